"""A sink never slows the session: it has a queue, what it drops is counted, and it ends alone."""

from __future__ import annotations

import json
import math
import socket
import sys
import threading
from dataclasses import replace
from time import monotonic, sleep
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from contactwrench.errors import FileAccessError, InputError, MissingExtraError
from contactwrench.live.sink import DRAIN, MOST_WAITING, Turn, open_sink
from contactwrench.live.source import DeviceError
from contactwrench.live.uri import sink_of
from tests.support.turns import START, turn, turns


class Written:
    """A sink that keeps what it gets, each write of which takes `pause` s and ends with `error`."""

    uri = "test:"
    waits = True

    def __init__(self, pause: float = 0.0, error: Exception | None = None, waits: bool = True) -> None:
        self.pause, self.error, self.waits = pause, error, waits
        self.written = self.dropped = 0
        self.got: list[Turn] = []
        self.closed = False

    def open(self) -> None:
        """Nothing to do."""

    def write(self, turn: Turn) -> None:
        sleep(self.pause)
        if self.error is not None:
            self.dropped += len(turn.t)
            raise self.error
        self.got.append(turn)
        self.written += len(turn.t)

    def close(self) -> None:
        self.closed = True


def test_a_sink_that_others_listen_to_gets_each_turn_at_once() -> None:
    """A file may be written twenty times a second; who controls by a topic may not wait for that."""
    sink = Written()
    at_work = open_sink(sink)
    late = []
    for k in range(30):
        at_work.write(turn(k, k + 1, judged=False))
        begun = monotonic()
        while len(sink.got) <= k:
            sleep(1e-4)
        late.append(monotonic() - begun)
        sleep(0.002)
    at_work.close()
    assert float(np.median(late)) < 0.01


def test_a_slow_disk_slows_nobody_and_what_it_dropped_is_counted() -> None:
    sink = Written(pause=0.1)
    at_work = open_sink(sink)
    one = turn(0, 1000, judged=False)
    begun = monotonic()
    for _ in range(40):
        at_work.write(one)
    assert monotonic() - begun < 0.5  # of 4 s
    at_work.close()
    room = MOST_WAITING // one.rows
    assert room <= len(sink.got) <= room + 2
    assert at_work.written == 1000 * len(sink.got)
    assert at_work.dropped == 40_000 - at_work.written
    assert sink.closed
    assert at_work.error == ""


def test_a_patient_session_waits_for_room() -> None:
    sink = Written(pause=0.005)
    at_work = open_sink(sink, patient=True)
    for one in turns([1000] * 40, judged=False):
        at_work.write(one)
    at_work.close()
    assert (at_work.written, at_work.dropped) == (40_000, 0)
    np.testing.assert_array_equal(Turn.joined(sink.got).t, START + np.arange(40_000) / 1000.0)


def test_what_waits_when_a_session_ends_is_given_up_after_two_seconds() -> None:
    sink = Written(pause=0.9)
    at_work = open_sink(sink)
    for _ in range(10):
        at_work.write(turn(0, 10))
    begun = monotonic()
    at_work.close()
    assert monotonic() - begun < DRAIN + 0.9
    assert at_work.error == "test:: was not done 2 s after the end: too slow"
    sleep(1.0)
    assert sink.closed
    assert at_work.written + at_work.dropped == 100
    assert at_work.written == 10 * len(sink.got) < 50


@pytest.mark.parametrize("waits", [True, False])
@pytest.mark.parametrize(
    ("error", "said"),
    [
        (FileAccessError("run.csv: cannot be written (no space left on device)"), "run.csv: cannot be written (no sp"),
        (ZeroDivisionError("two\nlines"), "test:: the sink failed (ZeroDivisionError: two lines)"),
    ],
)
def test_a_sink_that_fails_ends_alone(waits: bool, error: Exception, said: str) -> None:
    failing, other = Written(error=error, waits=waits), Written()
    both = [open_sink(failing), open_sink(other)]
    for one in turns([10] * 5):
        for sink in both:
            sink.write(one)
    for sink in both:
        sink.close()
    assert both[0].error.startswith(said)
    assert (both[0].written, both[0].dropped) == (0, 50)
    assert (both[1].written, both[1].dropped, both[1].error) == (50, 0, "")
    assert failing.closed


def test_in_silence_a_sink_may_write_what_it_kept() -> None:
    sink = Written()
    at_work = open_sink(sink)
    at_work.write(turn(0, 5))
    sleep(0.7)
    assert [len(one.t) for one in sink.got] == [5, 0]
    at_work.close()


def test_no_thread_is_left() -> None:
    before = threading.active_count()
    at_work = open_sink(Written())
    at_work.close()
    assert threading.active_count() == before


def _listening() -> tuple[socket.socket, str]:
    listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    listener.bind(("127.0.0.1", 0))
    listener.settimeout(1.0)
    return listener, f"udp://127.0.0.1:{listener.getsockname()[1]}"


def test_a_line_a_sample() -> None:
    listener, uri = _listening()
    with listener:
        at_work = open_sink(sink_of(uri))
        one = turn(0, 50)
        at_work.write(replace(one, judged=[]))
        at_work.write(one)
        lines = [json.loads(listener.recv(65536)) for _ in range(50)]
        at_work.close()
    contact = one.contact
    assert contact is not None
    assert (at_work.written, at_work.dropped, at_work.error) == (50, 0, "")
    assert list(lines[0]) == ["t", "fx", "fy", "fz", "tx", "ty", "tz", "std", "valid", "contact", "reason"]
    for row, line in enumerate(lines):
        values = [math.nan if line[name] is None else line[name] for name in ("fx", "fy", "fz", "tx", "ty", "tz")]
        np.testing.assert_array_equal(values, contact.wrench[row])
        np.testing.assert_array_equal(np.array(line["std"], dtype=np.float64), contact.std[row])
        assert line["t"] == one.t[row]
        assert line["valid"] is bool(contact.valid[row])
        assert line["contact"] is {-1: None, 0: False, 1: True}[int(contact.contact[row])]
        assert line["reason"] == contact.reason[row]
    assert any(line["fx"] is None for line in lines)


def test_lines_that_nobody_takes_are_counted() -> None:
    listener, uri = _listening()
    listener.close()
    at_work = open_sink(sink_of(uri))
    begun = monotonic()
    for one in turns([100] * 10):
        at_work.write(one)
    assert monotonic() - begun < 0.5
    at_work.close()
    assert at_work.error == ""
    assert at_work.dropped > 0
    assert at_work.written + at_work.dropped == 1000


@pytest.mark.parametrize("uri", ["udp://127.0.0.1", "udp://:9000", "udp://127.0.0.1:9/x", "udp://127.0.0.1:9?rate=5"])
def test_an_address_that_is_none(uri: str) -> None:
    with pytest.raises(InputError, match=f"^{uri.replace('?', '.')}: found "):
        sink_of(uri)


@pytest.mark.parametrize("host", ["nowhere.invalid", "a..b"])
def test_a_host_that_nobody_knows(host: str) -> None:
    with pytest.raises(DeviceError, match=rf"^udp://{host}:9: cannot be sent to \(.+\): check host and netw"):
        open_sink(sink_of(f"udp://{host}:9"))


def test_without_ros_it_is_said_what_to_source(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rclpy", None)
    with pytest.raises(MissingExtraError, match=r"^ros2://wrench: needs ROS 2's rclpy.*source /opt/ros/.*/setup\.bash"):
        open_sink(sink_of("ros2://wrench"))


def test_a_topic_of_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    """On names of rclpy's that are put in its place: only which calls are made is seen."""
    published: list[Any] = []
    calls: list[str] = []

    def message() -> Any:
        header = SimpleNamespace(frame_id="", stamp=SimpleNamespace(sec=0, nanosec=0))
        return SimpleNamespace(header=header, wrench=SimpleNamespace(force=SimpleNamespace(), torque=SimpleNamespace()))

    publisher = SimpleNamespace(publish=published.append)

    def create_publisher(kind: Any, topic: str, quality: str) -> Any:
        calls.append(topic)
        return publisher

    node = SimpleNamespace(create_publisher=create_publisher, destroy_node=lambda: calls.append("destroyed"))
    fakes: dict[str, dict[str, Any]] = {
        "rclpy": {
            "Context": lambda: SimpleNamespace(shutdown=lambda: calls.append("shut down")),
            "init": lambda context: None,
            "create_node": lambda name, context: node,
        },
        "rclpy.qos": {"qos_profile_sensor_data": "sensor data"},
        "geometry_msgs": {},
        "geometry_msgs.msg": {"WrenchStamped": message},
    }
    for name, content in fakes.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    at_work = open_sink(sink_of("ros2://Arm/contact_wrench?frame=ft"))
    one = turn(1500, 20)
    at_work.write(one)
    at_work.close()
    assert one.contact is not None
    assert calls == ["Arm/contact_wrench", "destroyed", "shut down"]
    assert (at_work.written, at_work.error) == (20, "")
    assert published[0].header.frame_id == "ft"
    stamps = [each.header.stamp.sec + 1e-9 * each.header.stamp.nanosec for each in published]
    np.testing.assert_allclose(stamps, one.t, atol=3e-7)
    forces = np.array([[each.wrench.force.x, each.wrench.force.y, each.wrench.force.z] for each in published])
    np.testing.assert_array_equal(forces, np.where(one.contact.valid[:, None], one.contact.wrench[:, :3], np.nan))
