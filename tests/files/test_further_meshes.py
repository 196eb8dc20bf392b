"""3MF, COLLADA and STEP files give the objects, places, colours and textures that their text describes."""

import io
import re
import warnings
import zipfile
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from PIL import Image
from support.mesh_files import check_refused
from support.meshes import area, write

import wrt
from wrt.errors import InputWarning
from wrt.io.load_mesh import load_file
from wrt.scene.srgb import linear_from_srgb

SCENES = ROOT / "tests/scenes/meshes"


HEAD = '<?xml version="1.0"?><model unit="meter" xmlns:m="m"><resources>'
SQUARE = "".join(f'<vertex x="{x}" y="{y}" z="0"/>' for x, y in ((0, 0), (1, 0), (1, 1), (0, 1)))
COLORS = (
    '<m:colorgroup id="2"><m:color color="#FF0000"/><m:color color="#00FF0080"/></m:colorgroup>'
    '<basematerials id="3"><base name="a" displaycolor="#FFFFFF"/><base name="b" displaycolor="#000000FF"/>'
    "</basematerials>"
    '<m:compositematerials id="4" matid="3" matindices="0 1"><m:composite values="0.25 0.75"/></m:compositematerials>'
)


def archive(folder: Path, model: str, **files: bytes | str) -> Path:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as opened:
        for name, data in {"3D/3dmodel.model": model, **files}.items():
            opened.writestr(name, data)
    return write(folder, "a.3mf", buffer.getvalue())


def loaded(folder: Path, model: str, **files: bytes | str) -> list[wrt.Shape]:
    return load_file(archive(folder, model, **files)).shapes


def item(objects: str, attributes: str = 'objectid="1"') -> str:
    return f"{HEAD}{objects}</resources><build><item {attributes}/></build></model>"


def model_of(first: str, second: str = "", resources: str = "", attributes: str = "") -> str:
    """Return a square of triangles 0 1 2 and 0 2 3, with attributes of each."""
    triangles = f'<triangle v1="0" v2="1" v3="2" {first}/><triangle v1="0" v2="2" v3="3" {second}/>'
    mesh = f"<mesh><vertices>{SQUARE}</vertices><triangles>{triangles}</triangles></mesh>"
    return item(f'{resources}<object id="1" {attributes}>{mesh}</object>')


THREEMF = """model: unit lang requiredextensions recommendedextensions
resources: | build: UUID | metadata: name preserve type | metadatagroup: | mesh: | vertices: | triangles: | components:
vertex: x y z | triangle: v1 v2 v3 p1 p2 p3 pid
trianglesets: | triangleset: name identifier | ref: index | refrange: startindex endindex
object: id type thumbnail partnumber name pid pindex UUID slicestackid meshresolution
component: objectid transform path UUID | item: objectid transform partnumber path UUID
basematerials: id displaypropertiesid | base: name displaycolor | colorgroup: id displaypropertiesid | color: color
texture2d: id path contenttype tilestyleu tilestylev filter | tex2coord: u v
texture2dgroup: id texid displaypropertiesid
compositematerials: id matid matindices displaypropertiesid | composite: values | multi: pindices
multiproperties: id pids blendmethods displaypropertiesid
pbspeculardisplayproperties: id | pbmetallicdisplayproperties: id | translucentdisplayproperties: id
pbspeculartexturedisplayproperties: id name | pbmetallictexturedisplayproperties: id name
beamlattice: minlength radius | slicestack: id zbottom | displacement2d: id path"""
"""Elements and attributes of the core specification 1.3, materials 1.2, production, slices, beams and displacement."""

THREEMF_UNUSED = {
    *("pbspeculardisplayproperties", "pbmetallicdisplayproperties", "translucentdisplayproperties"),
    *("pbspeculartexturedisplayproperties", "pbmetallictexturedisplayproperties", "beamlattice", "displacement2d"),
    *(f"{kind}.displaypropertiesid" for kind in ("basematerials", "colorgroup", "texture2dgroup")),
    *(f"{kind}.displaypropertiesid" for kind in ("compositematerials", "multiproperties")),
    "multiproperties.blendmethods",
}
"""What of these is lost."""

THREEMF_VALUES = {
    "displaycolor": "#102030",
    "color": "#102030",
    "transform": "1 0 0 0 1 0 0 0 1 0 0 0",
    "unit": "inch",
    "tilestyleu": "mirror",
    "tilestylev": "clamp",
    "filter": "nearest",
    "path": "/3D/3dmodel.model",
    "pids": "2",
    "matid": "3",
    "v1": "0",
    "v3": "2",
}


def unused_of(path: Path) -> set[str]:
    """Return the kinds of content that reading a file warns of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        load_file(path)
    messages = [re.search(r": ([^:]+) is unknown to wrt", str(each.message)) for each in caught]
    return {match[1] for match in messages if match}


def test_what_3mf_has_is_used_excused_or_warned_of(tmp_path):
    kinds = dict(each.split(":") for line in THREEMF.splitlines() for each in line.split(" | "))
    texts = {
        kind: " ".join(f'{key}="{THREEMF_VALUES.get(key, "1")}"' for key in keys.split())
        for kind, keys in kinds.items()
    }
    elements = "".join(f"<{kind} {text}/>" for kind, text in texts.items() if kind not in ("model", "triangle", "item"))
    mesh = f"<mesh><vertices>{SQUARE}</vertices><triangles><triangle {texts['triangle']}/></triangles></mesh>"
    model = HEAD.replace('unit="meter"', texts["model"])
    build = f"<build><item {texts['item']}/></build>"
    text = f'{model}{COLORS}{elements}<object id="1">{mesh}</object></resources>{build}</model>'
    assert unused_of(archive(tmp_path, text)) == THREEMF_UNUSED


def test_units_of_3mf_and_collada_become_metres_and_3mf_lies_on_its_plate(tmp_path):
    inches = archive(tmp_path, model_of("").replace('unit="meter"', 'unit="inch"'))
    np.testing.assert_allclose(wrt.load_mesh(inches).bounds, [[0, 0, 0], [0.0254, 0.0254, 0]], rtol=1e-6)
    bounds = np.array(wrt.load(inches).shapes[0].mesh_at(0.0).bounds)
    assert np.ptp(bounds, axis=0)[1] == pytest.approx(0.0, abs=1e-9)  # flat, though it could stand on an edge


@pytest.mark.filterwarnings("ignore:.*none.png")
def test_units_of_collada_become_metres_and_what_is_not_read_is_named(tmp_path):
    pytest.importorskip("collada")
    metres = load_file(write(tmp_path, "m.dae", GEOMETRY)).shapes[0].mesh.bounds
    text = GEOMETRY.replace("<asset>", '<asset><unit name="cm" meter="0.01"/>')
    np.testing.assert_allclose(
        load_file(write(tmp_path, "a.dae", text)).shapes[0].mesh.bounds, metres * 0.01, rtol=1e-5
    )


def test_colors_of_triangles_and_corners(tmp_path):
    for parts, expected in (
        (
            ('pid="2" p1="0" p2="1" p3="0"', 'pid="4" p1="0"', COLORS),
            [[(1, 0, 0, 1), (0, 1, 0, 128 / 255), (1, 0, 0, 1)], [(*linear_from_srgb(np.full(3, 0.25)), 1)] * 3],
        ),
        # The property of the object is that of its triangles.
        (("", 'p1="1"', COLORS, 'pid="3" pindex="0"'), [[(1, 1, 1)] * 3, [(0, 0, 0)] * 3]),
        # Colours that are all invisible are opaque: OpenSCAD has written such files.
        (("", "", COLORS.replace("FFFFFF", "FF000000"), 'pid="3" pindex="0"'), [[(1, 0, 0)] * 3] * 2),
    ):
        (shape,) = loaded(tmp_path, model_of(*parts))
        assert area(shape.mesh) == pytest.approx(1.0)
        np.testing.assert_allclose(shape.mesh.colors[shape.mesh.faces], expected, atol=1e-6)


def test_textures_and_properties_of_several_groups(tmp_path):
    buffer = io.BytesIO()
    Image.fromarray(np.array([[[255, 0, 0], [0, 255, 0]]], np.uint8)).save(buffer, "PNG")
    resources = (
        COLORS + '<m:texture2d id="5" path="/3D/Textures/t.png" contenttype="image/png" tilestyleu="clamp"/>'
        '<m:texture2dgroup id="6" texid="5"><m:tex2coord u="0" v="0"/><m:tex2coord u="1" v="0.5"/></m:texture2dgroup>'
        '<m:multiproperties id="7" pids="3 6"><m:multi pindices="0 0"/><m:multi pindices="0 1"/></m:multiproperties>'
    )
    model = model_of('pid="7" p1="0" p2="1" p3="1"', resources=resources)
    shapes = loaded(tmp_path, model, **{"3D/Textures/t.png": buffer.getvalue()})
    plain, shape = sorted(shapes, key=lambda each: isinstance(each.material.reflectance, wrt.ImageTexture))
    assert area(plain.mesh) == pytest.approx(0.5)
    image = shape.material.reflectance
    assert image.wrap == ("clamp", "repeat")
    np.testing.assert_array_equal(image.pixels[0], [(1, 0, 0), (0, 1, 0)])
    np.testing.assert_allclose(shape.mesh.uvs[shape.mesh.faces][0], [(0, 0), (1, 0.5), (1, 0.5)])


def test_components_in_another_part_are_placed(tmp_path):
    component = '<component objectid="1" p:path="/3D/component.model"'
    components = f'<components>{component} transform="0 1 0 -1 0 0 0 0 1 10 0 0"/>{component}/></components>'
    outer = item(f'<object id="9">{components}</object>', 'objectid="9" transform="2 0 0 0 2 0 0 0 2 0 0 5"')
    shapes = loaded(tmp_path, outer, **{"3D/component.model": model_of("")})
    assert shapes[0].mesh is shapes[1].mesh
    plain, turned = sorted(shape.mesh_at(0.0).bounds.tolist() for shape in shapes)
    np.testing.assert_allclose(plain, [(0, 0, 5), (2, 2, 5)])
    np.testing.assert_allclose(turned, [(18, 0, 5), (20, 2, 5)])  # x became y


LEVELS = "".join(
    f'<object id="{k}"><components>{2 * f"""<component objectid="{k + 1}"/>"""}</components></object>'
    for k in range(1, 60)
)


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (model_of("").replace('v3="3"', 'v3="9"'), "names vertex 9"),
        ('<!DOCTYPE a [<!ENTITY b "c">]>' + model_of("")[21:], "document type"),
        (item('<object id="1"><components><component objectid="1"/></components></object>'), "a component of itself"),
        (item(""), "KeyError: '1'"),
        (item(f'{LEVELS}<object id="60"/>'), "its shapes would take"),
        ("\0" * (80 << 20), "its meshes would take"),
    ],
    ids=["vertex", "doctype", "circle", "object", "doubling", "bomb"],
)
def test_damaged_models_are_refused_in_one_line(tmp_path, model, message):
    check_refused(message, load_file, archive(tmp_path, model))


COLLADA = (SCENES / "square.dae").read_text("utf-8")
"""A quad from (0, 0, 0) to (1, 2, 3), moved by 7 along z; it leaves room for the instance."""

BOUND = (
    "<bind_material><technique_common><instance_material symbol='M' target='#m'/></technique_common></bind_material>"
)
GEOMETRY = COLLADA.replace("INSTANCE", f"<instance_geometry url='#g'>{BOUND}</instance_geometry>")
NO_IMAGE = r"none\.png', which it refers to: no such file; it is left out"
GREY = r"textures that lead to no image are grey \(1\)"
LEFT_OUT = r"uses of materials that are not there are left out \(1\)"
MORE = "</newparam><newparam sid='x'><sampler2D><source>y</source></sampler2D></newparam>\n<technique"
POSE = "skins and morph targets are shown in their bind pose"


@pytest.mark.parametrize(
    ("text", "message", "shift"),
    [
        # Without a scene, the first is shown.
        (GEOMETRY.replace('<scene><instance_visual_scene url="#w"/></scene>', ""), NO_IMAGE, (0, 0, 7)),
        (GEOMETRY.replace("<init_from>none.png</init_from>", ""), GREY, (0, 0, 7)),
        (GEOMETRY.replace('url="#e"', 'url="#f"'), LEFT_OUT, (0, 0, 7)),
        (GEOMETRY.replace("profile_COMMON", "profile_CG"), LEFT_OUT, (0, 0, 7)),
        (GEOMETRY.replace("</newparam>\n<technique", MORE), NO_IMAGE, (0, 0, 7)),
        (GEOMETRY.replace("mesh>", "convex_mesh>"), NO_IMAGE, (0, 0, 7)),
        (GEOMETRY.replace("geometry url='#g'", "controller url='#c'"), POSE, (5, 0, 0)),
    ],
)
def test_collada_geometry_is_there_whatever_else_is_told(tmp_path, text, message, shift):
    pytest.importorskip("collada")
    text = text.replace("</instance_geometry>", "</instance_controller>") if message == POSE else text
    assert text != GEOMETRY
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        (shape,) = load_file(write(tmp_path, "a.dae", text)).shapes
    assert any(re.search(rf"a\.dae: .*{message}", str(each.message)) for each in caught)
    assert len(shape.mesh.faces) == 2
    assert shape.double_sided  # the format does not hide backs
    np.testing.assert_allclose(shape.mesh.bounds, np.add([[0, 0, 0], [1, 2, 3]], shift), atol=1e-6)


@pytest.mark.parametrize(("wrap", "color", "lost"), [("WRAP", "0 0 0 1", 0), ("CLAMP", "0.5 0 0 1", 2)])
def test_collada_values_without_effect_are_not_named(tmp_path, wrap, color, lost):
    pytest.importorskip("collada")
    text = GEOMETRY.replace(
        "</source></sampler2D>", f"</source><wrap_s>{wrap}</wrap_s><minfilter>NONE</minfilter></sampler2D>"
    )
    looks = f"<transparent opaque='RGB_ZERO'><color>{color}</color></transparent>"
    index = "<index_of_refraction><float>1.4</float></index_of_refraction>"
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        load_file(write(tmp_path, "a.dae", text.replace("</diffuse>", f"</diffuse>{looks}{index}")))
    assert sum("unknown to wrt" in str(each.message) for each in caught) == lost


@pytest.mark.filterwarnings("ignore:.*none.png")
@pytest.mark.parametrize(("axis", "height"), [("X", 1.0), ("Z", 3.0)])
def test_collada_names_its_up_axis(tmp_path, axis, height):
    """A plate tells of itself no axis."""
    pytest.importorskip("collada")
    for encoding in ("utf-8", "utf-16"):
        text = GEOMETRY.replace("Y_UP", f"{axis}_UP").replace("2 3<", "2 3\n<")
        path = write(tmp_path, "a.dae", text.encode(encoding))
        assert np.ptp(wrt.load(path).shapes[0].bounds, axis=0)[1] == pytest.approx(height)
    camera = wrt.PerspectiveCamera((0, 0, 9), (0, 0, 0))  # in the file's coordinates, which then stay
    kept = wrt.load(tmp_path / "a.dae", camera=camera)
    assert kept.shapes[0].bounds == pytest.approx(load_file(tmp_path / "a.dae").shapes[0].bounds)
    assert kept.camera is camera


@pytest.mark.filterwarnings("ignore:.*none.png")
@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (">0 0 0 1 0", ">0,5 0 0 1 0", "'0,5' in a float_array is not a number; numbers have decimal points"),
        ("0 1 2 3<", "0 1 x 3<", "'x' in a p is not a number"),
        ("0 1 2 3<", "0 1 2 4<", "go beyond the limits"),
        ("0 0 7<", "0 0 7,5<", "'7,5' in a translate is not a number; numbers have decimal points"),
        ("0 0 7<", "0 7<", "a translate has 2 numbers, not 3"),
    ],
)
def test_collada_geometry_that_cannot_be_read_is_told(tmp_path, old, new, message):
    """The library passes over it, and over transforms."""
    pytest.importorskip("collada")
    text = GEOMETRY.replace(old, new)
    path = write(tmp_path, "a.dae", text)
    check_refused(message, load_file, path)
    if "float_array" in message:  # with another geometry, which stays
        start, end = GEOMETRY.index("<geometry "), GEOMETRY.index("</library_geometries>")
        other = re.sub('([="#])(g|p|a|v)"', r'\1\g<2>2"', GEOMETRY[start:end])
        text = text.replace("</library_geometries>", f"{other}</library_geometries>")
        text = text.replace("</node>", "<instance_geometry url='#g2'/></node>")
        with pytest.warns(InputWarning, match=rf"geometry 'g' cannot be read: {message}.*; it is left out"):
            assert len(load_file(write(tmp_path, "a.dae", text)).shapes) == 1


def test_collada_without_its_library_or_end_is_told(tmp_path, monkeypatch):
    from trimesh.exchange.load import mesh_loaders

    check_refused(r"a\.dae: ", load_file, write(tmp_path, "a.dae", GEOMETRY[: len(GEOMETRY) // 2]))
    monkeypatch.delitem(mesh_loaders, "dae", raising=False)
    words = r"\.dae files need further libraries: pip install 'wrt\[formats\]'"
    check_refused(words, load_file, write(tmp_path, "box.dae", "<COLLADA>"))


STEP_BALL = (SCENES / "ball.step").read_text("ascii")
"""A ball of radius 10 around (5, 0, 0), in a unit to be named in place of PREFIX."""


def test_a_ball_of_a_step_file_is_round_and_in_metres(tmp_path):
    pytest.importorskip("cascadio")
    (shape,) = load_file(write(tmp_path, "ball.stp", STEP_BALL.replace("PREFIX", ".CENTI."))).shapes
    out = shape.mesh.vertices / 1e-2 - np.array([5.0, 0.0, 0.0])
    np.testing.assert_allclose(np.linalg.norm(out, axis=1), 10.0, rtol=1e-5)
    np.testing.assert_allclose(shape.mesh.normals, out / 10.0, atol=1e-4)
    # Between the vertices the surface is inside by at most the sagitta: the area is a ball's to 1 %.
    assert area(shape.mesh) == pytest.approx(400.0 * np.pi * 1e-4, rel=0.01)
    np.testing.assert_allclose(shape.material.base_color, linear_from_srgb(np.array([0.8, 0.4, 0.2])), atol=1e-3)


@pytest.mark.slow
def test_step_files_that_cannot_be_read_are_refused_in_one_line(tmp_path, monkeypatch, capfd):
    pytest.importorskip("cascadio")
    for text in (STEP_BALL[:600], "solid", STEP_BALL.replace("#20=", "#99=")):
        check_refused(r"part\.step: ", load_file, write(tmp_path, "part.step", text))
    assert capfd.readouterr() == ("", "")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    path = write(tmp_path, "part.step", STEP_BALL)
    check_refused(r"STEP files need Open CASCADE: pip install 'wrt\[step\]'", load_file, path)
    path = write(tmp_path, "part.cad", STEP_BALL)
    check_refused(r"it looks to be a STEP file; rename it to end in \.step", load_file, path)
