"""Upload the bodies of a scene and their media, and find the bodies around a point."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.backend import current_backend
from wrt.backend.device import Device
from wrt.errors import InputError, warn
from wrt.linalg import product
from wrt.scene.camera import Camera
from wrt.scene.environment import ConstantEnvironment
from wrt.scene.materials import Material, RoughDielectric
from wrt.scene.materials.body import Body, bodies_of
from wrt.scene.medium import Medium
from wrt.scene.scene import Scene
from wrt.upload.arrays import packed
from wrt.upload.grids import upload_media
from wrt.values import Vec3

VOTES = 15
"""Rays that test whether a point is inside a body; the majority decides."""


class BodyTable:
    """The bodies and media of a scene; a body for each material object.

    Attributes:
        of_shapes: (shapes,) number of the body that each shape bounds; −1 for none, and where none matters.
        records: (medium, priority, index inside, index outside, spread of the first over the channels) of each body.
        media: all media that affect light.
        medium: number of the medium outside all bodies; −1 for none.
        kind: the value of `Features.media`.
        nested: whether any body has a priority.
    """

    def __init__(self, scene: Scene) -> None:
        """List the bodies and media.

        Raises:
            InputError: when one surface bounds two different bodies, or a medium emits infinite light.
        """
        self.of_shapes: list[int] = []
        self.records: list[tuple[int, int, float, float, Vec3]] = []
        self.media: list[Medium] = []
        self.medium = self._number(scene.medium)
        numbers: dict[int, int] = {}
        for shape in scene.shapes:
            key = id(shape.material)
            if key not in numbers:
                body = _body(shape.material, shape.name)
                numbers[key] = -1 if body is None else len(self.records)
                if body is not None:
                    indices = body.interior_ior or 0.0, getattr(body, "exterior_ior", 1.0), body.interior_spread
                    self.records.append((self._number(body.interior), body.priority, *indices))
            self.of_shapes.append(numbers[key])
        self.kind = "absorbing" if self.media else "none"
        if any(medium.scatters for medium in self.media):
            self.kind = "scattering"
        self.nested = any(priority != 0 for _, priority, *_ in self.records)
        if not (self.media or self.nested):  # so that kernels which follow bodies have the bits of those which do not
            self.of_shapes = [-1] * len(self.of_shapes)
        for shape in scene.shapes if self.nested else ():
            if any(isinstance(body, RoughDielectric) and body.multiple_bounces for body in bodies_of(shape.material)):
                raise InputError(
                    f"{shape.name}: multiple_bounces needs a fixed index outside; turn it off where bodies have "
                    "priorities"
                )
        if scene.medium is not None and scene.medium.density is None:
            _check_outer(scene, scene.medium)

    def _number(self, medium: Medium | None) -> int:
        """Return the number of a medium; −1 if it does not affect light."""
        if medium is None or medium.is_clear:
            return -1
        if medium not in self.media:
            self.media.append(medium)
        return self.media.index(medium)

    @property
    def has_grids(self) -> bool:
        """Whether the density of any medium varies."""
        return any(medium.density is not None for medium in self.media)

    def upload(self, data: Any, device: Device, *, grids_too: bool = True) -> None:
        """Fill the tables of a SceneData struct; tables of grids only if `grids_too`."""
        backend = current_backend()
        scene_data = backend.kernels("wrt.kernels.core.scene_data")
        upload_media(data, self.media, device, grids_too=grids_too)
        data.bodies = backend.array(packed(self.records, scene_data.BodyRecord), scene_data.BodyRecord, device.name)
        data.medium = self.medium


def _body(material: Material, name: str) -> Body | None:
    """Return the body that a material or its parts bound."""
    bodies = list(bodies_of(material))
    insides = {(body.interior, body.priority, body.interior_ior, body.interior_spread) for body in bodies}
    if len(insides) > 1:
        raise InputError(f"{name}: the parts of a material must have the same interior, priority, ior and dispersion")
    return bodies[0] if bodies else None


def _check_outer(scene: Scene, medium: Medium) -> None:
    for emission, extinction in zip(medium.emission, medium.extinction, strict=True):  # type: ignore[arg-type]
        if emission > 0.0 and extinction == 0.0:
            raise InputError("the scene's medium reaches to infinity: where it emits it must absorb or scatter too")
    far = any(light.extent().corners is None for light in scene.lights)
    dark = isinstance(scene.environment, ConstantEnvironment) and not any(scene.environment.radiance)  # type: ignore[arg-type]
    if any(medium.extinction) and (far or (scene.environment is not None and not dark)):
        warn(
            "the scene's medium reaches to infinity and hides the environment and directional lights; put the medium "
            "in a body of wrt.Null to see them",
            UserWarning,
        )


def set_camera_bodies(data: Any, table: BodyTable, camera: Camera, geometry: str, device: Device) -> None:
    """Write the bodies around the camera into a SceneData struct; the arguments are those of `bodies_around`."""
    if not table.records:
        return
    most_bodies = current_backend().kernels("wrt.kernels.core.scene_data").MOST_BODIES
    origin = np.asarray(camera.origin, np.float64)
    if camera.motion is not None:
        origin = product(camera.motion.at(camera.shutter_open), [*origin, 1.0])[:3]
    around = bodies_around(data, table, origin, camera.shutter_open, geometry, device)
    numbers = [body + 1 for body in around[-most_bodies:]]
    data.inside_at_camera = tuple(numbers + [0] * (most_bodies - len(numbers)))


def bodies_around(
    data: Any, table: BodyTable, point: NDArray[np.float64], time: float, geometry: str, device: Device
) -> list[int]:
    """Return the numbers of the bodies around a point, outermost first, one for each surface around it.

    A ray from inside a closed surface leaves it once more often than it enters it. A ray can also pass through a hole
    in an open surface, so several rays vote: the point is inside if more than half of them leave. The struct must be
    complete otherwise; `geometry` is as in Features.
    """
    backend = current_backend()
    exits = backend.zeros((VOTES, len(table.records)), int, device.name)
    last_exits = backend.zeros((VOTES, len(table.records)), float, device.name)
    inputs = [VOTES, data, tuple(map(float, point)), float(time), exits, last_exits]
    device.launch(backend.call("wrt.kernels.media.bodies", "make_count_crossings", geometry), VOTES, inputs)
    counts = np.median(exits.numpy(), axis=0).astype(int)
    distances = np.median(last_exits.numpy(), axis=0)
    return [int(body) for body in np.argsort(-distances, kind="stable") for _ in range(max(counts[body], 0))]
