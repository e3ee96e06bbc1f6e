"""Solà's symbols: r robot, l landmark; the demo many times over: what ``slam-lab ekf-slam`` computes.

Question answered: how good and how honest is a filter in the cloister, over many worlds?  Every run has its own seed,
which does not depend on the filter: filters are compared on the same worlds.  Errors are told as they are and after the
best rigid motion, because the map's frame cannot be observed.  What is said and written of it is in `app_report`.
"""

import time
from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from lab import execution
from lab.ekfslam.alignment import align, apply
from lab.ekfslam.consistency import Consistency, assess
from lab.ekfslam.demo import Run, run
from lab.ekfslam.frames import wrap
from lab.ekfslam.slam import Settings
from lab.execution import Execute
from lab.validation import Array, InputError, whole_number

SEED_BITS = 48
KEYS = (  # of summary.json, in this order
    "filter",
    "steps",
    "landmarks",
    "updates",
    "position_rmse",
    "position_rmse_aligned",
    "heading_rmse",
    "landmark_rmse",
    "landmark_rmse_aligned",
    "nees_mean",
    "nis_per_dof",
    "skipped_lines",
    "seconds",
)


@dataclass(frozen=True, eq=False)
class Demo:
    """Many runs of one filter.

    Attributes
    ----------
    runs : tuple of Run
        The first kept its frames.
    seeds : tuple of int
    errors : dict of str to (runs,) array
        Root mean squares of each run, by the names of KEYS [m, rad].
    consistency : Consistency
    seconds : float
        On the clock.
    label : str
        Filter, sensor and association, for titles.
    """

    runs: tuple[Run, ...]
    seeds: tuple[int, ...]
    errors: dict[str, Array]
    consistency: Consistency
    seconds: float
    label: str

    def summary(self) -> dict[str, Any]:
        """Return the figures under KEYS: means over the runs."""
        first = self.runs[0]
        values = {
            "filter": first.filter,
            "steps": len(first.drive.u),
            "landmarks": float(np.mean([len(each.points) for each in self.runs])),
            "updates": float(np.mean([each.updates for each in self.runs])),
            **{name: float(np.mean(values)) for name, values in self.errors.items()},
            "nees_mean": self.consistency.nees_mean,
            "nis_per_dof": self.consistency.nis_mean,
            "skipped_lines": 0,
            "seconds": self.seconds,
        }
        return {key: plain(values[key]) for key in KEYS}


def demo(
    filter: str = "ekf",
    *,
    sensor: str = "range-bearing",
    settings: Settings | None = None,
    perturb: str = "truth",
    runs: int = 60,
    seed: int = 0,
    jobs: int = 1,
    on_done: Callable[[], None] | None = None,
) -> Demo:
    """Run the demo many times.

    Parameters
    ----------
    filter : str
        "ekf", "fej" or "ri".
    sensor : str
        "range-bearing", "bearing" or "range".
    settings : Settings, optional
    perturb : str
        Who feels the noise of the controls: "truth", or "estimator" as in the guide's listing.
    runs : int
        At least 1.
    seed : int
        From it come the seeds of all runs, whatever the filter.
    jobs : int
        Worker processes; -1 for one per processor. No result but the seconds depends on it.
    on_done : function, optional
        Called as each run ends.

    Raises
    ------
    InputError
        An argument is out of range, or filter and sensor do not go together.
    """
    whole_number("--runs", runs, at_least=1)
    whole_number("--seed", seed, at_least=0)
    if not isinstance(jobs, int) or (jobs < 1 and jobs != -1):
        raise InputError(f"--jobs must be at least 1, or -1 for one per processor, not {jobs!r}.")
    seeds = [_seed(seed, i) for i in range(runs)]
    start = time.perf_counter()
    done: dict[int, Run] = {}
    one = partial(_one, filter=filter, seeds=seeds, sensor=sensor, settings=settings, perturb=perturb)
    execute: Execute = execution.here if jobs == 1 else partial(execution.processes, jobs=jobs)
    for i, each in execute(one, range(runs), _lost):
        done[i] = each
        if on_done:
            on_done()
    ordered = tuple(done[i] for i in range(runs))
    errors = [measure(each) for each in ordered]
    stacked = {name: np.array([error[name] for error in errors]) for name in errors[0]}
    association = (settings or Settings()).association
    label = f"{filter}, {sensor}, association {association}"
    return Demo(ordered, tuple(seeds), stacked, assess(ordered), time.perf_counter() - start, label)


def _one(
    index: int, filter: str, seeds: list[int], sensor: str, settings: Settings | None, perturb: str
) -> tuple[int, Run]:
    with threadpool_limits(limits=1):
        own = seeds[index]
        return index, run(filter, seed=own, sensor=sensor, settings=settings, perturb=perturb, frames=index == 0)


def _lost(index: int, reason: str) -> tuple[int, Run]:
    raise BrokenProcessPool(f"run {index}: {reason}")


def _seed(seed: int, index: int) -> int:
    state = np.random.SeedSequence(seed, spawn_key=(index,)).generate_state(1, np.uint64)[0]
    return int(state) >> (64 - SEED_BITS)


def measure(each: Run) -> dict[str, float]:
    """Return the root mean square errors of a run: way and heading over all steps, landmarks at the end [m, rad]."""
    truth = each.drive.truth
    heading = wrap(truth[1:, 2] - each.r[1:, 2])
    position, aligned = _errors(each.r[1:, :2], truth[1:, :2])
    landmark, landmark_aligned = _errors(each.points, each.drive.W[each.whose])
    return {
        "position_rmse": position,
        "position_rmse_aligned": aligned,
        "heading_rmse": float(np.sqrt(np.mean(np.square(heading)))),
        "landmark_rmse": landmark,
        "landmark_rmse_aligned": landmark_aligned,
    }


def _errors(estimate: Array, truth: Array) -> tuple[float, float]:
    """Return the root mean square distance of points as they are, and after the best rigid motion."""
    if not len(estimate):
        return float("nan"), float("nan")
    moved = apply(*align(estimate, truth), estimate)
    return _rms(estimate - truth), _rms(moved - truth)


def _rms(differences: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(np.square(differences), axis=1))))


def plain(value: Any) -> Any:
    """Return a number as JSON knows it: whole where it is, null where there is none."""
    if isinstance(value, float):
        if not np.isfinite(value):
            return None
        return int(value) if value.is_integer() and abs(value) > 1 else value
    return value
