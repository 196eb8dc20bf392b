"""The requirements on a kernel whose paths are followed round by round; see `kernels/core/spmd_marks.py`."""

from wrt.spmd import ir


class Module:
    """The functions of a module by their C++ names, and their marks."""

    def __init__(self, functions: list[ir.Function]) -> None:
        """Take the functions."""
        self.functions = {f.name: f for f in functions}

    def marked(self, mark: str) -> set[str]:
        """Return the names of functions with a mark."""
        return {name for name, f in self.functions.items() if mark in f.marks}

    def calls(self, s: ir.Statement, mark: str) -> bool:
        """Return whether a statement, or a nested one, calls a function with a mark."""
        return not self.marked(mark).isdisjoint(ir.calls([s]))


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


def check_path_function(function: ir.Function, shared: list[ir.Variable], module: Module) -> None:
    """Check the requirements of `@path_function`; `shared` are the arguments that are the same for all paths.

    Raises:
        Unsupported: The function violates one; the message says what to change.
    """
    loop = the_loop(function)
    returns = [s for s in ir.walk(function.body) if isinstance(s, ir.Return)]
    if returns != function.body[-1:] or returns[0].value is None:
        raise ir.Unsupported(
            f"{function.key}: must return once, a variable, in its last line; leave the loop by `break` instead"
        )
    for s in ir.walk(function.body):
        if not isinstance(s, (ir.If, ir.Loop)) and module.calls(s, "ray_query") and s not in loop.body:
            raise ir.Unsupported(
                f"{function.key}: asks a ray query within an `if` or an inner loop, or outside the loop, "
                f"in `{s.line}`; ask it at the top level of the loop, with a distance below 0 where there is "
                "nothing to ask"
            )
    _check_called(function, module)
    queries = [s.value for s in loop.body if isinstance(s, ir.Set) and module.calls(s, "ray_query")]
    if not queries or not module.marked("shading_point") & set(ir.calls(loop.body)):
        raise ir.Unsupported(f"{function.key}: must call a @ray_query and then a @shading_point in its loop")
    for number, call in enumerate(queries):
        if not isinstance(call, ir.Call) or len(call.arguments) != (3 if number else 2):
            raise ir.Unsupported(
                f"{function.key}: must ask first for the next surface (scene, ray), then for shadow rays "
                f"(scene, ray, distance); query {number + 1} of a round is neither"
            )
        if call.arguments[0] not in shared:
            raise ir.Unsupported(
                f"{function.key}: traces rays in a scene that may differ between paths; "
                "pass the kernel's own scene to the path function, and on to the query"
            )


def _check_called(function: ir.Function, module: Module) -> None:
    """Check that no function that a path function calls traces rays without a mark that allows it."""
    queries, alone = module.marked("ray_query"), module.marked("traces_alone")
    waiting, seen = [function], {function.name}
    while waiting:
        f = waiting.pop()
        for name in ir.calls(f.body):
            if name in queries and f is not function:
                raise ir.Unsupported(
                    f"{f.key}: asks a ray query, and {function.key} calls it; "
                    f"ask it in {function.key}, or mark {f.key} with @traces_alone"
                )
            if name in module.functions and name not in seen | queries | alone:
                seen.add(name)
                waiting.append(module.functions[name])
