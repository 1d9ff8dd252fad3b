"""`python -m benchmarks [--quick] [accuracy] [speed]`: all figures with their targets, then those that are missed."""

from __future__ import annotations

import argparse
import multiprocessing
import os
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor

from .table import Row, print_table

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def _accuracy(quick: bool) -> Iterator[tuple[str, Iterable[Row]]]:
    from . import accuracy

    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))  # for the processes that are started from here on
    with ProcessPoolExecutor(os.cpu_count(), mp_context=multiprocessing.get_context("spawn")) as pool:
        yield from accuracy.tables(pool, quick)


def _speed(quick: bool) -> Iterator[tuple[str, Iterable[Row]]]:
    from . import speed

    yield from speed.tables(quick)


def main() -> None:
    """Run the benchmarks that are asked for, or all."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a tenth of the trials")
    parser.add_argument("which", nargs="*", metavar="accuracy|speed", help="what to run; default: both")
    options = parser.parse_args()
    if unknown := set(options.which) - {"accuracy", "speed"}:
        parser.error(f"found {', '.join(sorted(unknown))}, expected accuracy or speed")
    which = options.which or ["speed", "accuracy"]
    rows: list[tuple[str, Row]] = []
    for run in [{"speed": _speed, "accuracy": _accuracy}[name] for name in which]:
        for title, table in run(options.quick):
            figures = list(table)
            print_table(title, figures)
            rows += [(title, row) for row in figures]
    judged = [(title, row) for title, row in rows if row.has_target]
    missed = [(title, row) for title, row in judged if not row.met]
    print(f"\nSummary: {len(judged) - len(missed)} of {len(judged)} targets met, {len(missed)} missed")
    if options.quick:
        print(
            "  quick: a tenth of the trials, so that ratios scatter by 2 % and coverages by 1 %; only a full run judges"
        )
    for title, row in missed:
        print(f"  {title}: {row.what} {row.value:.4g} {row.unit}, expected {row.target}")


if __name__ == "__main__":
    main()
