"""wrt: a progressive, physically based ray tracer for triangle meshes.

`__init__.pyi` lists the public names. Each is imported on first use, so ``import wrt`` stays instant.
"""

from collections.abc import Iterator

from wrt import _above
from wrt._version import __version__ as __version__

_SOURCES: dict[str, str] = {}


def _sources() -> dict[str, str]:
    """Return the module of each public name, read from the stub on first use."""
    if not _SOURCES:
        _SOURCES.update(_exported("__init__.pyi"))
    return _SOURCES


def _exported(file: str) -> Iterator[tuple[str, str]]:
    """Yield the names that a file re-exports as `X as X`, or from a package by `*`, each with its module."""
    import ast
    import pkgutil

    for statement in ast.parse(pkgutil.get_data("wrt", file) or b"").body:
        if isinstance(statement, ast.ImportFrom) and statement.module:
            for each in statement.names:
                if each.name == "*":
                    yield from _exported(statement.module.removeprefix("wrt.").replace(".", "/") + "/__init__.py")
                elif each.asname == each.name:
                    yield each.name, statement.module


def _module(name: str) -> object:
    import importlib

    return importlib.import_module(name)


_above.gradients = lambda: _module("wrt.gradients.renderers")
_above.objects = lambda: _module("wrt.io.objects")
_above.pictures = lambda: _module("wrt.pictures")
_above.scene_files = lambda: _module("wrt.io.toml.writer")
_above.viewer = lambda: _module("wrt.view.notebook")


def __getattr__(name: str) -> object:
    if name == "__all__":
        return sorted(_sources())
    module = None if name.startswith("__") else _sources().get(name)
    if module is None:
        raise AttributeError(f"module 'wrt' has no attribute {name!r}")
    value = globals()[name] = getattr(_module(module), name)
    return value


def __dir__() -> list[str]:
    return sorted(_sources())
