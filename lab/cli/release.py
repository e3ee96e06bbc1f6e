"""``slam-lab release``: the students' notebooks from the instructors', in one step."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lab.cli.options import a_path

if TYPE_CHECKING:
    from lab.release import Course


def release(
    check: Annotated[
        bool, typer.Option("--check", help="Write nothing; say what is out of step, with status 1 if anything is.")
    ] = False,
    execute: Annotated[
        bool, typer.Option("--execute", help="First run the solutions and store their outputs and pictures.")
    ] = False,
    student: Annotated[
        Path | None,
        typer.Option("--student", metavar="DIR", parser=a_path, help="Also write all that a student needs there."),
    ] = None,
    only: Annotated[
        str, typer.Option("--only", metavar="TEXT", help="With --execute: the notebooks whose name begins so.")
    ] = "",
) -> None:
    """Derive notebooks/ from solutions/, for instructors."""
    from lab.cli import output
    from lab.errors import InputError
    from lab.release import find_course, write_bundle

    if check and (execute or student is not None):
        raise InputError("--check writes nothing, so it goes with no other option.")
    course = find_course()
    if execute:
        _execute(course, only)
    faults = course.faults() if check else []
    changed = [] if check else course.write()
    with output.deaf_reader():
        _print_points(course)
        for line in faults or [f"notebooks/{name} is written." for name in changed] or ["notebooks/ is in step."]:
            typer.echo(line)
    if student is not None:
        files = write_bundle(course, student)
        with output.deaf_reader():
            typer.echo(f"{student} holds {len(files)} files for students; its README.md says how to begin.")
    if faults:
        typer.echo("Run slam-lab release, and commit what it writes.", err=True)
        raise typer.Exit(1)


def _execute(course: "Course", only: str) -> None:
    from lab.errors import InputError
    from lab.release import execute

    chosen = [path for path in course.solutions if path.name.startswith(only)]
    if not chosen:
        raise InputError(f"No solution's name begins with {only!r}.")
    for path in chosen:
        typer.echo(f"running {path.name}", err=True)
        execute(path)


def _print_points(course: "Course") -> None:
    """Print a row per question and the total."""
    from lab.cli.tables import print_rows

    marks = course.marks()
    rows = [[mark.question, mark.notebook, mark.kind, f"{mark.points:g}"] for mark in marks]
    rows.append(["total", "", "", f"{sum(mark.points for mark in marks):g}"])
    print_rows(["question", "notebook", "kind", "points"], rows)
    typer.echo()
