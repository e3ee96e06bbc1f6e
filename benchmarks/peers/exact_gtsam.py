"""GTSAM: the linear factor graph of path and map, eliminated, with the marginal of every variable.

Building the graph, a loop of Python over factors, is not timed.
"""

import sys

import gtsam
import numpy as np
from worker import serve

data, answer = sys.argv[1:]
with np.load(data) as file:
    given = dict(file)
N, M = int(given["n_instants"]), len(given["landmark_means"])
UNIT = gtsam.noiseModel.Unit.Create(2)


def prepare():  # noqa: D103
    graph = gtsam.GaussianFactorGraph()

    def add(cov, value, *pairs):
        root = np.linalg.inv(np.linalg.cholesky(cov))  # its noise models of linear factors are diagonal
        blocks = [part for key, block in pairs for part in (key, root @ block)]
        graph.add(*blocks, root @ value, UNIT)

    one = np.eye(2)
    add(given["robot_cov"], given["robot_mean"], (0, one))
    for k in range(1, N):
        add(given["Q"], given["B"], (k, one), (k - 1, -given["F"]))
    for j in range(M):
        add(given["landmark_covs"][j], given["landmark_means"][j], (N + j, one))
    for k, j, z, R in zip(given["instants"].tolist(), given["landmarks"].tolist(), given["z"], given["R"], strict=True):
        add(R, z, (k, -one), (N + j, one))
    return graph


def act(graph):  # noqa: D103
    tree = graph.eliminateMultifrontal()
    solution = tree.optimize()
    mean = np.array([solution.at(i) for i in range(N + M)])
    variances = np.array([np.diag(tree.marginalCovariance(i)) for i in range(N + M)])
    return {"mean": mean, "variances": variances}


serve(prepare, act, answer)
