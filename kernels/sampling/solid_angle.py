"""Sampling a rectangle, a disk, a sphere or a cone by solid angle, and the densities.

Each `sample_X` returns pdf 0 if the light has no solid angle from the point: in its plane or inside the sphere. Each
`X_pdf` computes the same density in the same steps.
"""

import warp as wp

from wrt.kernels.core.elementary import arc_tangent, sine_cosine
from wrt.kernels.core.rays import Frame, make_frame, to_world
from wrt.kernels.sampling.warps import TWO_PI

SMALL_SOLID_ANGLE = wp.constant(2.0e-3)
"""Steradians below which a rectangle is sampled by area: the angles of Ureña's map lose precision there, and area and
solid angle then differ only for long, thin rectangles."""

NO_EXTENT = wp.constant(1.0e-12)
"""Distance from a light's plane, relative to its size, below which a point counts as in the plane."""


MOST_DENSE = wp.constant(1.0e18)
"""The greatest density: the square of a larger one overflows. Lights so small and far are invisible."""


@wp.func
def finite_density(pdf: float) -> float:
    """Return a density, or 0 if it exceeds the limit."""
    return wp.where(pdf < MOST_DENSE, pdf, 0.0)


@wp.struct
class Way:
    """A unit direction, the distance to the light, and the direction's density per solid angle."""

    wi: wp.vec3
    distance: float
    pdf: float


# --- Rectangle -------------------------------------------------------------------------------------


@wp.struct
class Rectangle:
    """A rectangle as seen from a point, which is the origin: [x0, x1] × [y0, y1] at distance h."""

    x0: float
    x1: float
    y0: float
    y1: float
    h: float


@wp.func
def rectangle_from(corner: wp.vec3, x: wp.vec3, y: wp.vec3, size: wp.vec2, p: wp.vec3) -> Rectangle:
    """Return the rectangle corner + [0, size]·(x, y), x and y perpendicular unit vectors, as seen from p."""
    to_corner = corner - p
    r = Rectangle()
    r.x0 = wp.dot(to_corner, x)
    r.y0 = wp.dot(to_corner, y)
    r.x1 = r.x0 + size[0]
    r.y1 = r.y0 + size[1]
    r.h = wp.abs(wp.dot(to_corner, wp.cross(x, y)))
    return r


@wp.func
def _corner_angle(x: float, y: float, h: float) -> float:
    """Return the signed solid angle of the rectangle between the foot of the perpendicular and a corner."""
    return arc_tangent(x * y, h * wp.sqrt(x * x + y * y + h * h))


@wp.func
def rectangle_solid_angle(r: Rectangle) -> float:
    """Return a rectangle's solid angle, the sum of four quadrants about the foot of the perpendicular."""
    upper = _corner_angle(r.x1, r.y1, r.h) - _corner_angle(r.x0, r.y1, r.h)
    return upper - _corner_angle(r.x1, r.y0, r.h) + _corner_angle(r.x0, r.y0, r.h)


@wp.func
def rectangle_pdf(r: Rectangle, distance: float) -> float:
    """Return the density per solid angle with which `sample_rectangle` samples a point `distance` away."""
    if r.h <= NO_EXTENT * (r.x1 - r.x0 + r.y1 - r.y0):
        return 0.0
    omega = rectangle_solid_angle(r)
    if omega >= SMALL_SOLID_ANGLE:
        return 1.0 / omega
    # One factor at a time: their product and the cube of the distance may overflow.
    return finite_density(distance / r.h * (distance / (r.x1 - r.x0)) * (distance / (r.y1 - r.y0)))


@wp.func
def sample_rectangle(r: Rectangle, u: wp.vec2) -> wp.vec2:
    """Return (x, y) of a point on the rectangle, uniform in solid angle (Ureña, Fajardo and King 2013).

    The paper's angles g2 and g3 at x0, with their sine and cosine, are computed by arc tangents of the corners, which
    stay precise where an arc cosine does not.
    """
    omega = rectangle_solid_angle(r)
    if omega < SMALL_SOLID_ANGLE:
        return wp.vec2(r.x0 + u[0] * (r.x1 - r.x0), r.y0 + u[1] * (r.y1 - r.y0))
    h2 = r.h * r.h
    b0 = -r.y0 / wp.sqrt(h2 + r.y0 * r.y0)
    b1 = r.y1 / wp.sqrt(h2 + r.y1 * r.y1)
    # phi is the paper's a_u − π.
    phi = u[0] * omega + _corner_angle(r.x0, r.y1, r.h) - _corner_angle(r.x0, r.y0, r.h)
    turned = sine_cosine(phi)
    sine = turned[0]
    up = turned[1] * b0 + b1
    across2 = up * up - sine * sine * h2 / (h2 + r.y0 * r.y0)
    x = r.h * sine * wp.sign(up) / wp.sqrt(wp.max(across2, 1.0e-30))
    x = wp.clamp(x, r.x0, r.x1)
    d2 = x * x + h2
    s0 = r.y0 / wp.sqrt(d2 + r.y0 * r.y0)
    s1 = r.y1 / wp.sqrt(d2 + r.y1 * r.y1)
    s = s0 + u[1] * (s1 - s0)
    cosine2 = (1.0 - s) * (1.0 + s)
    y = s * wp.sqrt(d2 / wp.max(cosine2, 1.0e-12))
    return wp.vec2(x, wp.clamp(y, r.y0, r.y1))


# --- Disk ------------------------------------------------------------------------------------------


@wp.struct
class EllipticCone:
    """The cone of directions from a point to a disk: (x/a)² + (y/b)² <= z² in the frame."""

    frame: Frame
    a: float
    b: float


@wp.func
def disk_cone(center: wp.vec3, normal: wp.vec3, radius: float, p: wp.vec3) -> EllipticCone:
    """Return the cone of directions to a disk; b is 0 where p lies in its plane.

    In the plane of symmetry, through p, the centre and the normal, the disk reaches from y0 to y1 at distance h. The
    cone's axis bisects the angle between the directions to both ends, at distances d0 and d1. With L = d0 d1 and M = h²
    + y0 y1, this angle has the cosine M / L, and the half-widths are a = R √(2 / (L + M)) and b = 2 R h / (L + M).
    """
    to_center = center - p
    side = wp.where(wp.dot(to_center, normal) < 0.0, -1.0, 1.0)
    ahead = normal * side
    h = wp.dot(to_center, ahead)
    flat = to_center - ahead * h
    c = wp.length(flat)
    cone = EllipticCone()
    across = make_frame(ahead).s
    if c > 1.0e-6 * (h + radius):
        across = flat / c
        across = wp.normalize(across - ahead * wp.dot(across, ahead))
    else:
        c = 0.0
    y0 = c - radius
    y1 = c + radius
    d0 = wp.sqrt(h * h + y0 * y0)
    d1 = wp.sqrt(h * h + y1 * y1)
    product = d0 * d1
    m = h * h + y0 * y1
    n = 2.0 * radius * h
    if h <= NO_EXTENT * radius or product == 0.0:
        return cone
    l_and_m = product + m
    if m < 0.0:
        l_and_m = n * n / (product - m)
    cone.a = radius * wp.sqrt(2.0 / l_and_m)
    cone.b = n / l_and_m
    # The sum of the two unit vectors; if y0 < 0 the components along y nearly cancel.
    along = y0 / d0 + y1 / d1
    if y0 < 0.0:
        along = h * h / (d0 * (d0 - y0)) - h * h / (d1 * (d1 + y1))
    axis = wp.normalize(wp.vec2(along, h / d0 + h / d1))
    cone.frame.n = across * axis[0] + ahead * axis[1]
    cone.frame.t = across * axis[1] - ahead * axis[0]
    cone.frame.s = wp.cross(cone.frame.t, cone.frame.n)
    return cone


@wp.func
def _cone_pdf(cone: EllipticCone, q2: float) -> float:
    q = wp.sqrt(q2)
    scale = wp.sqrt(1.0 + 1.0 / (cone.a * cone.a)) * wp.sqrt(1.0 + 1.0 / (cone.b * cone.b))
    return finite_density(scale * (q + 1.0) / (TWO_PI * q))


@wp.func
def disk_pdf(cone: EllipticCone, wi: wp.vec3) -> float:
    """Return the density per solid angle with which `sample_disk` samples a direction that meets the disk."""
    if cone.b <= 0.0:
        return 0.0
    x = wp.dot(wi, cone.frame.s)
    y = wp.dot(wi, cone.frame.t)
    square = x * x + y * y
    q2 = 1.0 + cone.a * cone.a
    if square > 0.0:
        q2 = 1.0 + square / (x * x / (cone.a * cone.a) + y * y / (cone.b * cone.b))
    return _cone_pdf(cone, q2)


@wp.func
def sample_disk(cone: EllipticCone, u: wp.vec2) -> Way:
    """Return a direction to a disk, nearly uniform in solid angle; its distance is left 0.

    With x = a ρ z cos φ and y = b ρ z sin φ, the solid angle between φ and φ + dφ is a b dφ / (q (q + 1)), where
    q² = 1 + a² cos²φ + b² sin²φ is 1 / cos² of the cone's half-angle there. φ is sampled by 1 / q², which inverts in
    closed form (tan φ = √(1 + a²) / √(1 + b²) tan 2πu), and the direction at φ is exactly uniform. The density is
    proportional to 1 + 1/q: it varies by less than a factor of two for any view, and not at all for small disks.
    """
    sample = Way()
    if cone.b <= 0.0:
        return sample
    turned = sine_cosine(TWO_PI * u[0])
    # a cos φ and b sin φ, up to a common factor
    cosine = turned[1] / wp.sqrt(1.0 + cone.a * cone.a)
    sine = turned[0] / wp.sqrt(1.0 + cone.b * cone.b)
    norm2 = cosine * cosine + sine * sine
    x = cosine * cone.a
    y = sine * cone.b
    s2 = (x * x + y * y) / norm2
    q2 = 1.0 + s2
    q = wp.sqrt(q2)
    below_one = u[1] * s2 / (q * (q + 1.0))  # 1 − cos of the angle to the axis
    z = 1.0 - below_one
    r = wp.sqrt(wp.max(below_one * (2.0 - below_one), 0.0)) / wp.sqrt(wp.max(x * x + y * y, 1.0e-37))
    sample.wi = wp.normalize(to_world(cone.frame, wp.vec3(x * r, y * r, z)))
    sample.pdf = _cone_pdf(cone, q2)
    return sample


# --- Sphere and round cone -------------------------------------------------------------------------


@wp.func
def cone_pdf(one_minus_cos: float) -> float:
    """Return the density of directions uniform in a cone; `one_minus_cos` is 1 − cos of its half-angle."""
    if one_minus_cos <= 0.0:
        return 0.0
    return finite_density(1.0 / (TWO_PI * one_minus_cos))


@wp.func
def sample_cone(axis: wp.vec3, one_minus_cos: float, u: wp.vec2) -> wp.vec3:
    """Return a unit direction uniform in a cone about the unit vector `axis`."""
    below_one = u[0] * one_minus_cos
    r = wp.sqrt(wp.max(below_one * (2.0 - below_one), 0.0))
    turned = sine_cosine(TWO_PI * u[1])
    local = wp.vec3(r * turned[1], r * turned[0], 1.0 - below_one)
    return wp.normalize(to_world(make_frame(axis), local))


@wp.func
def sphere_one_minus_cos(center: wp.vec3, radius: float, p: wp.vec3) -> float:
    """Return 1 − cos of a sphere's angular radius; 0 from its inside.

    It is computed from the sine, which resolves small angles (Pharr, Jakob and Humphreys 2023, section 6.2.4).
    """
    to_center = center - p
    distance = wp.length(to_center)
    if distance <= radius:
        return 0.0
    sine = radius / distance
    cosine2 = ((distance - radius) / distance) * ((distance + radius) / distance)
    return sine * sine / (1.0 + wp.sqrt(cosine2))


@wp.func
def sample_sphere(center: wp.vec3, radius: float, p: wp.vec3, u: wp.vec2) -> Way:
    """Return a direction to a sphere, uniform in solid angle, and the distance to its surface."""
    sample = Way()
    one_minus_cos = sphere_one_minus_cos(center, radius, p)
    if one_minus_cos > 0.0:
        to_center = center - p
        distance = wp.length(to_center)
        sample.wi = sample_cone(to_center / distance, one_minus_cos, u)
        sample.pdf = cone_pdf(one_minus_cos)
        below_one = u[0] * one_minus_cos
        sine2 = below_one * (2.0 - below_one)
        half_chord2 = radius * radius - distance * distance * sine2
        # By the product of both distances, (d − R)(d + R), which is more precise than a difference of squares.
        far = distance * (1.0 - below_one) + wp.sqrt(wp.max(half_chord2, 0.0))
        sample.distance = (distance - radius) * (distance + radius) / far
    return sample
