"""Solà's symbols: P covariance, z innovation, Z its covariance; and whether they mean what they say.

Question answered: do the covariances of many runs mean what they say?

    NEES   mean over runs at each step, beside the band of chi2(3 runs) / runs      needs the truth
    NIS    per degree of freedom, beside the band of chi2                           needs none, and is not enough:
           it stays at 1 while NEES is far outside, since all measurements share the map's error
    gauge  with no absolute information the heading's deviation may never fall below what it was when the first
           landmark was mapped; a filter whose does has seen its own frame turn

Source: Bar-Shalom, Li and Kirubarajan (2001), section 5.4; Huang, Mourikis and Roumeliotis (2010) for the gauge.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lab.ekfslam.demo import Run
from lab.ekfslam.sensor import Sensor, observe
from lab.gaussian import chi2_band
from lab.validation import Array

POSE = 3  # degrees of freedom
ROUNDING = 1e-9  # relative


@dataclass(frozen=True, eq=False)
class Consistency:
    """How consistent runs of one filter are.

    Attributes
    ----------
    nees, nis : (N + 1,) array
        Means over the runs at each step, NIS per degree of freedom; NaN where there is none.
    nees_mean : float
        Mean over the last steps.
    nees_band : (float, float)
        95 % band of a correct filter at one step.
    nis_mean : float
        Per degree of freedom, over all steps.
    nis_band : (Array, Array)
        95 % band (N + 1,) of NIS per degree of freedom at each step.
    gauge : float
        Least deviation of the heading after the first landmark was mapped, relative to what it was then; the mean
        over runs of a number that may not be below 1.
    """

    nees: Array
    nis: Array
    nees_mean: float
    nees_band: tuple[float, float]
    nis_mean: float
    nis_band: tuple[Array, Array]
    gauge: float

    def words(self, filter: str) -> list[str]:
        """Return what the figures say, a sentence each."""
        low, high = self.nees_band
        if not np.isfinite(self.nees_mean):
            verdict = "the NEES of the pose is infinite: its covariance is singular."
        elif self.nees_mean > high:
            verdict = (
                f"too sure of itself: NEES {self.nees_mean:.2f}, where a correct filter stays within"
                f" {low:.2f} to {high:.2f}."
            )
        elif self.nees_mean < low:
            verdict = f"too cautious: NEES {self.nees_mean:.2f} is below {low:.2f} to {high:.2f}."
        else:
            verdict = f"consistent: NEES {self.nees_mean:.2f} lies within {low:.2f} to {high:.2f}."
        lines = [f"{filter}: {verdict}"]
        if self.nees_mean > high and abs(self.nis_mean - 1) < 0.1:
            lines.append(
                f"{filter}: NIS per degree of freedom is {self.nis_mean:.2f} all the same: NIS alone hides it."
            )
        if self.gauge < 1 - ROUNDING:
            lines.append(
                f"{filter}: the heading's deviation fell to {self.gauge:.2f} of what it was when the first landmark was"
                " mapped, which nothing that was measured can tell: the filter has seen its own frame turn."
            )
        return lines


def assess(runs: Sequence[Run]) -> Consistency:
    """Return how consistent the runs of one filter are."""
    nees = np.array([run.nees for run in runs])
    nis, dof = (np.array([getattr(run, name) for run in runs]).sum(axis=0) for name in ("nis", "dof"))
    bands = [chi2_band(int(d), 1) if d else (np.nan, np.nan) for d in dof]
    low, high = np.array(bands).T / np.where(dof > 0, dof, 1)
    return Consistency(
        nees=nees.mean(axis=0),
        nis=np.divide(nis, dof, out=np.full(len(nis), np.nan), where=dof > 0),
        nees_mean=float(np.mean([run.nees_mean for run in runs])),
        nees_band=chi2_band(POSE, len(runs)),
        nis_mean=float(nis.sum() / dof.sum()) if dof.any() else float("nan"),
        nis_band=(low, high),
        gauge=float(np.mean([gauge(run.heading_std, run.mapped) for run in runs])),
    )


def nis(x: Array, P: Array, y: Array, i: int, sensor: Sensor) -> float:
    """Return z' Z^-1 z of one measurement, for a filter that keeps its map as one mean and one covariance.

    Parameters
    ----------
    x : (3 + 2 M,) array
        Robot, then landmarks.
    P : (3 + 2 M, 3 + 2 M) array
    y : (p,) array
    i : int
        Which landmark was measured, 0..M-1.
    sensor : Sensor
    """
    rows = np.array([0, 1, 2, 3 + 2 * i, 4 + 2 * i])
    e, Y_r, Y_l = observe(x[:3], x[rows[3:]], sensor)
    H = np.hstack([Y_r, Y_l])
    z = sensor.difference(y, e)
    return float(z @ np.linalg.solve(H @ P[np.ix_(rows, rows)] @ H.T + sensor.R, z))


def gauge(heading_std: Array, mapped: Array) -> float:
    """Return the least deviation of the heading since the first landmark was mapped, relative to that moment's.

    Parameters
    ----------
    heading_std : (N,) array
        [rad].
    mapped : (N,) array of int
        Landmarks in the map; 1 is returned where there is never one.
    """
    if not mapped.any():
        return 1.0
    first = int(np.argmax(mapped > 0))
    return float(np.min(heading_std[first:]) / heading_std[first])
