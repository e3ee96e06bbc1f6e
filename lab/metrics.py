"""How far one run of a filter is from the exact one: every figure that a comparison is made of.

Per run, over k >= 1, against `kalman` on the same measurements and never against the truth, whose error has a floor:

    mean_gap          sqrt of the mean over k and components of ((mean - exact mean) / exact deviation)^2
    cov_gap           mean over k of ||P - P_exact||_F / ||P_exact||_F
    log_evidence_gap  estimated minus exact log p(z_1..z_{N-1})
    ess_min           smallest ESS / N
    collapsed_at      first k with ESS < 2; NaN if never
    one_ancestor_at   first k whose cloud descends from a single particle of time 0; NaN if never
    same_map_at       first k from then on where no landmark has any variance left; NaN if never
    ancestors_left    distinct ancestors of time 0 at the end

Called by `lab.compare`.  Source: question 8 of the handout.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from lab.result import Filtered

SAME = 1e-6  # of the exact deviation: copies of one landmark differ by rounding alone


@dataclass(frozen=True)
class Metrics:
    """How far one run is from the exact filter; the module's docstring defines each. NaN where it does not apply."""

    mean_gap: float = np.nan
    cov_gap: float = np.nan
    log_evidence_gap: float = np.nan
    ess_min: float = np.nan
    collapsed_at: float = np.nan
    one_ancestor_at: float = np.nan
    same_map_at: float = np.nan
    ancestors_left: float = np.nan
    seconds: float = np.nan


def measure(filtered: Filtered, exact: Filtered, n_particles: int, seconds: float) -> Metrics:
    """Return the metrics of one run; components that are known exactly are left out of `mean_gap`."""
    stds, uncertain = exact.stds[1:], exact.uncertain[1:]
    gaps = (filtered.means - exact.means)[1:][uncertain] / stds[uncertain]
    sizes = np.linalg.norm(exact.covs[1:], axis=(1, 2))
    cov_gaps = np.linalg.norm((filtered.covs - exact.covs)[1:], axis=(1, 2))[sizes > 0] / sizes[sizes > 0]
    ess, survivors = filtered.ess, filtered.survivors
    return Metrics(
        mean_gap=float(np.sqrt(np.mean(gaps**2))) if len(gaps) else 0.0,
        cov_gap=float(np.mean(cov_gaps)) if len(cov_gaps) else 0.0,
        log_evidence_gap=float(filtered.log_evidence[-1] - exact.log_evidence[-1]),
        ess_min=np.nan if ess is None else float(np.min(ess) / n_particles),
        collapsed_at=np.nan if ess is None else _first(ess < 2),
        one_ancestor_at=np.nan if survivors is None else _first(survivors == 1),
        same_map_at=np.nan if survivors is None else _first((survivors == 1) & _one_map(filtered, exact)),
        ancestors_left=np.nan if survivors is None else float(survivors[-1]),
        seconds=seconds,
    )


def _one_map(filtered: Filtered, exact: Filtered) -> Any:
    """Return at which instants (N,) all landmarks are points to rounding, though not in the exact posterior."""
    return (filtered.stds <= SAME * exact.stds)[:, 2:].all(axis=1) & exact.uncertain[:, 2:].any(axis=1)


def _first(condition: Any) -> float:
    return float(np.argmax(condition)) if condition.any() else np.nan
