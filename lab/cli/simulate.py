"""``slam-lab simulate``: one random experiment, as a file or as an animation."""

from pathlib import Path
from typing import Annotated

import typer

from lab.cli.options import DEFAULT_SCENARIO, a_path, scenario_named, simulate_scenario
from lab.errors import InputError


def simulate(
    scenario: Annotated[str, typer.Option(metavar="NAME", help="handout or two-landmarks.")] = DEFAULT_SCENARIO,
    seed: Annotated[int, typer.Option(metavar="S", help="The same seed gives the same experiment.")] = 0,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", parser=a_path, help="Write it: .npz, or .mat with the handout's 16 variables."),
    ] = None,
    animate: Annotated[
        Path | None,
        typer.Option(metavar="FILE", parser=a_path, help="Write the animation: .gif, or .mp4 with ffmpeg."),
    ] = None,
) -> None:
    """Simulate the robot, its landmarks and what it sees of them."""
    from contextlib import ExitStack

    import numpy as np

    import data_simulation
    from lab import records
    from lab.cli.output import deaf_reader
    from lab.problem import Experiment

    _check_ending("an experiment", out, (".npz", ".mat"))
    _check_ending("the animation", animate, (".gif", ".mp4"))
    simulation = simulate_scenario(scenario, seed)
    with ExitStack() as both:  # or neither: the names are given when all is written
        if out is not None:
            temporary = both.enter_context(records.atomic_path(out))
            if out.suffix == ".mat":
                records.write_simulation(temporary, simulation)
            else:
                Experiment.from_simulation(simulation).save(temporary)
        if animate is not None:
            temporary = both.enter_context(records.atomic_path(animate))
            try:
                data_simulation.animate(simulation, temporary, field_of_view=scenario_named(scenario).field_of_view)
            except RuntimeError as error:  # no ffmpeg
                raise InputError(f"{animate}: {error}.") from None
    seen = (~np.isnan(simulation.Z[::2, 1:])).sum(axis=0)
    counts = ", ".join(f"{n} seen at {(seen == n).sum()}" for n in range(seen.max(initial=0) + 1))
    with deaf_reader():
        typer.echo(f"{scenario}, seed {seed}: {simulation.N} instants, {simulation.M} landmarks ({counts} instants).")
        for path in filter(None, (out, animate)):
            typer.echo(f"Written: {path}")


def _check_ending(what: str, path: Path | None, endings: tuple[str, ...]) -> None:
    if path is not None and path.suffix not in endings:
        raise InputError(f"{path}: the file of {what} ends in {' or '.join(endings)}.")
