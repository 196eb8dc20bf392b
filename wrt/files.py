"""Reading files that may not be there, and writing files that are whole or not there at all."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeAlias

from wrt.errors import InputError, one_line

PathLike: TypeAlias = str | os.PathLike[str]


def require_file(path: Path) -> None:
    """Raise InputError unless `path` is a file that may be read and holds something."""
    _read(path, 1)


def read_file(path: Path, most: int = -1) -> bytes:
    """Return all that is in a file, or what it begins with.

    Pipes and devices are none: some never end, and others are waited for without end.

    Args:
        path: the file.
        most: bytes to read; all of them where it is negative.

    Raises:
        InputError: where it is no file, is empty, or may not be read.
    """
    return _read(path, most)


def _read(path: Path, count: int) -> bytes:
    try:
        # Opening a pipe that nobody writes to would wait for somebody.
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            found = os.fstat(handle)
            if stat.S_ISDIR(found.st_mode):
                raise InputError(f"{path}: is a directory, not a file")
            if not stat.S_ISREG(found.st_mode):
                raise InputError(f"{path}: is a pipe or a device, not a file")
            # Of files that the system makes up the size is 0, and reading them may wait.
            size = found.st_size if count < 0 else min(count, found.st_size)
            with open(handle, "rb", closefd=False) as file:
                data = file.read(size)
        finally:
            os.close(handle)
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {first_line(error)}") from None
    if not data:
        raise InputError(f"{path}: the file is empty")
    return data


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Within the context, have every InputError say which file it is about."""
    try:
        yield
    except InputError as error:
        if one_line(str(path)) in str(error):
            raise
        raise InputError(f"{path}: {error}") from None


def require_place(path: Path) -> None:
    """Raise InputError unless a file could be written at `path`."""
    if path.is_dir():
        raise InputError(f"{path}: is a directory; name a file")
    folder = path.parent
    if not folder.is_dir():
        reason = "is not a folder" if folder.exists() else "does not exist; make it first"
        raise InputError(f"{path}: the folder {str(folder)!r} {reason}")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"{path}: the folder {str(folder)!r} may not be written to")


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Have `write` make a file that then takes the place of `path`, or leave things as they were.

    Raises:
        InputError: when it cannot be written.
    """
    # Opened without mkstemp, whose files only their owner may read.
    temporary = path.with_name(f".{path.stem}-{os.urandom(4).hex()}{path.suffix}")
    try:
        write(temporary)
        with temporary.open("rb") as file:
            os.fsync(file.fileno())  # or a crash could leave the new name with nothing behind it
        temporary.replace(path)
    except InputError:
        raise
    except (OSError, RuntimeError, ValueError, MemoryError) as error:
        raise InputError(f"{path}: cannot be written: {first_line(error)}") from error
    finally:
        temporary.unlink(missing_ok=True)


def keep_latest(folder: Path, pattern: str, count: int) -> None:
    """Remove what a pattern names in a folder, files or folders, but those that were written last."""
    found = sorted(folder.glob(pattern), key=lambda path: path.stat().st_mtime)
    for path in found[:-count]:
        if path.is_dir():
            import shutil

            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


def why_not(path: Path, error: InputError) -> str:
    """Return what `read_file` says, without the path."""
    return str(error).removeprefix(f"{one_line(str(path))}: ")


def first_line(error: BaseException) -> str:
    """Return what an exception says in one line, or its kind where it says nothing."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    lines = str(error).strip().splitlines()
    return lines[0].strip() if lines else type(error).__name__
