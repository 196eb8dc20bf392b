"""Cutting a path function where it traces rays and where shading begins, after checking that this is possible.

Between two parts of a round, the rays of all groups of paths are traced together, and before shading paths are
compacted (Wald 2011, "Active thread compaction for GPU path tracing"). What is required of a path function is in
`kernels/core/spmd_marks.py`.
"""

from dataclasses import dataclass
from typing import NamedTuple

from wrt.spmd import ir
from wrt.spmd.analysis import Liveness, changes, constant_ranges, range_of, returns_once, through_pointer, uses


class RayQuery(NamedTuple):
    """A statement of a path function that traces a ray.

    Attributes:
        answer: The variable that it sets.
        function: The function that it calls.
        scene: The scene.
        ray: The ray.
        distance: The greatest distance of an occlusion query, None for the nearest hit.
    """

    answer: ir.Variable
    function: str
    scene: ir.Variable
    ray: ir.Variable
    distance: ir.Variable | None = None


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
        prologue: The statements before the loop over rounds.
        loop: That loop.
        parts: The parts of a round.
        epilogue: The statements after the loop.
        result: The variable that is returned.
    """

    prologue: list[ir.Statement]
    loop: ir.Loop
    parts: list[Part]
    epilogue: list[ir.Statement]
    result: ir.Variable


def the_loop(function: ir.Function) -> ir.Loop:
    """Return the one outermost loop of a function.

    Raises:
        Unsupported: It has none, or several.
    """
    loops = [s for s in function.body if isinstance(s, ir.Loop)]
    outside = [s for top in function.body if not isinstance(top, ir.Loop) for s in ir.walk([top])]
    if len(loops) != 1 or any(isinstance(s, ir.Loop) for s in outside):
        raise ir.Unsupported(
            f"{function.key}: must have one loop, outside any other block; "
            "move loops before or after it into functions of their own"
        )
    return loops[0]


def check_path_function(function: ir.Function, shared: list[ir.Variable], module: ir.Module) -> None:
    """Check the requirements of `@path_function`; `shared` are the arguments that are the same for all paths.

    Raises:
        Unsupported: The function violates one; the message names the change to make.
    """

    def require(holds: bool, text: str) -> None:
        if not holds:
            raise ir.Unsupported(f"{function.key}: {text}")

    loop = the_loop(function)
    require(returns_once(function), "must return once, a variable, in its last line; leave the loop by `break` instead")
    for s in ir.walk(function.body):
        if not isinstance(s, (ir.If, ir.Loop)) and module.calls(s, "ray_query"):
            place = "within an `if` or an inner loop, or outside the loop"
            remedy = "ask it at the top level of the loop, with a distance below 0 where there is nothing to ask"
            require(s in loop.body, f"asks a ray query {place}, in `{s.line}`; {remedy}")
    _check_called(function, module)
    queries = [s.value for s in loop.body if isinstance(s, ir.Set) and module.calls(s, "ray_query")]
    shades = bool(module.marked("shading_point") & set(ir.calls(loop.body)))
    require(bool(queries) and shades, "must call a @ray_query and then a @shading_point in its loop")
    for number, call in enumerate(queries):
        arguments: tuple[ir.Variable, ...] = call.arguments if isinstance(call, ir.Call) else ()
        order = "must ask first for the next surface (scene, ray), then for shadow rays (scene, ray, distance)"
        require(len(arguments) == (3 if number else 2), f"{order}; query {number + 1} of a round is neither")
        remedy = "pass the kernel's own scene to the path function, and on to the query"
        require(arguments[0] in shared, f"traces rays in a scene that may differ between paths; {remedy}")


def _check_called(function: ir.Function, module: ir.Module) -> None:
    """Check that no function that a path function calls traces rays without a mark that allows it."""
    queries, exempt = module.marked("ray_query"), module.marked("traces_alone")
    waiting, visited = [function], {function.name}
    while waiting:
        f = waiting.pop()
        for name in ir.calls(f.body):
            if name in queries and f is not function:
                raise ir.Unsupported(
                    f"{f.key}: asks a ray query, and {function.key} calls it; "
                    f"ask it in {function.key}, or mark {f.key} with @traces_alone"
                )
            if name in module.functions and name not in visited | queries | exempt:
                visited.add(name)
                waiting.append(module.functions[name])


def cut(function: ir.Function, module: ir.Module, liveness: Liveness) -> Rounds:
    """Return a path function that has passed `check_path_function`, cut into the parts of a round."""
    loop = the_loop(function)
    spans: list[list[ir.Statement]] = [[]]
    query_statements: list[ir.Statement] = []
    queries: list[RayQuery] = []
    for s in loop.body:
        if isinstance(s, ir.Set) and isinstance(s.value, ir.Call) and module.calls(s, "ray_query"):
            queries.append(RayQuery(s.variable, s.value.function, *s.value.arguments))
            query_statements.append(s)
            spans.append([])
        else:
            spans[-1].append(s)
    first, second = _deferred(spans[0], query_statements[0], spans[1], liveness.outliving)
    # Shading begins after the last block in which paths that hit nothing can end.
    shading = next((i for i, s in enumerate(second) if module.calls(s, "shading_point")), 0)
    place = max((i + 1 for i in range(shading) if isinstance(second[i], ir.If | ir.Loop)), default=0)
    parts = [Part(None, False, first), Part(queries[0], False, second[:place]), Part(None, True, second[place:])]
    parts += [Part(q, False, span) for q, span in zip(queries[1:], spans[2:], strict=True)]
    return _around(function, loop, parts)


def uncut(function: ir.Function) -> Rounds | None:
    """Return a function that is no `@path_function` with its loop as a round of one part, so that paths can be moved.

    Return None if it must be called as a whole: it has no such loop, or several, or returns before its end.
    """
    ranges = constant_ranges(function.body)
    loops = [s for s in function.body if isinstance(s, ir.Loop) and not s.is_of_stage]
    loops = [s for s in loops if range_of(s.body[0]) not in ranges]
    if len(loops) != 1 or not returns_once(function):
        return None
    return _around(function, loops[0], [Part(None, False, loops[0].body)])


def _around(function: ir.Function, loop: ir.Loop, parts: list[Part]) -> Rounds:
    at, end = function.body.index(loop), function.body[-1]
    assert isinstance(end, ir.Return)
    assert end.value is not None
    return Rounds(function.body[:at], loop, parts, function.body[at + 1 : -1], end.value)


def _deferred(
    before: list[ir.Statement], query: ir.Statement, following: list[ir.Statement], outliving: set[ir.Variable]
) -> tuple[list[ir.Statement], list[ir.Statement]]:
    """Defer statements that a query does not need, and return what is before the query then, and what follows it.

    Such statements, as of random numbers, run only for the paths that go on after the query, next to the first use of
    their results, which need not be stored while rays are traced. `outliving` are variables that are needed after the
    round.
    """
    statements = [*before, query, *following]
    users: dict[ir.Variable, list[int]] = {}
    for i, s in enumerate(statements):
        for v in uses([s]):
            users.setdefault(v, []).append(i)
    places: dict[int, int] = {}
    for i in reversed(range(len(before))):
        s = before[i]
        if not isinstance(s, ir.Set) or s.variable in outliving or s.variable.is_pointer or through_pointer(s.value):
            continue
        place = min((places.get(k, k) for k in users[s.variable] if k > i), default=0)
        read = uses([s]) - {s.variable}
        if place > len(before) and not any(changes(statements[i + 1 : place], v) for v in read):
            places[i] = place
    out = []
    for k, s in enumerate(following, len(before) + 1):
        out += [before[i] for i in sorted(places) if places[i] == k] + [s]
    return [s for i, s in enumerate(before) if i not in places], out
