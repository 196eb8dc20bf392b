"""A small kernel with all that the SPMD translator looks for: the example of docs/spmd.md, and its stages as text.

What it renders has no meaning: a ray meets the next of many mirrors, and loses light at each.
"""

import inspect
import re
import textwrap
from typing import Any

import warp as wp
from warp._src.context import ModuleBuilder

from wrt.kernels.spmd_marks import path_function, pixel_kernel, ray_query, shading_point
from wrt.spmd import ir
from wrt.spmd.emit import Emitter
from wrt.spmd.parse import lines_of, parse
from wrt.spmd.passes.demands import Module
from wrt.spmd.passes.rounds import cut
from wrt.spmd.passes.storage import store
from wrt.spmd.types import Types, name_of, structs_of


@wp.struct
class Mirrors:
    distance: float
    sky: float


@wp.struct
class Ray:
    origin: wp.vec3
    direction: wp.vec3


@wp.func
@ray_query
def next_mirror(mirrors: Mirrors, ray: Ray) -> float:
    return mirrors.distance + 0.3 * ray.direction[0] + 0.05 * ray.direction[1]


@wp.func
@ray_query
def blocked(mirrors: Mirrors, ray: Ray, distance: float) -> bool:
    return mirrors.distance + 0.2 * ray.direction[0] < distance


@wp.func
@shading_point
def albedo_at(mirrors: Mirrors, t: float) -> float:
    return 0.5 + 0.1 * t * mirrors.distance


@wp.func
def random_number(seed: int, depth: int) -> float:
    return float(seed % 7 + depth) * 0.1


@wp.func
@path_function
def trace(mirrors: Mirrors, camera_ray: Ray, seed: int, max_depth: int) -> float:
    ray = camera_ray
    light = float(0.0)
    throughput = float(1.0)
    depth = int(0)
    while depth < max_depth:
        depth += 1
        u = random_number(seed, depth)
        t = next_mirror(mirrors, ray)
        if t < 0.0:
            light += throughput * mirrors.sky
            break
        throughput *= albedo_at(mirrors, t)
        if u >= throughput:
            break
        ray.direction = -ray.direction
    return light


def make_kernel(path: Any, name: str) -> wp.Kernel:
    """Return a kernel that renders with a path function, in a module of its own."""

    @wp.kernel(module=wp.get_module(f"wrt.test.spmd.{name}"), enable_backward=False)
    @pixel_kernel
    def render(
        first_pixel: int,
        last: int,
        max_depth: int,
        mirrors: Mirrors,
        film: wp.array(dtype=float),
        counts: wp.array(dtype=int),
    ):
        pixel = first_pixel + wp.tid()
        total = film[pixel]
        for sample in range(counts[pixel], last):
            ray = Ray()
            ray.direction = wp.vec3(float(sample % 5) - 3.5, 0.02 * float(pixel), 1.0)
            total += path(mirrors, ray, sample, max_depth)
        film[pixel] = total
        counts[pixel] = last

    return render


def stages() -> dict[str, str]:
    """Return what each stage of the translator makes of `trace`, as docs/spmd.md shows it."""
    module = make_kernel(trace, "example").module
    builder = ModuleBuilder(module, module.resolve_options(wp.config), target=None)
    built = [*builder.functions, *builder.kernels]
    structs, elements = structs_of(built)
    functions = [parse(f, {name_of(s): s for s in structs}) for f in built]
    types = Types(functions, structs, elements)
    (path,) = (f for f in functions if f.key == "trace")
    emitter = Emitter(types, path)
    rounds = cut(path, Module(functions[:-1]), emitter.liveness)
    own = path.arguments[1:3]
    stored = store(path, rounds, emitter.liveness, own)
    lists = {"kept": stored.kept, "across": stored.across, "moved": stored.moved}
    parts = []
    for number, part in enumerate(rounds.parts):
        query = f", after the answer to {part.query.function}" if part.query else ""
        parts.append(f"part {number}{query}{', where shading begins' if part.shades else ''}:")
        parts += shown(part.statements, 1)[:9]
    lines = next(lines_of(f) for f in built if f.key == "trace")
    first, end = lines.index("start_while_0:;"), lines.index("}")
    statements = shown([rounds.loop])
    texts = {
        "python": textwrap.dedent(inspect.getsource(trace.func)),
        "warp": "\n".join(lines[first : end + 1]),
        "parse": "\n".join(statements[: statements.index("        Jump(end, while_0)") + 1]),
        "rounds": "\n".join(parts),
        "storage": "\n".join(f"{name}: {', '.join(v.name for v in of)}" for name, of in lists.items()),
        "emit": textwrap.dedent(emitter.in_loop(rounds.loop.label, rounds.parts[1].statements, cut=True)),
    }
    return {name: re.sub(r"\n\s*\n", "\n", text).strip() for name, text in texts.items()}


def shown(statements: list[ir.Statement], depth: int = 0) -> list[str]:
    """Return the intermediate form of statements, one a line; addresses are shown where they are used."""
    lines: list[str] = []
    for s in statements:
        if isinstance(s, ir.Set) and s.variable.is_pointer:
            continue
        name = type(s).__name__
        of = [getattr(s, f) for f in s.__dataclass_fields__ if f not in ("line", "number", "body")]
        lines.append("    " * depth + f"{name}({', '.join(_shown(value) for value in of if value != ())})")
        if isinstance(s, (ir.If, ir.Loop)):
            lines += shown(s.body, depth + 1)
    return lines


def _shown(e: Any) -> str:
    if isinstance(e, ir.Variable):
        return e.name if e.constant is None else str(e.constant)
    if isinstance(e, tuple):
        return ", ".join(map(_shown, e)) if e and not isinstance(e[0], str) else ".".join(e)
    if hasattr(e, "__dataclass_fields__"):
        return f"{type(e).__name__}({', '.join(_shown(getattr(e, f)) for f in e.__dataclass_fields__)})"
    return str(e)
