"""One batch of units: the solver is run and each run measured against the exact filter, whatever the solver does.

An error becomes a record that says so.  Sent to workers by the ways of `lab.execution`; called by `lab.compare`.
"""

import time
import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from threadpoolctl import ThreadpoolController

from lab.comparison import Record, Unit
from lab.metrics import Metrics, measure
from lab.problem import Problem
from lab.result import Filtered
from lab.solvers import Solver, check_filtered
from lab.solvers.together import prepare, together
from lab.units import Batch
from lab.validation import InputError


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
        with threadpools().limit(limits=1):
            rngs = [np.random.default_rng(unit.seed) for unit in batch]
            start = time.perf_counter()
            answers = run(self.problems[first.data_set], rngs)
            seconds = (time.perf_counter() - start) / len(batch)
        return [self._record(unit, answer, seconds) for unit, answer in zip(batch, answers, strict=True)]

    def _alone(self, unit: Unit) -> Record:
        problem = self.problems[unit.data_set]
        try:
            prepare(self.solvers[unit.solver], unit.n_particles)
            with threadpools().limit(limits=1):  # BLAS threads reorder sums: a last digit can flip a resampling
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
def threadpools() -> ThreadpoolController:
    """Find the libraries once: the search runs Python inside C, where an interrupt would be swallowed."""
    return ThreadpoolController()


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
