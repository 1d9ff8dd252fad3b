"""A calibration through the page in the lab, as a person does it, again and again: is it right?

`python -m benchmarks.live_calibration [RUNS] [FIRST_SEED]`: a lab and a live session in processes of their own; a
client does what the page's buttons do: two pushes, 12 planned poses, fit, verify, save. Every parameter is held
against the rig's truth, in its own standard deviations, and the delay against what the run gave the sensor.
"""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

import contactwrench as cw
from contactwrench.geometry.rotations import rotation_log
from contactwrench.samples.delay import is_significant
from contactwrench.simulate.settings import Settings
from tests.support.page_client import PageClient, more_than, push, touch

Errors = NDArray[np.float64]
RUN = [sys.executable, "-m", "contactwrench"]


def started(*arguments: str) -> subprocess.Popen[str]:
    """A verb that goes on, its standard output read by us."""
    return subprocess.Popen([*RUN, *arguments], stdout=subprocess.PIPE, text=True, env=dict(os.environ))


def lines_until(process: subprocess.Popen[str], pattern: str) -> dict[str, str]:
    """What a process says, by its first word, until a line matches."""
    said: dict[str, str] = {}
    for line in process.stdout or ():
        word, _, rest = line.strip().partition(" ")
        said[word] = rest.strip()
        if re.match(pattern, line):
            break
    return said


def ended(process: subprocess.Popen[str]) -> int:
    """End a process: its status. A job in the background may not hear Ctrl-C."""
    with suppress(ProcessLookupError):
        process.terminate()
    return process.wait(15.0)


def ordered(control: str, order: dict[str, Any]) -> dict[str, Any]:
    """The lab's answer to an order."""
    host, _, port = control.removeprefix("tcp://").partition(":")
    with socket.create_connection((host, int(port))) as place:
        place.sendall(msgspec.json.encode(order) + b"\n")
        answer: dict[str, Any] = msgspec.json.decode(place.makefile("rb").readline())
        return answer


def through_the_page(page: PageClient, poses: int = 12, touched: int | None = None) -> None:
    """Click through the wizard; pose number `touched` is pushed while it is being taken."""
    page.until(lambda s: "next" in s["commands"] and s["still"])
    page.ask("next")
    for k, hand in enumerate(("press_down", "press_x")):
        push(page, hand, k)
    page.ask("next")
    page.until(lambda s: s["poses"] and len(s["poses"]["taken"]) >= 1)
    for k in range(1, poses):
        page.until(lambda s: s["poses"]["targets"])
        page.lab("next_pose")
        if k == touched:
            touch(page)
        page.until(more_than(k, lambda s: s["poses"]["taken"]), 40.0)
    page.ask("next")
    page.until(lambda s: s["phase"] == "fit" and s["fit"])
    page.ask("next")
    for k in range(2):
        page.until(lambda s: s["phase"] == "verify" and s["poses"]["targets"])
        page.lab("next_pose")
        page.until(more_than(k, lambda s: s["checks"]), 40.0)
    page.ask("save")
    page.until(lambda s: s["saved"])
    page.ask("next")
    page.until(lambda s: s["phase"] == "run" and s["contact"] and s["contact"]["valid"])


def beside_truth(cal: cw.Calibration, truth: dict[str, Any]) -> NDArray[np.float64]:
    """Each parameter's error in its own std: weight, com, bias, mounting (3), gravity (2)."""
    turn = rotation_log((np.array(truth["R_flange_sensor"]).T @ cal.R_flange_sensor)[None])[0]
    off = cal.gravity_direction - np.array(truth["gravity_direction"])
    pairs = [
        (cal.weight - truth["weight"], cal.std["weight"]),
        *zip(cal.com - np.array(truth["com"]), cal.std["com"], strict=True),
        *zip(cal.bias - np.array(truth["bias"]), cal.std["bias"], strict=True),
        *zip(turn, cal.std["mount"], strict=True),
        *zip(off[:2], cal.std["gravity"], strict=True),
    ]
    return np.array([error / std for error, std in pairs])


def one_run(
    seed: int, folder: Path, touched: int | None = None, settings: tuple[str, ...] = ()
) -> tuple[Errors, PageClient, cw.Calibration]:
    """A lab and a session, from connect to run: the errors in std, the page, the calibration."""
    file = folder / f"{seed}.json"
    lab = started("lab", "--seed", str(seed), *(part for each in settings for part in ("--set", each)))
    try:
        at = lines_until(lab, "contactwrench live")
        live = started(
            *(
                "live",
                "--sensor",
                at["Sensor"],
                "--robot",
                at["Robot"],
                "--lab",
                at["Control"],
                "--arm",
                "iiwa7",
                "-o",
                str(file),
            )
        )
        try:
            page = PageClient(lines_until(live, "Open")["Open"])
            through_the_page(page, touched=touched)
            truth = ordered(at["Control"], {"state": True})["truth"]
            page.close()
        finally:
            ended(live)
    finally:
        ended(lab)
    cal = cw.Calibration.load(file)
    return beside_truth(cal, truth), page, cal


def main() -> None:
    """Print a line a run, and how many were right."""
    runs, first = (int(each) for each in (*sys.argv[1:], "20", "1000")[:2])
    right = timed = 0
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, first + runs):
            began, delay = time.monotonic(), np.random.default_rng(seed).uniform(0.005, 0.04)
            touched = 7 if seed % 4 == 0 else None
            errors, page, cal = one_run(seed, Path(folder), touched, (f"sensor.delay={delay:.5f}",))
            right += bool(np.abs(errors).max() <= 3.0)
            late = 1e3 * ((cal.delay or np.nan) - delay - 0.5 / np.pi / Settings().sensor.low_pass)
            applied = cal.delay is not None and cal.delay_std is not None and is_significant(cal.delay, cal.delay_std)
            timed += applied and abs(late) <= 2.0
            refused = [each["text"] for each in page.events if each["kind"] == "pose_refused"]
            print(
                f"seed {seed}: largest error {np.abs(errors).max():.2f} std, verdict {cal.verdict}, delay "
                f"{1e3 * delay:.1f} ms off by {late:.2f}{'' if applied else ' and not applied'}, "
                f"{time.monotonic() - began:.0f} s{'; ' + refused[0] if refused else ''}",
                flush=True,
            )
    print(f"{right} of {runs} runs with every parameter within 3 std of the truth")
    print(f"{timed} of {runs} with the delay within 2 ms, and applied")


if __name__ == "__main__":
    main()
