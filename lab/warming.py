"""Kernels made ready before anybody waits for them.

Question answered: what happens at the very first run on a machine?  The compiled loop is translated, which takes a
quarter of a minute.  Its parts are translated by another process meanwhile, which leaves them on disk; so it takes half
of that.  Called by `lab.compare`.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress

from lab import fast
from lab.solvers import compiled


@contextmanager
def warming(schemes: Sequence[str], jobs: int) -> Iterator[Callable[[], None]]:
    """Have another process begin, if there is anything to compile and `jobs` allows it; what this yields does the rest.

    Parameters
    ----------
    schemes : sequence of str
        Of resampling, for which the kernels will be needed.
    jobs : int
        -1 for one per processor.

    Yields
    ------
    function
        Compiles the loop, waits for the other process, and loads the kernels; the other process ends then, or at the
        end of the block.
    """
    with ExitStack() as stack:
        parts = None
        if jobs != 1 and compiled.is_cold(schemes):
            import cloudpickle

            from lab.workers import Crew  # brings loky

            crew = stack.enter_context(Crew())
            crew.instruct(cloudpickle.dumps(_compile_parts))
            parts = crew.call(1).workers[0].submit(schemes)

        def warm() -> None:
            if parts is not None:
                compiled.compile_loop()
                with suppress(Exception):  # whatever befell that process: what it did not leave is compiled here
                    parts.result()
                stack.close()
            for scheme in schemes:
                compiled.warm(scheme)

        yield warm


def _compile_parts(schemes: Sequence[str]) -> None:
    kernels = fast.load()
    if kernels is not None:
        kernels.compile_parts(schemes)
