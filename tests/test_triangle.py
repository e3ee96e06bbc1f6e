"""The growing triangle against the whole matrix that it stands for."""

import numpy as np
import pytest
from worlds import covariance

from lab.triangle import Triangle


@pytest.mark.parametrize("panel", [2, 4, 6, 256])
@pytest.mark.parametrize("rank", [1, 3, 7, 64])
def test_is_the_matrix_that_grew(panel, rank):
    rng = np.random.default_rng(0)
    triangle, whole = Triangle(panel, rank), np.zeros((0, 0))
    for grown in (2, 6, 2, 10, 4):
        size = len(whole)
        cross, corner = rng.standard_normal((grown, size)), covariance(rng, grown, 1)
        triangle.append(cross, corner)
        whole = np.block([[whole, cross.T], [cross, corner]])
        W = rng.standard_normal((3, len(whole)))
        triangle.subtract_square(W)
        whole -= W.T @ W
        blocks = np.array([covariance(rng, 2, 1) for _ in range(len(whole) // 2)])
        triangle.add_blocks(blocks)
        for i, block in enumerate(blocks):
            whole[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] += block
        assert triangle.size == len(whole)
        np.testing.assert_allclose(triangle.rows(np.arange(len(whole))), whole, atol=1e-13)
        some = np.flatnonzero(rng.random(len(whole)) < 0.4)
        np.testing.assert_allclose(triangle.rows(some), whole[some], atol=1e-13)
        expected = [whole[i : i + 2, i : i + 2] for i in range(0, len(whole), 2)]
        np.testing.assert_allclose(triangle.blocks(), expected, atol=1e-13)


def test_no_row_is_no_row():
    triangle = Triangle(4)
    assert triangle.rows(np.zeros(0, dtype=int)).shape == (0, 0)
    triangle.append(np.zeros((6, 0)), np.eye(6))
    triangle.subtract_square(np.zeros((0, 6)))
    assert triangle.rows(np.zeros(0, dtype=int)).shape == (0, 6)
    np.testing.assert_array_equal(triangle.rows(np.arange(6)), np.eye(6))


def test_half_a_matrix_is_held_and_changed_in_place():
    triangle = Triangle(8)
    triangle.append(np.zeros((800, 0)), np.eye(800))
    panels = list(triangle._panels)
    triangle.subtract_square(np.ones((1, 800)))
    triangle.append(np.zeros((8, 800)), np.eye(8))
    assert panels[0][0, 0] == 1
    triangle.settle()
    assert all(panel is before for panel, before in zip(triangle._panels, panels, strict=False))
    assert panels[0][0, 0] == 0
    assert sum(panel.nbytes for panel in triangle._panels) < 0.51 * 8 * 808**2
