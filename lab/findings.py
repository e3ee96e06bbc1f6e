"""What went wrong with each filter, and when, in plain words.

Question answered: can these moments be believed?  The effective sample size alone cannot say: after each resampling it
looks healthy while the map descends from one particle.  So the sentences are built on both, and on the gap itself.
Printed under the table of a comparison.  Source: questions 5 and 7 of the handout.
"""

from collections.abc import Callable

import numpy as np

from lab.comparison import Comparison, Record

TOLERABLE_GAP = 0.3  # exact standard deviations: above it the picture of a posterior is visibly another one


def findings(comparison: Comparison) -> list[str]:
    """Return a few sentences per solver, failures included.

    Parameters
    ----------
    comparison : Comparison

    Returns
    -------
    list of str
    """
    return [sentence for solver in comparison.solvers for sentence in _about(comparison, solver)]


def _about(comparison: Comparison, solver: str) -> list[str]:
    sizes = list(dict.fromkeys(r.unit.n_particles for r in comparison.records if r.unit.solver == solver))
    groups = {size: comparison.of(solver, size) for size in sizes}
    groups = {size: records for size, records in groups.items() if records}
    sentences = [_failure(comparison, solver)] if any(r.unit.solver == solver for r in comparison.failures) else []
    if not groups:
        return sentences
    collapsed = _moments_of(groups, lambda record: record.metrics.collapsed_at)
    if collapsed:
        sentences.append(
            f"{solver}: the weights collapse onto one particle (ESS below 2), first at {collapsed}. The moments"
            " then rest on little more than that particle."
        )
    same = _moments_of(groups, lambda record: record.metrics.same_map_at)
    single = _moments_of(groups, lambda record: record.metrics.one_ancestor_at)
    if same:
        sentences.append(
            f"{solver}: the whole map descends from ONE particle of time 0, first at {same}. From then on every"
            f" particle carries the same map{_ess_hides(groups)}."
        )
    elif single:
        sentences.append(
            f"{solver}: all particles descend from ONE particle of time 0, first at {single}{_ess_hides(groups)}. Only"
            " what is drawn or conditioned later tells them apart."
        )
    largest = max(groups)
    gap = float(np.mean([record.metrics.mean_gap for record in groups[largest]]))
    verdict = "not to be trusted" if gap > TOLERABLE_GAP else "close to exact"
    sentences.append(
        f"{solver}: with N = {largest} the mean is on average {gap:.2g} exact standard deviations off: {verdict}."
    )
    return sentences


def _failure(comparison: Comparison, solver: str) -> str:
    failed = [record for record in comparison.failures if record.unit.solver == solver]
    n_all = sum(record.unit.solver == solver for record in comparison.records)
    unit = failed[0].unit
    data_set = f"data set {unit.data_set}, " if len(comparison.problems) > 1 else ""
    return (
        f"{solver}: {len(failed)} of {n_all} runs FAILED and are left out; the first is {data_set}N ="
        f" {unit.n_particles}, run {unit.run}, seed {unit.seed}: {failed[0].error}"
    )


def _moments_of(groups: dict[int, list[Record]], instant: Callable[[Record], float]) -> str:
    """Say for each N at which k something happened (median) and in how many runs; empty when it never did."""
    parts: dict[tuple[str, str], list[int]] = {}
    for size, records in groups.items():
        instants = [instant(record) for record in records]
        happened = [k for k in instants if not np.isnan(k)]
        if happened:
            share = "" if len(happened) == len(records) else f" in {len(happened)} of {len(records)} runs"
            parts.setdefault((f"k = {np.median(happened):.0f}", share), []).append(size)
    return ", ".join(f"{k} with N = {_listed(sizes)}{share}" for (k, share), sizes in parts.items())


def _listed(sizes: list[int]) -> str:
    *others, last = map(str, sizes)
    return f"{', '.join(others)} and {last}" if others else last


def _ess_hides(groups: dict[int, list[Record]]) -> str:
    """Quote the ESS after the map is gone, where it looks healthy."""
    ratios = [
        record.ess[int(record.metrics.one_ancestor_at) :] / record.unit.n_particles
        for records in groups.values()
        for record in records
        if record.ess is not None and record.ess.min() >= 2 and not np.isnan(record.metrics.one_ancestor_at)
    ]
    if not ratios:
        return ""
    return f", which the ESS hides: its median is then {np.median(np.concatenate(ratios)):.0%} of N"
