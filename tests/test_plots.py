"""Ellipses and corridors by the geometry of their artists."""

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from scipy.stats import chi2
from worlds import covariance

from lab.plots import corridor, ellipse
from lab.validation import InputError

MEAN = np.array([1.5, -2.0])
FULL = [
    np.array([[2.0, 0.9], [0.9, 0.5]]),
    np.array([[0.3, -0.5], [-0.5, 1.0]]),
    np.array([[1e-4, 0.0], [0.0, 25.0]]),
    *(covariance(np.random.default_rng(seed), 2, 0.7) for seed in range(4)),
]


@pytest.fixture
def ax():
    return Figure().subplots()


def boundary(patch):
    """Return points (n, 2) on the drawn edge, in data coordinates."""
    path = patch.get_path().transformed(patch.get_patch_transform())
    return np.concatenate([bezier(np.linspace(0, 1, 7)) for bezier, _ in path.iter_bezier()])


@pytest.mark.parametrize("cov", FULL)
@pytest.mark.parametrize("probability", [0.5, 0.99, 0.999])
def test_axes_and_angle_are_those_of_the_eigenvectors(ax, cov, probability):
    patch = ellipse(ax, MEAN, cov, color="black", probability=probability)
    variances, axes = np.linalg.eigh(cov)
    radius = np.sqrt(-2 * np.log(1 - probability))  # chi-square with 2 degrees of freedom has a closed form
    assert sorted((patch.width, patch.height)) == pytest.approx(2 * radius * np.sqrt(variances))
    assert patch.center == pytest.approx(MEAN)
    major = axes[:, 1]
    turned = np.radians(patch.angle + (0 if patch.width >= patch.height else 90))
    assert abs(major @ [np.cos(turned), np.sin(turned)]) == pytest.approx(1)


@pytest.mark.parametrize("cov", FULL)
def test_its_edge_is_a_level_of_the_density(ax, cov):
    points = boundary(ellipse(ax, MEAN, cov, color="black", probability=0.9)) - MEAN
    levels = np.sum(points * np.linalg.solve(cov, points.T).T, axis=1)
    assert len(levels) > 50
    np.testing.assert_allclose(levels, chi2.ppf(0.9, 2), rtol=2e-3)  # the curves of a circle are cubic


@pytest.mark.parametrize("probability", [0.1, 0.5, 0.9, 0.99])
def test_it_holds_the_probability_that_it_says(ax, probability):
    """The share of draws inside, within 4 standard errors: once in 16 000 a correct ellipse would fail."""
    rng, n = np.random.default_rng(5), 50_000
    patch = ellipse(ax, MEAN, FULL[0], color="black", probability=probability)
    draws = rng.multivariate_normal(MEAN, FULL[0], n)
    on_the_unit_circle = patch.get_patch_transform().inverted().transform(draws)
    inside = np.mean(np.linalg.norm(on_the_unit_circle, axis=1) <= 1)
    assert abs(inside - probability) <= 4 * np.sqrt(probability * (1 - probability) / n)


def test_the_default_is_99_percent_and_not_three_deviations(ax):
    patch = ellipse(ax, MEAN, np.eye(2), color="black")
    assert patch.width / 2 == pytest.approx(3.0349, abs=1e-4)


@pytest.mark.parametrize("noise", [0, 1e-17, -1e-17])
def test_a_circle_that_is_symmetric_to_rounding_only(ax, noise):
    """For eig such blocks have oblique or complex axes."""
    cov = np.array([[0.2, 1e-17], [noise, 0.2]])
    patch = ellipse(ax, MEAN, cov, color="black")
    assert patch.width == pytest.approx(patch.height)
    distances = np.linalg.norm(boundary(patch) - MEAN, axis=1)
    np.testing.assert_allclose(distances, np.sqrt(0.2 * chi2.ppf(0.99, 2)), rtol=1e-3)


def test_of_a_singular_covariance_it_is_a_line(ax):
    direction = np.array([3.0, 4.0]) / 5
    patch = ellipse(ax, MEAN, 2 * np.outer(direction, direction), color="black")
    points = boundary(patch) - MEAN
    across = points @ [-direction[1], direction[0]]
    np.testing.assert_allclose(across, 0, atol=1e-6)
    assert np.abs(points @ direction).max() == pytest.approx(np.sqrt(2 * chi2.ppf(0.99, 2)), rel=1e-3)


def test_of_no_covariance_it_is_a_point(ax):
    patch = ellipse(ax, MEAN, np.zeros((2, 2)), color="black")
    np.testing.assert_allclose(boundary(patch), np.broadcast_to(MEAN, (len(boundary(patch)), 2)))


def test_it_is_filled_at_an_opacity_of_a_fifth_and_added_once(ax):
    patch = ellipse(ax, MEAN, FULL[0], color="tab:blue")
    assert isinstance(patch, Ellipse)
    assert [*ax.patches] == [patch]
    assert patch.get_facecolor() == to_rgba("tab:blue", 0.2)
    assert patch.get_edgecolor() == to_rgba("tab:blue", 1)
    assert patch.get_fill()


def test_the_axes_make_room_for_it(ax):
    points = boundary(ellipse(ax, [50.0, 80.0], FULL[1], color="black"))
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    assert left <= points[:, 0].min() < points[:, 0].max() <= right
    assert low <= points[:, 1].min() < points[:, 1].max() <= high


@pytest.mark.parametrize(
    ("mean", "cov", "probability", "message"),
    [
        ([0, 0, 0], np.eye(2), 0.99, r"mean must have shape \(2,\), not \(3,\)"),
        ([0, np.nan], np.eye(2), 0.99, "mean must be finite"),
        ([0, 0], np.eye(3), 0.99, r"cov must have shape \(2, 2\), not \(3, 3\)"),
        ([0, 0], [1, 1], 0.99, r"cov must have shape \(2, 2\), not \(2,\)"),
        ([0, 0], [[1, 0], [0, np.inf]], 0.99, "cov must be finite"),
        ([0, 0], [[1, 1j], [1j, 1]], 0.99, "cov must hold real numbers"),
        ([0, 0], [[1, 0.5], [0, 1]], 0.99, "cov is not symmetric"),
        ([0, 0], [[1, 2], [2, 1]], 0.99, "cov is not positive semidefinite"),
        ([0, 0], [[-1, 0], [0, 1]], 0.99, "cov is not positive semidefinite"),
        ([0, 0], np.eye(2), 0, "strictly between 0 and 1, not 0"),
        ([0, 0], np.eye(2), 1, "strictly between 0 and 1, not 1"),
        ([0, 0], np.eye(2), 99, "strictly between 0 and 1, not 99"),
        ([0, 0], np.eye(2), np.nan, "strictly between 0 and 1, not nan"),
    ],
)
def test_what_is_no_gaussian_is_refused_and_not_drawn(ax, mean, cov, probability, message):
    with pytest.raises(InputError, match=message):
        ellipse(ax, mean, cov, color="black", probability=probability)
    assert not ax.patches


def edges(band):
    """Return lower and upper edge of a band at its abscissae."""
    (path,) = band.get_paths()
    vertices = path.vertices
    instants = np.unique(vertices[:, 0])
    at = [vertices[vertices[:, 0] == x, 1] for x in instants]
    return instants, np.array([y.min() for y in at]), np.array([y.max() for y in at])


@pytest.mark.parametrize(("more", "n_sigma"), [({}, 3), ({"n_sigma": 1.5}, 1.5)])
def test_a_corridor_is_the_mean_and_its_deviations(ax, more, n_sigma):
    rng = np.random.default_rng(0)
    instants, mean, std = np.arange(8) * 0.5, rng.standard_normal(8), rng.uniform(0.1, 2, 8)
    line, band = corridor(ax, instants, mean, std, color="tab:red", linestyle="--", label="mine", **more)
    np.testing.assert_array_equal(line.get_xydata(), np.column_stack([instants, mean]))
    x, low, high = edges(band)
    np.testing.assert_array_equal(x, instants)
    np.testing.assert_allclose(low, mean - n_sigma * std)
    np.testing.assert_allclose(high, mean + n_sigma * std)
    assert [*ax.lines] == [line]
    assert [*ax.collections] == [band]
    assert ax.get_legend_handles_labels() == ([line], ["mine"])
    assert line.get_linestyle() == "--"
    assert band.get_facecolor()[0] == pytest.approx(to_rgba("tab:red", 0.15))


def test_a_corridor_of_no_width_is_its_mean(ax):
    _, band = corridor(ax, np.arange(3.0), np.ones(3), np.zeros(3), color="black")
    _, low, high = edges(band)
    np.testing.assert_array_equal(low, high)
