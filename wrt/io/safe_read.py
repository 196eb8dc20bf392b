"""Reading files: refuses missing files, devices and pipes, and files outside a confinement.

All input goes through `read_file` and `require_file`. They record what was read, so that no output replaces it
(`wrt/io/safe_write.py`), and refuse files outside the folder that `confined_to` names.
"""

from __future__ import annotations

import codecs
import os
import stat
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

from wrt.errors import InputError, one_line

PathLike: TypeAlias = str | os.PathLike[str]

Identity: TypeAlias = tuple[int, int, int, int]
"""Identifies one version of a file: device, inode, time of change in ns, size."""


class _Confinement:
    """The folder that reading is confined to, and the first path that was refused."""

    def __init__(self, folder: Path, *, leniently: bool) -> None:
        self.folder = Path(os.path.realpath(folder))
        self.leniently = leniently
        self.refused: Path | None = None


@dataclass
class Load:
    """The files and the memory of a load so far, which `wrt.io.memory_limits` compares.

    Attributes:
        files: the files, each once, even under different paths.
        size: their bytes.
        counts: bytes of memory by limit.
    """

    files: set[str] = field(default_factory=set)
    size: int = 0
    counts: Counter[Any] = field(default_factory=Counter)


@dataclass(frozen=True)
class Unpacked:
    """The folder of an unpacked archive, and the size of the archive, as which its files count together."""

    folder: str
    size: int


class _OutsideError(Exception):
    """A path leads out of the folder. Not an InputError, which readers may turn into a warning."""


_confinement: ContextVar[_Confinement | None] = ContextVar("confinement", default=None)
LOAD: ContextVar[Load | None] = ContextVar("load", default=None)
UNPACKED: ContextVar[Unpacked | None] = ContextVar("unpacked", default=None)
_inputs: dict[str, Identity] = {}  # the files that this process has read, by real path


def identity_of(found: os.stat_result) -> Identity:
    """Return the identity of a file."""
    return found.st_dev, found.st_ino, found.st_mtime_ns, found.st_size


def is_input(path: Path) -> bool:
    """Return whether this process has read the file at `path`, under this name or another."""
    try:
        real = os.path.realpath(path)
        return real in _inputs or identity_of(os.stat(real)) in _inputs.values()
    except (OSError, ValueError):  # no file can have that name
        return False


def forget_input(path: Path) -> None:
    """Stop counting the file at `path` as read, so that it may be replaced."""
    _inputs.pop(os.path.realpath(path), None)


@contextmanager
def confined_to(folder: Path | None, *, leniently: bool = False) -> Iterator[None]:
    """Within the context, refuse files outside a folder, also through links; None refuses nothing.

    Args:
        folder: the folder.
        leniently: whether a file that is refused counts as missing, which most readers continue without.

    Raises:
        InputError: where a file was refused, even if its reader continued without it.
    """
    confinement = None if folder is None else _Confinement(folder, leniently=leniently)
    token = _confinement.set(confinement)
    try:
        yield
    except (_OutsideError, InputError):
        if confinement is None or confinement.refused is None:
            raise
    finally:
        _confinement.reset(token)
    if confinement is not None and confinement.refused is not None:
        raise InputError(f"{confinement.refused}: is outside the scene's folder, and reading is confined to that")


def confinement_folder() -> Path | None:
    """Return the folder of `confined_to`, for another process that reads on behalf of this one."""
    confinement = _confinement.get()
    return None if confinement is None else confinement.folder


def is_inside(path: Path) -> bool:
    """Return whether `path` is inside the folder of `confined_to`, for files that are guessed and not named."""
    confinement = _confinement.get()
    return confinement is None or Path(os.path.realpath(path)).is_relative_to(confinement.folder)


def require_inside(path: Path, real: str | None = None) -> None:
    """Raise unless `path` is inside the folder of `confined_to`, whether or not the file exists."""
    try:
        real = real or os.path.realpath(path)
    except ValueError as error:  # a zero byte, which no path has
        raise InputError(f"{path}: cannot be read: {first_line(error)}") from None
    confinement = _confinement.get()
    if confinement is not None and not Path(real).is_relative_to(confinement.folder):
        if confinement.leniently:
            raise InputError(f"{path}: is outside the archive, beyond which nothing is read")
        confinement.refused = confinement.refused or path
        raise _OutsideError


def require_file(path: Path) -> None:
    """Raise InputError unless `path` is a file that may be read and holds something."""
    read_file(path, 1)


def read_file(path: Path, most: int = -1) -> bytes:
    """Return the content of a file, or its first `most` bytes.

    Pipes and devices are refused: reading them may never end.

    Raises:
        InputError: where it is not a regular file, is empty, or may not be read.
    """
    try:
        require_inside(path)
        # Without O_NONBLOCK, opening a pipe waits for a writer.
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            found = os.fstat(handle)
            if stat.S_ISDIR(found.st_mode):
                raise InputError(f"{path}: is a directory, not a file")
            if not stat.S_ISREG(found.st_mode):
                raise InputError(f"{path}: is a pipe or a device, not a file")
            try:
                real = os.readlink(f"/proc/self/fd/{handle}")
            except OSError:
                real = os.path.realpath(path)
            require_inside(path, real)  # again: a link may have changed in between
            # Files of /proc have size 0, and reading them may block.
            size = found.st_size if most < 0 else min(most, found.st_size)
            with open(handle, "rb", closefd=False) as file:
                data = file.read(size)
        finally:
            os.close(handle)
    except InputError:
        raise
    except FileNotFoundError:
        if path.is_symlink():
            raise InputError(f"{path}: is a link to {os.readlink(path)!r}, which is not there") from None
        raise InputError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {first_line(error)}") from None
    if not data:
        raise InputError(f"{path}: the file is empty")
    _inputs[real] = identity_of(found)
    load = LOAD.get()
    size, archive = found.st_size, UNPACKED.get()
    if archive is not None and real.startswith(archive.folder):
        real, size = archive.folder, archive.size
    if load is not None and real not in load.files:
        load.files.add(real)
        load.size += size
    return data


@contextmanager
def naming_file(path: Path) -> Iterator[None]:
    """Within the context, make every InputError name the file."""
    try:
        yield
    except InputError as error:
        if one_line(str(path)) in str(error):
            raise
        raise InputError(f"{path}: {error}") from None


def reason_alone(path: Path, error: InputError) -> str:
    """Return the message of `read_file` without the path."""
    return str(error).removeprefix(f"{one_line(str(path))}: ")


def first_line(error: BaseException) -> str:
    """Return the first line of an exception's message, or its type if it has none."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    lines = str(error).strip().splitlines()
    return lines[0].strip() if lines else type(error).__name__


# --- Text ------------------------------------------------------------------------------------------

# Longer marks first: the UTF-32 mark starts with the UTF-16 mark.
_MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}


def as_utf8(data: bytes) -> bytes:
    """Return the data of a text file as UTF-8 without its byte-order mark, which programs on Windows often write.

    Data without a mark are returned unchanged.

    Raises:
        InputError: where the data are not valid in the encoding of the mark.
    """
    for mark, encoding in _MARKS.items():
        if data.startswith(mark):
            if encoding == "utf-8":
                return data[len(mark) :]
            try:
                return data.decode(encoding).encode("utf-8")
            except UnicodeDecodeError as error:
                name = encoding.upper()
                raise InputError(f"begins as {name} text but is invalid (byte {error.start}); save as UTF-8") from None
    return data


def as_text(data: bytes) -> str:
    """Decode the data of a text file; bytes that are not UTF-8 survive as surrogates, so that file names keep working.

    trimesh itself decodes only UTF-8 without an optional library.

    Raises:
        InputError: see `as_utf8`.
    """
    return as_utf8(data).decode("utf-8", "surrogateescape")
