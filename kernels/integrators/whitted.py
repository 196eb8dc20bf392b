"""Whitted's ray tree: at each hit the mirrored and the refracted ray, and the light that lamps send there straight.

Whitted (1980), "An improved illumination model for shaded display"; the limit on attenuation is Hall and Greenberg's
(1983), "A testbed for realistic image synthesis". But for jittered rays all of it is a function of the camera ray.

- What is smooth (`Model.specular`) sends on two rays, what is not receives direct light alone.
- Gloss by a jittered mirror direction (`Model.jitters`) sends on random rays of its lobe, as in distribution ray
  tracing (Cook, Porter and Carpenter 1984): `PathSettings.jittered_rays` where it is met first, and one beyond. They
  find all light but that of lamps without extent.
- Each point, spot or directional light casts a hard shadow; a triangle that shines does so from its middle, as if all
  of its area stood there: L A cosθ / r² (the midpoint rule). So do rectangles, disks, spheres and suns, by their solid
  angle; of a cylinder that shines on both sides, its near and its far wall.
- Ambient light arrives at what is not smooth from all sides alike and is blocked by nothing.
- Mixtures and what is not opaque are all of their parts, each by its share.
- Media absorb and emit along all rays, by Beer's law; what they absorb counts as attenuation. They do not scatter.
"""

import warp as wp

from wrt.kernels.bsdf import make_bsdf, make_receives_light, make_specular, models_with
from wrt.kernels.core.bsdf import Bsdf
from wrt.kernels.core.features import Features
from wrt.kernels.core.ray_tree import NO_HIT, Hit
from wrt.kernels.core.rays import Ray, Receiver, to_local
from wrt.kernels.core.scene_data import LIGHT_ENVIRONMENT, LIGHT_TRIANGLE, LightRecord, SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.geometry.spheres import make_sphere_of
from wrt.kernels.geometry.surface import (
    Surface,
    align_tangents,
    leave,
    leave_in_front,
    make_add_texture_coordinates,
    make_surface_at,
)
from wrt.kernels.geometry.triangles import WIDELY
from wrt.kernels.integrators.path_state import PathResult, PathSettings
from wrt.kernels.integrators.shadow_rays import make_visibility
from wrt.kernels.integrators.tree_ray import (
    WAITING,
    TreeRay,
    TreeVertex,
    make_children,
    make_waiting_rays,
    root_of,
    segment_of,
    straight_on,
)
from wrt.kernels.lights.environment import image_radiance
from wrt.kernels.lights.lights import make_lights
from wrt.kernels.lights.mesh_lights import make_sides_of
from wrt.kernels.lights.shapes import make_hit_seen, make_light_shapes, make_middle_of, shape_number
from wrt.kernels.materials.choice import MOST_PASSED, leaves_of, make_next_leaf
from wrt.kernels.materials.values import make_bsdf_at, make_with_indices
from wrt.kernels.media.bodies import innermost, is_there, make_meet, relative_index
from wrt.kernels.media.medium import emitted, make_extinction, medium_of, transmittance
from wrt.kernels.media.skin import no_skin
from wrt.kernels.sampling.sampler import Sampler
from wrt.kernels.sampling.warps import lattice_point
from wrt.kernels.textures.footprint import sample_footprint
from wrt.kernels.textures.normal_maps import apply_normal_map

AMBIENT_POINTS = wp.constant(16)
"""Directions by which the share of ambient light that a surface reflects is told; one would be enough for matt ones."""

MIDDLE = wp.constant(2.0 / 3.0)
"""Both numbers that `square_to_triangle` maps to the middle."""


@wp.func
def sees_lights(r: TreeRay, settings: PathSettings) -> bool:
    """Return whether a ray sees the environment and lights without triangles, which camera rays may not."""
    return settings.hides_lights == 0 or r.depth > 1


@wp.func
def is_followed(r: TreeRay, settings: PathSettings) -> bool:
    """Return whether a ray is not too dim."""
    strength = wp.max(r.throughput) * r.eta_scale
    return strength > 0.0 and strength >= settings.min_attenuation


@specialised()
def make_direct_light(features: Features) -> wp.Function:
    """Return the device function for light straight from lamps and ambient light, reflected by all but smooth lobes.

    Its arguments are (scene, vertex, surface, bsdf, wo, r, time, settings, jitters); `surface` has the normal map, and
    `r` is the ray that met the vertex. Where the surface `jitters`, only lamps without extent count.
    """
    bsdfs, receives_light = make_bsdf(features.models), make_receives_light(features.models)
    bsdf_evaluate, bsdf_sample = bsdfs.evaluate, bsdfs.sample
    visibility = make_visibility(features)
    sample_one_light = make_lights(features).sample_one_light
    middle_of_shape = make_middle_of(features.light_shapes)
    sides_of = make_sides_of(features.geometry)
    exact, sphere_of = features.has_exact, make_sphere_of(features.geometry)
    transmits = bool(models_with(features.models, "transmits"))

    @wp.func
    def middle_of(scene: SceneData, light: LightRecord, side: int, time: float) -> wp.vec2:
        if side > 0:
            return wp.vec2(0.5, 0.0)  # of the far wall of a cylinder
        if light.kind == LIGHT_TRIANGLE:
            if wp.static(exact):
                if sphere_of(scene, light.triangle, light.instance, time).radius > 0.0:
                    return wp.vec2(0.0)
            return wp.vec2(MIDDLE)
        return middle_of_shape(light.kind)

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
        scene: SceneData,
        vertex: TreeVertex,
        surface: Surface,
        bsdf: Bsdf,
        wo: wp.vec3,
        r: TreeRay,
        time: float,
        settings: PathSettings,
        jitters: bool,
    ) -> PathResult:
        result = PathResult()
        result.radiance = wp.vec3(0.0)
        result.rays = 0
        if not receives_light(bsdf):
            return result
        if wp.max(settings.ambient) > 0.0 and not jitters:
            result.radiance = wp.cw_mul(settings.ambient, ambient_share(bsdf, wo))
        for number in range(scene.lights.shape[0]):
            lamp = scene.lights[number]
            if lamp.kind != LIGHT_ENVIRONMENT:
                in_front = Receiver()
                in_front.position = vertex.origin_in_front
                in_front.normal = surface.normal
                in_front.time = time
                sides = sides_of(scene, lamp, in_front)
                for side in range(sides):
                    u = middle_of(scene, lamp, side, time)
                    origin = vertex.origin_in_front
                    inside = r.medium_stack
                    receiver = in_front
                    light = sample_one_light(scene, number, float(sides), receiver, u)
                    above = wp.dot(light.wi, surface.normal) > 0.0
                    if wp.static(transmits):
                        if not above:
                            origin = vertex.origin_behind
                            inside = vertex.stack_behind
                            receiver.position = origin
                            light = sample_one_light(scene, number, float(sides), receiver, u)
                    wi = to_local(surface.frame, light.wi)
                    counts = light.delta or not jitters
                    if counts and above == (wi[2] > 0.0) and (above or wp.static(transmits)):
                        arriving = wp.cw_mul(bsdf_evaluate(bsdf, wo, wi), light.radiance)
                        if wp.max(arriving) > 0.0:
                            shadow_ray = Ray()
                            shadow_ray.origin = origin
                            shadow_ray.direction = light.wi
                            shadow_ray.time = time
                            result.rays = result.rays + 1
                            seen = visibility(
                                scene, shadow_ray, light.distance, light.point, inside, no_skin(), wp.vec4()
                            )
                            result.radiance = result.radiance + wp.cw_mul(arriving, seen)
        return result

    return direct_light


@specialised("environment", "light_shapes")
def make_lights_seen(features: Features) -> wp.Function:
    """Return (scene, ray, hit, throughput, radiance) -> vec3: plus what a ray brings that hits no triangle.

    That is the radiance of the light shape that it hits, or of the environment and of suns.
    """
    has_environment = features.environment != "none"
    image_environment = features.environment == "image"
    light_shapes = bool(features.light_shapes)
    shapes = make_light_shapes(features.light_shapes)
    shines_back, sun_covers = shapes.shines_back, shapes.covers

    @wp.func
    def environment_seen(scene: SceneData, direction: wp.vec3) -> wp.vec3:
        if wp.static(image_environment):
            return image_radiance(scene.environment, direction)
        return scene.environment.radiance

    @wp.func
    def with_lights(scene: SceneData, ray: Ray, hit: Hit, throughput: wp.vec3, radiance: wp.vec3) -> wp.vec3:
        if wp.static(light_shapes):
            if hit.triangle != NO_HIT:
                met = scene.light_shapes[shape_number(hit)]
                if shines_back(scene, met, ray):
                    radiance += wp.cw_mul(throughput, scene.lights[met.light].value)
                return radiance
        if wp.static(has_environment):
            radiance += wp.cw_mul(throughput, environment_seen(scene, ray.direction))
        if wp.static(light_shapes):
            for i in range(scene.solid_light_shapes, scene.sun_light_shapes):
                if sun_covers(scene.light_shapes[i], ray.direction):
                    sun = scene.light_shapes[i].light
                    radiance += wp.cw_mul(throughput, scene.lights[sun].value)
        return radiance

    return with_lights


@specialised("instances", "exact", "media", "nested", "textured", "tangents", "uv2_alpha", "mipmapped")
def make_tree_vertex(features: Features) -> wp.Function:
    """Return the device function (scene, ray, r, hit, pixel_footprint, index) -> TreeVertex; `ray` is that of `r`."""
    surface_at = make_surface_at(features.geometry)
    meet = make_meet(features.geometry)
    add_texture_coordinates = make_add_texture_coordinates(features.uv2_alpha, features.has_exact)
    bodies, nested = features.bodies, features.nested
    textured, tangents, mipmapped = features.textured, features.tangents, features.mipmapped

    @wp.func
    def tree_vertex(
        scene: SceneData, ray: Ray, r: TreeRay, nearest: Hit, pixel_footprint: wp.vec2, index: wp.uint32
    ) -> TreeVertex:
        vertex = TreeVertex()
        hit = nearest
        surface = surface_at(scene, ray, hit)
        if wp.static(bodies):
            if scene.shapes[surface.shape].body >= 0:
                surface.clearance = surface.clearance * WIDELY
        vertex.origin_in_front = leave_in_front(surface, ray.origin, ray.direction)
        vertex.origin_behind = leave(surface, -1.0)
        vertex.is_solid = True
        if wp.static(bodies):
            meeting = meet(scene, ray, hit, surface, r.medium_stack)
            hit = meeting.hit
            surface = meeting.surface
            vertex.stack_behind = meeting.after
            if wp.static(nested):
                vertex.is_solid = is_there(scene, surface, r.medium_stack, meeting.after)
        if r.camera_distance >= 0.0:
            vertex.width = pixel_footprint[0] + pixel_footprint[1] * (r.camera_distance + hit.t)
        if wp.static(textured or tangents):
            surface = add_texture_coordinates(scene, hit, surface)
        if wp.static(mipmapped):
            if vertex.width > 0.0:
                surface.footprint = sample_footprint(scene, hit, surface, ray.direction, vertex.width, index)
        vertex.hit = hit
        vertex.surface = surface
        return vertex

    return tree_vertex


@wp.struct
class TreeSegment:
    """What a medium does to a ray of the tree: what it emits towards the root, and the throughput behind it."""

    emission: wp.vec3
    throughput: wp.vec3


@specialised()
def make_medium_segment(media: str) -> wp.Function:
    """Return the device function (scene, r, distance) -> TreeSegment, along a ray of the tree; see `Features.media`."""
    extinction_of = make_extinction(media)

    @wp.func
    def medium_segment(scene: SceneData, r: TreeRay, distance: float) -> TreeSegment:
        segment = TreeSegment()
        segment.throughput = r.throughput
        medium = medium_of(scene, r.medium_stack)
        if medium >= 0:
            extinction = extinction_of(scene, r.medium_stack)
            length = r.origin_gap + distance
            segment.emission = wp.cw_mul(r.throughput, emitted(scene.media[medium].emission, extinction, length))
            segment.throughput = wp.cw_mul(r.throughput, transmittance(extinction, length))
        return segment

    return medium_segment


@specialised()
def make_surface_with_normal(tangents: bool) -> wp.Function:
    """Return the device function (scene, vertex, leaf, direction) -> Surface with the normal map of a material."""

    @wp.func
    def surface_with_normal(scene: SceneData, vertex: TreeVertex, leaf: int, direction: wp.vec3) -> Surface:
        if wp.static(tangents):
            seen = align_tangents(scene, vertex.hit, vertex.surface)
            return apply_normal_map(scene, leaf, vertex.hit, seen, direction, vertex.width)
        else:
            return vertex.surface

    return surface_with_normal


@specialised("models", "nested", *make_bsdf_at.fields)
def make_leaf_bsdf(features: Features) -> wp.Function:
    """Return the device function (scene, r, vertex, surface, leaf) -> Bsdf, of a material that has no parts."""
    nested = features.nested
    bsdf_at = make_bsdf_at(features)
    with_indices = make_with_indices(features.models)

    @wp.func
    def leaf_bsdf(scene: SceneData, r: TreeRay, vertex: TreeVertex, surface: Surface, leaf: int) -> Bsdf:
        bsdf = bsdf_at(scene, leaf, surface)
        if wp.static(nested):
            if scene.shapes[surface.shape].body >= 0:
                in_front = innermost(scene, r.medium_stack)
                behind = innermost(scene, vertex.stack_behind)
                index = relative_index(scene, surface, in_front, behind)
                bsdf = with_indices(bsdf, index, wp.vec3(index))
        return bsdf

    return leaf_bsdf


@specialised()
def make_trace_tree(features: Features) -> wp.Function:
    """Return the device function that follows the ray tree of a camera ray."""
    direct_light = make_direct_light(features)
    with_lights = make_lights_seen(features)
    specular = make_specular(features.models)
    jittered_rays, child_of = make_children(features)
    next_leaf = make_next_leaf(features.uv2_alpha, features.mipmapped)
    tree_vertex = make_tree_vertex(features)
    surface_with_normal = make_surface_with_normal(features.tangents)
    leaf_bsdf = make_leaf_bsdf(features)
    medium_segment = make_medium_segment(features.media)
    hit_seen = make_hit_seen(features)
    emission_at = make_lights(features).emission_at
    opacity, composite, nested = features.opacity, features.mixed or features.composite == "sides", features.nested
    bodies, media = features.bodies, features.media != "none"
    rows_type, row_of, ray_of = make_waiting_rays(bodies)

    @wp.func
    def trace_tree(
        scene: SceneData, camera_ray: Ray, pixel_footprint: wp.vec2, sampler: Sampler, settings: PathSettings
    ) -> PathResult:
        result = PathResult()
        result.radiance = wp.vec3(0.0)
        result.rays = 0
        surfaces_passed = int(0)
        jittered_so_far = int(0)
        root = root_of(camera_ray)
        if wp.static(bodies):
            root.medium_stack = scene.inside_at_camera
        rows = rows_type()
        rows[0] = row_of(root)
        waiting = int(1)
        while waiting > 0:
            waiting -= 1
            r = ray_of(rows[waiting])
            ray = segment_of(r, camera_ray.time)
            hit = hit_seen(scene, ray, sees_lights(r, settings))
            result.rays = result.rays + 1
            if wp.static(media):
                segment = medium_segment(scene, r, hit.t)
                result.radiance = result.radiance + segment.emission
                r.throughput = segment.throughput
            if hit.triangle <= NO_HIT:
                if sees_lights(r, settings):
                    result.radiance = with_lights(scene, ray, hit, r.throughput, result.radiance)
                continue

            # Each part of the material by its share
            vertex = tree_vertex(scene, ray, r, hit, pixel_footprint, sampler.index)
            surface = vertex.surface
            shape = scene.shapes[surface.shape]
            leaves = leaves_of(shape.material)
            if wp.static(nested):
                if not vertex.is_solid:
                    leaves.left = 0
                    leaves.passed = 1.0
            while leaves.left > 0:
                if wp.static(composite):
                    leaves = next_leaf(scene, leaves, surface)
                    if leaves.share == 0.0:
                        continue
                else:
                    leaves.left = 0
                part = r.throughput * leaves.share

                # Emission
                if shape.first_light >= 0 and (surface.front or shape.two_sided != 0):
                    result.radiance = result.radiance + wp.cw_mul(part, emission_at(scene, shape, surface))
                if r.depth >= settings.max_depth:
                    continue

                # Direct light
                seen = surface_with_normal(scene, vertex, leaves.leaf, ray.direction)
                bsdf = leaf_bsdf(scene, r, vertex, seen, leaves.leaf)
                wo = to_local(seen.frame, -ray.direction)
                jittered = jittered_rays(bsdf, r, waiting, settings)
                direct = direct_light(scene, vertex, seen, bsdf, wo, r, ray.time, settings, jittered > 0)
                result.rays = result.rays + direct.rays
                result.radiance = result.radiance + wp.cw_mul(part, direct.radiance)

                # Jittered rays, and the mirrored and the refracted one
                lobes = specular(bsdf, wo)
                for k in range(jittered + 2):
                    child = child_of(r, part, vertex, seen, bsdf, lobes, wo, k, jittered, sampler, jittered_so_far)
                    if is_followed(child, settings) and waiting < WAITING:
                        rows[waiting] = row_of(child)
                        waiting += 1
                jittered_so_far += jittered

            # Straight on, through what is not opaque
            if wp.static(opacity or nested):
                surfaces_passed += 1
                r = straight_on(r, vertex, leaves.passed)
                if is_followed(r, settings) and surfaces_passed < MOST_PASSED and waiting < WAITING:
                    rows[waiting] = row_of(r)
                    waiting += 1

        return result

    return trace_tree
