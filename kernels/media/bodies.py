"""The stack of bodies that a path is in, and surfaces of several bodies at the same place.

Bodies may contain one another, overlap, or touch. Where they overlap, the one with the highest priority counts, of
equal ones that entered last (Schmidt and Budge, "Simple nested dielectrics in ray traced images", Journal of Graphics
Tools 7(2), 2002): a surface that does not change this body is skipped.

A ray continues from a small offset behind a surface, and would miss others within that offset. So all surfaces within
it are found and crossed together.
"""

import warp as wp

from wrt.kernels.accel.intersect import make_intersect
from wrt.kernels.core.ray_tree import INFINITE_DISTANCE, NO_HIT, Hit
from wrt.kernels.core.rays import Ray
from wrt.kernels.core.scene_data import MOST_BODIES, BodyStack, SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.geometry.surface import Surface, leave, make_surface_at
from wrt.kernels.sampling.warps import lattice_point, square_to_sphere

MOST_TOGETHER = wp.constant(2 * MOST_BODIES)
"""The most surfaces at one place that are considered."""

_MOST_CROSSINGS = wp.constant(4096)


@wp.struct
class Meeting:
    """The interaction of a ray with one surface, or with several at one place.

    `surface` and `hit` belong to the surface that decides: one that bounds no body, or the one of the body with the
    highest priority. `stack_behind` are the bodies behind all of them.
    """

    hit: Hit
    surface: Surface
    stack_behind: BodyStack


@wp.struct
class Crossing:
    """The bodies behind the surface that a straight ray crossed last; its body, its side, and its distance."""

    stack: BodyStack
    body: int
    front: bool
    t: float


@wp.func
def is_same_crossing(last: Crossing, body: int, front: bool, t: float) -> bool:
    """Return whether a ray that goes straight on meets the same place again, at the triangle beside an edge."""
    return last.t > 0.0 and last.body == body and last.front == front and t - last.t <= 1.0e-5 * t


@wp.func
def innermost(scene: SceneData, inside: BodyStack) -> int:
    """Return the body with the highest priority that contains a point; −1 for none."""
    best = int(-1)
    for i in range(MOST_BODIES):
        if inside[i] > 0:
            body = inside[i] - 1
            if best < 0 or scene.bodies[body].priority >= scene.bodies[wp.max(best, 0)].priority:
                best = body
    return best


@wp.func
def times_in(inside: BodyStack, body: int) -> int:
    """Return how often a body is in the stack."""
    n = int(0)
    for i in range(MOST_BODIES):
        if inside[i] == body + 1:
            n += 1
    return n


@wp.func
def entered(inside: BodyStack, body: int) -> BodyStack:
    """Return the stack with a body added, unless it is full."""
    stack = inside
    place = int(MOST_BODIES)
    for i in range(MOST_BODIES):
        if inside[i] == 0 and place == MOST_BODIES:
            place = i
    if place < MOST_BODIES:
        stack[place] = body + 1
    return stack


@wp.func
def left(inside: BodyStack, body: int) -> BodyStack:
    """Return the stack with one entry of a body removed, if there is one."""
    stack = inside
    place = int(MOST_BODIES)
    for i in range(MOST_BODIES):
        if inside[i] == body + 1:
            place = i
    for i in range(MOST_BODIES - 1):
        if i >= place:
            stack[i] = inside[i + 1]
    if place < MOST_BODIES:
        stack[MOST_BODIES - 1] = 0
    return stack


@wp.func
def crossed(first: BodyStack, stack: BodyStack, body: int, front: bool) -> BodyStack:
    """Return the stack behind one more of several surfaces at one place.

    `first` is the stack in front of all of them, `stack` the one behind those crossed so far. A body is entered or left
    only once: a ray through an edge hits the triangles on both sides of it.
    """
    n = times_in(stack, body) - times_in(first, body)
    if front:
        if n <= 0:
            return entered(stack, body)
    elif n >= 0:
        return left(stack, body)
    return stack


@wp.func
def crossed_at(last: Crossing, body: int, front: bool, t: float) -> Crossing:
    """Return the crossing of a surface of a body, unless the ray has crossed that already, beside it."""
    crossing = last
    if not is_same_crossing(last, body, front, t):
        crossing.stack = crossed(last.stack, last.stack, body, front)
        crossing.body = body
        crossing.front = front
        crossing.t = t
    return crossing


@specialised()
def make_meet(geometry: str) -> wp.Function:
    """Return the device function (scene, ray, hit, surface, inside) -> Meeting.

    It considers the surfaces from the nearest hit, a point of `surface`, to the ray's clearance behind it, for a ray in
    the bodies `inside`. See `Features.geometry`.
    """
    intersect, surface_at = make_intersect(geometry), make_surface_at(geometry)

    @wp.func
    def meet(scene: SceneData, ray: Ray, hit: Hit, surface: Surface, inside: BodyStack) -> Meeting:
        m = Meeting()
        m.hit = hit
        m.surface = surface
        m.stack_behind = inside
        body = scene.shapes[m.surface.shape].body
        if body < 0:
            return m
        m.stack_behind = crossed(inside, inside, body, m.surface.front)
        highest = scene.bodies[body].priority
        probe = Ray()
        probe.origin = leave(surface, 1.0)
        probe.time = ray.time
        across = leave(surface, -1.0) - probe.origin
        length = wp.length(across)
        probe.direction = across / length
        found = intersect.closest_hit_before(scene, probe, length)
        count = int(0)
        while found.triangle != NO_HIT and count < MOST_TOGETHER:
            if found.triangle != hit.triangle or found.instance != hit.instance:
                found_surface = surface_at(scene, ray, found)
                body = scene.shapes[found_surface.shape].body
                if body < 0:
                    # A surface on the boundary covers it.
                    found.t = hit.t
                    m.hit = found
                    m.surface = found_surface
                    return m
                n = times_in(m.stack_behind, body)
                m.stack_behind = crossed(inside, m.stack_behind, body, found_surface.front)
                if times_in(m.stack_behind, body) != n and scene.bodies[body].priority > highest:
                    highest = scene.bodies[body].priority
                    m.hit = found
                    m.hit.t = hit.t
                    m.surface = found_surface
            found = intersect.next_hit(scene, probe, found, length)
            count += 1
        return m

    return meet


@wp.func
def is_there(scene: SceneData, surface: Surface, stack: BodyStack, stack_behind: BodyStack) -> bool:
    """Return whether a surface between these stacks exists optically: not if the same body is on both sides."""
    return scene.shapes[surface.shape].body < 0 or innermost(scene, stack) != innermost(scene, stack_behind)


@wp.func
def relative_indices(scene: SceneData, surface: Surface, in_front: int, behind: int) -> wp.vec4:
    """Return the refractive index inside the body that `surface` bounds over the one on the surface's other side.

    The first one is for all channels, the others are one for each. `in_front` and `behind` are the bodies on both
    sides, −1 for none. Outside of all bodies, the index is the one that the body's own material is relative to.
    """
    inner = scene.bodies[scene.shapes[surface.shape].body]
    outside = inner.exterior_ior
    spread = wp.vec3(0.0)
    body = wp.where(surface.front, in_front, behind)
    if body >= 0:
        if scene.bodies[body].ior > 0.0:
            outside = scene.bodies[body].ior
            spread = scene.bodies[body].spread
    by_channel = wp.cw_div(wp.vec3(inner.ior) + inner.spread, wp.vec3(outside) + spread)
    return wp.vec4(inner.ior / outside, by_channel[0], by_channel[1], by_channel[2])


@specialised()
def make_count_crossings(geometry: str) -> wp.Kernel:
    """Return the kernel that traces rays from a point through the whole scene, to find the bodies that contain it.

    Row k of `left_more` counts for each body how much more often ray k left it than entered it, which is how many of
    its surfaces enclose the point; `last_left` has the distance at which the ray last left it. See
    `Features.geometry`.
    """
    intersect, surface_at = make_intersect(geometry), make_surface_at(geometry)

    @wp.kernel(module=wp.get_module(make_count_crossings.module_name(geometry)), enable_backward=False)
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
        found = intersect.closest_hit(scene, ray)
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
            found = intersect.next_hit(scene, ray, found, INFINITE_DISTANCE)
            crossings += 1

    return count_crossings
