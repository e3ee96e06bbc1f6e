"""Marked regions of a cell: what is a solution, a hidden test, a mark scheme, and what is left without them.

Question answered: which lines of a cell are the instructors' own?  A region lies between two marker lines,

    ### BEGIN SOLUTION            ### END SOLUTION             in cells with solution: true
    ### BEGIN HIDDEN TESTS        ### END HIDDEN TESTS         in cells with grade: true
    === BEGIN MARK SCHEME ===     === END MARK SCHEME ===      in cells with task: true

nbgrader is lenient with what it finds (an END without a BEGIN, a word more in the line), and a lenient reading is how a
solution gets out: whatever looks like a marker must be one, and the markers must pair.
Source: nbgrader's preprocessors ClearSolutions, ClearHiddenTests and ClearMarkScheme.
"""

import re
from collections.abc import Mapping

from lab.validation import InputError

SOLUTION, HIDDEN_TESTS, MARK_SCHEME = "SOLUTION", "HIDDEN TESTS", "MARK SCHEME"
MARKERS = {
    **{f"### {end} {kind}": (end, kind) for kind in (SOLUTION, HIDDEN_TESTS) for end in ("BEGIN", "END")},
    **{f"=== {end} {MARK_SCHEME} ===": (end, MARK_SCHEME) for end in ("BEGIN", "END")},
}
LOOKS_LIKE_ONE = re.compile(r"\b(begin|end)[\W_]*(solution|hidden[\W_]*test|mark(ing)?[\W_]*scheme)", re.IGNORECASE)


def regions(source: str, where: str) -> dict[str, list[str]]:
    """Return the text of every region of a cell, by kind.

    Parameters
    ----------
    source : str
        Of the cell.
    where : str
        Notebook and cell, for the message.

    Returns
    -------
    dict of str to list of str
        Kinds without a region are left out; marker lines belong to no region.

    Raises
    ------
    InputError
        A marker is misspelled, nested, or without its other end.
    """
    found: dict[str, list[str]] = {}
    kind = ""
    for number, line in enumerate(source.split("\n"), start=1):
        end, named = _marker(line, number, where)
        if end == "BEGIN":
            if kind:
                raise InputError(f"{where}: line {number} begins {_a(named)} inside {_a(kind)}.")
            kind = named
            found.setdefault(kind, []).append("")
        elif end == "END":
            if kind != named:
                raise InputError(f"{where}: line {number} ends {_a(named)} that was not begun.")
            kind = ""
        elif kind:
            found[kind][-1] += f"{line}\n"
    if kind:
        raise InputError(f"{where}: {_a(kind)} is begun and not ended.")
    return found


def cleared(source: str, stubs: Mapping[str, str], where: str) -> str:
    """Return the source with a stub, or nothing, in the place of every region.

    Parameters
    ----------
    source : str
    stubs : mapping of str to str
        By kind: what stands there instead, indented as the marker was; a kind that is missing leaves no line.
    where : str
        As in `regions`.

    Raises
    ------
    InputError
        As `regions`.
    """
    regions(source, where)
    lines: list[str] = []
    inside = False
    for number, line in enumerate(source.split("\n"), start=1):
        end, kind = _marker(line, number, where)
        if end == "BEGIN":
            indent = line[: len(line) - len(line.lstrip())]
            lines += [indent + stub for stub in stubs[kind].split("\n")] if kind in stubs else []
        elif not end and not inside:
            lines.append(line)
        inside = end == "BEGIN" or (inside and end != "END")
    return "\n".join(lines)


def _marker(line: str, number: int, where: str) -> tuple[str, str]:
    """Return which end of which kind the line marks, or two empty strings."""
    if line.strip() in MARKERS:
        return MARKERS[line.strip()]
    if LOOKS_LIKE_ONE.search(line):
        raise InputError(f"{where}: line {number} looks like a marker and is none: {line.strip()!r}.")
    return "", ""


def _a(kind: str) -> str:
    return f"a region {kind!r}"
