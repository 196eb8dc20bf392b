"""The paths of pictures and checkpoints."""

from __future__ import annotations

import argparse
import contextlib
import os
from collections.abc import Sequence
from pathlib import Path

from wrt.errors import InputError


def default_output(source: str) -> str:
    """Return the default name of an input's picture."""
    return f"{Path(source).stem or 'picture'}.png"


def default_outputs(sources: Sequence[str]) -> list[str]:
    """Return distinct picture names for several inputs.

    Inputs with the same stem get longer names: with their suffixes if these differ, otherwise with their folders.

    Raises:
        InputError: if two inputs still get the same name.
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
                f"{first} and {sources[number]} would both be written to {name}; render them one at a time"
            )
    return names


def _is_name(part: str) -> bool:
    return part not in ("/", "..")


def folder_for(output: str) -> str:
    """Return the folder that `-o` names for the pictures of several inputs; create it if the name ends with "/".

    Raises:
        InputError: if it is not a folder, or cannot be created.
    """
    if not output.endswith("/") and not os.path.isdir(output):
        raise InputError(f"{output}: for several inputs, the output must be a folder; end its name with / to create it")
    try:
        if not os.path.isdir(output):
            with contextlib.suppress(FileNotFoundError):
                os.lstat(output)  # raises before any folder is created if the path is too long
            os.makedirs(output, exist_ok=True)
    except OSError as error:
        raise InputError(f"{output}: cannot be created: {error.strerror or error}") from None
    except RecursionError:
        raise InputError(f"{output}: cannot be created: has too many folders") from None
    return output


def check_paths(options: argparse.Namespace) -> tuple[Path, Path | None]:
    """Return the paths of one input's picture and checkpoint, after checking that both may be written.

    Call it again when the scene is loaded, since it must not overwrite files that the scene reads.
    """
    from wrt.io.images import PICTURE, check_output
    from wrt.io.safe_write import free_path, require_writable
    from wrt.rendering.checkpoint import CHECKPOINT

    if options.resume and options.checkpoint is None:
        raise InputError("--resume needs --checkpoint FILE, the file to continue from")
    if options.output is None:
        output = free_path(Path(options.default), PICTURE, taken=options.taken, force=options.force)
    else:
        output = check_output(options.output, force=options.force)
    if options.checkpoint is None:
        return output, None
    checkpoint = Path(options.checkpoint)
    if os.path.realpath(checkpoint) == os.path.realpath(output):  # unlike `resolve`, it accepts circular links
        raise InputError(f"{checkpoint}: the checkpoint would replace the picture; name another file")
    require_writable(checkpoint, CHECKPOINT)
    return output, checkpoint
