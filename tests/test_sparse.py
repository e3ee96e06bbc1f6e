"""The problem by its blocks: there and back, drawn as data_simulation draws, and what it refuses."""

from dataclasses import fields, replace

import numpy as np
import pytest
from worlds import BLOCK_WORLDS, WORLDS, block_scenario, covariance, everything, problem

from data_simulation import HANDOUT, TWO_LANDMARKS, data_simulation
from lab.blocks import roots
from lab.problem import LinearGaussianModel, Problem
from lab.simulation import simulate
from lab.solvers import kalman
from lab.sparse import SparseProblem
from lab.validation import InputError


def assert_same(one, other, tolerance=0.0):
    for field in fields(SparseProblem):
        np.testing.assert_allclose(
            getattr(one, field.name), getattr(other, field.name), rtol=0, atol=tolerance, err_msg=field.name
        )


@pytest.mark.parametrize("world", BLOCK_WORLDS)
def test_goes_there_and_back(world):
    given = BLOCK_WORLDS[world]()
    back = SparseProblem.of(given).dense()
    for name in ("F", "B", "m0", "P0"):
        np.testing.assert_array_equal(getattr(back.model, name), getattr(given.model, name), err_msg=name)
    np.testing.assert_array_equal(back.model.Q, given.model.noise_cov)
    for name in ("z", "H", "R"):
        np.testing.assert_array_equal(getattr(back, name), getattr(given, name), err_msg=name)


@pytest.mark.parametrize(
    "scenario",
    [
        HANDOUT,
        TWO_LANDMARKS,
        block_scenario(4),
        block_scenario(4, field_of_view="exogenous"),
        block_scenario(3, field_of_view=everything),
        replace(block_scenario(4), landmark_noise_std=0.1, landmark_cov=(0.1, 0.2, 0.3, 0, 0, 0, 0.4, 0.5)),
        replace(block_scenario(4), robot_cov=((1, 2), (2, 4)), n_steps=1),
    ],
)
def test_draws_the_numbers_of_data_simulation(scenario):
    drawn, truth = simulate(scenario, np.random.default_rng(5))
    simulation = data_simulation(scenario=scenario, rng=5)
    np.testing.assert_allclose(truth, simulation.X.T, rtol=0, atol=1e-12)
    assert_same(drawn, SparseProblem.of(problem(scenario, 5)), 1e-12)


def test_roots_of_semidefinite_blocks_are_real():
    """Blocks of rank 1, whose second pivot is 0 up to rounding of either sign, and of rank 0."""
    v = np.random.default_rng(0).standard_normal((1000, 2)) * [[1, 30]]
    v[0] = 0
    blocks = v[:, :, None] * v[:, None, :]
    found = roots(blocks)
    np.testing.assert_allclose(found @ found.swapaxes(1, 2), blocks, rtol=1e-12, atol=0)
    assert not found[:, 0, 1].any()


def test_what_couples_is_named():
    for world in ("full-5", "landmark-noise"):
        with pytest.raises(InputError, match="P0 couples"):
            SparseProblem.of(WORLDS[world]())
    with pytest.raises(InputError, match="R at k = 8 couples"):
        SparseProblem.of(WORLDS["diffuse"]())
    given = BLOCK_WORLDS["blocks-5"]()
    model = given.model
    k = int(np.argmax(~np.isnan(given.z).all(axis=1)))
    H = given.H.copy()
    H[k, np.flatnonzero(~np.isnan(given.z[k]))[0], 0] *= 2
    with pytest.raises(InputError, match=f"H at k = {k} "):
        SparseProblem.of(replace(given, H=H))
    H = given.H.copy()
    H[k, :, 3] += 1e-3
    with pytest.raises(InputError, match=f"H at k = {k} "):
        SparseProblem.of(replace(given, H=H))
    Q = model.Q.copy()
    Q[2:4, 2:4] = Q[4:6, 4:6] = Q[2:4, 4:6] = Q[4:6, 2:4] = 0.01 * np.eye(2)
    with pytest.raises(InputError, match="Q couples"):
        SparseProblem.of(replace(given, model=replace(model, Q=Q)))
    F = model.F.copy()
    F[4, 0] = 0.1
    with pytest.raises(InputError, match="F and B"):
        SparseProblem.of(replace(given, model=replace(model, F=F)))
    B = model.B.copy()
    B[5] = 0.1
    with pytest.raises(InputError, match="F and B"):
        SparseProblem.of(replace(given, model=replace(model, B=B)))
    P0 = model.P0.copy()
    P0[0, 2] = P0[2, 0] = 1e-3
    with pytest.raises(InputError, match="P0 couples"):
        SparseProblem.of(replace(given, model=replace(model, P0=P0)))
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="measurement_cov couples"):
        simulate(replace(block_scenario(5), measurement_cov=covariance(rng, 10, 0.3)), rng)


def small(**changes):
    given = {
        **{"F": np.eye(2), "B": np.zeros(2), "Q": np.eye(2), "robot_mean": np.zeros(2), "robot_cov": np.eye(2)},
        **{"landmark_means": np.zeros((3, 2)), "landmark_covs": np.tile(np.eye(2), (3, 1, 1))},
        **{"landmark_noise": np.zeros((3, 2, 2)), "n_instants": 4, "instants": [2, 1, 2], "landmarks": [1, 0, 0]},
        **{"z": [[2.1, 2.1], [1, 1], [2, 2]], "R": np.tile(np.eye(2), (3, 1, 1)) * np.array([3, 1, 2])[:, None, None]},
    }
    return SparseProblem(**(given | changes))


def test_sightings_are_sorted_and_arrays_read_only():
    made = small()
    np.testing.assert_array_equal(made.instants, [1, 2, 2])
    np.testing.assert_array_equal(made.landmarks, [0, 0, 1])
    np.testing.assert_array_equal(made.z[:, 0], [1, 2, 2.1])
    np.testing.assert_array_equal(made.R[:, 1, 1], [1, 2, 3])
    landmarks, z, R = made.seen(2)
    np.testing.assert_array_equal(landmarks, [0, 1])
    np.testing.assert_array_equal(z[:, 0], [2, 2.1])
    np.testing.assert_array_equal(R[:, 0, 0], [2, 3])
    assert not len(made.seen(0)[0])
    assert not len(made.seen(3)[0])
    with pytest.raises(ValueError, match="read-only"):
        made.z[0, 0] = 1


def test_negligible_motion_counts_as_none():
    noise = np.tile(np.array([[1e-4, 1e-13], [1e-13, 1e-20]]), (3, 1, 1))
    np.testing.assert_array_equal(small(landmark_noise=noise).landmark_noise, np.tile([[1e-4, 0], [0, 0]], (3, 1, 1)))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"instants": [0, 1, 2]}, "instants must lie between 1 and 3"),
        ({"instants": [1, 2, 4]}, "instants must lie between 1 and 3"),
        ({"instants": [1.0, 2, 2]}, "instants must hold 3 whole numbers"),
        ({"landmarks": [0, 1]}, "landmarks must hold 3 whole numbers"),
        ({"landmarks": [0, 1, 3]}, "landmarks must lie between 0 and 2"),
        ({"landmarks": [1, 0, 1]}, "number 1 twice at k = 2"),
        ({"z": [[1, 1], [np.nan, np.nan], [1, 1]]}, "z must not be NaN in both"),
        ({"z": [[1, 1], [np.inf, 1], [1, 1]]}, "z must be finite"),
        ({"R": np.full((3, 2, 2), np.nan)}, "R at k = 2 is NaN"),
        ({"R": np.tile([[1, 2], [2, 1]], (3, 1, 1))}, r"R\[0\] is not positive semidefinite"),
        ({"landmark_covs": np.tile([[1, 0.1], [0, 1]], (3, 1, 1))}, r"landmark_covs\[0\] is not symmetric"),
        ({"landmark_noise": np.tile([[-1, 0], [0, 1]], (3, 1, 1))}, r"landmark_noise\[0\] is not positive"),
        ({"Q": [[1, 2], [2, 1]]}, "Q is not positive semidefinite"),
        ({"landmark_means": np.zeros((0, 2))}, "at least one landmark"),
        ({"n_instants": 0}, "n_instants must be at least 1"),
        ({"F": np.eye(3)}, r"F must have shape \(2, 2\)"),
    ],
)
def test_bad_fields_are_named(changes, message):
    with pytest.raises(InputError, match=message):
        small(**changes)


def test_one_instant_without_sightings():
    model = LinearGaussianModel(np.eye(4), np.zeros(4), np.eye(4), np.zeros(4), np.eye(4))
    empty = Problem(model, np.full((1, 2), np.nan), np.full((1, 2, 4), np.nan), np.full((1, 2, 2), np.nan))
    assert SparseProblem.of(empty).dense().n_instants == 1


def test_what_does_not_fit_is_said():
    """Terabytes, which no system promises."""
    many = {"landmark_means": np.zeros((200_000, 2))}
    many |= {name: np.zeros((200_000, 2, 2)) for name in ("landmark_covs", "landmark_noise")}
    with pytest.raises(InputError, match="H and R of 200000 landmarks need 10240 GB"):
        small(**many).dense()
    with pytest.raises(InputError, match='need 5120 GB: ask for keep="blocks"'):
        kalman(small(**many))
