"""The types of the estimation problem: what they hold, what they refuse, and how they answer."""

from dataclasses import replace

import numpy as np
import pytest
from worlds import experiment, full_scenario, problem

from data_simulation import HANDOUT, data_simulation
from lab.problem import Experiment, LinearGaussianModel, Problem
from lab.validation import InputError

N, M, n = 50, 5, 12


def test_from_simulation_turns_time_first():
    simulation = data_simulation(scenario=full_scenario(4), rng=3)
    turned = Experiment.from_simulation(simulation)
    for k in (0, 1, 7, 29):
        np.testing.assert_array_equal(turned.problem.z[k], simulation.Z[:, k])
        np.testing.assert_array_equal(turned.problem.H[k], simulation.arrayH[:, :, k])
        np.testing.assert_array_equal(turned.problem.R[k], simulation.arrayR[:, :, k])
        np.testing.assert_array_equal(turned.truth[k], simulation.X[:, k])
    model = turned.problem.model
    for name, original in (("F", "F"), ("B", "B"), ("Q", "Qw"), ("m0", "mX0"), ("P0", "PX0")):
        np.testing.assert_array_equal(getattr(model, name), getattr(simulation, original))
    np.testing.assert_array_equal(turned.centre, simulation.CC)


def test_seen_drops_rows_and_for_r_columns():
    world = problem(full_scenario(4), seed=1)
    assert len({len(world.seen(k)[0]) for k in range(world.n_instants)}) > 1
    for k in range(world.n_instants):
        z, H, R = world.seen(k)
        rows = [i for i in range(8) if not np.isnan(world.z[k, i])]
        np.testing.assert_array_equal(z, [world.z[k, i] for i in rows])
        np.testing.assert_array_equal(H, np.array([world.H[k, i] for i in rows]).reshape(-1, 10))
        expected = np.array([[world.R[k, i, j] for j in rows] for i in rows]).reshape(len(rows), len(rows))
        np.testing.assert_array_equal(R, expected)


def test_sizes():
    world = problem()
    assert (world.n_instants, world.n_landmarks) == (N, M)


def test_arrays_are_copies_and_read_only():
    m0 = HANDOUT.landmark_means.ravel()
    own = np.concatenate([[0.0, 0.0], m0])
    world = experiment()
    model = world.problem.model
    fresh = LinearGaussianModel(model.F, model.B, model.Q, own, model.P0)
    own[0] = 99
    assert fresh.m0[0] == 0
    for array in (fresh.F, fresh.m0, fresh.noise_cov, world.problem.z, world.problem.H, world.truth, world.centre):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


def test_h_and_r_are_blanked_where_nothing_is_seen():
    world = problem()
    full_H = np.broadcast_to(np.hstack([np.kron(np.ones((M, 1)), -np.eye(2)), np.eye(2 * M)]), world.H.shape)
    full_R = np.broadcast_to(0.15**2 * np.eye(2 * M), world.R.shape)
    blanked = Problem(world.model, world.z, full_H, full_R)
    np.testing.assert_array_equal(blanked.H, world.H)
    np.testing.assert_array_equal(blanked.R, world.R)


def test_landmark_noise_is_added_to_the_model():
    world = problem(full_scenario(3))
    noisy = world.with_landmark_noise(0.2)
    expected = world.model.Q + np.diag([0, 0] + [0.04] * 6)
    np.testing.assert_allclose(noisy.model.Q, expected)
    np.testing.assert_array_equal(noisy.z, world.z)
    assert not world.model.noise_cov[2:].any()
    np.testing.assert_array_equal(world.with_landmark_noise(0).model.Q, world.model.Q)


def test_negligible_noise_of_a_landmark_counts_as_none_but_never_the_robots():
    model = problem().model
    np.testing.assert_allclose(model.noise_cov, np.diag([0.04, 0.04] + [0] * 10))
    Q = np.diag([1e-30, 0.04] + [1e-30, 1e-12] + [0] * 8)
    small = replace(model, Q=Q, P0=np.diag([1.0, 1.0] + [0.2] * 10))
    np.testing.assert_array_equal(small.noise_cov, np.diag([1e-30, 0.04, 0, 1e-12] + [0] * 8))
    known = replace(model, Q=Q, P0=np.zeros((12, 12)))  # a landmark known exactly: any noise is more than its prior
    np.testing.assert_array_equal(known.noise_cov, Q)


def test_real_motion_under_a_diffuse_prior_is_not_negligible():
    model = replace(problem().model, P0=np.diag([0.0, 0] + [1e12] * 10), Q=np.diag([0.04, 0.04] + [2.5e-5] * 10))
    np.testing.assert_array_equal(model.noise_cov, model.Q)


def test_symmetry_is_held_to_rounding():
    model = problem().model
    skew = np.zeros((12, 12))
    skew[3, 4] = 0.2
    with pytest.raises(InputError, match="P0 is not symmetric"):
        replace(model, P0=model.P0 + 1e-6 * skew)
    replace(model, P0=model.P0 + 1e-12 * skew)


def test_a_mask_is_not_lost_in_silence():
    model = problem().model
    with pytest.raises(InputError, match="a mask would be lost"):
        replace(model, F=np.ma.array(model.F, mask=model.F == 0))


def test_moving_components():
    model = problem().model
    np.testing.assert_array_equal(model.moving, [0, 1])
    F = model.F.copy()
    F[7, 3] = 0.1
    np.testing.assert_array_equal(replace(model, F=F).moving, [0, 1, 7])
    B = model.B.copy()
    B[5] = 1
    np.testing.assert_array_equal(replace(model, B=B).moving, [0, 1, 5])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"F": np.eye(11)}, r"F must have shape \(12, 12\), not \(11, 11\)"),
        ({"B": np.zeros((12, 1))}, r"B must have shape \(12,\), not \(12, 1\)"),
        ({"m0": np.zeros(11)}, "2 \\+ 2M components"),
        ({"m0": np.zeros(2)}, "2 \\+ 2M components"),
        ({"Q": np.full((12, 12), np.nan)}, "Q must be finite, but holds NaN"),
        ({"Q": np.full((12, 12), np.inf)}, "Q must be finite, but holds infinite"),
        ({"Q": np.triu(np.full((12, 12), 0.1))}, "Q is not symmetric: entry"),
        ({"P0": -np.eye(12)}, "P0 is not positive semidefinite: it has a negative variance"),
        ({"P0": np.eye(12) - 0.5}, "P0 is not positive semidefinite: its smallest eigenvalue is -5"),
        ({"P0": np.ones((12, 12)) - np.eye(12)}, "P0 is not positive semidefinite"),
        ({"m0": np.array(["a"] * 12)}, "m0 must hold real numbers"),
        ({"m0": np.zeros(12, dtype=complex)}, "m0 must hold real numbers"),
        ({"m0": np.zeros(12, dtype=bool)}, "m0 must hold real numbers"),
        ({"m0": [[1, 2], [3]]}, "m0 must be a rectangular array"),
    ],
)
def test_bad_models_are_named(changes, message):
    with pytest.raises(InputError, match=message):
        replace(problem().model, **changes)


def test_a_small_indefinite_block_is_not_hidden_by_large_variances():
    P0 = np.diag([1e6] * 12)
    P0[:2, :2] = [[1e-8, 2e-8], [2e-8, 1e-8]]
    with pytest.raises(InputError, match="P0 is not positive semidefinite"):
        replace(problem().model, P0=P0)


def test_singular_covariances_are_welcome():
    model = problem().model
    vector = np.arange(12.0)
    replace(model, Q=np.zeros((12, 12)), P0=np.outer(vector, vector))


def changed(array, index, value):
    array = array.copy()
    array[index] = value
    return array


def test_bad_problems_are_named():
    world = problem()
    k = int(np.argmax(~np.isnan(world.z).all(axis=1)))
    row = int(np.argmax(~np.isnan(world.z[k])))
    unseen_H = changed(world.H, (k, row), np.nan)
    lopsided = changed(world.R, (k, row, row + 1), 0.01)
    indefinite = changed(world.R, (k, row, row), -1.0)
    for changes, message in (
        ({"z": world.z[:, :8]}, r"z must have shape \(any, 10\), not \(50, 8\)"),
        ({"z": world.z.T}, r"z must have shape \(any, 10\), not \(10, 50\)"),
        ({"z": world.z[:0]}, "at least one instant"),
        ({"H": world.H[:-1]}, r"H must have shape \(50, 10, 12\), not \(49, 10, 12\)"),
        ({"R": world.R[:, :8]}, r"R must have shape \(50, 10, 10\)"),
        ({"z": changed(world.z, 0, 1.0)}, "z must be NaN at k = 0"),
        ({"z": changed(world.z, (k, row), np.inf)}, "z must be finite"),
        ({"H": unseen_H}, f"H at k = {k} is NaN where z has a value"),
        ({"R": changed(world.R, (k, row, row), np.nan)}, f"R at k = {k} is NaN where z has a value"),
        ({"R": lopsided}, f"R at k = {k} is not symmetric"),
        ({"R": indefinite}, f"R at k = {k} is not positive semidefinite"),
    ):
        with pytest.raises(InputError, match=message):
            replace(world, **changes)


@pytest.mark.parametrize("std", [-1.0, np.nan, np.inf, "much", [0.1, 0.2]])
def test_bad_landmark_noise(std):
    with pytest.raises(InputError, match="The landmark noise must"):
        problem().with_landmark_noise(std)


def test_bad_experiments_are_named():
    world = experiment()
    with pytest.raises(InputError, match=r"truth must have shape \(50, 12\), not \(12, 50\)"):
        replace(world, truth=world.truth.T)
    with pytest.raises(InputError, match=r"centre must have shape \(2,\)"):
        replace(world, centre=[1, 2, 3])
    assert replace(world, truth=None).truth is None
