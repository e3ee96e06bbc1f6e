"""Pictures of replayed drives: the map as it is and after the best rigid motion, and how sure the filter was over time.

Question answered: where did the robots go, where are the landmarks, and does either agree with the truth?  The frame of
a map cannot be observed, so the map is shown twice where there is a truth.  Landmarks have the guide's colours, true
ones red and estimated ones blue with green 3-sigma ellipses; the true way is grey, each robot's estimate has its look.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from lab.ekfslam.alignment import apply
from lab.ekfslam.uncertainty import cov2elli
from lab.gaussian import chi2_quantile
from lab.plots.style import TRUTH, look, wrapped
from lab.validation import Array

SIGMAS = 3
WINDOWS = 60  # stretches of time over which NIS is averaged
POSE = 3  # degrees of freedom
BAND = "0.85"
LEVEL = (0.025, 0.975)
HONEST = "95 % of a filter that is as sure as it should be"
LEAST = 1e-2  # NEES below which nothing is told: at the start, where truth and estimate agree by definition


@dataclass(frozen=True, eq=False)
class Way:
    """What one robot's filter noted.

    Attributes
    ----------
    label : str
    poses, truth : (N, 3) array
        [m, m, rad]; NaN where there is no truth.
    nees, nis, dof : (N,) array
        As in `replay`.
    """

    label: str
    poses: Array
    truth: Array
    nees: Array
    nis: Array
    dof: Array


@dataclass(frozen=True, eq=False)
class Chart:
    """A final map.

    Attributes
    ----------
    ways : sequence of Way
        Of its robots.
    points : (L, 2) array
        Estimated landmarks [m].
    covs : (L, 2, 2) array
    true_points : (M, 2) array
        True landmarks [m].
    motion : (float, (2,) array)
        The rigid motion that fits the estimated ways to the true ones, or the landmarks where there are no ways.
    """

    ways: Sequence[Way]
    points: Array
    covs: Array
    true_points: Array
    motion: tuple[float, Array]


def draw_charts(ax: Axes, charts: Sequence[Chart], *, aligned: bool = False) -> Axes:
    """Draw ways and landmarks of maps, each moved to where it fits the truth best when `aligned`.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        The legend is left to the caller, as `legend_below`.
    charts : sequence of Chart
    aligned : bool

    Returns
    -------
    matplotlib.axes.Axes
    """
    index = 0
    for chart in charts:
        angle, shift = chart.motion if aligned else (0.0, np.zeros(2))
        for way in chart.ways:
            if np.isfinite(way.truth).any():
                ax.plot(*way.truth[:, :2].T, color=TRUTH, linewidth=2.2, alpha=0.5, label="true way")
            moved = apply(angle, shift, way.poses[:, :2])
            ax.plot(*moved.T, linewidth=0.9, label=wrapped(f"estimated way of {way.label}"), **look(index).line())
            index += 1
        true = chart.true_points
        if len(true):
            ax.plot(*true.T, linestyle="", marker="x", color="red", markersize=7, zorder=4, label="true landmark")
        if len(chart.points):
            turn = apply(angle, np.zeros(2), np.eye(2)).T
            moved = apply(angle, shift, chart.points)
            ax.plot(
                *moved.T, linestyle="", marker="+", color="blue", markersize=6, zorder=5, label="estimated landmark"
            )
            rings = [cov2elli(p, turn @ P @ turn.T, SIGMAS) for p, P in zip(moved, chart.covs, strict=True)]
            label = f"its {SIGMAS}-sigma ellipse"
            width = 0.9 if len(charts) == 1 else 0.4  # several maps of the same landmarks
            ax.add_collection(LineCollection(rings, colors="green", linewidths=width, zorder=3, label=label))
    ax.set(xlabel="$x$ [m]", ylabel="$y$ [m]")
    ax.set_aspect("equal", adjustable="datalim")
    ax.autoscale_view()
    return ax


def draw_nees(ax: Axes, ways: Sequence[Way]) -> Axes:
    """Draw each pose's NEES over the noted steps, in log, above the 95 % band of one consistent filter."""
    low, high = chi2_quantile(np.array(LEVEL), POSE)
    ax.axhspan(low, high, color=BAND, label=HONEST)
    for i, way in enumerate(ways):
        ax.plot(way.nees, linewidth=0.8, label=wrapped(way.label), **look(i).line())
    ax.set_yscale("log")
    ax.set(ylabel="NEES of the pose [-]", xlabel="noted step [-]")
    ax.set_ylim(bottom=max(LEAST, ax.get_ylim()[0]))
    ax.margins(x=0.01)
    return ax


def draw_nis(ax: Axes, ways: Sequence[Way]) -> Axes:
    """Draw NIS by degree of freedom of all robots, averaged over stretches of time, above the 95 % band."""
    count = max(len(way.nis) for way in ways)
    edges = np.unique(np.linspace(0, count, min(WINDOWS, count) + 1).astype(int))
    nis, dof = (
        np.sum([[part.sum() for part in np.split(series, edges[1:-1])] for series in each], axis=0)
        for each in ([way.nis for way in ways], [way.dof for way in ways])
    )
    seen = dof > 0
    middles, nis, dof = ((edges[:-1] + edges[1:]) / 2)[seen], nis[seen], dof[seen]
    if len(dof):
        low, high = (chi2_quantile(p, dof) / dof for p in LEVEL)
        ax.fill_between(middles, low, high, color=BAND, linewidth=0, label=HONEST)
    label = wrapped(ways[0].label) if len(ways) == 1 else "all robots"
    ax.plot(middles, nis / dof, marker=".", color="black", linewidth=1, label=label)
    ax.axhline(1, color="0.5", linewidth=0.8)
    ax.set(ylabel="NIS by degree of freedom [-]", xlabel="noted step [-]")
    ax.set_ylim(bottom=0)
    ax.margins(x=0.01)
    return ax
