"""Mistakes of the short answers: moments, corridor, ellipse, ESS, evidence, ancestors, loop closures, the gap."""

from typing import Any

import numpy as np
from scipy import stats

from lab.checks import reference
from lab.checks.mistakes.clouds import CHOOSE
from lab.checks.mistakes.kalman import Mutants
from lab.checks.recipes import Function, normalised
from lab.checks.reference import RADIUS
from lab.validation import Array

evidences: Mutants = [
    ("evidence-not-carried", lambda w, logs: _log_sum(np.zeros(len(w)), logs) - np.log(len(w))),
    ("evidence-not-carried", lambda w, logs: _log_sum(np.zeros(len(w)), logs)),
    ("evidence-summed", lambda w, logs: np.sum(logs)),
    ("evidence-of-logs", lambda w, logs: w @ logs),
    ("evidence-of-logs", lambda w, logs: np.mean(logs)),
    ("plain-exp", lambda w, logs: _plain_log(w, logs)),
    ("plain-exp", lambda w, logs: _plain_log(np.full(len(w), 1 / len(w)), logs)),
    ("linear-not-log", lambda w, logs: w @ np.exp(logs)),
    ("linear-not-log", lambda w, logs: np.mean(np.exp(logs))),
    ("linear-not-log", lambda w, logs: np.exp(reference.evidence_increment(w, logs))),
    ("evidence-summed", lambda w, logs: reference.evidence_increment(w, logs) + np.log(len(w))),
    ("evidence-averaged-twice", lambda w, logs: reference.evidence_increment(w, logs) - np.log(len(w))),
    ("weights-squared", lambda w, logs: reference.evidence_increment(w**2, logs)),
    ("exponent-sign", lambda w, logs: -reference.evidence_increment(w, logs)),
    ("evidence-maximum", lambda w, logs: np.max(logs)),
    ("evidence-maximum", lambda w, logs: np.max(logs[w > 0])),
    ("evidence-maximum", lambda w, logs: logs[np.argmax(w)]),
    ("maximum-lost", lambda w, logs: reference.evidence_increment(w, logs) - np.max(logs)),
    ("maximum-lost", lambda w, logs: reference.evidence_increment(w, logs) - 2 * np.max(logs)),
    ("maximum-lost", lambda w, logs: _even_log(logs) - np.max(logs)),
    ("log-base", lambda w, logs: reference.evidence_increment(w, logs) / np.log(10)),
    ("log-base", lambda w, logs: reference.evidence_increment(w, logs) / np.log(2)),
    ("log-base", lambda w, logs: np.max(logs) + (reference.evidence_increment(w, logs) - np.max(logs)) / np.log(10)),
    ("plain-exp", lambda w, logs: float(np.log(w @ np.exp(logs) + 1e-300))),
    ("plain-exp", lambda w, logs: float(np.log(max(w @ np.exp(logs), 1e-300)))),
    ("evidence-new-weights", lambda w, logs: reference.evidence_increment(normalised(w, logs), logs)),
    ("weight-not-log", lambda w, logs: _log_sum(w, logs)),
    ("evidence-not-carried", lambda w, logs: _even_log(logs[w > 0])),
    ("ess-of-evidence", lambda w, logs: float(1 / np.sum(normalised(w, logs) ** 2))),
]


def _even_log(logs: Array) -> float:
    return _log_sum(np.zeros(len(logs)), logs) - float(np.log(len(logs)))


def _log_sum(first: Array, second: Array) -> float:
    return float(np.logaddexp.reduce(first + second))


def _plain_log(weights: Array, logs: Array) -> float:
    with np.errstate(all="ignore"):
        return float(np.log(weights @ np.exp(logs)))


def _moments(weigh: Function, normalise: Function, centre: Function | None = None) -> Function:
    def moments(particles: Array, weights: Array) -> tuple[Array, Array]:
        mean = particles @ weigh(weights)
        middle = centre(particles, weights) if centre else mean
        deviation = particles - middle[:, np.newaxis]
        return mean, (deviation * weigh(weights)) @ deviation.T * normalise(weights)

    return moments


def _one(weights: Array) -> float:
    return 1.0


def _even(weights: Array) -> Array:
    return np.full(len(weights), 1 / len(weights))


def _same(weights: Array) -> Array:
    return weights


def _with_cov(change: Function) -> Function:
    def moments(particles: Array, weights: Array) -> tuple[Array, Array]:
        mean, cov = reference.moments(particles, weights)
        return mean, change(cov, particles, weights)

    return moments


def _scatter(x: Array, mean: Array, factor: Any) -> Array:
    deviation = x - mean[:, np.newaxis]
    return np.asarray((deviation * factor) @ deviation.T)


moments: Mutants = [
    ("weights-ignored", _moments(_even, _one)),
    ("weights-ignored", _moments(_even, lambda w: len(w) / (len(w) - 1))),
    ("weights-ignored", lambda x, w: (x @ w, np.cov(x))),
    ("weights-ignored", lambda x, w: (x @ w, np.cov(x, ddof=0))),
    ("weights-ignored", lambda x, w: (x.mean(axis=1), reference.moments(x, w)[1])),
    ("weights-ignored", lambda x, w: (x @ w, _scatter(x, x @ w, 1 / len(w)))),
    ("weights-ignored", lambda x, w: (x @ w, _scatter(x, x @ w, 1 / (len(w) - 1)))),
    ("weights-ignored", lambda x, w: (x.mean(axis=1), _scatter(x, x.mean(axis=1), w))),
    ("covariance-normalisation", lambda x, w: (x @ w, _scatter(x, x @ w, 1.0))),
    ("covariance-normalisation", _moments(_same, lambda w: 1 / (1 - np.sum(w**2)))),
    ("covariance-normalisation", _moments(_same, lambda w: 1 / len(w))),
    ("covariance-normalisation", _moments(_same, lambda w: 1 / (len(w) - 1))),
    ("covariance-normalisation", _moments(_same, lambda w: len(w) / (len(w) - 1))),
    ("covariance-normalisation", _moments(_same, lambda w: float(len(w)))),
    (
        "covariance-normalisation",
        _moments(_same, lambda w: np.count_nonzero(w) / (np.count_nonzero(w) - 1)),
    ),
    ("covariance-normalisation", _moments(_same, lambda w: 1 / np.sum(w**2))),
    ("covariance-normalisation", _moments(_same, lambda w: np.sum(w**2))),
    ("second-moment", _with_cov(lambda cov, x, w: (x * w) @ x.T)),
    ("second-moment", _with_cov(lambda cov, x, w: x @ x.T / len(w) - np.outer(x @ w, x @ w))),
    ("second-moment", _with_cov(lambda cov, x, w: (x * w) @ x.T + np.outer(x @ w, x @ w))),
    ("centred-elsewhere", _moments(_same, _one, lambda x, w: x.mean(axis=1))),
    ("centred-elsewhere", _moments(_same, _one, lambda x, w: x[:, np.argmax(w)])),
    ("likeliest-particle", lambda x, w: (x[:, np.argmax(w)], reference.moments(x, w)[1])),
    ("likeliest-particle", lambda x, w: (x[:, np.argmax(w)], _scatter(x, x[:, np.argmax(w)], w))),
    ("weights-ignored", lambda x, w: (np.median(x, axis=1), reference.moments(x, w)[1])),
    ("mean-over-all", lambda x, w: (np.full(len(x), x.mean()), reference.moments(x, w)[1])),
    ("mean-over-all", lambda x, w: (np.full(len(x), x.mean()), _scatter(x, np.full(len(x), x.mean()), w))),
    ("variances-only", _with_cov(lambda cov, x, w: np.diag(np.diag(cov)))),
    ("deviation-as-variance", _with_cov(lambda cov, x, w: np.diag(np.sqrt(np.diag(cov))))),
    ("deviation-as-variance", _with_cov(lambda cov, x, w: np.sqrt(cov))),
    ("deviation-as-variance", _with_cov(lambda cov, x, w: np.sqrt(np.abs(cov)))),
    ("weights-squared", _with_cov(lambda cov, x, w: _scatter(x, x @ w, w**2))),
    ("weights-squared", _with_cov(lambda cov, x, w: _scatter(w * x, x @ w, 1.0))),
    ("weights-squared", _with_cov(lambda cov, x, w: _scatter(w * x, (w * x).mean(axis=1), 1.0))),
    ("weights-rooted", _with_cov(lambda cov, x, w: _scatter(x, x @ w, np.sqrt(w)))),
    ("mean-divided", lambda x, w: (x @ w / len(w), reference.moments(x, w)[1])),
    ("mean-divided", lambda x, w: (x @ w / len(w), _scatter(x, x @ w / len(w), w))),
    ("cross-terms-dropped", _with_cov(lambda cov, x, w: _block(cov))),
]


def _block(cov: Array) -> Array:
    cov = cov.copy()
    cov[:2, 2:] = cov[2:, :2] = 0
    return cov


def _corridor(reach: Function) -> Function:
    def corridor(means: Array, covs: Array) -> tuple[Array, Array]:
        half = reach(np.diagonal(covs, axis1=1, axis2=2))
        return means - half, means + half

    return corridor


_QUANTILES = {0.95: 1.959963984540054, 0.99: 2.5758293035489004, 0.997: 2.7477813854449926}
corridors: Mutants = [
    ("variance-for-deviation", _corridor(lambda v: 3 * v)),
    ("variance-for-deviation", _corridor(lambda v: v)),
    ("variance-for-deviation", _corridor(lambda v: stats.norm.ppf(0.9985) * v)),
    ("wrong-level", _corridor(lambda v: np.sqrt(3 * v))),
    ("chi2-dimension", _corridor(lambda v: RADIUS * np.sqrt(v))),
    ("chi2-dimension", _corridor(lambda v: np.sqrt(stats.chi2.ppf(0.997, 2) * v))),
    ("bounds-swapped", lambda means, covs: reference.corridor(means, covs)[::-1]),
    ("width", lambda means, covs: (means, 3 * np.sqrt(np.diagonal(covs, axis1=1, axis2=2)))),
    ("width", _corridor(lambda v: 6 * np.sqrt(v))),
    ("width", _corridor(lambda v: 1.5 * np.sqrt(v))),
    ("deviation-as-variance", _corridor(lambda v: 3 * np.sqrt(np.sqrt(v)))),
    ("one-instant", lambda means, covs: _corridor(lambda v: 3 * np.sqrt(v[:1]) + 0 * v)(means, covs)),
    ("one-instant", lambda means, covs: _corridor(lambda v: 3 * np.sqrt(v[-1:]) + 0 * v)(means, covs)),
    ("one-instant", lambda means, covs: _corridor(lambda v: 3 * np.sqrt(v.mean(axis=0)) + 0 * v)(means, covs)),
    ("spread-over-time", lambda means, covs: _corridor(lambda v: 3 * means.std(axis=0) + 0 * v)(means, covs)),
    ("one-sided", lambda means, covs: (means, reference.corridor(means, covs)[1])),
    ("one-sided", lambda means, covs: (reference.corridor(means, covs)[0], means)),
    ("axes-of-time", lambda means, covs: _corridor(lambda v: 3 * np.sqrt(np.diagonal(covs)))(means, covs)),
    ("axes-of-time", lambda means, covs: _corridor(lambda v: 3 * np.sqrt(np.diagonal(covs).T))(means, covs)),
    ("axes-of-time", lambda means, covs: _corridor(lambda v: 3 * np.sqrt(np.diagonal(covs, 0, 0, 2)))(means, covs)),
    ("not-shifted", lambda means, covs: tuple(np.array(reference.corridor(means, covs)) - means)),
]
corridors += [
    ("wrong-level", _corridor(lambda v, factor=factor: factor * np.sqrt(v)))
    for factor in (1.0, 2.0, 2.5, 4.0, 9.0, *_QUANTILES.values())
]


def _ellipse(radius: float = RADIUS, root: Function | None = None, shift: float = 1.0) -> Function:
    def confidence_ellipse(mean: Array, cov: Array, n_points: int = 100) -> Array:
        angles = np.linspace(0, 2 * np.pi, n_points)
        circle = np.array([np.cos(angles), np.sin(angles)])
        A = np.linalg.cholesky(cov) if root is None else root(cov)
        return np.asarray(shift * mean[:, np.newaxis] + radius * A @ circle)

    return confidence_ellipse


def _transposed(cov: Array) -> Array:
    """Return the axes of eig as rows; those of eigh are symmetric in the plane, and would be right."""
    values, vectors = np.linalg.eig(cov)
    return np.asarray(vectors.T * np.sqrt(values))


def _axes(power: float = 0.5, swap: bool = False) -> Function:
    def root(cov: Array) -> Array:
        values, vectors = np.linalg.eigh(cov)
        return np.asarray(vectors * (values[::-1] if swap else values) ** power)

    return root


def _quantile(level: float, dimension: int) -> float:
    return float(np.sqrt(stats.chi2.ppf(level, dimension)))


ellipses: Mutants = [
    ("three-sigma", _ellipse(3.0)),
    ("chi2-dimension", _ellipse(_quantile(0.99, 1))),
    ("chi2-dimension", _ellipse(_quantile(0.99, 3))),
    ("chi2-dimension", _ellipse(_quantile(0.99, 4))),
    ("chi2-dimension", _ellipse(_quantile(0.99, 12))),
    ("wrong-level", _ellipse(_quantile(0.95, 2))),
    ("wrong-level", _ellipse(_quantile(0.997, 2))),
    ("wrong-level", _ellipse(_quantile(0.9, 2))),
    ("wrong-level", _ellipse(_quantile(0.999, 2))),
    ("wrong-level", _ellipse(1.0)),
    ("wrong-level", _ellipse(2.0)),
    ("chi2-dimension", _ellipse(_quantile(0.997, 1))),
    ("chi2-dimension", _ellipse(_quantile(0.95, 1))),
    ("radius-squared", _ellipse(RADIUS**2)),
    ("radius-squared", _ellipse(9.0)),
    ("deviation-as-variance", _ellipse(np.sqrt(RADIUS))),
    ("variance-for-deviation", _ellipse(root=_axes(1.0))),
    ("variance-for-deviation", _ellipse(3.0, root=_axes(1.0))),
    ("variance-for-deviation", _ellipse(RADIUS**2, root=_axes(1.0))),
    ("variance-for-deviation", _ellipse(root=lambda cov: cov)),
    ("axes-wrong", _ellipse(root=_transposed)),
    ("axes-wrong", _ellipse(root=_axes(swap=True))),
    ("axes-wrong", _ellipse(root=lambda cov: np.linalg.cholesky(cov).T)),
    ("axes-wrong", _ellipse(root=lambda cov: _diagonal_in_axes(cov))),
    ("correlation-ignored", _ellipse(root=lambda cov: np.diag(np.sqrt(np.diag(cov))))),
    ("correlation-ignored", _ellipse(3.0, root=lambda cov: np.diag(np.sqrt(np.diag(cov))))),
    ("correlation-ignored", _ellipse(root=lambda cov: np.diag(np.sqrt(np.linalg.eigvalsh(cov))))),
    ("correlation-ignored", _ellipse(root=lambda cov: np.diag(np.sqrt(np.linalg.eigvalsh(cov)[::-1])))),
    ("variance-for-deviation", _ellipse(root=lambda cov: np.diag(np.diag(cov)))),
    ("not-shifted", _ellipse(shift=0.0)),
    ("deviation-as-variance", _ellipse(root=_axes(0.25))),
    ("diameter", _ellipse(2 * RADIUS)),
    ("diameter", _ellipse(RADIUS / 2)),
    ("inverse-covariance", _ellipse(root=lambda cov: np.linalg.inv(np.linalg.cholesky(cov)))),
    ("inverse-covariance", _ellipse(root=lambda cov: np.linalg.cholesky(np.linalg.inv(cov)))),
    ("inverse-covariance", _ellipse(root=np.linalg.inv)),
    ("axes-wrong", _ellipse(root=lambda cov: _turned(cov, -1.0))),
    ("degrees", _ellipse(root=lambda cov: _turned(cov, 180 / np.pi))),
    ("degrees", _ellipse(root=lambda cov: _turned(cov, np.pi / 180))),
    ("correlation-ignored", _ellipse(root=lambda cov: np.sqrt(np.trace(cov) / 2) * np.eye(2))),
    ("correlation-ignored", _ellipse(root=lambda cov: np.linalg.det(cov) ** 0.25 * np.eye(2))),
    ("correlation-ignored", _ellipse(root=lambda cov: np.sqrt(np.max(np.linalg.eigvalsh(cov))) * np.eye(2))),
]


def _turned(cov: Array, factor: float) -> Array:
    """Turn the long axis by `factor` times the angle that it has."""
    values, vectors = np.linalg.eigh(cov)
    angle = factor * np.arctan2(vectors[1, 1], vectors[0, 1])
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return np.asarray(rotation * np.sqrt(values[::-1]))


def _diagonal_in_axes(cov: Array) -> Array:
    _, vectors = np.linalg.eigh(cov)
    return np.asarray(vectors * np.sqrt(np.diag(cov)))


def _entropy(weights: Array) -> float:
    positive = weights[weights > 0]
    return float(np.exp(-np.sum(positive * np.log(positive))))


ess: Mutants = [
    ("ess-inverse", lambda w: np.sum(w**2)),
    ("ess-ratio", lambda w: 1 / np.sum(w**2) / len(w)),
    ("ess-no-square", lambda w: 1 / np.sum(w)),
    ("ess-no-square", lambda w: np.sum(w) ** 2),
    ("ess-maximum", lambda w: 1 / np.max(w)),
    ("ess-count", lambda w: float(np.count_nonzero(w))),
    ("ess-count", lambda w: float(len(w))),
    ("ess-rounded", lambda w: np.floor(1 / np.sum(w**2))),
    ("ess-rounded", lambda w: np.round(1 / np.sum(w**2))),
    ("ess-rounded", lambda w: np.ceil(1 / np.sum(w**2))),
    ("ess-perplexity", _entropy),
    ("ess-rooted", lambda w: 1 / np.sqrt(np.sum(w**2))),
    ("ess-rooted", lambda w: np.sqrt(np.sum(w**2))),
    ("weights-squared", lambda w: 1 / np.sum(w**4)),
    ("weights-squared", lambda w: 1 / np.sum(w**2) ** 2),
    ("ess-ratio", lambda w: 1 / (len(w) * np.sum(w**2))),
    ("ess-inverse", lambda w: len(w) * np.sum(w**2)),
    ("ess-times-p", lambda w: len(w) / np.sum(w**2)),
    ("ess-variance", lambda w: len(w) / (1 + np.var(w))),
    ("ess-variance", lambda w: len(w) / (1 + np.var(w, ddof=1))),
    ("ess-variance", lambda w: len(w) / (1 + np.var(len(w) * w, ddof=1))),
    ("ess-variance", lambda w: len(w) / (1 + np.std(w))),
    ("ess-variance", lambda w: len(w) / (1 + np.std(len(w) * w))),
    ("ess-variance", lambda w: 1 / np.var(w)),
    ("ess-complement", lambda w: 1 - np.sum(w**2)),
    ("ess-entropy", lambda w: float(np.log(_entropy(w)))),
    ("ess-logarithm", lambda w: -np.log(np.sum(w**2))),
    ("ess-logarithm", lambda w: np.log(np.sum(w**2))),
    ("ess-term-by-term", lambda w: np.sum(1 / w**2)),
    ("weights-cubed", lambda w: 1 / np.sum(w**3)),
    ("ess-count", lambda w: float(np.sum(w > 1 / len(w)))),
]
ancestors: Mutants = [*CHOOSE]


def _closures(closes: Function, gain: Function | None = None, offset: int = 0, k_offset: int = 0) -> Function:
    def loop_closures(z: Array, covs: Array) -> tuple[Any, Array]:
        seen = ~np.isnan(z[:, ::2])
        found = [(k, m) for k in range(1, len(z)) for m in range(seen.shape[1]) if closes(seen, k, m)]
        closures = np.array(found, dtype=int).reshape(-1, 2)
        gains = (gain or _gain)(covs, closures[:, 0])
        return closures + np.array([k_offset, offset]), gains

    return loop_closures


def _closes(seen: Any, k: int, m: int) -> bool:
    return bool(seen[k, m] and not seen[k - 1, m] and seen[:k, m].any())


def _traces(covs: Array, first: int = 2) -> Array:
    variances = np.diagonal(covs, axis1=1, axis2=2)[:, first:]
    last = variances.shape[1] // 2 * 2
    return np.asarray(variances[:, 0:last:2] + variances[:, 1:last:2])


def _gain(covs: Array, k: Any) -> Array:
    traces = _traces(covs)
    return np.asarray(1 - traces[k] / traces[k - 1])


def _determinants(covs: Array) -> Array:
    M = covs.shape[1] // 2 - 1
    return np.stack([np.linalg.det(covs[:, 2 + 2 * m : 4 + 2 * m, 2 + 2 * m : 4 + 2 * m]) for m in range(M)], axis=1)


def _ratio(values: Function, form: Function) -> Function:
    return lambda covs, k: form(values(covs), k)


def _one_minus(values: Array, k: Any) -> Array:
    return np.asarray(1 - values[k] / values[k - 1])


closures: Mutants = [
    ("first-sighting", _closures(lambda seen, k, m: seen[k, m] and not seen[k - 1, m])),
    ("every-sighting", _closures(lambda seen, k, m: seen[k, m] and seen[:k, m].any())),
    ("every-sighting", _closures(lambda seen, k, m: seen[k, m])),
    ("first-sighting", _closures(lambda seen, k, m: seen[k, m] and not seen[:k, m].any())),
    ("index-from-one", _closures(_closes, offset=1)),
    ("index-from-one", _closures(_closes, k_offset=-1)),
    ("index-from-one", _closures(_closes, k_offset=1)),
    ("index-from-one", _closures(_closes, k_offset=1, offset=1)),
    ("gain-from-start", _closures(_closes, lambda covs, k: 1 - _traces(covs)[k] / _traces(covs)[0])),
    ("gain-of-deviation", _closures(_closes, _ratio(lambda c: np.sqrt(_traces(c)), _one_minus))),
    ("gain-flipped", _closures(_closes, _ratio(_traces, lambda t, k: t[k] / t[k - 1]))),
    ("gain-flipped", _closures(_closes, _ratio(_traces, lambda t, k: t[k - 1] / t[k]))),
    ("gain-sign", _closures(_closes, _ratio(_traces, lambda t, k: t[k] / t[k - 1] - 1))),
    ("gain-of-the-rest", _closures(_closes, _ratio(_traces, lambda t, k: 1 - t[k - 1] / t[k]))),
    ("gain-of-the-rest", _closures(_closes, _ratio(_traces, lambda t, k: t[k - 1] / t[k] - 1))),
    ("gain-absolute", _closures(_closes, _ratio(_traces, lambda t, k: t[k - 1] - t[k]))),
    ("gain-absolute", _closures(_closes, _ratio(_traces, lambda t, k: t[k] - t[k - 1]))),
    ("gain-percent", _closures(_closes, lambda covs, k: 100 * _gain(covs, k))),
    ("robot-offset", _closures(_closes, _ratio(lambda c: _traces(c, 0)[:, :-1], _one_minus))),
    ("gain-of-determinant", _closures(_closes, _ratio(_determinants, _one_minus))),
    ("gain-of-determinant", _closures(_closes, _ratio(lambda c: np.sqrt(_determinants(c)), _one_minus))),
    ("gain-of-part", _closures(_closes, _ratio(lambda c: np.diagonal(c, axis1=1, axis2=2)[:, 2::2], _one_minus))),
    ("gain-of-part", _closures(_closes, _ratio(lambda c: np.diagonal(c, axis1=1, axis2=2)[:, 3::2], _one_minus))),
    ("gain-of-whole", _closures(_closes, lambda covs, k: _repeated(np.trace(covs, axis1=1, axis2=2), covs, k))),
    ("gain-of-whole", _closures(_closes, lambda covs, k: _repeated(_traces(covs).sum(axis=1), covs, k))),
    ("closure-at-loss", _closures(lambda seen, k, m: seen[k - 1, m] and not seen[k, m])),
    ("first-closure-only", _closures(lambda seen, k, m: _closes(seen, k, m) and not _closed(seen, k, m))),
    ("last-instant-missed", _closures(lambda seen, k, m: _closes(seen, k, m) and k < len(seen) - 1)),
    ("columns-exchanged", lambda z, covs: _reordered(z, covs, lambda c, g: (c[:, ::-1], g))),
    ("order-of-rows", lambda z, covs: _reordered(z, covs, _by_landmark)),
    ("gain-of-one-landmark", lambda z, covs: _reordered(z, covs, _of_the_one_seen)),
    ("gain-since-last-seen", lambda z, covs: _since_seen(z, covs)),
    (
        "gain-late",
        _closures(_closes, lambda covs, k: 1 - _traces(covs)[np.minimum(k + 1, len(covs) - 1)] / _traces(covs)[k]),
    ),
]


def _repeated(values: Array, covs: Array, k: Any) -> Array:
    gains = 1 - values[k] / values[k - 1]
    return np.repeat(gains[:, np.newaxis], _traces(covs).shape[1], axis=1)


def _closed(seen: Any, k: int, m: int) -> bool:
    return any(_closes(seen, earlier, m) for earlier in range(1, k))


def _reordered(z: Array, covs: Array, change: Function) -> Any:
    return change(*_closures(_closes)(z, covs))


def _by_landmark(closures: Any, gains: Array) -> Any:
    order = np.lexsort((closures[:, 0], closures[:, 1]))
    return closures[order], gains[order]


def _of_the_one_seen(closures: Any, gains: Array) -> Any:
    own = gains[np.arange(len(gains)), closures[:, 1]]
    return closures, np.repeat(own[:, np.newaxis], gains.shape[1], axis=1)


def _since_seen(z: Array, covs: Array) -> Any:
    closures, _ = _closures(_closes)(z, covs)
    seen, traces = ~np.isnan(z[:, ::2]), _traces(covs)
    last = [np.flatnonzero(seen[:k, m])[-1] for k, m in closures]
    return closures, 1 - traces[closures[:, 0]] / traces[np.array(last, dtype=int)]


def _gap(scale: Function, mean: Function = lambda ratios: np.sqrt(np.mean(ratios**2)), first: int = 1) -> Function:
    def mean_gap(filtered: Any, exact: Any) -> float:
        with np.errstate(all="ignore"):
            return float(mean((filtered.means - exact.means)[first:] / scale(filtered, exact)[first:]))

    return mean_gap


def _stds(filtered: Any, exact: Any) -> Array:
    return np.asarray(exact.stds)


gaps: Mutants = [
    ("k0-counted", _gap(_stds, first=0)),
    ("k0-counted", _gap(_stds, lambda r: np.sqrt(np.nanmean(r**2)), first=0)),
    ("k0-counted", _gap(_stds, lambda r: np.sqrt(np.nansum(r**2) / r.size), first=0)),
    ("gap-in-metres", _gap(lambda f, e: np.ones(e.means.shape))),
    ("gap-by-variance", _gap(lambda f, e: e.stds**2)),
    ("gap-own-deviation", _gap(lambda f, e: f.stds)),
    ("gap-absolute", _gap(_stds, lambda r: np.mean(np.abs(r)))),
    ("gap-not-rooted", _gap(_stds, lambda r: np.mean(r**2))),
    ("gap-signed", _gap(_stds, np.mean)),
    ("gap-signed", _gap(_stds, lambda r: abs(np.mean(r)))),
    ("gap-summed", _gap(_stds, lambda r: np.sqrt(np.sum(r**2)))),
    ("gap-summed", _gap(_stds, lambda r: np.sqrt(np.mean(np.sum(r**2, axis=1))))),
    ("gap-summed", _gap(_stds, lambda r: np.sum(r**2))),
    ("gap-summed", _gap(_stds, lambda r: np.sum(np.abs(r)))),
    ("gap-centred", _gap(_stds, lambda r: np.std(r))),
    ("gap-centred", _gap(_stds, lambda r: np.std(r, ddof=1))),
    ("gap-root-inside", _gap(_stds, lambda r: np.mean(np.sqrt(np.mean(r**2, axis=1))))),
    ("gap-root-inside", _gap(_stds, lambda r: np.mean(np.sqrt(np.sum(r**2, axis=1))))),
    ("gap-root-inside", _gap(_stds, lambda r: np.mean(np.sqrt(np.mean(r**2, axis=0))))),
    ("gap-root-inside", _gap(_stds, lambda r: np.mean(np.sqrt(np.sum(r**2, axis=0))))),
    ("gap-absolute", _gap(_stds, lambda r: np.median(np.abs(r)))),
    ("gap-maximum", _gap(_stds, lambda r: np.max(np.abs(r)))),
    ("gap-one-instant", _gap(_stds, lambda r: np.sqrt(np.mean(r[-1] ** 2)))),
    ("k0-counted", _gap(_stds, lambda r: np.sqrt(np.sum(r**2) / (len(r) + 1) / r.shape[1]))),
    ("k0-counted", _gap(_stds, lambda r: np.sqrt(np.mean(r[1:] ** 2)))),
    ("last-instant-missed", _gap(_stds, lambda r: np.sqrt(np.mean(r[:-1] ** 2)))),
    ("gap-ratio-of-means", _gap(lambda f, e: np.full(e.means.shape, np.sqrt(np.mean(e.stds[1:] ** 2))))),
    ("gap-relative", _gap(lambda f, e: np.abs(e.means))),
    ("gap-whole-covariance", lambda f, e: _mahalanobis(f, e, 1)),
    ("gap-whole-covariance", lambda f, e: _mahalanobis(f, e, e.means.shape[1])),
    ("gap-in-metres", _gap(lambda f, e: np.full(e.means.shape, e.stds[1:].mean()))),
    ("gap-of-part", _gap(_stds, lambda r: np.sqrt(np.mean(r[:, :2] ** 2)))),
    ("gap-of-part", _gap(_stds, lambda r: np.sqrt(np.mean(r[:, 2:] ** 2)))),
]


def _mahalanobis(filtered: Any, exact: Any, divisor: int) -> float:
    gaps = (filtered.means - exact.means)[1:]
    squares = np.einsum("ki,kij,kj->k", gaps, np.linalg.pinv(exact.covs[1:], hermitian=True), gaps)
    return float(np.sqrt(np.mean(squares) / divisor))
