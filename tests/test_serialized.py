"""Mitsuba's binary meshes are read whole, in every version, or refused in one line."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wrt
from wrt.io.mitsuba.serialized import read_serialized

VERTICES = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.5]], np.float64)
FACES = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
NORMALS = np.array([[0, 0, 1], [0, 0.6, 0.8], [0, 0, 1], [0.6, 0, 0.8]])
UVS = VERTICES[:, :2] * 0.5
COLORS = np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6], [0.7, 0.8, 0.9], [1.0, 0.0, 0.5]])


def header(version: int) -> bytes:
    return struct.pack("<HH", 0x041C, version)


def mesh(version: int = 4, *, double: bool = False, flags: int = 0x1 | 0x2 | 0x8, shift: float = 0.0) -> bytes:
    """A mesh of version 3 or 4 as Mitsuba 0.5 documents it."""
    kind = "<f8" if double else "<f4"
    arrays = [VERTICES + shift]
    arrays += [array for bit, array in ((0x1, NORMALS), (0x2, UVS), (0x8, COLORS)) if flags & bit]
    data = struct.pack("<I", flags | (0x2000 if double else 0x1000))
    data += b"patch\0" if version == 4 else b""
    data += struct.pack("<QQ", len(VERTICES), len(FACES)) + b"".join(a.astype(kind).tobytes() for a in arrays)
    return header(version) + zlib.compress(data + FACES.astype("<u4").tobytes())


def packed(attributes: dict[str, np.ndarray]) -> bytes:
    """A mesh of version 5 as Mitsuba 3.9 documents it."""
    records = np.concatenate([VERTICES, NORMALS, UVS], axis=1).astype("<f4")
    faces = np.concatenate([FACES, np.zeros((2, 1), np.uint32)], axis=1).astype("<u4")
    data = struct.pack("<II", 0x1 | 0x4 | 0x10 | 0x1000, 5) + b"patch" + struct.pack("<QQQQ", 4, 2, 4, 0)
    data += (
        records.tobytes() + faces.tobytes() + np.arange(4, dtype="<u4").tobytes() + struct.pack("<I", len(attributes))
    )
    for name, values in attributes.items():
        data += struct.pack("<I", len(name)) + name.encode() + struct.pack("<BI", 0, values.shape[1])
        data += values.astype("<f4").tobytes()
    return header(5) + zlib.compress(data)


def together(*meshes: bytes, version: int = 4) -> bytes:
    """Several meshes in one file, with the table at its end."""
    starts = np.cumsum([0, *map(len, meshes)])[:-1]
    table = starts.astype("<u4" if version == 3 else "<u8").tobytes()
    return b"".join(meshes) + table + struct.pack("<I", len(meshes))


def read(data: bytes, index: int = 0) -> Any:
    return read_serialized(Path("a.serialized"), data, index)


@pytest.mark.parametrize("double", [False, True])
@pytest.mark.parametrize("version", [3, 4])
def test_all_arrays_are_read(version: int, double: bool) -> None:
    found = read(together(mesh(version, double=double), version=version))
    np.testing.assert_allclose(found.part.vertices, VERTICES, atol=1e-7)
    np.testing.assert_array_equal(found.part.faces, FACES)
    np.testing.assert_allclose(found.part.normals, NORMALS, atol=1e-7)
    np.testing.assert_allclose(found.part.uvs, UVS, atol=1e-7)
    np.testing.assert_allclose(found.attributes["vertex_color"], COLORS, atol=1e-7)
    assert found.part.name == ("patch" if version == 4 else "a")
    assert not found.face_normals


@pytest.mark.parametrize("flags", [0, 0x1, 0x2, 0x8, 0x10, 0x1 | 0x8])
def test_flags_say_which_arrays_there_are(flags: int) -> None:
    found = read(together(mesh(flags=flags)))
    assert (found.part.normals is not None) == bool(flags & 0x1)
    assert (found.part.uvs is not None) == bool(flags & 0x2)
    assert ("vertex_color" in found.attributes) == bool(flags & 0x8)
    assert found.face_normals == bool(flags & 0x10)
    np.testing.assert_array_equal(found.part.faces, FACES)


def test_the_packed_version_with_attributes() -> None:
    heat = np.array([[0.25], [0.75]])
    found = read(packed({"vertex_tint": COLORS, "face_heat": heat}))
    np.testing.assert_allclose(found.part.normals, NORMALS, atol=1e-7)
    np.testing.assert_allclose(found.part.uvs, UVS, atol=1e-7)
    np.testing.assert_allclose(found.attributes["vertex_tint"], COLORS, atol=1e-7)
    np.testing.assert_array_equal(found.attributes["face_heat"], heat)
    assert found.face_normals


@pytest.mark.parametrize("version", [3, 4])
def test_each_mesh_of_a_file(version: int) -> None:
    data = together(*(mesh(version, shift=float(k)) for k in range(3)), version=version)
    for k in range(3):
        np.testing.assert_allclose(read(data, k).part.vertices, VERTICES + k, atol=1e-6)
    with pytest.raises(wrt.InputError, match="'shape_index' is 3, but its meshes are numbered from 0 to 2"):
        read(data, 3)


WHOLE = together(mesh(), mesh(shift=1.0))
HUGE = header(4) + zlib.compress(struct.pack("<I", 0x1000) + b"\0" + struct.pack("<QQ", 2**40, 2**40))
BOMB = header(4) + zlib.compress(
    struct.pack("<I", 0x1000) + b"\0" + struct.pack("<QQ", 60_000_000, 1) + bytes(2**20), 9
)
WRONG = header(4) + zlib.compress(
    struct.pack("<I", 0x1000) + b"\0" + struct.pack("<QQ", 4, 2) + VERTICES.astype("<f4").tobytes() + b"\xff" * 24
)


@pytest.mark.parametrize(
    ("data", "index", "message"),
    [
        (b"solid", 0, "not a serialized mesh"),
        (header(7) + b"abcdefgh", 0, "version 7"),
        (WHOLE[:60], 0, "truncated"),
        (WHOLE[:-4], 1, "more than the file can hold|numbered from 0|begins at byte"),
        (header(4) + b"\x78\x9cgarbage!", 0, "cannot be decompressed"),
        (WHOLE[:-12] + struct.pack("<QI", 2**63, 2), 1, "begins at byte"),
        (WHOLE[:-4] + struct.pack("<I", 2**32 - 1), 1, "more than the file can hold"),
        (HUGE, 0, "truncated"),
        (BOMB, 0, "truncated"),
        (WRONG, 0, "a face names vertex"),
    ],
)
def test_damaged_files_are_refused(data: bytes, index: int, message: str) -> None:
    with pytest.raises(wrt.InputError, match=message) as error:
        read(data, index)
    assert "\n" not in str(error.value)
    assert str(error.value).startswith("a.serialized: ")


def test_truncation_and_flipped_bytes_never_surprise() -> None:
    random = np.random.default_rng(5)
    for size in range(0, len(WHOLE), 7):
        for index in (0, 1):
            _either(WHOLE[:size], index)
    for _ in range(300):
        data = bytearray(WHOLE)
        for place in random.integers(0, len(data), 3):
            data[place] = random.integers(0, 256)
        _either(bytes(data), int(random.integers(0, 2)))


def _either(data: bytes, index: int) -> None:
    try:
        read(data, index)
    except wrt.InputError as error:
        message = str(error)
    else:
        return
    assert "\n" not in message


LAMP = '<ref id="lamp"/>'


def scene(shape: str, bsdf: str = "") -> str:
    return f"""<scene version="3.0.0">
    <integrator type="path"/>
    <sensor type="perspective" id="a">
        <transform name="to_world"><lookat origin="0,0,4" target="0,0,0" up="0,1,0"/></transform>
        <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="12"/></film>
    </sensor>
    <sensor type="orthographic" id="b">
        <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/></film>
    </sensor>
    <emitter type="area" id="lamp"><rgb name="radiance" value="1,2,3"/></emitter>
    <shape {shape}{bsdf}</shape>
</scene>"""


def loaded(tmp_path: Path, text: str, **options: Any) -> wrt.Scene:
    (tmp_path / "scene.xml").write_text(text)
    return wrt.load(tmp_path / "scene.xml", **{"sensor": 0, **options})


def test_a_scene_takes_a_mesh_by_its_index(tmp_path: Path) -> None:
    (tmp_path / "a.serialized").write_bytes(WHOLE)
    shape = 'type="serialized"><string name="filename" value="a.serialized"/><integer name="shape_index" value="1"/>'
    found = loaded(tmp_path, scene(shape, LAMP)).shapes[0]
    np.testing.assert_allclose(found.mesh.vertices, VERTICES + 1.0, atol=1e-6)
    assert found.emission == pytest.approx((1.0, 2.0, 3.0))
    flat = loaded(tmp_path, scene(shape + '<boolean name="face_normals" value="true"/>', LAMP))
    assert flat.shapes[0].mesh.normals is None


def attribute(name: str) -> str:
    return f"""<bsdf type="twosided"><bsdf type="diffuse"><texture type="mesh_attribute" name="reflectance">
        <string name="name" value="{name}"/></texture></bsdf></bsdf><ref id="lamp"/>"""


def test_attributes_of_faces_and_vertices_are_colors(tmp_path: Path) -> None:
    heat = np.array([[0.25], [0.75]])
    (tmp_path / "a.serialized").write_bytes(packed({"vertex_tint": COLORS, "face_heat": heat}))
    shape = 'type="serialized"><string name="filename" value="a.serialized"/>'
    colors = loaded(tmp_path, scene(shape, attribute("vertex_tint"))).shapes[0].mesh.colors
    np.testing.assert_allclose(colors, COLORS, atol=1e-6)
    found = loaded(tmp_path, scene(shape, attribute("face_heat"))).shapes[0].mesh
    assert found.colors is not None
    np.testing.assert_allclose(found.colors[found.faces][..., 0], np.repeat(heat, 3, axis=1), atol=1e-6)
    with pytest.warns(wrt.errors.InputWarning, match="has no attribute 'vertex_tin'"):
        loaded(tmp_path, scene(shape, attribute("vertex_tin")))


PLY = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
property float heat_0
property float heat_1
property float heat_2
element face 1
property list uchar int vertex_indices
property float r
property float g
property float b
end_header
0 0 0 0.1 0.2 0.3
1 0 0 0.4 0.5 0.6
0 1 0 0.7 0.8 0.9
3 0 1 2 0.2 0.4 0.6
"""


def test_attributes_of_ply_have_mitsuba_names(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_text(PLY)
    shape = 'type="ply"><string name="filename" value="a.ply"/>'
    colors = loaded(tmp_path, scene(shape, attribute("vertex_heat"))).shapes[0].mesh.colors
    np.testing.assert_allclose(colors, [[0.1, 0.2, 0.3], [0.4, 0.5, 0.6], [0.7, 0.8, 0.9]], atol=1e-6)
    colors = loaded(tmp_path, scene(shape, attribute("face_color"))).shapes[0].mesh.colors
    np.testing.assert_allclose(colors, [[0.2, 0.4, 0.6]] * 3, atol=1e-6)


def test_a_sensor_is_chosen_by_its_number(tmp_path: Path) -> None:
    text = scene('type="cube">', LAMP)
    assert isinstance(loaded(tmp_path, text, sensor=0).camera, wrt.PerspectiveCamera)
    second = loaded(tmp_path, text, sensor=1)
    assert isinstance(second.camera, wrt.OrthographicCamera)
    assert (second.settings.width, second.settings.height) == (8, 8)
    with pytest.raises(wrt.InputError, match="there is no sensor 2; its sensors are numbered from 0 to 1"):
        loaded(tmp_path, text, sensor=2)
    with pytest.warns(wrt.errors.InputWarning, match="the first of 2 sensors is the camera"):
        loaded(tmp_path, text, sensor=None)
    with pytest.raises(wrt.InputError, match="only for Mitsuba scenes"):
        wrt.load("cornell-box", sensor=0)


def test_a_mask_has_holes_from_behind_too(tmp_path: Path) -> None:
    mask = '<bsdf type="mask"><float name="opacity" value="0.25"/><bsdf type="diffuse"/></bsdf>'
    found = loaded(tmp_path, scene('type="rectangle">', mask + LAMP)).shapes[0].material
    assert [part.opacity for part in found.parts] == [0.25, 0.25]


def test_curves_are_tubes(tmp_path: Path) -> None:
    (tmp_path / "line.txt").write_text("0 0 0 0.1\n1 0 0 0.1\n\n0 0 1 0.2\n0 1 1 0.1\n")
    lines = (
        loaded(tmp_path, scene('type="linearcurve"><string name="filename" value="line.txt"/>', LAMP)).shapes[0].mesh
    )
    low, high = lines.bounds
    np.testing.assert_allclose(low, [-0.2, -0.2, -0.1], atol=2e-3)
    np.testing.assert_allclose(high, [1.1, 1.1, 1.2], atol=2e-3)
    points = np.array([[0, 0, 0], [1, 0, 0.5], [2, 1, 0], [3, 0, 0], [4, 0, 1.0]])
    (tmp_path / "spline.txt").write_text("\n".join(f"{x} {y} {z} 0.05" for x, y, z in points))
    tube = (
        loaded(tmp_path, scene('type="bsplinecurve"><string name="filename" value="spline.txt"/>', LAMP)).shapes[0].mesh
    )
    # Its ends are those of the spline, its normals point away from the spline, and its faces outwards.
    start = (points[0] + 4 * points[1] + points[2]) / 6
    assert np.linalg.norm(tube.vertices - start, axis=1).min() == pytest.approx(0.05, rel=1e-3)
    corners = tube.vertices[tube.faces].astype(np.float64)
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("ij,ij->i", faces, tube.normals[tube.faces[:, 0]]) > 0.0).all()
    (tmp_path / "spline.txt").write_text("0 0 0 1\n1 x 0 1\n")
    with pytest.raises(wrt.InputError, match=r"line 2: a point of a curve is"):
        loaded(tmp_path, scene('type="bsplinecurve"><string name="filename" value="spline.txt"/>', LAMP))
