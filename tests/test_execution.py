"""Units in worker processes and threads: every result once, deaths named, no worker left behind."""

import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from functools import partial

import cloudpickle
import loky
import pytest

from lab import execution, workers


def lost(item, reason):
    return ("lost", item, reason)


def work(item, *, deadly=()):
    if item in deadly:
        os._exit(3)
    return (item * item, os.getpid())


@pytest.mark.parametrize("jobs", [1, 3])
def test_each_item_once_in_as_many_processes_as_asked_for(jobs):
    results = list(execution.processes(work, range(12), lost, jobs=jobs))
    assert sorted(square for square, _ in results) == [i * i for i in range(12)]
    pids = {pid for _, pid in results}
    assert os.getpid() not in pids
    assert 1 <= len(pids) <= jobs


def test_one_worker_per_processor_and_none_too_many(monkeypatch):
    monkeypatch.setattr(loky, "cpu_count", lambda: 3)
    made = []
    for items, jobs, expected in ((range(9), -1, 3), (range(2), -1, 2), (range(9), 2, 2), ([], 2, 0)):
        made.clear()
        monkeypatch.setattr(workers, "Worker", partial(Counted, made))
        assert len(list(execution.processes(work, items, lost, jobs=jobs))) == len(items)
        assert len(made) == expected


class Counted:
    """A worker of this process."""

    def __init__(self, made, file, module):
        made.append(self)
        self.file = file

    def submit(self, item):
        future = execution.Future()
        future.set_result(cloudpickle.loads(self.file.read_bytes())(item))
        return future

    def end(self):
        pass

    kill = end


def test_here_is_this_process_in_the_given_order():
    assert list(execution.here(work, [3, 1], lost)) == [(9, os.getpid()), (1, os.getpid())]


def test_threads_are_of_this_process_and_as_many_as_asked_for():
    together = threading.Barrier(3, timeout=20)

    def meet(item):
        together.wait()
        return item, threading.get_ident(), os.getpid()

    results = list(execution.threads(meet, range(6), lost, jobs=3))
    assert sorted(item for item, *_ in results) == [*range(6)]
    assert len({thread for _, thread, _ in results}) == 3
    assert {process for *_, process in results} == {os.getpid()}


def test_what_a_thread_raises_is_raised_and_nothing_more_is_begun():
    begun = []

    def fail(item):
        begun.append(item)
        time.sleep(0.01)
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        list(execution.threads(fail, range(500), lost, jobs=1))
    assert len(begun) < 500


def test_a_death_loses_its_own_item_only():
    results = list(execution.processes(partial(work, deadly={0, 4, 11}), range(12), lost, jobs=2))
    assert sorted(item for kind, item, *_ in (r for r in results if r[0] == "lost")) == [0, 4, 11]
    assert sorted(r[0] for r in results if r[0] != "lost") == sorted(i * i for i in {*range(12)} - {0, 4, 11})
    assert all("worker process died" in r[2] for r in results if r[0] == "lost")


def elsewhere(item, *, here, deadly=()):
    """Take a while; die of some items, but not in the process `here`."""
    time.sleep(0.05)
    return work(item, deadly=() if os.getpid() == here else deadly)


@pytest.mark.parametrize(("jobs", "items"), [(1, 6), (2, 40), (3, 60), (2, 2), (3, 3), (4, 6), (2, 1), (2, 0)])
def test_this_process_takes_its_part(jobs, items):
    function = partial(elsewhere, here=os.getpid())
    results = list(execution.processes(function, range(items), lost, jobs=jobs, beside=True))
    assert sorted(square for square, _ in results) == [i * i for i in range(items)]
    pids = [pid for _, pid in results]
    assert len(set(pids)) <= jobs
    assert pids.count(os.getpid()) >= min(items, 1)
    assert (pids.count(os.getpid()) == items) == (jobs == 1 or items < 2)


def test_a_worker_that_dies_beside_this_process_loses_what_it_was_given_and_nothing_else():
    """It may have been given two items; its successors die, too."""
    here = os.getpid()
    function = partial(elsewhere, here=here, deadly=range(100))
    results = list(execution.processes(function, range(40), lost, jobs=2, beside=True))
    done = {r[0] for r in results if r[0] != "lost"}
    gone = [r[1] for r in results if r[0] == "lost"]
    assert all(r[1] == here for r in results if r[0] != "lost")
    assert done == {i * i for i in {*range(40)} - {*gone}}
    assert len(results) == 40
    assert 1 <= len(gone) < 39


def grow(item):
    """Keep 150 MB more of every item."""
    kept.append(bytearray(os.urandom(1000) * 150_000))
    time.sleep(0.55)  # it is measured between two items
    return os.getpid()


kept = []


def test_a_worker_that_is_replaced_since_it_has_grown_knows_its_work():
    """The pool replaces one that has grown by 300 MB, a second after it began at the earliest."""
    pids = list(execution.processes(grow, range(7), lost, jobs=1))
    assert len(pids) == 7
    assert len(set(pids)) > 1


def test_what_this_process_does_to_the_function_is_not_sent():
    """It is pickled before this process works with it, which may remember things in it."""
    function = Remembering()
    results = list(execution.processes(function, range(30), lost, jobs=2, beside=True))
    assert sorted(results) == list(range(30))
    assert function.seen


class Remembering:
    """Cannot be pickled from its first call on."""

    def __init__(self):
        self.seen = []

    def __call__(self, item):
        self.seen.append(threading.Lock())
        time.sleep(0.05)
        return item


def test_the_folder_of_the_function_is_removed(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    results = execution.processes(work, range(4), lost, jobs=1)
    next(results)
    assert len(os.listdir(tmp_path)) == 1
    results.close()
    assert os.listdir(tmp_path) == []


def test_a_worker_killed_from_outside_between_two_items_costs_one_at_most():
    """It may be found dead before it is given the next item, or after."""
    results = []
    for result in execution.processes(work, range(4), lost, jobs=1):
        results.append(result)
        if len(results) == 1:
            time.sleep(0.5)  # the next is done by now, and its worker idle
            os.kill(result[1], signal.SIGKILL)
    assert [r[0] for r in results if r[0] != "lost"] in ([0, 1, 4, 9], [0, 1, 9])
    assert len(results) == 4


def test_what_the_function_raises_is_raised_and_no_process_remains():
    with pytest.raises(TypeError):
        list(execution.processes(work, [1, "a"], lost, jobs=1))
    results = execution.processes(work, range(4), lost, jobs=2)
    worker = next(results)[1]
    results.close()
    deadline = time.monotonic() + 10
    while time.monotonic() < deadline and alive(worker):
        time.sleep(0.05)
    assert not alive(worker)


def alive(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize(("jobs", "early"), [(1, 1), (2, 1), (1, 3)])
def test_workers_that_were_started_before_are_taken_and_others_join_them(jobs, early):
    with workers.Crew("colorsys").call(early) as crew:
        waiting = list(map(pid_of, crew.workers))
        results = list(execution.processes(imported, range(8), lost, jobs=jobs, crew=crew))
    assert sorted(item for item, _, _ in results) == [*range(8)]
    assert all(there for _, there, _ in results)  # what the crew imports, each of them has
    pids = {pid for _, _, pid in results}
    assert len(pids) <= jobs
    assert pids & set(waiting)
    assert not any(map(alive, waiting))


def imported(item):
    time.sleep(0.2)
    return item, "colorsys" in sys.modules, os.getpid()


def test_a_worker_that_died_while_it_waited_is_replaced():
    with workers.Crew().call(1) as crew:
        os.kill(pid_of(crew.workers[0]), signal.SIGKILL)
        time.sleep(0.5)
        results = list(execution.processes(work, range(4), lost, jobs=1, crew=crew))
    assert sorted(square for square, _ in results) == [0, 1, 4, 9]


def test_workers_without_work_end_at_once(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with workers.Crew().call(2) as crew:
        pids = list(map(pid_of, crew.workers))
        assert all(map(alive, pids))
    assert not any(map(alive, pids))
    assert os.listdir(tmp_path) == []


def pid_of(worker):
    return worker._pool.submit(os.getpid).result()


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="needs POSIX signals")
def test_workers_leave_an_interrupt_to_this_process():
    for result in execution.processes(work, range(3), lost, jobs=1):
        os.kill(result[1], signal.SIGINT)
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_the_first_worker_is_deaf_to_interrupts_from_its_beginning():
    """Before it reads anything: afterwards a traceback of its own would be in the terminal."""
    script = """
        from lab.workers import Crew
        with Crew().call(1) as crew:
            (pid,) = crew.workers[0]._pool._processes
            print(open(f"/proc/{pid}/status").read())
    """
    status = subprocess.run([sys.executable, "-c", textwrap.dedent(script)], capture_output=True, text=True, check=True)
    (blocked,) = (int(line.split()[1], 16) for line in status.stdout.splitlines() if line.startswith("SigBlk"))
    assert blocked >> (signal.SIGINT - 1) & 1


@pytest.mark.skipif(sys.platform != "linux", reason="kills with POSIX signals and reads /proc")
@pytest.mark.parametrize("delay", [0, 0.1, 1])
def test_a_worker_ends_after_this_process_was_killed_even_before_the_worker_had_begun(delay, tmp_path):
    script = f"""
        import os, signal, time
        from lab.workers import Crew
        crew = Crew().call(1)
        print(*crew.workers[0]._pool._processes, flush=True)
        time.sleep({delay})
        os.kill(os.getpid(), signal.SIGKILL)
    """
    with (tmp_path / "pid").open("w") as file:  # no pipe, which the worker would hold
        environment = os.environ | {"TMPDIR": str(tmp_path)}  # what a killed process leaves
        subprocess.run([sys.executable, "-c", textwrap.dedent(script)], stdout=file, env=environment)
    pid = int((tmp_path / "pid").read_text())
    deadline = time.monotonic() + 20
    while alive(pid) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not alive(pid)
