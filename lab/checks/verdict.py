"""What a check says: passed or not, why, and a hint.

Question answered: how is a person told?  The same `Verdict` is printed on a terminal, shown in a notebook, and written
by the grader.  A verdict that passes says "public checks passed (3/3)" and never "correct": other data may tell more.
"""

import html
import textwrap
from dataclasses import dataclass

WIDTH = 100  # characters of a line on a terminal
LOOKS = {  # sign and colour in a notebook
    "passed": ("&#10003;", "#2e7d32"),
    "not passed": ("&#10007;", "#b23c17"),
    "not answered yet": ("&#8943;", "#777777"),
}


@dataclass(frozen=True)
class Verdict:
    """The outcome of one check.

    Attributes
    ----------
    question : str
        Key of the question.
    passed : bool
    reason : str
        What was found, in a sentence or two.
    hint : str
        Where to look, without the answer; advice when the check has passed; may be empty.
    mistake : str
        Key of the named mistake, or of several that cannot be told apart, separated by spaces; empty when none.
    notes : tuple of str
        What to know about the check itself, such as a limit that this platform does not have.
    answered : bool
        Whether there was an answer at all.
    """

    question: str
    passed: bool
    reason: str
    hint: str = ""
    mistake: str = ""
    notes: tuple[str, ...] = ()
    answered: bool = True

    @property
    def status(self) -> str:
        """One word or three: passed, not passed, not answered yet."""
        return "passed" if self.passed else "not passed" if self.answered else "not answered yet"

    def __str__(self) -> str:
        """Return plain lines for a terminal."""
        mark = "[+]" if self.passed else "[x]" if self.answered else "[ ]"
        lines = [f"{mark} {self.question} {self.status}: {self.reason}"]
        if self.hint:
            lines.append(f"    {self._label}: {self.hint}")
        lines += [f"    Note: {note}" for note in self.notes]
        return "\n".join(textwrap.fill(line, WIDTH, subsequent_indent="    ") for line in lines)

    def __repr__(self) -> str:
        """Return what a terminal or a plain notebook shows for the last line of a cell."""
        return str(self)

    def _repr_html_(self) -> str:
        """Return what a notebook shows: a sign and words beside the colour, so that nothing hangs on colour alone."""
        sign, edge = LOOKS[self.status]
        text = f"<strong>{sign} {html.escape(self.question)} {self.status}.</strong> {html.escape(self.reason)}"
        if self.hint:
            text += f"<br><em>{self._label}:</em> {html.escape(self.hint)}"
        for note in self.notes:
            text += f"<br><small>Note: {html.escape(note)}</small>"
        style = f"border-left: 0.4em solid {edge}; padding: 0.4em 0.8em; margin: 0.3em 0; max-width: 60em"
        label = html.escape(f"Check of {self.question}: {self.status}", quote=True)
        return f'<div role="status" aria-label="{label}" style="{style}">{text}</div>'

    @property
    def _label(self) -> str:
        return "Advice" if self.passed else "Hint"
