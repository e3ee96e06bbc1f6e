"""Clouds, and truth beside estimate, by the geometry of their artists; the description inside a PNG."""

import io
from pathlib import Path

import numpy as np
import pytest
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, Wedge
from PIL import Image

from data_simulation import data_simulation
from lab import plots
from lab.plots.clouds import MOST
from lab.plots.style import png_description, save_png
from lab.problem import Experiment
from lab.solvers import kalman

EXPERIMENT = Experiment.from_simulation(data_simulation(rng=0))
EXACT = kalman(EXPERIMENT.problem)


@pytest.fixture
def ax():
    return Figure().subplots()


def line(ax, label):
    (found,) = [artist for artist in ax.lines if artist.get_label() == label]
    return np.column_stack(found.get_data())


def test_a_cloud_shows_robot_and_landmarks_of_every_particle_by_weight(ax):
    particles = np.arange(18.0).reshape(6, 3)
    weights = np.array([0.2, 0.5, 0.3])
    points = plots.draw_cloud(ax, particles, weights)
    spots = {tuple(spot): area for spot, area in zip(points.get_offsets(), points.get_sizes(), strict=True)}
    assert len(spots) == 9
    for i, weight in enumerate(weights):
        for part in range(3):
            assert spots[particles[2 * part, i], particles[2 * part + 1, i]] == pytest.approx(6 * 3 * weight)


def test_of_a_large_cloud_the_heaviest_are_shown(ax):
    rng = np.random.default_rng(0)
    particles, weights = rng.standard_normal((4, 5 * MOST)), rng.dirichlet(np.ones(5 * MOST))
    shown = plots.draw_cloud(ax, particles, weights).get_offsets()[::2, 0]
    assert sorted(shown) == sorted(particles[0, np.argsort(-weights)[:MOST]])


@pytest.mark.parametrize("k", [1, 4, 12])
def test_the_truth_shows_what_is_seen(ax, k):
    plots.draw_truth(ax, EXPERIMENT, k)
    robot, landmarks = EXPERIMENT.truth[k, :2], EXPERIMENT.truth[k, 2:].reshape(-1, 2)
    vectors = EXPERIMENT.problem.z[k].reshape(-1, 2)
    seen = ~np.isnan(vectors[:, 0])
    np.testing.assert_array_equal(line(ax, "landmark seen"), landmarks[seen])
    np.testing.assert_array_equal(line(ax, "landmark not seen"), landmarks[~seen])
    np.testing.assert_array_equal(line(ax, "robot"), [robot])
    arrows = [text for text in ax.texts if text.arrow_patch is not None]
    tips = {arrow.xy for arrow in arrows}
    assert tips == {tuple(robot + vector) for vector in vectors[seen]}
    (wedge,) = [patch for patch in ax.patches if isinstance(patch, Wedge)]
    inside = [in_wedge(wedge, landmark) for landmark in landmarks]
    assert inside == list(seen)


def in_wedge(wedge, point):
    angle = np.degrees(np.arctan2(*(point - wedge.center)[::-1]))
    return (angle - wedge.theta1) % 360 <= (wedge.theta2 - wedge.theta1) % 360


def test_nothing_is_seen_at_the_start(ax):
    plots.draw_truth(ax, EXPERIMENT, 0)
    assert not [patch for patch in ax.patches if isinstance(patch, Wedge)]
    assert len(line(ax, "landmark not seen")) == 5
    assert "nothing" in ax.get_title()


def test_both_sides_have_the_same_limits_at_every_instant():
    limits = set()
    for k in (0, 9, 49):
        left, right = plots.draw_instant(Figure(), EXPERIMENT, EXACT, k)
        limits |= {(*ax.get_xlim(), *ax.get_ylim()) for ax in (left, right)}
    assert len(limits) == 1
    x0, x1, y0, y1 = limits.pop()
    spots = EXPERIMENT.truth.reshape(-1, 2)
    assert ((spots > [x0, y0]) & (spots < [x1, y1])).all()


def test_the_estimate_has_an_ellipse_for_robot_and_landmarks_and_the_exact_one_too():
    cloud = np.repeat(EXACT.means[9][:, np.newaxis], 10, axis=1), np.full(10, 0.1)
    _, right = plots.draw_instant(Figure(), EXPERIMENT, EXACT, 9, exact=EXACT, cloud=cloud, label="mine")
    centres = [patch.center for patch in right.patches if isinstance(patch, Ellipse)]
    np.testing.assert_allclose(centres, np.tile(EXACT.means[9].reshape(-1, 2), (2, 1)))
    np.testing.assert_array_equal(line(right, "mine: mean"), EXACT.means[9].reshape(-1, 2))
    assert len(right.collections[0].get_offsets()) == 60


def test_a_description_comes_back_from_its_png():
    file = io.BytesIO()
    save_png(plots.new_figure(1, 1), file, "Two lines & <one> point.")
    assert png_description(file.getvalue()) == "Two lines & <one> point."
    assert Image.open(file).text["Description"] == "Two lines & <one> point."
    plain = io.BytesIO()
    Image.new("RGB", (2, 2)).save(plain, "png")
    assert png_description(plain.getvalue()) == ""
    assert png_description(b"") == ""


@pytest.mark.parametrize("layout", ["none", "tight", "constrained"])
def test_a_png_is_what_matplotlib_would_write_and_the_figure_is_drawn_once_and_stays_as_it_was(layout, monkeypatch):
    def made():
        figure = Figure((4, 3), dpi=90, layout=layout)
        ax = figure.subplots()
        figure.colorbar(ax.imshow(np.eye(3)), ax=ax)
        ax.set(xlabel="a long label\nof two lines", title="title")
        return figure

    draws, draw = [], Figure.draw
    monkeypatch.setattr(Figure, "draw", lambda *given: (draws.append(given[0]), draw(*given))[1])
    with rc_context({"figure.constrained_layout.use": True}):  # which "none" is to leave alone
        figure = made()
        engine, plain, ours = figure.get_layout_engine(), io.BytesIO(), io.BytesIO()
        save_png(figure, ours, "words")
        assert draws == [figure]
        assert (figure.get_layout_engine(), figure.dpi) == (engine, 90)
        with pytest.raises(FileNotFoundError):
            save_png(figure, Path("nowhere") / "a.png", "words")
        assert (figure.get_layout_engine(), figure.dpi) == (engine, 90)
        made().savefig(plain, format="png", dpi=120, metadata={"Description": "words"})
    np.testing.assert_array_equal(np.asarray(Image.open(ours)), np.asarray(Image.open(plain)))
    assert png_description(ours.getvalue()) == "words"
