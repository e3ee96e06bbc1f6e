"""The limit: what the parts of a particle-step cost, each in the best kernel here, and how near the filters are.

A step draws two normals for each particle, moves and weighs it, takes one exponential, sums mean and covariance, and
resamples when ESS has fallen.  Each part is timed alone, on blocks that stay in the cache; the memory that a step
cannot avoid is timed as a pass over arrays of the size of the cloud.  The sum is the floor of SIR (landmarks once per
ancestor) and of the Rao-Blackwellized filter (a row of its own for every component).  See README.md here.
"""

import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from numba import njit
from threadpoolctl import threadpool_limits

from lab.fast import block, moments, normals, offspring
from lab.problem import Experiment
from lab.solvers import rbpf, sir

N = 100_000
LANES = normals.LANES
BLOCKS = N // LANES
REPETITIONS = 9
WANTED = 2.5  # floors that the compiled SIR may take
WANTED_RBPF = 2.0  # compiled SIRs that the compiled RBPF may take
REFERENCE = Path(__file__).parents[1] / "tests" / "reference" / "experiment_1.mat"


@njit(nogil=True)
def draw(state, out):
    """Draw two normals for each particle."""
    for _ in range(BLOCKS):
        normals.normals(state, out, 2)


@njit(nogil=True)
def weigh(logs, weights, totals):
    """Take one exponential for each particle and sum the weights."""
    for _ in range(BLOCKS):
        block.weights_of(logs, 0, 0.0, weights, totals)


@njit(nogil=True)
def take_moments(rows, centre, weights, weighted, part, second):
    """Sum the moments of some rows."""
    n = len(rows)
    for _ in range(BLOCKS):
        moments.weigh(rows, centre, weights, 0, weighted, 0, n, part)
        moments.products(weighted, rows, centre, 0, n, 0, n, second, centre, 0, 0)  # asking for nothing


@njit(nogil=True)
def take_moments_of_points(x, centre, weights, part, second):
    """Sum the moments of two rows, which need no room."""
    for _ in range(BLOCKS):
        moments.point_in_plane(x, 0, centre, weights, part, second)


@njit(nogil=True)
def stream(x, logs):
    """Read and write a cloud once."""
    for b in range(BLOCKS):
        for i in range(x.shape[1]):
            for lane in range(LANES):
                x[b, i, lane] = 1.0000001 * x[b, i, lane]
        for lane in range(LANES):
            logs[b, lane] = logs[b, lane] - 1e-9


@njit(nogil=True)
def resample(even, weights, tops, state, scratch, ends, points, before, ancestors, places, new, old):
    """Draw ancestors and fetch them."""
    n = BLOCKS * LANES
    for b in range(BLOCKS):
        for lane in range(LANES):
            weights[b, lane] = even[b, lane]
    offspring.resample_systematic(
        offspring.SYSTEMATIC, weights, tops, 0.0, n, state, scratch, ends, points, before, ancestors
    )
    for b in range(BLOCKS):
        block.fetch(new, old, ancestors, b, n, new.shape[1], places)


def parts() -> dict[str, Callable[[], object]]:
    """Return the acts to be timed, those of SIR with 2 rows and those of the RBPF with 12."""
    rng = np.random.default_rng(0)
    state, out = normals.seed(rng), np.empty((2, LANES))
    logs, weights, totals = -rng.random((BLOCKS, LANES)), np.ones((1, LANES)), np.zeros(2)
    n = BLOCKS * LANES
    cloud_weights = (np.exp(logs), np.empty((BLOCKS, LANES)), np.zeros(BLOCKS))
    room = (np.empty((1, LANES)), np.empty(BLOCKS + 1), np.empty(n + 1))
    counts = (np.empty(n + 1, np.int32), np.empty(n + 1, np.int32), np.empty(LANES, np.uint64))
    acts = {"normals": partial(draw, state, out), "exp": partial(weigh, logs, weights, totals)}
    for name, rows in (("SIR", 2), ("RBPF", 12)):
        cloud, other = rng.standard_normal((BLOCKS, rows, LANES)), np.empty((BLOCKS, rows, LANES))
        centre, part, second = np.zeros(rows), np.zeros(rows), np.zeros((rows, rows))
        if rows == 2:  # one pass
            acts[f"moments {name}"] = partial(take_moments_of_points, cloud, centre, weights, part, second)
        else:
            sums = (np.empty((rows, LANES)), part, second)
            acts[f"moments {name}"] = partial(take_moments, cloud[0].copy(), centre, weights, *sums)
        acts[f"memory {name}"] = partial(stream, cloud, logs.copy())
        acts[f"resampling {name}"] = partial(resample, *cloud_weights, state, *room, *counts, other, cloud.reshape(-1))
    return acts


def main() -> int:
    """Print the table and return the status."""
    problem = Experiment.load(REFERENCE).problem
    steps = problem.n_instants - 1
    filters = {"SIR": sir, "RBPF": rbpf}
    runs = {name: partial(solver, problem, n_particles=N, backend="numba") for name, solver in filters.items()}
    shares = {}
    for name, run in runs.items():  # compiles, too
        shares[name] = np.mean(run(np.random.default_rng(0)).ess[:-1] <= N / 2)
    acts = parts()
    for act in acts.values():
        act()
    times: dict[str, list[float]] = {name: [] for name in (*acts, *runs)}
    for i in range(REPETITIONS):  # interleaved: what disturbs one disturbs all
        for name, act in acts.items():
            start = time.thread_time()
            act()
            times[name].append((time.thread_time() - start) / (BLOCKS * LANES))
        for name, run in runs.items():
            start = time.thread_time()
            run(np.random.default_rng(i))
            times[name].append((time.thread_time() - start) / (N * steps))
    cost = {name: 1e9 * float(np.median(each)) for name, each in times.items()}
    print(f"ns per particle-step, one thread, N = {N}, M = {problem.n_landmarks}, medians of {REPETITIONS}")
    floors = {}
    for name in filters:
        resampling = shares[name] * cost[f"resampling {name}"]
        rows = {"normals": cost["normals"], "memory": cost[f"memory {name}"], "exp": cost["exp"]}
        rows |= {"moments": cost[f"moments {name}"], f"resampling, {shares[name]:.0%} of steps": resampling}
        floors[name] = sum(rows.values())
        rows |= {"floor": floors[name], f"{name} compiled": cost[name]}
        print("\n".join(f"  {what:<28}{value:>8.1f}" for what, value in rows.items()))
        print(f"  {name + ' / floor':<28}{cost[name] / floors[name]:>8.2f}\n")
    ratio = cost["RBPF"] / cost["SIR"]
    print(f"RBPF / SIR {ratio:.2f} (wanted: at most {WANTED_RBPF}); SIR / floor wanted: at most {WANTED}")
    return 0 if cost["SIR"] <= WANTED * floors["SIR"] and ratio <= WANTED_RBPF else 1


if __name__ == "__main__":
    with threadpool_limits(limits=1):
        sys.exit(main())
