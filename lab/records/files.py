"""Reading and writing without surprises.

A file is written under a temporary name beside the real one and renamed when all is there; a file that cannot be read
is one sentence, whatever its damage makes a reader raise.
"""

import gzip
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from lab.validation import InputError


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Turn what reading this file raises into one sentence that names it.

    Raises
    ------
    InputError
        The file is missing, a folder, cannot be opened, or is damaged.
    """
    if not path.is_file():
        raise InputError(f"{path} is a folder, not a file." if path.is_dir() else f"{path} does not exist.")
    try:
        yield
    except InputError:
        raise
    except (EOFError, gzip.BadGzipFile) as error:
        what = "is cut short" if isinstance(error, EOFError) else "is not compressed as its name says"
        if path.suffix != ".gz":
            what = f"is damaged, or not a {path.suffix} file ({type(error).__name__})"
        raise InputError(f"{path} {what}.") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from None
    except Exception as error:  # on damaged bytes the readers raise anything: zlib.error, TokenError, ValueError...
        raise InputError(f"{path} is damaged, or not a {path.suffix} file ({type(error).__name__}).") from None


TEMPORARY = ".partial-"  # how the names of folders begin that nobody needs once their process has ended


@contextmanager
def exclusive(folder: Path) -> Iterator[None]:
    """Keep other processes out of a folder while the block runs; a kill ends that, too.

    Raises
    ------
    InputError
        Another process has it.
    """
    path = folder / ".lock"
    with path.open("w") as file:
        try:
            _lock(file.fileno())
        except (BlockingIOError, PermissionError):
            raise InputError(
                f"Another process is at work in {folder}; wait for it, or choose another folder."
            ) from None
        except OSError:
            pass  # a file system without locks
        try:
            yield
        finally:
            with suppress(OSError):
                path.unlink()


def _lock(descriptor: int) -> None:
    if sys.platform == "win32":
        import msvcrt

        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
    else:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """Give a temporary path with the same ending; rename it to `path` when the block ends well, else remove it.

    Parameters
    ----------
    path : path
        The real name; an existing file is replaced, and not before the new one is whole.

    Raises
    ------
    InputError
        The folder is missing or cannot be written to.
    """
    path = Path(path)
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=path.suffix, dir=path.parent)
        os.close(handle)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}.") from None
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o666 & ~_umask())  # mkstemp's files are private, a result is not
        temporary.replace(path)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}.") from None
    finally:
        temporary.unlink(missing_ok=True)


def _umask() -> int:
    current = os.umask(0)
    os.umask(current)
    return current
