"""The tables that the commands print, and the plain words below them."""

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from lab.cli.output import console

if TYPE_CHECKING:
    import pandas as pd

    from lab.comparison import Comparison
    from lab.validation import Array

COLUMNS = (  # header, name, digits
    ("solver", "solver", 0),
    ("N", "n_particles", 0),
    ("runs", "runs", 0),
    ("mean gap (se)\n[exact std]", "mean_gap", 3),
    ("cov gap (se)\n[relative]", "cov_gap", 3),
    ("log-evidence\ngap (se)", "log_evidence_gap", 3),
    ("min\nESS/N", "ess_min", 2),
    ("collapsed\nat k", "collapsed_at", 3),
    ("ancestors\nleft", "ancestors_left", 3),
    ("s per\nrun", "seconds_per_run", 2),
)
DISPENSABLE = ("seconds_per_run", "ess_min", "runs", "log_evidence_gap", "cov_gap", "ancestors_left")  # in this order
FOLDED = 16  # characters to which a narrow terminal folds the labels of solvers
GUTTER = 2  # between columns


def print_comparison(comparison: "Comparison") -> None:
    """Print one row per solver and N, and below the table what went wrong in plain words."""
    from lab.findings import findings

    summary = comparison.summary_rows()
    columns = {}
    for header, name, digits in COLUMNS:
        cells = [_cell(row[name], row.get(f"{name}_se", float("nan")), digits) for row in summary]
        columns[name] = [header, *cells]
    out = console()
    left_out = _fit(columns, out.width) if out.is_terminal else []
    _print_table(columns.values())
    if left_out:
        out.print(f"(no room for: {', '.join(header.replace(chr(10), ' ') for header in left_out)})", markup=False)
    _print_lines(findings(comparison))


def print_moments(table: "pd.DataFrame", lines: Sequence[str]) -> None:
    """Print the moments at the last instant, and the lines below."""
    last = table[table["k"] == table["k"].max()].drop(columns="k")
    columns = [[f"{name}\n[m]", *(f"{value:.4f}" for value in last[name])] for name in last.columns[1:]]
    _print_table([[f"k = {table['k'].max()}", *last["component"]], *columns])
    _print_lines(lines)


def _cell(value: Any, error: float, digits: int) -> str:
    text = str(value) if digits == 0 else "-" if math.isnan(value) else _number(value, digits)
    return text if math.isnan(error) else f"{text} ({_number(error, 2)})"


def print_forecast(
    forecasts: "dict[str, Array]",
    needed: "dict[str, Array]",
    ess: float,
    instants: Sequence[int],
    errors: "dict[int, Array]",
    bootstrap: "Array",
) -> None:
    """Print degeneracy and the particles that it takes per proposal, and the bootstrap filter's predicted error."""
    when = [f"k = {k}" for k in instants]
    console().print("log10 of the limiting ESS/N when nothing is resampled")
    print_rows(
        ["proposal", *when], [[name, *(f"{round(v[k], 1) + 0:.1f}" for k in instants)] for name, v in forecasts.items()]
    )
    _print_lines([f"Particles for an ESS of {ess:g} without resampling"])
    print_rows(["proposal", *when], [[name, *(_power(v[k]) for k in instants)] for name, v in needed.items()])
    _print_lines(["Error of the bootstrap filter's mean, multinomial resampling at every step [exact std, rms]"])
    rows = [[f"N = {size}", *(_cell(v[k], math.nan, 2) for k in instants)] for size, v in errors.items()]
    rows.append(["holds from N =", *(_power(math.log10(max(bootstrap[k], 1))) for k in instants)])
    print_rows(["", *when], rows)
    _print_lines(["With systematic or ESS-triggered resampling the error is usually smaller; that is no theorem."])


def print_slam(title: str, rows: Sequence[Sequence[str]], lines: Sequence[str]) -> None:
    """Print errors as they are and aligned, and the verdict below."""
    console().print(title, markup=False)
    print_rows(["", "as it is", "aligned"], rows)
    _print_lines(lines)


def print_rows(headers: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print rows under their headers."""
    _print_table(zip(headers, *rows, strict=True))


def _power(log10: float) -> str:
    """Return a number given by its logarithm: plain while it is small, a power of ten beyond."""
    return f"{10**log10:.0f}" if log10 < 5 else f"10^{log10:.1f}"


def _number(value: float, digits: int) -> str:
    """Return a number as a person writes it: 130 and not 1.3e+02."""
    return f"{float(f'{value:.{digits}g}'):g}"


def _fit(columns: dict[str, list[str]], width: int) -> list[str]:
    """Take out what a terminal of this width has no room for, and return its headers: numbers do not bear folding."""
    left_out = []
    for name in DISPENSABLE:
        widths = [max(len(line) for cell in cells for line in cell.splitlines()) for cells in columns.values()]
        if min(widths[0], FOLDED) + sum(widths[1:]) + GUTTER * (len(widths) - 1) <= width:
            break
        left_out.append(columns.pop(name)[0])
    return left_out


def _print_table(columns: Iterable[Sequence[str]]) -> None:
    """Print columns, each a header and its cells: the first to the left, numbers to the right."""
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, padding=(0, GUTTER // 2))
    cells = [list(map(Text, column)) for column in columns]
    for i, column in enumerate(cells):
        table.add_column(column[0], justify="right" if i else "left", overflow="fold", no_wrap=i > 0)
    for row in zip(*(column[1:] for column in cells), strict=True):
        table.add_row(*row)
    console().print(table)


def _print_lines(lines: Sequence[str]) -> None:
    """Print each line, folded between words on a terminal and whole in a file."""
    out = console()
    out.print()
    for line in lines:
        out.print(line, markup=False, soft_wrap=not out.is_terminal)
