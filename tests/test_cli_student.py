"""A student's function in the solver's slot: it takes part, or is named, and the rest goes on."""

import json
import shutil

import numpy as np
import pandas as pd
import pytest
from program import call
from worlds import experiment

from lab.solvers import SOLVERS, sir
from lab.units import unit_seed

FILTERS = """
from __future__ import annotations

import dataclasses

import numpy as np

from lab.result import Filtered
from lab.solvers import kalman, sir as reference
from neighbour import FACTOR


@dataclasses.dataclass
class Cloud:  # looks its module up in sys.modules
    weights: np.ndarray


def good(problem, rng, *, n_particles, ess_threshold=0.5, scheme="systematic"):
    return reference(
        problem, rng, n_particles=FACTOR * n_particles, ess_threshold=ess_threshold, resample=scheme
    )


def raising(problem, rng, *, n_particles):
    return problem.z[1000]


def unlucky(problem, rng, *, n_particles):
    if rng.random() < 0.5:
        raise ValueError("bad luck")
    return reference(problem, rng, n_particles=n_particles)


def changed(problem, rng, n_particles, **changes):
    answer = reference(problem, rng, n_particles=n_particles)
    return dataclasses.replace(answer, **{name: change(getattr(answer, name)) for name, change in changes.items()})


def with_nan(problem, rng, *, n_particles):
    return changed(problem, rng, n_particles, means=lambda means: np.where(means > 4, np.nan, means))


def time_last(problem, rng, *, n_particles):
    return changed(problem, rng, n_particles, means=np.transpose)


def no_covariances(problem, rng, *, n_particles):
    return changed(problem, rng, n_particles, covs=lambda covs: np.diagonal(covs, axis1=1, axis2=2))


def a_tuple(problem, rng, *, n_particles):
    return kalman(problem).means, kalman(problem).covs


def nothing(problem, rng, *, n_particles):
    pass


def leaving(problem, rng, *, n_particles):
    raise SystemExit("I leave")


def peeking(problem, rng, *, n_particles):
    return problem.truth


def editing(problem, rng, *, n_particles):
    problem.z[:] = 0


def exact(problem, rng, *, n_particles):
    return kalman(problem)


def _hidden(problem, rng, *, n_particles):
    return reference(problem, rng, n_particles=n_particles)


class Class:
    def __call__(self, problem, rng, *, n_particles):
        return reference(problem, rng, n_particles=n_particles)


made = Class()


def without_n(problem, rng):
    pass


def without_rng(problem, *, n_particles):
    pass


number = 3
"""
LINE = 1 + FILTERS.splitlines().index("    return problem.z[1000]")


@pytest.fixture
def filters(here):
    (here / "filters.py").write_text(FILTERS)
    (here / "neighbour.py").write_text("FACTOR = 2\n")
    return here


def compare(*solvers, particles="20", runs=2, more=()):
    return call("compare", "--solvers", ",".join(solvers), "--particles", particles, "--runs", runs, *more)


@pytest.fixture
def results(filters, no_pictures):
    """Compare and read what is written."""

    def results(*solvers, runs=2, more=()):
        done = compare(*solvers, runs=runs, more=("--out", "result", *more))
        assert done.err == ""
        return done, pd.read_csv("result/runs.csv"), pd.read_csv("result/summary.csv")

    return results


def test_a_good_one_takes_part(results, filters):
    done, runs, _ = results("mine=filters.py:good", "sir")
    assert done.status == 0
    problem = experiment(seed=0).problem
    expected = sir(problem, np.random.default_rng(unit_seed(0, "mine", 20, 1)), n_particles=40)
    assert runs["ancestors_left"][1] == expected.survivors[-1]
    assert runs["error"].isna().all()
    inputs = json.loads((filters / "result" / "config.json").read_text())["inputs"]
    assert inputs["solver mine"]["file"] == str(filters / "filters.py")


def test_without_a_label_it_goes_by_its_name(results):
    done, runs, _ = results("filters.py:good", "filters.py:good:ess_threshold=1:scheme=residual")
    assert done.status == 0
    assert list(dict.fromkeys(runs["solver"])) == ["good", "good:ess_threshold=1:scheme=residual"]


def test_its_options_arrive(results):
    _, runs, _ = results("never=filters.py:good:ess_threshold=0", "filters.py:good")
    by_label = runs.groupby("solver")["ancestors_left"]
    assert (by_label.get_group("never") == 40).all()
    assert (by_label.get_group("good") < 40).all()


def test_it_runs_in_workers_with_the_same_numbers(results):
    _, alone, _ = results("filters.py:good", "filters.py:unlucky", runs=6)
    _, shared, _ = results("filters.py:good", "filters.py:unlucky", runs=6, more=("--jobs", "2"))
    pd.testing.assert_frame_equal(alone.drop(columns="seconds"), shared.drop(columns="seconds"))
    assert 0 < alone["error"].notna().sum() < 6


def test_failing_in_some_runs_it_is_named_with_run_and_seed_and_the_rest_goes_on(results):
    done, runs, summary = results("sis", "filters.py:unlucky", runs=8)
    assert done.status == 1
    failed = runs[runs["error"].notna()]
    assert 0 < len(failed) < 8
    assert set(failed["solver"]) == {"unlucky"}
    assert summary["runs"].tolist() == [8, 8 - len(failed)]
    good = runs[(runs["solver"] == "unlucky") & runs["error"].isna()]
    assert summary["mean_gap"][1] == pytest.approx(good["mean_gap"].mean())
    first = failed.iloc[0]
    words = f"unlucky: {len(failed)} of 8 runs FAILED and are left out; the first is N = 20, run {first['run']},"
    words += f" seed {first['seed']}: ValueError: bad luck (filters.py, line "
    assert words in done.out
    assert first["seed"] == unit_seed(0, "unlucky", 20, first["run"])
    assert "sis: with N = 20 the mean is" in done.out


@pytest.mark.parametrize(
    ("function", "words"),
    [
        ("raising", f"IndexError: index 1000 is out of bounds for axis 0 with size 50 (filters.py, line {LINE})"),
        ("with_nan", "means must be finite, but holds NaN"),
        ("time_last", "means must have shape (50, 12), not (12, 50) (time comes first: N = 50 instants, n = 12"),
        ("no_covariances", "covs must have shape (50, 12, 12), not (50, 12)"),
        ("a_tuple", "it returned tuple, not lab.result.Filtered"),
        ("nothing", "it returned NoneType, not lab.result.Filtered"),
        ("leaving", "SystemExit: I leave"),
        ("peeking", "has no attribute 'truth'"),
        ("editing", "read-only"),
    ],
)
def test_each_way_to_fail_has_its_sentence(results, function, words):
    done, runs, summary = results(f"mine=filters.py:{function}", "sis")
    assert done.status == 1
    assert (
        f"mine: 2 of 2 runs FAILED and are left out; the first is N = 20, run 0, seed {runs['seed'][0]}: " in done.out
    )
    assert words in done.out
    assert runs["error"].notna().tolist() == [True, True, False, False]
    assert summary["runs"].tolist() == [0, 2]
    run = call("run", f"mine=filters.py:{function}", "--particles", "20")
    run.assert_refused(f"mine, N = 20, run 0, seed {runs['seed'][0]} failed: ", words, status=1)


def test_when_all_of_them_fail_the_figures_say_so(filters):
    """With the real figures: empty axes must not trip over their logarithms."""
    done = compare("filters.py:nothing", "filters.py:raising", particles="5,10", more=("--out", "result"))
    assert (done.status, done.err) == (1, "")
    assert (filters / "result" / "gap.png").exists()
    assert not list((filters / "result").glob("map-*"))


def test_an_exact_one_without_ess_is_drawn(filters):
    """Its gap is 0, which has no logarithm, and it has no ESS."""
    done = compare("filters.py:exact", particles="5,10", more=("--out", "result"))
    assert (done.status, done.err) == (0, "")
    assert "close to exact" in done.out
    assert (filters / "result" / "map-exact.png").exists()


@pytest.mark.usefixtures("no_pictures")
def test_labels_that_would_share_a_file_get_one_each(filters):
    solvers = ["a.b=sis", "A.b=sis", "filters.py:good:ess_threshold=1", "filters.py:_hidden", f"{'x' * 300}=sis"]
    done = compare(*solvers, particles="5", runs=1, more=("--out", "result"))
    assert (done.status, done.err) == (0, "")
    maps = sorted(path.name for path in (filters / "result").glob("map-*"))
    expected = ["map-A.b-2.png", "map-_hidden.png", "map-a.b.png", "map-good-ess_threshold-1.png"]
    assert maps == sorted([*expected, f"map-{'x' * 60}.png"])


def test_an_object_that_can_be_called(results):
    done, _, _ = results("filters.py:made")
    assert done.status == 0


@pytest.mark.parametrize(
    ("solver", "words"),
    [
        (
            "filters.py:without_n",
            "got an unexpected keyword argument 'n_particles'; it is called as solver(problem, rng",
        ),
        ("filters.py:without_rng", "too many positional arguments; it is called as solver(problem, rng"),
        ("filters.py:Class", "it is called as solver(problem, rng"),
        ("filters.py:number", "filters.py has no function named number"),
        ("filters.py:absent", "filters.py has no function named absent"),
        ("filters.py:good:power=2", "its options are ess_threshold, scheme"),
        (
            "filters.py:good,filters.py:good",
            "Two solvers are called 'good'; give one another label, as in other=filters",
        ),
        ("absent.py:good", "absent.py does not exist"),
        ("filters.py", "Unknown solver 'filters.py'; known are"),
        ("folder.py:good", "folder.py does not exist"),
    ],
)
def test_what_cannot_be_called_is_refused_before_the_work(filters, solver, words):
    (filters / "folder.py").mkdir()
    compare(solver, more=("--out", "result")).assert_refused(words)
    assert not (filters / "result").exists()
    if "," not in solver:
        call("run", solver).assert_refused(words)


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("def good(:", "cannot be imported: SyntaxError: "),
        ("1 / 0", "cannot be imported: ZeroDivisionError: division by zero"),
        ("import no_such_module", "cannot be imported: ModuleNotFoundError: No module named 'no_such_module'"),
        ("raise SystemExit('I leave')", "cannot be imported: SystemExit: I leave"),
        ("import absent_neighbour.part", "cannot be imported: ModuleNotFoundError"),
    ],
)
def test_a_file_that_cannot_be_imported(here, code, words):
    (here / "broken.py").write_text(code)
    compare("broken.py:good", more=("--out", "result")).assert_refused("broken.py", words)
    assert not (here / "result").exists()


def test_a_file_may_have_the_name_of_a_library(results, filters):
    """Loaded under that name it would hide the real one from everything that comes after."""
    shutil.copy("filters.py", "statistics.py")
    done, _, _ = results("statistics.py:good", "other=filters.py:good")
    assert done.status == 0
    import statistics

    assert not hasattr(statistics, "good")


def test_a_solver_of_the_laboratory_is_tried_before_the_work(here, monkeypatch):
    """A student's is not: its failure is a result."""
    called = []
    monkeypatch.setitem(SOLVERS, "sis", lambda problem, rng, *, n_particles: called.append(n_particles))
    compare("sis", "sir:ess_threshold=7").assert_refused("ess_threshold must lie between 0 and 1")
    assert called == [1]
