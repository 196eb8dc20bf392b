"""COLLADA files are read by trimesh's extra, 3MF files without one, and STEP files by Open CASCADE."""

from __future__ import annotations

import io
import re
import warnings
import zipfile

import numpy as np
import pytest
from support.meshes import area, write

import wrt
from wrt.errors import InputWarning
from wrt.io.load_mesh import load_file, load_mesh
from wrt.scene.srgb import linear_from_srgb


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


COLLADA = """\
<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><up_axis>Y_UP</up_axis></asset>
<library_images><image id="i"><init_from>none.png</init_from></image></library_images>
<library_effects><effect id="e"><profile_COMMON>
<newparam sid="f"><surface type="2D"><init_from>i</init_from></surface></newparam>
<newparam sid="s"><sampler2D><source>f</source></sampler2D></newparam>
<technique sid="t"><lambert><diffuse><texture texture="s" texcoord="UV"/></diffuse></lambert></technique>
</profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh><source id="p">
<float_array id="a" count="12">0 0 0 1 0 0 1 2 0 0 2 3</float_array><technique_common>
<accessor source="#a" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<polylist material="M" count="1">
<input semantic="VERTEX" source="#v" offset="0"/><vcount>4</vcount><p>0 1 2 3</p></polylist>
</mesh></geometry></library_geometries>
<library_controllers>
<controller id="c"><skin source="#d">
<bind_shape_matrix>1 0 0 5 0 1 0 0 0 0 1 0 0 0 0 1</bind_shape_matrix></skin></controller>
<controller id="d"><morph source="#g" method="NORMALIZED"/></controller>
</library_controllers>
<library_visual_scenes><visual_scene id="w"><node id="n"><translate>0 0 7</translate>INSTANCE</node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#w"/></scene></COLLADA>
"""
OF_X = {
    "camera": "<optics><technique_common><perspective><yfov>35</yfov><znear>1</znear><zfar>9</zfar></perspective>"
    "</technique_common></optics>",
    "light": "<technique_common><point><color>1 1 1</color></point></technique_common>",
}
BOUND = (
    "<bind_material><technique_common><instance_material symbol='M' target='#m'/></technique_common></bind_material>"
)


@pytest.mark.parametrize(("controller", "shift"), [("c", (5, 0, 0)), ("d", (0, 0, 7))])
def test_controllers_of_collada_are_shown_in_their_bind_pose(tmp_path, controller, shift):
    pytest.importorskip("collada")
    text = COLLADA.replace("INSTANCE", f"<instance_controller url='#{controller}'>{BOUND}</instance_controller>")
    words = "skins and morph targets are shown in their bind pose"
    with pytest.warns(InputWarning, match=rf"a\.dae: {words}"), pytest.warns(InputWarning, match=r"none\.png"):
        (shape,) = load_file(write(tmp_path, "a.dae", text)).shapes
    assert len(shape.mesh.faces) == 2
    np.testing.assert_allclose(shape.mesh.bounds, np.add([[0, 0, 0], [1, 2, 3]], shift), atol=1e-6)


def test_collada_without_a_scene_shows_its_first_and_names_missing_images(tmp_path):
    pytest.importorskip("collada")
    text = COLLADA.replace("INSTANCE", f"<instance_geometry url='#g'>{BOUND}</instance_geometry>")
    text = text.replace('<scene><instance_visual_scene url="#w"/></scene>', "")
    with pytest.warns(InputWarning, match=r"none\.png', which it refers to: no such file; it is left out"):
        (shape,) = load_file(write(tmp_path, "a.dae", text)).shapes
    np.testing.assert_allclose(shape.mesh.bounds, [[0, 0, 7], [1, 2, 10]], atol=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("<init_from>none.png</init_from>", "", r"textures that lead to no image are grey \(1\)"),
        ("<init_from>i</init_from>", "<init_from>j</init_from>", r"textures that lead to no image are grey \(1\)"),
        ("<source>f</source>", "<source>g</source>", r"textures that lead to no image are grey \(1\)"),
        ('url="#e"', 'url="#f"', r"uses of materials that are not there are left out \(1\)"),
        ("target='#m'", "target='#n'", r"uses of materials that are not there are left out \(1\)"),
        (
            "</newparam>\n<technique",
            "</newparam><newparam sid='x'><sampler2D><source>y</source></sampler2D></newparam>\n<technique",
            r"none\.png', which it refers to: no such file",
        ),
        ("mesh>", "convex_mesh>", r"none\.png', which it refers to: no such file"),
    ],
)
def test_collada_geometry_is_there_whatever_its_material_refers_to(tmp_path, old, new, told):
    pytest.importorskip("collada")
    text = COLLADA.replace("INSTANCE", f"<instance_geometry url='#g'>{BOUND}</instance_geometry>")
    assert old in text
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        (shape,) = load_file(write(tmp_path, "a.dae", text.replace(old, new))).shapes
    assert any(re.search(told, str(each.message)) for each in caught)
    np.testing.assert_allclose(shape.mesh.bounds, [[0, 0, 7], [1, 2, 10]], atol=1e-6)


@pytest.mark.filterwarnings("ignore:.*none.png")
def test_cameras_and_lights_of_collada_are_told(tmp_path):
    pytest.importorskip("collada")
    for more, words in (("camera", "cameras"), ("light", "lights")):
        text = COLLADA.replace("INSTANCE", f"<instance_geometry url='#g'/><instance_{more} url='#x'/>")
        library = f"<library_{more}s><{more} id='x'>{OF_X[more]}</{more}></library_{more}s>"
        text = text.replace("<library_geometries>", f"{library}<library_geometries>")
        with pytest.warns(InputWarning, match=rf"a\.dae: {words} of COLLADA files are left out"):
            load_file(write(tmp_path, "a.dae", text))


@pytest.mark.filterwarnings("ignore:.*none.png")
def test_collada_names_its_up_axis(tmp_path):
    """A plate tells of itself no axis."""
    pytest.importorskip("collada")
    text = COLLADA.replace("INSTANCE", "<instance_geometry url='#g'/>")
    for axis, height in (("X", 1.0), ("Y", 2.0), ("Z", 3.0)):
        for encoding in ("utf-8", "utf-16"):
            path = write(
                tmp_path, "a.dae", text.replace("Y_UP", f"{axis}_UP").replace("2 3<", "2 3\n<").encode(encoding)
            )
            low, high = wrt.load(path).shapes[0].bounds
            assert high[1] - low[1] == pytest.approx(height), axis
    low, high = wrt.load(path, up="x").shapes[0].bounds
    assert high[1] - low[1] == pytest.approx(1.0)


STEP_BALL = """\
ISO-10303-21;
HEADER;
FILE_DESCRIPTION((''),'2;1');
FILE_NAME('ball','2020-01-01T00:00:00',(''),(''),'','','');
FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));
ENDSEC;
DATA;
#1=APPLICATION_CONTEXT('automotive design');
#2=APPLICATION_PROTOCOL_DEFINITION('international standard','automotive_design',2000,#1);
#3=PRODUCT_CONTEXT('',#1,'mechanical');
#4=PRODUCT('ball','ball','',(#3));
#5=PRODUCT_DEFINITION_FORMATION('','',#4);
#6=PRODUCT_DEFINITION_CONTEXT('part definition',#1,'design');
#7=PRODUCT_DEFINITION('design','',#5,#6);
#8=PRODUCT_DEFINITION_SHAPE('','',#7);
#9=SHAPE_DEFINITION_REPRESENTATION(#8,#10);
#10=ADVANCED_BREP_SHAPE_REPRESENTATION('',(#11,#20),#12);
#11=AXIS2_PLACEMENT_3D('',#31,#32,#33);
#12=(GEOMETRIC_REPRESENTATION_CONTEXT(3) GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT((#16))
GLOBAL_UNIT_ASSIGNED_CONTEXT((#13,#14,#15)) REPRESENTATION_CONTEXT('',''));
#13=(LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(PREFIX,.METRE.));
#14=(NAMED_UNIT(*) PLANE_ANGLE_UNIT() SI_UNIT($,.RADIAN.));
#15=(NAMED_UNIT(*) SI_UNIT($,.STERADIAN.) SOLID_ANGLE_UNIT());
#16=UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-07),#13,'distance_accuracy_value','');
#20=MANIFOLD_SOLID_BREP('',#21);
#21=CLOSED_SHELL('',(#22));
#22=ADVANCED_FACE('',(#23),#26,.T.);
#23=FACE_BOUND('',#24,.T.);
#24=VERTEX_LOOP('',#25);
#25=VERTEX_POINT('',#34);
#26=SPHERICAL_SURFACE('',#30,10.);
#30=AXIS2_PLACEMENT_3D('',#35,#32,#33);
#31=CARTESIAN_POINT('',(0.,0.,0.));
#32=DIRECTION('',(0.,0.,1.));
#33=DIRECTION('',(1.,0.,0.));
#34=CARTESIAN_POINT('',(5.,0.,-10.));
#35=CARTESIAN_POINT('',(5.,0.,0.));
#40=MECHANICAL_DESIGN_GEOMETRIC_PRESENTATION_REPRESENTATION('',(#41),#12);
#41=STYLED_ITEM('color',(#42),#20);
#42=PRESENTATION_STYLE_ASSIGNMENT((#43));
#43=SURFACE_STYLE_USAGE(.BOTH.,#44);
#44=SURFACE_SIDE_STYLE('',(#45));
#45=SURFACE_STYLE_FILL_AREA(#46);
#46=FILL_AREA_STYLE('',(#47));
#47=FILL_AREA_STYLE_COLOUR('',#48);
#48=COLOUR_RGB('',0.8,0.4,0.2);
ENDSEC;
END-ISO-10303-21;
"""
"""A ball of radius 10 around (5, 0, 0), in a unit to be named in place of PREFIX."""


@pytest.mark.parametrize(
    ("prefix", "unit"),
    [(".MILLI.", 1e-3), *(pytest.param(*each, marks=pytest.mark.slow) for each in ((".CENTI.", 1e-2), ("$", 1.0)))],
)
def test_a_ball_of_a_step_file_is_round_and_in_metres(tmp_path, prefix, unit):
    pytest.importorskip("cascadio")
    (shape,) = load_file(write(tmp_path, "ball.stp", STEP_BALL.replace("PREFIX", prefix))).shapes
    out = shape.mesh.vertices / unit - np.array([5.0, 0.0, 0.0])
    np.testing.assert_allclose(np.linalg.norm(out, axis=1), 10.0, rtol=1e-5)
    assert shape.mesh.normals is not None
    np.testing.assert_allclose(shape.mesh.normals, out / 10.0, atol=1e-4)
    # Between the vertices the surface is inside by at most the sagitta, so that the area is that of a ball to 1 %.
    assert area(shape.mesh) == pytest.approx(400.0 * np.pi * unit**2, rel=0.01)
    np.testing.assert_allclose(shape.material.base_color, linear_from_srgb(np.array([0.8, 0.4, 0.2])), atol=1e-3)


@pytest.mark.slow
def test_step_files_that_cannot_be_read_are_refused_in_one_line(tmp_path, monkeypatch, capfd):
    pytest.importorskip("cascadio")
    for text in ("ISO-10303-21;\nHEADER;\n", STEP_BALL[:600], "solid", STEP_BALL.replace("#20=", "#99=")):
        with pytest.raises(wrt.InputError, match=r"part\.step: [^\n]*$"):
            load_mesh(write(tmp_path, "part.step", text))
    assert capfd.readouterr() == ("", "")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(wrt.InputError, match=r"part\.step: STEP files need Open CASCADE: pip install 'wrt\[step\]'"):
        load_mesh(write(tmp_path, "part.step", STEP_BALL))


def test_a_step_file_of_another_name_is_told(tmp_path):
    with pytest.raises(wrt.InputError, match=r"it looks to be a STEP file; rename it to end in \.step"):
        load_mesh(write(tmp_path, "part.cad", b"ISO-10303-21;\nHEADER;\n"))


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
