"""The evidence: how far each run's log p(z_1..z_k) is from the exact one.

Question answered: can the filter's evidence be used, to compare models say?  A particle filter's evidence is unbiased,
its logarithm is not: its mean lies below the exact value, by half its variance while that is small.
Source: question 8 of the handout.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator

from lab.comparison import Comparison
from lab.plots.style import EXACT, HATCHES, look, say, wrapped
from lab.validation import Array

FEWEST = 5  # runs that a box can stand for; fewer are points
WIDE = 30  # nats: beyond it the scale is logarithmic, or all but the worst filter would lie on zero


def draw_evidence(ax: Axes, comparison: Comparison) -> Axes:
    """Draw box plots of estimated minus exact log-evidence, solvers side by side, groups by N.

    Box: quartiles and median; whiskers: to the last run within 1.5 box lengths; circles: runs beyond.  Fewer than five
    runs are drawn as points.  The scale is logarithmic beyond one nat where a run is further off than thirty.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        The legend is left to the caller, as `legend_below`.
    comparison : Comparison

    Returns
    -------
    matplotlib.axes.Axes
    """
    sizes = sorted({record.unit.n_particles for record in comparison.records})
    solvers = comparison.solvers
    ax.axhline(0, color=EXACT, linewidth=1, label="exact")
    reach = 0.0
    for i, solver in enumerate(solvers):
        label = wrapped(solver)
        for j, size in enumerate(sizes):
            values = np.array([record.metrics.log_evidence_gap for record in comparison.of(solver, size)])
            if len(values):
                position = j + 0.84 * ((i + 0.5) / len(solvers) - 0.5)
                _draw_box(ax, values, position, 0.84 / len(solvers), index=i, label=label)
                label, reach = "", max(reach, float(np.abs(values).max()))
    for j in range(len(sizes) - 1):
        ax.axvline(j + 0.5, color="0.8", linewidth=0.8)
    ax.set_xlim(-0.5, len(sizes) - 0.5)
    ax.set_xticks(range(len(sizes)), list(map(str, sizes)))
    ax.set_xlabel("number of particles $N$ [-]")
    scale = ""
    if reach > WIDE:
        _symlog(ax)
        scale = "\nlogarithmic beyond ±1"
    elif not reach:
        ax.set_ylim(-1, 1)
    ax.set_ylabel(f"estimated minus exact log-evidence{scale} [nat]")
    if not any(comparison.of(solver, size) for solver in solvers for size in sizes):
        say(ax, "every run failed\n\n")  # above the line of the exact value
    ax.grid(visible=True, axis="y", linewidth=0.3)
    return ax


def _draw_box(ax: Axes, values: Array, position: float, width: float, *, index: int, label: str) -> None:
    style = look(index)
    if len(values) < FEWEST:
        ax.plot(
            np.full(len(values), position),
            values,
            color=style.color,
            linestyle="none",
            marker=style.marker,
            fillstyle="none",
            label=label,
        )
        return
    parts = ax.boxplot(
        [values],
        positions=[position],
        widths=0.8 * width,
        patch_artist=True,
        manage_ticks=False,
        medianprops={"color": "black", "linewidth": 1.5},
        flierprops={"markersize": 3, "markeredgecolor": style.color},
        whiskerprops={"color": style.color},
        capprops={"color": style.color},
    )
    (box,) = parts["boxes"]
    box.set(facecolor=(style.color, 0.3), edgecolor=style.color, hatch=HATCHES[index % len(HATCHES)], label=label)


def _symlog(ax: Axes) -> None:
    """Make the ordinate linear within one nat and logarithmic beyond, with numbers at powers of ten."""
    low, high = ax.dataLim.intervaly
    ax.set_yscale("symlog", linthresh=1)
    ax.set_ylim(min(1.5 * low, -1), max(1.5 * high, 1))
    low, high = ax.get_ylim()
    decades = np.arange(np.ceil(np.log10(max(-low, high))))
    tens = 10.0 ** decades[:: -(-len(decades) // 4)]  # five would crowd when both signs are there
    ax.yaxis.set_major_locator(FixedLocator([tick for tick in [*-tens[::-1], 0, *tens] if low <= tick <= high]))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.yaxis.set_minor_locator(NullLocator())
    ax.yaxis.set_minor_formatter(NullFormatter())
