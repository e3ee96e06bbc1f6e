"""What ``slam-lab ekf-slam`` says and writes of many runs of the demo: table, sentences, summary, runs and figures.

Question answered: how is a person told how good and how honest a filter is?  What is known is computed in `app`.
Called by lab.cli.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from lab.ekfslam.app import Demo
from lab.ekfslam.demo import LAST
from lab.validation import Array


def rows(found: Demo) -> list[list[str]]:
    """Return the table that a person reads: quantity, as it is, aligned; standard errors over the runs in brackets."""
    cell = {name: _with_error(values) for name, values in found.errors.items()}
    c = found.consistency
    return [
        ["position RMSE [m]", cell["position_rmse"], cell["position_rmse_aligned"]],
        ["heading RMSE [rad]", cell["heading_rmse"], "-"],
        ["landmark RMSE [m]", cell["landmark_rmse"], cell["landmark_rmse_aligned"]],
        [f"NEES of the pose, last {LAST} steps", f"{c.nees_mean:.2f}", "-"],
        ["  95 % of a correct filter", f"{c.nees_band[0]:.2f} to {c.nees_band[1]:.2f}", "-"],
        ["NIS per degree of freedom", f"{c.nis_mean:.3f}", "-"],
    ]


def words(found: Demo) -> list[str]:
    """Return what the figures say, a sentence each."""
    lines = found.consistency.words(found.runs[0].filter)
    first, c = found.runs[0], found.consistency
    others = {"range-bearing": "--filter fej or --filter ri", "range": "--filter ri"}.get(first.drive.sensor.kind)
    if first.filter == "ekf" and c.nees_mean > c.nees_band[1] and others:
        lines.append(f"Compare with {others}: the worlds are the same.")
    total = len(first.drive.W)
    short = sum(len(each.points) < total for each in found.runs)
    if short:
        lines.append(f"In {short} of {len(found.runs)} runs not all {total} landmarks are in the map at the end.")
    wrong, updates = sum(each.wrong for each in found.runs), sum(each.updates for each in found.runs)
    if wrong:
        lines.append(f"{wrong} of {updates} corrections took a measurement for another landmark's.")
    return lines


def write_summary(folder: Path, summary: dict[str, Any]) -> None:
    """Write summary.json; what is not known is null."""
    (folder / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")


def write_runs(folder: Path, found: Demo) -> None:
    """Write runs.csv: a row per run with its seed, its errors, and its NEES over the last steps."""
    import pandas as pd

    table = pd.DataFrame({"run": range(len(found.runs)), "seed": found.seeds, **found.errors})
    table["nees"] = [each.nees_mean for each in found.runs]
    for name in ("updates", "rejected", "wrong", "deleted"):
        table[name] = [getattr(each, name) for each in found.runs]
    table.to_csv(folder / "runs.csv", index=False)


def write_figures(folder: Path, found: Demo) -> None:
    """Write map.png (first run), consistency.png and heading.png."""
    from lab.plots import legend_below, new_figure
    from lab.plots.slam import draw_consistency, draw_heading, draw_run
    from lab.plots.style import save_png

    first, name, n = found.runs[0], found.runs[0].filter, len(found.runs)
    figure = new_figure(7, 9.6)
    draw_run(figure, first)
    error = {name: 100 * values[0] for name, values in found.errors.items()}
    figure.suptitle(
        f"{found.label}, first run\nposition RMSE {error['position_rmse']:.1f} cm"
        f" (aligned {error['position_rmse_aligned']:.1f} cm),"
        f" landmarks {error['landmark_rmse']:.1f} cm (aligned {error['landmark_rmse_aligned']:.1f} cm)",
        fontsize="medium",
    )
    text = f"True and estimated robot and landmarks of {name} with 3-sigma ellipses, and the pose's NEES over time."
    save_png(figure, folder / "map.png", text)

    figure = new_figure(10, 4.4)
    axes = figure.subplots(1, 2)
    draw_consistency(list(axes), {name: found.consistency}, n)
    figure.suptitle(f"{name}: {'one run' if n == 1 else f'means over {n} runs'}")
    legend_below(figure, *axes)
    save_png(figure, folder / "consistency.png", f"NEES and NIS of {name} over time with their 95 % bands.")

    figure = new_figure(7, 4.4)
    ax = figure.subplots()
    stds = np.mean([each.heading_std for each in found.runs], axis=0)
    start = [each.heading_std[np.argmax(each.mapped > 0)] for each in found.runs]
    draw_heading(ax, {name: stds}, float(np.mean(start)))
    legend_below(figure, ax)
    save_png(figure, folder / "heading.png", f"Deviation of the heading of {name} over time, with the gauge's floor.")


def _with_error(values: Array) -> str:
    mean = f"{np.mean(values):.4f}"
    return mean if len(values) == 1 else f"{mean} ({np.std(values, ddof=1) / np.sqrt(len(values)):.4f})"
