"""Meshes and points of PyVista, VTK, Open3D, and of anything with arrays of vertices and faces, as trimesh objects.

They are recognised by their attributes: none of the libraries is imported.
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
    if hasattr(source, "points") and hasattr(source, "colors") and not hasattr(source, "lines"):  # a cloud of Open3D
        return trimesh.PointCloud(_rows(kind, "points", source.points), colors=_codes(kind, source.colors))
    return source


def _of_open3d(source: Any, kind: str) -> Any:
    """Return a mesh, or a scene with one mesh per texture; the first row of a texture lies at v = 0."""
    import trimesh

    mesh = _mesh(kind, source.vertices, source.triangles, source.vertex_normals, source.vertex_colors)
    if not source.has_triangle_uvs():
        return mesh
    from PIL import Image

    normals, uvs = np.asarray(source.vertex_normals), np.asarray(source.triangle_uvs).reshape(-1, 3, 2)
    numbers = np.asarray(source.triangle_material_ids)
    numbers = numbers if len(numbers) == len(mesh.faces) else np.zeros(len(mesh.faces), int)
    colors = mesh.visual.vertex_colors if mesh.visual.kind == "vertex" else None
    parts = []
    for number in np.unique(numbers):
        # Coordinates are those of corners: the mesh falls into its triangles, and is joined again.
        chosen = numbers == number
        corners = mesh.faces[chosen].reshape(-1)
        part = _mesh(
            kind,
            mesh.vertices[corners],
            np.arange(len(corners)).reshape(-1, 3),
            normals[corners] if len(normals) else None,
        )
        image = source.textures[number] if number < len(source.textures) else None
        if image is None or image.is_empty():
            part.visual = _laid(uvs[chosen].reshape(-1, 2), None if colors is None else colors[corners])
        else:
            pixels = Image.fromarray(np.asarray(image)[::-1])
            part.visual = trimesh.visual.TextureVisuals(uv=uvs[chosen].reshape(-1, 2), image=pixels)
        parts.append(part)
    return parts[0] if len(parts) == 1 else trimesh.Scene(parts)


def _of_pyvista(source: Any, kind: str) -> Any:
    """Return the surface of a data set of PyVista: points, triangles, normals, colours and texture coordinates."""
    import trimesh

    if not hasattr(source, "is_all_triangles"):
        source = _surface(source)
    if source.n_lines:
        warn(f"{kind}: its lines have no surface and are left out")
    cloud = source
    if source.n_cells and not source.is_all_triangles:
        source = source.triangulate()  # leaves out points without faces
    points, faces = np.asarray(source.points), np.asarray(source.faces).reshape(-1, 4)[:, 1:]
    at_points, at_cells = source.point_data, source.cell_data
    colors, of_faces = _colors_of(at_points), _colors_of(at_cells)
    if (name := source.active_scalars_name) and colors is None and of_faces is None:
        warn(f"{kind}: the values {name!r} are not drawn; give colours, such as scene.add(..., material='gold')")
    if not len(faces):
        rows = _rows(kind, "points", cloud.points) if cloud.n_verts else ()
        return trimesh.PointCloud(rows, colors=_colors_of(cloud.point_data))
    mesh = _mesh(kind, points, faces, at_points.get("Normals"), colors)
    if colors is None and of_faces is not None and len(of_faces) == len(faces):  # not with lines and points before
        mesh.visual.face_colors = of_faces
    elif (uvs := source.active_texture_coordinates) is not None:
        mesh.visual = _laid(np.asarray(uvs)[:, :2], colors)
    return mesh


def _surface(source: Any) -> Any:
    try:
        return source.extract_surface(algorithm=None)
    except TypeError:  # PyVista before 0.47
        return source.extract_surface()


def _colors_of(data: Any) -> NDArray[np.uint8] | None:
    """Return the last colours, RGB or RGBA, among attributes of PyVista; None if there are none."""
    # PyVista's attributes iterate over values in some versions.
    arrays = [np.asarray(data[name]) for name in data.keys()]  # noqa: SIM118
    found = [each for each in arrays if each.dtype == np.uint8 and each.ndim == 2 and each.shape[1] in (3, 4)]
    return found[-1] if found else None


def _laid(uvs: Any, colors: Any) -> Any:
    """Return texture coordinates without a texture, for a material that is given later, and colours of vertices."""
    import trimesh

    visual = trimesh.visual.TextureVisuals(uv=uvs)
    visual.material = None
    if colors is not None:
        visual.vertex_attributes["color"] = colors
    return visual


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
