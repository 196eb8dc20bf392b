"""Whitted's ray tree: at each hit the mirrored and the refracted ray, and direct light from all lamps.

Whitted (1980), "An improved illumination model for shaded display"; the limit on attenuation is Hall and Greenberg's
(1983), "A testbed for realistic image synthesis". Without jittered rays all of it is a function of the camera ray.

- Smooth surfaces (`Model.specular`) send on two rays; rough ones receive direct light alone.
- Gloss by a jittered mirror direction (`Model.jitters`) sends on random rays of its lobe, as in distribution ray
  tracing (Cook, Porter and Carpenter 1984): `PathSettings.jittered_rays` at the first such surface, and one beyond.
  They find all light except from lamps without extent.
- Each point, spot or directional light casts a hard shadow. An emissive triangle emits from its middle, as if all of
  its area stood there: L A cosθ / r² (the midpoint rule). So do rectangles, disks, spheres and suns, by their solid
  angle. A cylinder that emits on both sides counts as two lights, its near and its far wall.
- Ambient light arrives at rough surfaces from all directions alike, and nothing blocks it.
- Mixtures and surfaces that are not opaque are all of their parts, each by its share.
- Media absorb and emit along all rays, by Beer's law; absorption counts as attenuation. They do not scatter.
"""

import warp as wp

from wrt.kernels.bsdf import make_bsdf, make_by_viewer, make_receives_light, models_with
from wrt.kernels.core.bsdf import Bsdf, no_lobes
from wrt.kernels.core.features import Features
from wrt.kernels.core.ray_tree import NO_HIT
from wrt.kernels.core.rays import Ray, Receiver, to_local
from wrt.kernels.core.scene_data import LIGHT_ENVIRONMENT, LIGHT_TRIANGLE, LightRecord, SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.core.spmd_marks import traces_alone
from wrt.kernels.geometry.spheres import make_sphere_of
from wrt.kernels.geometry.surface import Surface, align_tangents
from wrt.kernels.integrators.path_escape import make_add_lights_met
from wrt.kernels.integrators.path_state import PathResult, PathSettings, SurfaceVertex
from wrt.kernels.integrators.path_surface import cone_width, make_vertex_at, make_with_body_indices
from wrt.kernels.integrators.shadow_rays import make_visibility
from wrt.kernels.integrators.sides import make_hit_shown, shines_for
from wrt.kernels.integrators.tree_ray import (
    JITTERED,
    WAITING,
    TreeRay,
    make_children,
    make_waiting_rays,
    root_of,
    segment_of,
    straight_on,
)
from wrt.kernels.lights.lights import make_lights
from wrt.kernels.lights.mesh_lights import make_sides_of
from wrt.kernels.lights.shapes import make_hit_seen, make_middle_of
from wrt.kernels.materials.choice import MOST_PASSED, leaves_of, make_next_leaf
from wrt.kernels.materials.values import have_coat_normals, make_bsdf_at, make_with_normals
from wrt.kernels.media.medium import emitted, make_extinction, medium_of, transmittance
from wrt.kernels.media.skin import no_skin
from wrt.kernels.sampling.sampler import Sampler
from wrt.kernels.sampling.warps import lattice_point
from wrt.kernels.textures.normal_maps import apply_normal_map, normals_of_layers

AMBIENT_POINTS = wp.constant(16)
"""Directions used to estimate ambient albedo; one would do for matt surfaces."""

MIDDLE = wp.constant(2.0 / 3.0)
"""`square_to_triangle` maps (MIDDLE, MIDDLE) to the middle."""


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
    """Return the device function for direct light from lamps, and ambient light, reflected by all but smooth lobes.

    Its arguments are (scene, vertex, surface, bsdf, wo, r, time, settings, jitters); `surface` has the normal map, and
    `r` is the ray that met the vertex. Where the surface `jitters`, only lamps without extent count.
    """
    bsdfs, receives_light = make_bsdf(features.models), make_receives_light(features.models)
    visibility, sample_one_light = make_visibility(features), make_lights(features).sample_one_light
    middle_of_shape = make_middle_of(features.light_shapes)
    sides_of, sphere_of = make_sides_of(features.geometry), make_sphere_of(features.geometry)
    transmits = bool(models_with(features.models, "transmits"))

    @wp.func
    def middle_of(scene: SceneData, light: LightRecord, side: int, time: float) -> wp.vec2:
        if side > 0:
            return wp.vec2(0.5, 0.0)  # of the far wall of a cylinder
        if light.kind == LIGHT_TRIANGLE:
            if wp.static(features.has_exact):
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
            s = bsdfs.sample(bsdf, wo, shifted, u_lobe)
            if s.pdf > 0.0:
                share += s.weight / float(points)
        return share

    @wp.func
    def direct_light(
        scene: SceneData,
        vertex: SurfaceVertex,
        surface: Surface,
        bsdf: Bsdf,
        wo: wp.vec3,
        r: TreeRay,
        time: float,
        settings: PathSettings,
        jitters: bool,
    ) -> PathResult:
        result = PathResult()
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
                            inside = vertex.medium_stack_behind
                            receiver.position = origin
                            light = sample_one_light(scene, number, float(sides), receiver, u)
                    wi = to_local(surface.frame, light.wi)
                    counts = light.delta or not jitters
                    if counts and above == (wi[2] > 0.0) and (above or wp.static(transmits)):
                        arriving = wp.cw_mul(bsdfs.evaluate(bsdf, wo, wi), light.radiance)
                        if wp.max(arriving) > 0.0:
                            shadow_ray = Ray()
                            shadow_ray.origin = origin
                            shadow_ray.direction = light.wi
                            shadow_ray.time = time
                            result.rays += 1
                            visible = visibility(
                                scene, shadow_ray, light.distance, light.point, inside, no_skin(), wp.vec4()
                            )
                            result.radiance += wp.cw_mul(arriving, visible)
        return result

    return direct_light


@specialised()
def make_trace_tree(features: Features) -> wp.Function:
    """Return the device function that follows the ray tree of a camera ray."""
    direct_light = make_direct_light(features)
    add_lights_met, hit_seen = make_add_lights_met(features), make_hit_seen(features)
    of_triangles, of_all = make_hit_shown(features.geometry), make_hit_shown(features.geometry, features.light_shapes)
    specular, children = make_by_viewer(features.models, "specular", no_lobes), make_children(features)
    next_leaf = make_next_leaf(features.uv2_alpha, features.mipmapped, features.procedures)
    vertex_at, bsdf_at = make_vertex_at(features), make_bsdf_at(features)
    with_normals, has_layers = make_with_normals(features.models), have_coat_normals(features.models)
    with_body_indices = make_with_body_indices(features)
    extinction_of = make_extinction(features.media)
    emission_at = make_lights(features).emission_at
    lets_pass, composite = features.has_holes or features.nested, features.mixed or features.composite == "sides"
    rows_type, row_of, ray_of = make_waiting_rays(features.bodies)

    @wp.func
    @traces_alone
    def trace_tree(
        scene: SceneData, camera_ray: Ray, pixel_footprint: wp.vec2, sampler: Sampler, settings: PathSettings
    ) -> PathResult:
        result = PathResult()
        surfaces_passed = int(0)
        jittered_so_far = int(0)
        root = root_of(camera_ray)
        if wp.static(features.bodies):
            root.medium_stack = scene.inside_at_camera
        rows = rows_type()
        rows[0] = row_of(root)
        waiting = int(1)
        while waiting > 0:
            waiting -= 1
            r = ray_of(rows[waiting])
            ray = segment_of(r, camera_ray.time)
            hit = hit_seen(scene, ray, sees_lights(r, settings))
            result.rays += 1
            looks = r.camera_distance > JITTERED
            if wp.static(features.single_sided):
                if sees_lights(r, settings):
                    hit = of_all(scene, ray, hit, looks)
                else:
                    hit = of_triangles(scene, ray, hit, looks)
            if wp.static(features.media != "none"):
                medium = medium_of(scene, r.medium_stack)
                if medium >= 0:
                    extinction = extinction_of(scene, r.medium_stack)
                    length = r.origin_gap + hit.t
                    emission = emitted(scene.media[medium].emission, extinction, length)
                    result.radiance += wp.cw_mul(r.throughput, emission)
                    r.throughput = wp.cw_mul(r.throughput, transmittance(extinction, length))
            if hit.triangle <= NO_HIT:
                if sees_lights(r, settings):
                    result.radiance = add_lights_met(
                        scene, ray, hit, result.radiance, r.throughput, Receiver(), 0.0, 0.0, settings.strategy
                    )
                continue

            # Each part of the material by its share
            width = float(0.0)
            if r.camera_distance >= 0.0:
                width = cone_width(pixel_footprint, r.camera_distance + hit.t)
            vertex = vertex_at(scene, ray, hit, r.medium_stack, width, sampler.index)
            surface = vertex.surface
            shape = scene.shapes[surface.shape]
            leaves = leaves_of(shape.material)
            if wp.static(features.nested):
                if not vertex.is_solid:
                    leaves.remaining = 0
                    leaves.passed = 1.0
            while leaves.remaining > 0:
                if wp.static(composite):
                    leaves = next_leaf(scene, leaves, surface)
                    if leaves.share == 0.0:
                        continue
                else:
                    leaves.remaining = 0
                part = r.throughput * leaves.share

                # Emission
                shines = shape.first_light >= 0
                if wp.static(features.single_sided):
                    shines = shines_for(shape, looks)
                if shines and (surface.front or shape.two_sided != 0):
                    result.radiance += wp.cw_mul(part, emission_at(scene, shape, surface))
                if r.depth >= settings.max_depth:
                    continue

                # Direct light
                mapped = surface  # with the normal map
                if wp.static(features.tangents):
                    mapped = align_tangents(scene, vertex.hit, surface)
                    mapped = apply_normal_map(scene, leaves.leaf, vertex.hit, mapped, ray.direction, width)
                bsdf = bsdf_at(scene, leaves.leaf, mapped)
                if wp.static(has_layers):
                    if scene.materials[leaves.leaf].coat_normal_map >= 0:
                        mapped = align_tangents(scene, vertex.hit, surface)
                        normals = normals_of_layers(scene, leaves.leaf, vertex.hit, mapped, ray.direction)
                        bsdf = with_normals(bsdf, normals)
                if wp.static(features.nested):
                    bsdf = with_body_indices(scene, bsdf, mapped, r.medium_stack, vertex.medium_stack_behind)
                wo = to_local(mapped.frame, -ray.direction)
                jittered = children.jittered_rays(bsdf, r, waiting, settings)
                direct = direct_light(scene, vertex, mapped, bsdf, wo, r, ray.time, settings, jittered > 0)
                result.rays += direct.rays
                result.radiance += wp.cw_mul(part, direct.radiance)

                # Jittered rays, and the mirrored and the refracted one
                lobes = specular(bsdf, wo)
                for k in range(jittered + 2):
                    child = children.child(
                        r, part, vertex, mapped, bsdf, lobes, wo, k, jittered, sampler, jittered_so_far
                    )
                    if is_followed(child, settings) and waiting < WAITING:
                        rows[waiting] = row_of(child)
                        waiting += 1
                jittered_so_far += jittered

            # Straight on, through what is not opaque
            if wp.static(lets_pass):
                surfaces_passed += 1
                r = straight_on(r, vertex, leaves.passed)
                if is_followed(r, settings) and surfaces_passed < MOST_PASSED and waiting < WAITING:
                    rows[waiting] = row_of(r)
                    waiting += 1

        return result

    return trace_tree
