"""Particle filters against the exact one, on the same data: the units, and how each is run and measured.

Question answered: how far are the particle moments from the exact moments, for how many particles?  One unit is one
run of one solver with one N on one data set, with a seed of its own that depends on nothing else; so neither the
order of units, nor the number of workers, nor what else is compared changes a number.  Runs with few particles are
computed together, a batch a call.  Metrics: `lab.metrics`.

    compare(problem, {"sir": sir, "mine": my_filter}, n_particles=[100, 1000], runs=20).summary()

Source: question 8 of the handout.
"""

import hashlib
import inspect
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import ThreadpoolController

from lab import execution
from lab.comparison import Comparison, Record, Unit
from lab.execution import Execute
from lab.metrics import Metrics, measure
from lab.problem import Problem, require_problem
from lab.progress import progress_bar
from lab.result import Filtered
from lab.solvers import Solver, check_filtered, compiled, kalman
from lab.solvers.particle import guided, rbpf, sir, sis
from lab.solvers.together import in_kernels, prepare, together
from lab.validation import InputError, whole_number

SEED_BITS = 48  # a seed is written to CSV, and spreadsheets keep 15 digits
Batch = tuple[Unit, ...]  # of one solver, N and data set
TOGETHER = 10  # runs in one call, where that pays
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
    units = plan(solvers, n_particles, runs=runs, seed=seed, data_sets=len(problems))
    if execute is None:
        execute = way_to_run(solvers, max(unit.n_particles for unit in units), jobs)
    exacts = tuple(map(kalman, problems))
    work = Work(problems, exacts, dict(solvers), keep_moments)
    done = {}
    with ExitStack() as stack:
        if progress:
            advance = stack.enter_context(progress_bar("comparing", sum(u.n_particles + OVERHEAD for u in units)))
        # long ones first: workers end together
        stack.enter_context(_threadpools().limit(limits=1))  # here; each run asks for it where it is
        for records in execute(work, sorted(batches(units, solvers), key=lambda batch: -batch[0].n_particles), _lost):
            for record in records:
                done[record.unit] = record
                if progress:
                    advance(record.unit.n_particles + OVERHEAD)
                if on_done:
                    on_done(record)
    return Comparison(problems, exacts, tuple(done[unit] for unit in units), designs(solvers))


def way_to_run(solvers: Mapping[str, Solver], largest: int, jobs: int) -> Execute:
    """Return the way to run `jobs` units at a time: threads where all that take long run in kernels, else processes.

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
        return execution.here
    try:
        in_threads = largest >= LONG and all(in_kernels(solver, LONG) for solver in solvers.values())
    except InputError:  # which is for the run to say
        in_threads = False
    if not in_threads:
        return partial(execution.processes, jobs=jobs)
    return partial(_threads, jobs=jobs)  # type: ignore[return-value]


def _threads(
    work: Callable[[Batch], list[Record]],
    items: Sequence[Batch],
    lost: Callable[[Batch, str], list[Record]],
    *,
    jobs: int,
) -> Iterator[list[Record]]:
    """Run long batches in threads, then the others, each of which would wait for Python while another one has it."""
    long = [batch for batch in items if batch[0].n_particles >= LONG]
    if long:
        compiled.warm()  # before two threads want to
    yield from execution.threads(work, long, lost, jobs=jobs)
    yield from map(work, [batch for batch in items if batch[0].n_particles < LONG])


def plan(
    solvers: Mapping[str, Solver], n_particles: Sequence[int] | int, *, runs: int, seed: int, data_sets: int = 1
) -> list[Unit]:
    """Return all units in the order data set, solver, N, run; an N given twice counts once.

    Raises
    ------
    InputError
        No solver or no N, or a number out of range.
    """
    if isinstance(n_particles, int | np.integer):
        n_particles = [int(n_particles)]
    sizes = list(dict.fromkeys(whole_number("n_particles", size, at_least=1) for size in n_particles))
    if not solvers or not sizes:
        raise InputError("A comparison needs at least one solver and one number of particles.")
    runs = whole_number("runs", runs, at_least=1)
    seed = whole_number("seed", seed, at_least=0)
    return [
        Unit(label, size, run, unit_seed(seed, label, size, run, data_set), data_set)
        for data_set in range(data_sets)
        for label in solvers
        for size in sizes
        for run in range(runs)
    ]


def batches(units: Sequence[Unit], solvers: Mapping[str, Solver]) -> list[Batch]:
    """Return the units in groups to be run together; which group one is in depends on solver, N, data set and run."""
    found: dict[Any, list[Unit]] = {}
    for unit in units:
        several = together(solvers[unit.solver], unit.n_particles) is not None
        key = (unit.data_set, unit.solver, unit.n_particles, unit.run // TOGETHER if several else -1 - unit.run)
        found.setdefault(key, []).append(unit)
    return [tuple(batch) for batch in found.values()]


def unit_seed(seed: int, solver: str, n_particles: int, run: int, data_set: int = 0) -> int:
    """Return the seed of one unit, a function of nothing but these five."""
    label = int.from_bytes(hashlib.sha256(solver.encode()).digest()[:8], "big")
    key = (label, n_particles, run, data_set)
    state = np.random.SeedSequence(seed, spawn_key=key).generate_state(1, np.uint64)[0]
    return int(state) >> (64 - SEED_BITS)


def data_set_seeds(seed: int, n_data_sets: int) -> list[int]:
    """Return a seed for the simulation of each data set: `seed` itself, then others that depend on it and their number.

    Raises
    ------
    InputError
        Negative seed, or no data set.
    """
    whole_number("seed", seed, at_least=0)
    numbers = range(1, whole_number("The number of data sets", n_data_sets, at_least=1))
    states = (np.random.SeedSequence(seed, spawn_key=(i,)).generate_state(1, np.uint64)[0] for i in numbers)
    return [seed, *(int(state) >> (64 - SEED_BITS) for state in states)]


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
    problems: Sequence[Problem], solvers: Mapping[str, Solver], records: Sequence[Record]
) -> Comparison:
    """Return what some finished records amount to."""
    labels = list(solvers)
    order = sorted(
        records, key=lambda r: (r.unit.data_set, labels.index(r.unit.solver), r.unit.n_particles, r.unit.run)
    )
    return Comparison(tuple(problems), tuple(map(kalman, problems)), tuple(order), designs(solvers))


@dataclass(frozen=True, eq=False)
class Work:
    """All that units need, sent to a local worker once: data sets, their exact answers, and solvers by label."""

    problems: tuple[Problem, ...]
    exacts: tuple[Filtered, ...]
    solvers: Mapping[str, Solver]
    keep_moments: bool = False

    def only(self, batch: Batch) -> "Work":
        """Return what one batch needs, for a cluster, to which it is sent with each."""
        keep, label = batch[0].data_set, batch[0].solver
        problems = tuple(each if i == keep else None for i, each in enumerate(self.problems))
        exacts = tuple(each if i == keep else None for i, each in enumerate(self.exacts))
        return Work(problems, exacts, {label: self.solvers[label]}, self.keep_moments)  # type: ignore[arg-type]

    def __call__(self, batch: Batch) -> list[Record]:
        """Run a batch and measure each unit; whatever the solver raises becomes the record's error."""
        if len(batch) > 1:
            try:
                return self._together(batch)
            except Exception:  # whose it is shows when each runs by itself
                pass
        return [self._alone(unit) for unit in batch]

    def _together(self, batch: Batch) -> list[Record]:
        first = batch[0]
        run = together(self.solvers[first.solver], first.n_particles)
        if run is None:
            raise InputError("This solver runs alone.")
        with _threadpools().limit(limits=1):
            rngs = [np.random.default_rng(unit.seed) for unit in batch]
            start = time.perf_counter()
            answers = run(self.problems[first.data_set], rngs)
            seconds = (time.perf_counter() - start) / len(batch)
        return [self._record(unit, answer, seconds) for unit, answer in zip(batch, answers, strict=True)]

    def _alone(self, unit: Unit) -> Record:
        problem = self.problems[unit.data_set]
        try:
            prepare(self.solvers[unit.solver], unit.n_particles)
            with _threadpools().limit(limits=1):  # BLAS threads reorder sums: a last digit can flip a resampling
                rng = np.random.default_rng(unit.seed)
                start = time.perf_counter()
                answer = self.solvers[unit.solver](problem, rng, n_particles=unit.n_particles)
                seconds = time.perf_counter() - start
            return self._record(unit, check_filtered(answer, problem), seconds)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            return Record(unit, Metrics(), error=_described(error))

    def _record(self, unit: Unit, filtered: Filtered, seconds: float) -> Record:
        keep = self.keep_moments or unit.run == unit.data_set == 0
        metrics = measure(filtered, self.exacts[unit.data_set], unit.n_particles, seconds)
        return Record(unit, metrics, filtered.ess, filtered.survivors, filtered if keep else None)


@cache
def _threadpools() -> ThreadpoolController:
    """Find the libraries once: the search runs Python inside C, where an interrupt would be swallowed."""
    return ThreadpoolController()


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


def _described(error: BaseException) -> str:
    """Return kind and text of an error on one line, and the line of the file it came from, libraries left out."""
    library = ("site-packages", str(Path(__file__).parent))
    frames = [f for f in traceback.extract_tb(error.__traceback__) if not any(part in f.filename for part in library)]
    where = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    try:
        said = str(error)
    except Exception:
        said = "(it has no words)"
    text = " ".join(f"{type(error).__name__}: {said}{where}".split())
    return text.encode("utf-8", "backslashreplace").decode("utf-8")  # lone surrogates fit in no file
