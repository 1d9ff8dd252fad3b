"""The experiment's section on the use: it runs, its words follow its figures, and a seed is a seed."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("mujoco")
pytest.importorskip("matplotlib")

from contactwrench.geometry.arrays import Array
from contactwrench.simulate.rig import Rig
from reproduction import film, peg, pushing, tasks
from reproduction.closed_loop import Trace
from reproduction.part import Measured, Part
from reproduction.task_trials import FACES, Inserted, Job, guarded, joints_of_calibration, joints_of_moves, learned
from reproduction.task_words import against_ours


def drawn(rig: Rig, trace: Trace, times: Array, view: film.View) -> list[NDArray[np.uint8]]:
    """Small pictures, but of the peg none."""
    if rig.model.nq > 8:
        raise film.NoPicturesError("nothing here can draw")
    return [np.full((4, 4, 3), number, dtype=np.uint8) for number in range(len(times))]


@pytest.fixture(scope="module")
def three() -> tuple[Part, ...]:
    with pytest.MonkeyPatch.context() as patch, ThreadPoolExecutor(1) as pool:
        patch.setattr(pushing, "ROUND", 0.4)
        patch.setattr(peg, "LONGEST", 0.3)
        patch.setattr(film, "frames", drawn)
        return tasks.parts(pool, 0.0, 1)


@pytest.mark.slow
def test_three_parts_with_tables_of_every_way_and_pictures_or_a_word(three: tuple[Part, ...]) -> None:
    assert [part.key for part in three] == ["guarded_move", "pushing", "peg"]
    for part in three:
        for table in part.tables:
            assert [name for name, _ in table.rows] == ["tare", "gravity only", "paper", "ours"]
            assert all(len(cells) == len(table.columns) for _, cells in table.rows)
        films = [picture.name for picture in part.pictures if picture.name.endswith("_film")]
        assert films == ([] if part.key == "peg" else [f"{part.key}_film"])
        assert (part.paragraphs[-1] == "No pictures: nothing here can draw.") == (part.key == "peg")
        assert all(picture.html.startswith(("<img", "<svg")) for picture in part.pictures)


def test_shares_of_the_moves_sum_to_one(three: tuple[Part, ...]) -> None:
    for _, cells in three[0].tables[0].rows:
        shares = [cell.value for cell in (cells[0], cells[2], cells[3]) if isinstance(cell, Measured)]
        assert sum(shares) == pytest.approx(1.0)


def test_shares_stand_with_an_interval_and_the_tries_that_failed_are_told_apart(three: tuple[Part, ...]) -> None:
    for part in (three[0], three[2]):
        for table in part.tables:
            at = [number for number, name in enumerate(table.columns) if name.endswith("(share)")]
            cells = [row[number] for _, row in table.rows for number in at]
            assert cells
            assert all(isinstance(cell, Measured) and cell.standard_error is None for cell in cells)
            assert "2 calibrations" in table.note
    for table in three[2].tables:
        columns = {name: number for number, name in enumerate(table.columns)}
        for _, row in table.rows:
            done, failed = row[columns["in the hole (share)"]], row[columns["out of time, lost, stopped"]]
            assert isinstance(done, Measured)
            assert sum(map(int, str(failed).split(", "))) == round((1.0 - done.value) * done.trials)


def test_with_the_zero_left_in_no_move_reaches_the_plate_and_with_a_calibration_all_do(three: tuple[Part, ...]) -> None:
    rows = dict(three[0].tables[0].rows)
    for name, at_plate in (("gravity only", 0.0), ("paper", 1.0), ("ours", 1.0)):
        cell = rows[name][0]
        assert isinstance(cell, Measured)
        assert cell.value == at_plate


@pytest.mark.parametrize(("theirs", "ours", "verdict"), [(2, 38, "fewer"), (38, 2, "more"), (36, 38, "cannot tell")])
def test_the_words_follow_the_figures_whoever_is_better(theirs: int, ours: int, verdict: str) -> None:
    tries = {
        name: [Inserted("in" if number < went_in else "time", 8.0, 2.0, 0.0) for number in range(40)]
        for name, went_in in (("tare", theirs), ("ours", ours))
    }
    words = against_ours("upright", tries, "tare")
    assert f"tare brought {theirs} of 40 pegs in and ours {ours}" in words
    assert verdict in words


@pytest.mark.slow
def test_same_seed_same_moves_and_blocks_do_not_matter() -> None:
    postures = joints_of_calibration()
    methods = tuple(learned(3, number, postures)["ours"] for number in range(3))
    begin = joints_of_moves(3, 3)
    whole = guarded(Job(methods, 0, 3, 3, "level", begin))
    assert whole == guarded(Job(methods, 0, 2, 3, "level", begin)) + guarded(Job(methods, 2, 3, 3, "level", begin))
    assert set(FACES) == set(tasks.FACES)
