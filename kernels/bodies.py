"""In which bodies a path is, and what it meets where the surfaces of several lie in one place.

Bodies may lie within one another, overlap, or touch. Where they overlap the one of the highest priority is there, of
equals the one entered last (Schmidt and Budge, "Simple nested dielectrics in ray traced images", Journal of Graphics
Tools 7(2), 2002): a surface at which that body stays the same is passed as if it were not there.

A ray goes on a little behind the surface that it met, and would not meet any other before that. So all surfaces
within this little are looked for and crossed together.
"""

import functools

import warp as wp

from wrt.kernels.bvh import Hit
from wrt.kernels.geometry import Ray
from wrt.kernels.intersect import INFINITE_DISTANCE, NO_HIT, make_intersect
from wrt.kernels.scene_data import MOST_BODIES, BodyStack, SceneData
from wrt.kernels.surface import Surface, leave, make_surface_at
from wrt.kernels.warps import lattice_point, square_to_sphere

MOST_TOGETHER = wp.constant(2 * MOST_BODIES)
"""Surfaces in one place that are looked at."""

_FULL = wp.constant(MOST_BODIES)
_MOST_CROSSINGS = wp.constant(4096)


@wp.struct
class Meeting:
    """Where a ray meets one surface, or several in one place.

    `surface` and `hit` are those of the surface that decides what happens: one that bounds no body, or the one of the
    body of the highest priority. `after` are the bodies behind all of them.
    """

    hit: Hit
    surface: Surface
    after: BodyStack


@wp.struct
class Crossing:
    """A body's surface that a ray crossed last, which side of it was met, and at what distance."""

    body: int
    front: bool
    t: float


@wp.func
def is_same_crossing(last: Crossing, body: int, front: bool, t: float) -> bool:
    """Return whether a ray that goes straight on meets the same place again: by the triangle beside an edge."""
    return last.t > 0.0 and last.body == body and last.front == front and t - last.t <= 1.0e-5 * t


@wp.func
def innermost(scene: SceneData, inside: BodyStack) -> int:
    """Return the body that is there of all that a point is in; −1 where there is none."""
    best = int(-1)
    for i in range(MOST_BODIES):
        if inside[i] > 0:
            body = inside[i] - 1
            if best < 0 or scene.bodies[body].priority >= scene.bodies[wp.max(best, 0)].priority:
                best = body
    return best


@wp.func
def times_in(inside: BodyStack, body: int) -> int:
    """Return how many surfaces of this body enclose a point."""
    n = int(0)
    for i in range(MOST_BODIES):
        if inside[i] == body + 1:
            n += 1
    return n


@wp.func
def entered(inside: BodyStack, body: int) -> BodyStack:
    """Return the bodies with one more; if there is no room for it, without."""
    after = inside
    place = int(_FULL)
    for i in range(MOST_BODIES):
        if inside[i] == 0 and place == _FULL:
            place = i
    if place < _FULL:
        after[place] = body + 1
    return after


@wp.func
def left(inside: BodyStack, body: int) -> BodyStack:
    """Return the bodies without this one, once; the same bodies where it is not among them."""
    after = inside
    place = int(_FULL)
    for i in range(MOST_BODIES):
        if inside[i] == body + 1:
            place = i
    for i in range(MOST_BODIES - 1):
        if i >= place:
            after[i] = inside[i + 1]
    if place < _FULL:
        after[_FULL - 1] = 0
    return after


@wp.func
def crossed(before: BodyStack, after: BodyStack, body: int, front: bool) -> BodyStack:
    """Return the bodies behind one more surface of several in one place.

    `before` are those before all of them, and `after` behind the ones already crossed. A body is entered or left once:
    a ray through an edge meets the triangles on both sides of it.
    """
    n = times_in(after, body) - times_in(before, body)
    if front:
        if n <= 0:
            return entered(after, body)
    elif n >= 0:
        return left(after, body)
    return after


@functools.cache
def make_meet(instances: str) -> wp.Function:
    """Return the device function (scene, ray, hit, surface, inside) -> Meeting.

    It says what a ray through these bodies meets at its nearest hit, a point of `surface`, and within its clearance;
    `instances` as in Features.
    """
    _, closest_hit_before, next_hit, _ = make_intersect(instances)
    surface_at = make_surface_at(instances)

    @wp.func(name=f"meet_{instances}")
    def meet(scene: SceneData, ray: Ray, hit: Hit, surface: Surface, inside: BodyStack) -> Meeting:
        m = Meeting()
        m.hit = hit
        m.surface = surface
        m.after = inside
        body = scene.shapes[m.surface.shape].body
        if body < 0:
            return m
        m.after = crossed(inside, inside, body, m.surface.front)
        highest = scene.bodies[body].priority
        probe = Ray()
        probe.origin = leave(surface, 1.0)
        probe.time = ray.time
        way = leave(surface, -1.0) - probe.origin
        length = wp.length(way)
        probe.direction = way / length
        found = closest_hit_before(scene, probe, length)
        met = int(0)
        while found.triangle != NO_HIT and met < MOST_TOGETHER:
            if found.triangle != hit.triangle or found.instance != hit.instance:
                other = surface_at(scene, ray, found)
                body = scene.shapes[other.shape].body
                if body < 0:
                    # What lies on a boundary covers it.
                    found.t = hit.t
                    m.hit = found
                    m.surface = other
                    return m
                n = times_in(m.after, body)
                m.after = crossed(inside, m.after, body, other.front)
                if times_in(m.after, body) != n and scene.bodies[body].priority > highest:
                    highest = scene.bodies[body].priority
                    m.hit = found
                    m.hit.t = hit.t
                    m.surface = other
            found = next_hit(scene, probe, found, length)
            met += 1
        return m

    return meet


@wp.func
def is_there(scene: SceneData, surface: Surface, inside: BodyStack, after: BodyStack) -> bool:
    """Return whether a surface between these bodies parts anything: unless the same body is on both sides."""
    return scene.shapes[surface.shape].body < 0 or innermost(scene, inside) != innermost(scene, after)


@wp.func
def relative_index(scene: SceneData, surface: Surface, before: int, after: int) -> float:
    """Return the refractive index inside the body that `surface` bounds over that on the surface's other side.

    `before` and `after` are the bodies on both sides, −1 where there is none: there the index is the one that the
    body's own material has for what is around it.
    """
    body = scene.bodies[scene.shapes[surface.shape].body]
    other = wp.where(surface.front, before, after)
    outside = body.exterior_ior
    if other >= 0:
        if scene.bodies[other].ior > 0.0:
            outside = scene.bodies[other].ior
    return body.ior / outside


@functools.cache
def make_count_crossings(instances: str) -> wp.Kernel:
    """Return the kernel that follows rays from a point through everything, and notes of each body what they tell.

    Row k of `left_more` is how much more often ray k left a body than it entered it, which is how many of its surfaces
    enclose the point; of `last_left` it is the distance at which it was last left. `instances` as in Features.
    """
    closest_hit, _, next_hit, _ = make_intersect(instances)
    surface_at = make_surface_at(instances)

    @wp.kernel(module=wp.get_module(f"wrt.bodies.{instances}"), enable_backward=False)
    def count_crossings(
        first_ray: int,
        rays: int,
        scene: SceneData,
        origin: wp.vec3,
        time: float,
        left_more: wp.array2d(dtype=int),
        last_left: wp.array2d(dtype=float),
    ):
        k = first_ray + wp.tid()
        ray = Ray()
        ray.origin = origin
        ray.direction = square_to_sphere(lattice_point(k, rays))
        ray.time = time
        found = closest_hit(scene, ray)
        crossings = int(0)
        while found.triangle != NO_HIT and crossings < _MOST_CROSSINGS:
            surface = surface_at(scene, ray, found)
            body = scene.shapes[surface.shape].body
            if body >= 0:
                if surface.front:
                    left_more[k, body] = left_more[k, body] - 1
                else:
                    left_more[k, body] = left_more[k, body] + 1
                    last_left[k, body] = wp.max(last_left[k, body], found.t)
            found = next_hit(scene, ray, found, INFINITE_DISTANCE)
            crossings += 1

    return count_crossings
