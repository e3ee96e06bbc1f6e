"""Pictures of replayed drives, by the geometry of their artists."""

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.stats import chi2

from lab.ekfslam.alignment import align, apply
from lab.plots.drives import HONEST, Chart, Way, draw_charts, draw_nees, draw_nis


@pytest.fixture
def ax():
    return Figure().subplots()


def way(n=200, seed=0, label="robot"):
    rng = np.random.default_rng(seed)
    truth = np.cumsum(rng.normal(size=(n, 3)), axis=0)
    poses = np.column_stack([apply(0.4, np.array([2.0, -1.0]), truth[:, :2]), truth[:, 2]])
    return Way(label, poses, truth, rng.chisquare(3, n), 2 * rng.chisquare(2, n) / 2, np.full(n, 2.0))


def chart(*ways):
    points = np.array([[1.0, 2.0], [3.0, 4.0]])
    covs = np.array([np.diag([0.04, 0.01]), np.diag([0.09, 0.25])])
    motion = align(ways[0].poses[:, :2], ways[0].truth[:, :2])
    return Chart(ways, points, covs, apply(*motion, points), motion)


def lines(ax):
    return {line.get_label(): line.get_xydata() for line in ax.lines}


def test_a_map_as_it_is(ax):
    one = chart(way())
    draw_charts(ax, [one])
    drawn = lines(ax)
    np.testing.assert_allclose(drawn["true way"], one.ways[0].truth[:, :2])
    np.testing.assert_allclose(drawn["estimated way of robot"], one.ways[0].poses[:, :2])
    np.testing.assert_allclose(drawn["estimated landmark"], one.points)
    np.testing.assert_allclose(drawn["true landmark"], one.true_points)
    (ellipses,) = ax.collections
    for ring, point, cov in zip(ellipses.get_segments(), one.points, one.covs, strict=True):
        np.testing.assert_allclose(np.einsum("ni,ij,nj->n", ring - point, np.linalg.inv(cov), ring - point), 9)
    assert ax.get_xlabel() == "$x$ [m]"


def test_an_aligned_map_lies_on_the_truth_with_its_ellipses_turned(ax):
    one = chart(way())
    draw_charts(ax, [one], aligned=True)
    drawn = lines(ax)
    np.testing.assert_allclose(drawn["estimated way of robot"], drawn["true way"], atol=1e-9)
    np.testing.assert_allclose(drawn["estimated landmark"], drawn["true landmark"], atol=1e-9)
    (ellipses,) = ax.collections
    inverse = (-one.motion[0], np.zeros(2))
    for ring, point, cov in zip(ellipses.get_segments(), drawn["estimated landmark"], one.covs, strict=True):
        back = apply(*inverse, ring - point)
        np.testing.assert_allclose(np.einsum("ni,ij,nj->n", back, np.linalg.inv(cov), back), 9)


def test_without_truth_nothing_true_is_drawn(ax):
    bare = way()
    bare = Way("robot", bare.poses, np.full_like(bare.truth, np.nan), bare.nees * np.nan, bare.nis, bare.dof)
    draw_charts(ax, [Chart([bare], np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros((0, 2)), (0.0, np.zeros(2)))])
    assert set(lines(ax)) == {"estimated way of robot"}


def test_every_robot_has_a_look_of_its_own(ax):
    draw_charts(ax, [chart(way(label="robot 1"), way(seed=1, label="robot 2")), chart(way(seed=2, label="robot 3"))])
    ways = [line for line in ax.lines if line.get_label().startswith("estimated way")]
    assert len({(line.get_color(), line.get_linestyle()) for line in ways}) == 3


def test_nees_over_the_band(ax):
    one, two = way(label="robot 1"), way(n=50, seed=1, label="robot 2")
    draw_nees(ax, [one, two])
    np.testing.assert_array_equal(lines(ax)["robot 2"][:, 1], two.nees)
    assert ax.get_yscale() == "log"
    (band,) = ax.patches
    np.testing.assert_allclose(band.get_y(), chi2.ppf(0.025, 3))
    np.testing.assert_allclose(band.get_y() + band.get_height(), chi2.ppf(0.975, 3))
    assert band.get_label() == HONEST
    ax.clear()
    low = Way("robot", one.poses, one.truth, np.append(one.nees[1:], 1e-9), one.nis, one.dof)
    assert draw_nees(ax, [low]).get_ylim()[0] == pytest.approx(1e-2)


def test_nis_is_averaged_over_stretches(ax):
    one = way(n=600)
    draw_nis(ax, [one])
    drawn = lines(ax)["robot"]
    assert len(drawn) == 60
    np.testing.assert_allclose(drawn[0, 1], one.nis[:10].sum() / 20)
    np.testing.assert_allclose(drawn[-1, 1], one.nis[-10:].sum() / 20)
    np.testing.assert_allclose(drawn[0, 0], 5)
    (band,) = ax.collections
    low, high = chi2.ppf([0.025, 0.975], 20) / 20
    edges = band.get_paths()[0].vertices[:, 1]
    np.testing.assert_allclose([edges.min(), edges.max()], [low, high])


def test_nis_of_several_robots_is_summed(ax):
    one, two = way(n=600, label="robot 1"), way(n=590, seed=1, label="robot 2")
    draw_nis(ax, [one, two])
    drawn = lines(ax)["all robots"]
    np.testing.assert_allclose(drawn[0, 1], (one.nis[:10].sum() + two.nis[:10].sum()) / 40)
    np.testing.assert_allclose(drawn[-1, 1], one.nis[-10:].sum() / 20)


def test_stretches_in_which_nothing_is_seen_are_left_out(ax):
    one = way(n=600)
    one.nis[100:300] = one.dof[100:300] = 0
    draw_nis(ax, [one])
    drawn = lines(ax)["robot"]
    assert len(drawn) == 40
    assert np.isfinite(drawn).all()


def test_nis_of_a_way_that_saw_nothing(ax):
    one = way(n=5)
    one.nis[:] = one.dof[:] = 0
    draw_nis(ax, [one])
    assert not len(lines(ax)["robot"])
