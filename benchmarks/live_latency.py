"""From the sensor's datagram to the contact wrench that goes out, beside a bare echo of the same datagrams.

`python -m benchmarks.live_latency [SECONDS] [attacked]`: a lab (SRI at 1 kHz, UR at 500 Hz), a live session with a page
that is open at 30 Hz and a recording, and a plain Python loop that reads the same sensor and sends a line for each
packet, each in a process of its own. Time is counted from when a sample could have arrived at best, by the device's own
clock.
`attacked`: while another process attacks the page (live_attack.py).
"""

from __future__ import annotations

import os
import resource
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from urllib.parse import urlsplit

import msgspec
import numpy as np
from numpy.typing import NDArray

import contactwrench as cw
from contactwrench.live.clock import Clock
from contactwrench.simulate.recording import record_poses
from contactwrench.simulate.settings import Settings, changed
from tests.support.page_client import PageClient

from .live_calibration import ended, lines_until, started

ECHO = """
import socket, struct, sys, time
host, port, out = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
s = socket.create_connection((host, port)); s.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
u = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
for command in (b"AT+SMPF=1000", b"AT+SGDM=(A01,A02,A03,A04,A05,A06);E;1;(WMA:1)", b"AT+DCKMD=SUM", b"AT+GSD"):
    s.sendall(command + b"\\r\\n"); time.sleep(0.1)
data = b""
while True:
    data += s.recv(65536)
    while (at := data.find(b"\\xaa\\x55")) >= 0 and len(data) >= at + 31:
        number, = struct.unpack(">H", data[at + 4:at + 6])
        wrench = struct.unpack("<6f", data[at + 6:at + 30])
        u.sendto(b'{"n":%d,"t":%r,"w":%r}' % (number, time.time(), wrench), ("127.0.0.1", out))
        data = data[at + 31:]
"""


def rig_calibration() -> cw.Calibration:
    """Of the lab's own rig, from poses of the simulator."""
    from contactwrench.assess.plan import plan
    from contactwrench.assess.robot_arms import known_arm, reach

    planned = plan(12, reach=reach(known_arm("iiwa7")))
    settings = changed(Settings(), ["recording.rows=200"])
    if planned.joints is None:
        raise TypeError("a plan with a reach has joints")
    recorded = record_poses(settings, planned.joints, rng=np.random.default_rng(5)).samples
    return cw.calibrate(cw.Samples(recorded.wrench, recorded.R_base_flange, recorded.t))


STAMPED = getattr(socket, "SO_TIMESTAMPNS", 35)  # asm-generic/socket.h; Python names it from 3.14 on


class Lines:
    """What comes on a UDP port, with the time at which the kernel took it, so that this process' own threads do not
    count.
    """

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        self._socket.setsockopt(socket.SOL_SOCKET, STAMPED, 1)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.2)
        self.port = self._socket.getsockname()[1]
        self.lines: list[tuple[float, bytes]] = []
        self._stop = False
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._stop:
            try:
                line, ((_, _, stamp), *_), _, _ = self._socket.recvmsg(4096, 64)
            except TimeoutError:
                continue
            whole, nanoseconds = struct.unpack("qq", stamp)
            self.lines.append((whole + 1e-9 * nanoseconds, line))

    def close(self) -> None:
        """Stop listening."""
        self._stop = True
        self._thread.join()
        self._socket.close()


def usage(process: subprocess.Popen[str]) -> tuple[float, float]:
    """CPU seconds, and resident MiB, of a process."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    ticks = os.sysconf("SC_CLK_TCK")
    pages = int(Path(f"/proc/{process.pid}/statm").read_text().split()[1])
    return (int(fields[11]) + int(fields[12])) / ticks, pages * resource.getpagesize() / 2**20


def late(came: NDArray[np.float64], device: NDArray[np.float64]) -> NDArray[np.float64]:
    """s by which lines came after the samples could have arrived at best."""
    clock = Clock()
    times = clock.times(list(zip(came.tolist(), device.tolist(), strict=True)))
    best: NDArray[np.float64] = np.array([t for t, _ in times])
    return came - best


def shown(name: str, seconds: NDArray[np.float64]) -> None:
    """Print the percentiles."""
    ms = 1e3 * np.percentile(seconds, [50.0, 99.0, 99.9, 100.0])
    print(f"{name}: median {ms[0]:.3f} ms, 99 % {ms[1]:.2f}, 99.9 % {ms[2]:.2f}, largest {ms[3]:.1f} ms")


def main() -> None:
    """Run for so many seconds, and print."""
    seconds = float(next(iter(sys.argv[1:]), 600.0))
    folder = Path(tempfile.mkdtemp())
    rig_calibration().save(folder / "rig.json")
    lab = started("lab", "--auto")
    at = lines_until(lab, "contactwrench live")
    ours, bare = Lines(), Lines()
    host, _, port = at["Sensor"].removeprefix("sri://").partition(":")
    live = started(
        *("live", "--sensor", at["Sensor"], "--robot", at["Robot"], "-c", str(folder / "rig.json")),
        *("--out", f"udp://127.0.0.1:{ours.port}", "--record", str(folder / "run.mcap")),
    )
    address = lines_until(live, "Open")["Open"]
    page = PageClient(address)
    attack = [sys.executable, "-m", "benchmarks.live_attack", str(urlsplit(address).port)]
    others = [subprocess.Popen(attack)] if "attacked" in sys.argv else []
    echo = subprocess.Popen([sys.executable, "-c", ECHO, host, port, str(bare.port)])
    time.sleep(5.0)
    ours.lines.clear()
    bare.lines.clear()
    begun, (cpu, _), memory = time.monotonic(), usage(live), list[float]()
    snapshots = 0
    while (passed := time.monotonic() - begun) < seconds:
        page.next()
        snapshots += 1
        if passed > 60.0 * len(memory):
            memory.append(usage(live)[1])
    print(page.next()["outputs"], page.snapshot["contact"])
    cpu_used, memory_now = usage(live)
    device = page.next()["devices"]
    lines, echoed = list(ours.lines), list(bare.lines)
    for process in (echo, *others):
        process.kill()
    page.close()
    ended(live)
    ended(lab)
    ours.close()
    bare.close()
    print(f"lines: {len(lines)} of ours, {len(echoed)} of the echo")
    decoded = [msgspec.json.decode(line) for _, line in lines]
    t = np.array([each["t"] for each in decoded])
    came = np.array([when for when, _ in lines])
    out = came - t
    number = np.unwrap([msgspec.json.decode(line.split(b',"t"')[0] + b"}")["n"] for _, line in echoed], period=65536)
    print(f"{seconds:g} s; page at {snapshots / passed:.1f} Hz; {100.0 * (cpu_used - cpu) / passed:.0f} % of one core")
    shown("contact wrench out", out)
    shown("bare echo         ", late(np.array([when for when, _ in echoed]), number * 1e-3))
    print(f"lines {len(t)}, times that repeat or jump: {int((np.abs(np.diff(t) - 1e-3) > 5e-4).sum())}")
    print(f"devices: {[(each['uri'], each['samples'], each['lost'], each['repeated']) for each in device]}")
    print(f"memory MiB each minute: {' '.join(f'{each:.1f}' for each in memory)}, at the end {memory_now:.1f}")


if __name__ == "__main__":
    main()
