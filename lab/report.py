"""The report of a comparison: one page that holds everything and asks for nothing else.

Question answered: what was found, how, and with what?  Findings in plain words, the table, the figures inside the page,
the runs that failed, and the command, inputs and versions that repeat it.  The page needs no network and no script, and
can be read in the dark, on paper, and by those who hear it.  What it says stands in `templates/report.html`; labels and
errors come from users and are escaped there.  Written by the command line.
"""

import base64
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined

from lab.comparison import Comparison
from lab.plots.style import runs_in_words

MOST_FAILURES = 100  # rows: one mistake fails every run of a solver in the same way


class Column(NamedTuple):
    """One column of the summary: its header, its unit, its name in the summary, and how many digits are shown."""

    header: str
    unit: str
    name: str
    digits: int


COLUMNS = (
    Column("mean gap", "exact std", "mean_gap", 3),
    Column("covariance gap", "relative", "cov_gap", 3),
    Column("log-evidence gap", "nat", "log_evidence_gap", 3),
    Column("smallest ESS/N", "-", "ess_min", 2),
    Column("collapsed at", "k", "collapsed_at", 3),
    Column("ancestors left", "particles", "ancestors_left", 3),
    Column("time of a run", "s", "seconds_per_run", 2),
)


class Number(NamedTuple):
    """A number as a person writes it, beside all its digits; and its standard error, where there is one."""

    text: str
    value: float
    error: "Number | None" = None


def write_report(
    path: Path,
    comparison: Comparison,
    figures: Sequence[tuple[str, str, str]],
    config: dict[str, Any],
    findings: Sequence[str],
) -> None:
    """Write a comparison as one self-contained HTML page.

    Parameters
    ----------
    path : Path
        Of the page; the figures' files lie beside it.
    comparison : Comparison
    figures : sequence of (str, str, str)
        File, title and description of each PNG, in order.
    config : dict
        What config.json holds: `repeat`, `inputs`, `versions` and `platform`; what is missing is left out.
    findings : sequence of str
        Plain sentences.

    Raises
    ------
    OSError
        A figure cannot be read, or the page cannot be written.
    """
    environment = Environment(
        loader=PackageLoader("lab", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    page = environment.get_template("report.html").render(
        scope=_scope(comparison),
        findings=findings,
        columns=COLUMNS,
        several=len(comparison.problems) > 1,
        rows=_rows(comparison),
        figures=[_embedded(path.parent / file, title, alt) for file, title, alt in figures],
        failures=comparison.failures[:MOST_FAILURES],
        n_failures=len(comparison.failures),
        n_runs=len(comparison.records),
        config=config,
    )
    path.write_text(page, encoding="utf-8", errors="backslashreplace")


def _scope(comparison: Comparison) -> str:
    """Say in a sentence what was compared."""
    problem = comparison.problems[0]
    *others, last = map(str, sorted({record.unit.n_particles for record in comparison.records}))
    sizes = f"{', '.join(others)} and {last}" if others else last
    return (
        f"{_counted(len(comparison.solvers), 'filter')} with N = {sizes} particles: {runs_in_words(comparison)};"
        f" {_counted(problem.n_instants, 'instant')}, {_counted(problem.n_landmarks, 'landmark')}."
    )


def _counted(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def _rows(comparison: Comparison) -> list[dict[str, Any]]:
    """Return the rows of the summary, each number written out."""
    rows = []
    for row in comparison.summary().to_dict("records"):
        cells = [_number(row[c.name], c.digits, row.get(f"{c.name}_se")) for c in COLUMNS]
        rows.append({name: row[name] for name in ("solver", "n_particles", "data_sets", "runs")} | {"cells": cells})
    return rows


def _number(value: Any, digits: int, error: Any = None) -> Number | None:
    """Write a number: 130 and not 1.3e+02; None where there is none."""
    if pd.isna(value):
        return None
    text = f"{float(f'{value:.{digits}g}'):g}".replace("-", "\N{MINUS SIGN}")
    return Number(text, float(value), None if error is None else _number(error, 2))


def _embedded(file: Path, title: str, alt: str) -> dict[str, Any]:
    """Return a PNG as a page holds it, with its size in pixels, which its header says."""
    data = file.read_bytes()
    width, height = struct.unpack(">II", data[16:24])
    encoded = base64.b64encode(data).decode("ascii")
    return {"title": title, "alt": alt, "width": width, "height": height, "data": encoded}
