"""Mistakes of the Kalman step and of the filter around it."""

from typing import Any

import numpy as np

from lab.checks.mistakes.seeing import SELECT
from lab.checks.recipes import Function, kalman_filter_with, kalman_step_with, seen
from lab.checks.worlds import handout_model
from lab.validation import Array

Mutants = list[tuple[str, Function]]


def predicted_means() -> Mutants:
    """Return mistaken ways from mean (n,) or (n, P) to F mean + B."""
    return [
        ("b-omitted", lambda mean, model: model.F @ mean),
        ("wrong-b", lambda mean, model: model.F @ mean + 2 * _column(model.B, mean)),
        ("wrong-b", lambda mean, model: model.F @ mean - _column(model.B, mean)),
        ("wrong-b", lambda mean, model: model.F @ mean + _column(_centre(model), mean)),
        ("wrong-b", lambda mean, model: model.F @ (mean + _column(model.B, mean))),
        ("wrong-b", lambda mean, model: model.F @ (mean - _column(_centre(model), mean))),
        ("f-transposed", lambda mean, model: model.F.T @ mean + _column(model.B, mean)),
        ("f-omitted", lambda mean, model: mean + _column(model.B, mean)),
        ("retyped", lambda mean, model: handout_model(len(mean) // 2 - 1).F @ mean + _column(model.B, mean)),
        ("retyped", lambda mean, model: model.F @ mean + _column(handout_model(len(mean) // 2 - 1).B, mean)),
        ("retyped", lambda mean, model: _typed(mean, model)),
        ("wrong-b", lambda mean, model: model.F @ (mean - _column(model.B, mean)) + _column(model.B, mean)),
        ("predicted-twice", lambda mean, model: _twice(mean, model)),
        ("degrees", lambda mean, model: _turned(mean, 45.0) + _column(model.B, mean)),
        ("degrees", lambda mean, model: _about_centre(mean, 45.0)),
        ("f-transposed", lambda mean, model: _about_centre(mean, -np.pi / 4)),
        ("f-transposed", lambda mean, model: _turned(mean, -np.pi / 4) + _column(model.B, mean)),
        ("open-loop", lambda mean, model: mean),
    ]


def _column(vector: Array, like: Array) -> Array:
    return vector if like.ndim == 1 else vector[:, np.newaxis]


def _centre(model: Any) -> Array:
    centre = np.zeros(len(model.m0))
    centre[:2] = np.linalg.solve(np.eye(2) - model.F[:2, :2], model.B[:2])
    return centre


def _twice(mean: Array, model: Any) -> Array:
    once = model.F @ mean + _column(model.B, mean)
    return np.asarray(model.F @ once + _column(model.B, mean))


def _turned(mean: Array, angle: float) -> Array:
    turned = np.array(mean, dtype=np.float64)
    turned[:2] = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ turned[:2]
    return turned


def _about_centre(mean: Array, angle: float) -> Array:
    """Turn the robot about the handout's centre, typed in."""
    centre = np.zeros(len(mean))
    centre[0] = -1.5
    return _turned(mean - _column(centre, mean), angle) + _column(centre, mean)


def _typed(mean: Array, model: Any) -> Array:
    typed: Any = handout_model(len(mean) // 2 - 1)
    return np.asarray(typed.F @ mean + _column(typed.B, mean))


def _diagonal_blocks(cov: Array) -> Array:
    """Return the covariance without the terms between robot and landmarks."""
    cov = cov.copy()
    cov[:2, 2:] = cov[2:, :2] = 0
    return cov


def _only_seen(P: Array, H: Array, S: Array) -> Array:
    K = np.linalg.solve(S, H @ P).T
    K[~(H != 0).any(axis=0)] = 0
    return np.asarray(K)


def _part(first: int, last: int | None) -> Function:
    def gain(P: Array, H: Array, S: Array) -> Array:
        K = np.linalg.solve(S, H @ P).T
        K[first:last] = 0
        return np.asarray(K)

    return gain


def _scaled(change: Function) -> Function:
    return lambda cov, model: model.F @ cov @ model.F.T + change(model.Q)


def _swapped(step: Function) -> Function:
    """Update first, then predict."""

    class Still:
        def __init__(self, model: Any) -> None:
            self.F, self.B, self.Q = np.eye(len(model.m0)), 0 * model.B, 0 * model.Q

    def kalman_step(mean: Array, cov: Array, z: Array, H: Array, R: Array, model: Any) -> tuple[Array, Array]:
        mean, cov = step(mean, cov, z, H, R, Still(model))
        return model.F @ mean + model.B, model.F @ cov @ model.F.T + model.Q

    return kalman_step


def _early_gain(new_cov: Function) -> Function:
    """Compute the gain with the covariance of k - 1, and S with either."""

    def kalman_step(mean: Array, cov: Array, z: Array, H: Array, R: Array, model: Any) -> tuple[Array, Array]:
        z, H, R = seen(z, H, R)
        new, P = model.F @ mean + model.B, model.F @ cov @ model.F.T + model.Q
        if not len(z):
            return new, P
        S = H @ P @ H.T + R
        K = cov @ H.T @ np.linalg.inv(S)
        nu = z - H @ new
        return new + K @ nu, new_cov(P, K, H, S, nu)

    return kalman_step


def _retyped_Q(Q: Array) -> Array:
    return handout_model(len(Q) // 2 - 1).Q


# the same right update written in several ways, which differ once something before is wrong
STYLES: tuple[dict[str, Function], ...] = (
    {},
    {"gain": lambda P, H, S: P @ H.T @ np.linalg.inv(S)},
    {"new_cov": lambda P, K, H, S, nu: P - K @ S @ K.T},
    {"gain": lambda P, H, S: P @ H.T @ np.linalg.inv(S), "new_cov": lambda P, K, H, S, nu: P - K @ S @ K.T},
    {"new_cov": lambda P, K, H, S, nu: _joseph(P, K, H, S)},
    {"gain": lambda P, H, S: P @ H.T @ np.linalg.inv(S), "new_cov": lambda P, K, H, S, nu: _joseph(P, K, H, S)},
    {"finish": lambda new, predicted, old: (new[0], (new[1] + new[1].T) / 2)},
)


def _joseph(P: Array, K: Array, H: Array, S: Array) -> Array:
    left = np.eye(len(P)) - K @ H
    return np.asarray(left @ P @ left.T + K @ (S - H @ P @ H.T) @ K.T)


def steps() -> Mutants:
    """Return mistaken kalman_steps, each mistake in every style that it leaves open."""
    found: Mutants = []
    for style in STYLES:
        found += _steps(style)
    return found


def _steps(style: dict[str, Function]) -> Mutants:
    def build(**changes: Function) -> Function:
        return kalman_step_with(**{**style, **changes})

    short: Any = lambda P, K, H, S, nu: P - K @ H @ P  # noqa: E731
    eye: Any = lambda P: np.eye(len(P))  # noqa: E731
    found: Mutants = [(key, build(select=select)) for key, select in SELECT]
    found += [(key, build(predicted_mean=wrong)) for key, wrong in predicted_means() if key != "open-loop"]
    found += [
        (key, build(predicted_cov=wrong))
        for key, wrong in (
            ("noise-omitted", lambda cov, model: model.F @ cov @ model.F.T),
            ("covariance-not-predicted", lambda cov, model: cov),
            ("noise-before-f", lambda cov, model: model.F @ (cov + model.Q) @ model.F.T),
            ("covariance-not-predicted", lambda cov, model: cov + model.Q),
            ("f-transposed", lambda cov, model: model.F @ cov @ model.F + model.Q),
            ("f-transposed", lambda cov, model: model.F.T @ cov @ model.F + model.Q),
            ("f-omitted", lambda cov, model: model.F @ cov + model.Q),
            ("element-wise", lambda cov, model: model.F * cov * model.F.T + model.Q),
            ("element-wise", lambda cov, model: model.F @ cov * model.F.T + model.Q),
            ("element-wise", lambda cov, model: model.F * cov @ model.F.T + model.Q),
            ("deviation-as-variance", _scaled(np.sqrt)),
            ("deviation-as-variance", _scaled(np.linalg.cholesky)),
            ("variance-squared", _scaled(lambda Q: Q @ Q)),
            ("variance-squared", _scaled(lambda Q: Q**2)),
            ("diagonal-only", _scaled(lambda Q: np.diag(np.diag(Q)))),
            ("retyped", _scaled(_retyped_Q)),
            ("landmark-noise-ignored", _scaled(lambda Q: np.pad(Q[:2, :2], (0, len(Q) - 2)))),
            ("cross-terms-dropped", lambda cov, model: _diagonal_blocks(model.F @ cov @ model.F.T + model.Q)),
            ("cross-terms-dropped", lambda cov, model: np.diag(np.diag(model.F @ cov @ model.F.T + model.Q))),
        )
    ]
    found += [
        (key, build(spread=wrong))
        for key, wrong in (
            ("s-without-noise", lambda P, H, R: H @ P @ H.T),
            ("s-without-state", lambda P, H, R: R),
            ("s-sign", lambda P, H, R: H @ P @ H.T - R),
            ("element-wise", lambda P, H, R: (H @ P @ H.T) * R),
            ("deviation-as-variance", lambda P, H, R: H @ P @ H.T + np.sqrt(np.diag(np.diag(R)))),
        )
    ]
    found += [
        (key, build(gain=wrong))
        for key, wrong in (
            ("double-inverse", lambda P, H, S: P @ H.T @ S),
            ("double-inverse", lambda P, H, S: P @ H.T),
            ("element-wise", lambda P, H, S: P @ H.T / np.diag(S)),
            ("element-wise", lambda P, H, S: P @ H.T * (1 / np.diag(S))),
            ("element-wise", lambda P, H, S: P @ H.T @ (1 / S)),
            ("element-wise", lambda P, H, S: P @ H.T @ np.diag(1 / np.diag(S))),
            ("s-sign", lambda P, H, S: P @ H.T @ np.linalg.inv(2 * H @ P @ H.T - S)),
            ("only-seen-corrected", _only_seen),
            ("robot-only", _part(2, None)),
            ("gain-transposed", lambda P, H, S: H.T @ np.linalg.inv(S)),
            ("s-without-state", lambda P, H, S: P @ H.T @ np.linalg.inv(S - H @ P @ H.T)),
            ("s-without-noise", lambda P, H, S: P @ H.T @ np.linalg.pinv(H @ P @ H.T)),
        )
    ]
    found += [
        (key, build(new_mean=wrong))
        for key, wrong in (
            ("innovation-sign", lambda m, K, nu: m - K @ nu),
            ("mean-not-stored", lambda m, K, nu: m),
            ("f-omitted", lambda m, K, nu: K @ nu),
        )
    ]
    found += [
        (key, build(new_cov=wrong))
        for key, wrong in (
            ("covariance-sign", lambda P, K, H, S, nu: P + K @ H @ P),
            ("covariance-sign", lambda P, K, H, S, nu: P + K @ S @ K.T),
            ("covariance-not-stored", lambda P, K, H, S, nu: P),
            ("covariance-with-innovation", lambda P, K, H, S, nu: P - np.outer(K @ nu, K @ nu)),
            ("covariance-with-innovation", lambda P, K, H, S, nu: P - K @ nu),
            ("covariance-with-innovation", lambda P, K, H, S, nu: (eye(P) - np.outer(K @ nu, np.ones(len(P)))) @ P),
            ("covariance-with-innovation", lambda P, K, H, S, nu: P - (K @ nu)[:, np.newaxis]),
            ("covariance-with-innovation", lambda P, K, H, S, nu: P - K @ np.diag(nu) @ H @ P),
            ("covariance-with-innovation", lambda P, K, H, S, nu: P - np.diag(K @ nu)),
            ("one-for-identity", lambda P, K, H, S, nu: (1 - K @ H) @ P),
            ("joseph-incomplete", lambda P, K, H, S, nu: (eye(P) - K @ H) @ P @ (eye(P) - K @ H).T),
            ("element-wise", lambda P, K, H, S, nu: (eye(P) - K @ H) * P),
            ("gain-transposed", lambda P, K, H, S, nu: (eye(P) - (K @ H).T) @ P),
            ("product-order", lambda P, K, H, S, nu: P @ (eye(P) - K @ H)),
            ("s-without-noise", lambda P, K, H, S, nu: P - K @ (H @ P @ H.T) @ K.T),
            ("joseph-sign", lambda P, K, H, S, nu: 2 * _half(P, K, H) - _joseph(P, K, H, S)),
            ("s-without-state", lambda P, K, H, S, nu: P - K @ (S - H @ P @ H.T) @ K.T),
            ("p-missing", lambda P, K, H, S, nu: eye(P) - K @ H),
        )
    ]
    found += [
        ("innovation-before-prediction", build(innovation=lambda z, H, predicted, mean: z - H @ mean)),
        ("robot-ignored", build(innovation=lambda z, H, predicted, mean: z - H[:, 2:] @ predicted[2:])),
        ("innovation-sign", build(innovation=lambda z, H, predicted, mean: z + H @ predicted)),
        ("innovation-missing", build(innovation=lambda z, H, predicted, mean: z)),
        ("mean-not-carried", build(predicted_mean=lambda mean, model: model.F @ model.m0 + model.B)),
        ("covariance-not-carried", build(predicted_cov=lambda cov, model: model.F @ model.P0 @ model.F.T + model.Q)),
        ("predicted-twice", build(predicted_mean=_twice, predicted_cov=_twice_cov)),
        ("predicted-twice", build(predicted_cov=_twice_cov)),
        ("prediction-missing", build(predicted_mean=lambda mean, model: mean, predicted_cov=lambda cov, model: cov)),
        ("correction-on-old", build(finish=_on_old)),
        ("cross-terms-dropped", build(finish=_afterwards(_diagonal_blocks))),
        ("cross-terms-dropped", build(finish=_afterwards(lambda cov: np.diag(np.diag(cov))))),
        ("not-halved", build(finish=_afterwards(lambda cov: cov + cov.T))),
        ("prediction-late", _late(build(predicted_mean=lambda mean, model: model.F @ mean), 1, 0)),
        ("prediction-late", _late(build(predicted_cov=lambda cov, model: model.F @ cov @ model.F.T), 0, 1)),
        ("prediction-late", _late(build(predicted_mean=lambda mean, model: model.F @ mean), 1, 0, blind=False)),
        (
            "prediction-late",
            _late(build(predicted_cov=lambda cov, model: model.F @ cov @ model.F.T), 0, 1, blind=False),
        ),
        ("covariance-not-predicted", _old_cov_updated),
        ("double-inverse", _mean_twice_divided),
        ("gain-before-prediction", _old_gain),
        *[("updates-side-by-side", _side_by_side(cov)) for cov in (True, False)],
        ("open-loop", build(finish=lambda new, predicted, old: predicted)),
        ("prediction-lost", build(finish=lambda new, predicted, old: old)),
        ("no-prediction-when-blind", build(finish=_frozen)),
        ("update-before-prediction", _swapped(build())),
        ("gain-before-prediction", _early_gain(short)),
        ("gain-before-prediction", _early_gain(lambda P, K, H, S, nu: P - K @ S @ K.T)),
        ("covariance-not-predicted", build(predicted_cov=lambda cov, model: cov, new_cov=short)),
        ("mean-not-stored", build(finish=lambda new, predicted, old: (old[0], new[1]))),
        ("covariance-not-stored", build(finish=lambda new, predicted, old: (new[0], old[1]))),
        (
            "retyped",
            build(predicted_mean=_typed, predicted_cov=_typed_cov, select=dict_of("retyped")),
        ),
        ("retyped", build(predicted_mean=_typed, predicted_cov=_typed_cov)),
        ("innovation-sign", build(new_mean=lambda m, K, nu: m - K @ nu, new_cov=lambda P, K, H, S, nu: P + K @ H @ P)),
    ]
    return found


def _half(P: Array, K: Array, H: Array) -> Array:
    left = np.eye(len(P)) - K @ H
    return np.asarray(left @ P @ left.T)


def _twice_cov(cov: Array, model: Any) -> Array:
    once = model.F @ cov @ model.F.T + model.Q
    return np.asarray(model.F @ once @ model.F.T + model.Q)


def _on_old(new: Any, predicted: Any, old: Any) -> Any:
    return new if new[0] is predicted[0] else (old[0] + new[0] - predicted[0], new[1])


def _afterwards(change: Function) -> Function:
    """Change the covariance after an update."""
    return lambda new, predicted, old: new if new[0] is predicted[0] else (new[0], change(new[1]))


def _late(step: Function, B: int, Q: int, blind: bool = True) -> Function:
    """Add B, or Q, at the end; `blind` says whether also when nothing is seen."""

    def kalman_step(mean: Array, cov: Array, z: Array, H: Array, R: Array, model: Any) -> tuple[Array, Array]:
        mean, cov = step(mean, cov, z, H, R, model)
        added = blind or not np.isnan(z).all()
        return mean + added * B * model.B, cov + added * Q * model.Q

    return kalman_step


def _old_cov_updated(mean: Array, cov: Array, z: Array, H: Array, R: Array, model: Any) -> tuple[Array, Array]:
    """Predict the covariance for the gain, and update the old one with it."""
    z, H, R = seen(z, H, R)
    mean, P = model.F @ mean + model.B, model.F @ cov @ model.F.T + model.Q
    if not len(z):
        return mean, P
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    return mean + K @ (z - H @ mean), (np.eye(len(P)) - K @ H) @ cov


def _mean_twice_divided(mean: Array, cov: Array, z: Array, H: Array, R: Array, model: Any) -> tuple[Array, Array]:
    z, H, R = seen(z, H, R)
    mean, P = model.F @ mean + model.B, model.F @ cov @ model.F.T + model.Q
    S = H @ P @ H.T + R
    K = np.linalg.solve(S, H @ P).T
    return mean + K @ np.linalg.solve(S, z - H @ mean), P - K @ H @ P


def _old_gain(mean: Array, cov: Array, z: Array, H: Array, R: Array, model: Any) -> tuple[Array, Array]:
    """Take S and K from the covariance of k - 1."""
    z, H, R = seen(z, H, R)
    mean, P = model.F @ mean + model.B, model.F @ cov @ model.F.T + model.Q
    K = np.linalg.solve(H @ cov @ H.T + R, H @ cov).T
    return mean + K @ (z - H @ mean), P - K @ H @ P


def _side_by_side(both: bool) -> Function:
    """Correct the same prediction with every landmark; `both` says whether the covariance, too."""

    def kalman_step(mean: Array, cov: Array, z: Array, H: Array, R: Array, model: Any) -> tuple[Array, Array]:
        z, H, R = seen(z, H, R)
        mean, P = model.F @ mean + model.B, model.F @ cov @ model.F.T + model.Q
        new, left = mean, P
        for i in range(0, len(z), 2):
            h, prior = H[i : i + 2], P if both else left
            K = np.linalg.solve(h @ prior @ h.T + R[i : i + 2, i : i + 2], h @ prior).T
            new, left = new + K @ (z[i : i + 2] - h @ mean), left - K @ h @ prior
        return new, left

    return kalman_step


def dict_of(key: str) -> Function:
    """Return the first way of seeing with this key."""
    return next(select for name, select in SELECT if name == key)  # type: ignore[no-any-return]


def _typed_cov(cov: Array, model: Any) -> Array:
    typed: Any = handout_model(len(cov) // 2 - 1)
    return np.asarray(typed.F @ cov @ typed.F.T + typed.Q)


def _frozen(new: Any, predicted: Any, old: Any) -> Any:
    return old if new[0] is predicted[0] else new


def _shifted(by: int, what: str) -> Function:
    """Read the measurements of another instant; those beyond the end are not there."""

    def measured(problem: Any, k: int) -> tuple[Any, Any, Any]:
        there = min(max(k + by, 0), problem.n_instants - 1)
        z, H, R = problem.z[there], problem.H[there], problem.R[there]
        if not 0 <= k + by < problem.n_instants:
            z = np.full_like(z, np.nan)
        return (z, H, R) if what == "all" else (z, problem.H[k], problem.R[k])

    return measured


def _seen_in_both(z: Array, H: Array, R: Array) -> Any:
    rows = ~np.isnan(z) & ~np.isnan(H[:, 0])
    return seen(np.where(rows, z, np.nan), H, R)


def _stored_before(problem: Any) -> tuple[Array, Array]:
    model, step = problem.model, kalman_step_with()
    mean, cov = model.m0, model.P0
    means, covs = [mean], [cov]
    for k in range(1, problem.n_instants):
        means.append(model.F @ mean + model.B)
        covs.append(model.F @ cov @ model.F.T + model.Q)
        mean, cov = step(mean, cov, problem.z[k], problem.H[k], problem.R[k], model)
    return np.array(means), np.array(covs)


def _lagging(problem: Any) -> tuple[Array, Array]:
    """Store the estimate one row too late: the prior twice."""
    means, covs = kalman_filter_with()(problem)
    return np.r_[means[:1], means[:-1]], np.r_[covs[:1], covs[:-1]]


def _stepped_at_0(problem: Any) -> tuple[Array, Array]:
    """Predict at k = 0, too, so that every row is one step ahead."""
    model = problem.model
    return kalman_filter_with(  # type: ignore[no-any-return]
        start=lambda _: (model.F @ model.m0 + model.B, model.F @ model.P0 @ model.F.T + model.Q)
    )(problem)


def _without_row_0(problem: Any) -> tuple[Array, Array]:
    means, covs = kalman_filter_with()(problem)
    return means[1:], covs[1:]


def _from_landmark_0(problem: Any) -> tuple[Array, Array]:
    return kalman_filter_with(start=lambda model: (model.m0, 0 * model.P0))(problem)  # type: ignore[no-any-return]


def _next_or_last(problem: Any, k: int) -> tuple[Any, Any, Any]:
    there = min(k + 1, problem.n_instants - 1)
    return problem.z[there], problem.H[there], problem.R[there]


def _predictions_carried(problem: Any) -> tuple[Array, Array]:
    model, step = problem.model, kalman_step_with()
    mean, cov = model.m0, model.P0
    rows = [(mean, cov)]
    for k in range(1, problem.n_instants):
        rows.append(step(mean, cov, problem.z[k], problem.H[k], problem.R[k], model))
        mean, cov = model.F @ mean + model.B, model.F @ cov @ model.F.T + model.Q
    return np.array([mean for mean, _ in rows]), np.array([cov for _, cov in rows])


def _aliased(problem: Any) -> tuple[Array, Array]:
    means, covs = kalman_filter_with()(problem)
    return np.repeat(means[-1:], len(means), axis=0), np.repeat(covs[-1:], len(covs), axis=0)


def _smoothed(problem: Any) -> tuple[Array, Array]:
    model, (means, covs) = problem.model, kalman_filter_with()(problem)
    for k in range(len(means) - 2, -1, -1):
        P = model.F @ covs[k] @ model.F.T + model.Q
        G = covs[k] @ model.F.T @ np.linalg.pinv(P)
        means[k] = means[k] + G @ (means[k + 1] - model.F @ means[k] - model.B)
        covs[k] = covs[k] + G @ (covs[k + 1] - P) @ G.T
    return means, covs


def filters() -> Mutants:
    """Return mistaken kalman_filters: every mistaken step in the right loop, and the right step in a mistaken loop."""
    found: Mutants = [
        ("late", kalman_filter_with(measured=_shifted(-1, "all"))),
        ("late", kalman_filter_with(measured=_shifted(-1, "z"))),
        ("late", kalman_filter_with(kalman_step_with(select=_seen_in_both), measured=_shifted(-1, "z"))),
        ("early", kalman_filter_with(measured=_shifted(1, "all"))),
        ("early", kalman_filter_with(kalman_step_with(select=_seen_in_both), measured=_shifted(1, "z"))),
        ("covariance-not-carried", kalman_filter_with(carry=lambda new, start: (new[0], start[1]))),
        ("mean-not-carried", kalman_filter_with(carry=lambda new, start: (start[0], new[1]))),
        ("mean-not-carried", kalman_filter_with(carry=lambda new, start: start)),
        ("stored-before-update", _stored_before),
        ("time-0-updated", _stepped_at_0),
        ("time-0-missing", _without_row_0),
        ("time-0-updated", _lagging),
        ("p0-omitted", _from_landmark_0),
        ("wrong-start", kalman_filter_with(start=lambda model: (0 * model.m0, model.P0))),
        ("wrong-start", kalman_filter_with(start=lambda model: (model.m0, np.eye(len(model.m0))))),
        ("wrong-start", kalman_filter_with(start=lambda model: (0 * model.m0, np.eye(len(model.m0))))),
        ("wrong-start", kalman_filter_with(start=lambda model: (model.m0, model.Q))),
        ("early", kalman_filter_with(measured=_next_or_last)),
        ("update-not-carried", _predictions_carried),
        ("rows-alias", _aliased),
        ("smoothed", _smoothed),
        ("deviation-as-variance", kalman_filter_with(start=lambda model: (model.m0, np.sqrt(model.P0)))),
        ("variance-squared", kalman_filter_with(start=lambda model: (model.m0, model.P0 @ model.P0))),
    ]
    found += [(key, kalman_filter_with(step)) for key, step in steps()]
    return found
