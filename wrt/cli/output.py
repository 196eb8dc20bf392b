"""Where `wrt render` saves its pictures and checkpoints, and saving them, in another place if necessary."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from wrt.cli.exit_status import cause_of, complain
from wrt.errors import InputError

if TYPE_CHECKING:
    from wrt.cli.options import RenderOptions
    from wrt.develop.picture import Developed
    from wrt.rendering.renderer import Renderer


@dataclasses.dataclass
class Output:
    """The files of one render.

    Attributes:
        name: the preferred path of the picture.
        is_default: whether `name` is wrt's choice: then the picture gets another name where this one is taken.
        force: whether the picture may replace a file that wrt did not write.
        checkpoint: the path of the checkpoint, or None.
        pictures: paths of the pictures of this command so far; each render adds its own.
        picture: the path of the picture, once `check` has chosen it.
    """

    name: str
    is_default: bool
    force: bool
    checkpoint: Path | None
    pictures: set[Path]
    picture: Path = dataclasses.field(init=False)

    def __post_init__(self) -> None:
        """Start with the preferred path."""
        self.picture = Path(self.name)

    def check(self) -> None:
        """Choose a free name for the picture, and raise InputError if a file must not be written.

        Call it again once the scene is loaded, since the files that the scene has read must not be overwritten.
        """
        from wrt.io.images import PICTURE, check_output
        from wrt.io.safe_write import free_path, require_writable
        from wrt.rendering.checkpoint import CHECKPOINT

        if self.is_default:
            self.picture = free_path(Path(self.name), PICTURE, reserved=self.pictures, force=self.force)
        else:
            self.picture = check_output(self.name, force=self.force)
        if self.checkpoint is not None:
            # Unlike `resolve`, `realpath` accepts circular links.
            if os.path.realpath(self.checkpoint) == os.path.realpath(self.picture):
                raise InputError(f"{self.checkpoint}: the checkpoint would replace the picture; name another file")
            require_writable(self.checkpoint, CHECKPOINT)

    def save(self, renderer: Renderer, *, picture: bool, checkpoint: bool) -> None:
        """Write the checkpoint and the picture during the render.

        Raises:
            OSError: if one of them cannot be written; the other is written all the same.
        """
        try:
            if checkpoint:
                self._save_checkpoint(renderer)  # first, since it contains the picture
        finally:
            if picture:
                with _naming(self.picture):
                    renderer.save(self.picture, force=self.force)

    def save_at_end(self, renderer: Renderer) -> Developed | None:
        """Write the checkpoint and the picture, with another name if a file has appeared that must not be replaced.

        Raises:
            OSError: if a file cannot be written to its path; the message says where the picture is instead.
        """
        try:
            self._save_checkpoint(renderer)
        finally:
            developed = self._save_picture(renderer)
            self.pictures.add(self.picture)
        return developed

    def saved_files(self) -> str:
        """Return a message that names the files."""
        return f"{self.picture} saved" if self.checkpoint is None else f"{self.picture} and {self.checkpoint} saved"

    def _save_checkpoint(self, renderer: Renderer) -> None:
        if self.checkpoint is not None:
            with _naming(self.checkpoint):
                renderer.save_checkpoint(self.checkpoint)

    def _save_picture(self, renderer: Renderer) -> Developed | None:
        from wrt.io.safe_write import NotReplacedError

        try:
            return renderer.save(self.picture, force=self.force)
        except (MemoryError, RuntimeError) as error:
            if not renderer.settings.denoise:
                raise
            renderer.settings = dataclasses.replace(renderer.settings, denoise=False)
            self._save_picture(renderer)
            raise OSError(f"{self.picture}: saved with its noise, denoising failed: {cause_of(error)}") from error
        except InputError as error:
            developed = self._save_elsewhere(renderer, error)
            if not isinstance(error, NotReplacedError):
                raise OSError(f"{error}; the picture is {self.picture}") from error
            return developed

    def _save_elsewhere(self, renderer: Renderer, error: InputError) -> Developed | None:
        """Write the picture under another name, if necessary in another folder, or raise the error as an OSError."""
        from wrt.io.images import PICTURE
        from wrt.io.safe_write import free_path

        for folder in (self.picture.parent, Path(), Path(tempfile.gettempdir())):
            with contextlib.suppress(InputError):
                path = free_path(folder / self.picture.name, PICTURE, reserved=self.pictures)
                developed = renderer.save(path)
                self.picture = path
                return developed
        raise OSError(str(error)) from error


@contextlib.contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Within the context, turn errors in writing `path` into an OSError that names it."""
    try:
        yield
    except InputError as error:  # its message names the file
        raise OSError(str(error)) from error
    except OSError as error:
        raise OSError(f"{path}: cannot be written: {error.strerror or error}") from error


# --- Names -----------------------------------------------------------------------------------------


def outputs_of(options: RenderOptions) -> list[Output]:
    """Return the files of the picture of each input.

    Raises:
        InputError: if an option is not possible for several inputs, or two inputs would have the same output.
    """
    inputs = options.inputs
    if options.resume and options.checkpoint is None:
        raise InputError("--resume needs --checkpoint FILE, the file to continue from")
    if options.checkpoint is not None and len(inputs) > 1:
        raise InputError("--checkpoint is for a single input; render the inputs one at a time")
    for number, source in enumerate(inputs):
        if source in inputs[:number]:
            raise InputError(f"{source}: given twice")
    # An output that ends with a slash is a folder even for one input, since a shell pattern may match a single file.
    is_file = options.output is not None and len(inputs) == 1 and not options.output.endswith("/")
    names = [str(options.output)] if is_file else default_outputs(inputs)
    if not is_file and options.output is not None:
        folder = folder_for(options.output)
        names = [os.path.join(folder, name) for name in names]
    for source, name in zip(inputs, names, strict=True):
        if not is_file and os.path.basename(name) != default_output(source) and not options.quiet:
            name = os.path.basename(name)
            complain("note", f"{source}: the picture is {name}, because another input has the same name")
    # A default name never replaces a file that wrt did not write.
    force, pictures = options.force and options.output is not None, set[Path]()
    checkpoint = None if options.checkpoint is None else Path(options.checkpoint)
    return [Output(name, not is_file, force, checkpoint, pictures) for name in names]


def default_output(source: str) -> str:
    """Return the default name of an input's picture."""
    from wrt.io.archives import COMPRESSED

    path = Path(source)
    path = Path(path.stem) if path.suffix.lower() in COMPRESSED else path  # model.ply.gz is a model
    return f"{path.stem or 'picture'}.png"


def default_outputs(sources: Sequence[str]) -> list[str]:
    """Return distinct picture names for several inputs.

    Inputs with the same stem get longer names: with their suffixes if these differ, otherwise with their folders.

    Raises:
        InputError: if two inputs still get the same name.
    """
    names = [default_output(source) for source in sources]
    for name in {name for name in names if names.count(name) > 1}:
        same = [number for number, each in enumerate(names) if each == name]
        paths = [Path(sources[number]) for number in same]
        by_suffix = ["-".join((path.stem, *path.suffix.split(".")[1:])) for path in paths]
        folders = [[part for part in path.parent.parts if part not in ("/", "..")] for path in paths]
        by_folder = ["-".join((*folder, path.stem)) for folder, path in zip(folders, paths, strict=True)]
        longer = by_suffix if len(set(by_suffix)) == len(paths) else by_folder
        for number, stem in zip(same, longer, strict=True):
            names[number] = f"{stem}.png"
    for number, name in enumerate(names):
        if name in names[:number]:
            first = sources[names.index(name)]
            raise InputError(
                f"{first} and {sources[number]} would both be written to {name}; render them one at a time"
            )
    return names


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
