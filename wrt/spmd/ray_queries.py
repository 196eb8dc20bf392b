"""Ray queries of paths as C++ types, for all groups of a pool.

A query names its rays, their greatest distance, and the place for the answers; `kernels/native/lanes/ray_queries.h`
traces them.
"""

from typing import NamedTuple

from wrt.kernels.accel.intersect import INFINITE_DISTANCE
from wrt.spmd.library import traverses_one_tree
from wrt.spmd.templates import fill


class RayQuery(NamedTuple):
    """A statement of a path function that traces a ray.

    Attributes:
        answer: the variable that it sets.
        function: the function that it calls.
        scene: the scene's variable.
        ray: the ray's variable.
        distance: the distance's variable for an occlusion query, None for the nearest hit.
    """

    answer: str
    function: str
    scene: str
    ray: str
    distance: str | None


def ray_query_code(
    query: RayQuery, name: str, steps: str, answer: str, ray_type: str, answer_type: str, functions: dict[str, str]
) -> str:
    """Return the C++ type of a query.

    Args:
        query: the statement.
        name: the name of the type.
        steps: the type of the paths.
        answer: their member for the answer.
        ray_type: the C++ type of the ray.
        answer_type: the C++ type of the answer.
        functions: names in Warp's C++ by those in Python.
    """
    nearest = query.distance is None
    together = query.function == functions.get("closest_hit" if nearest else "occluded")
    call = f"wide_{query.function}(steps.{query.scene}, ray"
    if not together or not traverses_one_tree(functions):
        kind = f"AskedEach<{name}, {answer_type}>"
        blocked = f"lanes::choose({call}, reach, exec), (lanes::ints)0, (lanes::ints)-1)"
        ask = f"{call}, exec)" if nearest else f"lanes::Ints({blocked})"
        function = "Answer ask(const Steps& steps, const Ray& ray, lanes::Floats reach, lanes::Mask exec)"
        member = f"static {function} {{ return {ask}; }}"
    elif nearest:
        kind = f"NearestTogether<{name}>"
        hit = f"wide_{functions['_hit']}(found, exec)"
        member = f"template<class Found> static Answer as_hit(Found found, lanes::Mask exec) {{ return {hit}; }}"
    else:
        kind, member = f"AnyTogether<{name}>", ""
    return fill(
        "ray_query.h",
        FUNCTION=query.function,
        NAME=name,
        KIND=kind,
        STEPS=steps,
        RAY_TYPE=ray_type,
        ANSWER_TYPE=answer_type,
        SCENE=query.scene,
        RAY=query.ray,
        ANSWER=answer,
        REACH=f"lanes::Floats({INFINITE_DISTANCE!r}f)" if nearest else f"steps.{query.distance}",
        MEMBER=member,
    )
