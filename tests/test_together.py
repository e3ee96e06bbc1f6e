"""Runs with few particles, several in one call: which filters, which runs, and the same numbers as alone."""

from functools import partial

import numpy as np
import pytest
from test_proposals import cut, lost
from worlds import problem

from lab.compare import compare
from lab.comparison import Unit
from lab.resampling import systematic
from lab.solvers import compiled, guided, kalman, rbpf, sir, sis
from lab.solvers.clones import FEW
from lab.solvers.together import together
from lab.units import TOGETHER, all_units, batches
from lab.work import Work

SOLVERS = {"sis": sis, "sir": partial(sir, ess_threshold=0.9, resample="stratified"), "guided": guided}
SOLVERS |= {
    "rbpf": rbpf,
    "prior": partial(rbpf, proposal="prior"),
    "guided optimal": partial(guided, proposal="optimal"),
}


@pytest.mark.parametrize("name", SOLVERS)
def test_the_answers_of_the_solver_itself(name):
    world, solver = cut(problem(), 8), SOLVERS[name]
    answers = together(solver, 60)(world, [np.random.default_rng(s) for s in range(4)])
    for seed, answer in enumerate(answers):
        alone = solver(world, np.random.default_rng(seed), n_particles=60)
        for one, other in zip(vars(alone).values(), vars(answer).values(), strict=True):
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ("solver", "n_particles"),
    [
        (sir, 1),
        (sir, FEW + 1),
        (partial(sir, backend="auto"), FEW + 1),
        (partial(sir, resample="multinomial"), 60),
        (partial(sir, resample=systematic), 60),
        (partial(sir, ess_threshold=2), 60),
        (partial(sir, ess_threshold="often"), 60),
        (partial(sir, backend="fortran"), 60),
        (partial(rbpf, proposal="delayed"), 60),
        (lambda problem, rng, *, n_particles: sir(problem, rng, n_particles=n_particles), 60),
        (kalman, 60),
    ],
)
def test_others_run_alone(solver, n_particles):
    assert together(solver, n_particles) is None


def test_the_compiled_loop_runs_alone():
    pytest.importorskip("numba", reason="the extra toy-slam-lab[fast] is not installed")
    assert together(partial(sir, backend="auto"), 60) is not None
    assert together(partial(sir, backend="auto"), 100) is None
    assert together(partial(sir, backend="numba"), 60) is None


def test_kernels_are_loaded_before_the_clock_starts(monkeypatch):
    """Else the first run's time would be that of compiling; numpy and a student's function load none."""
    pytest.importorskip("numba", reason="the extra toy-slam-lab[fast] is not installed")
    loaded = []
    monkeypatch.setattr(compiled, "warm", lambda scheme: loaded.append(scheme))
    world = cut(problem(), 3)
    work = Work((world,), (kalman(world),), {"auto": partial(sir, backend="auto"), "numpy": sir})
    for label, n_particles in (("numpy", 200), ("auto", 20), ("auto", 200)):
        assert not loaded
        work((Unit(label, n_particles, 0, 0),))
    assert loaded == ["systematic"]
    Work((world,), (kalman(world),), {"low": partial(sir, backend="numba", resample="residual")})(
        (Unit("low", 200, 0, 0),)
    )
    assert loaded[1:] == ["residual"]


def test_who_is_in_a_batch_depends_on_nothing_else():
    """Neither on the number of runs, nor on the other solvers and sizes, nor on the order of units."""
    few = batches(all_units({"sir": sir}, [50], runs=14, seed=3), {"sir": sir})
    assert [[unit.run for unit in batch] for batch in few] == [list(range(10)), list(range(10, 14))]
    units = all_units(SOLVERS | {"mine": kalman}, [50, 1000], runs=25, seed=3, data_sets=2)
    groups = batches(units[::-1], SOLVERS | {"mine": kalman})
    assert sorted(map(str, units)) == sorted(str(unit) for group in groups for unit in group)
    for group in groups:
        assert len({(unit.data_set, unit.solver, unit.n_particles, unit.run // TOGETHER) for unit in group}) == 1
        expected = TOGETHER if group[0].run < 20 else 5
        assert len(group) == (expected if group[0].n_particles == 50 and group[0].solver != "mine" else 1)


def test_a_comparison_has_the_numbers_of_single_runs():
    world = cut(problem(), 8)
    result = compare(world, SOLVERS, n_particles=[20, 60], runs=12)
    work = Work((world,), (kalman(world),), SOLVERS)
    for record in result.records:
        (alone,) = work((record.unit,))
        assert alone.metrics.mean_gap == record.metrics.mean_gap
        assert alone.metrics.log_evidence_gap == record.metrics.log_evidence_gap
        np.testing.assert_array_equal(alone.ess, record.ess)
        assert record.metrics.seconds > 0


def test_a_batch_that_fails_is_tried_one_by_one():
    world = lost()
    work = Work((world,), (None,), {"sir": sir})
    with np.errstate(over="ignore"):
        records = work(tuple(Unit("sir", 20, run, run) for run in range(3)))
    assert len(records) == 3
    assert all("every weight is zero" in record.error for record in records)
