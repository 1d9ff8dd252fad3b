"""A calibration remembers how its recording was read: the verbs that take it read alike, and say so; base frames."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import contactwrench as cw
from tests.support.recordings import WRENCH, csv_text, run, wrenches_written, written
from tests.support.rigs import example
from tests.support.world import Array, random_rotations, readings
from tests.support.written import QUAT, column_by_column, euler, in_base_axes, quat, rotvec

Capture = pytest.CaptureFixture[str]

RIG, R, RNG = example(3, poses=12)
WORK = random_rotations(6, RNG)
PUSHED = RNG.normal(size=(6, 6)) * [3.0, 3.0, 3.0, 0.2, 0.2, 0.2]
"""Contact wrenches at the orientations `WORK`."""


def _table(R: Array, wrench: Array, columns: tuple[str, ...], numbers: Callable[[Array], Array]) -> str:
    return csv_text((*WRENCH, *columns), np.column_stack([wrench, numbers(R)]))


def _calibrated(capsys: Capture, folder: Path, recording: Path, *flags: str) -> Path:
    target = folder / "tool.json"
    done = run(capsys, "calibrate", recording, "-o", target, "--model", "mount", *flags)
    assert done.status == 0, done.err
    return target


def same(R: Array, wrench: Array) -> Array:
    return wrench


def reaction(R: Array, wrench: Array) -> Array:
    return -wrench


def in_newton_millimetres(R: Array, wrench: Array) -> Array:
    scaled: Array = wrench * np.repeat([1.0, 1e3], 3)
    return scaled


WAYS: dict[str, tuple[tuple[str, ...], Callable[[Array], Array], Callable[[Array, Array], Array], list[str]]] = {
    "reaction": (QUAT, quat, reaction, ["--sign", "reaction"]),
    "base": (QUAT, quat, in_base_axes, ["--wrench-frame", "base"]),
    "inverse": (QUAT, lambda R: quat(R.transpose(0, 2, 1)), same, ["--inverse-orientation"]),
    "yaskawa": (("rx", "ry", "rz"), euler("xyz"), same, ["--orientation", "yaskawa"]),
    "wrench columns": (QUAT, quat, reaction, ["--wrench-columns", "fx,fy,fz,tx,ty,tz", "--sign", "reaction"]),
    "columns": (("q0", "q1", "q2", "q3"), quat, same, ["--orientation", "quat_xyzw:q0,q1,q2,q3"]),
    "franka": (tuple(f"o_t_ee_{k}" for k in range(16)), column_by_column, reaction, ["--sign", "reaction"]),
    "units": (QUAT, quat, in_newton_millimetres, ["--units", "torque=Nmm"]),
}
COLUMNS = {
    "columns": 'Note: columns: qx..qw from "q0".."q3"\n',
    "units": 'Note: columns: fx..fz from "fx".."fz", tx..tz from "tx".."tz" in N mm\n',
}
"""What is said of columns that do not bear the usual names and units."""


@pytest.mark.parametrize("way", WAYS)
def test_what_was_said_to_calibrate_holds_for_the_others(tmp_path: Path, capsys: Capture, way: str) -> None:
    columns, numbers, turned, flags = WAYS[way]
    free = written(tmp_path, _table(R, turned(R, readings(RIG, R)), columns, numbers), "free.csv")
    touched = readings(RIG, WORK) + PUSHED
    work = written(tmp_path, _table(WORK, turned(WORK, touched), columns, numbers), "work.csv")
    tool = _calibrated(capsys, tmp_path, free, *flags)
    note = f"Note: read as the calibration was: {' '.join(flags)}\n"
    done = run(capsys, "compensate", work, "-c", tool, "-o", tmp_path / "out.csv")
    of_columns = COLUMNS.get(way, "")
    assert done.err == note + of_columns
    np.testing.assert_allclose(wrenches_written(tmp_path / "out.csv"), PUSHED, atol=1e-6)
    again = run(capsys, "compensate", work, "-c", tool, "-o", tmp_path / "again.csv", *flags)
    assert again.err == of_columns
    assert (tmp_path / "again.csv").read_text() == (tmp_path / "out.csv").read_text()
    verified = run(capsys, "verify", free, "-c", tool, "--limit-force", "0.001")
    assert verified.status == 0
    assert sorted(verified.err.splitlines()) == sorted((note + of_columns).splitlines())
    assert run(capsys, "weigh", work, "-c", tool, "--json").err == verified.err


@pytest.fixture
def reaction_tool(tmp_path: Path, capsys: Capture) -> Path:
    """Calibrated from quaternions and reactions."""
    return _calibrated(
        capsys, tmp_path, written(tmp_path, _table(R, -readings(RIG, R), QUAT, quat)), "--sign", "reaction"
    )


def test_what_is_stated_wins_and_is_said(tmp_path: Path, capsys: Capture, reaction_tool: Path) -> None:
    pulls = written(tmp_path, _table(WORK, readings(RIG, WORK) + PUSHED, QUAT, quat), "pulls.csv")
    flags = ("compensate", pulls, "-c", reaction_tool, "--force", "-o", tmp_path / "out.csv", "--sign", "pull")
    done = run(capsys, *flags, "--no-inverse-orientation")
    assert done.err == "Note: --sign was reaction for the calibration and is pull for this recording\n"
    np.testing.assert_allclose(wrenches_written(tmp_path / "out.csv"), PUSHED, atol=1e-6)
    inverse = written(
        tmp_path, _table(WORK.transpose(0, 2, 1), readings(RIG, WORK) + PUSHED, QUAT, quat), "inverse.csv"
    )
    done = run(capsys, *flags[:1], inverse, *flags[2:], "--inverse-orientation")
    assert done.err == (
        "Note: --sign was reaction for the calibration and is pull for this recording\n"
        "Note: --inverse-orientation was left out for the calibration and is given for this recording\n"
    )
    np.testing.assert_allclose(wrenches_written(tmp_path / "out.csv"), PUSHED, atol=1e-6)


OTHER_COLUMNS = {
    "told by their names": (("a", "b", "c"), euler("ZYX"), []),
    "stated": (("u", "v", "w"), rotvec, ["--orientation", "ur_rotvec:u,v,w"]),
}


@pytest.mark.parametrize("way", OTHER_COLUMNS)
def test_another_file_may_be_written_in_another_way(
    tmp_path: Path, capsys: Capture, reaction_tool: Path, way: str
) -> None:
    """The sign is the sensor's, and its columns are the same."""
    columns, numbers, flags = OTHER_COLUMNS[way]
    work = written(tmp_path, _table(WORK, -readings(RIG, WORK) - PUSHED, columns, numbers), "work.csv")
    done = run(capsys, "compensate", work, "-c", reaction_tool, "-o", tmp_path / "out.csv", *flags)
    np.testing.assert_allclose(wrenches_written(tmp_path / "out.csv"), PUSHED, atol=1e-6)
    differs = (
        "Note: --orientation was quat_xyzw for the calibration and is ur_rotvec:u,v,w for this recording\n"
        'Note: columns: rx from "u", ry from "v", rz from "w" as ur_rotvec\n'
    )
    assert done.err == "Note: read as the calibration was: --sign reaction\n" + (differs if flags else "")


@pytest.mark.parametrize("turned_round", [False, True])
def test_a_sign_is_asked_for_where_the_wrench_bears_other_names(
    tmp_path: Path, capsys: Capture, turned_round: bool
) -> None:
    """Two columns of one sensor, or two sensors, have each a sign of their own, whoever finds them by their names."""
    raw = tuple(f"ft_raw_wrench_{k}" for k in range(6))
    ours, other = (WRENCH, raw) if turned_round else (raw, WRENCH)
    free = written(tmp_path, csv_text((*ours, *QUAT), np.column_stack([-readings(RIG, R), quat(R)])), "free.csv")
    tool = _calibrated(capsys, tmp_path, free, "--sign", "reaction")
    assert run(capsys, "verify", free, "-c", tool).status == 0
    work = written(tmp_path, csv_text((*other, *QUAT), np.column_stack([readings(RIG, R), quat(R)])), "work.csv")
    assert run(capsys, "verify", work, "-c", tool).complaint == (
        f"{work}: found other columns, and a calibration read with --sign reaction, expected to be told whether that "
        "holds here: repeat it, or say --sign pull"
    )
    assert run(capsys, "verify", work, "-c", tool, "--sign", "pull").status == 0


def test_units_are_asked_for_where_the_wrench_bears_other_names(tmp_path: Path, capsys: Capture) -> None:
    in_nmm = in_newton_millimetres(R, readings(RIG, R))
    tool = _calibrated(
        capsys, tmp_path, written(tmp_path, _table(R, in_nmm, QUAT, quat), "free.csv"), "--units", "torque=Nmm"
    )
    raw = tuple(f"ft_raw_wrench_{k}" for k in range(6))
    work = written(tmp_path, csv_text((*raw, *QUAT), np.column_stack([readings(RIG, R), quat(R)])), "work.csv")
    assert run(capsys, "verify", work, "-c", tool).complaint == (
        f"{work}: found other columns, and a calibration read with --units torque=Nmm, expected to be told whether "
        "that holds here: repeat it, or say --units force=N,torque=Nm"
    )
    assert run(capsys, "verify", work, "-c", tool, "--units", "force=N,torque=Nm").status == 0


def test_units_of_columns_that_are_not_there_say_nothing_of_others(tmp_path: Path, capsys: Capture) -> None:
    in_kgf = np.column_stack([readings(RIG, R) / 9.80665, quat(R)])
    free = written(tmp_path, csv_text(("a", "b", "c", "d", "e", "f", *QUAT), in_kgf), "free.csv")
    flags = ["--units", "force=kgf,torque=kgfm", "--wrench-columns", "a,b,c,d,e,f"]
    tool = _calibrated(capsys, tmp_path, free, *flags)
    work = written(tmp_path, _table(WORK, readings(RIG, WORK) + PUSHED, QUAT, quat), "work.csv")
    done = run(capsys, "compensate", work, "-c", tool, "-o", tmp_path / "out.csv")
    assert done.err == f"Note: not read as the calibration was, no columns for {' '.join(flags)}\n"
    np.testing.assert_allclose(wrenches_written(tmp_path / "out.csv"), PUSHED, atol=1e-6)


def test_columns_that_are_not_there_are_left_out_and_said(tmp_path: Path, capsys: Capture) -> None:
    free = written(tmp_path, _table(R, readings(RIG, R), ("u", "v", "w"), rotvec), "free.csv")
    tool = _calibrated(capsys, tmp_path, free, "--orientation", "ur_rotvec:u,v,w")
    work = written(tmp_path, _table(WORK, readings(RIG, WORK) + PUSHED, QUAT, quat), "work.csv")
    done = run(capsys, "compensate", work, "-c", tool, "--force", "-o", tmp_path / "out.csv")
    assert done.err == "Note: not read as the calibration was, no columns for --orientation ur_rotvec:u,v,w\n"
    np.testing.assert_allclose(wrenches_written(tmp_path / "out.csv"), PUSHED, atol=1e-6)


@pytest.mark.parametrize("verb", ["compensate", "verify", "weigh"])
def test_an_inverse_that_may_or_may_not_hold_is_asked_for(tmp_path: Path, capsys: Capture, verb: str) -> None:
    free = written(tmp_path, _table(R.transpose(0, 2, 1), readings(RIG, R), QUAT, quat), "free.csv")
    tool = _calibrated(capsys, tmp_path, free, "--inverse-orientation")
    work = written(tmp_path, _table(WORK, readings(RIG, WORK), ("a", "b", "c"), euler("ZYX")), "work.csv")
    assert run(capsys, verb, work, "-c", tool).complaint == (
        f"{work}: found other columns, and a calibration read with --inverse-orientation, expected to be told whether "
        "that holds here: repeat it, or say --no-inverse-orientation"
    )
    assert run(capsys, verb, work, "-c", tool, "--no-inverse-orientation").status == 0


def test_a_file_that_is_no_recording_is_refused_as_usual(tmp_path: Path, capsys: Capture, reaction_tool: Path) -> None:
    bad = written(tmp_path, csv_text(WRENCH, readings(RIG, WORK)), "bad.csv")
    complaint = run(capsys, "verify", bad, "-c", reaction_tool).complaint
    assert complaint == run(capsys, "calibrate", bad).complaint


def test_a_calibration_from_before_and_one_from_arrays_say_nothing(tmp_path: Path, capsys: Capture) -> None:
    work = written(tmp_path, _table(WORK, readings(RIG, WORK) + PUSHED, QUAT, quat), "work.csv")
    tool = tmp_path / "tool.json"
    calibration = cw.calibrate(cw.Samples(readings(RIG, R), R), "mount")
    before: dict[str, str | int | float | bool | None] = {
        "orientation": "auto",
        "wrench_frame": "sensor",
        "sign": "pull",
        "inverse_orientation": False,
    }
    for provenance in (calibration.provenance, {**calibration.provenance, **before}):
        replace(calibration, provenance=provenance).save(tool)
        done = run(capsys, "compensate", work, "-c", tool, "--force", "-o", tmp_path / "out.csv")
        assert done.err == ""
        np.testing.assert_allclose(wrenches_written(tmp_path / "out.csv"), PUSHED, atol=1e-6)
    replace(calibration, provenance={**before, "sign": "reaction"}).save(tool)
    done = run(capsys, "compensate", work, "-c", tool, "--force", "-o", tmp_path / "out.csv")
    assert done.err == "Note: read as the calibration was: --sign reaction\n"


def test_python_keeps_how_a_file_was_read(tmp_path: Path) -> None:
    free = written(tmp_path, _table(R, -readings(RIG, R), QUAT, quat), "free.csv")
    samples = cw.read(free, sign="reaction", base_frame="cell")
    kept = {"orientation": "quat_xyzw", "sign": "reaction", "wrench_frame": "sensor", "inverse_orientation": False}
    assert samples.read_as == {**kept, "base_frame": "cell"}
    provenance = cw.calibrate(samples, "mount").provenance
    assert {name: provenance[name] for name in kept} == kept
    assert cw.Samples(readings(RIG, R), R).read_as == {}


def test_which_column_was_taken_for_what_is_said_and_kept(tmp_path: Path, capsys: Capture) -> None:
    raw = tuple(f"ft_raw_wrench_{k}" for k in range(6))
    words = 'fx..fz from "ft_raw_wrench_0".."ft_raw_wrench_2", tx..tz from "ft_raw_wrench_3".."ft_raw_wrench_5"'
    free = written(tmp_path, csv_text((*raw, *QUAT), np.column_stack([readings(RIG, R), quat(R)])), "free.csv")
    tool = tmp_path / "tool.json"
    assert run(capsys, "calibrate", free, "-o", tool).err == f"Note: columns: {words}\n"
    assert json.loads(tool.read_text())["provenance"]["columns"] == words
    for verb in ("compensate", "verify", "weigh"):
        assert run(capsys, verb, free, "-c", tool).err == f"Note: columns: {words}\n", verb
    assert run(capsys, "plan", "--from", free, "-n", "2").err == f"Note: columns: {words}\n"


def test_two_files_after_one(tmp_path: Path, capsys: Capture, reaction_tool: Path) -> None:
    t = 0.5 * np.arange(len(WORK))
    wrench = np.column_stack([t, -readings(RIG, WORK) - PUSHED])
    of_wrench = written(tmp_path, csv_text(("t", *WRENCH), wrench), "w.csv")
    of_pose = written(tmp_path, csv_text(("t", *QUAT), np.column_stack([t, quat(WORK)])), "p.csv")
    out = tmp_path / "out.csv"
    done = run(capsys, "compensate", "--wrench", of_wrench, "--pose", of_pose, "-c", reaction_tool, "-o", out)
    assert done.err.startswith("Note: read as the calibration was: --sign reaction\n")
    known = wrenches_written(out)
    np.testing.assert_allclose(known[np.isfinite(known[:, 0])], PUSHED[np.isfinite(known[:, 0])], atol=1e-6)
    assert np.isfinite(known[:, 0]).sum() >= 4


@pytest.mark.parametrize(
    ("name", "value"), [("sign", 5), ("inverse_orientation", "yes"), ("frames", "base"), ("orientation", 1.0)]
)
def test_a_provenance_that_was_edited(tmp_path: Path, capsys: Capture, name: str, value: str | float) -> None:
    calibration = cw.calibrate(cw.Samples(readings(RIG, R), R), "mount")
    tool = tmp_path / "tool.json"
    replace(calibration, provenance={name: value}).save(tool)
    work = written(tmp_path, _table(WORK, readings(RIG, WORK), QUAT, quat), "work.csv")
    complaint = run(capsys, "verify", work, "-c", tool).complaint
    assert complaint == f"the calibration's provenance has {name} {value!r}, which is none: calibrate again"


NMM = ("fx", "fy", "fz", "mx [Nmm]", "my [Nmm]", "mz [Nmm]")
UNITS: dict[str, tuple[tuple[str, ...], tuple[str, ...], float, list[str]]] = {
    "in the names": (NMM, QUAT, 1.0, []),
    "of force too": (("fx [kgf]", "fy [kgf]", "fz [kgf]", *NMM[3:]), QUAT, 1.0 / 9.80665, []),
    "of angles": (NMM, ("a_rad", "b_rad", "c_rad"), 1.0, []),
}
"""How the calibration's file states its units: names of the wrench and of the orientation, force per N, flags."""


def _in_nmm(names: tuple[str, ...], of_pose: tuple[str, ...], R: Array, wrench: Array, per_newton: float = 1.0) -> str:
    numbers = quat(R) if len(of_pose) == 4 else euler("ZYX", degrees=False)(R)
    scaled = wrench * np.repeat([per_newton, 1e3], 3)
    return csv_text((*names, *of_pose), np.column_stack([scaled, numbers]))


@pytest.mark.parametrize("way", UNITS)
def test_columns_that_state_no_unit_are_not_taken_for_the_usual_one(tmp_path: Path, capsys: Capture, way: str) -> None:
    names, of_pose, per_newton, flags = UNITS[way]
    free = written(tmp_path, _in_nmm(names, of_pose, R, readings(RIG, R), per_newton), "free.csv")
    tool = _calibrated(capsys, tmp_path, free, *flags)
    touched = readings(RIG, WORK) + PUSHED
    silent = tuple(name.partition("_")[0] for name in of_pose)
    other = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
    work = written(tmp_path, _in_nmm(other, silent, WORK, touched, per_newton), "work.csv")
    wanted = [("force", "kgf", "Fx")] * (per_newton != 1.0) + [("torque", "nmm", "Tx")]
    wanted += [("angle", "rad", "a")] * (len(of_pose) == 3)
    units = [f"{quantity}={symbol}" for quantity, symbol, _ in wanted]
    quantity, symbol, column = wanted[0]
    name = {"nmm": "N mm"}.get(symbol, symbol)
    for verb in ("compensate", "verify", "weigh"):
        done = run(capsys, verb, work, "-c", tool)
        assert (done.status, done.err) == (
            2,
            f"contactwrench: {work}: found no unit of the {quantity} in {column}, and a calibration whose {quantity} "
            f"was read in {name}, expected to be told which: say --units {quantity}={symbol}, or another unit\n",
        )
    assert run(capsys, "compensate", work, "-c", tool, "--units", units[0]).status == 2 * (len(units) > 1)
    out = tmp_path / "out.csv"
    done = run(capsys, "compensate", work, "-c", tool, "--force", "-o", out, "--units", ",".join(units))
    assert done.status == 0, done.err
    np.testing.assert_allclose(wrenches_written(out), PUSHED, atol=1e-6)


@pytest.mark.parametrize("way", UNITS)
def test_columns_that_state_their_unit_are_asked_nothing(tmp_path: Path, capsys: Capture, way: str) -> None:
    names, of_pose, per_newton, flags = UNITS[way]
    free = written(tmp_path, _in_nmm(names, of_pose, R, readings(RIG, R), per_newton), "free.csv")
    tool = _calibrated(capsys, tmp_path, free, *flags)
    touched = readings(RIG, WORK) + PUSHED
    alike = written(tmp_path, _in_nmm(names, of_pose, WORK, touched, per_newton), "alike.csv")
    stating = ("Fx [N]", "Fy [N]", "Fz [N]", "Tx [N mm]", "Ty [N mm]", "Tz [N mm]")
    others = written(tmp_path, _in_nmm(stating, of_pose, WORK, touched), "others.csv")
    for work in (alike, others):
        done = run(capsys, "compensate", work, "-c", tool, "--force", "-o", tmp_path / "out.csv")
        assert done.status == 0, done.err
        np.testing.assert_allclose(wrenches_written(tmp_path / "out.csv"), PUSHED, atol=1e-6)


@pytest.mark.parametrize("verb", ["verify", "compensate", "weigh"])
@pytest.mark.parametrize("is_weak", [True, False])
def test_that_a_calibration_is_weak_is_said_where_it_is_used(
    tmp_path: Path, capsys: Capture, verb: str, is_weak: bool
) -> None:
    rig, R, rng = example(8, 12)
    pushed = 0.5 * rig.weight * rng.normal(size=(12, 6)) * ([1.0, 1.0, 1.0, 0.0, 0.0, 0.0] if is_weak else np.zeros(6))
    calibration = cw.calibrate(cw.Samples(readings(rig, R) + pushed + 0.01 * rng.normal(size=(12, 6)), R), "mount")
    assert (calibration.verdict == "weak") is is_weak
    calibration.save(tmp_path / "tool.json")
    again = random_rotations(6, rng)
    rows = np.column_stack([readings(rig, again) + 0.01 * rng.normal(size=(6, 6)), quat(again)])
    recording = written(tmp_path, csv_text((*WRENCH, *QUAT), rows))
    done = run(capsys, verb, "-c", tmp_path / "tool.json", recording)
    assert ("the calibration is weak: " in done.err) is is_weak, done.err
