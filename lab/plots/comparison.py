"""A comparison in pictures: gaps to the exact filter against N and against seconds.

Question answered: how many particles, and how many seconds, buy how much accuracy?  An error that is only Monte-Carlo
noise falls like N^(-1/2), so that slope is drawn beside the measured ones, and so is the error that theory predicts of
the bootstrap filter, as far as the prediction holds.  The evidence, the health of the cloud over time, and what happens
when a loop is closed have modules of their own and are found here too.

    draw_gap(ax, comparison); legend_below(figure, ax)

Source: questions 5 to 8 of the handout.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, NullLocator
from pandas import DataFrame

from lab import theory
from lab.comparison import Comparison
from lab.plots.evidence import draw_evidence
from lab.plots.health import draw_ess, ess_grid
from lab.plots.loop_closure import draw_loop_closure
from lab.plots.style import EXACT, HALO, free_spot, look, plain_log_ticks, say, wrapped
from lab.validation import Array

__all__ = ["draw_cost", "draw_ess", "draw_evidence", "draw_gap", "draw_loop_closure", "ess_grid"]

METRIC_NAMES = {
    "mean_gap": "gap of the mean [exact std]",
    "cov_gap": "relative gap of the covariance [-]",
}


def draw_gap(ax: Axes, comparison: Comparison, metric: str = "mean_gap") -> Axes:
    """Draw a gap against N, in log-log, with standard errors and the -1/2 slope.

    For the mean, and where a filter with the prior proposal and resampling takes part, the error predicted of the
    bootstrap filter is drawn from the N on from which it holds, `lab.theory.predicted_gap`; else the legend names it.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        The legend is left to the caller, as `legend_below`.
    comparison : Comparison
    metric : str
        "mean_gap" or "cov_gap".

    Returns
    -------
    matplotlib.axes.Axes
    """
    summary = comparison.summary()
    sizes = np.array(sorted(set(summary["n_particles"])), dtype=float)
    shown = _draw_means(ax, summary, metric, "n_particles")
    if len(sizes) > 1 and len(shown):
        first = shown[shown["n_particles"] == shown["n_particles"].min()].nsmallest(1, metric).iloc[0]
        slope = first[metric] * np.sqrt(first["n_particles"] / sizes)
        ax.plot(sizes, slope, color="0.5", linewidth=1, label="slope -1/2")
    if metric == "mean_gap" and any(name == "prior" and share > 0 for name, share in comparison.designs.values()):
        _draw_prediction(ax, comparison.bootstrap_log_variances, sizes)
    if len(sizes) == 1:
        ax.set_xlim(sizes[0] / 3, sizes[0] * 3)
    elif not len(shown):
        ax.set_xlim(sizes[0] / 1.3, sizes[-1] * 1.3)
    ticks = [sizes[0]]
    for size in sizes[1:]:
        if size >= ticks[-1] * (sizes[-1] / sizes[0]) ** 0.1:  # or the numbers touch
            ticks.append(size)
    plain_log_ticks(ax.xaxis)
    ax.xaxis.set_major_locator(FixedLocator(ticks))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.set_xlabel("number of particles $N$ [-]")
    return ax


def draw_cost(ax: Axes, comparison: Comparison, metric: str = "mean_gap") -> Axes:
    """Draw a gap against the seconds that a run takes, in log-log, with standard errors and N beside the points.

    Seconds are medians over the runs that succeeded.  A number that has no room is left out; along a line they rise.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        The legend is left to the caller, as `legend_below`.
    comparison : Comparison
    metric : str
        "mean_gap" or "cov_gap".

    Returns
    -------
    matplotlib.axes.Axes
    """
    good = comparison.runs[comparison.runs["error"] == ""]
    medians = good.groupby(["solver", "n_particles"])["seconds"].median()
    summary = comparison.summary().join(medians, on=["solver", "n_particles"])
    shown = _draw_means(ax, summary, metric, "seconds")
    if len(shown):
        low, high = ax.get_xlim()
        widen = max(1.3, np.sqrt(10 * low / high))  # room for the numbers beside the points
        ax.set_xlim(low / widen, high * widen)
    else:
        ax.set_xlim(0.1, 1)
    plain_log_ticks(ax.xaxis)
    _name_points(ax, shown["seconds"], shown[metric], shown["n_particles"])
    ax.set_xlabel("time of a run, median [s]")
    ax.set_title("beside the points: number of particles $N$", fontsize="medium")
    return ax


def _draw_means(ax: Axes, summary: DataFrame, metric: str, abscissa: str) -> DataFrame:
    """Draw a line with standard errors per solver in log-log, and return the rows that could be drawn."""
    there = (summary[metric] > 0) & (summary[abscissa] > 0)  # what failed has no gap, and zero has no logarithm
    for i, (solver, rows) in enumerate(summary.groupby("solver", sort=False)):
        rows = rows[there[rows.index]].sort_values("n_particles")
        style = look(i)
        ax.errorbar(
            rows[abscissa],
            rows[metric],
            rows[f"{metric}_se"].fillna(0),
            marker=style.marker,
            capsize=3,
            label=wrapped(str(solver)),
            **style.line(),
        )
    ax.set_xscale("log")
    ax.set_yscale("log")
    if not there.any():
        say(ax, "the gap is zero" if summary["runs"].any() else "every run failed")
        ax.set_ylim(0.1, 1)
    low, high = ax.get_ylim()
    widen = max(1.0, np.sqrt(10 * low / high))  # a decade at least, so that the axis has numbers
    ax.set_ylim(low / widen, high * widen)
    plain_log_ticks(ax.yaxis)
    ax.set_ylabel(METRIC_NAMES[metric])
    ax.grid(visible=True, which="both", linewidth=0.3)
    return summary[there]


def _draw_prediction(ax: Axes, ratios: Array, sizes: Array) -> None:
    """Draw the gap predicted of the bootstrap filter from the N on from which it holds, or name that N."""
    _, log10_needed = theory.predicted_gap(ratios, sizes)
    label = "bootstrap filter, predicted"
    if sizes[-1] < 10**log10_needed:
        (line,) = ax.plot([], [], linestyle="none", label=f"{label}:\nonly from $N = 10^{{{log10_needed:.1f}}}$ on")
        line.set_color("0.4")
    elif np.isfinite(log10_needed):
        ends = sizes[[0, -1]] if len(sizes) > 1 else sizes[0] * np.array([1 / 3, 3])
        start = max(10**log10_needed, ends[0])
        reached = np.unique([start, *sizes[sizes > start], ends[1]])
        gaps, _ = theory.predicted_gap(ratios, reached)
        ax.plot(reached, gaps, color=EXACT, linestyle=":", linewidth=1.8, label=label)


def _name_points(ax: Axes, abscissae: DataFrame, ordinates: DataFrame, sizes: DataFrame) -> None:
    """Write N beside the points where there is room: the largest and smallest first, for they say the direction."""
    points = np.column_stack([abscissae, ordinates])
    boxes: list[Array] = []
    order = np.argsort(-np.abs(np.log(sizes) - np.log(sizes).mean()), kind="stable")
    for i in order:
        words = str(sizes.iloc[i])
        spot = free_spot(ax, points, i, len(words), boxes)
        if spot is not None:
            ax.annotate(
                words,
                tuple(points[i]),
                xytext=spot,
                textcoords="offset points",
                ha="center",
                va="center",
                fontsize=8,
                path_effects=HALO,
                zorder=5,
            )
