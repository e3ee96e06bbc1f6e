"""Accuracy per second: how far each filter's mean is from the exact one, against the processor time of a run.

    python benchmarks/accuracy.py [--runs 10] [--out FOLDER]

Every filter of the laboratory with both backends, N = 100 to 100 000, on the handout's problem (50 instants, 5
landmarks); cells take turns, run by run.  The error is the root mean square over runs of the gap of the mean, in exact
standard deviations.  Writes accuracy.csv, .md and .png; see README.md here.
"""

import argparse
import sys
import time
from datetime import date
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from exact_filters import processor
from threadpoolctl import threadpool_limits

from data_simulation import data_simulation
from lab.metrics import measure
from lab.plots.style import legend_below, look, new_figure, save_png
from lab.problem import Experiment
from lab.solvers import guided, kalman, rbpf, sir, sis
from lab.units import unit_seed

FILTERS = {"sis": sis, "sir": sir, "guided": guided, "rbpf": rbpf}
SIZES = (100, 1000, 10_000, 100_000)
BACKENDS = ("numba", "numpy")


def measured(runs: int) -> pd.DataFrame:
    """Return a row per filter, backend and N: median time [s], root mean square gap and how many runs gave them."""
    problem = Experiment.from_simulation(data_simulation(rng=0)).problem
    exact = kalman(problem)
    cells = list(product(FILTERS, BACKENDS, SIZES))
    seconds: dict[Any, list[float]] = {cell: [] for cell in cells}
    gaps: dict[Any, list[float]] = {cell: [] for cell in cells}
    for name, backend in product(FILTERS, BACKENDS):
        FILTERS[name](problem, np.random.default_rng(0), n_particles=10, backend=backend)  # compiles
    for run in range(runs):
        for cell in cells:
            name, backend, size = cell
            act = partial(FILTERS[name], problem, n_particles=size, backend=backend)
            rng = np.random.default_rng(unit_seed(0, name, size, run))
            start = time.thread_time()
            answer = act(rng)
            seconds[cell].append(time.thread_time() - start)
            gaps[cell].append(measure(answer, exact, size, 0.0).mean_gap)
    rows = [(*cell, np.median(seconds[cell]), np.sqrt(np.mean(np.square(gaps[cell]))), runs) for cell in cells]
    return pd.DataFrame(rows, columns=["filter", "backend", "n_particles", "seconds", "gap", "runs"])


def sentence(table: pd.DataFrame) -> str:
    """Compare the Rao-Blackwellized filter with few particles and SIR with the most."""
    rows = table[table["backend"] == "numba"].set_index(["filter", "n_particles"])
    few, many = rows.loc[("rbpf", SIZES[0])], rows.loc[("sir", SIZES[-1])]
    return (
        f"rbpf with N = {SIZES[0]}: gap {few['gap']:.2f} in {1e3 * few['seconds']:.2f} ms; sir with N = {SIZES[-1]}:"
        f" {many['gap']:.2f} in {1e3 * many['seconds']:.0f} ms, {many['seconds'] / few['seconds']:.0f} times as long."
    )


def markdown(table: pd.DataFrame) -> str:
    """Return the table and the sentence."""
    lines = [f"{date.today():%Y-%m-%d}, {processor()}, one thread; median processor time of a run, gap over {{}} runs."]
    lines = [lines[0].format(table["runs"].iloc[0]), "", "| filter | N | numba s | numpy s | gap numba | gap numpy |"]
    lines.append("|---|---|---|---|---|---|")
    wide = table.pivot(index=["filter", "n_particles"], columns="backend", values=["seconds", "gap"])
    for name, size in product(FILTERS, SIZES):
        row = wide.loc[(name, size)]
        numbers = [f"{row[('seconds', backend)]:.3g}" for backend in BACKENDS]
        numbers += [f"{row[('gap', backend)]:.2f}" for backend in BACKENDS]
        lines.append(f"| {name} | {size} | {' | '.join(numbers)} |")
    return "\n".join([*lines, "", sentence(table), ""])


def draw(table: pd.DataFrame, path: Path) -> None:
    """Draw gap against seconds: a line for each filter and backend."""
    figure = new_figure(8, 5.6)
    ax = figure.subplots()
    for i, (name, backend) in enumerate(product(FILTERS, BACKENDS)):
        rows = table[(table["filter"] == name) & (table["backend"] == backend)]
        style = look(i // 2)
        line = style.line() | {"linestyle": "-" if backend == "numba" else (0, (4, 2))}
        words = "compiled" if backend == "numba" else "numpy"
        ax.plot(rows["seconds"], rows["gap"], marker=style.marker, label=f"{name}, {words}", **line)
        if backend == "numba":
            for size, seconds, gap in rows[["n_particles", "seconds", "gap"]].itertuples(index=False):
                if size in (SIZES[0], SIZES[-1]):
                    place = {"xytext": (0, -14), "textcoords": "offset points", "ha": "center", "fontsize": 8}
                    ax.annotate(f"$10^{{{np.log10(size):.0f}}}$", (seconds, gap), **place)
    ax.set(xscale="log", yscale="log", xlabel="processor time of a run [s]")
    ax.set(
        ylabel="gap of the mean, RMS [exact standard deviations]", title="Accuracy per second, N from 100 to 100 000"
    )
    ax.grid(alpha=0.3, which="both")
    legend_below(figure, ax)
    description = "Log-log: root mean square gap of the mean against processor time, four filters, compiled and numpy. "
    save_png(figure, path, description + sentence(table))


def main() -> int:
    """Measure, write and return the status."""
    parser = argparse.ArgumentParser(description="Accuracy per second of every filter.")
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    table = measured(options.runs)
    table.to_csv(options.out / "accuracy.csv", index=False)
    text = markdown(table)
    print(text)
    (options.out / "accuracy.md").write_text(text, encoding="utf-8")
    draw(table, options.out / "accuracy.png")
    return 0


if __name__ == "__main__":
    with threadpool_limits(limits=1):
        sys.exit(main())
