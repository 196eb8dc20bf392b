"""Normal maps: the shading normal from a texture, and the variance of normals within a pixel."""

import warp as wp

from wrt.kernels.core.ray_tree import Hit
from wrt.kernels.core.rays import Frame, to_local, to_world
from wrt.kernels.core.scene_data import (
    NORMALS_AT_POINT,
    NORMALS_FILTERED,
    ImageRecord,
    MaterialRecord,
    NormalMapRecord,
    SceneData,
)
from wrt.kernels.geometry.surface import Surface, uv_edges
from wrt.kernels.textures.footprint import texels_across, texture_footprint
from wrt.kernels.textures.textures import image_color, image_gradient

LEAST_ELEVATION = wp.constant(0.02)
"""Sine of the least elevation of the mirror direction over the surface, and of the viewer over the mapped surface."""


# Numbers of `wrt.scene.textures.NORMAL_CONVENTIONS`; the third is right-handed.
CONVENTION_GLTF = wp.constant(0)
CONVENTION_MITSUBA = wp.constant(1)


@wp.struct
class Slopes:
    """Slopes nx / nz and ny / nz in a piece of a normal map: their means, and those of their products (xx, yy, xy)."""

    mean: wp.vec2
    products: wp.vec3


@wp.func
def slopes_at(scene: SceneData, image: ImageRecord, uv: wp.vec2) -> Slopes:
    """Return the slopes at one point."""
    n = image_color(scene, image, uv)
    slopes = Slopes()
    slopes.mean = wp.vec2(n[0] / n[2], n[1] / n[2])
    slopes.products = wp.vec3(
        slopes.mean[0] * slopes.mean[0], slopes.mean[1] * slopes.mean[1], slopes.mean[0] * slopes.mean[1]
    )
    return slopes


@wp.func
def slopes_of_level(scene: SceneData, normals: NormalMapRecord, level: int, uv: wp.vec2) -> Slopes:
    """Return the slopes around a point at a level of the pyramid; level -1 is the point itself."""
    if level < 0:
        return slopes_at(scene, scene.images[normals.image], uv)
    first = normals.first_level + 2 * level
    mean = image_color(scene, scene.images[first], uv)
    slopes = Slopes()
    slopes.mean = wp.vec2(mean[0], mean[1])
    slopes.products = image_color(scene, scene.images[first + 1], uv)
    return slopes


@wp.func
def filtered_slopes(scene: SceneData, normals: NormalMapRecord, uv: wp.vec2, texels: float) -> Slopes:
    """Return the slopes of a piece `texels` wide, more than 1/2, interpolated between the two nearest levels."""
    level = wp.min(wp.log2(texels), float(normals.levels - 1))
    lower = int(wp.floor(level))
    share = level - float(lower)
    slopes = slopes_of_level(scene, normals, lower, uv)
    if share > 0.0:
        upper = slopes_of_level(scene, normals, lower + 1, uv)
        slopes.mean = slopes.mean * (1.0 - share) + upper.mean * share
        slopes.products = slopes.products * (1.0 - share) + upper.products * share
    return slopes


@wp.func
def slopes_of_heights(scene: SceneData, image: ImageRecord, hit: Hit, surface: Surface) -> wp.vec2:
    """Return the slopes nx / nz and ny / nz, in the frame, of a surface displaced by an image along its normal.

    With the frame's x along ∂p/∂u, the displaced tangents are (Ux, 0, h_u) and (Vx, Vy, h_v), and their cross product
    is along (−h_u / Ux, (h_u Vx / Ux − h_v) / Vy, 1) (Blinn 1978, "Simulation of wrinkled surfaces").
    """
    uv = uv_edges(scene, hit)
    a = uv[0]
    b = uv[1]
    area = a[0] * b[1] - a[1] * b[0]
    if area == 0.0:
        return wp.vec2(0.0)
    along_u = (surface.e1 * b[1] - surface.e2 * a[1]) / area
    along_v = (surface.e2 * a[0] - surface.e1 * b[0]) / area
    u_x = wp.dot(along_u, surface.frame.s)
    v_x = wp.dot(along_v, surface.frame.s)
    v_y = wp.dot(along_v, surface.frame.t)
    change = image_gradient(scene, image, surface.uv, wp.vec3(1.0, 0.0, 0.0))
    if scene.aligns_tangents == 2:  # the frame's x may be along a tangent of the mesh, and Uy not 0
        u_y = wp.dot(along_u, surface.frame.t)
        across = u_x * v_y - u_y * v_x
        if across == 0.0:
            return wp.vec2(0.0)
        return wp.vec2(change[1] * u_y - change[0] * v_y, change[0] * v_x - change[1] * u_x) / across
    if u_x == 0.0 or v_y == 0.0:
        return wp.vec2(0.0)
    return wp.vec2(-change[0] / u_x, (change[0] * v_x / u_x - change[1]) / v_y)


@wp.func
def flipped_normal(surface: Surface, slopes: wp.vec2, direction: wp.vec3) -> Surface:
    """Return a surface whose mapped normal faces the viewer in Mitsuba's way: else it is mirrored about the smooth one.

    Its s is along the projection of the old one, as in Mitsuba.
    """
    frame = surface.frame
    n = wp.normalize(wp.vec3(slopes[0], slopes[1], 1.0))
    if wp.dot(to_local(frame, direction), n) >= 0.0:
        n = wp.vec3(-n[0], -n[1], n[2])
    surface.smooth_normal = frame.n
    cos2 = n[2] * n[2]
    surface.bump_alpha2 = wp.min(0.125 * (1.0 - cos2) / cos2, 1.0)
    x = wp.normalize(wp.vec3(1.0 - n[0] * n[0], -n[0] * n[1], -n[0] * n[2]))
    turned = Frame()
    turned.s = to_world(frame, x)
    turned.t = to_world(frame, wp.cross(n, x))
    turned.n = to_world(frame, n)
    surface.frame = turned
    return surface


@wp.func
def bump_shadow(surface: Surface, direction: wp.vec3, side: float) -> float:
    """Return the share of light from a direction that bumps do not shadow, by G1 of GGX; 1 for surfaces without.

    Estevez, Lecocq and Stellpflug (2019), "A microfacet-based shadowing function to solve the bump terminator problem".
    Nothing arrives where the mapped normal, above which `side` is positive, and the smooth one disagree about the side.
    """
    if surface.bump_alpha2 == 0.0:
        return 1.0
    cosine = wp.dot(direction, surface.smooth_normal)
    if cosine * side <= 0.0:
        return 0.0
    cos2 = cosine * cosine
    return 2.0 / (1.0 + wp.sqrt(1.0 + surface.bump_alpha2 * wp.max(1.0 - cos2, 0.0) / cos2))


@wp.func
def bent_normal(n: wp.vec3, normal: wp.vec3, wo: wp.vec3, matt: bool) -> wp.vec3:
    """Return a shading normal n that faces wo and, if not matt, mirrors it to above the surface.

    Mapped normals that do not would give black spots, which real bumps do not show, as other bumps hide those sides.
    The normal is turned in the plane of n and the geometric normal, no further than necessary. (For other ways see
    Schüssler, Heitz, Hanika and Dachsbacher 2017, section 2.)

    With n at the angle θ from the geometric normal, and wo at φ and of length a in their plane, n·wo is a cos(θ − φ),
    and the mirror direction is a cos(2θ − φ) above the surface. If that is too small, θ or 2θ becomes
    φ + arccos(least / a), which lies nearer to the geometric normal.
    """
    wo_z = wp.dot(wo, normal)
    n_z = wp.dot(n, normal)
    least = wp.min(LEAST_ELEVATION, 0.5 * wo_z)
    facing = wp.dot(n, wo)
    if facing >= least and (matt or (2.0 * facing * n_z - wo_z >= least and n_z > 0.0)):
        return n
    across = n - normal * n_z
    length = wp.length(across)
    if length < 1.0e-6:
        return normal
    across = across / length
    across = wp.normalize(across - normal * wp.dot(across, normal))  # short vectors are mostly rounding error
    wo_x = wp.dot(wo, across)
    phi = wp.atan2(wo_x, wo_z)
    theta = phi + wp.acos(wp.clamp(least / wp.sqrt(wo_x * wo_x + wo_z * wo_z), 0.0, 1.0))
    theta *= wp.where(matt, 1.0, 0.5)
    return wp.normalize(across * wp.sin(theta) + normal * wp.cos(theta))


@wp.func
def _quadratic(a: wp.vec2, xx: float, yy: float, xy: float) -> float:
    """Return the variance of a·slope."""
    return a[0] * a[0] * xx + a[1] * a[1] * yy + 2.0 * a[0] * a[1] * xy


@wp.func
def apply_normal_map(
    scene: SceneData, material: int, hit: Hit, surface: Surface, direction: wp.vec3, width: float
) -> Surface:
    """Return the surface with a material's normal map applied for a ray cone, `width` wide at the hit.

    Its frame must follow the texture coordinates. A width of 0 stands for a single ray.
    """
    return normal_mapped(scene, scene.materials[material], hit, surface, direction, width)


@wp.func
def normal_mapped(
    scene: SceneData, record: MaterialRecord, hit: Hit, surface: Surface, direction: wp.vec3, width: float
) -> Surface:
    """Return what `apply_normal_map` does for the record of a material."""
    if record.normal_map < 0:
        return surface
    normals = scene.normal_maps[record.normal_map]
    image = scene.images[normals.image]
    texels = float(0.0)
    if record.normal_filter != NORMALS_AT_POINT:
        texels = texels_across(texture_footprint(scene, hit, surface, direction, width), image)
    filtered = texels > 0.5
    slopes = Slopes()
    if normals.heights != 0:
        slopes.mean = slopes_of_heights(scene, image, hit, surface)
    elif filtered:
        slopes = filtered_slopes(scene, normals, surface.uv, texels)
    else:
        slopes = slopes_at(scene, image, surface.uv)
    mean = slopes.mean
    if mean[0] == 0.0 and mean[1] == 0.0 and not filtered:
        return surface
    if not surface.front:
        mean = -mean  # a bump is a dent from behind
    if normals.convention != CONVENTION_GLTF and normals.heights == 0:
        right = wp.dot(wp.cross(surface.frame.n, surface.frame.s), surface.frame.t) > 0.0
        if right != surface.front:
            mean = wp.vec2(mean[0], -mean[1])
    if normals.convention == CONVENTION_MITSUBA:
        return flipped_normal(surface, mean, direction)
    unbent = wp.normalize(wp.vec3(mean[0], mean[1], 1.0))
    frame = surface.frame
    n = bent_normal(to_world(frame, unbent), surface.normal, -direction, record.matt != 0)
    if wp.dot(n, direction) >= 0.0:
        return surface
    # The new axes in those of the old frame.
    z = to_local(frame, n)
    x = wp.normalize(wp.vec3(1.0 - z[0] * z[0], -z[0] * z[1], -z[0] * z[2]))
    y = wp.cross(z, x)
    if filtered:
        # From slopes of the map to slopes about the new normal, (m·x) / (m·n): ∂/∂slope is x / |(mean, 1)| at the mean.
        k = unbent[2]
        a = wp.vec2(x[0], x[1]) * k
        b = wp.vec2(y[0], y[1]) * k
        xx = wp.max(slopes.products[0] - mean[0] * mean[0], 0.0)
        yy = wp.max(slopes.products[1] - mean[1] * mean[1], 0.0)
        xy = slopes.products[2] - mean[0] * mean[1]
        variance = wp.vec2(_quadratic(a, xx, yy, xy), _quadratic(b, xx, yy, xy))
        if record.normal_filter == NORMALS_FILTERED:
            # Rotate to the eigenvectors of the covariance.
            covariance = a[0] * b[0] * xx + a[1] * b[1] * yy + (a[0] * b[1] + a[1] * b[0]) * xy
            middle = 0.5 * (variance[0] + variance[1])
            half = 0.5 * (variance[0] - variance[1])
            radius = wp.sqrt(half * half + covariance * covariance)
            turn = 0.5 * wp.atan2(covariance, half)
            along = x * wp.cos(turn) + y * wp.sin(turn)
            y = y * wp.cos(turn) - x * wp.sin(turn)
            x = along
            variance = wp.vec2(middle + radius, middle - radius)
        surface.normal_variance = wp.vec2(wp.max(variance[0], 0.0), wp.max(variance[1], 0.0))
    turned = Frame()
    turned.s = to_world(frame, x)
    turned.t = to_world(frame, y)
    turned.n = n
    surface.frame = turned
    return surface


@wp.func
def normals_of_layers(scene: SceneData, material: int, hit: Hit, surface: Surface, direction: wp.vec3) -> wp.vec4:
    """Return x and y, in the surface's frame, of the normal of a coat and of that of its base.

    Both are bent until they face the viewer and mirror to above the frame's plane, the horizon of both layers.
    """
    at = surface
    at.normal = surface.frame.n
    record = scene.materials[material]
    base = to_local(surface.frame, normal_mapped(scene, record, hit, at, direction, 0.0).frame.n)
    record.normal_map = record.coat_normal_map
    if scene.normal_maps[record.coat_normal_map].second != 0:
        at.uv = surface.second_uv
    coat = to_local(surface.frame, normal_mapped(scene, record, hit, at, direction, 0.0).frame.n)
    return wp.vec4(coat[0], coat[1], base[0], base[1])
