"""Checkpoints: the state of a film, and the identity of its scene and settings, in one file.

The file is an uncompressed NumPy archive (.npz layout) of the film's arrays and a JSON header.
"""

from __future__ import annotations

import dataclasses
import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from wrt._version import __version__
from wrt.errors import InputError
from wrt.io.npy import read_archive
from wrt.io.safe_read import PathLike, first_line, forget_input, read_file
from wrt.io.safe_write import Kind, write_atomically
from wrt.scene.integrators import INTEGRATORS, Integrator
from wrt.scene.layers import LIGHT_GROUPS
from wrt.scene.scene import RenderSettings, Scene

if TYPE_CHECKING:
    from wrt.rendering.renderer import Renderer

SETTINGS_OF_PICTURE = tuple(
    field.name
    for field in dataclasses.fields(RenderSettings)
    if field.name not in ("spp", "noise", "adaptive", "denoise", "tone", "exposure", "edge_color")
)
"""The fields of `RenderSettings` that change a picture; checkpoints store them."""

NUMBERS = "numbers of the integrator"
"""The key in a header for the numbers of a user-defined integrator."""

FORMAT = 1
_HEADER = "header"

_BEGINNING = 512
"""Bytes at the start of a checkpoint that hold the start of its header, which NumPy stores as UTF-32."""


def kind_of_state(name: str, key: str, *, may_force: bool = False) -> Kind:
    """Return a kind of file with the state of a film; `key` is the first of its header."""

    def is_own(path: Path) -> bool:
        with path.open("rb") as file:
            beginning = file.read(_BEGINNING)
        header = f"{_HEADER}.npy".encode()
        starts = f'{{"{key}": '.encode("utf-32-le")
        return beginning.startswith(b"PK\3\4") and header in beginning and starts in beginning

    return Kind(name, is_own, may_force=may_force)


CHECKPOINT = kind_of_state("a checkpoint", "format")
"""A checkpoint replaces only checkpoints, even with `force`."""


def write_checkpoint(path: PathLike, header: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
    """Write a checkpoint atomically: the old file stays until the new one is complete.

    Raises:
        InputError: when it cannot be written.
    """
    write_state(path, {"format": FORMAT, **header}, arrays, CHECKPOINT)


def write_state(path: PathLike, header: dict[str, Any], arrays: dict[str, NDArray[Any]], kind: Kind) -> None:
    """Write the state of a film atomically, with a header of a kind.

    Raises:
        InputError: when it cannot be written.
    """
    text = np.array(json.dumps(header))

    def write(temporary: Path) -> None:
        with temporary.open("wb") as handle:
            np.savez(handle, **{_HEADER: text}, **arrays)  # type: ignore[arg-type]

    write_atomically(Path(path), write, kind)


def read_checkpoint(path: PathLike) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return a checkpoint's header and arrays.

    Raises:
        InputError: when the file does not exist, or is not a complete checkpoint of this format.
    """
    header, arrays = read_state(path, "checkpoint")
    if header.get("format") != FORMAT:
        raise InputError(f"{path}: written in another checkpoint format than this version of wrt reads")
    return header, arrays


def read_state(path: PathLike, what: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return the header and the arrays of a file of `write_state`; `what` names its kind in messages.

    Raises:
        InputError: when the file does not exist, or is damaged.
    """
    path = Path(path)
    if not os.path.isfile(path):  # unlike `is_file`, False for a name that is too long
        raise InputError(f"{path}: no such {what} file")
    try:
        arrays = read_archive(read_file(path))
        forget_input(path)  # a resumed render may replace its checkpoint
        header = json.loads(str(arrays.pop(_HEADER)), parse_constant=_refuse)
    except (KeyError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: not a wrt {what}, or damaged ({first_line(error)})") from None
    return (header if isinstance(header, dict) else {}), arrays


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} in its header")


def require_same(
    path: PathLike,
    stored: dict[str, Any],
    expected: dict[str, Any],
    *,
    what: str = "cannot resume, these differ",
    pair: str = "{} there, {} here",
) -> None:
    """Raise InputError that lists all differences between a stored header and the expected one.

    Args:
        path: the file of the stored header.
        stored: the stored header.
        expected: the expected one.
        what: the beginning of the message.
        pair: how the message shows a stored value and the expected one.
    """
    differences = []
    for key, value in expected.items():
        found = stored.get(key)
        if found == value:
            continue
        if isinstance(value, dict) and isinstance(found, dict):
            differences += [f"the scene's {part}" for part in value if found.get(part) != value[part]]
        else:
            differences.append(f"{key} ({pair.format(found, value)})")
    if differences:
        raise InputError(f"{path}: {what}: {', '.join(differences)}")


def identity_of(renderer: Renderer) -> dict[str, Any]:
    """Return all that a checkpoint's picture depends on."""
    return {
        "wrt": __version__,
        "warp": renderer.device.backend.version,
        **{key: getattr(renderer.settings, key) for key in SETTINGS_OF_PICTURE},
        "seed": renderer.seed,
        "strategy": renderer.strategy,
        "crop": list(renderer.crop) if renderer.crop != (0, 0, renderer.width, renderer.height) else None,
        "integrator": renderer.integrator,
        **_numbers_of(renderer.settings.integrator),
        "layers": list(renderer.settings.layers),
        "light_groups": list(renderer.scene.light_groups) if LIGHT_GROUPS in renderer.settings.layers else [],
        "light_choice": renderer.light_choice,
        "scene": scene_fingerprint(renderer.scene),
    }


def _numbers_of(integrator: str | Integrator | None) -> dict[str, str]:
    """Return the numbers of a user-defined integrator under their key, or nothing for a built-in one."""
    if not isinstance(integrator, Integrator):
        return {}
    return {NUMBERS: json.dumps(dataclasses.asdict(integrator))}


def integrator_in(header: dict[str, Any]) -> Any:
    """Return the integrator of a header: a name, or a user-defined one with its numbers.

    Raises:
        InputError: if it has no such numbers.
    """
    name = header.get("integrator")
    cls = INTEGRATORS.get(name) if isinstance(name, str) else None
    if cls is None or NUMBERS not in header:
        return name
    try:
        return cls(**json.loads(header[NUMBERS]))
    except (TypeError, ValueError) as error:
        raise InputError(f"integrator {name!r} does not have the {NUMBERS}: {error}") from None


def scene_fingerprint(scene: Scene) -> dict[str, str]:
    """Return a hexadecimal digest of each part of the scene that a picture depends on; names do not count."""
    # Read a mesh that many shapes share only once.
    parts = {id(part): part for shape in scene.shapes for part in (shape.mesh, shape.deformation, shape.transform)}
    digests = {key: _digest(part) for key, part in parts.items()}
    groups = [each.group for each in (*scene.shapes, *scene.lights, scene.environment) if each is not None]
    return {
        "geometry": _digest(
            [
                tuple(digests[id(part)] for part in (shape.mesh, shape.transform, shape.deformation))
                for shape in scene.shapes
            ]
        ),
        "materials": _digest([shape.material for shape in scene.shapes]),
        "emission": _digest([(shape.emission, shape.two_sided_emission) for shape in scene.shapes]),
        "sides and edges": _digest([(shape.double_sided, shape.edges) for shape in scene.shapes]),
        "shadow catchers": _digest([shape.shadow_catcher for shape in scene.shapes]),
        "lights": _digest(scene.lights),
        "environment": _digest(scene.environment),
        "camera": _digest(scene.camera),
        "medium": _digest(scene.medium),
        **({"light groups": _digest(groups)} if scene.light_groups else {}),
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
            if field.name not in ("name", "group"):
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
