"""What the cells of the course's notebooks call: pictures with words, sliders, demonstrations that wait for an answer.

Question answered: how does a result reach the reader, whatever shows the notebook?  JupyterLab and nbconvert give an
image output no alternative text, so a picture is a small piece of HTML whose ``alt`` says what is on it; a slider
carries such a picture as a still, for whoever cannot run it.  A demonstration whose answer is still a stub says which
question is meant and shows the kind of picture to expect, from ``expected/`` beside the notebook.
"""

import base64
import html
import inspect
import io
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FunctionType, TracebackType
from typing import Any

from IPython.display import display

import lab
from lab.checks import QUESTIONS
from lab.plots.style import png_description, save_png
from lab.validation import InputError

RESOLUTION = 100  # dots per inch: crisp enough, and small in the file
EXPECTED = "expected"
FOLDERS = ("notebooks", "solutions")
PLAY = 400  # milliseconds a frame

Draw = Callable[[int], tuple[Any, str]]


def picture(figure: Any, alt: str) -> None:
    """Show a figure with its description.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    alt : str
        What is on it, in a sentence or two, for those who cannot see it.
    """
    _show(_bundle(_png(figure, alt), alt))


def scrub(draw: Draw, instants: Sequence[int], *, still: int) -> None:
    """Show one picture per instant behind a slider, and a still of one of them where no slider can be run.

    Parameters
    ----------
    draw : function of int
        Instant -> figure and its description.
    instants : sequence of int
        Consecutive.
    still : int
        The instant shown first.

    Raises
    ------
    InputError
        `still` is not among the instants.
    """
    if still not in instants:
        raise InputError(f"still must be one of the instants, not {still}.")
    frames: dict[int, dict[str, str]] = {}
    drawing = _as_of_now(draw)

    def frame(k: int) -> dict[str, str]:
        if k not in frames:
            figure, alt = drawing(k)
            frames[k] = _bundle(_png(figure, alt), alt)
        return frames[k]

    _show({**_slider(frame, instants, still), **frame(still)})


def save_answers(path: str | Path, functions: Sequence[Callable[..., Any]], *, imports: str) -> None:
    """Write functions of this notebook to a file, for ``slam-lab compare --solvers mine=FILE.py:NAME``.

    Parameters
    ----------
    path : str or Path
        Of the file, which is replaced.
    functions : sequence of function
        Every one that the filter needs, in any order.
    imports : str
        What stands at the head of the file.
    """
    parts = [imports.rstrip(), *(inspect.getsource(function).rstrip() for function in functions)]
    Path(path).write_text("\n\n\n".join(parts) + "\n", encoding="utf-8")


class demonstration:
    """Run a block that uses answers; while one of them is a stub, say so and show the kind of picture to expect.

    Parameters
    ----------
    key : str
        Name of the expected picture: that of the question, mostly.

    Raises
    ------
    Exception
        Whatever an answer raises but NotImplementedError: a mistake is to be seen.
    """

    def __init__(self, key: str) -> None:
        self.key = key

    def __enter__(self) -> None:
        """Begin the block."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        """End the block, and the error with it where an answer is a stub."""
        if not isinstance(error, NotImplementedError):
            return False
        label, function = _unanswered(trace, self.key)
        where = f"Write `{function}` in its cell above, run that cell, and then this one again." if function else ""
        print(f"{label} not answered yet. {where}".rstrip())
        file = _expected(self.key)
        if file is not None:
            data = file.read_bytes()
            print("The kind of picture to expect:")
            _show(_bundle(data, f"Expected: {png_description(data)}"))
        return True


def _unanswered(trace: TracebackType | None, key: str) -> tuple[str, str]:
    """Return the question's label and the function that is a stub: the innermost that bears a question's name."""
    names = []
    while trace is not None:
        names.append(trace.tb_frame.f_code.co_name)
        trace = trace.tb_next
    for name in reversed(names):
        for question in QUESTIONS:
            if question.function == name:
                return _label(question.key), name
    return _label(key), ""


def _label(key: str) -> str:
    """Return "Q1d" for "q1d-step"."""
    return key.partition("-")[0].capitalize()


def _expected(key: str) -> Path | None:
    """Return the picture's file: beside the notebook, in the current folder's course, or in this package's."""
    roots = (Path.cwd(), *(root / folder for root in (Path.cwd(), Path(lab.__file__).parents[1]) for folder in FOLDERS))
    files = (root / EXPECTED / f"{key}.png" for root in roots)
    return next((file for file in files if file.is_file()), None)


def _as_of_now(draw: Draw) -> Draw:
    """Return the function with the global variables as they are now: a later cell may use the same names."""
    if not isinstance(draw, FunctionType):
        return draw
    frozen = FunctionType(draw.__code__, dict(draw.__globals__), draw.__name__, draw.__defaults__, draw.__closure__)
    frozen.__kwdefaults__ = draw.__kwdefaults__
    return frozen


def _show(data: dict[str, Any]) -> None:
    display(data, raw=True)  # type: ignore[no-untyped-call]


def _png(figure: Any, alt: str) -> bytes:
    file = io.BytesIO()
    save_png(figure, file, alt, RESOLUTION)
    return file.getvalue()


def _bundle(png: bytes, alt: str) -> dict[str, str]:
    return {"text/html": _image(png, alt), "text/plain": alt}


def _image(png: bytes, alt: str) -> str:
    source = f"data:image/png;base64,{base64.b64encode(png).decode()}"
    return f'<img alt="{html.escape(alt)}" src="{source}" style="max-width: 100%; background: white">'


def _slider(frame: Callable[[int], dict[str, str]], instants: Sequence[int], still: int) -> dict[str, Any]:
    """Return the display data of the slider; none where ipywidgets cannot be used."""
    try:
        import ipywidgets
    except ImportError:
        return {}
    limits = {"min": instants[0], "max": instants[-1], "value": still}
    slider = ipywidgets.IntSlider(description="instant k", **limits)
    play = ipywidgets.Play(interval=PLAY, **limits)
    image = ipywidgets.HTML(frame(still)["text/html"])
    ipywidgets.jslink((play, "value"), (slider, "value"))
    slider.observe(lambda change: setattr(image, "value", frame(change["new"])["text/html"]), "value")
    shown = ipywidgets.VBox([ipywidgets.HBox([play, slider]), image])
    data = shown._repr_mimebundle_(include=None, exclude=None) or {}
    return {name: value for name, value in data.items() if name != "text/plain"}
