"""Triangle meshes as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt import _above
from wrt.errors import InputError, warn
from wrt.linalg import determinant, inverse, norm, product
from wrt.scene.motion import check_affine, turn
from wrt.scene.tangents import moved_tangents
from wrt.values import array, number, owned, refuse_codes, sealed, vector


def box_around(points: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Return the (2, 3) lowest and highest corner of the bounding box of (N, 3) points, N ≥ 1."""
    # Column by column, since NumPy is several times slower on short rows.
    return np.array([[function(column) for column in points.T] for function in (np.min, np.max)], np.float64)


def single(points: NDArray[Any]) -> NDArray[np.float32]:
    """Return positions in single precision, so that Mesh does not warn of rounding: few were put there on purpose."""
    with np.errstate(over="ignore"):  # Mesh refuses values that are not finite
        return points.astype(np.float32)


SMALLEST, LARGEST = 1e-11, 1e12
"""Limits of a mesh's extent and distance from the origin, metres; beyond, products of coordinates exceed float32."""


FARTHEST = 20_000.0
"""Distance from the origin, in sizes of the mesh, beyond which single precision visibly snaps vertices to a grid."""


def far_away(name: str, size: float, reach: float) -> str:
    """Return the warning about a mesh that is `size` across and reaches to `reach` if it is too far away, else ""."""
    if not reach > FARTHEST * size > 0.0:
        return ""
    step = 100.0 * reach * 2.0**-24 / size
    return (
        f"{name}: it is {size:g} across and up to {reach:g} from the origin, where numbers in single precision are "
        f"{step:.2g} % of its size apart; move it to the origin"
    )


ALL_SIDES = 7
"""In `Mesh.sides`, a triangle whose three sides are edges."""


def turned_sides(sides: NDArray[Any] | None) -> NDArray[np.uint8] | None:
    """Return `Mesh.sides` of triangles whose corners are taken in reverse order, the last one first."""
    return None if sides is None else np.array([0, 2, 1, 3, 4, 6, 5, 7], np.uint8)[sides]


VERTEX_ATTRIBUTES = {"normals": (3,), "uvs": (2, 4), "colors": (3, 4), "tangents": (4,)}
"""The optional arrays of a mesh with a row for each vertex, and how many numbers a row may have."""


@dataclass(frozen=True, eq=False, repr=False)
class Mesh:
    """Indexed triangles with optional vertex attributes.

    A mesh owns its arrays, which are read-only. It copies the given arrays unless they are read-only already. Where it
    rounds vertices, such as map coordinates, to a visible grid, an InputWarning names it.

    Attributes:
        vertices: (N, 3) float32 positions, metres.
        faces: (M, 3) int32 vertex indices; counter-clockwise seen from the front.
        normals: (N, 3) float32 shading normals, or None for flat triangles.
        uvs: (N, 2) float32 texture coordinates, v up, or None; (N, 4) for two sets.
        colors: (N, 3) float32 linear Rec. 709, or None; (N, 4) with alpha, 0 to 1, which a material's opacity may use.
        name: source of the mesh, for messages.
        tangents: (N, 4) float32 x axes of normal maps and anisotropic materials, and the sign of y = normal × tangent.
            Zero, or None, for axes along the texture coordinates.
        sides: (M,) uint8, the sides of triangles that are edges of polygons, not diagonals: 1 for the side after the
            first corner, 2 for the next, 4 for the last, added up. None if all are.

    Raises:
        InputError: if shapes are wrong, there are no triangles, or values are out of range or not finite.
    """

    vertices: NDArray[Any] = field(repr=False)
    faces: NDArray[Any] = field(repr=False)
    normals: NDArray[Any] | None = field(default=None, repr=False)
    uvs: NDArray[Any] | None = field(default=None, repr=False)
    colors: NDArray[Any] | None = field(default=None, repr=False)
    name: str = "mesh"
    tangents: NDArray[Any] | None = field(default=None, repr=False)
    sides: NDArray[Any] | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        has = [each for each in VERTEX_ATTRIBUTES if getattr(self, each) is not None]
        parts = "".join(f", {each}" for each in has)
        return f"<wrt.Mesh {self.name}: {len(self.faces)} triangles, {len(self.vertices)} vertices{parts}>"

    def _repr_png_(self) -> bytes | None:
        picture: bytes | None = _above.viewer().picture_of_mesh(self)
        return picture

    def __post_init__(self) -> None:
        vertices = self._float_array("vertices", self.vertices, (3,))
        count = len(vertices)
        faces = array(self.faces, f"{self.name}: faces")
        if faces.ndim != 2 or faces.shape[1] != 3:
            raise InputError(f"{self.name}: faces must be (M, 3), not {faces.shape}")
        if len(faces) == 0:
            raise InputError(f"{self.name}: the mesh has no triangles")
        if faces.dtype.kind not in "iu":
            raise InputError(f"{self.name}: faces must be integers, not {faces.dtype}")
        low, high = int(faces.min()), int(faces.max())
        if low < 0 or high >= count:
            bad = low if low < 0 else high
            raise InputError(f"{self.name}: a face names vertex {bad}, but there are {count} vertices")
        if getattr(self.vertices, "dtype", None) != np.float32:
            corners = box_around(vertices)
            if far := far_away(self.name, norm(corners[1] - corners[0]), float(np.abs(corners).max())):
                warn(far)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", owned(self.faces, f"{self.name}: faces", np.int32))
        if self.sides is not None:
            sides = array(self.sides, f"{self.name}: sides")
            if sides.shape != (len(faces),) or sides.dtype.kind not in "iu" or not np.isin(sides, range(8)).all():
                raise InputError(f"{self.name}: sides must be {len(faces)} whole numbers from 0 to {ALL_SIDES}")
            object.__setattr__(self, "sides", owned(self.sides, f"{self.name}: sides", np.uint8))
        for name, widths in VERTEX_ATTRIBUTES.items():
            value = getattr(self, name)
            if value is None:
                continue
            rows = self._float_array(name, value, widths)
            if name == "colors":
                refuse_codes(value, f"{self.name}: colors")
            if len(rows) != count:
                raise InputError(f"{self.name}: {len(rows)} {name} for {count} vertices")
            object.__setattr__(self, name, rows)

    def _float_array(self, what: str, value: ArrayLike, widths: tuple[int, ...]) -> NDArray[np.float32]:
        with np.errstate(over="ignore"):
            rows = owned(value, f"{self.name}: {what}", np.float32)
        if rows.ndim != 2 or rows.shape[1] not in widths:
            shapes = " or ".join(f"(N, {width})" for width in widths)
            raise InputError(f"{self.name}: {what} must be {shapes}, not {rows.shape}")
        if not np.isfinite(rows).all():
            bad = int(np.flatnonzero(~np.isfinite(rows).all(axis=1))[0])
            raise InputError(f"{self.name}: {what} must be finite; number {bad} is {rows[bad].tolist()}")
        return rows

    @classmethod
    def taking(
        cls,
        vertices: NDArray[Any],
        faces: NDArray[Any],
        normals: NDArray[Any] | None = None,
        uvs: NDArray[Any] | None = None,
        colors: NDArray[Any] | None = None,
        name: str = "mesh",
        tangents: NDArray[Any] | None = None,
        sides: NDArray[Any] | None = None,
    ) -> Mesh:
        """Make a mesh from arrays that the caller hands over: they become read-only and are not copied."""
        for values in (vertices, faces, normals, uvs, colors, tangents, sides):
            if values is not None:
                sealed(values)
        return cls(vertices, faces, normals, uvs, colors, name, tangents, sides)

    def reindexed(self, source: NDArray[Any], faces: NDArray[Any], **replaced: Any) -> Mesh:
        """Return a mesh with other faces, whose vertices are those of this one that `source` selects.

        Args:
            source: an index array or a mask.
            faces: (M, 3) indices of selected vertices, for the same triangles.
            replaced: other attributes of these vertices, sides of other triangles, and a name.
        """
        found = {name: getattr(self, name) for name in VERTEX_ATTRIBUTES if name not in replaced}
        kept = {name: rows[source] for name, rows in found.items() if rows is not None}
        return Mesh.taking(self.vertices[source], faces, **{"name": self.name, "sides": self.sides, **kept, **replaced})

    def share(self, name: str, array: NDArray[Any]) -> None:
        """Replace an array by a read-only view of `array`, which must hold the same values."""
        array = array.view()
        array.flags.writeable = False
        object.__setattr__(self, name, array)

    @cached_property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) float64 lowest and highest corner of the vertices that faces use."""
        used = np.zeros(len(self.vertices), bool)
        used[self.faces] = True
        points = self.vertices if used.all() else self.vertices[used]
        return box_around(points)

    def transformed(self, matrix: ArrayLike) -> Mesh:
        """Return a copy transformed by a (4, 4) or (3, 4) affine matrix, with correct normals and winding."""
        m = array(matrix, f"{self.name}: a transform", np.float64)
        if m.shape not in ((4, 4), (3, 4)):
            raise InputError(f"{self.name}: a transform must be a 4x4 matrix, not an array of {m.shape}")
        linear, offset = m[:3, :3], m[:3, 3]
        check_affine(np.vstack([m[:3], m[3:] if len(m) == 4 else (0.0, 0.0, 0.0, 1.0)]), f"{self.name}: a transform")
        volume = float(determinant(linear))
        with np.errstate(all="ignore"):  # Mesh refuses values that are not finite
            vertices = (product(self.vertices.astype(np.float64), linear.T) + offset).astype(np.float32)
        normals = self.normals
        if normals is not None:
            moved = product(normals.astype(np.float64), inverse(linear))
            length = np.linalg.norm(moved, axis=1, keepdims=True)
            normals = (moved / np.where(length > 0.0, length, 1.0)).astype(np.float32)
        faces, sides = self.faces, self.sides
        if volume <= 0.0:
            faces, sides = faces[:, ::-1], turned_sides(sides)
        tangents = self.tangents
        if tangents is not None:
            tangents = moved_tangents(tangents, linear).astype(np.float32)
        return Mesh.taking(vertices, faces, normals, self.uvs, self.colors, self.name, tangents, sides)

    def scaled(self, factor: float) -> Mesh:
        """Return a copy scaled about the origin."""
        scale = number(factor, f"{self.name}: a scale")
        return self.transformed(np.diag([scale, scale, scale, 1.0]))

    def translated(self, offset: ArrayLike) -> Mesh:
        """Return a copy moved by `offset`, metres."""
        m = np.eye(4)
        m[:3, 3] = vector(offset, f"{self.name}: an offset")
        return self.transformed(m)

    def standing(self, height: float) -> Mesh:
        """Return a copy scaled to a height in metres, standing on y = 0 and centred above the origin.

        This places a mesh in any unit of length. A mesh that is flat along y raises InputError.
        """
        low, high = self.bounds
        tall = float(high[1] - low[1])
        if tall == 0.0:
            raise InputError(f"{self.name}: the mesh is flat along y, so it cannot be scaled to a height")
        factor = number(height, f"{self.name}: height", above=0.0) / tall
        m = np.diag([factor, factor, factor, 1.0])
        m[:3, 3] = -factor * np.array([0.5 * (low[0] + high[0]), low[1], 0.5 * (low[2] + high[2])])
        return self.transformed(m)

    def rotated(self, axis: ArrayLike, degrees: float) -> Mesh:
        """Return a copy turned about an axis through the origin, counter-clockwise seen from the axis's tip."""
        return self.transformed(turn(axis, degrees))


def columns(mesh: Mesh, name: str, first: int, stop: int, default: float) -> NDArray[np.float32]:
    """Return (N, stop − first) columns of a vertex attribute, `default` where the mesh has none."""
    values = getattr(mesh, name)
    if values is not None and values.shape[1] >= stop:
        return np.asarray(values[:, first:stop])
    rows = np.full((len(mesh.vertices), stop - first), default, np.float32)
    if values is not None and values.shape[1] > first:
        rows[:, : values.shape[1] - first] = values[:, first:]
    return rows


def sides_of(mesh: Mesh) -> NDArray[np.uint8]:
    """Return (M,) `Mesh.sides`, also where all sides are edges."""
    return np.full(len(mesh.faces), ALL_SIDES, np.uint8) if mesh.sides is None else mesh.sides


def merge(meshes: list[Mesh], name: str) -> Mesh:
    """Return one mesh of all triangles in order.

    Meshes without `uvs` or `tangents` get zeros and those without `colors` get white if others have them; `normals` are
    dropped unless all meshes have them.
    """
    if len(meshes) == 1:
        return replace(meshes[0], name=name)
    offsets = np.cumsum([0] + [len(m.vertices) for m in meshes[:-1]])
    normals = [m.normals for m in meshes if m.normals is not None]
    return Mesh.taking(
        np.concatenate([m.vertices for m in meshes]),
        np.concatenate([m.faces.astype(np.int64) + o for m, o in zip(meshes, offsets, strict=True)]),
        np.concatenate(normals) if len(normals) == len(meshes) else None,
        _filled(meshes, "uvs", 0.0),
        _filled(meshes, "colors", 1.0),
        name,
        _filled(meshes, "tangents", 0.0),
        None if all(m.sides is None for m in meshes) else np.concatenate([sides_of(m) for m in meshes]),
    )


def _filled(meshes: list[Mesh], field: str, value: float) -> NDArray[np.float32] | None:
    widths = [getattr(m, field).shape[1] for m in meshes if getattr(m, field) is not None]
    return np.concatenate([columns(m, field, 0, max(widths), value) for m in meshes]) if widths else None
