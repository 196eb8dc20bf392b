"""What paths ask the ray tree, for all groups of a pool: C++ between those of `paths.py` and `pool.py`.

A question is a type: whose rays are traced, how far, and where the answers go. Down the tree of all triangles groups
are traced by `kernels/wide/rays.py`, and those rays that part from their groups are followed in turn, whichever they
left. Scenes of instances trace each group for itself.
"""

import re
from typing import NamedTuple

from wrt.kernels.intersect import INFINITE_DISTANCE

POINTS_IN_CACHE = 200_000
"""Of so many points or less it is not worth asking the processor to fetch them: 3 % slower in the Cornell box, while
with 10 million triangles paths are 5 % faster."""

ASKED = re.compile(r"(var_\w+) = ((?:closest_hit|occluded)\w*)\((var_\w+), (var_\w+)(?:, (var_\w+))?\);")
"""A statement that traces a ray: what it sets, which function it calls, with which scene, ray and distance."""


class Question(NamedTuple):
    """A statement of ASKED.

    Attributes:
        answer: the variable that it sets.
        function: which it calls.
        scene: the variable of the scene.
        ray: that of the ray.
        distance: that of the distance, if there is one: then it is asked whether anything is before it.
    """

    answer: str
    function: str
    scene: str
    ray: str
    distance: str | None


_QUESTION = """
// What FUNCTION is asked.
struct NAME {
    typedef STEPS Steps;
    typedef RAY_TYPE Ray;
    typedef ANSWER_TYPE Answer;
    static const Ray& ray(const Steps& steps) { return steps.RAY; }
    static lanes::Floats reach(const Steps& steps) { return REACH; }
    static Answer& answer(Steps& steps) { return steps.ANSWER; }
"""
_TOGETHER = """
    typedef lanes::Journeys Traced;
    static void set_out(const Steps& steps, Traced& t, const Ray& ray, lanes::Floats reach, lanes::Mask exec) {
        TRAVERSE_set_out(steps.SCENE.bvh, t, ray.origin, ray.direction, 0.0f, reach, ANY_HIT, exec);
    }
    static void follow(const Steps& steps, Traced* t, int count) {
        follow_alone<ANY_HIT>(steps.SCENE.bvh, t, count, 0.0f);
    }
"""
_FOUND_TOGETHER = """
    static Answer found(const Steps& steps, const Traced& t, lanes::Floats reach, lanes::Mask exec) {
        const Answer hits = AS_HIT(TRAVERSE_found(t, reach), exec);
        if (steps.SCENE.points.shape[0] > IN_CACHE) LANES_EACH(l, exec) {
            const size_t triangle = hits.triangle.v[l] < 0 ? 0 : hits.triangle.v[l];
            __builtin_prefetch((const int*)steps.SCENE.corners.data + 3 * triangle);
            __builtin_prefetch((const int*)steps.SCENE.triangle_shape.data + triangle);
        }
        return hits;
    }
    // Have the processor fetch the points of triangles that were met.
    static void prepare(const Steps& steps, const lanes::Mask exec) {
        if (steps.SCENE.points.shape[0] > IN_CACHE) LANES_EACH(l, exec) {
            const size_t triangle = steps.ANSWER.triangle.v[l] < 0 ? 0 : steps.ANSWER.triangle.v[l];
            const int* const corners = (const int*)steps.SCENE.corners.data + 3 * triangle;
            for (int k = 0; k < 3; ++k)
                __builtin_prefetch((const float*)steps.SCENE.points.data + 3 * (size_t)corners[k]);
        }
    }
};
"""
_BLOCKED_TOGETHER = """
    static Answer found(const Steps& steps, const Traced& t, lanes::Floats reach, lanes::Mask exec) {
        return lanes::cast_int32(TRAVERSE_found(t, reach).c[0]);
    }
    static void prepare(const Steps& steps, const lanes::Mask exec) {}
};
"""
_EACH = """
    typedef Answer Traced;
    static void set_out(const Steps& steps, Traced& t, const Ray& ray, lanes::Floats reach, lanes::Mask exec) {
        t = ASK;
    }
    static void follow(const Steps& steps, Traced* t, int count) {}
    static Answer found(const Steps& steps, const Traced& t, lanes::Floats reach, lanes::Mask exec) { return t; }
    static void prepare(const Steps& steps, const lanes::Mask exec) {}
};
"""


def question_code(
    question: Question, name: str, steps: str, answer: str, types: tuple[str, str], functions: dict[str, str]
) -> str:
    """Return the C++ type of a question.

    Args:
        question: what is asked.
        name: that of the type.
        steps: the type of paths that ask it.
        answer: the member of theirs that the answer goes to.
        types: of the ray and of the answer.
        functions: names in Warp's C++ by those in Python.
    """
    nearest = question.distance is None
    together = question.function == functions.get("closest_hit" if nearest else "occluded")
    if together and {"_traverse", "_hit"} <= set(functions):
        code = _QUESTION + _TOGETHER + (_FOUND_TOGETHER if nearest else _BLOCKED_TOGETHER)
    else:
        code = _QUESTION + _EACH
    call = f"wide_{question.function}(steps.SCENE, ray"
    names = {
        "FUNCTION": question.function,
        "NAME": name,
        "STEPS": steps,
        "RAY_TYPE": types[0],
        "ANSWER_TYPE": types[1],
        "RAY": question.ray,
        "ANSWER": answer,
        "REACH": f"lanes::Floats({INFINITE_DISTANCE!r}f)" if nearest else f"steps.{question.distance}",
        "ANY_HIT": "false" if nearest else "true",
        "ASK": f"{call}, exec)" if nearest else f"lanes::Ints({call}, reach, exec).v ? (lanes::i16)0 : (lanes::i16)-1)",
        "IN_CACHE": str(POINTS_IN_CACHE),
        "TRAVERSE": f"wide_{functions.get('_traverse')}",
        "AS_HIT": f"wide_{functions.get('_hit')}",
    }
    code = re.sub(rf"\b({'|'.join(names)})(?=\b|_set_out|_found)", lambda m: names[m[1]], code)
    return re.sub(r"\bSCENE\b", question.scene, code)
