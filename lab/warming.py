"""Kernels made ready before anybody waits for them.

Question answered: what happens at the very first run on a machine?  The compiled loop is translated, which takes a
quarter of a minute.  Its parts are translated by another process meanwhile, which leaves them on disk; so it takes
little more than half of that.  Called by `lab.compare`.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress

import cloudpickle

from lab import fast
from lab.solvers import compiled
from lab.workers import Crew


@contextmanager
def warming(load: Callable[[], None], jobs: int) -> Iterator[Callable[[], None]]:
    """Have another process begin, if there is anything to compile and `jobs` allows it; what this yields does the rest.

    Parameters
    ----------
    load : function
        Loads the kernels that will be needed, compiling what is not on disk.
    jobs : int
        -1 for one per processor.

    Yields
    ------
    function
        Compiles the loop, waits for the other process, which is ended then or with the block, and calls `load`.
    """
    if jobs == 1 or not compiled.is_cold():
        yield load
        return
    with ExitStack() as stack:
        crew = stack.enter_context(Crew())
        crew.instruct(cloudpickle.dumps(_compile_parts))
        parts = crew.call(1).workers[0].submit(None)

        def warm() -> None:
            compiled.compile_loop()
            with suppress(Exception):  # whatever befell that process: what it did not leave is compiled here
                parts.result()
            stack.close()
            load()

        yield warm


def _compile_parts(_: None) -> None:
    kernels = fast.load()
    if kernels is not None:
        kernels.compile_parts()
