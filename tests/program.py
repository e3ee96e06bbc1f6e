"""The command line as a person meets it: called in this process, or as a process of its own."""

import contextlib
import io
import signal
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

from lab.cli import main


class Done(NamedTuple):
    status: int
    out: str
    err: str

    def assert_refused(self, *words: str, status: int = 2) -> None:
        """One sentence on standard error, nothing on standard output."""
        assert self.status == status, self
        assert self.out == ""
        assert self.err.startswith("slam-lab: ")
        assert self.err.endswith(".\n")
        assert self.err.count("\n") == 1
        assert not set("│╭╰") & set(self.err)
        for word in words:
            assert word in self.err


def call(*arguments: object) -> Done:
    """Call `main` in this process."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main([str(argument) for argument in arguments])
        except SystemExit as leaving:
            status = leaving.code
        else:
            raise AssertionError("main returned instead of leaving")
    assert isinstance(status, int)
    return Done(status, out.getvalue(), err.getvalue())


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "lab", *map(str, arguments)]


def start(*arguments: object, cwd: Path, **options: object) -> Done:
    """Run the program as a process of its own, in a folder of its own."""
    done = subprocess.run(command(*arguments), cwd=cwd, capture_output=True, text=True, timeout=100, **options)
    return Done(done.returncode, done.stdout, done.stderr)


def interruptible():
    """Undo what a job in the background inherits: interrupts are ignored there, and the program respects that."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def everything_in(folder: Path) -> dict[str, bytes]:
    """Return what is in a folder and below, hidden files included."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
