"""Pictures of a motion: what is on them, the files, and one word where nothing can draw."""

from __future__ import annotations

import os
from base64 import b64decode
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("mujoco")
Image = pytest.importorskip("PIL.Image")

from contactwrench.simulate.kinematics import HOME  # noqa: E402
from contactwrench.simulate.rig import Rig  # noqa: E402
from contactwrench.simulate.settings import Settings  # noqa: E402
from reproduction import film  # noqa: E402
from reproduction.closed_loop import Trace, servo_rig  # noqa: E402
from reproduction.scenes import PLATE, PROBE  # noqa: E402

WORK = np.array([0.6, 0.2, 0.2])
VIEW = film.View((0.3, 0.0, 0.4), 1.6, 145.0, -15.0)
NEAR = film.View((0.6, 0.2, 0.25), 0.6, 145.0, -15.0)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return servo_rig(Settings(), PROBE, PLATE)


def trace(force: float) -> Trace:
    """Two moments: at `HOME`, and with the first joint turned; the force acts at the work's face, upwards."""
    qpos = np.zeros((2, 8))
    qpos[:, :7] = HOME
    qpos[1, 0] = 0.6
    up = np.tile([0.0, 0.0, force], (2, 1))
    return Trace(np.array([0.0, 1.0]), qpos, up, np.tile(WORK, (2, 1)), WORK, np.array([1.0, 0.0, 0.0, 0.0]), 0.0)


def drawn(rig: Rig, force: float, times: tuple[float, ...] = (0.0,), view: film.View = VIEW) -> list[NDArray[np.uint8]]:
    try:
        return film.frames(rig, trace(force), np.array(times), view, 200, 160)
    except film.NoPicturesError as error:
        pytest.skip(str(error))


def coloured(picture: NDArray[np.uint8], red: int, green: int, blue: int) -> int:
    """Pixels whose hue is near a colour's."""
    wanted = np.array([red, green, blue]) / np.linalg.norm([red, green, blue])
    length = np.linalg.norm(picture.astype(float), axis=2)
    return int(np.sum((picture @ wanted > 0.985 * length) & (length > 60.0)))


@pytest.mark.slow
def test_the_arm_is_on_the_picture_and_moves(rig: Rig) -> None:
    first, second = drawn(rig, 0.0, (0.0, 1.0))
    assert first.shape == (160, 200, 3)
    assert coloured(first, 237, 115, 33) > 50  # the orange rings of the joints
    assert np.mean(np.any(first != second, axis=2)) > 0.02
    assert np.all(first[0].min(axis=0) > 200)  # the sky is above: the picture is not upside down


@pytest.mark.slow
def test_the_contact_force_is_a_green_arrow_as_long_as_the_force_is_large(rig: Rig) -> None:
    green = [coloured(drawn(rig, force, view=NEAR)[0], 26, 158, 64) for force in (0.0, 5.0, 15.0)]
    assert green[0] == 0
    assert 10 < green[1] < green[2]


@pytest.mark.slow
def test_a_filmstrip_holds_its_pictures_side_by_side_and_a_gif_one_after_the_other(rig: Rig, tmp_path: Path) -> None:
    pictures = drawn(rig, 5.0, (0.0, 1.0))
    html = film.filmstrip(pictures)
    start = html.index("base64,") + len("base64,")
    with Image.open(BytesIO(b64decode(html[start : html.index('"', start)]))) as strip:
        assert strip.size == (2 * 200 + 6, 160)
    film.write_gif(pictures, tmp_path / "film.gif", 0.1)
    with Image.open(tmp_path / "film.gif") as gif:
        assert (gif.n_frames, gif.size, gif.info["duration"]) == (2, (200, 160), 100)


@pytest.fixture
def nothing_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_driver(name: str) -> None:
        raise AttributeError("'NoneType' object has no attribute 'eglQueryString'")

    monkeypatch.setattr(film, "import_module", no_driver)


@pytest.mark.usefixtures("nothing_draws")
def test_where_nothing_can_draw_it_says_so_in_one_line_and_leaves_no_trace(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("PYOPENGL_PLATFORM", "MUJOCO_GL"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(
        film.NoPicturesError, match=r"^neither EGL nor OSMesa works here, expected one of them: install .*$"
    ):
        film.frames(rig, trace(0.0), np.array([0.0]), VIEW)
    assert "PYOPENGL_PLATFORM" not in os.environ
    assert "MUJOCO_GL" not in os.environ


def test_the_camera_looks_across_the_work_from_outside() -> None:
    for along in (np.array([0.0, 1.0, 0.0]), np.array([0.7, 0.0, -0.7]), np.array([0.0, 0.0, -1.0])):
        view = film.whole_arm(WORK, along)
        azimuth, elevation = np.deg2rad([view.azimuth, view.elevation])
        sight = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
        camera = view.lookat - view.distance * sight
        assert abs(sight @ along) < 0.9
        assert np.linalg.norm(camera[:2] - WORK[:2]) < np.linalg.norm(camera[:2]) + 0.1
