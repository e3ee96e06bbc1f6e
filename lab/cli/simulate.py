"""``slam-lab simulate``: one random experiment, as a file or as an animation."""

from pathlib import Path
from typing import Annotated

import typer

from lab.cli.options import Seed, simulate_scenario
from lab.validation import InputError


def simulate(
    scenario: Annotated[str, typer.Option(metavar="NAME", help="handout or two-landmarks.")] = "handout",
    seed: Seed = 0,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write it: .npz, or .mat with the handout's 16 variables."),
    ] = None,
    animate: Annotated[
        Path | None, typer.Option("--animate", metavar="FILE", help="Write the animation: .gif, or .mp4 with ffmpeg.")
    ] = None,
) -> None:
    """Simulate the robot, its landmarks and what it sees of them."""
    import numpy as np

    import data_simulation
    from lab import records
    from lab.problem import Experiment

    simulation = simulate_scenario(scenario, seed)
    seen = (~np.isnan(simulation.Z[::2, 1:])).sum(axis=0)
    counts = ", ".join(f"{n} seen at {(seen == n).sum()}" for n in range(seen.max(initial=0) + 1))
    typer.echo(f"{scenario}, seed {seed}: {simulation.N} instants, {simulation.M} landmarks ({counts} instants).")
    if out is not None:
        if out.suffix == ".mat":
            with records.atomic_path(out) as temporary:
                records.write_simulation(temporary, simulation)
        else:
            Experiment.from_simulation(simulation).save(out)
        typer.echo(f"Written: {out}")
    if animate is not None:
        from lab.cli.options import SCENARIOS

        try:
            data_simulation.animate(simulation, animate, field_of_view=SCENARIOS[scenario].field_of_view)
        except (ValueError, OSError, RuntimeError) as error:
            raise InputError(str(error)) from None
        typer.echo(f"Written: {animate}")
