"""Numbers that nobody means, in every option of every verb and in data: refused in one line, or a finite result.

Options are found by looking at the program, so that a new one is covered by itself. Warnings are errors here.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import contactwrench as cw
from contactwrench.assess.plan import plan
from contactwrench.assess.verify import verify
from contactwrench.assess.weigh import weigh
from contactwrench.cli.main import app
from contactwrench.geometry import ranges
from contactwrench.simulate.settings import Settings, bounded_settings
from tests.support.recordings import MATRIX, PANDA, WRENCH, run_quietly
from tests.support.rigs import example, noisy

EXTREME = (
    *("0", "-0.0", "5e-324", "1e-320", "1e-300", "1e-12", "1e-8", "1e9", "1e155", "1e300", "1e308", "-1e308", "-1"),
    *("inf", "-inf", "nan", "9223372036854775808", "18446744073709551616", "1e400", "1e", "", " ", "1_000", "\u0663"),
    *("0x10", "+-", "9" * 5000),
)
FORMS = {
    "known": [
        *("weight={}+-0.1", "mass=1+-{}", "weight={}+-{}", "com=0,0,{}+-0.01", "com_mm={},0,0+-{}", "mount={},0,0+-1"),
        *("mount=0,0,0+-{}", "mount=1,0,0,0,1,0,0,0,{}+-1", "gravity={},0,{}+-1", "gravity=0,0,-1+-{}"),
    ],
    "lowpass": ["{}", "{}:4", "20:{}"],
    "sensor_filter": ["{}", "{}:4", "20:{}"],
    "gravity": ["{},0,0", "{},{},0"],
    "at": ["{},0,{}"],
    "sensor_com": ["{},0,{}"],
    "sensor_offset": ["{},0,{}"],
    "around": ["0,0,0,0,0,0,{}", "{},{},{},{},{},{},{}"],
    "poses": ["random:{}", "plan:{}"],
    "trajectory": ["stops:{}"],
    "load_g": ["{}", "0,{}"],
    "noise": ["{}", "1/f:{}"],
    "settings": [f"{name}={{}}" for name, _, _ in bounded_settings(Settings())] + ["base.on={}", "tool={}"],
}
BASE = {
    "calibrate": [str(PANDA), "--json", "--model", "mount"],
    "compensate": [str(PANDA), "-c", "tool.json", "-o", "out.csv"],
    "verify": [str(PANDA), "-c", "tool.json", "--json"],
    "weigh": [str(PANDA), "-c", "tool.json", "--json"],
    "plan": ["--json"],
    "diagnose": [str(PANDA), "--json", "--model", "mount"],
    "export": ["tool.json", "--to", "ur", "-o", "out.txt"],
    "simulate": ["-o", "out.csv"],
}
NEEDED = {
    "around": ["--robot", "iiwa7"],
    "pushes": ["--trajectory", "stops:1", "--set", "recording.rate=20"],
    "trajectory": ["--set", "recording.rate=20"],
    "mount_tilt_sd": ["--model", "auto"],
    "base_tilt_sd": ["--model", "auto"],
}


def _options() -> Iterator[tuple[str, Any]]:
    """Every option of every verb whose value is a text or a number, no file's name."""
    for verb, command in typer.main.get_command(app).commands.items():  # type: ignore[attr-defined]
        for option in command.params:
            if option.param_type_name == "option" and not getattr(option, "is_flag", False) and verb in BASE:
                kind = str(option.type_descriptor.annotation)
                if "Path" not in kind and option.name not in ("help", "to", "shared"):
                    yield verb, option


OPTIONS = list(_options())


@st.composite
def commands(draw: st.DrawFn) -> list[str]:
    """A command with an extreme number in one of its options."""
    verb, option = draw(st.sampled_from(OPTIONS))
    form = draw(st.sampled_from(FORMS.get(option.name, ["{}", "{},{},{}"])))
    value = form.replace("{}", draw(st.sampled_from(EXTREME)))
    flag = f"{option.opts[-1]}={value}" if option.opts[-1].startswith("--") else f"{option.opts[-1]}{value}"
    return [verb, *BASE[verb], *NEEDED.get(option.name, []), flag]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("extreme")
    measured()[1].save(path / "tool.json")
    return path


def test_a_number_states_its_range_where_it_is_declared() -> None:
    numeric = [
        (verb, o) for verb, o in OPTIONS if str(o.type_descriptor.annotation) in ("<class 'float'>", "<class 'int'>")
    ]
    assert len(numeric) > 15
    assert [(verb, option.name) for verb, option in numeric if option.callback is None] == []


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(arguments=commands())
def test_no_option_takes_the_program_down(
    arguments: list[str], folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        _assert_calm(arguments, capfd)


def _assert_calm(arguments: list[str], capfd: pytest.CaptureFixture[str]) -> None:
    capfd.readouterr()
    status = run_quietly(arguments)
    out, err = capfd.readouterr()
    said = [line for line in err.splitlines() if not line.startswith("Note: ")]
    assert status in (0, 1, 2)
    assert len(said) <= 1
    assert "Warning" not in err
    assert "WARNING" not in err
    assert not os.path.exists("MUJOCO_LOG.TXT")
    if status == 2:
        assert said[0].startswith("contactwrench: ")
    elif "--json" in arguments:
        json.loads(out, parse_constant=_no_json)


def _no_json(token: str) -> None:
    raise AssertionError(token)


INTO_DATA = (5e-324, 1e-320, 1e-300, 1e-160, -0.0, 1e-30, 1e9, 9.9e8, 1e16, 1e155, 1e200, 1e308, -1e308, np.inf, np.nan)
COLUMNS = ("t", *WRENCH, *MATRIX, "x", "y", "z", "load_g", "episode_index")


@st.composite
def tables(draw: st.DrawFn) -> str:
    """A fine table of poses, in which some cells, a column or all of a kind are extreme."""
    rows = draw(st.sampled_from([0, 1, 2, 12, 12, 12]))
    rig, R, rng = example(3, 12)
    wrench = noisy(rig, R, rng).wrench
    extra = np.column_stack([np.zeros((12, 4)), np.zeros(12)])
    values = np.column_stack([np.arange(12.0), wrench, R.reshape(-1, 9), extra])[:rows]
    if draw(st.booleans()) and rows:
        values[:, 1:7] = values[0, 1:7]
    for _ in range(draw(st.integers(0, 2)) if rows else 0):
        of = draw(st.sampled_from([slice(0, 1), slice(1, 4), slice(4, 7), slice(7, 16), slice(16, 19), slice(19, 21)]))
        which = draw(st.one_of(st.integers(0, rows - 1), st.just(slice(None))))
        number = draw(st.sampled_from(INTO_DATA))
        with np.errstate(all="ignore"):
            values[which, of] = values[which, of] * number if draw(st.booleans()) else number
    picked = [k for k, name in enumerate(COLUMNS) if name != "t" or draw(st.booleans())]
    lines = [",".join(repr(float(value)) for value in row) for row in values[:, picked]]
    return "\n".join([",".join(COLUMNS[k] for k in picked), *lines, ""])


VERBS = (
    ["info", "in.csv", "--json"],
    *(["calibrate", "in.csv", "--json", "--model", model] for model in ("paper", "yaw", "mount", "affine")),
    ["compensate", "in.csv", "-c", "tool.json", "-o", "out.csv"],
    ["compensate", "in.csv", "-c", "tool.json", "-o", "out.csv", "--contact", "--lowpass", "0.1", "--at", "1,2,3"],
    ["verify", "in.csv", "-c", "tool.json", "--json"],
    ["weigh", "in.csv", "-c", "tool.json", "--json"],
    ["plan", "-n", "1", "--from", "in.csv", "--json", "--model", "mount"],
    ["diagnose", "in.csv", "--json", "--model", "mount"],
)


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(table=tables(), arguments=st.sampled_from(VERBS))
def test_no_number_in_a_table_takes_the_program_down(
    table: str, arguments: list[str], folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        Path("in.csv").write_text(table, encoding="utf-8")
        _assert_calm(arguments, capfd)


ARGUMENTS = st.sampled_from([0.0, -0.0, 5e-324, 1e-300, 1e-12, 1e300, -1e308, np.inf, np.nan, 2**64])


@cache
def measured() -> tuple[cw.Samples, cw.Calibration]:
    samples = cw.read(PANDA)
    return samples, cw.calibrate(samples, "mount")


@settings(max_examples=80)
@given(number=ARGUMENTS, place=st.integers(0, 15))
def test_python_refuses_or_answers_with_finite_numbers(number: Any, place: int) -> None:
    samples, calibration = measured()
    six = [number] * 6
    calls: list[Any] = [
        lambda: cw.calibrate(samples, "mount", g=number).parameters,
        lambda: cw.calibrate(samples, "mount", noise=six).parameters,
        lambda: cw.calibrate(samples, "auto", mount_tilt_sd=number).parameters,
        lambda: cw.calibrate(samples, "mount", known={"weight": (number, 0.1)}).parameters,
        lambda: cw.calibrate(samples, "mount", known={"com": ((0.0, 0.0, 0.05), number)}).parameters,
        lambda: cw.calibrate(samples, "mount+base", gravity=(number, 0.0, -1.0)).parameters,
        lambda: verify(calibration, samples, limit_force=number).rms,
        lambda: weigh(calibration, samples, g=number).mass,
        lambda: len(plan(number, model="mount")),
        *(
            partial(_live, calibration, samples, **{name: number})
            for name in ("rate", "noise", "lowpass", "sensor_filter", "delay", "drift", "minimum_duration")
        ),
    ]
    try:
        assert np.isfinite(calls[place]()).all()
    except cw.ContactWrenchError as error:
        assert "\n" not in str(error)  # noqa: PT017
        assert len(str(error)) < 300  # noqa: PT017


def _live(calibration: cw.Calibration, samples: cw.Samples, **stated: Any) -> Any:
    compensator = cw.Compensator(calibration, fast=False, **stated)
    done = compensator.run(samples.wrench, samples.R_base_flange, 0.01 * np.arange(len(samples)))
    return done.wrench[done.valid]


@settings(max_examples=30)
@given(
    numbers=st.lists(st.tuples(st.integers(0, 10), st.sampled_from([*INTO_DATA, 2.0**64])), min_size=1, max_size=3),
    row=st.integers(0, 39),
)
def test_no_sample_takes_a_loop_down(numbers: list[tuple[int, float]], row: int) -> None:
    """Whatever comes in, what comes out and is called valid is finite."""
    quat = np.tile([0.0, 0.0, 0.0, 1.0], (40, 1))
    table = np.column_stack([np.zeros((40, 6)), quat, 0.01 * np.arange(40)])
    for column, number in numbers:
        table[row, column] = number
    compensator = cw.Compensator(measured()[1], drift=0.05, lowpass=5.0, sensor_filter=5.0, rate=100.0, fast=False)
    done = compensator.run(table[:, :6], table[:, 6:10], table[:, 10])
    assert np.isfinite(done.wrench[done.valid]).all()


@pytest.mark.parametrize(
    ("range_", "inside", "outside"),
    [
        (ranges.G, (0.1, 1.62, 25.0, 100.0), (0.0, 1e-320, 101.0, np.nan)),
        (ranges.LOAD_KG, (0.0, -0.0, 1e-6), (5e-324, -1.0, np.inf)),
    ],
)
def test_what_a_range_holds(range_: ranges.Range, inside: tuple[float, ...], outside: tuple[float, ...]) -> None:
    assert range_.holds(np.array(inside)).all()
    assert not range_.holds(np.array(outside)).any()


def test_a_position_that_is_none_refuses_nothing() -> None:
    samples = cw.read(PANDA)
    position = np.zeros((len(samples), 3))
    position[3, 1], position[5, 0] = np.nan, 1e308
    there = cw.Samples(samples.wrench, samples.R_base_flange, position=position)
    assert there.position is not None
    assert np.flatnonzero(np.isnan(there.position).any(axis=1)).tolist() == [3, 5]
    assert np.array_equal(cw.calibrate(there, "mount").parameters, cw.calibrate(samples, "mount").parameters)
