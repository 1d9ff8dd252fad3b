"""A calibration file is believed as far as it is consistent: edits of every field, generated from the file itself."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.calibration.file import ADDED, to_json
from contactwrench.errors import FileFormatError
from contactwrench.geometry.rotations import spread_rotations
from contactwrench.samples.poses import moments_of_poses
from tests.support.recordings import PANDA, written
from tests.support.rigs import NOISE, example, noisy
from tests.support.world import Array, noisy_readings, random_rig, random_rotations

OF_EACH = 1
"""Places of one kind, as the readings of poses, that are edited."""

ONLINE = {
    "delay": "its value, within 10 s",
    "delay_std": "its value",
    "still_noise.duration.*": "its values, ascending",
    "still_noise.row_std": "its order",
    "still_noise.row_std.*": "its values, 0 and more",
    "still_noise.std.*": "their order",
    "still_noise.std.*.*": "its values, 0 and more",
    "poses.*.wrench_cov.*.*": "variances",
    "gain_covariance.*.*": "a little",
}
"""What no other number can check, and what of it: it changes the std, the delay or the contacts of a `Compensator`.
docs/conventions.md has the list."""


@cache
def calibration(model: str) -> cw.Calibration:
    """Of a stream, so that every field is there; the moving arm's delay is put in."""
    rng = np.random.default_rng(3)
    rig, R = random_rig(rng), np.repeat(random_rotations(9, rng), 60, axis=0)
    t: Array = 0.02 * np.arange(540.0) + np.repeat(3.0 * np.arange(9.0), 60)
    of_stream = cw.calibrate(cw.Samples(noisy_readings(rig, R, NOISE, rng), R, t), model)
    return replace(of_stream, delay=0.02, delay_std=0.001)


def places(value: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[tuple[str | int, ...], Any]]:
    """Every field of a JSON document, lists as a whole and part by part."""
    if isinstance(value, dict):
        for key, part in value.items():
            yield from places(part, (*path, key))
        return
    yield path, value
    if isinstance(value, list):
        for k, part in enumerate(value):
            yield from places(part, (*path, k))


def edits(value: Any) -> list[Any]:
    if isinstance(value, bool) or value is None:
        return []
    if isinstance(value, int | float):
        return [-value, value * 1.01, value * 1000, type(value)(0)]
    if isinstance(value, str):
        return [f"{value}x"]
    transposed = np.array(value, dtype=object).T.tolist()
    return [value[::-1], [*value[1:], *value[:1]], transposed]


def uses(c: cw.Calibration) -> tuple[Array, Array]:
    """What compensating gives, and what a `Compensator` says beside it."""
    rng = np.random.default_rng(8)
    R = Rotation.from_rotvec(np.linspace(0.0, 1.0, 20)[:, None] * [1.0, 0.4, -0.3]).as_matrix()
    wrench = rng.normal(size=(20, 6))
    online = cw.Compensator(c, rate=100.0, fast=False).run(wrench, R, 0.01 * np.arange(20))
    said: list[Array] = [online.wrench, online.std, online.threshold, c.wrench_std(R), online.contact.astype(float)]
    return c.compensate(wrench, R), np.concatenate([part.ravel() for part in said])


@pytest.mark.parametrize("model", ["auto", "affine"])
def test_an_edited_file_is_refused_or_compensates_as_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, model: str
) -> None:
    few = spread_rotations(12, 6)  # over which the error to expect is looked for, hundreds of times here
    monkeypatch.setattr("contactwrench.calibration.fields.spread_rotations", lambda *_: few)
    text = to_json(replace(calibration(model)))
    path, (wrench, online) = tmp_path / "tool.json", uses(calibration(model))
    seen: Counter[str] = Counter()
    changed, said, document = set(), [], json.loads(text)
    for place, value in places(json.loads(text)):
        kind = ".".join("*" if isinstance(key, int) else key for key in place)
        seen[kind] += 1
        for edit in edits(value) if seen[kind] <= OF_EACH else []:
            if edit == value:
                continue
            put(*place, by=edit)(document)
            path.write_bytes(msgspec.json.encode(document))
            put(*place, by=value)(document)
            try:
                loaded = cw.Calibration.load(path)
            except FileFormatError as error:
                said.append((kind, str(error)))
                continue
            contact, beside = uses(loaded)
            np.testing.assert_allclose(contact, wrench, rtol=1e-8, atol=1e-8, err_msg=kind)
            if not np.allclose(beside, online, rtol=1e-6, atol=1e-12, equal_nan=True):
                changed.add(kind)
    assert changed <= set(ONLINE), changed - set(ONLINE)
    assert len(said) > 100
    assert [(kind, error) for kind, error in said if not _names(error, kind)] == []


def _names(error: str, kind: str) -> bool:
    return kind.partition(".")[0] in error or "what follows from" in error


def saved(c: cw.Calibration) -> dict[str, Any]:
    values: dict[str, Any] = json.loads(to_json(c))
    return values


def _negated(values: dict[str, Any]) -> None:
    values["gravity_direction"] = [-part for part in values["gravity_direction"]]


def _consistently_heavier(values: dict[str, Any]) -> None:
    """All that says how heavy the tool is, as one number after the other would have to be edited."""
    for name in ("weight", "mass"):
        values[name] *= 1.1
    values["parameters"][0] *= 1.1
    for row in values["B"]:
        row[:3] = [1.1 * entry for entry in row[:3]]


def _not_positive(values: dict[str, Any]) -> None:
    C = values["covariance"]
    C[13][14] = C[14][13] = 2.0 * np.sqrt(C[13][13] * C[14][14])


def put(*place: str | int, by: Any) -> Callable[[dict[str, Any]], None]:
    def edit(values: Any) -> None:
        for key in place[:-1]:
            values = values[key]
        values[place[-1]] = by(values[place[-1]]) if callable(by) else by

    return edit


LEFT = "off what follows from B, gravity_direction and the poses, expected a file as it was saved"


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (_negated, LEFT),
        (put("gravity_direction", by=lambda d: [d[1], d[0], d[2]]), LEFT),
        (put("poses", 3, "wrench", 2, by=lambda f: f + 0.1), LEFT),
        (put("poses", 3, "rejected", by="in contact"), LEFT),
        (put("left_of_poses", by=[0.0] * 6), LEFT),
        (put("left_of_poses", by=[0.0] * 3), "found left_of_poses of another shape, expected (6,)"),
        (_consistently_heavier, "found B_covariance off what follows from covariance, expected a file as it was saved"),
        (_not_positive, "covariance is not positive semi-definite, expected a covariance"),
        (put("covariance", 13, 14, by=lambda c: c + 1e-7), "covariance is not symmetric, expected a covariance"),
        (put("poses", 0, "wrench_cov", 0, 1, by=1.0), "poses[0].wrench_cov is not symmetric, expected a covariance"),
        (
            put("poses", 0, "wrench_cov", 0, 0, by=-1.0),
            "poses[0].wrench_cov is not positive semi-definite, expected a covariance",
        ),
        (put("poses", 1, "n", by=0), "poses[1].n is 0, expected 1 row or more"),
        (
            put("noise", 1, by=lambda n: 1.01 * n),
            "off what follows from noise and covariance, expected a file as it was saved",
        ),
        (put("expected_error", by=[1.0]), "found expected_error of another shape, expected (2,)"),
        (put("delay", by=-20.0), "delay is -20 s, expected at most 10 s either way"),
        (put("dof", by=0.0), "dof is 0, expected no more than the least parameter_dof"),
        (put("dof", by=1e6), "dof is 1e+06, expected no more than the least parameter_dof"),
    ],
)
def test_what_the_numbers_contradict_is_named(
    tmp_path: Path, edit: Callable[[dict[str, Any]], None], message: str
) -> None:
    values, path = saved(calibration("auto")), tmp_path / "tool.json"
    edit(values)
    path.write_text(json.dumps(values))
    with pytest.raises(FileFormatError) as caught:
        cw.Calibration.load(path)
    assert message in str(caught.value)
    assert str(caught.value).startswith(f"{path}: ")
    assert str(caught.value).endswith(": calibrate again or restore the file")


@cache
def honest() -> dict[str, cw.Calibration]:
    """Calibrations whose poses are explained badly, or hardly, or by something else too."""
    rig, R, rng = example(5, poses=12)
    clean, t = noisy(rig, R, rng).wrench, 10.0 * np.arange(12.0)
    outlier, stepped = clean.copy(), clean.copy()
    outlier[4, 1] += 8.0
    stepped[5:] += 1.0
    drifting = clean + np.linspace(0.0, 2.0, 12)[:, None]
    full = cw.calibrate(cw.Samples(clean, R), "mount+base")
    return {
        "exact": cw.calibrate(cw.Samples(noisy(rig, R, rng, 1e-12 * NOISE).wrench, R), "mount"),
        "one left out": cw.calibrate(cw.Samples(outlier, R)),
        "stepped": cw.calibrate(cw.Samples(stepped, R, t)),
        "drifting": cw.calibrate(cw.Samples(drifting, R, t)),
        "another zero": cw.calibrate(cw.Samples(clean[:1] + 1.0, R[:1]), prior=full),
        "another gravity": full.with_gravity([0.3, 0.1, -1.0]),
        "another base": full.with_base(R[0], "cell"),
        "many poses": _with_sums(cw.Samples(clean, R)),
        "many exact poses": _with_sums(noisy(rig, R, rng, 1e-9 * NOISE)),
        "far from zero": cw.calibrate(cw.Samples(_along_z(R) + rng.normal(0.0, NOISE, (12, 6)) + 1e5, R), "paper"),
        "measured": cw.calibrate(cw.read(PANDA)),
        "without poses": replace(full, poses=()),
    }


def _along_z(R: Array) -> Array:
    """Readings (n, 6) of 0.5 N on a sensor whose axes are the flange's, as the paper assumes."""
    force = -0.5 * R[:, 2]
    return np.hstack([force, np.cross([0.01, -0.02, 0.08], force)])


def _with_sums(samples: cw.Samples) -> cw.Calibration:
    """As of more than 10,000 poses."""
    c = cw.calibrate(samples, "mount")
    R, wrench = (np.array([getattr(pose, name) for pose in c.poses]) for name in ("R_base_flange", "wrench"))
    return replace(c, poses=(), moments=moments_of_poses(R, wrench))


def test_an_honest_calibration_is_believed(tmp_path: Path) -> None:
    for name, c in honest().items():
        c.save(tmp_path / "tool.json")
        loaded = cw.Calibration.load(tmp_path / "tool.json")
        assert to_json(loaded) == to_json(c), name


def test_what_gains_add_to_a_covariance_is_symmetric() -> None:
    """However far what is added to them cancels."""
    found = [(name, c.gain_covariance) for name, c in honest().items() if c.gain_covariance is not None]
    assert found
    for name, covariance in found:
        assert np.array_equal(covariance, covariance.T), name


def test_a_file_of_another_machine_which_rounds_otherwise_is_believed(tmp_path: Path) -> None:
    """Sums of squares leave little of each other where the bias is large: here, what the poses themselves leave."""
    rig, R, rng = example(5, poses=12)
    samples = cw.Samples(noisy(rig, R, rng).wrench + 1e4, R)
    c = _with_sums(samples)
    left = np.sqrt(np.mean((samples.wrench - c.predict(R)) ** 2, axis=0))
    values = saved(c)
    values["left_of_poses"] = left.tolist()
    (tmp_path / "tool.json").write_text(json.dumps(values))
    cw.Calibration.load(tmp_path / "tool.json")


def test_sums_that_stand_for_poses_are_held_against_the_rest_too(tmp_path: Path) -> None:
    path = tmp_path / "tool.json"
    for edit, message in (
        (_negated, LEFT),
        (put("moments", "n", by=13), "found moments.design"),
        (put("moments", "cross", 0, 0, by=lambda x: 3.0 * x), "moments is not positive semi-definite"),
        (put("moments", "design", 0, 3, by=lambda x: x + 9.0), "moments is not symmetric"),
    ):
        values = saved(honest()["many poses"])
        edit(values)
        path.write_text(json.dumps(values))
        with pytest.raises(FileFormatError) as caught:
            cw.Calibration.load(path)
        assert message in str(caught.value)


def test_a_file_from_before_lacks_what_came_later_and_is_read_as_it_was(tmp_path: Path) -> None:
    values = {key: value for key, value in saved(calibration("auto")).items() if key not in ADDED}
    path = tmp_path / "tool.json"
    path.write_text(json.dumps(values))
    old = cw.Calibration.load(path)
    assert np.array_equal(old.B, calibration("auto").B)
    assert (old.delay, old.still_noise, old.alternatives, old.parameter_dof) == (None, None, (), None)
    values["noise"] = [2.0 * each for each in values["noise"]]
    path.write_text(json.dumps(values))
    assert np.array_equal(cw.Calibration.load(path).noise, values["noise"])


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"noise": [1e7, *[0.1] * 5]}, "noise has a number beyond 1e+06, expected none"),
        ({"residual_rms": [1e308, *[0.1] * 5]}, "residual_rms has a number beyond 1e30, expected none"),
    ],
)
def test_numbers_that_overflow_are_refused(tmp_path: Path, changed: dict[str, Any], message: str) -> None:
    values = json.loads(to_json(cw.calibrate(cw.read(PANDA), "mount"))) | changed
    with pytest.raises(FileFormatError) as caught:
        cw.Calibration.load(written(tmp_path, json.dumps(values), "tool.json"))
    assert str(caught.value) == f"{tmp_path / 'tool.json'}: {message}: calibrate again or restore the file"


def test_an_older_file_is_held_against_its_poses_roughly(tmp_path: Path) -> None:
    values = json.loads(to_json(cw.calibrate(cw.read(PANDA), "mount")))
    values = {key: value for key, value in values.items() if key not in ADDED[ADDED.index("left_of_poses") :]}
    path = written(tmp_path, json.dumps(values), "tool.json")
    assert cw.Calibration.load(path).weight == values["weight"]
    values["gravity_direction"] = [-value for value in values["gravity_direction"]]
    path.write_text(json.dumps(values))
    with pytest.raises(FileFormatError, match=r"found 15\.\d N left in the poses, and residual_rms 0\.\d+ N"):
        cw.Calibration.load(path)
