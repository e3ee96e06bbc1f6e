"""The figures of the command line by what their artists say: corridors, map, gap and ESS."""

from functools import partial

import matplotlib.pyplot as plt
import numpy as np
import pytest
from artists import assert_inside, assert_labelled_with_units, band_edges, bare, drawn, failing, labels
from matplotlib.colors import to_rgba
from matplotlib.patches import Ellipse
from scipy.stats import chi2
from worlds import experiment, full_scenario, problem

from lab.compare import compare
from lab.comparison import Comparison
from lab.plots import draw_corridors, draw_ess, draw_gap, draw_map, legend_below, new_figure
from lab.plots.style import ESTIMATE, EXACT, LOOKS, look, thinned, wrapped
from lab.result import Filtered
from lab.solvers import kalman, sir, sis

FORECAST = ["forecast, $N = 10$", "ESS = 2: collapsed below"]


@pytest.fixture(autouse=True)
def _no_global_state():
    yield
    assert plt.get_fignums() == []


@pytest.fixture(scope="module")
def world():
    return experiment(full_scenario(3, n_steps=12))


@pytest.fixture(scope="module")
def exact(world):
    return kalman(world.problem)


@pytest.fixture(scope="module")
def estimate(world):
    return sir(world.problem, np.random.default_rng(0), n_particles=50)


@pytest.fixture(scope="module")
def comparison(world):
    return compare(world.problem, {"sis": sis, "sir": sir}, n_particles=[30, 10, 100], runs=4)


# corridors


def test_corridors_of_every_component(world, exact, estimate):
    figure = new_figure(10, 8)
    axes = draw_corridors(figure, estimate, exact, world.truth, label="mine")
    assert len(axes) == 8
    for i, ax in enumerate(axes):
        black, coloured, truth = ax.lines
        for line, band, filtered in zip((black, coloured), ax.collections, (exact, estimate), strict=True):
            np.testing.assert_array_equal(line.get_ydata(), filtered.means[:, i])
            np.testing.assert_array_equal(line.get_xdata(), np.arange(12))
            std = np.sqrt(filtered.covs[:, i, i])
            expected = filtered.means[:, i, np.newaxis] + 3 * std[:, np.newaxis] * [-1, 1]
            np.testing.assert_allclose(band_edges(band), expected)
        np.testing.assert_array_equal(truth.get_ydata(), world.truth[:, i])
        assert (black.get_color(), coloured.get_color()) == (EXACT, ESTIMATE)
        assert len({line.get_linestyle() for line in ax.lines}) == 3  # readable in grey
    names = [ax.get_ylabel() for ax in axes]
    assert names[:4] == ["$r_x$ [m]", "$r_y$ [m]", "$m_{1,x}$ [m]", "$m_{1,y}$ [m]"]
    assert all(name.endswith("[m]") for name in names)
    assert [bool(ax.get_xlabel()) for ax in axes] == [False] * 6 + [True] * 2
    assert labels(figure) == ["exact mean, ±3 std", "mine mean, ±3 std", "truth"]
    assert "mine" in figure.get_suptitle()
    assert_inside(figure)


def test_corridors_of_the_exact_filter_alone(world, exact):
    figure = new_figure(10, 8)
    axes = draw_corridors(figure, None, exact)
    assert [len(ax.lines) for ax in axes] == [1] * 8
    assert labels(figure) == ["exact mean, ±3 std"]
    assert figure.get_suptitle() == "Corridors of the exact filter"


@pytest.mark.parametrize(("n_landmarks", "n_axes"), [(1, 4), (7, 16), (20, 16)])
def test_corridors_of_a_large_map_say_what_they_leave_out(n_landmarks, n_axes):
    answer = kalman(problem(full_scenario(n_landmarks, n_steps=3)))
    figure = new_figure(10, 14)
    assert len(draw_corridors(figure, None, answer)) == n_axes
    assert ("(first 7 of 20 landmarks)" in figure.get_suptitle()) == (n_landmarks == 20)


def test_instants_are_whole_numbers(exact):
    first = Filtered(exact.means[:3], exact.covs[:3], exact.log_evidence[:3])
    figure = new_figure(10, 8)
    (*_, ax) = draw_corridors(figure, None, first)
    assert {float(tick) % 1 for tick in ax.get_xticks()} == {0}


# map


def ellipses(ax, color):
    return [patch for patch in ax.patches if isinstance(patch, Ellipse) and patch.get_edgecolor() == to_rgba(color)]


@pytest.mark.parametrize("k", [-1, 0, 5])
def test_map_has_an_ellipse_for_robot_and_landmarks(world, exact, estimate, k):
    figure = new_figure(7.5, 7.5)
    ax = draw_map(figure.subplots(), estimate, exact, world.truth, k=k, label="mine")
    for filtered, color in ((exact, EXACT), (estimate, ESTIMATE)):
        patches = ellipses(ax, color)
        assert len(patches) == 4
        for i, patch in enumerate(patches):
            block = slice(2 * i, 2 * i + 2)
            assert patch.center == pytest.approx(filtered.means[k, block])
            sides = 2 * np.sqrt(chi2.ppf(0.99, 2) * np.maximum(np.linalg.eigvalsh(filtered.covs[k, block, block]), 0))
            assert sorted((patch.width, patch.height)) == pytest.approx(sides, abs=1e-6)
    points = {line.get_marker(): line.get_xydata() for line in ax.lines if line.get_marker() != "None"}
    np.testing.assert_array_equal(points["+"], exact.means[k].reshape(4, 2))
    np.testing.assert_array_equal(points["s"], estimate.means[k].reshape(4, 2))
    np.testing.assert_array_equal(points["x"], world.truth[k].reshape(4, 2))
    (path,) = (line for line in ax.lines if line.get_label() == "true path")
    np.testing.assert_array_equal(path.get_xydata(), world.truth[: k % 12 + 1, :2])
    assert f"$k = {k % 12}$" in ax.get_title()
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("$x$ [m]", "$y$ [m]")
    assert ax.get_aspect() == 1
    assert [text.get_text() for text in ax.texts] == ["$r$", "$m_{1}$", "$m_{2}$", "$m_{3}$"]


def test_map_ties_each_estimate_to_its_exact_mean(exact, estimate):
    ax = draw_map(new_figure(7, 7).subplots(), estimate, exact, k=4)
    ties = [line.get_xydata() for line in ax.lines if line.get_linestyle() == "-" and line.get_marker() == "None"]
    expected = [[exact.means[4, i : i + 2], estimate.means[4, i : i + 2]] for i in range(0, 8, 2)]
    np.testing.assert_array_equal(ties, expected)


def test_map_of_the_exact_filter_without_a_truth(exact):
    figure = new_figure(7, 7)
    ax = draw_map(figure.subplots(), None, exact)
    assert len(ax.patches) == 4
    assert [line.get_marker() for line in ax.lines] == ["+"]
    legend_below(figure, ax)
    assert labels(figure) == ["exact: mean, 99 % ellipse"]
    assert_inside(figure)


def test_map_shows_all_of_a_map_far_from_the_origin(exact):
    moved = Filtered(exact.means + 1000, exact.covs, exact.log_evidence)
    figure = new_figure(7, 7)
    ax = draw_map(figure.subplots(), None, moved)
    drawn(figure)
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    assert left > 900
    assert low > 900
    for patch in ax.patches:
        x, y = np.array(patch.get_co_vertices()).T
        assert left <= x.min() <= x.max() <= right
        assert low <= y.min() <= y.max() <= high


def test_names_on_the_map_stay_off_the_marks():
    """They stand to the upper left of the mean, and elsewhere when something else is there."""
    means = np.array([[0.0, 0.0, 4.0, 0.0]])
    covs = np.array([0.01 * np.eye(4)])
    answer = Filtered(means, covs, np.zeros(1))
    beside = Filtered(np.array([[-0.2, 0.2, 4.2, 0.2]]), covs, np.zeros(1))
    robot, landmark = draw_map(new_figure(7, 7).subplots(), beside, answer).texts
    upper_left = np.array([-1, 1]) / np.sqrt(2)
    assert np.array(landmark.xyann) @ upper_left == pytest.approx(np.linalg.norm(landmark.xyann))
    assert np.array(robot.xyann) @ upper_left < 1e-9


# gap


def series(ax):
    """Return the lines with markers, by label."""
    return {bars.get_label(): bars for bars in ax.containers}


@pytest.mark.parametrize("metric", ["mean_gap", "cov_gap"])
def test_gap_is_that_of_the_summary_with_its_errors(comparison, metric):
    ax = draw_gap(new_figure(5, 5).subplots(), comparison, metric)
    summary = comparison.summary()
    for solver in ("sis", "sir"):
        rows = summary[summary["solver"] == solver].sort_values("n_particles")
        line, _, (bars,) = series(ax)[solver]
        assert line.get_xdata().tolist() == [10, 30, 100]
        np.testing.assert_allclose(line.get_ydata().astype(float), rows[metric])
        for segment, mean, error in zip(bars.get_segments(), rows[metric], rows[f"{metric}_se"], strict=True):
            np.testing.assert_allclose(segment[:, 1], [mean - error, mean + error])
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")
    assert_labelled_with_units([ax])


def test_the_slope_is_minus_one_half(comparison):
    ax = draw_gap(new_figure(5, 5).subplots(), comparison)
    (line,) = (line for line in ax.lines if line.get_label() == "slope -1/2")
    x, y = line.get_data()
    np.testing.assert_allclose(np.diff(np.log(y)) / np.diff(np.log(x)), -0.5)
    assert (x[0], x[-1]) == (10, 100)
    assert y[0] == pytest.approx(comparison.summary().query("n_particles == 10")["mean_gap"].min())


def test_gap_axes_have_numbers_at_each_n(comparison):
    figure = new_figure(5, 5)
    ax = draw_gap(figure.subplots(), comparison)
    drawn(figure)
    assert [text.get_text() for text in ax.get_xticklabels()] == ["10", "30", "100"]
    assert [text.get_text() for text in ax.get_xticklabels(minor=True)] == []
    low, high = ax.get_ylim()
    shown = [float(text.get_text()) for text in ax.get_yticklabels() if text.get_text()]
    assert sum(low <= value <= high for value in shown) >= 2


@pytest.mark.parametrize("runs", [1, 5])
def test_gap_of_one_n(world, runs):
    """Its axis reaches over a decade at least, or it would have no numbers."""
    figure = new_figure(5, 5)
    ax = draw_gap(figure.subplots(), compare(world.problem, {"sir": sir}, n_particles=[50], runs=runs))
    drawn(figure)
    assert "slope -1/2" not in ax.get_legend_handles_labels()[1]
    assert [text.get_text() for text in ax.get_xticklabels()] == ["50"]
    low, high = ax.get_ylim()
    assert high / low >= 9.99


@pytest.mark.parametrize(("solver", "words"), [(failing, "every run failed"), (bare, "the gap is zero")])
def test_gap_of_which_there_is_nothing_to_draw(world, solver, words):
    figure = new_figure(5, 5)
    ax = draw_gap(figure.subplots(), compare(world.problem, {"a": solver}, n_particles=[5, 10], runs=2))
    drawn(figure)
    assert [text.get_text() for text in ax.texts] == [words]


def test_gap_leaves_out_the_failed_and_starts_the_slope_at_the_first_that_is_there(world):
    def late(problem, rng, *, n_particles):
        if n_particles < 10:
            raise ValueError
        return sis(problem, rng, n_particles=n_particles)

    result = compare(world.problem, {"late": late, "exact": bare}, n_particles=[5, 10, 20], runs=2)
    ax = draw_gap(new_figure(5, 5).subplots(), result)
    assert series(ax)["late"][0].get_xdata().tolist() == [10, 20]
    (line,) = (line for line in ax.lines if line.get_label() == "slope -1/2")
    assert line.get_ydata()[1] == pytest.approx(result.summary()["mean_gap"][1])


# ESS


def test_ess_is_the_median_over_the_runs_within_their_range(comparison):
    figure = new_figure(8, 6)
    axes = draw_ess(figure, comparison)
    assert len(axes) == 4
    for (ess, ancestors), solver in zip((axes[:2], axes[2:]), ("sis", "sir"), strict=True):
        for ax, name in ((ess, "ess"), (ancestors, "survivors")):
            for line, band, size in zip(ax.lines, ax.collections, (10, 30, 100), strict=False):
                values = np.array([getattr(record, name) for record in comparison.of(solver, size)])
                np.testing.assert_allclose(line.get_ydata(), np.median(values, axis=0))
                expected = np.column_stack([values.min(axis=0), values.max(axis=0)])
                np.testing.assert_allclose(band_edges(band), expected)
                assert line.get_label() == f"$N = {size}$"
        assert ess.get_title() == solver
        forecast, collapsed = ess.lines[3:]
        limit = 100 * 10 ** comparison.forecasts[solver][0]
        np.testing.assert_allclose(forecast.get_ydata(), np.maximum(limit, 1))
        np.testing.assert_array_equal(collapsed.get_ydata(), [2, 2])
        assert len(ancestors.lines) == 3
    assert all(ax.get_yscale() == "log" for ax in axes)
    assert labels(figure) == [
        "$N = 10$",
        "$N = 30$",
        "$N = 100$",
        "forecast, $N = 100$",
        "ESS = 2: collapsed below",
    ]
    assert "medians over 4 runs" in figure.get_suptitle()
    assert_labelled_with_units(axes)
    assert_inside(figure)


def test_ess_of_six_filters_with_long_labels_stays_readable(world):
    names = [f"{'a-rather-long-label' if i % 2 else 'sir:resample=residual:ess_threshold=0.5'}-{i}" for i in range(5)]
    solvers = {name: partial(sir, ess_threshold=0.5) for name in [*names, "_hidden$x$"]}
    result = compare(world.problem, solvers, n_particles=[5, 6, 7, 8, 9, 10], runs=1)
    figure = new_figure(1 + 3 * 3, 0.8 + 5.4 * 2)
    axes = draw_ess(figure, result)
    assert len(axes) == 12
    columns = {round(ax.get_position().x0, 2) for ax in drawn(figure).axes}
    assert len(columns) == 3
    assert labels(figure) == ["$N = 5$", "$N = 7$", "$N = 8$", "$N = 10$", *FORECAST]
    assert "one run, 4 of 6 numbers of particles" in figure.get_suptitle()
    assert_labelled_with_units(axes)
    assert_inside(figure)
    figure = new_figure(10, 4.8)
    pair = figure.subplots(1, 2)
    for ax in pair:
        draw_gap(ax, result)
    legend_below(figure, pair[0])
    slope, prediction, *others = [text.replace("\n", "").strip() for text in labels(figure)]
    assert slope == "slope -1/2"
    assert prediction.startswith("bootstrap filter, predicted:only from ")
    assert others == [*names, r"_hidden\$x\$"]
    assert_inside(figure)


@pytest.mark.parametrize(("n_solvers", "width"), [(1, 1), (3, 3), (4, 4), (5, 3), (9, 3)])
def test_ess_leaves_no_empty_axes(world, n_solvers, width):
    result = compare(world.problem, {f"s{i}": sis for i in range(n_solvers)}, n_particles=[5], runs=1)
    figure = new_figure(11, 11)
    assert draw_ess(figure, result)
    assert len(figure.axes) == 2 * n_solvers
    assert all(ax.lines for ax in figure.axes)
    assert figure.axes[0].get_gridspec().ncols == width


@pytest.mark.parametrize(("solver", "words"), [(failing, "every run failed"), (bare, "not given by this filter")])
def test_ess_that_is_missing_is_said_to_be(world, solver, words):
    result = compare(world.problem, {"a": solver, "sir": sir}, n_particles=[5], runs=2)
    figure = new_figure(8, 6)
    axes = draw_ess(figure, result)
    assert [[text.get_text() for text in ax.texts] for ax in axes] == [[words], [words], [], []]
    assert_inside(figure)


# style


def test_36_series_look_different():
    looks = [look(i) for i in range(36)]
    assert len(set(looks)) == 36
    assert looks[:6] == list(LOOKS)


def test_labels_are_folded_where_they_may_be_and_lose_nothing():
    label = "sir:ess_threshold=0.05:resample=residual"
    assert wrapped(label, 24).splitlines() == ["sir:ess_threshold=0.05:", "resample=residual"]
    for text in ("x" * 100, label, "a b-c", "short"):
        folded = wrapped(text, 20)
        assert folded.replace("\n", "") == text
        assert max(map(len, folded.splitlines())) <= 20


def test_thinned():
    assert thinned([1, 2, 3], 4) == [1, 2, 3]
    assert thinned(list(range(10)), 4) == [0, 3, 6, 9]


def test_a_comparison_is_not_changed_by_drawing_it(comparison):
    before = comparison.summary()
    draw_gap(new_figure(5, 5).subplots(), comparison)
    draw_ess(new_figure(5, 5), comparison)
    assert isinstance(comparison, Comparison)
    assert before.equals(comparison.summary())
