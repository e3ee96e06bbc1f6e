"""``slam-lab ekf-slam`` as a person meets it, and its figures by what their artists say."""

import json
import re
import shlex

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from PIL import Image
from program import call, everything_in

from lab.ekfslam import app, app_report, demo
from lab.ekfslam.consistency import assess
from lab.ekfslam.uncertainty import cov2elli
from lab.ekfslam.world import drive
from lab.gaussian import chi2_band
from lab.plots import legend_below, live, new_figure
from lab.plots.slam import draw_consistency, draw_heading, draw_run, save_animation
from lab.validation import InputError

STEPS = 12


@pytest.fixture(autouse=True)
def _no_global_state():
    yield
    assert plt.get_fignums() == []


def short(rng, sensor):
    return drive(rng, sensor=sensor, steps=STEPS)


@pytest.fixture(scope="module")
def run():
    return demo.run("ri", seed=1, world=short, frames=True)


@pytest.fixture
def quick(monkeypatch):
    """Short drives, so that a command takes a second."""
    monkeypatch.setattr(
        demo, "drive", lambda rng, *, sensor, perturb: drive(rng, sensor=sensor, steps=STEPS, perturb=perturb)
    )


def test_the_command(here, quick):
    done = call("ekf-slam", "--filter", "ri", "--runs", 3, "--seed", 5, "--out", "result")
    assert (done.status, done.err) == (0, "")
    assert done.out.startswith(f"ri, range-bearing, association known: 3 worlds of {STEPS} steps\n")
    assert re.search(r"position RMSE \[m\] +0\.\d{4} \(0\.\d{4}\) +0\.\d{4}", done.out)
    assert re.search(r"NEES of the pose, last 20 steps +\d+\.\d\d", done.out)
    low, high = chi2_band(3, 3)
    assert f"{low:.2f} to {high:.2f}" in done.out
    assert re.search(r"^ri: (consistent|too sure|too cautious)", done.out, re.MULTILINE)
    files = ["config.json", "consistency.png", "heading.png", "map.png", "runs.csv", "summary.json"]
    assert sorted(file.name for file in (here / "result").iterdir()) == files
    for name in files:
        if name.endswith(".png"):
            with Image.open(here / "result" / name) as image:
                assert len(image.text["Description"]) > 30
    config = json.loads((here / "result" / "config.json").read_text())
    words = shlex.split(config["repeat"])
    assert words[:2] == ["slam-lab", "ekf-slam"]
    again = call(*words[1:], "--out", "again")
    assert again.out.replace("again", "result") == done.out
    first, second = (pd.read_csv(here / name / "runs.csv") for name in ("result", "again"))
    pd.testing.assert_frame_equal(first, second)


def test_the_number_of_workers_changes_nothing():
    found = app.demo("ekf", runs=2, seed=3, jobs=2)
    assert len(found.runs[0].frames) == 200
    assert found.runs[1].frames == []
    alone = demo.run("ekf", seed=found.seeds[1])
    np.testing.assert_array_equal(alone.r, found.runs[1].r)
    np.testing.assert_array_equal(alone.nees, found.runs[1].nees)


def test_the_listings_worlds_have_one_truth(quick):
    found = app.demo("ekf", runs=2, perturb="estimator")
    np.testing.assert_array_equal(*(each.drive.truth for each in found.runs))
    assert (found.runs[0].drive.u != found.runs[1].drive.u).any()


def test_the_summary(here, quick):
    call("ekf-slam", "--runs", 2, "--out", "result")
    summary = json.loads((here / "result" / "summary.json").read_text())
    assert [*summary] == [
        *("filter", "steps", "landmarks", "updates", "position_rmse", "position_rmse_aligned", "heading_rmse"),
        *("landmark_rmse", "landmark_rmse_aligned", "nees_mean", "nis_per_dof", "skipped_lines", "seconds"),
    ]
    assert (summary["filter"], summary["steps"], summary["landmarks"]) == ("ekf", STEPS, STEPS)
    table = pd.read_csv(here / "result" / "runs.csv")
    for name in ("position_rmse", "landmark_rmse_aligned", "heading_rmse", "updates"):
        assert summary[name] == pytest.approx(table[name].mean())
    one = demo.run("ekf", seed=int(table["seed"][1]), world=short)
    assert np.sqrt(np.mean(one.errors[1:] ** 2)) == pytest.approx(table["position_rmse"][1])


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("--filter", "ukf"), "Unknown filter 'ukf'; known are ekf, fej, ri"),
        (("--sensor", "radar"), "Unknown sensor 'radar'; known are range-bearing, bearing, range"),
        (("--association", "guess"), "Unknown association 'guess'"),
        (("--filter", "fej", "--sensor", "bearing"), "fej is not implemented for landmarks by inverse depth; use ekf"),
        (("--filter", "ri", "--sensor", "bearing"), "ri is not implemented for landmarks by inverse depth; use ekf"),
        (("--filter", "fej", "--sensor", "range"), "fej is not implemented for rings of range-only landmarks; use ekf"),
        (("--sensor", "range", "--association", "jcbb"), "with range it must be known"),
        (("--perturb", "nobody"), "--perturb must be truth or estimator, not 'nobody'"),
        (("--runs", "0"), "--runs must be at least 1, not 0"),
        (("--runs", "many"), "valid integer"),
        (("--seed", "-1"), "--seed must be at least 0, not -1"),
        (("--jobs", "0"), "--jobs must be at least 1"),
        (("--live",), "No screen is found here; --animate FILE.gif saves the animation instead."),
        (("--animate", "film.avi"), "film.avi: the file of the animation ends in .gif or .mp4"),
        (("--animate", "absent/film.gif"), "absent/film.gif cannot be written"),
        (("--out", ""), "the name is empty"),
    ],
)
def test_bad_input(here, arguments, word):
    call("ekf-slam", *arguments).assert_refused(word)
    assert everything_in(here) == {}


def test_nothing_half_written_when_the_work_fails(here, quick, monkeypatch):
    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(app_report, "write_figures", stop)
    done = call("ekf-slam", "--runs", 1, "--out", "result", "--animate", "film.gif")
    assert done.status == 130
    assert everything_in(here) == {}


def test_words_without_a_whole_map(quick):
    found = app.demo("ekf", runs=2)
    assert "In 2 of 2 runs not all 36 landmarks are in the map at the end." in app_report.words(found)


def test_numbers_that_are_not_there_are_null():
    assert app.plain(float("nan")) is None
    assert app.plain(36.0) == 36
    assert isinstance(app.plain(36.0), int)
    assert app.plain(0.5) == 0.5


@pytest.mark.parametrize("ending", ["gif"])
def test_the_animation(run, tmp_path, ending):
    path = tmp_path / f"film.{ending}"
    save_animation(run, path)
    with Image.open(path) as film:
        assert film.n_frames == STEPS
    with pytest.raises(InputError, match=r"\.gif or \.mp4"):
        save_animation(run, tmp_path / "film.png")


# figures


def test_the_live_map(run):
    figure = new_figure(7, 9)
    update = draw_run(figure, run)
    top, bottom = figure.axes
    for k in (3, STEPS):
        update(k)
        frame = run.frames[k - 1]
        lines = {line.get_label(): line for line in top.lines}
        np.testing.assert_array_equal(lines["true landmark"].get_xydata(), run.drive.W)
        np.testing.assert_array_equal(lines["estimated landmark"].get_xydata(), frame.points)
        np.testing.assert_allclose(
            lines["robot's 3-sigma ellipse"].get_xydata(), cov2elli(frame.r[:2], frame.P[:2, :2], 3)
        )
        (ellipses,) = [c for c in top.collections if isinstance(c, LineCollection)]
        segments = ellipses.get_segments()
        assert len(segments) == k
        np.testing.assert_allclose(segments[0], cov2elli(frame.points[0], frame.covs[0], 3))
        assert segments[0].shape == (17, 2)
        ahead = lines["estimated robot"].get_xydata()[0] - frame.r[:2]
        assert np.arctan2(*ahead[::-1]) == pytest.approx(frame.r[2])
        ahead = lines["true robot"].get_xydata()[0] - run.drive.truth[k, :2]
        assert np.arctan2(*ahead[::-1]) == pytest.approx(run.drive.truth[k, 2])
        assert f"step {k} of {STEPS}, {k} landmarks" in top.get_title()
        (now,) = [line for line in bottom.lines if line.get_label() == "now"]
        assert now.get_xdata()[0] == k
    colours = {name: to_hex(line.get_color()) for name, line in lines.items()}
    assert colours["true landmark"] == colours["true robot"] == to_hex("red")
    assert colours["estimated landmark"] == colours["estimated robot"] == to_hex("blue")
    assert colours["robot's 3-sigma ellipse"] == to_hex("magenta")
    assert to_hex(ellipses.get_color()[0]) == to_hex("green")
    assert top.get_xlim() == top.get_ylim() == (-6, 6)
    figure.draw_without_rendering()
    assert not figure.legends[0].get_window_extent().overlaps(bottom.get_tightbbox())


def test_the_window(run, monkeypatch):
    monkeypatch.setattr("lab.plots.live.require_screen", lambda: None)
    shown = []

    def look():
        figure = plt.gcf()
        figure.canvas.draw()
        shown.append([ax.get_xlabel() for ax in figure.axes])

    monkeypatch.setattr(plt, "show", look)
    live.show_run(run)
    assert shown == [["$x$ [m]", "instant $k$ [-]"]]
    assert not plt.get_fignums()


def test_rings_are_drawn():
    ranging = demo.run("ri", seed=1, sensor="range", world=short, frames=True)
    figure = new_figure(7, 9)
    draw_run(figure, ranging)(2)
    (dots,) = [line for line in figure.axes[0].lines if line.get_label() == "hypothesis of a ring"]
    np.testing.assert_array_equal(dots.get_xydata(), ranging.frames[1].hypotheses)
    assert len(dots.get_xydata()) > 24


def test_a_run_without_frames_is_not_drawn():
    with pytest.raises(InputError, match="frames=True"):
        draw_run(new_figure(3, 3), demo.run("ekf", world=short))


def test_consistency_in_two_panels(run):
    figure = new_figure(10, 4.4)
    axes = figure.subplots(1, 2)
    found = assess([run, run])
    draw_consistency(list(axes), {"ri": found}, 2)
    legend_below(figure, *axes)
    (curve,) = [line for line in axes[0].lines if line.get_label() == "ri"]
    np.testing.assert_array_equal(curve.get_ydata(), run.nees)
    (curve,) = [line for line in axes[1].lines if line.get_label() == "ri"]
    np.testing.assert_allclose(curve.get_ydata()[2:], run.nis[2:] / run.dof[2:])
    (band,) = axes[0].patches
    assert (band.get_y(), band.get_y() + band.get_height()) == pytest.approx(chi2_band(3, 2))
    for ax in axes:
        assert re.search(r"\[-\]$", ax.get_ylabel())
        assert re.search(r"\[-\]$", ax.get_xlabel())


def test_the_gauge_in_a_picture(run):
    figure = new_figure(7, 4)
    ax = draw_heading(figure.subplots(), {"ri": run.heading_std}, 0.02)
    curve, floor = ax.lines
    np.testing.assert_array_equal(curve.get_ydata(), run.heading_std)
    assert set(floor.get_ydata()) == {0.02}
    assert ax.get_ylabel().endswith("[rad]")
