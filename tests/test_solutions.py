"""The solutions as they are committed: complete, executed, in step with the students' copies, and without a leak."""

import ast
import re
from pathlib import Path

import nbformat
import pytest

from lab.checks import QUESTIONS
from lab.plots.style import png_description
from lab.release import Course, as_text, marks, read_notebook, student_copy
from lab.release.execute import normalise

ROOT = Path(__file__).resolve().parents[1]
COURSE = Course(ROOT)
PATHS = sorted((ROOT / "solutions").glob("*.ipynb"))
CODE = [question for question in QUESTIONS if question.kind == "code"]
TEXT = [question for question in QUESTIONS if question.kind == "text"]
REGION = re.compile(r"^ *### BEGIN (SOLUTION|HIDDEN TESTS)$(.*?)^ *### END \1$", re.DOTALL | re.MULTILINE)
SCHEME = re.compile(r"^=== BEGIN MARK SCHEME ===$(.*?)^=== END MARK SCHEME ===$", re.DOTALL | re.MULTILINE)
TELLING = 14  # characters of a line below which it tells nothing, such as "return mean"

by_notebook = pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)


def load(path):
    return nbformat.read(path, as_version=4)


def cells(notebook):
    return {cell.id: cell for cell in notebook.cells}


def text_of(cell):
    """Return all that nbval compares of a cell's outputs, pictures left out."""
    parts = [str(output.get("text", "")) + str(output.get("data", {}).get("text/plain", "")) for output in cell.outputs]
    return "\n".join(parts)


def test_the_notebooks_are_those_of_the_table():
    assert [path.stem for path in PATHS] == list(dict.fromkeys(question.notebook for question in QUESTIONS))


def test_the_students_copies_are_in_step():
    assert COURSE.faults() == []


def test_every_question_has_its_points_in_its_notebook():
    found = [(mark.notebook, mark.question, mark.kind, mark.points) for mark in COURSE.marks()]
    wanted = [(question.notebook, question.key, question.kind, question.points) for question in QUESTIONS]
    assert sorted(found) == sorted(wanted)


@by_notebook
def test_a_solution_is_run_from_top_to_bottom_in_a_fresh_kernel(path):
    code = [cell for cell in load(path).cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    assert not [cell.id for cell in code for output in cell.outputs if output.output_type == "error"]
    assert not [cell.id for cell in code for output in cell.outputs if output.get("name") == "stderr"]


@by_notebook
def test_a_solution_is_stored_as_make_solutions_stores_it(path):
    notebook = read_notebook(path)
    assert len({cell.id for cell in notebook.cells}) == len(notebook.cells)
    assert not [cell.id for cell in notebook.cells if re.fullmatch(r"[0-9a-f]{8}(-[0-9a-f-]+)?", cell.id)]  # random
    normalise(notebook, path.name)
    assert path.read_text(encoding="utf-8") == as_text(notebook)


@by_notebook
def test_no_file_holds_a_path_or_a_colour_of_the_machine_it_was_made_on(path):
    for file in (path, ROOT / "notebooks" / path.name):
        text = file.read_text(encoding="utf-8")
        for pattern in (r"/home/", r"/tmp/", r"/root/", r"/work", r"[A-Z]:\\\\", r"\\u001b\["):
            assert not re.search(pattern, text), (file.name, pattern)


@pytest.mark.parametrize("question", CODE, ids=lambda question: question.key)
def test_a_question_in_code_has_all_its_parts(question):
    notebook = load(ROOT / "solutions" / f"{question.notebook}.ipynb")
    found, order = cells(notebook), [cell.id for cell in notebook.cells]
    parts = [f"{question.key}-{part}" for part in ("question", "answer", "test")]
    assert [name for name in order if name in parts] == parts
    asked = found[parts[0]].source
    assert f"`{question.call}`" in asked
    for value in (*question.arguments, *question.returns):
        assert f"| `{value.name}` | {value.shape} | {value.meaning} |" in asked
    assert "<details><summary>Hint</summary>" in asked
    tree = ast.parse(found[parts[1]].source)
    (function,) = [node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == question.function]
    assert f"{function.name}({ast.unparse(function.args)})" == question.call
    assert ast.get_docstring(function)
    (call,) = [line for line in found[parts[2]].source.splitlines() if "check(" in line]
    assert call == f'verdict = check("{question.key}", {question.function})'
    assert "assert verdict.passed, verdict.reason" in found[parts[2]].source


@pytest.mark.parametrize("question", CODE, ids=lambda question: question.key)
def test_a_question_in_code_has_compared_outputs_and_a_picture_to_expect(question):
    found = cells(load(ROOT / "solutions" / f"{question.notebook}.ipynb"))
    assert "passed" in text_of(found[f"{question.key}-test"])
    shown = found[f"{question.key}-show"]
    assert re.search(r"\d\.\d", text_of(shown)), "a number with fixed digits"
    picture = ROOT / "notebooks" / "expected" / f"{question.key}.png"
    description = png_description(picture.read_bytes())
    assert len(description) > 40
    (alt,) = re.findall(
        rf'<img alt="([^"]*)" src="expected/{question.key}.png"', found[f"{question.key}-question"].source
    )
    assert alt == description
    assert description in text_of(shown)


@pytest.mark.parametrize("question", TEXT, ids=lambda question: question.key)
def test_a_question_in_words_has_an_answer_and_a_mark_scheme_of_its_points(question):
    found = cells(load(ROOT / "solutions" / f"{question.notebook}.ipynb"))
    asked, answer = found[f"{question.key}-question"].source, found[f"{question.key}-answer"].source
    assert "<details><summary>Hint</summary>" in asked
    (scheme,) = SCHEME.findall(asked)
    assert "point" in scheme
    (_, written) = REGION.findall(answer)[0]
    assert len(written.split()) > 60


def test_the_mark_scheme_of_q1c_has_the_subtlety():
    (scheme,) = SCHEME.findall(cells(load(PATHS[0]))["q1c-question"].source)
    for words in ("visibility", "informative" if "informative" in scheme else "TRUE state", "14.1", "95.8"):
        assert words in scheme


@by_notebook
def test_every_picture_has_a_description(path):
    for folder in ("solutions", "notebooks"):
        for cell in load(ROOT / folder / path.name).cells:
            texts = [
                cell.source,
                *(str(output.get("data", {}).get("text/html", "")) for output in cell.get("outputs", [])),
            ]
            for tag in re.findall(r"<img [^>]*>", "\n".join(texts)):
                assert re.match(r'<img alt="[^"]{20,}"', tag), (cell.id, tag[:80])
            assert "image/png" not in str([output.get("data", {}).keys() for output in cell.get("outputs", [])])
            for file in re.findall(r'src="(expected/[^"]+)"', cell.source):
                assert (ROOT / folder / file).is_file(), file


def secrets(notebook):
    """Yield the lines that belong to instructors: inside regions, comments and trifles left out."""
    for cell in notebook.cells:
        pieces = [text for _, text in REGION.findall(cell.source)] + SCHEME.findall(cell.source)
        for piece in pieces:
            for line in piece.splitlines():
                line = line.strip()
                if len(line) >= TELLING and not line.startswith("#"):
                    yield cell.id, line


def test_no_line_of_a_solution_a_hidden_test_or_a_mark_scheme_is_in_any_students_notebook():
    public = "\n".join(cell.source for path in PATHS for cell in load(ROOT / "notebooks" / path.name).cells)
    lines = {line.strip() for line in public.splitlines()}
    leaks = [(path.stem, cell, line) for path in PATHS for cell, line in secrets(load(path)) if line in lines]
    assert not leaks
    for word in ("BEGIN SOLUTION", "HIDDEN TEST", "MARK SCHEME", "END SOLUTION"):
        assert word not in public
    assert len(list(secrets(load(PATHS[0])))) > 60  # that the search finds what is there to be found


@by_notebook
def test_a_students_copy_is_what_is_left_without_the_regions(path):
    """By substitution in the text, which is not how the release does it."""
    student = cells(load(ROOT / "notebooks" / path.name))
    for cell in load(path).cells:
        stub = (
            "YOUR ANSWER HERE" if cell.cell_type == "markdown" else "# YOUR CODE HERE\n    raise NotImplementedError()"
        )
        source = re.sub(r"\n=== BEGIN MARK SCHEME ===\n.*?\n=== END MARK SCHEME ===", "", cell.source, flags=re.DOTALL)
        source = re.sub(r"\n### BEGIN HIDDEN TESTS\n.*?\n### END HIDDEN TESTS", "", source, flags=re.DOTALL)
        source = re.sub(r"### BEGIN SOLUTION\n.*?\n *### END SOLUTION", lambda _: stub, source, flags=re.DOTALL)  # noqa: B023
        assert student[cell.id].source == source.rstrip("\n")


def test_marks_and_copies_do_not_touch_their_source():
    notebook = load(PATHS[0])
    before = as_text(notebook)
    marks(notebook, "n")
    student_copy(notebook, "n")
    assert as_text(notebook) == before


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("q2a", "theirs = log_prior\ndef log_prior(x, model):\n    return theirs(x, model) + 3"),
        (
            "q2b",
            "theirs = log_transition\ndef log_transition(x_next, x, model):\n    return theirs(x_next, x, model) + 3",
        ),
        (
            "q2c",
            "theirs = log_likelihood\ndef log_likelihood(z, particles, H, R):\n"
            "    return theirs(z, particles, H, R) + 1.5 * np.count_nonzero(~np.isnan(z))",
        ),
        (
            "q4b-ellipse",
            "theirs = confidence_ellipse\ndef confidence_ellipse(mean, cov, n_points=100):\n"
            "    return theirs(mean, cov, n_points).T",
        ),
        (
            "q6-ancestors",
            "theirs = select_ancestors\ndef select_ancestors(weights, points):\n"
            "    return theirs(weights, points)[::-1]",
        ),
        (
            "q9",
            "theirs = propose\ndef propose(particles, k, problem, rng):\n"
            "    moved, logs = theirs(particles, k, problem, rng)\n    return moved, logs + 3",
        ),
    ],
)
def test_hidden_tests_leave_what_the_table_leaves(key, change):
    """A constant, the sense of rotation, an order: what the check accepts must not lose its points afterwards."""
    cell, scope = notebook_before(key)
    exec(change, scope)
    exec(cell[f"{key}-test"].source, scope)
    assert scope["verdict"].passed


@pytest.mark.parametrize("key", ["q2b", "q2c", "q12-predict", "q12-update", "q12-initialise", "q14-directions"])
def test_hidden_tests_judge_their_own_question_only(key):
    """None of the earlier ones answered: neither their functions nor what their hidden tests import is there."""
    cell, scope = notebook_before(key)

    def unanswered(*args):
        raise NotImplementedError

    stubs = {question.function: unanswered for question in CODE if question.key != key}
    judged = {**scope, **stubs}  # the answer itself keeps the functions that it calls
    exec(cell[f"{key}-test"].source, judged)
    assert judged["verdict"].passed


def notebook_before(key):
    """Return the cells by their ids, and what imports and answers up to this one define."""
    (question,) = [question for question in CODE if question.key == key]
    cell = cells(load(ROOT / "solutions" / f"{question.notebook}.ipynb"))
    answers = [name for name in cell if name.endswith("-answer") and cell[name].cell_type == "code"]
    scope = {"__name__": "notebook"}
    for name in ("imports", *answers[: answers.index(f"{key}-answer") + 1]):
        exec(cell[name].source, scope)
    if "simulate-code" in cell:
        exec(cell["simulate-code"].source, scope)
    return cell, scope
