"""The units of a comparison: one run of one solver with one N on one data set, its seed, and with which it is run.

A unit's seed depends on nothing but the comparison's seed, label, N, run and data set; so neither the order of units,
nor the number of workers, nor what else is compared changes a number.  Runs with few particles are computed together,
a batch a call; which batch one is in depends on nothing else either.  Run by `lab.work`; called by `lab.compare`.
"""

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from lab.comparison import Unit
from lab.solvers import Solver
from lab.solvers.together import together
from lab.validation import InputError, whole_number

SEED_BITS = 48  # a seed is written to CSV, and spreadsheets keep 15 digits
TOGETHER = 10  # runs in one call, where that pays
Batch = tuple[Unit, ...]  # of one solver, N and data set


def all_units(
    solvers: Mapping[str, Solver], n_particles: Sequence[int] | int, *, runs: int, seed: int, data_sets: int = 1
) -> list[Unit]:
    """Return all units in the order data set, solver, N, run; an N given twice counts once.

    Raises
    ------
    InputError
        No solver or no N, or a number out of range.
    """
    if isinstance(n_particles, int | np.integer):
        n_particles = [int(n_particles)]
    sizes = list(dict.fromkeys(whole_number("n_particles", size, at_least=1) for size in n_particles))
    if not solvers or not sizes:
        raise InputError("A comparison needs at least one solver and one number of particles.")
    runs = whole_number("runs", runs, at_least=1)
    seed = whole_number("seed", seed, at_least=0)
    return [
        Unit(label, size, run, unit_seed(seed, label, size, run, data_set), data_set)
        for data_set in range(data_sets)
        for label in solvers
        for size in sizes
        for run in range(runs)
    ]


def batches(units: Sequence[Unit], solvers: Mapping[str, Solver]) -> list[Batch]:
    """Return the units in groups to be run together; which group one is in depends on solver, N, data set and run."""
    found: dict[Any, list[Unit]] = {}
    for unit in units:
        several = together(solvers[unit.solver], unit.n_particles) is not None
        key = (unit.data_set, unit.solver, unit.n_particles, unit.run // TOGETHER if several else -1 - unit.run)
        found.setdefault(key, []).append(unit)
    return [tuple(batch) for batch in found.values()]


def unit_seed(seed: int, solver: str, n_particles: int, run: int, data_set: int = 0) -> int:
    """Return the seed of one unit, a function of nothing but these five."""
    label = int.from_bytes(hashlib.sha256(solver.encode()).digest()[:8], "big")
    key = (label, n_particles, run, data_set)
    state = np.random.SeedSequence(seed, spawn_key=key).generate_state(1, np.uint64)[0]
    return int(state) >> (64 - SEED_BITS)


def data_set_seeds(seed: int, n_data_sets: int) -> list[int]:
    """Return a seed for the simulation of each data set: `seed` itself, then others that depend on it and their number.

    Raises
    ------
    InputError
        Negative seed, or no data set.
    """
    whole_number("seed", seed, at_least=0)
    numbers = range(1, whole_number("The number of data sets", n_data_sets, at_least=1))
    states = (np.random.SeedSequence(seed, spawn_key=(i,)).generate_state(1, np.uint64)[0] for i in numbers)
    return [seed, *(int(state) >> (64 - SEED_BITS) for state in states)]
