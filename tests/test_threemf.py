"""3MF files give the objects, places, colours and textures that their text describes."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest
from PIL import Image
from support.meshes import area, write

import wrt
from wrt.io.load_mesh import load_file
from wrt.scene.srgb import linear_from_srgb

HEAD = '<?xml version="1.0"?><model unit="millimeter" xmlns:m="m"><resources>'
SQUARE = (
    '<vertices><vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/><vertex x="1" y="1" z="0"/>'
    '<vertex x="0" y="1" z="0"/></vertices>'
)
COLORS = (
    '<m:colorgroup id="2"><m:color color="#FF0000"/><m:color color="#00FF0080"/></m:colorgroup>'
    '<basematerials id="3"><base name="a" displaycolor="#FFFFFF"/><base name="b" displaycolor="#000000FF"/>'
    "</basematerials>"
    '<m:compositematerials id="4" matid="3" matindices="0 1"><m:composite values="0.25 0.75"/></m:compositematerials>'
)


def archive(model: str, **others: bytes | str) -> bytes:
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as opened:
        for name, data in {"3D/3dmodel.model": model, **others}.items():
            opened.writestr(name, data)
    return held.getvalue()


def loaded(tmp_path, model: str, **others: bytes | str) -> list[wrt.Shape]:
    return load_file(write(tmp_path, "a.3mf", archive(model, **others))).shapes


def model_of(triangles: str, resources: str = "", attributes: str = "") -> str:
    mesh = f'<object id="1" {attributes}><mesh>{SQUARE}<triangles>{triangles}</triangles></mesh></object>'
    return f'{HEAD}{resources}{mesh}</resources><build><item objectid="1"/></build></model>'


def corner_colors(shape: wrt.Shape) -> np.ndarray:
    return shape.mesh.colors[shape.mesh.faces]


def test_colors_of_triangles_and_corners(tmp_path):
    text = (
        '<triangle v1="0" v2="1" v3="2" pid="2" p1="0" p2="1" p3="0"/><triangle v1="0" v2="2" v3="3" pid="4" p1="0"/>'
    )
    (shape,) = loaded(tmp_path, model_of(text, COLORS))
    assert area(shape.mesh) == pytest.approx(1.0)
    first, second = corner_colors(shape)
    np.testing.assert_allclose(first[:, :3], [(1, 0, 0), (0, 1, 0), (1, 0, 0)])
    np.testing.assert_allclose(first[1, 3], 128 / 255)
    np.testing.assert_allclose(second[:, :3], linear_from_srgb(np.full((3, 3), 0.25)), atol=1e-6)


def test_colors_that_are_all_invisible_are_opaque(tmp_path):
    """OpenSCAD has written such files."""
    colors = '<basematerials id="3"><base name="a" displaycolor="#FF000000"/></basematerials>'
    text = '<triangle v1="0" v2="1" v3="2"/><triangle v1="0" v2="2" v3="3"/>'
    (shape,) = loaded(tmp_path, model_of(text, colors, 'pid="3" pindex="0"'))
    np.testing.assert_array_equal(corner_colors(shape), np.broadcast_to((1.0, 0.0, 0.0), (2, 3, 3)))


def test_the_property_of_the_object_is_that_of_its_triangles(tmp_path):
    text = '<triangle v1="0" v2="1" v3="2"/><triangle v1="0" v2="2" v3="3" p1="1"/>'
    (shape,) = loaded(tmp_path, model_of(text, COLORS, 'pid="3" pindex="0"'))
    np.testing.assert_allclose(corner_colors(shape)[:, 0], [(1, 1, 1), (0, 0, 0)])


def test_textures_and_properties_of_several_groups(tmp_path):
    held = io.BytesIO()
    Image.fromarray(np.array([[[255, 0, 0], [0, 255, 0]]], np.uint8)).save(held, "PNG")
    resources = (
        COLORS + '<m:texture2d id="5" path="/3D/Textures/t.png" contenttype="image/png" tilestyleu="clamp"/>'
        '<m:texture2dgroup id="6" texid="5"><m:tex2coord u="0" v="0"/><m:tex2coord u="1" v="0.5"/></m:texture2dgroup>'
        '<m:multiproperties id="7" pids="3 6"><m:multi pindices="0 0"/><m:multi pindices="0 1"/></m:multiproperties>'
    )
    text = '<triangle v1="0" v2="1" v3="2" pid="7" p1="0" p2="1" p3="1"/><triangle v1="0" v2="2" v3="3"/>'
    plain, shape = sorted(
        loaded(tmp_path, model_of(text, resources), **{"3D/Textures/t.png": held.getvalue()}),
        key=lambda each: isinstance(each.material.reflectance, wrt.ImageTexture),
    )
    assert area(plain.mesh) == pytest.approx(0.5)
    image = shape.material.reflectance
    assert image.wrap == ("clamp", "repeat")
    np.testing.assert_array_equal(image.pixels[0], [(1, 0, 0), (0, 1, 0)])
    np.testing.assert_allclose(shape.mesh.uvs[shape.mesh.faces][0], [(0, 0), (1, 0.5), (1, 0.5)])


def test_components_in_another_part_are_placed(tmp_path):
    inner = model_of('<triangle v1="0" v2="1" v3="2"/>')
    outer = (
        f'{HEAD}<object id="9"><components><component objectid="1" p:path="/3D/other.model" '
        'transform="0 1 0 -1 0 0 0 0 1 10 0 0"/><component objectid="1" p:path="/3D/other.model"/></components>'
        '</object></resources><build><item objectid="9" transform="2 0 0 0 2 0 0 0 2 0 0 5"/></build></model>'
    )
    shapes = loaded(tmp_path, outer, **{"3D/other.model": inner})
    assert shapes[0].mesh is shapes[1].mesh
    turned, plain = sorted((shape.mesh_at(0.0) for shape in shapes), key=lambda mesh: -mesh.bounds[1][0])
    np.testing.assert_allclose(plain.bounds, [(0, 0, 5), (2, 2, 5)])
    np.testing.assert_allclose(turned.bounds, [(18, 0, 5), (20, 2, 5)])  # x became y


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (model_of('<triangle v1="0" v2="1" v3="9"/>'), "names vertex 9"),
        (model_of('<triangle v1="0" v2="x" v3="1"/>'), "not a whole 3MF file"),
        (model_of('<triangle v1="0" v2="1"/>'), "'v3' is missing"),
        (model_of("")[:-9], "not a whole 3MF file"),
        ('<!DOCTYPE a [<!ENTITY b "c">]>' + model_of("")[21:], "document type"),
        (
            f'{HEAD}<object id="1"><components><component objectid="1"/></components></object></resources>'
            '<build><item objectid="1"/></build></model>',
            "a component of itself",
        ),
        (f'{HEAD}</resources><build><item objectid="1"/></build></model>', "'1' is missing"),
    ],
)
def test_damaged_models_are_refused_in_one_line(tmp_path, model, message):
    with pytest.raises(wrt.InputError, match=message) as caught:
        loaded(tmp_path, model)
    assert "\n" not in str(caught.value)


def test_components_that_double_at_every_level_are_refused(tmp_path):
    levels = "".join(
        f'<object id="{k}"><components>{2 * f"""<component objectid="{k + 1}"/>"""}</components></object>'
        for k in range(1, 60)
    )
    model = f'{HEAD}{levels}<object id="60"/></resources><build><item objectid="1"/></build></model>'
    with pytest.raises(wrt.InputError, match="its shapes would take"):
        loaded(tmp_path, model)


def test_properties_that_are_not_there_are_told(tmp_path):
    text = '<triangle v1="0" v2="1" v3="2" pid="2" p1="7"/><triangle v1="0" v2="2" v3="3" pid="99" p1="0"/>'
    with pytest.warns(wrt.errors.InputWarning, match="a property that is not there is left out"):
        (shape,) = loaded(tmp_path, model_of(text, COLORS))
    assert area(shape.mesh) == pytest.approx(1.0)
