"""A user-defined material: dust of the Moon, by the law of Lommel and Seeliger (Hapke 2012, chapter 8)."""

from dataclasses import dataclass

import warp as wp

import wrt
from wrt.kernels.core.bsdf import Bsdf, BsdfSample, Model, no_sample
from wrt.scene.materials.material import Reflectance

FOUR_PI = wp.constant(4.0 * wp.pi)
TWO_PI = wp.constant(2.0 * wp.pi)


@wp.func
def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
    if wi[2] <= 0.0:
        return wp.vec3(0.0)
    return bsdf.slots[0] * (wi[2] / (FOUR_PI * (wi[2] + wo[2])))


@wp.func
def pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
    return wp.where(wi[2] > 0.0, 1.0 / TWO_PI, 0.0)


@wp.func
def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    # All directions alike. By the cosine, as for Lambert's law, weights would grow without bound near the horizon.
    z = 1.0 - u[0]
    r = wp.sqrt(wp.max(0.0, 1.0 - z * z))
    s = no_sample()
    s.wi = wp.vec3(r * wp.cos(TWO_PI * u[1]), r * wp.sin(TWO_PI * u[1]), z)
    s.pdf = 1.0 / TWO_PI
    s.weight = evaluate(bsdf, wo, s.wi) * TWO_PI
    return s


@dataclass(frozen=True)
class Lunar(wrt.Material):
    """Dust such as the Moon's; `albedo` is the share of light that a grain scatters."""

    albedo: Reflectance = 0.2

    type_name = "lunar"
    slot_names = ("albedo",)


wrt.register_material(Lunar, Model(evaluate, pdf, sample, slots=1))

if __name__ == "__main__":
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 0.0, 220.0), fov_degrees=0.6))
    scene.add(wrt.sphere(), material=Lunar(albedo=(0.22, 0.2, 0.18)))
    scene.add_light(wrt.DirectionalLight((0.0, 0.0, -1.0), irradiance=60.0))  # the sun, behind us
    wrt.save_image("moon.png", wrt.render(scene, width=512, height=512, spp=16))
