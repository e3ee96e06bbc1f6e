"""The table of questions: one source, which the README of the solutions repeats."""

import inspect
import re
from pathlib import Path

import pytest

from lab.checks import QUESTIONS, check, question_named
from lab.checks.ekf_questions import EKF_QUESTIONS, NOTEBOOK
from lab.checks.questions import CODE, NOTEBOOKS, as_markdown
from lab.validation import InputError

README = Path(__file__).parents[1] / "solutions" / "README.md"
CODES = [question for question in QUESTIONS if question.kind == CODE]


def test_the_readme_repeats_the_table():
    assert as_markdown() in README.read_text(encoding="utf-8")


def test_keys_and_functions_are_unique_and_fit_a_notebook():
    keys = [question.key for question in QUESTIONS]
    functions = [question.function for question in CODES]
    assert len(set(keys)) == len(keys)
    assert len(set(functions)) == len(functions)
    assert all(re.fullmatch(r"q\d+[a-d]?(-[a-z]+)?", key) for key in keys)  # as nbgrader wants its grade_id


def test_every_question_of_the_handout_and_of_the_second_wing_has_its_place():
    asked = {re.match(r"q\d+[a-d]?", question.key)[0] for question in QUESTIONS}
    assert asked >= {
        "q1a",
        "q1b",
        "q1c",
        "q1d",
        "q2a",
        "q2b",
        "q2c",
        "q3",
        "q4a",
        "q4b",
        *(f"q{i}" for i in range(5, 17)),
    }
    assert {question.notebook for question in QUESTIONS} == set(NOTEBOOKS)
    assert {question.notebook for question in EKF_QUESTIONS} == {NOTEBOOK}
    points = {wing: sum(q.points for q in QUESTIONS if (q in EKF_QUESTIONS) == wing) for wing in (False, True)}
    assert points == {False: 100, True: 40}


@pytest.mark.parametrize("question", CODES, ids=lambda question: question.key)
def test_the_call_names_the_arguments(question):
    scope = {}
    exec(f"def {question.call}: pass", scope)
    parameters = inspect.signature(scope[question.function]).parameters
    assert list(parameters) == [value.name for value in question.arguments]
    assert question.returns


def test_an_unknown_key_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match="no question 'q77'; those with a check are q1d-step, q1d-filter"):
        check("q77", len)
    assert question_named("q5").function == "effective_sample_size"
