"""What a person hands in: a notebook, a Python file, or a folder of them; and the functions in it.

Question answered: which functions does a submission define, if parts of it are broken?  A file is read as statements,
one after the other; one that raises, hangs or cannot be parsed is left out, and the others go on.  Definitions,
imports and assignments are run; bare expressions (plots, prints), checks and the notebook's demonstrations are not,
since no function depends on them.
"""

import ast
import json
import re
import sys
import types
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from lab.checks import guard
from lab.validation import InputError

ENDINGS = (".ipynb", ".py")
SKIPPED = {"__pycache__", "__MACOSX", "node_modules", "site-packages"}
STATEMENT_SECONDS, SUBMISSION_SECONDS = 10.0, 40.0
MAGIC = re.compile(r"^\s*[%!?]|^\s*[\w.]+\?{1,2}\s*$")
MODULE = "submission"
SHOWING = "-show"  # ends the ids of the course's own cells that draw pictures
DEFINING = ast.FunctionDef | ast.ClassDef | ast.Import | ast.ImportFrom
SHOWN = {"demonstration": "lab.notebook", "check": "lab.checks"}  # calls that show or judge, and where they come from


class Cell(NamedTuple):
    """A cell's code, and whether it is one of the course's own that draw pictures."""

    code: str
    shows: bool = False


@dataclass(frozen=True)
class Submission:
    """One person's work: a name for the table, and the files that belong to it, in order."""

    name: str
    files: tuple[Path, ...]


@dataclass(eq=False)
class Loaded:
    """What running a submission left: its variables, its own functions, what went wrong, and which statements hung."""

    scope: dict[str, Any]
    own: dict[str, Any] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)
    hung: set[str] = field(default_factory=set)

    def answer(self, name: str) -> Any:
        """Return what stands under a name; a definition of one's own goes before an import from the laboratory."""
        value = self.scope.get(name)
        if value is not None and guard.of_the_laboratory(value) and name in self.own:
            return self.own[name]
        return value


def find(path: Path) -> list[Submission]:
    """Return the submissions at a path: a file is one; in a folder every file, and every folder with files in it.

    Raises
    ------
    InputError
        Nothing is there, or nothing that can be a submission.
    """
    if path.is_file():
        if path.suffix not in ENDINGS:
            raise InputError(f"{path}: a submission ends in .ipynb or .py.")
        cells(path)
        return [Submission(path.name, (path,))]
    if not path.is_dir():
        raise InputError(f"{path} does not exist.")
    found = []
    for entry in sorted(path.iterdir()):
        if _ignored(entry):
            continue
        if entry.is_file() and entry.suffix in ENDINGS:
            found.append(Submission(entry.name, (entry,)))
        elif entry.is_dir():
            files = [file for file in sorted(entry.rglob("*")) if file.suffix in ENDINGS and file.is_file()]
            files = [file for file in files if not any(map(_ignored, _between(entry, file)))]
            if files:
                found.append(Submission(entry.name, tuple(files)))
    if not found:
        raise InputError(f"{path} holds no .ipynb and no .py.")
    return found


def _between(folder: Path, file: Path) -> Iterator[Path]:
    for part in (file, *file.parents):
        if part == folder:
            return
        yield part


def _ignored(entry: Path) -> bool:
    return entry.name.startswith(".") or entry.name in SKIPPED


def cells(path: Path) -> list[Cell]:
    """Return the code of a file, cell by cell; a .py is one cell.

    Raises
    ------
    InputError
        The file cannot be read, or is no notebook.
    """
    try:
        text = path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}.") from None
    if path.suffix == ".py":
        return [Cell(text)]
    try:
        notebook = json.loads(text)
        raw = notebook["cells"] if "cells" in notebook else notebook["worksheets"][0]["cells"]
        codes = [cell for cell in raw if cell.get("cell_type") == "code"]
        return [
            Cell("".join(cell.get("source", cell.get("input", ""))), str(cell.get("id", "")).endswith(SHOWING))
            for cell in codes
        ]
    except (ValueError, KeyError, TypeError, AttributeError, IndexError):
        raise InputError(f"{path} is not a notebook: its JSON cannot be read.") from None


def defined(submission: Submission) -> set[str]:
    """Return the names that a submission defines or assigns at its top level, without running it."""
    names = set()
    for file in submission.files:
        try:
            parts = [statement for cell in cells(file) for statement, _ in statements(cell.code)]
        except InputError:
            continue
        for node in parts:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                names.add(node.name)
            elif isinstance(node, ast.Assign):
                names |= {target.id for target in node.targets if isinstance(target, ast.Name)}
    return names


def statements(cell: str) -> Iterator[tuple[ast.stmt | None, str]]:
    """Yield the statements of a cell; where it cannot be parsed, those of its pieces, and why a piece cannot."""
    if cell.lstrip().startswith("%%") and not re.match(r"\s*%%(time|timeit|capture)\b", cell):
        return
    tree, why = _parsed(cell)  # a line may begin with the != or the % of a formula: magics are what Python is not
    lines = cell.splitlines()
    if tree is None:
        lines = ["pass" if MAGIC.match(line) and not _continued(line) else line for line in lines]
        tree, why = _parsed("\n".join(lines))
    if tree is not None:
        yield from ((node, "") for node in tree.body)
        return
    for first, piece in _pieces(lines):
        tree, why = _parsed("\n" * first + "\n".join(piece))
        if tree is None:
            yield None, why
        else:
            yield from ((node, "") for node in tree.body)


def _continued(line: str) -> bool:
    """Whether a line that looks like a magic belongs to a formula that goes on: one with % or !=."""
    return bool(re.match(r"^\s+(%\s|!=)", line))


def _parsed(text: str) -> tuple[ast.Module | None, str]:
    try:
        return ast.parse(text), ""
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        line = f", line {error.lineno}" if isinstance(error, SyntaxError) and error.lineno else ""
        names = re.findall(r"^\s*(?:def|class)\s+(\w+)", text, re.MULTILINE)
        inside = f" (in {', '.join(names)})" if names else ""
        return None, f"{type(error).__name__}{line}: {getattr(error, 'msg', error)}{inside}"


def _pieces(lines: list[str]) -> Iterator[tuple[int, list[str]]]:
    """Cut a text where a new statement begins at the left margin."""
    start = 0
    for i, line in enumerate(lines):
        begins = bool(line) and not line[0].isspace() and line[0] not in ")]}#"
        after_decorator = i > start and lines[i - 1].startswith("@")
        goes_on = re.match(r"(else|elif|except|finally)\b", line)
        if begins and i > start and not after_decorator and not goes_on:
            yield start, lines[start:i]
            start = i
    yield start, lines[start:]


def load(submission: Submission, skipped: Collection[str] = ()) -> Loaded:
    """Run the statements of a submission, each on its own, but for those that are known to hang.

    Called in a child process: what is handed in may do anything.
    """
    module = types.ModuleType(MODULE)
    sys.modules[MODULE] = module  # dataclasses look their module up there
    loaded = Loaded(module.__dict__)
    left = SUBMISSION_SECONDS
    for file in submission.files:
        sys.path.append(str(file.parent.resolve()))
        module.__dict__["__file__"] = str(file.resolve())
        try:
            read = cells(file)
        except InputError as error:
            loaded.faults.append(str(error))
            continue
        for number, cell in enumerate(read, 1):
            for node, why in statements(cell.code):
                where = f"{file.name}, cell {number}" if file.suffix == ".ipynb" else file.name
                if node is None:
                    loaded.faults.append(f"{where}: {why}")
                elif isinstance(node, DEFINING) or not (cell.shows or _only_shows(node, loaded.scope)):
                    place = f"{where}, line {node.lineno}"
                    if place not in skipped:
                        left -= _run(node, place, loaded, min(left, STATEMENT_SECONDS))
    return loaded


def _only_shows(node: ast.stmt, scope: dict[str, Any]) -> bool:
    """Whether no function can depend on a statement: a bare expression, an assertion, a check, a demonstration.

    The last two take seconds each, and every child would wait for all of them.
    """
    if isinstance(node, ast.Expr | ast.Assert):
        return True
    called = [node.value] if isinstance(node, ast.Assign) else []
    called += [item.context_expr for item in node.items] if isinstance(node, ast.With) else []
    for call in called:
        name = call.func.id if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) else ""
        module = getattr(scope.get(name), "__module__", None)
        if name in SHOWN and isinstance(module, str) and module.startswith(SHOWN[name]):
            return True
    return False


def _run(node: ast.stmt, where: str, loaded: Loaded, seconds: float) -> float:
    """Run one statement; return how many seconds it took."""
    import time

    if seconds <= 0 and not isinstance(node, DEFINING):
        return 0.0
    code = compile(ast.Module([node], []), where, "exec", dont_inherit=True)
    start = time.monotonic()
    made = guard.call(lambda: exec(code, loaded.scope), (), seconds=max(seconds, 1.0))
    if made.error is not None:
        loaded.faults.append(f"{where}: {guard.describe(made.error, 0, seconds)}")
        if isinstance(made.error, guard.TimeUp):
            loaded.hung.add(where)
    elif isinstance(node, ast.FunctionDef):
        loaded.own[node.name] = loaded.scope.get(node.name)
    return time.monotonic() - start
