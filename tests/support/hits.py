"""Evaluate a material at a point on the device: which part is chosen, with what values, and what passes through."""

from typing import NamedTuple

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

import wrt
from support.kernels import upload
from wrt.backend import current_backend
from wrt.backend.device import Device
from wrt.kernels.core.features import Features
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.geometry.surface import Surface
from wrt.kernels.materials.choice import PASSED_THROUGH, make_choose_material
from wrt.kernels.materials.values import make_share_passed
from wrt.upload.materials import MaterialTable


@wp.struct
class Point:
    """What a material may ask of the point it is at."""

    front: bool
    uv: wp.vec2
    color: wp.vec3


@wp.func
def surface_of(point: Point) -> Surface:
    """Return a surface with what is in `point`, and nothing else."""
    surface = Surface()
    surface.front = point.front
    surface.uv = point.uv
    surface.color = point.color
    return surface


choose_material = make_choose_material()
# Of opacity alone, whatever the models.
share_passed = make_share_passed(Features((), False, "none"))


@wp.kernel(enable_backward=False)
def choose_kernel(
    scene: SceneData,
    point: Point,
    u: wp.array(dtype=float),
    chosen_out: wp.array(dtype=int),
    passed_out: wp.array(dtype=float),
):
    i = wp.tid()
    surface = surface_of(point)
    chosen_out[i] = choose_material(scene, 0, surface, u[i])
    passed_out[i] = share_passed(scene, 0, surface, wp.vec3(0.0, 0.0, 1.0))[0]


class Chosen(NamedTuple):
    """What answered for each random number: which material, PASSED_THROUGH for none; and the share that passes."""

    materials: list[wrt.Material]
    numbers: NDArray[np.int32]
    passed: NDArray[np.float32]

    def share(self, material: wrt.Material | None) -> float:
        """Return how often a material answers, by identity; None for how often nothing does."""
        number = PASSED_THROUGH if material is None else [m is material for m in self.materials].index(True)
        return float((self.numbers == number).mean())


class Hit:
    """A material, uploaded, and a point on it."""

    def __init__(
        self,
        material: wrt.Material,
        device: str,
        *,
        front: bool = True,
        uv: ArrayLike = (0.5, 0.5),
        color: ArrayLike = (1.0, 1.0, 1.0),
    ) -> None:
        """Upload `material` to a device."""
        self.device = device
        self.table = MaterialTable([material])
        self.scene = current_backend().kernels("wrt.kernels.core.scene_data").SceneData()
        self.table.upload(self.scene, Device(device))
        self.point = Point()
        self.point.front, self.point.uv, self.point.color = front, wp.vec2(*uv), wp.vec3(*color)

    def choose(self, u: ArrayLike) -> Chosen:
        """Return what answers for random numbers."""
        numbers = upload(u, float, self.device)
        out = [wp.empty(len(numbers), dtype=dtype, device=self.device) for dtype in (wp.int32, wp.float32)]
        wp.launch(choose_kernel, len(numbers), [self.scene, self.point, numbers], out, device=self.device)
        return Chosen(self.table.materials, *(array.numpy() for array in out))
