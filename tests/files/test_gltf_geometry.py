"""Geometry of glTF files that is compressed, sparse, quantised, instanced or morphed; cameras, lights, versions."""

import math
import sys

import numpy as np
import pytest
from support.mesh_files import add, add_view, attributes, check_refused, saved
from support.meshes import area_vector, gltf_box, write

import wrt
from wrt.errors import InputWarning
from wrt.io.gltf.meshopt import decoded
from wrt.io.load_mesh import load_file, load_mesh, load_shapes

POINTS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "<f4")
FACES = np.array([[0, 1, 2], [0, 2, 3]])
HALF = 0.5**0.5
DRACO = "KHR_draco_mesh_compression"


def square() -> dict:
    return gltf_box(POINTS, FACES)


def corners(tmp_path, tree: dict) -> np.ndarray:
    """Return (T, 3, 3) the corners of the triangles that the file is read as."""
    mesh = load_mesh(saved(tmp_path, tree))
    return mesh.vertices[mesh.faces].astype(float)


def test_nodes_factors_strips_and_normalized_integers(tmp_path):
    points = np.array([[0, 1, 0], [0, 0, 0], [1, 1, 0], [1, 0, 0]], "<f4")
    colors = np.array([[255, 0, 0, 255], [128, 128, 128, 255], [0, 0, 255, 255], [255] * 4], "<u1")
    tree = gltf_box(points, FACES)
    tree["buffers"][0]["uri"] = "the%20data.bin"
    data = write(tmp_path, "the data.bin", points.tobytes() + bytes(12))
    tree["nodes"] = [
        {"children": [1, 2], "translation": [10, 0, 0]},
        {"mesh": 0, "rotation": [HALF, 0, 0, HALF], "scale": [2, 2, 2]},  # +90 degrees about x
        {"mesh": 0, "scale": [-1, 1, 1]},
    ]
    tree["materials"] = [{"pbrMetallicRoughness": {"baseColorFactor": [0.001, 0.5, 1.0, 1.0]}}]
    attributes(tree)["COLOR_0"] = add(tree, colors, "<u1", normalized=True)
    del tree["meshes"][0]["primitives"][0]["indices"]
    tree["meshes"][0]["primitives"][0] |= {"mode": 5, "material": 0}
    turned, mirrored = load_shapes(saved(tmp_path, tree))
    # The square faces +z; a quarter turn about x takes that to -y.
    assert area_vector(turned.mesh) == pytest.approx([0, -4, 0], abs=1e-6)
    np.testing.assert_allclose(turned.mesh.bounds, [[10, 0, 0], [12, 0, 2]], atol=1e-6)
    assert area_vector(mirrored.mesh) == pytest.approx([0, 0, 1])  # a mirror keeps fronts in front
    np.testing.assert_allclose(mirrored.mesh.bounds, [[9, 0, 0], [10, 1, 0]], atol=1e-6)
    expected = colors[:, :3] / 255.0 * [0.001, 0.5, 1.0]  # linear in this format
    np.testing.assert_allclose(turned.mesh.colors, expected, rtol=1e-6)
    del attributes(tree)["COLOR_0"]
    assert load_shapes(saved(tmp_path, tree))[0].material.base_color == pytest.approx((0.001, 0.5, 1.0))
    data.unlink()
    check_refused(r"the data\.bin', which it refers to: no such file", load_mesh, tmp_path / "a.gltf")
    tree["nodes"][1]["children"], tree["scenes"] = [0], [{"nodes": [0]}]
    check_refused("circle", load_mesh, saved(tmp_path, tree))


def test_quantised_and_sparse_numbers_are_the_same_as_plain_ones(tmp_path):
    tree = square()
    attributes(tree)["POSITION"] = add(tree, np.round(POINTS * 32767), "<i2", normalized=True)
    tree["materials"], tree["meshes"][0]["primitives"][0]["material"] = [{}], 0
    attributes(tree)["TEXCOORD_0"] = add(tree, [[0, 0], [255, 0], [255, 255], [0, 51]], "<u1", normalized=True)
    np.testing.assert_allclose(corners(tmp_path, tree), POINTS[FACES], atol=1e-6)
    np.testing.assert_allclose(load_mesh(tmp_path / "a.gltf").uvs, [[0, 1], [1, 1], [1, 0], [0, 0.8]], atol=1e-6)

    tree = square()
    tree["accessors"][0]["sparse"] = {
        "count": 2,
        "indices": {"bufferView": add_view(tree, np.array([1, 2], "<u2").tobytes()), "componentType": 5123},
        "values": {"bufferView": add_view(tree, np.array([[3, 0, 0], [3, 1, 0]], "<f4").tobytes())},
    }
    np.testing.assert_allclose(corners(tmp_path, tree), (POINTS * [3, 1, 1])[FACES])
    del tree["accessors"][0]["bufferView"]  # then all others are zero
    with pytest.warns(InputWarning, match="1 of 2 triangles are left out"):
        np.testing.assert_allclose(corners(tmp_path, tree), [[[0, 0, 0], [3, 0, 0], [3, 1, 0]]])


@pytest.mark.parametrize(
    ("name", "shape"), [("NORMAL", (3, 3)), ("TANGENT", (4, 3)), ("TEXCOORD_0", (5, 2)), ("COLOR_0", (4, 2))]
)
def test_attributes_of_a_wrong_shape_are_left_out(name, shape, tmp_path):
    tree = square()
    attributes(tree)["NORMAL"] = add(tree, np.tile([0.0, 0.0, 1.0], (4, 1)))
    attributes(tree)[name] = add(tree, np.ones(shape))
    tree["materials"], tree["meshes"][0]["primitives"][0]["material"] = [{}], 0
    with pytest.warns(InputWarning, match=f"{name} of a primitive is left out: it is {shape[0]} x {shape[1]} numbers"):
        assert len(load_mesh(saved(tmp_path, tree)).faces) == 2


def test_triangles_of_one_side_that_wind_against_their_normals_are_warned_of(tmp_path):
    tree = square()
    attributes(tree)["NORMAL"] = add(tree, np.tile([0.0, 0.0, -1.0], (4, 1)))
    with pytest.warns(InputWarning, match="its triangles wind against their normals, so it is seen from inside"):
        load_mesh(saved(tmp_path, tree))
    tree["materials"], tree["meshes"][0]["primitives"][0]["material"] = [{"doubleSided": True}], 0
    load_mesh(saved(tmp_path, tree))


def test_primitives_that_are_no_triangles_are_told(tmp_path):
    tree = square()
    primitive = tree["meshes"][0]["primitives"][0]
    without, line = {**primitive, "attributes": {}}, {"attributes": {"POSITION": 0}, "mode": 3}
    tree["meshes"][0]["primitives"] = [without, line, {"attributes": {"POSITION": 0}, "mode": 6}]  # at last a fan
    with (
        pytest.warns(InputWarning, match=r"a\.gltf: primitives without positions .* \(1\)"),
        pytest.warns(InputWarning, match="lines are left out: only triangles and points are rendered"),
    ):
        np.testing.assert_allclose(corners(tmp_path, tree), POINTS[FACES])


def test_instances_and_hidden_nodes(tmp_path):
    tree = square()
    placed = {"TRANSLATION": add(tree, [[5, 0, 0], [0, 7, 0]]), "SCALE": add(tree, [[1, 1, 1], [2, 2, 2]])}
    tree["nodes"] = [
        {"mesh": 0, "translation": [0, 0, 1], "extensions": {"EXT_mesh_gpu_instancing": {"attributes": placed}}},
        {"children": [2], "extensions": {"KHR_node_visibility": {"visible": False}}},
        {"mesh": 0},
    ]
    tree["nodes"][2] |= light(0)
    tree["extensions"] = {"KHR_lights_punctual": {"lights": LIGHTS}}
    tree["extensionsRequired"] = ["EXT_mesh_gpu_instancing", "KHR_node_visibility"]
    scene = load_file(saved(tmp_path, tree))
    assert not scene.lights
    shapes = scene.shapes
    assert len({id(shape.mesh) for shape in shapes}) == 1
    bounds = sorted(tuple(shape.mesh_at(0.0).bounds.ravel()) for shape in shapes)
    assert bounds == [(0, 7, 1, 2, 9, 1), (5, 0, 1, 6, 1, 1)]


RAISED = np.zeros((4, 3), "<f4")
RAISED[2] = (0, 0, 4)
JOINTS = np.array([[0, 0, 0, 0]] * 2 + [[0, 1, 0, 0]] * 2, np.uint8)
SHARES = np.array([[1, 0, 0, 0]] * 2 + [[0.25, 0.75, 0, 0]] * 2, np.float32)
"""The upper two vertices follow the second joint by three quarters."""


def pack_bytes(rows: np.ndarray) -> bytes:
    """Return (N, stride) bytes as meshoptimizer compresses them, each group of 16 in its shortest form."""
    count, stride = rows.shape
    last, out = rows[0], bytearray([0xA0])
    block = min((8192 // stride) & ~15, 256)
    for start in range(0, count, block):
        part = rows[start : start + block]
        for k in range(stride):
            steps = np.diff(np.concatenate([last[k : k + 1], part[:, k]]).astype(np.int64)).astype(np.int8)
            groups = -(-len(part) // 16)
            padded = np.zeros((groups, 16), np.uint8)
            padded.reshape(-1)[: len(steps)] = ((steps << 1) ^ (steps >> 7)).view(np.uint8)
            codes, body = [], bytearray()
            for group in padded:
                code = 0 if not group.any() else 1 if group.max() < 3 else 2 if np.sort(group)[-3] < 15 else 3
                codes.append(code)
                if code in (1, 2):
                    bits, escape = (2, 3) if code == 1 else (4, 15)
                    short = np.minimum(group, escape).reshape(-1, 8 // bits).astype(int)
                    body += bytes((short << np.arange(8 - bits, -1, -bits)).sum(axis=1).astype(np.uint8))
                    body += bytes(group[group >= escape])
                elif code == 3:
                    body += bytes(group)
            codes += [0] * (-groups % 4)
            out += bytes(sum(codes[i + j] << 2 * j for j in range(4)) for i in range(0, len(codes), 4)) + body
        last = part[-1]
    return bytes(out) + bytes(max(32 - stride, 0)) + bytes(rows[0])


def test_vertices_compressed_by_meshoptimizer(tmp_path):
    rng = np.random.default_rng(5)
    rows = np.cumsum(rng.integers(-1, 2, (700, 3)), axis=0).astype("<f4")  # several blocks, groups of every form
    rows[:300] = rng.random((300, 3))
    rows = rows.view(np.uint8)
    assert decoded(pack_bytes(rows), *rows.shape, "ATTRIBUTES") == rows.tobytes()
    tree = square()
    view = add_view(tree, pack_bytes(POINTS.view(np.uint8).reshape(4, 12)))
    place = {**tree["bufferViews"].pop(view), "byteStride": 12, "count": 4, "mode": "ATTRIBUTES", "filter": "NONE"}
    tree["buffers"].append({"byteLength": 48})  # the file has no other form of it
    tree["bufferViews"][0] = {"buffer": 2, "byteLength": 48, "extensions": {"EXT_meshopt_compression": place}}
    tree["extensionsRequired"] = ["EXT_meshopt_compression"]
    np.testing.assert_allclose(corners(tmp_path, tree), POINTS[FACES])
    place["byteLength"] = 20
    check_refused("damaged or not as specified", load_mesh, saved(tmp_path, tree))


def test_indices_and_filters_of_meshoptimizer():
    # Triangles: (0, 1, 2) of new vertices, (2, 1, 3) by the edge before and a new one, (5, 9, 4) by differences.
    codes, varints = bytes([0xE1, 0xF0, 0x10, 0xFF]), bytes([0xFF, 10, 8, 9])  # b and c explicit; 0+5, 5+4, 9-5
    found = np.frombuffer(decoded(codes + varints + bytes(16), 9, 2, "TRIANGLES"), np.uint16)
    assert found.tolist() == [0, 1, 2, 2, 1, 3, 5, 9, 4]
    sequence = bytes([0xD1, 5 << 2, 1 | 7 << 2, 3 << 1, 0, 0, 0, 0])
    assert np.frombuffer(decoded(sequence, 3, 4, "INDICES"), np.uint32).tolist() == [5, 7, 3]

    octahedral = np.array([[0, 0, 127, 9], [127, 0, 127, 0], [-40, 60, 127, 1]], np.int8)  # the last with |x| + |y| < 1
    out = decoded(pack_bytes(octahedral.view(np.uint8)), 3, 4, "ATTRIBUTES", "OCTAHEDRAL")
    vectors = np.frombuffer(out, np.int8).reshape(3, 4)
    expected = np.array([[0, 0, 1], [1, 0, 0], [-40, 60, 27] / np.linalg.norm([-40, 60, 27])]) * 127
    np.testing.assert_allclose(vectors[:, :3], expected, atol=0.51)
    assert vectors[:, 3].tolist() == [9, 0, 1]
    numbers = np.array([[(-3 & 255) << 24 | 5], [2 << 24 | (-7 & 0xFFFFFF)]], np.uint32)
    out = decoded(pack_bytes(numbers.view(np.uint8)), 2, 4, "ATTRIBUTES", "EXPONENTIAL")
    assert np.frombuffer(out, np.float32).tolist() == [0.625, -28.0]


def test_what_draco_compresses_may_be_colored_morphed_and_skinned(tmp_path, monkeypatch):
    draco = pytest.importorskip("DracoPy")
    tree = square()
    colors = np.array([[65535, 0, 0], [0, 65535, 0], [0, 0, 65535], [13107, 13107, 13107]], np.uint32)  # of 16 bits
    generic = {1: colors, 2: JOINTS, 3: SHARES}
    packed = draco.encode(POINTS, FACES.astype(np.uint32), preserve_order=True, generic_attributes=generic)
    numbers = {"POSITION": 4, "COLOR_0": 1, "JOINTS_0": 2, "WEIGHTS_0": 3}
    extension = {"bufferView": add_view(tree, packed), "attributes": numbers}
    for name, kind, shape in (("COLOR_0", 5123, "VEC3"), ("JOINTS_0", 5121, "VEC4"), ("WEIGHTS_0", 5126, "VEC4")):
        attributes(tree)[name] = len(tree["accessors"])
        tree["accessors"].append({"componentType": kind, "type": shape, "count": 4, "normalized": name == "COLOR_0"})
    for accessor in tree["accessors"]:
        accessor.pop("bufferView", None)
    targets = [{"POSITION": add(tree, RAISED)}]
    tree["meshes"][0]["primitives"][0] |= {"targets": targets, "extensions": {DRACO: extension}}
    tree["extensionsRequired"] = [DRACO]
    tree["skins"] = [{"joints": [1, 2]}]
    tree["nodes"] = [{"mesh": 0, "skin": 0, "weights": [0.5]}, {}, {"translation": [0, 0, 2]}]
    mesh = load_mesh(saved(tmp_path, tree))
    expected = POINTS + 0.5 * RAISED + SHARES[:, 1:2] * [0, 0, 2]
    np.testing.assert_allclose(mesh.vertices[mesh.faces], expected[FACES], atol=1e-3)
    np.testing.assert_allclose(mesh.colors[mesh.faces], (colors / 65535.0)[FACES], atol=1e-6)
    tree["bufferViews"][extension["bufferView"]]["byteLength"] = 20
    path = saved(tmp_path, tree)
    check_refused(r"data of Draco cannot be decoded: ", load_mesh, path)
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    check_refused(r"compressed by Draco, which needs a decoder: pip install 'wrt\[draco\]'", load_mesh, path)


CAMERAS = [
    {"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1, "aspectRatio": 2.0}},
    {"type": "orthographic", "orthographic": {"xmag": 3.0, "ymag": 2.0, "znear": 0.1, "zfar": 9.0}},
]
LIGHTS = [
    {"type": "point", "intensity": 5.0, "color": [1.0, 0.5, 0.25]},
    {"type": "directional", "intensity": 2.0},
    {"type": "spot", "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.5}},
    {"type": "spot", "spot": {}},
]


def tree_with(nodes: list[dict], lights: list[dict] = LIGHTS, **fields: object) -> dict:
    """Return a triangle on node 0, and further nodes."""
    tree = gltf_box(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    tree["nodes"] += nodes
    return tree | {"cameras": CAMERAS, "extensions": {"KHR_lights_punctual": {"lights": lights}}} | fields


def light(number: int) -> dict:
    return {"extensions": {"KHR_lights_punctual": {"light": number}}}


def test_cameras_and_lights_are_taken_through_all_nodes_above(tmp_path):
    # Moved, then turned by 90 degrees about y: it looks along -x.
    nodes = [
        {"children": [2], "translation": [1, 2, 3]},
        {"camera": 0, "rotation": [0, HALF, 0, HALF], "scale": [2, 2, 2]},
        {"camera": 1},
    ]
    camera = load_file(saved(tmp_path, tree_with(nodes))).camera
    assert camera.origin == pytest.approx((1, 2, 3))
    assert camera.target == pytest.approx((0, 2, 3))
    assert camera.fov_degrees == pytest.approx(math.degrees(0.7))
    np.testing.assert_allclose(camera.frame()[:2], [[0, 0, -1], [0, 1, 0]], atol=1e-12)
    nodes[1]["camera"] = 1
    camera = load_file(saved(tmp_path, tree_with(nodes))).camera
    assert camera.view_height == 4.0
    # By columns: x to y, y to -x, and moved.
    matrix = [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 7, 8, 9, 1]
    tilted = {"rotation": [-HALF, 0, 0, HALF], "translation": [0, 5, 0]}  # -90 degrees about x: -z becomes -y
    nodes = [light(0) | {"matrix": matrix}, light(1) | tilted, light(2) | tilted, light(3)]
    point, sun, spot, wide = load_file(saved(tmp_path, tree_with(nodes))).lights
    assert point == wrt.PointLight((7.0, 8.0, 9.0), intensity=(5.0, 2.5, 1.25))
    assert sun.direction == pytest.approx((0, -1, 0))
    assert sun.irradiance == (2.0, 2.0, 2.0)
    assert (spot.position, spot.falloff) == ((0.0, 5.0, 0.0), "gltf")
    assert spot.direction == pytest.approx((0, -1, 0))
    assert (spot.inner_degrees, spot.outer_degrees) == pytest.approx((math.degrees(0.2), math.degrees(0.5)))
    assert (wide.inner_degrees, wide.outer_degrees) == pytest.approx((0.0, 45.0))


def test_lights_of_a_file_take_the_place_of_the_studio_unless_they_are_dark(tmp_path):
    scene = wrt.load(saved(tmp_path, tree_with([light(0)])))
    assert (len(scene.shapes), len(scene.lights), scene.environment) == (1, 1, None)
    path = saved(tmp_path, tree_with([{"camera": 0, "translation": [0.5, 0.5, 2]}]))
    scene = wrt.load(path)
    assert len(scene.shapes) > 1
    assert scene.camera.origin == (0.5, 0.5, 2.0)
    turned = wrt.load(path, up="z", frame=False)  # (x, y, z) becomes (x, z, -y)
    assert turned.camera.origin == pytest.approx((0.5, 2.0, -0.5))
    np.testing.assert_allclose(turned.shapes[0].bounds, [[0, 0, -1], [1, 0, 0]], atol=1e-6)
    lit = saved(tmp_path, tree_with([light(0)]))
    check_refused("an up axis is for files without lights", lambda path: wrt.load(path, up="z"), lit)
    # Alone they count as missing, so the studio lights the mesh; beside meshes that emit they mean darkness
    off = [{"type": "point", "intensity": 0.0}, {"type": "directional", "color": [0, 0, 0]}]
    tree = tree_with([light(0), light(1)], off)
    path = saved(tmp_path, tree)
    with pytest.warns(UserWarning, match=r"a\.gltf: its lights are dark, so the studio lights it"):
        scene = wrt.load(path)
    assert len(scene.shapes) > 1
    assert not scene.lights
    assert scene.environment is not None
    tree["materials"] = [{"emissiveFactor": [1, 1, 1]}]
    tree["meshes"][0]["primitives"][0]["material"] = 0
    scene = wrt.load(saved(tmp_path, tree))
    assert (len(scene.shapes), len(scene.lights)) == (1, 2)


def test_versions_and_extensions_that_a_file_may_require(tmp_path):
    """Minor versions add to a major one; `minVersion` is what a file cannot be read without (section 3.2)."""
    for asset in ({"version": "2.3"}, {"version": "3.0", "minVersion": "2.0"}):
        assert load_file(saved(tmp_path, tree_with([], asset=asset))).shapes
    for asset, fields, refused in (
        ({"version": "2.3", "minVersion": "2.1"}, {}, "2.1"),
        ({"version": "1.0"}, {"meshes": {}}, "1.0"),
    ):
        path = saved(tmp_path, tree_with([], asset=asset, **fields))
        check_refused(f"a file of glTF {refused}, which is not supported", load_file, path)
    tree = tree_with([], extensionsUsed=["KHR_materials_subsurface"])
    assert load_file(saved(tmp_path, tree)).shapes
    path = saved(tmp_path, tree | {"extensionsRequired": ["KHR_materials_subsurface"]})
    check_refused("requires the glTF extension KHR_materials_subsurface, which is not supported", load_file, path)


@pytest.mark.parametrize("node", [{"camera": 3}, light(9), {"camera": 0, "scale": [0, 0, 0]}, light(4), light(5)])
def test_mistakes_are_told_in_one_line(tmp_path, node):
    lights = [*LIGHTS, {"type": "spot", "intensity": "much"}, {"type": "area"}]
    check_refused("a.gltf: ", load_file, saved(tmp_path, tree_with([node], lights)))
