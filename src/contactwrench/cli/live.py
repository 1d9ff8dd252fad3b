"""`contactwrench live`."""

from __future__ import annotations

import os
import signal
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..errors import InputError
from ..files import already_there
from ..geometry.ranges import CUTOFF, NOISE, POSES, Range
from . import options
from .outputs import Writes

if TYPE_CHECKING:
    from ..calibration.calibration import Calibration
    from ..live.page import Hub, Server
    from ..live.pump import Pump
    from ..live.snapshot import Event as Said
    from ..live.source import About, Source
    from ..live.wizard import Wish

WANTED, SWITCH = Range(1e-6, 1e3, "N"), 5e-4
"""s after which a thread lets another run: the worker waits for no longer while a page is drawn."""
HOST_AND_PORT = "HOST:PORT"


def live(
    *,
    sensor: Annotated[str, typer.Option(metavar="URI", help="The sensor; `contactwrench devices` lists all.")],
    robot: Annotated[
        str | None, typer.Option(metavar="URI", help="The robot. [default: the sensor gives orientations too]")
    ] = None,
    calibration: Annotated[
        Path | None,
        typer.Option("--calibration", "-c", metavar="CAL.json", help="Run with this one. [default: the wizard first]"),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="CAL.json", help="Where the wizard saves. [default: live-DATE.json]"),
        Writes(),
    ] = None,
    sign: Annotated[
        str | None, typer.Option(metavar="pull|reaction", help="Of the readings. [default: the push test tells]")
    ] = None,
    gravity: options.Gravity = None,
    wanted: Annotated[float, options.number(WANTED, "N", "Std of the contact force at which poses are enough.")] = 0.05,
    poses: Annotated[int, options.number(POSES, "N", "How many poses the wizard plans.", "--poses")] = 12,
    lowpass: Annotated[float | None, options.number(CUTOFF, "HZ", "Low-pass of the contact wrench.")] = None,
    drift: Annotated[float | None, options.number(NOISE, "N", "Follow a bias that wanders so far in an hour.")] = None,
    page: Annotated[bool, typer.Option("--page/--no-page", help="Show the session in a browser.")] = True,
    wizard: Annotated[bool, typer.Option("--wizard", help="Without a page: the wizard in this terminal.")] = False,
    listen: Annotated[
        str, typer.Option(metavar=HOST_AND_PORT, help="Where the page is served; others need the token it prints.")
    ] = "127.0.0.1:0",
    events: Annotated[bool, typer.Option("--events", help="Print what happens as JSON lines.")] = False,
    lab: Annotated[str | None, typer.Option(metavar="URI", help="The control port of `contactwrench lab`.")] = None,
    force: options.Force = False,
) -> None:
    """Contact wrenches while the arm runs: a page that guides to a calibration, then runs; until Ctrl-C."""
    from ..calibration.calibration import Calibration
    from ..live.devices import require_devices
    from ..live.uri import source_of

    if not (page or wizard or calibration):
        raise InputError("found --no-page and no calibration, expected -c CAL.json to run with, or --wizard")
    known = None if calibration is None else Calibration.load(calibration)
    wish = _wish(wanted, poses, sign, gravity, sensor)
    host, port = _address(listen)
    sources = {"sensor": source_of(sensor), **({} if robot is None else {"robot": source_of(robot)})}
    with ExitStack() as stack:
        abouts = {role: _opened(source, role, robot is None, stack) for role, source in sources.items()}
        arm = abouts.get("robot", abouts["sensor"])
        if known is not None:
            require_devices(known, str(calibration), abouts["sensor"], arm)
        running = _Running(known, wish, _Save(output, abouts["sensor"], arm, force), (lowpass, drift))
        running.run(sources, abouts, host if page else None, port, lab, wizard, events)


def _opened(source: Source, role: str, alone: bool, stack: ExitStack) -> About:
    from ..live.devices import probed

    about = probed(source, wrench=role == "sensor", orientation=alone or role == "robot")
    stack.callback(source.close)
    return about


def _wish(wanted: float, poses: int, sign: str | None, gravity: str | None, source: str) -> Wish:
    from ..live.fitting import SIGNS, Stated
    from ..live.wizard import Wish

    if sign is not None and sign not in SIGNS:
        raise InputError(f"--sign is {sign!r}, expected {' or '.join(SIGNS)}")
    down = options.gravity_direction(gravity)
    stated = Stated(sign) if down is None else Stated(sign, (float(down[0]), float(down[1]), float(down[2])))
    return Wish(wanted, poses, stated, source)


def _address(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    if not host or not port.isdigit() or int(port) > 65_535:
        raise InputError(f"--listen is {text!r}, expected {HOST_AND_PORT}, as in 127.0.0.1:8010")
    return host, int(port)


class _Save:
    """Writes a calibration with the names of its devices, and says where."""

    def __init__(self, path: Path | None, sensor: About, robot: About, force: bool) -> None:
        self._path, self._sensor, self._robot, self._force = path, sensor, robot, force

    def __call__(self, calibration: Calibration) -> str:
        from ..live.devices import with_devices

        path = self._path or Path(time.strftime("live-%Y%m%d-%H%M%S.json"))
        if path.exists() and not self._force:
            raise already_there(path)
        with_devices(calibration, self._sensor, self._robot).save(path)
        self._force = True  # what it wrote itself it may write anew
        return str(path)


class _Running:
    """A session at work, until a signal."""

    def __init__(self, calibration: Any, wish: Wish, save: _Save, filters: tuple[float | None, float | None]) -> None:
        self._calibration, self._wish, self._save, self._filters = calibration, wish, save, filters
        self._stop, self._signal = Event(), 0

    def run(
        self,
        sources: dict[str, Source],
        abouts: dict[str, About],
        host: str | None,
        port: int,
        lab: str | None,
        wizard: bool,
        events: bool,
    ) -> None:
        from ..live.page.hub import Hub
        from ..live.pump import Pump, Reader, Ways
        from ..live.running import Options
        from ..live.session import Session

        sys.setswitchinterval(SWITCH)
        robot = sources["robot"].uri if "robot" in sources else None
        options_ = Options(*self._filters)
        session = Session(
            self._calibration,
            sensor=sources["sensor"].uri,
            robot=robot,
            wish=self._wish,
            options=options_,
            save=self._save,
        )
        hub = Hub()
        say = _say_json if events else _say_line
        ways = Ways(hub.publish if host or wizard else None, say, hub.commands)
        readers = {role: Reader(source, abouts[role]) for role, source in sources.items()}
        pump = Pump(session, readers, ways=ways)
        server = None if host is None else self._serve(hub, host, port, lab)
        self._until_a_signal(pump, server, hub if wizard else None)

    def _serve(self, hub: Hub, host: str, port: int, lab: str | None) -> Server:
        from ..live.page import serve
        from .live_lab import Hands

        server = serve(hub, host, port, lab=None if lab is None else Hands(lab, hub))
        options.say(f"Open {server.url}")
        sys.stdout.flush()
        return server

    def _until_a_signal(self, pump: Pump, server: Server | None, terminal: Hub | None) -> None:
        from .live_terminal import Terminal

        before = {number: signal.signal(number, self._asked_to_end) for number in (signal.SIGINT, signal.SIGTERM)}
        guide = None if terminal is None else Terminal(terminal)
        try:
            pump.start()
            while not self._stop.wait(0.1) and not pump.wait(0.0):
                if guide is not None:
                    guide.show()
        finally:
            pump.close()
            if server is not None:
                server.close()
            for number, handler in before.items():
                signal.signal(number, handler)
        if pump.failure is not None:
            raise pump.failure
        if self._signal:
            os.kill(os.getpid(), self._signal)

    def _asked_to_end(self, number: int, _: object) -> None:
        self._signal = number
        self._stop.set()


def _say_json(said: Said) -> None:
    import msgspec

    typer.echo(msgspec.json.encode(said).decode())
    sys.stdout.flush()


def _say_line(said: Said) -> None:
    where = f"{said.device}: " if said.device else ""
    when = time.strftime("%H:%M:%S", time.localtime(said.t))
    options.say(f"{when}  {'' if said.severity == 'note' else said.severity + ': '}{where}{said.text}", err=True)
