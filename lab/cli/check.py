"""``slam-lab check``: the answers that somebody hands in, judged one by one."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lab.cli.options import OutputFolder, a_path
from lab.errors import InputError

if TYPE_CHECKING:
    from lab.checks.grading import Graded
    from lab.checks.questions import Question
    from lab.checks.submission import Submission

TABLE = "checks.csv"
DEFAULT_FOLDER = Path("results/check")


def check(
    path: Annotated[
        Path, typer.Argument(metavar="PATH", parser=a_path, help="A notebook, a .py, or a folder of submissions.")
    ],
    questions: Annotated[
        str | None,
        typer.Option(metavar="LIST", help="Keys such as q5,q4-step; by default those of the notebooks touched."),
    ] = None,
    seconds: Annotated[float, typer.Option(metavar="S", help="Time limit of one question.")] = 150.0,
    memory: Annotated[int, typer.Option(metavar="MB", help="Memory limit of one question.")] = 4096,
    jobs: Annotated[int, typer.Option(metavar="J", help="Questions at a time.")] = 1,
    out: OutputFolder = None,
) -> None:
    """Check the answers in a notebook, a Python file or a folder of submissions.

    The answers are found by their names in the table of questions, in any cell. A folder gives a table, a row per
    submission and question, in results/check or the folder of --out. Status 0 only when all questions pass.
    """
    from contextlib import ExitStack

    from lab.checks import submission
    from lab.checks.grading import Limits
    from lab.cli import output
    from lab.validation import whole_number

    found = submission.find(path)
    chosen = _chosen(questions)
    whole_number("--jobs", jobs, at_least=1)
    whole_number("--memory", memory, at_least=512)
    if not seconds > 0:
        raise InputError(f"--seconds must be positive, not {seconds:g}.")
    many = path.is_dir()
    folder = out if out is not None else DEFAULT_FOLDER if many else None
    arguments = {"questions": questions, "seconds": seconds, "memory": memory}
    with ExitStack() as stack:
        written = stack.enter_context(output.result_folder(folder)) if folder is not None else None
        graded = [_grade(one, chosen, Limits(seconds, memory), jobs) for one in found]
        with output.deaf_reader():
            for one in graded:
                _print_summary(one) if many else _print_verdicts(one)
        if written is not None:
            _table(graded).to_csv(written / TABLE, index=False)
            output.write_config(written, output.describe("check", {"path": str(path)} | arguments, {}))
    if folder is not None:
        with output.deaf_reader():
            typer.echo(f"\nThe table is {folder / TABLE}.")
    if not all(one.passed for one in graded):
        raise typer.Exit(1)


def _chosen(text: str | None) -> "list[Question] | None":
    from lab.checks.questions import CODE, question_named

    if text is None:
        return None
    chosen = [question_named(key.strip()) for key in text.split(",")]
    for question in chosen:
        if question.kind != CODE:
            raise InputError(f"{question.key} asks for a text, which a person reads and marks; there is no check.")
    return chosen


def _grade(one: "Submission", chosen: "list[Question] | None", limits: Any, jobs: int) -> "Graded":
    from lab.checks import grading
    from lab.progress import progress_bar

    asked = chosen or grading.questions_of(one)
    with progress_bar(f"checking {one.name}", len(asked)) as advance:
        return grading.grade(one, asked, limits=limits, jobs=jobs, on_done=lambda verdict: advance(1))


def _print_verdicts(graded: "Graded") -> None:
    """Print a verdict per question, and the sum below."""
    for verdict in graded.verdicts:
        typer.echo(str(verdict))
    if graded.faults:
        typer.echo(f"\n{len(graded.faults)} part(s) could not be run and were left out; the first: {graded.faults[0]}")
    typer.echo(f"\n{_sum(graded)}")


def _print_summary(graded: "Graded") -> None:
    """Print a line per submission, and below it what did not pass, what is missing, and what could not be run."""
    typer.echo(f"{graded.name}: {_sum(graded)}")
    for verdict in graded.verdicts:
        if not verdict.passed and verdict.answered:
            named = f" ({verdict.mistake})" if verdict.mistake else ""
            typer.echo(f"    {verdict.question}: {verdict.status}{named}")
    missing = [verdict.question for verdict in graded.verdicts if not verdict.answered]
    if missing:
        typer.echo(f"    not answered yet: {', '.join(missing)}")
    if graded.faults:
        typer.echo(f"    could not be run: {len(graded.faults)} part(s), the first: {graded.faults[0]}")


def _sum(graded: "Graded") -> str:
    from lab.checks.questions import BY_KEY

    points = {verdict.question: BY_KEY[verdict.question].points for verdict in graded.verdicts}
    earned = sum(points[verdict.question] for verdict in graded.verdicts if verdict.passed)
    passed = sum(verdict.passed for verdict in graded.verdicts)
    asked = len(graded.verdicts)
    return f"public checks of {passed} of {asked} questions passed, {earned} of {sum(points.values())} points"


def _table(graded: "list[Graded]") -> Any:
    """Return a row per submission and question."""
    import pandas as pd

    from lab.checks.questions import BY_KEY

    rows = [
        {
            "submission": one.name,
            "question": verdict.question,
            "status": verdict.status,
            "points": BY_KEY[verdict.question].points if verdict.passed else 0,
            "of": BY_KEY[verdict.question].points,
            "mistake": verdict.mistake,
            "reason": verdict.reason,
            "hint": verdict.hint,
            "notes": "; ".join(verdict.notes),
        }
        for one in graded
        for verdict in one.verdicts
    ]
    return pd.DataFrame(rows)
