"""Cutting a round of the path loop where it traces rays and where shading begins.

Between two parts, the rays of all groups of paths are traced together, and before shading paths are compacted (Wald
2011, "Active thread compaction for GPU path tracing").
"""

from dataclasses import dataclass

from wrt.spmd import ir
from wrt.spmd.passes.deferral import deferred
from wrt.spmd.passes.demands import Module, the_loop
from wrt.spmd.passes.uses import Liveness
from wrt.spmd.ray_queries import RayQuery


@dataclass(frozen=True)
class Part:
    """A part of a round.

    Attributes:
        query: The ray query before it, if there is one.
        shades: Whether shading begins with it; paths that hit nothing have ended before.
        statements: Its statements.
    """

    query: RayQuery | None
    shades: bool
    statements: list[ir.Statement]


@dataclass(frozen=True)
class Rounds:
    """A path function, cut into parts.

    Attributes:
        before: The statements before the loop over rounds.
        loop: That loop.
        parts: The parts of a round.
        after: The statements after the loop.
        result: The variable that is returned.
    """

    before: list[ir.Statement]
    loop: ir.Loop
    parts: list[Part]
    after: list[ir.Statement]
    result: ir.Variable


def cut(function: ir.Function, module: Module, liveness: Liveness) -> Rounds:
    """Return a path function that has passed `check_path_function`, cut into the parts of a round."""
    loop = the_loop(function)
    spans: list[list[ir.Statement]] = [[]]
    asked: list[ir.Statement] = []
    queries: list[RayQuery] = []
    for s in loop.body:
        if isinstance(s, ir.Set) and isinstance(s.value, ir.Call) and module.calls(s, "ray_query"):
            scene, ray, *distance = (a.name for a in s.value.arguments)
            queries.append(RayQuery(s.variable.name, s.value.function, scene, ray, distance[0] if distance else None))
            asked.append(s)
            spans.append([])
        else:
            spans[-1].append(s)
    # Statements that the first query does not need, such as random numbers, wait until the surviving paths are known.
    begun, following = deferred(spans[0], asked[0], spans[1], liveness.outliving)
    # Shading begins after the last block in which paths that hit nothing can end.
    met = next((i for i, s in enumerate(following) if module.calls(s, "shading_point")), 0)
    place = max((i + 1 for i in range(met) if isinstance(following[i], ir.If | ir.Loop)), default=0)
    parts = [Part(None, False, begun), Part(queries[0], False, following[:place]), Part(None, True, following[place:])]
    parts += [Part(q, False, span) for q, span in zip(queries[1:], spans[2:], strict=True)]
    at, end = function.body.index(loop), function.body[-1]
    assert isinstance(end, ir.Return)
    assert end.value is not None
    return Rounds(function.body[:at], loop, parts, function.body[at + 1 : -1], end.value)
