"""The structured exact filter against FilterPy's whole matrices, in the answers and in the memory that it takes."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from worlds import BLOCK_WORLDS, WORLDS, block_scenario, everything, problem

from lab.problem import Experiment
from lab.result import Filtered, FilteredMap
from lab.simulation import simulate
from lab.solvers import exact, kalman
from lab.sparse import SparseProblem
from lab.validation import InputError


@pytest.mark.parametrize("world", BLOCK_WORLDS)
def test_agrees_with_filterpy(world):
    given = BLOCK_WORLDS[world]()
    dense, structured = kalman(given, method="dense"), kalman(SparseProblem.of(given), method="structured")
    np.testing.assert_allclose(structured.means, dense.means, rtol=0, atol=1e-9)
    np.testing.assert_allclose(structured.covs, dense.covs, rtol=0, atol=1e-9)
    np.testing.assert_allclose(structured.log_evidence, dense.log_evidence, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(structured.covs, structured.covs.swapaxes(1, 2))
    assert structured.ess is None


@pytest.mark.parametrize("world", ["handout", "blocks-20", "blocks-140", "blocks-holes", "blocks-moving", "full-5"])
@pytest.mark.parametrize("method", ["dense", "structured"])
def test_blocks_are_those_of_the_covariances(world, method):
    given = (BLOCK_WORLDS | WORLDS)[world]()
    dense, few = kalman(given, method="dense"), kalman(given, method=method, keep="blocks")
    assert isinstance(few, FilteredMap)
    np.testing.assert_allclose(few.means, dense.means, rtol=0, atol=1e-9)
    np.testing.assert_allclose(few.stds, dense.stds, rtol=0, atol=1e-9)
    np.testing.assert_allclose(few.log_evidence, dense.log_evidence, rtol=1e-9, atol=1e-9)
    for i in range(1 + given.n_landmarks):
        block = slice(2 * i, 2 * i + 2)
        np.testing.assert_allclose(few.blocks[:, i], dense.covs[:, block, block], rtol=0, atol=1e-9)
    components = np.random.default_rng(0).permutation(2 + 2 * given.n_landmarks)[:7]
    np.testing.assert_allclose(few.rows(components), dense.covs[-1][components], rtol=0, atol=1e-9)


@pytest.mark.parametrize("world", [name for name in WORLDS if name not in BLOCK_WORLDS and name != "full-1"])
def test_what_couples_landmarks_takes_the_dense_form(world):
    given = WORLDS[world]()
    with pytest.raises(InputError, match="couples"):
        SparseProblem.of(given)
    dense, structured = kalman(given, method="dense"), kalman(given, method="structured")
    np.testing.assert_array_equal(structured.means, dense.means)
    np.testing.assert_array_equal(structured.covs, dense.covs)


def test_auto_chooses_by_size(monkeypatch):
    made = []
    form = exact.MapFilter
    monkeypatch.setattr(exact, "MapFilter", lambda given: made.append(given) or form(given))
    few, many = (problem(block_scenario(M, n_steps=3)) for M in (exact.STRUCTURED_FROM - 1, exact.STRUCTURED_FROM))
    kalman(few)
    assert not made
    kalman(many)
    assert len(made) == 1
    kalman(many, method="dense")
    assert len(made) == 1
    kalman(few, method="structured")
    assert len(made) == 2
    coupled = many.model.P0.copy()
    coupled[2, 4] = coupled[4, 2] = 1e-3
    kalman(replace(many, model=replace(many.model, P0=coupled)))
    assert len(made) == 2


def test_a_sparse_problem_has_a_dense_form():
    sparse, _ = simulate(block_scenario(5), np.random.default_rng(0))
    same = kalman(problem(block_scenario(5)))
    answer = kalman(sparse)
    assert isinstance(answer, Filtered)
    np.testing.assert_allclose(answer.means, same.means, rtol=0, atol=1e-9)


def test_a_prior_without_information_loses_no_digits():
    """A prior deviation of 10^7 m: what is then known of a landmark is robot and measurement noise alone."""
    scenario = replace(block_scenario(2, field_of_view=everything, n_steps=3), landmark_cov=1e14)
    given = problem(scenario)
    answer = kalman(given, method="structured")
    r, R = answer.covs[1, :2, :2], given.R[1]
    np.testing.assert_allclose(answer.covs[1, 2:4, 2:4], r + R[:2, :2], rtol=1e-9)
    np.testing.assert_allclose(answer.covs[1, 2:4, 4:6], r, rtol=1e-9)
    np.testing.assert_allclose(answer.means[1, 2:4], answer.means[1, :2] + given.z[1, :2], rtol=1e-9)


def test_singular_innovation_covariance_is_named():
    sparse = SparseProblem.of(BLOCK_WORLDS["blocks-known-map"]())
    known = replace(sparse, Q=np.zeros((2, 2)), robot_cov=np.zeros((2, 2)), R=np.zeros_like(sparse.R))
    with pytest.raises(InputError, match=f"singular at k = {sparse.instants[0]}"):
        kalman(known, method="structured")


@pytest.mark.parametrize(
    ("options", "message"), [({"method": "fast"}, "method must be"), ({"keep": "last"}, "keep must be")]
)
def test_unknown_options_are_named(options, message):
    with pytest.raises(InputError, match=message):
        kalman(BLOCK_WORLDS["handout"](), **options)


def test_an_experiment_is_told_where_its_problem_is():
    given = BLOCK_WORLDS["handout"]()
    for method in ("auto", "dense", "structured"):
        with pytest.raises(InputError, match=r"experiment\.problem"):
            kalman(Experiment(given, None, np.zeros(2)), method=method)


LARGE = """
from dataclasses import replace
from pathlib import Path
import numpy as np
from data_simulation import HANDOUT
from lab.simulation import simulate
from lab.solvers import kalman

def peak():
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
    return 1024 * int(line.split()[1])

M, before = 1500, peak()
count = iter([M, 20, 100])  # landmarks seen at each instant
scenario = replace(
    HANDOUT, n_steps=4, landmark_means=np.zeros((M, 2)), field_of_view=lambda z, o: np.arange(M) < next(count)
)
given, truth = simulate(scenario, np.random.default_rng(0))
answer = kalman(given, keep="blocks")
assert answer.rows(np.array([0, 2 * M + 1])).shape == (2, 2 + 2 * M)
assert (answer.stds[-1, 2:] < 0.5).all()
print((peak() - before) / (8 * (2 + 2 * M) ** 2))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the peak of memory is read from /proc")
def test_memory_stays_below_one_covariance_and_a_tenth():
    """All of 1500 landmarks in the map: 72 MB for one covariance, in a process of its own."""
    done = subprocess.run([sys.executable, "-c", LARGE], capture_output=True, text=True, check=True)
    assert 0.3 < float(done.stdout) < 1.1
