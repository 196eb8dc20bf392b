from dataclasses import dataclass

import warp as wp

import wrt
from wrt.scene.description import Positive


@wp.func
def squared(z: wp.vec2) -> wp.vec2:
    return wp.vec2(z[0] * z[0] - z[1] * z[1], 2.0 * z[0] * z[1])


@wp.func
def distance(point: wp.vec3, thickness: float) -> float:
    z = point
    r = wp.length(z)
    dr = float(1.0)
    turns = int(0)
    while r < 8.0 and turns < 7:
        across = wp.sqrt(z[0] * z[0] + z[1] * z[1])
        polar = squared(squared(squared(wp.vec2(z[2], across))))
        around = squared(squared(squared(wp.vec2(z[0], z[1]) / wp.max(across, 1.0e-20))))
        dr = 8.0 * wp.length(polar) / wp.max(r, 1.0e-6) * dr + 1.0
        z = wp.vec3(polar[1] * around[0], polar[1] * around[1], polar[0]) + point
        r = wp.length(z)
        turns += 1
    return 0.5 * wp.log(wp.max(r, 1.0e-6)) * r / dr - thickness


@dataclass(frozen=True)
class Mandelbulb(wrt.DistanceShape):
    """The points from which z -> z⁸ + point does not leave, thickened, by an estimate of the distance."""

    thickness: Positive = 0.005

    type_name = "mandelbulb"

    def bounds(self):
        return (-1.25,) * 3, (1.25,) * 3


wrt.register_shape(Mandelbulb, distance)

if __name__ == "__main__":
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((1.6, 1.9, 3.0), fov_degrees=42.0))
    scene.add(Mandelbulb(), material=wrt.Diffuse((0.8, 0.55, 0.35)))
    scene.environment = wrt.ConstantEnvironment(0.4)
    scene.add_light(wrt.SphereLight((4.0, 5.0, 3.0), 1.0, radiance=30.0))
    wrt.save_image("mandelbulb.png", wrt.render(scene, width=512, height=512, spp=64))
