"""Particle filters against the exact one, on the same data: units, their metrics, and the table they add up to.

Question answered: how far are the particle moments from the exact moments, for how many particles?  One unit is one
run of one solver with one N; it is compared with `kalman` on the same measurements, never with the truth, whose error
has a floor.  Per run, over k >= 1:

    mean_gap          sqrt of the mean over k and components of ((mean - exact mean) / exact deviation)^2
    cov_gap           mean over k of ||P - P_exact||_F / ||P_exact||_F
    log_evidence_gap  estimated minus exact log p(z_1..z_{N-1})
    ess_min           smallest ESS / N
    collapsed_at      first k with ESS < 2; NaN if never
    one_ancestor_at   first k whose cloud descends from a single particle of time 0; NaN if never
    same_map_at       first k from then on where no landmark has any variance left; NaN if never
    ancestors_left    distinct ancestors of time 0 at the end

Source: question 8 of the handout.
"""

import hashlib
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from lab.problem import Problem, require_problem
from lab.processes import deaf_to_interrupts
from lab.result import Filtered
from lab.solvers import Solver, check_filtered, kalman
from lab.validation import Array, InputError, whole_number

SAME = 1e-6  # of the exact deviation: copies of one landmark differ by rounding alone
SEED_BITS = 48  # a seed is written to CSV, and spreadsheets keep 15 digits


@dataclass(frozen=True)
class Unit:
    """One run: which solver (by its label), how many particles, which repetition, and the seed of its generator."""

    solver: str
    n_particles: int
    run: int
    seed: int


@dataclass(frozen=True)
class Metrics:
    """How far one run is from the exact filter; the module's docstring defines each. NaN where it does not apply."""

    mean_gap: float = np.nan
    cov_gap: float = np.nan
    log_evidence_gap: float = np.nan
    ess_min: float = np.nan
    collapsed_at: float = np.nan
    one_ancestor_at: float = np.nan
    same_map_at: float = np.nan
    ancestors_left: float = np.nan
    seconds: float = np.nan


@dataclass(frozen=True, eq=False)
class Record:
    """What is kept of one unit.

    Attributes
    ----------
    unit : Unit
    metrics : Metrics
    ess : (N,) array or None
        Effective sample size over time, where the solver gives it.
    survivors : (N,) array or None
        Ancestors of time 0 still alive, likewise.
    filtered : Filtered or None
        All moments, kept by `compare` for run 0 alone.
    error : str
        Why the run has no metrics; empty when it has.
    """

    unit: Unit
    metrics: Metrics
    ess: Array | None = None
    survivors: Array | None = None
    filtered: Filtered | None = None
    error: str = ""


@dataclass(frozen=True, eq=False)
class Comparison:
    """The records of all units, in the order solver, N, run, and the exact answer they are measured against."""

    problem: Problem
    exact: Filtered
    records: tuple[Record, ...]

    @cached_property
    def runs(self) -> pd.DataFrame:
        """One row per unit: solver, n_particles, run, seed, the metrics, and the error if it failed."""
        rows = [{**asdict(r.unit), **asdict(r.metrics), "error": r.error} for r in self.records]
        return pd.DataFrame(rows)

    def summary(self) -> pd.DataFrame:
        """One row per solver and N: means over the runs that succeeded, with standard errors sd / sqrt(runs).

        `collapsed_at` is the median over the runs that collapsed, NaN when none did.
        """
        rows = []
        for (solver, n_particles), group in self.runs.groupby(["solver", "n_particles"], sort=False):
            good = group[group["error"] == ""]
            row: dict[str, Any] = {"solver": solver, "n_particles": n_particles, "runs": len(good)}
            for name in ("mean_gap", "cov_gap", "log_evidence_gap"):
                row[name] = good[name].mean()
                row[f"{name}_se"] = good[name].std(ddof=1) / np.sqrt(max(len(good), 1))
            row["ess_min"] = good["ess_min"].mean()
            row["collapsed_at"] = good["collapsed_at"].median()
            row["seconds_per_run"] = good["seconds"].mean()
            row["ancestors_left"] = good["ancestors_left"].mean()
            rows.append(row)
        return pd.DataFrame(rows)

    @property
    def failures(self) -> tuple[Record, ...]:
        """The records of the runs that failed."""
        return tuple(record for record in self.records if record.error)

    def of(self, solver: str, n_particles: int) -> list[Record]:
        """Return the successful records of one solver and N, in the order of runs."""
        return [r for r in self.records if (r.unit.solver, r.unit.n_particles) == (solver, n_particles) and not r.error]


def compare(
    problem: Problem,
    solvers: Mapping[str, Solver],
    *,
    n_particles: Sequence[int] | int = (100, 1000, 10_000),
    runs: int = 20,
    seed: int = 0,
    jobs: int = 1,
    on_done: Callable[[Record], None] | None = None,
) -> Comparison:
    """Run every solver with every N several times and measure each run against the exact filter.

    Parameters
    ----------
    problem : Problem
        At least two instants.
    solvers : mapping of str to Solver
        By label; the label is part of the seed.
    n_particles : sequence of int, or int
        The N to try, each at least 1.
    runs : int
        Repetitions of each, at least 1.
    seed : int
        Non-negative; from it come the seeds of all units.
    jobs : int
        Worker processes; -1 for one per processor. No result but the seconds depends on it.
    on_done : function of Record, optional
        Called as each unit ends, in no fixed order.

    Returns
    -------
    Comparison
        A run whose solver raises or answers badly is a record with an error; the others go on.

    Raises
    ------
    InputError
        An argument is out of range, or the exact filter itself cannot run.
    """
    if require_problem(problem).n_instants < 2:
        raise InputError("There is nothing to compare: the experiment has no instant after k = 0.")
    if not isinstance(jobs, int) or (jobs < 1 and jobs != -1):
        raise InputError(f"jobs must be at least 1, or -1 for one per processor, not {jobs!r}.")
    if not isinstance(solvers, Mapping) or not all(isinstance(label, str) for label in solvers):
        raise InputError('solvers must map labels to functions, as {"sir": sir}.')
    units = plan(solvers, n_particles, runs=runs, seed=seed)
    exact = kalman(problem)
    tasks = (
        joblib.delayed(run_unit)(problem, exact, solvers[unit.solver], unit, keep=unit.run == 0)
        for unit in sorted(units, key=lambda unit: -unit.n_particles)  # long ones first: workers end together
    )
    done = {}
    with deaf_to_interrupts():
        results = joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")(tasks)
    for record in results:
        done[record.unit] = record
        if on_done:
            on_done(record)
    return Comparison(problem, exact, tuple(done[unit] for unit in units))


def plan(solvers: Mapping[str, Solver], n_particles: Sequence[int] | int, *, runs: int, seed: int) -> list[Unit]:
    """Return all units in the order solver, N, run; an N given twice counts once.

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
        Unit(label, size, run, unit_seed(seed, label, size, run))
        for label in solvers
        for size in sizes
        for run in range(runs)
    ]


def unit_seed(seed: int, solver: str, n_particles: int, run: int) -> int:
    """Return the seed of one unit, a function of nothing but these four."""
    label = int.from_bytes(hashlib.sha256(solver.encode()).digest()[:8], "big")
    state = np.random.SeedSequence(seed, spawn_key=(label, n_particles, run)).generate_state(1, np.uint64)[0]
    return int(state) >> (64 - SEED_BITS)


def run_unit(problem: Problem, exact: Filtered, solver: Solver, unit: Unit, *, keep: bool = False) -> Record:
    """Run one unit and measure it; whatever the solver raises becomes the record's error.

    Parameters
    ----------
    problem : Problem
    exact : Filtered
        `kalman` on the same problem.
    solver : Solver
    unit : Unit
    keep : bool
        Whether the record holds all the moments, for pictures.

    Returns
    -------
    Record
    """
    rng = np.random.default_rng(unit.seed)
    try:
        with threadpool_limits(limits=1):  # threads inside BLAS reorder sums, and a last digit can flip a resampling
            start = time.perf_counter()
            answer = solver(problem, rng, n_particles=unit.n_particles)
            seconds = time.perf_counter() - start
        filtered = check_filtered(answer, problem)
    except (Exception, SystemExit) as error:
        return Record(unit, Metrics(), error=_described(error))
    metrics = measure(filtered, exact, unit.n_particles, seconds)
    return Record(unit, metrics, filtered.ess, filtered.survivors, filtered if keep else None)


def measure(filtered: Filtered, exact: Filtered, n_particles: int, seconds: float) -> Metrics:
    """Return the metrics of one run; components that are known exactly are left out of `mean_gap`."""
    stds, uncertain = exact.stds[1:], exact.uncertain[1:]
    gaps = (filtered.means - exact.means)[1:][uncertain] / stds[uncertain]
    sizes = np.linalg.norm(exact.covs[1:], axis=(1, 2))
    cov_gaps = np.linalg.norm((filtered.covs - exact.covs)[1:], axis=(1, 2))[sizes > 0] / sizes[sizes > 0]
    ess, survivors = filtered.ess, filtered.survivors
    return Metrics(
        mean_gap=float(np.sqrt(np.mean(gaps**2))) if len(gaps) else 0.0,
        cov_gap=float(np.mean(cov_gaps)) if len(cov_gaps) else 0.0,
        log_evidence_gap=float(filtered.log_evidence[-1] - exact.log_evidence[-1]),
        ess_min=np.nan if ess is None else float(np.min(ess) / n_particles),
        collapsed_at=np.nan if ess is None else _first(ess < 2),
        one_ancestor_at=np.nan if survivors is None else _first(survivors == 1),
        same_map_at=np.nan if survivors is None else _first((survivors == 1) & _one_map(filtered, exact)),
        ancestors_left=np.nan if survivors is None else float(survivors[-1]),
        seconds=seconds,
    )


def _one_map(filtered: Filtered, exact: Filtered) -> Any:
    """Return at which instants (N,) all landmarks are points to rounding, though not in the exact posterior."""
    return (filtered.stds <= SAME * exact.stds)[:, 2:].all(axis=1) & exact.uncertain[:, 2:].any(axis=1)


def _described(error: BaseException) -> str:
    """Return kind and text of an error on one line, and the line of the file it came from, libraries left out."""
    library = ("site-packages", str(Path(__file__).parent))
    frames = [f for f in traceback.extract_tb(error.__traceback__) if not any(part in f.filename for part in library)]
    where = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    text = " ".join(f"{type(error).__name__}: {error}{where}".split())
    return text.encode("utf-8", "backslashreplace").decode("utf-8")  # lone surrogates fit in no file


def _first(condition: Any) -> float:
    return float(np.argmax(condition)) if condition.any() else np.nan
