"""Meshes of USD files as parts of one material each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io import memory_limits
from wrt.io.mesh.parts import DEFAULT_REFLECTANCE, Part, points_of
from wrt.io.mesh.polygons import outer_sides, triangulate
from wrt.io.usd.lights import Values
from wrt.io.usd.materials import Coordinates, UsdMaterials
from wrt.linalg import product
from wrt.scene.mesh import Mesh, turned_sides
from wrt.scene.shapes import box, quad, sphere
from wrt.scene.textures import ImageTexture, VertexColor

_ROUND_SEGMENTS = 64


def parts_of_mesh(path: Path, shape: dict[str, Any], materials: UsdMaterials) -> list[Part]:
    """Return a part for each material of a mesh, in its own coordinates.

    Raises:
        InputError: where faces name points that are not there.
    """
    name, values = shape["path"], shape["values"]
    points = _rows(values["points"], 3)
    points = np.zeros((0, 3), np.float32) if points is None else points.astype(np.float32)
    counts, corners = (indices(values[key]) for key in ("faceVertexCounts", "faceVertexIndices"))
    memory_limits.take(memory_limits.MESHES, 40 * len(corners))
    if (counts < 0).any() or (counts > len(corners)).any() or counts.sum() != len(corners):
        raise InputError(f"{path}: {name}: its faces have {counts.sum()} corners, but {len(corners)} are given")
    triangles, owner = triangulate(f"{path}: {name}", points, corners, counts)
    sides = outer_sides(triangles, owner, counts)
    if values["orientation"] == "leftHanded":
        triangles, sides = triangles[:, ::-1], turned_sides(sides)
    at = _Corners(corners, counts, materials.unsupported)
    normals = [at.values("normals", primvar, 3) for primvar in shape["normals"]]
    at_corners = {
        "normals": next((each for each in normals if each is not None), None),
        "uvs": None,
        "colors": None,
    }
    coordinates = {each: at.values(each, primvar, 2) for each, primvar in shape["uvs"]}
    holes = indices(values.get("holeIndices"))
    parts = []
    for faces, material in _subsets(shape, len(counts)):
        is_chosen = np.isin(owner, np.setdiff1d(faces, holes))
        chosen = triangles[is_chosen]
        at_corners["uvs"], uv_sets = _uvs(coordinates, materials.uv_sets(material))
        at_corners["colors"] = _colors(shape, materials.color_primvar(material), at)
        if all(each is None for each in at_corners.values()):
            part = Part(name, points, corners[chosen])
        else:  # values at corners split the vertices
            used, chosen = np.unique(chosen, return_inverse=True)
            part = Part(name, points[corners[used]], chosen.reshape(-1, 3))
            for field, rows in at_corners.items():
                setattr(part, field, None if rows is None else rows[used])
        part.sides = None if sides is None else sides[is_chosen]
        part.smoothing = 0 if shape["faceted"] else None  # "A Note About Normals" of UsdGeomMesh
        parts.append(_with_material(part, material, materials, uv_sets))
    return parts


def _uvs(
    named: dict[str, NDArray[Any] | None], needed: list[Coordinates]
) -> tuple[NDArray[Any] | None, tuple[Coordinates, ...]]:
    """Return (C, 2 K) texture coordinates that a material needs, and which these are.

    A primvar that is missing or has no name is the mesh's first.
    """
    first = next((rows for rows in named.values() if rows is not None), None)
    if first is None or not needed:
        return first, ()
    sets = []
    for name, (scale, degrees, offset) in needed:
        rows = first if (found := named.get(name)) is None else found
        place = ImageTexture(np.zeros((1, 1, 3), np.float32), scale=scale, rotation_degrees=degrees, offset=offset)
        sets.append(product(rows, place.placement[:, :2].T) + place.placement[:, 2])
    return np.concatenate(sets, axis=1), tuple(needed)


def _colors(shape: dict[str, Any], name: str, at: _Corners) -> NDArray[Any] | None:
    """Return (C, 3) colours of a name at corners, or (C, 4) where they are not opaque and no material is bound."""
    colors = at.values(name, dict(shape["colors"]).get(name), 3)
    opacities = at.values("displayOpacity", shape["opacities"], 1)
    if opacities is None or shape["material"] is not None or not (opacities < 1.0).any():
        return colors
    colors = np.full((len(opacities), 3), DEFAULT_REFLECTANCE) if colors is None else colors
    return np.concatenate([colors, opacities], axis=1)


def part_of_points(shape: dict[str, Any], materials: UsdMaterials) -> Part:
    """Return points, whose widths are diameters (UsdGeomPoints)."""
    name, material = shape["path"], shape["material"]
    points = _rows(shape["values"]["points"], 3)
    points = np.zeros((0, 3), np.float32) if points is None else points.astype(np.float32)
    at = _each_vertex(len(points), materials)
    part = points_of(name, points, _colors(shape, materials.color_primvar(material), at))
    widths = at.values("widths", shape["widths"], 1)
    if widths is not None and ((widths > 0.0) & (widths < np.inf)).all():
        part.radius = 0.5 * widths[:, 0]
    elif widths is not None:
        materials.unsupported.add("a width of Points that is not positive, with the other widths,")
    return _with_material(part, material, materials, ())


def part_of_solid(path: Path, shape: dict[str, Any], materials: UsdMaterials) -> Part:
    """Return a solid as triangles."""
    kind, name = shape["kind"], shape["path"]
    values = Values(shape["values"], f"{path}: {name}")
    axis = np.eye(4)
    if kind == "Cube":
        half = 0.5 * values.number("size")
        mesh = box((-half,) * 3, (half,) * 3)
    elif kind == "Sphere":
        mesh = sphere(radius=values.number("radius"))
    else:
        turns = {"X": np.roll(np.eye(3), 1, axis=0), "Y": np.roll(np.eye(3), 2, axis=0)}
        axis[:3, :3] = turns.get(values.word("axis"), np.eye(3))
        if kind == "Plane":
            w, h = values.number("width"), values.number("length")
            mesh = quad((-0.5 * w, -0.5 * h, 0.0), (w, 0.0, 0.0), (0.0, h, 0.0))
        else:
            mesh = _revolved(_profile(kind, values.number("radius"), 0.5 * values.number("height")))
    mesh = mesh.transformed(axis)
    part = Part(name, mesh.vertices, mesh.faces, mesh.normals, mesh.uvs)
    uvs = None if mesh.uvs is None else np.asarray(mesh.uvs)
    part.uvs, uv_sets = _uvs({"st": uvs}, materials.uv_sets(shape["material"]))
    constant = [each for each in shape["colors"] if each[1] and each[1][1] == "constant"]
    opacities = shape["opacities"] if shape["opacities"] and shape["opacities"][1] == "constant" else None
    of_shape = {**shape, "colors": constant, "opacities": opacities}
    at = _each_vertex(len(mesh.vertices), materials)
    part.colors = _colors(of_shape, materials.color_primvar(shape["material"]), at)
    return _with_material(part, shape["material"], materials, uv_sets)


def _profile(kind: str, radius: float, half: float) -> NDArray[np.float64]:
    """Return (P, 2) distances from the axis and heights of a round solid, from its lower end to its upper one."""
    if kind == "Capsule":
        angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, _ROUND_SEGMENTS // 2)  # an even number, so that no angle is 0
        return np.stack([radius * np.cos(angle), radius * np.sin(angle) + np.copysign(half, angle)], axis=1)
    top = radius if kind == "Cylinder" else 0.0
    return np.array([(0.0, -half), (radius, -half), (top, half), (0.0, half)])[: 4 if top else 3]


def _revolved(profile: NDArray[np.float64]) -> Mesh:
    """Return the closed surface of a profile that revolves about z; its first and last point lie on the axis."""
    angle = np.arange(_ROUND_SEGMENTS) * (2.0 * np.pi / _ROUND_SEGMENTS)
    radius, height = profile[1:-1, :1], profile[1:-1, 1:]
    rings = np.stack(np.broadcast_arrays(radius * np.cos(angle), radius * np.sin(angle), height), 2)
    ends = np.array([(0.0, 0.0, z) for z in profile[[0, -1], 1]])
    this = np.arange(_ROUND_SEGMENTS)
    following = np.roll(this, -1)
    bottom, top = rings.shape[0] * _ROUND_SEGMENTS + np.zeros_like(this) + [[0], [1]]
    faces = [np.stack([following, this, bottom], axis=1)]
    for lower in range(0, bottom[0] - _ROUND_SEGMENTS, _ROUND_SEGMENTS):
        a, b, upper = lower + this, lower + following, lower + _ROUND_SEGMENTS
        faces += [np.stack([a, b, upper + following], axis=1), np.stack([a, upper + following, upper + this], axis=1)]
    last = bottom[0] - _ROUND_SEGMENTS
    faces.append(np.stack([last + this, last + following, top], axis=1))
    return Mesh(np.concatenate([rings.reshape(-1, 3), ends]), np.concatenate(faces))


def _subsets(shape: dict[str, Any], count: int) -> list[tuple[NDArray[np.int64], str | None]]:
    """Return the faces of each material, and the material."""
    is_bare = np.ones(count, bool)
    subsets: list[tuple[NDArray[np.int64], str | None]] = []
    for numbers, material in shape["subsets"]:
        faces = indices(numbers)
        faces = faces[(faces >= 0) & (faces < count)]
        is_bare[faces] = False
        subsets.append((faces, material))
    if is_bare.any() or not subsets:
        subsets.append((np.flatnonzero(is_bare), shape["material"]))
    return subsets


def _with_material(part: Part, name: str | None, materials: UsdMaterials, uv_sets: tuple[Coordinates, ...]) -> Part:
    """Return a part with its material; where there is one, the display colour counts only if that reads it."""
    material = materials.bound_to(name, uv_sets=uv_sets, has_colors=part.colors is not None)
    if material is None:
        return part
    uses_colors = any(isinstance(value, VertexColor) for value in vars(material).values())
    return replace(part, material=material, colors=part.colors if uses_colors else None)


def indices(value: Any) -> NDArray[np.int64]:
    """Return whole numbers; none where the value is of a type that the schema does not have."""
    fits = isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "iu"
    return value.astype(np.int64) if fits else np.zeros(0, np.int64)


def _rows(value: Any, width: int) -> NDArray[Any] | None:
    """Return (N, width) numbers, or None where the value is of a type that the schema does not have."""
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiu":
        return None
    rows: NDArray[Any] = value[:, None] if width == 1 and value.ndim == 1 else np.atleast_2d(value)
    return rows if rows.ndim == 2 and rows.shape[1] == width else None


@dataclass(frozen=True, eq=False)
class _Corners:
    """The corners of faces, at which a mesh has values.

    Attributes:
        corners: (C,) point of each corner.
        counts: corners of each face.
        misfits: takes the kinds of values that are left out.
    """

    corners: NDArray[np.int64]
    counts: NDArray[np.int64]
    misfits: set[str]

    def values(self, name: str, primvar: list[Any] | None, width: int) -> NDArray[Any] | None:
        """Return (C, width) values of a primvar, or None if it has none or their number or type does not fit.

        Args:
            name: of the primvar.
            primvar: the values and their interpolation, or None.
            width: numbers in each.
        """
        if primvar is None or primvar[0] is None or not np.size(primvar[0]):
            return None
        rows = _rows(primvar[0], width)
        numbers = {
            "faceVarying": np.arange(len(self.corners)),
            "vertex": self.corners,
            "varying": self.corners,
            "uniform": np.repeat(np.arange(len(self.counts)), self.counts),
            "constant": np.zeros(len(self.corners), np.int64),
        }.get(primvar[1])
        if rows is None or numbers is None or (len(numbers) and numbers.max() >= len(rows)):
            self.misfits.add(f"a primvar {name} that does not fit its points or faces")
            return None
        return np.asarray(rows[numbers], np.float64)


def _each_vertex(count: int, materials: UsdMaterials) -> _Corners:
    """Return the points of what has no faces, as the corners of one face each."""
    return _Corners(np.arange(count), np.ones(count, np.int64), materials.unsupported)
