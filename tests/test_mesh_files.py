"""Mesh files load as they were meant, or are refused in one line."""

from __future__ import annotations

import json
import os
import struct
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh
from support.meshes import SQUARE, area, area_vector, check_message, gltf_box, repeated_edges, triangles, volume, write

import wrt
from wrt.errors import InputWarning
from wrt.io.load_mesh import from_trimesh, load_mesh, load_shapes
from wrt.io.mesh.parts import DEFAULT_REFLECTANCE
from wrt.scene.srgb import linear_from_srgb

ASSETS = Path(__file__).resolve().parent.parent.parent / "shared" / "assets"
needs_assets = pytest.mark.skipif(not ASSETS.is_dir(), reason="the test assets are not beside this checkout")


# Real files ---------------------------------------------------------------------------------------


@needs_assets
@pytest.mark.parametrize(
    ("name", "count", "closed"),
    [
        ("stanford-bunny.obj", 69451, False),
        ("nefertiti.obj", 99938, True),
        ("spot.obj", 5856, True),
        ("igea.ply", 268686, True),
        ("Duck.glb", 4212, False),
        ("AlphaBlendModeTest.glb", 61, False),
        ("fuze/fuze.obj", 1000, False),
    ],
)
def test_real_files_load_whole_and_consistently_wound(name, count, closed):
    mesh = load_mesh(ASSETS / "meshes" / name)
    assert len(mesh.faces) == count
    assert mesh.normals is not None
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-5)
    if name != "AlphaBlendModeTest.glb":  # layers of decals there
        assert repeated_edges(mesh) == 0
        assert volume(mesh.translated(-mesh.bounds.mean(axis=0))) > 0.0
    if closed:
        assert np.abs(area_vector(mesh)).max() < 1e-5 * area(mesh)


@needs_assets
def test_igea_strips_keep_every_vertex_and_bridge_nothing():
    mesh = load_mesh(ASSETS / "meshes" / "igea.ply", smooth_degrees=None)
    assert len(mesh.vertices) == 134345
    # A closed surface of genus 0: F = 2 V - 4.
    assert len(mesh.faces) == 2 * 134345 - 4
    longest = np.linalg.norm(np.diff(triangles(mesh)[:, [0, 1, 2, 0]], axis=1), axis=2).max()
    assert longest < 0.02 * np.linalg.norm(np.diff(mesh.bounds, axis=0))


@needs_assets
def test_textures_of_real_files_lie_right():
    duck = load_shapes(ASSETS / "meshes" / "Duck.glb")[0]
    texture = duck.material.base_color
    assert isinstance(texture, wrt.ImageTexture)
    assert texture.pixels.shape == (512, 512, 3)
    # The duck is yellow: sampled where its vertices lie, red and green are far above blue.
    height, width, _ = texture.pixels.shape
    u, v = duck.mesh.uvs.T
    sampled = texture.pixels[((1.0 - v) * height).astype(int) % height, (u * width).astype(int) % width]
    red, green, blue = np.median(sampled, axis=0)
    assert red > 0.6
    assert green > 0.4
    assert blue < 0.1
    fuze = load_shapes(ASSETS / "meshes" / "fuze" / "fuze.obj")[0]
    assert fuze.material.base_color.name == "fuze uv.jpg"
    assert fuze.mesh.uvs is not None


@needs_assets
@pytest.mark.parametrize("path", sorted((ASSETS / "broken").glob("*")), ids=lambda p: p.name)
def test_broken_files_load_or_are_refused_in_one_line(path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # numpy's among them
        warnings.simplefilter("ignore", InputWarning)
        try:
            shapes = load_shapes(path)
        except wrt.InputError as error:
            check_message(error, path)
            assert path.name in {"obj_empty.obj", "obj_points.obj", "ply_empty_bin.ply", "ply_empty_header.ply"}
        else:
            assert sum(len(shape.mesh.faces) for shape in shapes) > 0


@needs_assets
def test_colors_that_are_not_finite_are_left_out_with_a_warning():
    with pytest.warns(InputWarning, match=r"nancolor\.obj: vertex colours are left out"):
        shape = load_shapes(ASSETS / "broken" / "nancolor.obj")[0]
    assert shape.mesh.colors is None
    assert shape.material.reflectance == DEFAULT_REFLECTANCE
    assert len(shape.mesh.faces) == 12


# What can be wrong with any file -------------------------------------------------------------------


def test_missing_directory_empty_and_unknown_files_are_refused(tmp_path):
    with pytest.raises(wrt.InputError, match=r"none\.obj: no such file"):
        load_mesh(tmp_path / "none.obj")
    (tmp_path / "folder.obj").mkdir()
    with pytest.raises(wrt.InputError, match="is a directory"):
        load_mesh(tmp_path / "folder.obj")
    with pytest.raises(wrt.InputError, match=r"mesh\.xyz: not a known mesh format"):
        load_mesh(write(tmp_path, "mesh.xyz", "1 2 3"))
    for suffix in ("obj", "ply", "stl", "off", "glb", "gltf"):
        with pytest.raises(wrt.InputError, match="the file is empty"):
            load_mesh(write(tmp_path, f"empty.{suffix}", ""))
        with pytest.raises(wrt.InputError, match=f"noise.{suffix}: "):
            load_mesh(write(tmp_path, f"noise.{suffix}", bytes(range(256)) * 3))


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_unreadable_file_is_refused(tmp_path):
    path = write(tmp_path, "mesh.obj", SQUARE + "f 1 2 3\n")
    path.chmod(0)
    with pytest.raises(wrt.InputError, match="cannot be read: Permission denied"):
        load_mesh(path)


def test_positions_that_are_not_finite_are_refused_by_value(tmp_path):
    for word in ("nan", "inf", "1e39"):
        path = write(tmp_path, "mesh.obj", f"v 0 0 0\nv 1 {word} 0\nv 1 1 0\nf 1 2 3\n")
        with pytest.raises(wrt.InputError, match=r"a vertex is at 1 \S+ 0; positions must be finite"):
            load_mesh(path)


def test_faces_without_area_are_dropped_and_nothing_else_left_is_refused(tmp_path):
    path = write(tmp_path, "mesh.obj", SQUARE + "v 0 0 0\nf 1 2 3\nf 1 1 2\nf 1 5 2\n")
    with pytest.warns(InputWarning, match=r"mesh\.obj: 2 of 3 triangles are left out: .* no area"):
        assert len(load_mesh(path).faces) == 1
    with pytest.raises(wrt.InputError, match="no triangles"):
        load_mesh(write(tmp_path, "mesh.obj", SQUARE + "f 1 1 2\n"))


def box_files(folder: Path) -> dict[str, Path]:
    """The same box in every format: no reader's idea of it may differ."""
    box = wrt.box((0, 0, 0), (1, 2, 3))
    points, faces = box.vertices.astype("<f4"), box.faces.astype("<i4")
    text_v = "\n".join(" ".join(map(str, p)) for p in points.tolist()) + "\n"
    text_f = "\n".join("3 " + " ".join(map(str, f)) for f in faces.tolist()) + "\n"
    corners = points[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).astype("<f4")
    rows = zip(normals.tolist(), corners.reshape(-1, 9).tolist(), strict=True)
    records = b"".join(struct.pack("<12fH", *n, *t, 0) for n, t in rows)
    ascii_stl = "solid box\n"
    for (x, y, z), t in zip(normals.tolist(), corners, strict=True):
        ascii_stl += f" facet normal {x} {y} {z}\n  outer loop\n"
        ascii_stl += "".join(f"   vertex {x} {y} {z}\n" for x, y, z in t.tolist()) + "  endloop\n endfacet\n"
    head = "ply\nformat {} 1.0\ncomment a box\nelement vertex 8\nproperty float x\nproperty float y\n"
    head += "property float z\nelement face 12\nproperty list uchar int vertex_indices\nend_header\n"
    small = b"".join(struct.pack("<B3i", 3, *f) for f in faces.tolist())
    big = b"".join(struct.pack(">B3i", 3, *f) for f in faces.tolist())
    contents: dict[str, str | bytes] = {
        "box.obj": "".join(f"v {x} {y} {z}\n" for x, y, z in points.tolist())
        + "".join(f"f {a} {b} {c}\n" for a, b, c in (faces + 1).tolist()),
        "ascii.stl": ascii_stl + "endsolid box\n",
        "binary.stl": b"solid though binary".ljust(80) + struct.pack("<I", 12) + records,
        "box.off": f"OFF # a box\n8 12 0\n{text_v}{text_f}",
        "ascii.ply": head.format("ascii") + text_v + text_f,
        "little.ply": head.format("binary_little_endian").encode() + points.tobytes() + small,
        "big.ply": head.format("binary_big_endian").encode() + points.astype(">f4").tobytes() + big,
        "box.gltf": json.dumps(gltf_box(points, faces)),
    }
    return {name: write(folder, name, content) for name, content in contents.items()}


def test_every_format_gives_the_same_box(tmp_path):
    for path in box_files(tmp_path).values():
        mesh = load_mesh(path)
        assert len(mesh.faces) == 12, path
        assert len(mesh.vertices) == 24, path  # split at the edges, which are sharp
        np.testing.assert_array_equal(mesh.bounds, [[0, 0, 0], [1, 2, 3]])
        assert volume(mesh) == pytest.approx(6.0), path
        flat = np.cross(*np.moveaxis(np.diff(triangles(mesh), axis=1), 1, 0))
        flat /= np.linalg.norm(flat, axis=1, keepdims=True)
        np.testing.assert_allclose(mesh.normals[mesh.faces], np.repeat(flat[:, None], 3, axis=1), atol=1e-6)


def test_files_cut_short_or_with_bytes_changed_never_fail_otherwise(tmp_path):
    rng = np.random.default_rng(7)
    for path in box_files(tmp_path).values():
        good = path.read_bytes()
        target = tmp_path / f"damaged{path.suffix}"
        for trial in range(60):
            data = bytearray(good)
            if trial % 2:
                data = data[: rng.integers(1, len(data))]
            for _ in range(rng.integers(0, 4)):
                data[rng.integers(len(data))] = rng.integers(256)
            target.write_bytes(data)
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                warnings.simplefilter("ignore", InputWarning)
                try:
                    mesh = load_mesh(target)
                except wrt.InputError as error:
                    check_message(error, target)
                else:
                    assert np.isfinite(mesh.normals).all()


def test_truncated_binary_files_say_so(tmp_path):
    files = box_files(tmp_path)
    for name in ("binary.stl", "little.ply", "big.ply", "ascii.ply", "ascii.stl"):
        path = files[name]
        path.write_bytes(path.read_bytes()[:-40])
        with pytest.raises(wrt.InputError, match="truncated"):
            load_mesh(path)


def test_absurd_counts_are_refused_at_once(tmp_path):
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 4000000000000\nproperty float x\nproperty float y\n"
    path = write(tmp_path, "huge.ply", head + "property float z\nend_header\n1234")
    start = time.perf_counter()
    with pytest.raises(wrt.InputError, match="truncated"):
        load_mesh(path)
    tree = gltf_box(np.zeros((3, 3), np.float32), np.zeros((1, 3), np.int32))
    tree["accessors"][0]["count"] = 10**15
    with pytest.raises(wrt.InputError, match="not a whole GLTF file"):
        load_mesh(write(tmp_path, "huge.gltf", json.dumps(tree)))
    assert time.perf_counter() - start < 5.0


def test_what_trimesh_logs_about_damaged_files_is_not_passed_on(tmp_path, caplog):
    import trimesh

    with caplog.at_level("DEBUG", logger=trimesh.constants.log.name):
        write(tmp_path, "mesh.mtl", "newmtl x\nKd a b c\nmap_Kd none.png\n")
        with pytest.warns(InputWarning, match=r"none\.png"):
            load_mesh(write(tmp_path, "mesh.obj", "mtllib mesh.mtl\n" + SQUARE + "usemtl x\nf 1 2 3 4\n"))
        with pytest.raises(wrt.InputError):
            load_mesh(write(tmp_path, "mesh.ply", "ply\nformat ascii 1.0\nend_header"))
        assert not caplog.records
        trimesh.load_scene(tmp_path / "mesh.obj")
        assert caplog.records  # it is heard again, and there was something to hear


# trimesh objects ----------------------------------------------------------------------------------


def test_from_trimesh_takes_colors_textures_transforms_and_given_normals():
    import trimesh
    from PIL import Image

    box = trimesh.creation.box()
    assert box.vertex_normals.shape == (8, 3)  # computed by trimesh: rounds the box off
    shape = from_trimesh(box)[0]
    assert shape.material.reflectance == DEFAULT_REFLECTANCE
    assert len(shape.mesh.vertices) == 24
    assert volume(shape.mesh) == pytest.approx(1.0)

    given = np.tile([0.0, 0.6, 0.8], (8, 1))
    kept = from_trimesh(trimesh.Trimesh(box.vertices, box.faces, vertex_normals=given, process=False))[0]
    np.testing.assert_allclose(kept.mesh.normals, given, atol=1e-6)

    colored = trimesh.Trimesh(box.vertices, box.faces, vertex_colors=np.full((8, 4), 128, np.uint8), process=False)
    clear = from_trimesh(colored)[0]
    np.testing.assert_allclose(clear.mesh.colors, [[linear_from_srgb(128 / 255)] * 3 + [128 / 255]] * 24, rtol=1e-6)
    assert clear.material.opacity.alpha
    colored.visual.vertex_colors[:, 3] = 255
    opaque = from_trimesh(colored)[0]
    np.testing.assert_allclose(opaque.mesh.colors, linear_from_srgb(128 / 255), rtol=1e-6)
    assert opaque.mesh.colors.shape == (24, 3)
    assert opaque.material.opacity == 1.0
    faces = trimesh.Trimesh(box.vertices, box.faces, face_colors=[[255, 0, 0, 51]] * 12, process=False)
    np.testing.assert_allclose(from_trimesh(faces)[0].mesh.colors, [[1.0, 0.0, 0.0, 0.2]] * 36, rtol=1e-6)

    image = Image.fromarray(np.full((2, 2, 3), 200, np.uint8))
    uv = np.linspace(0, 1, 16).reshape(8, 2)
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=image, baseColorFactor=[255, 51, 255, 255])
    laid = trimesh.Trimesh(box.vertices, box.faces, process=False)
    laid.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    scene = trimesh.Scene()
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    mirror[0, 3] = 7.0
    scene.add_geometry(laid, transform=mirror)
    (moved,) = from_trimesh(scene)
    np.testing.assert_allclose(moved.mesh.bounds, [[6.5, -0.5, -0.5], [7.5, 0.5, 0.5]])
    assert volume(moved.mesh.translated([-7, 0, 0])) == pytest.approx(1.0)
    bright = float(linear_from_srgb(200 / 255))
    tinted = moved.material.base_color.pixels[0, 0] * moved.material.base_color.factor
    np.testing.assert_allclose(tinted, [bright, bright * 0.2, bright], rtol=1e-5)


# Arrays, and places far away ----------------------------------------------------------------------


@pytest.mark.parametrize("channels", [3, 4])
def test_a_bare_mesh_has_its_colors_and_else_the_material_of_files(channels, tmp_path):
    vertices, faces = np.eye(3), [[0, 1, 2]]
    colors = np.linspace(0.0, 1.0, 3 * channels).reshape(3, channels)
    np.savez(tmp_path / "colored.npz", vertices=vertices, faces=faces, colors=colors)
    for source in (wrt.Mesh(vertices, faces, colors=colors), tmp_path / "colored.npz"):
        material = wrt.load(source).shapes[0].material
        assert material.reflectance == wrt.VertexColor()
        assert material.opacity == (wrt.VertexColor(alpha=True) if channels == 4 else 1.0)
        assert wrt.load(source, material="gold").shapes[0].material != material
    write(tmp_path, "own.toml", '[[shapes]]\ntype = "mesh"\nfile = "colored.npz"\n')
    assert wrt.load(tmp_path / "own.toml").shapes[0].material == wrt.Diffuse()
    plain = wrt.Mesh(vertices, faces)
    assert wrt.load(plain).shapes[0].material.reflectance == DEFAULT_REFLECTANCE


def test_colors_that_are_codes_are_refused():
    for codes in (np.full((3, 3), 200, np.uint8), np.full((3, 4), 255)):
        with pytest.raises(wrt.InputError, match=r"mesh: colors must be linear numbers, not codes up to 2"):
            wrt.Mesh(np.eye(3), [[0, 1, 2]], colors=codes)
    assert wrt.Mesh(np.eye(3), [[0, 1, 2]], colors=np.eye(3, dtype=int)).colors is not None
    bright = wrt.Mesh(np.eye(3), [[0, 1, 2]], colors=np.full((3, 3), 1.5))  # it may be meant to shine
    with pytest.raises(wrt.InputError, match=r"mesh: colors must be linear, from 0 to 1; they are from 1.5 to 1.5"):
        wrt.load(bright)
    assert bright._repr_png_() is None


def test_a_mesh_with_map_coordinates_is_shown_as_exactly_as_at_the_origin(tmp_path):
    away = np.array([448262.0, 5411932.0, 120.0])
    corners = np.random.default_rng(3).random((30, 3))
    faces = np.arange(30).reshape(-1, 3)
    lines = [
        *("v {:.9f} {:.9f} {:.9f}".format(*p) for p in corners + away),
        *("f {} {} {}".format(*f + 1) for f in faces),
    ]
    path = write(tmp_path, "map.obj", "\n".join(lines))
    for source in (path, trimesh.Trimesh(corners + away, faces, process=False)):
        shown = triangles(wrt.load(source, up="y", strict=True).shapes[0].mesh)
        edges = shown - shown[:, :1]
        expected = corners[faces]
        np.testing.assert_allclose(edges, expected - expected[:, :1], atol=1e-6)
    # In a scene of one's own it stays where it is.
    with pytest.warns(InputWarning, match="move it to the origin"):
        assert load_mesh(path).bounds[0, 1] > 5e6
    with pytest.raises(wrt.InputError, match=r"a face names vertex 2, but there are 0"):
        wrt.load(write(tmp_path, "none.off", "OFF\n0 1 0\n3 0 1 2\n"))


def test_arrays_that_single_precision_would_snap_to_a_grid_are_named():
    corners = np.random.default_rng(3).random((30, 3))
    faces, away = np.arange(30).reshape(-1, 3), np.array([448262.0, 120.0, 5411932.0])
    with pytest.warns(InputWarning, match=r"^map: it is 1\.\d+ across and up to 5\.4.* move it to the origin$"):
        wrt.Mesh(corners + away, faces, name="map")
    for harmless in (corners + 1e4, (corners + away).astype(np.float32), 1e4 * corners + away, corners * 0.0 + away):
        wrt.Mesh(harmless, faces)
    # What wrt makes itself stands where it was put; the mesh in the studio is the one to move.
    wrt.quad(tuple(away), (1, 0, 0), (0, 1, 0)), wrt.box(tuple(away), tuple(away + 1.0)), wrt.sphere(tuple(away))
    with pytest.warns(InputWarning, match="^map: ") as caught:
        wrt.load(wrt.Mesh(corners + away, faces, name="map"))
    assert len(caught) == 1
