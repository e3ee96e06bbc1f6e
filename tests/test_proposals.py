"""Importance functions: their weights, draws and filters, against algebra and against the exact filter."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from worlds import WORLDS, covariance, everything, full_scenario, nothing, problem, reference

from lab import gaussian
from lab.problem import LinearGaussianModel, Problem
from lab.solvers import guided, kalman, particle_steps, rbpf, sir
from lab.solvers.proposals import Cloud, delayed, optimal, prior, rbpf_optimal, rbpf_prior
from lab.validation import InputError

PROPOSALS = {
    "prior": prior,
    "optimal": optimal,
    "delayed": delayed,
    "rbpf-prior": rbpf_prior,
    "rbpf-optimal": rbpf_optimal,
}


def coupled(n_landmarks=3, seed=1, **options):
    """Return a world in which everything couples: P0 robot and landmarks, Q robot and landmarks, R landmarks."""
    world = problem(full_scenario(n_landmarks, seed, **options), seed)
    rng, n = np.random.default_rng(seed + 50), 2 + 2 * n_landmarks
    model = replace(world.model, P0=covariance(rng, n, 0.4), Q=covariance(rng, n, 0.1))
    return Problem(model, world.z, world.H, world.R)


def cut(world, n_instants):
    return Problem(world.model, world.z[:n_instants], world.H[:n_instants], world.R[:n_instants])


def mixed():
    """F that mixes all components."""
    world = problem(full_scenario(1))
    F = np.eye(4) + 0.1 * np.random.default_rng(2).standard_normal((4, 4))
    model = LinearGaussianModel(F, world.model.B, world.model.Q, world.model.m0, world.model.P0)
    return Problem(model, world.z, world.H, world.R)


def lost():
    """Return a world whose measurements are so far off that their densities are zero."""
    world = problem(full_scenario(1))
    return Problem(world.model, np.where(np.isnan(world.z), np.nan, 1e200), world.H, world.R)


def steps_of(world, proposal, n_particles, seed=0, ess_threshold=0.0):
    rng = np.random.default_rng(seed)
    options = {"n_particles": n_particles, "ess_threshold": ess_threshold, "resample": "systematic"}
    return list(particle_steps(world, rng, proposal=proposal, **options))


ANSWERED = {
    "handout": lambda: cut(reference(1).problem, 6),
    "coupled": lambda: cut(coupled(), 6),
    "all seen": lambda: cut(coupled(2, field_of_view=everything), 4),
    "one landmark": lambda: cut(coupled(1), 8),
    "landmark noise": lambda: cut(problem(full_scenario(3), 2).with_landmark_noise(0.1), 6),
}


@pytest.mark.parametrize("world", ANSWERED)
@pytest.mark.parametrize("name", ["delayed", "rbpf-prior", "rbpf-optimal", "optimal"])
def test_moments_and_evidence_agree_with_the_exact_filter(world, name):
    """Means over runs within five standard errors; the bias O(1/N) of a ratio gets three squared relative errors."""
    problem = ANSWERED[world]()
    problem = cut(problem, 2) if name == "optimal" else problem  # it degenerates at once
    exact, runs = kalman(problem), 40
    options = {"n_particles": 4000, "ess_threshold": 0.5, "resample": "systematic", "proposal": PROPOSALS[name]}
    all_steps = [list(particle_steps(problem, np.random.default_rng([s, 1]), **options)) for s in range(runs)]
    for what, target in (("mean", exact.means), ("cov", exact.covs)):
        estimates = np.array([[getattr(step, what) for step in steps] for steps in all_steps])
        spread = estimates.std(axis=0, ddof=1)
        scale = exact.stds if what == "mean" else exact.stds[:, :, None] * exact.stds[:, None, :]
        bias = np.divide(3 * spread**2, scale, out=np.zeros_like(scale), where=scale > 0)
        assert (np.abs(estimates.mean(axis=0) - target) <= 5 * spread / np.sqrt(runs) + bias + 1e-9).all()
        assert np.median(spread[1:][scale[1:] > 0] / scale[1:][scale[1:] > 0]) < 0.15  # else this proves nothing
    ratios = np.exp([[step.log_evidence for step in steps] - exact.log_evidence for steps in all_steps])
    assert (np.abs(ratios.mean(axis=0) - 1) <= 5 * ratios.std(axis=0, ddof=1) / np.sqrt(runs) + 1e-12).all()


@pytest.mark.parametrize("world", ["handout", "coupled", "all seen", "landmark noise"])
def test_optimal_weight_is_the_parents(world):
    problem = ANSWERED[world]()
    steps, model = steps_of(problem, optimal, 20), problem.model
    for k in range(1, problem.n_instants):
        z, H, R = problem.seen(k)
        expected = np.zeros(20)
        if len(z):
            S = H @ model.noise_cov @ H.T + R
            parents = steps[k - 1].cloud.particles
            expected = [multivariate_normal.logpdf(z, H @ (model.F @ x + model.B), S) for x in parents.T]
        difference = steps[k].cloud.log_weights - steps[k - 1].cloud.log_weights - expected
        np.testing.assert_allclose(difference, difference[0], atol=1e-9)


def test_optimal_draws_from_the_posterior_given_the_parent():
    problem = ANSWERED["coupled"]()
    k = next(k for k in range(1, problem.n_instants) if len(problem.seen(k)[0]))
    parent, n_particles, model = problem.model.m0 + 0.3, 40_000, problem.model
    cloud = Cloud(
        np.repeat(parent[:, None], n_particles, axis=1), np.full(n_particles, -np.log(n_particles)), 0 * model.P0
    )
    moved, _ = optimal(cloud, k, problem, np.random.default_rng(0))
    information = np.linalg.inv(model.Q) + problem.seen(k)[1].T @ np.linalg.solve(
        problem.seen(k)[2], problem.seen(k)[1]
    )
    cov = np.linalg.inv(information)
    predicted = model.F @ parent + model.B
    z, H, R = problem.seen(k)
    mean = cov @ (np.linalg.solve(model.Q, predicted) + H.T @ np.linalg.solve(R, z))
    draws = moved.particles - mean[:, None]
    assert (np.abs(draws.mean(axis=1)) <= 5 * np.sqrt(np.diag(cov) / n_particles)).all()
    error = np.sqrt((np.outer(np.diag(cov), np.diag(cov)) + cov**2) / n_particles)
    assert (np.abs(draws @ draws.T / n_particles - cov) <= 5 * error).all()


def landmarks_given_path(problem, path, last):
    """Condition the landmarks on one robot path and z_1..z_last, static landmarks: a filter over landmarks alone."""
    model = problem.model
    gain = model.P0[2:, :2] @ np.linalg.pinv(model.P0[:2, :2])
    mean = model.m0[2:] + gain @ (path[0] - model.m0[:2])
    cov = model.P0[2:, 2:] - gain @ model.P0[:2, 2:]
    log_evidence = 0.0
    for k in range(1, last + 1):
        z, H, R = problem.seen(k)
        mean, cov, increment = gaussian.update(mean, cov, z - H[:, :2] @ path[k], H[:, 2:], R)
        log_evidence += increment
    return mean, cov, log_evidence


@pytest.mark.parametrize("proposal", [rbpf_prior, rbpf_optimal])
@pytest.mark.parametrize("field_of_view", ["outward-ahead", everything, nothing])
def test_rao_blackwell_landmarks_are_a_filter_given_the_path(proposal, field_of_view):
    """Full R, full P0 that couples landmarks and robot; one covariance for all particles."""
    world = cut(coupled(3, field_of_view=field_of_view), 12)
    Q = np.zeros_like(world.model.Q)
    Q[:2, :2] = world.model.Q[:2, :2]
    world = replace(world, model=replace(world.model, Q=Q))
    steps, n_particles = steps_of(world, proposal, 12), 12
    paths = np.array([step.cloud.particles[:2] for step in steps])
    for k in (1, 5, 11):
        cloud = steps[k].cloud
        log_likelihoods = []
        for i in range(n_particles):
            mean, cov, log_evidence = landmarks_given_path(world, paths[:, :, i], k)
            np.testing.assert_allclose(cloud.particles[2:, i], mean, atol=1e-9)
            np.testing.assert_allclose(cloud.cov[2:, 2:], cov, atol=1e-9)
            log_likelihoods.append(log_evidence)
        assert not cloud.cov[:2].any()
        if proposal is rbpf_prior:  # its weight is the likelihood of the whole path
            difference = cloud.log_weights - log_likelihoods
            np.testing.assert_allclose(difference, difference[0], atol=1e-8)


def test_moments_are_the_law_of_total_covariance():
    world = cut(coupled(2), 6)
    for step in steps_of(world, rbpf_optimal, 15):
        weights, particles = np.exp(step.cloud.log_weights), step.cloud.particles
        mean = sum(w * x for w, x in zip(weights, particles.T, strict=True))
        second = sum(w * (step.cloud.cov + np.outer(x, x)) for w, x in zip(weights, particles.T, strict=True))
        np.testing.assert_allclose(step.mean, mean, atol=1e-12)
        np.testing.assert_allclose(step.cov, second - np.outer(mean, mean), atol=1e-10)
        if len(step.cloud.log_weights) and step.ess > 1.5:
            assert abs(step.cov[:2, 2:]).max() > 1e-6  # robot and landmarks do correlate


@pytest.mark.parametrize("noise", [0.0, 1e-18])
@pytest.mark.parametrize("proposal", ["prior", "optimal"])
@pytest.mark.parametrize("n_landmarks", [1, 3, 20])
@pytest.mark.parametrize("field_of_view", ["outward-ahead", everything, nothing])
def test_rbpf_is_the_exact_filter_when_the_path_is_known(noise, proposal, n_landmarks, field_of_view, backend):
    world = problem(full_scenario(n_landmarks, 3, field_of_view=field_of_view, n_steps=20), 3)
    n = 2 + 2 * n_landmarks
    P0, Q = world.model.P0.copy(), np.zeros((n, n))
    P0[:2], P0[:, :2], Q[[0, 1], [0, 1]] = 0, 0, noise
    known = replace(world, model=replace(world.model, P0=P0, Q=Q))
    options = {"n_particles": 7, "proposal": proposal, "backend": backend}
    exact, answer = kalman(known), rbpf(known, np.random.default_rng(0), **options)
    # with noise 1e-18 the robot itself is uncertain by 1e-9
    np.testing.assert_allclose(answer.means, exact.means, rtol=0, atol=1e-9 if noise == 0 else 2e-8)
    np.testing.assert_allclose(answer.covs, exact.covs, rtol=0, atol=1e-9)
    np.testing.assert_allclose(answer.log_evidence, exact.log_evidence, atol=1e-9 if noise == 0 else 1e-4)


def test_rbpf_error_falls_like_the_square_root(backend):
    """Rms gap over runs at the handout's k = 8, N from 100 to 6400: slope -1/2 within five standard errors."""
    world = cut(reference(1).problem, 9)
    exact, sizes, runs = kalman(world), np.array([100, 800, 6400]), 40
    gaps = []
    for size in sizes:
        answers = [
            rbpf(world, np.random.default_rng([s, size]), n_particles=int(size), backend=backend) for s in range(runs)
        ]
        gaps.append([np.mean(((a.means - exact.means)[1:] / exact.stds[1:]) ** 2) for a in answers])
    gaps = np.array(gaps)
    log_rms = 0.5 * np.log(gaps.mean(axis=1))
    errors = 0.5 * gaps.std(axis=1, ddof=1) / gaps.mean(axis=1) / np.sqrt(runs)
    slope = (log_rms[2] - log_rms[0]) / np.log(sizes[2] / sizes[0])
    assert abs(slope + 0.5) <= 5 * np.hypot(errors[0], errors[2]) / np.log(64)


def test_delayed_landmarks_are_their_prior_until_seen():
    world = reference(1).problem
    for k, step in enumerate(steps_of(world, delayed, 10, ess_threshold=0.5)):
        seen = (~np.isnan(world.z[: k + 1])).any(axis=0)
        np.testing.assert_array_equal(step.cloud.unsampled, 2 + np.flatnonzero(~seen))
        for i in step.cloud.unsampled:
            assert step.mean[i] == pytest.approx(world.model.m0[i])
            assert step.cov[i, i] == pytest.approx(world.model.P0[i, i])


def test_delayed_landmarks_that_p0_couples_follow_the_sampled_ones():
    world = cut(coupled(3), 3)
    step = steps_of(world, delayed, 5)[0]
    P0, m0 = world.model.P0, world.model.m0
    gain = P0[2:, :2] @ np.linalg.inv(P0[:2, :2])
    robots = step.cloud.particles[:2]
    np.testing.assert_allclose(step.cloud.particles[2:], m0[2:, None] + gain @ (robots - m0[:2, None]), atol=1e-12)
    np.testing.assert_allclose(step.cloud.cov[2:, 2:], P0[2:, 2:] - gain @ P0[:2, 2:], atol=1e-12)


def test_nothing_seen_leaves_weights_even():
    for name, proposal in PROPOSALS.items():
        for step in steps_of(WORLDS["nothing-seen"](), proposal, 9):
            np.testing.assert_allclose(step.cloud.log_weights, -np.log(9), atol=1e-12, err_msg=name)


def test_negligible_landmark_noise_is_sampled_by_none():
    for proposal in PROPOSALS.values():
        before, after = steps_of(problem(), proposal, 5)[:2]
        if proposal in (prior, optimal):
            np.testing.assert_array_equal(before.cloud.particles[2:], after.cloud.particles[2:])


def test_a_students_proposal_fits_the_loop():
    """A Student-t importance function, properly weighted: right in distribution, though not optimal."""

    def heavy(cloud, k, problem, rng):
        model, scale = problem.model, np.sqrt(0.04)
        t = rng.standard_t(5, size=(2, cloud.particles.shape[1]))
        mean = model.F[:2] @ cloud.particles + model.B[:2, None]
        particles = cloud.particles.copy()
        particles[:2] = mean + scale * t
        from scipy.stats import norm
        from scipy.stats import t as student

        z, H, R = problem.seen(k)
        log_ratio = (norm.logpdf(t) - student.logpdf(t, 5)).sum(axis=0)
        likelihood = gaussian.log_density(z[:, None] - H @ particles, R)
        return replace(cloud, particles=particles), likelihood + log_ratio

    world = cut(reference(1).problem, 3)
    exact = kalman(world)
    options = {"n_particles": 20_000, "ess_threshold": 0.0, "resample": "systematic", "proposal": heavy}
    ends = [list(particle_steps(world, np.random.default_rng(s), **options))[-1] for s in range(30)]
    ratios = np.exp([step.log_evidence - exact.log_evidence[-1] for step in ends])
    assert abs(ratios.mean() - 1) <= 5 * ratios.std(ddof=1) / np.sqrt(30)


def test_rank_deficient_prior_and_noise(backend):
    """P0 and Q of rank 1 on the robot: drawn within their range, and the exact filter is still met."""
    world = cut(problem(full_scenario(2, 4), 4), 5)
    P0, Q = world.model.P0.copy(), world.model.Q.copy()
    P0[:2, :2] = np.outer([0.3, -0.2], [0.3, -0.2])
    Q[:2, :2] = np.outer([0.1, 0.2], [0.1, 0.2])
    flat = replace(world, model=replace(world.model, P0=P0, Q=Q))
    exact = kalman(flat)
    answers = [rbpf(flat, np.random.default_rng(s), n_particles=2000, backend=backend) for s in range(30)]
    means = np.array([a.means for a in answers])
    error = means.std(axis=0, ddof=1) / np.sqrt(30)
    assert (np.abs(means.mean(axis=0) - exact.means) <= 5 * error + 1e-4 * exact.stds + 1e-9).all()


@pytest.mark.parametrize(("solver", "known"), [(guided, "delayed, optimal"), (rbpf, "optimal, prior")])
def test_unknown_proposals(solver, known):
    with pytest.raises(InputError, match=f"Unknown proposal 'best'; known are {known}"):
        solver(problem(), np.random.default_rng(0), proposal="best")


def test_singular_noise_is_named_for_each_proposal(backend):
    world = WORLDS["full-3-all-seen"]()
    singular = Problem(world.model, world.z, world.H, np.zeros(world.R.shape))
    with pytest.raises(InputError, match=r"positive definite.*k = 1"):
        sir(singular, np.random.default_rng(0), n_particles=5, backend=backend)
    with pytest.raises(InputError, match=r"positive definite.*k = 1"):
        guided(singular, np.random.default_rng(0), n_particles=5, proposal="optimal", backend=backend)


def test_a_model_in_which_everything_moves(backend):
    rng = np.random.default_rng(2)
    world = cut(coupled(1), 5)
    F = np.eye(4) + 0.1 * rng.standard_normal((4, 4))
    mixed = replace(world, model=LinearGaussianModel(F, world.model.B, world.model.Q, world.model.m0, world.model.P0))
    exact = kalman(mixed)
    for solver in (rbpf, guided, partial(rbpf, proposal="prior")):
        means = np.array(
            [solver(mixed, np.random.default_rng(s), n_particles=3000, backend=backend).means for s in range(30)]
        )
        spread = means.std(axis=0, ddof=1)
        assert (np.abs(means.mean(axis=0) - exact.means) <= 5 * spread / np.sqrt(30) + 3 * spread**2 / exact.stds).all()


def test_a_law_that_is_remembered_is_that_of_its_covariance():
    """Laws are kept for a problem; a cloud with another covariance gets its own, and none can be written to."""
    world = cut(coupled(), 6)
    cov = steps_of(world, rbpf_optimal, 3)[1].cloud.cov
    first, again = rbpf_optimal.law(cov, 2, world), rbpf_optimal.law(cov.copy(), 2, world)
    other = rbpf_optimal.law(2 * cov, 2, world)
    assert again is first
    fresh = rbpf_optimal.law(2 * cov, 2, replace(world))
    np.testing.assert_array_equal(other.cov, fresh.cov)
    assert abs(other.cov - first.cov).max() > 1e-6
    with pytest.raises(ValueError, match="read-only"):
        first.cov[0, 0] = 1
