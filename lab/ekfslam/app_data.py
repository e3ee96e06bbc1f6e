"""Recorded data through a filter: what ``slam-lab ekf-slam --data`` reads and computes.

Question answered: how good and how sure is a filter on data that somebody else recorded?  Three kinds are known:

    mrclam         a folder of the UTIAS multi-robot sets; robots in one map, or each in its own
    victoria-park  a factor file of a robot and landmarks; no truth, but a reference may stand in for it
    ntnu           a simulation in the manner of NTNU's course; names of landmarks from the truth, or to be found

What is said and written of it is in `app_data_report`.  Called by lab.cli.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from lab.ekfslam import drives, fleet
from lab.ekfslam.app import KEYS, plain
from lab.ekfslam.filters import make_filter
from lab.ekfslam.recording import Recording
from lab.ekfslam.replay import KNOWN, Replayed, replay
from lab.ekfslam.scores import score
from lab.records import mrclam, ntnu, vertices, victoria_park
from lab.records.lines import Skipped
from lab.validation import InputError

KINDS = ("mrclam", "victoria-park", "ntnu")


@dataclass(frozen=True)
class Choices:
    """How the data are read and replayed; each but the filter concerns one kind of data.

    Attributes
    ----------
    filter : str
    robots : tuple of int or None
        Of a MRCLAM folder; None for all.
    separate : bool
        Whether each robot has a map of its own.
    driving : fleet.Options
        How commands and sightings of robots are taken.
    association : str
        For ntnu.
    motion, sensor : tuple of float
        Noise of an ntnu simulation, deviations [m, m, rad] and [m, rad].
    reference : Path or None
        Values that stand in for the truth of a factor file.
    """

    filter: str = "ekf"
    robots: tuple[int, ...] | None = None
    separate: bool = False
    driving: fleet.Options = field(default_factory=fleet.Options)
    association: str = KNOWN
    motion: tuple[float, float, float] = drives.COURSE_MOTION
    sensor: tuple[float, float] = drives.COURSE_SENSOR
    reference: Path | None = None


@dataclass(frozen=True, eq=False)
class Loaded:
    """Data ready to be replayed.

    Attributes
    ----------
    kind : str
    recordings : tuple of Recording
        One for each map.
    skipped : Skipped
        Lines left out.
    sorted_lines : int
        Lines put in order.
    has_truth : bool
        Whether the truth is one, and no stand-in.
    """

    kind: str
    recordings: tuple[Recording, ...]
    skipped: Skipped
    sorted_lines: int
    has_truth: bool

    @property
    def steps(self) -> int:
        """Steps of all recordings."""
        return sum(len(recording.steps) for recording in self.recordings)


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a filter made of the data.

    Attributes
    ----------
    loaded : Loaded
    runs : tuple of Replayed
        One for each recording.
    figures : dict of str to float
        As `score` returns them.
    seconds : float
        On the clock, reading included.
    """

    loaded: Loaded
    runs: tuple[Replayed, ...]
    figures: dict[str, float]
    seconds: float

    def summary(self) -> dict[str, Any]:
        """Return the figures under KEYS; null where there is no truth."""
        values: dict[str, Any] = {
            **self.figures,
            "filter": self.runs[0].filter,
            "steps": self.loaded.steps,
            "landmarks": sum(len(run.landmarks) for run in self.runs),
            "updates": sum(run.updates for run in self.runs),
            "skipped_lines": self.loaded.skipped.total,
            "seconds": self.seconds,
        }
        return {key: plain(values[key]) for key in KEYS}


class Breakdown(Exception):
    """A filter could not go on: an innovation without a covariance, or an estimate that is no number."""


def load(kind: str, path: Path, choices: Choices) -> Loaded:
    """Read data of a kind.

    Raises
    ------
    InputError
        The kind or the filter is unknown, the filter does not know several robots, or the data cannot be used.
    """
    chosen = make_filter(choices.filter)
    if kind == "mrclam":
        data = mrclam.read(path, choices.robots)
        if len(data.robots) > 1 and not choices.separate:
            chosen.allow("several robots")
        apart = (
            fleet.apart(data, choices.driving).values() if choices.separate else [fleet.together(data, choices.driving)]
        )
        return Loaded(kind, tuple(apart), data.skipped, data.sorted_lines, has_truth=True)
    if kind == "victoria-park":
        graph = victoria_park.read(path)
        reference = None if choices.reference is None else vertices.read(choices.reference)
        if reference is not None:
            for fault, count in reference.skipped.counts.items():
                graph.skipped.add(f"{fault} in the reference", reference.skipped.first[fault], count)
        recording = drives.from_factors(graph, reference)
        return Loaded(kind, (recording,), graph.skipped, graph.sorted_lines, has_truth=False)
    if kind == "ntnu":
        log = ntnu.read(path)
        recording = drives.from_simulation(log, motion=choices.motion, sensor=choices.sensor)
        if choices.association == KNOWN and (log.truth is None or log.landmarks is None):
            raise InputError(
                f"{path} has no poseGT and landmarks to name what was seen; use --association nearest or jcbb."
            )
        return Loaded(kind, (recording,), log.skipped, 0, has_truth=True)
    raise InputError(f"Unknown kind of data {kind!r}; known are {', '.join(KINDS)}.")


def run(loaded: Loaded, choices: Choices, *, started: float, on_step: Callable[[int], None]) -> Outcome:
    """Replay what was read.

    Parameters
    ----------
    loaded : Loaded
    choices : Choices
    started : float
        Of `time.perf_counter`, for the seconds.
    on_step : function of int
        Called with the number of steps done.

    Raises
    ------
    Breakdown
        The filter could not go on.
    """
    done = 0
    runs: list[Replayed] = []
    for recording in loaded.recordings:
        before = done

        def progress(step: int, before: int = before) -> None:
            nonlocal done
            done = before + step
            on_step(done)

        try:
            with threadpool_limits(limits=1), np.errstate(all="ignore"):
                runs.append(replay(recording, choices.filter, association=choices.association, on_step=progress))
        except np.linalg.LinAlgError:
            raise Breakdown(f"the filter {choices.filter} broke down after step {done} of {loaded.steps}") from None
        except MemoryError:
            raise Breakdown(f"the map does not fit into the memory after step {done} of {loaded.steps}") from None
        if not np.isfinite(runs[-1].poses).all():
            raise Breakdown(f"the filter {choices.filter} broke down: its estimate is no number")
    figures = score(list(zip(loaded.recordings, runs, strict=True)))
    if not loaded.has_truth:
        figures["nees_mean"] = float("nan")  # a reference has errors of its own, made from the same data
    return Outcome(loaded, tuple(runs), figures, time.perf_counter() - started)
