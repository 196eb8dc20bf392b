"""Cryptomatte: ids of names, metadata, and masks from layers of ranked coverage.

After Psyop's Cryptomatte specification, version 1.2.0; ids are MurmurHash3_x86_32 of Appleby (2011).
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError

RANKS = 6
"""Pairs of id and coverage in a pixel; the specification suggests six."""

TYPES = {"crypto_object": "CryptoObject", "crypto_material": "CryptoMaterial"}
"""The name in files of each layer."""


def channels_of(layer: str) -> list[str]:
    """Return the channel names of a layer in OpenEXR files: two pairs of id and coverage in each RGBA."""
    return [f"{TYPES[layer]}{number:02}.{channel}" for number in range(RANKS // 2) for channel in "RGBA"]


def metadata_of(layer: str, names: Iterable[str] | None = None) -> dict[str, str]:
    """Return the attributes that tell other programs of a layer, with a manifest of `names` if they are known."""
    name = TYPES[layer]
    entries = {"name": name, "hash": "MurmurHash3_32", "conversion": "uint32_to_float32"}
    if names is not None:
        # Blender reads UTF-8 and knows no \u escapes.
        ids = {text: f"{id_of(text):08x}" for text in map(_encodable, names)}
        entries["manifest"] = json.dumps(ids, ensure_ascii=False, separators=(",", ":"))
    key = f"{_murmur3(name.encode()):08x}"[:7]
    return {f"cryptomatte/{key}/{entry}": value for entry, value in entries.items()}


def id_of(name: str) -> int:
    """Return the id of a name, the bits of a float32 that is neither denormal nor infinite nor NaN."""
    bits = _murmur3(_encodable(name).encode())
    return bits ^ (1 << 23) if bits >> 23 & 255 in (0, 255) else bits


def ids_of(names: Iterable[str]) -> NDArray[np.uint32]:
    """Return the id of each name."""
    known: dict[str, int] = {}
    return np.array(
        [known[name] if name in known else known.setdefault(name, id_of(name)) for name in names], np.uint32
    )


def cryptomatte_mask(layer: NDArray[Any], *names: str) -> NDArray[np.float32]:
    """Return how much of each pixel some objects or materials cover, (H, W) float32, 0 to 1.

    Args:
        layer: (H, W, ranks, 2) ids and coverage: "crypto_object" or "crypto_material" of `wrt.Renderer.layers`.
        names: names of shapes or materials.

    Raises:
        InputError: if the layer has another shape or type.
    """
    layer = np.asarray(layer)
    if layer.ndim != 4 or layer.shape[3] != 2 or layer.dtype != np.float32:
        raise InputError(
            f"a cryptomatte layer must be (H, W, ranks, 2) float32, not {layer.shape} {layer.dtype}: one of "
            f"{', '.join(TYPES)} of a renderer's layers"
        )
    chosen = np.isin(np.ascontiguousarray(layer[..., 0]).view(np.uint32), ids_of(names))
    mask: NDArray[np.float32] = (layer[..., 1] * chosen).sum(axis=2)
    return mask


def _encodable(name: str) -> str:
    """Return a name as UTF-8 can hold it: half a surrogate pair becomes a question mark."""
    return str(name).encode("utf-8", "replace").decode()


def _murmur3(data: bytes) -> int:
    """Return MurmurHash3_x86_32 with the seed 0."""
    mask, mixed = 0xFFFFFFFF, 0
    for start in range(0, len(data), 4):
        k = int.from_bytes(data[start : start + 4], "little") * 0xCC9E2D51 & mask
        mixed ^= (k << 15 | k >> 17) * 0x1B873593 & mask
        if start + 4 <= len(data):
            mixed = (mixed << 13 | mixed >> 19) & mask
            mixed = mixed * 5 + 0xE6546B64 & mask
    mixed ^= len(data)
    mixed = (mixed ^ mixed >> 16) * 0x85EBCA6B & mask
    mixed = (mixed ^ mixed >> 13) * 0xC2B2AE35 & mask
    return mixed ^ mixed >> 16
