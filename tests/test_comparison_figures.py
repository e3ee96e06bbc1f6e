"""What a comparison's figures say of theory, evidence, cost and loop closure, by the geometry of their artists."""

from dataclasses import replace
from functools import partial
from itertools import pairwise

import matplotlib.pyplot as plt
import numpy as np
import pytest
from artists import assert_inside, assert_labelled_with_units, bare, drawn, failing, labels
from matplotlib.colors import to_rgba
from matplotlib.patches import PathPatch
from test_proposals import cut
from worlds import experiment, full_scenario, nothing, problem, reference

from lab import theory
from lab.compare import compare
from lab.comparison import Comparison, Record, Unit
from lab.metrics import Metrics
from lab.plots import draw_cost, draw_ess, draw_evidence, draw_gap, draw_loop_closure, legend_below, new_figure
from lab.plots.loop_closure import correlations, deviations, loop_closure
from lab.plots.style import look
from lab.problem import Problem
from lab.solvers import guided, kalman, rbpf, sir, sis

PREDICTED = "bootstrap filter, predicted"


@pytest.fixture(autouse=True)
def _no_global_state():
    yield
    assert plt.get_fignums() == []


@pytest.fixture(scope="module")
def easy():
    """A few instants of one landmark: the prediction holds from N = 200 on."""
    return cut(problem(full_scenario(1, 8), 8), 5)


@pytest.fixture(scope="module")
def comparison():
    """Two data sets, four filters, one of which fails now and then."""

    def frail(problem, rng, *, n_particles):
        if rng.random() < 0.5:
            raise ValueError
        return sir(problem, rng, n_particles=n_particles)

    solvers = {"sis": sis, "sir": sir, "frail": frail, "rbpf": rbpf}
    sets = [problem(full_scenario(4, n_steps=25), seed) for seed in (0, 1)]
    return compare(sets, solvers, n_particles=[40, 10, 160], runs=6)


def made(values, *, seconds=1.0):
    """Return a comparison of records made up: values by solver and N, one run each entry."""
    world = cut(problem(full_scenario(1, 8), 8), 3)
    records = [
        Record(Unit(solver, size, run, 0), Metrics(0.5, 0.5, value, 0.5, seconds=seconds))
        for (solver, size), row in values.items()
        for run, value in enumerate(row)
    ]
    return Comparison((world,), (kalman(world),), tuple(records))


def line_of(ax, label):
    return next((line for line in ax.lines if line.get_label().startswith(label)), None)


# the predicted error


def test_the_predicted_line_passes_through_the_gaps_of_the_bootstrap_filter(easy):
    """Within five standard errors of the rms gap, and 4 % for terms of higher order in 1 / N."""
    bootstrap = partial(sir, ess_threshold=1.0, resample="multinomial")
    result = compare(easy, {"bootstrap": bootstrap}, n_particles=[2000, 6000], runs=150)
    line = line_of(draw_gap(new_figure(5, 5).subplots(), result), PREDICTED)
    assert line.get_xdata().tolist() == [2000, 6000]
    for size, predicted in line.get_xydata():
        squares = np.array([record.metrics.mean_gap**2 for record in result.of("bootstrap", int(size))])
        error = squares.std(ddof=1) / np.sqrt(len(squares)) / np.mean(squares)
        ratio = np.mean(squares) / predicted**2
        assert abs(ratio - 1) <= 5 * error + 0.08
        mean_gap = np.sqrt(squares).mean()
        assert 0.8 * predicted < mean_gap < predicted * (1 + 5 * error)  # the mean lies below the rms


def test_the_prediction_is_the_mean_over_data_sets_of_the_rms():
    """By loops, from the variances themselves; NaN below the N from which the worst component keeps to 0.3."""
    worlds = [cut(problem(full_scenario(1, 8), seed), 5) for seed in (8, 9)]
    ratios = np.array([theory.relative_log_variance(world) for world in worlds])
    worst, rms = 0.0, []
    for each, world in zip(ratios, worlds, strict=True):
        uncertain = kalman(world).uncertain
        squares = [np.exp(each[k, i]) for k in range(1, 5) for i in range(4) if uncertain[k, i]]
        worst = max(worst, *squares)
        rms.append(np.sqrt(np.mean(squares)))
    needed = worst / 0.3**2
    sizes = np.array([needed * 0.99, needed * 1.01, 100 * needed])
    gaps, log10_needed = theory.predicted_gap(ratios, sizes)
    assert log10_needed == pytest.approx(np.log10(needed))
    np.testing.assert_allclose(gaps, [np.nan, *(np.mean(rms) / np.sqrt(sizes[1:]))])


def test_the_prediction_is_drawn_where_it_holds_only(easy):
    result = compare(easy, {"sir": sir}, n_particles=[20, 100, 1000, 4000], runs=1)
    _, log10_needed = theory.predicted_gap(result.bootstrap_log_variances, np.array([1.0]))
    assert 100 < 10**log10_needed < 1000
    line = line_of(draw_gap(new_figure(5, 5).subplots(), result), PREDICTED)
    np.testing.assert_allclose(line.get_xdata(), [10**log10_needed, 1000, 4000])
    gaps, _ = theory.predicted_gap(result.bootstrap_log_variances, line.get_xdata())
    np.testing.assert_allclose(line.get_ydata(), gaps)
    assert (line.get_color(), line.get_linestyle()) == ("black", ":")


def test_the_prediction_of_one_n_has_a_length(easy):
    ax = draw_gap(new_figure(5, 5).subplots(), compare(easy, {"sir": sir}, n_particles=900, runs=1))
    np.testing.assert_allclose(line_of(ax, PREDICTED).get_xdata(), [300, 900, 2700])


def test_a_prediction_out_of_reach_is_named_with_its_n():
    world = reference(1).problem
    ax = draw_gap(new_figure(5, 5).subplots(), compare(world, {"sir": sir}, n_particles=[5, 10], runs=1))
    line = line_of(ax, PREDICTED)
    assert line.get_label() == f"{PREDICTED}:\nonly from $N = 10^{{10.6}}$ on"
    assert len(line.get_xdata()) == 0


@pytest.mark.parametrize(
    ("solvers", "metric", "drawn"),
    [
        ({"sir": sir}, "mean_gap", True),
        ({"sir": sir}, "cov_gap", False),
        ({"sis": sis, "guided": guided, "rbpf": rbpf}, "mean_gap", False),
        ({"never": partial(sir, ess_threshold=0.0)}, "mean_gap", False),
        ({"blind": partial(rbpf, proposal="prior")}, "mean_gap", False),
        ({"unknown": lambda problem, rng, *, n_particles: sir(problem, rng, n_particles=n_particles)}, "mean_gap", 0),
    ],
)
def test_the_prediction_is_for_the_mean_of_a_bootstrap_filter(easy, solvers, metric, drawn):
    ax = draw_gap(new_figure(5, 5).subplots(), compare(easy, solvers, n_particles=500, runs=1), metric)
    assert (line_of(ax, PREDICTED) is not None) == drawn


def test_nothing_is_predicted_of_a_state_that_is_known():
    gaps, needed = theory.predicted_gap(np.full((1, 4, 6), -np.inf), np.array([10.0]))
    assert (gaps.tolist(), needed) == ([0.0], -np.inf)


# the forecast of the ESS


def test_the_forecast_is_that_of_each_filter_with_its_own_threshold(comparison):
    figure = new_figure(12, 7)
    axes = draw_ess(figure, comparison)[::2]
    for ax, solver in zip(axes, comparison.solvers, strict=True):
        line = line_of(ax, "forecast, $N = 160$")
        if solver == "frail":  # theory does not know it
            assert line is None
            continue
        proposal, share = {"sis": ("prior", 0.0), "sir": ("prior", 0.5), "rbpf": ("rbpf-optimal", 0.5)}[solver]
        each = [theory.forecast(world, proposal, ess_threshold=share) for world in comparison.problems]
        np.testing.assert_allclose(line.get_ydata(), np.maximum(160 * 10 ** np.median(each, axis=0), 1))
    assert line_of(axes[0], "forecast").get_ydata()[-1] == 1  # SIS is far below one particle
    assert line_of(axes[1], "forecast").get_ydata()[5:].max() > 10  # SIR recovers
    assert "medians over 6 runs on each of 2 data sets" in figure.get_suptitle()
    assert_inside(figure)


# evidence


def boxes(ax):
    return [patch for patch in ax.patches if isinstance(patch, PathPatch)]


def test_boxes_are_the_quartiles_of_the_good_runs(comparison):
    figure = new_figure(9, 6)
    ax = draw_evidence(figure.subplots(), comparison)
    legend_below(figure, ax)
    groups = [(i, j, s, n) for i, s in enumerate(comparison.solvers) for j, n in enumerate((10, 40, 160))]
    good = [(i, j, records) for i, j, s, n in groups if len(records := comparison.of(s, n)) >= 5]
    assert len(good) < 12  # some have too few runs for a box
    for box, (i, j, records) in zip(boxes(ax), good, strict=True):
        corners = box.get_path().vertices
        values = [record.metrics.log_evidence_gap for record in records]
        np.testing.assert_allclose([corners[:, 1].min(), corners[:, 1].max()], np.percentile(values, [25, 75]))
        assert j - 0.42 <= corners[:, 0].min() < corners[:, 0].max() <= j + 0.42
        middle = (corners[:, 0].min() + corners[:, 0].max()) / 2
        assert middle == pytest.approx(j + 0.84 * ((i + 0.5) / 4 - 0.5))
        assert box.get_edgecolor() == to_rgba(look(i).color)
    assert len({box.get_hatch() for box in boxes(ax)}) >= 3  # readable in grey
    few = [len(line.get_xdata()) for line in ax.lines if line.get_fillstyle() == "none" and line.get_marker() == "^"]
    assert few == [len(comparison.of("frail", n)) for n in (10, 40, 160) if 0 < len(comparison.of("frail", n)) < 5]
    assert sorted(labels(figure)) == sorted(["exact", *comparison.solvers])
    assert [text.get_text() for text in ax.get_xticklabels()] == ["10", "40", "160"]
    assert set(line_of(ax, "exact").get_ydata()) == {0}
    assert_labelled_with_units([ax])
    assert_inside(figure)


@pytest.mark.parametrize(
    ("values", "scale", "ticks"),
    [
        ([-3, 1, 2, 0.5, -1], "linear", None),
        ([-3, 1, 29, 0.5, -1], "linear", None),
        ([-900, -3, 2, 0.5, 1], "symlog", ["-1000", "-100", "-10", "-1", "0", "1"]),
        ([-5e6, -3, 2, 0.5, 1], "symlog", ["-1e+06", "-10000", "-100", "-1", "0", "1"]),
        ([-100, -3, 200, 0.5, 1], "symlog", ["-100", "-10", "-1", "0", "1", "10", "100"]),
        ([-100, -80, -70, -60, -50], "symlog", ["-100", "-10", "-1", "0", "1"]),
    ],
)
def test_evidence_is_logarithmic_where_it_spreads(values, scale, ticks):
    figure = new_figure(6, 5)
    ax = draw_evidence(figure.subplots(), made({("a", 10): values}))
    drawn(figure)
    assert ax.get_yscale() == scale
    assert ("beyond ±1" in ax.get_ylabel()) == (scale == "symlog")
    low, high = ax.get_ylim()
    assert low < min(values)
    assert high > max(values)
    if ticks:
        shown = [text.get_text() for text in ax.get_yticklabels()]
        assert shown == ticks


def test_evidence_of_one_run_is_a_point():
    ax = draw_evidence(new_figure(6, 5).subplots(), made({("a", 10): [-2], ("b", 10): [1.5], ("b", 20): [0.5]}))
    assert not boxes(ax)
    points = {tuple(line.get_ydata()): line for line in ax.lines if line.get_marker() in "os"}
    assert set(points) == {(-2,), (1.5,), (0.5,)}
    assert [points[value,].get_marker() for value in (-2, 1.5, 0.5)] == ["o", "s", "s"]


@pytest.mark.parametrize(("solver", "words"), [(failing, ["every run failed"]), (bare, [])])
def test_evidence_of_which_there_is_nothing_to_draw(easy, solver, words):
    figure = new_figure(6, 5)
    ax = draw_evidence(figure.subplots(), compare(easy, {"a": solver}, n_particles=[5, 10], runs=6))
    drawn(figure)
    assert [text.get_text().strip() for text in ax.texts] == words


# cost


@pytest.mark.parametrize("metric", ["mean_gap", "cov_gap"])
def test_cost_is_the_gap_against_the_median_seconds(comparison, metric):
    figure = new_figure(8, 6)
    ax = draw_cost(figure.subplots(), comparison, metric)
    legend_below(figure, ax)
    summary = comparison.summary().sort_values("n_particles")
    for bars in ax.containers:
        line, _, (errors,) = bars
        rows = summary[summary["solver"] == bars.get_label()]
        seconds = [
            np.median([record.metrics.seconds for record in comparison.of(bars.get_label(), n)]) for n in (10, 40, 160)
        ]
        np.testing.assert_allclose(line.get_xdata().astype(float), seconds)
        np.testing.assert_allclose(line.get_ydata().astype(float), rows[metric])
        heights = [np.ptp(segment[:, 1]) / 2 for segment in errors.get_segments()]
        np.testing.assert_allclose(heights, rows[f"{metric}_se"])
    assert len(ax.containers) == 4
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")
    assert_labelled_with_units([ax])
    assert_inside(figure)


def test_n_stands_beside_its_point_and_on_no_other(comparison):
    figure = new_figure(8, 6)
    ax = draw_cost(figure.subplots(), comparison)
    legend_below(figure, ax)
    drawn(figure)
    points = {}
    for bars in ax.containers:
        points |= dict.fromkeys(map(tuple, bars[0].get_xydata().astype(float)), bars.get_label())
    extents = [text.get_window_extent() for text in ax.texts]
    for i, (text, extent) in enumerate(zip(ax.texts, extents, strict=True)):
        solver = points[tuple(text.xy)]
        at = comparison.summary().set_index(["solver", "n_particles"])["mean_gap"]
        assert at[solver, int(text.get_text())] == pytest.approx(text.xy[1])
        assert not any(extent.overlaps(other) for other in extents[:i])
        assert not any(extent.contains(*ax.transData.transform(point)) for point in points)
    assert len(ax.texts) >= 6


def test_cost_leaves_out_numbers_that_have_no_room(easy):
    solvers = {f"s{i}": partial(sir, ess_threshold=0.5) for i in range(9)}
    figure = new_figure(4, 3)
    ax = draw_cost(figure.subplots(), compare(easy, solvers, n_particles=[10, 11, 12, 13, 14, 15], runs=1))
    drawn(figure)
    extents = [text.get_window_extent() for text in ax.texts]
    assert 0 < len(extents) < 54
    assert not any(one.overlaps(other) for i, one in enumerate(extents) for other in extents[:i])


@pytest.mark.parametrize(("solver", "words"), [(failing, "every run failed"), (bare, "the gap is zero")])
def test_cost_of_which_there_is_nothing_to_draw(easy, solver, words):
    figure = new_figure(5, 5)
    ax = draw_cost(figure.subplots(), compare(easy, {"a": solver}, n_particles=[5, 10], runs=2))
    drawn(figure)
    assert [text.get_text() for text in ax.texts] == [words]
    assert ax.get_legend_handles_labels()[1] == ["a"]


# loop closure


def seen_at(n_landmarks, *instants):
    """Return a full world whose landmarks are seen at these instants only, one tuple of instants each."""
    world = experiment(full_scenario(n_landmarks, n_steps=12, field_of_view=lambda z, o: np.full(len(z), True))).problem
    z = world.z.copy()
    for i in range(n_landmarks):
        unseen = [k for k in range(12) if k not in (instants[i] if i < len(instants) else ())]
        z[unseen, 2 * i : 2 * i + 2] = np.nan
    return Problem(world.model, z, world.H, world.R)


def by_loops(world):
    """Return the instant and landmark of the closure that sharpens the others most, the slow way."""
    exact, best = kalman(world), None
    for k in range(1, world.n_instants):
        drops = []
        for i in range(world.n_landmarks):
            block = slice(2 + 2 * i, 4 + 2 * i)
            before, after = (np.sqrt(np.trace(exact.covs[t, block, block])) for t in (k - 1, k))
            drops.append(1 - after / before)
        seen = [[not np.isnan(world.z[t, 2 * i]) for i in range(world.n_landmarks)] for t in range(k + 1)]
        again = [i for i, now in enumerate(seen[k]) if now and not seen[k - 1][i] and any(row[i] for row in seen[:k])]
        score = sum(drop for i, drop in enumerate(drops) if not seen[k][i])
        if again and (best is None or score > best[0]):
            best = (score, k, max(again, key=lambda i: drops[i]))
    return best and best[1:]


@pytest.mark.parametrize("n_landmarks", [2, 3, 5, 20])
@pytest.mark.parametrize("seed", range(3))
def test_the_closure_sharpens_those_out_of_view_most(n_landmarks, seed):
    world = problem(full_scenario(n_landmarks, seed), seed)
    found = loop_closure(world, kalman(world))
    assert (found and (found.k, found.landmark)) == by_loops(world)


def test_a_closure_follows_an_absence():
    world = seen_at(3, (1, 2, 6), (3, 4, 5))
    k, landmark, away, in_view, sharpening = loop_closure(world, kalman(world))
    assert (k, landmark, away) == (6, 0, 3)
    assert in_view.tolist() == [True, False, False]
    assert sharpening.shape == (3,)
    for instants in ((), (1, 2, 3), (5,)):
        assert loop_closure(seen_at(3, instants), kalman(seen_at(3, instants))) is None


def test_deviations_and_correlations_are_those_of_the_covariance():
    exact = kalman(problem(full_scenario(3, n_steps=8)))
    P = exact.covs[7]
    std = [np.sqrt((P[i, i] + P[i + 1, i + 1]) / 2) for i in (2, 4, 6)]
    np.testing.assert_allclose(deviations(exact)[7], std)
    cross = [(P[4, i] + P[5, i + 1]) / 2 / std[1] / s for i, s in zip((2, 4, 6), std, strict=True)]
    values = correlations(exact, 1, np.zeros((8, 3)))
    np.testing.assert_allclose(values[7], cross)
    np.testing.assert_allclose(values[:, 1], 1)


@pytest.fixture(scope="module")
def closed():
    """A filter that keeps its correlations and one that collapses."""
    return compare(reference(1).problem, {"rbpf": rbpf, "sis": sis}, n_particles=[20, 50], runs=2)


@pytest.mark.parametrize("solver", ["rbpf", "sis"])
def test_loop_closure_shows_exact_beside_estimated(closed, solver):
    figure = new_figure(11, 8)
    over_time, correlated, across = draw_loop_closure(figure, closed, solver)
    exact, estimate = closed.exacts[0], closed.of(solver, 50)[0].filtered
    closure = loop_closure(closed.problems[0], exact)
    name = f"m_{{{closure.landmark + 1}}}"
    solid, dashed = (
        [line.get_ydata() for line in over_time.lines if line.get_linestyle() == kind and len(line.get_ydata()) > 2]
        for kind in ("-", "--")
    )
    np.testing.assert_allclose(np.column_stack(solid), deviations(exact))
    np.testing.assert_allclose(np.column_stack(dashed), deviations(estimate))
    floor, others = 1e-6 * deviations(exact), np.arange(5) != closure.landmark
    for kind, filtered in (("-", exact), ("--", estimate)):
        lines = [line.get_ydata() for line in correlated.lines if line.get_linestyle() == kind]
        expected = correlations(filtered, closure.landmark, floor)[:, others]
        np.testing.assert_allclose(np.column_stack(lines), expected)
        assert np.isnan(expected).any() == (filtered is estimate and solver == "sis")
    assert ("none where a cloud has no spread" in correlated.get_title()) == (solver == "sis")
    for ax in (over_time, correlated):
        (line,) = (line for line in ax.lines if line.get_linestyle() == ":")
        assert set(line.get_xdata()) == {closure.k}
    for filtered, words in ((exact, "exact"), (estimate, "estimate")):
        for k in (closure.k - 1, closure.k):
            points = line_of(across, f"{words}, $k = {k}$")
            np.testing.assert_allclose(points.get_ydata(), deviations(filtered)[k])
            assert points.get_fillstyle() == ("full" if k == closure.k else "none")
    assert f"${name}$, seen again" in labels(figure)
    assert f"Loop closed at k = {closure.k}: landmark {closure.landmark + 1} is seen again" in figure.get_suptitle()
    assert f"{solver} (N = 50, run 0)" in figure.get_suptitle()
    assert across.get_ylim()[1] > deviations(exact)[closure.k - 1].max()
    assert_labelled_with_units([over_time, correlated, across])
    assert_inside(figure)


@pytest.mark.parametrize(
    ("n_landmarks", "drawn_over_time", "compared"), [(2, 2, 2), (5, 5, 5), (20, 5, 20), (23, 5, 20)]
)
def test_loop_closure_of_a_large_map_says_what_it_leaves_out(n_landmarks, drawn_over_time, compared):
    world = problem(full_scenario(n_landmarks))
    result = compare(world, {"rbpf": rbpf}, n_particles=20, runs=1)
    closure = loop_closure(world, result.exacts[0])
    figure = new_figure(11, 8)
    over_time, correlated, across = draw_loop_closure(figure, result)
    named = [text for text in labels(figure) if text.startswith("$m_") and "view" not in text]
    assert len(named) == drawn_over_time
    assert f"$m_{{{closure.landmark + 1}}}$, seen again" in named
    if n_landmarks > 5:  # the rest are those out of view that sharpen most
        hidden = sorted(np.flatnonzero(~closure.in_view), key=lambda i: -closure.sharpening[i])
        assert set(named) > {f"$m_{{{i + 1}}}$" for i in hidden[:4]}
    assert len(across.get_xticks()) == compared
    few = f"{drawn_over_time} of {n_landmarks}"
    assert (few in over_time.get_title()) == (few in correlated.get_title()) == (n_landmarks > 5)
    assert (f"20 of {n_landmarks} landmarks" in across.get_title()) == (n_landmarks > 20)
    assert_inside(figure)
    extents = [label.get_window_extent() for label in across.get_xticklabels()]
    assert not any(one.overlaps(other) for one, other in pairwise(extents))


def test_the_landmark_seen_again_is_compared_however_many_there_are():
    """Here it is the last of 23."""
    instants = [(k,) for k in range(1, 12)] * 2
    world = seen_at(23, *instants, (1, 2, 11))
    figure = new_figure(11, 8)
    *_, across = draw_loop_closure(figure, compare(world, {"rbpf": rbpf}, n_particles=5, runs=1))
    assert [text.get_text() for text in across.get_xticklabels()][-1] == "$m_{23}$"


def test_one_landmark_has_no_other(easy):
    world = seen_at(1, (1, 2, 6))
    figure = new_figure(11, 8)
    _, correlated, across = draw_loop_closure(figure, compare(world, {"sir": sir}, n_particles=20, runs=1))
    assert [text.get_text() for text in correlated.texts] == ["there is no other landmark"]
    assert len(across.get_xticks()) == 1
    assert_inside(figure)


def test_no_loop_is_said_to_be_none():
    world = problem(full_scenario(3, field_of_view=nothing))
    figure = new_figure(11, 8)
    (ax,) = draw_loop_closure(figure, compare(world, {"sir": sir}, n_particles=5, runs=1))
    assert "No loop is closed" in ax.texts[0].get_text()
    assert_inside(figure)


def test_loop_closure_without_an_estimate_is_the_exact_one():
    result = compare(reference(1).problem, {"a": failing}, n_particles=5, runs=1)
    figure = new_figure(11, 8)
    over_time, _, _ = draw_loop_closure(figure, result)
    assert not [line for line in over_time.lines if line.get_linestyle() == "--"]
    assert "a (no run kept)" in figure.get_suptitle()
    assert_inside(figure)


def test_the_moments_drawn_are_those_of_the_first_data_set():
    """Even where its largest N failed and that of another did not."""
    sets = [reference(1).problem, reference(2).problem]
    result = compare(sets, {"rbpf": rbpf}, n_particles=[5, 10], runs=1, keep_moments=True)
    records = tuple(
        replace(r, filtered=None, error="no") if r.unit.n_particles == 10 and r.unit.data_set == 0 else r
        for r in result.records
    )
    figure = new_figure(11, 8)
    over_time, _, _ = draw_loop_closure(figure, replace(result, records=records))
    first = next(line for line in over_time.lines if line.get_linestyle() == "--")
    np.testing.assert_allclose(first.get_ydata(), deviations(result.records[0].filtered)[:, 0])
    assert "N = 5" in figure.get_suptitle()


def test_a_landmark_seen_in_one_coordinate_is_in_view():
    whole = seen_at(2, (1, 2, 6))
    z = whole.z.copy()
    z[[1, 2], 1] = np.nan
    z[6, 0] = np.nan
    closure = loop_closure(world := Problem(whole.model, z, whole.H, whole.R), kalman(world))
    assert (closure.k, closure.landmark, closure.away) == (6, 0, 3)
