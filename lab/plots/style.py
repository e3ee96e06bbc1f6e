"""One look for all pictures, readable in grey and by colour-blind people: every colour has its own line and marker.

The exact filter is always black and solid, the truth always a thin dotted line or a cross; estimates take the colours
of Okabe and Ito in an order whose greys differ.  Axes name their unit in brackets, [-] where there is none.
"""

import re
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backend_bases import FigureCanvasBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from lab.comparison import Comparison, Record
from lab.validation import Array

EXACT = "black"
TRUTH = "#7a7a7a"
ESTIMATE = "#D55E00"

RESOLUTION = 120  # dots per inch
PACKING = {"compress_level": 1}  # half the time of the usual 6, for a tenth more bytes, a third with few lines
HALO = [withStroke(linewidth=3, foreground="white")]  # readable on top of other marks
HATCHES = (
    "",
    "///",
    "...",
    "\\\\\\",
    "xxx",
    "---",
    "ooo",
    "+++",
    "|||",
)  # of boxes, which have neither line nor marker


class Look(NamedTuple):
    """How one series is drawn."""

    color: str
    linestyle: str
    marker: str

    def line(self) -> dict[str, Any]:
        """Return the keywords for a plain line."""
        return {"color": self.color, "linestyle": self.linestyle}


LOOKS = (
    Look("#0072B2", "-", "o"),
    Look("#D55E00", "--", "s"),
    Look("#009E73", "-.", "^"),
    Look("#E69F00", ":", "D"),
    Look("#882255", (0, (5, 1, 1, 1, 1, 1)), "v"),  # type: ignore[arg-type]
    Look("#56B4E9", (0, (1, 2)), "P"),  # type: ignore[arg-type]
)


def look(index: int) -> Look:
    """Return the look of the series with this index; after six, colours meet other lines and markers."""
    n = len(LOOKS)
    other = LOOKS[(index + index // n) % n]
    return Look(LOOKS[index % n].color, other.linestyle, other.marker)


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure [inches] that belongs to nobody's global state."""
    return Figure(figsize=(width, height), layout="constrained")


def save_png(figure: Figure, path: Path | IO[bytes], description: str, resolution: int = RESOLUTION) -> None:
    """Write a figure as PNG, to a path or an open file, with a description inside for those who cannot see it."""
    engine, dpi = figure.get_layout_engine(), figure.dpi
    if type(figure.canvas) is FigureCanvasBase:  # nobody's: the one that draws measures the words, too, and keeps that
        FigureCanvasAgg(figure)
    with rc_context({"figure.autolayout": False, "figure.constrained_layout.use": False}):  # where None means none
        try:
            if engine is not None and figure.axes:  # laid out here: savefig would draw all once more to lay it out
                figure.set_dpi(resolution)
                engine.execute(figure)
                figure.set_layout_engine(None)
            about: dict[str, Any] = {"metadata": {"Description": description}, "pil_kwargs": PACKING}
            figure.savefig(path, format="png", dpi=resolution, **about)
        finally:
            figure.set_dpi(dpi)
            figure.set_layout_engine(engine)


def png_description(data: bytes) -> str:
    """Return the description that `save_png` put into a PNG; empty where there is none.

    A PNG is an 8-byte signature and chunks of length, type, content and checksum; plain text stands in tEXt chunks.
    """
    place = 8
    while place + 8 <= len(data):
        length, kind = int.from_bytes(data[place : place + 4], "big"), data[place + 4 : place + 8]
        key, _, text = data[place + 8 : place + 8 + length].partition(b"\0")
        if kind == b"tEXt" and key == b"Description":
            return text.decode("latin-1")
        place += length + 12
    return ""


def component_names(n: int) -> list[str]:
    """Return what to write on the axis of each of the n state components, units included."""
    landmarks = [f"$m_{{{i},{axis}}}$ [m]" for i in range(1, n // 2) for axis in "xy"]
    return ["$r_x$ [m]", "$r_y$ [m]", *landmarks]


def wrapped(label: str, width: int = 32) -> str:
    """Return what a person typed, folded for a legend or a title and safe from matplotlib's reading of $ and _."""
    lines = re.findall(rf".{{1,{width}}}(?:(?<=[:\s-])|$)|.{{1,{width}}}", label.replace("$", r"\$"))
    folded = "\n".join(lines)
    return f" {folded}" if folded.startswith("_") else folded  # a legend leaves out what begins with _


def legend_below(figure: Figure, *axes: Axes) -> Legend:
    """Put one legend of all that the axes label under the figure, in as many columns as fit.

    Artists of the same axes that share a label, such as a mean and its band, share a line of the legend.
    """
    entries: dict[str, tuple[Artist, ...]] = {}
    for ax in axes:
        own: dict[str, tuple[Artist, ...]] = {}
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            own[label] = (*own.get(label, ()), handle)
        entries = own | entries
    longest = max((len(line) for label in entries for line in label.splitlines()), default=1)
    columns = max(1, int(13.5 * figure.get_figwidth() / (longest + 7)))  # characters an inch, and for the sample
    rows = -(-len(entries) // columns)
    handles: Any = list(entries.values())  # a tuple of artists is drawn as one sample, which the stubs do not know
    return figure.legend(handles, list(entries), loc="outside lower center", ncols=-(-len(entries) // max(rows, 1)))


def plain_log_ticks(axis: Axis) -> None:
    """Label a logarithmic axis with plain numbers, as in the tables: 1, 2, 5, 10... or decades when it is long."""
    low, high = axis.get_view_interval()
    long = high >= 1000 * low
    axis.set_major_locator(LogLocator(subs=(1.0,) if long else (1.0, 2.0, 5.0)))
    if long:  # eight ticks a decade would be many, and each takes a millisecond
        axis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def instants_axis(ax: Axes, *, label: bool = True) -> None:
    """Count the instants along x, in whole numbers."""
    ax.xaxis.set_major_locator(MaxNLocator(6, integer=True, steps=[1, 2, 5, 10]))
    if label:
        ax.set_xlabel("instant $k$ [-]")


def free_spot(ax: Axes, points: Array, i: int, n_characters: int, boxes: list[Array]) -> tuple[float, float] | None:
    """Find room beside a point for a few small characters, off the other points and the words already there.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        With its limits set.
    points : (P, 2) array
        All that is marked, in data coordinates.
    i : int
        Which of them is to be named.
    n_characters : int
    boxes : list of (2, 2) array
        Words already there, corners in typographic points; the new ones are added.

    Returns
    -------
    (float, float) or None
        Where the middle of the words belongs, typographic points from point i; None where there is no room.
    """
    figure = ax.get_figure(root=True)
    scale = 72 / (figure.dpi if figure else 72)
    spots = ax.transData.transform(points) * scale
    limits = ax.get_window_extent().get_points() * scale
    half = np.array([2.5 * n_characters + 1, 5])  # of 8-point characters
    for x, y in ((1, 1), (1, 0), (0, 1), (-1, -1), (0, -1), (1, -1), (-1, 1), (-1, 0)):
        offset = (half + 5) * [x, y] if x * y == 0 else (half + 1) * [x, y]
        box = np.array([spots[i] + offset - half, spots[i] + offset + half])
        others = [*boxes, *(np.array([spot - 3, spot + 3]) for spot in np.delete(spots, i, axis=0))]
        inside = (box[0] >= limits[0]).all() and (box[1] <= limits[1]).all()
        if inside and not any((box[0] < other[1]).all() and (box[1] > other[0]).all() for other in others):
            boxes.append(box)
            return float(offset[0]), float(offset[1])
    return None


def say(ax: Axes, words: str) -> None:
    """Write in the middle of empty axes why they are empty."""
    ax.text(0.5, 0.5, words, transform=ax.transAxes, ha="center", va="center", color="0.4")


def runs_in_words(comparison: Comparison) -> str:
    """Say how many runs stand behind a figure: "one run", "20 runs", "20 runs on each of 5 data sets"."""
    runs = 1 + max(record.unit.run for record in comparison.records)
    several = len(comparison.problems)
    words = "one run" if runs == 1 else f"{runs} runs"
    return f"{words} on each of {several} data sets" if several > 1 else words


def record_in_words(comparison: Comparison, record: Record) -> str:
    """Name the run that a figure shows: "sir (N = 1000, run 0)", and its data set where there are several."""
    unit = record.unit
    where = f" of data set {unit.data_set}" if len(comparison.problems) > 1 else ""
    return f"{unit.solver} (N = {unit.n_particles}, run {unit.run}{where})"


def thinned(values: list[int], most: int) -> list[int]:
    """Return at most this many of the values, the first and the last among them."""
    if len(values) <= most:
        return values
    return [values[i] for i in np.linspace(0, len(values) - 1, most).round().astype(int)]
