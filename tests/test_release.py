"""From solutions to student copies: markers, metadata, the course on disk, the bundle and the command."""

import os
import re
import subprocess
import venv
from pathlib import Path

import nbformat
import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output
from program import call, everything_in, start

from lab.release import Course, as_text, cleared, find_course, marks, read_notebook, regions, student_copy, write_bundle
from lab.validation import InputError

ROOT = Path(__file__).resolve().parents[1]
CODE = """def answer(x):
    \"\"\"Say.\"\"\"
    if x:
        ### BEGIN SOLUTION
        secret = x + 1
        return secret
        ### END SOLUTION
    return 0"""


def grader(grade_id, **fields):
    flags = {"grade": False, "solution": False, "locked": False, "task": False}
    return {"nbgrader": {**flags, "schema_version": 3, "grade_id": grade_id, **fields}}


def a_notebook():
    """One question in code, one in words, with all that a front end leaves behind."""
    code = new_code_cell(CODE, id="q1-answer", metadata=grader("q1-answer", solution=True) | {"scrolled": True})
    test = new_code_cell(
        "verdict = answer(1)\n### BEGIN HIDDEN TESTS\nassert verdict == 2\n### END HIDDEN TESTS\nverdict",
        id="q1-test",
        execution_count=2,
        outputs=[new_output("execute_result", {"text/plain": "2"}, execution_count=2)],
        metadata=grader("q1-test", grade=True, locked=True, points=3),
    )
    task = new_markdown_cell(
        "Why?\n=== BEGIN MARK SCHEME ===\n- the reason\n=== END MARK SCHEME ===",
        id="q2-question",
        metadata=grader("q2-question", task=True, locked=True, points=0),
    )
    words = new_markdown_cell(
        "**Answer:**\n\n### BEGIN SOLUTION\nBecause.\n### END SOLUTION",
        id="q2-answer",
        metadata=grader("q2-answer", grade=True, solution=True, points=1.5),
    )
    cells = [new_markdown_cell("# Title", id="title"), code, test, task, words]
    return new_notebook(
        cells=cells, metadata={"widgets": {"state": {}}, "language_info": {"name": "python", "version": "3.11.7"}}
    )


@pytest.fixture
def course(tmp_path):
    (tmp_path / "solutions" / "expected").mkdir(parents=True)
    (tmp_path / "solutions" / "expected" / "q1.png").write_bytes(b"a picture")
    (tmp_path / "solutions" / "01_first.ipynb").write_text(as_text(a_notebook()), encoding="utf-8")
    return Course(tmp_path)


def sources(notebook):
    return {cell.id: cell.source for cell in notebook.cells}


def test_a_student_copy_has_stubs_and_nothing_hidden():
    found = sources(student_copy(a_notebook(), "n"))
    assert found == {
        "title": "# Title",
        "q1-answer": 'def answer(x):\n    """Say."""\n    if x:\n        # YOUR CODE HERE\n'
        "        raise NotImplementedError()\n    return 0",
        "q1-test": "verdict = answer(1)\nverdict",
        "q2-question": "Why?",
        "q2-answer": "**Answer:**\n\nYOUR ANSWER HERE",
    }


def test_it_keeps_ids_and_nbgraders_metadata_and_nothing_of_a_run():
    source = a_notebook()
    copy = student_copy(source, "n")
    assert [cell.id for cell in copy.cells] == [cell.id for cell in source.cells]
    assert [cell.metadata.get("nbgrader") for cell in copy.cells] == [
        cell.metadata.get("nbgrader") for cell in source.cells
    ]
    protected = {cell.id: (cell.metadata.get("deletable"), cell.metadata.get("editable")) for cell in copy.cells}
    assert protected == {
        "title": (None, None),
        "q1-answer": (False, None),
        "q1-test": (False, False),
        "q2-question": (False, False),
        "q2-answer": (False, None),
    }
    assert "widgets" not in copy.metadata
    assert "version" not in copy.metadata.language_info
    assert all(not cell.outputs and cell.execution_count is None for cell in copy.cells if cell.cell_type == "code")
    nbformat.validate(copy)


def test_the_source_is_left_as_it_was_and_the_text_is_the_same_every_time():
    notebook = a_notebook()
    before = as_text(notebook)
    first = as_text(student_copy(notebook, "n"))
    assert as_text(notebook) == before
    other = nbformat.from_dict({key: notebook[key] for key in reversed(list(notebook))})
    assert as_text(student_copy(other, "n")) == first
    assert first.endswith("}\n")
    assert "\r" not in first


def test_points_are_counted_by_question():
    assert [(mark.question, mark.kind, mark.points) for mark in marks(a_notebook(), "n")] == [
        ("q1", "code", 3),
        ("q2", "text", 1.5),
    ]


def test_regions_are_found_by_kind():
    text = "a\n### BEGIN SOLUTION\nb\n### END SOLUTION\nc\n    ### BEGIN SOLUTION\n    d\n    ### END SOLUTION"
    assert regions(text, "n") == {"SOLUTION": ["b\n", "    d\n"]}
    assert cleared(text, {"SOLUTION": "x\ny"}, "n") == "a\nx\ny\nc\n    x\n    y"
    assert cleared(text, {}, "n") == "a\nc"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("### BEGIN SOLUTION\nx", "'SOLUTION' is begun and not ended"),
        ("x\n### END SOLUTION", "line 2 ends a region 'SOLUTION' that was not begun"),
        ("### BEGIN SOLUTION\n### BEGIN SOLUTION\n### END SOLUTION", "line 2 begins a region 'SOLUTION' inside"),
        ("### BEGIN SOLUTION\n### BEGIN HIDDEN TESTS\n", "line 2 begins a region 'HIDDEN TESTS' inside"),
        ("### BEGIN SOLUTION\n### END HIDDEN TESTS\n", "line 2 ends a region 'HIDDEN TESTS' that was not begun"),
        ("### BEGIN SOLUTION ###\nx\n### END SOLUTION", "line 1 looks like a marker and is none"),
        ("# BEGIN SOLUTION\nx", "looks like a marker"),
        ("### begin solution\nx", "looks like a marker"),
        ("### BEGIN HIDDEN TEST\nx", "looks like a marker"),
        ("=== BEGIN MARKING SCHEME ===\nx", "looks like a marker"),
        ("x = 1  ### BEGIN SOLUTION", "looks like a marker"),
    ],
)
def test_markers_that_do_not_pair_are_one_clear_error(text, words):
    with pytest.raises(InputError) as error:
        cleared(text, {}, "some.ipynb, cell q1")
    assert str(error.value).startswith("some.ipynb, cell q1")
    assert words in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("cell", "change", "words"),
    [
        (1, {"solution": False}, "'SOLUTION' stands in a cell that nbgrader does not know as solution"),
        (2, {"grade": False, "points": None}, "'HIDDEN TESTS' stands in a cell that nbgrader does not know as grade"),
        (3, {"task": False, "points": None}, "'MARK SCHEME' stands in a cell that nbgrader does not know as task"),
        (1, {"schema_version": 2}, "schema 3"),
        (1, {"cheksum": "1"}, "schema 3 (cheksum)"),
        (1, {"locked": "no"}, "locked must be true or false"),
        (1, {"grade_id": "q1 answer"}, "grade_id"),
        (1, {"grade_id": "q2-answer"}, "is taken by another cell"),
        (2, {"points": None}, "points belong"),
        (1, {"points": 2}, "points belong"),
        (2, {"points": -1}, "at least 0"),
        (2, {"points": True}, "at least 0"),
        (4, {"grade": False, "points": None}, "a markdown cell is graded and to be answered"),
        (3, {"grade": True}, "a task is a markdown cell without grade"),
    ],
)
def test_metadata_that_nbgrader_would_refuse_are_refused(cell, change, words):
    notebook = a_notebook()
    fields = notebook.cells[cell].metadata.nbgrader
    fields.update({key: value for key, value in change.items() if value is not None})
    for key in [key for key, value in change.items() if value is None]:
        del fields[key]
    with pytest.raises(InputError, match=re.escape(words)) as error:
        student_copy(notebook, "some.ipynb")
    assert "some.ipynb, cell q" in str(error.value)


def test_a_cell_to_be_answered_must_hold_a_region():
    notebook = a_notebook()
    notebook.cells[1].source = "def answer(x):\n    return x + 1"
    with pytest.raises(InputError, match="to be answered and has no region"):
        student_copy(notebook, "n")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{}", "is no notebook"),
        ("not json", "is no notebook"),
        (None, "cannot be read"),
        (as_text(a_notebook()).replace('"q1-test",\n', '"title",\n'), "title"),
        (as_text(a_notebook()).replace('"nbformat_minor": 5', '"nbformat_minor": 4'), "some.ipynb"),
    ],
)
def test_what_is_no_notebook_with_ids_is_refused(tmp_path, text, words):
    path = tmp_path / "some.ipynb"
    if text is not None:
        path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=words):
        read_notebook(path)


def test_a_course_is_written_checked_and_mended(course):
    assert course.faults() == ["notebooks/01_first.ipynb is missing.", "notebooks/expected/q1.png is missing."]
    assert course.write() == ["01_first.ipynb", "expected/q1.png"]
    assert course.faults() == []
    assert course.write() == []
    copy = course.root / "notebooks" / "01_first.ipynb"
    copy.write_text(copy.read_text(encoding="utf-8").replace("Title", "Titel"), encoding="utf-8")
    (course.root / "notebooks" / "02_old.ipynb").write_text("{}", encoding="utf-8")
    assert course.faults() == [
        "notebooks/01_first.ipynb is not what solutions/01_first.ipynb gives.",
        "notebooks/02_old.ipynb comes from nothing in solutions/.",
    ]
    assert course.write() == ["01_first.ipynb", "02_old.ipynb"]
    assert course.faults() == []


def test_a_course_is_found_from_its_root_and_from_inside(course, monkeypatch):
    course.write()
    for folder in (course.root, course.root / "notebooks", course.root / "solutions"):
        monkeypatch.chdir(folder)
        assert find_course().root == course.root
    with pytest.raises(InputError, match="no folder solutions"):
        find_course(course.root / "notebooks")


def test_the_command_says_points_writes_and_checks(course, monkeypatch):
    monkeypatch.chdir(course.root)
    out_of_step = call("release", "--check")
    assert out_of_step.status == 1
    assert "notebooks/01_first.ipynb is missing." in out_of_step.out
    assert not (course.root / "notebooks").exists()
    written = call("release")
    assert written.status == 0
    assert re.search(r"total +4.5", written.out)
    assert re.search(r"q1 +01_first +code +3\n", written.out)
    checked = call("release", "--check")
    assert checked.status == 0
    assert "in step" in checked.out


def test_the_command_refuses_in_one_sentence(course, monkeypatch):
    monkeypatch.chdir(course.root)
    call("release", "--check", "--student", "x").assert_refused("--check writes nothing")
    path = course.root / "solutions" / "01_first.ipynb"
    path.write_text(path.read_text(encoding="utf-8").replace("### END SOLUTION", "### THE END"), encoding="utf-8")
    call("release").assert_refused("01_first.ipynb, cell q1-answer", "begun and not ended")
    assert not (course.root / "notebooks").exists()


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bundle") / "for students"
    return folder, write_bundle(Course(ROOT), folder)


def test_a_bundle_holds_what_a_student_needs(bundle):
    folder, files = bundle
    needed = {
        "README.md",
        "environment.txt",
        "pyproject.toml",
        "LICENSE",
        "data_simulation.py",
        "lab/checks/__init__.py",
    }
    assert needed <= set(files)
    assert sorted(files) == sorted(name.replace("\\", "/") for name in everything_in(folder))
    assert {name for name in files if name.endswith(".ipynb")} == {
        f"notebooks/{path.name}" for path in (ROOT / "solutions").glob("*.ipynb")
    }


def test_a_bundle_holds_nothing_of_the_instructors(bundle):
    folder, files = bundle
    assert {Path(name).parts[0] for name in files} == {
        *("README.md", "environment.txt", "pyproject.toml", "LICENSE", "data_simulation.py", "lab", "notebooks")
    }
    assert not any("__pycache__" in name or "/release/" in name for name in files)
    for name, content in everything_in(folder).items():
        for marker in (b"BEGIN SOLUTION", b"BEGIN HIDDEN", b"BEGIN MARK"):
            assert marker not in content, name
    pins = (folder / "environment.txt").read_text(encoding="utf-8")
    assert "numpy==" in pins
    assert "pytest" not in pins


def test_a_bundle_works_where_it_is_unpacked(bundle):
    folder, _ = bundle
    done = start("run", "sir", "--particles", "20", cwd=folder)
    assert done.status == 0, done.err
    assert "release" not in start("--help", cwd=folder).out
    assert start("release", cwd=folder).status == 2


def test_a_bundle_is_never_mixed_with_something_else(course, tmp_path):
    course.write()
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").touch()
    with pytest.raises(InputError, match="not an empty folder"):
        write_bundle(course, tmp_path / "full")
    with pytest.raises(InputError, match="inside the course"):
        write_bundle(course, course.root / "notebooks" / "deep")


@pytest.mark.long
def test_a_bundle_installs_as_its_readme_says_and_runs(bundle):
    folder, _ = bundle
    home = folder / ".venv"
    venv.create(home, with_pip=True)
    python = home / ("Scripts" if os.name == "nt" else "bin") / "python"
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}

    def succeed(*command, cwd=folder):
        done = subprocess.run([python, *command], cwd=cwd, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
        return done.stdout

    succeed("-m", "pip", "install", "-q", "-r", "environment.txt", "-e", ".")
    assert Path(succeed("-c", "import lab; print(lab.__file__)").strip()).is_relative_to(folder)
    name = "01_simulation_and_modeling.ipynb"
    succeed("-m", "jupyter", "nbconvert", "--to", "notebook", "--execute", "--inplace", name, cwd=folder / "notebooks")
    assert "not answered yet" in (folder / "notebooks" / name).read_text(encoding="utf-8")
