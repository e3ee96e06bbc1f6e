"""The compiled loop: step for step the readable loop on the same random numbers, and equal to it in distribution."""

import numpy as np
import pytest
from test_proposals import PROPOSALS, coupled, cut
from worlds import WORLDS, full_scenario, problem

from lab.problem import LinearGaussianModel, Problem
from lab.solvers import compiled, particle_steps

kernels = pytest.importorskip("lab.fast.compiled", reason="the extra toy-slam-lab[fast] is not installed")


class Replay(np.random.Generator):
    """A generator that gives the readable loop the numbers which the compiled one draws from the seed."""

    def __init__(self, seed):
        super().__init__(np.random.PCG64(0))
        self.state = kernels.seed(np.random.default_rng(seed))

    def standard_normal(self, size):
        rows, n = size
        lanes = self.state.shape[1]
        block, blocks = np.empty((rows + 2, lanes)), []
        for _ in range(-(-n // lanes)):
            kernels.normals(self.state, block, rows)
            blocks.append(block[:rows].copy())
        return np.concatenate(blocks, axis=1)[:, :n]

    def random(self):
        row = np.empty((1, self.state.shape[1]))
        kernels.uniforms(self.state, row, 0)
        return row[0, 0]


def mixed():
    """F that mixes all components."""
    world = problem(full_scenario(1))
    F = np.eye(4) + 0.1 * np.random.default_rng(2).standard_normal((4, 4))
    model = LinearGaussianModel(F, world.model.B, world.model.Q, world.model.m0, world.model.P0)
    return Problem(model, world.z, world.H, world.R)


TWIN_WORLDS = WORLDS | {"coupled": coupled, "mixed": lambda: cut(mixed(), 8), "one instant": lambda: cut(problem(), 1)}


@pytest.mark.parametrize("world", TWIN_WORLDS)
@pytest.mark.parametrize("name", PROPOSALS)
def test_twin(world, name):
    """The readable loop, fed the same random numbers: the same moments, evidence, ESS and survivors."""
    problem, proposal = TWIN_WORLDS[world](), PROPOSALS[name]
    for n_particles, ess_threshold in ((700, 0.5), (256, 1.0), (30, 0.0), (1, 0.5)):
        options = {"proposal": proposal, "n_particles": n_particles, "ess_threshold": ess_threshold}
        options["resample"] = "systematic"
        answer = compiled.run(problem, np.random.default_rng(3), **options)
        steps = list(particle_steps(problem, Replay(3), **options))
        scale = np.abs([step.mean for step in steps]).max()
        np.testing.assert_allclose(answer.means, [step.mean for step in steps], rtol=0, atol=1e-10 * scale)
        np.testing.assert_allclose(answer.covs, [step.cov for step in steps], rtol=0, atol=1e-10 * scale)
        np.testing.assert_allclose(answer.log_evidence, [s.log_evidence for s in steps], rtol=1e-10, atol=1e-9)
        np.testing.assert_allclose(answer.ess, [step.ess for step in steps], rtol=1e-8)
        np.testing.assert_array_equal(answer.survivors, [step.survivors for step in steps])
