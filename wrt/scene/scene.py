"""The scene description: plain data, without Warp."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Annotated, Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt import _above
from wrt.errors import InputError, did_you_mean
from wrt.linalg import product
from wrt.scene.camera import Camera, require_camera
from wrt.scene.deformation import Deformation
from wrt.scene.description import Check, Description, Flag, GroupName, instance_of, optional, word_of
from wrt.scene.developing import DEFAULT_TONE, EXPOSURE_SCHEMA, TONE_SCHEMA, check_exposure, check_tone
from wrt.scene.environment import Environment
from wrt.scene.exact.analytic import Analytic
from wrt.scene.exact.distances import DistanceShape
from wrt.scene.integrators import INTEGRATORS, Integrator, integrator_of
from wrt.scene.layers import REST, SHADOW, layer_names
from wrt.scene.lights import LIGHTS, Light
from wrt.scene.materials import Diffuse, Material, Unlit
from wrt.scene.materials.body import bodies_of
from wrt.scene.materials.material import UnlimitedColor
from wrt.scene.medium import Medium
from wrt.scene.mesh import Mesh
from wrt.scene.motion import Motion, affine_matrix
from wrt.scene.textures import shines
from wrt.values import FLOAT32_MAX, ColorLike, Vec3, color, integer, number

FILTERS = ("box", "tent", "gaussian", "blackman-harris", "shared")
"""Reconstruction filters by name; `wrt/upload/camera.py` and `wrt/rendering/reading.py` define them."""

SAMPLERS = ("independent", "stratified", "sobol", "blue-noise")
"""Samplers by name; docs/sampling.md compares them."""

MAX_SPP = 2**30
"""Most samples per pixel: a wide kernel takes several at once, and must not count beyond 32 bits."""

MOST_JITTERED_RAYS = 16
"""More would not find a place among the 32 rays of a tree that may wait."""


def _matrix_or_motion(value: object, name: str) -> NDArray[np.float64] | Motion:
    return value if isinstance(value, Motion) else affine_matrix(value, name, " or a wrt.Motion")


_mesh = instance_of(Mesh, "; wrt.load_mesh makes one of a file or a trimesh object")

_Mesh = Annotated[Mesh, lambda value, name: _mesh(value.mesh if isinstance(value, DistanceShape) else value, name)]
_Placement = Annotated[NDArray[np.float64] | Motion | None, optional(_matrix_or_motion)]
_Deformation = Annotated[Deformation | None, optional(instance_of(Deformation))]


@dataclass(frozen=True, eq=False)
class Shape(Description):
    """A mesh with a material, an emission and a place in the world.

    Attributes:
        mesh: the triangles.
        material: material of the surface.
        emission: radiance from its front, per channel, W·sr⁻¹·m⁻², also an image or vertex colours; 0 for the
            material's.
        two_sided_emission: whether its back emits too.
        name: for messages, and for layers of objects; shapes of one name are one object of a cryptomatte.
        transform: a (4, 4) affine matrix from the mesh's space to the world, or a `Motion`. Shapes with a transform
            that share a mesh are instances. A mirroring one keeps the mesh's front.
        deformation: keyframes of the vertices.
        double_sided: whether its back is seen. If not, the camera, mirrors and clear glass show what is behind it, as
            in glTF; light stops all the same. What transmits, or emits from its back, has both sides.
        edges: whether `RenderSettings.edges` and `wireframe` draw lines on it.
        shadow_catcher: whether the camera sees of it only what the other shapes do to its light: their shadows, and
            light that they send there. The picture is transparent then; see docs/first-pictures.md.
        group: name of the light group of its emission.
    """

    mesh: _Mesh
    material: Annotated[Material, instance_of(Material)] = field(default_factory=Diffuse)
    emission: UnlimitedColor = 0.0
    two_sided_emission: bool = False
    name: str = "shape"
    transform: _Placement = field(default=None, repr=False)
    deformation: _Deformation = field(default=None, repr=False)
    double_sided: Flag = True
    edges: Flag = True
    shadow_catcher: Flag = False
    group: GroupName = None

    def _label(self, name: str) -> str:
        return f"{self.name}: {name}"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.deformation is not None:
            if isinstance(self.mesh, Analytic):
                raise InputError(f"{self.name}: exact shapes cannot be deformed; take mesh.tessellated()")
            moving, count = self.deformation.vertices.shape[1], len(self.mesh.vertices)
            if moving != count:
                raise InputError(f"{self.name}: the deformation has {moving} vertices, but the mesh has {count}")
        if not shines(self.emission):
            self._set(emission=self.material.emission)

    @property
    def emits(self) -> bool:
        """Whether it emits light; unlit surfaces do not."""
        return shines(self.emission) and not isinstance(self.material, Unlit)

    def transform_at(self, time: float) -> NDArray[np.float64]:
        """Return the (4, 4) matrix from the mesh's space to the world at a time in seconds."""
        if self.transform is None:
            return np.eye(4)
        return self.transform.at(time) if isinstance(self.transform, Motion) else self.transform

    def mesh_at(self, time: float) -> Mesh:
        """Return the mesh in world space at a time in seconds."""
        mesh = self.mesh if self.deformation is None else self.deformation.at(time, self.mesh)
        return mesh if self.transform is None else mesh.transformed(self.transform_at(time))

    def moved(self, matrix: NDArray[np.float64]) -> Shape:
        """Return the shape transformed by a (4, 4) affine matrix, applied to its transform or else to its mesh."""
        if isinstance(self.transform, Motion):
            motion = Motion(self.transform.times, product(matrix, self.transform.transforms), self.transform.center)
            return replace(self, transform=motion)
        if self.transform is not None or self.deformation is not None:
            return replace(self, transform=product(matrix, self.transform_at(0.0)))
        return replace(self, mesh=self.mesh.transformed(matrix))

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) float64 lowest and highest corner of the shape, or of its outline if it is transformed."""
        if self.transform is None and self.deformation is None:
            return self.mesh.bounds
        outline = self.outline
        return np.stack([outline.min(axis=0), outline.max(axis=0)])

    @property
    def outline(self) -> NDArray[np.floating[Any]]:
        """(P, 3) points whose convex hull contains the shape at all times: vertices, or corners of boxes."""
        if self.transform is None and self.deformation is None:
            return self.mesh.outline if isinstance(self.mesh, Analytic) else self.mesh.vertices
        low, high = self.mesh.bounds
        if self.deformation is not None:
            low, high = self.deformation.vertices.min(axis=(0, 1)), self.deformation.vertices.max(axis=(0, 1))
        corners = np.stack(np.meshgrid(*np.stack([low, high], axis=1), indexing="ij"), axis=-1).reshape(-1, 3)
        times = np.zeros(1)
        if isinstance(self.transform, Motion):
            keys = self.transform.times
            # It turns by less than 180 degrees between keys. At 12 degrees a step, arcs exceed their chords by 0.6 %.
            times = np.interp(np.linspace(0, len(keys) - 1, 16 * (len(keys) - 1) + 1), np.arange(len(keys)), keys)
        matrices = np.stack([self.transform_at(time) for time in times])
        moved = np.einsum("kij,nj->kni", matrices[:, :3, :3], corners) + matrices[:, None, :3, 3]
        return np.asarray(moved.reshape(-1, 3))


def bake_transforms(shapes: list[Shape]) -> list[Shape]:
    """Return shapes in world space, with a copy of the mesh for each instance."""
    return [s if s.transform is None else replace(s, mesh=s.mesh_at(0.0), transform=None) for s in shapes]


def _nameless(check: Callable[[Any], Any]) -> Check:
    """Return a check of a field whose messages name the field themselves."""
    return lambda value, _: check(value)


_Length = Annotated[int, partial(integer, minimum=1, maximum=65536)]
_Share = Annotated[float, partial(number, minimum=0.0, maximum=1.0)]
_Noise = Annotated[float | None, optional(partial(number, above=0.0, maximum=1.0))]


@dataclass(slots=True)
class RenderSettings(Description):
    """Render settings of a scene; options given to the renderer override them.

    Attributes:
        width, height: pixels.
        spp: samples per pixel.
        noise: relative noise at which a render ends instead, such as 0.01; see `wrt.Renderer.noise`.
        adaptive: whether tiles that are good enough for `noise` stop before the others; slightly biased.
        max_depth: maximum number of path segments; 1 shows emission only, 2 adds direct light.
        filter: reconstruction filter, one of FILTERS.
        sampler: sampler, one of SAMPLERS.
        tone: tone curve of pictures written as PNG or JPEG, see `wrt.develop_image`.
        exposure: stops (factors of two) by which these are brightened, or "auto"; None for 0, unless the picture would
            be mostly white or dark.
        denoise: whether saved pictures are denoised.
        crop: part of the picture to render: first column and row, and the column and row after the last.
        max_scatterings: maximum number of scattering events along a path.
        integrator: a name, or one of your own; None for "volpath" if media scatter, else "path".
        min_attenuation: integrator "whitted" ends rays whose throughput is below this.
        jittered_rays: rays, 0 to 16, that integrator "whitted" sends on where it first meets a "glossy" material; with
            0 that has direct light alone.
        ao_distance: distance up to which surfaces occlude for integrator "ao", metres.
        layers: layers to render besides radiance, see docs/integrators.md.
        clamp_indirect: limit of the indirect radiance of one path, W·sr⁻¹·m⁻²; biased.
        regularization: roughness r that widens rough surfaces to √(α² + r²) after the first non-specular scattering of
            a path, 0 to 1; biased.
        caustics: whether photons bring the light that glass, mirrors and water throw; slightly biased
            (docs/caustics.md).
        background: colour behind a transparent picture, which has no alpha channel then; exact in a PNG or JPEG,
            whatever the tone. It implies `transparent`.
        transparent: whether pictures have an alpha channel, and the camera sees neither the environment nor lights
            without a mesh.
        edges: whether the edges of polygons (see `Mesh.sides`) are drawn over the picture, where they are not hidden.
        wireframe: whether these lines are all that is seen, on the background, by default white; nothing hides them.
        edge_width: width of the lines, pixels; thinner ones than a pixel are fainter.
        edge_color: colour of the lines; exact in a PNG or JPEG, whatever the tone.
    """

    width: _Length = 768
    height: _Length = 576
    spp: Annotated[int, partial(integer, minimum=1, maximum=MAX_SPP)] = 64
    noise: _Noise = field(default=None, kw_only=True)
    adaptive: Flag = field(default=False, kw_only=True)
    denoise: Flag = field(default=False, kw_only=True)
    max_depth: _Length = 64
    filter: Annotated[str, word_of(FILTERS)] = "blackman-harris"
    sampler: Annotated[str, word_of(SAMPLERS)] = "sobol"
    exposure: Annotated[float | str | None, EXPOSURE_SCHEMA, _nameless(check_exposure)] = None
    crop: tuple[int, int, int, int] | None = None
    integrator: Annotated[str | Integrator | None, optional(partial(integrator_of, words=INTEGRATORS))] = None
    max_scatterings: Annotated[int, partial(integer, minimum=0, maximum=65535)] = 4096
    min_attenuation: _Share = 0.005
    jittered_rays: Annotated[int, partial(integer, minimum=0, maximum=MOST_JITTERED_RAYS)] = 1
    ao_distance: Annotated[float | None, optional(partial(number, above=0.0))] = None
    layers: Annotated[tuple[str, ...], _nameless(layer_names)] = ()
    clamp_indirect: Annotated[float | None, optional(partial(number, above=0.0, maximum=FLOAT32_MAX))] = None
    regularization: _Share = 0.0
    caustics: Flag = False
    tone: Annotated[str, TONE_SCHEMA, _nameless(check_tone)] = DEFAULT_TONE
    transparent: Flag = False
    background: Annotated[ColorLike | None, optional(partial(color, maximum=1.0))] = None
    edges: Flag = field(default=False, kw_only=True)
    wireframe: Flag = field(default=False, kw_only=True)
    edge_width: Annotated[float, partial(number, above=0.0, maximum=1000.0)] = field(default=1.0, kw_only=True)
    edge_color: Annotated[ColorLike, partial(color, maximum=1.0)] = field(default=(0.0, 0.0, 0.0), kw_only=True)

    def __post_init__(self) -> None:
        Description.__post_init__(self)  # super() knows the class without slots only
        if self.crop is not None:
            self.crop = _crop_window(self.crop, self.width, self.height)
        if self.background is not None:
            self.transparent = True

    def changed(self, **changes: Any) -> RenderSettings:
        """Return the settings with the changes that are not None.

        Raises:
            InputError: on unusable values.
            TypeError: on a setting that does not exist.
        """
        names = [each.name for each in fields(self)]
        for name in changes:
            if name not in names:
                raise TypeError(f"there is no render setting {name!r}{did_you_mean(name, names)}")
        return replace(self, **{name: value for name, value in changes.items() if value is not None})

    @property
    def film_layers(self) -> tuple[str, ...]:
        """The layers that a film needs: the selected ones, coverage for a transparent picture, and edges to draw."""
        needed = {"alpha": self.transparent, "edges": self.edges or self.wireframe}
        selected = tuple(name for name in self.layers if name != SHADOW)
        return layer_names((*selected, *(name for name, is_needed in needed.items() if is_needed)))

    @property
    def paper(self) -> ColorLike | None:
        """The colour behind what is seen: the background, and otherwise white behind a wireframe that has no alpha."""
        return (1.0, 1.0, 1.0) if self.wireframe and not self.transparent else self.background


def _crop_window(value: object, width: int, height: int) -> tuple[int, int, int, int]:
    """Return `value` as a crop window that is not empty, or raise InputError."""
    if not isinstance(value, (list, tuple, np.ndarray)) or len(value) != 4:
        shown = " ".join(repr(value).split())
        raise InputError(f"crop must be four whole numbers (x0, y0, x1, y1), not {shown}")
    x0, y0, x1, y1 = (integer(item, f"crop[{i}]", minimum=0, maximum=65536) for i, item in enumerate(value))
    if x0 >= x1 or y0 >= y1:
        raise InputError(f"crop must not be empty: there are no pixels from ({x0}, {y0}) up to ({x1}, {y1})")
    if x1 > width or y1 > height:
        raise InputError(f"crop must lie inside the picture: ({x1}, {y1}) is beyond its {width}x{height} pixels")
    return x0, y0, x1, y1


@dataclass(repr=False, slots=True)
class Scene:
    """Shapes, lights, an environment and a camera.

    Attributes:
        shapes: meshes with their materials.
        lights: lights without a mesh.
        environment: radiance of rays that hit nothing; None for black.
        camera: the camera; None lets the renderer frame the shapes.
        settings: render settings.
        medium: medium that fills all space outside bodies; None for a vacuum.
        studio_shapes: how many of the first shapes stand in wrt's studio, which the others are.
        cameras: the cameras of the scene's file by name.
    """

    shapes: list[Shape] = field(default_factory=list)
    lights: list[Light] = field(default_factory=list)
    environment: Environment | None = None
    camera: Camera | None = None
    settings: RenderSettings = field(default_factory=RenderSettings)
    medium: Medium | None = None
    studio_shapes: int = field(default=0, kw_only=True, repr=False)
    cameras: dict[str, Camera] = field(default_factory=dict, kw_only=True, repr=False)

    def __post_init__(self) -> None:
        self.check()

    def check(self) -> None:
        """Raise InputError unless its parts are what they must be: they may have been assigned after it was made."""
        if wrong := _wrong_item(self.shapes, Shape):
            raise InputError(
                f"shapes must be a list of wrt.Shape, not {wrong}; wrt.load makes a scene of a file or a mesh"
            )
        if wrong := _wrong_item(self.lights, tuple(LIGHTS.values())):
            raise InputError(f"lights must be a list of wrt's lights, not {wrong}")
        if self.camera is not None:
            require_camera(self.camera)
        for value, kinds, rule in (
            (self.environment, Environment | None, "environment must be one of wrt's environments"),
            (self.settings, RenderSettings, "settings must be wrt.RenderSettings"),
            (self.medium, Medium | None, "medium must be a wrt.Medium"),
        ):
            if not isinstance(value, kinds):
                raise InputError(f"the scene's {rule}, not {type(value).__name__}")

    @overload
    def add(self, mesh: Mesh, **options: Any) -> Shape: ...

    @overload
    def add(self, mesh: Light) -> Light: ...

    @overload
    def add(self, mesh: object, **options: Any) -> Any: ...

    def add(self, mesh: Any, *, material: Any = None, **options: Any) -> Shape | list[Shape] | Light:
        """Add a mesh and return the new shape.

        Args:
            mesh: a Mesh or DistanceShape, the path of a mesh file, or an object of trimesh, PyVista, Open3D, or with
                `vertices` and `faces`. Files and objects bring their materials and may have several parts, whose shapes
                are returned in a list. A light is added as by `add_light`, and takes no options.
            material: a material, the name of one such as "gold", a colour, or an image file for the texture.
            options: other attributes of Shape: emission, two_sided_emission, name, transform, deformation,
                double_sided, edges, shadow_catcher.

        Raises:
            InputError: if something cannot be used.
            TypeError: if there is no such option.
        """
        if isinstance(mesh, Light):
            if material is not None or options:
                raise InputError("a light without a mesh has no material and no options")
            return self.add_light(mesh)
        if material is not None:
            options["material"] = _above.objects().material_of(material)
        if isinstance(mesh, DistanceShape):
            mesh = mesh.mesh
        if isinstance(mesh, Mesh):
            made = [Shape(mesh, **{"name": mesh.name, **options})]
        else:
            parts: list[Shape] = _above.objects().shapes_of(mesh)
            if "transform" in options:
                parts = bake_transforms(parts)
            if material is not None:
                options.setdefault("emission", 0.0)
            made = [replace(part, **options) for part in parts]
        self.shapes += made
        return made[0] if len(made) == 1 else made

    def add_instances(
        self,
        mesh: Mesh,
        transforms: Iterable[ArrayLike | Motion],
        *,
        material: Any = None,
        **options: Any,
    ) -> list[Shape]:
        """Add instances of a mesh, which is stored once; return the new shapes.

        Args:
            mesh: the triangles.
            transforms: for each instance a (4, 4) affine matrix from the mesh's space to the world, or a Motion.
            material: of all instances, as for `add`.
            options: other options of `add`, for all instances.
        """
        shared = Diffuse() if material is None else _above.objects().material_of(material)
        return [self.add(mesh, material=shared, transform=transform, **options) for transform in transforms]

    def add_light(self, light: Light) -> Light:
        """Add a light without a mesh and return it."""
        if not isinstance(light, tuple(LIGHTS.values())):
            names = ", ".join(cls.__name__ for cls in LIGHTS.values())
            raise InputError(f"a light must be one of {names}, not {type(light).__name__}")
        self.lights.append(light)
        return light

    def render(self, **options: Any) -> Any:
        """Render the scene and return the picture; see `wrt.render`, whose options these are."""
        return _above.pictures().render(self, **options)

    def show(self, **options: Any) -> None:
        """Render the scene and show the picture; see `wrt.show`."""
        _above.pictures().show(self, **options)

    def save(self, path: str | os.PathLike[str], **options: Any) -> None:
        """Write the scene as a scene file (.toml) or a GLB; see `wrt.save_scene`. `wrt.save_image` writes pictures."""
        _above.scene_files().save_scene(path, self, **options)

    def view(self, *, spp: int | None = None, **options: Any) -> Any:
        """Return a live view of the scene for a notebook: it converges, and the mouse moves the camera.

        Args:
            spp: samples per pixel at which the view rests; by default at least 1024.
            options: of `wrt.Renderer`.

        Raises:
            InputError: when anywidget is not installed (`pip install "wrt[notebook]"`), or on unusable options.
        """
        return _above.viewer().view_scene(self, spp=spp, **options)

    def __repr__(self) -> str:
        kinds = f"{len(self.shapes)} shapes, {len(self.lights)} lights"
        return f"<wrt.Scene: {kinds}, {self.settings.width}x{self.settings.height}>"

    def _repr_png_(self) -> bytes | None:
        picture: bytes | None = _above.viewer().picture_of_scene(self)
        return picture

    @property
    def media(self) -> list[Medium]:
        """The media of the scene and its bodies."""
        insides = [body.interior for shape in self.shapes for body in bodies_of(shape.material)]
        return [medium for medium in (self.medium, *insides) if medium is not None]

    @property
    def light_groups(self) -> tuple[str, ...]:
        """Names of the groups of its lights in order of first use, without "rest"."""
        emitting = [shape for shape in self.shapes if shape.emits]
        names = dict.fromkeys(each.group for each in (*emitting, *self.lights, self.environment) if each is not None)
        return tuple(name for name in names if name not in (None, REST))

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) float64 lowest and highest corner of all shapes; zeros without shapes."""
        if not self.shapes:
            return np.zeros((2, 3))
        corners = np.stack([shape.bounds for shape in self.shapes])
        return np.stack([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])


def _wrong_item(values: object, kinds: type | tuple[type, ...]) -> str:
    """Return what is wrong with a list of instances of `kinds`, such as "of int", or "" if nothing is."""
    if not isinstance(values, (list, tuple)):
        return type(values).__name__
    return next((f"of {type(value).__name__}" for value in values if not isinstance(value, kinds)), "")


def require_scene(scene: object, what: str) -> None:
    """Raise InputError unless `scene` is a Scene whose parts can be used, naming what needs it."""
    if not isinstance(scene, Scene):
        raise InputError(
            f"{what} needs a wrt.Scene, not {type(scene).__name__}; wrt.load makes one of files and meshes"
        )
    scene.check()


__all__ = ["FILTERS", "SAMPLERS", "Environment", "Light", "RenderSettings", "Scene", "Shape", "Vec3"]
