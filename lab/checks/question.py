"""What a question of the course is, as data: the rows of `lab.checks.questions` and `lab.checks.ekf_questions`."""

from dataclasses import dataclass

CODE, TEXT = "code", "text"


@dataclass(frozen=True)
class Value:
    """An argument or a result: its name, its shape, and what it is, with its unit."""

    name: str
    shape: str
    meaning: str


@dataclass(frozen=True)
class Question:
    """One question of the course.

    Attributes
    ----------
    key : str
        Such as "q1d-step"; also the identity of its cells in the notebooks.
    kind : str
        "code" or "text".
    points : int
    notebook : str
        Name of the notebook, without its ending.
    title : str
        What is asked, in a line.
    function : str
        Name under which the answer is looked for; empty for a text.
    call : str
        How the function is called.
    arguments, returns : tuple of Value
    freedom : str
        What is left to the person who answers.
    """

    key: str
    kind: str
    points: int
    notebook: str
    title: str
    function: str = ""
    call: str = ""
    arguments: tuple[Value, ...] = ()
    returns: tuple[Value, ...] = ()
    freedom: str = ""
