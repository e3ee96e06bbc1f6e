"""Titles of a comparison's figures, and what is to be seen in them, with numbers, for those who cannot see them."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pandas as pd

from lab import theory
from lab.comparison import Comparison
from lab.plots.loop_closure import NO_SPREAD, deviations, kept, loop_closure
from lab.plots.style import record_in_words, runs_in_words
from lab.result import Filtered
from lab.validation import Array


class Picture(NamedTuple):
    """A figure that is written: its file, what it is, and what is to be seen in it."""

    file: str
    title: str
    alt: str


def gap(comparison: Comparison, file: str) -> Picture:
    """Describe the gaps against N."""
    summary = comparison.summary()
    sizes = sorted(set(summary["n_particles"]))
    words = [
        f"Two log-log panels against N, the number of particles, {_of_sizes(sizes)}.",
        f"Gap of the mean in exact standard deviations: {_each(summary, lambda rows: _course(rows, 'mean_gap'))}.",
        f"Relative gap of the covariance: {_each(summary, lambda rows: _course(rows, 'cov_gap'))}.",
        "A line of slope -1/2 is what Monte-Carlo noise alone would follow." if len(sizes) > 1 else "",
        _prediction(comparison, sizes),
    ]
    return Picture(file, f"Gap to the exact moments against N: {_means(comparison)}", _joined(words))


def ess(comparison: Comparison, file: str) -> Picture:
    """Describe the health of the clouds."""
    last = _largest(comparison)
    words = [
        "For each filter the effective sample size over time, above, and the ancestors of time 0 still alive, below.",
        f"With {_n(last)} the smallest ESS/N is on average {_each(last, lambda rows: _number(rows, 'ess_min'))};",
        f"at the end there are left {_each(last, lambda rows: _number(rows, 'ancestors_left'))} ancestors.",
    ]
    if comparison.forecasts:
        worst = {label: 10 ** np.median(values, axis=0).min() for label, values in comparison.forecasts.items()}
        words.append(
            "A dashed line is the forecast made before a particle is drawn; its smallest ESS/N:"
            f" {', '.join(f'{label} {ratio:.2g}' for label, ratio in worst.items())}."
        )
    spread = runs_in_words(comparison)
    title = "Health of the cloud over time: effective sample size with its forecast, and living ancestors"
    return Picture(file, f"{title}, {spread if spread == 'one run' else f'medians over {spread}'}", _joined(words))


def evidence(comparison: Comparison, file: str) -> Picture:
    """Describe the errors of the log-evidence."""
    last = _largest(comparison)
    medians = comparison.runs.groupby(["solver", "n_particles"])["log_evidence_gap"].median().rename("median")
    last = last.join(medians, on=["solver", "n_particles"])
    words = [
        "Box plots of estimated minus exact log-evidence, filters side by side, groups by number of particles.",
        f"With {_n(last)} the median is {_each(last, lambda rows: _number(rows, 'median'))} nats; exact is 0.",
    ]
    return Picture(file, f"Error of the log-evidence: {runs_in_words(comparison)}", _joined(words))


def cost(comparison: Comparison, file: str) -> Picture:
    """Describe the gap against seconds."""
    last = _largest(comparison)
    runs = comparison.runs[comparison.runs["error"] == ""]
    medians = runs.groupby(["solver", "n_particles"])["seconds"].median().rename("median_seconds")
    last = last.join(medians, on=["solver", "n_particles"])

    def price(rows: pd.DataFrame) -> str:
        return f"{_number(rows, 'mean_gap')} in {_number(rows, 'median_seconds')} s"

    good = last[last["mean_gap"].notna()]
    words = [
        "Log-log panel of the gap of the mean in exact standard deviations against the seconds of a run.",
        f"With {_n(last)}: {_each(last, price)}.",
        f"The smallest gap there is that of {good.loc[good['mean_gap'].idxmin(), 'solver']}." if len(good) else "",
    ]
    spread = f"{_means(comparison)}; seconds are medians"
    return Picture(file, f"Which filter buys most accuracy per second: {spread}", _joined(words))


def closure(comparison: Comparison, solver: str, file: str) -> Picture:
    """Describe what closing a loop does to the landmarks."""
    exact, record = comparison.exacts[0], kept(comparison, solver)
    found = loop_closure(comparison.problems[0], exact)
    title = f"Loop closure: {record_in_words(comparison, record) if record else solver}"
    if found is None:
        return Picture(file, title, "No landmark comes back into view after being out of sight: no loop is closed.")

    def fall(landmark: int) -> str:
        before, after = deviations(exact)[found.k - 1 : found.k + 1, landmark]
        words = f"exactly from {before:.3g} to {after:.3g} m"
        if record and record.filtered:
            spread = deviations(record.filtered)[found.k - 1 : found.k + 1, landmark]
            before, after = np.where(spread > NO_SPREAD * before, spread, 0)
            words += f", by estimate from {before:.3g} to {after:.3g} m"
        return words

    others = np.where(found.in_view, -np.inf, found.sharpening)
    most = int(others.argmax())
    words = [
        f"At k = {found.k} landmark {found.landmark + 1} is seen again; its standard deviation goes"
        f" {fall(found.landmark)}.",
        f"Of those out of view landmark {most + 1} sharpens most, {fall(most)}." if np.isfinite(others[most]) else "",
        "Above: deviations, and correlations with the landmark seen again, over time; below: before and after.",
    ]
    return Picture(file, title, _joined(words))


def corridors(filtered: Filtered | None, exact: Filtered, truth: Array | None, label: str, file: str) -> Picture:
    """Describe the corridors of all components."""
    words = [f"Corridors of three standard deviations over time, a panel for each component: {label}."]
    later, stds = exact.uncertain[1:], exact.stds[1:]
    for what, values in (
        ("The estimated mean", None if filtered is None else filtered.means),
        ("The truth", truth),
    ):
        if values is not None and later.any():
            inside = np.abs(values - exact.means)[1:][later] <= 3 * stds[later]
            words.append(f"{what} lies inside the exact corridor at {100 * inside.mean():.3g} % of the points.")
    return Picture(file, f"Corridors of three standard deviations: {label}", _joined(words))


def final_map(filtered: Filtered | None, exact: Filtered, label: str, file: str) -> Picture:
    """Describe the map at the last instant."""
    words = [f"Map at k = {len(exact.means) - 1} with 99 % ellipses: {label}."]
    if filtered is not None:
        apart = np.linalg.norm((filtered.means - exact.means)[-1, 2:].reshape(-1, 2), axis=1)
        words.append(
            f"The landmarks' estimated means are {apart.min():.2g} to {apart.max():.2g} m from the exact ones."
        )
    return Picture(file, f"Map at the last instant: {label}", _joined(words))


def _means(comparison: Comparison) -> str:
    words = runs_in_words(comparison)
    return words if words == "one run" else f"means over {words}, with standard errors"


def _prediction(comparison: Comparison, sizes: list[int]) -> str:
    """Say where the error predicted of the bootstrap filter is drawn."""
    if not any(name == "prior" and share > 0 for name, share in comparison.designs.values()):
        return ""
    gaps, needed = theory.predicted_gap(comparison.bootstrap_log_variances, np.array(sizes, float))
    if np.isnan(gaps[-1]):
        return (
            "The error of a bootstrap filter with multinomial resampling at every step is predicted only from"
            f" N = 10^{needed:.1f} on."
        )
    return (
        "A dotted line is the error predicted of a bootstrap filter with multinomial resampling at every step:"
        f" {gaps[-1]:.3g} with N = {sizes[-1]}."
    )


def _largest(comparison: Comparison) -> pd.DataFrame:
    """Return the rows of the summary with the largest N."""
    summary = comparison.summary()
    return summary[summary["n_particles"] == summary["n_particles"].max()]


def _n(rows: pd.DataFrame) -> str:
    return f"N = {rows['n_particles'].max()}"


def _of_sizes(sizes: list[int]) -> str:
    return f"{sizes[0]} to {sizes[-1]}" if len(sizes) > 1 else str(sizes[0])


def _each(summary: pd.DataFrame, said: Callable[[pd.DataFrame], str]) -> str:
    return ", ".join(f"{solver} {said(rows)}" for solver, rows in summary.groupby("solver", sort=False))


def _course(rows: pd.DataFrame, name: str) -> str:
    """Say from where to where a number goes as N grows."""
    rows = rows.sort_values("n_particles")
    first, last = _number(rows.head(1), name), _number(rows.tail(1), name)
    return first if len(rows) == 1 else f"{first} to {last}"


def _number(rows: pd.DataFrame, name: str) -> str:
    value = rows[name].iloc[0]
    return "not known" if pd.isna(value) else f"{float(f'{value:.3g}'):g}"


def _joined(words: list[str]) -> str:
    return " ".join(filter(None, words))
