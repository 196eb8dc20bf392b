"""Mitsuba's binary meshes are read whole, in every version, or refused in one line; attributes and curves."""

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from support.mesh_files import INDICES, XYZ, ply
from support.meshes import write

import wrt
from wrt.errors import InputWarning

VERTICES = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.5]], np.float64)
FACES = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
NORMALS = np.array([[0, 0, 1], [0, 0.6, 0.8], [0, 0, 1], [0.6, 0, 0.8]])
UVS = VERTICES[:, :2] * 0.5
COLORS = np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6], [0.7, 0.8, 0.9], [1.0, 0.0, 0.5]])
HEAT = np.array([[0.25], [0.75]])


def header(version: int) -> bytes:
    return struct.pack("<HH", 0x041C, version)


def packed(content: bytes, flags: int = 0x1000, name: bytes = b"\0", level: int = -1) -> bytes:
    return header(4) + zlib.compress(struct.pack("<I", flags) + name + content, level)


def mesh(version: int = 4, *, double: bool = False, flags: int = 0x1 | 0x2 | 0x8, shift: float = 0.0) -> bytes:
    """A mesh of version 3 or 4 as Mitsuba 0.5 documents it."""
    kind = "<f8" if double else "<f4"
    arrays = [VERTICES + shift]
    arrays += [array for bit, array in ((0x1, NORMALS), (0x2, UVS), (0x8, COLORS)) if flags & bit]
    data = struct.pack("<I", flags | (0x2000 if double else 0x1000)) + (b"patch\0" if version == 4 else b"")
    data += struct.pack("<QQ", len(VERTICES), len(FACES)) + b"".join(a.astype(kind).tobytes() for a in arrays)
    return header(version) + zlib.compress(data + FACES.astype("<u4").tobytes())


def newest(attributes: dict[str, np.ndarray]) -> bytes:
    """A mesh of version 5 as Mitsuba 3.9 documents it."""
    data = struct.pack("<II", 0x1 | 0x4 | 0x10 | 0x1000, 5) + b"patch" + struct.pack("<QQQQ", 4, 2, 4, 0)
    data += np.concatenate([VERTICES, NORMALS, UVS], axis=1).astype("<f4").tobytes()
    data += np.concatenate([FACES, np.zeros((2, 1), np.uint32)], axis=1).astype("<u4").tobytes()
    data += np.arange(4, dtype="<u4").tobytes() + struct.pack("<I", len(attributes))
    for name, values in attributes.items():
        data += struct.pack("<I", len(name)) + name.encode() + struct.pack("<BI", 0, values.shape[1])
        data += values.astype("<f4").tobytes()
    return header(5) + zlib.compress(data)


def together(*meshes: bytes, version: int = 4) -> bytes:
    """Several meshes in one file, with the table at its end."""
    starts = np.cumsum([0, *map(len, meshes)])[:-1]
    table = starts.astype("<u4" if version == 3 else "<u8").tobytes()
    return b"".join(meshes) + table + struct.pack("<I", len(meshes))


def attribute(name: str) -> str:
    return f"""<bsdf type="twosided"><bsdf type="diffuse"><texture type="mesh_attribute" name="reflectance">
        <string name="name" value="{name}"/></texture></bsdf></bsdf>"""


def shape_of(folder: Path, kind: str, inside: str) -> wrt.Shape:
    text = f'<scene version="3.0.0"><shape type="{kind}">{inside}</shape></scene>'
    return wrt.load(write(folder, "scene.xml", text)).shapes[0]


def read(folder: Path, data: bytes, index: int = 0, color: str = "", extra: str = "") -> wrt.Mesh:
    """Return a mesh of a file, whose colours are an attribute."""
    write(folder, "a.serialized", data)
    inside = f'<string name="filename" value="a.serialized"/><integer name="shape_index" value="{index}"/>{extra}'
    return shape_of(folder, "serialized", inside + (attribute(color) if color else "")).mesh


@pytest.mark.parametrize(
    ("version", "double", "flags"),
    [(3, False, 0xB), (4, True, 0xB), (4, False, 0x0), (4, False, 0x2), (4, False, 0x10), (4, False, 0x9)],
)
def test_arrays_of_each_mesh_are_read_as_its_flags_say(version, double, flags, tmp_path):
    meshes = (mesh(version, double=double, flags=flags, shift=shift) for shift in (0.0, 1.0))
    data = together(*meshes, version=version)
    found = read(tmp_path, data, 1, "vertex_color" if flags & 0x8 else "")
    np.testing.assert_allclose(found.vertices[found.faces], (VERTICES + 1.0)[FACES], atol=1e-6)
    for flag, array, values in ((0x1, found.normals, NORMALS), (0x2, found.uvs, UVS), (0x8, found.colors, COLORS)):
        if flags & flag:
            np.testing.assert_allclose(array, values, atol=1e-6)
        else:  # normals are made where flags do not forbid them
            assert (array is None) == (flag != 0x1 or bool(flags & 0x10))
    with pytest.raises(wrt.InputError, match="'shape_index' is 2, but its meshes are numbered from 0 to 1"):
        read(tmp_path, data, 2)
    assert read(tmp_path, data, extra='<boolean name="face_normals" value="true"/>').normals is None


def test_the_newest_version_has_attributes_of_faces_and_vertices(tmp_path):
    data = newest({"vertex_tint": COLORS, "face_heat": HEAT})
    found = read(tmp_path, data, color="vertex_tint")
    for array, values in ((found.vertices, VERTICES), (found.uvs, UVS), (found.colors, COLORS)):
        np.testing.assert_allclose(array, values, atol=1e-6)
    assert found.normals is None  # as its flags say
    found = read(tmp_path, data, color="face_heat")
    np.testing.assert_allclose(found.colors[found.faces][..., 0], np.repeat(HEAT, 3, axis=1), atol=1e-6)
    with pytest.warns(InputWarning, match="has no attribute 'vertex_tin'"):
        read(tmp_path, data, color="vertex_tin")


WHOLE = together(mesh(), mesh(shift=1.0))
CORNERS = VERTICES.astype("<f4").tobytes() + b"\xff" * 24


def test_damaged_files_are_refused(tmp_path):
    for data, index, message in (
        (b"solid", 0, "not a serialized mesh"),
        (header(7) + b"abcdefgh", 0, "version 7"),
        (WHOLE[:60], 0, "truncated"),
        (WHOLE[:-4], 1, "more than the file can hold|numbered from 0|begins at byte"),
        (WHOLE[:-4] + struct.pack("<I", 2**32 - 1), 1, "more than the file can hold"),
        (packed(struct.pack("<QQ", 60_000_000, 1) + bytes(2**20), level=9), 0, "truncated"),
        (packed(struct.pack("<QQ", 4, 2) + CORNERS), 0, "a face names vertex"),
    ):
        with pytest.raises(wrt.InputError, match=rf"a\.serialized: .*({message})[^\n]*$"):
            read(tmp_path, data, index)


def test_attributes_of_ply_have_mitsuba_names(tmp_path):
    kinds = *XYZ, "float heat_0", "float heat_1", "float heat_2"
    vertices = [(*point, *color) for point, color in zip(VERTICES.tolist(), COLORS.tolist(), strict=True)]
    face = [((0, 1, 2), 0.2, 0.4, 0.6)]
    elements = ("vertex", kinds, vertices), ("face", (INDICES, "float r", "float g", "float b"), face)
    write(tmp_path, "a.ply", ply("ascii", *elements))
    for name, expected in (("vertex_heat", COLORS[:3]), ("face_color", [[0.2, 0.4, 0.6]] * 3)):
        found = shape_of(tmp_path, "ply", '<string name="filename" value="a.ply"/>' + attribute(name)).mesh
        np.testing.assert_allclose(found.colors[found.faces][0], expected, atol=1e-6)


def test_curves_are_tubes(tmp_path):
    def tube(kind, text):
        write(tmp_path, "line.txt", text)
        return shape_of(tmp_path, kind, '<string name="filename" value="line.txt"/>').mesh

    low, high = tube("linearcurve", "0 0 0 0.1\n1 0 0 0.1\n\n0 0 1 0.2\n0 1 1 0.1\n").bounds
    np.testing.assert_allclose([low, high], [[-0.2, -0.2, -0.1], [1.1, 1.1, 1.2]], atol=2e-3)
    points = np.array([[0, 0, 0], [1, 0, 0.5], [2, 1, 0], [3, 0, 0], [4, 0, 1.0]])
    found = tube("bsplinecurve", "\n".join(f"{x} {y} {z} 0.05" for x, y, z in points))
    # Its ends are those of the spline, its normals point away from the spline, and its faces outwards.
    start = (points[0] + 4 * points[1] + points[2]) / 6
    assert np.linalg.norm(found.vertices - start, axis=1).min() == pytest.approx(0.05, rel=1e-3)
    a, b, c = np.moveaxis(found.vertices[found.faces].astype(np.float64), 1, 0)
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), found.normals[found.faces[:, 0]]) > 0.0).all()
    with pytest.raises(wrt.InputError, match=r"line 2: a point of a curve is"):
        tube("bsplinecurve", "0 0 0 1\n1 x 0 1\n")
