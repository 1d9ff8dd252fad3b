"""`contactwrench live`."""

from __future__ import annotations

import os
import sys
import time
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError, refuse
from ..files import already_there
from ..geometry.ranges import CAPACITY, CUTOFF, POSES, WALK, Range
from . import options
from .outputs import Writes, output_option
from .streams import caught

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from ..calibration.calibration import Calibration
    from ..live.page import Hub
    from ..live.pump import Pump, Reader
    from ..live.source import About, Source
    from ..live.wizard import Wish
    from .live_terminal import Before

WANTED, SPEED, SWITCH = Range(1e-6, 1e3, "N"), Range(1e-3, 1e6, or_zero=True), 5e-5
"""s after which a thread lets another run: the worker waits for no longer while a page is drawn."""
LOOK = 0.1
"""s from one look for a signal to the next."""
HOST_AND_PORT, MOST_PORT = "HOST:PORT", 65_535


def _files(outs: Any, _: object) -> Iterator[Path]:
    """Those that --out names."""
    from ..live.uri import file_of

    return filter(None, map(file_of, outs or ()))


def live(
    *,
    sensor: str | None = options.text("URI", "The sensor; `contactwrench devices` lists all."),
    robot: str | None = options.text("URI", "The robot. [default: the sensor gives orientations too]"),
    calibration: Path | None = options.text(
        "CAL.json", "Run with this one. [default: the wizard first]", "--calibration", "-c"
    ),
    output: Path | None = output_option(
        "CAL.json", "Where what is accepted is saved. [default: live-DATE.json]", suffix=".json"
    ),
    sign: str | None = options.text("pull|reaction", "Of the readings. [default: the push test tells]"),
    gravity: str | None = options.GRAVITY,
    wanted: float = options.number(WANTED, "N", "Std of the contact force at which poses are enough.", default=0.05),
    poses: int = options.number(POSES, "N", "How many poses the wizard plans.", "--poses", default=12),
    arm: str | None = options.text("NAME|URDF[:LINK]", "Plan only what its wrist reaches, as `plan` does."),
    lowpass: float | None = options.number(CUTOFF, "HZ", "Low-pass of the contact wrench."),
    drift: float | None = options.number(WALK, "N", "Follow a bias that wanders so far in an hour."),
    ranges: str | None = options.text("FX,FY,FZ,TX,TY,TZ", "The sensor's ranges, N and N m."),
    page: bool = options.switch("--page/--no-page", "Show the session in a browser.", default=True),
    wizard: bool = options.switch("--wizard", "Without a page: the wizard in this terminal."),
    listen: str = options.text(
        HOST_AND_PORT, "Where the page is served; others need the token it prints.", default="127.0.0.1:0"
    ),
    events: bool = options.switch("--events", "Print what happens as JSON lines."),
    record: Path | None = options.text(
        "FILE", "Record what both devices send: .csv, .parquet or .mcap.", mark=Writes()
    ),
    out: list[str] | None = options.text(
        "URI|FILE", "Where contact wrenches go: udp://HOST:PORT, a file; again for more.", mark=Writes(_files)
    ),
    recorded: Path | None = options.text("FILE", "Play this recording in place of devices.", "--from"),
    speed: float = options.number(SPEED, "X", "Of --from: times real time; 0: as fast as it goes.", default=1.0),
    lab: str | None = options.text("URI", "The control port of `contactwrench lab`."),
    force: bool = options.FORCE,
) -> None:
    """Contact wrenches while the arm runs: a page that guides to a calibration, then runs; until Ctrl-C."""
    from ..calibration.calibration import Calibration
    from ..live.devices import require_devices
    from ..live.page import Hub, serve
    from ..live.pump import Pump
    from ..live.running import Options
    from ..live.session import Session
    from ..live.sink import open_sink
    from ..live.sinks.file import Recorder
    from ..live.uri import parsed, sink_of
    from .live_lab import Hands
    from .live_terminal import LOADED, Before, say

    refuse(
        (not (page or wizard or calibration), "found --no-page and no calibration, expected -c CAL.json, or --wizard"),
        (not (sensor or recorded), "found neither --sensor nor --from, expected --sensor URI, or --from FILE"),
        (bool(recorded and sensor), "found --from and --sensor, expected one: a recording has both streams"),
        (bool(recorded and robot), "found --from and --robot, expected one: a recording has both streams"),
        (
            wizard and "stdin" in {str(uri).partition(":")[0] for uri in (sensor, robot)},
            "found --wizard and stdin:, expected one to read what comes in: use the page",
        ),
        (
            calibration is not None and sensor is not None and parsed(sensor).options.get("zero") == "1",
            "found -c and zero=1, expected one: a box that zeroes itself anew is no longer at the calibration's zero; "
            "leave zero=1 out, or calibrate anew",
        ),
    )
    host, port = _address(listen)
    known = None if calibration is None else Calibration.load(calibration)
    sources = _sources(sensor, robot, recorded, speed)
    wish = _wish(wanted, poses, sign, gravity, sources["sensor"].uri, arm)
    running = Options(lowpass, drift, _ranges(ranges))
    sinks, recorder = [sink_of(each) for each in out or ()], None if record is None else Recorder(record)
    hub = Hub()
    hands = None if lab is None else Hands(lab, hub)
    sys.setswitchinterval(SWITCH)
    words = events, wizard or not events
    with ExitStack() as stack:
        first = recorded is None and _before_others()
        if first:
            stack.callback(_as_others)
        serves, aside = partial(serve, hub, host, port, lab=hands) if page else None, _as_others if first else None
        inertia = None if known is None else known.dynamics is not None
        before = stack.enter_context(Before(words, sources, hub, serves, aside, inertia))
        if known is not None:
            before.compile(LOADED)  # before anything comes that could not be taken meanwhile
        readers = {role: _read(source, role, len(sources) == 1, stack, before) for role, source in sources.items()}
        at_sensor, at_arm = readers["sensor"].about, readers["robot" if "robot" in readers else "sensor"].about
        before.wait_until_compiled()
        if known is not None and not at_sensor.replay:
            require_devices(known, str(calibration), at_sensor, at_arm, running.ranges)
        session = Session(
            known,
            sensor=sources["sensor"].uri,
            robot=sources["robot"].uri if "robot" in sources else None,
            wish=wish,
            options=running,
            save=_saving(output, at_sensor, at_arm, force),
            save_accepted=output is not None,
        )
        before.serve()  # before a file is begun
        opened = partial(open_sink, patient=speed == 0.0)
        outlets, keeper = tuple(map(opened, sinks)), None if recorder is None else opened(recorder)
        session.recording = None if record is None else True
        if known is None:
            before.compile(0.0)  # while a person is at the wizard
        publish = hub.publish if page or wizard else None
        says = partial(say, *words)
        pump = Pump(session, readers, publish=publish, say=says, asked=hub.commands, outlets=outlets, recorder=keeper)
        before.end(readers.values())
        _until_a_signal(pump, hub if wizard else None, page, "" if recorded is None else f"the end of {recorded} or ")


def _sources(sensor: str | None, robot: str | None, recorded: Path | None, speed: float) -> dict[str, Source]:
    from ..live.replay import Replay
    from ..live.uri import source_of

    if recorded is not None:
        return {"sensor": Replay(recorded, speed=speed)}
    given = {"sensor": sensor, "robot": robot}
    return {role: source_of(uri) for role, uri in given.items() if uri is not None}


def _before_others() -> bool:
    """Whether the system runs this thread and those that it starts before other programs, whose turns are most of what
    a contact wrench waits for: on Linux it lets root, and whoever has a limit `rtprio`.
    """
    try:
        if os.sched_getscheduler(0) != os.SCHED_OTHER or os.getpriority(os.PRIO_PROCESS, 0) > 0:
            return False  # whoever started it has chosen
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    except (AttributeError, OSError):
        return False
    return True


def _as_others() -> None:
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def _read(source: Source, role: str, alone: bool, stack: ExitStack, before: Before) -> Reader:
    from ..live.devices import probed
    from ..live.pump import Reader

    stack.callback(source.close)
    waits = partial(before.tell, "waiting", device=source.uri)
    reader = Reader(source, *probed(source, wrench=role == "sensor", orientation=alone or role == "robot", say=waits))
    stack.callback(reader.join)
    stack.callback(reader.stop)  # the last goes first
    return reader


def _ranges(text: str | None) -> tuple[float, float, float, float, float, float] | None:
    if text is None:
        return None
    fx, fy, fz, tx, ty, tz = options.numbers(text, "--ranges", "six numbers FX,FY,FZ,TX,TY,TZ", CAPACITY, 6).tolist()
    return (fx, fy, fz, tx, ty, tz)


def _wish(wanted: float, poses: int, sign: str | None, gravity: str | None, source: str, arm: str | None) -> Wish:
    from ..assess.robot_arms import reach
    from ..live.fitting import SIGNS, Stated
    from ..live.wizard import Wish
    from ..recording.urdf import arm_of

    if sign is not None and sign not in SIGNS:
        raise InputError(f"--sign is {sign!r}, expected {' or '.join(SIGNS)}")
    down = options.gravity_direction(gravity)
    stated = Stated(sign) if down is None else Stated(sign, (float(down[0]), float(down[1]), float(down[2])))
    return Wish(wanted, poses, stated, source, None if arm is None else reach(arm_of(arm)))


def _address(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    if not host or not (port.isascii() and port.isdigit()) or int(port) > MOST_PORT:
        raise InputError(f"--listen is {text!r}, expected {HOST_AND_PORT}, as in 127.0.0.1:8010")
    return host.removeprefix("[").removesuffix("]"), int(port)


def _saving(output: Path | None, sensor: About, robot: About, force: bool) -> Callable[[Calibration], str]:
    """What writes a calibration with the names of its devices, and says where."""
    from ..live.devices import with_devices

    def save(calibration: Calibration) -> str:
        nonlocal force
        path = output or Path(time.strftime("live-%Y%m%d-%H%M%S.json"))
        if path.exists() and not force:
            raise already_there(path)
        with_devices(calibration, sensor, robot).save(path)
        force = True  # what it wrote itself it may write anew
        return str(path)

    return save


def _until_a_signal(pump: Pump, terminal: Hub | None, page: bool, end: str) -> None:
    """Run until Ctrl-C, a signal, or the end of a recording that no page shows; then end in order, by that signal."""
    from .live_terminal import Terminal, settle

    with caught() as came:
        guide = None if terminal is None else Terminal(terminal)
        if not (page or terminal):
            options.say(f"Running until {end}Ctrl-C.", err=True)
        settle()
        try:
            pump.start()
            while not came and (page or not pump.wait(0.0)) and pump.failure is None:
                time.sleep(LOOK)
                if guide is not None:
                    guide.show()
        finally:
            pump.close()
        if pump.failure is not None:
            raise pump.failure
