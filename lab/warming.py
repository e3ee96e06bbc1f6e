"""Kernels made ready before anybody waits for them.

Question answered: what happens at the very first run on a machine?  The compiled loop is translated, which takes a
quarter of a minute.  Its parts are translated by another process meanwhile, which leaves them on disk; so it takes
about half of that.  Called by `lab.compare`.
"""

from contextlib import suppress

import cloudpickle

from lab import fast
from lab.solvers import compiled
from lab.workers import Crew


def warm(jobs: int) -> None:
    """Load the kernels, or have them compiled, by two processes where `jobs` allows it.

    Parameters
    ----------
    jobs : int
        -1 for one per processor.
    """
    if jobs != 1 and compiled.is_cold():
        with Crew() as crew:
            crew.instruct(cloudpickle.dumps(_compile_parts))
            parts = crew.call(1).workers[0].submit(None)
            compiled.compile_loop()
            with suppress(Exception):  # whatever befell that process: what it did not leave is compiled here
                parts.result()
    compiled.warm()


def _compile_parts(_: None) -> None:
    kernels = fast.load()
    if kernels is not None:
        kernels.compile_parts()
