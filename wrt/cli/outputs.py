"""The paths of pictures and checkpoints, and writing them."""

from __future__ import annotations

import argparse
import contextlib
import os
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from wrt.errors import InputError

if TYPE_CHECKING:
    from wrt.renderer import Renderer


def default_output(source: str) -> str:
    """Return the default name of an input's picture."""
    return f"{Path(source).stem or 'picture'}.png"


def default_outputs(sources: Sequence[str]) -> list[str]:
    """Return a different picture name for each of several inputs.

    Inputs with the same stem get longer names: with their suffixes if these differ, otherwise with their folders.

    Raises:
        InputError: where two inputs still get the same name.
    """
    names = [default_output(source) for source in sources]
    for name in {name for name in names if names.count(name) > 1}:
        alike = [number for number, each in enumerate(names) if each == name]
        paths = [Path(sources[number]) for number in alike]
        by_suffix = ["-".join((path.stem, *path.suffix.split(".")[1:])) for path in paths]
        by_folder = ["-".join((*filter(_is_name, path.parent.parts), path.stem)) for path in paths]
        longer = by_suffix if len(set(by_suffix)) == len(paths) else by_folder
        for number, stem in zip(alike, longer, strict=True):
            names[number] = f"{stem}.png"
    for number, name in enumerate(names):
        if name in names[:number]:
            first = sources[names.index(name)]
            raise InputError(
                f"{first} and {sources[number]} would both be rendered to {name}; render them one at a time"
            )
    return names


def _is_name(part: str) -> bool:
    return part not in ("/", "..")


def folder_for(output: str) -> str:
    """Return the folder that `-o` names for the pictures of several inputs; create it if the name ends with "/".

    Raises:
        InputError: where it is not a folder, or cannot be created.
    """
    if not output.endswith("/") and not os.path.isdir(output):
        raise InputError(f"{output}: with several inputs the output must be a folder; end its name with / to create it")
    try:
        os.makedirs(output, exist_ok=True)
    except OSError as error:
        raise InputError(f"{output}: cannot be created: {error.strerror or error}") from None
    return output


def check_paths(options: argparse.Namespace) -> tuple[Path, Path | None]:
    """Return the paths of one input's picture and checkpoint, after checking that both may be written.

    Call it again once the scene is loaded: only then are the files known that the scene reads.
    """
    from wrt.checkpoint import CHECKPOINT
    from wrt.output import picture_place
    from wrt.safe_write import require_place

    if options.resume and options.checkpoint is None:
        raise InputError("--resume needs --checkpoint FILE, the file to continue from")
    output = picture_place(options.output, default=options.default, force=options.force, taken=options.taken)
    if options.checkpoint is None:
        return output, None
    checkpoint = Path(options.checkpoint)
    if os.path.realpath(checkpoint) == os.path.realpath(output):  # unlike `resolve`, it accepts circular links
        raise InputError(f"{checkpoint}: the checkpoint would replace the picture; name another file")
    require_place(checkpoint, CHECKPOINT)
    return output, checkpoint


def save(renderer: Renderer, options: argparse.Namespace, output: Path, checkpoint: Path | None) -> None:
    """Write the checkpoint, if any, and the picture.

    Raises:
        OSError: where one cannot be written, which does not keep the other from it.
    """
    from wrt.output import save_render

    try:
        _save_checkpoint(renderer, checkpoint)  # first, since the picture can be made from it again
    finally:
        with _naming(output):
            save_render(output, renderer, force=options.force)


def save_at_last(renderer: Renderer, options: argparse.Namespace, output: Path, checkpoint: Path | None) -> Path:
    """Write the checkpoint, if any, and the picture, elsewhere if it cannot be written at `output`.

    Returns:
        The path of the picture, which is another one if a file has appeared at `output` that must not be replaced.

    Raises:
        OSError: where a file cannot be written at its path; the message says where else the picture is.
    """
    try:
        _save_checkpoint(renderer, checkpoint)
    finally:
        output = _save_picture(renderer, options, output)
    return output


def _save_checkpoint(renderer: Renderer, checkpoint: Path | None) -> None:
    if checkpoint is not None:
        with _naming(checkpoint):
            renderer.save_checkpoint(checkpoint)


def _save_picture(renderer: Renderer, options: argparse.Namespace, output: Path) -> Path:
    from wrt.output import save_render
    from wrt.safe_write import NotReplacedError

    try:
        save_render(output, renderer, force=options.force)
    except InputError as error:
        place = _save_elsewhere(renderer, options, output)
        if place is None:
            raise OSError(str(error)) from error
        if not isinstance(error, NotReplacedError):
            raise OSError(f"{error}; the picture is {place}") from error
        return place
    return output


def _save_elsewhere(renderer: Renderer, options: argparse.Namespace, output: Path) -> Path | None:
    """Write the picture under another name, if need be in another folder; return None where that fails too."""
    from wrt.formats.images import PICTURE
    from wrt.output import save_render
    from wrt.safe_write import free_place

    for folder in (output.parent, Path(), Path(tempfile.gettempdir())):
        with contextlib.suppress(InputError):
            place = free_place(folder / output.name, PICTURE, taken=options.taken)
            save_render(place, renderer)
            return place
    return None


@contextlib.contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Within the context, turn every error in writing `path` into an OSError that names it."""
    try:
        yield
    except InputError as error:  # it names the file; the path itself was checked before rendering
        raise OSError(str(error)) from error
    except OSError as error:
        raise OSError(f"{path}: cannot be written: {error.strerror or error}") from error
