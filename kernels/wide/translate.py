"""The render kernel for sixteen lanes at once, from what Warp makes of the kernel for one.

On CUDA the hardware runs a kernel for 32 threads at a time. On a CPU Warp runs it for one, with numbers that fill a
sixteenth of the processor's registers. So Warp's intermediate code of a render kernel, which is plain C++, is written
anew for sixteen threads (`statements.py`), with paths that end at different times kept together (`paths.py`) and
rays traced side by side (`rays.py`). The kernels themselves know nothing of it, and the film's bits stay the same.
"""

import re
from collections import Counter
from typing import Any

import warp as wp
from warp._src.context import ModuleBuilder

from wrt.kernels.wide.library import LIBRARY
from wrt.kernels.wide.natives import native_function
from wrt.kernels.wide.paths import SampledPixels
from wrt.kernels.wide.statements import Body
from wrt.kernels.wide.types import Types, Unsupported, lines_of

PATH_FUNCTION = "trace_path"
"""What functions are called that follow a path; see `make_trace`."""


def wide_code(kernel: wp.Kernel) -> str:
    """Return C++ of what a render kernel does, for sixteen pixels at a time.

    Its function `render_tile(tile, width, height, ...)`, with the kernel's arguments after these, renders a square of
    the picture's pixels.

    Raises:
        Unsupported: where the kernel does something that is not known for lanes.
    """
    module = kernel.module
    builder = ModuleBuilder(module, module.resolve_options(wp.config), target=None)
    if len(builder.kernels) != 1:
        raise Unsupported(f"{module.name}: {len(builder.kernels)} kernels")
    (built,) = builder.kernels
    functions = list(builder.functions)
    types = Types([*functions, built])
    called = "\n".join(lines_of(built))
    paths = [f for f in functions if f.key.endswith(PATH_FUNCTION) and f"= {f.native_func}(" in called]
    if len(paths) != 1:
        raise Unsupported(f"{module.name}: follows no path")
    (path,) = paths
    out = [LIBRARY]
    out.append(types.declarations([a.type for a in built.adj.args]))
    for function in functions:
        if function is path:
            continue
        if getattr(function, "native_snippet", None):
            out.append(native_function(types, function))
        else:
            out.append(_function(types, function))
    out.append(SampledPixels(types, built, path, {f.key: f.native_func for f in functions}).code)
    return _numbered_anew("".join(out), [f.native_func for f in functions])


def _numbered_anew(code: str, names: list[str]) -> str:
    """Return the code with functions of one name numbered in the order in which they are there.

    Warp numbers them in the order in which a process has made them, whatever for. What one process has compiled
    would then be another one to the next.
    """
    counts: Counter[str] = Counter()
    numbered = {}
    for name in names:
        base = re.sub(r"_\d+$", "", name)
        numbered[name] = f"{base}_{counts[base]}"
        counts[base] += 1

    def anew(identifier: re.Match[str]) -> str:
        before, name, after = identifier.groups()
        return f"{before}{numbered[name]}{after}" if name in numbered else identifier[0]

    return re.sub(r"\b(wide_|steps_|)(\w+_\d+)((?:_of_one|_set_out|_found)?)\b", anew, code)


def _function(types: Types, function: Any) -> str:
    body = Body(types, function)
    results = body.adj.return_var or ()
    if len(results) > 1:
        raise Unsupported(f"{function.key}: several results")
    result = types.wide(results[0].type) if results else "void"

    def argument(a: Any) -> str:
        # Not copied where it stays as it is: a surface of sixteen lanes has 3,000 bytes.
        stays = types.is_shared(a.type) or not body.changes(a.emit())
        return f"const {types.wide(a.type)}& {a.emit()}" if stays else f"{types.wide(a.type)} {a.emit()}"

    arguments = "".join(f"{argument(a)}, " for a in body.adj.args)
    return f"""
static inline {result} wide_{function.native_func}({arguments}const lanes::Mask exec_in) {{
{f"    {result} result_;" if results else ""}
{body.whole()}{"    return result_;" if results else ""}
}}
"""
