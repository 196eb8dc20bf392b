"""Checkpoints: the state of a film, and the identity of its scene and settings, in one file.

The file is an uncompressed NumPy archive (.npz layout) of the film's arrays and a JSON header.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from wrt._version import __version__
from wrt.errors import InputError
from wrt.io.npy import read_archive
from wrt.io.safe_read import PathLike, first_line, forget_input, read_file
from wrt.io.safe_write import Kind, write_atomically
from wrt.rendering.fingerprint import scene_fingerprint
from wrt.rendering.noise.noise_target import NoiseEstimate
from wrt.rendering.noise.pilot import Pilot, has_pilot

if TYPE_CHECKING:
    from typing_extensions import Self

    from wrt.rendering.film import Film
    from wrt.rendering.renderer import Renderer
    from wrt.scene.scene import Scene

SETTINGS_OF_PICTURE = (
    "width",
    "height",
    "max_depth",
    "max_scatterings",
    "filter",
    "sampler",
    "crop",
    "integrator",
    "min_attenuation",
    "jittered_rays",
    "ao_distance",
    "layers",
    "clamp_indirect",
    "regularization",
    "transparent",
)
"""The fields of `RenderSettings` that change a picture; checkpoints store them."""

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


def write_state(
    path: PathLike, header: dict[str, Any], arrays: dict[str, NDArray[Any]], kind: Kind, *, force: bool = False
) -> None:
    """Write the state of a film atomically, with a header of a kind.

    Raises:
        InputError: when it cannot be written.
    """
    text = np.array(json.dumps(header))

    def write(temporary: Path) -> None:
        with temporary.open("wb") as handle:
            np.savez(handle, **{_HEADER: text}, **arrays)  # type: ignore[arg-type]

    write_atomically(Path(path), write, kind, force=force)


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
    wanted: dict[str, Any],
    *,
    what: str = "cannot resume, these differ",
    pair: str = "{} there, {} here",
) -> None:
    """Raise InputError that lists all differences between a stored header and the wanted one.

    Args:
        path: the file of the stored header.
        stored: the stored header.
        wanted: the wanted one.
        what: the beginning of the message.
        pair: how the message shows a stored value and the wanted one.
    """
    differences = []
    for key, value in wanted.items():
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
        "layers": list(renderer.settings.layers),
        "light_choice": renderer.light_choice,
        "scene": scene_fingerprint(renderer.scene),
    }


class Resumable:
    """The part of a Renderer that saves its film and continues from a saved one."""

    film: Film
    scene: Scene
    _noise_estimate: NoiseEstimate
    _pilot: Pilot | None
    _updated: bool

    def _estimate_noise(self, pilot: Pilot | None) -> None:
        """Estimate the noise anew, by a pilot or by the picture itself."""
        self._pilot = pilot
        self._noise_estimate = NoiseEstimate(self.film) if pilot is None else pilot.estimate

    @property
    def has_updated_vertices(self) -> bool:
        """Whether vertices were updated, so that the picture is no longer that of `scene`."""
        return self._updated

    def _decide_by_pilot(self, wanted: bool) -> None:
        """Let a pilot decide where rendering stops, or the picture itself; keep what is there."""
        if wanted != (self._pilot is not None):
            self._estimate_noise(Pilot(cast("Renderer", self)) if wanted else None)

    def save_checkpoint(self, path: PathLike) -> None:
        """Write everything needed to resume, atomically. An existing file is replaced only if it is a checkpoint.

        Raises:
            InputError: when it cannot be written or would replace another file, or when vertices were updated, which
                a checkpoint does not store.
        """
        if self._updated:
            raise InputError(f"{path}: no checkpoint of a picture whose vertices were updated; make a new Renderer")
        pilot = {} if self._pilot is None else self._pilot.state()
        arrays = {**self.film.state(), **self._noise_estimate.state(), **pilot}
        write_checkpoint(path, identity_of(cast("Renderer", self)), arrays)

    @classmethod
    def resume(cls, path: PathLike, scene: Scene, *, device: str = "cpu", threads: int | None = None) -> Self:
        """Return a renderer that continues from a checkpoint, with its size, seed and settings.

        Raises:
            InputError: when the file is not a checkpoint, or of another scene or version.
        """
        header, arrays = read_checkpoint(path)
        options = {key: header.get(key) for key in ("seed", "strategy", "light_choice", *SETTINGS_OF_PICTURE)}
        try:
            renderer = cls(scene, device=device, threads=threads, **options)  # type: ignore[call-arg]
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        renderer.restore(path, header, arrays)
        return renderer

    def load_checkpoint(self, path: PathLike) -> None:
        """Continue from a checkpoint of the same scene, size, seed and settings.

        Raises:
            InputError: listing the differences.
        """
        self.restore(path, *read_checkpoint(path))

    def restore(self, path: PathLike, header: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Continue from the content of a checkpoint that was read from `path`."""
        require_same(path, header, identity_of(cast("Renderer", self)))
        try:
            self.film.check(arrays, len(self.scene.shapes))
            self._estimate_noise(Pilot(cast("Renderer", self)) if has_pilot(arrays) else None)
            if self._pilot is None:
                self._noise_estimate.restore(arrays)
            else:
                self._pilot.restore(arrays, len(self.scene.shapes))
        except InputError as error:
            raise InputError(f"{path}: damaged, {error}") from None
        self.film.restore(arrays)

    def __reduce_ex__(self, _: Any) -> Any:
        """Raise TypeError: the arrays and threads of a renderer belong to a device."""
        raise TypeError(
            "a Renderer cannot be copied or pickled; copy its Scene and a file from save_checkpoint instead, and "
            "continue with Renderer.resume"
        )
