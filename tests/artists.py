"""What the artists of a figure say, and solvers that leave little to draw."""

import re

import numpy as np

from lab.solvers import kalman


def failing(problem, rng, *, n_particles):
    raise ValueError


def bare(problem, rng, *, n_particles):
    """Answer exactly, and without ESS or ancestors."""
    return kalman(problem)


def drawn(figure):
    figure.draw_without_rendering()
    return figure


def labels(figure):
    """Return the texts of the figure's legend."""
    (legend,) = figure.legends
    return [text.get_text() for text in legend.get_texts()]


def assert_labelled_with_units(axes):
    """Every axis says what it is, with a unit in brackets; inner axes of a grid leave it to the outer ones."""
    for ax in axes:
        geometry = ax.get_subplotspec()
        if ax.xaxis.get_tick_params()["labelbottom"]:
            assert re.search(r"\[.+\]$", ax.get_xlabel()), ax.get_xlabel()
        if geometry.is_first_col():
            assert re.search(r"\[.+\]$", ax.get_ylabel()), ax.get_ylabel()


def assert_inside(figure):
    """Nothing that is written is cut off or lies over another text."""
    drawn(figure)
    texts = [ax.title for ax in figure.axes] + [ax.xaxis.label for ax in figure.axes]
    texts += [ax.yaxis.label for ax in figure.axes] + [*figure.texts]
    boxes = [text.get_window_extent() for text in texts if text.get_text()]
    boxes += [legend.get_window_extent() for legend in figure.legends]
    width, height = figure.get_size_inches() * figure.dpi
    for i, box in enumerate(boxes):
        assert box.x0 >= 0
        assert box.y0 >= 0
        assert box.x1 <= width
        assert box.y1 <= height
        assert not any(box.overlaps(other) for other in boxes[:i])


def band_edges(band):
    (path,) = band.get_paths()
    at = [path.vertices[path.vertices[:, 0] == x, 1] for x in np.unique(path.vertices[:, 0])]
    return np.array([[y.min(), y.max()] for y in at])
