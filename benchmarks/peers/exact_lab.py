"""Our exact filter in its structured form, our elimination of the landmarks, our smoother with whole matrices."""

import sys

import numpy as np
from worker import peak_megabytes, serve

from lab.solvers import smooth_map, smoother
from lab.solvers.structured import MapFilter
from lab.sparse import SparseProblem

data, answer, what = sys.argv[1:]
with np.load(data) as file:
    given = dict(file)
names = ("F", "B", "Q", "robot_mean", "robot_cov", "landmark_means", "landmark_covs", "landmark_noise")
names += ("n_instants", "instants", "landmarks", "z", "R")
problem = SparseProblem(**{name: given[name] if given[name].ndim else int(given[name]) for name in names})
start = int(given["start"])  # the instants up to it are not timed: they bring every landmark into the map


def walk():
    """Return the structured filter at the start of what is timed."""
    state = MapFilter(problem)
    for k in range(1, start + 1):
        state.predict()
        state.update(k)
    return state


def filter_structured(state):
    """Take the steps that are timed, and again until there are enough to settle several times."""
    passes = -(-64 // (problem.n_instants - 1 - start))
    for once in range(passes):
        for k in range(start + 1, problem.n_instants):
            state.predict()
            state.update(k)
        if not once:
            found = {"mean": state.mean, "variances": np.diagonal(state.blocks(), axis1=1, axis2=2).ravel()}
    state.settle()
    return {**found, "passes": np.array(passes)}


def eliminate(state):
    """Return the moments of all poses, then of all landmarks."""
    found = smooth_map(problem)
    covs = np.concatenate([found.path_covs, found.landmark_covs])
    return {"mean": np.vstack([found.path, found.landmarks]), "variances": np.diagonal(covs, axis1=1, axis2=2)}


def rauch_tung_striebel(state):
    """Return the same by whole matrices."""
    means, covs, _ = smoother(dense)
    variances = np.diagonal(covs, axis1=1, axis2=2)
    rows = [array.reshape(len(array), -1, 2) for array in (means, variances)]
    mean, variances = (np.vstack([array[:, 0], array[-1, 1:]]) for array in rows)
    return {"mean": mean, "variances": variances}


if what == "structured":
    before = peak_megabytes()
    begin = walk()  # later calls go on from where the first one ended: other numbers, the same work, and no copy
    serve(lambda: begin, filter_structured, answer, before)
elif what == "eliminate":
    serve(lambda: None, eliminate, answer)
else:
    dense = problem.dense()
    serve(lambda: None, rauch_tung_striebel, answer)
