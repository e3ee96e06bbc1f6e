"""Particle filters against the exact one, on the same data.

Question answered: how far are the particle moments from the exact moments, for how many particles?  What is run, and
with which seed: `lab.units`; how: `lab.work`; figures of merit: `lab.metrics`; what came of it: `lab.comparison`.

    compare(problem, {"sir": sir, "mine": my_filter}, n_particles=[100, 1000], runs=20).summary()

Source: question 8 of the handout.
"""

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial

import numpy as np

from lab import execution
from lab.comparison import Comparison, Record
from lab.execution import Execute
from lab.metrics import Metrics
from lab.problem import Problem, require_problem
from lab.progress import progress_bar
from lab.result import Filtered
from lab.solvers import Solver, kalman
from lab.solvers.particle import guided, rbpf, sir, sis
from lab.solvers.together import in_kernels, scheme_of
from lab.units import Batch, all_units, batches
from lab.validation import InputError
from lab.warming import warming
from lab.work import Work, threadpools

LONG = 3000  # particles: a compiled run of less spends most of its time in Python
OVERHEAD = 1000  # particles: a run costs about as much as this many more


def compare(
    problem: Problem | Sequence[Problem],
    solvers: Mapping[str, Solver],
    *,
    n_particles: Sequence[int] | int = (100, 1000, 10_000),
    runs: int = 20,
    seed: int = 0,
    jobs: int = 1,
    keep_moments: bool = False,
    progress: bool = False,
    exact: Callable[[Problem], Filtered] = kalman,
    execute: Execute | None = None,
    on_done: Callable[[Record], None] | None = None,
) -> Comparison:
    """Run every solver with every N several times and measure each run against the exact filter.

    Parameters
    ----------
    problem : Problem, or sequence of Problem
        One data set or several of the same sizes, each of at least two instants.
    solvers : mapping of str to Solver
        By label; the label is part of the seed.
    n_particles : sequence of int, or int
        The N to try, each at least 1.
    runs : int
        Repetitions of each on each data set, at least 1.
    seed : int
        Non-negative; from it come the seeds of all units.
    jobs : int
        Runs at a time; -1 for one per processor. In worker processes; where all solvers are compiled and N goes to 3000
        or beyond, in threads, and shorter runs one by one afterwards. No result but the seconds depends on it.
    keep_moments : bool
        Keep the moments of all runs, not only of the first on the first data set.
    progress : bool
        Show a bar, on a terminal or in a notebook.
    exact : function of Problem
        Gives what filters are measured against.
    execute : Execute, optional
        Another way to run the units than `jobs` says, of `lab.execution` or `lab.sweep`.
    on_done : function of Record, optional
        Called as each unit ends, in no fixed order.

    Returns
    -------
    Comparison
        A run whose solver raises or answers badly, or whose worker dies, is a record with an error; the others go on.

    Raises
    ------
    InputError
        An argument is out of range, or the exact filter itself cannot run.
    """
    problems = _data_sets(problem)
    if isinstance(jobs, bool) or not isinstance(jobs, int | np.integer) or (jobs < 1 and jobs != -1):
        raise InputError(f"jobs must be at least 1, or -1 for one per processor, not {jobs!r}.")
    if not isinstance(solvers, Mapping) or not all(isinstance(label, str) for label in solvers):
        raise InputError('solvers must map labels to functions, as {"sir": sir}.')
    units = all_units(solvers, n_particles, runs=runs, seed=seed, data_sets=len(problems))
    done = {}
    with ExitStack() as stack:
        if execute is None:
            execute = stack.enter_context(way_to_run(solvers, max(unit.n_particles for unit in units), jobs))
        exacts = tuple(map(exact, problems))
        work = Work(problems, exacts, dict(solvers), keep_moments)
        if progress:
            advance = stack.enter_context(progress_bar("comparing", sum(u.n_particles + OVERHEAD for u in units)))
        stack.enter_context(threadpools().limit(limits=1))  # here; each run asks for it where it is
        # long ones first: workers end together; and run by run: solvers that wait for memory meet others that compute
        ordered = sorted(batches(units, solvers), key=lambda batch: (-batch[0].n_particles, batch[0].run))
        for records in execute(work, ordered, _lost):
            for record in records:
                done[record.unit] = record
                if progress:
                    advance(record.unit.n_particles + OVERHEAD)
                if on_done:
                    on_done(record)
    return Comparison(problems, exacts, tuple(done[unit] for unit in units), designs(solvers))


@contextmanager
def way_to_run(solvers: Mapping[str, Solver], largest: int, jobs: int) -> Iterator[Execute]:
    """Give the way to run `jobs` units at a time: threads where all that take long run in kernels, else processes.

    Threads begin at once and load the kernels once; but a function that is not ours could take the process with it.

    Parameters
    ----------
    solvers : mapping of str to Solver
    largest : int
        Number of particles.
    jobs : int
        -1 for one per processor.
    """
    if jobs == 1:
        yield execution.here
        return
    try:
        in_threads = largest >= LONG and all(in_kernels(solver, LONG) for solver in solvers.values())
    except InputError:  # which is for the run to say
        in_threads = False
    if not in_threads:
        yield partial(execution.processes, jobs=jobs)
        return
    with warming(sorted({scheme_of(solver) for solver in solvers.values()}), jobs) as warm:
        yield partial(_threads, jobs=jobs, warm=warm)  # type: ignore[misc]


def _threads(
    work: Callable[[Batch], list[Record]],
    items: Sequence[Batch],
    lost: Callable[[Batch, str], list[Record]],
    *,
    jobs: int,
    warm: Callable[[], None],
) -> Iterator[list[Record]]:
    """Run long batches in threads, then the others, each of which would wait for Python while another one has it."""
    long = [batch for batch in items if batch[0].n_particles >= LONG]
    if items:
        warm()  # before two threads want to
    yield from execution.threads(work, long, lost, jobs=jobs)
    yield from map(work, [batch for batch in items if batch[0].n_particles < LONG])


def designs(solvers: Mapping[str, Solver]) -> dict[str, tuple[str, float]]:
    """Return, for each filter of `lab.solvers`, its proposal as `lab.theory` names it and its resampling threshold."""
    found = {}
    for label, solver in solvers.items():
        function = solver.func if isinstance(solver, partial) else solver
        if function in (sis, sir, guided, rbpf):
            parameters = {name: p.default for name, p in inspect.signature(solver).parameters.items()}
            proposal = parameters.get("proposal", "prior")
            share = 0.0 if function is sis else parameters["ess_threshold"]
            found[label] = (f"rbpf-{proposal}" if function is rbpf else proposal, share)
    return found


def partial_comparison(
    problems: Sequence[Problem],
    solvers: Mapping[str, Solver],
    records: Sequence[Record],
    exact: Callable[[Problem], Filtered] = kalman,
) -> Comparison:
    """Return what some finished records amount to."""
    labels = list(solvers)
    order = sorted(
        records, key=lambda r: (r.unit.data_set, labels.index(r.unit.solver), r.unit.n_particles, r.unit.run)
    )
    return Comparison(tuple(problems), tuple(map(exact, problems)), tuple(order), designs(solvers))


def _data_sets(given: Problem | Sequence[Problem]) -> tuple[Problem, ...]:
    problems = tuple(map(require_problem, given)) if isinstance(given, list | tuple) else (require_problem(given),)
    if not problems:
        raise InputError("There is nothing to compare: no data set is given.")
    if min(problem.n_instants for problem in problems) < 2:
        raise InputError("There is nothing to compare: the experiment has no instant after k = 0.")
    if len({problem.z.shape for problem in problems}) > 1:
        raise InputError("The data sets of one comparison must have the same numbers of instants and landmarks.")
    return problems


def _lost(batch: Batch, reason: str) -> list[Record]:
    return [Record(unit, Metrics(), error=reason, died=True) for unit in batch]
