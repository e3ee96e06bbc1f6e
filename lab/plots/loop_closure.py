"""Loop closure: a landmark seen again sharpens the others too, through their correlations, if the filter keeps them.

Question answered: does a filter still have the correlations that closing a loop needs?  The exact filter does; a cloud
whose map descends from one particle has no spread to correlate.  Of a landmark's block P_ii (2, 2), and of two:

    deviation_i = sqrt(trace P_ii / 2)        correlation_ij = trace P_ij / sqrt(trace P_ii  trace P_jj)

The instant drawn is that at which a landmark comes back into view and those out of view sharpen most, exactly.  What is
measured is landmark minus robot, so those just seen sharpen through the robot, whatever their correlation with it.
Source: question 7 of the handout.
"""

from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from lab.comparison import Comparison, Record
from lab.plots.style import ESTIMATE, EXACT, instants_axis, legend_below, look, record_in_words, say, wrapped
from lab.problem import Problem
from lab.result import Filtered
from lab.validation import Array

MOST_LINES = 5  # landmarks in one axes over time: of more, those that the closure sharpens most
MOST_COMPARED = 20  # landmarks before and after
NO_SPREAD = 1e-6  # of the exact deviation: below it copies of one particle differ by rounding alone


class Closure(NamedTuple):
    """A landmark that comes back into view.

    Attributes
    ----------
    k : int
        The instant.
    landmark : int
        Which, from 0; where several come back, the one that sharpens most.
    away : int
        For how many instants it was out of sight.
    in_view : (M,) array
        Which landmarks are seen at k.
    sharpening : (M,) array
        By which share of itself each exact deviation falls from k - 1 to k.
    """

    k: int
    landmark: int
    away: int
    in_view: NDArray[np.bool_]
    sharpening: Array


def loop_closure(problem: Problem, exact: Filtered) -> Closure | None:
    """Return the closure that sharpens the landmarks out of view most, in sum; None where no landmark comes back."""
    seen = _in_view(problem)
    again = seen[1:] & ~seen[:-1] & np.logical_or.accumulate(seen)[:-1]
    if not again.any():
        return None
    stds = deviations(exact)
    sharpening = np.divide(stds[:-1] - stds[1:], stds[:-1], out=np.zeros(again.shape), where=stds[:-1] > 0)
    others = np.where(seen[1:], 0, sharpening).sum(axis=1)
    own = np.where(again, sharpening, -np.inf)
    best = max(np.flatnonzero(again.any(axis=1)), key=lambda i: (others[i], own[i].max()))
    landmark = int(own[best].argmax())
    away = int(best - np.flatnonzero(seen[: best + 1, landmark])[-1])
    return Closure(int(best) + 1, landmark, away, seen[best + 1], sharpening[best])


def deviations(filtered: Filtered) -> Array:
    """Return the standard deviation of each landmark over time [m], root mean square of x and y, (N, M)."""
    squares: Array = filtered.stds[:, 2:].reshape(len(filtered.means), -1, 2) ** 2
    return np.asarray(np.sqrt(squares.mean(axis=2)))


def correlations(filtered: Filtered, landmark: int, floor: Array) -> Array:
    """Return the correlation of each landmark with this one over time (N, M).

    NaN where one of the two has a deviation no larger than `floor` (N, M) [m].
    """
    i, stds = 2 + 2 * landmark, deviations(filtered)
    cross = (filtered.covs[:, i, 2::2] + filtered.covs[:, i + 1, 3::2]) / 2
    defined = (stds > floor) & (stds > floor)[:, [landmark]]
    values: Array = np.divide(cross, stds * stds[:, [landmark]], out=np.full(stds.shape, np.nan), where=defined)
    return values


def kept(comparison: Comparison, solver: str) -> Record | None:
    """Return the record with the moments to be drawn: the first data set's first good run kept, with the largest N."""
    found = [r for r in comparison.records if r.unit.solver == solver and r.unit.data_set == 0 and r.filtered]
    return max(found, key=lambda record: record.unit.n_particles, default=None)


def draw_loop_closure(figure: Figure, comparison: Comparison, solver: str | None = None) -> list[Axes]:
    """Fill a figure with deviations and correlations of the landmarks around a loop closure, exact and estimated.

    Over time at most five landmarks are drawn, those that sharpen most; before and after the closure at most twenty.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Empty.
    comparison : Comparison
        Its first data set is drawn.
    solver : str, optional
        Label; by default the first.

    Returns
    -------
    list of matplotlib.axes.Axes
        Deviations over time, correlations over time, deviations before and after; one, that says so, where no
        landmark comes back into view.
    """
    problem, exact = comparison.problems[0], comparison.exacts[0]
    solver = comparison.solvers[0] if solver is None else solver
    record = kept(comparison, solver)
    estimate = record.filtered if record else None
    name = record_in_words(comparison, record) if record else f"{solver} (no run kept)"
    closure = loop_closure(problem, exact)
    if closure is None:
        ax = figure.subplots()
        ax.set_axis_off()
        say(ax, "No loop is closed: no landmark comes back into view after being out of sight.")
        figure.suptitle(wrapped(f"Loop closure: {name}", 80))
        return [ax]
    grid = figure.add_gridspec(2, 2)
    over_time, correlated, across = (figure.add_subplot(cell) for cell in (grid[0, 0], grid[0, 1], grid[1, :]))
    shown = _chosen(closure)
    _draw_deviations(over_time, problem, exact, estimate, closure, shown, solver)
    _draw_correlations(correlated, exact, estimate, closure, shown)
    _draw_change(across, exact, estimate, closure)
    instants = "instant" if closure.away == 1 else "instants"
    title = f"Loop closed at k = {closure.k}: landmark {closure.landmark + 1} is seen again after {closure.away}"
    figure.suptitle(f"{title} {instants} out of sight\n{wrapped(f'{name} against the exact filter', 80)}")
    legend_below(figure, across, over_time)
    return [over_time, correlated, across]


def _in_view(problem: Problem) -> NDArray[np.bool_]:
    """Say which landmarks are seen when (N, M), at least in one coordinate."""
    hidden = np.isnan(problem.z)
    return np.asarray(~(hidden[:, ::2] & hidden[:, 1::2]))


def _chosen(closure: Closure) -> list[int]:
    """Return the landmarks to draw over time: the one seen again, and of the others those sharpened most."""
    order = np.argsort(np.where(closure.in_view, -1, closure.sharpening))[::-1]
    others = [int(i) for i in order if i != closure.landmark]
    return sorted([closure.landmark, *others[: MOST_LINES - 1]])


def _draw_deviations(
    ax: Axes,
    problem: Problem,
    exact: Filtered,
    estimate: Filtered | None,
    closure: Closure,
    shown: list[int],
    solver: str,
) -> None:
    _draw_pairs(ax, deviations(exact), deviations(estimate) if estimate else None, closure, shown)
    ax.plot([], [], color="0.3", linestyle="-", label="exact")
    if estimate:
        ax.plot([], [], color="0.3", linestyle="--", label=wrapped(solver))
    in_view = np.r_[False, _in_view(problem)[:, closure.landmark], False]
    starts, ends = (np.flatnonzero(np.diff(in_view.astype(int)) == sign) for sign in (1, -1))
    for start, end in zip(starts, ends, strict=True):
        ax.axvspan(start - 0.5, end - 0.5, color="0.9", zorder=0, label=f"$m_{{{closure.landmark + 1}}}$ in view")
    _from_zero(ax)
    ax.set_ylabel("standard deviation [m]")
    ax.set_title(_share(shown, closure, "landmarks over time"), fontsize="medium")


def _draw_correlations(
    ax: Axes, exact: Filtered, estimate: Filtered | None, closure: Closure, shown: list[int]
) -> None:
    known = deviations(exact) * NO_SPREAD
    values = correlations(exact, closure.landmark, known)
    estimated = correlations(estimate, closure.landmark, known) if estimate else None
    others = [i for i in shown if i != closure.landmark]
    _draw_pairs(ax, values, estimated, closure, shown, others)
    everything = values if estimated is None else np.concatenate([values, estimated])
    drawn = everything[:, others][~np.isnan(everything[:, others])]
    ax.set_ylim(-1.05 if (drawn < -0.05).any() else -0.1, 1.05)
    ax.set_ylabel(f"correlation with $m_{{{closure.landmark + 1}}}$ [-]")
    if not others:
        say(ax, "there is no other landmark")
    elif estimated is not None and np.isnan(estimated[:, others]).any():
        ax.set_title("correlations over time; none where a cloud has no spread", fontsize="medium")
    else:
        ax.set_title(_share(shown, closure, "correlations over time"), fontsize="medium")


def _draw_pairs(
    ax: Axes, exact: Array, estimate: Array | None, closure: Closure, order: list[int], shown: list[int] | None = None
) -> None:
    """Draw exact and estimated columns over time, each landmark in its own look, and a line where the loop closes."""
    every = max(1, len(exact) // 8)
    for place, i in enumerate(order):
        if shown is None or i in shown:
            style = look(place)
            marks: dict[str, Any] = {
                "marker": style.marker,
                "markersize": 4,
                "markevery": (place * every // len(order), every),
            }
            again = ", seen again" if i == closure.landmark else ""
            width = 2.2 if again else 1.2
            label = f"$m_{{{i + 1}}}${again}"
            ax.plot(exact[:, i], color=style.color, linestyle="-", linewidth=width, label=label, **marks)
            if estimate is not None:
                ax.plot(estimate[:, i], color=style.color, linestyle="--", linewidth=width, fillstyle="none", **marks)
    ax.axvline(closure.k, color="0.4", linestyle=":", linewidth=1.2)
    ax.grid(visible=True, linewidth=0.3)
    ax.set_xlim(-0.5, len(exact) - 0.5)
    instants_axis(ax)


def _draw_change(ax: Axes, exact: Filtered, estimate: Filtered | None, closure: Closure) -> None:
    """Draw for each landmark its deviation before and after, hollow and full, exact to the left of the estimate."""
    n_landmarks = len(closure.sharpening)
    compared = list(range(min(n_landmarks, MOST_COMPARED)))
    if closure.landmark >= MOST_COMPARED:
        compared = [*range(MOST_COMPARED - 1), closure.landmark]
    positions = np.arange(len(compared))
    series = [(exact, -0.15, EXACT, "-", "o", "exact")]
    if estimate:
        series.append((estimate, 0.15, ESTIMATE, "--", "s", "estimate"))
    for filtered, shift, color, linestyle, marker, name in series:
        before, after = deviations(filtered)[closure.k - 1 : closure.k + 1, compared]
        ax.vlines(positions + shift, after, before, color=color, linestyle=linestyle, linewidth=1)
        points: dict[str, Any] = {"color": color, "linestyle": "none", "marker": marker, "markersize": 7}
        ax.plot(positions + shift, before, fillstyle="none", label=f"{name}, $k = {closure.k - 1}$", **points)
        ax.plot(positions + shift, after, label=f"{name}, $k = {closure.k}$", **points)
    for position, i in zip(positions, compared, strict=True):
        if closure.in_view[i]:
            hatch = "" if i == closure.landmark else "///"
            label = "seen again" if i == closure.landmark else f"also in view at $k = {closure.k}$"
            span = ax.axvspan(position - 0.45, position + 0.45, zorder=0, label=label)
            span.set(facecolor="0.85" if i == closure.landmark else "white", edgecolor="0.85", hatch=hatch)
    ax.set_xticks(positions, [f"$m_{{{i + 1}}}$" for i in compared])
    ax.set_xlim(-0.6, len(compared) - 0.4)
    _from_zero(ax)
    ax.set_xlabel("landmark [-]")
    ax.set_ylabel("standard deviation [m]")
    share = f", {len(compared)} of {n_landmarks} landmarks" if len(compared) < n_landmarks else ""
    ax.set_title(f"before and after the landmark is seen again{share}", fontsize="medium")
    ax.grid(visible=True, axis="y", linewidth=0.3)


def _from_zero(ax: Axes) -> None:
    """Let deviations begin at zero, with room for the marks of a cloud that has none."""
    ax.set_ylim(-0.04 * ax.dataLim.y1, 1.08 * ax.dataLim.y1)


def _share(shown: list[int], closure: Closure, what: str) -> str:
    all_of_them = len(closure.sharpening)
    return what if len(shown) == all_of_them else f"{what}: {len(shown)} of {all_of_them}, sharpened most"
