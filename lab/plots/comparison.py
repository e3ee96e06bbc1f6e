"""A comparison in pictures: the gap to the exact filter against N, and the health of the cloud over time.

Question answered: how many particles buy how much accuracy, and where does each filter degenerate?  An error that is
only Monte-Carlo noise falls like N^(-1/2), so that slope is drawn beside the measured ones; degeneracy needs two
readings, because the effective sample size recovers after each resampling while the ancestors die out.
Source: questions 5 to 8 of the handout.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator

from lab.comparison import Comparison
from lab.plots.style import instants_axis, legend_below, look, plain_log_ticks, thinned, wrapped
from lab.validation import Array

METRIC_NAMES = {
    "mean_gap": "gap of the mean [exact std]",
    "cov_gap": "relative gap of the covariance [-]",
}
ABREAST = 4  # solvers side by side in the figure of ESS, at most
MOST_SIZES = 4  # lines of ESS in one axes: more cannot be told apart


def draw_gap(ax: Axes, comparison: Comparison, metric: str = "mean_gap") -> Axes:
    """Draw a gap against N, in log-log, with standard errors and the -1/2 slope.

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
    shown = summary[summary[metric] > 0]  # what failed has no gap, and zero has no logarithm
    for i, (solver, rows) in enumerate(summary.groupby("solver", sort=False)):
        rows = rows[rows[metric] > 0].sort_values("n_particles")
        style = look(i)
        ax.errorbar(
            rows["n_particles"],
            rows[metric],
            rows[f"{metric}_se"].fillna(0),
            marker=style.marker,
            capsize=3,
            label=wrapped(str(solver)),
            **style.line(),
        )
    sizes = np.array(sorted(set(summary["n_particles"])), dtype=float)
    if len(sizes) > 1 and len(shown):
        first = shown[shown["n_particles"] == shown["n_particles"].min()].nsmallest(1, metric).iloc[0]
        slope = first[metric] * np.sqrt(first["n_particles"] / sizes)
        ax.plot(sizes, slope, color="0.5", linewidth=1, label="slope -1/2")
    ax.set_xscale("log")
    ax.set_yscale("log")
    if len(sizes) == 1:
        ax.set_xlim(sizes[0] / 3, sizes[0] * 3)
    ticks = [sizes[0]]
    for size in sizes[1:]:
        if size >= ticks[-1] * (sizes[-1] / sizes[0]) ** 0.1:  # or the numbers touch
            ticks.append(size)
    plain_log_ticks(ax.xaxis)
    ax.xaxis.set_major_locator(FixedLocator(ticks))
    ax.xaxis.set_minor_locator(NullLocator())
    if not len(shown):
        reason = "the gap is zero" if summary["runs"].any() else "every run failed"
        ax.text(0.5, 0.5, reason, transform=ax.transAxes, ha="center", va="center", color="0.4")
        ax.set_ylim(0.1, 1)
    low, high = ax.get_ylim()
    widen = max(1.0, np.sqrt(10 * low / high))  # a decade at least, so that the axis has numbers
    ax.set_ylim(low / widen, high * widen)
    plain_log_ticks(ax.yaxis)
    ax.set_xlabel("number of particles $N$ [-]")
    ax.set_ylabel(METRIC_NAMES[metric])
    ax.grid(visible=True, which="both", linewidth=0.3)
    return ax


def draw_ess(figure: Figure, comparison: Comparison) -> list[Axes]:
    """Fill a figure with the cloud's health over time: for each solver ESS above, living ancestors below.

    Lines are medians over the runs, bands reach from the lowest run to the highest; one line per N, four at most.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Empty; up to four solvers stand side by side, the others under them.
    comparison : Comparison

    Returns
    -------
    list of matplotlib.axes.Axes
        For each solver in turn, ESS and ancestors.
    """
    solvers = comparison.solvers
    sizes = sorted({record.unit.n_particles for record in comparison.records})
    rows, width = ess_grid(len(solvers))
    grid = figure.subplots(2 * rows, width, sharex=True, sharey=True, squeeze=False)
    pairs = [(grid[2 * (i // width), i % width], grid[2 * (i // width) + 1, i % width]) for i in range(len(solvers))]
    for spare in grid[-2:, (len(solvers) - 1) % width + 1 :].ravel():
        spare.remove()
    for i, (solver, pair) in enumerate(zip(solvers, pairs, strict=True)):
        pair[0].set_title(wrapped(solver))
        for ax, name in zip(pair, ("ess", "survivors"), strict=True):
            _draw_health(ax, comparison, solver, thinned(sizes, MOST_SIZES), name)
        pair[0].axhline(2, color="0.4", linewidth=0.8, label="ESS = 2: collapsed below")
        instants_axis(pair[1])
        pair[1].tick_params(labelbottom=True)
        if i % width == 0:
            pair[0].set_ylabel("effective sample size\n[particles]")
            pair[1].set_ylabel("ancestors of time 0 alive\n[particles]")
    pairs[0][0].set(yscale="log", ylim=(0.7, 1.5 * max(2, *sizes)))  # of all: the axes share it
    for ax in figure.axes:
        plain_log_ticks(ax.yaxis)
        ax.grid(visible=True, linewidth=0.3)
    figure.suptitle(_caption(comparison, sizes))
    legend_below(figure, *(pair[0] for pair in pairs))
    return [ax for pair in pairs for ax in pair]


def ess_grid(n_solvers: int) -> tuple[int, int]:
    """Return how many rows of how many solvers the figure of ESS has: rows of even length, as far as that goes."""
    rows = -(-n_solvers // ABREAST)
    return rows, -(-n_solvers // rows)


def _caption(comparison: Comparison, sizes: list[int]) -> str:
    runs = 1 + max(record.unit.run for record in comparison.records)
    text = "one run" if runs == 1 else f"medians over {runs} runs,\nbands from the lowest run to the highest"
    if len(sizes) > MOST_SIZES:
        text += f", {MOST_SIZES} of {len(sizes)} numbers of particles"
    return f"Health of the cloud: {text}"


def _draw_health(ax: Axes, comparison: Comparison, solver: str, sizes: list[int], name: str) -> None:
    """Draw one line and band per N, or say why there is none."""
    failed = True
    for i, size in enumerate(sizes):
        records = comparison.of(solver, size)
        failed &= not records
        series = [getattr(record, name) for record in records if getattr(record, name) is not None]
        if series:
            _draw_spread(ax, np.array(series, dtype=float), i, f"$N = {size}$")
    if not ax.lines:
        reason = "every run failed" if failed else "not given by this filter"
        ax.text(0.5, 0.5, reason, transform=ax.transAxes, ha="center", va="center", color="0.4")


def _draw_spread(ax: Axes, series: Array, index: int, label: str) -> None:
    instants = np.arange(series.shape[1])
    style = look(index)
    ax.plot(instants, np.median(series, axis=0), label=label, **style.line())
    ax.fill_between(instants, series.min(axis=0), series.max(axis=0), color=style.color, alpha=0.15, linewidth=0)
