"""The report: one HTML file that needs nothing else, well formed, with what a reader looks for."""

from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.baselines import compare
from contactwrench.report import figures
from contactwrench.report.html import write_calibration_report
from tests.recordings import PANDA, PAPER
from tests.rigs import example, noisy

VOID = {"meta", "br", "link", "img", "hr", "input"}


class _Page(HTMLParser):
    """Collects tags, references and text, and checks that every tag is closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.references: list[str] = []
        self.words: list[str] = []
        self._open: list[str] = []
        self.feed(text)
        assert not self._open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.references += [value for name, value in attrs if name in ("src", "href", "xlink:href") and value]
        if tag not in VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self._open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def _page(path: Path) -> tuple[_Page, str]:
    page = _Page(path.read_text(encoding="utf-8"))
    return page, " ".join(" ".join(page.words).split())


def test_the_report_is_one_file_without_network_or_script(tmp_path: Path) -> None:
    write_calibration_report(tmp_path / "r.html", cw.calibrate(cw.read(PANDA), "mount"))
    page, _ = _page(tmp_path / "r.html")
    assert "script" not in page.tags
    assert "link" not in page.tags
    assert all(reference.startswith(("#", "data:image/png;base64,")) for reference in page.references)
    assert page.tags.count("svg") == 5


@pytest.mark.parametrize("model", ["paper", "yaw", "mount", "affine"])
def test_it_says_what_was_found_how_good_it_is_and_what_is_weak(tmp_path: Path, model: str) -> None:
    calibration = cw.calibrate(cw.read(PAPER if model == "paper" else PANDA), model)
    write_calibration_report(tmp_path / "r.html", calibration)
    _, words = _page(tmp_path / "r.html")
    assert calibration.verdict.partition(": ")[2][1:] in words
    for warning in calibration.warnings:
        assert warning.replace("+-", "±") in words
    for heading in (
        "Parameters",
        "Fit",
        "What is left in each contact-free pose",
        "Residuals",
        "Directions of gravity that the poses covered",
        "Standard deviation of the contact wrench over orientations",
    ):
        assert heading in words
    for way in ("full", "tare", "gravity only", "raw"):
        assert way in words


def test_names_from_outside_cannot_become_markup(tmp_path: Path) -> None:
    samples = cw.read(PANDA)
    strange = cw.Samples(samples.wrench, samples.R_base_flange, source="<script>alert(1)</script> & more.csv")
    write_calibration_report(tmp_path / "r.html", cw.calibrate(strange, "mount"))
    page, words = _page(tmp_path / "r.html")
    assert "script" not in page.tags
    assert "<script>alert(1)</script> & more.csv" in words


def test_a_calibration_of_very_many_poses_has_a_report_without_them(tmp_path: Path) -> None:
    rig, R, rng = example(1, poses=10_001)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    assert calibration.moments is not None
    write_calibration_report(tmp_path / "r.html", calibration)
    page, words = _page(tmp_path / "r.html")
    assert "more than 10,000 poses" in words
    assert "svg" not in page.tags


def test_figures_are_the_same_bytes_each_time() -> None:
    calibration = cw.calibrate(cw.read(PANDA), "mount+base")
    R = np.array([pose.R_base_flange for pose in calibration.poses])
    ways = compare(calibration, calibration.poses)
    assert figures.left_over_per_pose(ways) == figures.left_over_per_pose(ways)
    assert figures.residuals_per_pose(calibration, ways[0]) == figures.residuals_per_pose(calibration, ways[0])
    assert figures.gravity_on_sphere(calibration, R) == figures.gravity_on_sphere(calibration, R)
    once, again = (figures.std_over_orientations(calibration, R, "torque") for _ in range(2))
    assert once == again


def test_gravity_is_drawn_on_the_half_of_the_sphere_that_it_points_to() -> None:
    """Three poses with gravity along the flange's +z, one along -z (quaternions of half turns)."""
    calibration = cw.calibrate(cw.read(PANDA), "mount")
    down, up = np.diag([1.0, -1.0, -1.0]), np.eye(3)
    svg = figures.gravity_on_sphere(calibration, np.array([down, down, down, up]))
    assert "+z: 3 poses" in svg
    assert "-z: 1 pose" in svg


def test_without_matplotlib_the_report_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(__import__("sys").modules, "matplotlib", None)
    with pytest.raises(cw.ContactWrenchError, match=r"needs matplotlib.*pip install 'contactwrench\[report\]'"):
        write_calibration_report(tmp_path / "r.html", cw.calibrate(cw.read(PANDA), "mount"))
    assert not (tmp_path / "r.html").exists()
