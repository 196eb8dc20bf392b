"""Roughness: distributions of microfacet normals, and the base of materials that have them."""

from __future__ import annotations

import math
from collections.abc import Hashable
from functools import partial

import numpy as np

from wrt.errors import InputError
from wrt.linalg import gauss_legendre
from wrt.scene.materials.material import Material
from wrt.scene.textures import VARYING, ColorSource, ImageTexture, Texture, VertexColor, checked_texture
from wrt.values import number

LEAST_ALPHA = 1e-4
"""The least roughness; smoother surfaces look like mirrors (kernels/microfacet)."""

NEARLY_SMOOTH = 0.05
"""Most roughness α of surfaces that throw caustics by photons, as smooth ones do."""

_SMITH = ("smith", "smith-separable")
_GENERAL = ("cook-torrance", "kelemen", "implicit")

MASKINGS: dict[str, tuple[str, ...]] = {
    "ggx": (*_SMITH, *_GENERAL),
    "beckmann": (*_SMITH, "walter", *_GENERAL),
    "blinn-phong": ("smith-separable", "walter", *_GENERAL),
    "abc": _GENERAL,
    "sgd": _GENERAL,
}
"""The masking functions of each distribution of microfacet normals."""

_BY_ALPHA = ("ggx", "beckmann", "blinn-phong")
_ANISOTROPIC = ("ggx", "beckmann")
_PARAMETERS = {"abc": {"B": (0.1, 1e8), "C": (0.0, 100.0)}, "sgd": {"α": (1e-5, 10.0), "p": (0.0, 10.0)}}
"""Limits of the two parameters of distributions without a single roughness."""


MOST_BORROWED = 0.3
"""Largest roughness at which Blinn's distribution may use Beckmann's masking, for want of a closed form of its own
(Walter et al. 2007, section 5.2). Rougher surfaces would gain energy: a factor of 1.07 at 0.5."""


def masking_for(distribution: str, masking: str | None, alpha: ColorSource) -> str:
    """Return the masking to use: the given one, by default "smith" where available, else "cook-torrance".

    Raises:
        InputError: if the distribution or masking is unknown, or they cannot be combined.
    """
    if distribution not in MASKINGS:
        raise InputError(f"distribution must be one of {', '.join(MASKINGS)}, not {distribution!r}")
    maskings = MASKINGS[distribution]
    if masking is None:
        return "smith" if "smith" in maskings else "cook-torrance"
    if masking not in maskings:
        raise InputError(
            f"masking must be one of {', '.join(maskings)} for distribution {distribution!r}, not {masking!r}"
        )
    borrowed = distribution == "blinn-phong" and masking not in _GENERAL
    if borrowed and not (isinstance(alpha, (int, float)) and alpha <= MOST_BORROWED):
        raise InputError(
            f"masking {masking!r} for distribution 'blinn-phong' needs an alpha that is one number, at most "
            f"{MOST_BORROWED}; 'cook-torrance' takes any"
        )
    return masking


def roughness(value: ColorSource, distribution: str) -> ColorSource:
    """Return a checked roughness `alpha` for a distribution: a number, two numbers, or a texture.

    Raises:
        InputError: if a number is out of range, or the distribution does not support it.
    """
    if distribution not in _BY_ALPHA:
        return _parameters(value, distribution)
    if isinstance(value, VARYING):
        check = partial(number, name="alpha", minimum=LEAST_ALPHA, maximum=1.0)
        return checked_texture(value, lambda bound: check(np.ravel(bound)[0]))
    if np.ndim(value) == 0:
        return number(value, "alpha", minimum=LEAST_ALPHA, maximum=1.0)
    pair = tuple(number(x, f"alpha[{i}]", minimum=LEAST_ALPHA, maximum=1.0) for i, x in enumerate(_pair(value)))
    if pair[0] != pair[1] and distribution not in _ANISOTROPIC:
        raise InputError(f"alpha must be one number for distribution {distribution!r}, not {list(pair)}")
    return pair


def largest(value: ColorSource) -> float:
    """Return the largest of a material's numbers, anywhere on a surface; infinity if it depends on the mesh."""
    if isinstance(value, ImageTexture):
        return float(value.pixels.max()) * max(value.factor)  # type: ignore[arg-type]
    return math.inf if isinstance(value, (VertexColor, Texture)) else float(np.max(value))


def _pair(value: ColorSource) -> tuple[object, object]:
    try:
        first, second = value  # type: ignore[misc]
    except (TypeError, ValueError):
        raise InputError(f"alpha must be a number, two numbers or an image, not {value!r}") from None
    return first, second


def _parameters(value: ColorSource, distribution: str) -> ColorSource:
    """Return the two parameters of a distribution without a single roughness."""
    limits = _PARAMETERS[distribution]
    if isinstance(value, (*VARYING, str)) or np.ndim(value) == 0:
        raise InputError(f"alpha must be two numbers, {' and '.join(limits)}, for distribution {distribution!r}")
    a, b = (
        number(x, f"alpha[{i}] ({name})", minimum=low, maximum=high)
        for i, (x, (name, (low, high))) in enumerate(zip(_pair(value), limits.items(), strict=True))
    )
    return a, b


def sgd_normalization(alpha: float, p: float) -> float:
    """Return K = 1 / (α² exp(α) E_p(α)), the third number of the shape of a shifted gamma distribution.

    It makes ∫ D cosθ dω = 1 for D = K exp(−x / α) (1 + x / α²)^−p / (π cos⁴θ), x = tan²θ: the distribution of Bagher,
    Soler and Holzschuch (2012). In their terms K is exp(−α) / (α^(1 + p) Γ(1 − p, α)), where p may exceed 1.

    Args:
        alpha: α > 0; fits to measured materials have 3e-5 (chrome steel) to 0.7 (dark red paint).
        p: exponent, p ≥ 0; those fits have 0 to 1.4.
    """
    # exp(α) E_p(α) = ∫ exp(−αs) (1 + s)^−p ds over s ≥ 0. With 1 + s = e^y the integrand is smooth in y, and below
    # e^−50 at the end of this interval.
    end = math.log1p(50.0 / alpha)
    nodes, weights = gauss_legendre(128)
    y = 0.5 * end * (nodes + 1.0)
    integral = 0.5 * end * float(np.sum(weights * np.exp(-alpha * np.expm1(y) + (1.0 - p) * y)))
    return 1.0 / (alpha * alpha * integral)


class Microfacets(Material):
    """Base of rough materials whose facets are distributed along u and along v; not used by itself."""

    alpha: ColorSource
    distribution: str
    masking: str | None
    multiple_bounces: bool

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set(masking=masking_for(self.distribution, self.masking, self.alpha))
        self._set(alpha=roughness(self.alpha, self.distribution))
        _ = self.table_key  # which may refuse the roughness

    @property
    def is_nearly_smooth(self) -> bool:
        return self.distribution in _BY_ALPHA and largest(self.alpha) <= NEARLY_SMOOTH

    @property
    def _shape(self) -> ColorSource:
        """The kernels' `shape`: three numbers (see kernels/microfacet), or the texture."""
        alpha = self.alpha
        if isinstance(alpha, VARYING):
            return alpha
        first, second = (alpha, alpha) if isinstance(alpha, float) else alpha
        return first, second, sgd_normalization(first, second) if self.distribution == "sgd" else 0.0

    @property
    def needs_tangents(self) -> bool:
        """Whether it is anisotropic.

        An image has the roughness along x in red and along y in green; a grey image or a single channel is isotropic.
        """
        alpha = self.alpha
        if self.distribution not in _ANISOTROPIC or isinstance(alpha, float):
            return False
        if isinstance(alpha, ImageTexture):
            return alpha.channel is None and bool((alpha.pixels[..., 0] != alpha.pixels[..., 1]).any())
        if isinstance(alpha, Texture):
            return not alpha.bounds or any(np.ptp(bound) > 0.0 for bound in alpha.bounds)
        if isinstance(alpha, VertexColor):
            return True
        first, second = alpha
        return bool(first != second)

    @property
    def table_key(self) -> tuple[Hashable, ...] | None:
        return self._albedo_table_key if self.multiple_bounces else None

    @property
    def _albedo_table_key(self) -> tuple[Hashable, ...]:
        """The key of the table of the energy that a single bounce loses (wrt/upload/tables/albedo.py).

        Raises:
            InputError: if the roughness is an anisotropic texture, for which there is no table.
        """
        surface = "reflection", self.distribution, self.masking
        if not self.needs_tangents and self.distribution in _BY_ALPHA:
            return (*surface, None)
        if isinstance(self.alpha, VARYING):
            raise InputError("multiple_bounces needs an alpha that is a number, two numbers or a grey image")
        return (*surface, self._shape)
