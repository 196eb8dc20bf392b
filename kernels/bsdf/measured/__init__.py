"""A measured reflectance, in the adaptive parameterisation of Dupuy and Jakob (2018).

f |cosθi| = M(u) D(m) / (4 σ(o)), with the facet normal m halfway between both directions. D is the distribution of
normals and σ the area that they show to the viewer, both found from measured retroreflection. M is what was measured
besides, a smooth function of u: the point of the unit square that is warped to m by the density of visible normals.
A second warp, by the brightness of M, precedes that one where directions are drawn.
"""

import warp as wp

from wrt.kernels.bsdf.measured.tables import (
    TWO_OVER_PI,
    Tables,
    Viewed,
    angle_of,
    color_at,
    factor_at,
    tables_of,
    turned,
    view_of,
)
from wrt.kernels.core.bsdf import Bsdf, BsdfSample, Model, no_sample
from wrt.kernels.core.elementary import arc_tangent, sine_cosine
from wrt.kernels.sampling.bilinear import density_at, invert_grid, sample_grid
from wrt.kernels.sampling.warps import PI, TWO_PI

_HALF_PI = wp.constant(1.5707963267948966)
_LEAST_COSINE = wp.constant(1.0e-7)
# Mitsuba's bound on the solid angle of a point of the square near the pole.
_LEAST_ANGLE = wp.constant(1.0e-6)


@wp.func
def _place_of(t: Tables, v: Viewed, m: wp.vec3) -> wp.vec2:
    """Return the point of the square that stands for a normal."""
    azimuth = arc_tangent(m[1], m[0]) - wp.where(t.isotropic, v.azimuth, 0.0)
    turns = (azimuth + PI) / TWO_PI
    return wp.vec2(wp.sqrt(angle_of(m) * TWO_OVER_PI), turns - wp.floor(turns))


@wp.func
def _solid_angle(v: Viewed, facet: wp.vec2, m: wp.vec3) -> float:
    """Return the solid angle of mirrored directions to the area of the square of normals.

    dω_m = sinθ dθ dφ with θ = π/2 x² and φ = π (2y − 1); dω_i = 4 (o·m) dω_m.
    """
    sine = wp.sqrt(m[0] * m[0] + m[1] * m[1])
    of_normals = wp.max(2.0 * PI * PI * facet[0] * sine, _LEAST_ANGLE)
    return of_normals * 4.0 * wp.max(wp.dot(v.wo, m), _LEAST_COSINE)


@wp.func
def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
    """Return f |cosθi|."""
    if wi[2] <= 0.0 or wo[2] <= 0.0:
        return wp.vec3(0.0)
    t = tables_of(bsdf)
    v = view_of(bsdf, t, wo)
    facet = _place_of(t, v, wp.normalize(v.wo + turned(wi, v.signs)))
    u = invert_grid(bsdf.tables, t.visible, v.blend, facet)
    return color_at(bsdf, t, v, wp.vec2(u[0], u[1])) * factor_at(bsdf, t, v, facet)


@wp.func
def pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
    """Return the density of `sample` per solid angle."""
    if wi[2] <= 0.0 or wo[2] <= 0.0:
        return 0.0
    t = tables_of(bsdf)
    v = view_of(bsdf, t, wo)
    m = wp.normalize(v.wo + turned(wi, v.signs))
    facet = _place_of(t, v, m)
    u = invert_grid(bsdf.tables, t.visible, v.blend, facet)
    brightness = density_at(bsdf.tables, t.brightness, v.blend, wp.vec2(u[0], u[1]))
    return u[2] * brightness / _solid_angle(v, facet, m)


@wp.func
def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    """Return the mirrored direction of a normal that both warps find; none where it points below the surface."""
    if wo[2] <= 0.0:
        return no_sample()
    t = tables_of(bsdf)
    v = view_of(bsdf, t, wo)
    bright = sample_grid(bsdf.tables, t.brightness, v.blend, u)
    warped = wp.vec2(bright[0], bright[1])
    visible = sample_grid(bsdf.tables, t.visible, v.blend, warped)
    facet = wp.vec2(visible[0], visible[1])
    across = sine_cosine(PI * (2.0 * facet[1] - 1.0) + wp.where(t.isotropic, v.azimuth, 0.0))
    up = sine_cosine(_HALF_PI * facet[0] * facet[0])
    m = wp.vec3(across[1] * up[0], across[0] * up[0], up[1])
    wi = m * (2.0 * wp.dot(v.wo, m)) - v.wo
    density = visible[2] * bright[2] / _solid_angle(v, facet, m)
    if wi[2] <= 0.0 or density <= 0.0:
        return no_sample()
    s = BsdfSample()
    s.wi = wp.normalize(turned(wi, v.signs))
    s.weight = color_at(bsdf, t, v, warped) * (factor_at(bsdf, t, v, facet) / density)
    s.pdf = density
    s.delta = False
    s.eta = 1.0
    return s


MEASURED = Model(evaluate, pdf, sample, slots=0)
