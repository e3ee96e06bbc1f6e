"""A comparison that survives its end: every finished unit is written down, and what is left goes on from there.

Question answered: what remains after Ctrl-C, a kill or a power cut, and how does the work continue?  Beside the result
that a folder may hold already, `unfinished/` keeps

    config.json      what was asked for, and the versions that compute it
    finished.lines   one line per finished unit: metrics, and what is kept over time

A line that is half written or damaged counts as none (see `lab.ledger`), and the next begins a new one whatever was
there.  A unit's seed depends on nothing but the unit, so the result of a comparison that was stopped ten
times equals that of one that never was, but for the seconds.
Called by the command line; in Python, `resumable` goes into the `execute` of `lab.compare.compare`.
"""

import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.comparison import Comparison, Record, Unit
from lab.execution import Execute
from lab.ledger import line_of, record_of
from lab.records.files import TEMPORARY, atomic_path, exclusive
from lab.result import Filtered
from lab.units import Batch
from lab.validation import InputError

if TYPE_CHECKING:
    import pandas as pd

FOLDER = "unfinished"
CONFIG = "config.json"
FINISHED = "finished.lines"
NUMERIC_VERSIONS = ("toy-slam-lab", "numpy", "scipy", "filterpy", "numba")  # others change no number


class Unfinished:
    """The finished units of a comparison under way, in a folder of their own inside the result's.

    Parameters
    ----------
    folder : Path
        Where the result goes; `unfinished/` is made inside by `begun`.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder / FOLDER

    @property
    def config(self) -> dict[str, Any] | None:
        """What the comparison under way was asked for; None when there is none.

        Raises
        ------
        InputError
            The folder holds something else under that name.
        """
        try:
            config = json.loads((self.folder / CONFIG).read_text(encoding="utf-8"))
            ours = all(isinstance(config[part], dict) for part in ("arguments", "inputs", "versions"))
        except (FileNotFoundError, NotADirectoryError):
            if os.path.isdir(self.folder) and any(self.folder.iterdir()):
                raise InputError(
                    f"{self.folder} holds no {CONFIG} and so is not ours; choose another folder."
                ) from None
            return None
        except OSError as error:
            raise self._unusable(error) from None
        except (ValueError, KeyError, TypeError):
            ours = False
        if not ours:
            raise InputError(f"{self.folder / CONFIG} is not ours, or damaged; choose another folder.")
        return config  # type: ignore[no-any-return]

    @contextmanager
    def begun(self, config: dict[str, Any]) -> Iterator[None]:
        """Make the folder, or go on in the one that is there; when the block ends and nothing is finished, remove it.

        Raises
        ------
        InputError
            The folder cannot be written to, another process is at work in it, or what is in it was begun with other
            arguments, inputs or versions.
        """
        made = [folder for folder in self.folder.parents if not os.path.exists(folder)]
        with ExitStack() as stack:
            stack.callback(_remove_empty, made)
            try:
                self.folder.parent.mkdir(parents=True, exist_ok=True)
                stack.enter_context(exclusive(self.folder.parent))
                earlier = self.config
                if earlier is not None:
                    _check_same(earlier, config, self.folder)
                stack.callback(self._remove_unused)
                self.folder.mkdir(exist_ok=True)
                with atomic_path(self.folder / CONFIG) as path:
                    path.write_text(json.dumps(config, indent=2) + "\n", encoding="utf-8")
            except OSError as error:
                raise self._unusable(error) from None
            yield

    def _remove_unused(self) -> None:
        others = {path.name for path in self.folder.glob("[!.]*")} - {CONFIG, FINISHED}  # which are not ours, and stay
        if not others and not self.finished():
            self.remove()

    def finished(self) -> dict[Unit, Record]:
        """Return the records kept so far; a line that cannot be read is as good as none."""
        records = {}
        try:
            lines = (self.folder / FINISHED).read_bytes().split(b"\n")
        except OSError:
            return {}
        for line in lines:
            try:
                record = record_of(line)
            except (ValueError, KeyError, TypeError):
                continue
            records[record.unit] = record
        return records

    def keep(self, record: Record) -> None:
        """Write one record down, unless its worker died: that is to be tried again.

        Raises
        ------
        InputError
            The file cannot be written to.
        """
        if record.died:
            return
        path = self.folder / FINISHED
        try:
            with open(path, "ab") as file:
                file.write(b"\n" + line_of(record))
        except OSError as error:
            raise InputError(f"{path} cannot be written: {error.strerror}.") from None

    def _unusable(self, error: OSError) -> InputError:
        return InputError(f"The folder {self.folder.parent} cannot be written to: {error.strerror}.")

    def remove(self) -> None:
        """Forget everything, once the result is written or nothing was finished."""
        with suppress(OSError):
            # at once under another name: a folder half removed would look like another program's
            doomed = Path(tempfile.mkdtemp(prefix=TEMPORARY, dir=self.folder.parent))
            with suppress(OSError):
                self.folder.rename(doomed / FOLDER)
            shutil.rmtree(doomed, ignore_errors=True)


def resumable(execute: Execute, unfinished: Unfinished) -> Execute:
    """Return a way to run units that takes those already finished from the folder, and keeps the others there.

    Parameters
    ----------
    execute : Execute
        For the units that are left.
    unfinished : Unfinished
        Begun.
    """

    def run(
        function: Callable[[Batch], list[Record]], items: Sequence[Batch], lost: Callable[[Batch, str], list[Record]]
    ) -> Iterator[list[Record]]:
        known = unfinished.finished()
        yield [known[unit] for batch in items for unit in batch if unit in known]
        left = [tuple(unit for unit in batch if unit not in known) for batch in items]
        for records in execute(function, [batch for batch in left if batch], lost):
            for record in records:
                unfinished.keep(record)
            yield records

    return run  # type: ignore[return-value]


def moments_table(comparison: Comparison) -> "pd.DataFrame":
    """Return one row per data set, solver, N, run and instant whose moments were kept, and per instant of the exact.

    Columns: data_set, solver ("exact" with N = 0 for the Kalman filter), n_particles, run, k, log_evidence, ess,
    survivors, mean (n values [m]) and cov (n x n values [m^2], row by row).
    """
    import pandas as pd

    tables = [
        _instants(exact, {"data_set": i, "solver": "exact", "n_particles": 0, "run": 0})
        for i, exact in enumerate(comparison.exacts)
    ]
    for record in comparison.records:
        if record.filtered is not None:
            unit = asdict(record.unit)
            unit.pop("seed")
            tables.append(_instants(record.filtered, {"data_set": unit.pop("data_set"), **unit}))
    return pd.concat(tables, ignore_index=True)


def _instants(filtered: Filtered, unit: dict[str, Any]) -> "pd.DataFrame":
    import pandas as pd

    none = np.full(len(filtered.means), np.nan)
    return pd.DataFrame(
        {
            **unit,
            "k": np.arange(len(filtered.means)),
            "log_evidence": filtered.log_evidence,
            "ess": none if filtered.ess is None else filtered.ess,
            "survivors": none if filtered.survivors is None else filtered.survivors,
            "mean": list(filtered.means),
            "cov": [cov.ravel() for cov in filtered.covs],
        }
    )


def _remove_empty(folders: Iterable[Path]) -> None:
    for folder in folders:
        with suppress(OSError):  # not empty
            folder.rmdir()


def _check_same(earlier: dict[str, Any], config: dict[str, Any], folder: Path) -> None:
    for name in sorted({*earlier["arguments"], *config["arguments"]} - {"experiment"}):  # files count by contents
        before, now = earlier["arguments"].get(name), config["arguments"].get(name)
        if before != now:
            raise InputError(f"{folder} was begun with --{name} {before}, not {now}; give the same, or leave it out.")
    for what in sorted({*earlier["inputs"], *config["inputs"]}):
        before, now = (each["inputs"].get(what, {}) for each in (earlier, config))
        if before.get("sha256") != now.get("sha256"):
            file = now.get("file") or before.get("file")
            raise InputError(f"{file} is not the file with which {folder} was begun: the results would not fit.")
    for name in NUMERIC_VERSIONS:
        before, now = earlier["versions"].get(name), config["versions"].get(name)
        if before != now:
            raise InputError(f"{folder} was begun with {name} {before}, and this is {now}: the results would not fit.")
