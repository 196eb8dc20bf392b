"""A text file means the same in every common encoding, with or without a byte-order mark."""

import codecs
import re
import shutil

import pytest
from conftest import ROOT

import wrt
from wrt.rendering.checkpoint import scene_fingerprint

ENCODINGS = {
    "utf-8": codecs.BOM_UTF8,
    "utf-16-le": codecs.BOM_UTF16_LE,
    "utf-16-be": codecs.BOM_UTF16_BE,
    "utf-32-le": codecs.BOM_UTF32_LE,
}
XML = """<scene version="3.0.0">
    <sensor type="perspective"/>
    <shape type="obj"><string name="filename" value="polygons.obj"/>
        <bsdf type="diffuse"><spectrum name="reflectance" filename="green.spd"/></bsdf>
    </shape>
</scene>
"""
# The file that is re-encoded, and the file that is loaded.
FILES = [
    *((name, name) for name in ("text.ply", "text.stl", "quads.off", "scene.gltf", "shapes.toml")),
    ("paints.mtl", "textured.obj"),
    *((name, "scene.xml") for name in ("scene.xml", "green.spd", "polygons.obj")),
]


@pytest.fixture
def folder(tmp_path):
    result = tmp_path / "files"
    shutil.copytree(ROOT / "tests" / "corpus" / "seeds", result)
    (result / "green.spd").write_text("400 0.1\n550 0.8\n700 0.2\n")
    (result / "scene.xml").write_text(XML)
    return result


@pytest.mark.filterwarnings("ignore::wrt.errors.InputWarning")
@pytest.mark.parametrize(("written", "loaded"), FILES)
def test_every_reader_takes_every_encoding(written, loaded, folder):
    before = scene_fingerprint(wrt.load(folder / loaded))
    text = (folder / written).read_text()
    for name in ENCODINGS:
        (folder / written).write_bytes(ENCODINGS[name] + text.encode(name))
        if written.endswith(".xml") and name == "utf-32-le":  # XML parsers must support only UTF-8 and UTF-16
            with pytest.raises(wrt.InputError, match=r"^\S*scene\.xml: line \d+: not well-formed XML: [^\n]*$"):
                wrt.load(folder / loaded)
        else:
            assert scene_fingerprint(wrt.load(folder / loaded)) == before, name


@pytest.mark.parametrize("name", ["polygons.obj", "shapes.toml", "scene.gltf", "scene.xml"])
def test_invalid_utf_16_is_refused_in_one_line(name, folder):
    file = folder / name
    file.write_bytes(codecs.BOM_UTF16_LE + file.read_bytes() + b"\0\xd8")
    with pytest.raises(wrt.InputError, match=rf"^{re.escape(str(file))}: [^\n]+\Z"):
        wrt.load(file)
