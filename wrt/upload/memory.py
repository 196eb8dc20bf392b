"""Memory that a scene takes on a device, known before it is taken."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wrt.backend import current_backend
from wrt.scene.environment import ConstantEnvironment, ImageEnvironment
from wrt.scene.medium import Medium
from wrt.upload.accel.binary_tree import CHUNK, LARGEST, SUBTREE
from wrt.upload.accel.bvh import MORE_PIECES
from wrt.upload.accel.gpu_tree import MOST_BUILDERS
from wrt.upload.accel.instancing import Layout
from wrt.upload.grids import CELLS_PER_MAJORANT
from wrt.upload.lights.choice import FEW_LIGHTS
from wrt.upload.lights.environment import environment_kind
from wrt.upload.lights.environment_sampling import COLUMNS, ROWS, STEPS, finest_side
from wrt.upload.prepare import PreparedScene

TRIANGLES_IN_LEAF, LEAVES_IN_NODE = 7.2, 5.0
"""Means over trees, measured: 7.1 to 7.5 triangles of eight, and 4.9 to 5.2 leaves for each node."""

INSTANCES_IN_NODE = 6.0
"""Mean number of instances for each node of the tree over them, measured: 5.9 to 6.3 of a hundred and more."""

SUBTREE_SHARE = 0.7
"""Mean size of a subtree that one thread builds over the largest, measured."""

LIGHTS_IN_NODE = 4.5
"""Mean number of lights for each node of the light tree, measured: 4.0 to 4.8 for a thousand lights and more."""


class SceneMemory:
    """Bytes that the upload of a scene will take on a device, by part.

    Trees follow from the mean number of triangles in a leaf and are right within 4 %, all else within a few kilobytes.
    Tables of rough materials, under 1 MB, and the driver's memory are not counted.

    Attributes:
        geometry: vertices, triangles, and what belongs to them.
        trees: the ray trees.
        materials: materials, texels of images and normal maps, the environment with its tables, and grids of media.
        lights: light records, and what selects one.
        scratch: the most that building takes in addition; it is released afterwards.
        scratch_if_cut: the same if the builder cuts large triangles; it decides that from the finished tree.
        lasting: the built scene.
        editing: more that images take once values of the scene are changed.
        gradients: more that sums of derivatives take while they are made.
    """

    def __init__(self, prepared: PreparedScene, *, is_cpu: bool, texture_coordinates: bool = False) -> None:
        """Add up a scene; on the CPU builders of trees work in larger pieces. See `SceneUpload` for the option."""
        materials = prepared.materials
        textured = materials.textured or materials.tangents or texture_coordinates
        self.trees, most, most_if_cut = tree_memory(prepared.layout, is_cpu=is_cpu)
        self.scratch, self.scratch_if_cut = most - self.trees, most_if_cut - self.trees
        self.geometry = _geometry(
            prepared.layout, textured=textured, uv2_alpha=materials.uv2_alpha, tangents=prepared.has_tangents
        )
        self.materials = materials.bytes + _environment(prepared.environment) + _grids(prepared.scene.media)
        self.lights = _lights(prepared)
        self.lasting = self.geometry + self.trees + self.materials + self.lights
        self.editing = 12 * materials.editable_texels
        pixels = getattr(prepared.environment, "pixels", np.zeros((0, 0, 3)))
        values = materials.editable_texels + pixels.size // 3 + len(prepared.scene.shapes) + _light_count(prepared)
        self.gradients = 3 * 8 * values


def _geometry(layout: Layout, *, textured: bool, uv2_alpha: bool, tangents: bool) -> int:
    keys = [key for shared in layout.shared for key in shared.keys]
    vertices = sum(len(mesh.vertices) for mesh in (*layout.world_meshes, *keys))
    triangles = sum(len(mesh.faces) for mesh in (*layout.world_meshes, *(s.keys[0] for s in layout.shared)))
    shapes = len(layout.world_shapes) + len(layout.instances)
    of_vertex = 24 + 20 * textured + 12 * uv2_alpha  # points, normals; coordinates, colours; a second set
    of_triangle = 16 + 48 * tangents
    return of_vertex * vertices + of_triangle * triangles + shapes * _size("wrt.kernels.core.scene_data", "ShapeRecord")


class _Builder(NamedTuple):
    """Sizes in bytes of what the builder of trees handles; `bins` are those of a node."""

    node: int
    leaf: int
    binary_node: int
    bins: int
    is_cpu: bool

    def tree(self, triangles: int) -> int:
        """Return the bytes of a tree."""
        leaves = max(1, round(triangles / TRIANGLES_IN_LEAF))
        return leaves * self.leaf + max(1, round(leaves / LEAVES_IN_NODE)) * self.node

    def scratch(self, boxes: int) -> int:
        """Return the bytes that building a binary tree over boxes takes at once."""
        return self._scratch_on_cpu(boxes) if self.is_cpu else self._scratch_on_gpu(boxes)

    def _scratch_on_cpu(self, boxes: int) -> int:
        # A box and a number; for each of two nodes the node, its centres, its parent and whether a move touches it.
        each = 32 + 2 * (self.binary_node + 32 + 4 + 4)
        subtrees = math.ceil(boxes / min(boxes, SUBTREE_SHARE * SUBTREE))
        chunks = 2 * math.ceil(boxes / CHUNK)  # those of the first level and of the last are both there
        return each * boxes + self.bins * subtrees + (self.bins + 2 * 32 + 5 * 4) * chunks

    def _scratch_on_gpu(self, boxes: int) -> int:
        levels = current_backend().kernels("wrt.kernels.accel.build.levels")
        # Of each box, and of two nodes the node and its costs; then either what splitting or what moving takes.
        each = 32 + 2 * (self.binary_node + 32)
        nodes = boxes // (levels.SUBTREE + 1) + 1
        chunks = boxes // levels.CHUNK + nodes
        builders = min(math.ceil(2 * boxes / levels.SUBTREE), MOST_BUILDERS)
        roots, sorted_boxes = 4, 32 * (boxes > levels.SUBTREE)
        splitting = (roots + sorted_boxes) * boxes + self.bins * (nodes + chunks + builders) + 12 * chunks
        # Of each node its parent, whether it was visited, two locks, whether a move touches it, keys and numbers.
        moving = 2 * (4 + 4 + 2 * 8 + 4 + 2 * (4 + 4)) * boxes + 4 * 4 * min(LARGEST, 2 * boxes)
        scratch: int = each * boxes + max(splitting, moving)
        return scratch

    def scratch_if_cut(self, triangles: int) -> int:
        """Return the bytes that building takes if a second tree over cut triangles is built beside the first."""
        first = 32 + 2 * self.binary_node + 4  # a box, two nodes, the number of pieces
        wide = self.tree(triangles) // 8 if self.is_cpu else 4 * (8 + 2) * triangles
        return first * triangles + wide + self.scratch(round((1.0 + MORE_PIECES) * triangles))


def tree_memory(layout: Layout, *, is_cpu: bool) -> tuple[int, int, int]:
    """Return the bytes of a scene's trees, and the most that they and their builder take at once.

    The last number is the same if the builder cuts large triangles.
    """
    constants = current_backend().kernels("wrt.kernels.native.constants")
    binary_node = _size("wrt.kernels.accel.build.split", "BinaryNode")
    bins = 3 * constants.BINS * (32 + 4)
    builder = _Builder(4 * constants.NODE_FLOATS, 4 * constants.LEAF_FLOATS, binary_node, bins, is_cpu)
    lasting = most = most_if_cut = 0
    world = sum(len(mesh.faces) for mesh in layout.world_meshes)
    shared = [(len(mesh.keys[0].faces), len(mesh.keys)) for mesh in layout.shared]
    for triangles, keys in ([(world, 1)] if world else []) + shared:
        before = lasting + 12 * triangles * bool(layout.shared)
        most = max(most, before + builder.scratch(triangles))
        most_if_cut = max(most_if_cut, before + builder.scratch_if_cut(triangles))
        lasting += keys * builder.tree(triangles)
        most = max(most, lasting + (builder.tree(triangles) if keys > 1 else 0))  # a tree, and its copies for each key
    if layout.instances:
        count = len(layout.instances) + bool(world)
        lasting += count * _size("wrt.kernels.core.ray_tree", "InstanceRecord")
        lasting += builder.node * math.ceil(count / INSTANCES_IN_NODE)
    return lasting, max(most, lasting), max(most_if_cut, most, lasting)


def _environment(environment: ConstantEnvironment | ImageEnvironment | None) -> int:
    if environment_kind(environment) != "image" or not isinstance(environment, ImageEnvironment):
        return 0
    height, width = map(int, environment.pixels.shape[:2])
    side = finest_side((height, width))  # the table of bins may be coarser
    normals, cells = (STEPS + 1) ** 2 + 1, ROWS * COLUMNS
    return 12 * height * width + 2 * normals * (ROWS + cells) + 2 * cells * (side + side * side)


def _grids(media: Sequence[Medium]) -> int:
    grids = {id(medium.density): medium.density for medium in media if medium.density is not None}
    size: int = 0
    for grid in grids.values():
        blocks = math.prod(-(-int(cells) // CELLS_PER_MAJORANT) for cells in grid.values.shape)
        size += 4 * (int(grid.values.size) + 2 * blocks)
        colors = [each for each in (grid.albedo, grid.emission) if each is not None]
        size += sum(12 * math.prod(map(int, each.shape[:3])) for each in colors)
    return size


def _light_count(prepared: PreparedScene) -> int:
    of_triangles = sum(len(shape.mesh.faces) for shape in prepared.scene.shapes if shape.emits)
    return of_triangles + len(prepared.lights) + (environment_kind(prepared.environment) == "image")


def _lights(prepared: PreparedScene) -> int:
    count = _light_count(prepared)
    near = count - sum(light.extent().corners is None for light in prepared.lights)
    near -= environment_kind(prepared.environment) == "image"
    has_tree = near > FEW_LIGHTS
    size = count * _size("wrt.kernels.core.scene_data", "LightRecord")
    if not has_tree or count > near:  # a table of those at infinity, or of all
        size += 8 * count
    if has_tree:
        floats = current_backend().kernels("wrt.kernels.native.constants").LIGHT_NODE_FLOATS
        nodes = math.ceil(near / LIGHTS_IN_NODE)
        size += (4 * floats + 4) * nodes + 4 * count
    return size


def _size(module: str, struct: str) -> int:
    """Return the bytes of a struct of a module of `kernels/`."""
    return int(np.dtype(getattr(current_backend().kernels(module), struct).numpy_dtype()).itemsize)
