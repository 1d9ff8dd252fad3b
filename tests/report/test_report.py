"""The report: one HTML file that needs nothing else, well formed, with what a reader looks for."""

import re
from dataclasses import replace
from functools import cache, partial
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.assess.verify import compare
from contactwrench.calibration.findings import BIAS_MOVED, Finding, Kind, Severity
from contactwrench.calibration.text import verdict_sentences
from contactwrench.report import figures
from contactwrench.report.html import write_calibration_report
from contactwrench.samples.poses import Pose
from contactwrench.statistics import meaningful_digits
from tests.support.recordings import PANDA, PAPER
from tests.support.rigs import example, noisy
from tests.support.world import random_rotations

TITLES = ("h3", "summary")
VOID = {"meta", "br", "link", "img", "hr", "input"}


panda = cache(partial(cw.calibrate, cw.read(PANDA)))
"""The set of measured poses calibrated by a model."""


class _Page(HTMLParser):
    """Collects tags, references and text, and checks that every tag is closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.references: list[str] = []
        self.words: list[str] = []
        self._rows: list[tuple[str, list[str]]] = []
        self._title = ""
        self._open: list[str] = []
        self.feed(text)
        assert not self._open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.references += [value for name, value in attrs if name in ("src", "href", "xlink:href") and value]
        if tag not in VOID:
            self._open.append(tag)
        if tag in TITLES:
            self._title = ""
        elif tag == "tr":
            self._rows.append((self._title, []))
        elif tag in ("th", "td"):
            self._rows[-1][1].append("")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self._open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)
        if self._open and self._open[-1] in TITLES:
            self._title += data
        elif {"th", "td"} & set(self._open):
            self._rows[-1][1][-1] += data

    def rows_after(self, title: str) -> list[list[str]]:
        """The text of every cell of the table under a title, row by row."""
        return [cells for under, cells in self._rows if under == title]


def _page(path: Path) -> tuple[_Page, str]:
    page = _Page(path.read_text(encoding="utf-8"))
    return page, " ".join(" ".join(page.words).split())


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> tuple[_Page, str, str]:
    """A page with all of its figures, of a recording whose name would be markup, its words, and the file's text."""
    samples, path = cw.read(PANDA), tmp_path_factory.mktemp("drawn") / "r.html"
    strange = cw.Samples(samples.wrench, samples.R_base_flange, source="<script>alert(1)</script> & more.csv")
    write_calibration_report(path, cw.calibrate(strange, "mount"))
    return *_page(path), path.read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_report_is_one_file_without_network_or_script(drawn: tuple[_Page, str, str]) -> None:
    page, _, _ = drawn
    assert "script" not in page.tags
    assert "link" not in page.tags
    assert all(reference.startswith(("#", "data:image/png;base64,")) for reference in page.references)
    assert page.tags.count("svg") == 4


@pytest.mark.usefixtures("undrawn")
@pytest.mark.slow
@pytest.mark.parametrize("model", ["paper", "mount", "affine"])
def test_it_says_what_was_found_how_good_it_is_and_what_is_weak(tmp_path: Path, model: str) -> None:
    calibration = cw.calibrate(cw.read(PAPER), model) if model == "paper" else panda(model)
    write_calibration_report(tmp_path / "r.html", calibration)
    _, words = _page(tmp_path / "r.html")
    for sentence in verdict_sentences(calibration):
        assert sentence[1:] in words
    for warning in calibration.warnings:
        assert warning.replace("+-", "±") in words
    for heading in (
        "Parameters",
        "Fit",
        "What is left in each contact-free pose",
        "Residuals",
        "Directions of gravity that the poses covered, and the std of the contact wrench over all",
    ):
        assert heading in words
    for way in ("full", "tare", "gravity only", "raw"):
        assert way in words


@pytest.mark.slow
def test_names_from_outside_cannot_become_markup(drawn: tuple[_Page, str, str]) -> None:
    page, words, _ = drawn
    assert "script" not in page.tags
    assert "<script>alert(1)</script> & more.csv" in words


@pytest.mark.slow
def test_a_calibration_of_very_many_poses_has_a_report_without_them(tmp_path: Path) -> None:
    rig, R, rng = example(1, poses=10_001)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    assert calibration.moments is not None
    write_calibration_report(tmp_path / "r.html", calibration)
    page, words = _page(tmp_path / "r.html")
    assert "more than 10,000 poses" in words
    assert "svg" not in page.tags


@pytest.mark.slow
def test_figures_are_the_same_bytes_each_time(drawn: tuple[_Page, str, str]) -> None:
    calibration = panda("mount")
    ways = compare(calibration, calibration.poses)
    for svg in (
        figures.left_over_per_pose(calibration, ways),
        figures.residuals_per_pose(calibration, ways[0]),
        figures.sensor_axes(calibration),
        figures.std_over_orientations(calibration),
    ):
        assert svg in drawn[2]


def test_gravity_is_drawn_on_the_half_of_the_sphere_that_it_points_to() -> None:
    """Three poses with gravity along the flange's +z, one along -z (half turns), and one more that was left out."""
    down, up = np.diag([1.0, -1.0, -1.0]), np.eye(3)
    poses = [Pose(R, np.zeros(6), np.zeros((6, 6)), 1, None, None, None) for R in (down, down, down, up)]
    poses.append(Pose(up, np.zeros(6), np.zeros((6, 6)), 1, None, None, "in contact"))
    svg = figures.std_over_orientations(replace(panda("mount"), poses=tuple(poses)))
    assert "+z: 3 poses" in svg
    assert "-z: 1 pose<" in svg


@pytest.mark.usefixtures("undrawn")
@pytest.mark.slow
def test_auto_shows_what_it_assumed_and_what_other_models_make_of_the_poses(tmp_path: Path) -> None:
    calibration = panda()
    write_calibration_report(tmp_path / "r.html", calibration)
    page, words = _page(tmp_path / "r.html")
    for assumption in calibration.assumptions:
        assert assumption[1:].replace("+-", "±") in words
    rows = page.rows_after("What other models make of the same poses")
    assert [row[0] for row in rows[1:]] == ["yaw", "mount", "mount+base", "affine"]
    of_yaw = calibration.alternatives[0]
    assert of_yaw.weight is not None
    assert of_yaw.weight_std is not None
    assert rows[1][1] == " ± ".join(meaningful_digits(of_yaw.weight, of_yaw.weight_std))
    assert rows[4][1] == "-"
    for absent in ("Poses that were left out", "left out", "Hollow", "But the bias"):
        assert absent not in words
    write_calibration_report(tmp_path / "both.html", panda("mount+base"))
    _, words = _page(tmp_path / "both.html")
    assert "What was assumed" not in words
    assert "What other models" not in words


@pytest.mark.usefixtures("undrawn")
@pytest.mark.slow
@pytest.mark.parametrize("timed", [True, False])
def test_poses_that_were_left_out_keep_their_numbers_and_say_why(tmp_path: Path, timed: bool) -> None:
    """A push of 4 N at 50 mm in the sixth pose, of which compensation must leave just that, within the noise."""
    panda = cw.read(PANDA)
    wrench = panda.wrench.copy()
    wrench[5] += [0.0, 0.0, -4.0, 0.0, 0.2, 0.0]
    samples = cw.Samples(wrench, panda.R_base_flange, t=np.arange(17.0) * 10.0 if timed else None)
    calibration = cw.calibrate(samples)
    write_calibration_report(tmp_path / "r.html", calibration)
    page, words = _page(tmp_path / "r.html")
    head, row = page.rows_after("Poses that were left out")
    assert head == ["pose", *(["time, s"] if timed else []), "left, N", "left, mN m", "why"]
    assert row[:-3] == ["6", *(["50"] if timed else [])]
    assert float(row[-3]) == pytest.approx(4.0, abs=0.6)
    assert float(row[-2]) == pytest.approx(200.0, abs=20.0)
    assert row[-1] == calibration.poses[5].rejected
    assert "1 of 17 poses did not take part in the fit." in words
    assert "Shaded: poses that were left out." in words
    assert "Hollow: poses that were left out." in words
    every = page.rows_after("Every pose in numbers")
    assert [line[0] for line in every[1:]] == [str(k) for k in range(1, 18)]
    assert [line[0] for line in every if line[-1] == "left out"] == ["6"]


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("kind", [Kind.BIAS_STEPPED, Kind.BIAS_DRIFTED, Kind.BIAS_WANDERED, Kind.POSE_LEFT_OUT])
def test_a_bias_that_moved_is_said_where_the_residuals_show_it(tmp_path: Path, kind: Kind) -> None:
    finding = Finding.doubtful(kind, "something happened after pose 3")
    calibration = replace(panda("mount"), findings=(finding,))
    write_calibration_report(tmp_path / "r.html", calibration)
    _, words = _page(tmp_path / "r.html")
    how = kind.value.replace("_", " ")
    assert (f"But the {how}. The calibration holds the last bias" in words) == (kind in BIAS_MOVED)
    assert ("drawn against it" in words) == (kind in BIAS_MOVED)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("severity", "missed", "box"),
    [
        (Severity.WARNING, "", "good"),
        (Severity.DOUBTFUL, "", "doubtful"),
        (Severity.WEAK, "", "weak"),
        (Severity.NOTE, "force 1 N over 0.1", "missed"),
    ],
)
def test_only_good_is_green_and_warnings_stand_outside_of_it(
    tmp_path: Path, severity: Severity, missed: str, box: str
) -> None:
    finding = Finding(Kind.OTHER, severity, "something is odd")
    calibration = replace(panda("mount"), findings=(finding,))
    write_calibration_report(tmp_path / "r.html", calibration, missed=missed)
    text = (tmp_path / "r.html").read_text()
    (inside, after) = text.partition('<div class="verdict ')[2].split("</div>")[:2]
    assert inside.startswith(f'{box}"><strong>')
    assert "something is odd" not in inside
    assert after.startswith("<ul><li>something is odd</li></ul>")
    assert ("misses what is required, force 1 N over 0.1." in inside) == bool(missed)


@pytest.mark.usefixtures("undrawn")
def test_the_head_says_what_was_stated_and_no_more(tmp_path: Path) -> None:
    calibration = panda("mount")
    stated: dict[str, str | int | float | bool | None] = {
        "source": "a & b.mcap",
        "created": "2026-11-22T06:00:00+00:00",
        "robot": "panda",
        "wrench_topic": "/ft",
    }
    write_calibration_report(tmp_path / "r.html", replace(calibration, provenance=stated))
    _, words = _page(tmp_path / "r.html")
    assert "file a & b.mcap · calibrated 2026-11-22T06:00:00 UTC · robot panda · sensor /ft" in words
    write_calibration_report(tmp_path / "r.html", replace(calibration, provenance={"robot": None}))
    _, words = _page(tmp_path / "r.html")
    assert "17 poses Doubtful" in words


@pytest.mark.usefixtures("undrawn")
def test_stops_stand_in_the_order_of_time(tmp_path: Path) -> None:
    """The third of the recording's stops was left out and is the last of the poses, as estimation keeps them."""
    calibration = panda("mount")
    times = [0.0, 10.0, *(10.0 * k for k in range(3, 17)), 20.0]
    poses = [replace(pose, t_start=t, t_end=t + 1.0) for pose, t in zip(calibration.poses, times, strict=True)]
    poses[16] = replace(poses[16], rejected="in contact")
    timed = replace(calibration, poses=tuple(poses))
    assert figures.in_order_of_time(timed).tolist() == [0, 1, 16, *range(2, 16)]
    assert figures.in_order_of_time(calibration).tolist() == list(range(17))
    fitted, left_out = figures.places_in_time(timed)
    assert (fitted.tolist(), left_out.tolist()) == ([1, 2, *range(4, 18)], [3])
    write_calibration_report(tmp_path / "r.html", timed)
    page, _ = _page(tmp_path / "r.html")
    assert [row[0] for row in page.rows_after("Every pose in numbers")[1:5]] == ["1", "2", "17", "3"]


def test_the_maps_have_a_scale_from_zero_to_what_is_weak() -> None:
    """A hundred times the error, and the same scale: up to a tenth of the weight of 7.7 N, at 50 mm for the torque."""
    c = panda("mount")
    sure, vague = (figures.std_over_orientations(replace(c, covariance=k * c.covariance)) for k in (1e-4, 1.0))
    scales = [re.findall(r">([0-9.]+)</text>", svg) for svg in (sure, vague)]
    tenths = [f"0.{k}" for k in range(8)]
    assert scales[0] == scales[1] == [*tenths, *map(str, range(0, 40, 5))]


def test_the_maps_say_between_what_the_std_lies_on_either_half() -> None:
    """Against orientations drawn at random."""
    c = cw.calibrate(cw.read(PAPER), "mount")
    R = random_rotations(4000, np.random.default_rng(1))
    std = np.linalg.norm(c.wrench_std(R).reshape(-1, 2, 3), axis=2) * [1.0, 1e3]
    up = (c.gravity_direction @ R)[:, 2] > 0.0
    said = re.findall(r">([0-9.]+) to ([0-9.]+) m?N", figures.std_over_orientations(c))
    ends = [(std[half, k].min(), std[half, k].max()) for k in (0, 1) for half in (up, ~up)]
    assert np.array(said, dtype=np.float64) == pytest.approx(np.array(ends), rel=0.07)


def test_the_drawing_names_the_axes_the_centre_of_mass_and_the_weight() -> None:
    calibration = panda("mount")
    assert calibration.weight is not None
    assert calibration.com is not None
    svg = figures.sensor_axes(calibration)
    for name in ("x", "y", "z", "flange x", "flange y", "flange z", f"{calibration.weight:.2f} N"):
        assert f">{name}<" in svg
    assert f">com {', '.join(f'{1e3 * part:.1f}' for part in calibration.com)} mm<" in svg
    assert figures.sensor_axes(panda("affine")) == ""


@pytest.mark.parametrize("inertia", [1e-4 * np.diag([4.0, 17.0, 19.0]), 1e-4 * np.diag([9.0, 16.0, 25.0]), np.eye(3)])
def test_the_body_is_drawn_and_in_numbers_where_the_inertia_is_known(
    inertia: np.ndarray, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    """A slim body; a flat one, whose outline is an ellipse all the same; and one that is hardly known."""
    moving_tool = pytest.importorskip("tests.support.moving_tool")
    _, known = moving_tool.known(2, "mount", noise=1.0)
    calibration = replace(known, dynamics=replace(known.dynamics, inertia=inertia))
    outlined = figures.sensor_axes(calibration)
    assert "nan" not in outlined
    assert outlined.count(figures.BODY) == 1 + 1 + 3
    assert outlined.count(figures.BODY) > figures.sensor_axes(replace(known, dynamics=None)).count(figures.BODY)
    request.getfixturevalue("undrawn")  # from here on words
    write_calibration_report(tmp_path / "r.html", calibration)
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "Brown: the uniform solid ellipsoid of the same mass and inertia" in page
    body = calibration.ellipsoid
    assert body is not None
    moments = [meaningful_digits(1e4 * m, 1e4 * s) for m, s in zip(body.moments, body.moment_std, strict=True)]
    assert all(f"<td>{moment} ± {std}</td>" in page for moment, std in moments)


def test_without_matplotlib_the_report_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(__import__("sys").modules, "matplotlib", None)
    with pytest.raises(cw.ContactWrenchError, match=r"needs matplotlib.*pip install 'contactwrench\[report\]'"):
        write_calibration_report(tmp_path / "r.html", panda("mount"))
    assert not (tmp_path / "r.html").exists()
