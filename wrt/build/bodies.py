"""The bodies of a scene, the media inside them, and in which of them the camera stands."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.device import Device
from wrt.environment import ConstantEnvironment
from wrt.errors import InputError
from wrt.lights import DirectionalLight
from wrt.materials import Material, RoughDielectric
from wrt.materials.body import Body, bodies_of
from wrt.medium import Medium
from wrt.scene import Scene

CAMERA_RAYS = 15
"""Rays that are asked whether the camera is inside a body; the greater half decides."""


@dataclass
class BodyTable:
    """What the materials of a scene say of the inside of bodies.

    Attributes:
        of_shapes: (shapes,) number of the body that each shape bounds; −1 where it bounds none.
        records: (medium, priority, index inside, index outside) of each body.
        media: all media that do anything.
        medium: number of the one outside of all bodies; −1 for none.
    """

    of_shapes: list[int] = field(default_factory=list)
    records: list[tuple[int, int, float, float]] = field(default_factory=list)
    media: list[Medium] = field(default_factory=list)
    medium: int = -1

    @property
    def kind(self) -> str:
        """What `Features.media` says."""
        if any(medium.scatters for medium in self.media):
            return "scattering"
        return "absorbing" if self.media else "none"

    @property
    def nested(self) -> bool:
        """Whether any body has a priority."""
        return any(priority != 0 for _, priority, _, _ in self.records)

    def number(self, medium: Medium | None) -> int:
        """Return a medium's number; −1 for one that does nothing."""
        if medium is None or medium.is_clear:
            return -1
        if medium not in self.media:
            self.media.append(medium)
        return self.media.index(medium)

    def upload(self, data: Any, device: Device) -> None:
        """Fill the tables of a SceneData struct."""
        import warp as wp

        from wrt.kernels.scene_data import BodyRecord, MediumRecord

        media = np.zeros(len(self.media), MediumRecord.numpy_dtype())
        for record, medium in zip(media, self.media, strict=True):
            for name in ("absorption", "scattering", "emission", "g"):
                record[name] = getattr(medium, name)
        bodies = np.zeros(len(self.records), BodyRecord.numpy_dtype())
        for i, values in enumerate(self.records):
            bodies[i] = values
        data.media = wp.array(media, dtype=MediumRecord, device=device.name)
        data.bodies = wp.array(bodies, dtype=BodyRecord, device=device.name)
        data.medium = self.medium


def describe_bodies(scene: Scene) -> BodyTable:
    """Return the table of a scene's bodies: one for each material object.

    Raises:
        InputError: where one surface would bound two different bodies, or a medium gives infinite light.
    """
    table = BodyTable(medium=-1)
    table.medium = table.number(scene.medium)
    numbers: dict[int, int] = {}
    for shape in scene.shapes:
        key = id(shape.material)
        if key not in numbers:
            body = _body(shape.material, shape.name)
            numbers[key] = -1 if body is None else len(table.records)
            if body is not None:
                outside = getattr(body, "exterior_ior", 1.0)
                inside = body.interior_ior or 0.0
                table.records.append((table.number(body.interior), body.priority, inside, outside))
        table.of_shapes.append(numbers[key])
    if table.nested:
        for shape in scene.shapes:
            if any(isinstance(body, RoughDielectric) and body.multiple_bounces for body in bodies_of(shape.material)):
                raise InputError(
                    f"{shape.name}: multiple_bounces knows one index outside; leave it where bodies have priorities"
                )
    if scene.medium is not None:
        _check_outer(scene, scene.medium)
    return table


def _body(material: Material, name: str) -> Body | None:
    """Return what a material, or the parts that it is made of, bounds."""
    bodies = list(bodies_of(material))
    insides = {(body.interior, body.priority, body.interior_ior) for body in bodies}
    if len(insides) > 1:
        raise InputError(f"{name}: the parts of a material must bound the same body, of one interior, priority and ior")
    return bodies[0] if bodies else None


def _check_outer(scene: Scene, medium: Medium) -> None:
    for emission, extinction in zip(medium.emission, medium.extinction, strict=True):  # type: ignore[arg-type]
        if emission > 0.0 and extinction == 0.0:
            raise InputError("the scene's medium reaches to infinity: where it emits it must absorb or scatter too")
    far = any(isinstance(light, DirectionalLight) for light in scene.lights)
    dark = isinstance(scene.environment, ConstantEnvironment) and not any(scene.environment.radiance)  # type: ignore[arg-type]
    if any(medium.extinction) and (far or (scene.environment is not None and not dark)):
        warnings.warn(
            "the scene's medium reaches to infinity: nothing is seen through it of the environment and of directional "
            "lights; put the medium in a body of wrt.Null to see them",
            UserWarning,
            stacklevel=4,
        )


def find_bodies(
    data: Any, bodies: int, origin: NDArray[np.float64], time: float, instances: str, device: Device
) -> list[int]:
    """Return the bodies that a point is in, outermost first, each once for every surface of it around the point.

    A ray from inside a closed surface leaves it once more than it enters it. Several rays are asked, for a ray may slip
    through a hole in a surface that is not closed; of such a one the point is inside that more than half of the rays
    leave.

    Args:
        data: the SceneData struct, complete but for what is found here.
        bodies: how many there are.
        origin: the point, metres.
        time: when, seconds.
        instances: as in Features.
        device: where the scene is.
    """
    import warp as wp

    from wrt.kernels.bodies import make_count_crossings

    left_more = wp.zeros((CAMERA_RAYS, bodies), dtype=int, device=device.name)
    last_left = wp.zeros((CAMERA_RAYS, bodies), dtype=float, device=device.name)
    inputs = [CAMERA_RAYS, data, wp.vec3(*map(float, origin)), float(time), left_more, last_left]
    device.launch(make_count_crossings(instances), CAMERA_RAYS, inputs)
    counts = np.median(left_more.numpy(), axis=0).astype(int)
    far = np.median(last_left.numpy(), axis=0)
    return [int(body) for body in np.argsort(-far, kind="stable") for _ in range(max(counts[body], 0))]


def set_camera_bodies(data: Any, table: BodyTable, scene: Scene, instances: str, device: Device) -> None:
    """Write into a SceneData struct in which bodies the camera of the scene begins its rays."""
    from wrt.kernels.scene_data import MOST_BODIES, BodyStack

    if scene.camera is None or not table.records:
        return
    motion = getattr(scene.camera, "motion", None)
    time = float(getattr(scene.camera, "shutter_open", 0.0))
    origin = np.asarray(scene.camera.origin, np.float64)
    if motion is not None:
        origin = (motion.at(time) @ [*origin, 1.0])[:3]
    around = find_bodies(data, len(table.records), origin, time, instances, device)
    numbers = [body + 1 for body in around[-MOST_BODIES:]]
    data.inside_at_camera = BodyStack(*(numbers + [0] * (MOST_BODIES - len(numbers))))
