"""One instant, truth and estimate side by side: what the animations of the course scrub through.

Question answered: where is the robot, what does it see, and what does the filter make of it?  On the left the truth:
centre, the robot with its last 15 steps, its field of view, each landmark (a full disc when seen, a hollow square when
not) and the measured vectors.  On the right the estimate: means with 99 % ellipses and, for a particle filter, the
cloud.  Both axes keep the same limits at every instant, so that nothing jumps.  Source: figure 1 of the handout.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Wedge

from lab.plots.clouds import draw_cloud
from lab.plots.ellipses import ellipse
from lab.plots.style import ESTIMATE, EXACT, legend_below, wrapped
from lab.problem import Experiment
from lab.result import Filtered
from lab.validation import Array

SIZE = (10.5, 6.5)  # inches, of a figure with both sides
TRAIL = 15  # steps
MARGIN = 1.5  # metres around everything that is true or expected at first
SEEN, UNSEEN = "#006400", "#B23C17"


def draw_truth(ax: Axes, experiment: Experiment, k: int, *, wedge: bool = True) -> Axes:
    """Draw the truth at instant k and what was measured then.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        The legend is left to the caller, as `legend_below`.
    experiment : Experiment
        With truth.
    k : int
        Instant.
    wedge : bool
        Whether the handout's field of view, the quadrant outward and ahead, is drawn.

    Returns
    -------
    matplotlib.axes.Axes
    """
    assert experiment.truth is not None
    robot, landmarks = experiment.truth[k, :2], experiment.truth[k, 2:].reshape(-1, 2)
    vectors = experiment.problem.z[k].reshape(-1, 2)
    seen = ~np.isnan(vectors).any(axis=1)
    if wedge and k > 0:
        ahead = float(np.degrees(np.arctan2(*(robot - experiment.centre)[::-1])))
        ax.add_patch(Wedge((robot[0], robot[1]), 50, ahead, ahead + 90, facecolor="0.9", label="field of view"))
    ax.plot(*experiment.centre, color="black", marker="+", markersize=10, linestyle="none", label="centre")
    trail = experiment.truth[max(0, k - TRAIL) : k + 1, :2]
    ax.plot(*trail.T, color="0.45", marker=".", linewidth=1, label="robot's last steps")
    for vector in vectors[seen]:
        ends = tuple(robot + vector), tuple(robot)
        ax.annotate("", *ends, arrowprops={"arrowstyle": "->", "color": "black", "shrinkA": 0, "shrinkB": 0})
    ax.plot(*landmarks[seen].T, color=SEEN, marker="o", markersize=11, linestyle="none", label="landmark seen")
    ax.plot(
        *landmarks[~seen].T,
        color=UNSEEN,
        marker="s",
        markersize=9,
        fillstyle="none",
        linestyle="none",
        label="landmark not seen",
    )
    for i, spot in enumerate(landmarks):
        ax.annotate(
            f"{i + 1}", (spot[0], spot[1]), ha="center", va="center", fontsize=8, color="white" if seen[i] else UNSEEN
        )
    ax.plot(*robot, color="black", marker="D", markersize=7, linestyle="none", label="robot")
    ax.set_title(f"truth, $k = {k}$" if k else "truth, $k = 0$: nothing is measured")
    return _framed(ax, experiment)


def draw_instant(
    figure: Figure,
    experiment: Experiment,
    estimate: Filtered,
    k: int,
    *,
    exact: Filtered | None = None,
    cloud: tuple[Array, Array] | None = None,
    label: str = "estimate",
) -> tuple[Axes, Axes]:
    """Fill a figure with truth and estimate at instant k.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Empty; `SIZE` inches leave room for the legend.
    experiment : Experiment
        With truth.
    estimate : Filtered
    k : int
        Instant.
    exact : Filtered, optional
        Drawn in black beside the estimate.
    cloud : tuple of (n, P) and (P,) array, optional
        Particles [m] and their weights.
    label : str
        What to call the estimate.

    Returns
    -------
    left, right : matplotlib.axes.Axes
    """
    left, right = figure.subplots(1, 2)
    draw_truth(left, experiment, k)
    if cloud is not None:
        draw_cloud(right, *cloud, label="particles, area by weight")
    _draw_gaussian(right, estimate, k, color=ESTIMATE, linestyle="--", marker="s", label=wrapped(label))
    if exact is not None:
        _draw_gaussian(right, exact, k, color=EXACT, linestyle="-", marker="+", label="exact")
    right.set_title(f"{wrapped(label, 60)}, $k = {k}$")
    _framed(right, experiment)
    right.set_ylabel("")
    legend_below(figure, left, right)
    return left, right


def _draw_gaussian(
    ax: Axes, filtered: Filtered, k: int, *, color: str, linestyle: str, marker: str, label: str
) -> None:
    mean, cov = filtered.means[k], filtered.covs[k]
    patches = [ellipse(ax, mean[i : i + 2], cov[i : i + 2, i : i + 2], color=color) for i in range(0, len(mean), 2)]
    for patch in patches:
        patch.set(linestyle=linestyle)
    patches[0].set_label(f"{label}: 99 % ellipse")
    ax.plot(
        *mean.reshape(-1, 2).T,
        color=color,
        linestyle="none",
        marker=marker,
        markersize=6,
        fillstyle="none",
        label=f"{label}: mean",
    )


def _framed(ax: Axes, experiment: Experiment) -> Axes:
    """Give the axes limits that hold for all instants."""
    assert experiment.truth is not None
    spots = np.vstack([experiment.truth.reshape(-1, 2), experiment.problem.model.m0.reshape(-1, 2)])
    low, high = spots.min(axis=0) - MARGIN, spots.max(axis=0) + MARGIN
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="$x$ [m]", ylabel="$y$ [m]")
    return ax
