"""Evaluate a material at a point on the device: which part is chosen, with what values, and what passes through."""

import functools
from typing import NamedTuple

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

import wrt
from support.kernels import upload
from wrt.backend.device import Device
from wrt.kernels.bsdf import make_bsdf
from wrt.kernels.features import Features
from wrt.kernels.geometry.surface import Surface
from wrt.kernels.scene.materials import PASSED_THROUGH, make_bsdf_at, make_choose_material, make_share_passed
from wrt.kernels.scene.scene_data import SceneData
from wrt.upload.materials import describe_materials


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


@functools.cache
def evaluate_kernel(features: Features) -> wp.Kernel:
    """Return a kernel that chooses by a random number and evaluates what was chosen."""
    functions = make_bsdf(features.models)
    bsdf_evaluate, bsdf_pdf = functions.evaluate, functions.pdf
    bsdf_at = make_bsdf_at(features)
    module = wp.get_module(f"test.composite.{features.name}")

    @wp.kernel(module=module, enable_backward=False)
    def evaluate(
        scene: SceneData,
        point: Point,
        u: wp.array(dtype=float),
        wo: wp.array(dtype=wp.vec3),
        wi: wp.array(dtype=wp.vec3),
        value_out: wp.array(dtype=wp.vec3),
        pdf_out: wp.array(dtype=float),
    ):
        i, j = wp.tid()
        surface = surface_of(point)
        material = choose_material(scene, 0, surface, u[j])
        if material != PASSED_THROUGH:
            bsdf = bsdf_at(scene, material, surface)
            wp.atomic_add(value_out, i, bsdf_evaluate(bsdf, wo[i], wi[i]) / float(u.shape[0]))
            wp.atomic_add(pdf_out, i, bsdf_pdf(bsdf, wo[i], wi[i]) / float(u.shape[0]))

    return evaluate


class Chosen(NamedTuple):
    """What answered for each random number: which material, PASSED_THROUGH for none; and the share that passes."""

    materials: list[wrt.Material]
    numbers: NDArray[np.int32]
    passed: NDArray[np.float32]

    def share(self, material: wrt.Material | None) -> float:
        """Return how often a material answers, by identity; None for how often nothing does."""
        wanted = PASSED_THROUGH if material is None else [m is material for m in self.materials].index(True)
        return float((self.numbers == wanted).mean())


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
        self.table = describe_materials([material])
        self.scene = SceneData()
        self.table.upload(self.scene, Device(device))
        self.point = Point()
        self.point.front, self.point.uv, self.point.color = front, wp.vec2(*uv), wp.vec3(*color)

    def choose(self, u: ArrayLike) -> Chosen:
        """Return what answers for random numbers."""
        numbers = upload(u, float, self.device)
        out = [wp.empty(len(numbers), dtype=dtype, device=self.device) for dtype in (wp.int32, wp.float32)]
        wp.launch(choose_kernel, len(numbers), [self.scene, self.point, numbers], out, device=self.device)
        return Chosen(self.table.materials, *(array.numpy() for array in out))

    def evaluate(self, u: ArrayLike, wo: ArrayLike, wi: ArrayLike) -> tuple[NDArray, NDArray]:
        """Return (N, 3) f |cosθi| and (N,) densities, both their means over random numbers."""
        numbers = upload(u, float, self.device)
        value = wp.zeros(len(np.asarray(wo)), dtype=wp.vec3, device=self.device)
        pdf = wp.zeros(len(value), dtype=float, device=self.device)
        features = Features(self.table.models, self.table.textured, "none", opacity=True)
        inputs = [self.scene, self.point, numbers, upload(wo, wp.vec3, self.device), upload(wi, wp.vec3, self.device)]
        wp.launch(evaluate_kernel(features), (len(value), len(numbers)), inputs, [value, pdf], device=self.device)
        return value.numpy(), pdf.numpy()
