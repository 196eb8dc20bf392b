"""The compiler's driver: from Warp's C++ of a render kernel to C++ for several lanes; see docs/spmd.md.

On CUDA the hardware runs a kernel for 32 threads at a time. On a CPU Warp runs it for one, whose numbers fill a
fraction of a register. So Warp's C++ of a render kernel is parsed (`parse.py`), cut where paths wait for rays
(`rounds.py`) and emitted for several lanes (`emit.py`); the film's bits stay the same.
"""

import re
from collections import Counter
from dataclasses import replace

import warp as wp
from warp._src.context import ModuleBuilder

from wrt.kernels.native import headers_of, included_by
from wrt.spmd.adjoints import Adjoints
from wrt.spmd.analysis import changes, returns_once
from wrt.spmd.emit import Emitter
from wrt.spmd.ir import Function, Module, Unsupported, Variable, calls
from wrt.spmd.library import library, native_function
from wrt.spmd.parse import parse
from wrt.spmd.pixel_object import pixel_object
from wrt.spmd.stages import without_stages
from wrt.spmd.types import Types, name_of, structs_in


def wide_code(kernel: wp.Kernel, lanes: int) -> str:
    """Return the C++ of a render kernel for 4, 8 or 16 lanes.

    Its function `render_tile(tile, width, height, ...)`, followed by the kernel's arguments, renders a square tile of
    the picture.

    Raises:
        Unsupported: The kernel uses something that the translator does not support.
    """
    module = kernel.module
    builder = ModuleBuilder(module, module.resolve_options(wp.config), target=None)
    if len(builder.kernels) != 1:
        raise Unsupported(f"{module.name}: {len(builder.kernels)} kernels")
    if not any({"path_function", "traces_alone"} & set(getattr(f.func, "spmd_marks", ())) for f in builder.functions):
        raise Unsupported(f"{module.name}: follows no path")
    # Adjoints written by hand are part of every module, and nothing here calls them.
    of_module = [f for f in builder.functions if not f.adj.custom_reverse_mode]
    built = [*of_module, *builder.kernels]
    structs, elements = structs_in(v.type for f in built for v in (*f.adj.args, *f.adj.variables))
    by_name = {name_of(s): s for s in structs}
    *functions, pixels = [parse(f, by_name) for f in built]
    if "pixel_kernel" not in pixels.marks:
        raise Unsupported(f"{pixels.key}: is not marked with @pixel_kernel")
    code = Module(functions)
    called = set(calls(pixels.body))
    paths = code.marked("path_function") & called or code.marked("traces_alone") & called
    if len(paths) != 1:
        raise Unsupported(f"{module.name}: follows no path")
    (path,) = paths
    in_rounds = "path_function" in code.functions[path].marks
    if not in_rounds:  # stages that return early are called
        functions = [f if returns_once(f) else replace(f, marks=f.marks - {"inline_stage"}) for f in functions]
        code = Module(functions)
    types = Types([*functions, pixels], structs, elements)
    headers = {n for f in builder.functions for header in included_by(f) for n in headers_of(header)}
    kinds = ("exact/with_boxes.h", "exact/with_quadrics.h", "exact/with_spheres.h")
    exact = next((header for header in kinds if header in headers), "")
    gradients = {name.removeprefix("grad_") for f in functions for name in calls(f.body) if name.startswith("grad_")}
    out = [library(lanes, exact=exact, adjoints=bool(gradients))]
    out.append(types.declarations([a.type for a in pixels.arguments]))
    adjoints = Adjoints(types, builder.functions, by_name)
    out += [f"{adjoints.declaration(name)};\n" for name in sorted(gradients)]
    code.functions |= {
        f.name: without_stages(f, code, splits_all=in_rounds)
        for f in functions
        if f.name == path or not (in_rounds or _is_stage(f))
    }
    called = {name for f in (*code.functions.values(), pixels) if not _is_stage(f) for name in calls(f.body)}
    for of_warp, f in zip(of_module, code.functions.values(), strict=True):
        if (f.name == path and in_rounds) or (_is_stage(f) and f.name not in called):
            continue
        native = getattr(of_warp, "native_snippet", None)
        out.append(native_function(types, of_warp) if native else _function(types, f))
    if gradients:
        out.append(adjoints.code(gradients))
    out.append(pixel_object(types, pixels, code.functions[path], code))
    # Whether they take such arguments is up to clang.
    if missing := set(re.findall(r"\blanes::(\w+)\(", "".join(out[1:]))) - set(re.findall(r"\w+", out[0])):
        raise Unsupported(f"{module.name}: calls {', '.join(sorted(missing))}, which kernels/native/lanes lacks")
    return _renumbered("".join(out), [f.name for f in functions])


def _is_stage(function: Function) -> bool:
    return "inline_stage" in function.marks


def _function(types: Types, function: Function) -> str:
    """Return a function for several lanes, where `exec_in` are active."""
    result = types.wide(function.result) if function.result is not None else "void"

    def argument(a: Variable) -> str:
        # Arguments that do not change are not copied: a surface of sixteen lanes has 3,000 bytes.
        stays = types.is_shared(a.type) or not changes(function.body, a)
        return f"const {types.wide(a.type)}& {a.name}" if stays else f"{types.wide(a.type)} {a.name}"

    arguments = "".join(f"{argument(a)}, " for a in function.arguments)
    has_result = result != "void"
    return f"""
static inline {result} wide_{function.name}({arguments}const lanes::Mask exec_in) {{
{f"    {result} result_;" if has_result else ""}
{Emitter(types, function).whole()}{"    return result_;" if has_result else ""}
}}
"""


def _renumbered(code: str, names: list[str]) -> str:
    """Return the code with functions of the same name numbered in the order in which they occur.

    Warp numbers them in the order in which a process has made them, so that the next process would not recognise the
    compiled kernel.
    """
    counts: Counter[str] = Counter()
    numbered = {}
    for name in names:
        base = re.sub(r"_\d+$", "", name)
        numbered[name] = f"{base}_{counts[base]}"
        counts[base] += 1

    def renamed(identifier: re.Match[str]) -> str:
        prefix, name, suffix = identifier.groups()
        return f"{prefix}{numbered[name]}{suffix}" if name in numbered else identifier[0]

    return re.sub(r"\b(wide_grad_|wide_adj_|wide_|steps_|)(\w+_\d+)((?:_of_one|_set_out|_found)?)\b", renamed, code)
