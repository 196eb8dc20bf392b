"""Roughness: how the normals of a surface too rough to be a mirror, too fine to be seen, are described and checked."""

from __future__ import annotations

from collections.abc import Hashable

import numpy as np

from wrt.distributions import sgd_normalization
from wrt.errors import InputError
from wrt.textures import ColorSource, ImageTexture, VertexColor
from wrt.values import Vec3, number

LEAST_ALPHA = 1e-4
"""The least roughness; anything below looks like a mirror (kernels/microfacet)."""

_SMITH = ("smith", "smith-separable")
_GENERAL = ("cook-torrance", "kelemen", "implicit")

MASKINGS: dict[str, tuple[str, ...]] = {
    "ggx": (*_SMITH, *_GENERAL),
    "beckmann": (*_SMITH, "walter", *_GENERAL),
    "blinn-phong": ("smith-separable", "walter", *_GENERAL),
    "abc": _GENERAL,
    "sgd": _GENERAL,
}
"""Distributions of microfacet normals, and what is known for each of how facets hide one another."""

_BY_ALPHA = ("ggx", "beckmann", "blinn-phong")
_ANISOTROPIC = ("ggx", "beckmann")


MOST_BORROWED = 0.3
"""Blinn's distribution has no masking of Smith's kind in closed form. That of Beckmann's stands in for it (Walter et
al. 2007, section 5.2); beyond this roughness it would send back more light than comes: 1.07 of it at 0.5."""


def masking_for(distribution: str, masking: str | None, alpha: ColorSource) -> str:
    """Return the masking to use: the one asked for, or "smith", or "cook-torrance" where that is not known.

    Raises:
        InputError: where there is no such distribution or masking, or they do not go together.
    """
    if distribution not in MASKINGS:
        raise InputError(f"distribution must be one of {', '.join(MASKINGS)}, not {distribution!r}")
    known = MASKINGS[distribution]
    if masking is None:
        return "smith" if "smith" in known else "cook-torrance"
    if masking not in known:
        raise InputError(
            f"masking must be one of {', '.join(known)} for distribution {distribution!r}, not {masking!r}"
        )
    borrowed = distribution == "blinn-phong" and masking not in _GENERAL
    if borrowed and not (isinstance(alpha, (int, float)) and alpha <= MOST_BORROWED):
        raise InputError(
            f"masking {masking!r} for distribution 'blinn-phong' needs an alpha that is one number, at most "
            f"{MOST_BORROWED}; 'cook-torrance' takes all"
        )
    return masking


def roughness(value: ColorSource, distribution: str, name: str = "alpha") -> ColorSource:
    """Return a roughness for `distribution`, checked: a number, two numbers, or what varies over the surface.

    Raises:
        InputError: where a number is out of range, or the distribution cannot have it.
    """
    if distribution not in _BY_ALPHA:
        return _parameters(value, distribution, name)
    if isinstance(value, (ImageTexture, VertexColor)):
        return value
    if np.ndim(value) == 0:
        return number(value, name, minimum=LEAST_ALPHA, maximum=1.0)
    first, second = _pair(value, name)
    pair = tuple(number(x, f"{name}[{i}]", minimum=LEAST_ALPHA, maximum=1.0) for i, x in enumerate((first, second)))
    if pair[0] != pair[1] and distribution not in _ANISOTROPIC:
        raise InputError(f"{name} must be one number for distribution {distribution!r}, not {list(pair)}")
    return pair


def _pair(value: ColorSource, name: str) -> tuple[object, object]:
    try:
        first, second = value  # type: ignore[misc]
    except (TypeError, ValueError):
        raise InputError(f"{name} must be a number, two numbers or an image, not {value!r}") from None
    return first, second


def _parameters(value: ColorSource, distribution: str, name: str) -> ColorSource:
    """Return the two numbers of a distribution that has no single roughness."""
    if isinstance(value, (ImageTexture, VertexColor, str)) or np.ndim(value) == 0:
        names = {"abc": "B and C", "sgd": "α and p"}[distribution]
        raise InputError(f"{name} must be two numbers, {names}, for distribution {distribution!r}")
    first, second = _pair(value, name)
    if distribution == "abc":
        b = number(first, f"{name}[0] (B)", minimum=0.1, maximum=1e8)
        return b, number(second, f"{name}[1] (C)", minimum=0.0, maximum=100.0)
    a = number(first, f"{name}[0] (α)", minimum=1e-5, maximum=10.0)
    return a, number(second, f"{name}[1] (p)", minimum=0.0, maximum=10.0)


def shape_of(alpha: ColorSource, distribution: str) -> ColorSource:
    """Return what the kernels' `shape` is made from: three numbers (see kernels/microfacet), or the texture."""
    if isinstance(alpha, (ImageTexture, VertexColor)):
        return alpha
    first, second = (alpha, alpha) if isinstance(alpha, float) else alpha
    if distribution == "sgd":
        return first, second, sgd_normalization(first, second)
    return first, second, 0.0


def is_anisotropic(alpha: ColorSource, distribution: str) -> bool:
    """Return whether a surface may look different when turned about its normal.

    Of an image, red is the roughness along x and green that along y: a grey one, or a channel of one, is the same
    along both.
    """
    if distribution not in _ANISOTROPIC or isinstance(alpha, float):
        return False
    if isinstance(alpha, ImageTexture):
        return alpha.channel is None and bool((alpha.pixels[..., 0] != alpha.pixels[..., 1]).any())
    if isinstance(alpha, VertexColor):
        return True
    first, second = alpha
    return bool(first != second)


def albedo_table_key(alpha: ColorSource, distribution: str, masking: str | None) -> tuple[Hashable, ...]:
    """Return the key of the table of energy that one bounce loses (wrt/build/albedo_tables.py).

    Raises:
        InputError: where there is no table for such a roughness: one that varies differently along x and y.
    """
    if not is_anisotropic(alpha, distribution) and distribution in _BY_ALPHA:
        return ("reflection", distribution, masking, None)
    if isinstance(alpha, (ImageTexture, VertexColor)):
        raise InputError("multiple_bounces needs an alpha that is a number, two numbers or a grey image")
    shape: Vec3 = shape_of(alpha, distribution)  # type: ignore[assignment]
    return ("reflection", distribution, masking, shape)
