"""Fresnel reflectance of smooth boundaries for unpolarised light."""

import warp as wp


@wp.func
def cos_transmitted_squared(cos_i: float, eta: float) -> float:
    """Return cos²θt by Snell's law, eta = n_t / n_i; not positive beyond the critical angle."""
    return 1.0 - (1.0 - cos_i * cos_i) / (eta * eta)


@wp.func
def refracted_by(m: wp.vec3, wo: wp.vec3, cos_o: float, eta: float) -> wp.vec3:
    """Return the direction into which a facet refracts, a unit vector up to rounding (Walter 2007, eq. 40)."""
    cos_t = wp.sqrt(wp.max(cos_transmitted_squared(cos_o, eta), 0.0))
    return m * (cos_o / eta - cos_t) - wo / eta


@wp.func
def fresnel_dielectric(cos_i: float, eta: float) -> float:
    """Return (F_s + F_p) / 2 for cosθi ≥ 0 and eta = n_t / n_i; 1 under total internal reflection."""
    cos2_t = cos_transmitted_squared(cos_i, eta)
    if cos2_t <= 0.0:
        return 1.0
    cos_t = wp.sqrt(cos2_t)
    r_s = (cos_i - eta * cos_t) / (cos_i + eta * cos_t)
    r_p = (eta * cos_i - cos_t) / (eta * cos_i + cos_t)
    return 0.5 * (r_s * r_s + r_p * r_p)


@wp.func
def fresnel_conductor_channel(cos_i: float, eta: float, k: float) -> float:
    """Return the reflectance of a metal with complex index eta + i k (Born and Wolf, section 14.2).

    Written with a² + b² as in Lazányi and Szirmay-Kalos (2005): exact, not an approximation.
    """
    cos2 = cos_i * cos_i
    sin2 = 1.0 - cos2
    t0 = eta * eta - k * k - sin2
    a2_plus_b2 = wp.sqrt(t0 * t0 + 4.0 * eta * eta * k * k)
    a = wp.sqrt(wp.max(0.0, 0.5 * (a2_plus_b2 + t0)))
    t1 = a2_plus_b2 + cos2
    t2 = 2.0 * a * cos_i
    r_s = (t1 - t2) / (t1 + t2)
    t3 = cos2 * a2_plus_b2 + sin2 * sin2
    t4 = t2 * sin2
    r_p = r_s * (t3 - t4) / (t3 + t4)
    return wp.max(0.5 * (r_s + r_p), 0.0)  # rounding can make tiny reflectances negative


@wp.func
def fresnel_conductor(cos_i: float, eta: wp.vec3, k: wp.vec3) -> wp.vec3:
    """Return the reflectance of a metal per channel."""
    return wp.vec3(
        fresnel_conductor_channel(cos_i, eta[0], k[0]),
        fresnel_conductor_channel(cos_i, eta[1], k[1]),
        fresnel_conductor_channel(cos_i, eta[2], k[2]),
    )


@wp.func
def schlick_weight(cosine: float) -> float:
    """Return (1 − cosθ)⁵."""
    x = wp.clamp(1.0 - cosine, 0.0, 1.0)
    x2 = x * x
    return x2 * x2 * x


@wp.func
def schlick(cos_i: float, f0: wp.vec3, f90: float) -> wp.vec3:
    """Return F0 + (F90 − F0)(1 − cosθ)⁵ for reflectances at normal and at grazing incidence (Schlick 1994, eq. 15)."""
    return f0 + (wp.vec3(f90) - f0) * schlick_weight(cos_i)


@wp.func
def fresnel_schlick(cos_i: float, f0: wp.vec3) -> wp.vec3:
    """Return `schlick` with a reflectance of 1 at grazing incidence."""
    return schlick(cos_i, f0, 1.0)
