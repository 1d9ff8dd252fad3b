"""The calibration file: every number comes back exactly, and whatever contradicts itself is refused by name."""

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import MISSING, fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.calibration.alternative import Alternative, Alternatives
from contactwrench.calibration.consistency import FOLLOWS, Derived
from contactwrench.calibration.dynamics import Dynamics
from contactwrench.calibration.file import ADDED, SCHEMA, to_json
from contactwrench.calibration.observability import Observability
from contactwrench.errors import FileAccessError, FileFormatError
from contactwrench.samples.accelerometer import Accelerometer
from contactwrench.samples.poses import Pose, PoseMoments, moments_of_poses
from contactwrench.samples.still_noise import StillNoise
from tests.support.recordings import PANDA, PAPER, written
from tests.support.rigs import example, noisy

MODELS = ("paper", "yaw", "mount", "mount+base", "affine")
AGAIN = "calibrate again or restore the file"
EDITED = f"expected a file as it was saved: {AGAIN}"


@cache
def calibration_of(model: str) -> cw.Calibration:
    return cw.calibrate(cw.read(PAPER if model in ("paper", "yaw") else PANDA), model=model)


def saved(model: str = "mount") -> dict[str, Any]:
    """The saved form, to be edited."""
    values: dict[str, Any] = json.loads(to_json(calibration_of(model)))
    return values


def refusal(folder: Path, content: str | bytes | dict[str, Any]) -> str:
    """The message, without the folder, with which `load` refuses a file."""
    path = written(folder, json.dumps(content) if isinstance(content, dict) else content, "tool.json")
    with pytest.raises(FileFormatError) as caught:
        cw.Calibration.load(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message.removeprefix(f"{path}: ")


def assert_identical(a: object, b: object) -> None:
    """Equal to the last bit, through records, tuples and arrays."""
    a, b = (tuple(each) if isinstance(each, Alternatives) else each for each in (a, b))
    assert type(a) is type(b)
    if isinstance(a, np.ndarray):
        assert np.array_equal(a, b)  # type: ignore[arg-type]
    elif isinstance(a, cw.Calibration | Pose | PoseMoments | Observability | Alternative):
        for field in fields(a):
            assert_identical(getattr(a, field.name), getattr(b, field.name))
    elif isinstance(a, tuple):
        assert isinstance(b, tuple)
        for x, y in zip(a, b, strict=True):
            assert_identical(x, y)
    else:
        assert a == b


@pytest.mark.parametrize("model", MODELS)
def test_every_field_comes_back_exactly(tmp_path: Path, model: str) -> None:
    calibration = calibration_of(model)
    calibration.save(tmp_path / "tool.json")
    loaded = cw.Calibration.load(tmp_path / "tool.json")
    assert_identical(loaded, calibration)
    assert len(loaded.poses) == len(calibration.poses) > 0
    assert to_json(loaded) == to_json(calibration)


def test_times_scatter_and_missing_held_out_errors_come_back_exactly(tmp_path: Path) -> None:
    samples = cw.read(PANDA)
    rng = np.random.default_rng(4)
    repeated = cw.Samples(
        wrench=np.repeat(samples.wrench, 5, axis=0) + 0.01 * rng.normal(size=(85, 6)),
        R_base_flange=np.repeat(samples.R_base_flange, 5, axis=0),
        t=1.7e9 + rng.uniform(size=85).cumsum(),
    )
    calibration = replace(cw.calibrate(repeated, "mount"), held_out_rms=None)
    calibration.save(tmp_path / "tool.json")
    loaded = cw.Calibration.load(tmp_path / "tool.json")
    assert_identical(loaded, calibration)
    assert loaded.poses[3].t_start == repeated.t[15]  # type: ignore[index]
    assert np.abs(loaded.poses[3].wrench_cov).max() > 0.0


def test_the_moments_that_stand_in_for_many_poses_come_back_exactly(tmp_path: Path) -> None:
    samples = cw.read(PANDA)
    moments = moments_of_poses(samples.R_base_flange, samples.wrench)
    calibration = replace(calibration_of("mount"), poses=(), moments=moments)
    calibration.save(tmp_path / "tool.json")
    assert_identical(cw.Calibration.load(tmp_path / "tool.json"), calibration)


def test_a_calibration_for_another_gravity_can_be_saved(tmp_path: Path) -> None:
    for model in MODELS:
        calibration = calibration_of(model).with_gravity(np.array([0.3, -0.4, 0.1]))
        calibration.save(tmp_path / "tool.json")
        assert_identical(cw.Calibration.load(tmp_path / "tool.json"), calibration)


def test_the_file_has_the_fields_of_the_calibration_and_their_standard_deviations(tmp_path: Path) -> None:
    values, calibration = saved("mount+base"), calibration_of("mount+base")
    assert values["schema"] == SCHEMA == "contactwrench/calibration/1"
    beside = {"schema", "std", "warnings", "verdict", "expected_error", "left_of_poses"}
    assert set(values) == {*beside, *(field.name for field in fields(cw.Calibration))}
    in_motion = {"inertia", "sensor_offset"}
    assert set(values["std"]) == {"weight", "com", "bias", "yaw", "mount", "gravity", *in_motion}
    assert values["std"]["weight"] == calibration.std["weight"]
    assert values["std"]["com"] == calibration.std["com"].tolist()
    assert values["std"]["gravity"] == calibration.std["gravity"].tolist()
    assert np.array_equal(values["B"], calibration.B)


def test_what_a_model_does_not_know_is_null() -> None:
    affine = saved("affine")
    assert [affine[name] for name in ("weight", "mass", "com", "R_flange_sensor", "yaw", "weight_z")] == [None] * 6
    assert [affine["std"][name] for name in ("weight", "com", "yaw", "mount", "gravity")] == [None] * 5
    assert len(affine["std"]["bias"]) == 6
    paper = saved("paper")
    assert paper["weight_z"] == paper["weight"]
    assert paper["weight_xy"] is not None


def test_unknown_keys_a_byte_order_mark_and_other_layout_are_accepted(tmp_path: Path) -> None:
    values = {"comment": {"by": ["hand"]}, **saved(), "later": None}
    values["observability"]["later"] = 1
    values["poses"][0]["later"] = "x"
    path = written(tmp_path, b"\xef\xbb\xbf" + json.dumps(values, indent=4).replace("\n", "\r\n").encode())
    assert_identical(cw.Calibration.load(path), calibration_of("mount"))


def test_files_that_are_no_whole_json(tmp_path: Path) -> None:
    text = to_json(calibration_of("mount"))
    whole = f"expected a saved calibration: {AGAIN}"
    cut_short = f"no whole JSON file (Input data was truncated), {whole}"
    assert refusal(tmp_path, text[: text.index("weight") + 3]) == cut_short
    assert refusal(tmp_path, text[:-3]) == cut_short
    for length in range(1, len(text.rstrip()), len(text) // 25):
        message = refusal(tmp_path, text[:length])
        assert message.startswith("no whole JSON file (")
        assert message.endswith(f"), {whole}")
    a_table = "found no JSON, expected a saved calibration: name one (info shows a recording)"
    assert refusal(tmp_path, b"t,fx,fy") == a_table
    assert refusal(tmp_path, b"") == f"no whole JSON file (Input data was truncated), {whole}"
    assert refusal(tmp_path, text.encode("utf-16")).startswith("no whole JSON file (JSON is malformed")
    assert refusal(tmp_path, text.replace(": 0.", ": NaN", 1)).startswith("no whole JSON file (JSON is malformed")
    assert refusal(tmp_path, text.replace("[", "[1e999, ", 1)).startswith("no whole JSON file (Number out of range")
    assert refusal(tmp_path, b"[" * 100_000).startswith("no whole JSON file (maximum recursion depth")


@pytest.mark.parametrize(
    ("content", "found"),
    [
        ("[]", "None"),
        ("{}", "None"),
        ('"contactwrench/calibration/1"', "None"),
        ('{"schema": 1}', "1"),
        ('{"schema": "payload/3"}', "'payload/3'"),
        ('{"schema": "contactwrench/verification/1"}', "'contactwrench/verification/1'"),
    ],
)
def test_files_of_another_kind(tmp_path: Path, content: str, found: str) -> None:
    assert refusal(tmp_path, content) == (
        f"found schema {found}, expected 'contactwrench/calibration/1': name a file that calibrate wrote"
    )


@pytest.mark.parametrize(
    ("number", "remedy"),
    [("2", "upgrade contactwrench"), ("10", "upgrade contactwrench"), ("0", AGAIN), ("x", AGAIN)],
)
def test_files_of_another_version(tmp_path: Path, number: str, remedy: str) -> None:
    assert refusal(tmp_path, saved() | {"schema": f"contactwrench/calibration/{number}"}) == (
        f"found schema 'contactwrench/calibration/{number}', expected '{SCHEMA}': {remedy}"
    )


def test_a_version_of_thousands_of_digits_is_a_newer_one(tmp_path: Path) -> None:
    message = refusal(tmp_path, saved() | {"schema": "contactwrench/calibration/" + "9" * 5000})
    assert message.endswith("upgrade contactwrench")
    assert len(message) < 200


@pytest.mark.parametrize("key", ["weight", "bias", "B", "covariance", "std", "poses", "provenance", "moments"])
def test_a_missing_key_is_named(tmp_path: Path, key: str) -> None:
    values = saved()
    del values[key]
    assert refusal(tmp_path, values) == (
        f"Object missing required field `{key}`, expected a saved calibration: {AGAIN}"
    )


@pytest.mark.parametrize("key", [key for key in ADDED if "." not in key][:-1])
def test_a_key_that_an_older_file_lacks_is_missed_in_one_that_has_later_ones(tmp_path: Path, key: str) -> None:
    """An older file lacks all that came later: one that was cut by hand is none."""
    values = saved()
    del values[key]
    assert refusal(tmp_path, values) == (
        f"Object missing required field `{key}`, expected a saved calibration: {AGAIN}"
    )
    older = {name: value for name, value in saved().items() if name not in ADDED[ADDED.index(key) :]}
    assert cw.Calibration.load(written(tmp_path, json.dumps(older))).weight == calibration_of("mount").weight


def test_every_key_that_may_be_missing_has_its_place() -> None:
    parts = {Dynamics: "dynamics.", Accelerometer: "dynamics.accelerometer.", StillNoise: "still_noise."}
    parts |= {Pose: "poses.", PoseMoments: "moments.", Observability: "observability.", Alternative: "alternatives."}
    may = {
        f"{where}{each.name}"
        for form, where in {cw.Calibration: "", Derived: "", **parts}.items()
        for each in fields(form)
        if (each.default, each.default_factory) != (MISSING, MISSING)
    }
    assert sorted(ADDED) == sorted({*may, *FOLLOWS, "findings"})


def test_a_key_of_an_object_is_missed_too_where_a_later_one_is_there(tmp_path: Path) -> None:
    last = ADDED.index("orientation_std")
    values = {key: value for key, value in saved().items() if key not in ADDED[last:]}
    values["dynamics"] = {"matrix": []}
    assert "`inertia` - at `$.dynamics`" in refusal(tmp_path, values)
    assert refusal(tmp_path, values | {"orientation_std": None}) == (
        f"Object missing required field `accelerometer` - at `$.dynamics`, expected a saved calibration: {AGAIN}"
    )


@pytest.mark.parametrize("constant", ["NaN", "Infinity", "-Infinity"])
@pytest.mark.parametrize(
    ("path", "where"),
    [(("weight",), "weight"), (("bias", 2), "bias[2]"), (("poses", 1, "wrench", 5), "poses[1].wrench[5]")],
)
def test_what_is_no_number_is_named_with_its_key(
    tmp_path: Path, constant: str, path: tuple[str | int, ...], where: str
) -> None:
    values = saved()
    replaced(*path, by=float(constant))(values)
    assert refusal(tmp_path, values) == (
        f"Expected `float`, got {constant} - at `$.{where}`, expected a saved calibration: {AGAIN}"
    )


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("dof", None, "Expected `float`, got `null` - at `$.dof`"),
        ("weight", "7.7", "Expected `float | null`, got `str` - at `$.weight`"),
        ("bias", [0, 0, None, 0, 0, 0], "Expected `float`, got `null` - at `$.bias[2]`"),
        ("warnings", "none", "Expected `array`, got `str` - at `$.warnings`"),
        ("observability", [], "Expected `object`, got `array` - at `$.observability`"),
    ],
)
def test_a_value_of_the_wrong_type_is_named(tmp_path: Path, key: str, value: object, message: str) -> None:
    assert refusal(tmp_path, saved() | {key: value}) == f"{message}, expected a saved calibration: {AGAIN}"


def scaled(key: str, factor: float) -> Callable[[dict[str, Any]], None]:
    def edit(values: dict[str, Any]) -> None:
        values[key] = (np.array(values[key]) * factor).tolist()

    return edit


def replaced(*path: str | int, by: object) -> Callable[[dict[str, Any]], None]:
    def edit(values: Any) -> None:
        for key in path[:-1]:
            values = values[key]
        values[path[-1]] = by

    return edit


MIRRORED = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]
BY_TOOL = f"follows from weight, com, bias and R_flange_sensor, {EDITED}"


@pytest.mark.parametrize(
    ("model", "edit", "message"),
    [
        ("mount", replaced("model", by="plane"), f"model is 'plane', expected one of {', '.join(MODELS)}: {AGAIN}"),
        ("mount", replaced("parameter_names", 1, by="com"), "parameter_names do not fit model mount, expected weight,"),
        ("mount", replaced("weight", by=8.0), BY_TOOL),
        ("mount", replaced("com", 2, by=-0.06), BY_TOOL),
        ("mount", replaced("bias", 0, by=0.0), BY_TOOL),
        ("mount", replaced("B", 0, 0, by=0.0), BY_TOOL),
        ("mount", replaced("R_flange_sensor", by=np.eye(3).tolist()), BY_TOOL),
        (
            "mount",
            replaced("R_flange_sensor", by=MIRRORED),
            f"found a matrix R_flange_sensor that does more or less than turn, expected a rotation: {AGAIN}",
        ),
        (
            "mount",
            scaled("R_flange_sensor", 1.001),
            f"found a matrix R_flange_sensor that does more or less than turn, expected a rotation: {AGAIN}",
        ),
        ("mount", replaced("R_flange_sensor", by=[1, 0, 0]), "Expected `array`, got `int` - at `$.R_flange_sensor"),
        (
            "mount",
            replaced("R_flange_sensor", by=[[1.0]]),
            f"found R_flange_sensor of another shape, expected (3, 3): {AGAIN}",
        ),
        (
            "mount",
            replaced("poses", 2, "R_base_flange", by=MIRRORED),
            "found a matrix poses[2].R_base_flange that does more or less than turn, expected a rotation",
        ),
        (
            "mount",
            replaced("poses", 2, "wrench", by=[1.0]),
            f"found poses[2].wrench of another shape, expected (6,): {AGAIN}",
        ),
        ("mount", replaced("bias", by=[0.0] * 5), f"found bias of another shape, expected (6,): {AGAIN}"),
        ("mount", replaced("B", 3, by=[0.0] * 3), f"found B of another shape, expected (6, 4): {AGAIN}"),
        (
            "mount",
            replaced("observability", "tilt_range", by=[]),
            "found observability.tilt_range of another shape, expected (2,)",
        ),
        (
            "mount",
            replaced("gravity_direction", by=[0.0, 0.0, -2.0]),
            f"gravity_direction has length 2, expected 1: {AGAIN}",
        ),
        ("mount", replaced("gravity_direction", by=[0.0, 0.0, 1e300]), "gravity_direction has a number beyond 1e30"),
        ("mount", replaced("mass", by=0.0), "expected numbers above 0"),
        ("mount", replaced("mass", by=0.9), f"follows from mass and g, {EDITED}"),
        ("mount", replaced("yaw", by=0.1), f"follows from R_flange_sensor, {EDITED}"),
        ("mount", replaced("parameters", 0, by=9.0), f"follows from weight, com, bias and yaw, {EDITED}"),
        ("yaw", replaced("parameters", 10, by=9.0), f"follows from weight, com, bias and yaw, {EDITED}"),
        ("paper", replaced("weight_z", by=9.0), f"follows from weight, {EDITED}"),
        ("mount", replaced("std", "weight", by=1e-6), f"follows from covariance, {EDITED}"),
        ("mount", replaced("std", "yaw", by=None), f"std.yaw does not fit mount, expected a number: {AGAIN}"),
        ("mount", replaced("covariance", 0, 0, by=-1.0), "covariance has a variance below 0, expected 0 or more"),
        (
            "mount",
            replaced("covariance", 0, 1, by=0.5),
            f"found B_covariance off what follows from covariance, {EDITED}",
        ),
        ("mount", scaled("B_covariance", 1.01), f"found B_covariance off what follows from covariance, {EDITED}"),
        ("mount", scaled("noise", -1.0), "noise has a number that is not above 0, expected 6 above 0"),
        ("mount", scaled("noise", 0.0), "noise has a number that is not above 0, expected 6 above 0"),
        ("mount", replaced("dof", by=-1.0), "dof is -1 and reduced_chi2"),
        ("mount", replaced("yaw", by=None), "model mount lacks weight, mass, com, R_flange_sensor or yaw"),
        (
            "affine",
            replaced("weight", by=7.7),
            "model affine has a weight, mass, com, R_flange_sensor or yaw, expected",
        ),
        ("affine", replaced("bias", 0, by=0.0), f"follows from bias, {EDITED}"),
        ("affine", replaced("parameters", 5, by=9.0), f"follows from B, {EDITED}"),
    ],
)
def test_what_contradicts_itself_is_refused_by_name(
    tmp_path: Path, model: str, edit: Callable[[dict[str, Any]], None], message: str
) -> None:
    values = saved(model)
    edit(values)
    assert message in refusal(tmp_path, values)


def test_an_edit_beyond_the_ninth_decimal_is_refused_and_one_below_is_not(tmp_path: Path) -> None:
    values = saved()
    values["B"][0][0] += 1e-10
    cw.Calibration.load(written(tmp_path, json.dumps(values)))
    values["B"][0][0] += 2e-9
    assert refusal(tmp_path, values) == f"found B 2.1e-09 off what {BY_TOOL}"


def test_a_folder_and_a_missing_file(tmp_path: Path) -> None:
    for path, why in (
        (tmp_path, "found a directory, expected a file: name the file in it"),
        (tmp_path / "gone.json", "there is no such file, expected a readable file: check the path"),
    ):
        with pytest.raises(FileAccessError) as caught:
            cw.Calibration.load(path)
        assert str(caught.value) == f"{path}: {why}"


IN_THREADS = """
import sys
from threading import Barrier, Thread
import contactwrench as cw
cw.Calibration
sys.setswitchinterval(1e-6)
together = Barrier(8)
def load():
    together.wait()
    loaded.append(cw.Calibration.load(sys.argv[1]))
loaded = []
threads = [Thread(target=load) for _ in range(8)]
for thread in threads: thread.start()
for thread in threads: thread.join()
assert len(loaded) == 8
"""


def test_threads_may_load_at_the_same_time(tmp_path: Path) -> None:
    """In half of such processes the first loads ended in a segmentation fault."""
    path = tmp_path / "tool.json"
    rig, R, rng = example(3)
    cw.calibrate(noisy(rig, R, rng), "mount").save(path)
    for _ in range(4):
        done = subprocess.run(
            [sys.executable, "-c", IN_THREADS, str(path)], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
