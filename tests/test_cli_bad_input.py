"""Whatever cannot be used is one sentence and status 2, and nothing is written."""

import json
import os

import numpy as np
import pytest
import scipy.io
from program import call, everything_in
from worlds import REFERENCE

import lab.work
from lab.problem import Experiment
from lab.solvers import SOLVERS

QUICK = ("--solvers", "sis", "--particles", "5", "--runs", "1")


def variables():
    read = scipy.io.loadmat(REFERENCE / "experiment_1.mat")
    return {name: value for name, value in read.items() if not name.startswith("__")}


def changed(name, entry, *values):
    """Return a variable of the reference experiment with some entries replaced."""
    array = variables()[name].copy()
    for index, value in zip(entry, values, strict=True):
        array[index] = value
    return array


def off_diagonal(name, value):
    return changed(name, [(0, 1), (1, 0)] if name == "Qw" else [(3, 4), (4, 3)], value, value)


def cell():
    array = np.empty((1, 2), dtype=object)
    array[:] = 1.0
    return array


BAD_MAT_FILES = {
    "a missing variable": ({"Z": None}, "the variable Z is missing"),
    "missing variables": ({"F": None, "Qw": None}, "the variables F and Qw are missing"),
    "no measurement matrix": ({"arrayH": None, "Hfull": None}, "arrayH or Hfull"),
    "too few rows": ({"Z": variables()["Z"][:9]}, "Z has shape (9, 50)"),
    "time first": ({"Z": variables()["Z"].T}, "Z has shape (50, 10)"),
    "another shape of F": ({"F": np.eye(11)}, "F must have shape (12, 12), not (11, 11)"),
    "another shape of X": ({"X": variables()["X"].T}, "X must have shape (12, 50), not (50, 12)"),
    "another number of landmarks": ({"M": 4.0}, "does not fit M = [4.0]"),
    "nothing but NaN": ({"Z": np.full((10, 50), np.nan)}, "NaN throughout"),
    "a measurement at k = 0": ({"Z": np.zeros((10, 50))}, "z must be NaN at k = 0"),
    "NaN in F": ({"F": np.full((12, 12), np.nan)}, "F must be finite"),
    "P0 not symmetric": ({"PX0": changed("PX0", [(3, 4)], 0.1)}, "PX0 is not symmetric: entry (3, 4) is 0.1"),
    "Q not symmetric": ({"Qw": changed("Qw", [(0, 1)], 0.01)}, "Qw is not symmetric"),
    "R not symmetric": ({"arrayR": changed("arrayR", [(..., 1)], np.triu(np.ones((10, 10))))}, "R at k = 1 is not sym"),
    "P0 with a negative variance": ({"PX0": changed("PX0", [(3, 3)], -1.0)}, "PX0 is not positive semidefinite"),
    "P0 not PSD": ({"PX0": off_diagonal("PX0", 0.3)}, "PX0 is not positive semidefinite"),
    "Q not PSD": ({"Qw": off_diagonal("Qw", 0.3)}, "Qw is not positive semidefinite"),
    "R not PSD": ({"arrayR": -variables()["arrayR"]}, "R at k = 1 is not positive semidefinite"),
    "R of zeros": ({"arrayR": 0 * variables()["arrayR"]}, "positive definite"),
    "text": ({"F": "identity"}, "F must hold real numbers"),
    "complex numbers": ({"Z": variables()["Z"] * 1j}, "Z must hold real numbers"),
    "a cell array": ({"mX0": cell()}, "mX0 must hold real numbers"),
    "a structure": ({"Qw": {"a": 1.0}}, "Qw must hold real numbers"),
}


@pytest.mark.parametrize("case", BAD_MAT_FILES)
@pytest.mark.parametrize("program", [("compare", *QUICK), ("run", "sir")], ids=["compare", "run"])
def test_mat_files(here, case, program):
    changes, words = BAD_MAT_FILES[case]
    all_variables = variables() | changes
    kept = {name: value for name, value in all_variables.items() if value is not None}
    scipy.io.savemat(here / "bad.mat", kept)
    before = everything_in(here)
    done = call(*program, "--experiment", "bad.mat", "--out", "result")
    done.assert_refused(words)
    assert "bad.mat" in done.err or "positive definite" in words  # which comes from trying the solver
    assert everything_in(here) == before
    assert not (here / "result").exists()


HDF = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Jan  1 00:00:00 2024 HDF5 schema 1.00 .".ljust(124)
HDF += b"\x00\x02IM" + bytes(384) + b"\x89HDF\r\n\x1a\n" + bytes(500)
WHOLE = (REFERENCE / "experiment_1.mat").read_bytes()

BAD_BYTES = {
    "text.mat": (b"These are no matrices.\n" * 20, "damaged, or not a .mat file"),
    "empty.mat": (b"", "damaged, or not a .mat file"),
    "new.mat": (HDF, "-v7.3 file"),
    "cut.mat": (WHOLE[: len(WHOLE) // 2], "cannot be read"),
    "cut-in-the-header.mat": (WHOLE[:60], "damaged, or not a .mat file"),
    "text.npz": (b"hello", "damaged, or not a .npz file"),
    "empty.npz": (b"", "damaged, or not a .npz file"),
    "data.csv": (b"1,2,3", "ends in .mat or .npz"),
    "data": (b"1,2,3", "ends in .mat or .npz"),
}


@pytest.mark.parametrize("name", BAD_BYTES)
def test_files_of_another_kind(here, name):
    data, words = BAD_BYTES[name]
    (here / name).write_bytes(data)
    call("compare", *QUICK, "--experiment", name, "--out", "result").assert_refused(name, words)
    assert everything_in(here) == {name: data}


def test_npz_files(here):
    Experiment.load(REFERENCE / "experiment_1.mat").save("good.npz")
    fields = dict(np.load("good.npz"))
    whole = (here / "good.npz").read_bytes()
    (here / "cut.npz").write_bytes(whole[: len(whole) // 2])
    np.savez("pickled.npz", **fields | {"F": np.array([{}, 1], dtype=object)})
    np.savez("lacking.npz", F=fields["F"])
    np.savez("text.npz", **fields | {"F": fields["F"].astype(str)})
    np.savez("turned.npz", **fields | {"z": fields["z"].T})
    for name, words in (
        ("cut", "damaged, or not a .npz file"),
        ("pickled", "damaged, or not a .npz file"),
        ("lacking", "is not an experiment: it has no B, Q"),
        ("text", "F must hold real numbers"),
        ("turned", "z must have shape (any, 10), not (10, 50)"),
    ):
        call("compare", *QUICK, "--experiment", f"{name}.npz").assert_refused(f"{name}.npz", words)


@pytest.mark.parametrize("name", ["none.mat", "none.npz", "folder.mat", "folder"])
def test_files_that_are_not_there(here, name):
    (here / "folder.mat").mkdir()
    (here / "folder").mkdir()
    words = {"folder": "ends in", "folder.mat": "is a folder, not a file"}.get(name, "does not exist")
    call("compare", *QUICK, "--experiment", name).assert_refused(name, words)
    call("run", "kalman", "--experiment", name).assert_refused(name, words)


KNOWN = ", ".join(SOLVERS)

BAD_OPTIONS = {
    "unknown solver": (("--solvers", "sir,nosuch"), f"Unknown solver 'nosuch'; known are {KNOWN}"),
    "kalman as a solver": (("--solvers", "kalman"), "it always runs"),
    "kalman under a label": (("--solvers", "exact=kalman"), "it always runs"),
    "nothing between commas": (("--solvers", "sir,"), "--solvers has an empty entry"),
    "no solver": (("--solvers", ""), "--solvers has an empty entry"),
    "unknown option": (("--solvers", "sir:threshold=1"), "its options are ess_threshold, resample"),
    "bad value": (("--solvers", "sis,sir:ess_threshold=2"), "sir:ess_threshold=2: ess_threshold must lie between"),
    "text for a number": (("--solvers", "sir:ess_threshold=high"), "ess_threshold must hold real numbers"),
    "unknown scheme": (("--solvers", "sir:resample=fair"), "known are systematic, stratified, residual, multinomial"),
    "an option twice": (("--solvers", "sir:resample=residual:resample=residual"), "given twice"),
    "particles as an option": (("--solvers", "sir:n_particles=5"), "--particles sets it"),
    "a label twice": (("--solvers", "sis,sis"), "Two solvers are called 'sis'; give one another label"),
    "two under one label": (("--solvers", "a=sis,a=sir"), "Two solvers are called 'a'"),
    "no particles": (("--particles", "0"), "must be at least 1, not 0"),
    "negative particles": (("--particles", "100,-5"), "must be at least 1, not -5"),
    "particles in words": (("--particles", "abc"), "whole numbers, separated by commas, not 'abc'"),
    "empty particles": (("--particles", ""), "whole numbers, separated by commas, not ''"),
    "a comma too many": (("--particles", "100,"), "whole numbers, separated by commas, not ''"),
    "parts of a particle": (("--particles", "2.5"), "whole numbers, separated by commas, not '2.5'"),
    "no runs": (("--runs", "0"), "runs must be at least 1, not 0"),
    "runs in words": (("--runs", "many"), "'--runs'"),
    "negative seed": (("--seed", "-1"), "seed must be at least 0, not -1"),
    "no jobs": (("--jobs", "0"), "jobs must be at least 1, or -1"),
    "negative jobs": (("--jobs", "-2"), "jobs must be at least 1, or -1"),
    "unknown scenario": (("--scenario", "mars"), "Unknown scenario 'mars'; known are handout, two-landmarks"),
    "empty scenario": (("--scenario", ""), "Unknown scenario ''"),
    "two sources": (("--scenario", "handout", "--experiment", "e.mat"), "either --experiment or --scenario"),
    "negative noise": (("--landmark-noise", "-1"), "must not be negative"),
    "infinite noise": (("--landmark-noise", "inf"), "must be finite"),
    "enormous noise": (("--landmark-noise", "1e200"), "--landmark-noise is too large"),
    "noise in words": (("--landmark-noise", "some"), "'--landmark-noise'"),
    "empty experiment": (("--experiment", ""), "'--experiment': the name is empty"),
    "empty folder": (("--out", ""), "'--out': the name is empty"),
    "unknown command option": (("--particle", "5"), "No such option"),
    "an option without value": (("--particles",), "requires an argument"),
    "a word too many": (("100",), "unexpected extra argument"),
}


@pytest.mark.parametrize("case", BAD_OPTIONS)
def test_options_of_compare(here, case):
    arguments, words = BAD_OPTIONS[case]
    out = () if "--out" in arguments else ("--out", "result")
    call("compare", *out, *arguments).assert_refused(words)
    assert os.listdir(here) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("run",), "Missing argument 'SOLVER'"),
        (("run", "nosuch"), f"Unknown solver 'nosuch'; known are kalman, {KNOWN}"),
        (("run", "kalman:q=1"), "kalman has no options"),
        (("run", "sir,sis"), "Cannot read 'sir,sis'"),
        (("run", "sir", "--particles", "0"), "must be at least 1, not 0"),
        (("run", "sir", "--particles", "10,20"), "'--particles'"),
        (("run", "sir", "--run", "-1"), "--run must be at least 0"),
        (("run", "sir", "--seed", "-1"), "--seed must be at least 0"),
        (("run", "sir", "--experiment", REFERENCE / "experiment_1.mat", "--seed", "-1"), "--seed must be at least 0"),
        (("simulate", "--scenario", "mars"), "known are handout, two-landmarks"),
        (("simulate", "--seed", "-1"), "--seed must be at least 0"),
        (("simulate", "--out", "e.txt"), "e.txt: the file of an experiment ends in .npz or .mat"),
        (("simulate", "--out", "no/e.npz"), "no/e.npz cannot be written: No such file"),
        (("simulate", "--animate", "e.png"), "e.png: the file of the animation ends in .gif or .mp4"),
        (("simulate", "--animate", "no/e.gif"), "no/e.gif cannot be written: No such file"),
        (("simulate", "--out", "e.npz", "--animate", "no/e.gif"), "no/e.gif cannot be written"),
        (("simulate", "--out", ""), "'--out': the name is empty"),
        (("nosuch",), "No such command 'nosuch'"),
        (("--nosuch",), "No such option"),
    ],
)
def test_the_other_commands(here, arguments, words):
    call(*arguments).assert_refused(words)
    assert os.listdir(here) == []


def test_an_animation_that_fails_takes_the_experiment_with_it(here, monkeypatch):
    def no_ffmpeg(*_, **__):
        raise RuntimeError("an .mp4 needs the program ffmpeg")

    monkeypatch.setattr("data_simulation.animate", no_ffmpeg)
    call("simulate", "--out", "e.npz", "--animate", "e.mp4").assert_refused("e.mp4: an .mp4 needs the program ffmpeg")
    assert os.listdir(here) == []


@pytest.mark.parametrize("program", [("compare", *QUICK), ("run", "sir", "--particles", "5")], ids=["compare", "run"])
@pytest.mark.parametrize(
    ("folder", "words"),
    [
        ("file", "The folder file cannot be written to: File exists"),
        ("file/in/it", "cannot be written to: Not a directory"),
        ("made/" + "x" * 300, "cannot be written to: File name too long"),
    ],
)
def test_folders_that_cannot_be_written(here, program, folder, words, monkeypatch):
    """It is said before the work."""
    monkeypatch.setattr(lab.work.Work, "__call__", None)
    (here / "file").write_text("mine")
    call(*program, "--out", folder).assert_refused(words)
    assert os.listdir(here) == ["file"]
    assert (here / "file").read_text() == "mine"


@pytest.mark.usefixtures("no_pictures")
def test_a_second_result_in_the_same_folder_replaces_the_first(here):
    call("compare", *QUICK, "--solvers", "sis,old=sir", "--out", "result")
    (here / "result" / "mine.txt").write_text("mine")
    assert (here / "result" / "map-old.png").exists()
    call("compare", *QUICK, "--solvers", "sis", "--seed", "1", "--out", "result")
    ours = json.loads((here / "result" / "config.json").read_text())["files"]
    assert {*everything_in(here / "result")} == {*ours, "mine.txt"}
    assert {"corridors-sis.png", "report.html", "runs.csv"} <= {*ours}
    assert not [name for name in ours if "old" in name]
    assert "old" not in (here / "result" / "runs.csv").read_text()
    call("run", "kalman", "--out", "result")
    names = ["config.json", "corridors.png", "experiment.npz", "map.png", "mine.txt", "moments.csv"]
    assert sorted(everything_in(here / "result")) == names


@pytest.mark.parametrize("text", ['{"files": ["mine.txt"]}', '{"repeat": 3}', "[]", "no JSON at all", "\xff"])
def test_the_config_of_another_program_is_left_alone(here, text):
    (here / "mine.txt").write_text("mine")
    (here / "config.json").write_bytes(text.encode("latin-1"))
    before = everything_in(here)
    call("compare", *QUICK, "--out", ".").assert_refused("holds a config.json that is not ours")
    assert everything_in(here) == before


@pytest.mark.usefixtures("no_pictures")
def test_a_config_that_lists_files_elsewhere_does_not_reach_them(here):
    call("run", "kalman", "--out", "result")
    config = json.loads((here / "result" / "config.json").read_text())
    (here / "mine.txt").write_text("mine")
    config["files"] += ["../mine.txt", str(here / "mine.txt")]
    (here / "result" / "config.json").write_text(json.dumps(config))
    assert call("run", "kalman", "--out", "result").status == 0
    assert (here / "mine.txt").read_text() == "mine"


@pytest.mark.usefixtures("no_pictures")
def test_a_folder_in_the_place_of_a_file(here):
    (here / "result" / "runs.csv").mkdir(parents=True)
    done = call("compare", *QUICK, "--out", "result")
    assert done.status == 2
    assert done.err == "slam-lab: The folder result holds a folder runs.csv where a file of the result belongs.\n"
    assert sorted(os.listdir(here / "result")) == ["runs.csv", "unfinished"]
    (here / "result" / "runs.csv").rmdir()
    assert call("compare", "--resume", "--out", "result").status == 0
    assert (here / "result" / "runs.csv").is_file()


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize("earlier", [True, False])
@pytest.mark.parametrize(
    ("where", "error", "status"),
    [
        ("lab.work.Work.__call__", KeyboardInterrupt(), 130),
        ("lab.work.Work.__call__", OSError(28, "No space left on device"), 2),
        ("lab.cli.album.write_comparison", KeyboardInterrupt(), 130),
        ("lab.cli.album.write_comparison", OSError(28, "No space left on device"), 2),
        ("lab.cli.album.write_comparison", ZeroDivisionError("a mistake of ours"), None),
    ],
)
def test_only_finished_runs_are_left_after_an_error(here, monkeypatch, where, error, status, earlier):
    """Nor is an earlier result touched."""

    def fail(*_, **__):
        raise error

    if earlier:
        call("compare", *QUICK, "--out", "deep/result")
    before = everything_in(here)
    monkeypatch.setattr(where, fail)
    if status is None:
        with pytest.raises(ZeroDivisionError):
            call("compare", *QUICK, "--out", "deep/result")
    else:
        done = call("compare", *QUICK, "--out", "deep/result")
        assert done.status == status
        assert done.err.count("\n") == 1
        assert done.err.startswith("slam-lab: ")
    kept = {name for name in everything_in(here) if name.startswith("deep/result/unfinished/")}
    assert {name: text for name, text in everything_in(here).items() if name not in kept} == before
    if where.startswith("lab.work"):
        assert not kept
        assert os.listdir(here) == (["deep"] if earlier else [])
    else:
        assert len(kept) == 2
        if isinstance(error, KeyboardInterrupt):
            assert "stopped; all 1 runs are finished and kept" in done.err


@pytest.mark.parametrize("command", ["compare", "run"])
def test_a_solver_that_is_interrupted(here, monkeypatch, command):
    sis = SOLVERS["sis"]

    def interrupted(problem, rng, *, n_particles, backend="numpy"):
        if n_particles > 1:  # the first call only tries the options
            raise KeyboardInterrupt
        return sis(problem, rng, n_particles=n_particles)

    monkeypatch.setitem(SOLVERS, "sis", interrupted)
    arguments = QUICK if command == "compare" else ("sis",)
    done = call(command, *arguments, "--out", "result")
    assert done == (130, "", "slam-lab: stopped; no half-written result remains.\n")
    assert os.listdir(here) == []
