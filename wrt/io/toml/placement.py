"""Instances, motions and deformations of shapes in scene files."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io import memory_limits
from wrt.io.npy import read_array, read_arrays
from wrt.io.safe_read import naming_file, read_file
from wrt.io.toml import scene_keys
from wrt.io.toml.tables import Table, TableReader, numbers_of, table_of, text_of
from wrt.io.volume.read import load_density, read_volume
from wrt.linalg import product
from wrt.scene.deformation import Deformation
from wrt.scene.medium import DensityGrid
from wrt.scene.mesh import Mesh, merge
from wrt.scene.motion import Motion
from wrt.scene.scene import Shape
from wrt.values import Vec3, array, number, vector

Transform = NDArray[np.float64] | Motion | None


def read_places(reader: TableReader, table: dict[str, Any]) -> list[Transform]:
    """Return the transforms of a shape: one, or one for each of its `instances`."""
    if "instances" not in table:
        return [_motion(reader, table)]
    if "motion" in table:
        raise InputError("has both motion and instances; give each instance a motion of its own")
    if isinstance(table["instances"], str):
        with reader.at("instances"):
            return list(_matrices(reader.file(table["instances"])))
    places: list[Transform] = []

    def add(place: dict[str, Any]) -> None:
        reader.check_table(place, scene_keys.INSTANCE)
        places.append(after(_motion(reader, place), reader.transform(place)))

    reader.each(table, "instances", add)
    if not places:
        raise InputError("instances must not be empty")
    return places


def _motion(reader: TableReader, table: dict[str, Any]) -> Motion | None:
    return reader.read(table, "motion", lambda value: read_motion(reader, table_of(value), (0.0, 0.0, 0.0)))


def read_motion(reader: TableReader, table: Table, center: Vec3) -> Motion:
    """Return the motion of a table: keyframes, or one rotation and translation at constant speed.

    Keyframes have a time and a transform as shapes do, which scales and rotates about `center`.
    """
    pivot = np.array(vector(table.get("center", center), "center"))
    if "times" in table:
        reader.check_table(table, scene_keys.EVEN_MOTION)
        turn = table_of(table.get("rotate", {"axis": [0.0, 1.0, 0.0], "degrees": 0.0}))
        with reader.at("rotate"):
            reader.check_table(turn, scene_keys.TURN)
        offset = vector(table.get("translate", [0.0, 0.0, 0.0]), "translate")
        return Motion.rotation(turn["axis"], turn["degrees"], pivot, numbers_of(table["times"], "times"), offset)
    reader.check_table(table, scene_keys.KEYFRAMES)
    times: list[float] = []
    matrices: list[NDArray[np.float64]] = []

    def add(key: Table) -> None:
        reader.check_table(key, scene_keys.KEYFRAME, fields=scene_keys.MATRIX_KEYFRAME)
        times.append(number(key["time"], "time"))
        if "matrix" in key:
            reader.check_table(key, scene_keys.MATRIX_KEYFRAME)
            matrices.append(_affine(key["matrix"]))
            return
        matrices.append(reader.transform(key))
        matrices[-1][:3, 3] += pivot - product(matrices[-1][:3, :3], pivot)

    reader.each(table, "keys", add)
    return Motion(np.array(times), np.array(matrices).reshape(-1, 4, 4), tuple(pivot))


def _affine(rows: Any) -> NDArray[np.float64]:
    """Return the (4, 4) matrix whose first three rows are given."""
    values = [numbers_of(row, f"matrix[{i}]") for i, row in enumerate(rows)] if isinstance(rows, list) else []
    if [len(row) for row in values] != [4, 4, 4]:
        raise InputError("matrix must be three rows of four numbers")
    return np.array([*values, [0.0, 0.0, 0.0, 1.0]])


def _matrices(file: Path) -> NDArray[np.float64]:
    with naming_file(file):
        matrices = array(read_array(read_file(file)), "matrices", np.float64)
        memory_limits.take(memory_limits.SHAPES, len(matrices) * memory_limits.BYTES_PER_SHAPE)
    if matrices.ndim != 3 or matrices.shape[1:] != (4, 4) or len(matrices) == 0:
        raise InputError(f"{file}: must be (N, 4, 4) matrices, not an array of {matrices.shape}")
    return matrices


def after(place: Transform, first: Transform) -> Transform:
    """Return the composition of two transforms, `first` applied first. As a motion, `place` must be rigid."""
    if place is None or first is None:
        return place if first is None else first
    assert not isinstance(first, Motion)
    return place.after(first) if isinstance(place, Motion) else product(place, first)


def joined(shapes: list[Shape]) -> list[Shape]:
    """Merge the shapes that will share one material; instances stay as they are."""
    loose = [shape.mesh for shape in shapes if shape.transform is None]
    placed = [shape for shape in shapes if shape.transform is not None]
    return [Shape(merge(loose, "mesh")), *placed] if len(loose) > 1 else shapes


def read_deformation(
    reader: TableReader, table: dict[str, Any], mesh: Mesh, place: Callable[[Mesh], Mesh]
) -> Deformation | None:
    """Return the deformation of a mesh, from an archive or from mesh files, which `place` transforms like the shape."""
    if "deformation" not in table:
        return None
    with reader.at("deformation"):
        keyframes = table_of(table["deformation"])
        if "file" in keyframes:
            reader.check_table(keyframes, scene_keys.DEFORMATION_ARCHIVE)
            with reader.at("file"):
                archive = reader.file(keyframes["file"])
                arrays = read_arrays(archive, ("times", "vertices"), ("normals",))
                with naming_file(archive):
                    return Deformation(**arrays)
        reader.check_table(keyframes, scene_keys.DEFORMATION_FILES)
        files, times = keyframes["files"], keyframes["times"]
        if not isinstance(files, list) or not isinstance(times, list) or len(files) != len(times):
            raise InputError("files and times must be two arrays of one length")
        keys = []
        for i, file in enumerate(files):
            with reader.at(f"files[{i}]"):
                from wrt.io.load_mesh import load_mesh

                key = load_mesh(reader.file(file), smooth_degrees=0.0)
                if len(key.vertices) != len(mesh.vertices):
                    raise InputError(
                        f"{file} has {len(key.vertices)} vertices, the shape {len(mesh.vertices)}; "
                        "without normals in its file the shape needs smooth = false"
                    )
                memory_limits.take(memory_limits.MESHES, memory_limits.size_of(key))
                keys.append(place(key))
        normals = None
        if mesh.normals is not None and all(key.normals is not None for key in keys):
            normals = np.stack([key.normals for key in keys if key.normals is not None])
        return Deformation(times, np.stack([key.vertices for key in keys]), normals)  # type: ignore[arg-type]


def read_density(reader: TableReader, table: dict[str, Any]) -> DensityGrid:
    """Return the density of a medium from files."""
    reader.check_table(table, scene_keys.DENSITY, fields=scene_keys.DENSITY_OWN)
    options = {key: table[key] for key in scene_keys.DENSITY_OWN if key in table}
    for key in (each for each in ("albedo", "emission") if each in table):  # otherwise the file's own count
        options[key] = reader.read(table, key, lambda value: read_volume(reader.file(value)).values)
    grid = reader.read(table, "grid", text_of)
    with reader.at("file"):
        density = load_density(reader.file(table["file"]), grid=grid, **options)
    if not scene_keys.TRANSFORM.keys() & table.keys():
        return density
    in_file = np.eye(4) if density.transform is None else density.transform
    return dataclasses.replace(density, transform=product(reader.transform(table), in_file))
