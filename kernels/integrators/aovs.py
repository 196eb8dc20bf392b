"""Layers besides radiance: properties of the first surface that a camera ray hits.

Reflectance, normals and coverage are averaged over a pixel's samples, where a miss counts as 0. Quantities that cannot
be averaged, such as depth across an edge, come from the sample nearest to the pixel's centre.
"""

import warp as wp

from wrt.kernels.bsdf import make_bsdf
from wrt.kernels.camera.camera import Camera, CameraRay
from wrt.kernels.camera.models import make_camera
from wrt.kernels.core.features import Features, has_quadrics
from wrt.kernels.core.ray_tree import NO_HIT
from wrt.kernels.core.rays import to_local, to_world
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.film.film import is_finite_color
from wrt.kernels.geometry.distances import make_volume_of
from wrt.kernels.geometry.quadrics import NO_QUADRIC, in_unit_shape, make_quadric_of, point_of
from wrt.kernels.geometry.spheres import make_sphere_axes, make_sphere_of
from wrt.kernels.geometry.surface import Surface, make_add_texture_coordinates
from wrt.kernels.geometry.triangles import make_triangle_of
from wrt.kernels.integrators.edges import make_find_line
from wrt.kernels.integrators.first_surface import FirstSurface, make_first_surface, make_follow_specular
from wrt.kernels.materials.values import make_bsdf_at
from wrt.kernels.sampling.sampler import BLOCK_BSDF, Sampler, make_sample_4d, vertex_block


@wp.struct
class AovData:
    """A film's layers, (pixels, channels), and the first channel of each in its array, −1 for disabled layers.

    `sums` are over all samples; `nearest`, `object_number` (0 for a miss) and `off_middle` (the squared distance in
    pixels) belong to the sample nearest to the pixel's centre. `coverage` has pairs of an object's number and its
    samples in each of the `slots` of a pixel, 0 and 0 where a slot is empty.
    """

    sums: wp.array2d(dtype=wp.float64)
    nearest: wp.array2d(dtype=wp.float32)
    object_number: wp.array(dtype=wp.int32)
    off_middle: wp.array(dtype=wp.float32)
    coverage: wp.array2d(dtype=wp.int32)
    slots: int
    # In `sums`
    albedo: int
    normal: int
    geometric_normal: int
    alpha: int
    catcher: int
    edges: int
    light_groups: int  # the last ones
    # In `nearest`
    depth: int
    z: int
    position: int
    uv: int
    motion: int
    edge_width: float  # of lines, pixels


@wp.func
def add_color(sums: wp.array2d(dtype=wp.float64), pixel: int, first: int, value: wp.vec3):
    """Add three values to the sums from channel `first` on, unless that is −1."""
    if first >= 0 and is_finite_color(value):
        for k in range(3):
            sums[pixel, first + k] = sums[pixel, first + k] + wp.float64(value[k])


@wp.func
def set_numbers(nearest: wp.array2d(dtype=wp.float32), pixel: int, first: int, count: int, value: wp.vec3):
    """Set `count` channels from `first` on, unless that is −1."""
    if first >= 0:
        for k in range(count):
            nearest[pixel, first + k] = value[k]


@wp.func
def add_coverage(coverage: wp.array2d(dtype=wp.int32), slots: int, pixel: int, object_number: int):
    """Count a sample of an object.

    Where all slots are taken, it replaces the last object that has a single sample, or is lost. Of 41 objects in a
    pixel, one that covers a fifth is then lost in 1 % of pixels of 64 samples instead of in 15 %.
    """
    chosen = int(-1)
    single = int(-1)
    for k in range(slots):
        held = coverage[pixel, 2 * k]
        if chosen < 0 and (held == object_number or held == 0):
            chosen = k
        if coverage[pixel, 2 * k + 1] == 1:
            single = k
    if chosen < 0:
        chosen = single
    if chosen >= 0:
        if coverage[pixel, 2 * chosen] != object_number:
            coverage[pixel, 2 * chosen] = object_number
            coverage[pixel, 2 * chosen + 1] = 0
        coverage[pixel, 2 * chosen + 1] = coverage[pixel, 2 * chosen + 1] + 1


@specialised("models", *make_bsdf_at.fields)
def make_directional_albedo(features: Features) -> wp.Function:
    """Return the device function (scene, surface, material, direction, u) -> vec3, an estimate of directional albedo.

    It samples one direction as a path does. The weight f |cosθi| / pdf has the mean ∫ f |cosθi| dωi, the fraction of
    uniform illumination that reaches the viewer, specular directions included. The scaling of radiance on refraction
    is taken out, or glass would be brighter than 1 from inside.
    """
    bsdf_sample, bsdf_at = make_bsdf(features.models).sample, make_bsdf_at(features)

    @wp.func
    def directional_albedo(
        scene: SceneData, surface: Surface, material: int, direction: wp.vec3, u: wp.vec4
    ) -> wp.vec3:
        bsdf = bsdf_at(scene, material, surface)
        s = bsdf_sample(bsdf, to_local(surface.frame, -direction), wp.vec2(u[0], u[1]), u[2])
        return s.weight * (s.eta * s.eta)

    return directional_albedo


@specialised("instances", "exact", "cameras")
def make_motion_on_film(features: Features) -> wp.Function:
    """Return the device function (scene, camera, first, direction, time) -> vec2, a point's motion in pixels.

    It leads from the point's position on the film when the shutter opens to that when it closes.
    """
    triangle_of, quadric_of = make_triangle_of(features.instances), make_quadric_of(features.geometry)
    sphere_of, sphere_axes = make_sphere_of(features.geometry), make_sphere_axes(features.geometry)
    volume_of, film_position = make_volume_of(features.geometry), make_camera(features.cameras).film_position

    @wp.func
    def position_at(scene: SceneData, first: FirstSurface, hit_time: float, time: float) -> wp.vec3:
        hit = first.hit
        t = triangle_of(scene, hit.triangle, hit.instance, time)
        position = t.p0 + t.e1 * hit.u + t.e2 * hit.v
        if wp.static(features.has_exact):
            sphere = sphere_of(scene, hit.triangle, hit.instance, hit_time)
            if sphere.radius > 0.0:
                # The same point of the sphere, in its own axes
                axes = sphere_axes(scene, hit.triangle, hit.instance, hit_time)
                place = to_local(axes, (first.surface.position - sphere.center) / sphere.radius)
                axes = sphere_axes(scene, hit.triangle, hit.instance, time)
                sphere = sphere_of(scene, hit.triangle, hit.instance, time)
                position = sphere.center + to_world(axes, place) * sphere.radius
        if wp.static(has_quadrics(features.geometry)):
            quadric = quadric_of(scene, hit.triangle, hit.instance, hit_time)
            if quadric.kind != NO_QUADRIC:
                on_unit = in_unit_shape(quadric, first.surface.position - quadric.center)
                position = point_of(quadric_of(scene, hit.triangle, hit.instance, time), on_unit)
        if wp.static(bool(features.distances)):
            volume = volume_of(scene, hit.triangle, hit.instance, hit_time)
            if volume.model >= 0:
                in_volume = in_unit_shape(volume.axes, first.surface.position - volume.axes.center)
                position = point_of(volume_of(scene, hit.triangle, hit.instance, time).axes, in_volume)
        return position

    @wp.func
    def motion_on_film(
        scene: SceneData, camera: Camera, first: FirstSurface, direction: wp.vec3, time: float
    ) -> wp.vec2:
        begin = direction
        end = direction
        distant = first.hit.triangle == NO_HIT
        if not distant:
            begin = position_at(scene, first, time, camera.shutter_open)
            end = position_at(scene, first, time, camera.shutter_close)
        last = film_position(camera, end, distant, camera.shutter_close)
        return last - film_position(camera, begin, distant, camera.shutter_open)

    return motion_on_film


@specialised(
    *("guides", "cameras", *make_follow_specular.fields, *make_directional_albedo.fields),
    *(*make_motion_on_film.fields, *make_find_line.fields),
)
def make_add_aovs(features: Features) -> wp.Function:
    """Return the device function (scene, camera, seen, sampler, aovs, pixel, offset, radiance) -> rays traced.

    It adds one sample, of the camera ray `seen` through the point `offset` from the pixel's centre, along which the
    integrator has found a `radiance`.
    """
    first_surface = make_first_surface(features)
    follow_specular, directional_albedo = make_follow_specular(features), make_directional_albedo(features)
    motion_on_film, sample_4d = make_motion_on_film(features), make_sample_4d(features.sampler)
    along_axis, find_line = make_camera(features.cameras).along_axis, make_find_line(features)
    has_coordinates = features.textured or features.tangents
    add_texture_coordinates = make_add_texture_coordinates(False, features.has_exact)

    @wp.func
    def add_aovs(
        scene: SceneData,
        camera: Camera,
        seen: CameraRay,
        sampler: Sampler,
        aovs: AovData,
        pixel: int,
        offset: wp.vec2,
        radiance: wp.vec3,
    ) -> int:
        first = first_surface(scene, seen.ray, seen.footprint, sampler)
        if wp.static(features.edges != "none"):
            line = find_line(scene, camera, seen, first, aovs.edge_width)
            if line.is_met:
                aovs.sums[pixel, aovs.edges] = aovs.sums[pixel, aovs.edges] + wp.float64(1.0)
            first.rays = first.rays + line.rays
        direction = seen.ray.direction
        tint = wp.vec3(1.0)
        if wp.static(features.guides):
            chain = follow_specular(scene, first, seen.ray, sampler)
            first = chain.first
            direction = chain.direction
            tint = chain.tint
        surface = first.surface
        is_hit = first.hit.triangle != NO_HIT
        if is_hit:
            add_color(aovs.sums, pixel, aovs.normal, surface.frame.n)
            add_color(aovs.sums, pixel, aovs.geometric_normal, surface.normal)
            if aovs.slots > 0:
                add_coverage(aovs.coverage, aovs.slots, pixel, surface.shape + 1)
            if aovs.alpha >= 0:
                aovs.sums[pixel, aovs.alpha] = aovs.sums[pixel, aovs.alpha] + wp.float64(1.0)
            if aovs.catcher >= 0 and scene.shapes[surface.shape].catches_shadows != 0:
                add_color(aovs.sums, pixel, aovs.catcher, radiance)
                share = aovs.catcher + 3
                aovs.sums[pixel, share] = aovs.sums[pixel, share] + wp.float64(1.0)
            if aovs.albedo >= 0:
                u = sample_4d(sampler, vertex_block(1, BLOCK_BSDF))
                albedo = directional_albedo(scene, surface, first.material, direction, u)
                if wp.static(features.guides):
                    albedo = wp.cw_mul(albedo, tint)
                add_color(aovs.sums, pixel, aovs.albedo, albedo)
        off_middle = wp.dot(offset, offset)
        if off_middle < aovs.off_middle[pixel]:
            aovs.off_middle[pixel] = off_middle
            number = int(0)
            depth = wp.inf
            if is_hit:
                number = surface.shape + 1
                depth = first.distance
            aovs.object_number[pixel] = number
            set_numbers(aovs.nearest, pixel, aovs.depth, 1, wp.vec3(depth))
            if aovs.z >= 0:
                z = wp.inf
                if is_hit:
                    z = along_axis(camera, surface.position, seen.ray.time)
                set_numbers(aovs.nearest, pixel, aovs.z, 1, wp.vec3(z))
            set_numbers(aovs.nearest, pixel, aovs.position, 3, surface.position)
            if aovs.uv >= 0:
                if is_hit and wp.static(not has_coordinates):
                    surface = add_texture_coordinates(scene, first.hit, surface)
                set_numbers(aovs.nearest, pixel, aovs.uv, 2, wp.vec3(surface.uv[0], surface.uv[1], 0.0))
            if aovs.motion >= 0:
                moved = motion_on_film(scene, camera, first, seen.ray.direction, seen.ray.time)
                set_numbers(aovs.nearest, pixel, aovs.motion, 2, wp.vec3(moved[0], moved[1], 0.0))
        return first.rays

    return add_aovs
