"""Mistakes of the Rao-Blackwellized step and of its moments."""

from typing import Any

import numpy as np

from lab.checks import recipes, reference
from lab.checks.mistakes.clouds import COMBINE
from lab.checks.mistakes.densities import DENSITIES
from lab.checks.mistakes.kalman import Mutants
from lab.checks.mistakes.seeing import SELECT
from lab.checks.recipes import rbpf_step_with
from lab.validation import Array


def _late(move: Any) -> Any:
    def wrong(robots: Array, noise: Array, model: Any) -> Array:
        F, B = model.F[:2, :2], model.B[:2, np.newaxis]
        return np.asarray(move(robots, noise, F, B))

    return wrong


def _mean_robot(z: Array, H: Array, robots: Array, means: Array) -> Array:
    robot = robots.mean(axis=1, keepdims=True)
    return np.asarray(z[:, np.newaxis] - H[:, :2] @ robot - H[:, 2:] @ means)


def _only_seen(cov: Array, H: Array, S: Array) -> Array:
    K = np.linalg.solve(S, H[:, 2:] @ cov).T
    K[~(H[:, 2:] != 0).any(axis=0)] = 0
    return np.asarray(K)


def steps() -> Mutants:
    """Return mistaken rbpf_steps."""
    build = rbpf_step_with
    found: Mutants = [(key, build(select=select)) for key, select in SELECT]
    found += [(key, build(combine=combine)) for key, combine in COMBINE]
    found += [(key, _kept_when_blind(build(combine=combine))) for key, combine in COMBINE]
    found += [(key, build(density=density)) for key, density in DENSITIES]
    found += [
        (key, build(move=_late(move)))
        for key, move in (
            ("b-omitted", lambda r, noise, F, B: F @ r + noise),
            ("f-omitted", lambda r, noise, F, B: r + B + noise),
            ("f-omitted", lambda r, noise, F, B: r + noise),
            ("f-transposed", lambda r, noise, F, B: F.T @ r + B + noise),
            ("noise-omitted", lambda r, noise, F, B: F @ r + B),
            ("noise-shared", lambda r, noise, F, B: F @ r + B + noise[:, :1]),
            ("noise-again", lambda r, noise, F, B: F @ r + B + 2 * noise),
            ("wrong-b", lambda r, noise, F, B: F @ r - B + noise),
            ("prediction-lost", lambda r, noise, F, B: r),
        )
    ]
    found += [
        ("noise-again", build(move=_factor_again)),
        ("rb-without-landmarks", build(weight_spread=lambda cov, H, R: R)),
        ("rb-without-noise", build(weight_spread=lambda cov, H, R: H[:, 2:] @ cov @ H[:, 2:].T)),
        ("rb-without-landmarks", build(spread=lambda cov, H, R: R)),
        ("rb-without-noise", build(spread=lambda cov, H, R: H[:, 2:] @ cov @ H[:, 2:].T)),
        ("rb-weighed-late", build(weigh_late=True)),
        ("rb-weighed-late", build(weigh_late=True, weight_spread=lambda cov, H, R: R)),
        ("rb-weighed-late", build(weigh_late=True, weight_spread=_after)),
        ("rb-weighed-late", build(weight_spread=_after)),
        ("rb-mean-robot", build(innovation=_mean_robot)),
        ("rb-old-robot", build(old_robots=True)),
        ("rb-means-not-updated", build(new_means=lambda means, K, nu, w: means)),
        ("innovation-sign", build(new_means=lambda means, K, nu, w: means - K @ nu)),
        ("rb-mean-robot", build(new_means=lambda means, K, nu, w: means + (K @ nu).mean(axis=1, keepdims=True))),
        ("rb-mean-robot", build(new_means=lambda means, K, nu, w: means + (K @ nu @ w)[:, np.newaxis])),
        ("rb-cov-not-updated", build(new_cov=lambda cov, K, H: cov)),
        ("covariance-sign", build(new_cov=lambda cov, K, H: cov + K @ H[:, 2:] @ cov)),
        ("one-for-identity", build(new_cov=lambda cov, K, H: (1 - K @ H[:, 2:]) @ cov)),
        ("joseph-incomplete", build(new_cov=_half_joseph)),
        ("double-inverse", build(gain=lambda cov, H, S: cov @ H[:, 2:].T @ S)),
        ("double-inverse", build(gain=lambda cov, H, S: cov @ H[:, 2:].T)),
        ("element-wise", build(gain=lambda cov, H, S: cov @ H[:, 2:].T / np.diag(S))),
        ("relative-sign", build(innovation=lambda z, H, r, m: z[:, np.newaxis] + H[:, :2] @ r - H[:, 2:] @ m)),
        ("robot-ignored", build(innovation=lambda z, H, r, m: z[:, np.newaxis] - H[:, 2:] @ m)),
        ("weights-reset-when-blind", _even_when_blind),
        ("no-prediction-when-blind", _frozen_when_blind),
        ("rb-means-not-updated", build(new_means=lambda m, K, nu, w: m, new_cov=lambda cov, K, H: cov)),
        ("map-correlations-dropped", build(new_cov=lambda cov, K, H: np.diag(np.diag(cov - K @ H[:, 2:] @ cov)))),
        ("old-particles", lambda *args: (args[0], *rbpf_step_with()(*args)[1:])),
        ("rb-cov-each-particle", _cov_each_particle),
        ("rb-robot-spread-added", _robot_spread(False)),
        ("rb-robot-spread-added", _robot_spread(True)),
        ("log-as-weight", build(combine=lambda w, logs: np.log(w) + logs - np.max(np.log(w) + logs))),
        ("rb-without-landmarks", build(spread=lambda cov, H, R: np.diag(np.diag(H[:, 2:] @ cov @ H[:, 2:].T)) + R)),
    ]
    return found


def _kept_when_blind(step: Any) -> Any:
    """Leave the weights as they are when nothing is seen, whatever is wrong otherwise."""

    def rbpf_step(*args: Any) -> Any:
        answer = step(*args)
        return (*answer[:3], args[3]) if np.isnan(args[5]).all() else answer

    return rbpf_step


def _factor_again(robots: Array, noise: Array, model: Any) -> Array:
    moved = recipes.moved(robots, 0 * noise, _Robot(model))
    return np.asarray(moved + np.linalg.cholesky(model.Q[:2, :2]) @ noise)


class _Robot:
    def __init__(self, model: Any) -> None:
        self.F, self.B = model.F[:2, :2], model.B[:2]


def _after(cov: Array, H: Array, R: Array) -> Array:
    """Return the spread of z with the landmarks' covariance after the update."""
    L = H[:, 2:]
    K = np.linalg.solve(L @ cov @ L.T + R, L @ cov).T
    return np.asarray(L @ (cov - K @ L @ cov) @ L.T + R)


def _cov_each_particle(*args: Any) -> Any:
    """Update the one covariance once for every particle."""
    robots, means, cov, weights = rbpf_step_with()(*args)
    z, H, R = recipes.seen(*args[5:8])
    cov = args[2] + args[8].Q[2:, 2:]
    for _ in range(len(weights) if len(z) else 0):
        K = np.linalg.solve(H[:, 2:] @ cov @ H[:, 2:].T + R, H[:, 2:] @ cov).T
        cov = cov - K @ H[:, 2:] @ cov
    return robots, means, cov, weights


def _robot_spread(only_weight: bool) -> Any:
    """Add the noise of the robot, which has been drawn already, to the spread of z."""

    def rbpf_step(*args: Any) -> Any:
        Q = args[8].Q[:2, :2]

        def spread(cov: Array, H: Array, R: Array) -> Array:
            return np.asarray(H[:, 2:] @ cov @ H[:, 2:].T + R + H[:, :2] @ Q @ H[:, :2].T)

        step = rbpf_step_with(weight_spread=spread) if only_weight else rbpf_step_with(spread=spread)
        return step(*args)

    return rbpf_step


def _half_joseph(cov: Array, K: Array, H: Array) -> Array:
    left = np.eye(len(cov)) - K @ H[:, 2:]
    return np.asarray(left @ cov @ left.T)


def _even_when_blind(*args: Any) -> Any:
    answer = reference.rbpf_step(*args)
    return (*answer[:3], np.full(len(answer[3]), 1 / len(answer[3]))) if np.isnan(args[5]).all() else answer


def _frozen_when_blind(*args: Any) -> Any:
    return args[:4] if np.isnan(args[5]).all() else reference.rbpf_step(*args)


def _mixture(change: Any) -> Any:
    def rbpf_moments(robots: Array, means: Array, cov: Array, weights: Array) -> tuple[Array, Array]:
        mean, spread = reference.moments(np.vstack([robots, means]), weights)
        return mean, change(spread, cov, weights)

    return rbpf_moments


def _within(spread: Array, cov: Array) -> Array:
    spread = spread.copy()
    spread[2:, 2:] += cov
    return spread


def _uncrossed(spread: Array) -> Array:
    spread = spread.copy()
    spread[:2, 2:] = spread[2:, :2] = 0
    return spread


def _only_within(spread: Array, cov: Array) -> Array:
    spread = spread.copy()
    spread[2:, 2:] = cov
    return spread


def _on_robot(spread: Array, cov: Array) -> Array:
    spread = spread.copy()
    spread[:2, :2] += cov[:2, :2]
    return spread


def _on_top_left(spread: Array, cov: Array) -> Array:
    spread = spread.copy()
    spread[: len(cov), : len(cov)] += cov
    return spread


def _map_blocks(cov: Array) -> Array:
    """Keep what belongs to the robot, and a (2, 2) block for each landmark."""
    pair = np.arange(len(cov)) // 2
    kept = (pair[:, np.newaxis] == pair) | (pair[:, np.newaxis] == 0) | (pair == 0)
    return np.where(kept, cov, 0)


def _half_crossed(cov: Array, upper: int) -> Array:
    cov = cov.copy()
    if upper:
        cov[:2, 2:] = 0
    else:
        cov[2:, :2] = 0
    return cov


def _second_moment(robots: Array, means: Array, cov: Array, weights: Array) -> tuple[Array, Array]:
    x = np.vstack([robots, means])
    return x @ weights, _within((x * weights) @ x.T, cov)


def _rolled(mean: Array, cov: Array) -> tuple[Array, Array]:
    """Put the landmarks first."""
    return np.roll(mean, -2), np.roll(cov, (-2, -2), axis=(0, 1))


def _plain_about(robots: Array, means: Array, cov: Array, weights: Array) -> tuple[Array, Array]:
    """Weigh the mean, and not the spread about it."""
    x = np.vstack([robots, means])
    d = x - (x @ weights)[:, np.newaxis]
    return x @ weights, _within(d @ d.T / len(weights), cov)


def _weighed_about_plain(robots: Array, means: Array, cov: Array, weights: Array) -> tuple[Array, Array]:
    """Weigh the spread, and not the mean."""
    x = np.vstack([robots, means])
    d = x - x.mean(axis=1, keepdims=True)
    return x.mean(axis=1), _within((d * weights) @ d.T, cov)


moments: Mutants = [
    ("rb-conditional-dropped", _mixture(lambda spread, cov, w: spread)),
    ("rb-cross-dropped", _mixture(lambda spread, cov, w: _within(_uncrossed(spread), cov))),
    ("rb-cross-dropped", _mixture(lambda spread, cov, w: _uncrossed(spread))),
    ("rb-spread-dropped", _mixture(lambda spread, cov, w: _only_within(spread, cov))),
    ("rb-spread-dropped", _mixture(lambda spread, cov, w: _only_within(_uncrossed(spread), cov))),
    ("rb-conditional-misplaced", _mixture(lambda spread, cov, w: _on_robot(spread, cov))),
    ("rb-conditional-misplaced", _mixture(lambda spread, cov, w: _on_top_left(spread, cov))),
    ("covariance-sign", _mixture(lambda spread, cov, w: _within(spread, -cov))),
    ("deviation-as-variance", _mixture(lambda spread, cov, w: _within(spread, np.sqrt(np.abs(cov))))),
    ("map-correlations-dropped", _mixture(lambda spread, cov, w: _map_blocks(_within(spread, cov)))),
    ("rb-cross-half", _mixture(lambda spread, cov, w: _half_crossed(_within(spread, cov), 0))),
    ("rb-cross-half", _mixture(lambda spread, cov, w: _half_crossed(_within(spread, cov), 1))),
    ("second-moment", lambda r, m, cov, w: _second_moment(r, m, cov, w)),
    ("order-of-components", lambda r, m, cov, w: _rolled(*reference.rbpf_moments(r, m, cov, w))),
    ("weights-ignored", lambda r, m, cov, w: _plain_about(r, m, cov, w)),
    ("weights-ignored", lambda r, m, cov, w: _weighed_about_plain(r, m, cov, w)),
    ("covariance-normalisation", _mixture(lambda spread, cov, w: _within(spread / (1 - np.sum(w**2)), cov))),
    ("covariance-normalisation", _mixture(lambda spread, cov, w: _within(spread, cov * np.sum(w**2)))),
    ("covariance-normalisation", _mixture(lambda spread, cov, w: _within(spread, cov / len(w)))),
    ("covariance-normalisation", _mixture(lambda spread, cov, w: _within(spread, cov * len(w)))),
    ("weights-ignored", lambda r, m, cov, w: reference.rbpf_moments(r, m, cov, np.full(len(w), 1 / len(w)))),
    ("variances-only", _mixture(lambda spread, cov, w: np.diag(np.diag(_within(spread, cov))))),
    ("map-correlations-dropped", _mixture(lambda spread, cov, w: _within(spread, np.diag(np.diag(cov))))),
    ("weights-ignored", lambda r, m, cov, w: _plain(r, m, cov, w)),
]


def _plain(robots: Array, means: Array, cov: Array, weights: Array) -> tuple[Array, Array]:
    """Weigh the mean, but not the spread."""
    x = np.vstack([robots, means])
    return x @ weights, _within(np.cov(x, ddof=0), cov)
