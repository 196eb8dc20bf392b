"""Store the texels of images as one byte a channel if that is lossless, otherwise as float32.

An image from an 8-bit file has at most 256 values in each channel, also after conversion to linear colours or normals.
Four bytes and a palette then replace the twelve bytes of a texel, with the same bits when read. The pixels themselves
decide, not their origin.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from wrt.scene.srgb import of_codes
from wrt.upload.arrays import require_countable

FloatArray = NDArray[np.float32]
Codes = NDArray[np.uint8]

FEWEST_TEXELS = 1024
"""Smaller images stay float32: a palette takes 3 KB."""

_CHUNK = 2**16
"""Values processed in one step, so that intermediate arrays stay in cache."""


class Texels:
    """The concatenated pixels of a scene's images.

    Attributes:
        colors: (N, 3) texels of images that stay float32.
        codes: (N,) uint32 texels of the others: red in the lowest byte, then green and blue.
        palettes: (256,) values of a channel, three arrays for each palette.
        places: for each image its start in `colors` or `codes`, and the number of its palette or −1.
    """

    def __init__(self, images: Sequence[FloatArray], *, coded: bool = True) -> None:
        """Store (H, W, 3) images; without `coded` all of them as float32.

        Raises:
            InputError: when they have more texels than 32 bits can count.
        """
        require_countable(sum(image.shape[0] * image.shape[1] for image in images), "texels of the scene's textures")
        self.palettes: list[FloatArray] = []
        self.places: list[tuple[int, int]] = []
        colors: list[FloatArray] = [np.zeros((0, 3), np.float32)]
        codes: list[NDArray[np.uint32]] = [np.zeros(0, np.uint32)]
        n_colors = n_codes = 0
        for image in images:
            flat = image.reshape(-1, 3)
            found = self._coded(flat) if coded and len(flat) >= FEWEST_TEXELS else None
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

    @property
    def bytes(self) -> int:
        """Bytes of the texels and palettes."""
        return self.colors.nbytes + self.codes.nbytes + sum(palette.nbytes for palette in self.palettes)

    def _coded(self, pixels: FloatArray) -> tuple[Codes, int] | None:
        """Return the (N, 3) codes of an image and the number of its palette; None if it has too many values."""
        for linear in (False, True):
            # Prefer the standard palettes, which all images share.
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
        """Return the number of a palette, which is added if new."""
        for number in range(len(self.palettes) // 3):
            if all(np.array_equal(a, b) for a, b in zip(self.palettes[3 * number :], palette, strict=False)):
                return number
        self.palettes += palette
        return len(self.palettes) // 3 - 1


def codes_of(values: FloatArray, start: FloatArray | None = None) -> tuple[Codes, FloatArray] | None:
    """Return (N,) codes and their palette, which begins with `start`; None if there are more than 256 values."""
    bits = values.view(np.uint32)
    palette = np.zeros(0, np.uint32) if start is None else start.view(np.uint32)
    factor, table = _hashed(palette)
    codes = np.empty(len(bits), np.uint8)
    for first in range(0, len(bits), _CHUNK):
        part = bits[first : first + _CHUNK]
        found = table[_hash(part, factor)]
        new = part[palette[found] != part] if len(palette) else part
        if len(new):
            palette = np.concatenate([palette, np.unique(new)])
            if len(palette) > 256:
                return None
            factor, table = _hashed(palette)
            found = table[_hash(part, factor)]
        codes[first : first + _CHUNK] = found
    return codes, palette.view(np.float32)


def _hash(bits: NDArray[np.uint32], factor: np.uint32) -> NDArray[np.uint32]:
    return (bits * factor) >> np.uint32(16)


def _hashed(palette: NDArray[np.uint32]) -> tuple[np.uint32, Codes]:
    """Return a factor that makes `_hash` perfect for a palette, and a table from hashes to palette indices."""
    rng = np.random.default_rng(0)
    while True:  # with 256 values and 65536 hashes, three tries in five succeed
        factor = np.uint32(2 * rng.integers(2**31) + 1)
        hashes = _hash(palette, factor)
        if len(np.unique(hashes)) == len(palette):
            table = np.zeros(2**16, np.uint8)
            table[hashes] = np.arange(len(palette))
            return factor, table


def _packed(codes: Codes) -> NDArray[np.uint32]:
    """Pack (N, 3) codes into one integer each."""
    bytes_ = np.zeros((len(codes), 4), np.uint8)
    bytes_[:, :3] = codes
    packed: NDArray[np.uint32] = bytes_.view("<u4").reshape(-1).astype(np.uint32, copy=False)
    return packed
