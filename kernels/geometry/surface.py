"""The surface at a hit: position, normals, and interpolated vertex attributes."""

import warp as wp

from wrt.kernels.core.features import distances_of, has_exact, has_quadrics, identifier, instances_of
from wrt.kernels.core.motion import key_at
from wrt.kernels.core.ray_tree import Hit, make_instance_placement
from wrt.kernels.core.rays import Frame, Ray, make_frame
from wrt.kernels.core.scene_data import NEEDS_EXACT, NEEDS_MORE_COORDINATES, SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.core.spmd_marks import shading_point
from wrt.kernels.geometry.distances import make_point_on_volume, make_volume_of
from wrt.kernels.geometry.quadrics import (
    NO_QUADRIC,
    Quadric,
    by_coordinate,
    clearance_of_quadric,
    front_of,
    make_quadric_of,
    point_of,
    point_on_quadric,
    quadric_coordinates,
)
from wrt.kernels.geometry.spheres import (
    Sphere,
    along_meridian,
    along_turn,
    clearance_of_sphere,
    make_sphere_axes,
    make_sphere_of,
    point_on_sphere,
    sphere_coordinates,
)
from wrt.kernels.geometry.triangles import clearance, make_triangle_of, triangle_normal, twice_area

# Rays leave a surface at most this many times its clearance from where one met it.
_MOST_CLEARANCES = wp.constant(64.0)


@wp.struct
class Surface:
    """A point on a triangle, seen along a ray.

    `normal` (geometric) and `frame.n` (shading) face the viewer; `front` is whether the viewer is on the triangle's
    front, where its corners run counter-clockwise; for a mirrored instance, the front of its mesh. `e1` and `e2` are
    two edges of the triangle in the world, `clearance` is the offset from which rays leave it. `footprint` is the ray
    cone's footprint in the texture (see `texture_footprint`); zero for a point sample. `second_uv` and `alpha` are set
    if Features.uv2_alpha. `normal_variance` is the variance that a filtered normal map leaves to the roughness (see
    `Bsdf`). `smooth_normal` and `bump_alpha2` are the normal before a map of Mitsuba's conventions, and the roughness
    by which its bumps shadow; 0 for all other surfaces.
    """

    position: wp.vec3
    e1: wp.vec3
    e2: wp.vec3
    clearance: float
    normal: wp.vec3
    frame: Frame
    front: bool
    shape: int
    uv: wp.vec2
    footprint: wp.vec4
    color: wp.vec3
    second_uv: wp.vec2
    alpha: float
    normal_variance: wp.vec2
    smooth_normal: wp.vec3
    bump_alpha2: float


@wp.func
def normal_of_mesh(scene: SceneData, hit: Hit, first: int) -> wp.vec3:
    """Return the interpolated normal on a mesh copy, whose vertices are offset by `first` from the indices."""
    i = scene.corners[hit.triangle]
    normal = scene.normals[i[0] + first] * (1.0 - hit.u - hit.v)
    return normal + scene.normals[i[1] + first] * hit.u + scene.normals[i[2] + first] * hit.v


@specialised()
def make_shading_normal(instances: str) -> wp.Function:
    """Return the device function (scene, hit, time) -> the interpolated normal, of any length; 0 on flat triangles."""
    deforming = instances == "deforming"

    @wp.func
    def of_one_tree(scene: SceneData, hit: Hit, time: float) -> wp.vec3:
        return normal_of_mesh(scene, hit, 0)

    if instances == "none":
        return of_one_tree
    instance_placement = make_instance_placement(instances)

    @wp.func
    def shading_normal(scene: SceneData, hit: Hit, time: float) -> wp.vec3:
        record = scene.placed.instances[hit.instance]
        normal = normal_of_mesh(scene, hit, 0)
        if wp.static(deforming):
            mesh = scene.placed.meshes[record.mesh]
            if mesh.keys > 1:
                at = key_at(scene.placed.key_times, mesh.first_time, mesh.keys, time)
                first = int(at[0]) * mesh.vertex_stride
                second = wp.min(first + mesh.vertex_stride, (mesh.keys - 1) * mesh.vertex_stride)
                normal = normal_of_mesh(scene, hit, first) * (1.0 - at[1])
                normal += normal_of_mesh(scene, hit, second) * at[1]
        # Transform by cofactors: the inverse transpose times the determinant, for a map scaled to 1.
        linear = instance_placement(scene.placed, record, time).linear
        size = float(0.0)
        for k in range(3):
            size = wp.max(size, wp.max(wp.abs(linear[k])))
        a = wp.vec3(linear[0, 0], linear[1, 0], linear[2, 0]) / size
        b = wp.vec3(linear[0, 1], linear[1, 1], linear[2, 1]) / size
        c = wp.vec3(linear[0, 2], linear[1, 2], linear[2, 2]) / size
        return wp.cross(b, c) * normal[0] + wp.cross(c, a) * normal[1] + wp.cross(a, b) * normal[2]

    return shading_normal


@wp.func
def leave(surface: Surface, side: float) -> wp.vec3:
    """Return the surface's point offset to the side of its geometric normal (1) or the other (−1)."""
    return surface.position + surface.normal * (side * surface.clearance)


@wp.func
def leave_in_front(surface: Surface, origin: wp.vec3, direction: wp.vec3) -> wp.vec3:
    """Return where rays leave a surface to the side from which a ray came, given that ray's origin and direction.

    It is back along that ray, since nothing lay there. In a corner, the rounded point may be beyond the other wall, and
    so may a point beside it along the normal.
    """
    cosine = -wp.dot(direction, surface.normal)
    height = surface.clearance
    back = height / wp.max(cosine, 1.0 / _MOST_CLEARANCES)
    half = 0.5 * wp.dot(surface.position - origin, direction)
    if half < back:  # from wall to wall in a narrow corner, where a whole clearance is beyond the other wall
        back = half
        height = 0.25 * height
    return surface.position - direction * back + surface.normal * wp.max(height - back * cosine, 0.0)


@wp.func
def gap_behind(surface: Surface, origin: wp.vec3, direction: wp.vec3) -> float:
    """Return how far a ray that leaves a surface at `origin`, a little beside it, has come from it already."""
    height = wp.abs(wp.dot(origin - surface.position, surface.normal))
    return height / wp.max(wp.abs(wp.dot(direction, surface.normal)), 0.02)


@specialised()
def make_surface_at(geometry: str) -> wp.Function:
    """Return the device function (scene, ray, hit) -> Surface; see `Features.geometry`.

    With exact shapes, `uv` are the weights by which `make_add_texture_coordinates` interpolates.
    """
    if has_exact(geometry):
        return _make_surface_or_exact_at(geometry)
    instances = geometry
    placed = instances != "none"
    triangle_of = make_triangle_of(instances)
    shading_normal = make_shading_normal(instances)

    @wp.func(name=f"surface_at_{instances}")
    @shading_point
    def at(scene: SceneData, ray: Ray, hit: Hit) -> Surface:
        triangle = triangle_of(scene, hit.triangle, hit.instance, ray.time)
        surface = Surface()
        # Interpolated, not origin + t·direction: the error then depends on the triangle's own coordinates, not on the
        # length of the ray.
        surface.position = triangle.p0 + triangle.e1 * hit.u + triangle.e2 * hit.v
        surface.e1 = triangle.e1
        surface.e2 = triangle.e2
        normal = triangle_normal(triangle.e1, triangle.e2)
        sizes = wp.abs(triangle.p0) + wp.abs(triangle.e1) + wp.abs(triangle.e2)
        surface.clearance = clearance(normal, sizes, triangle.slack)
        if wp.static(placed):
            surface.shape = scene.placed.instances[hit.instance].shape
            if surface.shape < 0:
                surface.shape = scene.triangle_shape[hit.triangle]
            normal = normal * triangle.side
        else:
            surface.shape = scene.triangle_shape[hit.triangle]

        shading = wp.vec3()
        if scene.shapes[surface.shape].smooth != 0:
            shading = shading_normal(scene, hit, ray.time)
        # Normals in files may point either way.
        if wp.dot(shading, normal) < 0.0:
            shading = -shading
        surface.front = wp.dot(normal, ray.direction) < 0.0
        if not surface.front:
            normal = -normal
            shading = -shading
        # A BSDF cannot use an interpolated normal that faces away from the viewer.
        if wp.dot(shading, ray.direction) >= 0.0:
            shading = normal
        surface.normal = normal
        surface.frame = make_frame(wp.normalize(shading))
        return surface

    return at


@specialised()
def _make_surface_or_exact_at(geometry: str) -> wp.Function:
    """Return the function of `make_surface_at` for scenes with exact shapes."""
    instances, quadrics = instances_of(geometry), has_quadrics(geometry)
    placed = instances != "none"
    on_triangle = make_surface_at(instances)
    sphere_of, sphere_axes = make_sphere_of(geometry), make_sphere_axes(geometry)
    quadric_of = make_quadric_of(geometry)
    volume_of, point_on_volume = make_volume_of(geometry), make_point_on_volume(geometry)

    @wp.func
    def seen_of(scene: SceneData, hit: Hit, position: wp.vec3, normal: wp.vec3, outside: bool, front: bool) -> Surface:
        surface = Surface()
        surface.position = position
        surface.normal = wp.where(outside, normal, -normal)
        surface.frame = make_frame(surface.normal)
        surface.front = front
        surface.shape = scene.triangle_shape[hit.triangle]
        if wp.static(placed):
            of_instance = scene.placed.instances[hit.instance].shape
            if of_instance >= 0:
                surface.shape = of_instance
        return surface

    @wp.func(name=f"surface_at_{identifier([geometry])}")
    @shading_point
    def at(scene: SceneData, ray: Ray, hit: Hit) -> Surface:
        if wp.static(bool(distances_of(geometry))):
            volume = volume_of(scene, hit.triangle, hit.instance, ray.time)
            if volume.model >= 0:
                outside = hit.u > 0.5
                seen = point_on_volume(scene, volume, ray, hit.t, outside)
                front_shown = outside == (volume.axes.side > 0.0)
                on_surface = seen_of(scene, hit, seen.position, seen.normal, outside, front_shown)
                on_surface.clearance = seen.clearance
                on_surface.uv = seen.uv
                on_surface.e1 = seen.e1
                on_surface.e2 = seen.e2
                return on_surface
        if wp.static(quadrics):
            quadric = Quadric()
            if scene.needs & NEEDS_EXACT != 0:
                quadric = quadric_of(scene, hit.triangle, hit.instance, ray.time)
            if quadric.kind != NO_QUADRIC:
                point = point_on_quadric(quadric, ray, hit.t)
                normal = front_of(quadric, point.place)
                position = point_of(quadric, point.place)
                on_quadric = seen_of(scene, hit, position, normal, point.front, point.front)
                on_quadric.clearance = clearance_of_quadric(quadric, normal)
                on_quadric.uv = quadric_coordinates(quadric, point.place)
                on_quadric.e1 = by_coordinate(quadric, point.place, 0)
                on_quadric.e2 = by_coordinate(quadric, point.place, 1)
                return on_quadric
        surface = Surface()
        sphere = Sphere()
        if scene.needs & NEEDS_EXACT != 0:
            sphere = sphere_of(scene, hit.triangle, hit.instance, ray.time)
        if sphere.radius > 0.0:
            on_sphere = point_on_sphere(sphere, ray, hit.t)
            sphere_position = sphere.center + on_sphere.out * sphere.radius
            front = on_sphere.from_outside == (sphere.side > 0.0)
            surface = seen_of(scene, hit, sphere_position, on_sphere.out, on_sphere.from_outside, front)
            surface.clearance = clearance_of_sphere(sphere, on_sphere.out)
            axes = sphere_axes(scene, hit.triangle, hit.instance, ray.time)
            surface.uv = sphere_coordinates(axes, on_sphere.out)
            surface.e1 = along_turn(axes, on_sphere.out, sphere.radius)
            surface.e2 = along_meridian(axes, on_sphere.out, sphere.radius)
        else:
            surface = on_triangle(scene, ray, hit)
            surface.uv = wp.vec2(hit.u, hit.v)
        return surface

    return at


surface_at = make_surface_at("none")


@wp.func
def add_texture_coordinates(scene: SceneData, hit: Hit, surface: Surface) -> Surface:
    """Return the surface with the attributes that only textured materials need."""
    i = scene.corners[hit.triangle]
    w0 = 1.0 - hit.u - hit.v
    surface.uv = scene.uvs[i[0]] * w0 + scene.uvs[i[1]] * hit.u + scene.uvs[i[2]] * hit.v
    surface.color = scene.colors[i[0]] * w0 + scene.colors[i[1]] * hit.u + scene.colors[i[2]] * hit.v
    return surface


@specialised()
def make_add_texture_coordinates(uv2_alpha: bool, exact: bool) -> wp.Function:
    """Return `add_texture_coordinates`, extended by second coordinates and alpha if `uv2_alpha`.

    With exact shapes, `uv` has the weights of the vertices (see `make_surface_at`).
    """
    if exact:
        plain = make_add_texture_coordinates(uv2_alpha, False)

        @wp.func
        def by_weights(scene: SceneData, hit: Hit, surface: Surface) -> Surface:
            at = hit
            at.u = surface.uv[0]
            at.v = surface.uv[1]
            return plain(scene, at, surface)

        return by_weights

    @wp.func
    def add(scene: SceneData, hit: Hit, surface: Surface) -> Surface:
        surface = add_texture_coordinates(scene, hit, surface)
        if scene.needs & NEEDS_MORE_COORDINATES != 0:
            i = scene.corners[hit.triangle]
            second = scene.uv2_alpha[i[0]] * (1.0 - hit.u - hit.v)
            second = second + scene.uv2_alpha[i[1]] * hit.u + scene.uv2_alpha[i[2]] * hit.v
            surface.second_uv = wp.vec2(second[0], second[1])
            surface.alpha = second[2]
        return surface

    return add if uv2_alpha else add_texture_coordinates


@wp.func
def uv_edges(scene: SceneData, hit: Hit) -> wp.mat22:
    """Return the changes of u and v along the triangle's edges e1 and e2, one row per edge."""
    i = scene.corners[hit.triangle]
    uv = scene.uvs[i[0]]
    a = scene.uvs[i[1]] - uv
    b = scene.uvs[i[2]] - uv
    return wp.mat22(a[0], a[1], b[0], b[1])


@wp.func
def tangent_of_mesh(scene: SceneData, hit: Hit) -> wp.vec4:
    """Return the interpolated tangent, relative to the triangle as in `SceneData.tangents`; 0 if there is none."""
    first = 3 * hit.triangle
    tangent = scene.tangents[first] * (1.0 - hit.u - hit.v)
    return tangent + scene.tangents[first + 1] * hit.u + scene.tangents[first + 2] * hit.v


@wp.func
def align_tangents(scene: SceneData, hit: Hit, surface: Surface) -> Surface:
    """Return the surface with its frame turned about the normal: s along increasing u, t as near as possible to v's.

    t = ±n × s: if the texture is mirrored as the viewer sees it, the frame is left-handed. If u and v do not span the
    triangle, the frame stays unchanged. Tangents of the mesh replace the directions of u and v.
    """
    if scene.aligns_tangents == 0:
        return surface
    e1 = surface.e1
    e2 = surface.e2
    along_u = wp.vec3()
    along_v = wp.vec3()
    tangent = wp.vec4()
    if scene.aligns_tangents == 2:
        tangent = tangent_of_mesh(scene, hit)
    if tangent[3] != 0.0:
        normal = triangle_normal(e1, e2)
        front = wp.where(surface.front, surface.normal, -surface.normal)
        along_u = e1 * tangent[0] + e2 * tangent[1] + front * (tangent[2] * wp.sqrt(twice_area(e1, e2)))
        along_v = wp.cross(normal, along_u) * tangent[3]
    else:
        uv = uv_edges(scene, hit)
        a = uv[0]
        b = uv[1]
        forth = a[0] * b[1]
        back = a[1] * b[0]
        area = forth - back
        # Smaller values are rounding: the coordinates lie on a line, or in one point.
        if wp.abs(area) <= 1.0e-6 * (wp.abs(forth) + wp.abs(back)):
            return surface
        # ∂p/∂u and ∂p/∂v up to the factor 1 / |area|.
        sign = wp.sign(area)
        along_u = (e1 * b[1] - e2 * a[1]) * sign
        along_v = (e2 * a[0] - e1 * b[0]) * sign
    along_u = wp.normalize(along_u)
    n = surface.frame.n
    s = along_u - n * wp.dot(n, along_u)
    if wp.length_sq(s) <= 1.0e-8:
        return surface
    s = wp.normalize(s)
    t = wp.cross(n, s)
    if wp.dot(t, along_v) < 0.0:
        t = -t
    surface.frame.s = s
    surface.frame.t = t
    return surface
