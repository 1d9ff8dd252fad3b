"""`contactwrench lab`."""

from __future__ import annotations

from contextlib import ExitStack
from time import sleep
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import typer

from ..geometry.ranges import SEED, Range
from . import options

if TYPE_CHECKING:
    from ..lab.device import Fake
    from ..lab.rig import Lab

PORTS = Range(0, 65_000)
LEAST_DEG, MOST_DEG = (0.0, 0.0, 0.0, 0.0, -90.0, -110.0, -120.0), (0.0, 0.0, 0.0, 0.0, 90.0, 25.0, 120.0)
"""From home: how far the wrist turns on its own; every tilt is within it, and nothing is near."""
REST = 3.0
"""s in each pose."""


def lab(
    sensor: Annotated[Literal["sri"], typer.Option(help="The sensor's protocol.")] = "sri",
    robot: Annotated[Literal["ur"], typer.Option(help="The robot's protocol.")] = "ur",
    auto: Annotated[bool, typer.Option("--auto", help="The arm visits poses of its own accord.")] = False,
    port_base: Annotated[
        int, options.number(PORTS, "N", "The first port; the others follow. [default: any that are free]")
    ] = 0,
    seed: Annotated[int, options.number(SEED, "S", "Of everything random.")] = 0,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="Change a setting of the rig; again for more."),
    ] = None,
) -> None:
    """Run a virtual lab: the rig of `simulate` in real time, behind real network protocols on this machine, until
    Ctrl-C.
    """
    from ..lab.control import Control
    from ..lab.rig import Lab
    from ..simulate.settings import Settings, changed

    virtual = Lab(changed(Settings(), settings or []), seed)
    with ExitStack() as running:
        sensing = running.enter_context(_sensor(sensor, virtual, port_base))
        arm = running.enter_context(_robot(robot, virtual, port_base and port_base + 1))
        control = running.enter_context(Control(virtual, port_base and port_base + 2))
        options.say(
            f"Sensor   {sensing.uri}\nRobot    {arm.uri}\nControl  {control.uri}\n"
            f"contactwrench live --robot {arm.uri} --sensor {sensing.uri}"
        )
        _run(virtual, auto, np.random.default_rng(seed))


def _sensor(kind: str, virtual: Lab, port: int) -> Fake:
    from ..lab.sri import Sri

    return Sri(virtual, port=port)


def _robot(kind: str, virtual: Lab, port: int) -> Fake:
    from ..lab.ur import Ur

    return Ur(virtual.sensor(), port=port)


def _run(virtual: Lab, auto: bool, rng: np.random.Generator) -> None:
    """Until Ctrl-C."""
    from ..simulate.kinematics import HOME

    while True:
        lasting = virtual.move_to(HOME + np.deg2rad(rng.uniform(LEAST_DEG, MOST_DEG))) if auto else 0.0
        sleep(lasting + REST)
