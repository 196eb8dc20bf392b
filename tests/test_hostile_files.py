"""What is not a file, what has an odd name, and what is out of all proportion: refused in one line, or shown."""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from support.meshes import SQUARE, write
from test_cli import without_progress

import wrt
from wrt.errors import LONGEST_MESSAGE, InputWarning, one_line
from wrt.io import npy
from wrt.io.images import load_image
from wrt.io.load_mesh import load_file, load_mesh
from wrt.io.mesh.polygons import triangulate
from wrt.io.npy import read_archive, read_array
from wrt.io.safe_read import read_file

SEEDS = ROOT / "tests" / "corpus" / "seeds"
SUFFIXES = ("obj", "ply", "stl", "off", "gltf", "glb", "npz", "toml", "xml")


def run(*arguments: str, **options) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "wrt", *arguments]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(command, env=environment, capture_output=True, timeout=300, check=False, **options)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_pipes_links_in_circles_folders_and_empty_files_are_refused(tmp_path: Path, suffix: str):
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


def test_devices_are_never_read(tmp_path: Path):
    for name in ("/dev/zero", "/dev/random", "/proc/kmsg"):
        with pytest.raises(wrt.InputError, match=r"a device|is empty|cannot be read"):
            read_file(Path(name))
    write(tmp_path, "m.mtl", "newmtl m\nKd 0.5 0.5 0.5\nmap_Kd /dev/zero\nmap_Pr /dev/random\n")
    path = write(tmp_path, "mesh.obj", "mtllib m.mtl\nvt 0 0\n" + SQUARE + "usemtl m\nf 1/1 2/1 3/1\n")
    with pytest.warns(InputWarning, match="a pipe or a device"):
        assert len(load_file(path).shapes) == 1


def test_images_beside_the_folder_are_read(tmp_path: Path):
    (tmp_path / "scenes").mkdir()
    shutil.copy(SEEDS / "colors.png", tmp_path)
    write(tmp_path / "scenes", "m.mtl", "newmtl m\nmap_Kd ../colors.png\n")
    text = "mtllib m.mtl\nvt 0 0\nvt 1 0\nvt 0 1\n" + SQUARE + "usemtl m\nf 1/1 2/2 3/3\n"
    shape = load_file(write(tmp_path / "scenes", "mesh.obj", text)).shapes[0]
    assert isinstance(shape.material.reflectance, wrt.ImageTexture)


def test_messages_are_one_line_whatever_is_in_them():
    error = wrt.InputError("a\nb\x1b[31m\r\udcff" + "x" * 5000)
    assert str(error).startswith("a\\nb\\x1b[31m\\r\\udcff")
    assert str(error).isprintable()
    assert len(str(error)) == LONGEST_MESSAGE
    assert one_line("Größe: 3 µm") == "Größe: 3 µm"


def test_sizes_beyond_single_precision(tmp_path: Path):
    def mesh(scale: str, offset: float = 0.0) -> Path:
        size = float(scale)
        rows = [(offset, 0, 0), (offset + size, 0, 0), (offset, size, 0), (offset, 0, size)]
        text = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in rows)
        return write(tmp_path, "mesh.obj", text + "f 1 2 3\nf 1 2 4\nf 1 3 4\n")

    for scale in ("1e12", "1e-10"):
        assert len(load_mesh(mesh(scale)).faces) == 3
    with pytest.raises(wrt.InputError, match=r"mesh\.obj: its vertices reach to 1e\+13.* scale it down"):
        load_mesh(mesh("1e13"))
    with pytest.raises(wrt.InputError, match=r"mesh\.obj: it is .*e-12 across.* scale it up"):
        load_mesh(mesh("1e-12"))
    with pytest.warns(InputWarning, match=r"mesh\.obj: .* from the origin, .* move it to the origin"):
        load_mesh(mesh("1", 1e6))
    with pytest.raises(wrt.InputError, match="a vertex is at nan 0 0"):
        load_mesh(write(tmp_path, "mesh.obj", "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"))
    off = write(tmp_path, "mesh.off", "OFF\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 inf 0\n3 0 1 3\n")
    with pytest.raises(wrt.InputError, match=r"vertex 3 .*is at 0 inf 0"):
        load_mesh(off)


def test_tiny_and_huge_meshes_look_like_others():
    """Lengths are scaled by powers of two, so pictures are equal but for the rounding of what is not scaled."""
    pictures = []
    for exponent in (0, -33, 33):
        mesh = wrt.sphere(subdivisions=2).scaled(2.0**exponent)
        pictures.append(wrt.render(mesh, width=24, height=18, spp=2))
    for picture in pictures[1:]:
        np.testing.assert_allclose(picture, pictures[0], rtol=1e-3, atol=1e-4)


def test_promised_sizes_are_checked_before_memory_is_taken(tmp_path: Path, monkeypatch):
    np.save(tmp_path / "a.npy", np.zeros((4, 4, 3), np.float32))
    data = (tmp_path / "a.npy").read_bytes()
    with pytest.raises(wrt.InputError, match=r"takes .* bytes, but the file has 192"):
        read_array(data.replace(b"(4, 4, 3)", b"(99999,3)"))
    monkeypatch.setattr(npy, "_SMALL", 2**20)  # the true limit takes long to write
    np.savez_compressed(tmp_path / "bomb.npz", vertices=np.zeros(2**18, np.float64))
    with pytest.raises(wrt.InputError, match=r"bomb\.npz: .*many times larger than the file"):
        load_mesh(tmp_path / "bomb.npz")
    with zipfile.ZipFile(tmp_path / "other.zip", "w") as archive:
        archive.writestr("vertices.npy", b"nothing")
    with pytest.raises(wrt.InputError, match="not a NumPy file"):
        read_archive((tmp_path / "other.zip").read_bytes())
    (tmp_path / "bomb.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 20000 +X 60000\n\2\2")
    with pytest.raises(wrt.InputError, match=r"too large|claims"):
        load_image(tmp_path / "bomb.hdr")
    scene = "".join('[[shapes]]\ntype = "sphere"\nsubdivisions = 9\n' for _ in range(6))
    with pytest.raises(wrt.InputError, match="more than 30000000 triangles"):
        wrt.load(write(tmp_path, "many.toml", scene))


def test_polygons_that_cross_themselves_end():
    points = np.random.default_rng(0).random((1500, 3)) * (1.0, 1.0, 0.0)
    triangles, _ = triangulate(points, np.arange(1500), np.array([1500]))
    assert triangles.shape == (1498, 3)


def test_corners_are_keyholes_only_where_they_meet():
    # Corner 3 has the x of one corner of the triangle 0 1 2 and the y of another, and lies inside.
    points = np.array([[0, 0, 0], [4, 1, 0], [2, 5, 0], [2, 1, 0]], float)
    triangles, _ = triangulate(points, np.arange(4), np.array([4]))
    a, b, c = (points[triangles[:, k]] for k in range(3))
    areas = 0.5 * np.cross(b - a, c - a)[:, 2]
    assert (areas > 0.0).all()


@pytest.mark.parametrize("name", ["new\nline  b", "esc\x1b[31m", "\udcff\udcfe日本"])
def test_odd_names_are_rendered_and_shown_in_one_line(tmp_path: Path, name: str):
    shutil.copy(SEEDS / "little.ply", tmp_path / f"{name}.ply")
    result = run("render", f"./{name}.ply", "--size", "16x12", "--spp", "1", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert (tmp_path / f"{name}.png").is_file()
    said = without_progress(result.stderr.decode(errors="replace"))
    assert said.rstrip("\n").count("\n") == 0
    told = run("info", f"./{name}.ply", cwd=tmp_path)
    assert told.returncode == 0, told.stderr
    assert b"\x1b" not in told.stdout + result.stderr


def test_a_full_disk_and_links_in_circles_end_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def small() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))

    # With a limit on files, Python would leave truncated modules in its cache for all later tests.
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    options = ("render", str(SEEDS / "little.ply"), "--size", "64x64", "--spp", "1", "--quiet")
    run(*options, "-o", "whole.png", cwd=tmp_path)  # kernels are in the cache from here on
    for name in ("x.png", "x.exr"):
        result = run(*options, "-o", name, cwd=tmp_path, preexec_fn=small)
        assert result.returncode == 1, result.stderr
        assert result.stderr.startswith(f"wrt: error: {name}: cannot be written".encode())
        assert result.stderr.count(b"\n") == 1
    (tmp_path / "loop").symlink_to("loop")
    result = run(*options, "-o", "y.png", "--checkpoint", "loop", cwd=tmp_path)
    assert result.returncode == 2
    assert result.stderr.startswith(b"wrt: error: loop: cannot be written")
    assert result.stderr.count(b"\n") == 1
    assert [path.name for path in tmp_path.iterdir() if path.suffix in (".png", ".exr", ".npy")] == ["whole.png"]
