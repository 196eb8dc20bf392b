"""The features of a scene, which choose the specialised kernel."""

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace

_LONGEST_NAME = 100

_COVERING_FLAGS = (
    *("textured", "mipmapped", "tangents", "light_tree", "uv2_alpha", "single_sided", "grid_media"),
    "clamped",  # with a limit that may be infinite
)
_COVERING_KINDS = {"media": ("none", "absorbing", "scattering"), "exact": ("none", "spheres", "quadrics")}
_COVERING = ("sampler", "models", "light_shapes", "environment", "composite", *_COVERING_FLAGS, *_COVERING_KINDS)
"""Features of a kernel that a scene need not have, or less of: the kernel decides at run time."""

_COVERING_INTEGRATORS = ("path", "aov")
"""Those whose kernels decide at run time. The ray tree does not: it takes an image around for there, for one."""

EITHER, OF_EITHER = "either", ("sobol", "independent")
"""The sampler of kernels that take one of two at run time, and these."""

PASSED_BY_LIGHT = frozenset(("null", "thin_dielectric"))
"""Built-in reflection models that let a part of the light straight through."""


@dataclass(frozen=True)
class Features:
    """Selects one kernel variant; scenes with equal features share a compiled kernel.

    Each field doubles the number of variants, which take seconds to compile: add one only where it pays.

    Attributes:
        models: sorted names of the reflection models in the scene (see `kernels.bsdf`).
        textured: whether any value varies over a surface.
        mipmapped: whether any image has mip levels, or a procedural texture is filtered.
        environment: "none", "constant" or "image".
        tangents: whether any material depends on the direction of the texture coordinates.
        sampler: the source of random numbers (see `make_sample_4d` in `kernels/sampling/sampler.py`), or EITHER.
        instances: "none" where all triangles lie in one tree, else the most general kind of instance: "still",
            "moving" rigidly, or "deforming".
        integrator: the integrator's name (see `kernels/integrators/registry.py`), built-in or registered from outside.
        cameras: names of the camera models that the scene uses and that not all kernels have: models with distortion,
            and models registered from outside the package.
        light_tree: whether lights are chosen by a light tree instead of by power alone.
        light_shapes: names of the light models, where any light has a shape: all built-in ones, and those registered
            from outside that the scene uses (see `kernels/lights/shapes.py`).
        clamped: whether indirect light is clamped.
        regularized: whether surfaces get rougher along a path.
        aovs: whether the film has layers besides radiance (see `kernels/integrators/aovs.py`).
        guides: whether albedo and normals are the guides of a denoiser, which look through glass and into mirrors.
        media: "none", "absorbing" (media absorb or emit light), "scattering", or "unscattered", where the integrator
            leaves out that they scatter.
        grid_media: whether the density of any medium varies on a grid.
        nested: whether media have priorities, so that bodies may overlap or contain one another.
        composite: "none" where no material has parts, "sides" where front and back may differ, "mixed" where hits
            choose parts of mixtures at random, or "holes" where some material has an opacity below 1, so that rays may
            pass its surface, and any may have parts.
        exact: which exact shapes lie among the triangles of the ray tree: "none", "spheres" alone, or "quadrics", which
            are disks and cylinders, with spheres or without. "quadrics" may be followed by names of distance functions,
            each after a hyphen (`kernels/geometry/distances.py`).
        uv2_alpha: whether any value uses the second texture coordinates or the alpha of vertex colours.
        single_sided: whether any shape is single-sided or unlit (see `kernels/integrators/sides.py`).
        caustics: whether photons bring the light that smooth surfaces throw (`kernels/integrators/photons.py`).
        edges: which lines along edges of triangles the film has a layer of: "none", those on the first "surfaces", or
            "wires", which surfaces do not hide (see `kernels/integrators/edges.py`).
        light_groups: whether the film has a layer for each group of lights (see `kernels/integrators/light_groups.py`).
        procedures: names of the models of procedural textures that any material's value comes from.
        gpu: whether the kernel is for GPUs alone. There one loop reads the values of materials for all models, threads
            take the pixels tile by tile, and shadow rays to a hole in a light are traced to nowhere, beside others of
            a warp.
    """

    models: tuple[str, ...]
    textured: bool
    environment: str
    tangents: bool = False
    sampler: str = "independent"
    instances: str = "none"
    integrator: str = "path"
    light_shapes: tuple[str, ...] = ()
    clamped: bool = False
    regularized: bool = False
    aovs: bool = False
    guides: bool = False
    cameras: tuple[str, ...] = ()
    light_tree: bool = False
    media: str = "none"
    grid_media: bool = False
    nested: bool = False
    uv2_alpha: bool = False
    mipmapped: bool = False
    composite: str = "none"
    exact: str = "none"
    single_sided: bool = False
    caustics: bool = False
    edges: str = "none"
    light_groups: bool = False
    procedures: tuple[str, ...] = ()
    gpu: bool = False

    def covers(self, scene: "Features") -> bool:
        """Return whether the kernel of these features renders scenes with the features `scene`, with the same bits."""
        if self.integrator not in _COVERING_INTEGRATORS:
            return self == scene
        return replace(scene, **{name: getattr(self, name) for name in _COVERING}) == self and (
            set(scene.models) <= set(self.models)
            and (self.sampler == scene.sampler or (self.sampler == EITHER and scene.sampler in OF_EITHER))
            and set(scene.light_shapes) <= set(self.light_shapes)
            and (self.environment == "image" or self.environment == scene.environment)
            and (self.has_holes or scene.composite in ("none", self.composite))
            and (not scene.grid_media or scene.media == self.media)  # grids that only absorb are tracked differently
            and all(getattr(self, name) or not getattr(scene, name) for name in _COVERING_FLAGS)
            and all(_reaches(kinds, getattr(self, of), getattr(scene, of)) for of, kinds in _COVERING_KINDS.items())
        )

    def has_uploads_of(self, kernel: "Features") -> bool:
        """Return whether a scene uploaded for these features has all arrays that a `kernel` of others reads."""
        has_uvs = self.textured or self.tangents or not (kernel.textured or kernel.tangents)
        return has_uvs and (self.uv2_alpha or not kernel.uv2_alpha)

    @property
    def geometry(self) -> str:
        """What rays meet: `instances`, followed by `exact` where there are such shapes."""
        return f"{self.instances}_{self.exact}" if self.has_exact else self.instances

    @property
    def has_exact(self) -> bool:
        """Whether rays meet any exact shapes."""
        return self.exact != "none"

    @property
    def distances(self) -> tuple[str, ...]:
        """Names of the distance functions whose shapes rays meet."""
        return distances_of(self.geometry)

    @property
    def has_holes(self) -> bool:
        """Whether rays may pass surfaces that are not opaque."""
        return self.composite == "holes"

    @property
    def lets_light_pass(self) -> bool:
        """Whether a surface may let a part of the light straight through, as far as built-in models go."""
        return self.has_holes or self.nested or not PASSED_BY_LIGHT.isdisjoint(self.models)

    @property
    def is_general(self) -> bool:
        """Whether the kernel is one of those for many scenes (`wrt/compiling/general.py`)."""
        return self.sampler == EITHER

    @property
    def mixed(self) -> bool:
        """Whether each hit chooses a material at random."""
        return self.composite in ("mixed", "holes")

    @property
    def tells_blurred(self) -> bool:
        """Whether a path must know if anything that is not smooth has scattered it."""
        return self.regularized or self.single_sided

    @property
    def shares_times(self) -> bool:
        """Whether a sample has one time in all pixels: that of its photons, where shapes move."""
        return self.caustics and self.instances in ("moving", "deforming")

    @property
    def bodies(self) -> bool:
        """Whether a path must track the bodies that it is in."""
        return self.nested or self.media != "none"

    @property
    def name(self) -> str:
        """A name that identifies the variant, for the kernel's module."""
        parts = [*self.models, "textured" if self.textured else "plain", self.environment]
        for field in fields(self)[3:]:
            value = getattr(self, field.name)
            if value != field.default:
                parts.append(field.name if value is True else value)
        return identifier(parts)


def _reaches(kinds: tuple[str, ...], kernel: str, scene: str) -> bool:
    return kernel == scene or (kernel in kinds and scene in kinds[: kinds.index(kernel)])


def has_exact(geometry: str) -> bool:
    """Return whether there are exact shapes in a `Features.geometry`."""
    return "_" in geometry


def has_quadrics(geometry: str) -> bool:
    """Return whether there are disks or cylinders in a `Features.geometry`."""
    return geometry.split("-")[0].endswith("_quadrics")


def distances_of(geometry: str) -> tuple[str, ...]:
    """Return the names of the distance functions in a `Features.geometry`."""
    return tuple(geometry.split("-")[1:])


def instances_of(geometry: str) -> str:
    """Return the instances of a `Features.geometry`."""
    return geometry.split("_")[0]


def identifier(parts: Iterable[object]) -> str:
    """Return one identifier for a key of names, numbers, tuples of names or features."""
    words = [part.name if isinstance(part, Features) else part for part in parts]
    name = "_".join("_".join(word) if isinstance(word, tuple) else str(word) for word in words)
    name = name.replace(":", "_").replace("-", "_")
    if len(name) > _LONGEST_NAME:
        import hashlib

        # It becomes part of a file name, which may have 255 bytes.
        name = f"{name[:_LONGEST_NAME]}_{hashlib.blake2b(name.encode(), digest_size=8).hexdigest()}"
    return name
