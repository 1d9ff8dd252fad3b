"""`contactwrench demo` and the examples: what a newcomer runs first."""

import runpy
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np
import pytest

import contactwrench as cw
from reproduction import film
from reproduction.film import frames
from tests.support.recordings import run_quietly

EXAMPLES = [
    path for path in sorted((Path(__file__).parents[2] / "examples").glob("*.py")) if not path.stem.startswith("live_")
]
"""Those that need no lab: the others run on one in tests/live/test_live_examples.py."""


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    folder, text, errors = tmp_path_factory.mktemp("demo") / "deep" / "folder", StringIO(), StringIO()
    with redirect_stdout(text), redirect_stderr(errors), pytest.MonkeyPatch.context() as patch:
        patch.setattr("contactwrench.report.figures.svg_text", lambda _: "<svg></svg>")  # drawn in tests/report
        assert run_quietly(["demo", "--out", f"{folder}/"]) == 0  # a folder's name may end with a slash
    assert errors.getvalue() == ""
    assert str(folder) in text.getvalue().splitlines()[-1]
    assert all(len(line) <= 80 for line in text.getvalue().splitlines() if str(folder) not in line)
    return folder, " ".join(text.getvalue().split())


@pytest.mark.slow
def test_it_writes_recordings_calibrations_contact_wrenches_and_one_report(demo: tuple[Path, str]) -> None:
    folder, _ = demo
    names = {path.name for path in folder.iterdir()}
    for one in ("panda_mini45", "paper_six_poses"):
        assert {f"{one}.csv", f"{one}.json", f"{one}_contact.csv"} <= names
        cw.Calibration.load(folder / f"{one}.json")
    assert {name for name in names if name.endswith(".html")} == {"report.html"}


def test_it_says_what_the_results_mean(demo: tuple[Path, str]) -> None:
    _, words = demo
    assert "A tool of 0.788 +- 0.008 kg; the set's authors found 0.788 kg" in words
    assert "mounted flipped and turned by 10" in words
    assert "shows the tool 7 % lighter than along another" in words
    assert "Warning doubtful: no rigid tool explains these readings" in words
    assert "six poses cannot fix the weight" in words
    assert "condition number 46" in words
    assert "weight and bias_fz: correlation -0.999" in words
    assert "Table V (1.980 N) does not follow" in words
    assert "demand 9.29 N or more" in words


def test_the_panda_set_is_left_with_the_noise_of_its_poses(demo: tuple[Path, str]) -> None:
    table = np.genfromtxt(demo[0] / "panda_mini45_contact.csv", delimiter=",", names=True)
    force = np.column_stack([table[name] for name in ("fx", "fy", "fz")])
    assert np.sqrt(np.mean(np.sum(force**2, axis=1))) == pytest.approx(0.244, rel=0.05)
    assert np.all(table["fx_std"] > 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_examples_run(
    example: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A film is of one picture."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(film, "frames", lambda rig, trace, times, *view: frames(rig, trace, times[:1], *view))
    runpy.run_path(str(example), run_name="__main__")
    assert capsys.readouterr().out
