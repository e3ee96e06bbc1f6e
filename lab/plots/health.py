"""The health of each filter's cloud over time: effective sample size, its forecast, and the ancestors still alive.

Question answered: where does each filter degenerate?  It takes two readings, because the effective sample size recovers
after each resampling while the ancestors die out.  The forecast, where theory knows the filter, was made before a
particle was drawn: the limit of ESS / N with the filter's own resampling threshold, times the largest N.
Source: questions 5 to 7 of the handout.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from lab.comparison import Comparison
from lab.plots.style import (
    EXACT,
    instants_axis,
    legend_below,
    look,
    plain_log_ticks,
    runs_in_words,
    say,
    thinned,
    wrapped,
)
from lab.validation import Array

ABREAST = 4  # solvers side by side in the figure of ESS, at most
MOST_SIZES = 4  # lines of ESS in one axes: more cannot be told apart


def draw_ess(figure: Figure, comparison: Comparison) -> list[Axes]:
    """Fill a figure with the cloud's health over time: for each solver ESS above, living ancestors below.

    Lines are medians over the runs, bands reach from the lowest run to the highest; one line per N, four at most.
    The forecast of the ESS, median over data sets, is that of the largest N; below one particle it is drawn at one.

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
        if solver in comparison.forecasts and pair[0].lines:
            _draw_forecast(pair[0], comparison.forecasts[solver], sizes[-1])
        pair[0].axhline(2, color="0.4", linewidth=0.8, label="ESS = 2: collapsed below")
        instants_axis(pair[1])
        pair[1].tick_params(labelbottom=True)
        if i % width == 0:
            pair[0].set_ylabel("effective sample size\n[particles]")
            pair[1].set_ylabel("ancestors of time 0 alive\n[particles]")
    pairs[0][0].set(yscale="log", ylim=(0.7, 1.5 * max(2, *sizes)))  # of all: the axes share it
    for ax in figure.axes:
        plain_log_ticks(ax.yaxis)
        ax.yaxis.set_minor_locator(NullLocator())  # lines at the numbers suffice, and each tick takes a millisecond
        ax.grid(visible=True, linewidth=0.3)
    figure.suptitle(_caption(comparison, sizes))
    legend_below(figure, *(pair[0] for pair in pairs))
    return [ax for pair in pairs for ax in pair]


def ess_grid(n_solvers: int) -> tuple[int, int]:
    """Return how many rows of how many solvers the figure of ESS has: rows of even length, as far as that goes."""
    rows = -(-n_solvers // ABREAST)
    return rows, -(-n_solvers // rows)


def _caption(comparison: Comparison, sizes: list[int]) -> str:
    words = runs_in_words(comparison)
    text = words if words == "one run" else f"medians over {words},\nbands from the lowest run to the highest"
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
        say(ax, reason)


def _draw_spread(ax: Axes, series: Array, index: int, label: str) -> None:
    instants = np.arange(series.shape[1])
    style = look(index)
    ax.plot(instants, np.median(series, axis=0), label=label, **style.line())
    ax.fill_between(instants, series.min(axis=0), series.max(axis=0), color=style.color, alpha=0.15, linewidth=0)


def _draw_forecast(ax: Axes, log10_ratios: Array, size: int) -> None:
    ess = np.maximum(size * 10 ** np.median(log10_ratios, axis=0), 1)
    ax.plot(ess, color=EXACT, linestyle=(0, (4, 2)), linewidth=1, label=f"forecast, $N = {size}$")
