"""Stone Soup: ParticlePredictor, ParticleUpdater and its resampler at ESS < P / 2; moments before resampling."""

from datetime import datetime, timedelta

import cloud
import numpy as np
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
from stonesoup.predictor.particle import ParticlePredictor
from stonesoup.resampler.particle import ESSResampler, SystematicResampler
from stonesoup.types.array import StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import ParticleState
from stonesoup.types.update import Update
from stonesoup.updater.particle import ParticleUpdater
from worker import serve

given = cloud.load()
# its linear transition has no constant input: measured from the centre of the turn, the model needs none
fixed = np.linalg.solve(np.eye(2) - given.F[:2, :2], given.B[:2])
shift = np.tile(fixed, given.n // 2)
move = LinearGaussianTimeInvariantTransitionModel(transition_matrix=given.F, covariance_matrix=given.Q)
BEGIN = datetime(2020, 1, 1)


class See(LinearGaussian):
    """A linear measurement with any matrix; its own picks components."""

    def matrix(self, **_):  # noqa: D102
        return self.whole


def act(rng):  # noqa: D103
    resampler = ESSResampler(resampler=SystematicResampler())
    predictor, updater = ParticlePredictor(move), ParticleUpdater(None)
    x = given.m0 - shift + rng.standard_normal((given.P, given.root_P0.shape[1])) @ given.root_P0.T
    even = np.full(given.P, -np.log(given.P))
    state = ParticleState(StateVectors(x.T), log_weight=even, timestamp=BEGIN)
    found = [cloud.moments(x + shift, np.exp(even))]
    for k, (z, H, R) in enumerate(given.seen[1:], start=1):
        when = BEGIN + timedelta(seconds=k)
        state = predictor.predict(resampler.resample(state), timestamp=when)
        if len(z):
            model = See(ndim_state=given.n, mapping=tuple(range(len(z))), noise_covar=R)
            model.whole = H
            # H subtracts two points, so what is seen does not depend on where they are measured from
            seen = Detection(z[:, None], timestamp=when, measurement_model=model)
            state = updater.update(SingleHypothesis(state, seen))
        else:
            state = Update.from_state(state, hypothesis=None, timestamp=when)
        found.append((np.asarray(state.mean, dtype=float).ravel() + shift, np.asarray(state.covar, dtype=float)))
    return cloud.stacked(found)


generator = np.random.default_rng(0)
serve(lambda: generator, act, given.answer)
