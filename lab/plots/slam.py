"""Pictures of the EKF-SLAM demo: the map with the guide's colours, the strip of NEES below it, and Monte-Carlo runs.

Question answered: where are robot and landmarks, where does the filter think they are, and is it too sure?
Colours of the guide: true landmarks red +, true robot red triangle; estimates blue with 3-sigma ellipses, the robot's
magenta and the landmarks' green, of 16 segments.  The curves of filters take the looks of `style`.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import FFMpegWriter, FuncAnimation
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from lab.ekfslam.consistency import POSE, Consistency
from lab.ekfslam.demo import Frame, Run
from lab.ekfslam.uncertainty import cov2elli
from lab.gaussian import chi2_band
from lab.plots.style import instants_axis, legend_below, look
from lab.validation import Array, InputError

SIGMAS = 3
REACH = 6.0  # metres: the demo's axes
SHAPE = 0.25 * np.array([[1.4, 0.0], [-0.8, 0.6], [-0.8, -0.6], [1.4, 0.0]])  # the triangle, ahead to the right
BAND = "0.85"
FILM_SIZE = (7, 9.6)  # inches


def triangle(r: Array) -> Array:
    """Return the outline (4, 2) of a robot at pose r (3,)."""
    c, s = np.cos(r[2]), np.sin(r[2])
    return np.asarray(SHAPE @ np.array([[c, s], [-s, c]]) + r[:2])


class Scene:
    """The map of one instant, whose artists can be moved to another.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    W : (m, 2) array or None
        True landmarks [m], where they are known.
    truth : (N, 3) array or None
        True poses.
    """

    def __init__(self, ax: Axes, W: Array | None, truth: Array | None) -> None:
        self.ax, self.truth = ax, truth
        if W is not None:
            ax.plot(*W.T, linestyle="", marker="+", color="red", markersize=11, label="true landmark")
        if truth is not None:
            (self.path,) = ax.plot([], [], color="red", linewidth=0.8, alpha=0.6)
            (self.true_robot,) = ax.plot([], [], color="red", linewidth=1.6, label="true robot")
        (self.way,) = ax.plot([], [], color="blue", linewidth=0.8, linestyle=":")
        (self.robot,) = ax.plot([], [], color="blue", linewidth=1.6, linestyle="--", label="estimated robot")
        (self.ellipse,) = ax.plot([], [], color="magenta", linewidth=1.4, label=f"robot's {SIGMAS}-sigma ellipse")
        (self.points,) = ax.plot(
            [], [], linestyle="", marker="+", color="blue", markersize=6, mew=1.6, label="estimated landmark"
        )
        (self.hypotheses,) = ax.plot([], [], linestyle="", marker=".", color="0.55", markersize=4)
        self.ellipses = LineCollection([], colors="green", linewidths=0.9, label=f"landmark's {SIGMAS}-sigma ellipse")
        ax.add_collection(self.ellipses, autolim=False)
        ax.set(xlabel="$x$ [m]", ylabel="$y$ [m]", aspect="equal")

    def show(self, k: int, r: Array, frame: Frame) -> list[Artist]:
        """Show the map at instant k; r (k + 1, 3) is the estimated way so far."""
        artists: list[Artist] = [self.way, self.robot, self.ellipse, self.hypotheses, self.points, self.ellipses]
        if self.truth is not None:
            self.path.set_data(*self.truth[: k + 1, :2].T)
            self.true_robot.set_data(*triangle(self.truth[k]).T)
            artists += [self.path, self.true_robot]
        self.way.set_data(*r[: k + 1, :2].T)
        self.robot.set_data(*triangle(frame.r).T)
        self.ellipse.set_data(*cov2elli(frame.r[:2], frame.P[:2, :2], SIGMAS).T)
        self.points.set_data(*frame.points.T)
        self.hypotheses.set_data(*frame.hypotheses.T)
        pairs = zip(frame.points, frame.covs, strict=True)
        self.ellipses.set_segments([cov2elli(point, cov, SIGMAS) for point, cov in pairs])
        return artists


def draw_strip(ax: Axes, nees: Array, runs: int = 1, *, label: str = "NEES of the pose") -> Axes:
    """Draw NEES over time above its 95 % chi-square band; infinite and missing values leave gaps.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    nees : (N,) array
        Mean over `runs` at each step.
    """
    low, high = chi2_band(POSE, runs)
    ax.axhspan(low, high, color=BAND, label=f"95 % of a correct filter: {low:.2f} to {high:.2f}")
    ax.axhline(POSE, color="0.5", linewidth=0.8)
    ax.plot(nees, color="black", linewidth=1, label=label)
    finite = nees[np.isfinite(nees)]
    ax.set(ylim=(0, 1.15 * max(high, *finite) if len(finite) else 2 * high), ylabel="NEES [-]")
    instants_axis(ax)
    ax.margins(x=0.01)
    return ax


def draw_run(figure: Figure, run: Run) -> Callable[[int], list[Artist]]:
    """Fill a figure with map and strip of a run and return the function that shows step k = 1 ... N; N is shown.

    Raises
    ------
    InputError
        The run kept no frames.
    """
    if not run.frames:
        raise InputError("A run is drawn from its frames: run it with frames=True.")
    top, bottom = figure.subplots(2, 1, height_ratios=(4, 1))
    scene = Scene(top, run.drive.W, run.drive.truth)
    if any(len(frame.hypotheses) for frame in run.frames):
        scene.hypotheses.set_label("hypothesis of a ring")
    reach = max(REACH, 1.1 * float(np.abs(run.drive.W).max(initial=0)))
    top.set(xlim=(-reach, reach), ylim=(-reach, reach))
    draw_strip(bottom, run.nees)
    cursor = bottom.axvline(0, color="black", linewidth=0.8, linestyle="--", label="now")
    legend_below(figure, top, bottom)

    def update(k: int) -> list[Artist]:
        frame = run.frames[k - 1]
        title = f"{run.filter}: step {k} of {len(run.frames)}, {len(frame.points)} landmarks"
        top.set_title(title)
        cursor.set_xdata([k, k])
        return [*scene.show(k, run.r, frame), cursor, top.title]

    update(len(run.frames))
    return update


def check_animation(path: Path) -> None:
    """Refuse a file that no animation can be saved to.

    Raises
    ------
    InputError
        Another ending than .gif or .mp4, or .mp4 without ffmpeg.
    """
    kind = path.suffix.lower()
    if kind not in (".gif", ".mp4"):
        raise InputError(f"{path}: the file of the animation ends in .gif or .mp4.")
    if kind == ".mp4" and not FFMpegWriter.isAvailable():
        raise InputError(f"{path}: an .mp4 needs the program ffmpeg, which is missing here; save a .gif instead.")


def save_animation(
    run: Run, path: Path, *, interval: float = 80, on_frame: Callable[[int, int], None] = lambda done, total: None
) -> None:
    """Save the live map of a run as .gif or .mp4, by the ending of `path`; `on_frame` is told how many of how many.

    Raises
    ------
    InputError
        Another ending, or .mp4 without ffmpeg.
    """
    check_animation(path)
    figure = _Film(figsize=FILM_SIZE, dpi=80, layout="constrained")
    canvas: Any = _FilmCanvas(figure)
    update = draw_run(figure, run)
    canvas.draw()
    figure.set_layout_engine("none")  # the frames must not shift against each other
    moving = update(1)
    for artist in moving:
        artist.set_visible(False)
    canvas.draw()
    still = canvas.copy_from_bbox(figure.bbox)
    for artist in moving:
        artist.set_visible(True)

    def show(k: int) -> list[Artist]:
        canvas.restore_region(still)
        for artist in update(k):
            assert isinstance(artist.axes, Axes)
            artist.axes.draw_artist(artist)
        return moving

    animation = FuncAnimation(figure, show, frames=range(1, len(run.frames) + 1), interval=interval)
    writer = "pillow" if path.suffix.lower() == ".gif" else "ffmpeg"
    animation.save(path, writer=writer, progress_callback=lambda done, total: on_frame(done + 1, total))


class _Film(Figure):
    """A figure whose frames are what its canvas holds: to draw axes and legend anew for each takes far longer."""

    def savefig(self, fname: Any, **_: Any) -> None:
        """Write the canvas as it is, in the RGBA that movie writers ask for."""
        canvas: Any = self.canvas
        fname.write(bytes(canvas.buffer_rgba()))


class _FilmCanvas(FigureCanvasAgg):
    """A canvas that is drawn when it is told to, and not after each frame."""

    def draw_idle(self, *_: Any, **__: Any) -> None:
        """Do nothing."""


def draw_consistency(axes: Sequence[Axes], found: Mapping[str, Consistency], runs: int) -> None:
    """Draw NEES of the pose in the first axes and NIS per degree of freedom in the second, a line per filter."""
    left, right = axes
    low, high = chi2_band(POSE, runs)
    left.axhspan(low, high, color=BAND, label="95 % band of a correct filter")
    left.axhline(POSE, color="0.5", linewidth=0.8)
    for i, (name, each) in enumerate(found.items()):
        style = look(i)
        left.plot(each.nees, label=name, **style.line())
        right.plot(each.nis, label=name, **style.line())
    band = next(iter(found.values())).nis_band
    right.fill_between(np.arange(len(band[0])), *band, color=BAND, label="95 % band of a correct filter", linewidth=0)
    right.axhline(1, color="0.5", linewidth=0.8)
    left.set(title="NEES of the pose: needs the truth", ylabel="NEES [-]")
    left.set_ylim(0, max(1.3 * high, left.get_ylim()[1]))
    right.set(title="NIS: necessary, not sufficient", ylabel="NIS per degree of freedom [-]", ylim=(0.5, 1.5))
    for ax in axes:
        instants_axis(ax)
        ax.margins(x=0.01)
        ax.grid(visible=True, linewidth=0.3)


def draw_heading(ax: Axes, stds: Mapping[str, Array], floor: float) -> Axes:
    """Draw the heading's deviation over time, a line per filter, above what nothing measured can get it below.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    stds : mapping of str to (N,) array
        Deviations by filter [rad].
    floor : float
        The deviation when the first landmark was mapped [rad].
    """
    for i, (name, std) in enumerate(stds.items()):
        ax.plot(std, label=name, **look(i).line())
    ax.axhline(floor, color="black", linewidth=1, linestyle=(0, (1, 1)), label="when the first landmark was mapped")
    ax.set(ylabel="deviation of the heading [rad]", title="Gauge test: no filter may fall below the dotted line")
    ax.set_ylim(bottom=0)
    instants_axis(ax)
    ax.margins(x=0.01)
    ax.grid(visible=True, linewidth=0.3)
    return ax
