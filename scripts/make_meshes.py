"""Make the sample meshes: `python scripts/make_meshes.py [folder]`, by default into meshes/.

`teapot.ply` is the Utah teapot (data/teapot.txt), `sweep.ply` a photographer's backdrop. Both are
little-endian binary PLY, metres, y up, with normals, and the same on every run.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Triangles = tuple[Array, Array, NDArray[np.int64]]
"""Positions (N, 3), unit normals (N, 3) and faces (M, 3)."""

TEAPOT_HEIGHT = 0.15
"""Metres, table to knob."""

TEAPOT_STEPS = 20
"""Edges along each side of a patch: 80 around the body, an outline within 0.1 mm of the true one."""


PARTS = {
    "body": (*range(12), *range(28, 32)),
    "handle": range(12, 16),
    "spout": range(16, 20),
    "lid": range(20, 28),
}
"""Patches that meet smoothly, by number from 0. Handle and spout merely enter the body."""


def control_points() -> Array:
    """Return the teapot's (32, 4, 4, 3) control points in Newell's frame: z up, 3.15 units tall."""
    text = (Path(__file__).resolve().parent / "data" / "teapot.txt").read_text(encoding="utf-8")
    patches, points = (section.partition("\n")[2].split() for section in text.split("\n[")[1:])
    return np.array(points, np.float64).reshape(306, 3)[np.array(patches, np.int64).reshape(32, 4, 4) - 1]


def bernstein(t: Array) -> tuple[Array, Array]:
    """Return the (N, 4) cubic Bernstein polynomials and their derivatives at N parameters."""
    s = 1.0 - t
    value = np.stack([s**3, 3.0 * s**2 * t, 3.0 * s * t**2, t**3], axis=1)
    slope = np.stack([-3.0 * s**2, 3.0 * s * (s - 2.0 * t), 3.0 * t * (2.0 * s - t), 3.0 * t**2], axis=1)
    return value, slope


def evaluate(patch: Array, steps: int) -> tuple[Array, Array]:
    """Return the ((steps + 1)², 3) points and unit normals of a bicubic Bezier patch on a regular grid.

    The normal is the cross product of the partial derivatives. Where the first row of control points is
    one point (the tip of the lid, the middle of the bottom), the derivative along it vanishes there,
    and its first-order change away from that row, the mixed derivative, gives its direction.
    """
    value, slope = bernstein(np.linspace(0.0, 1.0, steps + 1))
    points = np.einsum("ui,vj,ijk->uvk", value, value, patch)
    along_u = np.einsum("ui,vj,ijk->uvk", slope, value, patch)
    along_v = np.einsum("ui,vj,ijk->uvk", value, slope, patch)
    if (patch[0] == patch[0, 0]).all():
        along_u[0] = along_u[0].mean(axis=0)
        along_v[0] = np.einsum("i,vj,ijk->vk", slope[0], slope, patch)
    normals = np.cross(along_v, along_u)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    return points.reshape(-1, 3), normals.reshape(-1, 3)


def grid_faces(rows: int, columns: int) -> NDArray[np.int64]:
    """Return the (2·(rows - 1)·(columns - 1), 3) faces of a grid of points, rows × columns."""
    i = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (x.ravel() for x in (i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]))
    return np.stack([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)], axis=1).reshape(-1, 3)


def weld(points: Array, normals: Array, faces: NDArray[np.int64], tolerance: float) -> Triangles:
    """Join points that lie within about `tolerance`, average their normals, drop faces that lose their area."""
    keys = np.round(points / tolerance).astype(np.int64)
    _, first, where = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    where = where.reshape(-1)
    summed = np.zeros((len(first), 3))
    np.add.at(summed, where, normals)
    faces = where[faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    return points[first], summed / np.linalg.norm(summed, axis=1, keepdims=True), faces


def join(pieces: list[Triangles]) -> Triangles:
    """Return several meshes as one, without joining their vertices."""
    starts = np.cumsum([0] + [len(points) for points, _, _ in pieces])
    return (
        np.concatenate([points for points, _, _ in pieces]),
        np.concatenate([normals for _, normals, _ in pieces]),
        np.concatenate([faces + start for (_, _, faces), start in zip(pieces, starts[:-1], strict=True)]),
    )


def teapot(height: float = TEAPOT_HEIGHT, steps: int = TEAPOT_STEPS) -> Triangles:
    """Return the Utah teapot standing on y = 0, spout towards +x, facing outwards.

    Each of body, lid, handle and spout is one sheet without inner seams. As published, no part is closed:
    the lid rests loosely in the rim, and handle and spout end inside the body's wall.
    """
    patches = control_points()
    pieces = []
    for part in PARTS.values():
        sheets = []
        for index in part:
            points, normals = evaluate(patches[index], steps)
            sheets.append((points, normals, grid_faces(steps + 1, steps + 1)))
        pieces.append(weld(*join(sheets), tolerance=1e-6))
    points, normals, faces = join(pieces)
    # From z up to y up by a rotation about x, which keeps the orientation of faces.
    y_up = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    scale = height / np.ptp(points[:, 2])
    return scale * points @ y_up.T, normals @ y_up.T, faces


def sweep(
    width: float = 4.0, front: float = 1.6, back: float = 0.55, radius: float = 0.5, height: float = 1.8, arc: int = 64
) -> Triangles:
    """Return a backdrop: a floor at y = 0 from z = `front` back to z = -`back`, an arc, and a wall up to `height`.

    Args:
        width: along x, metres.
        front: where the floor begins.
        back: where the arc begins.
        radius: of the arc.
        height: of the wall's top.
        arc: edges along the arc.
    """
    angle = np.linspace(0.0, 0.5 * np.pi, arc + 1)
    across, up = np.cos(angle), np.sin(angle)
    y = np.concatenate([[0.0], radius * (1.0 - across), [height]])
    z = np.concatenate([[front], -back - radius * up, [-back - radius]])
    tilt = np.concatenate([[0.0], angle, [angle[-1]]])
    profile = np.stack([np.zeros_like(y), y, z], axis=1)
    normal = np.stack([np.zeros_like(y), np.cos(tilt), np.sin(tilt)], axis=1)
    points = profile[:, None] + np.array([[-0.5 * width, 0.0, 0.0], [0.5 * width, 0.0, 0.0]])
    return points.reshape(-1, 3), np.repeat(normal, 2, axis=0), grid_faces(len(y), 2)


def write_ply(path: Path, mesh: Triangles) -> None:
    """Write a little-endian binary PLY with normals, float32."""
    points, normals, faces = mesh
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment made by scripts/make_meshes.py\n"
        f"element vertex {len(points)}\n"
        + "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
        + f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = np.empty(len(faces), dtype=[("count", "u1"), ("index", "<i4", 3)])
    rows["count"], rows["index"] = 3, faces
    vertices = np.concatenate([points, normals], axis=1).astype("<f4")
    path.write_bytes(header.encode("ascii") + vertices.tobytes() + rows.tobytes())


def main(folder: Path) -> None:
    """Write every sample mesh into `folder`."""
    for name, mesh in (("teapot", teapot()), ("sweep", sweep())):
        path = folder / f"{name}.ply"
        write_ply(path, mesh)
        print(f"{path}: {len(mesh[2]):,} triangles, {path.stat().st_size / 1e3:,.0f} kB")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parent.parent / "meshes")
