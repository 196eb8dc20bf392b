"""Archives, bytes and open files are read like the files in them, and hostile ones end in one line."""

import bz2
import gzip
import io
import lzma
import os
import signal
import stat
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from support.commands import start
from support.meshes import write

import wrt
from wrt.cli import main
from wrt.io import archives, memory_limits
from wrt.io.load_mesh import load_file
from wrt.io.safe_read import read_file

OBJ = "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
MTL = "newmtl m\nmap_Kd maps/red.png\n"
TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


@pytest.fixture(autouse=True)
def temporary(tmp_path, monkeypatch):
    """Make temporary folders in one folder, and check that they are removed."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    yield folder
    assert not list(folder.iterdir())


def zipped(path: Path, files: dict[str, str | bytes], method: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return path


@pytest.fixture
def model(tmp_path):
    wrt.save_image(tmp_path / "red.png", np.full((2, 2, 3), (0.5, 0.0, 0.0)))
    return {"m/a.obj": OBJ, "m/a.mtl": MTL, "m/maps/red.png": (tmp_path / "red.png").read_bytes(), "readme.txt": "a"}


def test_the_one_mesh_of_an_archive_is_read_with_its_neighbours(tmp_path, model, capsys):
    path = zipped(tmp_path / "model.zip", model | {"__MACOSX/m/._a.obj": b"\0\5\26\7"})
    data = path.read_bytes()
    for source in (path, f"{path}/m/a.obj", data, io.BytesIO(data)):
        options = {} if isinstance(source, (str, Path)) else {"file_type": "zip"}
        scene = wrt.load(source, strict=True, confined=True, **options)
        assert scene.shapes[0].material.reflectance.pixels[0, 0] == pytest.approx((0.5, 0, 0), abs=0.01)
    assert main(["info", str(path)]) == 0
    assert "1 triangle, 3 vertices, 1 material, 1 texture" in capsys.readouterr().out
    assert main(["convert", str(path), str(tmp_path / "out.toml")]) == 0
    assert main(["render", str(path), "-o", str(path)]) == 2  # it was read, and is not replaced
    # A scene names its meshes.
    shape = '[[shapes]]\ntype = "mesh"\nfile = "m/a.obj"\n'
    assert len(wrt.load(zipped(tmp_path / "scene.zip", model | {"scene.toml": shape})).shapes) == 1


def test_compressed_files_bytes_and_open_files(tmp_path):
    compressed = {
        "gz": gzip.compress(TRIANGLE),
        "bz2": bz2.compress(TRIANGLE),
        "xz": lzma.compress(TRIANGLE),
        "zip": b"",
    }
    for suffix, data in list(compressed.items())[:3]:
        (tmp_path / f"a.obj.{suffix}").write_bytes(data)
        assert len(wrt.load_mesh(tmp_path / f"a.obj.{suffix}").faces) == 1
        assert len(wrt.load_mesh(data, file_type=f"obj.{suffix}").faces) == 1
    for source in (TRIANGLE, bytearray(TRIANGLE), io.BytesIO(TRIANGLE)):
        assert len(wrt.load_mesh(source, file_type=".obj").faces) == 1
    (tmp_path / "a.obj").write_bytes(TRIANGLE)
    with open(tmp_path / "a.obj", "rb") as file:
        assert len(wrt.load_mesh(file).faces) == 1
    with pytest.warns(wrt.InputWarning, match=r"^data\.obj: 'data\.obj/a\.mtl', which it refers to"):
        wrt.load(OBJ.encode(), file_type="obj")
    with open(tmp_path / "a.obj") as text, pytest.raises(wrt.InputError, match=r"open\(path, 'rb'\)"):
        wrt.load(text)
    for source, options, message in (
        (TRIANGLE, {}, "need their type, such as file_type='glb'"),
        (io.BytesIO(TRIANGLE), {"file_type": "../obj"}, "file_type must be the suffix"),
        (tmp_path / "a.obj", {"file_type": "obj"}, "a path has its suffix"),
        (TRIANGLE, {"file_type": "glb"}, r"^data\.glb: it looks to be an OBJ file"),
    ):
        with pytest.raises(wrt.InputError, match=message):
            wrt.load(source, **options)


def test_what_is_ambiguous_or_missing_is_named(tmp_path):
    path = zipped(
        tmp_path / "two.zip", {"a.obj": TRIANGLE, "b/c.obj": b"v 0 0 broken\n", "in.zip": b"PK", "n.txt": b"n"}
    )
    for source, message in (
        (path, r"two\.zip: name one of the 2 files in it, such as .*/two\.zip/a\.obj: a\.obj, b/c\.obj$"),
        (path / "d.obj", r"two\.zip: there is no file 'd\.obj' in it"),
        (path / "../a.obj", r"two\.zip: there is no file '\.\./a\.obj' in it"),
        (path / "in.zip", "'in.zip' in it is an archive, too"),
        (path / "b/c.obj", r"two\.zip/b/c\.obj: "),  # not the temporary folder
        (
            zipped(tmp_path / "none.zip", {"x.fbx": b"Kaydara"}),
            r"none\.zip: nothing in it can be rendered; it holds x\.fbx",
        ),
    ):
        with pytest.raises(wrt.InputError, match=message) as caught:
            wrt.load(source)
        assert "temporary" not in str(caught.value)
    assert len(load_file(path / "a.obj").shapes) == 1


def hostile(folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield messages and archives that must end in them."""
    for number, name in enumerate(("../a.obj", "/a.obj", "b/../../a.obj", "..\\a.obj", "C:/a.obj")):
        yield "leads out of the archive", zipped(folder / f"{number}.zip", {name: TRIANGLE})
    link = zipfile.ZipInfo("a.obj")
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    with zipfile.ZipFile(folder / "link.zip", "w") as archive:
        archive.writestr(link, "/etc/passwd")
    yield "is a link", folder / "link.zip"
    locked = bytearray(zipped(folder / "plain.zip", {"a.obj": TRIANGLE}).read_bytes())
    locked[locked.index(b"PK\1\2") + 8] |= 1
    (folder / "locked.zip").write_bytes(locked)
    yield "it is encrypted", folder / "locked.zip"
    yield "is an archive, too", write(folder, "a.zip.gz", gzip.compress(b"PK"))
    yield "in a way that is not read", zipped(folder / "method.zip", {"a.obj": TRIANGLE}, zipfile.ZIP_BZIP2)
    yield "the limit is 10000", zipped(folder / "many.zip", {f"{k}.txt": b"" for k in range(10_001)})
    twice = zipped(folder / "both.zip", {"a.obj": TRIANGLE, "b.obj": TRIANGLE}).read_bytes()
    yield "the ZIP file is damaged", write(folder, "twice.zip", twice.replace(b"b.obj", b"a.obj"))
    yield "the ZIP file is damaged", write(folder, "cut.zip", (folder / "0.zip").read_bytes()[:40])
    yield "the compressed file is damaged", write(folder, "cut.obj.gz", gzip.compress(TRIANGLE)[:-9])
    whole, large = lzma.compress(TRIANGLE), [{"id": lzma.FILTER_LZMA2, "dict_size": 1 << 30}]
    yield "it ends early", write(folder, "cut.obj.xz", whole[:-20])
    yield "something behind its first stream", write(folder, "two.obj.xz", whole * 2)
    yield "Memory usage limit", write(folder, "large.obj.xz", lzma.compress(TRIANGLE, filters=large))
    yield "its unpacked files would take", write(folder, "bomb.obj.xz", lzma.compress(bytes(2**25), preset=0))
    # Bombs: 32 MB of zeros each.
    zeros = bytes(2**20)
    with zipfile.ZipFile(folder / "bomb.zip", "w", zipfile.ZIP_DEFLATED) as archive, archive.open("a.obj", "w") as file:
        for _ in range(32):
            file.write(zeros)
    yield "its unpacked files would take", folder / "bomb.zip"
    packer = bz2.BZ2Compressor()
    yield (
        "its unpacked files would take",
        write(folder, "bomb.obj.bz2", b"".join(packer.compress(zeros) for _ in range(32)) + packer.flush()),
    )


def test_hostile_archives_end_in_one_line(tmp_path, temporary, monkeypatch):
    monkeypatch.setattr(memory_limits, "UNPACKED", memory_limits.Limit("unpacked files", 2**20, 64))
    for message, path in hostile(tmp_path):
        with pytest.raises(wrt.InputError, match=message) as caught:
            wrt.load(path)
        assert str(path) in str(caught.value)
        assert not (tmp_path / "a.obj").exists()
        assert not list(temporary.iterdir()), path


def test_files_beyond_the_archive_are_missing_and_its_files_count_as_it_does(tmp_path):
    write(tmp_path, "secret.mtl", "newmtl m\nKd 1 0 0\n")
    outside = zipped(tmp_path / "out.zip", {"a.obj": OBJ.replace("a.mtl", f"{tmp_path}/secret.mtl")})
    with pytest.warns(wrt.InputWarning, match=r"secret\.mtl.*outside the archive"):
        wrt.load(outside)
    path = zipped(tmp_path / "zeros.zip", {"a.obj": TRIANGLE + b"\n" * 100_000})
    with archives.unpacked(path) as file, memory_limits.one_load():
        read_file(file)
        assert memory_limits.size_of_files() == path.stat().st_size < 1000


def test_ctrl_c_removes_what_was_unpacked(tmp_path, temporary):
    lines = b"".join(b"v %d %d %d\n" % (k % 7, k % 11, k % 13) for k in range(300_000))
    path = write(tmp_path, "a.obj.gz", gzip.compress(lines * 10 + b"f 1 2 3\n"))
    process = start(tmp_path, "info", str(path), env={**os.environ, "TMPDIR": str(temporary)})
    while not list(temporary.glob("wrt-unpacked-*/*")):
        assert process.poll() is None
    process.send_signal(signal.SIGINT)
    assert "Traceback" not in process.communicate(timeout=60)[1]
    assert process.returncode == 130
