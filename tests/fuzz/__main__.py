"""Damaged and hostile files, made by a seed, through the program: `make fuzz`.

Each original is changed in a few bytes, or loses a piece, and goes through the verbs that read it, each run in a
process of its own. What is counted: tracebacks, hangs, memory, anything on stderr but the program's one line, and
readings that are lost without a word, of which the writer of the original knows how many there are. A changed number
that is believed is counted too, and is no fault: only a checksum could tell.
"""

from __future__ import annotations

import argparse
import functools
import gc
import importlib
import io
import os
import pkgutil
import secrets
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import numpy as np
import typer.main

import contactwrench as cw
from tests.support.recordings import run_quietly

from .hostile import hostile
from .mutations import mutated
from .originals import URDF, Original, joints_bag, messages_of, originals, recorded, rows_of_text
from .runs import Run, run_all

HOSTILE = "hostile"
OF_SUFFIX = {".urdf": "URDF", ".csv": "CSV", ".parquet": "Parquet", ".h5": "HDF5"}
"""Of a hostile file; others are bags."""
MOST_SECONDS_OF_HOSTILE = 10.0
VERBS = {
    "recording": {
        "info": "info {file} --json",
        "calibrate": "calibrate {file} --model mount -o {out}/tool.json",
        "compensate": "compensate {file} -c {tool} -o {out}/contact.csv",
    },
    "bag": {
        "info": "info {file} --json",
        "calibrate": "calibrate {file} --model mount -o {out}/tool.json",
        "compensate": "compensate {file} -c {tool} -o {out}/contact.csv",
        "what is left": "compensate {file} -c {tool} -o {out}/left.csv --accept-damaged",
    },
    "JSON": {"show": "show {file}", "compensate": "compensate {run} -c {file} -o {out}/contact.csv"},
    "URDF": {
        "plan": "plan --robot {file} -o {out}/plan.csv",
        "calibrate": "calibrate {joints} --robot {file} --model mount -o {out}/tool.json",
        "compensate": "compensate {joints} --robot {file} -c {of_joints} -o {out}/contact.csv",
    },
}
"""What is run on an input of a kind; of models the one that is quick, as it is the reading that is tried."""

LIBRARIES = ("mcap.reader", "pyarrow.compute", "pyarrow.parquet", "rosbags.rosbag2", "scipy.spatial.transform")
DAMAGE_SAID = " is damaged: found "


@dataclass
class Tally:
    """What became of the inputs of one kind."""

    inputs: int = 0
    refused: int = 0
    same: int = 0
    other: int = 0
    faults: Counter[str] = field(default_factory=Counter)
    seconds: float = 0.0
    peak: int = 0


@dataclass
class Case:
    """An input, what was done to it, and what the program did with it, by the names in `VERBS`."""

    original: Original
    seed: int
    way: str
    place: Path
    readings: int
    runs: dict[str, Run] = field(default_factory=dict)

    @property
    def verbs(self) -> dict[str, str]:
        kind = self.original.kind
        if kind == HOSTILE:
            kind = OF_SUFFIX.get(self.original.path.suffix, "bag")
        return VERBS.get(kind) or VERBS["recording" if kind in ("CSV", "Parquet", "HDF5") else "bag"]


def fuzz(mutations: int, seed: int, seconds: float, kinds: list[str], at_once: int) -> int:
    """So many changed inputs of every kind, or as many as fit in the time: 0 unless one of them shows a fault."""
    _import_all()
    begin = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="contactwrench-fuzz-") as made:
        folder = Path(made)
        every = _originals(folder)
        known = {name: str(folder / path) for name, path in KNOWN.items()}
        chosen = [one for one in every if not kinds or any(kind in one.name for kind in kinds)]
        whole = [Case(one, 0, "whole", folder / "whole" / str(k), one.readings) for k, one in enumerate(chosen)]
        for case in whole:
            _put(case, case.original.changed.read_bytes())
        run_all(_work(whole, known, lambda case: None), at_once)
        expected = {case.original.name: _compensated(case) for case in whole}
        for case in whole:
            if bad := [run for run in case.runs.values() if run.status != 0 or run.faults]:
                print(f"the whole {case.original.name} was not read: {bad[0]}")
                return 1
        tallies = {one.kind: Tally() for one in chosen}

        def judge(case: Case) -> None:
            faults = _judged(case, expected[case.original.name], tallies[case.original.kind])
            for fault in faults:
                kept = Path(f"fuzz-{case.original.name.replace(' ', '-')}-{case.place.name}")
                print(f"{fault}: {case.original.name}, seed {case.seed}, {case.way}; kept in {kept}", flush=True)
                shutil.copytree(case.place, kept, dirs_exist_ok=True)
            shutil.rmtree(case.place)

        run_all(_work(_cases(chosen, mutations, seed, folder), known, judge), at_once, begin + seconds)
        if not kinds or HOSTILE in kinds:
            tallies[HOSTILE], expected[HOSTILE] = Tally(), []
            run_all(_work(_hostile_cases(folder), known, judge), at_once)
    _print_table(tallies, seed, time.monotonic() - begin)
    return 1 if any(tally.faults for tally in tallies.values()) else 0


KNOWN = {"tool": "tool.json", "run": "run.csv", "joints": "joints.mcap", "of_joints": "of_joints.json"}
"""Whole files beside the one that is changed."""


def _originals(folder: Path) -> list[Original]:
    """All of them, and the files that are `KNOWN`."""
    made = originals(folder)
    csv = next(one.path for one in made if one.kind == "CSV")
    shutil.copy(csv, folder / KNOWN["run"])
    cw.calibrate(cw.read(csv)).save(folder / KNOWN["tool"])
    joints_bag(folder)
    (folder / "urdf").mkdir()
    urdf = folder / "urdf" / "arm.urdf"
    urdf.write_text(URDF)
    cw.calibrate(cw.read(folder / KNOWN["joints"], robot=str(urdf))).save(folder / KNOWN["of_joints"])
    (folder / "json").mkdir()
    tool = Path(shutil.copy(folder / KNOWN["tool"], folder / "json" / "tool.json"))
    readings = made[0].readings
    return [*made, Original("JSON", tool, tool, readings, True), Original("URDF", urdf, urdf, readings, True)]


def _cases(chosen: list[Original], mutations: int, seed: int, folder: Path) -> Iterator[Case]:
    """So many of each kind, and of each variant one at least."""
    numbers = {original.name: number for number, original in enumerate(chosen)}
    of_kind = {kind: [one for one in chosen if one.kind == kind] for kind in (one.kind for one in chosen)}
    for k in range(max(mutations, *map(len, of_kind.values()))):
        for variants in of_kind.values():
            if k >= max(mutations, len(variants)):
                continue
            original, own = variants[k % len(variants)], seed + k
            number = numbers[original.name]
            rng = np.random.default_rng([own, *original.name.encode()])
            content, way = mutated(original.changed.read_bytes(), rng, text=original.text)
            place = folder / f"{number}-{own}"
            readings = rows_of_text(content) if original.kind == "CSV" else original.readings
            case = Case(original, own, way, place, readings)
            _put(case, content)
            yield case


def _hostile_cases(folder: Path) -> Iterator[Case]:
    for name, path in hostile(folder, list(messages_of(recorded()))[:200]):
        yield Case(Original(HOSTILE, path, path, -1), 0, name, path.parent, -1)


def _put(case: Case, content: bytes) -> None:
    """The input with the changed content."""
    case.place.mkdir(parents=True)
    original = case.original
    if original.path.is_dir():
        shutil.copytree(original.path, case.place / original.path.name)
        (case.place / original.path.name / original.changed.name).write_bytes(content)
    else:
        (case.place / original.path.name).write_bytes(content)


def _work(
    cases: Iterator[Case] | list[Case], known: dict[str, str], done: Callable[[Case], None]
) -> Iterator[tuple[list[str], Path, Callable[[Run], None]]]:
    for case in cases:
        for name, line in case.verbs.items():
            out = case.place / "out"
            names = {**known, "file": str(case.place / case.original.path.name), "out": str(out)}
            arguments = [part.format(**names) for part in line.split()]
            yield arguments, out / name.replace(" ", "-"), _finished(case, name, done)


def _finished(case: Case, name: str, done: Callable[[Case], None]) -> Callable[[Run], None]:
    def finished(run: Run) -> None:
        case.runs[name] = run
        if len(case.runs) == len(case.verbs):
            done(case)

    return finished


def _compensated(case: Case, name: str = "contact.csv") -> list[str]:
    """The rows of contact wrenches that were written."""
    path = case.place / "out" / name
    return path.read_text().splitlines()[1:] if path.exists() else []


def _judged(case: Case, expected: list[str], tally: Tally) -> list[str]:
    """What is wrong with how the program took an input; counts what it did."""
    tally.inputs += 1
    tally.seconds = max(tally.seconds, *(run.seconds for run in case.runs.values()))
    tally.peak = max(tally.peak, *(run.peak for run in case.runs.values()))
    faults = [f"{fault} ({name})" for name, run in case.runs.items() for fault in run.faults]
    if case.original.kind == HOSTILE:
        faults += [
            f"{run.seconds:.0f} s ({name})" for name, run in case.runs.items() if run.seconds > MOST_SECONDS_OF_HOSTILE
        ]
        tally.refused += all(run.status == 2 for run in case.runs.values())
        tally.faults.update(faults)
        return faults
    run, rows = case.runs["compensate"], _compensated(case)
    if run.status == 2:
        tally.refused += 1
    elif len(rows) != case.readings:
        faults.append(f"{len(rows)} of {case.readings} readings without a word (compensate)")
    elif rows == expected:
        tally.same += 1
    else:
        tally.other += 1
    faults += _lost_in_info(case)
    left = case.runs.get("what is left")
    if left is not None and left.status == 0:
        rows = _compensated(case, "left.csv")
        said = DAMAGE_SAID in left.err
        if len(rows) != case.readings and not said:
            faults.append(f"{len(rows)} of {case.readings} readings without a word (what is left)")
    tally.faults.update(faults)
    return faults


def _lost_in_info(case: Case) -> list[str]:
    run = case.runs.get("info")
    if run is None or run.status != 0:
        return []
    said = msgspec.json.decode(run.out)
    topics = [topic for topic in said.get("topics", []) if topic["gives"] == "wrench"]
    count = sum(topic["rhythm"]["count"] for topic in topics) if topics else said.get("rows")
    if count in (None, case.readings) or said.get("damage"):
        return []
    return [f"{count} of {case.readings} readings without a word (info)"]


def _print_table(tallies: dict[str, Tally], seed: int, seconds: float) -> None:
    print(f"\nseed {seed}, {sum(tally.inputs for tally in tallies.values())} inputs, {seconds:.0f} s\n")
    print("| input | changed | refused | read, no number changed | read, a number changed | faults | s | GB |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for kind, t in tallies.items():
        counts = f"{t.inputs} | {t.refused} | {t.same} | {t.other} | {sum(t.faults.values())}"
        print(f"| {kind} | {counts} | {t.seconds:.1f} | {1e-9 * t.peak:.2f} |")


def _import_all() -> None:
    """Import what the runs will, and make the program's verbs and options, which takes longer than most runs last, so
    that each begins at once.
    """
    ours = [module.name for module in pkgutil.walk_packages(cw.__path__, "contactwrench.")]
    for name in (*LIBRARIES, *(name for name in ours if not name.endswith("__main__"))):
        importlib.import_module(name)
    typer.main.get_command = functools.cache(typer.main.get_command)
    with redirect_stderr(io.StringIO()):
        run_quietly(["show", "no such file"])
    gc.freeze()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--mutations", type=int, default=300, help="of each kind")
    parser.add_argument("--seed", type=int, default=None)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--at-once", type=int, default=len(os.sched_getaffinity(0)), help="runs, one a core")
    parser.add_argument("kinds", nargs="*", help="parts of their names; all of them if none is named")
    given = parser.parse_args()
    chosen_seed = secrets.randbelow(2**31) if given.seed is None else given.seed
    sys.exit(fuzz(given.mutations, chosen_seed, given.seconds, given.kinds, given.at_once))
