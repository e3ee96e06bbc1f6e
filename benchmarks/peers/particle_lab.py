"""Our own filters: sir or rbpf, on the path that the last argument names (where this version offers a choice)."""

import inspect

import cloud
import numpy as np
from worker import serve

from lab import solvers
from lab.problem import LinearGaussianModel, Problem

given = cloud.load()
solver, backend = given.rest
problem = Problem(LinearGaussianModel(given.F, given.B, given.Q, given.m0, given.P0), given.z, given.H, given.R)
solve = getattr(solvers, solver)
options = {"backend": backend} if "backend" in inspect.signature(solve).parameters else {}
if backend != "numpy" and not options:
    raise SystemExit(f"this version has no backend {backend!r}")


def act(rng):  # noqa: D103
    filtered = solve(problem, rng, n_particles=given.P, **options)
    return {"means": filtered.means, "covs": filtered.covs}


generator = np.random.default_rng(0)
serve(lambda: generator, act, given.answer)
