"""The figures that the commands write, as PNG files with a description inside for those who cannot see them."""

from pathlib import Path
from typing import Any

from lab import plots
from lab.cli import captions
from lab.cli.captions import Picture
from lab.comparison import Comparison
from lab.plots.comparison import ess_grid
from lab.plots.corridors import MOST_LANDMARKS
from lab.plots.loop_closure import kept, loop_closure
from lab.plots.style import new_figure, record_in_words, save_png
from lab.problem import Experiment
from lab.result import Filtered
from lab.validation import Array


def write(
    kind: str, folder: Path, comparison: Comparison, experiment: Experiment, solver: str, suffix: str
) -> Picture | None:
    """Write one figure of a comparison, of those that `lab.cli.album` names; None where no run of a solver was kept."""
    if kind in _GENERAL:
        return _GENERAL[kind](folder, comparison)
    record = kept(comparison, solver)
    if record is None:
        return None
    if kind == "loop-closure":
        return _write_closure(folder, suffix, comparison, solver)
    write_it = {"corridors": _write_corridors, "map": _write_map}[kind]
    label = record_in_words(comparison, record)
    return write_it(folder, suffix, record.filtered, comparison.exacts[0], experiment, label)


def _write_gap(folder: Path, comparison: Comparison) -> Picture:
    picture = captions.gap(comparison, "gap.png")
    figure = new_figure(10, 4.8)
    axes = figure.subplots(1, 2)
    for ax, metric in zip(axes, ("mean_gap", "cov_gap"), strict=True):
        plots.draw_gap(ax, comparison, metric)
    figure.suptitle(picture.title)
    plots.legend_below(figure, axes[0])
    return _saved(figure, folder, picture)


def _write_cost(folder: Path, comparison: Comparison) -> Picture:
    figure = new_figure(7.5, 5.8)
    ax = figure.subplots()
    plots.draw_cost(ax, comparison)
    plots.legend_below(figure, ax)
    return _saved(figure, folder, captions.cost(comparison, "cost.png"))


def _write_evidence(folder: Path, comparison: Comparison) -> Picture:
    figure = new_figure(9, 5.5)
    ax = figure.subplots()
    plots.draw_evidence(ax, comparison)
    plots.legend_below(figure, ax)
    return _saved(figure, folder, captions.evidence(comparison, "evidence.png"))


def _write_ess(folder: Path, comparison: Comparison) -> Picture:
    rows, width = ess_grid(len(comparison.solvers))
    figure = new_figure(1 + max(3.0 * width, 5), 0.8 + 5.4 * rows)
    plots.draw_ess(figure, comparison)
    return _saved(figure, folder, captions.ess(comparison, "ess.png"))


_GENERAL = {"gap": _write_gap, "cost": _write_cost, "evidence": _write_evidence, "ess": _write_ess}


def _write_closure(folder: Path, suffix: str, comparison: Comparison, solver: str) -> Picture:
    closes = loop_closure(comparison.problems[0], comparison.exacts[0])
    figure = new_figure(11, 8 if closes else 1.5)
    plots.draw_loop_closure(figure, comparison, solver)
    return _saved(figure, folder, captions.closure(comparison, solver, f"loop-closure{suffix}.png"))


def _saved(figure: Any, folder: Path, picture: Picture) -> Picture:
    save_png(figure, folder / picture.file, picture.alt)
    return picture


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
) -> list[Picture]:
    """Write corridors and map of one estimate beside the exact ones; None for `filtered` draws the exact alone."""
    return [write_it(folder, suffix, filtered, exact, experiment, label) for write_it in (_write_corridors, _write_map)]


def _write_corridors(
    folder: Path, suffix: str, filtered: Filtered | None, exact: Filtered, experiment: Experiment, label: str
) -> Picture:
    rows = min(exact.means.shape[1] // 2, 1 + MOST_LANDMARKS)
    figure = new_figure(10, 1.4 + 1.6 * rows)
    plots.draw_corridors(figure, filtered, exact, experiment.truth, label=label)
    picture = captions.corridors(filtered, exact, experiment.truth, label, f"corridors{suffix}.png")
    return _saved(figure, folder, picture)


def _write_map(
    folder: Path, suffix: str, filtered: Filtered | None, exact: Filtered, experiment: Experiment, label: str
) -> Picture:
    figure = new_figure(7.5, 7.5)
    ax = figure.subplots()
    plots.draw_map(ax, filtered, exact, experiment.truth, label=label)
    plots.legend_below(figure, ax)
    return _saved(figure, folder, captions.final_map(filtered, exact, label, f"map{suffix}.png"))
