"""The verb `devices`, and a sensor that another package adds."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from contactwrench.live.uri import SINKS, SOURCES, known_sinks, known_sources
from tests.support.recordings import run

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "contactwrench_example_sensor"


def test_every_device_says_what_it_is() -> None:
    for known, table in ((known_sources(), SOURCES), (known_sinks(), SINKS)):
        assert {each.scheme for each in known} >= set(table)
        for each in known:
            assert each.error == ""
            assert all((each.form, each.about, each.rate, each.tested)), each


def test_no_line_is_wider_than_a_terminal_and_no_word_is_broken(capsys: pytest.CaptureFixture[str]) -> None:
    out = run(capsys, "devices").out
    assert max(map(len, out.splitlines())) <= 80
    without_blanks = "".join(out.split())
    for each in (*known_sources(), *known_sinks()):
        assert "".join(each.form.split()) in without_blanks
        for text in (each.about, each.rate, each.tested):
            assert set(text.split()) <= set(out.split())


@pytest.mark.slow
def test_another_package_adds_a_sensor(tmp_path: Path) -> None:
    pytest.importorskip("flit_core")
    pip = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation", "--no-index"]
    subprocess.run([*pip, "--target", str(tmp_path), str(EXAMPLE)], check=True, capture_output=True)
    paths = os.pathsep.join([str(tmp_path), *filter(None, sys.path)])
    environment = {**os.environ, "PYTHONPATH": paths}
    listed = [sys.executable, "-m", "contactwrench", "devices", "--json"]
    done = subprocess.run(listed, check=True, capture_output=True, text=True, env=environment)
    assert "example" in [each["scheme"] for each in json.loads(done.stdout)["sources"]]
    code = (
        "from contactwrench.live.stream import open_stream\n"
        "with open_stream('example://bench?amplitude=5') as stream:\n"
        "    print(stream.about.name, next(iter(stream)).wrench.shape[1])"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True, env=environment)
    assert done.stdout.split() == ["Example", "bench", "6"]
