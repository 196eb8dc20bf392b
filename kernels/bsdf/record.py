"""What a reflection model is given and what it answers."""

import warp as wp


@wp.struct
class Bsdf:
    """A material at one point: its model and that model's colours there.

    What `a` and `b` mean is written at the top of each model's file. The frame's z is the shading
    normal and faces the viewer; `front` tells whether that is the front of the surface.
    """

    model: int
    a: wp.vec3
    b: wp.vec3
    front: bool


@wp.struct
class BsdfSample:
    """A direction drawn from a BSDF.

    `weight` is f |cosθi| / pdf and zero where there is none; `pdf` is per solid angle and 0 where
    `delta` says that the direction was the only one possible; `eta` is n_t / n_i, 1 but on refraction.
    """

    wi: wp.vec3
    weight: wp.vec3
    pdf: float
    delta: bool
    eta: float


@wp.func
def mirror_sample(wo: wp.vec3, reflectance: wp.vec3) -> BsdfSample:
    """Return the ideal mirror direction."""
    s = BsdfSample()
    s.wi = wp.vec3(-wo[0], -wo[1], wo[2])
    s.weight = reflectance
    s.pdf = 0.0
    s.delta = True
    s.eta = 1.0
    return s


@wp.func
def zero_evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
    """Return the value of a BSDF that is not zero in single directions only, in any other."""
    return wp.vec3(0.0)


@wp.func
def zero_pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
    """Return the density of a BSDF that samples single directions only, in any other."""
    return 0.0
