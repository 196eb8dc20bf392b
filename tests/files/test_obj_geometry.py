"""Geometry of OBJ files: numbers in any notation, faces of any kind, and every statement accounted for."""

import warnings

import numpy as np
import pytest
from conftest import ROOT
from support.meshes import SQUARE, write

from wrt.errors import InputError, InputWarning
from wrt.io.load_mesh import load_mesh
from wrt.io.mesh.obj import read_obj
from wrt.io.mesh.obj_kernel import read_lines
from wrt.io.mesh.obj_text import _COLUMNS, ObjText


@pytest.mark.parametrize("zeros", [0, 2])
def test_numbers_and_corners_of_obj_are_those_of_python(zeros, tmp_path, monkeypatch):
    """Of each notation, of polygons of any kind between materials, in chunks of some lines and in one."""
    rng = np.random.default_rng(zeros)
    points = rng.normal(size=(60, 3)) * 10.0 ** rng.integers(-3, 4, (60, 1))
    rows = list(enumerate(points.tolist()))
    notations = "{:.6f}", "{:g}", "{:+.3f}", "{:.0f}.", "{!r}", "{:e}", "{:.1f}"
    words = [[notations[(3 * i + j) // 40 % 7].format(x) for j, x in enumerate(row)] for i, row in rows]
    text = "".join(f"v {' '.join(row)}{' 1' * (zeros > 0)}\n" for row in words)
    text += "".join(f"vt {u:.3f}{' 0' * (i % (zeros + 1))}\nvn 0 {i} 1e0\n" for i, u in enumerate(points[:, 0]))
    expected = []
    for i in range(0, 40, 3):
        kind = ("{0}", "{0}/{0}", "{0}//{0}", "{0}/{0}/{0}")[i % 4]
        for count in (3, 3, 4, 5)[: 1 + i % 4]:
            corners = [i + k for k in range(count)]
            numbers = [k + 1 if i % 2 else k - 60 for k in corners]
            text += f"usemtl m{i % 2}\nf {' '.join(kind.format(k) for k in numbers)}\n"
            expected.append((corners, i % 2, "/" in kind and "//" not in kind, kind.count("/") == 2))
    path = tmp_path / "mesh.obj"
    for chunk in (1 << 20, 100):
        monkeypatch.setattr("wrt.io.mesh.obj_text._CHUNK", chunk)
        found = ObjText(path, text.encode())
        np.testing.assert_array_equal(found.rows["v"][:, :3], [[float(word) for word in row] for row in words])
        np.testing.assert_array_equal(found.rows["vn"][:, 1], np.arange(60))
        ends = np.cumsum(found.counts)
        for (corners, material, has_uvs, has_normals), end, count, number in zip(
            expected, ends, found.counts, found.face_materials, strict=True
        ):
            rows = found.corners[end - count : end]
            assert (rows[:, 0].tolist(), number - 1) == (corners, material)
            for column, given in ((1, has_uvs), (2, has_normals)):
                assert rows[:, column].tolist() == (corners if given else [-1] * len(corners))


def attributes_of(text: ObjText) -> dict[str, object]:
    """Return what was read, without the numbers of data that the file lacks; -0.0 as 0.0."""
    rows = {kind: (each + 0.0).tobytes() for kind, each in text.rows.items() if len(each)}
    arrays = text.corners, text.counts, text.face_materials, text.face_smoothing
    faces = {"faces": [None if each is None else each.tolist() for each in arrays], "rows": rows}
    names = "materials", "libraries", "others", "colors_are_partial"
    return faces | {name: getattr(text, name) for name in names}


def odd_obj() -> bytes:
    """Return numbers of all notations, polygons, and lines of every kind between them."""
    rng = np.random.default_rng(4)
    notations = "{:.6f}", "{!r}", "{:+.18e}", "{:g}", "{:.17g}", "{:.0f}.", "{:.3E}"
    numbers = rng.normal(size=3000) * 10.0 ** rng.integers(-15, 12, 3000)
    words = [notations[k % 7].format(x) for k, x in enumerate(numbers.tolist())]
    # Halves between two doubles, and a bit beside them; 19 digits; no digits before or after the point.
    words += ["9007199254740993", "9007199254740993.001", "9007199254740992.9", "9999999999999999999", "1.5e22"]
    words += [".5", "5.", "-.25e1", "00012.50", "0e5", "-0", "0.00000000000000000001", "1e-22", "1e2"]
    kept = [word for word in words if len(word.partition("e")[0].strip("+-0.")) < 20]
    lines = [" ".join(("v", *kept[k : k + 3])) for k in range(0, len(kept) - 2, 3)]
    lines += ["vt 0.25 1 0 # three", "\tvt\t0.5  .75\t", "vn 0 1 0 7", "# v 1", "g  a  b", "usemtl one  two", "s 1", ""]
    lines += ["f 1 2 3", "f 1/1 2/2 3/-1 4/1", "s off", "f\t-1//-1  -2//1 -3//1#c", "l 1 2", "f 5/1/1 6/2/1 7//", "f"]
    return "\n".join([*lines, "mtllib a b.mtl", "v 1 2 3", "usemtl", "f -1 -2 -3", "usemtl three"]).encode()


def test_the_kernel_reads_from_obj_what_numpy_does(tmp_path, monkeypatch):
    files = [path.read_bytes() for path in sorted((ROOT / "tests" / "corpus").rglob("*.obj"))]
    read = []
    for data in [odd_obj(), odd_obj().replace(b"\n", b"\r\n"), *files]:
        results = []
        for sizes in (range(0), range(1 << 30)):
            monkeypatch.setattr("wrt.io.mesh.obj_text.SIZES", sizes)
            monkeypatch.setattr("wrt.io.mesh.obj_kernel._CHUNK", 1000)
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                try:
                    results.append(attributes_of(ObjText(tmp_path / "mesh.obj", data)))
                except InputError as error:
                    results.append({"error": str(error)})
            results[-1]["warnings"] = [str(each.message) for each in caught]
        assert results[0] == results[1]
        read.append(read_lines(data.replace(b"\r", b""), _COLUMNS) is not None)
    assert read[:2] == [True, True]


def test_the_kernel_leaves_to_numpy_what_it_cannot_read() -> None:
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\n{}\nf 1 2 3\n"
    assert read_lines(text.format("v 1 2 3").encode(), _COLUMNS) is not None
    numbers = ["nan", "x", "3x", "1_0", ".", "1e", "1e400", "99999999999999999999", "-", "0x1", "1-2"]
    corners = ["0", "-4", "3x", "2/x", "1//1/1", "1.0", "12345678901", "/1", "1/-2", "+1"]
    lines = [*(f"v 1 2 {word}" for word in numbers), *(f"f 1 2 {word}" for word in corners)]
    for line in [*lines, "v 1 2", "v 1 2 3 4", "vt ", "vn 1 2", "f "]:
        assert read_lines(text.format(line).encode(), _COLUMNS) is None, line


OBJ_STATEMENTS = """
    v vt vn f usemtl mtllib vp cstype deg bmat step p l curv curv2 surf parm trim hole scrv sp end con g s mg o bevel
    c_interp d_interp lod shadow_obj trace_obj ctech stech maplib usemap call csh res bsp bzp cdc cdp fo
"""
LINES_FOR = {"vt": "vt 0 0", "vn": "vn 0 0 1", "v": "v 0 0 0", "f": "f 1 2 3", "mtllib": "mtllib none.mtl"}


def test_each_statement_of_obj_is_used_or_excused_or_warned_of(tmp_path):
    left_out = []
    for key in OBJ_STATEMENTS.split():
        path = write(tmp_path, "mesh.obj", SQUARE + "f 1 2 3 4\n" + LINES_FOR.get(key, f"{key} 1 2") + "\n")
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            load_mesh(path)
        messages = [str(each.message) for each in caught]
        if messages == [f"{path}: {key} is unknown to wrt and left out"]:
            left_out.append(key)
        else:
            assert key in ("usemtl", "mtllib") or not messages, messages
    excused = {"g", "o", "s", "mg", "bevel", "c_interp", "d_interp", "lod"}
    assert set(left_out) == set(OBJ_STATEMENTS.split()) - excused - {"v", "vt", "vn", "f", "usemtl", "mtllib"}


def test_obj_normals_and_coordinates_that_differ_at_a_corner_part_its_vertices(tmp_path):
    uvs = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\nvn 0 1 0\n"
    faces = "f 1/1/1 2/2/1 3/3/1\nf 1/2/1 3/3/2 4/4/1\nf 4/4/1 3/3/2 1/2/1\n"
    mesh = load_mesh(write(tmp_path, "mesh.obj", SQUARE + uvs + faces), smooth_degrees=None)
    assert len(mesh.vertices) == 6  # two of the corner 1, and two of the corner 3
    expected = [[(0, 0), (1, 0), (1, 1)], [(1, 0), (1, 1), (0, 1)], [(0, 1), (1, 1), (1, 0)]]
    np.testing.assert_array_equal(mesh.uvs[mesh.faces], expected)
    up, back = (0, 0, 1), (0, 1, 0)
    np.testing.assert_array_equal(mesh.normals[mesh.faces], [[up] * 3, [up, back, up], [up, back, up]])
    np.testing.assert_array_equal(mesh.vertices[mesh.faces[0]], [[0, 0, 0], [1, 0, 0], [1, 1, 0]])


def test_obj_colors_of_some_vertices_and_faces_with_too_few_corners_are_named(tmp_path):
    text = "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 1 1 0 0 0 1\n"
    assert load_mesh(write(tmp_path, "mesh.obj", text + "f 1 2 3\n")).colors is not None
    with pytest.warns(InputWarning, match="vertex colours are left out, as some vertices have none"):
        assert load_mesh(write(tmp_path, "mesh.obj", text + "v 0 1 0\nf 1 2 3\n")).colors is None
    for more, width in (("f 1 2 3\n", 3), ("", 1)):  # a triangle, or points
        path = write(tmp_path, "mesh.obj", SQUARE + "f 1 2\nf 3\nf\n" + more)
        with pytest.warns(InputWarning, match=r"3 face\(s\) with fewer than 3 corners left out"):
            assert [part.faces.shape[1] for part in read_obj(path, path.read_bytes())] == [width]
