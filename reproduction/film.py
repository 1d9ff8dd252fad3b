"""Pictures of a motion, rendered off-screen: a filmstrip, or a moving GIF.

The context for drawing is EGL's, or OSMesa's where EGL does not work, made here: nothing has to be set before mujoco is
imported, and no window is needed.
"""

from __future__ import annotations

import os
import sys
from base64 import b64encode
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactwrench.errors import ContactWrenchError, MissingExtraError
from contactwrench.geometry.arrays import Array
from contactwrench.simulate.rig import Rig, import_mujoco

from .closed_loop import Trace

PER_NEWTON = 0.012
"""Length of the arrow of the contact force, m/N."""
LONGEST_ARROW = 0.25
FAINTEST = 0.3
"""N: below, no arrow."""
ARROW_COLOUR = np.array([0.1, 0.62, 0.25, 1.0])
POST_COLOUR = np.array([0.5, 0.52, 0.55, 1.0])


class NoPicturesError(ContactWrenchError, RuntimeError):
    """Nothing here can draw without a screen."""


@dataclass(frozen=True)
class View:
    """Where the camera looks from: `lookat` (m, world axes), `distance` m, `azimuth` and `elevation` deg."""

    lookat: tuple[float, float, float]
    distance: float
    azimuth: float
    elevation: float


def whole_arm(work: Array, along: Array) -> View:
    """Arm and work (3,), m, seen across the direction (3,) in which the tool works, from outside; world axes."""
    across = np.array([-along[1], along[0]])
    if np.linalg.norm(across) < 0.3:
        across = np.array([-work[1], work[0]])
    across /= np.linalg.norm(across)
    if across @ work[:2] < 0.0:
        across = -across
    outside = across + 0.7 * work[:2] / np.linalg.norm(work[:2])
    lookat = 0.5 * work + 0.5 * np.array([0.0, 0.0, 0.35])
    x, y, z = (float(value) for value in lookat)
    return View((x, y, z), 1.5, float(np.rad2deg(np.arctan2(-outside[1], -outside[0]))), -15.0)


def frames(
    rig: Rig, trace: Trace, times: Array, view: View, width: int = 480, height: int = 480
) -> list[NDArray[np.uint8]]:
    """Pictures (height, width, 3) of a motion at `times` (k,), s, with the contact force on the tool as an arrow.

    Raises `NoPicturesError`, one line, where neither EGL nor OSMesa works.
    """
    mujoco = import_mujoco()
    data = mujoco.MjData(rig.model)
    data.mocap_pos[0], data.mocap_quat[0] = trace.work_position, trace.work_quat_wxyz
    camera = mujoco.MjvCamera()
    camera.lookat[:], camera.distance = view.lookat, view.distance
    camera.azimuth, camera.elevation = view.azimuth, view.elevation
    scene, option, pixels = mujoco.MjvScene(rig.model, maxgeom=400), mujoco.MjvOption(), []
    with _drawing(mujoco, rig.model, width, height) as context:
        window = mujoco.MjrRect(0, 0, width, height)
        for moment in np.searchsorted(trace.t, times).clip(0, len(trace.t) - 1):
            data.qpos[:] = trace.qpos[moment]
            mujoco.mj_forward(rig.model, data)
            mujoco.mjv_updateScene(rig.model, data, option, None, camera, mujoco.mjtCatBit.mjCAT_ALL, scene)
            _post(mujoco, scene, data)
            _arrow(mujoco, scene, trace.force[moment], trace.point[moment])
            mujoco.mjr_render(window, scene, context)
            picture = np.empty((height, width, 3), dtype=np.uint8)
            mujoco.mjr_readPixels(picture, None, window, context)
            pixels.append(picture[::-1])
    return pixels


def filmstrip(pictures: list[NDArray[np.uint8]]) -> str:
    """Pictures side by side as an `img` with its data inside, a PNG."""
    gap = np.full((len(pictures[0]), 6, 3), 255, dtype=np.uint8)
    row = [part for picture in pictures for part in (picture, gap)][:-1]
    held = BytesIO()
    _image(np.concatenate(row, axis=1)).save(held, format="PNG", optimize=True)
    return f'<img alt="" src="data:image/png;base64,{b64encode(held.getvalue()).decode()}"/>'


def write_gif(pictures: list[NDArray[np.uint8]], path: Path, seconds: float) -> None:
    """A GIF that runs for ever, `seconds` from one picture to the next."""
    first, *rest = (_image(picture) for picture in pictures)
    first.save(path, save_all=True, append_images=rest, duration=round(1000.0 * seconds), loop=0)


def _image(pixels: NDArray[np.uint8]) -> Any:
    try:
        from PIL import Image
    except ImportError:
        raise MissingExtraError(
            "pictures need pillow, which is not installed: pip install 'contactwrench[sim]'"
        ) from None
    return Image.fromarray(pixels).quantize(256, method=Image.Quantize.FASTOCTREE)


def _post(mujoco: Any, scene: Any, data: Any) -> None:
    """What holds the work: a post from behind it down to the floor."""
    behind = data.mocap_pos[0] - 0.045 * data.body("work").xmat.reshape(3, 3)[:, 2]
    _bar(mujoco, scene, mujoco.mjtGeom.mjGEOM_CAPSULE, 0.02, behind, np.array([behind[0], behind[1], 0.0]), POST_COLOUR)


def _arrow(mujoco: Any, scene: Any, force: Array, point: Array) -> None:
    """The contact force on the tool, its tip where it acts."""
    size = float(np.linalg.norm(force))
    if size > FAINTEST:
        long = min(PER_NEWTON * size, LONGEST_ARROW)
        _bar(mujoco, scene, mujoco.mjtGeom.mjGEOM_ARROW, 0.008, point, point + long / size * force, ARROW_COLOUR)


def _bar(mujoco: Any, scene: Any, kind: Any, width: float, start: Array, end: Array, colour: Array) -> None:
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), colour.astype(np.float32))
    mujoco.mjv_connector(geom, kind, width, start, end)
    scene.ngeom += 1


@contextmanager
def _drawing(mujoco: Any, model: Any, width: int, height: int) -> Iterator[Any]:
    """MuJoCo's drawing context, off-screen, by the first platform that works."""
    for platform in ("egl", "osmesa"):
        with _platform_set(platform):
            try:
                gl = import_module(f"mujoco.{platform}").GLContext(width, height)
                gl.make_current()
                context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
            except Exception:  # whatever a driver that is not there raises: ImportError, AttributeError, its own
                _forget_opengl()
                continue
            try:
                mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, context)
                yield context
            finally:
                context.free()
                gl.free()
            return
    raise NoPicturesError("neither EGL nor OSMesa works here, expected one of them: install libegl1 or libosmesa6")


@contextmanager
def _platform_set(platform: str) -> Iterator[None]:
    """The variables that PyOpenGL and MuJoCo choose their platform by, for as long as pictures are drawn."""
    names = ("MUJOCO_GL", "PYOPENGL_PLATFORM")
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, platform))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _forget_opengl() -> None:
    """PyOpenGL binds itself to a platform when it is first imported, and would stay with one that does not work."""
    for name in [name for name in sys.modules if name == "OpenGL" or name.startswith("OpenGL.")]:
        del sys.modules[name]
