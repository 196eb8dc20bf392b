"""Bounds on the position, direction and power of lights, for light selection."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LightBounds:
    """The bounds of N lights.

    A light emits only from within its sphere and its box, and only in directions that are closer to its axis than the
    sum of the angles of spread and falloff: normals lie within the spread of the axis, and each point emits within
    the falloff of its normal.

    Attributes:
        center: (N, 3) centre of box and sphere, metres; NaN for lights infinitely far away.
        half: (N, 3) half the sides of the box, metres.
        radius: (N,) radius of the sphere, metres.
        depth: (N,) extent from the centre along the axis, metres.
        axis: (N, 3) unit vector, the middle of the normals.
        cos_spread: (N,) cosine of the largest angle between the axis and a normal; −1 if normals point everywhere.
        cos_falloff: (N,) cosine of the angle to the normal beyond which there is no emission; 0 for surfaces.
        two_sided: (N,) whether it also emits against its axis.
        power: (N,) luminance of the power, W, or of the irradiance, W·m⁻², for lights infinitely far away.
    """

    center: Array
    half: Array
    radius: Array
    depth: Array
    axis: Array
    cos_spread: Array
    cos_falloff: Array
    two_sided: NDArray[np.bool_]
    power: Array

    def __len__(self) -> int:
        return len(self.power)

    @staticmethod
    def of(
        corners: ArrayLike,
        axis: ArrayLike,
        power: ArrayLike,
        *,
        cos_spread: ArrayLike = 1.0,
        cos_falloff: ArrayLike = 0.0,
        two_sided: ArrayLike = False,
    ) -> LightBounds:
        """Return the bounds of N lights, each the hull of its corners, (N, K, 3); other values may be one for all."""
        points = np.asarray(corners, np.float64)
        n = len(points)
        axes = np.array(np.broadcast_to(np.asarray(axis, np.float64), (n, 3)))
        low, high = points.min(axis=1), points.max(axis=1)
        center = 0.5 * low + 0.5 * high
        offset = points - center[:, None]

        def each(value: ArrayLike) -> Array:
            return np.array(np.broadcast_to(np.asarray(value, np.float64), (n,)))

        return LightBounds(
            center,
            0.5 * (high - low),
            np.sqrt((offset**2).sum(axis=2).max(axis=1)),
            np.abs((offset * axes[:, None]).sum(axis=2)).max(axis=1),
            axes,
            each(cos_spread),
            each(cos_falloff),
            each(two_sided) != 0.0,
            each(power),
        )

    @staticmethod
    def joined(parts: list[LightBounds]) -> LightBounds:
        """Concatenate bounds."""
        return LightBounds(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(LightBounds)))

    def take(self, which: NDArray[np.int64] | NDArray[np.bool_]) -> LightBounds:
        """Return the bounds of some of the lights."""
        return LightBounds(*(getattr(self, f.name)[which] for f in fields(LightBounds)))

    @property
    def is_far(self) -> NDArray[np.bool_]:
        """(N,) whether each light is infinitely far away."""
        return np.isnan(self.center[:, 0])

    @property
    def facing_power(self) -> Array:
        """(N,) π times the largest radiant intensity: the power of a flat light of that intensity.

        Two-sided lights split their power between the sides. Lights with normals everywhere have a quarter of the
        intensity of a flat one; beams have more, the narrower they are.
        """
        beam = np.where(
            self.cos_falloff >= 0.0, 1.0 - np.minimum(self.cos_falloff, 1.0 - 1e-7) ** 2, 1.0 - self.cos_falloff
        )
        share = np.where(self.two_sided, 0.5, 1.0) * np.where(self.cos_spread <= -1.0, 0.25, 1.0 / beam)
        return np.asarray(self.power * share)
