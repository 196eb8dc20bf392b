"""Whitted's ray tree: at each hit the mirrored and the refracted ray, and the light that lamps send there straight.

Whitted (1980), "An improved illumination model for shaded display"; the limit on attenuation is Hall and Greenberg's
(1983), "A testbed for realistic image synthesis". All of it is a function of the camera ray: no number is random.

- What is smooth (`Model.specular`) sends on two rays, what is not receives direct light alone.
- Each point, spot or directional light casts a hard shadow; a triangle that shines does so from its middle, as if all
  of its area stood there: L A cosθ / r² (the midpoint rule). So do rectangles, disks, spheres and suns, by their solid
  angle.
- Ambient light arrives at what is not smooth from all sides alike and is blocked by nothing.
- Mixtures and what is not opaque are all of their parts, each by its share.
"""

import functools

import warp as wp

from wrt.kernels.bsdf import make_bsdf, model_of
from wrt.kernels.bsdf.record import Bsdf
from wrt.kernels.bsdf.specular import make_specular
from wrt.kernels.environment import image_radiance
from wrt.kernels.features import Features
from wrt.kernels.footprint import sample_footprint
from wrt.kernels.geometry import Ray, Receiver, to_local, to_world
from wrt.kernels.intersect import NO_HIT, make_intersect
from wrt.kernels.light_shapes import shape_number, shines_back, sun_covers
from wrt.kernels.lights import make_lights
from wrt.kernels.materials import MOST_PASSED, leaves_of, make_bsdf_at, make_next_leaf
from wrt.kernels.normal_maps import apply_normal_map
from wrt.kernels.path import PathResult, PathSettings
from wrt.kernels.sampler import Sampler
from wrt.kernels.scene_data import LIGHT_ENVIRONMENT, LIGHT_RECTANGLE, LIGHT_TRIANGLE, BodyStack, SceneData
from wrt.kernels.shadow import make_visibility
from wrt.kernels.skin import no_skin
from wrt.kernels.surface import Surface, align_tangents, leave, make_add_texture_coordinates, make_surface_at
from wrt.kernels.warps import lattice_point

WAITING = wp.constant(32)
"""Rays of a tree that may wait. Of two the weaker is followed first, which halves what is left: 32 halvings are more
than any limit on attenuation leaves, and what finds no place is not followed."""

AMBIENT_POINTS = wp.constant(16)
"""Directions by which the share of ambient light that a surface reflects is told; one would be enough for matt ones."""

MIDDLE = wp.constant(2.0 / 3.0)
"""Both numbers that `square_to_triangle` maps to the middle."""


@wp.func
def middle_of(kind: int) -> wp.vec2:
    """Return the numbers by which the middle of a light of this kind is drawn."""
    if kind == LIGHT_TRIANGLE:
        return wp.vec2(MIDDLE)
    if kind == LIGHT_RECTANGLE:
        return wp.vec2(0.5)
    return wp.vec2(0.0)


_vectors = wp.types.matrix(shape=(32, 3), dtype=float)
_numbers = wp.types.vector(length=32, dtype=float)
_counts = wp.types.vector(length=32, dtype=int)


@functools.cache
def make_direct_light(features: Features) -> wp.Function:
    """Return the device function (scene, surface, bsdf, wo, time, settings) -> PathResult: without smooth lobes."""
    bsdf_evaluate, _, bsdf_sample, bsdf_is_delta, _ = make_bsdf(features.models)
    visibility = make_visibility(features)
    sample_one_light = make_lights(features).sample_one_light
    transmits = any(model_of(name).transmits for name in features.models)

    @wp.func
    def ambient_share(bsdf: Bsdf, wo: wp.vec3) -> wp.vec3:
        share = wp.vec3(0.0)
        points = int(AMBIENT_POINTS)  # a variable, or the loop would be unrolled
        for k in range(points):
            u_lobe = (float((7 * k) % points) + 0.5) / float(points)
            u = lattice_point(k, points)
            shifted = wp.vec2(u[0], wp.where(u[1] < 0.5, u[1] + 0.5, u[1] - 0.5))  # no point on the edge
            s = bsdf_sample(bsdf, wo, shifted, u_lobe)
            if s.pdf > 0.0:
                share += s.weight / float(points)
        return share

    @wp.func
    def direct_light(
        scene: SceneData, surface: Surface, bsdf: Bsdf, wo: wp.vec3, time: float, settings: PathSettings
    ) -> PathResult:
        result = PathResult()
        result.radiance = wp.vec3(0.0)
        result.rays = 0
        if bsdf_is_delta(bsdf):
            return result
        if wp.max(settings.ambient) > 0.0:
            result.radiance = wp.cw_mul(settings.ambient, ambient_share(bsdf, wo))
        for number in range(scene.lights.shape[0]):
            kind = scene.lights[number].kind
            if kind != LIGHT_ENVIRONMENT:
                origin = leave(surface, 1.0)
                receiver = Receiver()
                receiver.position = origin
                receiver.normal = surface.normal
                receiver.time = time
                light = sample_one_light(scene, number, 1.0, receiver, middle_of(kind))
                above = wp.dot(light.wi, surface.normal) > 0.0
                if wp.static(transmits):
                    if not above:
                        origin = leave(surface, -1.0)
                        receiver.position = origin
                        light = sample_one_light(scene, number, 1.0, receiver, middle_of(kind))
                wi = to_local(surface.frame, light.wi)
                if above == (wi[2] > 0.0) and (above or wp.static(transmits)):
                    arriving = wp.cw_mul(bsdf_evaluate(bsdf, wo, wi), light.radiance)
                    if wp.max(arriving) > 0.0:
                        shadow = Ray()
                        shadow.origin = origin
                        shadow.direction = light.wi
                        shadow.time = time
                        result.rays = result.rays + 1
                        seen = visibility(scene, shadow, light.distance, light.point, BodyStack(), no_skin())
                        result.radiance = result.radiance + wp.cw_mul(arriving, seen)
        return result

    return direct_light


@functools.cache
def make_trace_tree(features: Features) -> wp.Function:
    """Return the device function that follows the ray tree of a camera ray."""
    direct_light = make_direct_light(features)
    specular = make_specular(features.models)
    bsdf_at = make_bsdf_at(features)
    next_leaf = make_next_leaf(features.extras, features.mipmapped)
    add_texture_coordinates = make_add_texture_coordinates(features.extras)
    closest_hit = make_intersect(features.instances, features.light_shapes).closest_hit
    emission_at = make_lights(features).emission_at
    light_shapes = features.light_shapes
    surface_at = make_surface_at(features.instances)
    textured = features.textured
    layered = features.layered
    tangents = features.tangents
    mipmapped = features.mipmapped
    has_environment = features.environment != "none"
    image_environment = features.environment == "image"

    @wp.func
    def environment_seen(scene: SceneData, direction: wp.vec3) -> wp.vec3:
        if wp.static(image_environment):
            return image_radiance(scene.environment, direction)
        return scene.environment.radiance

    @wp.func
    def trace_tree(
        scene: SceneData, camera_ray: Ray, pixel_footprint: wp.vec2, sampler: Sampler, settings: PathSettings
    ) -> PathResult:
        radiance = wp.vec3(0.0)
        rays = int(0)
        surfaces_passed = int(0)
        # The rays that wait: each with its throughput, the product of all eta², the distance that it came through what
        # let it pass (−1 once it was reflected or refracted), and its depth.
        origins = _vectors()
        directions = _vectors()
        throughputs = _vectors()
        scales = _numbers()
        ways = _numbers()
        depths = _counts()
        origins[0] = camera_ray.origin
        directions[0] = camera_ray.direction
        throughputs[0] = wp.vec3(1.0)
        scales[0] = 1.0
        ways[0] = 0.0
        depths[0] = 1
        waiting = int(1)
        while waiting > 0:
            waiting -= 1
            ray = Ray()
            ray.origin = origins[waiting]
            ray.direction = directions[waiting]
            ray.time = camera_ray.time
            throughput = throughputs[waiting]
            eta_scale = scales[waiting]
            way = ways[waiting]
            depth = depths[waiting]
            hit = closest_hit(scene, ray)
            rays += 1

            # Environment
            if hit.triangle == NO_HIT:
                if wp.static(has_environment):
                    radiance += wp.cw_mul(throughput, environment_seen(scene, ray.direction))
                if wp.static(light_shapes):
                    for i in range(scene.solid_light_shapes, scene.sun_light_shapes):
                        if sun_covers(scene.light_shapes[i], ray.direction):
                            sun = scene.light_shapes[i].light
                            radiance += wp.cw_mul(throughput, scene.lights[sun].value)
                continue

            # Lights that are shapes of their own
            if wp.static(light_shapes):
                if hit.triangle < NO_HIT:
                    met = scene.light_shapes[shape_number(hit)]
                    if shines_back(scene, met, ray):
                        radiance += wp.cw_mul(throughput, scene.lights[met.light].value)
                    continue

            # Each part of the material by its share
            surface = surface_at(scene, ray, hit)
            shape = scene.shapes[surface.shape]
            if wp.static(textured or tangents):
                surface = add_texture_coordinates(scene, hit, surface)
            if wp.static(mipmapped):
                if way >= 0.0:
                    width = pixel_footprint[0] + pixel_footprint[1] * (way + hit.t)
                    surface.footprint = sample_footprint(scene, hit, surface, ray.direction, width, sampler.index)
            leaves = leaves_of(shape.material)
            while leaves.left > 0:
                if wp.static(layered):
                    leaves = next_leaf(scene, leaves, surface)
                    if leaves.share == 0.0:
                        continue
                else:
                    leaves.left = 0
                part = throughput * leaves.share

                # Emission
                if shape.first_light >= 0 and (surface.front or shape.two_sided != 0):
                    radiance += wp.cw_mul(part, emission_at(scene, shape, surface))
                if depth >= settings.max_depth:
                    continue

                # Direct light
                seen = surface
                if wp.static(tangents):
                    width = float(0.0)
                    if way >= 0.0:
                        width = pixel_footprint[0] + pixel_footprint[1] * (way + hit.t)
                    seen = align_tangents(scene, hit, seen)
                    seen = apply_normal_map(scene, leaves.leaf, hit, seen, ray.direction, width)
                bsdf = bsdf_at(scene, leaves.leaf, seen)
                wo = to_local(seen.frame, -ray.direction)
                direct = direct_light(scene, seen, bsdf, wo, ray.time, settings)
                rays += direct.rays
                radiance += wp.cw_mul(part, direct.radiance)

                # Mirrored and refracted rays, the stronger below the weaker
                lobes = specular(bsdf, wo)
                mirrored = wp.vec3(-wo[0], -wo[1], wo[2])
                eta2 = lobes.eta * lobes.eta
                mirrored_first = wp.max(lobes.reflected) >= wp.max(lobes.transmitted) * eta2
                for k in range(2):
                    weight = lobes.transmitted
                    wi = lobes.through
                    scale = eta_scale * eta2
                    if mirrored_first == (k == 0):
                        weight = lobes.reflected
                        wi = mirrored
                        scale = eta_scale
                    sent = wp.cw_mul(part, weight)
                    strength = wp.max(sent) * scale
                    direction = to_world(seen.frame, wi)
                    side = wp.where(wi[2] > 0.0, 1.0, -1.0)
                    outwards = wp.dot(direction, seen.normal) * side > 0.0
                    if strength > 0.0 and strength >= settings.min_attenuation and outwards and waiting < WAITING:
                        origins[waiting] = leave(seen, side)
                        directions[waiting] = wp.normalize(direction)
                        throughputs[waiting] = sent
                        scales[waiting] = scale
                        ways[waiting] = -1.0
                        depths[waiting] = depth + 1
                        waiting += 1

            # Straight on, through what is not opaque
            if wp.static(layered):
                on = throughput * leaves.passed
                surfaces_passed += 1
                strength = wp.max(on) * eta_scale
                if (
                    strength > 0.0
                    and strength >= settings.min_attenuation
                    and surfaces_passed < MOST_PASSED
                    and waiting < WAITING
                ):
                    beyond = leave(surface, -1.0)
                    origins[waiting] = beyond
                    directions[waiting] = ray.direction
                    throughputs[waiting] = on
                    scales[waiting] = eta_scale
                    ways[waiting] = wp.where(way < 0.0, way, way + wp.length(beyond - ray.origin))
                    depths[waiting] = depth
                    waiting += 1

        result = PathResult()
        result.radiance = radiance
        result.rays = rays
        return result

    return trace_tree
