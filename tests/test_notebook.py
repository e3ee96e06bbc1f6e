"""The helpers of the notebooks: what they send to the front end, and how a demonstration waits for an answer."""

import base64
import io
import re
from html.parser import HTMLParser

import ipywidgets
import numpy as np
import pytest
from PIL import Image

from lab import given, notebook, plots
from lab.checks import check
from lab.notebook import demonstration, picture, save_answers, scrub
from lab.solvers import resolve
from lab.validation import InputError


class Images(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.found = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        if tag == "img":
            self.found.append(dict(attrs))


@pytest.fixture
def shown(monkeypatch):
    """What is sent to the front end."""
    sent = []
    monkeypatch.setattr(notebook, "display", lambda data, raw: sent.append(data))
    return sent


def effective_sample_size(weights):
    """A stub, as in the notebook."""
    raise NotImplementedError()


def a_figure(k=0):
    figure = plots.new_figure(2, 1)
    figure.subplots().plot([0, k])
    return figure


def test_a_picture_carries_its_description(shown):
    picture(a_figure(), 'A "line" < another')
    (data,) = shown
    (image,) = Images(data["text/html"]).found
    assert image["alt"] == 'A "line" < another' == data["text/plain"]
    png = base64.b64decode(image["src"].removeprefix("data:image/png;base64,"))
    assert Image.open(io.BytesIO(png)).size == (200, 100)


def test_a_picture_is_the_same_every_time(shown):
    for _ in range(2):
        picture(a_figure(), "A line")
    assert shown[0] == shown[1]


def test_a_slider_carries_a_still_and_draws_other_instants_when_moved(shown, monkeypatch):
    drawn, boxes = [], []

    class Box(ipywidgets.VBox):
        def __init__(self, *args, **options):
            super().__init__(*args, **options)
            boxes.append(self)

    monkeypatch.setattr(ipywidgets, "VBox", Box)

    def draw(k):
        drawn.append(k)
        return a_figure(k), f"instant {k}"

    scrub(draw, range(5), still=3)
    (data,) = shown
    assert drawn == [3]
    assert data["text/plain"] == "instant 3"
    assert Images(data["text/html"]).found[0]["alt"] == "instant 3"
    assert "application/vnd.jupyter.widget-view+json" in data

    (box,) = boxes
    assert data["application/vnd.jupyter.widget-view+json"]["model_id"] == box.model_id
    play, slider = box.children[0].children
    assert (slider.min, slider.max, slider.value, play.max) == (0, 4, 3, 4)
    slider.value = 1
    assert drawn == [3, 1]
    assert Images(box.children[1].value).found[0]["alt"] == "instant 1"
    slider.value = 3
    assert drawn == [3, 1]
    with pytest.raises(InputError, match="still"):
        scrub(draw, range(5), still=7)


def test_a_slider_keeps_what_its_cell_had_when_later_cells_use_the_same_names(shown, monkeypatch):
    frames = []
    monkeypatch.setattr(notebook, "_slider", lambda frame, instants, still: frames.append(frame) or {})
    cell = {"figure": a_figure(), "P": 400, "scrub": scrub}
    exec(
        "def draw(k, *, end='.'):\n    return figure, f'{P} particles, k = {k}{end}'\nscrub(draw, range(3), still=0)",
        cell,
    )
    cell["P"] = "another cell's"
    assert frames[0](2)["text/plain"] == "400 particles, k = 2."


def test_a_still_is_shown_where_widgets_are_missing(shown, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "ipywidgets", None)
    scrub(lambda k: (a_figure(k), "still"), range(2), still=0)
    assert set(shown[0]) == {"text/html", "text/plain"}


def test_a_demonstration_of_a_stub_says_which_question_and_shows_what_to_expect(shown, capsys, tmp_path, monkeypatch):
    (tmp_path / "expected").mkdir()
    plots.style.save_png(a_figure(), tmp_path / "expected" / "q5.png", "Curves that fall")
    monkeypatch.chdir(tmp_path)
    with demonstration("q5"):
        effective_sample_size(None)
        raise AssertionError("not reached")
    out = capsys.readouterr().out
    assert out.startswith("Q5 not answered yet. Write `effective_sample_size` in its cell above")
    assert "kind of picture to expect" in out
    assert Images(shown[0]["text/html"]).found[0]["alt"] == "Expected: Curves that fall"


def test_the_innermost_stub_is_named_and_without_a_picture_there_is_none(shown, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def sir():
        effective_sample_size(None)

    with demonstration("nothing-of-this-name"):
        sir()
    assert capsys.readouterr().out.startswith("Q5 not answered yet. Write `effective_sample_size`")
    with demonstration("q8-nothing"):
        raise NotImplementedError
    assert capsys.readouterr().out == "Q8 not answered yet.\n"
    assert shown == []


def test_a_mistake_in_an_answer_is_to_be_seen():
    with pytest.raises(ZeroDivisionError), demonstration("q5"):
        _ = 1 / 0


def test_what_is_given_works_and_is_no_answer():
    assert given.effective_sample_size(np.full(4, 0.25)) == pytest.approx(4)
    assert not check("q5", given.effective_sample_size).passed
    with pytest.raises(ImportError):
        from lab.given import eval  # noqa: F401
    with pytest.raises(AttributeError, match="no question asks"):
        _ = given.eval


def test_saved_answers_are_a_solver(tmp_path):
    path = tmp_path / "my_filters.py"
    save_answers(path, [helper, my_filter], imports="from lab.solvers import sir")
    label, solver = resolve(f"mine={path}:my_filter")
    assert label == "mine"
    assert solver.load().__name__ == "my_filter"
    assert re.search(r"def helper.*\n\n\ndef my_filter", path.read_text(encoding="utf-8"), re.DOTALL)


def helper():
    return 3


def my_filter(problem, rng, *, n_particles):
    return helper()
