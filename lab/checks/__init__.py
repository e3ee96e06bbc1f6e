"""Checks of answers to the questions of the course: ``check("q5", effective_sample_size)`` returns a `Verdict`.

The same checks serve the notebooks, the tests and the grader ``slam-lab check``.
"""

from lab.checks.examination import check
from lab.checks.questions import QUESTIONS, Question, question_named
from lab.checks.verdict import Verdict

__all__ = ["QUESTIONS", "Question", "Verdict", "check", "question_named"]
