"""The scene on the device: flat arrays, which are not edited after the upload."""

import warp as wp

from wrt.kernels.core.ray_tree import Bvh, InstanceTree

# Wrapping of an image beyond its edges.
WRAP_REPEAT = wp.constant(0)
WRAP_MIRROR = wp.constant(1)
WRAP_CLAMP = wp.constant(2)

# The component of the mesh's vertex colours that multiplies a value.
VERTEX_COLOR_NONE = wp.constant(0)
VERTEX_COLOR = wp.constant(1)
VERTEX_ALPHA = wp.constant(2)

# `ColorSlot.image` of a procedural texture whose values begin in slot 0; of others it is as many lower.
FIRST_PROCEDURE = wp.constant(-2)

# Kinds of materials: a reflection model, or one of two other materials by weight or by side.
MATERIAL_MODEL = wp.constant(0)
MATERIAL_MIX = wp.constant(1)
MATERIAL_SIDES = wp.constant(2)

# Lookups in a normal map: the normal at the point; or mean and variance over the footprint, with the variance along the
# axes of the slopes, or along those of the texture for anisotropic materials.
NORMALS_AT_POINT = wp.constant(0)
NORMALS_FILTERED = wp.constant(1)
NORMALS_FILTERED_ALONG_TEXTURE = wp.constant(2)

# Kinds of lights in `lights`.
LIGHT_TRIANGLE = wp.constant(0)
LIGHT_POINT = wp.constant(1)
LIGHT_DIRECTIONAL = wp.constant(2)
LIGHT_ENVIRONMENT = wp.constant(3)
FIRST_LIGHT_SHAPE = wp.constant(4)  # see kernels/lights/shapes.py


@wp.struct
class MaterialRecord:
    """A reflection model's number (see `kernels.bsdf`) and the start of its values; or a combination of two materials.

    If `kind` is MATERIAL_MIX, `first` and `second` are materials and the first value is the weight of the second; if
    it is MATERIAL_SIDES, they are the materials of the front and the back.
    """

    kind: int
    model: int
    first_slot: int
    opacity_slot: int  # -1 if opaque
    first: int
    second: int
    table: int  # start of the model's table in `tables`
    normal_map: int  # -1 for the mesh's own normal
    normal_filter: int
    matt: int
    coat_normal_map: int  # -1 where a coat has the normals of its base


@wp.struct
class ColorSlot:
    """A colour, optionally multiplied by an image and by the vertex colour.

    `channel` is -1, or the image's channel used for all three. With a `cutoff` ≥ 0 the result is 1 if it reaches the
    cutoff, else 0. Second texture coordinates and VERTEX_ALPHA need Features.uv2_alpha. In place of the image may be a
    procedural texture, with the number of its model in `second`.
    """

    value: wp.vec3
    image: int  # -1 for none
    channel: int
    vertex_color: int
    cutoff: float
    second: int  # whether the image uses the second texture coordinates


@wp.struct
class ImageRecord:
    """The texels of an image, and the mapping from texture coordinates.

    Without a palette the texels begin at `first` in `texels`. With one they begin there in `texel_codes`, with a code
    for each channel in the three lowest bytes; `palettes` has 256 values for red, 256 for green and 256 for blue from
    `palette` on.

    The image at half its size, a quarter, and so on, is stored as `levels` further images from `next_level` on.
    (u, v, 1) times `to_u` and `to_v` are the coordinates in the image.
    """

    first: int
    palette: int  # -1 for none
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
    """A normal map, stored as images.

    `image` holds tangent-space normals, not of unit length. Level k of the pyramid is two images from `first_level` +
    2k on: mean slopes (x, y, 0), and the means of their products (xx, yy, xy).
    """

    image: int
    first_level: int
    levels: int  # 0 if it is never filtered
    heights: int  # whether the image holds heights instead
    convention: int  # a number of kernels/textures/normal_maps.py
    second: int  # whether it uses the second texture coordinates


@wp.struct
class ShapeRecord:
    """Properties shared by all triangles of a shape."""

    material: int
    first_triangle: int
    smooth: int  # whether its vertices have normals; if not, they are 0
    first_light: int  # light number of its first triangle; -1 if it does not emit
    emission: wp.vec3
    emission_slot: int  # -1 if `emission` is constant
    two_sided: int
    single_sided: int  # see `kernels/integrators/sides.py`
    unlit: int
    edges: int  # whether lines are drawn on it
    body: int  # the body that it bounds; −1 for none
    catches_shadows: int


MOST_BODIES = 8
"""The greatest number of bodies that a path can be in at once."""

BodyStack = wp.types.vector(length=MOST_BODIES, dtype=int)
"""The bodies that contain a point, in the order in which they were entered: their numbers + 1, then zeros."""


@wp.struct
class BodyRecord:
    """The interior of a closed surface.

    `medium` is −1 if it is clear; `ior` is 0 if light is not refracted on entry. `spread` is what the index of each
    channel differs from it by.
    """

    medium: int
    priority: int
    ior: float
    exterior_ior: float
    spread: wp.vec3


@wp.struct
class MediumRecord:
    """A medium, per metre; `g` is the mean cosine of the scattering angle.

    If `grid` is not −1, the coefficients are those where the density is 1, and tentative collisions where the majorant
    is 1 have the coefficient `tracking`. It is at least the extinction of every channel.
    """

    absorption: wp.vec3
    scattering: wp.vec3
    emission: wp.vec3
    g: float
    grid: int
    tracking: float


@wp.struct
class Lattice:
    """Values at the centres of the cells into which the unit cube is divided, in an array from `first` on, x fastest.

    `nx` is 0 if there are none.
    """

    first: int
    nx: int
    ny: int
    nz: int


@wp.struct
class GridRecord:
    """Values that vary in a box: density, albedo, and a factor on the emission.

    (x, y, z, 1) times `to_unit_x` and so on is the place in the unit cube that stands for the box.
    """

    to_unit_x: wp.vec4
    to_unit_y: wp.vec4
    to_unit_z: wp.vec4
    density: Lattice  # in `grid_values`
    majorants: Lattice  # in `grid_values`: the greatest density within each of their cells
    minorants: Lattice  # in `grid_values`: the least within the same cells
    albedo: Lattice  # in `grid_colors`
    emission: Lattice  # in `grid_colors`


@wp.struct
class LightRecord:
    """One entry of the light table.

    `value` is radiance (triangle, rectangle, disk, sphere, sun), intensity (point, spot) or irradiance (directional);
    `place` is the position of a point or spot light, and the direction from which directional light arrives. For a
    triangle of varying emission, `value` is the mean.
    """

    kind: int
    triangle: int
    instance: int  # of the triangle, in scenes with instances
    shape: int  # index in `shapes` of a triangle; in `light_shapes` of a spot, rectangle, disk, sphere or sun
    place: wp.vec3
    value: wp.vec3
    two_sided: int
    probability: float


@wp.struct
class LightShape:
    """The position and size of a light without triangles.

    Rectangle: a corner, two unit axes, x × y = normal, and its width and height. Disk and sphere: the centre, the
    normal, and the radius twice. Sun: `normal` points to it; 1 − cos and sin² of its angular radius. Spot: `normal`
    is its axis; cosines of the inner and of the outer cone; with a texture, `x` and `y` to the right and up. Projector:
    the same three axes, and half the frame's width and height at unit distance. Models from outside define their own
    use of the fields.
    """

    kind: int
    light: int  # index in `lights`
    place: wp.vec3
    x: wp.vec3
    y: wp.vec3
    normal: wp.vec3
    size: wp.vec2
    falloff: int
    slot: int  # of its texture in `slots`; -1 without one


@wp.struct
class LightBox:
    """A box around a light that rays can hit, or around a subtree of such boxes (`kernels/native/light_boxes.h`)."""

    middle: wp.vec3
    half: wp.vec3
    behind: int  # place of the first box that is not within this one
    shape: int  # index in `light_shapes`; -1 for a subtree


@wp.struct
class LightTree:
    """The tree in the layout of `wrt.upload.lights.tree.LightTree`, with at least one node.

    `far` is the irradiance of all lights at infinity; `scale` converts the importance of the root's children to an
    irradiance.
    """

    nodes: wp.array(dtype=float)
    parents: wp.array(dtype=int)
    places: wp.array(dtype=int)
    scale: float
    far: float


@wp.struct
class EnvironmentData:
    """A constant radiance, or a latitude-longitude image with its sampling tables."""

    radiance: wp.vec3
    texels: wp.array(dtype=wp.vec3)
    width: int
    height: int
    rotation: wp.mat33  # from world to image
    cells: wp.array(
        dtype=wp.uint16
    )  # tiles of cells (kernels/sampling/piecewise.py), one for each normal and one for none
    bins: wp.array(dtype=wp.uint16)  # tile of each cell
    side: int  # bins along the side of a cell
    light: int  # index in `lights`; -1 if it is not sampled


NEEDS_COORDINATES = wp.constant(1)
"""Some material reads texture coordinates or vertex colours."""
NEEDS_MORE_COORDINATES = wp.constant(2)
"""Some material reads second texture coordinates or the alpha of vertex colours."""
NEEDS_LEVELS = wp.constant(4)
"""Some image has mip levels."""
NEEDS_SIDES = wp.constant(8)
"""Some shape is single-sided or unlit."""
NEEDS_ATTENUATION = wp.constant(16)
"""Some surface lets a part of the light pass."""
NEEDS_EXACT = wp.constant(32)
"""Some shape is exact."""
NEEDS_BODIES = wp.constant(64)
"""Some body contains a medium or has a priority."""


@wp.struct
class SceneData:
    """All data of a scene that a path needs."""

    # Geometry, in world space; with `placed`, in the spaces of the meshes, one mesh after the other
    bvh: Bvh
    placed: InstanceTree
    points: wp.array(dtype=wp.vec3)
    indices: wp.array(dtype=int)
    corners: wp.array(dtype=wp.vec3i)  # the three vertices of a triangle: the same memory as above, for a single load
    normals: wp.array(dtype=wp.vec3)
    uvs: wp.array(dtype=wp.vec2)
    colors: wp.array(dtype=wp.vec3)
    needs: int  # sum of NEEDS_...; a kernel of other scenes skips what this one does not need
    aligns_tangents: int  # 1 if any material depends on the direction of texture coordinates, 2 if meshes have tangents
    tangents: wp.array(dtype=wp.vec4)  # three a triangle (`wrt.scene.tangents.tangents_by_edges`)
    uv2_alpha: wp.array(dtype=wp.vec3)  # second texture coordinates, alpha of colours; if Features.uv2_alpha
    triangle_shape: wp.array(dtype=int)
    edges: wp.array(dtype=int)  # sides of triangles that are drawn (`kernels/integrators/edges.py`); if Features.edges
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
    # Interiors: of bodies, of the space around them, and at the camera
    bodies: wp.array(dtype=BodyRecord)
    media: wp.array(dtype=MediumRecord)
    grids: wp.array(dtype=GridRecord)
    grid_values: wp.array(dtype=float)
    grid_colors: wp.array(dtype=wp.vec3)
    medium: int
    inside_at_camera: BodyStack
    # Lights
    lights: wp.array(dtype=LightRecord)
    light_thresholds: wp.array(dtype=float)
    light_aliases: wp.array(dtype=int)
    light_tree: LightTree  # if Features.light_tree; the table above then has the lights at infinity
    light_shapes: wp.array(dtype=LightShape)  # the ones that rays can hit, suns, spots
    light_boxes: wp.array(dtype=LightBox)  # around the ones that rays can hit, in depth-first order
    solid_light_shapes: int
    sun_light_shapes: int  # index of the first one after the suns
    light_groups: wp.array(dtype=int)  # of what is no light of the table, of each light there, and of the environment
    environment: EnvironmentData
