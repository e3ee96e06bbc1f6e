"""What a comparison found: the records of all units, the exact answers, and the tables that they add up to.

Question answered: which filter, with how many particles, is how far from exact, with what standard error?  A unit is
one run of one solver with one N on one data set.  Means are taken over the runs of a data set first, then over data
sets, whose spread gives the standard error; with one data set it comes from the spread of the runs.
Made by `lab.compare`, kept by `lab.sweep`, drawn by `lab.plots.comparison`.  Source: question 8 of the handout.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.metrics import Metrics
from lab.problem import Problem
from lab.result import Filtered
from lab.theory import forecast, relative_log_variance
from lab.validation import Array

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Unit:
    """One run: the solver's label, how many particles, which repetition, its generator's seed, and which data set."""

    solver: str
    n_particles: int
    run: int
    seed: int
    data_set: int = 0


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
        All moments, kept for run 0 of data set 0, or for all runs when asked for.
    error : str
        Why the run has no metrics; empty when it has.
    died : bool
        Whether its worker died, which another attempt may survive; a solver that raises would raise again.
    """

    unit: Unit
    metrics: Metrics
    ess: Array | None = None
    survivors: Array | None = None
    filtered: Filtered | None = None
    error: str = ""
    died: bool = False


@dataclass(frozen=True, eq=False, repr=False)
class Comparison:
    """The records of all units, in the order data set, solver, N, run, and what they are measured against.

    Attributes
    ----------
    problems : tuple of Problem
        The data sets.
    exacts : tuple of Filtered
        The exact answer for each.
    records : tuple of Record
    designs : mapping of str to (str, float)
        For each label whose filter the theory knows: its proposal in `lab.theory` and its resampling threshold.
    """

    problems: tuple[Problem, ...]
    exacts: tuple[Filtered, ...]
    records: tuple[Record, ...]
    designs: Mapping[str, tuple[str, float]] = field(default_factory=dict)

    @cached_property
    def runs(self) -> "pd.DataFrame":
        """One row per unit: data_set, solver, n_particles, run, seed, the metrics, and the error if it failed."""
        import pandas as pd

        rows = [{**vars(r.unit), **vars(r.metrics), "error": r.error} for r in self.records]
        table = pd.DataFrame(rows)
        return table[["data_set", *table.columns.drop("data_set")]]

    def summary(self) -> "pd.DataFrame":
        """One row per solver and N: means over the runs that succeeded, with standard errors.

        A standard error is that of the means of the data sets where there are several, else that of the runs.
        `collapsed_at` is the median over the runs that collapsed, NaN when none did.
        """
        import pandas as pd

        return pd.DataFrame(self.summary_rows())

    def summary_rows(self) -> list[dict[str, Any]]:
        """Return the rows of `summary` without pandas, which takes longer to import than all else here."""
        rows = []
        for solver, n_particles in dict.fromkeys((r.unit.solver, r.unit.n_particles) for r in self.records):
            good = self.of(solver, n_particles)
            data_sets: dict[int, list[Record]] = {}
            for record in good:
                data_sets.setdefault(record.unit.data_set, []).append(record)
            groups = list(data_sets.values()) if len(self.problems) > 1 else [[record] for record in good]
            row: dict[str, Any] = {"solver": solver, "n_particles": n_particles, "runs": len(good)}
            for name in ("mean_gap", "cov_gap", "log_evidence_gap"):
                each = _means(groups, name)
                row[name], row[f"{name}_se"] = _mean(each), _standard_error(each)
            collapsed = _known([record.metrics.collapsed_at for record in good])
            row["ess_min"] = _mean(_means(groups, "ess_min"))
            row["collapsed_at"] = float(np.median(collapsed)) if len(collapsed) else np.nan
            row["seconds_per_run"] = _mean(_means(groups, "seconds"))
            row["ancestors_left"] = _mean(_means(groups, "ancestors_left"))
            row["data_sets"] = len(data_sets)
            rows.append(row)
        return rows

    @property
    def solvers(self) -> list[str]:
        """The labels, in the order in which they were given."""
        return list(dict.fromkeys(record.unit.solver for record in self.records))

    @property
    def failures(self) -> tuple[Record, ...]:
        """The records of the runs that failed."""
        return tuple(record for record in self.records if record.error)

    def of(self, solver: str, n_particles: int) -> list[Record]:
        """Return the successful records of one solver and N, in the order of data sets and runs."""
        return [r for r in self.records if (r.unit.solver, r.unit.n_particles) == (solver, n_particles) and not r.error]

    @cached_property
    def forecasts(self) -> dict[str, Array]:
        """log10 of the limiting ESS / N on each data set, (data sets, N), by label, for filters that theory knows."""
        return {
            label: np.array([forecast(problem, proposal, ess_threshold=share) for problem in self.problems])
            for label, (proposal, share) in self.designs.items()
        }

    @cached_property
    def bootstrap_log_variances(self) -> Array:
        """lab.theory.relative_log_variance on each data set, (data sets, N, n)."""
        return np.array([relative_log_variance(problem) for problem in self.problems])

    def __repr__(self) -> str:
        """Say what it is, in a line."""
        sizes = ", ".join(map(str, sorted({record.unit.n_particles for record in self.records})))
        return f"<Comparison of {', '.join(self.solvers)} with N = {sizes}: {len(self.records)} runs>"

    def _repr_html_(self) -> str:
        """Show the summary in a notebook."""
        table = self.summary().rename(columns=lambda name: name.replace("_", " "))
        digits: str = table.to_html(index=False, float_format="{:.3g}".format, na_rep="", border=0)
        failed = f"<p>{len(self.failures)} of {len(self.records)} runs failed.</p>" if self.failures else ""
        return digits + failed


def _known(values: Sequence[float]) -> Array:
    return np.array([value for value in values if not np.isnan(value)])


def _mean(values: Sequence[float]) -> float:
    known = _known(values)
    return float(known.mean()) if len(known) else np.nan


def _means(groups: Sequence[Sequence[Record]], name: str) -> list[float]:
    """Return the mean of a metric over each group of records."""
    return [_mean([getattr(record.metrics, name) for record in group]) for group in groups]


def _standard_error(values: Sequence[float]) -> float:
    """Return the standard error of the mean of all values, of which those that are NaN say nothing."""
    known = _known(values)
    return float(known.std(ddof=1) / np.sqrt(len(values))) if len(known) > 1 else np.nan
