"""A device that is connected to again has to be the one that was: its calibration, and its noise, are no other's."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from time import monotonic, sleep
from typing import Any, TypeAlias

import pytest

from contactwrench.lab.netft import NetFt
from contactwrench.lab.truth import Plain
from contactwrench.lab.ur import Ur
from contactwrench.live.devices import probed, require_same
from contactwrench.live.intake import Intake
from contactwrench.live.pump import Reader
from contactwrench.live.source import About
from contactwrench.live.uri import source_of

Others: TypeAlias = dict[str, tuple[str, list[str | About]]]
DO = "as when the session began: connect that again, or begin a new session"


def said(first: Any, second: Callable[[Any], Any], wrench: bool) -> tuple[str, list[str | About]]:
    """The URI, and what a reader says of a device that goes, and of the one that is there after it."""
    with first as fake:
        source = source_of(fake.uri)
        reader = Reader(source, *probed(source, wrench=wrench, orientation=not wrench))
    news, end = list[Any](), monotonic() + 3.0
    with second(fake):
        while monotonic() < end:
            news += [each for each in reader.news() if isinstance(each, str | About)]
            sleep(0.02)
    reader.stop()
    reader.join()
    return fake.uri, news


@pytest.fixture(scope="module")
def others() -> Others:
    """What is said of each, all at once: what takes long is to wait."""

    def box(rate: float) -> tuple[str, list[str | About]]:
        first = NetFt(Plain())
        return said(first, lambda fake: NetFt(Plain(), rate, port=fake.port, http_port=fake.http_port), wrench=True)

    with ThreadPoolExecutor(3) as pool:
        robot = pool.submit(said, Ur(Plain()), lambda fake: Ur(Plain(), port=fake.port, cb3=True), wrench=False)
        quick, slow = pool.submit(box, 2000.0), pool.submit(box, 1000.0)
        return {"robot": robot.result(), "2000.0": quick.result(), "1000.0": slow.result()}


def test_another_robot_is_not_taken_for_the_one_that_was(others: Others) -> None:
    uri, news = others["robot"]
    assert [each.name for each in news if isinstance(each, About)] == ["Universal Robots e-series, PolyScope 5.15.0"]
    was, now = "Universal Robots e-series, PolyScope 5.15.0", "Universal Robots CB3, PolyScope 3.15.8"
    assert f"{uri}: found {now}, expected {was}, {DO}" in news


@pytest.mark.parametrize("rate", [2000.0, 1000.0])
def test_a_box_at_another_rate_is_not_taken_for_the_one_that_was(rate: float, others: Others) -> None:
    uri, news = others[str(rate)]
    assert (f"{uri}: found 2000 samples a second, expected 1000, {DO}" in news) == (rate == 2000.0)
    assert sum(isinstance(each, About) for each in news) == (1 if rate == 2000.0 else 2)


def test_a_newer_program_and_the_rate_of_poses_make_no_other_device() -> None:
    robot = About("KUKA RSI, 1", wrench=False, orientation=True, rate=250.0)
    require_same("rsi://", robot, replace(robot, name="KUKA RSI, 2", rate=125.0))
    sensor = About("a sensor", wrench=True, orientation=False, rate=1000.0)
    require_same("x://", sensor, replace(sensor, rate=1001.0))
    require_same("x://", sensor, replace(sensor, rate=None))


def test_each_reason_why_a_device_is_not_there_is_said_once() -> None:
    """The second may be the one that is to be known: that another device is there."""
    intake = Intake("x://", "sensor")
    about = About("a sensor", wrench=True, orientation=False)
    intake.opened(about, 0.0)
    texts = ["cut", "refused", "cut", "another", "another", "3", "4", "5"]
    events = [intake.down(text, 1.0 + k) for k, text in enumerate(texts)]
    assert [event.text for event in events if event is not None] == ["cut", "refused", "another", "3"]
    intake.opened(about, 10.0)
    again = intake.down("cut", 11.0)
    assert again is not None
    assert again.text == "cut"
