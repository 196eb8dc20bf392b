"""Python files that register models, loaded on purpose: by `wrt.load_models` and by `--with`."""

from __future__ import annotations

import sys
import traceback
from pathlib import Path
from types import ModuleType
from typing import Any

from wrt.errors import InputError
from wrt.io.safe_read import PathLike, read_file
from wrt.scene.camera import CAMERAS
from wrt.scene.exact.distances import SHAPES
from wrt.scene.integrators import INTEGRATORS
from wrt.scene.lights import LIGHTS
from wrt.scene.materials import MATERIALS
from wrt.scene.procedural import TEXTURES


def load_models(path: PathLike) -> list[str]:
    """Run a Python file that registers models, and return their types in scene files.

    It runs as any program does, with all that it may read and write: load only files that you trust. While it runs, it
    can import what lies beside it.

    Args:
        path: the file.

    Raises:
        InputError: if it cannot be read, is no Python, fails, or registers nothing; the message names file and line.
    """
    file = Path(path)
    name = file.stem
    if file.suffix != ".py" or not name.isidentifier():
        raise InputError(f"{file}: models are in a Python file whose name is an identifier, such as my_models.py")
    source = read_file(file)
    present = sys.modules.get(name)
    if present is not None and Path(getattr(present, "__file__", None) or "").resolve() != file.resolve():
        raise InputError(f"{file}: Python has another module {name!r}; give the file another name")
    before = _registered()
    module = sys.modules[name] = ModuleType(name)
    module.__file__ = str(file.resolve())
    sys.path.insert(0, str(file.resolve().parent))
    try:
        code = compile(source, str(file.resolve()), "exec", dont_inherit=True)  # not with this file's annotations
        exec(code, module.__dict__)  # it is why the file was given
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise InputError(f"{file}{_where(error, file)}") from error
    finally:
        sys.path.remove(str(file.resolve().parent))
    after = _registered()
    if added := [type_name for key, type_name in after.items() if key not in before]:
        return added
    del sys.modules[name]
    calls = "wrt.register_material, _texture, _light, _camera, _shape or _integrator"
    raise InputError(f"{file}: registers nothing; it should call {calls}")


def _registered() -> dict[int, str]:
    """Return the types of all registered classes, by the identity of the class."""
    registers: tuple[dict[str, Any], ...] = (MATERIALS, TEXTURES, LIGHTS, CAMERAS, SHAPES, INTEGRATORS)
    return {id(cls): name for register in registers for name, cls in register.items()}


def _where(error: BaseException, file: Path) -> str:
    """Return the line of a file that an exception comes from, and its message."""
    if isinstance(error, SyntaxError):
        return f", line {error.lineno}: {error.msg}"
    lines = [each.lineno for each in traceback.extract_tb(error.__traceback__) if each.filename == str(file.resolve())]
    kind = "" if isinstance(error, InputError) else f"{type(error).__name__}: "
    return f"{f', line {lines[-1]}' if lines else ''}: {kind}{error}"
