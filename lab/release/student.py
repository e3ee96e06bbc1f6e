"""One notebook: its metadata checked, its points counted, and its student copy.

Question answered: what of a solution notebook does a student get, and for how many points?  nbgrader's metadata of a
cell (schema 3) say what it is:

    solution            code: the student's to write
    grade               code: a check, which raises where the answer is wrong
    grade, solution     markdown: an answer in words, marked by a person
    task                markdown: a question with its mark scheme
    locked              what is not the student's

Source: nbgrader's nbgraderformat/v3 and its preprocessors for assignments.
"""

import copy
import re
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import nbformat

from lab.release.regions import HIDDEN_TESTS, MARK_SCHEME, SOLUTION, cleared, regions
from lab.validation import InputError

SCHEMA = 3
FIELDS = {"grade", "solution", "locked", "task", "points", "grade_id", "schema_version"}
CODE_STUB = "# YOUR CODE HERE\nraise NotImplementedError()"
TEXT_STUB = "YOUR ANSWER HERE"
# What a front end adds besides (versions, widths) differs from machine to machine.
METADATA = {
    "kernelspec": {"display_name": "Python 3 (ipykernel)", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}
Notebook = Any  # nbformat.NotebookNode, which is a dict whose keys are attributes


@dataclass(frozen=True)
class Mark:
    """Points for one cell: the notebook's name, the question's key, what the cell is ("code" or "text"), the points."""

    notebook: str
    question: str
    kind: str
    points: float


def read_notebook(path: Path) -> Notebook:
    """Return a notebook of format 4.5 whose cells have ids of their own.

    Raises
    ------
    InputError
        The file cannot be read, is no such notebook, or two cells share an id.
    """
    read: Any = nbformat.read
    try:
        with warnings.catch_warnings(action="error"):  # nbformat would give new, random ids where they are missing
            notebook = read(path, as_version=nbformat.NO_CONVERT)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from None
    except Exception as error:  # nbformat lets through whatever its JSON reader met
        raise InputError(f"{path} is no notebook: {' '.join(str(error).split())}.") from None
    version = notebook.get("nbformat", 0), notebook.get("nbformat_minor", 0)
    if version < (4, 5):
        raise InputError(f"{path} is no notebook of format 4.5, which has the cell ids, but {version[0]}.{version[1]}.")
    ids = [cell.get("id", "") for cell in notebook.cells]
    for i, cell_id in enumerate(ids):
        if not cell_id or cell_id in ids[:i]:
            raise InputError(f"{path}: cell {i} has no id of its own ({cell_id!r}).")
    return notebook


def node(data: dict[str, Any]) -> Any:
    """Return a copy of a dict whose keys are attributes, as notebooks have them."""
    return nbformat.from_dict(copy.deepcopy(data))  # type: ignore[no-untyped-call]


def as_text(notebook: Notebook) -> str:
    """Return the file's text: sorted keys, one end of line, the same on every machine."""
    write: Any = nbformat.writes
    return f"{write(notebook, version=nbformat.NO_CONVERT).rstrip()}\n"


def student_copy(notebook: Notebook, name: str) -> Notebook:
    """Return the copy for students.

    Parameters
    ----------
    notebook : NotebookNode
        Of ``solutions/``, left as it is.
    name : str
        For messages.

    Raises
    ------
    InputError
        A marker or the metadata of a cell are wrong; the message names notebook and cell.
    """
    check_cells(notebook, name)
    result = copy.deepcopy(notebook)
    result.metadata = node(METADATA)
    for cell in result.cells:
        stub = CODE_STUB if cell.cell_type == "code" else TEXT_STUB
        cell.source = cleared(cell.source, {SOLUTION: stub}, _where(name, cell)).rstrip("\n")
        grader = cell.metadata.get("nbgrader")
        kept = {key: cell.metadata[key] for key in ("nbgrader", "tags") if key in cell.metadata}
        if grader:
            kept["deletable"] = False
            if not grader["solution"]:
                kept["editable"] = False
        cell.metadata = node(kept)
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
        cell.pop("attachments", None)
    return result


def marks(notebook: Notebook, name: str) -> list[Mark]:
    """Return the points of the notebook's cells, in their order.

    Raises
    ------
    InputError
        As `student_copy`.
    """
    check_cells(notebook, name)
    found = []
    for cell in notebook.cells:
        grader = cell.metadata.get("nbgrader", {})
        if grader.get("grade"):
            question, _, _ = grader["grade_id"].rpartition("-")
            found.append(Mark(name, question, "text" if grader["solution"] else "code", grader["points"]))
    return found


def check_cells(notebook: Notebook, name: str) -> None:
    """Refuse a notebook that nbgrader would refuse, or whose markers stand in the wrong kind of cell.

    Raises
    ------
    InputError
        The message names notebook and cell.
    """
    taken: set[str] = set()
    for cell in notebook.cells:
        where = _where(name, cell)
        grader = cell.metadata.get("nbgrader")
        if grader is not None:
            _check_metadata(grader, cell, where)
            if grader["grade_id"] in taken:
                raise InputError(f"{where}: the grade_id {grader['grade_id']!r} is taken by another cell.")
            taken.add(grader["grade_id"])
        own = grader or {}
        found = regions(cell.source, where)
        for kind, field in ((SOLUTION, "solution"), (HIDDEN_TESTS, "grade"), (MARK_SCHEME, "task")):
            if kind in found and not own.get(field):
                raise InputError(f"{where}: a region {kind!r} stands in a cell that nbgrader does not know as {field}.")
        if own.get("solution") and SOLUTION not in found:
            raise InputError(f"{where}: the cell is to be answered and has no region {SOLUTION!r}.")


def _check_metadata(grader: Any, cell: Any, where: str) -> None:
    unknown = set(grader) - FIELDS
    if unknown or grader.get("schema_version") != SCHEMA:
        raise InputError(f"{where}: nbgrader's metadata are not of schema {SCHEMA} ({', '.join(sorted(unknown))}).")
    flags = {field: grader.get(field) for field in ("grade", "solution", "locked")} | {
        "task": grader.get("task", False)
    }
    for field, value in flags.items():
        if not isinstance(value, bool):
            raise InputError(f"{where}: {field} must be true or false, not {value!r}.")
    if not re.fullmatch(r"[A-Za-z0-9_-]+", str(grader.get("grade_id", ""))):
        raise InputError(f"{where}: the grade_id {grader.get('grade_id')!r} is not of letters, digits, - and _.")
    points = grader.get("points")
    counted = flags["grade"] or flags["task"]
    if counted != ("points" in grader):
        raise InputError(f"{where}: points belong to cells with grade or task, and to those only.")
    if counted and (isinstance(points, bool) or not isinstance(points, int | float) or points < 0):
        raise InputError(f"{where}: points must be a number of at least 0, not {points!r}.")
    if flags["task"] and (cell.cell_type != "markdown" or flags["grade"] or flags["solution"]):
        raise InputError(f"{where}: a task is a markdown cell without grade and solution.")
    if cell.cell_type == "markdown" and flags["grade"] != flags["solution"]:
        raise InputError(f"{where}: a markdown cell is graded and to be answered, or neither.")


def _where(name: str, cell: Any) -> str:
    return f"{name}, cell {cell.get('id', '?')}"
