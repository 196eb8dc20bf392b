"""Reflectance of a surface under a thin transparent film, whose two faces reflect waves that interfere.

Airy's sum for one wavelength and one polarisation (Born and Wolf, section 7.6), with ρ the amplitude that the film's
outer face reflects, q that of its inner face, and D the difference of paths:

    r = (ρ + q e^{iφ}) / (1 + ρ q e^{iφ}),    φ = 2π D / λ,    D = 2 n₂ d cosθ₂.

With c = −ρ q, |r|² = 1 − A (1 + 2 Σ Re(c^m e^{imφ})), m ≥ 1, where A = (1 − ρ²)(1 − |q|²) / (1 − |c|²). A channel sees
the mean over wavelengths, where S(m D), the transform of its weight, takes the place of e^{imφ} (Belcour and Barla, "A
practical extension to microfacet theory for the modeling of varying iridescence", 2017, section 4). Indices are the
same for all wavelengths of a channel. A sum of Gaussians approximates S to 0.02 (`scripts/thin_film_fit.py`), and
ends where terms are below LEAST_TERM.
"""

import warp as wp

from wrt.kernels.bsdf.lobes.fresnel import fresnel_dielectric, fresnel_schlick
from wrt.kernels.core.elementary import exponential, sine_cosine
from wrt.kernels.sampling.warps import TWO_PI

FARTHEST = wp.constant(40.0)
"""Differences of paths beyond this, µm, count as this: S is 0 there."""

LEAST_TERM = wp.constant(1.0e-3)
MOST_TERMS = wp.constant(32)

MOST_F0 = wp.constant(0.9999)
"""Reflectance at normal incidence beyond which an index would be infinite."""

_TWO_PI_SQUARED = wp.constant(19.739208802178716)


@wp.struct
class Channels:
    """A complex number for each channel."""

    re: wp.vec3
    im: wp.vec3


@wp.func
def times(x: Channels, y: Channels) -> Channels:
    """Return the product per channel."""
    z = Channels()
    z.re = wp.cw_mul(x.re, y.re) - wp.cw_mul(x.im, y.im)
    z.im = wp.cw_mul(x.re, y.im) + wp.cw_mul(x.im, y.re)
    return z


@wp.func
def _gaussian(d: float, wavenumber: float, width: float) -> wp.vec2:
    wave = sine_cosine(TWO_PI * d * wavenumber)
    dw = d * width
    return wave * exponential(-_TWO_PI_SQUARED * dw * dw)


@wp.func
def _gaussian_slope(d: float, wavenumber: float, width: float) -> wp.vec2:
    wave = _gaussian(d, wavenumber, width)
    turning = TWO_PI * wavenumber
    return wave * (-2.0 * _TWO_PI_SQUARED * d * width * width) + wp.vec2(wave[1], -wave[0]) * turning


def _summed(name: str, gaussian: wp.Function) -> wp.Function:
    """Return the device function (difference of paths, µm) -> Channels, the sum of S over Gaussians or their slopes."""

    @wp.func(name=name)
    def summed(d: float) -> Channels:
        a = gaussian(d, 1.6356, 0.0624)
        b = gaussian(d, 1.7311, 0.1068)
        c = gaussian(d, 1.8295, 0.1143)
        e = gaussian(d, 2.1923, 0.1093)
        f = gaussian(d, 2.2181, 0.1006)
        w_a = wp.vec3(0.69745, -0.13080, 0.01335)
        w_b = wp.vec3(1.76072, -0.18515, -0.05130)
        w_c = wp.vec3(-1.47746, 1.39148, -0.10073)
        w_e = wp.vec3(-0.57756, 0.27577, 0.56201)
        w_f = wp.vec3(0.59684, -0.35130, 0.57667)
        s = Channels()
        s.re = w_a * a[1] + w_b * b[1] + w_c * c[1] + w_e * e[1] + w_f * f[1]
        s.im = w_a * a[0] + w_b * b[0] + w_c * c[0] + w_e * e[0] + w_f * f[0]
        return s

    return summed


sensitivity, sensitivity_slope = _summed("sensitivity", _gaussian), _summed("sensitivity_slope", _gaussian_slope)
"""S of a difference of paths in µm, and its derivative."""


@wp.func
def _root(re: float, im: float) -> wp.vec2:
    """Return the square root of a complex number whose imaginary part is not negative."""
    length = wp.sqrt(re * re + im * im)
    return wp.vec2(wp.sqrt(wp.max(0.5 * (length + re), 0.0)), wp.sqrt(wp.max(0.5 * (length - re), 0.0)))


@wp.func_grad(_root)
def _root_adjoint(re: float, im: float, adj_ret: wp.vec2):
    # dw = dz / (2 w), also for a real z, where a part of w is the root of 0.
    w = _root(re, im)
    scale = 0.5 / wp.max(wp.dot(w, w), 1.0e-30)
    wp.adjoint[re] += scale * (adj_ret[0] * w[0] - adj_ret[1] * w[1])
    wp.adjoint[im] += scale * (adj_ret[0] * w[1] + adj_ret[1] * w[0])


@wp.func
def _inner_face(outer: float, x: wp.vec2, y: wp.vec2) -> wp.vec3:
    # q = (x − y) / (x + y) for complex x and y. Returned are A, and c = −ρ q.
    sum2 = (x[0] + y[0]) * (x[0] + y[0]) + (x[1] + y[1]) * (x[1] + y[1])
    inverse = 1.0 / wp.max(sum2, 1.0e-30)
    through = 4.0 * (x[0] * y[0] + x[1] * y[1]) * inverse  # 1 − |q|²
    re = -outer * (wp.dot(x, x) - wp.dot(y, y)) * inverse
    im = -outer * 2.0 * (x[1] * y[0] - x[0] * y[1]) * inverse
    a = (1.0 - outer * outer) * through / wp.max(1.0 - re * re - im * im, 1.0e-12)
    return wp.vec3(wp.clamp(a, 0.0, 1.0), re, im)


@wp.func
def _terms(a: wp.vec3, power: Channels, s: Channels) -> wp.vec3:
    return wp.cw_mul(a, wp.cw_mul(power.re, s.re) - wp.cw_mul(power.im, s.im))


@wp.func
def _size(a: wp.vec3, power: Channels) -> float:
    return wp.max(wp.cw_mul(a, wp.cw_mul(power.re, power.re) + wp.cw_mul(power.im, power.im)))


@wp.func
def _waves(s_a: wp.vec3, s_re: wp.vec3, s_im: wp.vec3, p_a: wp.vec3, p_re: wp.vec3, p_im: wp.vec3, d: float) -> wp.vec3:
    """Return 1 − |r|², the mean over both polarisations, from A and c of each and the difference of paths."""
    total = (s_a + p_a) * 0.5
    s_c = Channels()
    p_c = Channels()
    s_c.re = s_re
    s_c.im = s_im
    p_c.re = p_re
    p_c.im = p_im
    s_power = s_c
    p_power = p_c
    m = int(1)
    while m <= MOST_TERMS and wp.max(_size(s_a, s_power), _size(p_a, p_power)) > LEAST_TERM * LEAST_TERM:
        wave = sensitivity(wp.min(float(m) * d, FARTHEST))
        total += _terms(s_a, s_power, wave) + _terms(p_a, p_power, wave)
        s_power = times(s_power, s_c)
        p_power = times(p_power, p_c)
        m += 1
    return total


@wp.func_grad(_waves)
def _waves_adjoint(
    s_a: wp.vec3,
    s_re: wp.vec3,
    s_im: wp.vec3,
    p_a: wp.vec3,
    p_re: wp.vec3,
    p_im: wp.vec3,
    d: float,
    adj_ret: wp.vec3,
):
    # Warp's own adjoint of a loop that carries values is wrong. Of Re(cᵐ S(m D)) the derivatives are
    # m cᵐ⁻¹ S by c and m cᵐ S' by D.
    one = wp.vec3(1.0)
    s_c = Channels()
    p_c = Channels()
    s_c.re = s_re
    s_c.im = s_im
    p_c.re = p_re
    p_c.im = p_im
    s_before = Channels()
    p_before = Channels()
    s_before.re = one
    p_before.re = one
    s_power = s_c
    p_power = p_c
    by_s_a = one * 0.5
    by_p_a = one * 0.5
    s_slope = Channels()
    p_slope = Channels()
    by_d = wp.vec3(0.0)
    m = int(1)
    while m <= MOST_TERMS and wp.max(_size(s_a, s_power), _size(p_a, p_power)) > LEAST_TERM * LEAST_TERM:
        distance = wp.min(float(m) * d, FARTHEST)
        wave = sensitivity(distance)
        by_s_a += _terms(one, s_power, wave)
        by_p_a += _terms(one, p_power, wave)
        s_term = times(s_before, wave)
        p_term = times(p_before, wave)
        s_slope.re += s_term.re * float(m)
        s_slope.im += s_term.im * float(m)
        p_slope.re += p_term.re * float(m)
        p_slope.im += p_term.im * float(m)
        slope = sensitivity_slope(distance)
        by_d += (_terms(s_a, s_power, slope) + _terms(p_a, p_power, slope)) * float(m)
        s_before = s_power
        p_before = p_power
        s_power = times(s_power, s_c)
        p_power = times(p_power, p_c)
        m += 1
    by_s = wp.cw_mul(adj_ret, s_a)
    by_p = wp.cw_mul(adj_ret, p_a)
    wp.adjoint[s_a] += wp.cw_mul(adj_ret, by_s_a)
    wp.adjoint[s_re] += wp.cw_mul(by_s, s_slope.re)
    wp.adjoint[s_im] += -wp.cw_mul(by_s, s_slope.im)
    wp.adjoint[p_a] += wp.cw_mul(adj_ret, by_p_a)
    wp.adjoint[p_re] += wp.cw_mul(by_p, p_slope.re)
    wp.adjoint[p_im] += -wp.cw_mul(by_p, p_slope.im)
    wp.adjoint[d] += wp.dot(adj_ret, by_d)


@wp.func
def film_reflectance(cos_i: float, index: float, thickness: float, eta: wp.vec3, k: wp.vec3) -> wp.vec3:
    """Return the reflectance of a film on a dielectric or metal for unpolarised light, per channel, 0 to 1.

    Args:
        cos_i: cosine outside, greater than 0.
        index: the film's refractive index over that outside.
        thickness: the film's, times the index outside, µm.
        eta: real part of the index of what is below, over that outside.
        k: imaginary part of that; 0 for dielectrics.
    """
    sin2 = wp.max(1.0 - cos_i * cos_i, 0.0)
    cos2 = 1.0 - sin2 / (index * index)
    if cos2 <= 0.0:
        return wp.vec3(1.0)
    cos_film = wp.sqrt(cos2)
    outer_s = (cos_i - index * cos_film) / (cos_i + index * cos_film)
    outer_p = (index * cos_i - cos_film) / (index * cos_i + cos_film)
    # A and c of both polarisations, s and p
    s_a = wp.vec3(0.0)
    p_a = wp.vec3(0.0)
    s_re = wp.vec3(0.0)
    p_re = wp.vec3(0.0)
    s_im = wp.vec3(0.0)
    p_im = wp.vec3(0.0)
    for i in range(3):
        # n₃ cosθ₃ = √(n₃² − sin²θ), with both parts positive
        square = wp.vec2(eta[i] * eta[i] - k[i] * k[i], 2.0 * eta[i] * k[i])
        below = _root(square[0] - sin2, square[1])
        face = _inner_face(outer_s, wp.vec2(index * cos_film, 0.0), below)
        s_a[i] = face[0]
        s_re[i] = face[1]
        s_im[i] = face[2]
        face = _inner_face(outer_p, square * cos_film, below * index)
        p_a[i] = face[0]
        p_re[i] = face[1]
        p_im[i] = face[2]

    d = 2.0 * index * thickness * cos_film
    reflected = wp.vec3(1.0) - _waves(s_a, s_re, s_im, p_a, p_re, p_im, d)
    return wp.vec3(wp.clamp(reflected[0], 0.0, 1.0), wp.clamp(reflected[1], 0.0, 1.0), wp.clamp(reflected[2], 0.0, 1.0))


@wp.func
def film_change(film: wp.vec3, cos_i: float, f0: wp.vec3) -> wp.vec3:
    """Return by how much a film changes the reflectance of a surface whose index is real, per channel.

    Without a film it is 0, and where its thickness or its contrast vanishes it tends to 0.

    Args:
        film: the share of the surface with a film, its index over that outside, and its thickness, µm.
        cos_i: cosine outside.
        f0: reflectance of the surface at normal incidence, which tells its index.
    """
    if film[0] <= 0.0 or film[2] <= 0.0:
        return wp.vec3(0.0)
    index = wp.vec3(_index_of(f0[0]), _index_of(f0[1]), _index_of(f0[2]))
    cosine = wp.clamp(cos_i, 1.0e-4, 1.0)
    unfilmed = wp.vec3(
        fresnel_dielectric(cosine, index[0]),
        fresnel_dielectric(cosine, index[1]),
        fresnel_dielectric(cosine, index[2]),
    )
    return (film_reflectance(cosine, film[1], film[2], index, wp.vec3(0.0)) - unfilmed) * film[0]


@wp.func
def _index_of(f0: float) -> float:
    root = wp.sqrt(wp.clamp(f0, 0.0, MOST_F0))
    return (1.0 + root) / (1.0 - root)


@wp.func
def filmed_conductor(cos_i: float, eta: wp.vec3, k: wp.vec3, thickness: float, index: float) -> wp.vec3:
    """Return the reflectance of a metal with complex index eta + i k under a film; its thickness is in nm."""
    return film_reflectance(wp.max(cos_i, 1.0e-4), index, 1.0e-3 * wp.max(thickness, 0.0), eta, k)


@wp.func
def filmed_schlick(cos_i: float, f0: wp.vec3, thickness: float, index: float) -> wp.vec3:
    """Return the same of a metal by Schlick's approximation, with the reflectance f0 at normal incidence."""
    film = wp.vec3(1.0, index, 1.0e-3 * wp.max(thickness, 0.0))
    reflected = fresnel_schlick(cos_i, f0) + film_change(film, cos_i, f0)
    return wp.min(wp.max(reflected, wp.vec3(0.0)), wp.vec3(1.0))
