"""Normals of vertices between creases (`wrt.scene.normals.with_normals`): C++ (`kernels/native/creases.h`)."""

import warp as wp

from wrt.kernels.native import include

creases_h = include("creases.h")


@wp.struct
class Mesh:
    """A mesh, and the groups of corners at each position.

    Attributes:
        vertices: (3 N,) positions.
        faces: (C,) vertices of corners.
        positions: (N,) numbers from 0, equal for vertices at the same position.
        begins: (P + 2,) zeros; then where the corners of each position begin.
        corners: (C,) the corners, position by position.
        copies: (C,) which copy of its vertex a corner has.
        sources: (C,) the row of `normals` that a corner has.
        normals: (3 C,) normals.
        counts: (N,) zeros; then copies of each vertex.
        is_done: (P,) 1 for a position that is done, 0 for one that is left to the host.
        origin: A point of the mesh.
        scale: Its size.
        least_cosine: Of the angle between two faces that have a smooth edge.
    """

    vertices: wp.array(dtype=float)
    faces: wp.array(dtype=int)
    positions: wp.array(dtype=int)
    begins: wp.array(dtype=int)
    corners: wp.array(dtype=int)
    copies: wp.array(dtype=int)
    sources: wp.array(dtype=int)
    normals: wp.array(dtype=float)
    counts: wp.array(dtype=int)
    is_done: wp.array(dtype=int)
    origin: wp.vec3d
    scale: wp.float64
    least_cosine: wp.float64


@wp.func_native("wrt::list_corners(mesh);")
def _list(mesh: Mesh):
    creases_h()


@wp.func_native("return wrt::join_corners(mesh, position);")
def _join(mesh: Mesh, position: int) -> bool:
    creases_h()


@wp.kernel(enable_backward=False)
def list_corners(first: int, mesh: Mesh):
    """List the corners of all positions, in one thread."""
    _list(mesh)


@wp.kernel(enable_backward=False)
def join_corners(first: int, mesh: Mesh):
    """Find the groups of corners of a position, and their normals."""
    position = first + wp.tid()
    mesh.is_done[position] = wp.where(_join(mesh, position), 1, 0)
