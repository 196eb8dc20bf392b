"""Where pictures and checkpoints go, and writing them."""

from __future__ import annotations

import argparse
import contextlib
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from wrt.errors import InputError

if TYPE_CHECKING:
    from wrt.renderer import Renderer


def default_output(source: str) -> str:
    """Return the name of an input's picture, where none is given."""
    return f"{Path(source).stem or 'picture'}.png"


def default_outputs(sources: Sequence[str]) -> list[str]:
    """Return the names of several inputs' pictures, no two alike.

    Those of inputs that are called alike get more of their paths: suffixes where these tell them apart, folders else.

    Raises:
        InputError: where that does not tell them apart either.
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
            raise InputError(f"{first} and {sources[number]} would both be rendered to {name}; name one of them by -o")
    return names


def _is_name(part: str) -> bool:
    return part not in ("/", "..")


def folder_for(output: str) -> str:
    """Return the folder that `-o` names for the pictures of several inputs, which is made where it ends in "/".

    Raises:
        InputError: where it is no folder, or cannot be made.
    """
    if not output.endswith("/") and not os.path.isdir(output):
        raise InputError(f"{output}: of several inputs the output must be a folder; end its name in / to have it made")
    try:
        os.makedirs(output, exist_ok=True)
    except OSError as error:
        raise InputError(f"{output}: cannot be made: {error.strerror or error}") from None
    return output


def check_paths(options: argparse.Namespace) -> tuple[Path, Path | None]:
    """Return where picture and checkpoint of one input go, once it is sure that they may be written.

    Asked again after the scene was loaded, it knows the files that the scene reads.
    """
    from wrt.checkpoint import CHECKPOINT
    from wrt.output import picture_place
    from wrt.safe_write import require_place

    if options.resume and options.checkpoint is None:
        raise InputError("--resume needs --checkpoint FILE, the file to go on from")
    output = picture_place(options.output, default=options.default, force=options.force, taken=options.taken)
    if options.checkpoint is None:
        return output, None
    checkpoint = Path(options.checkpoint)
    if os.path.realpath(checkpoint) == os.path.realpath(output):  # unlike `resolve`, it takes links in circles
        raise InputError(f"{checkpoint}: the checkpoint would replace the picture; name another file")
    require_place(checkpoint, CHECKPOINT)
    return output, checkpoint


def save(renderer: Renderer, output: Path, checkpoint: Path | None, *, force: bool) -> Path:
    """Write the checkpoint, if there is to be one, and the picture; return where that is.

    It is another place where somebody has put a file at `output` during the render.

    Raises:
        OSError: where one cannot be written.
    """
    from wrt.formats.images import PICTURE
    from wrt.output import save_render
    from wrt.safe_write import NotReplacedError, free_place

    if checkpoint is not None:  # first, since the picture can be had from it again
        with _naming(checkpoint):
            renderer.save_checkpoint(checkpoint)
    with _naming(output):
        try:
            save_render(output, renderer, force=force)
        except NotReplacedError:
            output = free_place(output, PICTURE)
            save_render(output, renderer)
    return output


@contextlib.contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Within the context, have what keeps `path` from being written end as an OSError that names it."""
    try:
        yield
    except InputError as error:  # names the file; and that the path was good had been seen before
        raise OSError(str(error)) from error
    except OSError as error:
        raise OSError(f"{path}: cannot be written: {error.strerror or error}") from error
