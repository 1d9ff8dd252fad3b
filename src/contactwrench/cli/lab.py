"""`contactwrench lab`."""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from subprocess import Popen, TimeoutExpired
from time import monotonic, sleep
from typing import TYPE_CHECKING, Literal

import numpy as np
import typer

from ..geometry.arrays import Array
from ..geometry.ranges import SEED, Range
from . import options
from .streams import caught

if TYPE_CHECKING:
    from ..lab.device import Fake
    from ..lab.rig import Lab
    from ..lab.truth import Truth

PORTS = Range(0, 65_000)
LEAST_DEG, MOST_DEG = (0.0, 0.0, 0.0, 0.0, -90.0, -110.0, -120.0), (0.0, 0.0, 0.0, 0.0, 90.0, 25.0, 120.0)
"""From home: how far the wrist turns on its own; every tilt is within it, and nothing is near."""

BRISK = 0.5
"""Of the joints' largest speed."""
REST = 3.0
"""s in each pose."""
LOOK, ENDS_IN = 0.1, 15.0
"""s from one look at a live session to the next, and that it is given to end: longer than all of its threads together.
"""


def lab(
    sensor: Literal["sri", "netft", "ft300", "robotiq", "lines"] = options.text(
        None, "The sensor's protocol.", default="sri"
    ),
    robot: Literal["ur", "rsi", "lines"] = options.text(None, "The robot's protocol.", default="ur"),
    live: bool = options.switch("--live", "Start `contactwrench live` on it too, and end with it."),
    auto: bool = options.switch("--auto", "The arm visits poses of its own accord."),
    port_base: int = options.number(
        PORTS, "N", "The first port; the others follow. [default: any that are free]", default=0
    ),
    seed: int = options.number(SEED, "S", "Of everything random.", default=0),
    settings: list[str] | None = options.text("NAME=VALUE", "Change a setting of the rig; again for more.", "--set"),
) -> None:
    """Run a virtual lab: the rig of `simulate` in real time, behind real network protocols on this machine, until
    Ctrl-C.
    """
    from ..lab.control import Control
    from ..lab.rig import Lab
    from ..simulate.settings import Settings, changed

    virtual = Lab(changed(Settings(), settings or []), seed, BRISK)
    ports = [port_base and port_base + k for k in range(4)]
    with ExitStack() as running:
        sensing = running.enter_context(_sensor(sensor, virtual, ports[:2]))
        arm = running.enter_context(_robot(robot, virtual.sensor(), ports[2]))
        control = running.enter_context(Control(virtual, ports[3]))
        options.say(f"Sensor   {sensing.uri}\nRobot    {arm.uri}\nControl  {control.uri}")
        session = ("--robot", arm.uri, "--sensor", sensing.uri, "--lab", control.uri)
        rng = np.random.default_rng(seed)
        gc.collect()
        gc.freeze()  # else the devices stand still now and then while what was imported is looked through
        if not live:
            options.say(f"contactwrench live {' '.join(session)}")
            _run(virtual, wandering(rng) if auto else None, sleep)
            return
        with _live(*session) as ended:
            status = _run(virtual, wandering(rng) if auto else None, ended)
        raise typer.Exit(status)


def _sensor(kind: str, truth: Truth, ports: list[int]) -> Fake:
    from ..lab import ft300, lines, netft, sri

    made: dict[str, Callable[[], Fake]] = {
        "sri": lambda: sri.Sri(truth, port=ports[0]),
        "netft": lambda: netft.NetFt(truth, port=ports[0], http_port=ports[1]),
        "ft300": lambda: ft300.Ft300(truth, port=ports[0]),
        "robotiq": lambda: ft300.Robotiq(truth, port=ports[0]),
        "lines": lambda: lines.TcpLines(truth, shows="wrench", port=ports[0]),
    }
    return made[kind]()


def _robot(kind: str, truth: Truth, port: int) -> Fake:
    """The robot; of one that sends without being asked, `port` is where it sends to."""
    from ..lab import lines, rsi, ur
    from ..lab.device import LOCALHOST
    from ..lab.sockets import free_port

    made: dict[str, Callable[[], Fake]] = {
        "ur": lambda: ur.Ur(truth, port=port),
        "rsi": lambda: rsi.Rsi(truth, (LOCALHOST, port or free_port())),
        "lines": lambda: lines.UdpLines(truth, (LOCALHOST, port or free_port()), shows="pose"),
    }
    return made[kind]()


def wandering(rng: np.random.Generator) -> Iterator[Array]:
    """Where the arm goes of its own accord, one after the other: joints (7,), rad."""
    from ..simulate.kinematics import HOME

    while True:
        yield HOME + np.deg2rad(rng.uniform(LEAST_DEG, MOST_DEG))


def _run(virtual: Lab, targets: Iterator[Array] | None, ended: Callable[[float], int | None]) -> int:
    """Until Ctrl-C, or until what is asked after so many s says that it has ended, with which status; the arm goes to
    one of `targets` after the other, where there are some.
    """
    while True:
        lasting = 0.0 if targets is None else virtual.move_to(next(targets))
        if (status := ended(lasting + REST)) is not None:
            return status


@contextmanager
def _live(*arguments: str) -> Iterator[Callable[[float], int | None]]:
    """Run `contactwrench live` with these arguments, a program of its own on the same terminal. It ends with the lab; a
    signal that comes is handed on to it, and ends both. Gives what waits some s at most for the session's end: its exit
    status, or None where it goes on.
    """
    with caught() as came:
        session = Popen([sys.executable, "-m", "contactwrench", "live", *arguments])

        def ended(seconds: float) -> int | None:
            until = monotonic() + seconds
            while not came and session.poll() is None and (left := until - monotonic()) > 0.0:
                with suppress(TimeoutExpired):
                    session.wait(min(left, LOOK))
            return 128 + came[0] if came else session.poll()

        try:
            yield ended
        finally:
            _end(session, came[0] if came else signal.SIGTERM)


def _end(session: Popen[bytes], number: int) -> None:
    """End the session as the lab was ended; a terminal's Ctrl-C has reached it already, and twice does no harm."""
    if session.poll() is not None:
        return
    if os.name == "posix":
        session.send_signal(number)
    else:
        session.terminate()
    try:
        session.wait(ENDS_IN)
    except TimeoutExpired:
        session.kill()
        session.wait()
