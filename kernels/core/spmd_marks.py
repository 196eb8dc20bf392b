"""Decorators that mark functions for the translator of the wide kernel; see docs/spmd.md.

The translator (`wrt/spmd`) turns a render kernel into one for several lanes. It follows many paths at once, round by
round, and traces the rays of all of them together. It must therefore find the path function, its ray queries and the
start of shading, all in places where it can cut the loop. A mark names a function's role, and the mark's docstring
states the requirements; a kernel that violates one is not translated, and the error names the function. A mark stands
below `@wp.func` or `@wp.kernel` and does not change the code that Warp generates.
"""

from collections.abc import Callable
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable[..., Any])


def _marked(function: F, mark: str) -> F:
    function.spmd_marks = (*getattr(function, "spmd_marks", ()), mark)  # type: ignore[attr-defined]
    return function


def pixel_kernel(kernel: F) -> F:
    """Mark a kernel that renders the samples of a pixel.

    It has one loop over samples, `for index in range(first, last)`, where `last` is an argument of the kernel. The loop
    calls the path function once, either at its top level or in the last of nested `if`s. The kernel may be launched
    with a smaller `last` first: it resumes where it left a pixel, or else is launched for numbers of samples that
    are taken at once (see `wrt/gradients/kernels.py`).
    """
    return _marked(kernel, "pixel_kernel")


def path_function(function: F) -> F:
    """Mark the function that follows one path.

    It has one outermost loop, itself or in a stage, and one `return` of a variable, at its end. A round of the loop
    advances to the next surface: it makes one `ray_query` for the next surface, then calls a `shading_point`, and may
    make further queries for shadow rays. Arguments that a kernel passes on unchanged, such as the scene, are the same
    for all paths.
    """
    return _marked(function, "path_function")


def ray_query(function: F) -> F:
    """Mark a function that traces one ray: (scene, ray) -> the nearest hit, or (scene, ray, distance) -> blocked.

    A path function calls it at the top level of the loop, where a round can be cut so that the rays of all paths are
    traced together: not within an `if`, an inner loop or another function. The scene is an argument of the path
    function.
    """
    return _marked(function, "ray_query")


def traces_alone(function: F) -> F:
    """Mark a function that traces its own rays, because their number or their ends depend on what they hit.

    They are traced for one group of paths at a time, which is slower than a `ray_query` of the path function.

    A kernel may call such a function instead of a path function. It may have any form. If it has one outermost loop of
    its own, without a constant number of rounds, and returns once, at its end, then paths are compacted between rounds.
    """
    return _marked(function, "traces_alone")


def shading_point(function: F) -> F:
    """Mark the function that computes the surface at a hit, where shading begins.

    Paths that hit nothing should have ended by then: the remaining ones are compacted first.
    """
    return _marked(function, "shading_point")


def inline_stage(function: F) -> F:
    """Mark a stage of a path function, inlined where it is called: (scene, state, ...) -> the new state.

    It returns once, in its last line. The state's members become separate variables, so that a path stores and moves
    only the members that the scene uses; use the state member by member, and pass it as a whole to stages only.
    """
    return _marked(function, "inline_stage")
