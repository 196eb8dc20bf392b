"""Geometry of glTF files that is compressed, sparse, quantised, instanced, skinned or morphed."""

from __future__ import annotations

import json
import sys
import warnings

import numpy as np
import pytest
from support.meshes import gltf_box, write

import wrt
from wrt.errors import InputError, InputWarning
from wrt.io.gltf.meshopt import decoded
from wrt.io.load_mesh import load_file, load_mesh

POINTS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "<f4")
FACES = np.array([[0, 1, 2], [0, 2, 3]])
TYPES = {"f4": 5126, "i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125}
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


def square() -> dict:
    return gltf_box(POINTS, FACES)


def data_uri(data: bytes) -> str:
    import base64

    return "data:application/octet-stream;base64," + base64.b64encode(data).decode()


def add_view(tree: dict, data: bytes, **more: object) -> int:
    tree["buffers"].append({"uri": data_uri(data), "byteLength": len(data)})
    tree["bufferViews"].append({"buffer": len(tree["buffers"]) - 1, "byteLength": len(data), **more})
    return len(tree["bufferViews"]) - 1


def add(tree: dict, values: np.ndarray, **more: object) -> int:
    """Add an accessor of an array, and return its number."""
    width = 1 if values.ndim == 1 else values.shape[1]
    view = add_view(tree, values.tobytes())
    kind = TYPES[values.dtype.str[1:]]
    accessor = {"bufferView": view, "componentType": kind, "type": KINDS[width], "count": len(values), **more}
    tree["accessors"].append(accessor)
    return len(tree["accessors"]) - 1


def corners(tmp_path, tree: dict) -> np.ndarray:
    """Return (T, 3, 3) the corners of the triangles that the file is read as."""
    mesh = load_mesh(write(tmp_path, "mesh.gltf", json.dumps(tree)))
    return mesh.vertices[mesh.faces].astype(float)


def test_quantised_and_sparse_numbers_are_the_same_as_plain_ones(tmp_path):
    expected = POINTS[FACES]
    tree = square()
    primitive = tree["meshes"][0]["primitives"][0]
    primitive["attributes"]["POSITION"] = add(tree, np.round(POINTS * 32767).astype("<i2"), normalized=True)
    np.testing.assert_allclose(corners(tmp_path, tree), expected, atol=1e-6)

    tree = square()
    sparse = {
        "count": 2,
        "indices": {"bufferView": add_view(tree, np.array([1, 2], "<u2").tobytes()), "componentType": 5123},
        "values": {"bufferView": add_view(tree, np.array([[3, 0, 0], [3, 1, 0]], "<f4").tobytes())},
    }
    tree["accessors"][0]["sparse"] = sparse
    np.testing.assert_allclose(corners(tmp_path, tree), (POINTS * [3, 1, 1])[FACES])
    del tree["accessors"][0]["bufferView"]  # then all others are zero
    with pytest.warns(InputWarning, match="1 of 2 triangles are left out"):
        moved = corners(tmp_path, tree)
    np.testing.assert_allclose(moved, np.array([[0, 0, 0], [3, 0, 0], [3, 1, 0], [0, 0, 0]])[FACES[:1]])

    tree = square()
    tree["images"] = [{"uri": "none.png"}]
    tree["textures"] = [{"source": 0}]
    tree["materials"] = [{"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1]}}]
    uvs = add(tree, np.array([[0, 0], [255, 0], [255, 255], [0, 51]], "<u1"), normalized=True)
    primitive = tree["meshes"][0]["primitives"][0]
    primitive["attributes"]["TEXCOORD_0"] = uvs
    primitive["material"] = 0
    mesh = load_mesh(write(tmp_path, "mesh.gltf", json.dumps(tree)))
    np.testing.assert_allclose(mesh.uvs, [[0, 1], [1, 1], [1, 0], [0, 0.8]], atol=1e-6)


def test_a_view_longer_than_its_buffer_hurts_only_accessors_that_reach_beyond(tmp_path):
    tree = square()
    tree["bufferViews"][-1]["byteLength"] += 1000
    np.testing.assert_allclose(corners(tmp_path, tree), POINTS[FACES])
    tree["accessors"][1]["count"] += 300
    with pytest.raises(wrt.InputError, match=r"mesh\.gltf"):
        corners(tmp_path, tree)


def test_fans_are_triangles_and_lines_are_told(tmp_path):
    tree = square()
    tree["meshes"][0]["primitives"] = [{"attributes": {"POSITION": 0}, "mode": 6}]
    np.testing.assert_allclose(corners(tmp_path, tree), POINTS[FACES])
    tree["meshes"][0]["primitives"].append({"attributes": {"POSITION": 0}, "mode": 3})
    with pytest.warns(InputWarning, match="lines are left out: only triangles are rendered"):
        corners(tmp_path, tree)


def test_primitives_without_positions_are_left_out(tmp_path):
    tree = square()
    whole = tree["meshes"][0]["primitives"][0]
    without = {**whole, "attributes": {}}
    tree["meshes"][0]["primitives"] = [without, whole]
    tree["meshes"].append({"primitives": [without]})
    tree["nodes"].append({"mesh": 1, "name": "empty", "skin": 0, "weights": [0.5]})
    assert "scenes" not in tree, "all nodes are shown"
    with pytest.warns(InputWarning, match=r"mesh.gltf: primitives without positions .* \(2\)"):
        assert np.array_equal(corners(tmp_path, tree), POINTS[FACES])
    tree["meshes"][0]["primitives"] = [without]
    with pytest.warns(InputWarning), pytest.raises(InputError, match=r"mesh.gltf: no triangles"):
        corners(tmp_path, tree)


def test_instances_and_hidden_nodes(tmp_path):
    tree = square()
    moves = np.array([[5, 0, 0], [0, 7, 0]], "<f4")
    sizes = np.array([[1, 1, 1], [2, 2, 2]], "<f4")
    attributes = {"TRANSLATION": add(tree, moves), "SCALE": add(tree, sizes)}
    tree["nodes"] = [
        {"mesh": 0, "translation": [0, 0, 1], "extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}}},
        {"children": [2], "extensions": {"KHR_node_visibility": {"visible": False}}},
        {"mesh": 0},
    ]
    tree["extensionsRequired"] = ["EXT_mesh_gpu_instancing", "KHR_node_visibility"]
    scene = load_file(write(tmp_path, "many.gltf", json.dumps(tree)))
    assert len(scene.shapes) == 2
    assert scene.shapes[0].mesh is scene.shapes[1].mesh
    lowest = sorted(tuple(shape.mesh_at(0.0).bounds.ravel()) for shape in scene.shapes)
    assert lowest == [(0, 7, 1, 2, 9, 1), (5, 0, 1, 6, 1, 1)]


def test_skins_and_morph_targets_are_as_at_rest(tmp_path):
    tree = square()
    primitive = tree["meshes"][0]["primitives"][0]
    raised = np.zeros((4, 3), "<f4")
    raised[2] = (0, 0, 4)
    primitive["targets"] = [{"POSITION": add(tree, raised)}]
    tree["meshes"][0]["weights"] = [0.5]
    morphed = POINTS + 0.5 * raised
    np.testing.assert_allclose(corners(tmp_path, tree), morphed[FACES])
    tree["nodes"][0]["weights"] = [0.0]  # those of the node come first
    np.testing.assert_allclose(corners(tmp_path, tree), POINTS[FACES])

    # The upper two vertices follow the second joint by three quarters; the node of the mesh does not count.
    joints = np.array([[0, 0, 0, 0], [0, 0, 0, 0], [0, 1, 0, 0], [0, 1, 0, 0]], "<u1")
    shares = np.array([[1, 0, 0, 0], [1, 0, 0, 0], [0.25, 0.75, 0, 0], [0.25, 0.75, 0, 0]], "<f4")
    inverse = np.stack([np.eye(4)] * 2)
    inverse[1, 3, :3] = (0, -1, 0)  # columns first
    primitive["attributes"] |= {"JOINTS_0": add(tree, joints), "WEIGHTS_0": add(tree, shares)}
    matrices = add(tree, inverse.astype("<f4").reshape(2, 16))
    tree["skins"] = [{"joints": [1, 2], "inverseBindMatrices": matrices}]
    tree["nodes"] = [
        {"mesh": 0, "skin": 0, "weights": [0.0], "translation": [9, 9, 9]},
        {"translation": [0, 0, 2], "children": [2]},
        {"translation": [0, 1, 0], "scale": [2, 2, 2]},
    ]
    first, second = POINTS + [0, 0, 2], (POINTS - [0, 1, 0]) * 2 + [0, 1, 2]
    weights = shares[:, :1], shares[:, 1:2]
    np.testing.assert_allclose(corners(tmp_path, tree), (first * weights[0] + second * weights[1])[FACES], atol=1e-6)


def pack_bytes(rows: np.ndarray) -> bytes:
    """Return (N, stride) bytes as meshoptimizer compresses them, each group of 16 in its shortest form."""
    count, stride = rows.shape
    last = rows[0].copy()
    out = bytearray([0xA0])
    block = min((8192 // stride) & ~15, 256)
    baseline = last.copy()
    for start in range(0, count, block):
        part = rows[start : start + block]
        for k in range(stride):
            column = np.concatenate([last[k : k + 1], part[:, k]])
            steps = np.diff(column.astype(np.int64)).astype(np.int8)
            zigzag = ((steps << 1) ^ (steps >> 7)).view(np.uint8)
            groups = -(-len(part) // 16)
            padded = np.zeros(groups * 16, np.uint8)
            padded[: len(zigzag)] = zigzag
            codes, body = [], bytearray()
            for group in padded.reshape(groups, 16):
                code = 0 if not group.any() else 1 if group.max() < 3 else 2 if np.sort(group)[-3] < 15 else 3
                codes.append(code)
                if code in (1, 2):
                    bits, escape = (2, 3) if code == 1 else (4, 15)
                    short = np.minimum(group, escape).reshape(-1, 8 // bits)
                    shifts = np.arange(8 - bits, -1, -bits)
                    body += bytes((short.astype(int) << shifts).sum(axis=1).astype(np.uint8))
                    body += bytes(group[group >= escape])
                elif code == 3:
                    body += bytes(group)
            codes += [0] * (-groups % 4)
            out += bytes(sum(codes[i + j] << 2 * j for j in range(4)) for i in range(0, len(codes), 4)) + body
        last = part[-1]
    tail = bytes(max(32 - stride, 0)) + bytes(baseline)
    return bytes(out) + tail


def test_vertices_compressed_by_meshoptimizer(tmp_path):
    rng = np.random.default_rng(5)
    smooth = np.cumsum(rng.integers(-1, 2, (700, 3)), axis=0).astype("<f4")  # several blocks, groups of every form
    rows = smooth.view(np.uint8).reshape(700, 12)
    assert decoded(pack_bytes(rows), 700, 12, "ATTRIBUTES") == smooth.tobytes()
    noise = rng.integers(0, 256, (300, 8)).astype(np.uint8)
    assert decoded(pack_bytes(noise), 300, 8, "ATTRIBUTES") == noise.tobytes()

    tree = square()
    packed = pack_bytes(POINTS.view(np.uint8).reshape(4, 12))
    view = add_view(tree, packed)
    place = {**tree["bufferViews"].pop(view), "byteStride": 12, "count": 4, "mode": "ATTRIBUTES", "filter": "NONE"}
    tree["buffers"].append({"byteLength": 48})  # the file has no other form of it
    tree["bufferViews"][0] = {"buffer": 2, "byteLength": 48, "extensions": {"EXT_meshopt_compression": place}}
    tree["extensionsRequired"] = ["EXT_meshopt_compression"]
    np.testing.assert_allclose(corners(tmp_path, tree), POINTS[FACES])
    place["byteLength"] = 20
    with pytest.raises(wrt.InputError, match="compressed by meshoptimizer are damaged"):
        corners(tmp_path, tree)


def test_indices_and_filters_of_meshoptimizer():
    # Triangles: (0, 1, 2) of new vertices, (2, 1, 3) by the edge before and a new one, (5, 9, 4) by differences.
    codes = bytes([0xE1, 0xF0, 0x10, 0xFF])
    varints = bytes([0xFF, 10, 8, 9])  # b and c explicit; 0+5, 5+4, 9−5
    table = bytes(16)
    found = np.frombuffer(decoded(codes + varints + table, 9, 2, "TRIANGLES"), np.uint16)
    assert found.tolist() == [0, 1, 2, 2, 1, 3, 5, 9, 4]
    sequence = bytes([0xD1, 5 << 2, 1 | 7 << 2, 3 << 1, 0, 0, 0, 0])
    assert np.frombuffer(decoded(sequence, 3, 4, "INDICES"), np.uint32).tolist() == [5, 7, 3]

    ways = np.array([[0, 0, 127, 9], [127, 0, 127, 0], [-40, 60, 127, 1]], np.int8)  # the last with |x| + |y| < 1
    out = decoded(pack_bytes(ways.view(np.uint8)), 3, 4, "ATTRIBUTES", "OCTAHEDRAL")
    vectors = np.frombuffer(out, np.int8).reshape(3, 4)
    expected = np.array([[0, 0, 1], [1, 0, 0], [-40, 60, 27] / np.linalg.norm([-40, 60, 27])]) * 127
    np.testing.assert_allclose(vectors[:, :3], expected, atol=0.51)
    assert vectors[:, 3].tolist() == [9, 0, 1]
    numbers = np.array([[(-3 & 255) << 24 | 5], [2 << 24 | (-7 & 0xFFFFFF)]], np.uint32)
    out = decoded(pack_bytes(numbers.view(np.uint8)), 2, 4, "ATTRIBUTES", "EXPONENTIAL")
    assert np.frombuffer(out, np.float32).tolist() == [0.625, -28.0]


def test_draco_needs_its_decoder(tmp_path, monkeypatch):
    tree = square()
    tree["meshes"][0]["primitives"][0]["extensions"] = {"KHR_draco_mesh_compression": {"bufferView": 0}}
    tree["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    with pytest.raises(wrt.InputError, match=r"compressed by Draco, which needs a decoder: pip install 'wrt\[draco\]'"):
        corners(tmp_path, tree)


def test_draco(tmp_path):
    draco = pytest.importorskip("DracoPy")
    tree = square()
    packed = draco.encode(POINTS, FACES.astype(np.uint32), quantization_bits=14)
    view = add_view(tree, packed)
    for number in (0, 1):
        tree["accessors"][number].pop("bufferView", None)
    primitive = tree["meshes"][0]["primitives"][0]
    primitive["extensions"] = {"KHR_draco_mesh_compression": {"bufferView": view, "attributes": {"POSITION": 0}}}
    tree["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    found = corners(tmp_path, tree)
    assert sorted(map(tuple, found.reshape(-1, 3).round(3))) == sorted(map(tuple, POINTS[FACES].reshape(-1, 3)))


def test_what_draco_compresses_may_be_colored_morphed_and_skinned(tmp_path):
    draco = pytest.importorskip("DracoPy")
    tree = square()
    colors = np.array([[65535, 0, 0], [0, 65535, 0], [0, 0, 65535], [13107, 13107, 13107]], np.uint32)  # of 16 bits
    joints = np.array([[0, 0, 0, 0]] * 2 + [[0, 1, 0, 0]] * 2, np.uint8)
    shares = np.array([[1, 0, 0, 0]] * 2 + [[0.25, 0.75, 0, 0]] * 2, np.float32)
    packed = draco.encode(
        POINTS, FACES.astype(np.uint32), preserve_order=True, generic_attributes={1: colors, 2: joints, 3: shares}
    )
    view = add_view(tree, packed)
    held = {"COLOR_0": (5123, "VEC3", 1), "JOINTS_0": (5121, "VEC4", 2), "WEIGHTS_0": (5126, "VEC4", 3)}
    primitive = tree["meshes"][0]["primitives"][0]
    for name, (kind, shape, _) in held.items():
        primitive["attributes"][name] = len(tree["accessors"])
        normalized = {"normalized": True} if name == "COLOR_0" else {}
        tree["accessors"].append({"componentType": kind, "type": shape, "count": 4, **normalized})
    names = {"POSITION": 0, **{name: number for name, (_, _, number) in held.items()}}
    primitive["extensions"] = {"KHR_draco_mesh_compression": {"bufferView": view, "attributes": names}}
    raised = np.zeros((4, 3), "<f4")
    raised[2] = (0, 0, 4)
    primitive["targets"] = [{"POSITION": add(tree, raised)}]
    tree["skins"] = [{"joints": [1, 2]}]
    tree["nodes"] = [{"mesh": 0, "skin": 0, "weights": [0.5]}, {}, {"translation": [0, 0, 2]}]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mesh = load_mesh(write(tmp_path, "mesh.gltf", json.dumps(tree)))
    expected = POINTS + 0.5 * raised + shares[:, 1:2] * [0, 0, 2]
    np.testing.assert_allclose(mesh.vertices[mesh.faces], expected[FACES], atol=1e-3)
    np.testing.assert_allclose(mesh.colors[mesh.faces], (colors / 65535.0)[FACES], atol=1e-6)


def test_damaged_data_of_draco_are_told(tmp_path):
    pytest.importorskip("DracoPy")
    tree = square()
    view = add_view(tree, b"DRACO\x02\x02 and no more")
    extension = {"bufferView": view, "attributes": {"POSITION": 0}}
    tree["meshes"][0]["primitives"][0]["extensions"] = {"KHR_draco_mesh_compression": extension}
    with pytest.raises(wrt.InputError, match=r"mesh\.gltf: data of Draco cannot be decoded: "):
        corners(tmp_path, tree)


def test_gltf_1_is_told(tmp_path):
    with pytest.raises(wrt.InputError, match=r"a file of glTF 1\.0, which is not supported; convert it"):
        load_mesh(write(tmp_path, "old.gltf", json.dumps({"asset": {"version": "1.0"}, "meshes": {}})))
