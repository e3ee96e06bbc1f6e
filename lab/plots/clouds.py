"""A weighted cloud in the plane: every particle's robot and landmarks, large where the weight is.

Question answered: where are the particles, and how many of them count?  The area of a point is its weight relative to
an even one, so a cloud that has collapsed shows as one large point.  Source: questions 4 to 7 of the handout.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection

from lab.plots.style import ESTIMATE
from lab.validation import Array

MOST = 400  # points for each of robot and landmarks: more are one blot
AREA, LARGEST = 6.0, 600.0  # typographic points squared: of an even weight, and of any


def draw_cloud(
    ax: Axes, particles: Array, weights: Array, *, color: str = ESTIMATE, label: str | None = None
) -> PathCollection:
    """Draw the robot and the landmarks of the heaviest particles.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    particles : (n, P) array
        Dimension first [m].
    weights : (P,) array
        Sum to 1.
    color : colour
    label : str, optional
        For the legend.

    Returns
    -------
    matplotlib.collections.PathCollection
        One point for each robot or landmark drawn, particle by particle.
    """
    n, P = particles.shape
    heaviest = np.argsort(-np.asarray(weights), kind="stable")[:MOST]
    spots = particles[:, heaviest].T.reshape(-1, 2)
    areas = np.repeat(np.minimum(AREA * P * np.asarray(weights)[heaviest], LARGEST), n // 2)
    return ax.scatter(
        spots[:, 0], spots[:, 1], s=areas, facecolor=(color, 0.35), edgecolor="none", label=label, zorder=1.5
    )
