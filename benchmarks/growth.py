"""How the time of a particle-step grows with particles, landmarks and instants, with numpy and compiled.

    python benchmarks/growth.py [--rounds 5] [--out FOLDER]

SIS, SIR, guided and Rao-Blackwellized filter on the handout's scenario, with mean and full covariance at every instant;
both backends take turns, and medians of processor time in one thread count.  One of the three grows at a time, from N =
10 000 particles, M = 5 landmarks and 50 instants.  Writes growth.csv, .md and .png; see README.md here.
"""

import argparse
import sys
import time
from dataclasses import replace
from datetime import date
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from exact_filters import processor
from threadpoolctl import threadpool_limits

from data_simulation import HANDOUT, data_simulation
from lab.plots.style import legend_below, look, new_figure, save_png
from lab.problem import Experiment, Problem
from lab.solvers import guided, rbpf, sir, sis

FILTERS = {"sis": sis, "sir": sir, "guided": guided, "rbpf": rbpf}
BACKENDS = ("numba", "numpy")
USUAL = {"N": 10_000, "M": 5, "instants": 50}
GROWTH = {"N": (100, 1000, 10_000, 100_000, 1_000_000), "M": (1, 5, 20, 50), "instants": (25, 50, 100, 200)}
TITLES = {"N": "particles $N$ [-]", "M": "landmarks $M$ [-]", "instants": "instants [-]"}
FEW = 2  # rounds from LARGE particles on
LARGE = 1_000_000


def world(n_landmarks: int, n_instants: int) -> Problem:
    """Return the handout's experiment with so many landmarks on a circle, and so many instants."""
    angles = 2 * np.pi * np.arange(n_landmarks) / n_landmarks
    means = np.stack([4 * np.cos(angles) - 1.5, 4 * np.sin(angles)], axis=1)
    scenario = HANDOUT if n_landmarks == USUAL["M"] else replace(HANDOUT, landmark_means=means)
    return Experiment.from_simulation(data_simulation(scenario=replace(scenario, n_steps=n_instants), rng=0)).problem


def measured(rounds: int) -> pd.DataFrame:
    """Return a row per filter, backend and size: nanoseconds per particle-step."""
    rows: list[dict[str, Any]] = []
    for what, sizes in GROWTH.items():
        for size in sizes:
            sized = USUAL | {what: size}
            problem, n = world(sized["M"], sized["instants"]), sized["N"]
            times: dict[Any, list[float]] = {cell: [] for cell in product(FILTERS, BACKENDS)}
            for i in range(1 + (FEW if n >= LARGE else rounds)):
                for (name, backend), each in times.items():
                    start = time.thread_time()
                    FILTERS[name](problem, np.random.default_rng(i), n_particles=n, backend=backend)
                    each.append((time.thread_time() - start) / (n * (problem.n_instants - 1)))
            for (name, backend), each in times.items():  # the first compiles, and makes what all runs share
                row = {"growing": what, "size": size, "filter": name, "backend": backend}
                rows.append(row | {"ns": 1e9 * float(np.median(each[1:]))})
            print(f"{what} = {size}", flush=True)
    return pd.DataFrame(rows)


def markdown(table: pd.DataFrame) -> str:
    """Return one table for each of what grows."""
    lines = [f"{date.today():%Y-%m-%d}, {processor()}, one thread; ns per particle-step, compiled / numpy.", ""]
    for what, sizes in GROWTH.items():
        others = ", ".join(f"{name} = {value}" for name, value in USUAL.items() if name != what)
        lines += [f"**{what}** grows ({others})", "", f"| filter | {' | '.join(map(str, sizes))} |"]
        lines.append("|---" * (1 + len(sizes)) + "|")
        chosen = table[table["growing"] == what].set_index(["filter", "size", "backend"])["ns"]
        for name in FILTERS:
            cells = (" / ".join(f"{chosen[name, size, backend]:.0f}" for backend in BACKENDS) for size in sizes)
            lines.append(f"| {name} | {' | '.join(cells)} |")
        lines.append("")
    return "\n".join(lines)


def draw(table: pd.DataFrame, path: Path) -> None:
    """Draw a panel for each of what grows."""
    figure = new_figure(12, 5)
    axes = figure.subplots(1, 3, sharey=True)
    for ax, what in zip(axes, GROWTH, strict=True):
        for i, (name, backend) in enumerate(product(FILTERS, BACKENDS)):
            rows = table[(table["growing"] == what) & (table["filter"] == name) & (table["backend"] == backend)]
            style = look(i // 2)
            line = style.line() | {"linestyle": "-" if backend == "numba" else (0, (4, 2))}
            words = "compiled" if backend == "numba" else "numpy"
            ax.plot(rows["size"], rows["ns"], marker=style.marker, label=f"{name}, {words}", **line)
        ax.set(xscale="log", yscale="log", xlabel=TITLES[what])
        if what != "N":
            ax.set_xticks(GROWTH[what], map(str, GROWTH[what]))
            ax.minorticks_off()
        ax.grid(alpha=0.3, which="both")
    axes[0].set_ylabel("processor time per particle-step [ns]")
    legend_below(figure, axes[0])
    figure.suptitle(f"Cost of a particle-step; else N = {USUAL['N']}, M = {USUAL['M']}, {USUAL['instants']} instants")
    description = "Three log-log panels of nanoseconds per particle-step against particles, landmarks and instants."
    save_png(figure, path, description)


def main() -> int:
    """Measure, write and return the status."""
    parser = argparse.ArgumentParser(description="How the cost of a particle-step grows.")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    table = measured(options.rounds)
    table.to_csv(options.out / "growth.csv", index=False)
    text = markdown(table)
    print(text)
    (options.out / "growth.md").write_text(text, encoding="utf-8")
    draw(table, options.out / "growth.png")
    return 0


if __name__ == "__main__":
    with threadpool_limits(limits=1):
        sys.exit(main())
