"""Writing files atomically, without replacing files of others.

Every output of wrt is written by `write_atomically`. Before long work, `require_writable` checks whether its output
may be written. Both follow the same rules for every kind of output:

- A file that this process has read is never replaced.
- Links are followed. Anything but a regular file, such as a device, a pipe or a folder, is refused.
- A write-protected file is never replaced.
- Any other existing file is replaced if wrt wrote it and it is of the same kind as the output (`Kind`), or with
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
from wrt.io.safe_read import Identity, first_line, forget_input, identity_of, is_input

_TEMPORARY = re.compile(r"\.wrt-([0-9a-f]{8})-[0-9a-f]{8}\.part(\..*)?")
"""Names of temporary files, with a digest of the host's name."""

_FOREIGN_SECONDS = 3600.0
"""Age from which on a temporary file of another host counts as left over; its locks may not be visible here."""

_MOST_NAMES = 1000


@dataclass(frozen=True)
class Kind:
    """A kind of output.

    Attributes:
        name: the kind in messages, such as "a checkpoint"; empty if existing files are replaced only with `force`.
        is_own: returns whether wrt wrote a regular file, so that it may be replaced.
        may_force: whether `force` replaces other files too.
    """

    name: str
    is_own: Callable[[Path], bool]
    may_force: bool = True


_written: dict[str, tuple[Identity, Kind]] = {}  # the files that this process has written, by real path
_swept: set[str] = set()  # folders that were searched for leftovers


class NotReplacedError(InputError):
    """An existing file may not be replaced."""


def output_path(path: object, what: str, instead: str = "") -> Path:
    """Return the path of an output, such as "a picture", or raise InputError with some advice if it is not a path."""
    if not isinstance(path, (str, os.PathLike)):
        raise InputError(f"{what} is written to a path, not to {type(path).__name__}{instead}")
    return Path(path)


def require_writable(path: Path, kind: Kind, *, force: bool = False) -> None:
    """Raise InputError unless a file of a kind may be written at `path`; see the rules above."""
    _target(path, kind, force)


def free_path(path: Path, kind: Kind, *, reserved: Collection[Path] = frozenset(), force: bool = False) -> Path:
    """Return the first of `NAME`, `NAME-render`, `NAME-render-2` and so on where a file of a kind may be written.

    Paths in `reserved` are not used.
    """
    for number in range(_MOST_NAMES):
        tried = path if number == 0 else path.with_stem(f"{path.stem}-render{'' if number == 1 else f'-{number}'}")
        try:
            require_writable(tried, kind, force=force)
        except NotReplacedError:
            continue
        if tried not in reserved:
            return tried
    raise NotReplacedError(f"{path}: this and {_MOST_NAMES} similar names are taken; name another file")


def write_atomically(path: Path, write: Callable[[Path], object], kind: Kind, *, force: bool = False) -> None:
    """Write a file atomically: `write` fills an empty temporary file in the same folder, which then replaces `path`.

    Raises:
        InputError: when the file cannot be written, or the rules above forbid it.
    """
    target = _target(path, kind, force)
    try:
        _sweep(target.parent)
        with _temporary(target) as (temporary, handle):
            write(temporary)
            os.fsync(handle)  # otherwise a crash could leave an empty file under the new name
            target = _target(path, kind, force)  # check again: a file may have appeared there
            with contextlib.suppress(OSError):  # there is no old file, or the file system has no modes
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
    """Make a folder, which is removed again after an error in the context, or if it is still empty."""
    import shutil

    try:
        path.mkdir()
    except OSError as error:
        raise InputError(f"{path}: cannot be made: {first_line(error)}") from None
    try:
        yield path
    except BaseException:
        shutil.rmtree(path, ignore_errors=True)
        raise
    with contextlib.suppress(OSError):  # it is not empty
        path.rmdir()


def _target(path: Path, kind: Kind, force: bool) -> Path:
    """Return the real path of a file that may be written; see `require_writable`."""
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
    if found.st_size and not may_replace:  # an empty file is no loss
        with contextlib.suppress(OSError):  # it may be unreadable
            may_replace = kind.is_own(target)
    if found.st_size and not may_replace:
        what = f" and is not {kind.name}" if kind.name else ""
        hint = ", or replace it by --force (force=True)" if kind.may_force else ""
        raise NotReplacedError(f"{path}: already exists{what}; name another file{hint}")
    return target


def _require_folder(path: Path, folder: Path) -> None:
    if not folder.is_dir():
        reason = "is not a folder" if folder.exists() else "does not exist; make it first"
        raise InputError(f"{path}: the folder {str(folder)!r} {reason}")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"{path}: the folder {str(folder)!r} may not be written to")


@contextlib.contextmanager
def _temporary(target: Path) -> Iterator[tuple[Path, int]]:
    """Give the path and file descriptor of an empty file beside the target, removed unless renamed.

    It is locked, so that no other process takes it for a leftover. Its name is short, since a longer form of the
    target's name could exceed the limit of the file system.
    """
    while True:
        path = target.with_name(f".wrt-{_host()}-{os.urandom(4).hex()}.part{target.suffix}")
        # Opened without mkstemp, whose files only their owner may read.
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        try:
            _lock(handle, wait=True)
            if path.exists():  # no other process removed it as a leftover before it was locked
                yield path, handle
                return
        finally:
            path.unlink(missing_ok=True)
            os.close(handle)


@cache
def _host() -> str:
    """Return a digest of the host's name, 8 characters."""
    return f"{zlib.crc32(os.fsencode(os.uname().nodename)):08x}"


def _lock(handle: int, *, wait: bool) -> bool:
    """Lock an open file; return False if that fails, as on file systems without locks."""
    import fcntl

    try:
        fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except OSError:
        return False
    return True


def _sweep(folder: Path) -> None:
    """Remove temporary files that killed processes left in a folder; each folder is searched once."""
    if os.fspath(folder) in _swept:
        return
    _swept.add(os.fspath(folder))
    with contextlib.suppress(OSError):
        for found in filter(None, map(_TEMPORARY.fullmatch, os.listdir(folder))):
            with contextlib.suppress(OSError):
                leftover = folder / found[0]
                handle = os.open(leftover, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
                try:
                    age = time.time() - os.fstat(handle).st_mtime
                    if (found[1] == _host() or age > _FOREIGN_SECONDS) and _lock(handle, wait=False):
                        leftover.unlink(missing_ok=True)
                finally:
                    os.close(handle)
