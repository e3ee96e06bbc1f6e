"""Corridors: each component over time within three standard deviations, 99.73 % of a Gaussian in one dimension.

Question answered: where does the filter say that the state is, and is it there?  Source: question 4b of the handout.
"""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import FillBetweenPolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from lab.plots.style import ESTIMATE, EXACT, TRUTH, component_names, instants_axis, legend_below, wrapped
from lab.result import Filtered
from lab.validation import Array

MOST_LANDMARKS = 7  # a page


def corridor(
    ax: Axes,
    instants: Array,
    mean: Array,
    std: Array,
    *,
    color: Any,
    linestyle: str = "-",
    label: str | None = None,
    n_sigma: float = 3.0,
) -> tuple[Line2D, FillBetweenPolyCollection]:
    """Draw the mean of one component and a band of `n_sigma` standard deviations on either side.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    instants : (N,) array
        Abscissae: k, or seconds.
    mean, std : (N,) array
        Of one component [m].
    color : colour
    linestyle : str
        Of the mean and of the band's edge, so that two corridors can be told apart in grey.
    label : str, optional
        For the legend, on the mean.
    n_sigma : float
        Half width of the band in standard deviations.

    Returns
    -------
    line : matplotlib.lines.Line2D
    band : matplotlib.collections.FillBetweenPolyCollection
    """
    (line,) = ax.plot(instants, mean, color=color, linestyle=linestyle, linewidth=1.2, label=label)
    low, high = mean - n_sigma * std, mean + n_sigma * std
    band = ax.fill_between(instants, low, high, facecolor=(color, 0.15), edgecolor=color, linestyle=linestyle)
    band.set_linewidth(0.5)
    return line, band


def draw_corridors(
    figure: Figure, filtered: Filtered | None, exact: Filtered, truth: Array | None = None, *, label: str = "estimate"
) -> list[Axes]:
    """Fill a figure with the corridors of every component: exact, estimated, and the truth.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Empty; two columns and a row for the robot and each of the first seven landmarks.
    filtered : Filtered or None
        A particle filter's answer; None draws the exact corridors alone.
    exact : Filtered
    truth : (N, n) array, optional
        True states [m].
    label : str
        What to call the estimate.

    Returns
    -------
    list of matplotlib.axes.Axes
        One per component drawn.
    """
    n = exact.means.shape[1]
    shown = min(n, 2 + 2 * MOST_LANDMARKS)
    instants = np.arange(len(exact.means), dtype=float)
    axes = list(figure.subplots(shown // 2, 2, sharex=True, squeeze=False).ravel())
    for i, (ax, name) in enumerate(zip(axes, component_names(n), strict=False)):
        _draw_component(ax, instants, exact, i, color=EXACT, linestyle="-", label="exact mean, ±3 std")
        if filtered is not None:
            words = f"{wrapped(label, 50)} mean, ±3 std"
            _draw_component(ax, instants, filtered, i, color=ESTIMATE, linestyle="--", label=words)
        if truth is not None:
            ax.plot(instants, truth[:, i], color=TRUTH, linestyle=":", linewidth=1.6, label="truth")
        ax.set_ylabel(name)
        ax.margins(x=0)
        instants_axis(ax, label=ax in axes[-2:])
    title = "Corridors of the exact filter" if filtered is None else f"Corridors of {label} and of the exact filter"
    title = title if shown == n else f"{title} (first {MOST_LANDMARKS} of {n // 2 - 1} landmarks)"
    figure.suptitle(wrapped(title, 80))
    legend_below(figure, axes[0])
    return axes


def _draw_component(
    ax: Axes, instants: Array, filtered: Filtered, i: int, *, color: str, linestyle: str, label: str
) -> None:
    mean, std = filtered.means[:, i], filtered.stds[:, i]
    for artist in corridor(ax, instants, mean, std, color=color, linestyle=linestyle):
        artist.set_label(label)  # both: they share a line of the legend
