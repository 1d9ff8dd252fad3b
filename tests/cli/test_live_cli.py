"""`contactwrench live` and `lab` with input that is wrong: one line, status 2, and no page; and a recording played."""

from __future__ import annotations

import csv
import os
import socket
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.cli.live_lab import Hands
from contactwrench.lab.lines import TcpLines
from contactwrench.lab.sri import Sri
from contactwrench.lab.truth import Plain
from contactwrench.lab.ur import Ur
from contactwrench.live.page import Hub
from contactwrench.live.pump import Pump
from contactwrench.live.session import Session
from contactwrench.live.uri import known_sources
from tests.lab.clients import nothing_left
from tests.support.devices import answering, free_port
from tests.support.moving import smooth_rotations
from tests.support.recordings import MATRIX, PANDA, WRENCH, csv_text, run, written
from tests.support.rigs import example, noisy

Capture = pytest.CaptureFixture[str]
NEITHER = "found neither --sensor nor --from, expected --sensor URI, or --from FILE"


@pytest.fixture(scope="module")
def calibration(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("known") / "cal.json"
    cw.calibrate(cw.read(PANDA), "mount").save(path)
    return path


@pytest.fixture
def devices(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[str, str]]:
    """The URIs of a sensor and a robot that are there, and believed at a glance to have their rates."""
    monkeypatch.setattr("contactwrench.live.devices.PROBE", (0.05, 10.0))
    with Sri(Plain()) as sri, Ur(Plain()) as ur:
        yield sri.uri, ur.uri


def _begun(*_: object) -> None:
    raise AssertionError("the session began")


def complaint(capsys: Capture, verb: str, *arguments: str | Path) -> str:
    """What the program says of input that is wrong, on one line, with no page before it and no thread left. A session
    that begins nevertheless would have no end.
    """
    with nothing_left(), pytest.MonkeyPatch.context() as patch:
        patch.setattr("contactwrench.cli.live._until_a_signal", _begun)
        patch.setattr("contactwrench.cli.live_terminal.compile_now", lambda _: None)  # said where no file has it yet
        done = run(capsys, verb, *arguments)
    assert (done.status, done.out) == (2, "")
    assert done.err.startswith("contactwrench: ")
    assert done.err.count("\n") == 1
    return done.err.removeprefix("contactwrench: ").rstrip("\n")


SCHEMES = ", ".join(each.scheme for each in known_sources())


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("--sensor foo://x", f"foo://x: found the scheme foo, expected one of {SCHEMES}"),
        ("--sensor 10.0.0.7", "10.0.0.7: found no scheme, expected a URI like sri://10.0.0.7"),
        ("--sensor sri://no.invalid", "sri://no.invalid: found no host no.invalid, expected the SRI interface box: "
         "check the name, or write its address"),
        ("--sensor sri://x?rat=3", "sri://x?rat=3: found the option rat, expected one of rate, zero: correct the URI"),
        ("--sensor rig://?seed=1&seed=2",
         "rig://?seed=1&seed=2: found seed=1 and seed=2, expected one: correct the URI"),
        (f"--sensor rig://?seed={10**15}",
         f"rig://?seed={10**15}: found seed={10**15}, expected a whole number of at most 15 digits: correct the URI"),
        ("--sensor sri://no.invalid --out foo://x", "foo://x: found the scheme foo, expected one of file, ros2, udp"),
        ("--sensor sri://no.invalid --record a.xyz",
         "a.xyz: found the suffix .xyz, expected .csv, .parquet, .mcap"),
        ("", NEITHER),
        ("--robot ur://10.0.0.5", NEITHER),
        ("--from a.csv --sensor sri://x",
         "found --from and --sensor, expected one: a recording has both streams"),
        ("--from a.csv --robot ur://x",
         "found --from and --robot, expected one: a recording has both streams"),
        ("--sensor stdin: --wizard --no-page",
         "found --wizard and stdin:, expected one to read what comes in: use the page"),
        ("--sensor sri://10.0.0.5?zero=1 --robot ur://10.0.0.6 -c a.json",
         "found -c and zero=1, expected one: a box that zeroes itself anew is no longer at the calibration's zero; "
         "leave zero=1 out, or calibrate anew"),
        ("--from a.csv --no-page",
         "found --no-page and no calibration, expected -c CAL.json, or --wizard"),
        ("--from a.csv", "a.csv: there is no such file, expected a readable file: check the path"),
        ("--from a.csv -c b.json", "b.json: there is no such file, expected a readable file: check the path"),
        ("--from a.csv --listen here", "--listen is 'here', expected HOST:PORT, as in 127.0.0.1:8010"),
        ("--from a.csv --listen 127.0.0.1:99999",
         "--listen is '127.0.0.1:99999', expected HOST:PORT, as in 127.0.0.1:8010"),
        ("--from a.csv --listen 127.0.0.1:²", "--listen is '127.0.0.1:²', expected HOST:PORT, as in 127.0.0.1:8010"),
        ("--from a.csv --sign push", "--sign is 'push', expected pull or reaction"),
        ("--from a.csv --ranges 1,2",
         "--ranges is '1,2', expected six numbers FX,FY,FZ,TX,TY,TZ, 1e-06 to 1e+09 N or N m"),
        ("--from a.csv --lab here", "here: found no scheme, expected a URI like sri://here"),
        ("--from a.csv --lab udp://:1",
         "--lab is udp://:1, expected tcp://127.0.0.1:PORT, as `contactwrench lab` says"),
        ("--from a.csv --speed -1", "Invalid value for '--speed': found -1, expected 0 or 0.001 to 1e+06: "
         "try 'contactwrench live --help'"),
    ],
)  # fmt: skip
def test_what_cannot_be_meant(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture, arguments: str, said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    assert complaint(capsys, "live", *arguments.split()) == said


def test_an_output_that_is_there_is_kept(capsys: Capture, calibration: Path) -> None:
    said = complaint(capsys, "live", "--from", PANDA, "-o", calibration)
    assert (
        said
        == f"{calibration}: found a file there already, expected a new name: name another, or replace it with --force"
    )


@pytest.mark.parametrize(
    ("scheme", "device"),
    [
        ("sri", "the SRI interface box"),
        ("ur", "the robot's controller, RTDE switched on"),
        ("tcp", "the server of lines"),
    ],
)
def test_nobody_listens(capsys: Capture, scheme: str, device: str) -> None:
    port = free_port()
    uri = f"{scheme}://127.0.0.1:{port}"
    assert complaint(capsys, "live", "--sensor", uri) == (
        f"{uri}: found nobody listening at 127.0.0.1 port {port}, expected {device}: "
        "check its power, its cable and the address; it must be in this computer's network"
    )


@pytest.mark.parametrize(
    ("scheme", "expected"),
    [
        ("sri", "ACK+ and a value, as an SRI box answers: check that this is the SRI interface box"),
        ("ur", "an RTDE server: check that this is the robot's controller, RTDE switched on"),
    ],
)
def test_an_http_server_is_no_device(capsys: Capture, scheme: str, expected: str) -> None:
    with answering(b"HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n") as port:
        said = complaint(capsys, "live", "--sensor", f"{scheme}://127.0.0.1:{port}")
    assert said == (
        f"{scheme}://127.0.0.1:{port}: found an answer that begins 'HTTP/1.1 400 Bad Request', expected {expected}"
    )


def test_a_sensor_at_another_rate(capsys: Capture) -> None:
    with TcpLines(Plain(), rate=250.0) as lines:
        begin, rate, rest = complaint(capsys, "live", "--sensor", f"{lines.uri}?rate=1000").partition(
            " samples a second"
        )
        found = float(begin.removeprefix(f"{lines.uri}?rate=1000: found "))
    assert rate
    assert abs(found - 250.0) < 50.0
    assert rest == (f", expected 1000: set that rate in the device, or ask for it, as in {lines.uri}?rate={found:.0f}")


def test_a_sensor_alone_turns_nothing(capsys: Capture, devices: tuple[str, str]) -> None:
    assert complaint(capsys, "live", "--sensor", devices[0]) == (
        f"{devices[0]}: found no orientation of the flange, expected one: name another device for that"
    )


@pytest.mark.parametrize(
    ("role", "real"), [("sensor", "SRI M8128"), ("robot", "Universal Robots e-series, PolyScope 5.15.0")]
)
def test_the_calibration_of_another_device(
    tmp_path: Path, capsys: Capture, calibration: Path, devices: tuple[str, str], role: str, real: str
) -> None:
    known = cw.Calibration.load(calibration)
    replace(known, provenance={**known.provenance, f"live_{role}": "another"}).save(tmp_path / "other.json")
    said = complaint(
        capsys, "live", "--sensor", devices[0], "--robot", devices[1], "-c", tmp_path / "other.json", "--no-page"
    )
    assert said == f"{tmp_path / 'other.json'}: found the calibration of another, expected one of {real}: name its own"


@pytest.mark.parametrize(("may", "policy", "nice", "then"), [
    (True, os.SCHED_OTHER, 0, os.SCHED_RR),
    (False, os.SCHED_OTHER, 0, os.SCHED_OTHER),
    (True, os.SCHED_OTHER, 10, os.SCHED_OTHER),
    (True, os.SCHED_FIFO, 0, os.SCHED_FIFO),
])  # fmt: skip
def test_a_session_runs_before_other_programs_where_it_may(
    monkeypatch: pytest.MonkeyPatch,
    capsys: Capture,
    devices: tuple[str, str],
    calibration: Path,
    may: bool,
    policy: int,
    nice: int,
    then: int,
) -> None:
    """And where whoever started it has not chosen otherwise; afterwards all is as it was."""
    policies, seen = [policy], []

    def ask(pid: int, policy: int, parameters: os.sched_param) -> None:
        if not may:
            raise PermissionError(1, "Operation not permitted")
        assert (pid, parameters.sched_priority) == (0, int(policy == os.SCHED_RR))
        policies.append(policy)

    monkeypatch.setattr(os, "sched_getscheduler", lambda _: policies[-1])
    monkeypatch.setattr(os, "getpriority", lambda *_: nice)
    monkeypatch.setattr(os, "sched_setscheduler", ask)
    monkeypatch.setattr("contactwrench.cli.live._until_a_signal", lambda *_: seen.append(policies[-1]))
    monkeypatch.setattr("contactwrench.cli.live_terminal.compile_now", lambda _: None)  # a thread of its own
    arguments = ("--sensor", devices[0], "--robot", devices[1], "-c", calibration, "--no-page")
    with nothing_left():
        assert run(capsys, "live", *arguments).status == 0
    assert seen == [then]
    assert policies[-1] == policy


@pytest.mark.parametrize("output", [True, False])
def test_a_calibration_that_has_a_name_is_written_when_it_is_accepted(
    monkeypatch: pytest.MonkeyPatch, capsys: Capture, devices: tuple[str, str], tmp_path: Path, output: bool
) -> None:
    seen: list[object] = []

    def session(*given: Any, save_accepted: bool, **named: Any) -> Session:
        seen.append(save_accepted)
        return Session(*given, save_accepted=save_accepted, **named)

    monkeypatch.setattr("contactwrench.live.session.Session", session)
    monkeypatch.setattr("contactwrench.cli.live._until_a_signal", lambda *_: None)
    named = ("-o", tmp_path / "new.json") if output else ()
    arguments = ("--sensor", devices[0], "--robot", devices[1], "--no-page", "--wizard", *named)
    assert run(capsys, "live", *arguments).status == 0
    assert seen == [output]


@pytest.mark.parametrize("wizard", [True, False])
def test_events_are_said_in_words_too_to_whoever_is_at_the_wizard(
    monkeypatch: pytest.MonkeyPatch, capsys: Capture, devices: tuple[str, str], calibration: Path, wizard: bool
) -> None:
    def a_moment(pump: Pump, *_: object) -> None:
        pump.start()
        pump.wait(0.2)
        pump.close()

    monkeypatch.setattr("contactwrench.cli.live._until_a_signal", a_moment)
    mode = ("--wizard",) if wizard else ("-c", calibration)
    done = run(capsys, "live", "--sensor", devices[0], "--robot", devices[1], "--no-page", "--events", *mode)
    assert sum('"kind":"connected"' in line for line in done.out.splitlines()) == 2
    assert done.err.count("SRI M8128: connected") == wizard


@pytest.mark.parametrize(
    ("was", "now"),
    [
        ("Universal Robots e-series, PolyScope 5.12.0", "Universal Robots e-series, PolyScope 5.13.1"),
        ("lines of udp://:9555", "lines of udp://:9556"),
        ("SRI M8128", "SRI M8128"),
    ],
)
def test_a_calibration_is_that_of_a_kind_of_device(was: str, now: str) -> None:
    """Whose program may be a newer one; and the names are no options for reading what was recorded."""
    from contactwrench.live.devices import require_devices, with_devices
    from contactwrench.live.source import About
    from contactwrench.recording.options import remembered

    before, after = (About(name, wrench=True, orientation=True) for name in (was, now))
    known = with_devices(cw.calibrate(cw.read(PANDA), "mount"), before, before)
    require_devices(known, "cal.json", after, after)
    assert "robot" not in remembered(known.provenance)


def test_the_calibration_of_a_larger_sensor() -> None:
    from contactwrench.errors import InputError
    from contactwrench.live.devices import require_devices
    from contactwrench.live.source import About

    known = cw.calibrate(cw.read(PANDA), "mount")
    small = About("small", wrench=True, orientation=True, ranges=(1.0, 1.0, 1.0, 0.1, 0.1, 0.1))
    free = abs(known.bias[0]) + np.linalg.norm(known.B[0, :3])
    with pytest.raises(InputError) as refused:
        require_devices(known, "cal.json", small, small)
    assert str(refused.value) == (
        f"cal.json: found fx of a free tool up to {free:.3g}, expected at most the sensor's range, 1: "
        "it is of another sensor"
    )
    stated = (0.5, *small.ranges[1:]) if small.ranges else None
    with pytest.raises(InputError) as refused:
        require_devices(known, "cal.json", small, small, stated)
    assert str(refused.value) == (
        f"cal.json: found fx of a free tool up to {free:.3g}, expected at most 0.5, as in --ranges: "
        "it, or --ranges, is of another sensor"
    )
    require_devices(known, "cal.json", small, small, (1e3,) * 6)


def test_stated_ranges_are_held_against_a_calibration_before_a_session(
    tmp_path: Path, calibration: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """Of a sensor that states none: it ran, and each reading of a free tool was an overload."""
    monkeypatch.setattr("contactwrench.cli.live_terminal.compile_now", lambda _: None)
    monkeypatch.setattr("contactwrench.cli.live._until_a_signal", lambda *_: None)
    lines = '{"fx":0,"fy":0,"fz":0,"tx":0,"ty":0,"tz":0,"qx":0,"qy":0,"qz":0,"qw":1}\n'
    (tmp_path / "in").write_text(lines)
    for ranges, status in (("1,1,1,0.1,0.1,0.1", 2), ("500,500,500,50,50,50", 0)):
        with open(tmp_path / "in", encoding="utf-8") as sent:
            monkeypatch.setattr("sys.stdin", sent)
            options = ("-c", calibration, "--no-page", "--ranges", ranges)
            done = run(capsys, "live", "--sensor", "stdin:", *options)
        assert done.status == status, done.err
        assert (", as in --ranges: it, or --ranges, is of another sensor" in done.err) == (status == 2)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("--set x", "found 'x', expected NAME=VALUE, as in sensor.noise.force=0.05"),
        ("--set tool.mas=1", "there is no setting tool.mas, expected tool with one of: mass, com, hook, inertia"),
        ("--port-base 70000", "Invalid value for '--port-base': found 70000, expected 0 to 65000: "
         "try 'contactwrench lab --help'"),
        ("--seed -1", "Invalid value for '--seed': found -1, expected 0 to 1e+15: try 'contactwrench lab --help'"),
    ],
)  # fmt: skip
def test_a_lab_that_cannot_be_meant(capsys: Capture, arguments: str, said: str) -> None:
    assert complaint(capsys, "lab", *arguments.split()) == said


def test_a_page_that_cannot_be_served_leaves_no_file(tmp_path: Path, capsys: Capture) -> None:
    still = np.tile([*range(6), 0.0, 0.0, 0.0, 1.0], (50, 1))
    rows = np.column_stack([np.arange(50) / 100.0, still])
    recording = written(tmp_path, csv_text(("t", *WRENCH, "qx", "qy", "qz", "qw"), rows), "run.csv")
    with socket.create_server(("127.0.0.1", 0)) as other:
        taken = f"127.0.0.1:{other.getsockname()[1]}"
        output = ("--out", tmp_path / "a.mcap", "--record", tmp_path / "b.mcap")
        said = complaint(capsys, "live", "--from", recording, "--listen", taken, *output)
    assert said.startswith(f"{taken}: found that it cannot be listened on (")
    assert [each.name for each in tmp_path.iterdir()] == ["run.csv"]


def test_a_button_does_nothing_where_the_lab_is_another() -> None:
    with answering(b"HTTP/1.1 400 Bad Request\r\n\r\n") as port:
        Hands(f"tcp://127.0.0.1:{port}", Hub())({"do": "press_down"})


def test_a_lab_whose_port_is_taken(capsys: Capture) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        assert complaint(capsys, "lab", "--port-base", str(port)).startswith(
            f"port {port} of 127.0.0.1 cannot be listened on (address already in use"
        )


def table_of(path: Path) -> dict[str, np.ndarray[tuple[int], np.dtype[np.float64]]]:
    """The numbers of a CSV by column; what is no number is NaN."""
    with path.open() as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name] or "nan") for row in rows]) for name in ("t", *WRENCH, "valid")}


def test_a_recording_played_is_the_recording_compensated(tmp_path: Path, capsys: Capture) -> None:
    """The same rows; live, the orientation of 4 ms before is between two that came, and at first there is none."""
    rig, poses, rng = example(3)
    known = replace(cw.calibrate(noisy(rig, poses, rng), "mount"), delay=0.004, delay_std=1e-5)
    known.save(tmp_path / "cal.json")
    t = np.arange(4_000) / 1000.0
    arm = noisy(rig, smooth_rotations(t, rng), rng)
    rows = np.column_stack([t, arm.wrench, arm.R_base_flange.reshape(-1, 9)])
    recording = written(tmp_path, csv_text(("t", *WRENCH, *MATRIX), rows), "run.csv")
    shared = ("-c", tmp_path / "cal.json")
    played = run(capsys, "live", "--from", recording, "--speed", "0", "--no-page", *shared, "--out", tmp_path / "a.csv")
    assert (played.status, played.out) == (0, "")
    assert "silent" not in played.err
    assert "samples a second" not in played.err
    assert run(capsys, "compensate", recording, *shared, "-o", tmp_path / "b.csv").status == 0
    a, b = table_of(tmp_path / "a.csv"), table_of(tmp_path / "b.csv")
    assert len(a["t"]) == len(b["t"]) == len(t)
    assert np.abs(a["t"] - a["t"][0] - b["t"]).max() < 1e-5  # played now
    assert np.flatnonzero(a["valid"] != b["valid"]).tolist() in ([], [4])  # the filter of faults begins there
    both = np.arange(5, len(t))
    assert not np.isnan(a["fx"][both]).any()
    for name in WRENCH:
        assert np.abs(a[name] - b[name])[both].max() < 1e-3 * (known.weight or 0.0), name
