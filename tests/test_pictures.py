"""The figures that a comparison writes, and the words that go with them."""

import re

import numpy as np
import pytest
from artists import bare, failing
from PIL import Image
from program import everything_in
from worlds import experiment, full_scenario, nothing, reference

from lab import theory
from lab.cli import album, captions
from lab.compare import compare
from lab.plots.loop_closure import deviations, loop_closure
from lab.solvers import kalman, sir

ALL = ["gap.png", "cost.png", "evidence.png", "ess.png"]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Two data sets, one filter that theory knows and one that always fails; what was written, and what was said."""
    folder = tmp_path_factory.mktemp("pictures")
    sets = [reference(1), reference(2)]
    result = compare([one.problem for one in sets], {"sir": sir, "bad": failing}, n_particles=[20, 60], runs=3)
    told = []
    given = album.write_comparison(folder, result, sets[0], lambda done, total: told.append((done, total)))
    return folder, result, given, told


def test_each_file_is_named_in_order_with_a_title_and_its_words(written):
    folder, _, given, told = written
    assert [picture.file for picture in given] == [*ALL, "loop-closure-sir.png", "corridors-sir.png", "map-sir.png"]
    assert set(everything_in(folder)) == {picture.file for picture in given}
    for file, title, alt in given:
        assert title
        assert not title.endswith(".")
        assert alt.endswith(".")
        assert "nan" not in alt
        with Image.open(folder / file) as image:
            assert image.text["Description"] == alt
    assert told == [(i, 10) for i in range(1, 11)]


def test_processes_draw_the_same(written, tmp_path):
    folder, result, given, _ = written
    assert album.write_comparison(tmp_path, result, reference(1), lambda done, total: None, jobs=2) == given
    assert everything_in(tmp_path) == everything_in(folder)


def test_titles_say_over_how_many_runs_and_data_sets(written):
    titles = {picture.file: picture.title for picture in written[2]}
    for file in ("gap.png", "cost.png"):
        assert "means over 3 runs on each of 2 data sets, with standard errors" in titles[file]
    for file in ("evidence.png", "ess.png"):
        assert "3 runs on each of 2 data sets" in titles[file]
    for file in ("loop-closure-sir.png", "corridors-sir.png", "map-sir.png"):
        assert "sir (N = 60, run 0 of data set 0)" in titles[file]


def words_of(written, file):
    return next(picture.alt for picture in written[2] if picture.file == file)


def test_the_gap_is_told_with_the_numbers_of_the_summary(written):
    summary = written[1].summary().set_index(["solver", "n_particles"])
    words = words_of(written, "gap.png")
    for name in ("mean_gap", "cov_gap"):
        first, last = (f"{summary.loc[('sir', size), name]:.3g}" for size in (20, 60))
        assert f"sir {first} to {last}, bad not known" in words
    _, needed = theory.predicted_gap(written[1].bootstrap_log_variances, np.array([1.0]))
    assert f"only from N = 10^{needed:.1f} on" in words


def test_evidence_cost_and_health_are_told_for_the_largest_n(written):
    result = written[1]
    row = result.summary().set_index(["solver", "n_particles"]).loc[("sir", 60)]
    values = [record.metrics.log_evidence_gap for record in result.of("sir", 60)]
    assert f"N = 60 the median is sir {np.median(values):.3g}, bad not known" in words_of(written, "evidence.png")
    cost = words_of(written, "cost.png")
    seconds = np.median([record.metrics.seconds for record in result.of("sir", 60)])
    assert f"sir {row['mean_gap']:.3g} in {seconds:.3g} s" in cost
    assert "smallest gap there is that of sir." in cost
    health = words_of(written, "ess.png")
    assert f"sir {row['ess_min']:.3g}, bad not known" in health
    lowest = 10 ** np.median(result.forecasts["sir"], axis=0).min()
    assert f"its smallest ESS/N: sir {lowest:.2g}." in health


def test_loop_closure_is_told_exact_and_estimated(written):
    result, words = written[1], words_of(written, "loop-closure-sir.png")
    exact, estimate = result.exacts[0], result.of("sir", 60)[0].filtered
    closure = loop_closure(result.problems[0], exact)
    assert f"At k = {closure.k} landmark {closure.landmark + 1} is seen again" in words
    before, after = deviations(exact)[closure.k - 1 : closure.k + 1, closure.landmark]
    assert f"exactly from {before:.3g} to {after:.3g} m" in words
    most = max(np.flatnonzero(~closure.in_view), key=lambda i: closure.sharpening[i])
    assert closure.sharpening[most] < closure.sharpening.max()  # one in view sharpens more
    assert f"Of those out of view landmark {most + 1} sharpens most" in words
    spread = deviations(estimate)[closure.k - 1 : closure.k + 1, closure.landmark]
    collapsed = spread <= 1e-6 * before
    told = re.search(r"by estimate from (\S+) to (\S+) m", words).groups()
    np.testing.assert_allclose(np.array(told, float), np.where(collapsed, 0, spread), rtol=0.01)


def test_corridors_and_map_are_told(written):
    result = written[1]
    exact, estimate = result.exacts[0], result.of("sir", 60)[0].filtered
    later = exact.uncertain[1:]
    inside = np.abs(estimate.means - exact.means)[1:][later] <= 3 * exact.stds[1:][later]
    words = words_of(written, "corridors-sir.png")
    assert f"The estimated mean lies inside the exact corridor at {100 * inside.mean():.3g} % of the points" in words
    truth = np.abs(reference(1).truth - exact.means)[1:][later] <= 3 * exact.stds[1:][later]
    assert f"The truth lies inside the exact corridor at {100 * truth.mean():.3g} % of the points" in words
    apart = [np.linalg.norm((estimate.means - exact.means)[-1, i : i + 2]) for i in range(2, 12, 2)]
    assert f"{min(apart):.2g} to {max(apart):.2g} m from the exact ones" in words_of(written, "map-sir.png")


def test_a_loop_that_is_not_closed_has_a_small_figure_that_says_so(tmp_path):
    source = experiment(full_scenario(2, n_steps=4, field_of_view=nothing))
    result = compare(source.problem, {"sir": sir}, n_particles=5, runs=1)
    given = album.write_comparison(tmp_path, result, source, lambda done, total: None)
    closure = next(picture for picture in given if picture.file == "loop-closure-sir.png")
    assert "no loop is closed" in closure.alt
    with Image.open(tmp_path / closure.file) as image:
        assert image.height < 300


def test_one_run_is_no_mean():
    result = compare(experiment(full_scenario(1, n_steps=4)).problem, {"a": bare}, n_particles=[5, 6], runs=1)
    assert captions.gap(result, "g").title == "Gap to the exact moments against N: one run"
    assert "bootstrap" not in captions.gap(result, "g").alt
    assert "forecast made" not in captions.ess(result, "e").alt
    assert "sir" not in captions.cost(result, "c").alt


def test_a_prediction_that_holds_is_told():
    world = experiment(full_scenario(1, 8, n_steps=5), 8).problem
    result = compare(world, {"sir": sir}, n_particles=5000, runs=1)
    gaps, _ = theory.predicted_gap(result.bootstrap_log_variances, np.array([5000.0]))
    assert f"at every step: {gaps[0]:.3g} with N = 5000." in captions.gap(result, "g").alt


def test_the_exact_filter_alone_is_told(written):
    source = reference(1)
    exact = kalman(source.problem)
    picture = captions.corridors(None, exact, None, "kalman", "c.png")
    assert picture.alt.endswith("a panel for each component: kalman.")
    assert captions.final_map(None, exact, "kalman", "m.png").alt == "Map at k = 49 with 99 % ellipses: kalman."
