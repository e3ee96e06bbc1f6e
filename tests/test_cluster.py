"""The comparison on a real Dask cluster of two worker processes, as its people use it: by address, from a process."""

import subprocess
import sys
from importlib.metadata import PackageNotFoundError

import pandas as pd
import pytest
from program import start

import lab
from lab import cluster
from lab.validation import InputError

pytest.importorskip("distributed", reason="needs the extra toy-slam-lab[cluster]")

CLUSTER = """
import sys
from distributed import LocalCluster

if __name__ == "__main__":
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()
"""
DEADLY = """
import os
from lab.solvers import sir

def deadly(problem, rng, *, n_particles):
    if n_particles == 20:
        os._exit(3)
    return sir(problem, rng, n_particles=n_particles)
"""


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cluster")
    (folder / "cluster.py").write_text(CLUSTER)
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True}
    with subprocess.Popen([sys.executable, "cluster.py"], cwd=folder, **pipes) as running:
        yield running.stdout.readline().strip()
        running.stdin.close()


def test_the_same_numbers_as_in_one_process(address, here):
    """In a process of its own: distributed leaves sockets to the garbage collector, whose warnings are errors here."""
    code = f"""if True:
        import sys
        from data_simulation import TWO_LANDMARKS, data_simulation
        from lab.cluster import connect
        from lab.compare import compare
        from lab.problem import Experiment
        from lab.solvers import rbpf, sir

        worlds = [Experiment.from_simulation(data_simulation(scenario=TWO_LANDMARKS, rng=i)).problem for i in (0, 1)]
        given = {{"solvers": {{"sir": sir, "rbpf": rbpf}}, "n_particles": [20, 50], "runs": 2, "seed": 5}}
        with connect({address!r}) as execute:
            there = compare(worlds, **given, execute=execute)
        alone = compare(worlds, **given)
        assert len(there.records) == 16
        assert there.runs.drop(columns="seconds").equals(alone.runs.drop(columns="seconds"))
        assert (there.of("sir", 20)[0].filtered.means == alone.of("sir", 20)[0].filtered.means).all()
    """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=100)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_unit_that_kills_its_workers_is_lost_and_the_rest_goes_on(address, here):
    (here / "deadly.py").write_text(DEADLY)
    given = ("--scenario", "two-landmarks", "--particles", "10,20", "--runs", 1, "--solvers", "deadly.py:deadly")
    done = start("compare", *given, "--dask", address, "--out", "result", cwd=here)
    assert (done.status, done.err) == (1, "")
    runs = pd.read_parquet("result/runs.parquet").set_index(["solver", "n_particles"])
    assert (runs["error"] != "").to_dict() == {("deadly", 10): False, ("deadly", 20): True}
    assert f"N = 20, run 0, seed {runs.loc[('deadly', 20), 'seed']}: its worker process died" in done.out
    assert "again: the same command with --resume" in done.out


def test_nobody_answers(here):
    nowhere = "tcp://127.0.0.1:1"
    code = f"import lab.cluster, lab.cli; lab.cluster.CONNECTING = 1; lab.cli.main(['compare', '--dask', {nowhere!r}])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=100)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"slam-lab: No Dask scheduler answers at {nowhere}: ")
    assert done.stderr.count("\n") == 1


def test_an_address_is_asked_for():
    with pytest.raises(InputError, match="such as tcp://host:8786, not 'nonsense'"), cluster.connect("nonsense"):
        pass


@pytest.mark.parametrize(
    ("answers", "message"),
    [
        ({}, "The Dask cluster at tcp://a:1 has no workers"),
        (
            {"tcp://b:2": ModuleNotFoundError("No module named 'lab'")},
            "tcp://b:2 needs toy-slam-lab .* No module named",
        ),
        ({"tcp://b:2": "0.0.0"}, "tcp://b:2 needs toy-slam-lab .*; it answers: 0.0.0"),
    ],
)
def test_workers_that_cannot_help_are_named(answers, message):
    class Client:
        def run(self, function, package, on_error):
            assert (package, on_error) == ("toy-slam-lab", "return")
            return answers

    with pytest.raises(InputError, match=message):
        cluster._check_workers(Client(), "tcp://a:1", {"toy-slam-lab": lab.__version__})


def test_workers_need_what_compiles_here():
    """A worker without numba would run the numpy loop, whose numbers are others."""

    class Client:
        def run(self, function, package, on_error):
            return {"tcp://b:2": lab.__version__ if package == "toy-slam-lab" else PackageNotFoundError(package)}

    with pytest.raises(InputError, match=r"tcp://b:2 needs numba 0\.68\.1; it answers: .*numba"):
        cluster._check_workers(Client(), "tcp://a:1", {"toy-slam-lab": lab.__version__, "numba": "0.68.1"})


def test_without_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install toy-slam-lab\[cluster\]"), cluster.connect("tcp://x:1"):
        pass
