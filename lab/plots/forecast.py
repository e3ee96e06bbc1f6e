"""What the theory forecasts: how fast weights degenerate, and how far a bootstrap filter's mean would be off.

Question answered: which filter degenerates when, and how many particles would it take?
"""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes

from lab.plots.style import look
from lab.validation import Array


def draw_forecast(ax: Axes, forecasts: Mapping[str, Array], sizes: tuple[int, ...] = (1000, 1_000_000)) -> Axes:
    """Draw log10 of the limiting ESS / N without resampling over time, one line per proposal.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    forecasts : mapping of str to (N,) array
        By the proposal's name, from `lab.theory.forecast`.
    sizes : tuple of int
        Numbers of particles whose last effective particle is marked by a level line.

    Returns
    -------
    matplotlib.axes.Axes
    """
    for i, (name, values) in enumerate(forecasts.items()):
        style = look(i)
        ax.plot(values, label=name, marker=style.marker, markevery=(i, 6), markersize=4, **style.line())
    for size in sizes:
        ax.axhline(-np.log10(size), color="0.6", linewidth=0.8)
        ax.annotate(
            f"ESS = 1 with N = $10^{{{np.log10(size):.0f}}}$",
            (1, -np.log10(size)),
            xycoords=("axes fraction", "data"),
            xytext=(-3, 2),
            textcoords="offset points",
            ha="right",
            fontsize=8,
        )
    ax.set_xlabel("instant $k$")
    ax.set_ylabel(r"$\log_{10}$ of the limiting ESS$/N$ [-]")
    ax.set_title("Degeneracy without resampling")
    ax.margins(x=0.01)
    ax.grid(visible=True, linewidth=0.3)
    ax.legend(title="proposal", fontsize=9)
    return ax


def draw_predicted_error(ax: Axes, ratios: Mapping[int, Array], limit: float) -> Axes:
    """Draw the bootstrap filter's predicted error over time, one line per N, as far as the prediction holds.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    ratios : mapping of int to (N,) array
        By number of particles: rms over the components of predicted standard deviation / exact standard deviation,
        NaN where the prediction does not hold.
    limit : float
        The ratio beyond which it does not.

    Returns
    -------
    matplotlib.axes.Axes
    """
    for i, (size, values) in enumerate(ratios.items()):
        style = look(i)
        instants = np.arange(1, len(values))
        ax.plot(instants, values[1:], label=f"$N = 10^{{{np.log10(size):.3g}}}$", marker=style.marker, **style.line())
    ax.axhline(limit, color="0.4", linewidth=0.8, label="no prediction above")
    ax.set_yscale("log")
    ax.set_xlabel("instant $k$")
    ax.set_ylabel("predicted error of the mean [exact std]")
    ax.set_title("Bootstrap filter, multinomial resampling at every step")
    ax.grid(visible=True, linewidth=0.3)
    ax.legend(fontsize=9)
    return ax
