"""The surface at a hit: position, normals, and what is interpolated over the triangle."""

import warp as wp

from wrt.kernels.bvh import Hit
from wrt.kernels.geometry import Frame, Ray, make_frame
from wrt.kernels.scene_data import SceneData


@wp.struct
class Surface:
    """A point on a triangle, seen along a ray.

    `normal` (geometric) and `frame.n` (shading) face the viewer; `front` tells whether the viewer
    is on the triangle's front, where its corners run counter-clockwise. `normal_variance` is what a filtered
    normal map leaves to the roughness (see `Bsdf`).
    """

    position: wp.vec3
    normal: wp.vec3
    frame: Frame
    front: bool
    shape: int
    uv: wp.vec2
    color: wp.vec3
    normal_variance: wp.vec2


@wp.func
def surface_at(scene: SceneData, ray: Ray, hit: Hit) -> Surface:
    """Return the surface that `ray` meets at `hit`."""
    i0 = scene.indices[3 * hit.triangle]
    i1 = scene.indices[3 * hit.triangle + 1]
    i2 = scene.indices[3 * hit.triangle + 2]
    p0 = scene.points[i0]
    e1 = scene.points[i1] - p0
    e2 = scene.points[i2] - p0
    w0 = 1.0 - hit.u - hit.v

    surface = Surface()
    # Interpolated, not origin + t·direction: the error is then that of the triangle's own
    # coordinates, however far the ray came.
    surface.position = p0 + e1 * hit.u + e2 * hit.v
    surface.shape = scene.triangle_shape[hit.triangle]

    normal = wp.normalize(wp.cross(e1, e2))
    shading = scene.normals[i0] * w0 + scene.normals[i1] * hit.u + scene.normals[i2] * hit.v
    # Flat shapes carry zero normals; file normals may point either way.
    if wp.dot(shading, normal) < 0.0:
        shading = -shading
    surface.front = wp.dot(normal, ray.direction) < 0.0
    if not surface.front:
        normal = -normal
        shading = -shading
    # An interpolated normal that faces away from the viewer has no meaning for a BSDF.
    if wp.dot(shading, ray.direction) >= 0.0:
        shading = normal
    surface.normal = normal
    surface.frame = make_frame(wp.normalize(shading))
    return surface


@wp.func
def add_texture_coordinates(scene: SceneData, hit: Hit, surface: Surface) -> Surface:
    """Return the surface with what only textured materials need."""
    i0 = scene.indices[3 * hit.triangle]
    i1 = scene.indices[3 * hit.triangle + 1]
    i2 = scene.indices[3 * hit.triangle + 2]
    w0 = 1.0 - hit.u - hit.v
    surface.uv = scene.uvs[i0] * w0 + scene.uvs[i1] * hit.u + scene.uvs[i2] * hit.v
    surface.color = scene.colors[i0] * w0 + scene.colors[i1] * hit.u + scene.colors[i2] * hit.v
    return surface


@wp.func
def align_tangents(scene: SceneData, hit: Hit, surface: Surface) -> Surface:
    """Return the surface with its frame turned about the normal: s along growing u, t as near as can be to growing v.

    t = ±n × s: where the texture lies mirrored on what the viewer sees, the frame is left-handed. Where u and v do not
    span the triangle the frame stays as it was.
    """
    i0 = scene.indices[3 * hit.triangle]
    i1 = scene.indices[3 * hit.triangle + 1]
    i2 = scene.indices[3 * hit.triangle + 2]
    e1 = scene.points[i1] - scene.points[i0]
    e2 = scene.points[i2] - scene.points[i0]
    a = scene.uvs[i1] - scene.uvs[i0]
    b = scene.uvs[i2] - scene.uvs[i0]
    forth = a[0] * b[1]
    back = a[1] * b[0]
    area = forth - back
    # Less is rounding: the coordinates lie on a line, or all in one place.
    if wp.abs(area) <= 1.0e-6 * (wp.abs(forth) + wp.abs(back)):
        return surface
    # ∂p/∂u and ∂p/∂v but for the factor 1 / |area|.
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
