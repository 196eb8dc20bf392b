"""Shapes by signed distance functions, registered from outside: where rays meet them, and points on them.

The host stores such a shape as the box around it (`wrt/scene/exact/distances.py`). The normals of the box's three
vertices are the shape's own axes in the scene; further vertices of its mesh, which no face has, hold what the function
needs. A ray is mapped to the shape's own space and sphere-traced there (Hart 1996, "Sphere tracing"): the absolute
distance over its Lipschitz constant is the radius of a ball that holds no surface. A step reaches to where the balls of
both its ends just touch if the surface is plane, and is taken back if they do not (Keinert and others 2014, "Enhanced
sphere tracing"; Bálint and Valasek 2018, "Accelerating sphere tracing"). Each step has a least length, and a hit is a
change of sign: so a ray which starts beside a surface does not meet it again, and one that begins inside finds the far
wall.

Normals are differences along the corners of a tetrahedron. `wp.grad` would be wrong for functions with loops that carry
values, as of fractals.
"""

from typing import Any, NamedTuple, get_type_hints

import warp as wp

from wrt.kernels.core.features import distances_of, instances_of
from wrt.kernels.core.ray_tree import make_instance_placement
from wrt.kernels.core.rays import Ray
from wrt.kernels.core.registry import Registry, model_number
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.geometry.quadrics import Quadric, in_unit_shape, point_of, scale_of
from wrt.kernels.geometry.triangles import clearance, slack_of

MOST_NUMBERS = 24
"""Most numbers that a distance function takes besides the point."""

NO_MEETING = wp.constant(0.0)

_LEAST_STEP = wp.constant(2.0**-15)
"""The least step, in diagonals of the box: thinner parts may be missed. Rounding of distances is a hundredth of it."""

_CLEARANCE = wp.constant(2.0**-15)
"""The distance from the surface at which rays leave it, in diagonals of the box."""

_DIFFERENCE = wp.constant(2.0**-13)
"""Half the edge of the cube of points for a normal, in diagonals: rounding turns normals by 1e-4 or so."""

_ROUNDINGS = wp.constant(2.0**-22)
"""How wrong the distance of a hit may be, as a share of itself."""

_TOLERANCE = wp.constant(2.0**-23)
"""The distance from the surface at which a hit is found, in diagonals: a rounding or two."""

_LEAST_COSINE = wp.constant(1.0e-4)
"""The least cosine between a ray and a normal."""

_CAUTION = wp.constant(0.95)
_MOST_STRETCHED = wp.constant(2.0)
"""Factor on the step that would be right for a plane surface, and the longest step over the distance.

Evaluations are 0.79, 0.95 and 0.73 of those of plain steps for a ball, a rounded box and a Mandelbulb.
"""

_FINE_STEPS = wp.constant(256)
_STEPS_TO_DOUBLE = wp.constant(32)
"""The least step doubles after the first number of steps, and again each second number: a ray ends after 750."""

_REFINEMENTS = wp.constant(6)


class DistanceModel(NamedTuple):
    """A signed distance function (point, numbers...) -> metres, negative inside, and how many numbers it takes."""

    distance: wp.Function
    numbers: int


def _check(name: str, model: DistanceModel) -> None:
    if not 0 <= model.numbers <= MOST_NUMBERS:
        raise ValueError(f"{name}: a distance function takes at most {MOST_NUMBERS} numbers, not {model.numbers}")


DISTANCES: Registry[DistanceModel] = Registry({}, _check)
current_name = DISTANCES.current_name


def distance_model(name: str, function: object) -> DistanceModel:
    """Return the model of a distance function.

    Raises:
        ValueError: unless it is a Warp function (point: wp.vec3, number: float, ...) -> float.
    """
    rule = f"{name}: a distance must be a Warp function (point: wp.vec3, number: float, ...) -> float"
    if not isinstance(function, wp.Function) or function.input_types is None:
        raise ValueError(f"{rule}, not {type(function).__name__}")
    of_point, *of_numbers = function.input_types.items() or [("", None)]
    if of_point[1] is not wp.vec3:
        raise ValueError(f"{rule}; its first argument is not a wp.vec3")
    for argument, kind in of_numbers:
        if kind not in (float, wp.float32):
            raise ValueError(f"{rule}; {argument} is not a float")
    if get_type_hints(function.func).get("return", float) not in (float, wp.float32):
        raise ValueError(f"{rule}; it returns something else")
    return DistanceModel(function, len(of_numbers))


def numbers_of(name: str) -> int:
    """Return how many numbers a distance function takes."""
    return DISTANCES.model_of(name).numbers


def number_of(name: str) -> int:
    """Return the number of a distance function, by its name with or without a version: a kernel has one version."""
    return model_number(name.partition(":")[0])


@wp.struct
class Volume:
    """A box around a shape that a distance function describes; its `model` is −1 for other shapes.

    `axes` maps the shape's own space, where the box is from `low` to `high`, to the world; its centre is the image of
    the origin. `first` is the vertex that holds the first three numbers.
    """

    model: int
    axes: Quadric
    low: wp.vec3
    high: wp.vec3
    lipschitz: float
    first: int


@wp.func
def volume_of_one_tree(scene: SceneData, triangle: int, instance: int, time: float) -> Volume:
    """Return the volume that is stored as a triangle in a scene without instances."""
    corners = scene.corners[triangle]
    a = scene.points[corners[0]]
    b = scene.points[corners[1]]
    c = scene.points[corners[2]]
    volume = Volume()
    volume.model = -1
    rises = a[0] < b[0]
    if a[0] == c[0] and a[1] == c[1] and a[2] == c[2] and rises == (a[1] < b[1]) and rises != (a[2] < b[2]):
        k = corners[2] + 1
        volume.axes.x = scene.normals[corners[0]]
        volume.axes.y = scene.normals[corners[1]]
        volume.axes.z = scene.normals[corners[2]]
        volume.axes.center = scene.normals[k]
        volume.axes.side = wp.where(rises, 1.0, -1.0)
        volume.low = scene.normals[k + 1]
        volume.high = scene.normals[k + 2]
        head = scene.normals[k + 3]
        volume.model = int(head[0]) * 32768 + int(head[1])
        volume.lipschitz = head[2]
        volume.first = k + 4
    return volume


@specialised()
def make_volume_of(geometry: str) -> wp.Function:
    """Return the device function (scene, triangle, instance, time) -> Volume; see `Features.geometry`."""
    if instances_of(geometry) == "none":
        return volume_of_one_tree
    instance_placement = make_instance_placement(instances_of(geometry))

    @wp.func
    def volume_of(scene: SceneData, triangle: int, instance: int, time: float) -> Volume:
        volume = volume_of_one_tree(scene, triangle, instance, time)
        if volume.model >= 0:
            record = scene.placed.instances[instance]
            placement = instance_placement(scene.placed, record, time)
            corners = scene.corners[triangle]
            sizes = wp.max(wp.abs(scene.points[corners[0]]), wp.abs(scene.points[corners[1]]))
            volume.axes.slack = slack_of(record, placement, sizes)
            volume.axes.center = placement.linear * volume.axes.center + placement.offset
            volume.axes.x = placement.linear * volume.axes.x
            volume.axes.y = placement.linear * volume.axes.y
            volume.axes.z = placement.linear * volume.axes.z
        return volume

    return volume_of


# --- The distance ----------------------------------------------------------------------------------


@specialised()
def make_numbers(names: tuple[str, ...]) -> wp.Function:
    """Return the device function (scene, volume) -> the numbers that the host stored for its function, and others."""
    Numbers = numbers_type(names)  # noqa: N806

    @wp.func
    def numbers_of_volume(scene: SceneData, volume: Volume) -> Numbers:  # type: ignore[valid-type]
        numbers = Numbers()
        last = scene.normals.shape[0] - 1
        for k in range(wp.static(Numbers._length_)):
            numbers[k] = scene.normals[wp.min(volume.first + k // 3, last)][k % 3]
        return numbers

    return numbers_of_volume


def numbers_type(names: tuple[str, ...]) -> Any:
    """Return the vector type that holds the numbers of each of these functions."""
    return wp.types.vector(length=max([1, *map(numbers_of, names)]), dtype=float)


@specialised()
def make_distance(names: tuple[str, ...], all_names: tuple[str, ...]) -> wp.Function:
    """Return the device function (model, numbers, point in its space) -> distance, a link of a chain for each name.

    The numbers are those of `make_numbers` for `all_names`.
    """
    Numbers = numbers_type(all_names)  # noqa: N806
    if not names:

        @wp.func
        def nowhere(model: int, numbers: Numbers, point: wp.vec3) -> float:  # type: ignore[valid-type]
            return 1.0e30

        return nowhere
    function, count = DISTANCES.model_of(names[0])
    kind, following = number_of(names[0]), make_distance(names[1:], all_names)
    Own = wp.types.vector(length=max(count, 1), dtype=float)  # noqa: N806

    @wp.func
    def distance(model: int, numbers: Numbers, point: wp.vec3) -> float:  # type: ignore[valid-type]
        if model == wp.static(kind):
            own = Own()
            for k in range(wp.static(count)):
                own[k] = numbers[k]
            if wp.static(count == 0):
                return function(point)
            else:
                return function(point, *own)
        return following(model, numbers, point)

    return distance


# --- Rays ------------------------------------------------------------------------------------------


@wp.struct
class Passage:
    """A ray's way through the box of a volume, in its space: `start` + s `direction`, `begin` ≤ begin + s ≤ `end`.

    The three distances are the ray's own. If it misses the box, `end` is less than `begin`.
    """

    start: wp.vec3
    direction: wp.vec3
    begin: float
    end: float


@wp.func
def passage_of(volume: Volume, ray: Ray) -> Passage:
    """Return a ray's way through the box. It starts there, so the error of its points does not grow with their t."""
    passage = Passage()
    origin = in_unit_shape(volume.axes, ray.origin - volume.axes.center)
    passage.direction = in_unit_shape(volume.axes, ray.direction)
    passage.begin = 0.0
    passage.end = 3.0e38
    for k in range(3):
        d = passage.direction[k]
        if wp.abs(d) > 1.0e-30:
            one = (volume.low[k] - origin[k]) / d
            other = (volume.high[k] - origin[k]) / d
            passage.begin = wp.max(passage.begin, wp.min(one, other))
            passage.end = wp.min(passage.end, wp.max(one, other))
        elif origin[k] < volume.low[k] or origin[k] > volume.high[k]:
            passage.end = -1.0
    passage.start = origin + passage.direction * passage.begin
    return passage


@wp.func
def diagonal_of(volume: Volume) -> float:
    """Return the length of the box's diagonal in its space."""
    return wp.length(volume.high - volume.low)


@specialised()
def make_meet_volume(geometry: str) -> wp.Function:
    """Return the device function (scene, volume, ray, after, before) -> distance at which a ray meets the surface.

    It is the first beyond `after` and before `before`, negative if the ray comes from inside, or NO_MEETING. If `after`
    is not 0, a surface was met there, and the next begins a few least steps behind it. Where the function returns NaN,
    nothing is met.
    """
    names = distances_of(geometry)
    distance, numbers_of_volume = make_distance(names, names), make_numbers(names)

    @wp.func
    def meet_volume(scene: SceneData, volume: Volume, ray: Ray, after: float, before: float) -> float:
        passage = passage_of(volume, ray)
        numbers = numbers_of_volume(scene, volume)
        length = wp.length(passage.direction)
        diagonal = diagonal_of(volume)
        least = diagonal * _LEAST_STEP / length
        per_distance = 1.0 / (volume.lipschitz * length)
        end = wp.min(passage.end, before) - passage.begin
        s = float(0.0)
        if after > 0.0:
            s = wp.max(after + 2.0 * least - passage.begin, 0.0)
        if not (s < end):
            return NO_MEETING
        value = distance(volume.model, numbers, passage.start + passage.direction * s)
        outside = value > 0.0
        free = wp.abs(value) * per_distance
        stretch = float(1.0)
        steps = int(0)
        far = float(s)
        far_value = float(value)
        is_met = bool(False)
        goes_on = bool(value == value)
        while goes_on:
            far = wp.min(s + wp.max(free * stretch, least), end)
            far_value = distance(volume.model, numbers, passage.start + passage.direction * far)
            far_free = wp.abs(far_value) * per_distance
            steps += 1
            if steps >= _FINE_STEPS and steps % _STEPS_TO_DOUBLE == 0:
                least = 2.0 * least
            if stretch > 1.0 and (far - s) - (free + far_free) > least:
                stretch = 1.0
            elif (far_value > 0.0) != outside or far_value != far_value:
                is_met = far_value == far_value
                goes_on = False
            else:
                slope = (free - far_free) / (far - s)
                stretch = wp.clamp(2.0 * _CAUTION / (1.0 + slope), 1.0, _MOST_STRETCHED)
                s = far
                value = far_value
                free = far_free
                goes_on = s < end
        if not is_met:
            return NO_MEETING
        # Regula falsi; an end that stays halves its value (the Illinois method).
        last_side = int(0)
        turns = int(0)
        middle = float(far)
        at_middle = float(far_value)
        while wp.abs(at_middle) > diagonal * _TOLERANCE and turns < _REFINEMENTS:
            middle = s + (far - s) * wp.clamp(value / (value - far_value), 0.01, 0.99)
            at_middle = distance(volume.model, numbers, passage.start + passage.direction * middle)
            if (at_middle > 0.0) == outside:
                s = middle
                value = at_middle
                if last_side == 1:
                    far_value = 0.5 * far_value
                last_side = 1
            else:
                far = middle
                far_value = at_middle
                if last_side == 2:
                    value = 0.5 * value
                last_side = 2
            turns += 1
        met = wp.max(passage.begin + middle, 1.0e-30)
        return wp.where(outside, met, -met)

    return meet_volume


@wp.struct
class VolumePoint:
    """A point of a surface.

    `position` and the unit `normal`, towards greater distances, are in the world. `clearance` is the offset along the
    normal from which rays leave. `uv` is the place in the box, 0 to 1, seen along the axis nearest to the normal; `e1`
    and `e2` are its derivatives.
    """

    position: wp.vec3
    normal: wp.vec3
    clearance: float
    uv: wp.vec2
    e1: wp.vec3
    e2: wp.vec3


@wp.func
def to_world_normal(volume: Volume, gradient: wp.vec3) -> wp.vec4:
    """Return the unit normal in the world of a gradient in the volume's space, and the gradient's length there."""
    scale = wp.max(scale_of(volume.axes.x), wp.max(scale_of(volume.axes.y), scale_of(volume.axes.z)))
    x = volume.axes.x * scale
    y = volume.axes.y * scale
    z = volume.axes.z * scale
    yz = wp.cross(y, z)
    mapped = yz * gradient[0] + wp.cross(z, x) * gradient[1] + wp.cross(x, y) * gradient[2]
    mapped = mapped / wp.dot(x, yz)
    length = wp.length(mapped)
    normal = mapped / length
    return wp.vec4(normal[0], normal[1], normal[2], length * scale)


@specialised()
def make_point_on_volume(geometry: str) -> wp.Function:
    """Return the device function (scene, volume, ray, t, outside) -> VolumePoint at which a ray meets a surface.

    `outside` is whether it comes from there. The point on the ray is moved to the surface along the gradient, so its
    error does not depend on t. Where details are finer than the difference, the normal may face away from the ray, and
    is turned to it.
    """
    names = distances_of(geometry)
    distance, numbers_of_volume = make_distance(names, names), make_numbers(names)

    @wp.func
    def point_on_volume(scene: SceneData, volume: Volume, ray: Ray, t: float, outside: bool) -> VolumePoint:
        passage = passage_of(volume, ray)
        numbers = numbers_of_volume(scene, volume)
        local = passage.start + passage.direction * (t - passage.begin)
        diagonal = diagonal_of(volume)
        error = t * wp.length(passage.direction) * _ROUNDINGS
        h = diagonal * _DIFFERENCE
        gradient = wp.vec3()
        mean = float(0.0)
        corners = int(4)  # a variable, or the loop would be unrolled
        for k in range(corners):
            x = wp.where(k < 2, 1.0, -1.0)
            y = wp.where(k % 2 == 0, 1.0, -1.0)
            corner = wp.vec3(x, y, x * y)
            value = distance(volume.model, numbers, local + h * corner)
            gradient += value * corner
            mean += 0.25 * value
        gradient = gradient / (4.0 * h)
        slope = wp.length(gradient)
        if not (slope > 1.0e-20 and slope < 1.0e20):
            gradient = -wp.normalize(passage.direction)
            slope = 1.0
        unit = gradient / slope
        most = 0.25 * diagonal * _CLEARANCE + error
        local -= unit * wp.clamp(mean / slope, -most, most)
        point = VolumePoint()
        point.position = point_of(volume.axes, local)
        normal = to_world_normal(volume, unit)
        point.normal = wp.vec3(normal[0], normal[1], normal[2])
        side = wp.where(outside, 1.0, -1.0)
        cosine = wp.dot(point.normal, ray.direction)
        if cosine * side > -_LEAST_COSINE:
            point.normal = wp.normalize(point.normal - ray.direction * (cosine + side * _LEAST_COSINE))
        far = wp.max(wp.abs(volume.low), wp.abs(volume.high))
        sizes = wp.abs(volume.axes.x) * far[0] + wp.abs(volume.axes.y) * far[1] + wp.abs(volume.axes.z) * far[2]
        sizes += wp.abs(volume.axes.center)
        point.clearance = clearance(point.normal, sizes, volume.axes.slack) + diagonal * _CLEARANCE / normal[3]
        size = volume.high - volume.low
        place = wp.cw_div(local - volume.low, size)
        along = wp.abs(unit)
        if along[0] > along[1] and along[0] > along[2]:
            point.uv = wp.vec2(place[2], place[1])
            point.e1 = volume.axes.z * size[2]
            point.e2 = volume.axes.y * size[1]
        elif along[1] > along[2]:
            point.uv = wp.vec2(place[0], place[2])
            point.e1 = volume.axes.x * size[0]
            point.e2 = volume.axes.z * size[2]
        else:
            point.uv = wp.vec2(place[0], place[1])
            point.e1 = volume.axes.x * size[0]
            point.e2 = volume.axes.y * size[1]
        return point

    return point_on_volume
