"""The fast loop in numpy: step for step the readable loop, on the same random numbers."""

import numpy as np
import pytest
from test_proposals import PROPOSALS, coupled, cut, lost, mixed
from worlds import WORLDS, full_scenario, problem

from lab import weights
from lab.problem import LinearGaussianModel, Problem
from lab.resampling import RESAMPLERS
from lab.result import collect
from lab.solvers import blocked, kalman, particle, particle_steps, sir
from lab.solvers.blocked import LONG
from lab.solvers.clones import FEW, LARGEST, Clones, _moments
from lab.solvers.plan import plan
from lab.solvers.proposals import prior
from lab.solvers.steps import steps_of
from lab.solvers.together import FEWEST
from lab.validation import InputError

TWIN_WORLDS = WORLDS | {"coupled": coupled, "mixed": lambda: cut(mixed(), 8), "one instant": lambda: cut(problem(), 1)}


def both(problem, proposal, seed, scheme="systematic", **options):
    options |= {"proposal": proposal, "resample": scheme}
    (fast,) = blocked.run(problem, [np.random.default_rng(seed)], **options)
    return fast, collect(particle_steps(problem, np.random.default_rng(seed), **options))


def assert_same(fast, readable):
    scale = np.abs(readable.means).max()
    np.testing.assert_allclose(fast.means, readable.means, rtol=0, atol=1e-11 * scale)
    np.testing.assert_allclose(fast.covs, readable.covs, rtol=0, atol=1e-11 * scale)
    np.testing.assert_allclose(fast.log_evidence, readable.log_evidence, rtol=1e-11, atol=1e-9)
    np.testing.assert_allclose(fast.ess, readable.ess, rtol=1e-9)
    np.testing.assert_array_equal(fast.survivors, readable.survivors)


@pytest.mark.parametrize("world", TWIN_WORLDS)
@pytest.mark.parametrize("name", PROPOSALS)
def test_twin(world, name):
    problem = TWIN_WORLDS[world]()
    for n_particles, ess_threshold, scheme in (
        (700, 0.5, "systematic"),
        (256, 1.0, "stratified"),
        (30, 0.0, "systematic"),
        (1, 0.5, "stratified"),
    ):
        options = {"n_particles": n_particles, "ess_threshold": ess_threshold}
        assert_same(*both(problem, PROPOSALS[name], 3, scheme, **options))


@pytest.mark.parametrize("n_particles", [LARGEST - 1, LARGEST, LARGEST + 1, 2 * LARGEST + 96])
@pytest.mark.parametrize("name", PROPOSALS)
def test_twin_over_blocks(n_particles, name):
    assert_same(*both(cut(problem(), 12), PROPOSALS[name], 4, n_particles=n_particles, ess_threshold=0.7))


def test_twin_with_few_ancestors():
    """Which are then gone through one by one, over the edges of blocks."""
    fast, readable = both(problem(), prior, 5, n_particles=2 * LARGEST + 96, ess_threshold=0.9)
    assert fast.survivors[25] * LONG < 2 * LARGEST
    assert fast.survivors[25] > 2
    assert_same(fast, readable)


def test_landmarks_are_kept_once_for_each_ancestor():
    """Static rows shrink with the survivors, whose places in the cloud they give."""
    laws = blocked.plan(cut(problem(), 12), prior)
    cloud = Clones(laws, 50, [np.random.default_rng(0)])
    before, places = cloud.static, np.sort(np.random.default_rng(1).integers(0, 50, 50))
    cloud.resample(np.searchsorted(places, np.arange(50), side="right"))
    assert cloud.static.shape[1] == len(cloud.starts) == len(np.unique(places)) < 50
    np.testing.assert_array_equal(cloud.spread_out(cloud.static), before[:, places])


def test_resampling_leaves_the_order_of_memory_as_it_was():
    """Products of few particles add in it: a last digit would depend on whether another run had resampled."""
    cloud = Clones(blocked.plan(cut(problem(), 12), prior), FEW, [np.random.default_rng(0)])
    assert cloud.static.flags.f_contiguous
    cloud.resample(np.minimum(2 * np.arange(1, FEW + 1), FEW))
    assert cloud.static.flags.f_contiguous
    assert not cloud.static.flags.c_contiguous


@pytest.mark.parametrize("n_particles", [FEWEST, 7, 100, FEW])
@pytest.mark.parametrize("name", PROPOSALS)
def test_runs_together_have_the_numbers_of_runs_alone(n_particles, name):
    """To the last digit: nothing may depend on which runs share a call."""
    world, options = cut(problem(), 15), {"proposal": PROPOSALS[name], "n_particles": n_particles}
    for options["resample"], options["ess_threshold"] in (("systematic", 0.5), ("stratified", 0.9)):
        together = blocked.run(world, [np.random.default_rng(s) for s in range(10)], **options)
        for seed, answer in enumerate(together):
            (alone,) = blocked.run(world, [np.random.default_rng(seed)], **options)
            for one, other in zip(vars(alone).values(), vars(answer).values(), strict=True):
                np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("scheme", RESAMPLERS)
def test_who_runs_a_scheme(scheme, monkeypatch):
    """Schemes whose ancestors ascend go the fast way, others and functions through the readable loop."""
    went = []
    monkeypatch.setattr(particle.blocked, "run", lambda *args, **options: [went.append("fast")])
    monkeypatch.setattr(particle, "collect", lambda steps: went.append("readable"))
    for resample in (scheme, RESAMPLERS[scheme]):
        sir(problem(), np.random.default_rng(0), n_particles=5, resample=resample)
    assert went == ["fast" if scheme in ("systematic", "stratified") else "readable", "readable"]


def test_weights_that_are_all_zero_name_their_instant():
    with pytest.raises(InputError, match=r"At k = \d+: .* every weight is zero"), np.errstate(over="ignore"):
        sir(lost(), np.random.default_rng(0), n_particles=300)


@pytest.mark.parametrize("near", [False, True])
def test_a_covariance_far_smaller_than_what_surrounds_it(near):
    """Nearly all weight at one place, far from where most particles are: differences of squares would drown it."""
    rng = np.random.default_rng(0)
    x, w = 1e3 + rng.standard_normal((3, 5000)), np.zeros(5000)
    x[:, 17:20] = np.array([[1e3], [1e6], [-1e3]]) + 1e-4 * rng.standard_normal((3, 3))
    w[17:20] = 0.5, 0.3, 0.2
    mean, cov = _moments([x[:1], x[1:]], 7 * w, 7 * w.sum(), near=near)
    expected = weights.moments(x, w / w.sum())
    np.testing.assert_allclose(mean, expected[0], rtol=1e-14)
    np.testing.assert_allclose(cov, expected[1], rtol=1e-6)
    assert (np.diag(cov) > 0).all()


@pytest.mark.parametrize("near", [False, True])
@pytest.mark.parametrize("n", [2, 33])
def test_moments_of_few_and_of_many_rows(n, near):
    rng = np.random.default_rng(n)
    x, w = (1 if near else 10) + rng.standard_normal((n, 3000)), rng.gamma(0.3, size=3000)
    mean, cov = _moments([x[:2], x[2:]], w, w.sum(), near=near)
    expected = weights.moments(x, w / w.sum())
    np.testing.assert_allclose(mean, expected[0], rtol=1e-13)
    np.testing.assert_allclose(cov, expected[1], rtol=0, atol=1e-13)


@pytest.mark.parametrize("name", PROPOSALS)
def test_rows_are_counted_from_a_path_only_where_measurements_keep_it_near(name):
    """What nothing corrects may go anywhere without its particles, which weights hold near the data."""
    given = problem(full_scenario(3, n_steps=30))
    laws = plan(given, PROPOSALS[name])
    steps, loose = steps_of(laws), name in ("prior", "rbpf-prior")
    exact = kalman(given)
    for k, step in enumerate(steps, start=1):
        assert (step.path[:2] == 0).all() == loose
        assert step.shift.any() == loose
        if not loose:
            means, stds = exact.means[k, laws.order], exact.stds[k, laws.order]
            assert (np.abs(step.path - means) <= 30 * stds).all()


def test_twin_with_a_motion_that_is_not_stable():
    world = cut(problem(), 40)
    model = world.model
    F = model.F.copy()
    F[:2, :2] *= 1.3
    given = Problem(LinearGaussianModel(F, model.B, model.Q, model.m0, model.P0), world.z, world.H, world.R)
    for proposal in PROPOSALS.values():
        fast, readable = both(given, proposal, 6, n_particles=1000, ess_threshold=0.5)
        np.testing.assert_allclose(fast.means, readable.means, rtol=0, atol=1e-6 * np.abs(readable.means).max())
        np.testing.assert_array_equal(fast.survivors, readable.survivors)


@pytest.mark.parametrize("threshold", [0.0, 0.5])
@pytest.mark.parametrize("distance", [12.0, 40.0, 400.0])
def test_twin_where_all_particles_are_far_from_what_is_seen(distance, threshold):
    """Weights that are all faint, some of them 0, count from the largest; the next instants go on from there."""
    world = cut(problem(), 20)
    z = world.z.copy()
    z[[4, 5, 11]] += distance
    world = Problem(world.model, z, world.H, world.R)
    options = {"n_particles": 700, "ess_threshold": threshold, "proposal": prior, "resample": "systematic"}
    together = blocked.run(world, [np.random.default_rng(seed) for seed in range(4)], **options)
    for seed, answer in enumerate(together):
        assert_same(answer, collect(particle_steps(world, np.random.default_rng(seed), **options)))
