"""Layers: what the surface that a camera ray meets first is like, beside the light that comes from there.

Reflectance, normals and coverage are means over a pixel's samples, in which a ray that meets nothing counts as 0.
What has no mean, as depth across an edge has none, is taken from the sample nearest to the pixel's middle.
"""

import functools

import warp as wp

from wrt.kernels.bsdf import make_bsdf
from wrt.kernels.camera import Camera, CameraRay
from wrt.kernels.features import Features
from wrt.kernels.film import is_finite_color
from wrt.kernels.first_surface import FirstSurface, make_first_surface
from wrt.kernels.geometry import to_local
from wrt.kernels.intersect import NO_HIT
from wrt.kernels.materials import make_bsdf_at
from wrt.kernels.projection import film_position
from wrt.kernels.sampler import BLOCK_BSDF, Sampler, make_sample_4d, vertex_block
from wrt.kernels.scene_data import SceneData
from wrt.kernels.surface import Surface, add_texture_coordinates
from wrt.kernels.triangles import make_triangle_of


@wp.struct
class LayerData:
    """A film's layers, (pixels, channels), and the first channel of each in its array; −1 where it is not asked for.

    `sums` are over all samples; `nearest`, `object_number` (0: nothing was met) and `off_middle` (the squared distance
    in pixels) are of the sample nearest to the pixel's middle.
    """

    sums: wp.array2d(dtype=wp.float64)
    nearest: wp.array2d(dtype=wp.float32)
    object_number: wp.array(dtype=wp.int32)
    off_middle: wp.array(dtype=wp.float32)
    # In `sums`
    albedo: int
    normal: int
    geometric_normal: int
    alpha: int
    # In `nearest`
    depth: int
    position: int
    uv: int
    motion: int


@wp.func
def add_color(sums: wp.array2d(dtype=wp.float64), pixel: int, first: int, value: wp.vec3):
    """Add three values to the sums from channel `first` on, where that is not −1."""
    if first >= 0 and is_finite_color(value):
        for k in range(3):
            sums[pixel, first + k] = sums[pixel, first + k] + wp.float64(value[k])


@wp.func
def set_numbers(nearest: wp.array2d(dtype=wp.float32), pixel: int, first: int, count: int, value: wp.vec3):
    """Set `count` channels from `first` on, where that is not −1."""
    if first >= 0:
        for k in range(count):
            nearest[pixel, first + k] = value[k]


@functools.cache
def make_directional_albedo(features: Features) -> wp.Function:
    """Return the device function (scene, surface, material, direction, u) -> vec3, whose mean is the albedo to there.

    One direction is drawn as a path does it. Its weight f |cosθi| / pdf has the mean ∫ f |cosθi| dωi, the share of
    light from everywhere that goes to the viewer; what goes in single directions counts too. The squeeze of solid
    angles on refraction is taken out, or glass would be brighter than 1 from inside.
    """
    bsdf_sample = make_bsdf(features.models).sample
    bsdf_at = make_bsdf_at(features)

    @wp.func
    def directional_albedo(
        scene: SceneData, surface: Surface, material: int, direction: wp.vec3, u: wp.vec4
    ) -> wp.vec3:
        bsdf = bsdf_at(scene, material, surface)
        s = bsdf_sample(bsdf, to_local(surface.frame, -direction), wp.vec2(u[0], u[1]), u[2])
        return s.weight * (s.eta * s.eta)

    return directional_albedo


@functools.cache
def make_motion_on_film(features: Features) -> wp.Function:
    """Return the device function (scene, camera, first, direction) -> vec2: how far the shutter lets a point move.

    From where the film shows the point as the shutter opens to where it does as it closes, in pixels.
    """
    triangle_of = make_triangle_of(features.instances)

    @wp.func
    def motion_on_film(scene: SceneData, camera: Camera, first: FirstSurface, direction: wp.vec3) -> wp.vec2:
        begin = direction
        end = direction
        distant = first.hit.triangle == NO_HIT
        if not distant:
            hit = first.hit
            t = triangle_of(scene, hit.triangle, hit.instance, camera.shutter_open)
            begin = t.p0 + t.e1 * hit.u + t.e2 * hit.v
            t = triangle_of(scene, hit.triangle, hit.instance, camera.shutter_close)
            end = t.p0 + t.e1 * hit.u + t.e2 * hit.v
        there = film_position(camera, end, distant, camera.shutter_close)
        return there - film_position(camera, begin, distant, camera.shutter_open)

    return motion_on_film


@functools.cache
def make_add_layers(features: Features) -> wp.Function:
    """Return the device function (scene, camera, seen, sampler, layers, pixel, offset) -> rays traced.

    It adds one sample, seen along a camera ray that goes through the point `offset` from the pixel's middle.
    """
    first_surface = make_first_surface(features)
    directional_albedo = make_directional_albedo(features)
    motion_on_film = make_motion_on_film(features)
    sample_4d = make_sample_4d(features.sampler)
    has_coordinates = features.textured or features.tangents

    @wp.func
    def add_layers(
        scene: SceneData,
        camera: Camera,
        seen: CameraRay,
        sampler: Sampler,
        layers: LayerData,
        pixel: int,
        offset: wp.vec2,
    ) -> int:
        first = first_surface(scene, seen.ray, seen.footprint, sampler)
        surface = first.surface
        met = first.hit.triangle != NO_HIT
        if met:
            add_color(layers.sums, pixel, layers.normal, surface.frame.n)
            add_color(layers.sums, pixel, layers.geometric_normal, surface.normal)
            if layers.alpha >= 0:
                layers.sums[pixel, layers.alpha] = layers.sums[pixel, layers.alpha] + wp.float64(1.0)
            if layers.albedo >= 0:
                u = sample_4d(sampler, vertex_block(1, BLOCK_BSDF))
                albedo = directional_albedo(scene, surface, first.material, seen.ray.direction, u)
                add_color(layers.sums, pixel, layers.albedo, albedo)
        off_middle = wp.dot(offset, offset)
        if off_middle < layers.off_middle[pixel]:
            layers.off_middle[pixel] = off_middle
            number = int(0)
            depth = wp.inf
            if met:
                number = surface.shape + 1
                depth = first.distance
            layers.object_number[pixel] = number
            set_numbers(layers.nearest, pixel, layers.depth, 1, wp.vec3(depth))
            set_numbers(layers.nearest, pixel, layers.position, 3, surface.position)
            if layers.uv >= 0:
                if met and wp.static(not has_coordinates):
                    surface = add_texture_coordinates(scene, first.hit, surface)
                set_numbers(layers.nearest, pixel, layers.uv, 2, wp.vec3(surface.uv[0], surface.uv[1], 0.0))
            if layers.motion >= 0:
                moved = motion_on_film(scene, camera, first, seen.ray.direction)
                set_numbers(layers.nearest, pixel, layers.motion, 2, wp.vec3(moved[0], moved[1], 0.0))
        return first.rays

    return add_layers
