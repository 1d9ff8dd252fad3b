"""The pictures of docs/live-session.md: the real page on the lab, step by step, as a person sees it.

`python -m tests.support.live_pictures [FOLDER]` takes half a minute, and needs playwright and a Chromium.
"""

from __future__ import annotations

import io
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from shutil import which
from typing import Any

import msgspec
from PIL import Image
from playwright.sync_api import Browser, Page, ViewportSize, sync_playwright

from benchmarks.live_calibration import ended, lines_until, started
from contactwrench.live.page import Hub, serve
from tests.support.live_session import UGLY
from tests.support.page_client import PageClient, more_than, push, touch

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "images" / "live"
WIDE, HIGH, COLOURS = 1280, 860, 64
PHONE: ViewportSize = {"width": 400, "height": 860}
POSES, TOUCHED = 12, 5
SEED = "3"

Take = Callable[[str], None]


@contextmanager
def lab_and_session(folder: Path) -> Iterator[str]:
    """The address of the page of a session on the lab."""
    lab = started("lab", "--seed", SEED)
    try:
        at = lines_until(lab, "contactwrench live")
        saved = str(folder / "gripper.json")
        devices = ("--sensor", at["Sensor"], "--robot", at["Robot"], "--lab", at["Control"])
        session = started("live", *devices, "-o", saved, "--record", str(folder / "run.mcap"))
        try:
            address = lines_until(session, "Open")["Open"]
            os.nice(15)  # a browser that draws in software must not make lab and session stutter
            yield address
        finally:
            ended(session)
    finally:
        ended(lab)


def through(page: PageClient, take: Take) -> None:
    """From connecting to running, with a picture of each step while something is to be seen in it."""
    page.until(lambda s: "next" in s["commands"] and s["still"])
    time.sleep(3.0)
    take("connect")
    page.ask("next")
    push(page, "press_down", 0)
    push(page, "press_x", 1, lambda: take("push"))
    page.ask("next")
    for k in range(POSES):
        page.until(lambda s: s["poses"] and s["poses"]["targets"])
        if k:
            page.lab("next_pose")
        if k == TOUCHED:
            touch(page)
        if k == POSES - 4:
            page.until(lambda s: s["poses"]["progress"] > 0.1)
            take("poses")
        page.until(more_than(k, lambda s: s["poses"]["taken"]), 40.0)
    page.ask("next")
    page.until(lambda s: s["phase"] == "fit" and s["fit"])
    take("fit")
    page.ask("next")
    for k in range(2):
        page.until(lambda s: s["phase"] == "verify" and s["poses"]["targets"])
        page.lab("next_pose")
        page.until(more_than(k, lambda s: s["checks"]), 40.0)
    page.until(lambda s: s["saved"])
    take("verify")
    page.ask("next")
    page.until(lambda s: s["phase"] == "run" and s["contact"] and s["contact"]["contact"] is not None)
    run(page, take)


def run(page: PageClient, take: Take) -> None:
    """Two contacts, the second of which lasts in the picture."""
    for lasts in (False, True):
        time.sleep(2.0)
        page.lab("push_tool")
        time.sleep(1.5)
        if not lasts:
            page.lab("release")
    take("run")
    page.lab("release")


def photographed(page: Page, file: Path) -> None:
    """A picture of the page, of few colours, so that it is small."""
    page.wait_for_timeout(400)
    page.evaluate("window.scrollTo(0, 0)")
    whole = Image.open(io.BytesIO(page.screenshot(full_page=page.viewport_size == PHONE)))
    few: Any = whole.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    few.save(file, optimize=True)
    print(f"{file.name}: {file.stat().st_size / 1000:.0f} kB")


def silent(browser: Browser, file: Path) -> None:
    """A session on a phone whose sensor is silent."""
    hub = Hub()
    server = serve(hub)
    hub.publish(msgspec.json.encode(UGLY["sensor silent"]))
    page = browser.new_page(viewport=PHONE)
    page.goto(server.url)
    page.wait_for_timeout(600)
    photographed(page, file)
    server.close()


def main() -> None:
    """Take all pictures into the folder that is named, or the documentation's."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    with (
        tempfile.TemporaryDirectory() as scratch,
        lab_and_session(Path(scratch)) as address,
        sync_playwright() as playwright,
    ):
        browser = playwright.chromium.launch(executable_path=which("chromium"))
        shown = browser.new_page(viewport={"width": WIDE, "height": HIGH})
        shown.goto(address)
        through(PageClient(address), lambda name: photographed(shown, folder / f"{name}.png"))
        silent(browser, folder / "silent.png")
        browser.close()


if __name__ == "__main__":
    main()
