"""Products entry by entry: the numbers of a product of matrices, and where they pay."""

import numpy as np
import pytest
from test_blocked import TWIN_WORLDS
from test_proposals import PROPOSALS
from worlds import full_scenario, problem

from lab.problem import LinearGaussianModel, Problem
from lab.solvers.plan import plan
from lab.solvers.steps import steps_of
from lab.solvers.terms import MANY, combine, pay, terms_of


def test_the_product_of_two_matrices():
    rng = np.random.default_rng(0)
    matrix = rng.standard_normal((6, 5)) * (rng.random((6, 5)) < 0.5)
    matrix[2] = 0
    read, made = rng.standard_normal((5, 300)), np.full((6, 300), np.nan)
    combine(terms_of(matrix), read, made)
    np.testing.assert_allclose(made, matrix @ read, rtol=0, atol=1e-14)


def test_parts_of_rows_further_apart():
    """As those of a block of a cloud: what lies beside it stays as it is."""
    rng = np.random.default_rng(1)
    matrix, read, made = rng.standard_normal((2, 3)), rng.standard_normal((3, 900)), np.zeros((2, 900))
    combine(terms_of(matrix), read[:, 200:500], made[:, 200:500])
    np.testing.assert_allclose(made[:, 200:500], (matrix @ read)[:, 200:500], rtol=0, atol=1e-14)
    assert not made[:, :200].any()
    assert not made[:, 500:].any()


def test_rows_may_be_made_of_rows_before_them():
    read, made = np.array([[1.0, 2.0], [10.0, 20.0]]), np.empty((3, 2))
    combine([[(0, 2.0), (1, 1.0)], [(2, -1.0), (0, 1.0)], [(3, 3.0)]], read, made)
    np.testing.assert_array_equal(made, [[12, 24], [-11, -22], [-33, -66]])


def pulled():
    """Return a world whose first landmark pulls the robot: it is measured, read by the motion, and stays as it is."""
    world = problem(full_scenario(2))
    model, F = world.model, world.model.F.copy()
    F[:2, 2:4] = 0.1 * np.eye(2)
    return Problem(LinearGaussianModel(F, model.B, model.Q, model.m0, model.P0), world.z, world.H, world.R)


TERM_WORLDS = TWIN_WORLDS | {"pulled": pulled}


@pytest.mark.parametrize("world", TERM_WORLDS)
@pytest.mark.parametrize("name", PROPOSALS)
def test_the_terms_of_a_step_are_its_matrix(world, name):
    for step in steps_of(plan(TERM_WORLDS[world](), PROPOSALS[name])):
        read = np.eye(step.map.shape[1])
        made = np.empty((len(step.map), len(read)))
        combine(step.terms, read, made)
        np.testing.assert_allclose(made, step.map, rtol=0, atol=1e-13 * np.abs(step.map).max(initial=0))


def test_a_measurement_of_rows_that_have_just_changed_reads_these():
    """Two passes for two coordinates, where the motion alone turns one into the other."""
    steps = steps_of(plan(TWIN_WORLDS["handout"](), PROPOSALS["prior"]))
    seen = [step for step in steps if len(step.expected)]
    assert seen
    for step in seen:
        assert all(len(row) == 1 for row in step.terms[len(step.gain) :])
        assert all(np.count_nonzero(row) > 1 for row in step.map[len(step.gain) :])


def test_where_it_pays():
    turn, full = terms_of(np.eye(4, k=1)), terms_of(np.ones((9, 9)))
    assert pay(turn, 4, MANY)
    assert not pay(turn, 4, MANY - 1)
    assert not pay(full, 9, MANY)
