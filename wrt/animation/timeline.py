"""Times of frames: the animation of a glTF or USD file, and the keyframes of a scene, whose shutter moves along."""

from __future__ import annotations

import dataclasses
import os
import warnings
from functools import lru_cache

import numpy as np

from wrt.errors import InputError
from wrt.io.archives import unpacked
from wrt.io.cameras import with_camera
from wrt.io.load_mesh import animation_of, load_file
from wrt.io.mesh.parts import NO_ANIMATION
from wrt.io.safe_read import PathLike
from wrt.scene.motion import Motion
from wrt.scene.scene import Scene
from wrt.studio.subjects import Reach, reach_of

TIMES = 12
"""Times between the first keyframe and the last at which shapes are located."""


def is_animated(path: PathLike) -> bool:
    """Return whether a file has an animation that `wrt.load` evaluates at a time."""
    with unpacked(path) as file:
        return os.path.isfile(file) and animation_of(file) is not None


def reach_of_file(path: PathLike, camera: int | str | None = None, up: str | None = None) -> Reach:
    """Return the space that a file's first animation covers, so that one studio and one camera serve all frames.

    The result is cached for the latest file, since each frame of an animation needs it.

    Args:
        path: the file.
        camera: the name or number of its camera; by default the first.
        up: the axis that points up, see `load_file`.

    Raises:
        InputError: if the file has no animation, lacks that camera, or cannot be read.
    """
    if (ends := animation_of(path)) is None:
        raise InputError(f"{path}: {NO_ANIMATION}")
    status = os.stat(path)
    version = status.st_dev, status.st_ino, status.st_mtime_ns, status.st_size
    return _reach(os.fspath(path), ends, camera, up, version)


@lru_cache(maxsize=1)
def _reach(
    path: str, ends: tuple[float, float], camera: int | str | None, up: str | None, _version: tuple[int, ...]
) -> Reach:
    times = np.unique(np.linspace(*ends, TIMES)).tolist()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # loading the frame itself repeats them
        return reach_of(with_camera(path, load_file(path, time=time, up=up), camera) for time in times)


def moves(scene: Scene) -> bool:
    """Return whether a shape or the camera of a scene has keyframes that differ."""
    motions = [shape.transform for shape in scene.shapes if isinstance(shape.transform, Motion)]
    if scene.camera is not None and scene.camera.motion is not None:
        motions.append(scene.camera.motion)
    deformations = [shape.deformation for shape in scene.shapes if shape.deformation is not None]
    return any(motion.moves for motion in motions) or any(
        bool((each.vertices != each.vertices[0]).any()) for each in deformations
    )


def at_frame(scene: Scene, number: int, fps: float) -> Scene:
    """Return the scene of a frame, which begins at `number`/`fps` seconds.

    The scene's camera defines the shutter of frame 0. In each frame it opens `shutter_open` seconds after the frame
    begins and stays open for the same time, but closes when the frame ends.

    Raises:
        InputError: if the scene has no camera.
    """
    camera = scene.camera
    if camera is None:
        raise InputError("frames of a scene that moves need a camera, since every frame would be framed differently")
    begin, end = number / fps, (number + 1) / fps
    opens, closes = begin + camera.shutter_open, begin + camera.shutter_close
    if camera.shutter_close > camera.shutter_open:
        opens = min(opens, end)
        closes = min(closes, max(opens, end))
    return dataclasses.replace(scene, camera=dataclasses.replace(camera, shutter_open=opens, shutter_close=closes))
