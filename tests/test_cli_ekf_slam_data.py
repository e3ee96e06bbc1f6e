"""``slam-lab ekf-slam --data``: every kind of data through the command, and what a person gets wrong."""

import json

import numpy as np
import pandas as pd
import pytest
from datasets import MRCLAM, NTNU, VICTORIA_PARK, drive, needs, write_graph, write_mrclam, write_ntnu
from program import call, everything_in, start

from lab.ekfslam import app_data_report, drives
from lab.ekfslam.app import KEYS
from lab.ekfslam.replay import replay
from lab.ekfslam.scores import score
from lab.records import ntnu

TRUTHLESS = ("position_rmse", "position_rmse_aligned", "heading_rmse", "landmark_rmse", "landmark_rmse_aligned")
FILES = {"config.json", "consistency.png", "landmarks.csv", "map.png", "summary.json", "trajectory.csv"}
NOISE = ("--motion-noise", "0.02,0.02,0.005", "--sensor-noise", "0.05,0.02")


@pytest.fixture
def paths(here):
    world = drive(seed=5)
    return {
        "ntnu": write_ntnu(here / "s.mat", world),
        "victoria-park": write_graph(here / "g.txt", world),
        "mrclam": write_mrclam(here / "set", n_robots=2, seconds=15, packed=True),
    }


@pytest.fixture
def no_figures(monkeypatch):
    """Leave out what takes most of the time, where the test is not about it."""
    monkeypatch.setattr(app_data_report, "write_figures", lambda folder, outcome: None)


def summary_of(folder):
    summary = json.loads((folder / "summary.json").read_text(), parse_constant=lambda text: pytest.fail(text))
    assert tuple(summary) == KEYS
    return summary


@pytest.mark.parametrize("filter", ["ekf", "fej", "ri"])
@pytest.mark.parametrize("kind", ["ntnu", "victoria-park", "mrclam"])
def test_every_kind_with_every_filter(here, paths, kind, filter, monkeypatch):
    if filter != "ekf":  # figures take most of the time
        monkeypatch.setattr(app_data_report, "write_figures", lambda folder, outcome: None)
    more = ("--robots", "2") if kind == "mrclam" else ()
    done = call("ekf-slam", "--data", kind, paths[kind], "--filter", filter, "--out", "result", *more)
    assert (done.status, done.err) == (0, "")
    pictures = set() if filter == "ekf" else {"map.png", "consistency.png"}
    assert set(everything_in(here / "result")) == FILES - pictures
    summary = summary_of(here / "result")
    assert summary["filter"] == filter
    assert summary["skipped_lines"] == 0
    assert 0 < summary["landmarks"] <= 8
    assert summary["updates"] > 10
    assert summary["seconds"] > 0
    for name in TRUTHLESS:
        if kind == "victoria-park":
            assert summary[name] is None
        else:
            assert 0 < summary[name] < 1
            assert summary[name] >= summary.get(f"{name}_aligned", 0)
    assert (summary["nees_mean"] is None) == (kind == "victoria-park")
    assert ("no truth" in done.out) == (kind == "victoria-park")


def test_the_summary_holds_the_scores(here, paths, no_figures):
    call("ekf-slam", "--data", "ntnu", paths["ntnu"], "--filter", "fej", *NOISE, "--out", "result").out.index(
        "position"
    )
    recording = drives.from_simulation(ntnu.read(paths["ntnu"]), motion=(0.02, 0.02, 0.005), sensor=(0.05, 0.02))
    run = replay(recording, "fej")
    summary = summary_of(here / "result")
    for name, value in score([(recording, run)]).items():
        assert summary[name] == pytest.approx(value)
    assert (summary["steps"], summary["updates"], summary["landmarks"]) == (60, run.updates, len(run.landmarks))
    poses = pd.read_csv(here / "result" / "trajectory.csv")
    np.testing.assert_allclose(poses[["x", "y", "theta"]], run.poses)
    np.testing.assert_allclose(poses[["true_x", "true_y", "true_theta"]], run.truth)
    points = pd.read_csv(here / "result" / "landmarks.csv")
    np.testing.assert_allclose(points[["x", "y"]], [*run.landmarks.values()])
    np.testing.assert_allclose(points[["true_x", "true_y"]], [recording.landmarks[name] for name in run.landmarks])


def test_the_noise_that_is_told_makes_the_filter(here, paths, no_figures):
    """The course's noise is not that of this world, and the command says so."""
    wrong = call("ekf-slam", "--data", "ntnu", paths["ntnu"], "--sensor-noise", "0.2,0.1", "--out", "a")
    right = call("ekf-slam", "--data", "ntnu", paths["ntnu"], *NOISE, "--out", "b")
    assert summary_of(here / "a")["nis_per_dof"] < 0.5
    assert summary_of(here / "b")["nis_per_dof"] == pytest.approx(1, abs=0.25)
    assert "is larger than that of the data" in wrong.out
    assert "of the data" not in right.out


def test_the_text_form_is_the_same(here, paths, no_figures):
    text = write_ntnu(here / "s.txt", drive(seed=5))
    for path, out in ((paths["ntnu"], "a"), (text, "b")):
        call("ekf-slam", "--data", "ntnu", path, "--out", out)
    one, two = summary_of(here / "a"), summary_of(here / "b")
    assert {**one, "seconds": 0} == {**two, "seconds": 0}


@pytest.mark.parametrize("association", ["nearest", "jcbb"])
def test_association_that_has_to_be_found(here, paths, association):
    done = call("ekf-slam", "--data", "ntnu", paths["ntnu"], "--association", association, *NOISE)
    assert done.status == 0
    assert f"Association {association}: 0 of " in done.out


def test_a_simulation_without_truth_needs_an_association(here):
    path = write_ntnu(here / "s.mat", drive(seed=5), truth=False)
    call("ekf-slam", "--data", "ntnu", path).assert_refused("poseGT", "--association nearest")
    done = call("ekf-slam", "--data", "ntnu", path, "--association", "nearest", *NOISE, "--out", "r")
    assert done.status == 0
    assert [summary_of(here / "r")[name] for name in (*TRUTHLESS, "nees_mean")] == [None] * 6
    assert "Association nearest: no truth to say how often wrong." in done.out


def test_robots_in_one_map_or_apart(here, paths, no_figures):
    base = ("ekf-slam", "--data", "mrclam", paths["mrclam"])
    for options, out in (((), "a"), (("--no-robot-sightings",), "b"), (("--separate",), "c"), (("--robots", "1"), "d")):
        assert call(*base, *options, "--out", out).status == 0
    a, b, c, d = (summary_of(here / out) for out in "abcd")
    assert a["updates"] > b["updates"] > c["updates"] > d["updates"]
    assert d["landmarks"] <= a["landmarks"] == b["landmarks"] < c["landmarks"] <= 10
    assert a["steps"] == b["steps"] > d["steps"]
    assert set(pd.read_csv(here / "a" / "trajectory.csv")["robot"]) == {1, 2}
    assert set(pd.read_csv(here / "c" / "landmarks.csv")["map"]) == {1, 2}
    call(*base, "--filter", "ri").assert_refused("ri", "several robots")
    assert call(*base, "--filter", "ri", "--separate").status == 0


def test_the_delay_and_the_scale_change_the_answer(here, paths, no_figures):
    base = ("ekf-slam", "--data", "mrclam", paths["mrclam"])
    for options, out in (((), "a"), (("--command-delay", "0.3"), "b"), (("--rotation-scale", "0.8"), "c")):
        assert call(*base, *options, "--out", out).status == 0
    plain, late, scaled = (summary_of(here / out)["heading_rmse"] for out in "abc")
    assert late != plain
    assert scaled > 1.5 * plain  # these robots turn as they are told
    call(*base, "--command-delay", "-1").assert_refused("delay", "-1")
    call(*base, "--rotation-scale", "nan").assert_refused("scale", "nan")


def test_a_reference_stands_in_for_the_truth(here, paths):
    world = drive(seed=5)
    from lab.records import victoria_park

    graph = victoria_park.read(paths["victoria-park"])
    # the numbers of the file, in its order of poses and of first sightings
    names = list(dict.fromkeys(np.concatenate(world.names).tolist()))
    lines = [
        f"VERTEX_SE2 {i} {' '.join(map(repr, p.tolist()))}" for i, p in zip(graph.pose_ids, world.poses, strict=False)
    ]
    lines += [
        f"VERTEX_XY {i} {world.landmarks[name][0]} {world.landmarks[name][1]}"
        for i, name in zip(graph.landmark_ids, names, strict=True)
    ]
    (here / "best.g2o").write_text("\n".join([*lines, "EDGE_SE2 1 2 3", "VERTEX_XY x 1 2"]))
    base = ("ekf-slam", "--data", "victoria-park", paths["victoria-park"])
    done = call(*base, "--reference", "best.g2o", "--out", "r")
    assert done.status == 0
    assert "Errors are against best.g2o" in done.out
    assert "Lines left out: 1 malformed in the reference (first: best.g2o:" in done.out
    summary = summary_of(here / "r")
    assert summary["skipped_lines"] == 1
    assert 0 < summary["position_rmse_aligned"] <= summary["position_rmse"] < 0.3
    assert 0 < summary["landmark_rmse_aligned"] <= summary["landmark_rmse"] < 0.3
    assert summary["nees_mean"] is None
    (here / "empty.g2o").write_text("EDGE_SE2 1 2 3\n")
    call(*base, "--reference", "empty.g2o").assert_refused("empty.g2o", "no value")
    call(*base, "--reference", "nowhere").assert_refused("nowhere", "does not exist")


def test_what_was_left_out_is_told(here, paths, no_figures):
    with paths["victoria-park"].open("a") as file:
        file.write("LANDMARK 0 1\nWORD\n")
    done = call("ekf-slam", "--data", "victoria-park", paths["victoria-park"], "--out", "r")
    assert "Lines left out: 1 malformed (first: g.txt:" in done.out
    assert "Lines left out: 1 unknown tag WORD (first: g.txt:" in done.out
    assert summary_of(here / "r")["skipped_lines"] == 2


def test_config_repeats_the_command(here, paths, no_figures):
    options = ("--separate", "--no-robot-sightings", "--command-delay", "0.2", "--robots", "2,1", "--filter", "fej")
    call("ekf-slam", "--data", "mrclam", "set", *options, "--out", "a")
    config = json.loads((here / "a" / "config.json").read_text())
    assert set(config["inputs"]) >= {"Barcodes.dat.gz", "Robot1_Odometry.dat.gz"}
    assert config["arguments"]["data"] == ["mrclam", "set"]
    words = config["repeat"].split()
    assert words[:5] == ["slam-lab", "ekf-slam", "--data", "mrclam", "set"]
    assert {"--separate", "--no-robot-sightings", "--robots=2,1", "--filter=fej"} <= set(words)
    assert call(*words[1:], "--out", "b").status == 0
    assert {**summary_of(here / "a"), "seconds": 0} == {**summary_of(here / "b"), "seconds": 0}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--data", "ntnu", "nowhere.mat"), ["nowhere.mat does not exist"]),
        (("--data", "ntnu", "set"), ["set", "ends in .mat or .txt"]),
        (("--data", "ntnu", ""), ["empty"]),
        (("--data", "mrclam", "nowhere"), ["nowhere does not exist", "folder"]),
        (("--data", "mrclam", "s.mat"), ["s.mat is a file"]),
        (("--data", "victoria-park", "set"), ["set is a folder"]),
        (("--data", "victoria-park", "s.mat"), ["s.mat is no text file"]),
        (("--data", "kitti", "s.mat"), ["Unknown kind of data 'kitti'", "mrclam, victoria-park, ntnu"]),
        (("--data", "ntnu", "s.mat", "--filter", "ukf"), ["Unknown filter 'ukf'"]),
        (("--data", "ntnu", "s.mat", "--association", "guess"), ["Unknown association 'guess'"]),
        (("--data", "ntnu", "s.mat", "--sensor-noise", "1"), ["--sensor-noise takes 2 positive numbers"]),
        (("--data", "ntnu", "s.mat", "--motion-noise", "1,0,1"), ["--motion-noise takes 3 positive numbers"]),
        (("--data", "ntnu", "s.mat", "--robots", "1"), ["--robots belongs to --data mrclam"]),
        (("--data", "ntnu", "s.mat", "--runs", "3"), ["--runs belongs to the cloister"]),
        (("--data", "ntnu", "s.mat", "--perturb", "truth"), ["--perturb belongs to the cloister"]),
        (("--data", "mrclam", "set", "--association", "nearest"), ["--association", "mrclam names what it saw"]),
        (("--data", "mrclam", "set", "--robots", "1,x"), ["--robots takes numbers"]),
        (("--data", "mrclam", "set", "--robots", "1,7"), ["no robot 7: there are 1, 2"]),
        (("--data", "mrclam", "set", "--reference", "g.txt"), ["--reference belongs to --data victoria-park"]),
        (("--robots", "1"), ["--robots belongs to --data mrclam"]),
        (("--separate",), ["--separate belongs to --data mrclam"]),
    ],
)
def test_what_cannot_be_done_is_one_sentence(here, arguments, words):
    world = drive(steps=3)
    write_ntnu(here / "s.mat", world)
    write_graph(here / "g.txt", world)
    write_mrclam(here / "set", seconds=1)
    before = everything_in(here)
    call("ekf-slam", *arguments, "--out", "new/result").assert_refused(*words)
    assert everything_in(here) == before


def test_a_kind_without_a_path(here):
    call("ekf-slam", "--data", "ntnu").assert_refused("--data", "2 arguments")


def test_a_filter_that_breaks_down_is_one_sentence(here, paths, monkeypatch):
    from lab.ekfslam.map import Map

    def broken(self, *observations):
        raise np.linalg.LinAlgError("not positive definite")

    monkeypatch.setattr(Map, "correct", broken)
    done = call("ekf-slam", "--data", "ntnu", paths["ntnu"], "--out", "r")
    done.assert_refused("ekf broke down after step", "of 60", "nothing is written", status=1)
    assert not (here / "r").exists()


def test_as_a_process(here, paths):
    done = start("ekf-slam", "--data", "ntnu", "s.mat", "--filter", "ri", "--out", "r", cwd=here)
    assert (done.status, done.err) == (0, "")  # no bar where there is no terminal
    assert set(everything_in(here / "r")) == FILES


@pytest.mark.long
@pytest.mark.parametrize(
    "arguments",
    [
        pytest.param(("ntnu", NTNU, "--filter", "ri"), marks=needs(NTNU)),
        pytest.param(("victoria-park", VICTORIA_PARK, "--filter", "fej"), marks=needs(VICTORIA_PARK)),
        pytest.param(("mrclam", MRCLAM, "--robots", "1,2,3,4,5"), marks=needs(MRCLAM)),
    ],
)
def test_the_third_party_data(here, arguments):
    done = start("ekf-slam", "--data", *arguments, "--out", "r", cwd=here)
    assert (done.status, done.err) == (0, "")
    assert summary_of(here / "r")["landmarks"] == {"ntnu": 78, "victoria-park": 151, "mrclam": 15}[arguments[0]]
