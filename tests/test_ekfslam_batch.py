"""The batch optimum, the oracle of the factor files: its Jacobian, a dense solver, and the known chi-square."""

import batch
import numpy as np
import pytest
from datasets import VICTORIA_PARK, drive, needs, write_graph
from scipy.optimize import least_squares

from lab.records import victoria_park


@pytest.fixture
def graph(tmp_path):
    return victoria_park.read(write_graph(tmp_path / "g.txt", drive(steps=12, n_landmarks=5, seed=3)))


def unpacked(graph, v):
    n = len(graph.pose_ids)
    return np.vstack([np.zeros(3), v[: 3 * n - 3].reshape(-1, 3)]), v[3 * n - 3 :].reshape(-1, 2)


def test_its_jacobian_against_differences(graph):
    poses, landmarks = batch.extended(graph, np.zeros((1, 3)), np.zeros((0, 2)))
    v = np.concatenate([poses[1:].ravel(), landmarks.ravel()])
    _, J = batch.residuals(graph, poses, landmarks)
    for column, step in enumerate(1e-6 * np.eye(len(v))):
        ahead, behind = (batch.residuals(graph, *unpacked(graph, v + sign * step))[0] for sign in (1, -1))
        np.testing.assert_allclose(J[:, [column]].toarray()[:, 0], (ahead - behind) / 2e-6, atol=1e-5)


@pytest.mark.parametrize("stride", [5, 700])
def test_a_dense_solver_finds_the_same(graph, stride):
    best = batch.optimum_by_parts(graph, stride)
    poses, landmarks = batch.extended(graph, np.zeros((1, 3)), np.zeros((0, 2)))
    start = np.concatenate([poses[1:].ravel(), landmarks.ravel()])
    dense = least_squares(lambda v: batch.residuals(graph, *unpacked(graph, v))[0], start, xtol=1e-12, ftol=1e-12)
    assert best.chi2 == pytest.approx(2 * dense.cost, rel=1e-8)
    np.testing.assert_allclose(best.landmarks, unpacked(graph, dense.x)[1], atol=1e-5)
    assert best.dof == len(dense.fun) - len(start)


@pytest.mark.long
@needs(VICTORIA_PARK)
def test_victoria_park():
    best = batch.optimum_by_parts(victoria_park.read(VICTORIA_PARK))
    assert best.chi2 == pytest.approx(6183.93, abs=0.005)
    assert best.dof == 6978
    assert best.gradient < 1e-3
