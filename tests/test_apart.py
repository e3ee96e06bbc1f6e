"""A cloud that never resamples, in parts: one mixture, and what is left out changes nothing."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.stats import ks_2samp
from test_proposals import cut, lost
from worlds import everything, full_scenario, problem, reference

from data_simulation import HANDOUT
from lab.result import Filtered
from lab.solvers import apart, compiled, guided, particle_steps, rbpf, sis
from lab.solvers.plan import plan
from lab.solvers.proposals import prior
from lab.validation import InputError

LANES = 256


def clouds(rng, sizes, n_instants=6, d=3, rises=None):
    """Return answers of clouds of these sizes, and all their particles and weights at each instant.

    With `rises`, a log-weight rises by no more than that at each step.
    """
    answers, everybody = [], [[] for _ in range(n_instants)]
    for n in sizes:
        log_w = np.vstack([np.zeros(n), rng.normal(scale=3, size=(n_instants - 1, n)).cumsum(axis=0)])
        log_w += rng.normal(scale=4, size=(n_instants, 1)).cumsum(axis=0) * (np.arange(n_instants)[:, None] > 0)
        if rises is not None:
            log_w[1:] = np.cumsum(rises[:, np.newaxis] - rng.gamma(1, 3, size=(n_instants - 1, n)), axis=0)
        x = rng.normal(size=(n_instants, d, n)) + rng.normal(size=(n_instants, d, 1))
        w = np.exp(log_w)
        share = w / w.sum(axis=1, keepdims=True)
        means = np.einsum("kdn,kn->kd", x, share)
        off = x - means[:, :, np.newaxis]
        covs = np.einsum("kdn,ken,kn->kde", off, off, share)
        answers.append(
            Filtered(means, covs, np.log(w.mean(axis=1)), 1 / (share**2).sum(axis=1), np.full(n_instants, n))
        )
        for k in range(n_instants):
            everybody[k].append((x[k], w[k]))
    return answers, [tuple(np.concatenate(each, axis=-1) for each in zip(*some, strict=True)) for some in everybody]


@pytest.mark.parametrize("at_once", [apart.AT_ONCE, 20])
def test_parts_are_one_mixture(monkeypatch, at_once):
    """All particles of all parts together, weighed by hand."""
    monkeypatch.setattr(apart, "PART", 40)
    monkeypatch.setattr(apart, "AT_ONCE", at_once)
    answers, everybody = clouds(np.random.default_rng(0), [40, 40, 40, 7])
    asked = []

    def cloud(n):
        asked.append(n)
        return lambda least: answers[len(asked) - 1]

    whole = apart.run_apart(cloud, 127, np.zeros(5))
    assert asked == [40, 40, 40, 7]
    assert (whole.log_evidence[0], whole.survivors.tolist()) == (0, [127] * 6)
    for k, (x, w) in enumerate(everybody):
        share = w / w.sum()
        mean = x @ share
        np.testing.assert_allclose(whole.means[k], mean, rtol=1e-12, atol=1e-12)
        off = x - mean[:, np.newaxis]
        np.testing.assert_allclose(whole.covs[k], (share * off) @ off.T, rtol=1e-11, atol=1e-12)
        np.testing.assert_allclose(whole.log_evidence[k], np.log(w.mean()), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(whole.ess[k], 1 / (share**2).sum(), rtol=1e-11)


def test_what_is_left_out_can_never_count(monkeypatch):
    """The bounds, by explicit loops over all instants to come, where each log-weight rises by the constant at most."""
    rng = np.random.default_rng(1)
    monkeypatch.setattr(apart, "PART", 40)
    constants, bounds = rng.normal(scale=3, size=5), []
    answers, _ = clouds(rng, [40, 40, 9], rises=constants)

    def cloud(n):
        def run(least):
            bounds.append((n, least))
            return answers[len(bounds) - 1]

        return run

    apart.run_apart(cloud, 89, constants)
    log_total = np.full(6, -np.inf)
    for (n, least), answer in zip(bounds, answers, strict=True):
        for k in range(6):
            # all of them at their heaviest, and one of them with all that it can gain
            assert least[0, k] + 2 * np.log(n) == pytest.approx(log_total[k] - 52)
            reached = [log_total[s] - constants[k:s].sum() for s in range(k, 6)]
            assert least[1, k] + np.log(n) == pytest.approx(min(reached) - 52)
        log_total = np.logaddexp(log_total, answer.log_evidence + np.log(n))


@pytest.fixture
def kernels():
    """Skip where there are none."""
    return pytest.importorskip("lab.fast.compiled", reason="the extra toy-slam-lab[fast] is not installed")


def in_parts(monkeypatch, size, faint):
    monkeypatch.setattr(apart, "PART", size)
    monkeypatch.setattr(apart, "FAINT", faint)


def all_seen(off=0.0):
    """Four landmarks in sight all the time, of which the last sighting but one is false by some metres."""
    steady = replace(full_scenario(4, field_of_view=everything, n_steps=40), robot_noise_cov=np.zeros((2, 2)))
    world = problem(steady)
    z = world.z.copy()
    z[-2] += off
    return replace(world, z=z)


STEADY = {
    "handout": lambda: problem(replace(HANDOUT, robot_noise_cov=np.zeros((2, 2)))),
    "all seen": all_seen,
    "false by 1.8 m": partial(all_seen, 1.8),
    "false by 3 m": partial(all_seen, 3.0),
}


@pytest.mark.parametrize("name", STEADY)
def test_parts_leave_out_nothing_that_shows(monkeypatch, kernels, name):
    """A robot that goes as it is told: nothing is drawn after time 0, so that the particles are those of one cloud."""
    world, answers, runs, run = STEADY[name](), [], [], kernels.run
    monkeypatch.setattr(kernels, "run", lambda *given: runs.append(given) or run(*given))
    for size, faint, n_parts in ((10**9, 52.0, 1), (2 * LANES, np.inf, 5), (2 * LANES, 52.0, 5)):
        in_parts(monkeypatch, size, faint)
        before = len(runs)
        answers.append(sis(world, np.random.default_rng(5), n_particles=9 * LANES + 31, backend="numba"))
        assert len(runs) - before == n_parts
    whole, parts, fewer = answers
    scale = np.abs(whole.means).max()
    assert whole.ess.min() < 2 < whole.ess[1:].max()
    for answer in (parts, fewer):
        np.testing.assert_allclose(answer.means, whole.means, rtol=0, atol=1e-11 * scale)
        np.testing.assert_allclose(answer.covs, whole.covs, rtol=0, atol=1e-11 * scale**2)
        np.testing.assert_allclose(answer.log_evidence, whole.log_evidence, rtol=1e-11, atol=1e-9)
        np.testing.assert_allclose(answer.ess, whole.ess, rtol=1e-8)
        np.testing.assert_array_equal(answer.survivors, whole.survivors)


@pytest.mark.parametrize("k", [9, 38])  # before a step like others, and after a false sighting
def test_who_need_not_go_on_is_who_weighs_too_little_by_then(kernels, k):
    """The readable loop's particles, of which a mask takes those that go on."""
    from test_compiled import Replay

    world, n = all_seen(1.8), 6 * LANES
    options = {"proposal": prior, "n_particles": n, "ess_threshold": 0.0, "resample": "systematic"}
    steps = list(particle_steps(world, Replay(5), **options))
    logs = np.array([step.log_evidence + step.cloud.log_weights for step in steps])
    for heavy in (n // 3, n // 20, 0):
        bound = np.partition(logs[k], -heavy)[-heavy] - 1e-6 if heavy else logs[k].max() + 1
        least = np.full((2, world.n_instants), -np.inf)
        least[1, k] = bound
        state = kernels.seed(np.random.default_rng(5))
        answer = compiled._Cloud(kernels, plan(world, prior), 0.0, "systematic", state, n)(least)
        means = answer.means[:, plan(world, prior).back]
        for j, step in enumerate(steps):
            goes_on = (logs[k] >= bound) | (j <= k)
            w = np.where(goes_on, np.exp(logs[j] - logs[j].max()), 0)
            if not w.any():
                assert answer.log_evidence[j] == -np.inf
                continue
            assert answer.log_evidence[j] == pytest.approx(np.log(w.sum()) + logs[j].max(), abs=1e-8)
            assert answer.ess[j] == pytest.approx(w.sum() ** 2 / (w @ w), rel=1e-8)
            np.testing.assert_allclose(means[j], step.cloud.particles @ w / w.sum(), rtol=0, atol=1e-9)


def test_nothing_is_drawn_for_who_does_not_go_on(kernels):
    world, states = problem(), []
    for bound in (-np.inf, np.inf):
        least = np.full((2, world.n_instants), -np.inf)
        least[1, 9] = bound
        states.append(kernels.seed(np.random.default_rng(5)))
        compiled._Cloud(kernels, plan(world, prior), 0.0, "systematic", states[-1], 4 * LANES)(least)
    assert (states[0] != states[1]).any()


def test_who_goes_on_moves_up(kernels):
    """What boolean indexing says, when that saves a block, and nothing otherwise."""
    import numba

    from lab.fast.dropping import leave_out

    called = numba.njit(lambda *given: leave_out(*given))
    rng, n, n_active = np.random.default_rng(0), 5 * LANES - 100, 2
    for share in (0.0, 0.1, 0.5, 0.75, 0.99, 1.0):
        logs, static = np.full((5, LANES), -np.inf), rng.normal(size=(6, 5 * LANES))
        logs.reshape(-1)[:n] = rng.normal(size=n)
        places, before, rows = np.full(n + 1, -1, dtype=np.int32), logs.reshape(-1)[:n].copy(), static.copy()
        least = np.quantile(before, 1 - share) if 0 < share < 1 else (np.inf if share == 0 else -np.inf)
        heavy = np.flatnonzero(before >= least)
        left = called(logs, static, n_active, n, least, places)
        if share > 0.8:
            assert left == n
            np.testing.assert_array_equal(logs.reshape(-1)[:n], before)
            np.testing.assert_array_equal(static, rows)
            continue
        assert left == len(heavy)
        np.testing.assert_array_equal(places[:left], heavy)
        np.testing.assert_array_equal(static[n_active:, :left], rows[n_active:, heavy])
        lanes = logs.reshape(-1)[: -(-left // LANES) * LANES]
        np.testing.assert_array_equal(lanes[:left], before[heavy])
        assert (lanes[left:] == -np.inf).all()


@pytest.mark.parametrize("solver", [sis, partial(guided, ess_threshold=0), partial(rbpf, ess_threshold=0)])
def test_parts_have_the_distribution_of_one_cloud(monkeypatch, kernels, solver):
    """Log-evidence, ESS and a mean of 200 runs each: Kolmogorov and Smirnov, one false alarm in 10^4."""
    world, found = cut(reference(1).problem, 14), []
    for i, size in enumerate((10**9, LANES)):
        in_parts(monkeypatch, size, 52.0)
        generators = [np.random.default_rng([s, i]) for s in range(200)]
        answers = [solver(world, rng, n_particles=5 * LANES, backend="numba") for rng in generators]
        found.append(
            [[a.log_evidence[-1] for a in answers], [a.ess[4] for a in answers], [a.means[-1, 3] for a in answers]]
        )
    for one, two in zip(*found, strict=True):
        assert ks_2samp(one, two).pvalue > 1e-4


def test_parts_without_weight_are_told_of_as_one_cloud(monkeypatch, kernels):
    in_parts(monkeypatch, LANES, 52.0)
    with pytest.raises(InputError, match=r"At k = \d+: .* every weight is zero"):
        sis(lost(), np.random.default_rng(0), n_particles=3 * LANES, backend="numba")


def test_where_a_part_has_no_weight_the_whole_cloud_is_run(monkeypatch, kernels):
    """As if there had never been parts: with the same draws."""

    def first_part_only(cloud, n_particles, constants):
        cloud(LANES)(-np.inf)
        raise InputError("the second one has none")

    world = problem()
    in_parts(monkeypatch, 10**9, 52.0)
    whole = sis(world, np.random.default_rng(5), n_particles=3 * LANES, backend="numba")
    in_parts(monkeypatch, LANES, 52.0)
    monkeypatch.setattr(apart, "run_apart", first_part_only)
    answer = sis(world, np.random.default_rng(5), n_particles=3 * LANES, backend="numba")
    np.testing.assert_array_equal(answer.means, whole.means)
