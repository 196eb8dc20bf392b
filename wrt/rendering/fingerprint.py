"""Digests of a scene, by which checkpoints recognize it."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from wrt.scene.scene import Scene


def scene_fingerprint(scene: Scene) -> dict[str, str]:
    """Return a hexadecimal digest of each part of the scene that a picture depends on; names do not count."""
    # Read a mesh that many shapes share only once.
    parts = {id(part): part for shape in scene.shapes for part in (shape.mesh, shape.deformation, shape.transform)}
    digests = {key: _digest(part) for key, part in parts.items()}
    return {
        "geometry": _digest(
            [
                tuple(digests[id(part)] for part in (shape.mesh, shape.transform, shape.deformation))
                for shape in scene.shapes
            ]
        ),
        "materials": _digest([shape.material for shape in scene.shapes]),
        "emission": _digest([(shape.emission, shape.two_sided_emission) for shape in scene.shapes]),
        "lights": _digest(scene.lights),
        "environment": _digest(scene.environment),
        "camera": _digest(scene.camera),
        "medium": _digest(scene.medium),
    }


def _digest(value: Any) -> str:
    import hashlib

    digest = hashlib.blake2b(digest_size=16)
    _feed(digest, value)
    return digest.hexdigest()


def _feed(digest: Any, value: Any) -> None:
    """Add a value to a digest, encoded so that different values have different bytes."""
    if dataclasses.is_dataclass(value):
        digest.update(f"<{type(value).__name__}>".encode())
        for field in dataclasses.fields(value):
            if field.name != "name":
                digest.update(f".{field.name}=".encode())
                _feed(digest, getattr(value, field.name))
    elif isinstance(value, np.ndarray):
        digest.update(f"array{value.dtype.str}{value.shape}".encode())
        digest.update(np.ascontiguousarray(value).data)
    elif isinstance(value, (list, tuple)):
        digest.update(f"[{len(value)}]".encode())
        for item in value:
            _feed(digest, item)
    else:
        digest.update(f"{type(value).__name__}:{value!r};".encode())
