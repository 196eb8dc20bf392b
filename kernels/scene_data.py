"""The scene as the device sees it: flat arrays, never edited once uploaded."""

import warp as wp

from wrt.kernels.bvh import Bvh
from wrt.kernels.instances import InstanceTree
from wrt.kernels.light_tree import LightTree

# How an image goes on beyond its edges.
WRAP_REPEAT = wp.constant(0)
WRAP_MIRROR = wp.constant(1)
WRAP_CLAMP = wp.constant(2)

# What of the mesh's own colours multiplies a value.
VERTEX_COLOR_NONE = wp.constant(0)
VERTEX_COLOR = wp.constant(1)
VERTEX_ALPHA = wp.constant(2)

# What a material is: a reflection model, or one of two others by share or by side.
MATERIAL_MODEL = wp.constant(0)
MATERIAL_MIX = wp.constant(1)
MATERIAL_SIDES = wp.constant(2)

# What of a material's normal map is read: the normal at the point; or where the pixel covers more, the mean and the
# variance, the latter along its own axes, or along the texture's for materials that have axes themselves.
NORMALS_AT_POINT = wp.constant(0)
NORMALS_FILTERED = wp.constant(1)
NORMALS_FILTERED_ALONG_TEXTURE = wp.constant(2)

# Which kind of light an entry of `lights` is.
LIGHT_TRIANGLE = wp.constant(0)
LIGHT_POINT = wp.constant(1)
LIGHT_DIRECTIONAL = wp.constant(2)
LIGHT_ENVIRONMENT = wp.constant(3)
LIGHT_SPOT = wp.constant(4)
LIGHT_RECTANGLE = wp.constant(5)
LIGHT_DISK = wp.constant(6)
LIGHT_SPHERE = wp.constant(7)
LIGHT_SUN = wp.constant(8)

# How a spot light fades from its inner to its outer cone; wrt/lights.py has the formulas.
FALLOFF_SMOOTH = wp.constant(0)
FALLOFF_LINEAR = wp.constant(1)
FALLOFF_GLTF = wp.constant(2)


@wp.struct
class MaterialRecord:
    """A reflection model's number (see `kernels.bsdf`) and where its values begin; or what is made of others.

    Where `kind` is MATERIAL_MIX, `first` and `second` are materials and the first value is the share of
    the second; where it is MATERIAL_SIDES they are the materials of the front and the back.
    """

    kind: int
    model: int
    first_slot: int
    opacity_slot: int  # -1 where it is opaque
    first: int
    second: int
    table: int  # where in `tables` the model's table begins
    normal_map: int  # -1 where the normal is the mesh's own
    normal_filter: int
    matt: int


@wp.struct
class ColorSlot:
    """A colour, and what multiplies it: an image, the vertex colour, both or neither.

    `channel` is -1, or the channel of the image that stands for all three. From a `cutoff` of 0 or more on, the
    result is 1 where it reaches the cutoff, and else 0. Second texture coordinates, and VERTEX_ALPHA, are there where
    Features.extras.
    """

    value: wp.vec3
    image: int  # -1 without
    channel: int
    vertex_color: int
    cutoff: float
    second: int  # whether the image is laid by the second texture coordinates


@wp.struct
class ImageRecord:
    """Where an image's texels lie, and how texture coordinates find them.

    Without a palette they begin at `first` of `texels`, else of `texel_codes`: a code for each channel in the three
    lowest bytes. Its value is in `palettes`, 256 for red, 256 for green and 256 for blue from `palette` on.

    The image at half its size, a quarter, and so on, is as many images as there are `levels`, from `next_level` on.
    (u, v, 1) times `to_u` and `to_v` are the coordinates in the image.
    """

    first: int
    palette: int  # -1 without
    width: int
    height: int
    wrap_u: int
    wrap_v: int
    nearest: int
    to_u: wp.vec3
    to_v: wp.vec3
    levels: int
    next_level: int


@wp.struct
class NormalMapRecord:
    """A normal map among the images.

    `image` holds normals in tangent space, not of unit length. Level k of the pyramid is two images from
    `first_level` + 2k on: mean slopes (x, y, 0), and means of their products (xx, yy, xy).
    """

    image: int
    first_level: int
    levels: int  # 0 where it is never filtered


@wp.struct
class ShapeRecord:
    """What all triangles of one shape share."""

    material: int
    first_triangle: int
    smooth: int  # whether its vertices have normals; those of others are 0
    first_light: int  # light number of its first triangle; -1 where it does not emit
    emission: wp.vec3
    emission_slot: int  # -1 where `emission` is the same everywhere
    two_sided: int
    body: int  # that it bounds; −1 where it bounds none


MOST_BODIES = 8
"""In how many bodies at once a path can be."""

BodyStack = wp.types.vector(length=MOST_BODIES, dtype=int)
"""The bodies that a point is in, in the order in which they were entered: their numbers + 1, then zeros."""


@wp.struct
class BodyRecord:
    """What a closed surface has inside.

    `medium` is −1 where it is clear; `ior` is 0 where light is not bent on the way in.
    """

    medium: int
    priority: int
    ior: float
    exterior_ior: float


@wp.struct
class MediumRecord:
    """A homogeneous medium, per metre; `g` is the mean cosine of scattering."""

    absorption: wp.vec3
    scattering: wp.vec3
    emission: wp.vec3
    g: float


@wp.struct
class LightRecord:
    """One entry of the light table.

    `value` is radiance (triangle, rectangle, disk, sphere, sun), intensity (point, spot) or irradiance (directional);
    `place` is the position of a point or spot light and the direction that directional light comes from. A triangle
    whose emission varies is told its mean.
    """

    kind: int
    triangle: int
    instance: int  # that the triangle belongs to, in scenes with instances
    shape: int  # number in `shapes` of a triangle; in `light_shapes` of a spot, rectangle, disk, sphere or sun
    place: wp.vec3
    value: wp.vec3
    two_sided: int
    probability: float


@wp.struct
class LightShape:
    """Where a light is that is no triangle, and how large.

    Rectangle: a corner, two unit axes, x × y = normal, and its width and height. Disk and sphere: the centre, the
    normal, and the radius twice. Sun: `normal` points to it; 1 − cos and sin² of its angular radius. Spot: `normal`
    is its axis; cosines of the inner and of the outer cone.
    """

    kind: int
    light: int  # number in `lights`
    place: wp.vec3
    x: wp.vec3
    y: wp.vec3
    normal: wp.vec3
    size: wp.vec2
    falloff: int


@wp.struct
class EnvironmentData:
    """A constant radiance, or an image in latitude-longitude layout with the tables that it is sampled by."""

    radiance: wp.vec3
    texels: wp.array(dtype=wp.vec3)
    width: int
    height: int
    rotation: wp.mat33  # from world to image
    cells: wp.array(dtype=wp.uint16)  # tiles of cells (kernels/piecewise.py), one for each normal and one for none
    bins: wp.array(dtype=wp.uint16)  # tile of each cell
    side: int  # bins along the side of a cell
    light: int  # number in `lights`; -1 where it is not sampled


@wp.struct
class SceneData:
    """Everything that a path needs to know of a scene."""

    # Geometry, in world space; with `placed`, in the space of the mesh, one mesh after the other
    bvh: Bvh
    placed: InstanceTree
    points: wp.array(dtype=wp.vec3)
    indices: wp.array(dtype=int)
    corners: wp.array(dtype=wp.vec3i)  # of a triangle, its vertices: the same memory, for one load
    normals: wp.array(dtype=wp.vec3)
    uvs: wp.array(dtype=wp.vec2)
    colors: wp.array(dtype=wp.vec3)
    extras: wp.array(dtype=wp.vec3)  # second texture coordinates and the alpha of colours, where Features.extras
    triangle_shape: wp.array(dtype=int)
    # Materials
    shapes: wp.array(dtype=ShapeRecord)
    materials: wp.array(dtype=MaterialRecord)
    slots: wp.array(dtype=ColorSlot)
    tables: wp.array(dtype=float)
    images: wp.array(dtype=ImageRecord)
    texels: wp.array(dtype=wp.vec3)
    texel_codes: wp.array(dtype=wp.uint32)
    palettes: wp.array(dtype=float)
    normal_maps: wp.array(dtype=NormalMapRecord)
    # What is inside: of bodies, where none is, and where the camera stands
    bodies: wp.array(dtype=BodyRecord)
    media: wp.array(dtype=MediumRecord)
    medium: int
    inside_at_camera: BodyStack
    # Lights
    lights: wp.array(dtype=LightRecord)
    light_thresholds: wp.array(dtype=float)
    light_aliases: wp.array(dtype=int)
    light_tree: LightTree  # where Features.light_tree; the table above then has the lights that are far away
    light_shapes: wp.array(dtype=LightShape)  # first those that rays can hit, then suns, then spots
    solid_light_shapes: int
    sun_light_shapes: int  # number of the first that is no sun
    environment: EnvironmentData
