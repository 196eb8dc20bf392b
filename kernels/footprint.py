"""What a cone of rays covers of a texture."""

import warp as wp

from wrt.kernels.bvh import Hit
from wrt.kernels.scene_data import ImageRecord, SceneData
from wrt.kernels.surface import Surface, uv_edges


@wp.func
def texture_footprint(scene: SceneData, hit: Hit, surface: Surface, direction: wp.vec3, width: float) -> wp.vec4:
    """Return what a cone of rays that is `width` wide at the hit covers, in texture coordinates.

    The cone (Akenine-Möller et al. 2021, "Improved shader and texture level of detail using ray cones") cuts the
    surface in an ellipse, as along the tilt it is longer by 1 / cosθ. Its image in the texture has the matrix

        K = width² (∇a·∇b + (∇a·d)(∇b·d) / cos²θ)   for a, b of u, v,   det K = |∇u × ∇v|² width⁴ / cos²θ.

    What is returned is K's uu, vv and uv, and the root of its determinant, which has no digits left in the others
    where the ellipse is long.
    """
    e1 = surface.e1
    e2 = surface.e2
    uv = uv_edges(scene, hit)
    a = uv[0]
    b = uv[1]
    c = wp.cross(e1, e2)
    c = c / wp.max(wp.length_sq(c), 1.0e-36)
    r1 = wp.cross(e2, c) * width
    r2 = wp.cross(c, e1) * width
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
    """Return what a pixel's sample with this index stands for in the texture, where the pixel is `width` wide.

    All of the pixel for the first sample, and ever less: samples that came before have found the means already, and
    what is narrower is sharper. So pictures of textures converge to those without levels. The area shrinks by the root
    of the index: its mean over n samples is 2/√n, and so the blur vanishes, while the noise of few samples is still
    spared. (In proportion to 1/n, the least that makes sense, little was gained from 16 samples on.)
    """
    return texture_footprint(scene, hit, surface, direction, width / wp.sqrt(wp.sqrt(float(index) + 1.0)))


@wp.func
def texels_across(footprint: wp.vec4, image: ImageRecord) -> float:
    """Return how many texels of an image a footprint covers along its narrower axis.

    The narrower axis, not the wider one: a texture must not be blurred over more than the pixel, and what lies along
    the wider one is averaged by the pixel's samples.
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
