"""Recorded data through a filter: what ``slam-lab ekf-slam --data`` reads, computes, says and writes.

Question answered: how good and how sure is a filter on data that somebody else recorded?  Three kinds are known:

    mrclam         a folder of the UTIAS multi-robot sets; robots in one map, or each in its own
    victoria-park  a factor file of a robot and landmarks; no truth, but a reference may stand in for it
    ntnu           a simulation in the manner of NTNU's course; names of landmarks from the truth, or to be found

Errors are told as they are and after the best rigid motion.  Called by lab.cli.
"""

import time
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from lab.ekfslam import drives, fleet
from lab.ekfslam.alignment import align
from lab.ekfslam.app import KEYS, plain
from lab.ekfslam.filters import make_filter
from lab.ekfslam.recording import Recording
from lab.ekfslam.replay import KNOWN, Replayed, replay
from lab.ekfslam.scores import found_and_true, landmarks_and_truth, score
from lab.records import mrclam, ntnu, vertices, victoria_park
from lab.records.lines import Skipped
from lab.validation import InputError

KINDS = ("mrclam", "victoria-park", "ntnu")
FAR = 1.5  # NIS by degree of freedom beyond which, or below 1 / FAR, the noise figures do not fit the data
SURE = 1.5  # mean NEES by degree of freedom beyond which a filter is called too sure


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


def rows(outcome: Outcome) -> list[list[str]]:
    """Return the table that a person reads: quantity, as it is, aligned."""
    figures = outcome.figures

    def cell(name: str, digits: int = 3) -> str:
        return f"{figures[name]:.{digits}f}" if np.isfinite(figures[name]) else "no truth"

    return [
        ["position RMSE [m]", cell("position_rmse"), cell("position_rmse_aligned")],
        ["heading RMSE [rad]", cell("heading_rmse", 4), "-"],
        ["landmark RMSE [m]", cell("landmark_rmse"), cell("landmark_rmse_aligned")],
        ["NEES of the pose (3 when consistent)", cell("nees_mean", 2), "-"],
        ["NIS per degree of freedom (1)", cell("nis_per_dof"), "-"],
        ["landmarks", str(sum(len(each.landmarks) for each in outcome.runs)), "-"],
        ["corrections", str(sum(each.updates for each in outcome.runs)), "-"],
        ["steps", str(outcome.loaded.steps), "-"],
        ["seconds", f"{outcome.seconds:.1f}", "-"],
    ]


def words(outcome: Outcome, choices: Choices) -> list[str]:
    """Return what the figures do not say, a sentence each."""
    loaded, figures, lines = outcome.loaded, outcome.figures, []
    name = outcome.runs[0].filter
    if choices.reference is not None:
        lines.append(f"Errors are against {choices.reference}, which has errors of its own: NEES is left out.")
    if figures["nees_mean"] > 3 * SURE:
        lines.append(
            f"{name} is too sure of itself: its squared errors are {figures['nees_mean'] / 3:.1f} times what it says"
            " (one drive, whose errors hang together, so this is no test)."
        )
    if not 1 / FAR < figures["nis_per_dof"] < FAR and np.isfinite(figures["nis_per_dof"]):
        side = "larger" if figures["nis_per_dof"] < 1 else "smaller"
        lines.append(f"The noise that the filter is told is {side} than that of the data: NIS should be near 1.")
    if choices.association != KNOWN:
        wrong, updates = sum(each.wrong for each in outcome.runs), sum(each.updates for each in outcome.runs)
        named = any(name is not None for each in outcome.runs for name in each.identities.values())
        told = (
            f"{wrong} of {updates} corrections with another landmark's" if named else "no truth to say how often wrong"
        )
        lines.append(f"Association {choices.association}: {told}.")
    unused = sum(each.unused for each in outcome.runs)
    if unused:
        reason = (
            "nameless or too far from what their name says" if choices.association == KNOWN else "neither known nor new"
        )
        lines.append(f"{unused} measurements were not used, being {reason}.")
    deleted = sum(each.deleted for each in outcome.runs)
    if deleted:
        lines.append(f"{deleted} landmarks were deleted, because most of their measurements contradicted them.")
    lines += [f"Lines left out: {sentence}." for sentence in loaded.skipped.sentences()]
    if loaded.sorted_lines:
        lines.append(f"{loaded.sorted_lines} lines stood before an earlier one and were sorted.")
    return lines


def write_tables(folder: Path, outcome: Outcome) -> None:
    """Write landmarks.csv and trajectory.csv: estimates, and the truth where there is one."""
    import pandas as pd

    points, poses = [], []
    for number, (recording, each) in enumerate(zip(outcome.loaded.recordings, outcome.runs, strict=True), start=1):
        for name, point in each.landmarks.items():
            cov, identity = each.covs[name], each.identities[name]
            truth = recording.landmarks.get(identity, (np.nan, np.nan))
            points.append([number, name, *point, cov[0, 0], cov[0, 1], cov[1, 1], identity, *truth])
        for k, (robot, pose, truth) in enumerate(zip(each.robots, each.poses, each.truth, strict=True)):
            poses.append([number, robot, k, *pose, *truth, each.nees[k]])
    columns = ["map", "landmark", "x", "y", "xx", "xy", "yy", "true_name", "true_x", "true_y"]
    pd.DataFrame(points, columns=columns).to_csv(folder / "landmarks.csv", index=False)
    columns = ["map", "robot", "note", "x", "y", "theta", "true_x", "true_y", "true_theta", "nees"]
    pd.DataFrame(poses, columns=columns).to_csv(folder / "trajectory.csv", index=False)


def write_figures(folder: Path, outcome: Outcome) -> None:
    """Write map.png and consistency.png."""
    from lab.plots import legend_below, new_figure
    from lab.plots.drives import draw_charts, draw_nees, draw_nis
    from lab.plots.style import save_png

    charts = [_chart(*pair) for pair in zip(outcome.loaded.recordings, outcome.runs, strict=True)]
    ways = [way for chart in charts for way in chart.ways]
    name = f"{outcome.runs[0].filter} on {outcome.loaded.kind} data"
    kinds = {"": "as it is", "_aligned": "after the best rigid motion"}
    kinds = kinds if _has_errors(outcome) else {"": "no truth to compare with"}
    figure = new_figure(13 if len(kinds) > 1 else 7.5, 7.5)
    for ax, (ending, title) in zip(figure.subplots(1, len(kinds), squeeze=False)[0], kinds.items(), strict=True):
        draw_charts(ax, charts, aligned=bool(ending))
        ax.set_title(title + _errors_in_words(outcome, ending))
    figure.suptitle(name)
    legend_below(figure, figure.axes[0])
    text = f"Map of {name}: ways and landmarks with 3-sigma ellipses, {' and '.join(kinds.values())}."
    save_png(figure, folder / "map.png", text)

    nees = np.isfinite(outcome.figures["nees_mean"])
    figure = new_figure(10, 7.5 if nees else 4.5)
    axes = figure.subplots(2 if nees else 1, 1, squeeze=False)[:, 0]
    if nees:
        draw_nees(axes[0], ways)
    draw_nis(axes[-1], ways)
    figure.suptitle(name)
    legend_below(figure, *axes)
    save_png(figure, folder / "consistency.png", f"NEES and NIS of {name} over time with their 95 % bands.")


def _has_errors(outcome: Outcome) -> bool:
    return any(np.isfinite(outcome.figures[f"{what}_rmse"]) for what in ("position", "landmark"))


def _errors_in_words(outcome: Outcome, ending: str) -> str:
    """Return the errors for a title."""
    errors = {what: outcome.figures[f"{what}_rmse{ending}"] for what in ("position", "landmark")}
    parts = [f"{what} {error:.3g} m" for what, error in errors.items() if np.isfinite(error)]
    return f"\nRMSE: {', '.join(parts)}" if parts else ""


def _chart(recording: Recording, run: Replayed) -> Any:
    from lab.plots.drives import Chart, Way

    ways = []
    for robot in dict.fromkeys(run.robots.tolist()):
        own = run.robots == robot
        label = robot if robot == "robot" else f"robot {robot}"
        ways.append(Way(label, *(series[own] for series in (run.poses, run.truth, run.nees, run.nis, run.dof))))
    pairs = [found_and_true(run), landmarks_and_truth(recording, run)]
    motion = next((align(*pair) for pair in pairs if len(pair[0])), (0.0, np.zeros(2)))
    points, covs = np.reshape([*run.landmarks.values()], (-1, 2)), np.reshape([*run.covs.values()], (-1, 2, 2))
    seen: Sequence[Hashable] = [name for name in recording.landmarks if name in {*run.identities.values()}]
    true_points = np.reshape([recording.landmarks[name] for name in seen], (-1, 2))
    return Chart(ways, points, covs, true_points, motion)
