"""Options of a picture besides its source: view, material, environment, a transparent background."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from wrt.errors import InputError, name_of, warn
from wrt.scene.camera import Camera
from wrt.scene.environment import Environment, SunSkyEnvironment
from wrt.scene.materials import Material
from wrt.scene.scene import Scene, Shape
from wrt.studio.framing import frame_camera
from wrt.studio.presentation import FOV_DEGREES, SETTINGS, present
from wrt.studio.subjects import Reach, share_of_picture, subjects
from wrt.studio.views import VIEWS, view_angles, view_direction
from wrt.values import number, vec3

SKY = "sky"
"""The word for a clear sky with the sun instead of the name of an image."""

FOR_ANIMATIONS = "a time is for glTF and USD files with an animation"

SMALL = 0.5
"""Part of the picture's width or height that a file's camera must fill with the mesh to be kept."""

_SCENE_MARGIN = 1.15
_SKY_STOPS = -5.5  # scales the absolute radiance of a day to a well exposed picture, see SunSkyEnvironment
_SUN = (-0.75, 1.15, 0.8)  # where the studio's lamp is


@dataclasses.dataclass(frozen=True)
class Stage:
    """The options of `wrt.load` for showing the source.

    Attributes:
        view: the angles of a view, see `wrt.studio.views`; None for the source's camera, or else three-quarter.
        frame: whether to ignore the camera of the source and frame what it shows; None to decide by whether that
            camera shows a mesh well.
        material: replaces the materials of a mesh.
        environment: lights the source instead of the studio, or of the scene's own environment.
        transparent: whether the picture shows neither backdrop nor environment, but how much of each pixel is covered.
        aspect: width of the picture over its height; None to take it from the source's settings.
        time: the time of the source's animation, seconds; None for the source at rest.
        cameras: cameras that replace the source's, the first one in use; empty to keep those.
        reach: what that animation shows at all times, if there is a time; the studio and its camera are made for it.
        is_bare: whether a mesh file is left without a studio.
        shadow_catcher: whether a mesh stands on ground that shows its shadow alone.
    """

    view: Any = None
    frame: bool | None = None
    material: Any = None
    environment: Any = None
    transparent: bool = False
    aspect: float | None = None
    time: float | None = None
    reach: Reach | None = None
    cameras: Mapping[str, Camera] = dataclasses.field(default_factory=dict)
    is_bare: bool = False
    shadow_catcher: bool = False

    def __post_init__(self) -> None:
        """Check the options, as a person gives them, and keep the things that they stand for.

        Raises:
            InputError: if one of them cannot be used, or the image of an environment cannot be read.
        """
        view, material, environment = self.view, self.material, self.environment
        if view is not None:
            view = view_angles(view)
            if self.frame is False:
                raise InputError("a view replaces the source's camera; it cannot be kept as well")
        if material is not None and not isinstance(material, Material):
            from wrt.io.objects import material_of

            material = material_of(material)
        if environment is not None:
            environment = _environment(environment, (view or VIEWS["three-quarter"])[0])
        time = None if self.time is None else number(self.time, "time")
        values = {"view": view, "material": material, "environment": environment, "time": time}
        for name, value in (values | {"transparent": bool(self.transparent)}).items():
            object.__setattr__(self, name, value)

    def with_cameras(self, scene: Scene) -> Scene:
        """Return a scene with the cameras that replace its own, if there are any."""
        if not self.cameras:
            return scene
        return dataclasses.replace(scene, camera=next(iter(self.cameras.values())), cameras=dict(self.cameras))

    def shown(self, scene: Scene) -> Scene:
        """Return a scene with these options.

        Raises:
            InputError: if one of them is for meshes only.
        """
        if self.time is not None:
            raise InputError(f"{FOR_ANIMATIONS}; --frames renders a scene's own keyframes")
        if self.material is not None:
            raise InputError("a material is for meshes; the shapes of a scene have their own")
        if self.shadow_catcher:
            raise InputError(
                "a shadow catcher is put under meshes in the studio; give shapes of a scene shadow_catcher = true"
            )
        scene = self.with_cameras(scene)
        settings, camera = scene.settings, scene.camera
        if self.transparent:
            settings = dataclasses.replace(settings, transparent=True)
        if self.frame or self.view is not None or (self.reach is not None and camera is None):
            camera = self._framed(scene)
        environment = scene.environment if self.environment is None else self.environment
        if settings is scene.settings and camera is scene.camera and environment is scene.environment:
            return scene
        return dataclasses.replace(scene, settings=settings, camera=camera, environment=environment)

    def _framed(self, scene: Scene) -> Camera:
        if not scene.shapes:
            raise InputError("there is nothing to frame: the scene has no shapes")
        aspect = scene.settings.width / scene.settings.height if self.aspect is None else self.aspect
        old = scene.camera
        if old is None or self.view is not None:
            toward, up = view_direction(self.view or "three-quarter")
        else:
            at_first = old if self.reach is None or self.reach.camera is None else self.reach.camera
            _, upwards, forward = at_first.frame()
            toward, up = vec3(-forward), vec3(upwards)
        if self.reach is None:
            points = np.concatenate([shape.outline for shape in subjects(scene.shapes, old)])
        else:
            points = self.reach.subjects
        camera = frame_camera(points, aspect, view=toward, up=up, fov_degrees=FOV_DEGREES, margin=_SCENE_MARGIN)
        if old is None:
            return camera
        shutter = {name: getattr(old, name) for name in ("shutter_open", "shutter_close", "shutter_ramp")}
        return dataclasses.replace(camera, **shutter)

    def present(self, source: object, scene: Scene, up: str, *, neutral: bool = False) -> Scene:
        """Return the content of a mesh file in a studio, or with its own lights.

        Args:
            source: the file or object, for messages.
            scene: its content.
            up: the axis that points up.
            neutral: whether the studio's light is that of glTF's viewers.
        """
        if self.cameras and self.shadow_catcher:
            raise InputError(
                "a shadow catcher lies under meshes that stand upright, which cameras of their own do not "
                "say; add a shape with shadow_catcher=True"
            )
        scene = self.with_cameras(scene)
        shapes, camera = scene.shapes, scene.camera
        if self.material is not None:
            shapes = [dataclasses.replace(shape, material=self.material, emission=0.0) for shape in shapes]
        if self.frame or self.view is not None:
            camera = None
        shines = any(light.shines for light in scene.lights) or any(shape.emits for shape in shapes)
        if scene.environment is not None or (scene.lights and shines):
            lit = dataclasses.replace(scene, shapes=shapes, camera=scene.camera, settings=dataclasses.replace(SETTINGS))
            return dataclasses.replace(self, material=None, time=None).shown(lit)
        if scene.lights and self.environment is None:
            warn(f"{name_of(source)}: its lights are dark, so the studio lights it", UserWarning)
        if camera is not None and self.frame is None and isinstance(source, (str, os.PathLike)):
            camera = self._worth_keeping(source, shapes, camera)
        made = present(
            shapes,
            up=up,
            rescale=camera is None,
            view=self.view or "three-quarter",
            aspect=self.aspect,
            camera=camera,
            environment=self.environment,
            backdrop=not (self.transparent or self.cameras),
            reach=self.reach,
            neutral=neutral,
            shadow_catcher=self.shadow_catcher,
        )
        made.settings.transparent |= self.transparent
        made.cameras = (
            scene.cameras if camera is not None else {}
        )  # otherwise the shapes may have been turned and scaled
        return made

    def _worth_keeping(self, source: object, shapes: list[Shape], camera: Camera) -> Camera | None:
        """Return a file's camera, or None with a note if it shows the mesh small or not at all."""
        aspect = SETTINGS.width / SETTINGS.height if self.aspect is None else self.aspect
        if self.reach is None or self.reach.camera is None:
            share = share_of_picture(camera, np.concatenate([shape.outline for shape in shapes]), aspect)
        else:  # the same for all frames
            share = share_of_picture(self.reach.camera, self.reach.points, aspect)
        if share >= SMALL:
            return camera
        size = f"at {share:.0%} of the picture's size" if share > 0.0 else "not at all"
        remedy = "frame=False, or --no-frame, keeps its camera"
        warn(f"{source}: its camera shows the mesh {size}, so it is framed anew; {remedy}", UserWarning)
        return None


def _environment(value: Any, azimuth: float) -> Environment:
    """Return an environment: the value itself, the image of a file, or a sunny day for "sky"."""
    if isinstance(value, Environment):
        return value
    if value == SKY:
        # The sun stands where the studio's lamp does, on the camera's side.
        angle = np.radians(azimuth - VIEWS["three-quarter"][0])
        x, y, z = _SUN
        turned = (x * np.cos(angle) + z * np.sin(angle), y, z * np.cos(angle) - x * np.sin(angle))
        scale = 2.0**_SKY_STOPS
        return SunSkyEnvironment(
            sun_direction=tuple(float(each) for each in turned),  # type: ignore[arg-type]
            sky_scale=scale,
            sun_scale=scale,
        )
    if isinstance(value, (str, os.PathLike)):
        from wrt.io.images import load_environment

        if not str(value):
            raise InputError("the name of the environment is empty")
        return load_environment(value)
    raise InputError(f"environment must be an environment, an image file or 'sky', not {type(value).__name__}")
