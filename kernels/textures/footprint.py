"""Footprints of ray cones in textures."""

import warp as wp

from wrt.kernels.core.ray_tree import Hit
from wrt.kernels.core.scene_data import ImageRecord, SceneData
from wrt.kernels.geometry.surface import Surface, uv_edges
from wrt.kernels.geometry.triangles import edge_scale


@wp.func
def texture_footprint(scene: SceneData, hit: Hit, surface: Surface, direction: wp.vec3, width: float) -> wp.vec4:
    """Return the footprint of a ray cone, `width` wide at the hit, in texture coordinates.

    The cone (Akenine-Möller et al. 2021, "Improved shader and texture level of detail using ray cones") cuts the
    surface in an ellipse, longer by 1 / cosθ along the tilt. Its image in the texture has the matrix

        K = width² (∇a·∇b + (∇a·d)(∇b·d) / cos²θ)   for a, b of u, v,   det K = |∇u × ∇v|² width⁴ / cos²θ.

    The result is K's uu, vv and uv, and the root of its determinant, which these cannot give precisely if the ellipse
    is long.
    """
    scale = edge_scale(surface.e1, surface.e2)
    e1 = surface.e1 * scale
    e2 = surface.e2 * scale
    across = width * scale
    uv = uv_edges(scene, hit)
    a = uv[0]
    b = uv[1]
    c = wp.cross(e1, e2)
    c = c / wp.max(wp.length_sq(c), 1.0e-36)
    r1 = wp.cross(e2, c) * across
    r2 = wp.cross(c, e1) * across
    du = r1 * a[0] + r2 * b[0]
    dv = r1 * a[1] + r2 * b[1]
    cos = wp.max(wp.abs(wp.dot(surface.normal, direction)), 1.0e-3)
    u_depth = wp.dot(du, direction) / cos
    v_depth = wp.dot(dv, direction) / cos
    return wp.vec4(
        wp.length_sq(du) + u_depth * u_depth,
        wp.length_sq(dv) + v_depth * v_depth,
        wp.dot(du, dv) + u_depth * v_depth,
        wp.length(wp.cross(du, dv)) / cos,
    )


@wp.func
def sample_footprint(
    scene: SceneData, hit: Hit, surface: Surface, direction: wp.vec3, width: float, index: wp.uint32
) -> wp.vec4:
    """Return the texture footprint of a pixel's sample with this index, where the pixel is `width` wide.

    It is the whole pixel for the first sample, and shrinks from then on: earlier samples have found the mean, and
    narrower ones are sharper. So pictures of textures converge to those without mip levels. The area shrinks by the
    root of the index: its mean over n samples is 2/√n, so the blur vanishes, while the first samples stay free of
    noise. (An area proportional to 1/n, the least that makes sense, gained little from 16 samples on.)
    """
    return texture_footprint(scene, hit, surface, direction, width / wp.sqrt(wp.sqrt(float(index) + 1.0)))


@wp.func
def texels_across(footprint: wp.vec4, image: ImageRecord) -> float:
    """Return the number of texels that a footprint covers along its narrower axis.

    A texture must not be blurred over more than the pixel, and the pixel's samples average along the wider axis.
    """
    w = float(image.width)
    h = float(image.height)
    a = image.to_u
    b = image.to_v
    uu = a[0] * a[0] * footprint[0] + a[1] * a[1] * footprint[1] + 2.0 * a[0] * a[1] * footprint[2]
    vv = b[0] * b[0] * footprint[0] + b[1] * b[1] * footprint[1] + 2.0 * b[0] * b[1] * footprint[2]
    trace = w * w * uu + h * h * vv
    root = w * h * wp.abs(a[0] * b[1] - a[1] * b[0]) * footprint[3]
    larger = 0.5 * (trace + wp.sqrt(wp.max(trace * trace - 4.0 * root * root, 0.0)))
    return root / wp.sqrt(wp.max(larger, 1.0e-30))
