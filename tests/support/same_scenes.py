"""Differences of two scenes, apart from the order of their shapes and triangles."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

import wrt
from wrt.scene.mesh import VERTEX_ATTRIBUTES


def differences(first: wrt.Scene, second: wrt.Scene) -> dict[str, float]:
    """Return the largest difference of each property that differs, by its name; inf if it is not a number.

    Names are such as "vertices", "normals", "material.base_color.factor" or "camera.fov_degrees". Vertices are
    compared in world space, relative to the size of the scene; vertex attributes are compared at the corners of
    triangles. Shapes are paired by their number of triangles and their position, triangles by their number.
    """
    found: dict[str, float] = {}

    def note(name: str, amount: float) -> None:
        if amount > 0.0:
            found[name] = max(found.get(name, 0.0), amount)

    for field in dataclasses.fields(wrt.Scene):
        if field.name not in ("shapes", "settings", "cameras"):
            _compare(field.name, getattr(first, field.name), getattr(second, field.name), note)
    if first.settings != second.settings:
        note("settings", np.inf)
    if len(first.shapes) != len(second.shapes):
        return {"number of shapes": np.inf}
    size = float(np.linalg.norm(np.subtract(*first.bounds)))
    for a, b in zip(*(sorted(scene.shapes, key=_place) for scene in (first, second)), strict=True):
        one, two = a.mesh_at(0.0), b.mesh_at(0.0)
        if len(one.faces) != len(two.faces):
            return {"number of triangles": np.inf}
        for name in ("vertices", *VERTEX_ATTRIBUTES):
            values = [getattr(mesh, name) for mesh in (one, two)]
            if any(value is None for value in values):
                note(name, np.inf if values[0] is not values[1] else 0.0)
                continue
            x, y = (value[_corners(mesh)].astype(float) for value, mesh in zip(values, (one, two), strict=True))
            unit = size if name == "vertices" else 1.0
            note(name, np.inf if x.shape != y.shape else float(np.abs(x - y).max()) / unit)
        for name in ("material", "emission", "two_sided_emission", "double_sided", "edges", "shadow_catcher"):
            _compare(name, getattr(a, name), getattr(b, name), note)
    return found


def _corners(mesh: wrt.Mesh) -> np.ndarray:
    """Return (M, 3) faces that start at the corner with the lowest coordinates, since readers differ in this."""
    x, y, z = np.moveaxis(mesh.vertices[mesh.faces], 2, 0)
    first = np.lexsort((z, y, x), axis=-1)[:, :1]
    return np.take_along_axis(mesh.faces, (first + np.arange(3)) % 3, axis=1)


def _place(shape: wrt.Shape) -> tuple[Any, ...]:
    corners = shape.mesh_at(0.0).vertices[shape.mesh.faces].astype(float)
    return len(shape.mesh.faces), *corners.mean(axis=(0, 1)).round(3).tolist(), shape.name.rpartition(": ")[2]


def _compare(name: str, a: Any, b: Any, note: Any) -> None:
    if type(a) is not type(b):
        note(name, np.inf)
    elif dataclasses.is_dataclass(a):
        for field in dataclasses.fields(a):
            if field.name != "name":
                _compare(f"{name}.{field.name}", getattr(a, field.name), getattr(b, field.name), note)
    elif isinstance(a, (list, tuple)) and not all(isinstance(x, (int, float)) for x in (*a, *b)):
        if len(a) != len(b):
            note(name, np.inf)
        else:
            for x, y in zip(a, b, strict=True):
                _compare(name, x, y, note)
    elif isinstance(a, (float, tuple, list, np.ndarray)) and np.shape(a) == np.shape(b):
        note(name, float(np.abs(np.subtract(a, b, dtype=float)).max(initial=0.0)))
    elif isinstance(a, np.ndarray) or a != b:
        note(name, np.inf)
