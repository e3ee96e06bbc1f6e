"""The map at one instant: robot and landmarks with their 99 % ellipses, exact, estimated and true.

Question answered: does the estimated map agree with the exact one, and does either hold the truth?
Source: question 4b of the handout.
"""

import numpy as np
from matplotlib.axes import Axes

from lab.plots.ellipses import ellipse
from lab.plots.style import ESTIMATE, EXACT, HALO, TRUTH, wrapped
from lab.result import Filtered
from lab.validation import Array

LABEL_DISTANCE = 15  # typographic points from the mean


def draw_map(
    ax: Axes,
    filtered: Filtered | None,
    exact: Filtered,
    truth: Array | None = None,
    *,
    k: int = -1,
    label: str = "estimate",
) -> Axes:
    """Draw the map at instant k: means and ellipses of the robot and of all landmarks, and the true path up to k.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        The legend is left to the caller, as `legend_below`.
    filtered : Filtered or None
        A particle filter's answer; None draws the exact map alone.
    exact : Filtered
    truth : (N, n) array, optional
        True states [m].
    k : int
        Instant; negative counts from the end.
    label : str
        What to call the estimate.

    Returns
    -------
    matplotlib.axes.Axes
    """
    k %= len(exact.means)
    _draw_estimate(ax, exact, k, color=EXACT, linestyle="-", marker="+", label="exact")
    marks = [exact.means[k]]
    if filtered is not None:
        _draw_estimate(ax, filtered, k, color=ESTIMATE, linestyle="--", marker="s", label=wrapped(label))
        marks.append(filtered.means[k])
        for i in range(0, len(exact.means[k]), 2):  # which estimate belongs to which landmark
            ends = np.array([exact.means[k, i : i + 2], filtered.means[k, i : i + 2]])
            ax.plot(*ends.T, color=ESTIMATE, linewidth=0.6)
    if truth is not None:
        ax.plot(truth[: k + 1, 0], truth[: k + 1, 1], color=TRUTH, linestyle=":", linewidth=1, label="true path")
        ax.plot(
            *truth[k].reshape(-1, 2).T, color=TRUTH, linestyle="none", marker="x", markersize=7, label="truth at $k$"
        )
        marks.append(truth[k])
    _draw_names(ax, exact.means[k].reshape(-1, 2), np.concatenate(marks).reshape(-1, 2))
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_xlabel("$x$ [m]")
    ax.set_ylabel("$y$ [m]")
    ax.set_title(f"{wrapped(label, 60)}, $k = {k}$" if filtered is not None else f"exact filter, $k = {k}$")
    return ax


def _draw_estimate(
    ax: Axes, filtered: Filtered, k: int, *, color: str, linestyle: str, marker: str, label: str
) -> None:
    mean, cov = filtered.means[k], filtered.covs[k]
    patches = [ellipse(ax, mean[i : i + 2], cov[i : i + 2, i : i + 2], color=color) for i in range(0, len(mean), 2)]
    for patch in patches:
        patch.set(linestyle=linestyle)
    points = ax.plot(
        *mean.reshape(-1, 2).T, color=color, linestyle="none", marker=marker, markersize=6, fillstyle="none"
    )
    for artist in (patches[0], points[0]):
        artist.set_label(f"{label}: mean, 99 % ellipse")


def _draw_names(ax: Axes, means: Array, marks: Array) -> None:
    """Name each mean beside it, in that of eight directions where the nearest mark or other name is farthest."""
    angles = np.radians([135, 45, 225, 315, 180, 0, 90, 270])
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    reach = 0.05 * max(ax.dataLim.width, ax.dataLim.height)  # about LABEL_DISTANCE on a page
    for i, mean in enumerate(means):
        spots = mean + reach * directions
        nearest = np.linalg.norm(spots[:, np.newaxis] - marks, axis=2).min(axis=1)
        best = np.argmax(nearest.round(6))
        marks = np.vstack([marks, spots[best]])
        ax.annotate(
            f"$m_{{{i}}}$" if i else "$r$",
            (mean[0], mean[1]),
            xytext=tuple(LABEL_DISTANCE * directions[best]),
            textcoords="offset points",
            ha="center",
            va="center",
            path_effects=HALO,
            zorder=5,
        )
