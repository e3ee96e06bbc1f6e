"""Exact filters and smoothers against their peers, for maps of 5 to 5000 landmarks.

    python benchmarks/environments.py filterpy dynamax gtsam
    python benchmarks/exact_filters.py [--out FOLDER] [--rounds 5]

Two questions, each with peers that take turns in one session, on one processor and one thread:

    filter   one step (prediction, then some landmarks seen) when EVERY landmark is in the map: mean and covariance
    map      from all sightings to the final moments of every pose and landmark: smooth_map, RTS smoother, GTSAM

Every answer is compared with ours before its time counts.  Writes exact_filters.csv, .md and .png; see README.md here.
"""

import argparse
import csv
import dataclasses
import platform
import sys
import tempfile
from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from interleave import OWN, Measured, Peer, measure

from data_simulation import Scenario
from lab.plots.style import legend_below, look, new_figure, plain_log_ticks, save_png
from lab.simulation import simulate
from lab.solvers.structured import MapFilter
from lab.sparse import SparseProblem

FILTERS = [
    Peer("structured (ours)", OWN, "exact_lab.py", ("structured",)),
    Peer("FilterPy", "filterpy", "exact_filterpy.py"),
    Peer("statsmodels", "filterpy", "exact_statsmodels.py"),
    Peer("dynamax", "dynamax", "exact_dynamax.py", variables={"JAX_ENABLE_X64": "1"}),
]
SMOOTHERS = [
    Peer("smooth_map (ours)", OWN, "exact_lab.py", ("eliminate",)),
    Peer("RTS smoother (ours)", OWN, "exact_lab.py", ("rts",)),
    Peer("GTSAM", "gtsam", "exact_gtsam.py"),
]
SIZES = (5, 50, 200, 1000, 5000)
STEPS = {5: 50, 50: 50, 200: 20, 1000: 3, 5000: 3}  # timed in one call of a filter
SEEN = 2  # landmarks a step, as many as the handout's robot sees
LARGEST_DENSE = 1000  # beyond, one n x n matrix takes 0.8 GB, a dense filter several, and a step minutes
LARGEST_RTS = 50  # the dense smoother keeps three n x n matrices an instant and takes pseudo-inverses
CAP = 600.0  # seconds for one call
AGREEMENT = 1e-6  # of means [m] and variances [m^2] with ours, whatever a peer's own rounding
COLUMNS = ("task", "landmarks", "seen", "peer", "seconds", "calls", "times_ours", "peak_mb", "gap", "reason")


def scenario(n_landmarks: int, n_steps: int, rule: Any) -> Scenario:
    """Return a ring of landmarks around the robot's circle, with a robot that is not quite known."""
    rng = np.random.default_rng(n_landmarks)
    radius, angle = rng.uniform(2, 8, n_landmarks), rng.uniform(0, 2 * np.pi, n_landmarks)
    return Scenario(
        n_steps=n_steps,
        centre=(0.0, 0.0),
        robot_mean=(5.0, 0.0),
        robot_cov=0.01,
        landmark_means=np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]),
        measurement_cov=0.15**2,
        field_of_view=rule,
    )


def filter_task(n_landmarks: int, seen: int) -> tuple[SparseProblem, int]:
    """Return a problem and the instant after which steps are timed: by then every landmark was seen."""
    sweep, steps = 1 + n_landmarks // 100, STEPS[n_landmarks]
    order = np.random.default_rng(0).permutation(n_landmarks)
    shares = [np.isin(order, part) for part in np.array_split(np.arange(n_landmarks), sweep)]
    shares += [np.isin(np.arange(n_landmarks), np.roll(order, seen * k)[:seen]) for k in range(steps)]
    turns = iter(shares)
    world = scenario(n_landmarks, 1 + len(shares), lambda z, o: next(turns))
    return simulate(world, np.random.default_rng(1))[0], sweep


def map_task(n_landmarks: int) -> tuple[SparseProblem, int]:
    """Return a drive of 50 instants that sees about a seventh of the map at each: 37 000 sightings of 5000."""
    world = scenario(n_landmarks, 50, lambda z, o: (z**2).sum(axis=1) < 5.2**2 * (0.5 if n_landmarks > 5 else 1))
    return simulate(world, np.random.default_rng(1))[0], 0


def write_data(path: Path, problem: SparseProblem, start: int) -> None:
    """Write what the workers read: the problem and, where dense peers can use them, the moments to start from."""
    fields: dict[str, Any] = {field.name: getattr(problem, field.name) for field in dataclasses.fields(problem)}
    if start and problem.n_landmarks <= LARGEST_DENSE:
        state = MapFilter(problem)
        for k in range(1, start + 1):
            state.predict()
            state.update(k)
        fields |= {"mean": state.mean, "cov": state.cov()}
    np.savez(path, start=start, **fields)


def tasks(sizes: list[int]) -> Iterator[tuple[str, int, int, list[Peer]]]:
    """Yield task, landmarks, landmarks seen a step (0: as it comes) and who takes part."""
    for M in sizes:
        yield "filter", M, min(SEEN, M), FILTERS if M <= LARGEST_DENSE else FILTERS[:1]
    if 1000 in sizes:
        yield "filter", 1000, 8, FILTERS
        yield "filter", 1000, 250, FILTERS
    for M in sizes:
        yield "map", M, 0, [peer for peer in SMOOTHERS if M <= LARGEST_RTS or "RTS" not in peer.name]


def gap(answer: dict[str, np.ndarray], ours: dict[str, np.ndarray]) -> float:
    """Return the largest difference of means [m] and variances [m^2]."""
    return max(float(np.abs(answer[name].ravel() - ours[name].ravel()).max()) for name in ("mean", "variances"))


def per_step(task: str, M: int, measured: Measured) -> float:
    """Return the median time of a step of a filter, or of a whole map [s]; ours takes the steps several times."""
    return measured.median / (STEPS[M] * int(measured.answer.get("passes", 1)) if task == "filter" else 1)


def rows_of(task: str, M: int, seen: int, everyone: list[Peer], found: dict[str, Measured]) -> list[dict[str, Any]]:
    """Return the lines of the table for one task."""
    ours, rows = next(iter(found.values())), []
    for peer in everyone:
        row: dict[str, Any] = {"task": task, "landmarks": M, "seen": seen, "peer": peer.name}
        measured = found.get(peer.name)
        if measured is None:
            measured = Measured(reason="not run: dense, see text")
        if measured.seconds:
            seconds = per_step(task, M, measured)
            row |= {"seconds": seconds, "calls": len(measured.seconds), "peak_mb": measured.peak - measured.before}
            row["times_ours"] = seconds / per_step(task, M, ours)
            row["gap"] = gap(measured.answer, ours.answer)
            if row["gap"] > AGREEMENT:
                row |= {"seconds": float("nan"), "reason": f"its answer differs by {row['gap']:.2g}"}
        else:
            row["reason"] = measured.reason
        rows.append(row)
    return rows


def markdown(rows: list[dict[str, Any]]) -> str:
    """Return the table, a line for each task and size."""
    lines = [
        f"{date.today():%Y-%m-%d}, {processor()}, one thread; median processor time, in brackets times ours.",
        "",
    ]
    for task, title in (("filter", "One step of an exact filter"), ("map", "Final moments of path and map")):
        chosen = [row for row in rows if row["task"] == task]
        peers = list(dict.fromkeys(row["peer"] for row in chosen))
        head = ["landmarks", *(["seen a step"] if task == "filter" else []), *peers]
        lines += [f"**{title}**", "", f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
        for key in dict.fromkeys((row["landmarks"], row["seen"]) for row in chosen):
            line = {row["peer"]: row for row in chosen if (row["landmarks"], row["seen"]) == key}
            cells = [str(key[0]), *([str(key[1])] if task == "filter" else [])]
            lines.append(f"| {' | '.join(cells + [cell(line[peer]) for peer in peers])} |")
        lines.append("")
    peaks = [row for row in rows if row["landmarks"] == max(SIZES) and "ours" in row["peer"] and row.get("peak_mb")]
    whole = 8e-6 * (2 + 2 * max(SIZES)) ** 2
    for row in peaks:
        share = row["peak_mb"] / whole
        lines.append(
            f"{row['peer']} at M = {row['landmarks']}: {row['peak_mb']:.0f} MB above its start,"
            f" {share:.2f} of one covariance matrix ({whole:.0f} MB)."
        )
    return "\n".join([*lines, ""])


def cell(row: dict[str, Any]) -> str:
    """Return a time with its ratio, or why there is none."""
    if not row.get("seconds", float("nan")) > 0:
        return str(row["reason"])
    seconds = row["seconds"]
    text = (
        f"{1e6 * seconds:.3g} us"
        if seconds < 1e-3
        else f"{1e3 * seconds:.3g} ms"
        if seconds < 1
        else f"{seconds:.3g} s"
    )
    return text if row["times_ours"] == 1 else f"{text} ({row['times_ours']:.3g})"


def processor() -> str:
    """Return the name of the processor, as far as the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or "unknown processor"


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Draw seconds against landmarks, one panel for each task."""
    figure = new_figure(10, 4.6)
    axes = figure.subplots(1, 2)
    titles = {"filter": f"one step, {SEEN} landmarks seen", "map": "final moments of path and map"}
    names = list(dict.fromkeys(row["peer"] for row in rows))
    for ax, (task, title) in zip(axes, titles.items(), strict=True):
        for i, name in enumerate(names):
            own = [row for row in rows if row["peer"] == name and row["task"] == task and row["seen"] in (0, SEEN)]
            points = [(row["landmarks"], row["seconds"]) for row in own if row.get("seconds", 0) > 0]
            if points:
                style = look(i)
                ax.plot(*zip(*points, strict=True), marker=style.marker, label=name, **style.line())
        ax.set(xscale="log", yscale="log", title=title, xlabel="landmarks $M$ [-]", ylabel="median processor time [s]")
        plain_log_ticks(ax.xaxis)
        ax.grid(alpha=0.3)
    legend_below(figure, *axes)
    save_png(
        figure, path, "Two log-log panels of seconds against the number of landmarks: exact filters, and smoothers."
    )


def main() -> int:
    """Measure, write and return the status."""
    parser = argparse.ArgumentParser(description="Exact filters against their peers.")
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"))
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--sizes", type=int, nargs="+", default=list(SIZES), choices=SIZES)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    for task, M, seen, peers in tasks(options.sizes):
        problem, start = filter_task(M, seen) if task == "filter" else map_task(M)
        print(f"{task}, {M} landmarks, {len(problem.instants)} sightings", flush=True)
        with tempfile.TemporaryDirectory() as folder:
            data = Path(folder) / "data.npz"
            write_data(data, problem, start)
            found = measure(peers, data, options.rounds, CAP)
        rows += rows_of(task, M, seen, FILTERS if task == "filter" else SMOOTHERS, found)
        for row in rows[-len(FILTERS if task == "filter" else SMOOTHERS) :]:
            print(f"  {row['peer']:22}{cell(row)}", flush=True)
        with (options.out / "exact_filters.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, COLUMNS, restval="")
            writer.writeheader()
            writer.writerows(rows)
    (options.out / "exact_filters.md").write_text(markdown(rows), encoding="utf-8")
    draw(rows, options.out / "exact_filters.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
