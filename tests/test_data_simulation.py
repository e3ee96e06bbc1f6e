"""The simulator: against the original's recorded outputs, a naive twin written with loops, and the law it promises."""

import dataclasses
import itertools
import math
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st

import data_simulation as simulator
from data_simulation import HANDOUT, TWO_LANDMARKS, Draws, Scenario, Simulation, animate, data_simulation

NAMES = list(Simulation._fields)
REFERENCE = Path(__file__).parent / "reference"
SOURCE = Path(simulator.__file__)
QUICK = dataclasses.replace(HANDOUT, n_steps=3)
TOO_FAR = 5.0  # standard errors: some 300 numbers are tested with fixed seeds, a false alarm has probability 2e-4


def full_covariance(rng, side, scale):
    root = scale * rng.standard_normal((side, side + 2))
    return root @ root.T / side


def everything(z, o):
    return np.ones(len(z), dtype=bool)


def nothing(z, o):
    return np.zeros(len(z), dtype=bool)


def full_scenario(M, n_steps, seed=0, **changes):
    """Return a scenario that no symmetry protects: full covariances that differ from landmark to landmark."""
    rng = np.random.default_rng([seed, M])
    fields = {
        "n_steps": n_steps,
        "dt": 0.3,
        "omega": -1.7,
        "centre": (0.8, -2.5),
        "robot_mean": (1.0, 0.5),
        "robot_cov": full_covariance(rng, 2, 0.7),
        "landmark_means": rng.uniform(-5, 5, (M, 2)),
        "landmark_cov": full_covariance(rng, 2 * M, 0.5),
        "robot_noise_cov": full_covariance(rng, 2, 0.4),
        "landmark_noise_std": 0.05,
        "measurement_cov": full_covariance(rng, 2 * M, 0.3),
    }
    return Scenario(**(fields | changes))


def normals(scenario, seed):
    rng, N, M = np.random.default_rng(seed), scenario.n_steps, scenario.n_landmarks
    return Draws(rng.normal(size=(2 + 2 * M, N)), rng.normal(size=(2 * M, N)), rng.normal(size=2 + 2 * M))


def assert_same(got, expected):
    for name in NAMES:
        np.testing.assert_allclose(
            getattr(got, name),
            expected[name],
            rtol=0,
            atol=1e-12,
            equal_nan=True,
            err_msg=name,
            strict=name not in "NM",
        )


# ------------------------------------------------------------------------------------------------ original and twin


@pytest.mark.parametrize("number", [1, 2, 3])
def test_reference_outputs(number):
    original = scipy.io.loadmat(REFERENCE / f"experiment_{number}.mat")
    draws = Draws(original["draw_w"], original["draw_v"], original["draw_x0"][:, 0])
    simulation = data_simulation(draws=draws)
    flat = {name: original[name].ravel() if name in ("T", "B", "CC", "mX0") else original[name] for name in NAMES}
    assert_same(simulation, flat | {"N": original["N"].item(), "M": original["M"].item()})
    assert isinstance(simulation.N, int)
    assert isinstance(simulation.M, int)


def twin(scenario, draws, seen_at=None):
    """Simulate with a loop over every index; `seen_at` (M, N) overrides the rule outward-ahead."""
    N, M, means = scenario.n_steps, scenario.n_landmarks, np.asarray(scenario.landmark_means)
    n, angle, c = 2 + 2 * M, scenario.omega * scenario.dt, np.asarray(scenario.centre)
    F, B, Hfull = np.zeros((n, n)), np.zeros(n), np.zeros((2 * M, n))
    for i in range(n):
        F[i, i] = 1
    F[0, 0] = F[1, 1] = math.cos(angle)
    F[1, 0], F[0, 1] = math.sin(angle), -math.sin(angle)
    B[0] = c[0] - F[0, 0] * c[0] - F[0, 1] * c[1]
    B[1] = c[1] - F[1, 0] * c[0] - F[1, 1] * c[1]
    P0, Q, R, m0 = np.zeros((n, n)), np.zeros((n, n)), np.array(scenario.measurement_cov), np.zeros(n)
    for i, j in itertools.product(range(n), repeat=2):
        if i < 2 and j < 2:
            P0[i, j], Q[i, j] = scenario.robot_cov[i, j], scenario.robot_noise_cov[i, j]
        elif i >= 2 and j >= 2:
            P0[i, j] = scenario.landmark_cov[i - 2, j - 2]
            Q[i, j] = scenario.landmark_noise_std**2 if i == j else 0
    for m in range(M):
        Hfull[2 * m, 0] = Hfull[2 * m + 1, 1] = -1
        Hfull[2 * m, 2 + 2 * m] = Hfull[2 * m + 1, 3 + 2 * m] = 1
        m0[2 + 2 * m], m0[3 + 2 * m] = means[m]
    m0[:2] = scenario.robot_mean
    L0, LQ, LR = np.linalg.cholesky(P0), np.linalg.cholesky(Q), np.linalg.cholesky(R)
    X, Z, T = np.zeros((n, N)), np.full((2 * M, N), np.nan), np.zeros(N)
    H, Rk, in_fov = np.full((2 * M, n, N), np.nan), np.full((2 * M, 2 * M, N), np.nan), np.full((2 * M, N), np.nan)
    X[:, 0] = m0 + L0 @ draws.x0
    for k in range(1, N):
        T[k] = k * scenario.dt
        X[:, k] = F @ X[:, k - 1] + B + LQ @ draws.w[:, k - 1]
        o, v, rows = X[:2, k] - c, LR @ draws.v[:, k], []
        for m in range(M):
            dx, dy = X[2 + 2 * m : 4 + 2 * m, k] - X[:2, k]
            seen = dx * o[0] + dy * o[1] >= 0 and -dx * o[1] + dy * o[0] >= 0
            if seen if seen_at is None else seen_at[m, k]:
                rows += [2 * m, 2 * m + 1]
                Z[2 * m, k], Z[2 * m + 1, k] = dx + v[2 * m], dy + v[2 * m + 1]
        for i in rows:
            in_fov[i, k] = 1
            H[i, :, k] = Hfull[i]
            for j in rows:
                Rk[i, j, k] = R[i, j]
    values = N, T, M, Z, H, Rk, in_fov, F, B, c, Hfull, m0, P0, Q, R, X
    return dict(zip(NAMES, values, strict=True))


@pytest.mark.parametrize("n_steps", [1, 2, 7])
@pytest.mark.parametrize("M", [1, 3, 20])
def test_twin_on_full_covariances(M, n_steps):
    scenario = full_scenario(M, n_steps)
    draws = normals(scenario, seed=5)
    assert_same(data_simulation(scenario=scenario, draws=draws), twin(scenario, draws))


def test_twin_meets_every_case_of_visibility():
    scenario = full_scenario(6, 40, centre=(0, 0), robot_noise_cov=full_covariance(np.random.default_rng(1), 2, 0.1))
    simulation = data_simulation(scenario=scenario, draws=normals(scenario, 1))
    assert set((simulation.in_fov == 1).sum(axis=0)) >= {0, 2, 4, 6}
    assert_same(simulation, twin(scenario, normals(scenario, 1)))


@pytest.mark.parametrize(("rule", "seen"), [(everything, True), (nothing, False)])
def test_everything_or_nothing_seen(rule, seen):
    scenario = full_scenario(3, 7, field_of_view=rule)
    draws = normals(scenario, 2)
    simulation = data_simulation(scenario=scenario, draws=draws)
    assert_same(simulation, twin(scenario, draws, np.full((3, 7), seen)))
    assert np.isfinite(simulation.arrayR[:, :, 1:]).all() == seen  # the blocks between landmarks are there, and full
    assert np.isnan(simulation.arrayR[:, :, 0]).all()


def test_order_of_the_outputs():
    order = "N T M Z arrayH arrayR in_fov F B CC Hfull mX0 PX0 Qw Rv X"
    assert " ".join(Simulation._fields) == order


def test_handout_facts():
    N, T, M, Z, arrayH, arrayR, in_fov, F, B, CC, Hfull, mX0, PX0, Qw, Rv, X = data_simulation(rng=0)
    assert (N, M, Z.shape, arrayH.shape, arrayR.shape) == (50, 5, (10, 50), (10, 12, 50), (10, 10, 50))
    assert (in_fov.shape, F.shape, Hfull.shape, X.shape) == ((10, 50), (12, 12), (10, 12), (12, 50))
    assert T.tolist() == list(range(50))
    assert CC.tolist() == [-1.5, 0]
    assert mX0.tolist() == [0, 0, -2, 4, -4, 2, -4, -2, -2, -4, 4, -2]
    np.testing.assert_allclose(PX0, np.diag([0, 0] + [0.2] * 10), rtol=1e-15)
    np.testing.assert_allclose(Qw, np.diag([0.04] * 2 + [1e-20] * 10), rtol=1e-15)
    np.testing.assert_allclose(Rv, 0.0225 * np.eye(10), rtol=1e-15)
    np.testing.assert_allclose(B[:2], (np.eye(2) - F[:2, :2]) @ CC, atol=1e-15)
    assert (X[:2, 0] == 0).all()
    counts = (np.nansum([data_simulation(rng=seed).in_fov for seed in range(60)], axis=1) / 2)[:, 1:]
    assert counts.max() <= 3
    shares = [np.mean(counts == count) for count in (0, 1, 2)]
    assert shares == pytest.approx([0.27, 0.62, 0.10], abs=0.06)


# ------------------------------------------------------------------------------------------------ visibility


def test_two_landmarks_older_edition():
    seen_ever = 0
    for seed in range(20):
        sim = data_simulation(scenario=TWO_LANDMARKS, rng=seed)
        z = (sim.Hfull @ sim.X).reshape(2, 2, 50)
        for m, k in itertools.product(range(2), range(50)):
            seen = k > 0 and z[m, 0, k] > 0 and z[m, 1, k] > 0
            assert np.array_equal(sim.in_fov[2 * m : 2 * m + 2, k], [1 if seen else np.nan] * 2, equal_nan=True)
            seen_ever += seen
    assert 0 < seen_ever < 20 * 98
    assert (sim.N, sim.M, sim.T[1]) == (50, 2, 1)
    assert not sim.B.any()
    assert not sim.CC.any()
    assert sim.mX0.tolist() == [2, 0, -1, 4, 4, -1]
    np.testing.assert_allclose(np.diag(sim.PX0), [0.1, 0.2, 0.2, 0.2, 0.2, 0.2])
    np.testing.assert_allclose(np.diag(sim.Qw), [0.0025] * 2 + [1e-20] * 4)
    np.testing.assert_allclose(sim.Rv, 0.01 * np.eye(4), atol=1e-16)


def test_north_east_boundary_is_not_seen_and_outward_ahead_boundary_is():
    still = {"n_steps": 2, "omega": 0, "robot_noise_cov": 0, "landmark_cov": 0, "landmark_noise_std": 0}
    fields = {"centre": (0, 0), "robot_mean": (1, 0), "landmark_means": [(2, 0), (1, 2), (2, 2), (0.5, 2), (2, -0.5)]}
    for rule, expected in (("north-east", [0, 0, 1, 0, 0]), ("outward-ahead", [1, 1, 1, 0, 0])):
        sim = data_simulation(scenario=Scenario(**still, **fields, field_of_view=rule), rng=0)
        assert np.isfinite(sim.in_fov[::2, 1]).tolist() == [bool(value) for value in expected]


def test_masks_and_noise_free_visibility():
    # With this noise the sign of a noisy component is nearly a coin toss.
    scenario = full_scenario(4, 60, measurement_cov=400.0)
    simulation = data_simulation(scenario=scenario, rng=3)
    noisy = 0
    for k, m in itertools.product(range(1, 60), range(4)):
        pair = slice(2 * m, 2 * m + 2)
        o = simulation.X[:2, k] - simulation.CC
        z = simulation.X[2 + 2 * m : 4 + 2 * m, k] - simulation.X[:2, k]
        seen = z @ o >= 0 and z @ (-o[1], o[0]) >= 0
        assert np.isfinite(simulation.Z[pair, k]).all() == seen
        noisy += seen and (simulation.Z[pair, k] @ o < 0)
    assert noisy > 5
    assert set(simulation.in_fov[np.isfinite(simulation.in_fov)]) == {1.0}
    gone = np.isnan(simulation.in_fov)
    assert gone[:, 0].all()
    assert (np.isnan(simulation.Z) == gone).all()
    assert (np.isnan(simulation.arrayH) == gone[:, None]).all()
    assert (np.isnan(simulation.arrayR) == (gone[:, None] | gone[None])).all()


def test_custom_rule_gets_noise_free_z_and_offset_from_the_centre():
    calls = []

    def rule(z, o):
        calls.append((z.copy(), o.copy()))
        z[:] = o[:] = np.nan  # whatever it does to its arguments stays with it
        return np.array([True, False, True])

    scenario = full_scenario(3, 4, field_of_view=rule)
    simulation = data_simulation(scenario=scenario, draws=normals(scenario, 0))
    expected = np.tile(np.array([True, False, True])[:, None], 4)
    assert_same(simulation, twin(scenario, normals(scenario, 0), expected))
    assert len(calls) == 3  # k = 1, 2, 3
    for k, (z, o) in enumerate(calls, start=1):
        np.testing.assert_allclose(z, (simulation.Hfull @ simulation.X[:, k]).reshape(3, 2))
        np.testing.assert_allclose(o, simulation.X[:2, k] - simulation.CC)


@pytest.mark.parametrize("answer", [[True], [[True], [True]], [1, 0], [1.0, 0.0], None, "yes", [True, False, True]])
def test_custom_rule_with_a_wrong_answer(answer):
    scenario = dataclasses.replace(TWO_LANDMARKS, field_of_view=lambda z, o: answer)
    with pytest.raises(
        ValueError, match=r"^the field_of_view function must return bool \(2,\), but returned .* at k = 1$"
    ):
        data_simulation(scenario=scenario, rng=0)


def test_truth_does_not_depend_on_the_field_of_view():
    truths = []
    for rule in ("outward-ahead", "north-east", "exogenous", everything):
        sim = data_simulation(scenario=full_scenario(3, 9, field_of_view=rule), rng=11)
        truths.append((sim.X, sim.Z))
    X, Z = truths[-1]
    for other_X, other_Z in truths[:-1]:
        assert (other_X == X).all()
        both = np.isfinite(other_Z)
        assert (other_Z[both] == Z[both]).all()


@pytest.mark.parametrize("given_draws", [False, True])
def test_exogenous_trajectory_is_drawn_last_and_from_the_same_model(given_draws):
    slippage = full_covariance(np.random.default_rng(1), 2, 0.2)
    scenario = full_scenario(3, 30, field_of_view="exogenous", centre=(0, 0), robot_noise_cov=slippage)
    rng = np.random.default_rng(8)
    own = Draws(rng.normal(size=(8, 30)), rng.normal(size=(6, 30)), rng.normal(size=8))
    noise, first = rng.normal(size=(2, 30)), rng.normal(size=2)
    # The other robot is a world of its own, whose landmarks are exactly where the prior means are.
    alone = dataclasses.replace(scenario, landmark_cov=np.eye(6), landmark_noise_std=1.0, field_of_view="outward-ahead")
    draws = Draws(np.vstack([noise, np.zeros((6, 30))]), np.zeros((6, 30)), np.append(first, np.zeros(6)))
    seen = np.isfinite(twin(alone, draws)["in_fov"][::2])
    assert 10 < seen.sum() < 80
    used = normals(scenario, 77) if given_draws else own
    assert_same(
        data_simulation(scenario=scenario, rng=8, draws=used if given_draws else None), twin(scenario, used, seen)
    )


def test_exogenous_visibility_tells_nothing_about_the_state():
    # The landmarks sit on the edges of the first field of view, so that who sees them is a matter of chance.
    runs = 1200
    base = {"n_steps": 2, "robot_cov": 0.1, "landmark_means": [(1.0, 2.5), (-2.0, 2.6)]}

    def worst_z_score(rule):
        seen, states = np.empty((runs, 2)), np.empty((runs, 6))
        rng = np.random.default_rng(4)
        scenario = dataclasses.replace(HANDOUT, **base, field_of_view=rule)
        for run in range(runs):
            simulation = data_simulation(scenario=scenario, rng=rng)
            seen[run], states[run] = np.isfinite(simulation.in_fov[::2, 1]), simulation.X[:, 1]
        assert (abs(seen.mean(axis=0) - 0.5) < 0.3).all()
        # A correlation of independent variables has standard error 1/sqrt(runs).
        return abs(np.corrcoef(seen.T, states.T)[:2, 2:]).max() * math.sqrt(runs)

    assert worst_z_score("exogenous") < 4  # of 12: a false alarm in 1300
    assert worst_z_score("outward-ahead") > 10


# ------------------------------------------------------------------------------------------------ law of the draws


def assert_moments(sample, cov):
    """Compare (d, runs) with N(0, cov): means have variance C_ii/runs, covariances (C_ii C_jj + C_ij^2)/runs."""
    runs, variances = sample.shape[1], np.diag(cov)
    assert abs(sample.mean(axis=1) / np.sqrt(variances / runs)).max() < TOO_FAR
    error = sample @ sample.T / runs - cov
    assert abs(error / np.sqrt((np.outer(variances, variances) + cov**2) / runs)).max() < TOO_FAR


def test_moments_of_the_noises():
    scenario = full_scenario(2, 20_000, landmark_noise_std=0.3, field_of_view=everything)
    sim = data_simulation(scenario=scenario, rng=1)
    assert_moments(sim.X[:, 1:] - sim.F @ sim.X[:, :-1] - sim.B[:, None], scenario.Qw)
    assert_moments((sim.Z - sim.Hfull @ sim.X)[:, 1:], np.asarray(scenario.measurement_cov))


def test_moments_of_the_prior():
    scenario, rng = full_scenario(2, 1), np.random.default_rng(2)
    sample = np.array([data_simulation(scenario=scenario, rng=rng).X[:, 0] for _ in range(2000)]).T
    assert_moments(sample - np.append(scenario.robot_mean, scenario.landmark_means)[:, None], scenario.P0)


def factors(scenario):
    """Read the factors L_P0, L_Q, L_R off the outputs, one column per unit draw."""
    columns = [[], [], []]
    scenario = dataclasses.replace(scenario, n_steps=2, field_of_view=everything)
    n = 2 + 2 * scenario.n_landmarks
    for j in range(n):
        w, v, x0 = np.zeros((n, 2)), np.zeros((n - 2, 2)), np.zeros(n)
        x0[j] = 1
        sim = data_simulation(scenario=scenario, draws=Draws(w, v, x0))
        columns[0].append(sim.X[:, 0] - sim.mX0)
        w[j, 0] = 1
        sim = data_simulation(scenario=scenario, draws=Draws(w, v, 0 * x0))
        columns[1].append(sim.X[:, 1] - sim.F @ sim.mX0 - sim.B)
        if j < n - 2:
            v[j, 1] = 1
            sim = data_simulation(scenario=scenario, draws=Draws(0 * w, v, 0 * x0))
            columns[2].append(sim.Z[:, 1] - sim.Hfull @ sim.X[:, 1])
    return [np.transpose(factor) for factor in columns]


ORIGIN = Scenario(
    landmark_means=np.zeros((2, 2)), centre=(0, 0)
)  # means of zero, so that 1e-10 is not lost beside them
LINE = np.outer([1.0, -2, 0.5, 3], [1.0, -2, 0.5, 3])


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {
            "robot_cov": [[4, 2], [2, 1]],
            "landmark_cov": LINE,
            "measurement_cov": LINE,
            "robot_noise_cov": [[1, -3], [-3, 9]],
        },
        {"landmark_cov": [0, 1, 0, 2], "measurement_cov": np.diag([0, 1e-20, 4, 0]), "robot_noise_cov": [0, 0.3]},
        {"landmark_cov": np.pad(LINE[:3, :3], (1, 0)), "measurement_cov": 0, "landmark_noise_std": 0},
        {"measurement_cov": np.outer([1e-9, 1, 1e-4, 1], [1e-9, 1, 1e-4, 1]) * (1 + np.eye(4))},
    ],
    ids=["handout", "rank one", "zeros", "leading zero", "scales"],
)
def test_factors_of_singular_covariances(changes):
    scenario = dataclasses.replace(ORIGIN, **changes)
    for factor, cov in zip(factors(scenario), (scenario.P0, scenario.Qw, scenario.Rv), strict=True):
        assert (np.triu(factor, 1) == 0).all()
        deviation = np.sqrt(np.diag(cov))
        # Entry by entry and relative to the two deviations: 1e-20 is to be right beside 0.04.
        assert (abs(factor @ factor.T - cov) <= 1e-13 * np.outer(deviation, deviation)).all()


@settings(deadline=None, max_examples=25, derandomize=True)
@given(st.integers(0, 4), st.integers(0, 10**6), st.lists(st.integers(-9, 3), min_size=4, max_size=4))
def test_factor_of_any_rank_and_scale(rank, seed, exponents):
    root = np.random.default_rng(seed).standard_normal((4, rank)) * 10.0 ** np.array(exponents)[:, None]
    scenario = dataclasses.replace(ORIGIN, landmark_cov=root @ root.T)
    factor, cov = factors(scenario)[0], scenario.P0
    deviation = np.sqrt(np.diag(cov))
    assert (abs(factor @ factor.T - cov) <= 1e-6 * np.outer(deviation, deviation)).all()


def test_rounding_errors_are_no_further_directions():
    rng = np.random.default_rng(0)
    for _ in range(20):
        line = rng.standard_normal(4)
        factor = factors(dataclasses.replace(ORIGIN, landmark_cov=np.outer(line, line)))[0]
        assert factor.any(axis=0).tolist() == [False, False, True, False, False, False]


def test_landmarks_of_the_handout_move_by_the_tiny_noise():
    # 1e-20 stands beside 0.04 in Qw and must not be taken for zero.
    sim = data_simulation(scenario=ORIGIN, draws=Draws(np.ones((6, 50)), np.zeros((4, 50)), np.zeros(6)))
    np.testing.assert_allclose(sim.X[2:], np.tile(1e-10 * np.arange(50), (4, 1)), rtol=1e-12)


# ------------------------------------------------------------------------------------------------ randomness


def test_draws_and_seeds():
    rng = np.random.default_rng(21)
    draws = Draws(rng.standard_normal((12, 50)), rng.standard_normal((10, 50)), rng.standard_normal(12))
    expected = data_simulation(draws=draws)._asdict()
    for same in (21, np.int64(21), np.uint8(21), np.random.default_rng(21)):
        assert_same(data_simulation(rng=same), expected)
    assert (data_simulation().X != data_simulation().X).any()
    generator = np.random.default_rng(0)
    assert (data_simulation(rng=generator).X != data_simulation(rng=generator).X).any()


def test_global_generator_is_left_alone():
    before = np.random.get_state()  # noqa: NPY002
    data_simulation(rng=0)
    data_simulation()
    after = np.random.get_state()  # noqa: NPY002
    assert (after[1] == before[1]).all()
    assert after[2:] == before[2:]


def test_outputs_are_the_callers_own():
    first = data_simulation(rng=0)
    for name in ("CC", "mX0", "PX0", "Rv", "F"):
        getattr(first, name)[:] = 99
    second = data_simulation(rng=0)
    assert second.CC.tolist() == [-1.5, 0]
    assert second.Rv[0, 0] == pytest.approx(0.0225)
    draws = normals(TWO_LANDMARKS, 0)
    copy = Draws(*(array.copy() for array in draws))
    data_simulation(scenario=TWO_LANDMARKS, draws=draws)
    assert all((a == b).all() for a, b in zip(draws, copy, strict=True))


@pytest.mark.parametrize("bad", [True, 1.0, "7", [1], np.random.RandomState(0), np.True_, np.random])
def test_bad_rng(bad):
    with pytest.raises(TypeError, match=r"^rng must be None, an integer seed or a numpy.random.Generator, not "):
        data_simulation(rng=bad)


def test_negative_seed():
    with pytest.raises(ValueError, match=r"^rng must be a seed >= 0, not -1$"):
        data_simulation(rng=-1)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"w": np.zeros((6, 49))}, r"draws\.w must have shape \(6, 50\); its shape is \(6, 49\)"),
        ({"v": np.zeros((50, 4))}, r"draws\.v must have shape \(4, 50\); its shape is \(50, 4\)"),
        ({"x0": np.zeros((1, 6))}, r"draws\.x0 must have shape \(6,\); its shape is \(1, 6\)"),
        ({"x0": np.full(6, np.nan)}, r"draws\.x0 must be finite, but holds NaN or infinity"),
        ({"v": np.zeros((4, 50), complex)}, r"draws\.v must be an array \(4, 50\) of real numbers, not .*complex128\)"),
    ],
)
def test_bad_draws(changes, message):
    with pytest.raises(ValueError, match=f"^{message}$"):
        data_simulation(scenario=TWO_LANDMARKS, draws=normals(TWO_LANDMARKS, 0)._replace(**changes))


def test_draws_as_matlab_has_them_and_plot_as_it_takes_it():
    w, v, x0 = normals(HANDOUT, 0)
    column = data_simulation(0, draws=(w, v, x0[:, None]))
    np.testing.assert_array_equal(column.X, data_simulation(draws=Draws(w, v, x0)).X)


def test_arguments_of_the_wrong_type():
    with pytest.raises(TypeError, match=r"^draws must be Draws\(w, v, x0\), not list$"):
        data_simulation(draws=list(normals(HANDOUT, 0)))
    with pytest.raises(TypeError, match=r"^plot must be True or False, not Scenario \(the scenario comes second\)$"):
        data_simulation(HANDOUT)
    with pytest.raises(TypeError, match=r"^scenario must be a Scenario, not dict$"):
        data_simulation(scenario={})


# ------------------------------------------------------------------------------------------------ scenario


def test_scenario_defaults_and_freezing():
    assert HANDOUT.n_steps == 50
    assert HANDOUT.n_landmarks == 5
    assert HANDOUT.measurement_cov == 0.15**2
    assert HANDOUT.field_of_view == "outward-ahead"
    means = np.array([(1.0, 2), (3, 4)])
    scenario = Scenario(landmark_means=means, measurement_cov=np.diag([1.0, 2, 3, 4]))
    means[:] = 0
    assert scenario.landmark_means.tolist() == [[1, 2], [3, 4]]
    for name in ("centre", "robot_mean", "landmark_means", "measurement_cov"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(scenario, name)[0] = 9
    with pytest.raises(dataclasses.FrozenInstanceError):
        scenario.dt = 2.0
    assert scenario == scenario  # identity: arrays have no single answer to ==
    assert scenario != Scenario()
    assert len({scenario, HANDOUT}) == 2


def test_scalar_covariance_stays_scalar_so_that_replace_takes_another_map():
    for scalar in (2, np.float64(2), np.array(2), np.int8(2)):
        scenario = Scenario(landmark_cov=scalar, measurement_cov=scalar, robot_cov=scalar, n_steps=np.int64(4))
        assert type(scenario.landmark_cov) is float
        assert type(scenario.n_steps) is int
        other = dataclasses.replace(scenario, landmark_means=[(0, 1), (2, 3), (4, 5)])
        assert other.n_landmarks == 3
        assert other.P0.tolist() == (2 * np.eye(8)).tolist()
        assert other.Rv.tolist() == (2 * np.eye(6)).tolist()


def test_three_ways_to_say_one_covariance():
    sims = [
        data_simulation(scenario=dataclasses.replace(TWO_LANDMARKS, measurement_cov=cov, robot_noise_cov=q), rng=0)
        for cov, q in ((0.3, 0.2), ([0.3] * 4, (0.2, 0.2)), (0.3 * np.eye(4), 0.2 * np.eye(2)))
    ]
    assert_same(sims[1], sims[0]._asdict())
    assert_same(sims[2], sims[0]._asdict())
    scenario = dataclasses.replace(TWO_LANDMARKS, landmark_cov=(1, 2, 3, 4))
    assert scenario.P0.tolist() == np.diag([0.1, 0.2, 1, 2, 3, 4]).tolist()


def test_tiny_asymmetry_and_rounding_of_a_computed_covariance_are_accepted():
    rng = np.random.default_rng(0)
    for _ in range(50):
        root = rng.standard_normal((10, 3)) * 10.0 ** rng.integers(-6, 3, (10, 1))
        scenario = Scenario(measurement_cov=root @ np.eye(3) @ root.T * (1 + 1e-15 * rng.standard_normal((10, 10))))
        assert (scenario.Rv == scenario.Rv.T).all()


ROUND = np.eye(10)
SKEW = np.eye(10) + np.eye(10, k=1)
DENTED = np.eye(10) - 1.3 * np.pad([[1.0]], (0, 9))
KNOWN = r'"outward-ahead", "north-east", "exogenous" or a function \(z \(M, 2\), o \(2,\)\) -> bool \(M,\)'


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("n_steps", 0, "n_steps must be an integer >= 1, not 0"),
        ("n_steps", 50.0, "n_steps must be an integer >= 1, not 50.0"),
        ("n_steps", True, "n_steps must be an integer >= 1, not True"),
        ("n_steps", "50", "n_steps must be an integer >= 1, not '50'"),
        ("dt", 0, "dt must be positive, not 0.0"),
        ("dt", -1.0, "dt must be positive, not -1.0"),
        ("dt", [1.0], r"dt must be a scalar; its shape is \(1,\)"),
        ("dt", math.nan, "dt must be finite, but holds NaN or infinity"),
        ("omega", math.inf, "omega must be finite, but holds NaN or infinity"),
        ("omega", "fast", r"omega must be a scalar of real numbers, not str \(dtype <U4\)"),
        ("omega", True, r"omega must be a scalar of real numbers, not bool \(dtype bool\)"),
        ("omega", 1j, r"omega must be a scalar of real numbers, not complex \(dtype complex128\)"),
        ("omega", None, r"omega must be a scalar of real numbers, not NoneType \(dtype object\)"),
        ("centre", (0, 0, 0), r"centre must be a vector \(2,\); its shape is \(3,\)"),
        ("centre", 1.0, r"centre must be a vector \(2,\); its shape is \(\)"),
        ("centre", ("1", "2"), r"centre must be a vector \(2,\) of real numbers, not tuple \(dtype <U1\)"),
        ("robot_mean", (True, 0.5), r"robot_mean must be a vector \(2,\) of real numbers, not tuple \(dtype float64\)"),
        ("robot_mean", ((1,), (1, 2)), r"robot_mean must be a vector \(2,\), not nested lists of unequal lengths"),
        ("robot_mean", np.ma.masked_equal([1.0, 2.0], 2), r"robot_mean must be .* not MaskedArray \(dtype float64\)"),
        ("landmark_means", (1, 2), r"landmark_means must be an array \(M, 2\) with M >= 1; its shape is \(2,\)"),
        ("landmark_means", np.zeros((0, 2)), r"landmark_means must be .* with M >= 1; its shape is \(0, 2\)"),
        ("landmark_means", np.zeros((2, 5)), r"landmark_means must be .* with M >= 1; its shape is \(2, 5\)"),
        ("landmark_means", [(1, math.nan)], "landmark_means must be finite, but holds NaN or infinity"),
        ("landmark_noise_std", -1e-9, "landmark_noise_std must be >= 0, not -1e-09"),
        ("robot_cov", -1, r"robot_cov must be positive semidefinite \(2, 2\): its smallest eigenvalue is -1"),
        ("robot_cov", -1e-15, r"robot_cov must be positive semidefinite \(2, 2\): its smallest eigenvalue is -1e-15"),
        ("robot_cov", (1, -2), r"robot_cov must be positive semidefinite \(2, 2\): its smallest eigenvalue is -2"),
        (
            "robot_cov",
            (1, 2, 3),
            r"robot_cov must be a scalar, a vector \(2,\) or a matrix \(2, 2\); its shape is \(3,\)",
        ),
        ("robot_cov", [[0, 1e-22], [1e-22, 1e-20]], "robot_cov must be positive semidefinite .* eigenvalue is -1e-24"),
        ("robot_noise_cov", [[1, 2], [2, 1]], r"robot_noise_cov must be positive semidefinite \(2, 2\): .* is -1"),
        ("landmark_cov", np.eye(2), r"landmark_cov must be .* or a matrix \(10, 10\); its shape is \(2, 2\)"),
        ("landmark_cov", [0.2], r"landmark_cov must be .* or a matrix \(10, 10\); its shape is \(1,\)"),
        ("landmark_cov", SKEW, r"landmark_cov must be symmetric: its entries \(0, 1\) and \(1, 0\) are 1.0 and 0.0"),
        ("landmark_cov", ROUND * 1j, r"landmark_cov must be .* of real numbers, not ndarray \(dtype complex128\)"),
        ("landmark_cov", ROUND > 0, r"landmark_cov must be .* of real numbers, not ndarray \(dtype bool\)"),
        ("measurement_cov", DENTED, r"measurement_cov must be positive semidefinite \(10, 10\): .* is -0.3"),
        ("measurement_cov", DENTED * 1e-18, r"measurement_cov must be positive semidefinite .* is -3e-19"),
        ("measurement_cov", np.full((10, 10), np.inf), "measurement_cov must be finite, .*"),
        ("field_of_view", "ahead", f"field_of_view must be one of {KNOWN}, not 'ahead'"),
        ("field_of_view", None, f"field_of_view must be one of {KNOWN}, not None"),
        ("field_of_view", ["north-east"], rf"field_of_view must be one of {KNOWN}, not \['north-east'\]"),
    ],
)
def test_bad_field(field, value, message):
    with pytest.raises(ValueError, match=f"^{message}$") as caught:
        Scenario(**{field: value})
    assert "\n" not in str(caught.value)


# ------------------------------------------------------------------------------------------------ standing alone


def run(code_or_file, *arguments, cwd, **environment):
    """Run Python isolated from this folder and from PYTHONPATH: no lab to be found."""
    command = [sys.executable, "-I", *([code_or_file] if code_or_file.endswith(".py") else ["-c", code_or_file])]
    env = os.environ | {"MPLBACKEND": "Agg"} | environment
    return subprocess.run([*command, *arguments], cwd=cwd, env=env, capture_output=True, text=True, timeout=300)


@pytest.fixture
def copied(tmp_path):
    home = tmp_path / "alone"
    home.mkdir()
    return Path(shutil.copy(SOURCE, home))


def test_runs_when_copied_alone(copied, tmp_path):
    code = """
import dataclasses, sys
class NoLab:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("lab", "scipy", "pandas", "filterpy"):
            raise ImportError(f"{name} is not there")
sys.meta_path.insert(0, NoLab())
sys.path.insert(0, sys.argv[1])
import data_simulation as d
assert not {"matplotlib", "PIL", "IPython", "lab", "scipy"} & set(sys.modules)
simulation = d.data_simulation(rng=0, scenario=dataclasses.replace(d.HANDOUT, n_steps=2))
assert "matplotlib" not in sys.modules
d.animate(simulation, "two.gif")
"""
    done = run(code, str(copied.parent), cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert (tmp_path / "two.gif").read_bytes().startswith(b"GIF8")


def test_script_without_a_window(copied, tmp_path):
    done = run(str(copied), cwd=tmp_path)
    sentence = (
        "data_simulation.py: no window can be shown here: give the name of a file to save, such as experiment.gif\n"
    )
    assert (done.returncode, done.stdout, done.stderr) == (1, "", sentence)


@pytest.mark.long
def test_script_saves_the_handout(copied, tmp_path):
    from PIL import Image

    done = run(str(copied), "out.gif", "--seed", "3", cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    with Image.open(tmp_path / "out.gif") as image:
        assert image.n_frames == 50


# ------------------------------------------------------------------------------------------------ animation


@pytest.fixture(autouse=True)
def _drawing(monkeypatch):
    import matplotlib

    matplotlib.use("Agg", force=True)
    monkeypatch.setitem(matplotlib.rcParams, "savefig.dpi", 40)  # small frames save faster
    from matplotlib import pyplot as plt

    plt.close("all")
    yield
    assert len(plt.get_fignums()) <= 1
    plt.close("all")


class Film:
    """An animation at hand frame by frame, without saving it."""

    def __init__(self, scenario=HANDOUT, seed=1, rule=None):
        self.sim = data_simulation(scenario=scenario, rng=seed)
        self.animation = animate(self.sim, field_of_view=rule or scenario.field_of_view)
        self.animation._draw_was_started = True  # matplotlib warns of animations that nobody looked at
        self.figure = self.animation._fig
        (self.ax,) = self.figure.axes

    def at(self, k):
        self.animation._func(k)
        return self

    def line(self, label):
        (line,) = [line for line in self.ax.lines if line.get_label() == label]
        return line

    def points(self, label):
        return np.transpose(self.line(label).get_data()).astype(float)

    def texts(self, mathematical):
        return [t for t in self.ax.texts if t.get_visible() and t.get_text().startswith("$") == mathematical]

    def seen(self, k):
        return np.flatnonzero(np.isfinite(self.sim.in_fov[::2, k]))


BUSY = dataclasses.replace(HANDOUT, landmark_means=np.random.default_rng(3).uniform(-8, 8, (20, 2)))
SMALL = full_scenario(1, 4, centre=(7.0, 7.0))
LEGS = "measured $(l_m, m_m)$ of landmark $m$"


@pytest.mark.parametrize("scenario", [HANDOUT, TWO_LANDMARKS, BUSY, SMALL], ids=["handout", "two", "twenty", "one"])
def test_artists_are_where_the_truth_is(scenario):
    film = Film(scenario)
    sim, landmarks = film.sim, film.sim.X[2:].reshape(scenario.n_landmarks, 2, scenario.n_steps)
    legs_drawn = 0
    for k in [*range(4), *range(17, scenario.n_steps, 8)]:
        film.at(k)
        np.testing.assert_allclose(film.points("robot"), [sim.X[:2, k]])
        np.testing.assert_allclose(film.points("centre"), [sim.CC])
        np.testing.assert_allclose(film.points("its last 15 steps"), sim.X[:2, max(k - 15, 0) : k + 1].T)
        seen = film.seen(k)
        hidden = np.setdiff1d(np.arange(sim.M), seen)
        np.testing.assert_allclose(film.points("landmark seen"), landmarks[seen, :, k])
        np.testing.assert_allclose(film.points("landmark not seen"), landmarks[hidden, :, k])
        for number, text in enumerate(film.texts(mathematical=False)):
            assert text.get_text() == str(number + 1)
            np.testing.assert_allclose(text.get_position(), landmarks[number, :, k])
        # Robot, corner, end, gap: horizontal leg l, then vertical leg m, of the noisy measurement.
        legs = film.points(LEGS).reshape(-1, 4, 2)
        assert len(legs) == len(seen)
        for m, (start, corner, end, gap) in zip(seen, legs, strict=True):
            np.testing.assert_allclose(start, sim.X[:2, k])
            np.testing.assert_allclose(corner, [start[0] + sim.Z[2 * m, k], start[1]])
            np.testing.assert_allclose(end, start + sim.Z[2 * m : 2 * m + 2, k])
            assert np.isnan(gap).all()
            legs_drawn += 1
        title = film.ax.get_title()
        assert title.startswith(f"k = {k},  t = {sim.T[k]:g} s")
        assert title.endswith("nothing is measured") == (k == 0)
    assert legs_drawn or scenario is SMALL


@pytest.mark.parametrize("scenario", [HANDOUT, TWO_LANDMARKS, BUSY], ids=["handout", "two", "twenty"])
def test_labels_stand_beside_the_leg_of_their_own_landmark(scenario):
    film = Film(scenario)
    pixels = film.ax.transData.transform
    near = 60 * film.figure.dpi / 72  # 60 points: five lines of text
    for k in range(1, 50, 7):
        labels = {text.get_text(): text.get_position() for text in film.at(k).texts(mathematical=True)}
        assert set(labels) == {f"${letter}_{{{m + 1}}}$" for m in film.seen(k) for letter in "lm"}
        x, y = film.sim.X[:2, k]
        for m in film.seen(k):
            end_x, end_y = (x, y) + film.sim.Z[2 * m : 2 * m + 2, k]
            for name, corners in (("l", [(x, y), (end_x, y)]), ("m", [(end_x, y), (end_x, end_y)])):
                across = 1 if name == "l" else 0
                low, high = np.sort(pixels(corners), axis=0)
                place = pixels(labels[f"${name}_{{{m + 1}}}$"])
                assert 0 < abs(place[across] - low[across]) < near
                assert low[1 - across] - 1 <= place[1 - across] <= high[1 - across] + 1


def test_no_text_covers_another():
    film = Film()
    renderer = film.figure.canvas.get_renderer()
    film.at(0)
    frame = [film.ax.title, film.ax.xaxis.label, film.ax.yaxis.label, *film.figure.legends]
    boxes = [artist.get_window_extent(renderer) for artist in frame] + [film.ax.get_window_extent(renderer)]
    assert not any(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))
    for box in boxes:
        assert film.figure.bbox.x0 <= box.x0 < box.x1 <= film.figure.bbox.x1
        assert film.figure.bbox.y0 <= box.y0 < box.y1 <= film.figure.bbox.y1
    for k in range(1, 50):
        boxes = [text.get_window_extent(renderer) for text in film.at(k).texts(mathematical=True)]
        assert not any(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))
        assert all(film.ax.bbox.contains(*corner) for box in boxes for corner in (box.min, box.max))
    assert film.ax.get_aspect() == 1
    assert (film.ax.get_xlabel(), film.ax.get_ylabel()) == ("x [m]", "y [m]")


def test_labels_of_a_crowd_find_room():
    film = Film(BUSY)
    renderer = film.figure.canvas.get_renderer()
    labels = hidden = 0
    for k in range(1, 50):
        boxes = [text.get_window_extent(renderer) for text in film.at(k).texts(mathematical=True)]
        marks = film.ax.transData.transform(film.sim.X[:, k].reshape(-1, 2))
        labels += len(boxes)
        hidden += sum(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))
        hidden += sum(box.contains(*mark) for box in boxes for mark in marks)
    assert labels > 300
    assert hidden <= 0.02 * labels


def test_seen_and_unseen_differ_in_colour_shape_and_filling():
    film = Film().at(5)
    seen, hidden = film.line("landmark seen"), film.line("landmark not seen")
    assert (seen.get_color(), seen.get_marker(), seen.get_fillstyle()) == ("darkgreen", "o", "full")
    assert (hidden.get_markeredgecolor(), hidden.get_markerfacecolor(), hidden.get_marker()) == (
        "tab:red",
        "white",
        "s",
    )
    colours = [text.get_color() for text in film.texts(mathematical=False)]
    assert colours == ["white" if m in film.seen(5) else "tab:red" for m in range(5)]
    entries = [text.get_text() for text in film.figure.legends[0].get_texts()]
    states = ["landmark seen", "landmark not seen"]
    assert entries == ["robot", "its last 15 steps", LEGS, *states, "centre", "field of view"]


@pytest.mark.parametrize("scenario", [HANDOUT, TWO_LANDMARKS, SMALL])
def test_wedge_holds_exactly_the_seen_landmarks(scenario):
    film = Film(scenario)
    (wedge,) = film.ax.patches
    for k in range(scenario.n_steps):
        film.at(k)
        assert wedge.get_visible() == (k > 0)
        if k == 0:
            continue
        np.testing.assert_allclose(wedge.center, film.sim.X[:2, k])
        assert wedge.theta2 - wedge.theta1 == pytest.approx(90)
        ox, oy = film.sim.X[:2, k] - film.sim.CC
        expected = 0 if scenario is TWO_LANDMARKS else math.degrees(math.atan2(oy, ox))
        assert (wedge.theta1 - expected) % 360 == pytest.approx(0, abs=1e-9)
        for m in range(film.sim.M):
            dx, dy = film.sim.X[2 + 2 * m : 4 + 2 * m, k] - film.sim.X[:2, k]
            inside = (math.degrees(math.atan2(dy, dx)) - wedge.theta1) % 360 < 90
            assert inside == (m in film.seen(k))
            assert not inside or math.hypot(dx, dy) < wedge.r


@pytest.mark.parametrize("rule", ["exogenous", everything])
def test_no_wedge_where_visibility_has_none(rule):
    film = Film(dataclasses.replace(QUICK, field_of_view=rule)).at(2)
    assert not film.ax.patches
    assert "field of view" not in [text.get_text() for text in film.figure.legends[0].get_texts()]


def test_wedge_that_explains_nothing_is_left_out_with_a_warning():
    with pytest.warns(
        UserWarning, match=r"^field_of_view 'outward-ahead' does not explain which landmarks are seen: no wedge"
    ):
        film = Film(TWO_LANDMARKS, rule="outward-ahead")
    assert not film.at(3).ax.patches


def test_robot_at_the_centre_sees_all_round():
    still = {"n_steps": 2, "robot_noise_cov": 0, "robot_mean": (-1.5, 0), "omega": 0}
    film = Film(dataclasses.replace(HANDOUT, **still)).at(1)
    (wedge,) = film.ax.patches
    assert len(film.seen(1)) == 5
    assert (wedge.theta1, wedge.theta2) == (0, 360)


def test_single_instant_and_single_point():
    film = Film(dataclasses.replace(HANDOUT, n_steps=1, landmark_means=[(0, 0)], landmark_cov=0, centre=(0, 0))).at(0)
    assert np.diff(film.ax.get_xlim()) > 0.5


def test_gif(tmp_path):
    from PIL import Image

    name = "Film.GIF"

    animation = animate(data_simulation(scenario=QUICK, rng=0), tmp_path / name, interval=150)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    with Image.open(tmp_path / name) as image:
        assert (image.n_frames, image.info["duration"]) == (3, 150)
    from matplotlib import pyplot as plt

    assert not plt.get_fignums()
    assert animation is not None


@pytest.mark.skipif(not shutil.which("ffmpeg"), reason="ffmpeg is not installed")
def test_mp4(tmp_path):
    animate(data_simulation(scenario=QUICK, rng=0), str(tmp_path / "film.mp4"))
    assert [path.name for path in tmp_path.iterdir()] == ["film.mp4"]
    assert (tmp_path / "film.mp4").read_bytes()[4:8] == b"ftyp"
    probe = ["ffmpeg", "-i", str(tmp_path / "film.mp4"), "-f", "null", "-"]
    log = subprocess.run(probe, capture_output=True, text=True, timeout=60).stderr
    assert "frame=    3" in log
    assert "5 fps" in log


def test_mp4_without_ffmpeg(tmp_path, monkeypatch):
    from matplotlib.animation import FFMpegWriter

    monkeypatch.setattr(FFMpegWriter, "isAvailable", classmethod(lambda cls: False))
    with pytest.raises(
        RuntimeError, match=r"^an \.mp4 needs the program ffmpeg, which is missing here: save a \.gif instead$"
    ):
        animate(data_simulation(scenario=QUICK, rng=0), tmp_path / "film.mp4")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("problem", [KeyboardInterrupt, OSError("disk full")])
def test_interrupted_save_leaves_what_was_there(tmp_path, monkeypatch, problem):
    from matplotlib import pyplot as plt
    from matplotlib.animation import FuncAnimation

    def save(self, path, **options):
        self._draw_was_started = True
        Path(path).write_bytes(b"GIF8 and no more")
        raise problem

    monkeypatch.setattr(FuncAnimation, "save", save)
    (tmp_path / "film.gif").write_bytes(b"the old one")
    with pytest.raises((KeyboardInterrupt, OSError)):
        animate(data_simulation(scenario=QUICK, rng=0), tmp_path / "film.gif")
    assert [path.name for path in tmp_path.iterdir()] == ["film.gif"]
    assert (tmp_path / "film.gif").read_bytes() == b"the old one"
    assert not plt.get_fignums()


def test_bad_arguments_of_animate(tmp_path, monkeypatch):
    simulation = data_simulation(scenario=QUICK, rng=0)
    from matplotlib import pyplot as plt

    def no_work(*args, **kwargs):
        pytest.fail("a figure was made before the arguments were checked")

    monkeypatch.setattr(plt, "subplots", no_work)
    (tmp_path / "folder.gif").mkdir()
    for path, error, message in (
        ("film.png", ValueError, r"the animation is saved as \.gif or \.mp4, not as 'film\.png'"),
        ("film", ValueError, r"the animation is saved as \.gif or \.mp4, not as 'film'"),
        ("", ValueError, r"the animation is saved as \.gif or \.mp4, not as ''"),
        ("nowhere/film.gif", FileNotFoundError, r"the folder .*nowhere does not exist"),
        (tmp_path / "folder.gif", IsADirectoryError, r".*folder\.gif is a folder"),
    ):
        with pytest.raises(error, match=f"^{message}$"):
            animate(simulation, path)
    with monkeypatch.context() as read_only:
        read_only.setattr(os, "access", lambda folder, mode: False)
        with pytest.raises(PermissionError, match=r"^the folder \. cannot be written$"):
            animate(simulation, "film.gif")
    for interval in (0, -1, math.nan, "slow", True):
        with pytest.raises(ValueError, match=r"^interval must be "):
            animate(simulation, interval=interval)
    with pytest.raises(ValueError, match=f"^field_of_view must be one of {KNOWN}, not 'behind'$"):
        animate(simulation, field_of_view="behind")
    with pytest.raises(TypeError, match=r"^simulation must be a Simulation, not Scenario$"):
        animate(HANDOUT)


def test_html_for_a_notebook_closes_the_figure():
    from matplotlib import pyplot as plt

    animation = animate(data_simulation(scenario=QUICK, rng=0))
    assert len(plt.get_fignums()) == 1
    html = animation._repr_html_()
    assert not plt.get_fignums()
    assert html.count("data:image/png;base64") == 3
    assert "<script" in html


# ------------------------------------------------------------------------------------------------ showing


@pytest.fixture
def window(monkeypatch):
    """Stand in for a screen; the list gets what is open when the window is shown."""
    from matplotlib import pyplot as plt

    shown = []

    def show():
        plt.gcf().canvas.draw()
        shown.append(len(plt.gcf().axes[0].patches))

    monkeypatch.setattr(plt, "get_backend", lambda: "QtAgg")
    monkeypatch.setattr(plt, "show", show)
    return shown


def test_plot_in_a_window(window):
    simulation = data_simulation(True, dataclasses.replace(TWO_LANDMARKS, n_steps=5), rng=0)
    assert window == [1]  # with the wedge: the scenario's own field of view was used
    assert isinstance(simulation, Simulation)


def test_plot_in_a_notebook(monkeypatch):
    displayed = []
    shell = SimpleNamespace(kernel=object())
    notebook = SimpleNamespace(get_ipython=lambda: shell, display=SimpleNamespace(display=displayed.append))
    monkeypatch.setitem(sys.modules, "IPython", notebook)
    data_simulation(True, QUICK, rng=0)
    (animation,) = displayed
    assert "<script" in animation._repr_html_()


def test_plot_without_a_window_warns_and_returns_the_data():
    with pytest.warns(
        UserWarning, match=r"^no window can be shown here: save the animation with animate\(simulation, "
    ) as seen:
        simulation = data_simulation(True, QUICK, rng=0)
    assert len(seen) == 1
    assert seen[0].filename == __file__
    assert simulation.N == 3


def test_main_shows_a_window(window, monkeypatch, capsys):
    monkeypatch.setattr(simulator, "HANDOUT", QUICK)
    assert simulator.main([]) == 0
    assert window == [1]
    assert capsys.readouterr() == ("", "")


def test_main_saves_with_a_seed(monkeypatch, tmp_path, capsys):
    saved = {}
    monkeypatch.setattr(simulator, "animate", lambda simulation, path: saved.update({path: simulation}))
    assert simulator.main(["a.gif", "--seed", "5"]) == 0
    assert (saved["a.gif"].X == data_simulation(rng=5).X).all()
    monkeypatch.undo()
    monkeypatch.setattr(simulator, "HANDOUT", QUICK)
    assert simulator.main([str(tmp_path / "b.gif")]) == 0
    assert (tmp_path / "b.gif").read_bytes().startswith(b"GIF8")
    assert capsys.readouterr() == ("", "")


def test_main_with_bad_arguments(tmp_path, capsys, monkeypatch):
    for arguments, sentence in (
        (["film.png"], "the animation is saved as .gif or .mp4, not as 'film.png'"),
        ([str(tmp_path / "no" / "film.gif")], f"the folder {tmp_path / 'no'} does not exist"),
        (["film.gif", "--seed", "-4"], "rng must be a seed >= 0, not -4"),
        (["film.gif", "--seed", "x"], "argument --seed: invalid int value: 'x'"),
        (["film.gif", "more"], "unrecognized arguments: more"),
    ):
        try:
            status = simulator.main(arguments)
        except SystemExit as stop:
            status = stop.code
        assert status == 2
        assert capsys.readouterr() == ("", f"data_simulation.py: {sentence}\n")

    def interrupt(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr(simulator, "animate", interrupt)
    assert simulator.main(["film.gif"]) == 130


def test_main_without_matplotlib(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert simulator.main([]) == 1
    assert "matplotlib" in capsys.readouterr().err
