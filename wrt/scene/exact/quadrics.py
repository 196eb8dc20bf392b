"""Exact disks and open cylinders, and the same as triangles."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt.errors import InputError
from wrt.linalg import determinant, inverse, norm, product
from wrt.scene.exact.analytic import MOST_TRIANGLES, Analytic, FloatArray, keeps_spheres, stored
from wrt.scene.exact.spheres import circle, curved, grid
from wrt.scene.mesh import Mesh
from wrt.values import Vec3, number, vector

_SQUARE = 1e-5
"""The cosine up to which vectors count as perpendicular, and the difference up to which lengths count as equal."""

_PADDING = 2.0**-21
"""Boxes are larger than what they hold by this share of its size and distance: a few roundings. So no side is 0."""

_LEAST_SIZE = 2.0**-18
"""The least radius and length, relative to the distance from the origin, that float32 resolves well enough."""


@dataclass(frozen=True, eq=False, repr=False)
class Quadrics(Analytic):
    """Disks and open cylinders that are not made of triangles; `wrt.disk` and `wrt.cylinder` make them.

    Of the corners of a box, the first is the lowest along x, or the highest if the front is the other side; along y it
    is the opposite, unlike a sphere's; along z it is as along x for a disk, and as along y for a
    cylinder. The vectors of a disk are two radii and its normal, those of a cylinder two radii and the way from end to
    end. Disks may be ellipses; the vectors of a cylinder are perpendicular, and its radii equal.
    The texture coordinates are Mitsuba's: of a disk, the distance from the centre in radii, and the fraction of a turn
    from its first vector; of a cylinder, the fraction of a turn, and the height in its length.
    """

    @property
    def counts(self) -> dict[str, int]:
        disks = int(self.are_disks.sum())
        counts = {"disk": disks, "cylinder": len(self.faces) - disks}
        return {noun: count for noun, count in counts.items() if count}

    @property
    def are_disks(self) -> NDArray[np.bool_]:
        """(N,) whether a shape is a disk, not a cylinder."""
        rises = self.vertices[0::3] < self.vertices[1::3]
        return np.asarray(rises[:, 0] == rises[:, 2])

    @property
    def areas(self) -> FloatArray:
        x, y, z = np.moveaxis(self.axes, 1, 0)
        of_cylinders = 2.0 * math.pi * np.linalg.norm(x, axis=1) * np.linalg.norm(z, axis=1)
        return np.asarray(np.where(self.are_disks, math.pi * np.linalg.norm(np.cross(x, y), axis=1), of_cylinders))

    @property
    def fronts(self) -> FloatArray:
        """(N, 3) float64 unit normals of the fronts of disks, and the axes of cylinders."""
        z = self.axes[:, 2] / np.linalg.norm(self.axes[:, 2], axis=1, keepdims=True)
        return np.asarray(np.where((self.are_disks & self.inside_out)[:, None], -z, z))

    def mistakes(self) -> list[tuple[NDArray[np.bool_], str, str]]:
        disks, axes, rises = self.are_disks, self.axes, self.vertices[0::3] < self.vertices[1::3]
        x, y, z = np.moveaxis(axes, 1, 0)
        lengths = np.linalg.norm(axes, axis=2)
        flat = np.linalg.norm(np.cross(x, y), axis=1) == 0.0
        leaning = np.abs(np.einsum("njk,nk->nj", axes[:, :2], z)).max(axis=1) > _SQUARE * lengths[:, :2].max(axis=1)
        half = 0.5 * np.abs(self._corners(1) - self._corners(0))
        off = np.abs(half - _reach(disks, self.centers, axes)).max(axis=1)
        scale = (np.abs(self.centers) + half).max(axis=1)
        return [
            (rises[:, 0] == rises[:, 1], "boxes", "corners must be in the order of a disk's or a cylinder's"),
            (disks & (np.abs(lengths[:, 2] - 1.0) > _SQUARE), "axes", "a disk's third row must be a unit vector"),
            (disks & flat, "axes", "a disk's radii, its first two rows, must not be parallel"),
            (disks & leaning, "axes", "a disk's normal, its third row, must be perpendicular to its radii"),
            (~disks & ~_are_straight(axes), "axes", "a cylinder's rows must be perpendicular, its radii equal"),
            (off > 0.5 * _PADDING * scale, "boxes", "must be opposite corners of the box around the shape"),
        ]

    def keeps(self, matrices: FloatArray) -> bool:
        # Disks become ellipses under every map that can be inverted; cylinders must stay round and straight. The maps
        # between two of a motion are similarities only if these are. Shapes that float32 does not resolve are not kept.
        if not all(determinant(matrix[:3, :3]) for matrix in matrices):
            return False
        disks, cylinders = self.are_disks, self.axes[~self.are_disks]
        if len(matrices) > 1 and len(cylinders) and not all(keeps_spheres(matrix) for matrix in matrices):
            return False
        # Between the keys of a motion shapes may be a little less straight than there.
        tolerance = _SQUARE if len(matrices) == 1 else 0.5 * _SQUARE
        with np.errstate(all="ignore"):
            return all(
                _are_straight(product(cylinders, matrix[:3, :3].T), tolerance).all()
                and not len(_unresolved(disks, *self._moved(matrix)))
                for matrix in matrices
            )

    def _moved(self, matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the centres and vectors of transformed shapes."""
        linear, disks = matrix[:3, :3], self.are_disks
        axes = product(self.axes, linear.T)
        axes[disks, 2] = product(self.axes[disks, 2], inverse(linear))
        return product(self.centers, linear.T) + matrix[:3, 3], axes

    def _mapped(self, matrix: FloatArray) -> Mesh:
        return _made(self.are_disks, *self._moved(matrix), self.inside_out, self.colors, self.name)

    def tessellated(self, segments: int = 64) -> Mesh:
        if len(self.faces) * 2 * segments > MOST_TRIANGLES:
            raise InputError(f"{self.name}: {len(self.faces)} shapes as triangles are more than {MOST_TRIANGLES}")
        units = {True: unit_disk(segments), False: unit_cylinder(segments)}
        points, normals, uvs, faces, colors, first = [], [], [], [], [], 0
        for k, disk in enumerate(self.are_disks):
            unit, axes = units[bool(disk)], self.axes[k]
            assert unit.uvs is not None
            place = unit.vertices.astype(np.float64) - (0.0 if disk else (0.0, 0.0, 0.5))
            side = -1.0 if self.inside_out[k] else 1.0
            right_handed = float(determinant(axes)) > 0.0
            points.append(self.centers[k] + product(place, axes))
            out = np.broadcast_to(axes[2], place.shape) if disk else product(place * (1.0, 1.0, 0.0), axes)
            normals.append(side * out / np.linalg.norm(out, axis=1, keepdims=True))
            faces.append(first + (unit.faces if right_handed == (side > 0.0) else unit.faces[:, ::-1]))
            uvs.append(unit.uvs)
            if self.colors is not None:
                colors.append(np.repeat(self.colors[3 * k : 3 * k + 1], len(place), axis=0))
            first += len(place)
        joined = [np.concatenate(each) for each in (points, faces, normals, uvs)]
        of_corners = np.concatenate(colors) if colors else None
        return Mesh.taking(joined[0], joined[1], joined[2], joined[3], of_corners, self.name)


def disk(center: Vec3 = (0.0, 0.0, 0.0), normal: Vec3 = (0.0, 1.0, 0.0), radius: float = 1.0) -> Quadrics:
    """Return an exact disk, which rays meet as such.

    Its outline is round at any size. `tessellated` makes triangles of it.

    Args:
        center: metres.
        normal: direction of its front, which emits; of any length.
        radius: metres.

    Raises:
        InputError: on values that are not finite, a normal of length 0, or a radius that is not above 0 or too small
            for float32 at the centre.
    """
    middle, front = np.array(vector(center, "center")), np.array(vector(normal, "normal"))
    size, length = number(radius, "radius", above=0.0), norm(front)
    if not 0.0 < length < math.inf:
        raise InputError(f"a disk's normal must have a length above 0, not {front.tolist()}")
    axes = basis(front / length) * [[size], [size], [1.0]]
    return quadrics_of([True], middle[None], axes[None], "disk")


def cylinder(start: Vec3 = (0.0, 0.0, 0.0), end: Vec3 = (0.0, 1.0, 0.0), radius: float = 1.0) -> Quadrics:
    """Return an exact open cylinder, which rays meet as such; its front is the outside.

    It has no caps: `wrt.disk` makes them. `tessellated` makes triangles of it.

    Args:
        start: the middle of one end, metres.
        end: the middle of the other end, metres.
        radius: metres.

    Raises:
        InputError: on values that are not finite, ends in one place, or a radius that is not above 0 or too small for
            float32 at the cylinder.
    """
    a, b = np.array(vector(start, "start")), np.array(vector(end, "end"))
    size, length = number(radius, "radius", above=0.0), norm(b - a)
    if not 0.0 < length < math.inf:
        raise InputError(f"a cylinder's start and end must differ, and are {a.tolist()} and {b.tolist()}")
    axes = basis((b - a) / length) * [[size], [size], [length]]
    return quadrics_of([False], 0.5 * (a + b)[None], axes[None], "cylinder")


def basis(z: FloatArray) -> FloatArray:
    """Return three orthonormal rows ending with z (Duff et al. 2017, "Building an Orthonormal Basis")."""
    sign = math.copysign(1.0, z[2])
    a = -1.0 / (sign + z[2])
    b = z[0] * z[1] * a
    x = (1.0 + sign * z[0] * z[0] * a, sign * b, -sign * z[0])
    return np.array([x, (b, sign + z[1] * z[1] * a, -z[1]), z])


def quadrics_of(are_disks: ArrayLike, centers: ArrayLike, axes: ArrayLike, name: str) -> Quadrics:
    """Return N disks and cylinders from their middles, (N, 3), and their vectors in the rows of `axes`, (N, 3, 3).

    These are two radii, then the normal of a disk, or the vector from end to end of a cylinder.

    Raises:
        InputError: when float32 does not resolve one of them.
    """
    disks, middles, vectors = np.asarray(are_disks, bool), np.asarray(centers), np.asarray(axes)
    if len(bad := _unresolved(disks, middles, vectors)):
        noun = "disk" if disks[bad[0]] else "cylinder"
        place = middles[bad[0]].tolist()
        raise InputError(f"{name}: the {noun} at {place} has a radius or length that float32 does not resolve there")
    return _made(disks, middles, vectors, np.zeros(len(disks), bool), None, name)


def _unresolved(disks: NDArray[np.bool_], centers: FloatArray, axes: FloatArray) -> NDArray[np.intp]:
    """Return which shapes have a radius, or a length, that float32 does not resolve at their ends."""
    sizes = np.linalg.norm(axes, axis=2)
    least = np.where(disks, sizes[:, :2].min(axis=1), sizes.min(axis=1))
    ends = np.abs(centers) + np.where(disks[:, None], 0.0, 0.5 * np.abs(axes[:, 2]))
    return np.flatnonzero(~(least > _LEAST_SIZE * ends.max(axis=1)))


def _are_straight(axes: FloatArray, tolerance: float = _SQUARE) -> NDArray[np.bool_]:
    """Return which cylinders have perpendicular vectors and equal radii."""
    length = np.linalg.norm(axes, axis=2)
    unit = axes / np.maximum(length, 1e-300)[..., None]
    cosines = np.abs(np.einsum("njk,nik->nji", unit, unit) - np.eye(3)).max(axis=(1, 2), initial=0.0)
    return np.asarray((cosines < tolerance) & (np.abs(length[:, 0] - length[:, 1]) < tolerance * length[:, 0]))


def _reach(disks: NDArray[np.bool_], centers: FloatArray, axes: FloatArray) -> FloatArray:
    """Return half the sides of the boxes around shapes, (N, 3)."""
    reach = np.sqrt((axes[:, :2] ** 2).sum(axis=1)) + np.where(disks[:, None], 0.0, 0.5 * np.abs(axes[:, 2]))
    return np.asarray(reach + _PADDING * (np.abs(centers) + reach).max(axis=1, keepdims=True))


def _made(
    disks: NDArray[np.bool_],
    centers: FloatArray,
    axes: FloatArray,
    inside_out: NDArray[np.bool_],
    colors: NDArray[np.float32] | None,
    name: str,
) -> Quadrics:
    axes = axes.copy()
    axes[disks, 2] /= np.linalg.norm(axes[disks, 2], axis=1, keepdims=True)
    with np.errstate(over="ignore"):
        axes = axes.astype(np.float32).astype(np.float64)
    reach = _reach(disks, centers, axes)
    side = np.where(inside_out, -1.0, 1.0)[:, None] * np.where(disks[:, None], (1, -1, 1), (1, -1, -1))
    with np.errstate(over="ignore"):
        first, second = ((centers + sign * side * reach).astype(np.float32) for sign in (-1.0, 1.0))
    return stored(Quadrics, np.stack([first, second, first], axis=1), axes, colors, name)


# --- Triangles -------------------------------------------------------------------------------------


def unit_disk(segments: int) -> Mesh:
    """Return the unit disk that faces z: u is the distance from the centre, v the fraction of a turn from x."""
    around = circle(segments)
    rim = np.concatenate([around, np.zeros((segments + 1, 1))], axis=1)
    turns = np.arange(segments + 1) / segments
    middle = np.stack([np.zeros(segments), turns[:-1] + 0.5 / segments], axis=-1)
    index = np.arange(segments)
    return Mesh(
        np.concatenate([rim, np.zeros((segments, 3))]),
        np.stack([index, index + 1, segments + 1 + index], axis=-1),
        uvs=np.concatenate([np.stack([np.ones_like(turns), turns], axis=-1), middle]),
        name="disk",
    )


def unit_cylinder(segments: int) -> Mesh:
    """Return the open unit cylinder along z from 0 to 1, facing outwards: u is the fraction of a turn, v is z."""
    u, v = np.meshgrid(np.arange(segments + 1) / segments, np.arange(2.0))
    normals = np.concatenate([np.stack([circle(segments)] * 2), np.zeros((2, segments + 1, 1))], axis=-1)
    points = normals.copy()
    points[..., 2] = v
    faces = grid(1, segments, downwards=False)
    return curved(points.reshape(-1, 3), normals.reshape(-1, 3), faces, u, v, "cylinder")
