"""A text file means the same in every common encoding, with or without a byte-order mark."""

from __future__ import annotations

import codecs
import shutil
from pathlib import Path

import pytest

import wrt
from wrt.errors import InputWarning
from wrt.io.encodings import as_utf8
from wrt.rendering.fingerprint import scene_fingerprint

SEEDS = Path(__file__).parent / "corpus" / "seeds"

ENCODINGS = {
    "utf-8 with a mark": ("utf-8", codecs.BOM_UTF8),
    "utf-16, little end first": ("utf-16-le", codecs.BOM_UTF16_LE),
    "utf-16, big end first": ("utf-16-be", codecs.BOM_UTF16_BE),
    "utf-32": ("utf-32-le", codecs.BOM_UTF32_LE),
}

XML = """<scene version="3.0.0">
    <sensor type="perspective"/>
    <shape type="obj"><string name="filename" value="polygons.obj"/>
        <bsdf type="diffuse"><spectrum name="reflectance" filename="green.spd"/></bsdf>
    </shape>
    <shape type="ply"><string name="filename" value="text.ply"/></shape>
</scene>
"""

# The file that is re-encoded, and the file that is loaded.
FILES = [
    ("textured.obj", "textured.obj"),
    ("polygons.obj", "polygons.obj"),
    ("paints.mtl", "textured.obj"),
    ("text.ply", "text.ply"),
    ("text.stl", "text.stl"),
    ("quads.off", "quads.off"),
    ("scene.gltf", "scene.gltf"),
    ("shapes.toml", "shapes.toml"),
    ("scene.xml", "scene.xml"),
    ("green.spd", "scene.xml"),
    ("polygons.obj", "scene.xml"),
    ("text.ply", "scene.xml"),
]


@pytest.fixture
def folder(tmp_path):
    result = tmp_path / "files"
    shutil.copytree(SEEDS, result)
    (result / "green.spd").write_text("400 0.1\n550 0.8\n700 0.2\n")
    (result / "scene.xml").write_text(XML)
    return result


@pytest.mark.filterwarnings("ignore::wrt.errors.InputWarning")
@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize(("written", "loaded"), FILES)
def test_every_reader_takes_it(written, loaded, encoding, folder):
    if written.endswith(".xml") and encoding == "utf-32":
        pytest.skip("XML parsers must support only UTF-8 and UTF-16; the next test checks the error message")
    before = scene_fingerprint(wrt.load(folder / loaded))
    name, mark = ENCODINGS[encoding]
    file = folder / written
    file.write_bytes(mark + file.read_text().encode(name))
    assert scene_fingerprint(wrt.load(folder / loaded)) == before


def test_xml_in_another_encoding_is_refused_in_one_line(folder):
    file = folder / "scene.xml"
    file.write_bytes(codecs.BOM_UTF32_LE + XML.encode("utf-32-le"))
    with pytest.raises(wrt.InputError, match=r"^\S*scene\.xml: line \d+: not well-formed XML: [^\n]*$"):
        wrt.load(file)


@pytest.mark.parametrize("name", ["polygons.obj", "text.ply", "quads.off", "shapes.toml", "scene.gltf", "scene.xml"])
def test_what_only_begins_so_is_refused_in_one_line(name, folder):
    file = folder / name
    file.write_bytes(codecs.BOM_UTF16_LE + file.read_bytes() + b"\0\xd8")
    with pytest.raises(wrt.InputError) as info:
        wrt.load(file)
    message = str(info.value)
    assert message.startswith(f"{file}: ")
    assert "\n" not in message
    assert message.count(str(file)) == 1


def test_materials_that_only_begin_so_are_told_and_left_out(folder):
    (folder / "paints.mtl").write_bytes(codecs.BOM_UTF16_LE + b"\0\xd8\0")
    told = r"paints\.mtl: begins as UTF-16 text but is invalid .*; it is left out"
    with pytest.warns(InputWarning, match=told):
        wrt.load(folder / "textured.obj")


@pytest.mark.filterwarnings("ignore:.*the STL file has no normals")
def test_a_binary_stl_file_may_begin_with_anything(folder):
    file = folder / "box.stl"
    before = scene_fingerprint(wrt.load(file))
    for mark in (*(mark for _, mark in ENCODINGS.values()), codecs.BOM_UTF16_BE + b"\xd8\0\xd8\0"):
        file.write_bytes(mark + file.read_bytes()[len(mark) :])
        assert scene_fingerprint(wrt.load(file)) == before


def test_a_mark_may_stand_before_the_header_of_a_binary_ply_file(folder):
    file = folder / "little.ply"
    before = scene_fingerprint(wrt.load(file))
    file.write_bytes(codecs.BOM_UTF8 + file.read_bytes())
    assert scene_fingerprint(wrt.load(file)) == before


def test_text_without_a_mark_is_not_touched():
    data = b"# caf\xe9\n"
    assert as_utf8(data) is data
