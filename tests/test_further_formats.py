"""COLLADA files are read by trimesh's extra, 3MF files without one, and STEP is told apart."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest
from support.meshes import write

import wrt
from wrt.io.load_mesh import load_file, load_mesh


def test_3mf_and_collada_files(tmp_path):
    pytest.importorskip("lxml")
    pytest.importorskip("networkx")
    pytest.importorskip("collada")
    import trimesh
    from trimesh.exchange.dae import export_collada

    mesh = trimesh.creation.box(extents=(1, 2, 3))
    for kind in ("3mf", "dae"):
        exported = export_collada(mesh) if kind == "dae" else trimesh.Scene(mesh).export(file_type=kind)
        scene = load_file(write(tmp_path, f"box.{kind}", exported))
        low, high = scene.bounds
        np.testing.assert_allclose(high - low, [1, 2, 3], atol=1e-5)
        assert sum(len(shape.mesh.faces) for shape in scene.shapes) == 12
        with pytest.raises(wrt.InputError, match=rf"box\.{kind}: "):
            load_file(write(tmp_path, f"box.{kind}", exported[: len(exported) // 2]))


def test_an_archive_that_would_fill_the_memory_is_refused(tmp_path):
    pytest.importorskip("lxml")
    pytest.importorskip("networkx")
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("3D/3dmodel.model", "w") as file:
        for _ in range(80):
            file.write(bytes(1 << 20))
    with pytest.raises(wrt.InputError, match="its meshes would take"):
        load_file(write(tmp_path, "bomb.3mf", held.getvalue()))


def test_without_the_extra_it_is_named(tmp_path, monkeypatch):
    from trimesh.exchange.load import mesh_loaders

    monkeypatch.delitem(mesh_loaders, "dae", raising=False)
    with pytest.raises(wrt.InputError, match=r"\.dae files need further libraries: pip install 'wrt\[formats\]'"):
        load_mesh(write(tmp_path, "box.dae", "<COLLADA>"))


def test_step_is_told(tmp_path):
    with pytest.raises(wrt.InputError, match="a STEP file, whose surfaces are no triangles"):
        load_mesh(write(tmp_path, "part.step", b"ISO-10303-21;\nHEADER;\n"))


def test_a_contact_sheet_has_a_verdict_for_each_file(tmp_path, capsys):
    import contact_sheet  # type: ignore[import-not-found]
    from PIL import Image

    write(tmp_path, "good.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    write(tmp_path, "empty.obj", "")
    write(tmp_path, "told.obj", "mtllib none.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    options = ["--spp", "0", "--sheet", str(tmp_path / "sheet"), "--table", str(tmp_path / "files.md")]
    assert contact_sheet.main([str(tmp_path), *options]) == 0
    assert "3 files: 1 as it is, 1 refused, 1 with warnings" in capsys.readouterr().out
    text = (tmp_path / "files.md").read_text("utf-8")
    assert f"As they are: `{tmp_path.name}/good.obj`." in text
    assert "told.obj` | with warnings | 'none.mtl', which it refers to: no such file" in text
    with Image.open(tmp_path / "sheet-1.png") as sheet:
        assert sheet.width == 3 * 128
