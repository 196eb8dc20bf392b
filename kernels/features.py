"""What a scene uses, and so what its kernel must contain."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Features:
    """Chooses one kernel variant; equal values share one compiled kernel.

    Few fields on purpose: each doubles the number of kernels a person may have to wait for.

    Attributes:
        models: names of the reflection models in the scene, sorted (see `kernels.bsdf`).
        textured: whether any colour comes from an image or from vertex colours.
        environment: "none", "constant" or "image".
    """

    models: tuple[str, ...]
    textured: bool
    environment: str

    @property
    def name(self) -> str:
        """A name that tells one variant from every other, for the kernel's module."""
        parts = [*self.models, "textured" if self.textured else "plain", self.environment]
        return "_".join(parts)
