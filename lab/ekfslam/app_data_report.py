"""What ``slam-lab ekf-slam --data`` says and writes of recorded data: table, sentences, estimates and figures.

Question answered: how is a person told how good and how sure a filter is on data that somebody else recorded?  Errors
are told as they are and after the best rigid motion.  What is known is computed in `app_data`.  Called by lab.cli.
"""

from collections.abc import Hashable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lab.ekfslam.alignment import align
from lab.ekfslam.app_data import Choices, Outcome
from lab.ekfslam.recording import Recording
from lab.ekfslam.replay import KNOWN, Replayed
from lab.ekfslam.scores import found_and_true, landmarks_and_truth

FAR = 1.5  # NIS by degree of freedom beyond which, or below 1 / FAR, the noise figures do not fit the data
SURE = 1.5  # mean NEES by degree of freedom beyond which a filter is called too sure


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
