"""Sampling an exact cylinder by angle and height.

From a point outside, a cylinder fills an angle about the parallel to its axis through the point; from a point inside, a
whole turn. That angle α is sampled uniformly, and so is the height h along the axis. In a direction that makes the
angle γ with the axis, dα dh is the solid angle sin²γ / r dα dh at the distance r. The density has no cosine at the
light, and no sample is wasted on what the point cannot see.
"""

import warp as wp

from wrt.kernels.geometry.quadrics import Quadric, in_unit_shape
from wrt.kernels.math.trigonometry import arc_tangent, sine_cosine
from wrt.kernels.sampling.solid_angle import finite_density
from wrt.kernels.sampling.warps import TWO_PI


@wp.struct
class CylinderView:
    """What a point may see shine of a cylinder, in the plane across its axis, in radii.

    The point is at `distance` from the axis, in the direction `towards`. The cylinder fills the angle `width` there,
    radians. A line from the point meets the wall twice: whether the `near` and the `far` meeting count.
    """

    towards: wp.vec2
    distance: float
    width: float
    near: bool
    far: bool


@wp.func
def view_of_cylinder(quadric: Quadric, two_sided: int, position: wp.vec3) -> CylinderView:
    """Return what a point sees.

    The far wall from outside is seen through an end alone, so from none of the places beside the cylinder.
    """
    view = CylinderView()
    place = in_unit_shape(quadric, position - quadric.center)
    view.towards = wp.vec2(1.0, 0.0)
    view.distance = wp.sqrt(place[0] * place[0] + place[1] * place[1])
    if view.distance > 0.0:
        view.towards = wp.vec2(place[0] / view.distance, place[1] / view.distance)
    outside = view.distance > 1.0
    view.width = TWO_PI
    if outside:
        view.width = 2.0 * arc_tangent(1.0, wp.sqrt((view.distance - 1.0) * (view.distance + 1.0)))
    view.near = outside and (two_sided != 0 or quadric.side > 0.0)
    beside = outside and wp.abs(place[2]) <= 0.5
    view.far = not beside and (two_sided != 0 or quadric.side < 0.0)
    return view


@wp.func
def place_on_cylinder(view: CylinderView, u: wp.vec2) -> wp.vec3:
    """Return a place on the unit cylinder; u = 0 is the nearest one of the circle in the middle."""
    share = u[0]
    near = view.near
    if view.near and view.far:
        near = u[0] < 0.5
        share = wp.where(near, 2.0 * u[0], 2.0 * u[0] - 1.0)
    turned = sine_cosine(view.width * wp.where(share < 0.5, share, share - 1.0))
    off_axis = view.distance * turned[0]
    half_chord = wp.sqrt(wp.max(1.0 - off_axis * off_axis, 0.0))
    half_chord = wp.where(near, half_chord, -half_chord)
    # Along `towards`, and across it
    x = off_axis * turned[0] + half_chord * turned[1]
    y = off_axis * turned[1] - half_chord * turned[0]
    scale = 1.0 / wp.sqrt(x * x + y * y)
    x = x * scale
    y = y * scale
    height = wp.where(u[1] < 0.5, u[1], u[1] - 1.0)
    return wp.vec3(x * view.towards[0] - y * view.towards[1], x * view.towards[1] + y * view.towards[0], height)


@wp.func
def cylinder_pdf(quadric: Quadric, view: CylinderView, direction: wp.vec3, distance: float) -> float:
    """Return the density per solid angle of `place_on_cylinder` in a direction that meets it at a distance."""
    sides = wp.where(view.near, 1.0, 0.0) + wp.where(view.far, 1.0, 0.0)
    length = wp.length(quadric.z)
    sine2 = wp.length_sq(wp.cross(direction, quadric.z / length))
    if sides == 0.0 or sine2 == 0.0:
        return 0.0
    return finite_density(distance / (sides * sine2 * view.width * length))
