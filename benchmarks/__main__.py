"""`python -m benchmarks [--quick] [--only WORD] [NAME ...]`: figures with their targets, then those that are missed.

A full run is added to results.csv.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from importlib import import_module

from .record import append
from .table import Row, print_table

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
BY_THEMSELVES = (
    "speed",
    "tables",
    "plan",
    "rig",
    "measured",
    "bags",
    "clock_delay",
    "stillness",
    "live",
    "live_devices",
    "live_page",
)
"""They use the clock, or are too short for a pool; they come first, while numpy has all its threads."""

IN_A_POOL = ("accuracy", "auto", "dirty", "inference", "judgements", "diagnose", "dynamic")


def _tables(name: str, quick: bool) -> Iterator[tuple[str, Iterable[Row]]]:
    benchmark = import_module(f".{name}", __package__)
    if name in BY_THEMSELVES:
        yield from benchmark.tables(quick)
        return
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))  # for the processes that are started from here on
    with ProcessPoolExecutor(os.cpu_count(), mp_context=multiprocessing.get_context("spawn")) as pool:
        yield from benchmark.tables(pool, quick)


def main() -> None:
    """Run the benchmarks that are asked for, or all."""
    known = (*BY_THEMSELVES, *IN_A_POOL)
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=(__doc__ or "").partition(": ")[2])
    parser.add_argument("--quick", action="store_true", help="a tenth of the trials, and nothing added to results.csv")
    parser.add_argument("--only", metavar="WORD", default="", help="tables whose title has this word, and no others")
    parser.add_argument("which", nargs="*", metavar="NAME", help=f"what to run: {', '.join(known)}; default: all")
    options = parser.parse_args()
    if unknown := set(options.which) - set(known):
        parser.error(f"found {', '.join(sorted(unknown))}, expected {', '.join(known)}")
    rows: list[tuple[str, Row]] = []
    for name in [name for name in known if name in (options.which or known)]:
        for title, table in _tables(name, options.quick):
            if options.only.lower() not in title.lower():
                continue
            figures = list(table)  # nothing was computed before
            print_table(title, figures)
            rows += [(title, row) for row in figures]
            if not options.quick:
                append(title, figures)
    judged = [(title, row) for title, row in rows if row.has_target]
    missed = [(title, row) for title, row in judged if not row.met]
    print(f"\nSummary: {len(judged) - len(missed)} of {len(judged)} targets met, {len(missed)} missed")
    if options.quick:
        print("  quick: a tenth of the trials, so that figures scatter; only a full run judges; clearly missed:")
    for title, row in missed:
        if options.quick and row.judgement != "MISSED":
            continue
        print(f"  {title}: {row.what} {row.value:.4g} {row.unit}, expected {row.target}")


if __name__ == "__main__":
    main()
