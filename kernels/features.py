"""What a scene uses, and so what its kernel must contain."""

from dataclasses import dataclass

_LONGEST_NAME = 100


@dataclass(frozen=True)
class Features:
    """Chooses one kernel variant; equal values share one compiled kernel.

    Few fields on purpose: each doubles the number of kernels a person may have to wait for.

    Attributes:
        models: names of the reflection models in the scene, sorted (see `kernels.bsdf`).
        textured: whether any value comes from an image or from vertex colours.
        mipmapped: whether any image has levels.
        environment: "none", "constant" or "image".
        layered: whether any material lets rays pass by opacity, or is made of others.
        tangents: whether any material depends on the direction of the texture coordinates.
        sampler: where the random numbers come from (see `kernels.sampler.make_sample_4d`).
        instances: "none" where all triangles lie in one tree, else what instances do at most: "still", "moving" as
            wholes, or "deforming".
        integrator: what follows a camera ray (see `kernels/integrators.py`).
        light_tree: whether lights are chosen by a tree over them, not by power alone.
        light_shapes: whether any light is a spot, a rectangle, a disk, a sphere or a sun with a diameter.
        clamped: whether paths bring only so much indirect light.
        regularized: whether surfaces get rougher along a path.
        layers: whether the film has layers (see `kernels/layers.py`).
        media: "none", "absorbing" (where media emit or absorb light) or "scattering".
        nested: whether bodies have priorities, by which they may lie within one another and overlap.
        extras: whether any value is laid by second texture coordinates, or multiplied by the alpha of vertex colours.
    """

    models: tuple[str, ...]
    textured: bool
    environment: str
    layered: bool = False
    tangents: bool = False
    sampler: str = "independent"
    instances: str = "none"
    integrator: str = "path"
    light_shapes: bool = False
    clamped: bool = False
    regularized: bool = False
    layers: bool = False
    light_tree: bool = False
    media: str = "none"
    nested: bool = False
    extras: bool = False
    mipmapped: bool = False

    @property
    def bodies(self) -> bool:
        """Whether a path must know in which bodies it is."""
        return self.nested or self.media != "none"

    @property
    def name(self) -> str:
        """A name that tells one variant from every other, for the kernel's module."""
        parts = [*self.models, "textured" if self.textured else "plain", self.environment]
        parts += ["layered"] * self.layered + ["tangents"] * self.tangents
        parts += [self.sampler] * (self.sampler != "independent")
        parts += [self.instances] * (self.instances != "none")
        parts += [self.integrator] * (self.integrator != "path")
        parts += ["lights"] * self.light_shapes
        parts += ["clamped"] * self.clamped + ["regularized"] * self.regularized + ["layers"] * self.layers
        parts += ["tree"] * self.light_tree
        parts += [self.media] * (self.media != "none") + ["nested"] * self.nested
        parts += ["extras"] * self.extras
        parts += ["mipmapped"] * self.mipmapped
        name = "_".join(parts).replace(":", "_").replace("-", "_")
        if len(name) > _LONGEST_NAME:
            import hashlib

            # It becomes part of a file's name, which may have 255 bytes.
            name = f"{name[:_LONGEST_NAME]}_{hashlib.blake2b(name.encode(), digest_size=8).hexdigest()}"
        return name
