"""Photons: light that smooth surfaces throw onto others, followed from its first smooth surface on.

A photon is aimed. A point is chosen on the smooth surfaces, uniformly by area, and then a light as seen from there, as
for next-event estimation; so every kind of light does as it is. The photon flies from the light to that point, and is
lost if anything else scatters it before. So each path of light has one density, that of its first smooth surface. It is
stored where it meets a surface that scatters, and goes on from there: the light of a focus is found by none of the
paths from the camera but by chance. The first surface stores it, and the one where it ends.

The path tracer finds the same paths by itself, from the other end, and leaves them out (`follow_path`).
"""

import inspect
from collections.abc import Callable

import warp as wp

from wrt.kernels.accel.intersect import make_intersect
from wrt.kernels.bsdf import make_gathers, make_is_matt, models_with
from wrt.kernels.camera.camera import Camera
from wrt.kernels.camera.models import make_camera_time
from wrt.kernels.core.elementary import sine_cosine
from wrt.kernels.core.features import Features, has_exact, has_quadrics, instances_of
from wrt.kernels.core.photon_map import Photon
from wrt.kernels.core.ray_tree import NO_HIT
from wrt.kernels.core.rays import RECEIVES_BOTH, Ray, Receiver, make_frame, to_world
from wrt.kernels.core.scene_data import BodyStack, SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.core.spmd_marks import path_function, pixel_kernel
from wrt.kernels.geometry.quadrics import DISK, NO_QUADRIC, disk_area, front_of, make_quadric_of, point_of
from wrt.kernels.geometry.spheres import make_sphere_of
from wrt.kernels.geometry.triangles import make_triangle_of, triangle_normal, twice_area
from wrt.kernels.integrators.gathering import NO_PHOTON, key_of
from wrt.kernels.integrators.path import make_begin_path
from wrt.kernels.integrators.path_media import make_traverse_medium
from wrt.kernels.integrators.path_state import PathSettings
from wrt.kernels.integrators.path_surface import (
    make_prepare_bsdf,
    make_sample_bsdf,
    make_surface_vertex,
    pass_through,
)
from wrt.kernels.lights.choice import make_light_choice
from wrt.kernels.lights.lights import make_lights
from wrt.kernels.lights.mesh_lights import place_on_disk
from wrt.kernels.lights.shapes import make_light_shapes
from wrt.kernels.sampling.sampler import (
    BLOCK_BSDF,
    BLOCK_LIGHT,
    BLOCK_MATERIAL,
    Sampler,
    make_sample_4d,
    passed_block,
    vertex_block,
)
from wrt.kernels.sampling.warps import (
    PI,
    TWO_PI,
    sample_alias,
    square_to_cosine_hemisphere,
    square_to_sphere,
    square_to_triangle,
)

FIRST_PIXEL = wp.constant(wp.uint32(2**31))
"""Photons of set k have the random numbers of this pixel + k, which no picture has: one sample for each photon."""


@wp.struct
class Caster:
    """A triangle or exact shape of a smooth material, and the probability with which photons are aimed at it."""

    triangle: int
    instance: int
    shape: int
    probability: float


@wp.struct
class Casters:
    """What photons are aimed at, the alias table that chooses, and the box of the scene."""

    records: wp.array(dtype=Caster)
    thresholds: wp.array(dtype=float)
    aliases: wp.array(dtype=int)
    low: wp.vec3
    high: wp.vec3


@wp.struct
class Aim:
    """A point on a caster: its geometric normal, on either side, and the area of the caster."""

    position: wp.vec3
    normal: wp.vec3
    area: float


@wp.struct
class Departure:
    """A photon that leaves a light, known by its number as in `Photon`: its ray and its power.

    It is to meet `shape` first, within `tolerance` of `position`. It has come a distance of `gap` through the medium
    around the scene.
    """

    ray: Ray
    power: wp.vec3
    shape: int
    position: wp.vec3
    tolerance: float
    gap: float
    light: int


@specialised()
def make_aim(geometry: str) -> wp.Function:
    """Return the device function (scene, caster, u vec2, time) -> Aim, uniform by area; see `Features.geometry`."""
    triangle_of = make_triangle_of(instances_of(geometry))
    sphere_of, quadric_of = make_sphere_of(geometry), make_quadric_of(geometry)

    @wp.func
    def aim_at(scene: SceneData, caster: Caster, u: wp.vec2, time: float) -> Aim:
        aim = Aim()
        if wp.static(has_quadrics(geometry)):
            quadric = quadric_of(scene, caster.triangle, caster.instance, time)
            if quadric.kind != NO_QUADRIC:
                place = place_on_disk(u)
                aim.area = disk_area(quadric)
                if quadric.kind != DISK:
                    around = sine_cosine(TWO_PI * u[1])
                    place = wp.vec3(around[1], around[0], u[0] - 0.5)
                    aim.area = TWO_PI * wp.length(quadric.x) * wp.length(quadric.z)
                aim.position = point_of(quadric, place)
                aim.normal = front_of(quadric, place)
                return aim
        if wp.static(has_exact(geometry)):
            sphere = sphere_of(scene, caster.triangle, caster.instance, time)
            if sphere.radius > 0.0:
                aim.normal = square_to_sphere(u)
                aim.position = sphere.center + aim.normal * sphere.radius
                aim.area = 4.0 * PI * sphere.radius * sphere.radius
                return aim
        triangle = triangle_of(scene, caster.triangle, caster.instance, time)
        b = square_to_triangle(u)
        aim.position = triangle.p0 + triangle.e1 * b[0] + triangle.e2 * b[1]
        aim.normal = triangle_normal(triangle.e1, triangle.e2)
        aim.area = 0.5 * twice_area(triangle.e1, triangle.e2)
        return aim

    return aim_at


_INFINITELY_FAR = wp.constant(1.0e30)

_BEFORE_LIGHT = wp.constant(1.0 - 2.0**-16)
"""Share of the way to a light at which photons start, so that they do not meet the light itself."""

_MOST_GO_ON = wp.constant(0.8)
"""Most of the photons that go on from a surface which can store them."""

_TOLERANCE = wp.constant(2.0**-14)
"""How far from the point that it was aimed at a photon may meet a shape, as a share of its way: rounding."""

_ROUNDING = wp.constant(2.0**-20)
"""As much again, as a share of the point's coordinates: a photon from far away starts close to it."""


@wp.func
def way_out(low: wp.vec3, high: wp.vec3, position: wp.vec3, direction: wp.vec3) -> float:
    """Return the distance along a direction at which a position within a box leaves it."""
    distance = float(_INFINITELY_FAR)
    for k in range(3):
        wall = wp.where(direction[k] > 0.0, high[k], low[k])
        if direction[k] != 0.0:
            distance = wp.min(distance, (wall - position[k]) / direction[k])
    return wp.max(distance, 0.0)


@specialised("environment", "instances", "exact", "light_groups", *make_lights.fields)
def make_depart(features: Features) -> wp.Function:
    """Return the device function (scene, casters, sampler, time) -> Departure of one photon of a set of one.

    Half of the photons come from a constant environment where there are other lights, too.
    """
    aim_at, sample_light = make_aim(features.geometry), make_lights(features).sample_light
    choose_light = make_light_choice(features.light_tree).choose_light
    sample_4d = make_sample_4d("sobol")
    surrounded = features.environment == "constant"

    @wp.func
    def depart(scene: SceneData, casters: Casters, sampler: Sampler, time: float) -> Departure:
        departure = Departure()
        departure.light = scene.lights.shape[0]
        u = sample_4d(sampler, vertex_block(0, BLOCK_BSDF))
        u_light = sample_4d(sampler, vertex_block(0, BLOCK_LIGHT))
        caster = casters.records[sample_alias(casters.thresholds, casters.aliases, u[2], u[3]).index]
        aim = aim_at(scene, caster, wp.vec2(u[0], u[1]), time)
        from_environment = bool(False)
        share = float(1.0)
        if wp.static(surrounded):
            u_sides = sample_4d(sampler, vertex_block(0, BLOCK_MATERIAL))
            share = wp.where(scene.lights.shape[0] > 0, 0.5, 1.0)
            from_environment = u_sides[0] < share
        wi = wp.vec3(0.0, 0.0, 1.0)
        irradiance = wp.vec3(0.0)
        distance = float(_INFINITELY_FAR)
        if from_environment:
            if wp.static(surrounded):
                wi = to_world(make_frame(aim.normal), square_to_cosine_hemisphere(wp.vec2(u_light[0], u_light[1])))
                wi = wp.where(u_sides[2] < 0.5, wi, -wi)
                irradiance = scene.environment.radiance * (TWO_PI / share)
        elif scene.lights.shape[0] > 0:
            receiver = Receiver()
            receiver.position = aim.position
            receiver.normal = aim.normal
            receiver.receives = RECEIVES_BOTH
            receiver.time = time
            light = sample_light(scene, receiver, u_light)
            wi = light.wi
            distance = light.distance
            irradiance = light.radiance * (wp.abs(wp.dot(wi, aim.normal)) / share)
            if wp.static(features.light_groups):
                departure.light = choose_light(scene, receiver, u_light).light
        if distance >= _INFINITELY_FAR:
            distance = way_out(casters.low, casters.high, aim.position, wi)
            departure.gap = _INFINITELY_FAR
        departure.ray.origin = aim.position + wi * (distance * _BEFORE_LIGHT)
        departure.ray.direction = -wi
        departure.ray.time = time
        departure.power = irradiance * (aim.area / caster.probability)
        departure.shape = caster.shape
        departure.position = aim.position
        departure.tolerance = distance * _TOLERANCE + wp.max(wp.abs(aim.position)) * _ROUNDING
        return departure

    return depart


@specialised()
def make_follow_photon(features: Features) -> wp.Function:
    """Return the device function that follows photon i of a set and returns how often the photon was stored.

    Its arguments are (scene, settings, photons_out, keys_out, departure, sampler, i).
    """
    intersect, light_shapes = make_intersect(features.geometry), make_light_shapes(features.light_shapes)
    begin_path = make_begin_path(features)
    surface_vertex, prepare_bsdf = make_surface_vertex(features), make_prepare_bsdf(features)
    sample_bsdf, traverse_medium = make_sample_bsdf(features, of_photons=True), make_traverse_medium(features)
    gathers, nearly_smooth = make_gathers(features.models), bool(models_with(features.models, "is_caster"))
    is_matt, sample_4d = make_is_matt(features.models), make_sample_4d("sobol")

    @wp.func
    @path_function
    def follow_photon(
        scene: SceneData,
        settings: PathSettings,
        photons_out: wp.array(dtype=Photon),
        keys_out: wp.array(dtype=wp.int64),
        departure: Departure,
        sampler: Sampler,
        i: int,
    ) -> int:
        traced = photons_out.shape[0] // 2
        stored = int(0)
        was_scattered = bool(False)
        path = begin_path(scene, departure.ray, wp.vec2(0.0))
        path.medium_stack = BodyStack()
        path.origin_gap = departure.gap
        # The photon, the surface that gathers it and that surface's own path make `turns` + 2 segments at least.
        while path.depth + 2 <= settings.max_depth:
            vertex_number = path.depth + 1
            hit = intersect.closest_hit(scene, path.ray)
            if wp.static(bool(features.light_shapes)):
                hit = light_shapes.nearer(scene, path.ray, hit)
            if hit.triangle <= NO_HIT:
                break
            u_more = sample_4d(sampler, passed_block(vertex_number, path.surfaces_passed))
            if wp.static(features.media != "none"):
                segment = traverse_medium(scene, path, hit, wp.vec2(u_more[3], u_more[2]), 0)
                path.throughput = segment.throughput
                if wp.static(features.media == "scattering"):
                    if segment.ends or segment.scatters:
                        break
            vertex = surface_vertex(scene, path, hit, u_more[0], sampler)
            if wp.static(features.has_holes or features.nested):
                if not vertex.is_solid:
                    path = pass_through(path, vertex)
                    if path.is_done:
                        break
                    continue
            vertex = prepare_bsdf(scene, path, vertex, settings.widening)
            off = vertex.surface.position - departure.position
            is_met = vertex.surface.shape == departure.shape and wp.length(off) <= departure.tolerance
            turns = path.depth
            takes = turns > 0 and gathers(vertex.bsdf) and (not was_scattered or is_matt(vertex.bsdf))
            photon = Photon()
            photon.position = vertex.surface.position
            photon.towards = -path.ray.direction
            photon.normal = vertex.surface.normal
            # Flux is not squeezed as radiance is inside glass.
            photon.power = wp.cw_mul(path.throughput, departure.power) * (path.eta_scale / float(traced))
            photon.turns = turns
            photon.was_scattered = was_scattered
            photon.light = departure.light
            u_bsdf = sample_4d(sampler, vertex_block(vertex_number, BLOCK_BSDF))
            before = wp.max(path.throughput)
            path = sample_bsdf(path, vertex, u_bsdf, u_more[1], settings.max_depth)
            was_turned = path.depth > turns
            is_scattered = was_turned and path.scatter_pdf > 0.0
            if wp.static(nearly_smooth):
                is_scattered = was_turned and not path.was_cast
            # The first turn is by a delta lobe or a caster, at the point that the photon was aimed at.
            if turns == 0 and (was_turned != is_met or is_scattered):
                break
            # It goes on with the share of light that does, so that its power changes little.
            goes_on = float(1.0)
            if is_scattered:
                goes_on = wp.min(wp.max(path.throughput) / before, 1.0)
                if wp.static(features.media == "scattering"):
                    goes_on = 0.0
            if takes:
                goes_on = wp.min(goes_on, _MOST_GO_ON)
            if path.is_done:
                goes_on = 0.0
            u_ends = sample_4d(sampler, vertex_block(vertex_number, BLOCK_LIGHT))
            ends = not (u_ends[0] < goes_on)
            if takes and (stored == 0 or ends):
                if stored > 0:
                    photon.power = photon.power / (1.0 - goes_on)
                place = stored * traced + i
                photons_out[place] = photon
                keys_out[place] = key_of(settings.photon_map, photon.position, place)
                stored += 1
            if ends:
                break
            path.throughput = path.throughput / goes_on
            was_scattered = was_scattered or is_scattered
        return stored

    return follow_photon


def of_set(function: Callable[..., None]) -> Callable[..., None]:
    """Annotate the arguments of a kernel of a set of photons, or of a function that does its work, with their types."""
    types = (int, int, int, wp.uint32, Camera, SceneData, PathSettings, Casters)
    types += (wp.array(dtype=Photon), wp.array(dtype=wp.int64))
    function.__annotations__ = dict(zip(inspect.signature(function).parameters, types, strict=True))
    return function


@specialised()
def make_photon_kernel(features: Features) -> wp.Kernel:
    """Return the kernel that follows the photons of a set, at the time of the samples that gather them.

    Each thread follows `share` photons.
    """
    depart, follow_photon, camera_time = make_depart(features), make_follow_photon(features), make_camera_time(features)

    @wp.kernel(module=wp.get_module(make_photon_kernel.module_name(features)), enable_backward=False)
    @pixel_kernel
    @of_set
    def trace_photons(first_thread, share, set_number, seed, camera, scene, settings, casters, photons_out, keys_out):
        first = (first_thread + wp.tid()) * share
        traced = photons_out.shape[0] // 2
        sampler = Sampler()
        sampler.seed = seed
        time = camera.shutter_open
        if wp.static(features.shares_times):  # and then each sample has a set of its own
            sampler.index = wp.uint32(set_number)
            time = camera_time(camera, sampler)
        sampler.pixel = FIRST_PIXEL + wp.uint32(set_number)
        for number in range(0, share):
            i = first + number
            if i < traced:
                keys_out[i] = NO_PHOTON
                keys_out[traced + i] = NO_PHOTON
                sampler.index = wp.uint32(i)
                departure = depart(scene, casters, sampler, time)
                if wp.max(departure.power) > 0.0:
                    follow_photon(scene, settings, photons_out, keys_out, departure, sampler, i)

    return trace_photons
