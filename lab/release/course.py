"""The course on disk: which files belong to the students' folder, and whether it is in step with the instructors'.

Question answered: what does ``notebooks/`` hold, given ``solutions/``?  A student copy of every notebook, and the
pictures of expected results, which ``make solutions`` takes from the executed solutions.
"""

from dataclasses import dataclass
from pathlib import Path

import lab
from lab.release.student import Mark, as_text, marks, read_notebook, student_copy
from lab.validation import InputError

SOLUTIONS, NOTEBOOKS, EXPECTED = "solutions", "notebooks", "expected"


@dataclass(frozen=True)
class Course:
    """A checkout, by its folder."""

    root: Path

    @property
    def solutions(self) -> list[Path]:
        """The instructors' notebooks, in their order.

        Raises
        ------
        InputError
            There are none.
        """
        found = sorted((self.root / SOLUTIONS).glob("*.ipynb"))
        if not found:
            raise InputError(f"{self.root / SOLUTIONS} holds no notebook.")
        return found

    def marks(self) -> list[Mark]:
        """Return the points of all notebooks."""
        return [mark for path in self.solutions for mark in marks(read_notebook(path), path.stem)]

    def derived(self) -> dict[str, bytes]:
        """Return what ``notebooks/`` must hold, by path inside it.

        Raises
        ------
        InputError
            A notebook cannot be released; the message names it and the cell.
        """
        files = {path.name: as_text(student_copy(read_notebook(path), path.name)).encode() for path in self.solutions}
        for picture in sorted((self.root / SOLUTIONS / EXPECTED).glob("*.png")):
            files[f"{EXPECTED}/{picture.name}"] = picture.read_bytes()
        return files

    def faults(self) -> list[str]:
        """Return one sentence for each file of ``notebooks/`` that is not what `derived` says; empty when all are."""
        derived, found = self.derived(), []
        for name, content in derived.items():
            path = self.root / NOTEBOOKS / name
            if not path.is_file():
                found.append(f"{NOTEBOOKS}/{name} is missing.")
            elif path.read_bytes().replace(b"\r\n", b"\n") != content.replace(b"\r\n", b"\n"):  # a checkout on Windows
                found.append(f"{NOTEBOOKS}/{name} is not what {SOLUTIONS}/{name} gives.")
        found += [f"{NOTEBOOKS}/{name} comes from nothing in {SOLUTIONS}/." for name in self._present() - set(derived)]
        return sorted(found)

    def write(self) -> list[str]:
        """Write ``notebooks/``, take out what comes from nothing any more, and return the names that changed."""
        derived, changed = self.derived(), []
        for name, content in derived.items():
            path = self.root / NOTEBOOKS / name
            if not path.is_file() or path.read_bytes() != content:
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
                changed.append(name)
        for name in self._present() - set(derived):
            (self.root / NOTEBOOKS / name).unlink()
            changed.append(name)
        return sorted(changed)

    def _present(self) -> set[str]:
        folder = self.root / NOTEBOOKS
        files = [*folder.glob("*.ipynb"), *(folder / EXPECTED).glob("*.png")]
        return {path.relative_to(folder).as_posix() for path in files}


def find_course(start: Path | None = None) -> Course:
    """Return the course of the folder given, else of the current one or the nearest above it, else of this package.

    Raises
    ------
    InputError
        None of them has a folder ``solutions``.
    """
    here = Path.cwd()
    candidates = [start] if start else [here, *here.parents, Path(lab.__file__).resolve().parents[1]]
    for folder in candidates:
        if any((folder / SOLUTIONS).glob("*.ipynb")):
            return Course(folder)
    raise InputError(f"There is no folder {SOLUTIONS} with notebooks in {candidates[0]}: run this in the checkout.")
