"""What is no file, is damaged, not what its name says or out of proportion: refused in one line, or shown."""

import io
import json
import math
import os
import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from support.commands import ROOM, SMALL, without_progress
from support.mesh_files import box_files, check_refused, joined
from support.meshes import SQUARE, gltf_box, write

import wrt
from wrt.cli import main
from wrt.errors import LONGEST_MESSAGE, InputWarning, one_line
from wrt.io import npy
from wrt.io.images import load_image
from wrt.io.load_mesh import load_file, load_mesh
from wrt.io.mesh.parts import Part, moved
from wrt.io.mesh.polygons import triangulate
from wrt.io.npy import read_array

TREE = json.dumps(gltf_box(np.eye(3), np.array([[0, 1, 2]]))).encode()


def image(kind: str) -> bytes:
    buffer = io.BytesIO()
    Image.new("RGB", (8, 8)).save(buffer, kind)
    return buffer.getvalue()


XML = b'<?xml version="1.0"?>\n'
RENAME = "; rename it to end in ."
KINDS: dict[str, tuple[bytes, str]] = {
    "png": (image("PNG"), "a PNG image"),
    "obj": (b"\n# by hand\n\n" + SQUARE.encode() + b"f 1 2 3\n", f"an OBJ file{RENAME}obj"),
    "binary.stl": (b"a header".ljust(80) + struct.pack("<I", 1) + bytes(50), "a binary STL file; rename it to end in"),
    "xml": (XML + b'<!-- a -->\n<scene version="3.0.0">', f"a scene file of Mitsuba{RENAME}xml"),
    "dae": (XML + b"<COLLADA><scene/></COLLADA>", f"a COLLADA file{RENAME}dae"),
    "toml": (b"# by hand\n[camera]\norigin = [0, 0, 1]\n", f"a scene file{RENAME}toml"),
    "zip": (b"PK\x03\x04" + bytes(30), f"a ZIP archive{RENAME}zip"),
    "lfs": (b"version https://git-lfs.github.com/spec/v1\n", "a Git LFS pointer to a file that has not been fetched"),
}
NAMES = ("a.obj", "a.ply", "a.STL", "a.gltf", "a.npz", "a.toml", "a.xml", "a")


@pytest.mark.filterwarnings("ignore::wrt.errors.InputWarning")
@pytest.mark.parametrize("kind", KINDS)
def test_what_a_file_looks_to_be_is_told(tmp_path, kind):
    data, words = KINDS[kind]
    for name in NAMES:
        suffix = Path(name).suffix[1:].lower()
        if suffix == kind.split(".")[-1]:
            continue
        path = write(tmp_path, name, data)
        with pytest.raises(wrt.InputError) as caught:
            wrt.load(path)
        assert str(caught.value).startswith(f"{path}: "), name
        assert f"it looks to be {words}" in str(caught.value), name


def test_files_that_are_not_rendered_tell_what_to_do_and_content_counts_more_than_names(tmp_path):
    for name, message in (
        ("a.blend", "it is a Blender file; in Blender, export it as glTF"),
        ("a.FBX", "it is an FBX file; export it as glTF"),
        ("a.vdb", "it is an OpenVDB file; convert it to NanoVDB"),
        ("a.ply.txt", "it looks to be a PLY file; rename it to end in .ply"),
        ("a.txt", "not a known mesh format; the name must end in .obj"),
        ("a.png", "it is an image, which a scene file can name as a texture or an environment"),
    ):
        data = {"a.png": image("PNG"), "a.ply.txt": b"ply\nformat ascii 1.0\n"}.get(name, b"Some text.\n")
        with pytest.raises(wrt.InputError) as caught:
            wrt.load(write(tmp_path, name, data))
        assert str(caught.value).startswith(f"{tmp_path / name}: {message}")
    for number, found in enumerate(("nothing in it is rendered", "name a file in it, such as .*/a.obj: a.obj, b.glb$")):
        with pytest.raises(wrt.InputError, match=f"{tmp_path}: is a directory; {found}"):
            wrt.load(tmp_path)
        for each in ("b.glb", "a.obj", ".c.obj", "d.xml") if not number else ():
            write(tmp_path, each, b"<a/>")
    # The content of a glTF file decides its form
    assert len(load_file(write(tmp_path, "a.gltf", joined(json.loads(TREE), b""))).shapes) == 1
    assert len(load_file(write(tmp_path, "a.glb", TREE)).shapes) == 1
    for kind in ("obj", "xml", "toml"):
        with pytest.raises(wrt.InputError) as caught:
            wrt.load(write(tmp_path, f"a.{kind}", KINDS[kind][0][:30] + b"\xff\xfe"))
        assert "looks to be" not in str(caught.value)


@pytest.mark.parametrize("suffix", ["obj", "glb", "toml", "xml"])
def test_pipes_links_in_circles_folders_and_empty_files_are_refused(tmp_path, suffix):
    pipe, loop, folder, empty = (tmp_path / f"{name}.{suffix}" for name in ("pipe", "loop", "folder", "empty"))
    os.mkfifo(pipe)
    loop.symlink_to(loop)
    folder.mkdir()
    empty.touch()
    for path, reason in (
        (pipe, "is a pipe or a device"),
        (loop, "cannot be read"),
        (folder, "is a directory"),
        (empty, "the file is empty"),
        (tmp_path / f"none.{suffix}", "no such file"),
    ):
        with pytest.raises(wrt.InputError, match=f"{path.name}.*{reason}"):
            wrt.load(path)


def test_messages_are_one_line_whatever_is_in_them_or_in_a_name(tmp_path, monkeypatch, capfd):
    error = wrt.InputError("a\nb\x1b[31m\r\udcff" + "x" * 5000)
    assert str(error).startswith("a\\nb\\x1b[31m\\r\\udcff")
    assert str(error).isprintable()
    assert len(str(error)) == LONGEST_MESSAGE
    assert one_line("Größe: 3 µm") == "Größe: 3 µm"
    name = "new\nline \x1b[31m"
    monkeypatch.chdir(tmp_path)
    Path(f"{name}.toml").write_text(ROOM)
    assert main(["render", f"./{name}.toml", *SMALL]) == 0
    assert Path(f"{name}.png").is_file()
    messages = capfd.readouterr().err
    assert without_progress(messages).rstrip("\n").count("\n") == 0
    assert main(["info", f"./{name}.toml"]) == 0
    assert "\x1b" not in capfd.readouterr().out + messages


def test_sizes_beyond_single_precision(tmp_path):
    for size, message in (
        (1e13, r"its vertices reach to 1e\+13.* scale it down"),
        (1e-12, r"it is .*e-12 across.* scale it up"),
        (math.inf, "a vertex is at .*inf"),
        (1e12, None),
        (1e-10, None),
    ):
        text = "".join(f"v {x!r} {y!r} 0\n" for x, y in ((0.0, 0.0), (size, 0.0), (0.0, size)))
        path = write(tmp_path, "mesh.obj", text + "f 1 2 3\n")
        if message is None:
            assert len(load_mesh(path).faces) == 1
        else:
            check_refused(message, load_mesh, path)


def test_promised_sizes_are_checked_before_memory_is_taken(tmp_path, monkeypatch):
    np.save(tmp_path / "a.npy", np.zeros((4, 4, 3), np.float32))
    data = (tmp_path / "a.npy").read_bytes()
    with pytest.raises(wrt.InputError, match=r"takes .* bytes, but the file has 192"):
        read_array(data.replace(b"(4, 4, 3)", b"(99999,3)"))
    monkeypatch.setattr(npy, "_SMALL", 2**20)  # the true limit takes long to write
    np.savez_compressed(tmp_path / "bomb.npz", vertices=np.zeros(2**18, np.float64))
    with pytest.raises(wrt.InputError, match=r"bomb\.npz: .*many times larger than the file"):
        load_mesh(tmp_path / "bomb.npz")
    write(tmp_path, "bomb.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 20000 +X 30000\n\2\2")
    with pytest.raises(wrt.InputError, match=r"too large|claims"):
        load_image(tmp_path / "bomb.hdr")


def test_polygons_that_cross_themselves_end_and_corners_are_keyholes_only_where_they_meet():
    points = np.random.default_rng(0).random((300, 3)) * (1.0, 1.0, 0.0)
    triangles, _ = triangulate("a", points, np.arange(300), np.array([300]))
    assert triangles.shape == (298, 3)
    # Corner 3 has the x of one corner of the triangle 0 1 2 and the y of another, and lies inside.
    points = np.array([[0, 0, 0], [4, 1, 0], [2, 5, 0], [2, 1, 0]], float)
    triangles, _ = triangulate("a", points, np.arange(4), np.array([4]))
    a, b, c = (points[triangles[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0.0).all()


BOXES = box_files()
POINTS = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]
OFF = "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n"
SUFFIXES = "obj", "ply", "stl", "off", "glb", "gltf"
MANY = b"element vertex 4000000000000\nproperty float x\nproperty float y\nproperty float z\nend_header\n1234"


REFUSED: list[tuple[str, str | bytes, str]] = [
    ("a.txt", "1 2 3", "not a known mesh format"),
    *((f"noise.{suffix}", bytes(range(256)) * 3, "noise") for suffix in (*SUFFIXES, "3mf")),
    # Cut short, or longer than any memory
    *((name, BOXES[name][:-40], "truncated") for name in BOXES if name.endswith((".stl", ".ply"))),
    ("a.off", BOXES["big.off"][:-8], "not as long as its numbers"),
    ("a.ply", b"ply\nformat binary_little_endian 1.0\n" + MANY, "truncated"),
    ("a.gltf", TREE.replace(b'"count": 3', b'"count": 1000000000000000'), "its meshes would take"),
    # Places and corners
    *(
        ("a.obj", f"v 0 0 0\nv 1 {word} 0\nv 1 1 0\nf 1 2 3\n", r"a vertex is at 1 \S+ 0; positions must be finite")
        for word in ("nan", "1e39")
    ),
    ("a.obj", SQUARE + "f 1 2 9\n", "a face names 'v' 9, but there are 4"),
    ("a.obj", SQUARE + "f 0 1 2\n", r"line 5: a face names a 'v' that is not there \(4 are\)"),
    ("a.obj", SQUARE + "f -1 -2 -9\n", "line 5: a face names a 'v'"),
    ("a.off", OFF + "3 0 1 3\n", "names vertex 3, but there are 3"),
    # No triangles
    ("a.obj", SQUARE + "f 1 1 2\n", "no triangles"),
    ("a.obj", "hello\n", "not an OBJ file: none of its lines is a vertex"),
    ("a.obj", "P 0.3 0.3 0.4 10 1 3\n0 0 0\n1 0 0\n0 1 0\n", "a surface of MNI's neuroimaging tools"),
    (
        "a.obj",
        b"p" + struct.pack(">5fi9f", 0.3, 0.3, 0.4, 10, 1, 3, *range(9)),
        "a surface of MNI's neuroimaging tools",
    ),
    ("a.stl", bytes(range(128, 208)) + bytes(4), "no triangles in it"),  # its header is text in no encoding
    # Words and numbers
    ("a.obj", "v 0 0 0\nv 1 a 0\nv 1 1 0\nf 1 2 3\n", "something else where a number of 'v' should be"),
    ("a.obj", SQUARE + "v\nf 1 2 3\n", "'v' has no numbers"),
    ("a.obj", SQUARE + "v 1 2\nf 1 2 3\n", "line 5: 'v' has 2 numbers instead of 3"),
    ("a.obj", SQUARE + "f 1 2 3/1/1/1\n", "something in a face that is no index, from line 5 on"),
    ("a.obj", SQUARE + "f 1 2 x\n", "something in a face that is no index"),
    ("a.obj", SQUARE + "f 1 2 99999999999999999999\n", "a face names 'v' 2147483647, but there are 4"),
    ("a.ply", "ply\nformat ascii 1.0\n\nend_header\n", r"not a whole PLY file .* not as specified \(list index"),
    ("a.off", OFF.replace("1 0 0\n", "1 x 0\n") + "3 0 1 2\n", "the OFF file is damaged or not as specified"),
]


def test_files_that_cannot_be_read_are_refused_in_one_line(tmp_path):
    for name, content, message in REFUSED:
        check_refused(message, load_mesh, write(tmp_path, name, content))
    for arrays, message in (
        ({"vertices": np.zeros((3, 2)), "faces": [[0, 1, 2]]}, r"vertices must be \(N, 3\), not \(3, 2\)"),
        ({"vertices": np.zeros((3, 3))}, "there is no array 'faces' in it"),
        ({"vertices": np.array(["a"], object), "faces": [[0, 1, 2]]}, "not a NumPy archive, or damaged"),
    ):
        np.savez(tmp_path / "mesh.npz", **arrays)
        check_refused(message, load_mesh, tmp_path / "mesh.npz")


def test_colors_and_normals_of_no_use_are_told(tmp_path):
    stl = struct.pack("<80sI", b"", 1) + struct.pack("<12fH", 0, 0, 0, *np.ravel(POINTS), 0)
    for name, data, message in (
        ("a.off", f"C{OFF}3 0 1 2\n", "vertex colours of the OFF file are left out"),
        ("a.obj", "v 0 0 0 nan 0 0\nv 1 0 0 1 0 0\nv 0 1 0 1 0 0\nf 1 2 3\n", "a.obj: vertex colours are left out"),
        ("a.stl", stl, r"a\.stl: the STL file has no normals; .* the order of corners"),
    ):
        with pytest.warns(InputWarning, match=message):
            assert load_mesh(write(tmp_path, name, data)).colors is None


@pytest.mark.filterwarnings("error")
def test_normals_of_any_bits_are_taken_without_a_warning_of_numpy(tmp_path):
    """Damaged files and decoders such as Draco's give signalling NaN, which NumPy warns of."""
    normals = np.full((3, 3), 0x7F800001, np.uint32).view(np.float32)
    assert np.isnan(moved(Part("part", np.eye(3), np.array([[0, 1, 2]]), normals=normals), np.eye(4)).normals).all()
    facet = normals[0].tobytes() + struct.pack("<9fH", *np.eye(3).ravel(), 0)
    load_mesh(write(tmp_path, "a.stl", struct.pack("<80sI", b"", 1) + facet))
