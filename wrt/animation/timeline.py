"""Frames of scenes that move: the camera's shutter is moved to the time of each frame."""

from __future__ import annotations

import dataclasses

from wrt.errors import InputError
from wrt.scene.camera import Camera
from wrt.scene.motion import Motion
from wrt.scene.scene import Scene


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
    """Return the scene of a frame, whose shutter opens at `number`/`fps` seconds.

    The shutter of the scene's camera is that of frame 0: it opens `shutter_open` seconds after the frame begins, for as
    long as there, but is closed when the frame ends.

    Raises:
        InputError: when the scene has no camera.
    """
    if scene.camera is None:
        raise InputError("frames of a scene that moves need a camera, since every frame would be framed differently")
    return dataclasses.replace(scene, camera=camera_at(scene.camera, number, fps))


def camera_at(camera: Camera, number: int, fps: float) -> Camera:
    """Return a camera with its shutter in a frame; see `at_frame`."""
    begin, end = number / fps, (number + 1) / fps
    opens = begin + camera.shutter_open
    closes = begin + camera.shutter_close
    if camera.shutter_close > camera.shutter_open:
        opens = min(opens, end)
        closes = min(closes, max(opens, end))
    return dataclasses.replace(camera, shutter_open=opens, shutter_close=closes)
