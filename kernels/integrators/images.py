"""Images of small lamps in clear surfaces, as camera paths see them where photons bring the rest of the light.

Photons cannot bring what smooth surfaces alone reflect to the camera, and Fresnel's share, 4 %, seldom finds a lamp.
"""

import warp as wp

from wrt.kernels.bsdf import make_by_viewer, make_is_any, model_of
from wrt.kernels.core.bsdf import Bsdf, BsdfSample, SpecularLobes, no_sample
from wrt.kernels.core.specialise import specialised

LEAST_REFLECTED = wp.constant(0.25)
"""Least share of paths that clear surfaces reflect."""


@wp.func
def no_lobes(bsdf: Bsdf, wo: wp.vec3) -> SpecularLobes:
    """Return the lobes of a surface that is not clear."""
    return SpecularLobes()


@specialised()
def make_sample_image(names: tuple[str, ...]) -> wp.Function:
    """Return the device function (bsdf, wo, u_lobe, sample) -> BsdfSample: of clear surfaces another one.

    They only reflect and refract, each in one direction, whatever the wavelength.
    """
    models = {name: model_of(name) for name in names}
    clear = tuple(k for k, m in models.items() if m.delta and m.index_slot >= 0 and m.channels_slot < 0 and m.specular)
    is_clear, specular = make_is_any(clear), make_by_viewer(clear, "specular", no_lobes)

    @wp.func
    def sample_image(bsdf: Bsdf, wo: wp.vec3, u_lobe: float, sample: BsdfSample) -> BsdfSample:
        if not is_clear(bsdf):
            return sample
        lobes = specular(bsdf, wo)
        mirrored = wp.max(lobes.reflected)
        through = wp.max(lobes.transmitted) * lobes.eta * lobes.eta
        share = float(1.0)
        if through > 0.0:
            share = wp.where(mirrored > 0.0, wp.max(mirrored / (mirrored + through), LEAST_REFLECTED), 0.0)
        found = no_sample()
        if u_lobe < share:
            found.wi = wp.vec3(-wo[0], -wo[1], wo[2])
            found.weight = lobes.reflected / share
        else:
            found.wi = lobes.through
            found.weight = lobes.transmitted / wp.max(1.0 - share, 1.0e-6)
            found.eta = lobes.eta
        return found

    return sample_image
