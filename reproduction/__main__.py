"""`python -m reproduction`: the paper's experiment on the virtual rig, what `make experiment` runs."""

from __future__ import annotations

import multiprocessing
import os
from concurrent.futures import Executor, ProcessPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from contactwrench.cli.main import main

if TYPE_CHECKING:
    from rich.progress import Progress

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")

QUICK = 0.05
"""Of the trials."""


def experiment(
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder for the report, the figures and the pictures.")
    ] = Path("contactwrench-experiment"),
    seed: Annotated[int, typer.Option(metavar="S", help="Of everything random: same seed, same figures.", min=0)] = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help=f"{QUICK:.0%} of the trials: a look at it, no result.")
    ] = False,
) -> None:
    """Run the paper's experiment on the virtual rig, with every estimator, and report all figures."""
    from contactwrench.files import make_folder
    from contactwrench.simulate.rig import import_mujoco

    from .page import write_experiment
    from .run import STEPS, run

    import_mujoco()
    make_folder(out)
    scale = QUICK if quick else 1.0
    with _processes() as pool, _progress() as progress:
        task = progress.add_task("all steps at once", total=len(STEPS))
        parts = run(pool, scale, seed, lambda name: progress.update(task, advance=1, description=f"done: {name}"))
    write_experiment(out, parts, scale, seed)
    typer.echo(f"Wrote report.html, figures.json, experiment.md and images to {out}")


def _progress() -> Progress:
    """A line on stderr: how many steps are done, the time, and the last one."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        SpinnerColumn(),
        TextColumn("{task.description}"),
    )
    return Progress(*columns, console=Console(stderr=True))


def _processes() -> Executor:
    """A process a core, from a fresh interpreter each, with one thread for its linear algebra."""
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    return ProcessPoolExecutor(os.cpu_count(), mp_context=multiprocessing.get_context("spawn"))


if __name__ == "__main__":
    program = typer.Typer(
        add_completion=False,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    program.command()(experiment)
    main(program, "python -m reproduction")
