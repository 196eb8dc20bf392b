"""Exact spheres, which rays meet as such, and spheres as triangles."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt.errors import InputError
from wrt.scene.mesh import Mesh
from wrt.values import array, sealed

FloatArray = NDArray[np.float64]

MOST_TRIANGLES = 50_000_000
"""Most triangles into which spheres are cut, two gigabytes."""

_SIMILAR = 1e-5
"""The relative difference of lengths up to which a matrix still maps spheres to spheres."""

_WEIGHTS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], np.float32)


@dataclass(frozen=True, eq=False, repr=False)
class Spheres(Mesh):
    """Spheres that are not made of triangles; `wrt.spheres` and `wrt.sphere(exact=True)` make them.

    Each is stored as a triangle that no ray hits, so that all which holds meshes holds spheres, too
    (`kernels/native/spheres.h`): its corners are the lowest and the highest corner of the box around the sphere, then
    the lowest again; or the highest, the lowest, and the highest, if its front is the inside. The normals of its
    vertices are the sphere's axes.
    The texture coordinate u is the fraction of a turn about the third axis from the first, v the angle from the third
    axis over π, as in Mitsuba.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.normals is None or len(self.vertices) != 3 * len(self.faces):
            raise InputError(f"{self.name}: make spheres by wrt.spheres")

    def __repr__(self) -> str:
        colors = ", colors" if self.colors is not None else ""
        return f"<spheres {self.name}: {len(self.faces)} spheres{colors}>"

    @property
    def centers(self) -> FloatArray:
        """(N, 3) float64 centres, metres."""
        return np.asarray(0.5 * (self._corners(0) + self._corners(1)))

    @property
    def radii(self) -> FloatArray:
        """(N,) float64 radii, metres."""
        return np.asarray(0.5 * np.abs(self._corners(1) - self._corners(0)).min(axis=1))

    @property
    def inside_out(self) -> NDArray[np.bool_]:
        """(N,) whether the front of a sphere is its inside."""
        return np.asarray(self.vertices[1::3, 0] < self.vertices[0::3, 0])

    @property
    def axes(self) -> FloatArray:
        """(N, 3, 3) float64 axes of the spheres, a row each."""
        assert self.normals is not None
        return self.normals.reshape(-1, 3, 3).astype(np.float64)

    @property
    def outline(self) -> NDArray[np.float32]:
        """(P, 3) points whose convex hull contains the spheres: corners of their boxes."""
        boxes = np.stack([self.vertices[0::3], self.vertices[1::3]])
        if len(self.faces) > 10_000:
            boxes = self.bounds.astype(np.float32)[:, None]
        picks = np.array([[k >> axis & 1 for axis in range(3)] for k in range(8)])
        return np.concatenate([boxes[pick, :, np.arange(3)].T for pick in picks])

    def _corners(self, which: int) -> FloatArray:
        return self.vertices[which::3].astype(np.float64)

    def turned_inside_out(self) -> Spheres:
        """Return the spheres with front and back exchanged."""
        return _stored(self.vertices.reshape(-1, 3, 3)[:, [1, 0, 1]], self.axes, self.colors, self.name)

    def transformed(self, matrix: ArrayLike) -> Mesh:
        """Return a transformed copy; of triangles if the matrix does not map spheres to spheres."""
        m = np.asarray(array(matrix, f"{self.name}: a transform", np.float64))
        if m.shape not in ((4, 4), (3, 4)) or not keeps_spheres(m):
            return self.tessellated().transformed(m)
        scale = float(np.cbrt(abs(np.linalg.det(m[:3, :3]))))
        axes = self.axes @ (m[:3, :3] / scale).T
        with np.errstate(all="ignore"):  # Mesh refuses values that are not finite
            centers = self.centers @ m[:3, :3].T + m[:3, 3]
            return _made(centers, scale * self.radii, self.inside_out, axes, self.colors, self.name)

    def tessellated(self, segments: int = 64) -> Mesh:
        """Return triangles with exact normals in place of the spheres, facing to the same sides.

        Args:
            segments: the number of vertices around.

        Raises:
            InputError: if there would be too many.
        """
        one = ball(segments)
        count = len(self.faces)
        if count * len(one.faces) > MOST_TRIANGLES:
            raise InputError(f"{self.name}: {count} spheres as triangles are more than {MOST_TRIANGLES}")
        assert one.normals is not None
        assert one.uvs is not None
        normals = np.einsum("nk,skj->snj", one.normals.astype(np.float64), self.axes)
        points = self.centers[:, None] + self.radii[:, None, None] * normals
        mirrored = np.linalg.det(self.axes) < 0.0
        faces = np.where((mirrored != self.inside_out)[:, None, None], one.faces[:, ::-1], one.faces)
        faces = faces + np.arange(count)[:, None, None] * len(one.vertices)
        normals[self.inside_out] *= -1.0
        colors = None if self.colors is None else np.repeat(self.colors[::3], len(one.vertices), axis=0)
        uvs = np.tile(one.uvs, (count, 1))
        return Mesh.taking(points.reshape(-1, 3), faces.reshape(-1, 3), normals.reshape(-1, 3), uvs, colors, self.name)


def spheres(centers: ArrayLike, radii: ArrayLike, *, colors: ArrayLike | None = None, name: str = "spheres") -> Spheres:
    """Return exact spheres, such as the particles of a simulation, as one mesh.

    Args:
        centers: (N, 3) metres.
        radii: (N,) metres, or one for all.
        colors: (N, 3) linear Rec. 709 of each, which a material reads by `wrt.VertexColor`; (N, 4) with alpha.
        name: for messages.

    Raises:
        InputError: on arrays of other shapes, values that are not finite, or radii that are not positive, or too small
            for float32 at their centres.
    """
    middle = np.asarray(array(centers, f"{name}: centers", np.float64))
    if middle.ndim != 2 or middle.shape[1] != 3 or not len(middle):
        raise InputError(f"{name}: centers must be (N, 3), not {middle.shape}")
    given = np.asarray(array(radii, f"{name}: radii", np.float64))
    if given.shape not in ((), (len(middle),)):
        raise InputError(f"{name}: radii must be one number or {len(middle)}, as many as centers, not {given.shape}")
    size = np.broadcast_to(given, (len(middle),))
    good = np.isfinite(middle).all(axis=1) & np.isfinite(size) & (size > 0.0)
    if not good.all():
        bad = int(np.flatnonzero(~good)[0])
        values = f"{bad} is at {middle[bad].tolist()} with the radius {size[bad]:g}"
        raise InputError(f"{name}: centers must be finite, and radii finite and above 0; sphere {values}")
    of_corners = None
    if colors is not None:
        rows = np.asarray(array(colors, f"{name}: colors", np.float32))
        if rows.ndim != 2 or rows.shape[1] not in (3, 4) or len(rows) != len(middle):
            raise InputError(f"{name}: colors must be ({len(middle)}, 3) or ({len(middle)}, 4), not {rows.shape}")
        of_corners = np.repeat(rows, 3, axis=0)
    axes = np.broadcast_to(np.eye(3), (len(middle), 3, 3))
    return _made(middle, size, np.zeros(len(middle), bool), axes, of_corners, name)


def keeps_spheres(matrix: FloatArray) -> bool:
    """Return whether an affine matrix maps spheres to spheres: it turns, mirrors and scales alike along all axes."""
    product = matrix[:3, :3].T @ matrix[:3, :3]
    square = float(np.trace(product)) / 3.0
    return square > 0.0 and bool((np.abs(product - square * np.eye(3)) <= 2.0 * _SIMILAR * square).all())


def spheres_in(boxes: ArrayLike, axes: ArrayLike, colors: ArrayLike | None, name: str) -> Spheres:
    """Return spheres from their own arrays, bit for bit.

    Args:
        boxes: (N, 2, 3) first and second corners.
        axes: (N, 3, 3).
        colors: (N, 3) or (N, 4), or None.
        name: for messages.
    """
    pairs, rows = np.asarray(boxes, np.float32), np.asarray(axes, np.float64)
    if pairs.ndim != 3 or pairs.shape[1:] != (2, 3) or rows.shape != (len(pairs), 3, 3):
        raise InputError(f"{name}: boxes must be (N, 2, 3) and axes (N, 3, 3), not {pairs.shape} and {rows.shape}")
    of_corners = None if colors is None else np.repeat(np.asarray(colors, np.float32), 3, axis=0)
    return _stored(pairs[:, [0, 1, 0]], rows, of_corners, name)


def _made(
    centers: FloatArray,
    radii: FloatArray,
    inside_out: NDArray[np.bool_],
    axes: FloatArray,
    colors: NDArray[np.float32] | None,
    name: str,
) -> Spheres:
    side = np.where(inside_out, -radii, radii)[:, None]
    with np.errstate(over="ignore"):
        low, high = (centers - side).astype(np.float32), (centers + side).astype(np.float32)
    if (flat := np.flatnonzero((low == high).any(axis=1))).size:
        bad = int(flat[0])
        raise InputError(
            f"{name}: sphere {bad} at {centers[bad].tolist()} has the radius {radii[bad]:g}, "
            "which is less than float32 resolves there"
        )
    return _stored(np.stack([low, high, low], axis=1), axes, colors, name)


def _stored(corners: NDArray[np.float32], axes: FloatArray, colors: NDArray[np.float32] | None, name: str) -> Spheres:
    count = len(corners)
    vertices = np.ascontiguousarray(corners, np.float32).reshape(-1, 3)
    faces = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    normals = np.ascontiguousarray(axes, np.float32).reshape(-1, 3)
    uvs = np.tile(_WEIGHTS, (count, 1))
    for each in (vertices, faces, normals, uvs):
        sealed(each)
    return Spheres(vertices, faces, normals, uvs, colors, name)


# --- Triangles -------------------------------------------------------------------------------------


def ball(segments: int) -> Mesh:
    """Return the unit sphere: u is the fraction of a turn about z from x, v the angle from +z over π."""
    rows = (segments + 1) // 2
    u, v = np.meshgrid(np.arange(segments + 1) / segments, np.arange(rows + 1) / rows)
    sine = np.sin(math.pi * v)
    sine[0] = sine[-1] = 0.0
    points = np.concatenate([sine[..., None] * circle(segments), np.cos(math.pi * v)[..., None]], axis=-1)
    # At a pole, each triangle has the u of its own middle.
    u[0] += 0.5 / segments
    u[-1] += 0.5 / segments
    faces = grid(rows, segments, downwards=True)
    solid = np.ones(len(faces), bool)
    solid[:segments] = False  # in the top row, the first triangle of each cell has two corners at the pole
    solid[-segments:] = False
    return curved(points.reshape(-1, 3), points.reshape(-1, 3), faces[solid], u, v, "sphere")


def circle(segments: int) -> FloatArray:
    """Return (segments + 1, 2) points of the unit circle from x on; the last equals the first, to the bit."""
    angles = 2.0 * math.pi * (np.arange(segments + 1) % segments) / segments
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def grid(rows: int, columns: int, *, downwards: bool) -> NDArray[np.int64]:
    """Return the triangles of a grid: for every cell the one with two corners in its row, then the others.

    Columns go counter-clockwise about the axis seen from above, rows down or up.
    """
    row, column = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    a = (row * (columns + 1) + column).reshape(-1)
    b, c, d = a + 1, a + columns + 1, a + columns + 2
    triangles = ([a, d, b], [a, c, d]) if downwards else ([a, b, d], [a, d, c])
    return np.concatenate([np.stack(corners, -1) for corners in triangles])


def curved(
    points: FloatArray, normals: FloatArray, faces: NDArray[np.int64], u: FloatArray, v: FloatArray, name: str
) -> Mesh:
    """Return a mesh with texture coordinates from the two grids u and v."""
    uvs = np.stack([u.reshape(-1), v.reshape(-1)], axis=-1)
    return Mesh(points, faces, normals, uvs, name=name)
