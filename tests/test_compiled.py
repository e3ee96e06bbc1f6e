"""The compiled loop: step for step the readable loop on the same random numbers, and equal to it in distribution."""

import json
import os
import shutil
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from program import call, start
from scipy.stats import ks_2samp, kstest
from test_proposals import PROPOSALS, coupled, cut, lost, mixed
from worlds import WORLDS, everything, full_scenario, problem, reference

from lab import execution, warming
from lab.compare import LONG, compare, way_to_run
from lab.problem import Problem
from lab.solvers import compiled, guided, kalman, particle_steps, rbpf, sir, sis
from lab.solvers.backends import WORTHWHILE
from lab.solvers.plan import plan
from lab.validation import InputError

kernels = pytest.importorskip("lab.fast.compiled", reason="the extra toy-slam-lab[fast] is not installed")
parts = pytest.importorskip("lab.fast.parts")
numba = pytest.importorskip("numba")
pytestmark = pytest.mark.usefixtures("compiled_once")

ROOT = Path(__file__).resolve().parents[1]


class Replay(np.random.Generator):
    """A generator that gives the readable loop the numbers which the compiled one draws from the seed."""

    def __init__(self, seed):
        super().__init__(np.random.PCG64(0))
        self.state = kernels.seed(np.random.default_rng(seed))

    def standard_normal(self, size):
        rows, n = size
        lanes = self.state.shape[1]
        block, blocks = np.empty((rows + 2, lanes)), []
        for _ in range(-(-n // lanes)):
            kernels.normals(self.state, block, rows)
            blocks.append(block[:rows].copy())
        return np.concatenate(blocks, axis=1)[:, :n]

    def random(self):
        row = np.empty((1, self.state.shape[1]))
        kernels.uniforms(self.state, row, 0)
        return row[0, 0]


def in_three_waves():
    """Return a world whose landmarks come into sight in three groups, far enough apart for new genealogies."""
    world = problem(full_scenario(6, field_of_view=everything, n_steps=70))
    z = world.z.copy()
    for begin, landmarks in ((20, (2, 3)), (45, (4, 5))):
        for j in landmarks:
            z[:begin, 2 * j : 2 * j + 2] = np.nan
    return Problem(world.model, z, world.H, world.R)


TWIN_WORLDS = WORLDS | {"coupled": coupled, "mixed": lambda: cut(mixed(), 8), "one instant": lambda: cut(problem(), 1)}
TWIN_WORLDS["three waves"] = in_three_waves


@pytest.mark.parametrize("world", TWIN_WORLDS)
@pytest.mark.parametrize("name", PROPOSALS)
def test_twin(world, name):
    """The readable loop, fed the same random numbers: the same moments, evidence, ESS and survivors."""
    problem, proposal = TWIN_WORLDS[world](), PROPOSALS[name]
    for n_particles, ess_threshold in ((700, 0.5), (256, 1.0), (30, 0.0), (1, 0.5)):
        options = {"proposal": proposal, "n_particles": n_particles, "ess_threshold": ess_threshold}
        options["resample"] = "systematic"
        answer = compiled.run(problem, np.random.default_rng(3), **options)
        steps = list(particle_steps(problem, Replay(3), **options))
        scale = np.abs([step.mean for step in steps]).max()
        np.testing.assert_allclose(answer.means, [step.mean for step in steps], rtol=0, atol=1e-10 * scale)
        np.testing.assert_allclose(answer.covs, [step.cov for step in steps], rtol=0, atol=1e-10 * scale)
        np.testing.assert_allclose(answer.log_evidence, [s.log_evidence for s in steps], rtol=1e-10, atol=1e-9)
        np.testing.assert_allclose(answer.ess, [step.ess for step in steps], rtol=1e-8)
        np.testing.assert_array_equal(answer.survivors, [step.survivors for step in steps])


def test_the_three_waves_are_three():
    own = plan(in_three_waves(), PROPOSALS["delayed"]).sizes[:, 2]
    assert list(dict.fromkeys(own.tolist())) == [14, 10, 6, 2]


@pytest.mark.parametrize("solver", [sis, sir, guided, rbpf, partial(rbpf, proposal="prior")])
def test_runs_of_both_backends_have_one_distribution(solver):
    """Gap of the mean, log-evidence and ESS of 200 runs each: Kolmogorov and Smirnov, one false alarm in 10^4."""
    world = cut(reference(1).problem, 7)
    exact, n_components = kalman(world), 12
    found = []
    for i, backend in enumerate(("numpy", "numba")):
        answers = [solver(world, np.random.default_rng([s, i]), n_particles=100, backend=backend) for s in range(200)]
        gaps = [np.sum(((a.means - exact.means)[1:] / exact.stds[1:]) ** 2) / n_components for a in answers]
        found.append([gaps, [a.log_evidence[-1] for a in answers], [a.ess[1:].mean() for a in answers]])
    for one, two in zip(*found, strict=True):
        assert ks_2samp(one, two).pvalue > 1e-4


def test_a_run_depends_on_its_seed_and_not_on_its_thread():
    world = problem()
    alone = [rbpf(world, np.random.default_rng(s), n_particles=3000, backend="numba") for s in range(6)]
    with ThreadPoolExecutor(3) as pool:
        run = partial(rbpf, world, n_particles=3000, backend="numba")
        together = list(pool.map(lambda s: run(np.random.default_rng(s)), range(6)))
    for one, two in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one.means, two.means)
        np.testing.assert_array_equal(one.covs, two.covs)
    assert (alone[0].means[1:] != alone[1].means[1:]).any()


def test_a_comparison_of_compiled_filters_runs_in_threads_to_the_same_numbers():
    world, solvers = cut(reference(1).problem, 7), {"sir": partial(sir, backend="numba"), "sis": sis}

    def way(solvers, largest, jobs):
        with way_to_run(solvers, largest, jobs) as execute:
            return getattr(execute, "func", execute)

    assert way(solvers, LONG, 2) is execution.processes  # not all of them are compiled
    solvers["sis"] = partial(sis, backend="auto")
    assert way(solvers, LONG - 1, 2) is execution.processes  # nothing takes long
    assert way(solvers, LONG, 2) not in (execution.processes, execution.here)
    assert way(solvers, LONG, 1) is execution.here
    with_resampler = {"sir": partial(sir, backend="numba", resample=lambda weights, rng: None)}
    assert way(with_resampler, LONG, 2) is execution.processes
    alone, shared = (compare(world, solvers, n_particles=[20, LONG], runs=3, jobs=jobs).runs for jobs in (1, 2))
    assert shared.drop(columns="seconds").equals(alone.drop(columns="seconds"))


def test_threads_begin_when_the_kernels_of_all_schemes_are_loaded(monkeypatch):
    loaded, sir_ = [], partial(sir, backend="numba")
    monkeypatch.setattr(compiled, "is_cold", lambda _: False)
    monkeypatch.setattr(compiled, "warm", loaded.append)
    with way_to_run({"usual": sir_, "other": partial(sir_, resample="stratified")}, LONG, 2) as execute:
        assert not loaded
        execute.keywords["warm"]()
    assert loaded == ["stratified", "systematic"]


def test_the_interpreter_goes_on_during_a_run():
    """A thread that counts is let in while the kernel runs: it does not hold Python's lock."""
    counted, done = [0], threading.Event()

    def count():
        while not done.is_set():
            counted[0] += 1

    sir(problem(), np.random.default_rng(0), n_particles=10, backend="numba")
    thread = threading.Thread(target=count)
    thread.start()
    before = counted[0]
    args = {"n_particles": 300_000, "backend": "numba"}
    sir(problem(), np.random.default_rng(0), **args)
    during = counted[0] - before
    done.set()
    thread.join()
    assert during > 1000


def test_normals():
    """Moments, law and independence of two rows and of neighbours; five standard errors, level 10^-4."""
    state, n_blocks = kernels.seed(np.random.default_rng(1)), 2000
    block, blocks = np.empty((4, 256)), []
    for _ in range(n_blocks):
        kernels.normals(state, block, 3)
        blocks.append(block[:3].copy())
    rows = np.concatenate(blocks, axis=1)
    n = rows.shape[1]
    assert kstest(rows[0], "norm").pvalue > 1e-4
    assert kstest(rows[1], "norm").pvalue > 1e-4
    assert kstest(np.arctan2(rows[0], rows[1]) / (2 * np.pi) + 0.5, "uniform").pvalue > 1e-4
    assert (np.abs(np.corrcoef(np.vstack([rows, rows**2])) - np.eye(6)) < 5 / np.sqrt(n)).all()
    assert abs(np.mean(rows[0, 1:] * rows[0, :-1])) < 5 / np.sqrt(n)
    assert abs(np.mean(rows**4) - 3) < 5 * np.sqrt(96 / rows.size)
    assert np.abs(rows).max() > 4.2


def test_weights_that_are_all_zero_are_named():
    with pytest.raises(InputError, match=r"At k = \d+: .* every weight is zero"):
        sir(lost(), np.random.default_rng(0), n_particles=300, backend="numba")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"backend": "fortran"}, "Unknown backend 'fortran'; known are numpy, numba, auto"),
        ({"backend": 1}, "Unknown backend 1"),
        ({"backend": "numba", "resample": lambda w, rng: np.arange(len(w))}, "named resampling schemes only"),
        ({"backend": "numba", "resample": "bogus"}, "Unknown resampling scheme"),
        ({"backend": "numba", "n_particles": 0}, "at least 1"),
        ({"backend": "numba", "ess_threshold": 2}, "between 0 and 1"),
    ],
)
def test_bad_options(options, message):
    with pytest.raises(InputError, match=message):
        sir(problem(), np.random.default_rng(0), **options)


def test_auto_depends_on_the_number_of_particles_alone():
    world = cut(problem(), 3)
    for n, meant in ((WORTHWHILE - 1, "numpy"), (WORTHWHILE, "numba")):
        auto, expected = (sir(world, np.random.default_rng(2), n_particles=n, backend=b) for b in ("auto", meant))
        np.testing.assert_array_equal(auto.means, expected.means)


SMALL = ("compare", "--solvers", "sir", "--runs", "1", "--scenario", "two-landmarks")


def config(folder):
    return json.loads((folder / "config.json").read_text())


def test_the_command_line_records_what_ran(here, no_pictures):
    for backend, particles, recorded in (("auto", 50, "numpy"), ("auto", WORTHWHILE, "auto"), ("numba", 50, "numba")):
        done = call(*SMALL, "--particles", particles, "--backend", backend, "--out", backend + str(particles))
        assert (done.status, done.err) == (0, "")
        written = config(here / (backend + str(particles)))
        assert written["arguments"]["backend"] == recorded
        assert ("numba" in written["versions"]) == (recorded != "numpy")
    call(*SMALL, "--particles", "50", "--backend", "fast").assert_refused("--backend", "numpy, numba, auto")
    again = call(*SMALL, "--particles", "50", "--backend", "numba", "--out", "auto50", "--resume")
    again.assert_refused("another finished result")


def test_run_gives_the_numbers_of_compare(here, no_pictures):
    call(*SMALL, "--particles", "60", "--backend", "numba", "--out", "a")
    call("run", "sir", "--particles", "60", "--scenario", "two-landmarks", "--backend", "numba", "--out", "b")
    gap = pd.read_csv(here / "a" / "runs.csv")["mean_gap"][0]
    table = pd.read_csv(here / "b" / "moments.csv")
    table = table[(table.k > 0) & (table.exact_std > 1e-9)]
    assert np.sqrt(np.mean(((table["mean"] - table.exact_mean) / table.exact_std) ** 2)) == pytest.approx(gap)


def without_numba(folder):
    """Return the environment of a process in which numba fails to import."""
    (folder / "numba").mkdir()
    (folder / "numba" / "__init__.py").write_text("raise ImportError('no such luck')")
    return os.environ | {"PYTHONPATH": str(folder)}


def test_a_numba_that_fails_is_told_of_once(tmp_path):
    environment = without_numba(tmp_path)
    done = start(*SMALL, "--particles", "20,30", "--backend", "numba", cwd=tmp_path, env=environment)
    plain = start(*SMALL, "--particles", "20,30", "--backend", "numpy", cwd=tmp_path)
    assert done.status == 0
    assert done.err == "slam-lab: numba cannot be imported (ImportError: no such luck); numpy takes its place.\n"
    no_seconds = [[word for word in line.split() if "." not in word] for line in done.out.splitlines()]
    assert no_seconds == [[word for word in line.split() if "." not in word] for line in plain.out.splitlines()]


def test_a_library_call_without_numba_warns_once(tmp_path):
    code = (
        "import sys, warnings; sys.path.insert(0, 'tests'); from worlds import problem; import numpy as np\n"
        "from lab.solvers import sir\n"
        "with warnings.catch_warnings(record=True) as said:\n"
        "    warnings.simplefilter('always')\n"
        "    a, b = (sir(problem(), np.random.default_rng(0), n_particles=9, backend=x) for x in ('numba', 'numba'))\n"
        "    c = sir(problem(), np.random.default_rng(0), n_particles=9)\n"
        "print(len(said), (a.means == c.means).all(), (b.means == c.means).all())"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], env=without_numba(tmp_path), cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["1", "True", "True"]


def test_no_folder_for_kernels_is_told_of():
    """numba has nowhere to keep them: its locators are taken away, since root may write to any folder."""
    code = (
        "import warnings, numba.core.caching as caching; caching.CacheImpl._locator_classes = []\n"
        "caching.CodeLibraryCacheImpl._locator_classes = []\n"
        "from lab import fast\n"
        "with warnings.catch_warnings(record=True) as said:\n"
        "    warnings.simplefilter('always')\n"
        "    kernels = fast.load(), fast.load()\n"
        "print([str(w.message) for w in said if w.category is RuntimeWarning], kernels[0].KEPT)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.count("NUMBA_CACHE_DIR") == 1
    assert done.stdout.split()[-1] == "False"


def test_two_processes_compile_what_was_never_used_or_was_changed(tmp_path):
    """The parts of the loop are kept by the other process, and found; what is kept names the hash of all sources."""
    shutil.copytree(ROOT / "lab", tmp_path / "lab", ignore=shutil.ignore_patterns("__pycache__"))
    code = (
        "from lab.fast import compiled as kernels\n"
        "from lab.solvers import compiled\n"
        "from lab.warming import warming\n"
        "schemes = ['systematic']\n"
        "before = compiled.is_cold(schemes)\n"
        "if {wanted}:\n"
        "    with warming(schemes, 2) as warm: warm()\n"
        "    made = map(kernels._made, kernels.parts_for(*schemes))\n"
        "    print(before, compiled.is_cold(schemes), *(part.cache_hits for part in made))\n"
        "else:\n"
        "    print(before)"
    )

    def said(*, wanted=True):
        environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "kernels"), "PYTHONPATH": str(tmp_path)}
        command = [sys.executable, "-c", code.format(wanted=wanted)]
        return subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True).stdout

    assert said().split() == ["True", "False", *"11111"]
    assert said().split() == ["False", "False", *"11111"]
    with (tmp_path / "lab" / "fast" / "arithmetic.py").open("a") as file:
        file.write("# changed\n")
    assert said(wanted=False).split() == ["True"]


def test_parts_that_another_process_could_not_compile_are_compiled_here(monkeypatch):
    called = []
    monkeypatch.setattr(compiled, "is_cold", lambda _: True)
    monkeypatch.setattr(compiled, "compile_loop", lambda: called.append("loop"))
    monkeypatch.setattr(compiled, "warm", called.append)
    for end in (lambda _: os._exit(1), lambda _: 1 / 0):
        monkeypatch.setattr(warming, "_compile_parts", end)
        with warming.warming(["residual"], 2) as warm:
            warm()
    assert called == ["loop", "residual"] * 2
    with warming.warming(["residual"], 1) as warm:  # nobody else is to work
        warm()
    assert called == ["loop", "residual"] * 2 + ["residual"]


def test_each_scheme_runs_its_own_code(monkeypatch):
    world, run = cut(problem(), 8), partial(sir, backend="numba", n_particles=400, ess_threshold=1)
    means = [run(world, np.random.default_rng(0), resample=scheme).means[-1] for scheme in kernels.SCHEMES]
    assert all((one != other).all() for one, other in combinations(means, 2))
    asked = []
    monkeypatch.setattr(kernels, "run", lambda scheme, *_: asked.append(scheme) or 1)
    compiled.warm.cache_clear()
    for scheme in kernels.SCHEMES:
        with pytest.raises(InputError):
            compiled.warm(scheme)
    assert asked == [*kernels.SCHEMES]


def test_parts_refuse_what_they_would_misread():
    caller = parts.Part(parts.NORMALS.kernel, parts.ROW, numba.int64).caller()
    asks = numba.njit(lambda values, number: caller(0, values, number))
    for values, number in ((np.zeros(4)[::2], 1), (np.zeros(4, np.float32), 1), (np.zeros(4), 5.7)):
        with pytest.raises(numba.TypingError, match="A part takes"):
            asks.compile((numba.typeof(values), numba.typeof(number)))
    fixed = np.zeros(4)
    fixed.flags.writeable = False
    with pytest.raises(numba.TypingError, match="A part takes"):
        asks.compile((numba.typeof(fixed), numba.int64))
    with pytest.raises(numba.TypingError, match="A part takes"):
        numba.njit(lambda values: caller(0, values)).compile((parts.ROW,))
