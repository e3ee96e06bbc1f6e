"""The units of a comparison on an existing Dask cluster, through joblib's dask backend.

Question answered: what if one machine is not enough?  The cluster's scheduler places the units, and runs one again
elsewhere when its worker goes; a unit that several workers died of is reported as lost, and the rest goes on.  There
is no scheduler of our own.  Needs the extra toy-slam-lab[cluster] here, and this package on every worker.
Called by `lab.sweep`.  Source: joblib's manual, "Using Dask for single-machine parallel computing" and below.
"""

import logging
import re
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from functools import partial
from importlib.metadata import version
from typing import Any

import joblib

import lab
from lab.errors import ClusterError
from lab.execution import DIED, Execute, Item, Result
from lab.validation import InputError

ADDRESS = r"(\w+://)?[^/\s]+:\d+"
CONNECTING = 10.0  # seconds


@contextmanager
def connect(address: str, packages: Sequence[str] = ()) -> Iterator[Execute]:
    """Connect to a cluster and give the way to run units on it.

    Parameters
    ----------
    address : str
        Of the scheduler, such as tcp://host:8786.
    packages : sequence of str
        Beside this one, what numbers depend on: workers must have the same versions.

    Raises
    ------
    InputError
        The extra is not installed, the address is none, nothing answers there, or the workers lack a package or have
        another version of it.
    ClusterError
        The connection is lost inside the block.
    """
    try:
        from distributed import Client
    except ModuleNotFoundError:
        raise InputError("A Dask cluster needs the extra packages: pip install toy-slam-lab[cluster].") from None
    if not re.fullmatch(ADDRESS, address):
        raise InputError(f"A Dask scheduler has an address such as tcp://host:8786, not {address!r}.")
    with _silent("distributed", "distributed.client"):  # what matters is said in the errors
        yield from _connected(Client, address, packages)


def _connected(Client: Any, address: str, packages: Sequence[str]) -> Iterator[Execute]:
    try:
        client: Any = Client(address, timeout=CONNECTING, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(f"No Dask scheduler answers at {address}: {_first_line(error)}.") from None
    try:
        _check_workers(client, address, {"toy-slam-lab": lab.__version__, **{name: version(name) for name in packages}})
        yield partial(_run, client=client, address=address)
    finally:
        client.close(timeout=CONNECTING)


@contextmanager
def _silent(*names: str) -> Iterator[None]:
    """Let these loggers say nothing while the block runs."""
    levels = {name: logging.getLogger(name).level for name in names}
    try:
        for name in names:
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
        yield
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)


def _check_workers(client: Any, address: str, needed: dict[str, str]) -> None:
    for package, wanted in needed.items():
        answers = client.run(version, package, on_error="return")
        if not answers:
            raise InputError(f"The Dask cluster at {address} has no workers.")
        for name, answer in answers.items():
            if str(answer) != wanted:
                raise InputError(f"The Dask worker {name} needs {package} {wanted}; it answers: {answer}.")


def _run(
    function: Callable[[Item], Result],
    items: Sequence[Item],
    lost: Callable[[Item, str], Result],
    *,
    client: Any,
    address: str,
) -> Iterator[Result]:
    """Yield results in the order in which they end; see `lab.execution`."""
    try:
        with joblib.parallel_config(backend=_backend(client, lost), n_jobs=-1):
            # the function is bound, not an argument: joblib would place it on one worker, and lose it there
            yield from joblib.Parallel(return_as="generator_unordered", batch_size=1)(
                joblib.delayed(partial(_apply, _share(function, item)))(item) for item in items
            )
    except (CancelledError, OSError) as error:
        reason = "" if isinstance(error, CancelledError) else f" ({_first_line(error)})"
        raise ClusterError(f"the Dask cluster at {address} went away{reason}") from None


def _share(function: Callable[[Item], Result], item: Item) -> Callable[[Item], Result]:
    """Return what of the function one item needs, where the function can tell: it travels with each item."""
    return function.only(item) if hasattr(function, "only") else function


def _apply(function: Callable[[Item], Result], item: Item) -> Result:
    return function(item)


def _backend(client: Any, lost: Callable[[Any, str], Any]) -> Any:
    """Return joblib's backend, mended: of a task that killed its workers it tells nobody, and waits for ever."""
    import asyncio

    from distributed.scheduler import KilledWorker
    from joblib._dask import DaskDistributedBackend

    class Backend(DaskDistributedBackend):  # type: ignore[misc]
        def submit(self, func: Any, callback: Any = None) -> Any:
            """Submit a batch, whose end is told either way."""

            def ended(out: Any) -> None:
                if isinstance(out, Exception) and not isinstance(out, CancelledError):  # as when the scheduler goes
                    reason = DIED if isinstance(out, KilledWorker) else f"Dask: {_first_line(out)}"
                    out = [lost(arguments[0], reason) for _, arguments, _ in func.items]
                callback(out)

            return super().submit(func, ended)

        async def _collect(self) -> None:
            while self._continue:
                async for future, result in self.waiting_futures:
                    told, callback = self._results.pop(future), self._callbacks.pop(future)
                    out = result[1] if future.status == "error" else result
                    told.set_result(out)
                    callback(out)
                await asyncio.sleep(0.01)

    return Backend(client=client)


def _first_line(error: BaseException) -> str:
    return (str(error) or type(error).__name__).splitlines()[0].rstrip(".")
