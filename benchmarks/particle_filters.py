"""Our particle filters with numpy and compiled: time per particle-step for several N and M, and their ratio.

Every run computes mean and full covariance at every one of 49 steps, on the handout's scenario with M landmarks on a
circle; both backends take turns, and medians of CPU time in one thread are shown.  See README.md here.
"""

import sys
import time
from dataclasses import replace
from functools import partial

import numpy as np
from threadpoolctl import threadpool_limits

from data_simulation import HANDOUT, data_simulation
from lab.problem import Experiment, Problem
from lab.solvers import guided, rbpf, sir, sis

SIZES = (100, 1000, 10_000, 100_000)
LANDMARKS = (5, 20)
WORK = 400_000  # particles in all repetitions of one cell, about
FILTERS = {
    "sis": sis,
    "sir": sir,
    "guided": guided,
    "rbpf": rbpf,
    "rbpf prior": partial(rbpf, proposal="prior"),
}


def world(n_landmarks: int) -> Problem:
    """Return the handout's experiment with this many landmarks."""
    angles = 2 * np.pi * np.arange(n_landmarks) / n_landmarks
    means = np.stack([4 * np.cos(angles) - 1.5, 4 * np.sin(angles)], axis=1)
    scenario = HANDOUT if n_landmarks == 5 else replace(HANDOUT, landmark_means=means)
    return Experiment.from_simulation(data_simulation(scenario=scenario, rng=0)).problem


def main() -> None:
    """Print the table."""
    print(f"{'M':>3} {'filter':<11}{'N':>8}{'numpy':>10}{'numba':>10}{'numpy/numba':>13}   [ns per particle-step]")
    for n_landmarks in LANDMARKS:
        problem = world(n_landmarks)
        steps = problem.n_instants - 1
        for name, solver in FILTERS.items():
            for size in SIZES:
                repetitions = int(np.clip(WORK // size, 5, 25))
                times: dict[str, list[float]] = {"numpy": [], "numba": []}
                for i in range(repetitions + 1):
                    for backend, each in times.items():
                        start = time.thread_time()
                        solver(problem, np.random.default_rng(i), n_particles=size, backend=backend)
                        each.append((time.thread_time() - start) / (size * steps))
                numpy, numba = (1e9 * float(np.median(each[1:])) for each in times.values())  # the first compiles
                row = f"{n_landmarks:>3} {name:<11}{size:>8}{numpy:>10.1f}{numba:>10.1f}{numpy / numba:>13.1f}"
                print(row, flush=True)


if __name__ == "__main__":
    with threadpool_limits(limits=1):
        sys.exit(main())
