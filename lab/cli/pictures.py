"""The figures that the commands write, as PNG files with a description inside for those who cannot see them."""

import re
from collections.abc import Callable
from pathlib import Path

from lab import plots
from lab.comparison import Comparison
from lab.plots.comparison import ess_grid
from lab.plots.corridors import MOST_LANDMARKS
from lab.plots.style import new_figure, save_png
from lab.problem import Experiment
from lab.result import Filtered
from lab.validation import Array

LONGEST = 60  # characters of a label in a file's name


def write_comparison(
    folder: Path, comparison: Comparison, experiment: Experiment, on_done: Callable[[int, int], None]
) -> None:
    """Write gap.png, ess.png, and for each solver corridors and map of its first good run kept, with the largest N.

    Parameters
    ----------
    folder : Path
    comparison : Comparison
    experiment : Experiment
        For the truth.
    on_done : function of int and int
        Told after each figure, or pair of figures, how many of how many are there.
    """
    solvers = comparison.solvers
    runs = 1 + max(record.unit.run for record in comparison.records)
    figure = new_figure(10, 4.8)
    axes = figure.subplots(1, 2)
    for ax, metric in zip(axes, ("mean_gap", "cov_gap"), strict=True):
        plots.draw_gap(ax, comparison, metric)
    spread = "one run" if runs == 1 else f"means over {runs} runs, with standard errors"
    figure.suptitle(f"Particle moments against the exact ones: {spread}")
    plots.legend_below(figure, axes[0])
    save_png(figure, folder / "gap.png", "Gaps of mean and covariance to the exact filter against N, log-log.")
    on_done(1, 2 + len(solvers))

    rows, width = ess_grid(len(solvers))
    figure = new_figure(1 + max(3.0 * width, 5), 0.8 + 5.4 * rows)
    plots.draw_ess(figure, comparison)
    save_png(figure, folder / "ess.png", "Effective sample size and living ancestors of each filter over time.")
    on_done(2, 2 + len(solvers))

    for i, (solver, suffix) in enumerate(_suffixes(solvers).items()):
        kept = [record for record in comparison.records if record.unit.solver == solver and record.filtered is not None]
        if kept:
            best = max(kept, key=lambda record: record.unit.n_particles)
            label = f"{solver} (N = {best.unit.n_particles}, run {best.unit.run})"
            write_estimate(folder, suffix, best.filtered, comparison.exacts[0], experiment, label)
        on_done(3 + i, 2 + len(solvers))


def write_forecast(folder: Path, forecasts: dict[str, Array], errors: dict[int, Array], limit: float) -> None:
    """Write forecast.png: degeneracy of each proposal, and the bootstrap filter's predicted error."""
    figure = new_figure(11, 4.8)
    left, right = figure.subplots(1, 2)
    plots.draw_forecast(left, forecasts)
    plots.draw_predicted_error(right, errors, limit)
    description = "Forecast ESS/N of five proposals over time, and predicted error of the bootstrap filter, log scales."
    save_png(figure, folder / "forecast.png", description)


def write_estimate(
    folder: Path, suffix: str, filtered: Filtered | None, exact: Filtered, experiment: Experiment, label: str
) -> None:
    """Write corridors and map of one estimate beside the exact ones; None for `filtered` draws the exact alone."""
    rows = min(exact.means.shape[1] // 2, 1 + MOST_LANDMARKS)
    figure = new_figure(10, 1.4 + 1.6 * rows)
    plots.draw_corridors(figure, filtered, exact, experiment.truth, label=label)
    save_png(figure, folder / f"corridors{suffix}.png", f"Corridors of three standard deviations over time: {label}.")
    figure = new_figure(7.5, 7.5)
    ax = figure.subplots()
    plots.draw_map(ax, filtered, exact, experiment.truth, label=label)
    plots.legend_below(figure, ax)
    save_png(figure, folder / f"map{suffix}.png", f"Map at the last instant with 99 % ellipses: {label}.")


def _suffixes(solvers: list[str]) -> dict[str, str]:
    """Return the end of a file's name for each label: one of its own even where the system ignores case."""
    suffixes: dict[str, str] = {}
    for solver in solvers:
        plain = stem = f"-{re.sub(r'[^A-Za-z0-9_.-]', '-', solver)[:LONGEST]}"
        number = 2
        while stem.casefold() in (taken.casefold() for taken in suffixes.values()):
            stem, number = f"{plain}-{number}", number + 1
        suffixes[solver] = stem
    return suffixes
