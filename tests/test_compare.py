"""The comparison: metrics by their definitions, seeds, failures, and the table."""

import threading
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
import pytest
from worlds import full_scenario, problem, reference

from data_simulation import Scenario
from lab.compare import compare, designs, partial_comparison
from lab.comparison import Comparison, Record, Unit
from lab.findings import findings
from lab.metrics import Metrics, measure
from lab.problem import Problem
from lab.result import Filtered
from lab.solvers import guided, kalman, rbpf, sir, sis
from lab.theory import forecast
from lab.units import all_units, data_set_seeds, unit_seed
from lab.validation import InputError
from lab.work import Work


@pytest.fixture(scope="module")
def world():
    return problem(full_scenario(2, n_steps=12))


@pytest.fixture(scope="module")
def comparison(world):
    return compare(world, {"sis": sis, "sir": sir}, n_particles=[20, 100], runs=3, seed=4)


def test_metrics_by_explicit_loops(world):
    exact = kalman(world)
    answer = sir(world, np.random.default_rng(1), n_particles=50)
    metrics = measure(answer, exact, 50, 0.25)
    squares, ratios = [], []
    for k in range(1, world.n_instants):
        for i in range(6):
            squares.append(((answer.means[k, i] - exact.means[k, i]) / np.sqrt(exact.covs[k, i, i])) ** 2)
        difference = answer.covs[k] - exact.covs[k]
        ratios.append(np.sqrt((difference**2).sum()) / np.sqrt((exact.covs[k] ** 2).sum()))
    assert metrics.mean_gap == pytest.approx(np.sqrt(sum(squares) / len(squares)))
    assert metrics.cov_gap == pytest.approx(sum(ratios) / len(ratios))
    assert metrics.log_evidence_gap == pytest.approx(answer.log_evidence[-1] - exact.log_evidence[-1])
    assert metrics.ess_min == pytest.approx(min(answer.ess) / 50)
    assert metrics.ancestors_left == answer.survivors[-1]
    assert metrics.seconds == 0.25
    expected = [k for k in range(world.n_instants) if answer.ess[k] < 2]
    assert metrics.collapsed_at == (expected[0] if expected else pytest.approx(np.nan, nan_ok=True))


def test_collapse_and_single_ancestor_are_dated_from_the_first_instant():
    exact = kalman(problem())
    ess = np.full(50, 30.0)
    survivors = np.full(50, 40)
    calm = measure(Filtered(exact.means, exact.covs, exact.log_evidence, ess, survivors), exact, 60, 0)
    assert np.isnan(calm.collapsed_at)
    assert np.isnan(calm.one_ancestor_at)
    assert (calm.mean_gap, calm.cov_gap, calm.log_evidence_gap, calm.ess_min) == (0, 0, 0, 0.5)
    ess[7:9], ess[5], survivors[12:] = 1.99, 2.0, 1
    bad = measure(Filtered(exact.means, exact.covs, exact.log_evidence, ess, survivors), exact, 60, 0)
    assert (bad.collapsed_at, bad.one_ancestor_at, bad.ancestors_left) == (7, 12, 1)


def test_an_exact_answer_has_no_gap_and_known_components_are_left_out(world):
    model = world.model
    P0, Q = model.P0.copy(), np.zeros_like(model.Q)
    P0[:2], P0[:, :2] = 0, 0  # the robot's path is known exactly
    known = Problem(type(model)(model.F, model.B, Q, model.m0, P0), world.z, world.H, world.R)
    exact = kalman(known)
    assert not exact.stds[:, :2].any()
    shifted = Filtered(exact.means + np.array([9, 9, 0, 0, 0, 0]), exact.covs, exact.log_evidence)
    metrics = measure(shifted, exact, 10, 0)
    assert (metrics.mean_gap, metrics.cov_gap, metrics.log_evidence_gap) == (0, 0, 0)
    assert np.isnan([metrics.ess_min, metrics.collapsed_at, metrics.ancestors_left]).all()


def test_deviations_of_rounding_are_left_out():
    """cos(pi / 2) is 6e-17: a robot that the model knows exactly keeps deviations of 1e-17, which are no scale."""
    scenario = Scenario(
        n_steps=3, omega=np.pi / 2, robot_cov=(0, 0.1), robot_noise_cov=0, centre=(-1.5, 0.3), robot_mean=(0.7, 0.2)
    )
    world = problem(scenario, 1)
    exact = kalman(world)
    assert 0 < exact.stds[exact.stds > 0].min() < 1e-15
    assert measure(sir(world, np.random.default_rng(0), n_particles=10_000), exact, 10_000, 0).mean_gap < 0.5
    assert measure(rbpf(world, np.random.default_rng(0), n_particles=10_000), exact, 10_000, 0).mean_gap < 0.05


def test_summary_by_hand(comparison):
    summary, runs = comparison.summary(), comparison.runs
    assert list(summary.columns) == [
        *("solver", "n_particles", "runs", "mean_gap", "mean_gap_se", "cov_gap", "cov_gap_se"),
        *(
            "log_evidence_gap",
            "log_evidence_gap_se",
            "ess_min",
            "collapsed_at",
            "seconds_per_run",
            "ancestors_left",
            "data_sets",
        ),
    ]
    assert list(zip(summary["solver"], summary["n_particles"], strict=True)) == [
        *(("sis", 20), ("sis", 100), ("sir", 20), ("sir", 100))
    ]
    for row in summary.itertuples():
        mine = runs[(runs["solver"] == row.solver) & (runs["n_particles"] == row.n_particles)]
        assert row.runs == len(mine) == 3
        values = mine["mean_gap"].tolist()
        mean = sum(values) / 3
        assert row.mean_gap == pytest.approx(mean)
        assert row.mean_gap_se == pytest.approx(np.sqrt(sum((v - mean) ** 2 for v in values) / 2) / np.sqrt(3))
        collapsed = sorted(v for v in mine["collapsed_at"] if not np.isnan(v))
        assert row.collapsed_at == pytest.approx(np.median(collapsed) if collapsed else np.nan, nan_ok=True)


@pytest.mark.parametrize("data_sets", [1, 3])
def test_summary_is_what_pandas_makes_of_the_runs(data_sets):
    """Some runs fail, all of one data set do, metrics are missing at times or always, and N are met in turns."""
    rng, records = np.random.default_rng(0), []
    for data_set in range(data_sets):
        for solver, size in (("b", 10), ("a", 10), ("b", 5), ("a", 5)):
            for run in range(6):
                metrics = Metrics(
                    *rng.random(3), np.nan if solver == "a" else rng.random(), np.nan, seconds=rng.random()
                )
                if rng.random() < 0.5:
                    metrics = replace(metrics, collapsed_at=float(rng.integers(9)), log_evidence_gap=np.nan)
                else:
                    metrics = replace(metrics, ancestors_left=float(rng.integers(9)))
                failed = rng.random() < 0.3 or (data_set, solver) == (1, "b") or (solver, size) == ("a", 5)
                unit = Unit(solver, size, run, 0, data_set)
                records.append(Record(unit, Metrics(), error="no") if failed else Record(unit, metrics))
    worlds = (problem(),) * data_sets
    summary = Comparison(worlds, (), tuple(records)).summary()
    rows = pd.DataFrame([{**vars(r.unit), **vars(r.metrics)} for r in records if not r.error])
    assert list(zip(summary["solver"], summary["n_particles"], strict=True)) == [
        ("b", 10),
        ("a", 10),
        ("b", 5),
        ("a", 5),
    ]
    for row in summary.to_dict("records"):
        good = rows[(rows["solver"] == row["solver"]) & (rows["n_particles"] == row["n_particles"])]
        each = good.groupby("data_set").mean(numeric_only=True) if data_sets > 1 else good
        expected = {"runs": len(good), "data_sets": good["data_set"].nunique()}
        for name in ("mean_gap", "cov_gap", "log_evidence_gap"):
            expected |= {name: each[name].mean(), f"{name}_se": each[name].std(ddof=1) / np.sqrt(max(len(each), 1))}
        expected |= {name: each[name].mean() for name in ("ess_min", "ancestors_left")}
        expected |= {"seconds_per_run": each["seconds"].mean(), "collapsed_at": good["collapsed_at"].median()}
        assert {name: row[name] for name in expected} == pytest.approx(expected, rel=1e-12, nan_ok=True)
        assert set(row) == {*expected, "solver", "n_particles"}


def without_seconds(comparison):
    return comparison.runs.drop(columns="seconds")


def test_numbers_do_not_depend_on_order_workers_or_company(world, comparison):
    alone = compare(world, {"sir": sir}, n_particles=[100], runs=2, seed=4)
    runs = without_seconds(comparison)
    same = runs[(runs["solver"] == "sir") & (runs["n_particles"] == 100) & (runs["run"] < 2)]
    assert without_seconds(alone).equals(same.reset_index(drop=True))
    backwards = compare(world, {"sir": sir, "sis": sis}, n_particles=[100, 20], runs=3, seed=4, jobs=2)
    keys = ["solver", "n_particles", "run"]
    assert (
        without_seconds(backwards)
        .sort_values(keys, ignore_index=True)
        .equals(runs.sort_values(keys, ignore_index=True))
    )


def test_a_seed_repeats_its_run(world, comparison):
    row = comparison.runs.query("solver == 'sir' and n_particles == 100 and run == 2").iloc[0]
    answer = sir(world, np.random.default_rng(row["seed"]), n_particles=100)
    assert measure(answer, comparison.exacts[0], 100, 0).mean_gap == row["mean_gap"]


def test_seeds_differ_and_survive_a_spreadsheet():
    seeds = {unit_seed(s, name, n, r) for s in (0, 1) for name in ("sis", "sir") for n in (10, 11) for r in range(50)}
    assert len(seeds) == 400
    assert max(seeds) < 10**15  # what a spreadsheet keeps


def test_an_n_given_twice_counts_once():
    units = all_units({"a": sis}, [10, 20, 10], runs=2, seed=0)
    assert [(u.n_particles, u.run) for u in units] == [(10, 0), (10, 1), (20, 0), (20, 1)]


def test_failures_are_recorded_and_the_rest_goes_on(world):
    def sometimes(problem, rng, *, n_particles):
        if rng.random() < 0.5:
            raise ValueError("no luck\ntoday")
        return sis(problem, rng, n_particles=n_particles)

    done = []
    result = compare(world, {"sometimes": sometimes, "sis": sis}, n_particles=[10], runs=8, on_done=done.append)
    failed = result.failures
    assert 0 < len(failed) < 8
    assert len(done) == len(result.records) == 16
    assert all(record.unit.solver == "sometimes" for record in failed)
    assert "ValueError: no luck today" in failed[0].error
    assert "test_compare.py, line" in failed[0].error
    row = result.summary().set_index("solver").loc["sometimes"]
    assert row["runs"] == 8 - len(failed)
    assert row["mean_gap"] == pytest.approx(np.mean([r.metrics.mean_gap for r in result.of("sometimes", 10)]))
    unit = failed[0].unit
    assert any(
        f"run {unit.run}, seed {unit.seed}: ValueError" in sentence and f"{len(failed)} of 8 runs FAILED" in sentence
        for sentence in findings(result)
    )


class Speechless(BaseException):
    def __str__(self):
        raise ZeroDivisionError


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_error_without_words_is_a_failure_like_another(world, jobs):
    def speechless(problem, rng, *, n_particles):
        raise Speechless

    result = compare(world, {"mute": speechless, "sis": sis}, n_particles=[10], runs=1, jobs=jobs)
    assert [record.unit.solver for record in result.failures] == ["mute"]
    assert "Speechless: (it has no words)" in result.failures[0].error


def test_what_cannot_be_sent_to_a_worker_is_said(world):
    lock = threading.Lock()

    def locked(problem, rng, *, n_particles):
        with lock:
            return sis(problem, rng, n_particles=n_particles)

    with pytest.raises(InputError, match=r"cannot be sent to other processes .*jobs=1"):
        compare(world, {"locked": locked}, n_particles=[10], runs=1, jobs=2)
    assert not compare(world, {"locked": locked}, n_particles=[10], runs=1).failures


def test_a_unit_travels_with_its_own_data_set_only(world):
    work = Work((world, world), (kalman(world), kalman(world)), {"sis": sis, "sir": sir})
    unit = Unit("sir", 10, 0, 3, data_set=1)
    own = work.only((unit,))
    assert (own.problems[0], own.exacts[0], {*own.solvers}) == (None, None, {"sir"})
    assert own((unit,))[0].metrics.mean_gap == work((unit,))[0].metrics.mean_gap


def test_when_every_run_fails_the_row_is_there_and_empty(world):
    result = compare(world, {"bad": lambda problem, rng, *, n_particles: None}, n_particles=[10], runs=2)
    row = result.summary().iloc[0]
    assert row["runs"] == 0
    assert np.isnan(row["mean_gap"])
    assert len(findings(result)) == 1


def answer_with(**changes):
    def solver(problem, rng, *, n_particles):
        exact = kalman(problem)
        fields = {"means": exact.means, "covs": exact.covs, "log_evidence": exact.log_evidence}
        return Filtered(**(fields | {name: change(fields.get(name)) for name, change in changes.items()}))

    return solver


@pytest.mark.parametrize(
    ("solver", "message"),
    [
        (answer_with(means=np.transpose), r"means must have shape \(12, 6\), not \(6, 12\) \(time comes first: N = 12"),
        (answer_with(covs=lambda c: c[:, 0]), r"covs must have shape \(12, 6, 6\), not \(12, 6\)"),
        (answer_with(means=lambda m: np.where(m > 0, m, np.nan)), "means must be finite, but holds NaN"),
        (answer_with(log_evidence=lambda v: v[-1]), r"log_evidence must have shape \(12,\), not \(\)"),
        (answer_with(log_evidence=lambda v: None), "log_evidence must hold real numbers"),
        (answer_with(ess=lambda v: np.ones(11)), r"ess must have shape \(12,\)"),
        (answer_with(survivors=lambda v: np.ones((12, 1))), r"survivors must have shape \(12,\)"),
        (answer_with(covs=np.negative), "covs has a negative variance at k = 0"),
        (lambda problem, rng, *, n_particles: (1, 2), "it returned tuple, not lab.result.Filtered"),
    ],
)
def test_bad_answers_are_named(world, solver, message):
    result = compare(world, {"mine": solver}, n_particles=[10], runs=1)
    with pytest.raises(InputError, match=message):
        raise InputError(result.failures[0].error)


def test_an_answer_in_lists_is_as_good_as_one_in_arrays(world):
    def lists(problem, rng, *, n_particles):
        exact = kalman(problem)
        return Filtered(exact.means.tolist(), exact.covs.tolist(), exact.log_evidence.tolist(), [2] * 12, [3] * 12)

    result = compare(world, {"lists": lists}, n_particles=[10], runs=1)
    assert not result.failures
    assert result.runs["mean_gap"].tolist() == [0]


def test_keyboard_interrupt_is_not_a_failure_of_the_solver(world):
    def interrupted(problem, rng, *, n_particles):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        compare(world, {"mine": interrupted}, n_particles=[10], runs=1)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"n_particles": [0]}, "n_particles must be at least 1"),
        ({"n_particles": [10.5]}, "whole number"),
        ({"n_particles": []}, "at least one solver and one number"),
        ({"solvers": {}}, "at least one solver and one number"),
        ({"runs": 0}, "runs must be at least 1"),
        ({"seed": -1}, "seed must be at least 0"),
        ({"jobs": 0}, "jobs must be at least 1"),
        ({"jobs": -2}, "jobs must be at least 1"),
        ({"jobs": 1.5}, "jobs must be at least 1"),
        ({"n_particles": [[10]]}, "n_particles must be a whole number"),
        ({"solvers": [sis]}, "solvers must map labels to functions"),
        ({"solvers": {1: sis}}, "solvers must map labels to functions"),
    ],
)
def test_bad_arguments(world, changes, message):
    arguments = {"solvers": {"sis": sis}, "n_particles": [10], "runs": 1, "seed": 0, "jobs": 1} | changes
    with pytest.raises(InputError, match=message):
        compare(world, **arguments)


def test_one_number_of_particles_needs_no_list(world):
    assert compare(world, {"sis": sis}, n_particles=10, runs=1).runs["n_particles"].tolist() == [10]


def test_an_experiment_is_told_where_its_problem_is():
    with pytest.raises(InputError, match=r"not Experiment; give experiment\.problem"):
        compare(reference(1), {"sis": sis}, n_particles=[10], runs=1)
    with pytest.raises(InputError, match=r"give experiment\.problem"):
        kalman(reference(1))


def test_nothing_to_compare():
    with pytest.raises(InputError, match="no instant after k = 0"):
        compare(problem(full_scenario(1, n_steps=1)), {"sis": sis}, n_particles=[10])


def test_only_run_0_keeps_its_moments(comparison):
    assert [record.filtered is not None for record in comparison.of("sir", 100)] == [True, False, False]


def test_the_lesson_on_the_originals_experiment():
    """Figures of an independent implementation: SIS 3.9 and 3.4, SIR 3.6 and 2.8 for N = 100 and 1000; 5 errors."""
    result = compare(reference(1).problem, {"sis": sis, "sir": sir}, n_particles=[100, 1000], runs=20, seed=1)
    rows = result.summary().set_index(["solver", "n_particles"])
    for key, expected in {("sis", 100): 3.9, ("sis", 1000): 3.4, ("sir", 100): 3.6, ("sir", 1000): 2.8}.items():
        # that figure is itself a mean over 10 runs
        error = np.hypot(rows.loc[key, "mean_gap_se"], rows.loc[key, "mean_gap_se"] * np.sqrt(2))
        assert abs(rows.loc[key, "mean_gap"] - expected) <= 5 * error
    assert rows.loc["sis", "collapsed_at"].between(2, 4).all()
    assert (rows.loc["sir", "ancestors_left"] == 1).all()
    text = " ".join(findings(result))
    assert "sis: the weights collapse onto one particle" in text
    assert "sir: the whole map descends from ONE particle of time 0" in text
    assert "which the ESS hides" not in text.split("sir:")[0]


def test_a_conditional_map_is_not_called_one_map():
    """Rao-Blackwellized particles of one ancestor still differ, and so do landmarks drawn later or that jitter."""
    world = reference(1).problem
    result = compare(world, {"rbpf": rbpf, "guided": guided}, n_particles=[30], runs=3)
    assert (result.runs.groupby("solver")["one_ancestor_at"].count() > 0).all()
    text = " ".join(findings(result))
    assert "rbpf: all particles descend from ONE particle of time 0" in text
    assert "rbpf: the whole map" not in text
    jittered = " ".join(findings(compare(world.with_landmark_noise(0.05), {"sir": sir}, n_particles=[100], runs=2)))
    assert "sir: all particles descend from ONE particle of time 0" in jittered


def test_findings_of_a_good_filter_say_so(world):
    text = findings(compare(world, {"exact": answer_with()}, n_particles=[10], runs=2))
    assert text == ["exact: with N = 10 the mean is on average 0 exact standard deviations off: close to exact."]


def test_bound_options_reach_the_solver(world):
    runs = compare(world, {"a": partial(sir, ess_threshold=0.0)}, n_particles=[30], runs=1).runs
    assert runs["ancestors_left"].tolist() == [30]


def test_the_theory_knows_our_filters_by_their_options(world):
    solvers = {
        "a": sis,
        "b": partial(sir, ess_threshold=0.2),
        "c": guided,
        "d": partial(guided, proposal="optimal"),
        "e": partial(rbpf, proposal="prior", ess_threshold=0.9),
        "mine": answer_with(),
    }
    assert designs(solvers) == {
        "a": ("prior", 0.0),
        "b": ("prior", 0.2),
        "c": ("delayed", 0.5),
        "d": ("optimal", 0.5),
        "e": ("rbpf-prior", 0.9),
    }
    result = compare([world, world], solvers, n_particles=10, runs=1)
    assert {*result.forecasts} == {*"abcde"}
    assert (result.forecasts["b"][1] == forecast(world, "prior", ess_threshold=0.2)).all()
    assert result.bootstrap_log_variances.shape == (2, 12, 6)


def test_data_sets_that_do_not_fit_each_other(world):
    with pytest.raises(InputError, match="must have the same numbers of instants and landmarks"):
        compare([world, problem(full_scenario(1, n_steps=12))], {"sis": sis}, n_particles=10)
    with pytest.raises(InputError, match="no data set is given"):
        compare([], {"sis": sis}, n_particles=10)


def test_seeds_of_data_sets():
    seeds = data_set_seeds(7, 20)
    assert seeds[0] == 7
    assert len({*seeds, *data_set_seeds(8, 20)}) == 40
    assert data_set_seeds(7, 3) == seeds[:3]
    assert max(seeds) < 10**15


def test_it_shows_itself_in_a_notebook(comparison):
    assert repr(comparison) == "<Comparison of sis, sir with N = 20, 100: 12 runs>"
    page = comparison._repr_html_()
    assert page.count("<tr") == 5
    assert "<th>mean gap</th>" in page
    assert f"<td>{comparison.summary()['mean_gap'][0]:.3g}</td>" in page
    assert "failed" not in page


def test_progress_is_silent_where_nobody_watches(world, capfd):
    compare(world, {"sis": sis}, n_particles=[10], runs=2, progress=True)
    assert capfd.readouterr() == ("", "")


def test_a_part_of_a_comparison_is_one_too(world, comparison):
    part = partial_comparison([world], {"sis": sis, "sir": sir}, comparison.records[8:6:-1])
    assert part.runs.equals(comparison.runs.iloc[7:9].reset_index(drop=True))
    assert part.designs == comparison.designs


def test_a_unit_limits_blas_to_one_thread(world):
    seen = []

    def spy(problem, rng, *, n_particles):
        from threadpoolctl import threadpool_info

        seen.extend(pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas")
        return kalman(problem)

    Work((world,), (kalman(world),), {"spy": spy})((Unit("spy", 1, 0, 0),))
    assert seen
    assert set(seen) == {1}
