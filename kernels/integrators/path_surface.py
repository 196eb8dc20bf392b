"""Stages of a path at surfaces: the vertex, emission and scattering."""

import warp as wp

from wrt.kernels.bsdf import (
    make_bsdf,
    make_by_viewer,
    make_is_any,
    make_is_caster,
    make_is_matt,
    make_receives_light,
    models_with,
)
from wrt.kernels.core.bsdf import Bsdf, BsdfSample
from wrt.kernels.core.features import Features
from wrt.kernels.core.ray_tree import Hit
from wrt.kernels.core.rays import RECEIVES_BOTH, RECEIVES_FRONT, Ray, to_local, to_world
from wrt.kernels.core.scene_data import NEEDS_BODIES, NEEDS_COORDINATES, NEEDS_LEVELS, BodyStack, SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.core.spmd_marks import inline_stage
from wrt.kernels.geometry.surface import (
    Surface,
    align_tangents,
    gap_behind,
    leave,
    leave_in_front,
    make_add_texture_coordinates,
    make_surface_at,
)
from wrt.kernels.geometry.triangles import WIDELY
from wrt.kernels.integrators.light_groups import add_to_group
from wrt.kernels.integrators.next_event import emitter_hit_weight
from wrt.kernels.integrators.path_state import PathState, SurfaceVertex, make_begin_indirect
from wrt.kernels.integrators.shadow_rays import can_attenuate_shadows
from wrt.kernels.integrators.sides import shines_for
from wrt.kernels.lights.lights import make_lights
from wrt.kernels.lights.mesh_lights import make_hit_pdf
from wrt.kernels.materials.choice import MOST_PASSED, PASSED_THROUGH, make_choose_material, material_of_side
from wrt.kernels.materials.values import (
    disperses,
    have_coat_normals,
    make_bsdf_at,
    make_with_indices,
    make_with_normals,
    make_with_throughput,
)
from wrt.kernels.media.bodies import innermost, is_there, make_meet, relative_indices
from wrt.kernels.sampling.sampler import Sampler
from wrt.kernels.textures.footprint import sample_footprint
from wrt.kernels.textures.normal_maps import apply_normal_map, bump_shadow, normals_of_layers


@wp.func
def cone_width(footprint: wp.vec2, distance: float) -> float:
    """Return the width of the camera ray's cone at a distance; `footprint` is its first width, and its growth."""
    return footprint[0] + footprint[1] * distance


@specialised("instances", "exact", "media", "nested", "textured", "tangents", "uv2_alpha", "mipmapped")
def make_vertex_at(features: Features) -> wp.Function:
    """Return the stage (scene, ray, nearest hit, medium_stack, width, index) -> SurfaceVertex, without its material.

    `width` is the width of the pixel's cone at the hit, 0 for none, and `index` the number of the sample.
    """
    bodies, has_coordinates = features.bodies, features.textured or features.tangents
    surface_at = make_surface_at(features.geometry)
    meet = make_meet(features.geometry)
    add_texture_coordinates = make_add_texture_coordinates(features.uv2_alpha, features.has_exact)

    @wp.func
    @inline_stage
    def vertex_at(
        scene: SceneData, ray: Ray, nearest: Hit, medium_stack: BodyStack, width: float, index: wp.uint32
    ) -> SurfaceVertex:
        vertex = SurfaceVertex()
        hit = nearest
        surface = surface_at(scene, ray, hit)
        if wp.static(bodies):
            if scene.needs & NEEDS_BODIES != 0 and scene.shapes[surface.shape].body >= 0:
                surface.clearance = surface.clearance * WIDELY
        vertex.origin_in_front = leave_in_front(surface, ray.origin, ray.direction)
        vertex.origin_behind = leave(surface, -1.0)

        # Bodies: of several surfaces in one place, the one that decides
        vertex.is_solid = True
        if wp.static(bodies):
            if scene.needs & NEEDS_BODIES != 0:
                meeting = meet(scene, ray, hit, surface, medium_stack)
                hit = meeting.hit
                surface = meeting.surface
                vertex.medium_stack_behind = meeting.stack_behind
                if wp.static(features.nested):
                    vertex.is_solid = is_there(scene, surface, medium_stack, meeting.stack_behind)

        # Texture coordinates
        if wp.static(has_coordinates):
            if scene.needs & NEEDS_COORDINATES != 0:
                surface = add_texture_coordinates(scene, hit, surface)
        if wp.static(features.mipmapped):
            if scene.needs & NEEDS_LEVELS != 0 and width > 0.0:
                surface.footprint = sample_footprint(scene, hit, surface, ray.direction, width, index)
        vertex.hit = hit
        vertex.surface = surface
        return vertex

    return vertex_at


@specialised()
def make_surface_vertex(features: Features) -> wp.Function:
    """Return the stage (scene, path, hit, u_material, sampler) -> SurfaceVertex, the vertex at a path's nearest hit."""
    vertex_at = make_vertex_at(features)
    choose_material = make_choose_material(features.uv2_alpha, features.mipmapped, features.procedures)

    @wp.func
    @inline_stage
    def surface_vertex(
        scene: SceneData, path: PathState, hit: Hit, u_material: float, sampler: Sampler
    ) -> SurfaceVertex:
        width = float(0.0)
        if wp.static(features.mipmapped):
            width = cone_width(path.footprint, path.passed_distance + hit.t)
        vertex = vertex_at(scene, path.ray, hit, path.medium_stack, width, sampler.index)
        vertex.material = scene.shapes[vertex.surface.shape].material
        if wp.static(features.composite == "sides"):
            vertex.material = material_of_side(scene, vertex.material, vertex.surface)
        if wp.static(features.mixed):
            if vertex.is_solid:
                vertex.material = choose_material(scene, vertex.material, vertex.surface, u_material)
                if wp.static(features.has_holes):
                    vertex.is_solid = vertex.material != PASSED_THROUGH
        return vertex

    return surface_vertex


@wp.func
@inline_stage
def pass_through(path: PathState, vertex: SurfaceVertex) -> PathState:
    """Move a path straight on to behind a surface, which does not count as a vertex."""
    path.surfaces_passed += 1
    path.is_done = path.surfaces_passed > MOST_PASSED
    path.passed_distance += wp.length(vertex.origin_behind - path.ray.origin)
    path.ray.origin = vertex.origin_behind
    path.origin_gap = gap_behind(vertex.surface, vertex.origin_behind, path.ray.direction)
    path.previous_hit = vertex.hit
    path.medium_stack = vertex.medium_stack_behind
    return path


@specialised(*make_lights.fields, "single_sided")
def make_emission_weight(features: Features) -> wp.Function:
    """Return the stage (scene, path, vertex, strategy) -> float: the weight of the surface's emission, −1 if none."""
    lights, hit_pdf = make_lights(features), make_hit_pdf(features.geometry)

    @wp.func
    @inline_stage
    def emission_weight(scene: SceneData, path: PathState, vertex: SurfaceVertex, strategy: int) -> float:
        weight = float(-1.0)
        shape = scene.shapes[vertex.surface.shape]
        shines = shape.first_light >= 0
        if wp.static(features.single_sided):
            shines = shines_for(shape, not path.was_blurred)
        if shines:
            if vertex.surface.front or shape.two_sided != 0:
                weight = 1.0
                if path.scatter_pdf > 0.0:
                    distance = path.passed_distance + vertex.hit.t
                    light_pdf = hit_pdf(scene, path.receiver, vertex.surface, vertex.hit, path.ray.direction, distance)
                    light_number = shape.first_light + vertex.hit.triangle - shape.first_triangle
                    light_pdf *= lights.choice_probability(scene, path.receiver, light_number)
                    weight = emitter_hit_weight(strategy, path.scatter_pdf, light_pdf)
        return weight

    return emission_weight


@specialised(*make_emission_weight.fields, "light_groups")
def make_surface_emission(features: Features) -> wp.Function:
    """Return the stage (scene, path, vertex, strategy) -> PathState that adds the emission of the surface."""
    emission_weight, emission_at = make_emission_weight(features), make_lights(features).emission_at

    @wp.func
    @inline_stage
    def surface_emission(scene: SceneData, path: PathState, vertex: SurfaceVertex, strategy: int) -> PathState:
        weight = emission_weight(scene, path, vertex, strategy)
        if weight >= 0.0:
            shape = scene.shapes[vertex.surface.shape]
            emission = wp.cw_mul(path.throughput, emission_at(scene, shape, vertex.surface)) * weight
            path.radiance += emission
            if wp.static(features.light_groups):
                path.groups = add_to_group(scene, path.groups, shape.first_light, emission)
        return path

    return surface_emission


@specialised("models")
def make_with_body_indices(features: Features, *, by_channel: bool = False) -> wp.Function:
    """Return (scene, bsdf, surface, stack, stack_behind) -> Bsdf with the refractive index between the bodies there.

    Dispersive models have one `by_channel`, or the same one for all.
    """
    with_indices = make_with_indices(features.models)

    @wp.func
    def with_body_indices(
        scene: SceneData, bsdf: Bsdf, surface: Surface, stack: BodyStack, stack_behind: BodyStack
    ) -> Bsdf:
        if scene.shapes[surface.shape].body < 0:
            return bsdf
        found = relative_indices(scene, surface, innermost(scene, stack), innermost(scene, stack_behind))
        indices = wp.vec3(found[0])
        if wp.static(by_channel):
            indices = wp.vec3(found[1], found[2], found[3])
        return with_indices(bsdf, found[0], indices)

    return with_body_indices


@specialised()
def make_prepare_bsdf(features: Features) -> wp.Function:
    """Return the stage (scene, path, vertex, widening) -> SurfaceVertex with its normal and BSDF."""
    panes, dispersive = models_with(features.models, "straight"), disperses(features.models)
    bsdf_at = make_bsdf_at(features)
    with_body_indices = make_with_body_indices(features, by_channel=dispersive)
    with_throughput = make_with_throughput(features.models)
    with_normals, has_layers = make_with_normals(features.models), have_coat_normals(features.models)
    receives_light, is_pane = make_receives_light(features.models), make_is_any(panes)

    @wp.func
    @inline_stage
    def prepare_bsdf(scene: SceneData, path: PathState, vertex: SurfaceVertex, widening: float) -> SurfaceVertex:
        surface = vertex.surface
        if wp.static(features.tangents):
            if wp.static(has_layers):
                aligned = surface
            if scene.aligns_tangents != 0:
                surface = align_tangents(scene, vertex.hit, surface)
                width = cone_width(path.footprint, path.passed_distance + vertex.hit.t)
                if wp.static(has_layers):
                    aligned = surface
                surface = apply_normal_map(scene, vertex.material, vertex.hit, surface, path.ray.direction, width)
        bsdf = bsdf_at(scene, vertex.material, surface)
        if wp.static(has_layers):
            if scene.aligns_tangents != 0 and scene.materials[vertex.material].coat_normal_map >= 0:
                surface = aligned
                normals = normals_of_layers(scene, vertex.material, vertex.hit, surface, path.ray.direction)
                bsdf = with_normals(bsdf, normals)
        if wp.static(features.regularized):
            if path.was_blurred:
                bsdf.normal_variance = bsdf.normal_variance + wp.vec2(widening)
        if wp.static(features.nested):
            bsdf = with_body_indices(scene, bsdf, surface, path.medium_stack, vertex.medium_stack_behind)
        if wp.static(dispersive):
            bsdf = with_throughput(bsdf, path.throughput)
        vertex.wo = to_local(surface.frame, -path.ray.direction)
        if wp.static(bool(panes)):
            vertex.is_pane = is_pane(bsdf)
        vertex.samples_lights = scene.lights.shape[0] > 0 and receives_light(bsdf)
        vertex.bsdf = bsdf
        vertex.surface = surface
        return vertex

    return prepare_bsdf


@specialised("models")
def make_place_receiver(features: Features) -> wp.Function:
    """Return the stage (path, vertex) -> PathState that moves the receiver of light to the vertex."""
    transmitting = models_with(features.models, "transmits")
    bsdf_transmits = make_is_any(transmitting)

    @wp.func
    @inline_stage
    def place_receiver(path: PathState, vertex: SurfaceVertex) -> PathState:
        if vertex.samples_lights:
            path.receiver.position = vertex.origin_in_front
            path.receiver.normal = vertex.surface.frame.n
            path.receiver.receives = RECEIVES_FRONT
            if wp.static(bool(transmitting)):
                if bsdf_transmits(vertex.bsdf):
                    path.receiver.receives = RECEIVES_BOTH
        return path

    return place_receiver


# Shorter paths are never ended by roulette; the survival of longer ones follows the throughput. One that has lost
# nothing survives: light comes through many panes of clear glass.
ROULETTE_DEPTH = wp.constant(5)


@wp.func
@inline_stage
def russian_roulette(path: PathState, u: float) -> PathState:
    """End a path by chance according to its throughput, without the squeeze of solid angles inside glass."""
    survival = wp.max(path.throughput) * path.eta_scale
    if path.depth >= ROULETTE_DEPTH:
        survival = wp.min(survival, 1.0)
        path.is_done = path.is_done or not (u < survival)
        path.throughput = path.throughput / survival
    path.is_done = path.is_done or not (survival > 0.0)
    return path


@specialised()
def make_scatter_at_surface(features: Features, *, of_photons: bool = False) -> wp.Function:
    """Return the stage (path, vertex, sample, u_roulette) -> PathState that turns a path to a sampled direction.

    The path is done if roulette ends it, or if shading normal and surface disagree about the side to which it leaves.
    A path of photons runs the other way: what depends on the direction to the light depends on where it comes from.
    """
    is_matt, is_caster = make_is_matt(features.models), make_is_caster(features.models)
    casters = bool(models_with(features.models, "is_caster"))

    @wp.func
    @inline_stage
    def scatter_at_surface(path: PathState, vertex: SurfaceVertex, sample: BsdfSample, u_roulette: float) -> PathState:
        path.depth += 1
        path.eta_scale *= sample.eta * sample.eta
        path.scatter_pdf = sample.pdf
        if wp.static(features.tells_blurred):
            path.was_blurred = path.was_blurred or sample.pdf > 0.0
        side = wp.where(sample.wi[2] > 0.0, 1.0, -1.0)
        direction = to_world(vertex.surface.frame, sample.wi)
        # A direction along the surface, wi[2] = 0, leaves to no side.
        path.is_done = not (wp.dot(direction, vertex.surface.normal) * sample.wi[2] > 0.0)
        if wp.static(features.caustics):
            receives = sample.pdf > 0.0
            if wp.static(casters):
                path.was_cast = sample.pdf == 0.0 or is_caster(vertex.bsdf)
                receives = not path.was_cast
            path.has_gathered = path.has_gathered or receives
            if wp.static(features.media != "scattering"):
                path.has_settled = path.has_settled or (receives and is_matt(vertex.bsdf))
        if wp.static(of_photons):
            # With shading normals the adjoint of a BSDF is another one (Veach 1997, section 5.3).
            came = wp.abs(vertex.wo[2]) * wp.abs(wp.dot(direction, vertex.surface.normal))
            leaves = wp.abs(sample.wi[2]) * wp.abs(wp.dot(path.ray.direction, vertex.surface.normal))
            path.is_done = path.is_done or not (leaves > 0.0)
            path.throughput = path.throughput * (came / leaves)
        if wp.static(features.tangents):
            share = bump_shadow(vertex.surface, direction, side)
            if wp.static(of_photons):
                share = bump_shadow(vertex.surface, -path.ray.direction, 1.0)
            path.throughput = path.throughput * share
            path.is_done = path.is_done or share == 0.0
        if side > 0.0:
            path.ray.origin = vertex.origin_in_front
        else:
            path.ray.origin = vertex.origin_behind
            if wp.static(features.bodies):
                path.medium_stack = vertex.medium_stack_behind
        path.ray.direction = wp.normalize(direction)
        if wp.static(features.media != "none"):
            path.origin_gap = gap_behind(vertex.surface, path.ray.origin, path.ray.direction)
            path.previous_hit = vertex.hit
        if wp.static(can_attenuate_shadows(features)):
            path.passed_distance = 0.0
        if wp.static(features.mipmapped or features.tangents):
            path.footprint = wp.vec2(0.0)
        path = russian_roulette(path, u_roulette)
        return path

    return scatter_at_surface


_REFLECTED = wp.constant(0.25)
"""Share of the paths that the first clear surface reflects at least: one of four samples, as they are stratified."""


@wp.func
def reflect_a_quarter(u_lobe: float, reflectance: float) -> wp.vec2:
    """Return the number in place of `u_lobe` by which a quarter of the paths are reflected, and the weight for it."""
    if reflectance <= 0.0 or reflectance >= _REFLECTED:
        return wp.vec2(u_lobe, 1.0)
    if u_lobe < _REFLECTED:
        share = reflectance / _REFLECTED
        return wp.vec2(u_lobe * share, share)
    share = (1.0 - reflectance) / (1.0 - _REFLECTED)
    return wp.vec2(reflectance + (u_lobe - _REFLECTED) * share, share)


@wp.func
def _no_reflectance(bsdf: Bsdf, wo: wp.vec3) -> float:
    return 0.0


@specialised()
def make_sample_bsdf(features: Features, *, of_photons: bool = False) -> wp.Function:
    """Return the stage (path, vertex, u, u_pane, max_depth) -> PathState: on from a vertex, unless it is done.

    A path that goes straight through a pane passes it, as if it were not there.
    """
    panes = bool(models_with(features.models, "straight"))
    bsdf_sample, begin_indirect = make_bsdf(features.models).sample, make_begin_indirect(features)
    scatter_at_surface = make_scatter_at_surface(features, of_photons=of_photons)
    stratifies = features.caustics and not of_photons and bool(models_with(features.models, "reflects"))
    reflects = make_by_viewer(features.models, "reflects", _no_reflectance)

    @wp.func
    @inline_stage
    def sample_bsdf(path: PathState, vertex: SurfaceVertex, u: wp.vec4, u_pane: float, max_depth: int) -> PathState:
        u_lobe = u[2]
        if wp.static(panes):
            u_lobe = wp.where(vertex.is_pane, u_pane, u[2])
        if wp.static(stratifies):
            # Images of lamps in glass are dim and bright at once. Samples of a pixel are stratified by fours.
            if path.depth == 0:
                choice = reflect_a_quarter(u_lobe, reflects(vertex.bsdf, vertex.wo))
                u_lobe = choice[0]
                path.throughput = path.throughput * choice[1]
        sample = bsdf_sample(vertex.bsdf, vertex.wo, wp.vec2(u[0], u[1]), u_lobe)
        path.throughput = wp.cw_mul(path.throughput, sample.weight)
        if wp.static(panes):
            if vertex.is_pane and not (sample.wi[2] > 0.0):
                path = pass_through(path, vertex)
                path.is_done = path.is_done or wp.max(path.throughput) == 0.0
            else:
                if wp.static(features.clamped):
                    path = begin_indirect(path, path.depth + path.medium_scatterings >= 1)
                path = scatter_at_surface(path, vertex, sample, u[3])
                path.is_done = path.is_done or path.depth >= max_depth
        else:
            path = scatter_at_surface(path, vertex, sample, u[3])
        return path

    return sample_bsdf
