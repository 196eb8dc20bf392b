"""Archives, compressed files, bytes and open files, which become files in a temporary folder while they are read.

Only files within that folder are read, and together they count as the archive where `memory_limits` compares memory
with the size of files. Formats: PKWARE, "APPNOTE.TXT - .ZIP File Format Specification"; RFC 1952 (gzip); bzip2; xz.
"""

from __future__ import annotations

import contextlib
import functools
import importlib
import io
import os
import re
import stat
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path, PurePosixPath
from typing import IO, Any, Concatenate, ParamSpec, TypeVar

from wrt.errors import InputError, did_you_mean, shown_as
from wrt.io import memory_limits
from wrt.io.file_type import renderable
from wrt.io.mesh.parts import as_specified
from wrt.io.safe_read import UNPACKED, PathLike, Unpacked, confined_to, naming_file, read_file

P = ParamSpec("P")
T = TypeVar("T")

ZIPS = (".zip", ".zae")
COMPRESSED = {".gz": "gzip", ".bz2": "bz2", ".xz": "lzma"}
"""Suffixes of compressed files, and the modules that open them."""

ARCHIVE_SUFFIXES = (*ZIPS, *COMPRESSED)

MOST_FILES = 10_000
"""Maximum number of files in an archive."""

_CHUNK = 1 << 20
_XZ_MEMORY = 1 << 27  # bytes for decompressing: xz -9 needs 65 MB
_METHODS = (0, 8)  # stored and deflated; with the others zipfile unpacks a whole block at once

_TYPE = re.compile(r"\.?(\w+(\.\w+)?)")
_SEVERAL = 5  # files that a message names


@contextlib.contextmanager
def unpacked(source: Any, file_type: str | None = None) -> Iterator[Any]:
    """Within the context, have an archive, bytes or an open file as a file; other sources are yielded unchanged.

    Args:
        source: any source of `wrt.load`. `model.zip/part.obj` is a file in an archive.
        file_type: the type of bytes or of an open file, such as "glb"; by default the suffix of its name.

    Raises:
        InputError: if it cannot be unpacked, has no type, or holds no or several files that can be rendered.
    """
    path, inner, data = _divided(source, file_type)
    if path is None:
        yield source
        return
    import tempfile

    with tempfile.TemporaryDirectory(prefix="wrt-unpacked-") as name:
        folder = Path(os.path.realpath(name))
        file = folder / (path.stem if path.suffix.lower() in COMPRESSED else path.name)
        with shown_as(file, path), shown_as(folder, path):
            with memory_limits.one_load(), naming_file(path):
                data = read_file(path) if data is None else memory_limits.counted(data)
                if path.suffix.lower() in ZIPS:
                    _unzip(path, data, folder)
                    file = _chosen(path, folder, inner)
                elif path.suffix.lower() in COMPRESSED:
                    _decompress(path, data, file)
                else:
                    file.write_bytes(data)
            token = UNPACKED.set(Unpacked(str(folder), len(data)))
            del data
            try:
                with confined_to(folder, leniently=True):
                    yield file
            finally:
                UNPACKED.reset(token)


def unpacking(read: Callable[Concatenate[PathLike, P], T]) -> Callable[Concatenate[PathLike, P], T]:
    """Make a function that reads a file read archives, too."""

    @functools.wraps(read)
    def wrapped(path: PathLike, /, *args: P.args, **options: P.kwargs) -> T:
        with unpacked(path) as file:
            return read(file, *args, **options)

    return wrapped


def _divided(source: Any, file_type: str | None) -> tuple[Path | None, str, bytes | None]:
    """Return the path of an archive and of a file in it, or a name and the content of bytes; None for other sources."""
    if isinstance(source, (str, os.PathLike)):
        if file_type is not None:
            raise InputError(f"{source}: a file type is for bytes and open files; a path has its suffix")
        path = Path(source)
        for archive in (path, *path.parents):
            if archive.suffix.lower() in ARCHIVE_SUFFIXES and archive.is_file():
                return archive, str(path.relative_to(archive)) if archive != path else "", None
        return None, "", None
    read = getattr(source, "read", None)
    if not callable(read) and not isinstance(source, (bytes, bytearray, memoryview)):
        if file_type is not None:
            raise InputError(f"{type(source).__name__}: a file type is for bytes and open files")
        return None, "", None
    data, name = read() if callable(read) else bytes(source), getattr(source, "name", None)
    if not isinstance(data, bytes):
        raise InputError("an open file must be opened for reading bytes: open(path, 'rb')")
    found = _TYPE.fullmatch(str(file_type or ""))
    if file_type is not None and not found:
        raise InputError(f"file_type must be the suffix of such files, such as 'glb', not {file_type!r}")
    path = Path(f"data.{found[1]}" if found else Path(name).name if isinstance(name, str) else "")
    if not path.suffix:
        raise InputError("bytes and open files without a name need their type, such as file_type='glb'")
    return path, "", data


def _unzip(path: Path, data: bytes, folder: Path) -> None:
    """Unpack a ZIP archive; sizes are counted while unpacking, since headers may promise less."""
    import zipfile

    with (
        as_specified(path, "ZIP", zipfile.BadZipFile, zlib.error, OSError),
        zipfile.ZipFile(io.BytesIO(data)) as archive,
    ):
        entries = [entry for entry in archive.infolist() if not entry.is_dir()]
        if len(entries) > MOST_FILES:
            raise InputError(f"{path}: it has {len(entries)} files; the limit is {MOST_FILES}")
        for entry in entries:
            name = entry.filename.replace("\\", "/")
            parts = PurePosixPath(name).parts
            if name.startswith("/") or ".." in parts or ":" in parts[0]:
                raise InputError(f"{path}: {name!r} in it leads out of the archive")
            if stat.S_ISLNK(entry.external_attr >> 16):
                raise InputError(f"{path}: {name!r} in it is a link, which is not followed")
            if entry.flag_bits & 1:
                raise InputError(f"{path}: it is encrypted; unpack it with its password")
            if entry.compress_type not in _METHODS:
                raise InputError(f"{path}: {name!r} in it is compressed in a way that is not read; unpack it first")
            target = folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            with archive.open(entry) as stream, open(target, "xb") as file:
                _copy(stream, file)


def _decompress(path: Path, data: bytes, target: Path) -> None:
    module = importlib.import_module(COMPRESSED[path.suffix.lower()])
    damages = OSError, zlib.error, getattr(module, "LZMAError", OSError)
    with as_specified(path, "compressed", *damages), open(target, "xb") as file:
        if path.suffix.lower() == ".xz":
            _decompress_xz(module.LZMADecompressor(memlimit=_XZ_MEMORY), data, file)
        else:
            with module.open(io.BytesIO(data)) as stream:
                _copy(stream, file)
    _refuse_nested(path, target)


def _decompress_xz(decoder: Any, data: bytes, file: IO[bytes]) -> None:
    """Decompress one stream by a decoder with a memory limit, which the `open` of `lzma` does not have."""
    while not decoder.eof:
        chunk = decoder.decompress(data if decoder.needs_input else b"", _CHUNK)
        if not chunk and decoder.needs_input and not decoder.eof:
            raise EOFError("it ends early")
        data = b""
        memory_limits.take(memory_limits.UNPACKED, len(chunk))
        file.write(chunk)
    if decoder.unused_data.strip(b"\0"):
        raise OSError("there is something behind its first stream")


def _copy(stream: IO[bytes], file: IO[bytes]) -> None:
    """Copy a stream to a file, as far as the memory limit of unpacked files allows."""
    while chunk := stream.read(_CHUNK):
        memory_limits.take(memory_limits.UNPACKED, len(chunk))
        file.write(chunk)


def _refuse_nested(path: Path, file: Path) -> None:
    if file.suffix.lower() in (*ARCHIVE_SUFFIXES, ".tar", ".tgz"):
        raise InputError(f"{path}: {file.name!r} in it is an archive, too; unpack it first")


def _chosen(path: Path, folder: Path, inner: str) -> Path:
    """Return the file of a path within an archive, or the only file that can be rendered."""
    scenes, meshes = renderable(folder, folder.rglob("*"))
    found = scenes or meshes  # a scene names its meshes
    if inner:
        file = folder / inner
        if not Path(os.path.realpath(file)).is_relative_to(folder) or not file.is_file():
            raise InputError(f"{path}: there is no file {inner!r} in it{did_you_mean(inner, found)}")
        _refuse_nested(path, file)
        return file
    if len(found) == 1:
        return folder / found[0]
    if not found:
        names = sorted(str(each.relative_to(folder)) for each in folder.rglob("*") if each.is_file())
        raise InputError(f"{path}: nothing in it can be rendered; it holds {first_of(names) or 'no files'}")
    raise InputError(f"{path}: name one of the {len(found)} files in it, such as {path}/{found[0]}: {first_of(found)}")


def first_of(names: list[str]) -> str:
    """Return the first few names for a message."""
    return ", ".join(names[:_SEVERAL]) + (f" and {len(names) - _SEVERAL} more" if len(names) > _SEVERAL else "")
