"""Saves the picture and the checkpoint of a render, in another place if necessary."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from wrt.cli.exit_status import cause_of
from wrt.errors import InputError

if TYPE_CHECKING:
    from wrt.develop.picture import Developed
    from wrt.rendering.renderer import Renderer


class Saved(NamedTuple):
    """A picture that was written.

    Attributes:
        path: the file.
        developed: how radiance was developed to 8 bits, or None if it was not.
    """

    path: Path
    developed: Developed | None


def save(renderer: Renderer, options: argparse.Namespace, output: Path | None, checkpoint: Path | None) -> None:
    """Write the checkpoint and the picture, if named.

    Raises:
        OSError: if one of them cannot be written; the other is written all the same.
    """
    try:
        _save_checkpoint(renderer, checkpoint)  # first, since it contains the picture
    finally:
        if output is not None:
            with _naming(output):
                renderer.save(output, force=options.force)


def save_at_last(renderer: Renderer, options: argparse.Namespace, output: Path, checkpoint: Path | None) -> Saved:
    """Write the checkpoint, if any, and the picture, in another place if it cannot be written to `output`.

    Returns:
        The picture and its path, which differs from `output` if a file that must not be overwritten has appeared there.

    Raises:
        OSError: if a file cannot be written to its path; the message says where the picture is instead.
    """
    try:
        _save_checkpoint(renderer, checkpoint)
    finally:
        saved = _save_picture(renderer, options, output)
    return saved


def _save_checkpoint(renderer: Renderer, checkpoint: Path | None) -> None:
    if checkpoint is not None:
        with _naming(checkpoint):
            renderer.save_checkpoint(checkpoint)


def _save_picture(renderer: Renderer, options: argparse.Namespace, output: Path) -> Saved:
    from wrt.io.safe_write import NotReplacedError

    try:
        return Saved(output, renderer.save(output, force=options.force))
    except (MemoryError, RuntimeError) as error:
        if not renderer.settings.denoise:
            raise
        renderer.settings = dataclasses.replace(renderer.settings, denoise=False)
        noisy = _save_picture(renderer, options, output)
        raise OSError(f"{noisy.path}: saved with its noise, denoising failed: {cause_of(error)}") from error
    except InputError as error:
        saved = _save_elsewhere(renderer, options, output)
        if saved is None:
            raise OSError(str(error)) from error
        if not isinstance(error, NotReplacedError):
            raise OSError(f"{error}; the picture is {saved.path}") from error
        return saved


def _save_elsewhere(renderer: Renderer, options: argparse.Namespace, output: Path) -> Saved | None:
    """Write the picture under another name, if necessary in another folder; return None if that fails too."""
    from wrt.io.images import PICTURE
    from wrt.io.safe_write import free_path

    for folder in (output.parent, Path(), Path(tempfile.gettempdir())):
        with contextlib.suppress(InputError):
            place = free_path(folder / output.name, PICTURE, taken=options.taken)
            return Saved(place, renderer.save(place))
    return None


@contextlib.contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Within the context, turn errors in writing `path` into an OSError that names it."""
    try:
        yield
    except InputError as error:  # its message names the file
        raise OSError(str(error)) from error
    except OSError as error:
        raise OSError(f"{path}: cannot be written: {error.strerror or error}") from error
