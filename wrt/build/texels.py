"""How the texels of images lie in memory: as codes of a byte a channel where that loses nothing, else as float32.

An image from a file of 8 bits has at most 256 values in each channel, also after its colours became linear or a
normal map its normals. So four bytes and a palette hold a texel that would take twelve, and it comes out with the same
bits. Whether an image has so few values is asked of its pixels, not of where they came from.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.srgb import of_codes

FloatArray = NDArray[np.float32]
Codes = NDArray[np.uint8]

FEWEST_TEXELS = 1024
"""An image of fewer texels stays as it is: a palette takes 3 KB."""

_CHUNK = 2**16
"""Values that are looked at together: what is made of them on the way stays in a cache."""


class Texels:
    """The pixels of a scene's images, one after the other.

    Attributes:
        colors: of images that stay in float32.
        codes: (N,) uint32 of the others: red in the lowest byte, then green and blue.
        palettes: (256,) values of a channel, three in turn for each palette.
        places: for each image, where in `colors` or in `codes` it begins, and its palette's number or −1.
    """

    def __init__(self, images: Sequence[FloatArray]) -> None:
        """Take (H, W, 3) images.

        Raises:
            InputError: where they have more texels than an int counts.
        """
        if sum(image.shape[0] * image.shape[1] for image in images) >= 2**31:
            raise InputError("the scene's textures have more than 2^31 texels")
        self.palettes: list[FloatArray] = []
        self.places: list[tuple[int, int]] = []
        colors: list[FloatArray] = [np.zeros((0, 3), np.float32)]
        codes: list[NDArray[np.uint32]] = [np.zeros(0, np.uint32)]
        n_colors = n_codes = 0
        for image in images:
            flat = image.reshape(-1, 3)
            found = None if len(flat) < FEWEST_TEXELS else self._coded(flat)
            if found is None:
                self.places.append((n_colors, -1))
                colors.append(flat)
                n_colors += len(flat)
            else:
                channels, palette = found
                self.places.append((n_codes, palette))
                codes.append(_packed(channels))
                n_codes += len(flat)
        self.colors, self.codes = np.concatenate(colors), np.concatenate(codes)

    def _coded(self, pixels: FloatArray) -> tuple[Codes, int] | None:
        """Return the (N, 3) codes of an image and the number of its palette; None where it has too many values."""
        for linear in (False, True):
            # The usual ones are shared by all images.
            usual = of_codes(linear=linear)
            if (same := codes_of(pixels.reshape(-1), usual)) is not None:
                return same[0].reshape(-1, 3), self._numbered([usual] * 3)
        channels = []
        for k in range(3):
            found = codes_of(np.ascontiguousarray(pixels[:, k]))
            if found is None:
                return None
            channels.append(found)
        palette = [np.resize(values, 256) for _, values in channels]
        return np.stack([codes for codes, _ in channels], axis=1), self._numbered(palette)

    def _numbered(self, palette: list[FloatArray]) -> int:
        """Return the number of a palette, a new one if it is not there yet."""
        for number in range(len(self.palettes) // 3):
            if all(np.array_equal(a, b) for a, b in zip(self.palettes[3 * number :], palette, strict=False)):
                return number
        self.palettes += palette
        return len(self.palettes) // 3 - 1


def codes_of(values: FloatArray, known: FloatArray | None = None) -> tuple[Codes, FloatArray] | None:
    """Return (N,) codes, and the values that these stand for, bit for bit; None where there are more than 256.

    Args:
        values: (N,) numbers.
        known: values that the codes stand for to begin with.
    """
    bits = values.view(np.uint32)
    palette = np.zeros(0, np.uint32) if known is None else known.view(np.uint32)
    factor, table = _hashed(palette)
    codes = np.empty(len(bits), np.uint8)
    for start in range(0, len(bits), _CHUNK):
        part = bits[start : start + _CHUNK]
        found = table[_hash(part, factor)]
        new = part[palette[found] != part] if len(palette) else part
        if len(new):
            palette = np.concatenate([palette, np.unique(new)])
            if len(palette) > 256:
                return None
            factor, table = _hashed(palette)
            found = table[_hash(part, factor)]
        codes[start : start + _CHUNK] = found
    return codes, palette.view(np.float32)


def _hash(bits: NDArray[np.uint32], factor: np.uint32) -> NDArray[np.uint32]:
    return (bits * factor) >> np.uint32(16)


def _hashed(palette: NDArray[np.uint32]) -> tuple[np.uint32, Codes]:
    """Return a factor whose `_hash` tells the values of a palette apart, and their places in it by their hashes."""
    rng = np.random.default_rng(0)
    while True:  # of 256 values in 65536 places, three tries in five find one
        factor = np.uint32(2 * rng.integers(2**31) + 1)
        hashes = _hash(palette, factor)
        if len(np.unique(hashes)) == len(palette):
            table = np.zeros(2**16, np.uint8)
            table[hashes] = np.arange(len(palette))
            return factor, table


def _packed(codes: Codes) -> NDArray[np.uint32]:
    """Return (N, 3) codes as one number each."""
    bytes_ = np.zeros((len(codes), 4), np.uint8)
    bytes_[:, :3] = codes
    packed: NDArray[np.uint32] = bytes_.view("<u4").reshape(-1).astype(np.uint32, copy=False)
    return packed
