"""Confidence ellipses: where a Gaussian's mass is, in two dimensions.

    (x - mean)' cov^-1 (x - mean) <= chi2(probability, 2)

For 99 % the radius is sqrt(9.21) = 3.035 deviations; "3 sigma" would be 98.9 %.  Source: the handout's `ellipse`.
"""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse

from lab.gaussian import chi2_quantile
from lab.validation import Array, InputError, check_covariance, real_array


def ellipse(ax: Axes, mean: Array, cov: Array, *, color: Any, probability: float = 0.99) -> Ellipse:
    """Draw the region that holds this probability of N(mean, cov), filled at an opacity of 0.2.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    mean : (2,) array
        Centre [m].
    cov : (2, 2) array
        Covariance [m^2]; where it is singular the ellipse is a line or a point.
    color : colour
        Of the filling and of the edge.
    probability : float
        In (0, 1).

    Returns
    -------
    matplotlib.patches.Ellipse
        Already added to `ax`.

    Raises
    ------
    InputError
        `mean` or `cov` has the wrong shape, is not finite or is no covariance, or `probability` is out of range.
    """
    mean = real_array("mean", mean, (2,))
    cov = real_array("cov", cov, (2, 2))
    check_covariance("cov", cov)
    if not 0 < probability < 1:
        raise InputError(f"probability must lie strictly between 0 and 1, not {probability}.")
    # eigh and not eig: the handout's blocks are circles to rounding, where eig's axes are oblique or complex
    variances, axes = np.linalg.eigh((cov + cov.T) / 2)
    minor, major = 2 * np.sqrt(chi2_quantile(probability, 2) * np.maximum(variances, 0))
    angle = np.degrees(np.arctan2(axes[1, 1], axes[0, 1]))
    patch = Ellipse((mean[0], mean[1]), major, minor, angle=angle)
    patch.set_facecolor((color, 0.2))
    patch.set_edgecolor(color)
    ax.add_patch(patch)
    ax.autoscale_view()
    return patch
