"""Consistency: the laws of a correct filter, the collapsed cloud that must show, and the handout's own finding."""

import numpy as np
import pytest
from scipy.stats import chi2, kstest
from worlds import covariance, experiment, full_scenario

from data_simulation import HANDOUT, data_simulation
from lab import consistency
from lab.problem import Experiment
from lab.result import Filtered
from lab.solvers import kalman, rbpf, sis
from lab.validation import InputError

EXOGENOUS = full_scenario(3, 5, field_of_view="exogenous", n_steps=15)


def simulate(scenario, n_experiments):
    return [Experiment.from_simulation(data_simulation(scenario=scenario, rng=seed)) for seed in range(n_experiments)]


@pytest.fixture(scope="module")
def exogenous():
    experiments = simulate(EXOGENOUS, 150)
    return experiments, [kalman(e.problem) for e in experiments]


@pytest.fixture(scope="module")
def table(exogenous):
    return consistency.assess(*exogenous, np.random.default_rng(0))


def test_nees_of_the_exact_filter_is_chi_square(exogenous):
    """Kolmogorov-Smirnov at k = 1 and at the end, 150 independent experiments each; odds of a false alarm 1e-4."""
    experiments, answers = exogenous
    for k in (1, 14):
        pairs = [consistency.nees(a, e.truth, a) for e, a in zip(experiments, answers, strict=True)]
        assert {dof[k] for _, dof in pairs} == {8}
        assert kstest([values[k] for values, _ in pairs], chi2(8).cdf).pvalue > 1e-4


def test_nis_of_the_exact_filter_is_chi_square(exogenous):
    experiments, answers = exogenous
    pairs = [consistency.nis(a, e.problem) for e, a in zip(experiments, answers, strict=True)]
    levels = np.concatenate([chi2.cdf(values[dof > 0], dof[dof > 0]) for values, dof in pairs])
    assert kstest(levels, "uniform").pvalue > 1e-4
    assert pairs[0][1][0] == 0


def test_assess_of_the_exact_filter(table):
    for name in ("nees_per_dof", "nis_per_dof", "robot_ellipses", "landmark_ellipses", "corridors"):
        row = table.loc[name]
        assert abs(row["value"] - row["expected"]) <= 4.5 * row["se"], name
        assert 0 < row["se"] < 0.06
    assert table.loc["kl", "value"] == pytest.approx(0, abs=1e-9)
    assert table.loc["kl", "expected"] == 0
    assert table.loc["wasserstein", "value"] == pytest.approx(0, abs=1e-6)


def test_overconfidence_shows(exogenous):
    experiments, answers = exogenous
    sure = [Filtered(a.means, a.covs / 2, a.log_evidence) for a in answers]
    table = consistency.assess(experiments, sure, np.random.default_rng(0))
    assert table.loc["nees_per_dof", "value"] == pytest.approx(2, abs=5 * table.loc["nees_per_dof", "se"])
    assert table.loc["nees_per_dof", "value"] > table.loc["nees_per_dof", "high"]
    assert table.loc["landmark_ellipses", "value"] == pytest.approx(chi2.cdf(chi2.ppf(0.99, 2) / 2, 2), abs=0.03)
    assert table.loc["kl", "value"] == pytest.approx(8 * (2 - 1 - np.log(2)) / 2)


def test_bootstrap_error_is_the_error_of_a_mean(exogenous, table):
    pairs = [consistency.nees(a, e.truth, a) for e, a in zip(*exogenous, strict=True)]
    values = [np.sum(errors[1:]) / np.sum(dof[1:]) for errors, dof in pairs]
    assert table.loc["nees_per_dof", "se"] == pytest.approx(np.std(values, ddof=1) / np.sqrt(150), rel=0.15)


def test_the_handouts_visibility_is_informative():
    """Its exact filter is too sure: in 3000 runs NEES was 14.1 of 12 at k = 49, landmark ellipses held 95.8 %."""
    experiments = simulate(HANDOUT, 250)
    answers = [kalman(e.problem) for e in experiments]
    ends = [Filtered(a.means[-1:], a.covs[-1:], a.log_evidence[-1:]) for a in answers]
    last = [consistency.nees(a, e.truth[-1:], a)[0][0] for e, a in zip(experiments, ends, strict=True)]
    held = [consistency.ellipses_hold(a, e.truth[-1:], a)[0, 1:].mean() for e, a in zip(experiments, ends, strict=True)]
    for values, figure in ((last, 14.1), (held, 0.958)):
        assert np.mean(values) == pytest.approx(figure, abs=5 * np.std(values, ddof=1) / np.sqrt(250))
    assert np.mean(last) > consistency.chi2_band(12, 250, 0.999)[1]
    assert np.mean(held) + 2.5 * np.std(held, ddof=1) / np.sqrt(250) < 0.99
    nis = consistency.assess(experiments[:40], answers[:40], np.random.default_rng(0)).loc["nis_per_dof"]
    assert abs(nis["value"] - 1) <= 4.5 * nis["se"]


def test_a_collapsed_cloud_is_infinitely_wrong_and_not_perfect():
    world = experiment()
    answer, exact = sis(world.problem, np.random.default_rng(0), n_particles=50), kalman(world.problem)
    collapsed = Filtered(answer.means, np.zeros_like(answer.covs), answer.log_evidence, answer.ess)
    values, dof = consistency.nees(collapsed, world.truth, exact)
    assert dof[0] == 10  # the robot is known at the start
    assert (dof[1:] == 12).all()
    assert np.isinf(values).all()
    assert np.isinf(consistency.kl_from_exact(collapsed, exact)).all()
    assert np.isfinite(consistency.wasserstein_from_exact(collapsed, exact)).all()
    assert not consistency.ellipses_hold(collapsed, world.truth, exact)[1:].any()
    table = consistency.assess([world, world], [collapsed, collapsed], np.random.default_rng(0))
    assert np.isinf(table.loc["nees_per_dof", "value"])


def test_a_cloud_of_low_rank_has_collapsed():
    """Five particles span four directions of twelve."""
    world = experiment()
    answer = sis(world.problem, np.random.default_rng(0), n_particles=5)
    values, _ = consistency.nees(answer, world.truth, kalman(world.problem))
    assert np.isinf(values).all()


def gaussians(d, seed):
    rng = np.random.default_rng(seed)
    means, covs = rng.standard_normal((2, 1, d)), [covariance(rng, d, 1.0)[None] for _ in range(2)]
    return [Filtered(m, c, np.zeros(1)) for m, c in zip(means, covs, strict=True)]


def test_kl_by_monte_carlo():
    exact, estimate = gaussians(3, 0)
    from scipy.stats import multivariate_normal

    p, q = (multivariate_normal(g.means[0], g.covs[0]) for g in (exact, estimate))
    draws = p.rvs(200_000, random_state=np.random.default_rng(1))
    ratios = p.logpdf(draws) - q.logpdf(draws)
    value = consistency.kl_from_exact(estimate, exact)[0]
    assert value == pytest.approx(ratios.mean(), abs=5 * ratios.std() / np.sqrt(200_000))
    assert abs(value - consistency.kl_from_exact(exact, estimate)[0]) > 0.1  # the direction matters


def test_wasserstein_of_commuting_covariances():
    """For diagonal covariances W2^2 is the sum of squared differences of means and of deviations."""
    exact = Filtered(np.array([[0.0, 1.0]]), np.diag([4.0, 9.0])[None], np.zeros(1))
    other = Filtered(np.array([[1.0, 1.0]]), np.diag([1.0, 16.0])[None], np.zeros(1))
    assert consistency.wasserstein_from_exact(other, exact)[0] == pytest.approx(np.sqrt(1 + 1 + 1))


def test_expected_distances_are_those_of_independent_draws():
    exact, _ = gaussians(4, 2)
    rng, size, runs = np.random.default_rng(3), 2000, 400
    kl, w2 = [], []
    for _ in range(runs):
        draws = rng.multivariate_normal(exact.means[0], exact.covs[0], size)
        estimate = Filtered(draws.mean(axis=0)[None], np.cov(draws.T, bias=True)[None], np.zeros(1))
        kl.append(consistency.kl_from_exact(estimate, exact)[0])
        w2.append(consistency.wasserstein_from_exact(estimate, exact)[0] ** 2)
    expected_kl = consistency.expected_kl(np.array([4]), np.array([size]))[0]
    expected_w2 = consistency.expected_wasserstein(exact, np.array([size]))[0] ** 2
    assert np.mean(kl) == pytest.approx(expected_kl, abs=5 * np.std(kl) / np.sqrt(runs) + 0.02 * expected_kl)
    assert np.mean(w2) == pytest.approx(expected_w2, abs=5 * np.std(w2) / np.sqrt(runs) + 0.02 * expected_w2)


def test_a_good_particle_filter_is_near_what_its_ess_allows():
    """The Rao-Blackwellized filter knows landmarks better than ESS draws would; SIS is far beyond."""
    experiments = simulate(full_scenario(2, 5, field_of_view="exogenous", n_steps=8), 12)
    good = [rbpf(e.problem, np.random.default_rng(s), n_particles=1000) for s, e in enumerate(experiments)]
    bad = [sis(e.problem, np.random.default_rng(s), n_particles=100) for s, e in enumerate(experiments)]
    good_table, bad_table = (consistency.assess(experiments, a, np.random.default_rng(0)) for a in (good, bad))
    assert good_table.loc["kl", "value"] <= good_table.loc["kl", "expected"]
    assert bad_table.loc["kl", "value"] > 10 * good_table.loc["kl", "value"]


def test_bands():
    low, high = consistency.chi2_band(3, 40)
    assert low == pytest.approx(2.29, abs=0.01)
    assert high == pytest.approx(3.81, abs=0.01)
    with pytest.raises(InputError, match="level must lie"):
        consistency.chi2_band(3, 40, 1.5)


def test_bad_arguments():
    world = experiment()
    answer = kalman(world.problem)
    with pytest.raises(InputError, match="at least two experiments"):
        consistency.assess([world], [answer], np.random.default_rng(0))
    blind = Experiment(world.problem, None, world.centre)
    with pytest.raises(InputError, match="needs the truth"):
        consistency.assess([blind, blind], [answer, answer], np.random.default_rng(0))
