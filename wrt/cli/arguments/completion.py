"""Shell completion by argcomplete: commands, options, choices, built-in scenes, and files by suffix."""

from __future__ import annotations

import argparse
import contextlib
import importlib
import os
from collections.abc import Callable, Iterable

from wrt.cli.arguments.parser import commands_of

PICTURES = (".png", ".jpg", ".jpeg", ".exr", ".npy")


def shell_code(shell: str) -> str:
    """Return the shell code that sets up completion of wrt's arguments."""
    import argcomplete

    return str(argcomplete.shellcode(["wrt"], use_defaults=False, shell=shell)).strip("\n")


Finder = Callable[[str], Iterable[str]]
"""Returns the words that may complete a prefix; the others are left out afterwards."""


def complete(parser: argparse.ArgumentParser) -> None:
    """Print the completions that the shell asks for, and end the process."""
    import argcomplete

    for command in commands_of(parser).values():
        for action in command._actions:
            find = _FINDERS.get(action.dest) or _FINDERS.get(str(action.metavar))
            if find is not None:
                action.completer = _finding(find)  # type: ignore[attr-defined]
    argcomplete.autocomplete(parser, always_complete_options=False, default_completer=_finding(lambda prefix: ()))


def _finding(find: Finder) -> Callable[..., list[str]]:
    """Wrap a finder in the signature that argcomplete calls."""

    def completer(prefix: str, **_: object) -> list[str]:
        return [word for word in find(prefix) if word.startswith(prefix)]

    return completer


def _files(prefix: str, suffixes: Iterable[str] | None = None) -> list[str]:
    """Return the folders and files that start with `prefix`, files only with one of the suffixes, if given."""
    folder, begin = os.path.split(prefix)
    found = []
    with contextlib.suppress(OSError), os.scandir(os.path.expanduser(folder) or ".") as entries:
        for entry in entries:
            if not entry.name.startswith(begin) or (entry.name.startswith(".") and not begin):
                continue
            path = os.path.join(folder, entry.name)
            if entry.is_dir():
                found.append(f"{path}/")
            elif suffixes is None or os.path.splitext(entry.name)[1].lower() in suffixes:
                found.append(path)
    return sorted(found)


def _inputs(prefix: str) -> list[str]:
    from wrt.io.archives import ARCHIVE_SUFFIXES
    from wrt.io.file_type import MESH_SUFFIXES
    from wrt.meshes import scene_names

    return [*scene_names(), *_files(prefix, (*MESH_SUFFIXES, *ARCHIVE_SUFFIXES, ".toml", ".xml"))]


def _names(module: str, table: str) -> Finder:
    """Return a finder of the names in a table, whose module is imported only when needed."""
    return lambda prefix: getattr(importlib.import_module(module), table)


def _layers(prefix: str) -> Iterable[str]:
    """Return the completions of a comma-separated list of layers."""
    from wrt.scene.layers import GROUPS, SELECTABLE

    before, comma, _ = prefix.rpartition(",")
    return [f"{before}{comma}{name}" for name in (*SELECTABLE, *GROUPS) if name not in before.split(",")]


_FINDERS: dict[str, Finder] = {
    "INPUT": _inputs,
    "SCENE": _inputs,
    "OUT": lambda prefix: _files(prefix, PICTURES),
    "OUT.toml": lambda prefix: _files(prefix, (".toml",)),
    "checkpoint": _files,
    "device": lambda prefix: ("cpu", "cuda", "cuda:0"),
    "sampler": _names("wrt.scene.scene", "SAMPLERS"),
    "integrator": _names("wrt.scene.integrators", "INTEGRATORS"),
    "layers": _layers,
    "size": _names("wrt.cli.arguments.types", "PICTURES"),
    "name": _names("wrt.scene.materials", "MATERIALS"),
}
"""Finders by the name of an argument, or by what it stands for in the help."""
