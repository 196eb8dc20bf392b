"""A small kernel with all that the SPMD translator looks for: the example of docs/spmd.md.

The picture has no meaning: a ray meets the next of many mirrors, and loses light at each.
"""

from typing import Any

import warp as wp

from wrt.kernels.spmd_marks import path_function, pixel_kernel, ray_query, shading_point


@wp.struct
class Mirrors:
    distance: float
    sky: float


@wp.struct
class Ray:
    origin: wp.vec3
    direction: wp.vec3


@wp.func
@ray_query
def next_mirror(mirrors: Mirrors, ray: Ray) -> float:
    return mirrors.distance + 0.3 * ray.direction[0] + 0.05 * ray.direction[1]


@wp.func
@ray_query
def blocked(mirrors: Mirrors, ray: Ray, distance: float) -> bool:
    return mirrors.distance + 0.2 * ray.direction[0] < distance


@wp.func
@shading_point
def albedo_at(mirrors: Mirrors, t: float) -> float:
    return 0.5 + 0.1 * t * mirrors.distance


@wp.func
def random_number(seed: int, depth: int) -> float:
    return float(seed % 7 + depth) * 0.1


@wp.func
@path_function
def trace(mirrors: Mirrors, camera_ray: Ray, seed: int, max_depth: int) -> float:
    ray = camera_ray
    light = float(0.0)
    throughput = float(1.0)
    depth = int(0)
    while depth < max_depth:
        depth += 1
        u = random_number(seed, depth)
        t = next_mirror(mirrors, ray)
        if t < 0.0:
            light += throughput * mirrors.sky
            break
        throughput *= albedo_at(mirrors, t)
        if u >= throughput:
            break
        ray.direction = -ray.direction
    return light


def make_kernel(path: Any, name: str) -> wp.Kernel:
    """Return a kernel that renders with a path function, in a module of its own."""

    @wp.kernel(module=wp.get_module(f"wrt.test.spmd.{name}"), enable_backward=False)
    @pixel_kernel
    def render(
        first_pixel: int,
        last: int,
        max_depth: int,
        mirrors: Mirrors,
        film: wp.array(dtype=float),
        counts: wp.array(dtype=int),
    ):
        pixel = first_pixel + wp.tid()
        total = film[pixel]
        for sample in range(counts[pixel], last):
            ray = Ray()
            ray.direction = wp.vec3(float(sample % 5) - 3.5, 0.02 * float(pixel), 1.0)
            total += path(mirrors, ray, sample, max_depth)
        film[pixel] = total
        counts[pixel] = last

    return render
