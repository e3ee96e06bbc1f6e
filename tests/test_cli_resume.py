"""A comparison that is stopped and goes on: kill -9, Ctrl-C, workers that die, and what is said of it."""

import json
import os
import re
import signal
import subprocess
import time
from pathlib import Path

import pandas as pd
import pytest
from program import call, command, everything_in, interruptible, start

from lab.records.files import exclusive
from lab.solvers import resolve
from lab.validation import InputError

posix = pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")

# runs 2 and 3 wait for a file, so that the comparison can be stopped between
PATIENT = """
import pathlib, time
from lab.solvers import sir

def patient(problem, rng, *, n_particles):
    answer = sir(problem, rng, n_particles=n_particles)
    with open("begun", "a") as file:
        file.write("x")
    if pathlib.Path("begun").stat().st_size > 2:
        while not pathlib.Path("go").exists():
            time.sleep(0.02)
    return answer
"""
DEADLY = """
import os, pathlib, signal
from lab.solvers import sir

def deadly(problem, rng, *, n_particles):
    if n_particles == 20 and not pathlib.Path("go").exists():
        os.kill(os.getpid(), signal.SIGKILL)
    return sir(problem, rng, n_particles=n_particles)
"""
GIVEN = ("compare", "--scenario", "two-landmarks", "--particles", "20", "--runs", "4")


def finished(folder):
    return sum(
        text.count(b"\n") for name, text in everything_in(folder).items() if name.endswith("unfinished/finished.lines")
    )


def runs_in(folder):
    return pd.read_parquet(Path(folder) / "runs.parquet").drop(columns="seconds")


@pytest.fixture
def stopped(here):
    """Start a comparison, send a signal when two of four runs are finished, and return how it ended.

    A worker that outlived it would hold the pipes, and the end would not come.
    """

    def stop(number, *more):
        (here / "patient.py").write_text(PATIENT)
        arguments = command(*GIVEN, "--solvers", "patient.py:patient", "--moments", "--out", "result", *more)
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        process = subprocess.Popen(arguments, start_new_session=True, preexec_fn=interruptible, **pipes)
        try:
            deadline = time.monotonic() + 100
            while finished(here) < 2 and time.monotonic() < deadline:
                time.sleep(0.05)
            os.kill(process.pid, number)
            out, err = process.communicate(timeout=100)
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
        return process.returncode, out, err

    return stop


@posix
@pytest.mark.usefixtures("no_pictures")
def test_after_kill_9_it_goes_on_to_the_same_numbers(here, stopped):
    assert stopped(signal.SIGKILL)[0] == -signal.SIGKILL
    assert finished(here) == 2
    again = call(*GIVEN, "--solvers", "patient.py:patient", "--out", "result")
    again.assert_refused("result holds 2 finished runs of a comparison that was stopped", "--resume")
    other = call("compare", "--resume", "--runs", "5", "--out", "result")
    other.assert_refused("was begun with --runs 4, not 5")
    (here / "go").touch()
    begun = (here / "begun").stat().st_size
    assert call("compare", "--resume", "--out", "result").status == 0
    assert (here / "begun").stat().st_size - begun == 2  # the other two only
    assert call(*GIVEN, "--solvers", "patient.py:patient", "--moments", "--out", "whole").status == 0
    assert runs_in("result").equals(runs_in("whole"))
    one, other = (pd.read_parquet(Path(folder) / "moments.parquet") for folder in ("result", "whole"))
    assert one.to_json() == other.to_json()
    assert {*everything_in(here / "result")} == {*everything_in(here / "whole")}
    complete = call("compare", "--resume", "--out", "result")
    assert complete == (0, "The comparison in result is complete; there is nothing to resume.\n", "")
    another = call("compare", "--resume", "--out", "result", "--seed", "5")
    another.assert_refused("The folder result holds another finished result")


@posix
@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_stop_shows_what_is_finished_and_says_how_to_go_on(here, stopped, number, status):
    returned, out, err = stopped(number)
    assert returned == status
    kept = "2 of 4 runs are finished and kept in result/unfinished; --resume goes on with the others"
    assert err == f"slam-lab: stopped; {kept}.\n"
    assert re.search(r"patient +20 +2 ", out)
    (here / "go").touch()
    assert call("compare", "--resume", "--out", "result", "--jobs", "2").status == 0
    assert len(runs_in("result")) == 4


@posix
def test_a_stop_without_a_folder_leaves_the_table(here, monkeypatch):
    from lab.solvers import SOLVERS

    sis, calls = SOLVERS["sis"], []

    def interrupted(problem, rng, *, n_particles):
        calls.append(n_particles)
        if len(calls) == 4:  # the first call only tries the options
            raise KeyboardInterrupt
        return sis(problem, rng, n_particles=n_particles)

    monkeypatch.setitem(SOLVERS, "sis", interrupted)
    done = call(*GIVEN, "--solvers", "sis")
    assert (done.status, done.err) == (130, "slam-lab: stopped; 2 of 4 runs are finished and in the table.\n")
    assert re.search(r"sis +20 +2 ", done.out)
    assert os.listdir(here) == []


@posix
@pytest.mark.parametrize("jobs", [1, 2])
def test_a_worker_that_dies_is_named_and_the_rest_goes_on(here, jobs):
    (here / "deadly.py").write_text(DEADLY)
    arguments = ("--solvers", "deadly.py:deadly", "--particles", "10,20,30", "--runs", "1", "--jobs", jobs)
    done = start("compare", "--scenario", "two-landmarks", *arguments, "--out", "result", cwd=here)
    assert (done.status, done.err) == (1, "")
    runs = runs_in("result").set_index("n_particles")
    assert (runs["error"] == "").to_dict() == {10: True, 20: False, 30: True}
    assert runs.loc[[10, 30], "mean_gap"].notna().all()
    named = f"deadly: 1 of 3 runs FAILED and are left out; the first is N = 20, run 0, seed {runs.loc[20, 'seed']}: its"
    assert named in done.out
    assert "The runs whose worker died can be tried again: the same command with --resume." in done.out
    (here / "go").touch()
    if jobs == 1:
        again = start("compare", "--resume", "--out", "result", cwd=here)
        assert again.status == 0
        assert (runs_in("result")["error"] == "").all()
        assert not (here / "result" / "unfinished").exists()


@pytest.mark.usefixtures("no_pictures")
def test_two_at_once_in_one_folder_are_one_too_many(here):
    (here / "result").mkdir()
    with exclusive(here / "result"):
        call(*GIVEN, "--solvers", "sis", "--out", "result").assert_refused("Another process is at work in result")
    assert os.listdir(here / "result") == []
    assert call(*GIVEN, "--solvers", "sis", "--out", "result").status == 0


@pytest.mark.usefixtures("no_pictures")
def test_the_result_of_another_command_is_no_comparison(here):
    assert call("run", "kalman", "--out", "result").status == 0
    call("compare", "--resume", "--out", "result").assert_refused("result holds no comparison")


@pytest.mark.usefixtures("no_pictures")
def test_a_complete_result_with_failures_keeps_its_status(here):
    (here / "bad.py").write_text("def bad(problem, rng, *, n_particles):\n    raise ValueError('no')\n")
    assert call(*GIVEN, "--solvers", "bad.py:bad", "--out", "result").status == 1
    done = call("compare", "--resume", "--out", "result")
    assert (done.status, done.out) == (1, "The comparison in result is complete; there is nothing to resume.\n")


def test_a_file_that_changes_meanwhile_is_refused(here):
    """A worker that lives longer than one comparison, such as a cluster's, must not keep the older text."""
    (here / "mine.py").write_text("from lab.solvers import sis as mine\n")
    _, before = resolve("mine.py:mine")
    assert before.load().__name__ == "sis"
    (here / "mine.py").write_text("from lab.solvers import sir as mine\n")
    with pytest.raises(InputError, match="is not the file with which this began"):
        before.load()
    assert resolve("mine.py:mine")[1].load().__name__ == "sir"


@pytest.mark.usefixtures("no_pictures")
def test_resume_with_nothing_there_begins_and_says_so(here):
    done = call(*GIVEN, "--solvers", "sis", "--resume", "--out", "result")
    assert (done.status, done.err) == (0, "Nothing to resume in result: beginning.\n")
    assert json.loads((here / "result" / "config.json").read_text())["arguments"]["runs"] == 4


def test_resume_needs_a_folder(here):
    call(*GIVEN, "--resume").assert_refused("--resume goes on with what is in --out DIR; say which folder")


@pytest.mark.usefixtures("no_pictures")
def test_data_sets_are_simulations_that_can_be_repeated(here):
    given = ("compare", "--scenario", "two-landmarks", "--particles", "20", "--runs", "2", "--solvers", "sis")
    assert call(*given, "--datasets", "3", "--seed", "6", "--out", "three").status == 0
    assert call(*given, "--datasets", "1", "--seed", "6", "--out", "one").status == 0
    three, one = runs_in("three"), runs_in("one")
    assert three["data_set"].tolist() == [0, 0, 1, 1, 2, 2]
    assert three[three["data_set"] == 0].equals(one)
    assert three["mean_gap"].nunique() == 6
    alone = call("run", "sis", "--experiment", "three/experiment-2.npz", "--particles", "20")
    assert alone.status == 0
    assert pd.read_csv("three/summary.csv")["data_sets"].tolist() == [3]
    call(*given, "--datasets", "0").assert_refused("The number of data sets must be at least 1")
    refused = call("compare", "--experiment", "three/experiment-2.npz", "--datasets", "2")
    refused.assert_refused("--datasets simulates afresh, and --experiment is one data set")


@pytest.mark.usefixtures("no_pictures")
def test_another_backend_is_refused(here):
    """Its numbers would be others: a comparison goes on with the backend that it was begun with."""
    pytest.importorskip("numba", reason="the extra toy-slam-lab[fast] is not installed")
    given = [*GIVEN[:-4], "--particles", "200", "--runs", "2", "--solvers", "sir", "--out", "result"]
    from lab.cli import options
    from lab.comparison import Record, Unit
    from lab.metrics import Metrics
    from lab.sweep import Unfinished

    assert call(*given, "--backend", "numpy").status == 0
    config = json.loads((here / "result" / "config.json").read_text())
    assert config["arguments"]["backend"] == "numpy"
    (here / "result").rename(here / "earlier")
    unfinished = Unfinished(here / "result")
    with unfinished.begun(config):
        unfinished.keep(Record(Unit("sir", 200, 0, seed=1), Metrics()))
    call("compare", "--resume", "--backend", "numba", "--out", "result").assert_refused("--backend numpy, not numba")
    assert options.settle_backend("auto", [20]) == "numpy"  # below N = 100 nothing is compiled
