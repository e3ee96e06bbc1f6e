"""The study by the laboratory's comparison; the gap by einsum; closures by set arithmetic."""

import numpy as np

from lab.compare import compare


def study(problem, solver, sizes, runs, seed):
    summary = compare(problem, {"mine": solver}, n_particles=sizes, runs=runs, seed=seed).summary()
    return summary[["n_particles", "mean_gap", "mean_gap_se"]]


def mean_gap(filtered, exact):
    d = (filtered.means - exact.means)[1:]
    variances = np.einsum("kii->ki", exact.covs)[1:]
    return np.sqrt((d * d / variances).mean())


def loop_closures(z, covs):
    seen = np.isfinite(z).reshape(len(z), -1, 2).all(axis=2)
    ever = np.maximum.accumulate(seen, axis=0)
    new = seen[1:] & ~seen[:-1] & ever[:-1]
    k, m = np.nonzero(new)
    traces = np.einsum("kmimi->km", covs[:, 2:, 2:].reshape(len(z), seen.shape[1], 2, seen.shape[1], 2))
    return np.column_stack([k + 1, m]), (traces[k] - traces[k + 1]) / traces[k]
