"""wrt: a progressive, physically based ray tracer for triangle meshes.

`__init__.pyi` lists the public names. Each is imported on first use, so ``import wrt`` stays instant.
"""

from wrt._version import __version__ as __version__

_SOURCES: dict[str, str] = {}


def _sources() -> dict[str, str]:
    """Return the module of each public name, read from the stub on first use."""
    if not _SOURCES:
        import ast
        import pkgutil

        for statement in ast.parse(pkgutil.get_data("wrt", "__init__.pyi") or b"").body:
            if isinstance(statement, ast.ImportFrom) and statement.module:
                _SOURCES.update((each.name, statement.module) for each in statement.names)
    return _SOURCES


def __getattr__(name: str) -> object:
    if name == "__all__":
        return sorted(_sources())
    module = None if name.startswith("__") else _sources().get(name)
    if module is None:
        raise AttributeError(f"module 'wrt' has no attribute {name!r}")
    import importlib

    value = globals()[name] = getattr(importlib.import_module(module), name)
    return value


def __dir__() -> list[str]:
    return sorted(_sources())
