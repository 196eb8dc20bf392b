"""The process in which Pixar's library reads a USD file. It sends a plain description for the readers beside it.

A layer names other files, which composing opens, and a few references can multiply prims without end. So each layer is
checked before the library opens it; before they are composed, the process gives up opening files at all; and its memory
is limited relative to the size of the files. The library does not ask before it takes memory: the process ends then.
"""

from __future__ import annotations

import contextlib
import os
import resource
import sys
from pathlib import Path
from typing import Any

from pxr import Ar, Sdf, Tf, Usd, UsdUtils, Work

from wrt.errors import InputError
from wrt.io import memory_limits
from wrt.io.safe_read import confined_to, require_file, require_inside
from wrt.io.usd.prims import Description, beside, outer
from wrt.io.usd.process import SECONDS, SECONDS_PER_MEGABYTE, write_message

_SUFFIXES = ("usd", "usda", "usdc", "usdz")

_THREADS = 4
"""Threads of Pixar's library at most. The stacks of more, 6 MB each, would count as memory of prims."""


def main() -> None:
    """Read the file `sys.argv[1]` and send what it holds.

    Reading is confined to the folder `sys.argv[2]` unless that is empty; `sys.argv[3]` is the time, seconds, or empty.
    """
    path, folder = Path(sys.argv[1]), Path(sys.argv[2]) if sys.argv[2] else None
    seconds = float(sys.argv[3]) if sys.argv[3] else None
    result = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what the library prints
    _limit(resource.RLIMIT_CORE, 0)
    _limit(resource.RLIMIT_FSIZE, 0)
    arrays: list[memoryview[Any]] = []
    content: dict[str, Any]
    try:
        with confined_to(folder), memory_limits.one_load():
            content = _content(path, seconds, arrays)
    except InputError as error:
        content, arrays = {"error": str(error)}, []
    except UnicodeDecodeError:
        content, arrays = {"error": f"{path}: not a USD file that can be read: a name in it is not UTF-8"}, []
    write_message(result, content, arrays)
    os._exit(0)  # without taking the stage apart


def _content(path: Path, seconds: float | None, arrays: list[memoryview[Any]]) -> dict[str, Any]:
    Work.SetConcurrencyLimit(min(_THREADS, Work.GetConcurrencyLimit()))
    notes = UsdUtils.CoalescingDiagnosticDelegate()  # or they are printed
    Usd.SchemaRegistry()  # reads files of the library
    bounds = _Bounds()
    try:
        with Ar.ResolverScopedCache():  # keeps archives open
            layers, files = _layers(path, bounds)
            _limit(resource.RLIMIT_NOFILE, 0)
            stage = Usd.Stage.Open(layers[0], Usd.Stage.LoadAll)
            bounds.set(2 * memory_limits.most(memory_limits.MESHES))  # arrays as they are stored, and unpacked
            content = Description(stage, layers, arrays, seconds).content
    except Tf.ErrorException as error:
        raise _unreadable(path, error) from None
    messages = [str(note.commentary) for note in notes.TakeUncoalescedDiagnostics()]
    return {**content, "files": files, "notes": messages}


def _unreadable(path: Path, error: Any) -> InputError:
    reason = str(error.args[0].commentary)
    if "bad_alloc" in reason:
        raise MemoryError
    reason = reason.replace(f"@{path.absolute()}@", "").replace(str(path.absolute()), path.name)
    return InputError(f"{path}: not a USD file that can be read: {' '.join(reason.split())}")


# Limits --------------------------------------------------------------------------------------------


def _limit(what: int, most: int) -> None:
    hard = resource.getrlimit(what)[1]
    resource.setrlimit(what, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


class _Bounds:
    """The memory and the time that the process may take, by the size of the files that it has been given so far."""

    def __init__(self) -> None:
        self._start: int | None = None
        with contextlib.suppress(FileNotFoundError):  # there is no /proc on macOS
            self._start = int(Path("/proc/self/statm").read_text().split()[5]) * resource.getpagesize()

    def set(self, arrays: int = 0) -> None:
        """Set the limits; `arrays` are the bytes beside those of layers and prims."""
        _limit(resource.RLIMIT_CPU, SECONDS + SECONDS_PER_MEGABYTE * (memory_limits.size_of_files() >> 20))
        if self._start is not None:
            _limit(resource.RLIMIT_DATA, self._start + memory_limits.most(memory_limits.COMPOSED) + arrays)


# Layers --------------------------------------------------------------------------------------------


def _layers(path: Path, bounds: _Bounds) -> tuple[list[Any], list[str]]:
    """Return the layers that a file may be composed of, its own first, and their files.

    Layers that cannot be opened are missing.
    """
    require_file(path)
    bounds.set()
    root = Sdf.Layer.FindOrOpen(str(path.absolute()))
    if not root:
        raise InputError(f"{path}: not a USD file that can be read: Pixar's library finds no layer in it")
    layers, files = {root.identifier: root}, [str(path)]
    waiting = [root]
    while waiting:
        layer = waiting.pop()
        for asset in layer.GetCompositionAssetDependencies():
            found = _checked(layer, _evaluated(asset, root, layer))
            if found is None or found[0] in layers:
                continue
            files.append(found[1])
            bounds.set()
            with contextlib.suppress(Tf.ErrorException):  # composing will tell
                opened = Sdf.Layer.FindOrOpen(found[0])
                if opened:
                    layers[found[0]] = opened
                    waiting.append(opened)
    return list(layers.values()), files


def _evaluated(asset: str, root: Any, layer: Any) -> str:
    """Return the path that an expression in a path's place gives; most are none."""
    if not Sdf.VariableExpression.IsExpression(asset):
        return asset
    variables = {**layer.expressionVariables, **root.expressionVariables}
    return str(Sdf.VariableExpression(asset).Evaluate(variables).value or "")


def _checked(layer: Any, asset: str) -> tuple[str, str] | None:
    """Return the identifier and the file of a layer that another names, or None if Pixar's library cannot open it.

    Raises:
        InputError: if the file is none that may be read; `confined_to` raises another.
    """
    if not asset:
        return None
    identifier = str(Sdf.ComputeAssetPathRelativeToLayer(layer, asset))
    name = str(Sdf.Layer.SplitIdentifier(identifier)[0])
    require_inside(Path(beside(layer, outer(name))))  # before its existence makes any difference
    found = str(Ar.GetResolver().Resolve(name))
    if not found or Sdf.FileFormat.GetFileExtension(found).lower() not in _SUFFIXES:
        return None
    require_file(Path(outer(found)))
    return identifier, outer(found)
