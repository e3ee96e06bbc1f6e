"""Right functions in place of a person's own that are missing or wrong, while the others are judged.

Question answered: how is the filter of question 6 graded for somebody whose effective sample size is wrong?  With the
right one under its name.  Calls from here on do not count as leaving the answer to the laboratory, but for an answer
that calls the right one of its own question.
"""

from collections.abc import Callable
from typing import Any

from lab.checks import reference


def stand_in(name: str) -> Callable[..., Any]:
    """Return a right function for a name of the table."""
    getattr(reference, name)  # now, and not at the first call, if there is none

    def stand_in_call(*args: Any, **options: Any) -> Any:
        return getattr(reference, name)(*args, **options)  # lab.checks.guard reads this name

    stand_in_call.__name__ = stand_in_call.__qualname__ = name
    stand_in_call.__module__ = "lab.given"  # where it is to be had
    return stand_in_call
