"""The description of what is rendered: plain data, no Warp."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt.camera import Camera
from wrt.deformation import Deformation
from wrt.environment import Environment
from wrt.errors import InputError
from wrt.layers import layer_names
from wrt.lights import LIGHTS, Light
from wrt.materials import Diffuse, Material
from wrt.materials.body import bodies_of
from wrt.materials.material import color_source
from wrt.medium import Medium
from wrt.mesh import Mesh
from wrt.motion import Motion, check_affine
from wrt.textures import ColorSource, shines
from wrt.values import FLOAT32_MAX, Vec3, integer, number, one_of

FILTERS = ("box", "tent", "gaussian", "blackman-harris")
"""Reconstruction filters by name; `kernels/filters.py` says what each is."""

SAMPLERS = ("independent", "stratified", "sobol", "blue-noise")
"""Where random numbers come from; docs/sampling.md compares them."""

INTEGRATORS = ("path", "volpath", "direct", "whitted", "ao", "aov")
"""What a picture shows, by name; docs/integrators.md says what each computes."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A mesh, what it is made of, and the light it gives.

    Attributes:
        mesh: the triangles.
        material: how it reflects.
        emission: radiance it gives off its front, per channel, W·sr⁻¹·m⁻², also an image or the mesh's colours;
            where it is 0, that of the material.
        two_sided_emission: whether its back shines as well.
        name: for messages.
        transform: where it is: a (4, 4) affine matrix from the mesh's space to the world, or how it moves. Shapes that
            have one and share a mesh share its memory; of mirror images, the front is the mesh's front.
        deformation: how the mesh changes its shape.
    """

    mesh: Mesh
    material: Material = field(default_factory=Diffuse)
    emission: ColorSource = 0.0
    two_sided_emission: bool = False
    name: str = "shape"
    transform: NDArray[np.float64] | Motion | None = field(default=None, repr=False)
    deformation: Deformation | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.mesh, Mesh):
            raise InputError(f"{self.name}: mesh must be a wrt.Mesh, not {type(self.mesh).__name__}")
        if not isinstance(self.material, Material):
            raise InputError(f"{self.name}: material must be a wrt.Material, not {type(self.material).__name__}")
        if self.transform is not None and not isinstance(self.transform, Motion):
            object.__setattr__(self, "transform", _matrix(self.transform, f"{self.name}: transform"))
        if self.deformation is not None:
            if not isinstance(self.deformation, Deformation):
                raise InputError(f"{self.name}: deformation must be a wrt.Deformation")
            count = self.deformation.vertices.shape[1]
            if count != len(self.mesh.vertices):
                raise InputError(
                    f"{self.name}: the deformation has {count} vertices, the mesh {len(self.mesh.vertices)}"
                )
        emission = color_source(self.emission, f"{self.name}: emission", maximum=FLOAT32_MAX)
        object.__setattr__(self, "emission", emission if shines(emission) else self.material.emission)

    @property
    def emits(self) -> bool:
        """Whether it gives off any light."""
        return shines(self.emission)

    def transform_at(self, time: float) -> NDArray[np.float64]:
        """Return the (4, 4) map from the mesh's space to the world at a time, seconds."""
        if self.transform is None:
            return np.eye(4)
        return self.transform.at(time) if isinstance(self.transform, Motion) else self.transform

    def mesh_at(self, time: float) -> Mesh:
        """Return the mesh in the world at a time, seconds."""
        mesh = self.mesh if self.deformation is None else self.deformation.at(time, self.mesh)
        return mesh if self.transform is None else mesh.transformed(self.transform_at(time))

    def moved(self, matrix: NDArray[np.float64]) -> Shape:
        """Return the shape moved by a (4, 4) affine matrix: its mesh, or its transform where it has one."""
        if isinstance(self.transform, Motion):
            motion = Motion(self.transform.times, matrix @ self.transform.transforms, self.transform.center)
            return replace(self, transform=motion)
        if self.transform is not None or self.deformation is not None:
            return replace(self, transform=matrix @ self.transform_at(0.0))
        return replace(self, mesh=self.mesh.transformed(matrix))

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) float64 lowest and highest corner of the shape, or of its outline where it has a transform."""
        if self.transform is None and self.deformation is None:
            return self.mesh.bounds
        outline = self.outline
        return np.stack([outline.min(axis=0), outline.max(axis=0)])

    @property
    def outline(self) -> NDArray[np.floating[Any]]:
        """(P, 3) points whose convex hull has the shape within: the vertices, or corners of boxes, at all keys."""
        if self.transform is None and self.deformation is None:
            return self.mesh.vertices
        low, high = self.mesh.bounds
        if self.deformation is not None:
            low, high = self.deformation.vertices.min(axis=(0, 1)), self.deformation.vertices.max(axis=(0, 1))
        corners = np.stack(np.meshgrid(*np.stack([low, high], axis=1), indexing="ij"), axis=-1).reshape(-1, 3)
        times = np.zeros(1)
        if isinstance(self.transform, Motion):
            keys = self.transform.times
            # Between keys it turns by less than 180 degrees: every 12 degrees, arcs are 0.6 % beyond their chords.
            times = np.interp(np.linspace(0, len(keys) - 1, 16 * (len(keys) - 1) + 1), np.arange(len(keys)), keys)
        matrices = np.stack([self.transform_at(time) for time in times])
        moved = np.einsum("kij,nj->kni", matrices[:, :3, :3], corners) + matrices[:, None, :3, 3]
        return np.asarray(moved.reshape(-1, 3))


@dataclass
class RenderSettings:
    """How a scene asks to be rendered; options given to the renderer win.

    Attributes:
        width, height: pixels.
        spp: samples per pixel.
        max_depth: most segments in a path; 1 sees emission only, 2 adds direct light.
        filter: reconstruction filter, one of FILTERS.
        sampler: how random numbers are spread over the samples of a pixel, one of SAMPLERS.
        exposure: stops (factors of two) applied when a picture is written as PNG.
        crop: the part of the picture that is rendered, in its pixels: first column, first row, and the column and row
            after the last; None is all of it. A part has the very pixels that the whole has there.
        max_scatterings: most scattering events inside media in a path; max_depth counts surfaces alone.
        integrator: one of INTEGRATORS; None is "volpath" where media scatter, else "path".
        min_attenuation: integrator "whitted" follows no ray that counts for less than this share.
        ao_distance: how far integrator "ao" looks for what blocks the sky, metres; None is without limit.
        layers: names of `wrt.layers.LAYERS` to render beside the light.
        clamp_indirect: most indirect radiance per channel that one path brings, W·sr⁻¹·m⁻²; None is without limit.
            Biased: what is cut off is lost.
        regularization: roughness that rough surfaces gain, √(α² + r²), once a path was scattered by anything that is
            not smooth, 0 to 1. Biased: what such surfaces show of one another is blurred.
    """

    width: int = 768
    height: int = 576
    spp: int = 64
    max_depth: int = 64
    filter: str = "blackman-harris"
    sampler: str = "sobol"
    exposure: float = 0.0
    crop: tuple[int, int, int, int] | None = None
    integrator: str | None = None
    max_scatterings: int = 4096
    min_attenuation: float = 0.005
    ao_distance: float | None = None
    layers: tuple[str, ...] = ()
    clamp_indirect: float | None = None
    regularization: float = 0.0

    def __post_init__(self) -> None:
        self.width = integer(self.width, "width", minimum=1, maximum=65536)
        self.height = integer(self.height, "height", minimum=1, maximum=65536)
        self.spp = integer(self.spp, "spp", minimum=1, maximum=2**31 - 1)
        self.max_depth = integer(self.max_depth, "max_depth", minimum=1, maximum=65536)
        self.max_scatterings = integer(self.max_scatterings, "max_scatterings", minimum=0, maximum=65535)
        self.filter = one_of(self.filter, FILTERS, "filter")
        self.sampler = one_of(self.sampler, SAMPLERS, "sampler")
        self.exposure = number(self.exposure, "exposure", minimum=-100.0, maximum=100.0)
        if self.integrator is not None:
            self.integrator = one_of(self.integrator, INTEGRATORS, "integrator")
        self.min_attenuation = number(self.min_attenuation, "min_attenuation", minimum=0.0, maximum=1.0)
        if self.ao_distance is not None:
            self.ao_distance = number(self.ao_distance, "ao_distance", above=0.0)
        self.layers = layer_names(self.layers)
        if self.clamp_indirect is not None:
            self.clamp_indirect = number(self.clamp_indirect, "clamp_indirect", above=0.0, maximum=FLOAT32_MAX)
        self.regularization = number(self.regularization, "regularization", minimum=0.0, maximum=1.0)
        if self.crop is not None:
            self.crop = _crop_window(self.crop, self.width, self.height)


def _matrix(value: object, name: str) -> NDArray[np.float64]:
    """Return `value` as an affine (4, 4) matrix, or raise InputError."""
    try:
        matrix = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be a (4, 4) matrix or a wrt.Motion, not {type(value).__name__}") from None
    if matrix.shape != (4, 4):
        raise InputError(f"{name} must be a (4, 4) matrix or a wrt.Motion, not an array of {matrix.shape}")
    check_affine(matrix, name)
    matrix.setflags(write=False)
    return matrix


def _crop_window(value: object, width: int, height: int) -> tuple[int, int, int, int]:
    """Return `value` as a part of a picture that is not empty, or raise InputError."""
    if not isinstance(value, (list, tuple, np.ndarray)) or len(value) != 4:
        shown = " ".join(repr(value).split())
        raise InputError(f"crop must be four whole numbers (x0, y0, x1, y1), not {shown}")
    x0, y0, x1, y1 = (integer(item, f"crop[{i}]", minimum=0, maximum=65536) for i, item in enumerate(value))
    if x0 >= x1 or y0 >= y1:
        raise InputError(f"crop must not be empty: from ({x0}, {y0}) up to ({x1}, {y1}) there are no pixels")
    if x1 > width or y1 > height:
        raise InputError(f"crop must lie inside the picture: ({x1}, {y1}) is beyond its {width}x{height} pixels")
    return x0, y0, x1, y1


@dataclass
class Scene:
    """Shapes, lights, an environment and a camera.

    Attributes:
        shapes: what can be hit.
        lights: those that are no meshes.
        environment: what rays that hit nothing see; None is black.
        camera: where the picture is taken from; None lets the renderer frame the shapes.
        settings: how the scene asks to be rendered.
        medium: what fills all space outside of bodies; None is clear.
    """

    shapes: list[Shape] = field(default_factory=list)
    lights: list[Light] = field(default_factory=list)
    environment: Environment | None = None
    camera: Camera | None = None
    settings: RenderSettings = field(default_factory=RenderSettings)
    medium: Medium | None = None

    def __post_init__(self) -> None:
        if self.medium is not None and not isinstance(self.medium, Medium):
            raise InputError(f"the scene's medium must be a wrt.Medium, not {type(self.medium).__name__}")

    def add(
        self,
        mesh: Mesh,
        *,
        material: Material | None = None,
        emission: ColorSource = 0.0,
        two_sided_emission: bool = False,
        name: str | None = None,
        transform: ArrayLike | Motion | None = None,
        deformation: Deformation | None = None,
    ) -> Shape:
        """Add a mesh with a material and, for a light, an emission; return the new shape."""
        shape = Shape(
            mesh=mesh,
            material=Diffuse() if material is None else material,
            emission=emission,
            two_sided_emission=two_sided_emission,
            name=name or str(getattr(mesh, "name", "shape")),
            transform=transform,  # type: ignore[arg-type]
            deformation=deformation,
        )
        self.shapes.append(shape)
        return shape

    def add_instances(
        self,
        mesh: Mesh,
        transforms: Iterable[ArrayLike | Motion],
        *,
        material: Material | None = None,
        emission: ColorSource = 0.0,
        two_sided_emission: bool = False,
        name: str | None = None,
        deformation: Deformation | None = None,
    ) -> list[Shape]:
        """Add a mesh in many places, where it takes memory once; return the new shapes.

        Args:
            mesh: the triangles.
            transforms: for each place a (4, 4) affine matrix from the mesh's space to the world, or a Motion.
            material: as for `add`, and likewise the others.
            emission: of all of them.
            two_sided_emission: of all of them.
            name: of all of them.
            deformation: of all of them.
        """
        shared = Diffuse() if material is None else material
        return [
            self.add(
                mesh,
                material=shared,
                emission=emission,
                two_sided_emission=two_sided_emission,
                name=name,
                transform=transform,
                deformation=deformation,
            )
            for transform in transforms
        ]

    def add_light(self, light: Light) -> Light:
        """Add a light that is no mesh and return it."""
        if not isinstance(light, tuple(LIGHTS.values())):
            names = ", ".join(cls.__name__ for cls in LIGHTS.values())
            raise InputError(f"a light must be one of {names}, not {type(light).__name__}")
        self.lights.append(light)
        return light

    @property
    def media(self) -> list[Medium]:
        """What fills the scene and its bodies."""
        insides = [body.interior for shape in self.shapes for body in bodies_of(shape.material)]
        return [medium for medium in (self.medium, *insides) if medium is not None]

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) float64 lowest and highest corner of all shapes; zeros without shapes."""
        if not self.shapes:
            return np.zeros((2, 3))
        corners = np.stack([shape.bounds for shape in self.shapes])
        return np.stack([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])


__all__ = ["FILTERS", "SAMPLERS", "Environment", "Light", "RenderSettings", "Scene", "Shape", "Vec3"]
