"""The laboratory's own answers to earlier questions, for answers that build on them: ``from lab.given import moments``.

Question answered: how does a notebook use what an earlier one asked for without depending on it?  Every
function of the table of questions can be imported from here; a call to it does not count as leaving one's own answer
to the laboratory, and it is no answer to its own question either.
"""

from collections.abc import Callable
from typing import Any

from lab.checks import QUESTIONS
from lab.checks.stand_ins import stand_in


def __getattr__(name: str) -> Callable[..., Any]:
    """Return the function of this name in the table of questions.

    Raises
    ------
    AttributeError
        No question asks for it.
    """
    if not any(question.function == name for question in QUESTIONS if question.function):
        raise AttributeError(f"no question asks for a function named {name!r}")
    return stand_in(name)
