"""One bootstrap filter in nine libraries and forms, on the same data: seconds, after each answer was checked.

    python benchmarks/environments.py
    python benchmarks/particle_peers.py [--particles 100000] [--rounds 5] [--out FOLDER]

Every peer runs the bootstrap filter of the handout (50 instants, 5 landmarks, n = 12), resamples systematically at
ESS <= N / 2, and gives mean and full covariance at every instant.  Before it is timed it filters other data, on which
measurements are ten times less precise and the filter works: there its distance from the exact filter must be that of
our own sir over several seeds.  Writes particle_peers.csv and .md; see README.md here.
"""

import argparse
import csv
import sys
import tempfile
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from exact_filters import processor
from interleave import OWN, Measured, Peer, measure

from data_simulation import HANDOUT, data_simulation
from lab.problem import Experiment, Problem
from lab.result import Filtered
from lab.solvers import kalman, sir

CAP = 600.0  # seconds for one call
SEEDS = 8  # of our own filter, from which a peer's distance may differ
WIDTH = 5.0  # standard deviations
COLUMNS = (
    "peer",
    "particles",
    "seconds",
    "ns_per_particle_step",
    "times_ours",
    "first_call",
    "peak_mb",
    "gap",
    "reason",
)


def peers(n_particles: int) -> list[Peer]:
    """Return who takes part, ours first."""
    P = str(n_particles)
    jax = ("particle_jax.py", (P, "blackjax")), ("particle_jax.py", (P, "cuthbert"))
    return [
        Peer("sir, numpy (ours)", OWN, "particle_lab.py", (P, "sir", "numpy")),
        Peer("sir, numba (ours)", OWN, "particle_lab.py", (P, "sir", "numba")),
        Peer("rbpf, numpy (ours)", OWN, "particle_lab.py", (P, "rbpf", "numpy")),
        Peer("rbpf, numba (ours)", OWN, "particle_lab.py", (P, "rbpf", "numba")),
        Peer("particles, tailored", "particles", "particle_particles.py", (P, "tailored")),
        Peer("particles, MvNormal", "particles", "particle_particles.py", (P, "mvnormal")),
        Peer("student's numpy", OWN, "particle_numpy.py", (P, "numpy")),
        Peer("FilterPy resampling", "filterpy", "particle_numpy.py", (P, "filterpy")),
        Peer("pfilter", "pfilter", "particle_pfilter.py", (P,)),
        Peer("Stone Soup", "stonesoup", "particle_stonesoup.py", (P,)),
        Peer("JAX scan, blackjax", "blackjax", *jax[0]),
        Peer("cuthbert", "cuthbert", *jax[1]),
    ]


def write_data(path: Path, problem: Problem) -> None:
    """Write what the workers read."""
    model = problem.model
    fields = {name: getattr(model, name) for name in ("F", "B", "m0", "P0")}
    np.savez(path, **fields, Q=model.noise_cov, z=problem.z, H=problem.H, R=problem.R)


def gap(means: np.ndarray, covs: np.ndarray, exact: Filtered) -> np.ndarray:
    """Return the distances of mean [exact deviations] and covariance [relative] from the exact filter."""
    sure = exact.stds[1:] > 0
    of_means = ((means - exact.means)[1:][sure] / exact.stds[1:][sure]) ** 2
    of_covs = np.linalg.norm((covs - exact.covs)[1:], axis=(1, 2)) / np.linalg.norm(exact.covs[1:], axis=(1, 2))
    return np.array([np.sqrt(of_means.mean()), of_covs.mean()])


def check(found: dict[str, Measured], problem: Problem, n_particles: int) -> dict[str, str]:
    """Return, for each peer whose answer is not that of a bootstrap filter, how far off it is."""
    exact = kalman(problem)
    runs = (sir(problem, np.random.default_rng(seed), n_particles=n_particles) for seed in range(SEEDS))
    own = np.array([gap(run.means, run.covs, exact) for run in runs])
    most = own.mean(axis=0) + WIDTH * own.std(axis=0, ddof=1)
    wrong = {}
    for name, measured in found.items():
        if measured.answer:
            distance = gap(measured.answer["means"], measured.answer["covs"], exact)
            if not (distance <= most).all():
                wrong[name] = f"wrong: gaps {distance[0]:.2g}, {distance[1]:.2g}, of ours {most[0]:.2g}, {most[1]:.2g}"
    return wrong


def main() -> int:
    """Check, measure, write and return the status."""
    parser = argparse.ArgumentParser(description="One bootstrap filter in many libraries.")
    parser.add_argument("--particles", type=int, default=100_000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    everyone = peers(options.particles)
    problems = {}
    for name, scenario in (("easy", replace(HANDOUT, measurement_cov=1.5**2)), ("handout", HANDOUT)):
        problems[name] = Experiment.from_simulation(data_simulation(scenario=scenario, rng=0)).problem
    with tempfile.TemporaryDirectory() as folder:
        data = {name: Path(folder) / f"{name}.npz" for name in problems}
        for name, problem in problems.items():
            write_data(data[name], problem)
        first = measure(everyone, data["easy"], 0, CAP)
        reasons = {name: measured.reason for name, measured in first.items() if measured.reason}
        reasons |= check(first, problems["easy"], options.particles)
        for name, reason in reasons.items():
            print(f"{name:22}{reason}", flush=True)
        able = [peer for peer in everyone if peer.name not in reasons]
        found = measure(able, data["handout"], options.rounds, CAP)
    ours = found[everyone[0].name].median
    exact, rows = kalman(problems["handout"]), []
    for peer in everyone:
        row: dict[str, Any] = {"peer": peer.name, "particles": options.particles}
        measured = found.get(peer.name, Measured(reason=reasons.get(peer.name, "")))
        if measured.seconds:
            seconds = measured.median
            each = 1e9 * seconds / options.particles / (exact.means.shape[0] - 1)
            row |= {"seconds": seconds, "ns_per_particle_step": each, "times_ours": seconds / ours}
            row |= {"first_call": measured.first, "peak_mb": measured.peak - measured.before}
            row["gap"] = gap(measured.answer["means"], measured.answer["covs"], exact)[0]
            print(f"{peer.name:22}{seconds:8.3f} s {each:8.1f} ns {seconds / ours:8.2f}", flush=True)
        row["reason"] = measured.reason
        rows.append(row)
    with (options.out / "particle_peers.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, restval="")
        writer.writeheader()
        writer.writerows(rows)
    lines = [f"{date.today():%Y-%m-%d}, {processor()}, one thread, N = {options.particles}; median processor time.", ""]
    lines += ["| filter | s | ns per particle-step | times ours | gap to the exact mean |", "|---|---|---|---|---|"]
    for row in rows:
        numbers = [f"{row[name]:.3g}" for name in COLUMNS[2:5]] + [f"{row['gap']:.2f}"] if "gap" in row else None
        lines.append(f"| {row['peer']} | {' | '.join(numbers or [row['reason'], '', '', ''])} |")
    (options.out / "particle_peers.md").write_text("\n".join([*lines, ""]), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
