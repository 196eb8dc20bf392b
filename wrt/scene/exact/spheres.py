"""Exact spheres, which rays meet as such, and spheres as triangles."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt.errors import InputError
from wrt.linalg import determinant, product
from wrt.scene.exact.analytic import MOST_TRIANGLES, Analytic, FloatArray, keeps_spheres, stored
from wrt.scene.mesh import Mesh
from wrt.values import array, refuse_codes

_ORTHONORMAL = 1e-3
"""The error of products of axes that a file may have; each transform adds up to 1e-5."""


@dataclass(frozen=True, eq=False, repr=False)
class Spheres(Analytic):
    """Spheres that are not made of triangles; `wrt.spheres` and `wrt.sphere(exact=True)` make them.

    The corners of their triangles are the lowest and the highest corner of the box around the sphere, then the lowest
    again; or the highest, the lowest, and the highest, if its front is the inside. Their vectors are unit axes. The
    texture coordinate u is the fraction of a turn about the third axis from the first, v the angle from the third axis
    over π, as in Mitsuba.
    """

    @property
    def counts(self) -> dict[str, int]:
        return {"sphere": len(self.faces)}

    @property
    def radii(self) -> FloatArray:
        """(N,) float64 radii, metres."""
        return np.asarray(0.5 * np.abs(self._corners(1) - self._corners(0)).min(axis=1))

    @property
    def areas(self) -> FloatArray:
        return np.asarray(4.0 * np.pi * self.radii**2)

    def mistakes(self) -> list[tuple[NDArray[np.bool_], str, str]]:
        first, second = self._corners(0), self._corners(1)
        half, falls = 0.5 * np.abs(second - first), second < first
        uneven = half.max(axis=1) - half.min(axis=1) > 2.0**-22 * (np.abs(self.centers) + half).max(axis=1)
        uneven |= (falls != falls[:, :1]).any(axis=1)
        turned = np.abs(product(self.axes, np.swapaxes(self.axes, 1, 2)) - np.eye(3)).max(axis=(1, 2)) > _ORTHONORMAL
        return [
            (half.min(axis=1) == 0.0, "boxes", "must have a size"),
            (uneven, "boxes", "must be the lowest and the highest corner of a cube"),
            (turned, "axes", "rows must be perpendicular and of length 1"),
        ]

    def keeps(self, matrices: FloatArray) -> bool:
        return all(keeps_spheres(matrix) for matrix in matrices)

    def _mapped(self, matrix: FloatArray) -> Mesh:
        scale = float(np.cbrt(abs(determinant(matrix[:3, :3]))))
        axes = product(self.axes, (matrix[:3, :3] / scale).T)
        centers = product(self.centers, matrix[:3, :3].T) + matrix[:3, 3]
        return _made(centers, scale * self.radii, self.inside_out, axes, self.colors, self.name)

    def tessellated(self, segments: int = 64) -> Mesh:
        one = ball(segments)
        count = len(self.faces)
        if count * len(one.faces) > MOST_TRIANGLES:
            raise InputError(f"{self.name}: {count} spheres as triangles are more than {MOST_TRIANGLES}")
        assert one.normals is not None
        assert one.uvs is not None
        normals = np.einsum("nk,skj->snj", one.normals.astype(np.float64), self.axes)
        points = self.centers[:, None] + self.radii[:, None, None] * normals
        mirrored = determinant(self.axes) < 0.0
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
        colors: (N, 3) linear Rec. 709, read by `wrt.VertexColor`; (N, 4) with alpha.
        name: for messages.

    Raises:
        InputError: on arrays of other shapes, values that are not finite, or radii that are not positive, or too small
            for float32 at their centres.
    """
    middle = np.asarray(array(centers, f"{name}: centers", np.float64))
    if len(middle.shape) == 2 and not len(middle):
        raise InputError(f"{name}: there are no centers")
    if middle.ndim != 2 or middle.shape[1] != 3:
        raise InputError(f"{name}: centers must be (N, 3), not {middle.shape}")
    size = np.asarray(array(radii, f"{name}: radii", np.float64))
    if size.shape not in ((), (len(middle),)):
        raise InputError(f"{name}: radii must be one number or {len(middle)}, as many as centers, not {size.shape}")
    size = np.broadcast_to(size, (len(middle),))
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
        refuse_codes(colors, f"{name}: colors")
        of_corners = np.repeat(rows, 3, axis=0)
    axes = np.broadcast_to(np.eye(3), (len(middle), 3, 3))
    return _made(middle, size, np.zeros(len(middle), bool), axes, of_corners, name)


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
    return stored(Spheres, np.stack([low, high, low], axis=1), axes, colors, name)


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
