"""What fails in another package's source or sink is said to be that package's, and no fault of this program."""

from __future__ import annotations

import sys
from importlib import import_module, metadata
from pathlib import Path

import pytest

from contactwrench.errors import InputError
from contactwrench.live.uri import parsed, sink_of, source_of

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "contactwrench_example_sensor"
CODE = """
class Fails:
    def __init__(self, uri):
        float(uri.host)
"""
POINTS = """[contactwrench.sources]
fails = another:Fails
gone = no_such_module:X
[contactwrench.sinks]
fails = another:Fails
"""


@pytest.fixture
def _another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    info = tmp_path / "another-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: another\nVersion: 1.0\n", encoding="utf-8")
    (info / "entry_points.txt").write_text(POINTS, encoding="utf-8")
    (tmp_path / "another.py").write_text(CODE, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    assert metadata.version("another") == "1.0"


@pytest.mark.usefixtures("_another")
@pytest.mark.parametrize(
    ("uri", "made", "said"),
    [
        ("fails://b", source_of, "source fails of the package another that failed (ValueError: could not convert"),
        ("fails://b", sink_of, "sink fails of the package another that failed (ValueError: could not convert"),
        (
            "gone://b",
            source_of,
            "source gone of the package another that failed (ModuleNotFoundError: No module named 'no_such_module'), "
            "expected a device: correct the URI, or report it there",
        ),
    ],
)
def test_what_fails_there_is_said_to_be_theirs(uri: str, made: type, said: str) -> None:
    """It was an error of ours, to be reported."""
    with pytest.raises(InputError) as failed:
        made(uri)
    assert str(failed.value).startswith(f"{uri}: found the {said}")
    assert str(failed.value).endswith("), expected a device: correct the URI, or report it there")


def test_what_fails_here_is_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("contactwrench.live.sources.sri.Sri.__init__", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        source_of("sri://x")


def test_the_example_refuses_what_it_cannot_take(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLE))
    sensor = import_module("contactwrench_example_sensor").ExampleSensor
    with pytest.raises(InputError) as refused:
        sensor(parsed("example://b?amplitude=abc"))
    assert (
        str(refused.value) == "example://b?amplitude=abc: found amplitude=abc, expected N, as amplitude=10: correct it"
    )
    assert sensor(parsed("example://b?amplitude=3")).uri == "example://b?amplitude=3"
    sys.modules.pop("contactwrench_example_sensor")
