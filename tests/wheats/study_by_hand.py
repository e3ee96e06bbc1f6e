"""The study with spawned seeds, sizes outermost, population deviation."""

import numpy as np

from lab.solvers import kalman


def study(problem, solver, sizes, runs, seed):
    exact = kalman(problem)
    rows = []
    for size, stream in zip(sizes, np.random.SeedSequence(seed).spawn(len(sizes)), strict=True):
        gaps = []
        for child in stream.spawn(runs):
            answer = solver(problem, np.random.default_rng(child), n_particles=int(size))
            ratio = (answer.means[1:] - exact.means[1:]) / np.sqrt(np.diagonal(exact.covs[1:], axis1=1, axis2=2))
            gaps.append(np.linalg.norm(ratio) / np.sqrt(ratio.size))
        rows.append((size, np.mean(gaps), np.std(gaps) / len(gaps) ** 0.5))
    return rows
