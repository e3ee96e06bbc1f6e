"""Right functions in place of a person's own that are missing or wrong, while the others are judged.

Question answered: how is the filter of question 6 graded for somebody whose effective sample size is wrong?  With the
right one under its name.  Calls from here on do not count as leaving the answer to the laboratory.
"""

from collections.abc import Callable
from typing import Any

from lab.checks import reference


def stand_in(name: str) -> Callable[..., Any]:
    """Return a right function for a name of the table."""
    right = getattr(reference, name)

    def stand_in_call(*args: Any, **options: Any) -> Any:
        return right(*args, **options)

    stand_in_call.__name__ = name
    return stand_in_call
