"""Writing files: whole or not at all, and never over one that somebody would miss.

All that wrt writes for people goes through `write_whole`. What is written after long work is checked before it, by
`require_place`. The rule of both, whatever the output:

- a file that this process has read is never written;
- what is no regular file, such as a device, a pipe or a folder, is refused, and links are followed;
- a write-protected file is left alone;
- a file that is there already is replaced if wrt has made it and it is of the output's own kind (`Kind`), or by
  `force`.
"""

from __future__ import annotations

import contextlib
import os
import re
import stat
import time
import zlib
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from wrt.errors import InputError
from wrt.files import Identity, first_line, forget_input, identity_of, is_input

_TEMPORARY = re.compile(r"\.wrt-([0-9a-f]{8})-[0-9a-f]{8}\.part(\..*)?")
"""Names of files and folders that are being written, with a digest of the host's name."""

_FOREIGN_SECONDS = 3600.0
"""Age of a file that another host was writing from which on it counts as left over: locks may not reach so far."""

_MOST_NAMES = 1000


@dataclass(frozen=True)
class Kind:
    """A kind of output.

    Attributes:
        name: what one is called in messages, such as "a checkpoint"; empty where none is ever replaced without leave.
        is_own: tells of a regular file whether wrt made it, so that it may be replaced.
        may_force: whether a person may have others replaced.
    """

    name: str
    is_own: Callable[[Path], bool]
    may_force: bool = True


_written: dict[str, tuple[Identity, Kind]] = {}  # what this process has written, by its path without links
_swept: set[str] = set()  # folders in which leftovers were looked for


class NotReplacedError(InputError):
    """A file is there already, and not one that may be replaced."""


def require_place(path: Path, kind: Kind, *, force: bool = False) -> None:
    """Raise InputError unless a file of a kind may be written at `path`; see the rule above."""
    _target(path, kind, force)


def free_place(path: Path, kind: Kind, *, taken: Collection[Path] = frozenset(), force: bool = False) -> Path:
    """Return `path`, or the first of `NAME-render`, `NAME-render-2` and so on at which a file of a kind may be written.

    Args:
        path: the place that is tried first.
        kind: what is to be written.
        taken: places that it must not be.
        force: see `write_whole`.

    Raises:
        InputError: where it is not for the sake of a file that is there that none may be.
    """
    for number in range(_MOST_NAMES):
        tried = path if number == 0 else path.with_stem(f"{path.stem}-render{'' if number == 1 else f'-{number}'}")
        try:
            require_place(tried, kind, force=force)
        except NotReplacedError:
            continue
        if tried not in taken:
            return tried
    raise NotReplacedError(f"{path}: so are {_MOST_NAMES} names like it; name another file")


def write_whole(path: Path, write: Callable[[Path], object], kind: Kind, *, force: bool = False) -> None:
    """Have `write` fill a file that then takes the place of `path`, or leave things as they were.

    Args:
        path: the place; where it is a link, what that leads to.
        write: is called with the path of an empty file beside the place.
        kind: what is written.
        force: whether any file may be replaced that this process has not read.

    Raises:
        InputError: when it cannot be written, or the rule above forbids it.
    """
    target = _target(path, kind, force)
    try:
        _sweep(target.parent)
        with _temporary(target) as (temporary, handle):
            write(temporary)
            os.fsync(handle)  # or a crash could leave the new name with nothing behind it
            target = _target(path, kind, force)  # somebody may have put a file there meanwhile
            with contextlib.suppress(OSError):  # there is none yet, or modes cannot be set
                os.fchmod(handle, stat.S_IMODE(target.stat().st_mode))
            temporary.replace(target)
            _written[os.fspath(target)] = identity_of(os.fstat(handle)), kind
        forget_input(target)
    except InputError:
        raise
    except (OSError, RuntimeError, ValueError, MemoryError) as error:
        raise InputError(f"{path}: cannot be written: {first_line(error)}") from error


@contextlib.contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """Within the context, have an empty folder, which at its end takes the place `path` if something is in it.

    Raises:
        InputError: where there is something already, or a folder cannot be made.
    """
    if os.path.lexists(path):
        raise NotReplacedError(f"{path}: is there already; name another file")
    _sweep(path.parent)
    try:
        folder, handle = _make_folder(path)
        try:
            yield folder
            if any(folder.iterdir()):
                folder.rename(path)
        finally:
            _remove(folder)
            os.close(handle)
    except OSError as error:
        raise InputError(f"{path}: cannot be made: {first_line(error)}") from None


def _make_folder(path: Path) -> tuple[Path, int]:
    """Return a new folder beside `path`, and a handle of it that is locked."""
    while True:
        folder = path.with_name(_temporary_name())
        folder.mkdir()
        with contextlib.suppress(FileNotFoundError):  # another process took it for left over before it was locked
            handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
            _lock(handle, wait=True)
            if folder.is_dir():
                return folder, handle
            os.close(handle)


def _remove(path: Path) -> None:
    """Remove a file or a folder, if it is there."""
    if path.is_dir():
        import shutil

        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def _target(path: Path, kind: Kind, force: bool) -> Path:
    """Return the path, without links, of a file that may be written; see `require_place`."""
    try:
        target = Path(os.path.realpath(path))
        _require_folder(path, target.parent if path.is_symlink() else path.parent)
        found = os.stat(target) if os.path.lexists(target) else None
    except InputError:
        raise
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be written: {first_line(error)}") from None
    if found is not None and stat.S_ISDIR(found.st_mode):
        raise InputError(f"{path}: is a directory; name a file")
    if found is not None and not stat.S_ISREG(found.st_mode):
        raise InputError(f"{path}: is a pipe or a device, not a file; name a file")
    if found is None:
        return target
    if is_input(target):
        raise NotReplacedError(f"{path}: would replace a file that was read; name another file")
    if not found.st_mode & 0o222 or not os.access(target, os.W_OK):
        raise NotReplacedError(f"{path}: is write-protected; name another file")
    may_replace = (force and kind.may_force) or _written.get(os.fspath(target)) == (identity_of(found), kind)
    if found.st_size and not may_replace and not _is_own(target, kind):  # what is empty is no loss
        what = f" and is not {kind.name}" if kind.name else ""
        hint = ", or replace it by --force (force=True)" if kind.may_force else ""
        raise NotReplacedError(f"{path}: is there already{what}; name another file{hint}")
    return target


def _is_own(target: Path, kind: Kind) -> bool:
    try:
        return kind.is_own(target)
    except OSError:  # it may not be read
        return False


def _require_folder(path: Path, folder: Path) -> None:
    if not folder.is_dir():
        reason = "is not a folder" if folder.exists() else "does not exist; make it first"
        raise InputError(f"{path}: the folder {str(folder)!r} {reason}")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"{path}: the folder {str(folder)!r} may not be written to")


@contextlib.contextmanager
def _temporary(target: Path) -> Iterator[tuple[Path, int]]:
    """Within the context, have an empty file beside `target`, locked so that no other process takes it for a leftover.

    Gives its path and a handle. The name is short whatever the target's is, which may be as long as names can be.
    """
    while True:
        path = target.with_name(_temporary_name() + target.suffix)
        # Opened without mkstemp, whose files only their owner may read.
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        try:
            _lock(handle, wait=True)
            if path.exists():  # nobody took it for a leftover before it was locked
                yield path, handle
                return
        finally:
            path.unlink(missing_ok=True)
            os.close(handle)


def _temporary_name() -> str:
    return f".wrt-{_host()}-{os.urandom(4).hex()}.part"


@cache
def _host() -> str:
    """Return a digest of the host's name, 8 characters."""
    return f"{zlib.crc32(os.fsencode(os.uname().nodename)):08x}"


def _lock(handle: int, *, wait: bool) -> bool:
    """Lock an open file; return whether that went well. Not every file system can."""
    import fcntl

    try:
        fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except OSError:
        return False
    return True


def _sweep(folder: Path) -> None:
    """Remove what processes that were killed have left of their writing in a folder, once in this process."""
    if os.fspath(folder) in _swept:
        return
    _swept.add(os.fspath(folder))
    with contextlib.suppress(OSError):
        for found in filter(None, map(_TEMPORARY.fullmatch, os.listdir(folder))):
            with contextlib.suppress(OSError):
                left = folder / found[0]
                handle = os.open(left, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
                try:
                    age = time.time() - os.fstat(handle).st_mtime
                    if (found[1] == _host() or age > _FOREIGN_SECONDS) and _lock(handle, wait=False):
                        _remove(left)
                finally:
                    os.close(handle)
