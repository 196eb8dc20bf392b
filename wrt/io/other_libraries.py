"""Meshes and points of PyVista, VTK, Open3D, and of anything with arrays of vertices and faces, as trimesh objects.

They are told by their attributes: none of the libraries is imported.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, warn
from wrt.values import array


def as_trimesh(source: Any) -> Any:
    """Return a trimesh object with the content of `source`, or `source` itself if it is of no other library."""
    import trimesh

    if isinstance(source, trimesh.parent.Geometry):
        return source
    kind = type(source).__name__
    if hasattr(source, "to_legacy"):  # Open3D's tensors
        source = source.to_legacy()
    if hasattr(source, "triangles") and hasattr(source, "vertices"):
        return _of_open3d(source, kind)
    if hasattr(source, "extract_surface"):
        return _of_pyvista(source, kind)
    if hasattr(source, "GetPolys"):
        return _of_pyvista(_wrapped(source), kind)
    if hasattr(source, "vertices") and hasattr(source, "faces"):
        normals, colors = getattr(source, "vertex_normals", None), getattr(source, "vertex_colors", None)
        return _mesh(kind, source.vertices, source.faces, normals, colors)
    if hasattr(source, "points") and hasattr(source, "colors"):  # a cloud of Open3D
        return trimesh.PointCloud(_rows(kind, "points", source.points), colors=_codes(kind, source.colors))
    return source


def _of_open3d(source: Any, kind: str) -> Any:
    mesh = _mesh(kind, source.vertices, source.triangles, source.vertex_normals, source.vertex_colors)
    if source.has_triangle_uvs():  # for each corner: the mesh falls into its triangles, and is joined again
        import trimesh
        from PIL import Image

        corners = mesh.faces.reshape(-1)
        normals = np.asarray(source.vertex_normals)
        images = [image for image in map(np.asarray, source.textures) if image.size]
        if len(images) > 1:
            warn(f"{kind}: it has {len(images)} textures, and all of it has the first")
        mesh = _mesh(
            kind,
            mesh.vertices[corners],
            np.arange(len(corners)).reshape(-1, 3),
            normals[corners] if len(normals) else None,
        )
        image = Image.fromarray(images[0]) if images else None
        mesh.visual = trimesh.visual.TextureVisuals(uv=np.asarray(source.triangle_uvs), image=image)
    return mesh


def _of_pyvista(source: Any, kind: str) -> Any:
    """Return the surface of a data set of PyVista: points, triangles, normals, colours in RGB or RGBA."""
    import trimesh

    if not hasattr(source, "is_all_triangles"):
        source = source.extract_surface()
    if source.n_cells and not source.is_all_triangles:
        source = source.triangulate()
    points, faces = np.asarray(source.points), np.asarray(source.faces).reshape(-1, 4)[:, 1:]
    colors = None
    for values in (source.point_data, source.cell_data):
        for name in values.keys():  # noqa: SIM118 - PyVista's attributes iterate over values in some versions
            data = np.asarray(values[name])
            if data.ndim == 2 and data.dtype == np.uint8 and data.shape[1] in (3, 4) and values is source.point_data:
                colors = data
            elif name not in ("Normals", "TCoords", "Texture Coordinates") and not name.startswith("vtkOriginal"):
                warn(
                    f"{kind}: the values {name!r} are not drawn; give colours, such as scene.add(..., material='gold')"
                )
    normals = source.point_data.get("Normals")
    if not len(faces):
        return trimesh.PointCloud(_rows(kind, "points", points), colors=colors)
    return _mesh(kind, points, faces, normals, colors)


def _wrapped(source: Any) -> Any:
    """Return a data set of VTK as one of PyVista."""
    try:
        pyvista: Any = importlib.import_module("pyvista")
    except ImportError:
        raise InputError(f"{type(source).__name__}: objects of VTK are read by PyVista: pip install pyvista") from None
    return pyvista.wrap(source)


def _mesh(kind: str, vertices: Any, faces: Any, normals: Any = None, colors: Any = None) -> Any:
    import trimesh

    vertices, faces = _rows(kind, "vertices", vertices), array(np.asarray(faces), f"{kind}: faces")
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise InputError(f"{kind}: faces must be (F, 3) whole numbers, not {faces.shape} {faces.dtype}")
    if faces.size and (faces.min() < 0 or faces.max() >= len(vertices)):
        raise InputError(f"{kind}: faces name vertices beyond the {len(vertices)} that there are")
    normals = None if normals is None or not len(normals) else _rows(kind, "vertex_normals", normals)
    codes = None if colors is None else _codes(kind, colors)
    return trimesh.Trimesh(vertices, faces, vertex_normals=normals, vertex_colors=codes, process=False)


def _rows(kind: str, name: str, values: Any) -> NDArray[np.float64]:
    """Return (N, 3) numbers."""
    rows = array(np.asarray(values), f"{kind}: {name}", np.float64)
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise InputError(f"{kind}: {name} must be (N, 3), not {rows.shape}")
    return rows


def _codes(kind: str, colors: Any) -> NDArray[np.uint8] | None:
    """Return sRGB colours, from 0 to 1 or as codes, as codes; None if there are none."""
    values = array(np.asarray(colors), f"{kind}: colors")
    if not values.size:
        return None
    if values.dtype.kind == "f":
        values = np.rint(255.0 * values.clip(0.0, 1.0))
    return values.astype(np.uint8)
