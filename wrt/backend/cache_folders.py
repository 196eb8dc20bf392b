"""The folders of the kernel cache, and the temporary work folder of a process."""

from __future__ import annotations

import atexit
import contextlib
import errno
import os
import stat
import sys
import threading
import time
import warnings
import zlib
from collections.abc import Iterator
from pathlib import Path

from wrt.errors import is_utf8

ROOM = 32 << 20
"""Free bytes that a folder needs for kernels to be compiled in it: Warp's headers take 5 MB a thread, the code of a
large kernel 4 MB. LLVM ends the process when the disk is full."""

ABANDONED_SECONDS = 3600.0
"""Age from which a file that `put` has begun was left by a killed process."""

_PREFIX = "wrt-work-"
"""Start of the names of work folders."""

_lock = threading.Lock()
_work: tuple[int, Path] | None = None
_locks_of_work: list[int] = []
_warnings_given: set[str] = set()


def user_folder() -> Path:
    """Return the user's cache folder.

    An empty or relative XDG_CACHE_HOME counts as unset (XDG Base Directory Specification). So does such a HOME; the
    home folder then comes from the password database. In a folder that all users share as they do /tmp, each has one.

    Raises:
        FileNotFoundError: when this user has no home folder.
    """
    if os.path.isabs(cache := os.environ.get("XDG_CACHE_HOME", "")):
        return Path(cache, f"uid-{os.getuid()}") if _is_shared(cache) else Path(cache)
    home = os.environ.get("HOME", "")
    if not os.path.isabs(home):
        import pwd

        with contextlib.suppress(KeyError):
            home = pwd.getpwuid(os.getuid()).pw_dir
    if not os.path.isabs(home):
        raise FileNotFoundError(errno.ENOENT, "no home folder is known", "~")
    return Path(home) / ".cache"


def wrt_folder() -> Path:
    """Return the folder of the table of artefacts, requests and precompiled headers.

    It is inside the work folder if the user has no home, or if others can write to the usual folder.
    """
    try:
        return _trusted(user_folder() / "wrt", "wrt")
    except FileNotFoundError:
        return work_folder() / "wrt"


def warp_folder() -> Path:
    """Return the folder of Warp's compiled kernels, which has a subfolder for each version of Warp.

    It is inside the work folder if others can write to the usual folder.

    Raises:
        FileNotFoundError: see `user_folder`.
    """
    return _trusted(Path(os.environ.get("WARP_CACHE_PATH") or user_folder() / "warp"), "warp")


def make_private(folder: Path) -> None:
    """Create a folder of the cache, and those above it, for this user alone whatever the umask, where they are missing.

    Raises:
        OSError: if it cannot be created.
    """
    for missing in (*(each for each in reversed(folder.parents) if not each.exists()), folder):
        missing.mkdir(mode=0o700, exist_ok=True)


def is_private(folder: Path) -> bool:
    """Return whether only this user and root can replace what is in a folder."""
    try:
        return not _why_untrusted(folder.absolute())
    except OSError:
        return False


def _is_shared(folder: str) -> bool:
    with contextlib.suppress(OSError):
        mode = os.stat(folder).st_mode
        return bool(mode & stat.S_ISVTX and mode & stat.S_IWOTH)
    return False


def _trusted(folder: Path, name: str) -> Path:
    """Return a folder of the cache, or one in the work folder if others could put machine code into it."""
    try:
        why = _why_untrusted(folder.absolute())
    except OSError:  # it cannot be searched; writing to it will say so
        return folder
    if not why:
        return folder
    warn_once(f"{folder}: not used as a cache of machine code: {why}; {_kept_for_now()}")
    return work_folder() / name


def _why_untrusted(folder: Path) -> str:
    """Return why a folder must not be used: who else could replace it or what is in it, or a path that is not UTF-8.

    Return "" if it may be. As with sshd's StrictModes, the folder and each above it must belong to the user or to root,
    and others must not be able to write to it, unless it is sticky as /tmp is: there they cannot replace the user's
    files. What lies in a folder that others cannot search is out of their reach.
    """
    resolved = Path(os.path.realpath(folder))
    if not is_utf8(folder) or not is_utf8(resolved):
        return "its path is not UTF-8, which the compiler needs"
    why = ""
    for place in (resolved, *resolved.parents):
        try:
            status = place.stat()
        except FileNotFoundError:  # it will be created, by this user
            continue
        if status.st_uid not in (0, os.getuid()):
            return f"{place} belongs to another user (uid {status.st_uid})"
        if not _others_may(status, stat.S_IXGRP, stat.S_IXOTH):
            why = ""
        elif _others_may(status, stat.S_IWGRP, stat.S_IWOTH) and (
            place == resolved or not status.st_mode & stat.S_ISVTX
        ):
            why = why or f"others can write to {place}"
    return why


def _others_may(status: os.stat_result, of_group: int, of_others: int) -> bool:
    """Return whether a mode gives a permission to others than this user and root."""
    return bool(status.st_mode & of_others or (status.st_mode & of_group and not _is_private(status.st_gid)))


def _is_private(group: int) -> bool:
    """Return whether a group is root's, or a group of this user alone, as many systems make."""
    import grp
    import pwd

    if group == 0:
        return True
    with contextlib.suppress(KeyError):
        user, found = pwd.getpwuid(os.getuid()), grp.getgrgid(group)
        return group == user.pw_gid and found.gr_name == user.pw_name and set(found.gr_mem) <= {user.pw_name}
    return False


def kernels_folder() -> Path:
    """Return Warp's folder of compiled kernels, without its version, as this process has set it.

    Raises:
        FileNotFoundError: see `user_folder`.
    """
    warp = sys.modules.get("warp")
    folder = warp and warp.config.kernel_cache_dir
    return Path(folder).parent if folder else warp_folder()  # Warp adds its version to the path


def choose_warp_folder() -> None:
    """Set Warp's kernel cache folder before Warp starts; use the work folder if the usual one cannot be created."""
    import warp as wp
    from warp._src import context

    if context.runtime is not None:
        return  # Warp has started and has its folder
    folder = Path("~")
    try:
        folder = Path(wp.config.kernel_cache_dir or warp_folder())
        make_private(folder)
        (folder / wp.config.version).mkdir(exist_ok=True)
    except OSError as error:
        say_unwritable(folder, error)
        folder = work_folder() / "warp"
    wp.config.kernel_cache_dir = str(folder)


def say_unwritable(folder: Path, error: OSError) -> None:
    """Warn, once for each folder, that compiled kernels will not outlive this process."""
    warn_once(f"{folder}: cannot be written: {error.strerror or error}; {_kept_for_now()}")


def _kept_for_now() -> str:
    return f"compiled kernels are kept in {work_folder()} until this process ends"


def warn_once(text: str) -> None:
    """Give a warning, unless this process has given it before."""
    if text not in _warnings_given:
        _warnings_given.add(text)
        warnings.warn(text, stacklevel=3)


def require_writable(folder: Path) -> None:
    """Create a folder, and raise OSError unless it can be written to and has room for a kernel."""
    make_private(folder.parent)
    folder.mkdir(exist_ok=True)
    _require_room(folder, ROOM // 4)
    put(probe := folder / ".probe", b"")
    probe.unlink(missing_ok=True)


def _require_room(folder: Path, size: int) -> None:
    found = os.statvfs(folder)
    if found.f_bavail * found.f_frsize < size:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(folder))


def put(path: Path, data: bytes) -> None:
    """Write a file atomically: after an error it is unchanged.

    Raises:
        OSError: when it cannot be written.
    """
    temporary = path.with_name(f".{os.urandom(8).hex()}")
    try:
        temporary.write_bytes(data)
        temporary.replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise


def digest(data: bytes) -> bytes:
    """Return a checksum of 16 characters, the same in every version of Python."""
    # Importing hashlib takes longer than reading the cache.
    return b"%08x%08x" % (zlib.crc32(data), len(data) & 0xFFFFFFFF)


def write_checked(path: Path, data: bytes) -> None:
    """Write a file atomically, after a line with its digest.

    Raises:
        OSError: when it cannot be written.
    """
    put(path, digest(data) + b"\n" + data)


def read_checked(path: Path) -> bytes | None:
    """Return the data that `write_checked` wrote; None if the file is damaged.

    Raises:
        OSError: when it cannot be read.
    """
    checksum, _, data = path.read_bytes().partition(b"\n")
    return data if checksum == digest(data) else None


def keep_latest(folder: Path, pattern: str, count: int) -> None:
    """Remove files and folders that match a pattern, except the `count` most recent."""
    found = sorted(folder.glob(pattern), key=lambda path: path.stat().st_mtime)
    for path in found[:-count]:
        _remove_any(path)


@contextlib.contextmanager
def locked(folder: Path, *, seconds: float) -> Iterator[bool]:
    """Within the context, hold an exclusive lock on a folder, if its file system has locks.

    Yields False if another process still held the lock after these seconds.
    """
    try:
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError:
        yield True
        return
    try:
        until = time.monotonic() + seconds
        while not (is_free := _lock_open(handle)) and time.monotonic() < until:
            time.sleep(0.005)
        yield is_free
    finally:
        os.close(handle)


def _lock_open(handle: int) -> bool:
    """Lock an open folder; return False if another process holds the lock."""
    import fcntl

    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        pass
    return True


def work_folder() -> Path:
    """Return this process's temporary folder, readable by its user alone; it is removed when the process ends.

    Raises:
        OSError: when no folder has room for it.
    """
    global _work
    with _lock:
        if _work is None or _work[0] != os.getpid():
            _work = os.getpid(), _make_work_folder()
            atexit.register(_remove, *_work)
        return _work[1]


def _make_work_folder() -> Path:
    import tempfile

    while True:
        folder = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=_place_with_room()))
        try:
            handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        except FileNotFoundError:  # another process removed it as a leftover before it was locked
            continue
        # The lock shows that this process is alive; process ids would not, as they differ between containers.
        if _lock_open(handle) and folder.is_dir():  # else another process is removing it as a leftover
            _locks_of_work.append(handle)
            return folder
        os.close(handle)


def _places() -> list[str]:
    """Return folders for temporary files, the best first."""
    temporary = os.environ.get("TMPDIR", "")
    usual = ["/tmp", "/var/tmp", "/dev/shm"]
    return [temporary, *usual] if os.path.isabs(temporary) and is_utf8(temporary) else usual


def _place_with_room() -> str:
    for place in _places():
        with contextlib.suppress(OSError):
            _require_room(Path(place), ROOM)
            if os.access(place, os.W_OK | os.X_OK):
                return place
    places = " or ".join(_places())
    raise OSError(errno.ENOSPC, f"compiling kernels takes {ROOM >> 20} MB of disk space in {places}; none has room")


def _remove(process: int, folder: Path) -> None:
    if os.getpid() == process:  # not in a fork
        _remove_any(folder)


def remove_leftovers(*folders: Path) -> None:
    """Remove unfinished files and work folders of processes that no longer run.

    Args:
        folders: folders of the cache; those for temporary files are always searched.
    """
    for folder in folders:
        for path in folder.glob(".*"):
            with contextlib.suppress(OSError):
                if time.time() - path.stat().st_mtime > ABANDONED_SECONDS:
                    path.unlink()
    for place in {*_places()}:
        for path in Path(place).glob(f"{_PREFIX}*"):
            _remove_unless_in_use(path)


def _remove_any(path: Path) -> None:
    import shutil

    with contextlib.suppress(OSError):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


def _remove_unless_in_use(folder: Path) -> None:
    import fcntl
    import shutil

    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC | os.O_NOFOLLOW)
        try:
            if os.fstat(handle).st_uid == os.getuid():
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder, ignore_errors=True)
        finally:
            os.close(handle)
