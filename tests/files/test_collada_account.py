"""Each element and attribute of COLLADA 1.4.1 is used, without effect, or warned of, and cameras are read."""

import math
import re
import warnings
from fnmatch import fnmatchcase
from importlib import resources

import numpy as np
import pytest
from support.meshes import write
from support.same_scenes import differences

import wrt
from wrt.errors import InputWarning
from wrt.io.load_mesh import load_file
from wrt.io.mesh.collada import WITHOUT_EFFECT

etree = pytest.importorskip("lxml.etree")
pytest.importorskip("collada")

XS = "{http://www.w3.org/2001/XMLSchema}"
SPACE = "{http://www.collada.org/2005/11/COLLADASchema}"

SOURCE = (
    '<source id="{0}"><float_array id="{0}-a" count="{1}">{3}</float_array><technique_common>'
    '<accessor source="#{0}-a" count="{4}" stride="{2}">{5}</accessor></technique_common></source>'
)
PARAM = '<param name="{}" type="float"/>'


def source(name: str, axes: str, numbers: str) -> str:
    size, count = len(axes), len(numbers.split())
    return SOURCE.format(name, count, size, numbers, count // size, "".join(map(PARAM.format, axes)))


def effect(name: str, shader: str, diffuse: str) -> str:
    return f"""<effect id="{name}"><profile_COMMON>
<image id="{name}-i"><init_from>t.png</init_from></image>
<newparam sid="{name}-f"><surface type="2D"><init_from>{name}-i</init_from></surface></newparam>
<newparam sid="{name}-s"><sampler2D><source>{name}-f</source></sampler2D></newparam>
<technique sid="t"><{shader}><emission><color>1 2 3 1</color></emission><diffuse>{diffuse}</diffuse>
{"" if shader in ("lambert", "constant") else "<shininess><float>9</float></shininess>"}</{shader}></technique>
</profile_COMMON></effect>"""


TEXTURE = '<texture texture="{}-s" texcoord="UV"/>'
INPUTS = '<input semantic="VERTEX" source="#v" offset="0"/><input semantic="TEXCOORD" source="#uv" offset="1" set="0"/>'
COMPLETE = f"""<COLLADA xmlns="{SPACE[1:-1]}" version="1.4.1">
<asset><unit name="dm" meter="0.1"/><up_axis>Z_UP</up_axis></asset>
<library_cameras>
<camera id="wide"><optics><technique_common><perspective>
<xfov>60</xfov><aspect_ratio>2</aspect_ratio></perspective></technique_common></optics></camera>
<camera id="high"><optics><technique_common><perspective><yfov>50</yfov></perspective></technique_common></optics>
</camera><camera id="flat"><optics><technique_common><orthographic>
<xmag>6</xmag><aspect_ratio>2</aspect_ratio></orthographic></technique_common></optics></camera>
<camera id="tall"><optics><technique_common><orthographic><ymag>5</ymag></orthographic></technique_common></optics>
</camera></library_cameras>
<library_images><image id="i"><init_from>t.png</init_from></image></library_images>
<library_effects>{effect("e1", "lambert", TEXTURE.format("e1"))}{effect("e2", "phong", "<color>1 0 0 1</color>")}
{effect("e3", "blinn", TEXTURE.format("e3")).replace(">e3-i<", ">i<")}</library_effects>
<library_materials><material id="m1"><instance_effect url="#e1"/></material>
<material id="m2"><instance_effect url="#e2"/></material>
<material id="m3"><instance_effect url="#e3"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>{source("p", "XYZ", "0 0 0  1 0 0  1 2 0  0 2 0")}
{source("uv", "ST", "0 0  1 0  1 1")}<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles material="M1" count="1">{INPUTS}<p>0 0 1 1 2 2</p></triangles>
<polylist material="M2" count="1">{INPUTS}<vcount>4</vcount><p>0 0 1 1 2 2 3 0</p></polylist>
<polygons material="M3" count="1">{INPUTS}<p>0 0 2 1 3 2</p></polygons>
</mesh></geometry></library_geometries>
<library_nodes><node id="held"><translate>9 0 0</translate><instance_camera url="#wide"/></node></library_nodes>
<library_visual_scenes><visual_scene id="w"><node id="n"><rotate>0 0 1 30</rotate><translate>0 0 7</translate>
<scale>1 2 3</scale><matrix>1 0 0 0 0 1 0 0 0 0 1 4 0 0 0 1</matrix>
<instance_camera url="#tall"/><instance_camera url="#high"/><instance_camera url="#flat"/>
<instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="M1" target="#m1"/><instance_material symbol="M2" target="#m2"/>
<instance_material symbol="M3" target="#m3"/></technique_common></bind_material></instance_geometry>
<instance_node url="#held"/></node>
<node id="l"><lookat>1 2 3 0 0 3 0 0 1</lookat><node id="k"><instance_camera url="#high"/></node></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#w"/></scene></COLLADA>"""


EXPECTED = {
    "COLLADA > scene removed": "the first scene is shown",
    "asset > up_axis removed": "a bare mesh is turned when it is put into a studio",
    **dict.fromkeys(("geometry > convex_mesh", "technique > constant"), "there may be one of several"),
}
"""What changes nothing in this test, and why."""


class Schema:
    """The elements and attributes that the schema allows in an element."""

    def __init__(self) -> None:
        text = resources.files("collada.resources").joinpath("schema-1.4.1.xml").read_bytes()
        root = etree.fromstring(text)
        self.top = {each.get("name"): each for each in root.iterchildren(f"{XS}element")}
        kinds = f"{XS}complexType", f"{XS}group"
        self._types = {each.get("name"): each for each in root.iterchildren(*kinds)}

    def _content(self, declared):
        """Yield what a declaration, its type and the types that it extends consist of."""
        waiting = [self._types[declared.get("type")]] if declared.get("type") in self._types else [declared]
        while waiting:
            part = waiting.pop()
            for each in part.iterchildren(tag=f"{XS}*"):
                if each.tag in (f"{XS}element", f"{XS}attribute"):
                    yield each
                else:
                    waiting.append(each)
                    base = each.get("base") or each.get("ref")
                    waiting += [self._types[base]] if base in self._types else []

    def inner(self, declared):
        """Return the declarations of the elements in an element by their names."""
        found = [each for each in self._content(declared) if each.tag == f"{XS}element"]
        names = {each.get("ref") or each.get("name"): self.top.get(each.get("ref"), each) for each in found}
        stands_for = {name: each for name, each in self.top.items() if each.get("substitutionGroup") in names}
        return {name: each for name, each in (names | stands_for).items() if each.get("abstract") != "true"}

    def attributes(self, declared):
        return {each.get("name") for each in self._content(declared) if each.tag == f"{XS}attribute"} - {None}


def loaded(folder, root):
    path = write(folder, "a.dae", etree.tostring(root))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("ignore", UserWarning)
        warnings.simplefilter("always", InputWarning)
        try:
            scene = load_file(path)
        except wrt.InputError as error:
            return wrt.Scene(), [str(error)]
        return scene, [str(each.message) for each in caught]


@pytest.fixture
def folder(tmp_path):
    wrt.save_image(tmp_path / "t.png", np.random.default_rng(0).random((4, 4, 3)))
    return tmp_path


def is_excused(*kinds):
    return any(fnmatchcase(kind, pattern) for kind in kinds for pattern in WITHOUT_EFFECT)


def test_each_element_and_attribute_is_used_excused_or_warned_of(folder):
    schema, root = Schema(), etree.fromstring(COMPLETE)
    before, messages = loaded(folder, root)
    assert messages == []
    assert len(before.cameras) == 5
    lost, seen = set(), set()

    def is_lost():
        after, new_messages = loaded(folder, root)
        return messages == new_messages and before.cameras == after.cameras and not differences(before, after)

    def visit(element, declared):
        name = etree.QName(element).localname
        allowed = schema.inner(declared)
        for inner in allowed:
            present = element.find(f"{SPACE}{inner}")
            is_elsewhere = present is None and root.find(f".//{SPACE}{name}/{SPACE}{inner}") is not None
            if (name, inner) in seen or is_excused(inner) or is_elsewhere:
                continue
            seen.add((name, inner))
            if present is None:
                added = etree.SubElement(element, f"{SPACE}{inner}")
                added.text = "0.4 0.3 0.2 0.1 0 0 0"
                if is_lost():
                    lost.add(f"{name} > {inner}")
                element.remove(added)
            else:
                place = element.index(present)
                element.remove(present)
                if is_lost():
                    lost.add(f"{name} > {inner} removed")
                element.insert(place, present)
        for key in schema.attributes(declared):
            if (name, f"@{key}") in seen or is_excused(f"{name}.{key}"):
                continue
            seen.add((name, f"@{key}"))
            value = element.get(key)
            element.set(key, "7")
            if is_lost():
                lost.add(f"{name}.{key}")
            element.attrib.pop(key)
            if value is not None:
                element.set(key, value)
        for child in element:
            visit(child, allowed[etree.QName(child).localname])

    visit(root, schema.top["COLLADA"])
    assert lost - set(EXPECTED) == set(), sorted(lost)


def test_cameras_stand_where_their_nodes_are(folder):
    cameras = load_file(write(folder, "a.dae", COMPLETE)).cameras
    assert list(cameras) == ["n", "n_1", "n_2", "held", "k"]
    tall, high, flat, wide, aimed = cameras.values()
    assert (tall.view_height, flat.view_height) == pytest.approx((1.0, 0.6))  # of units of 0.1 m
    assert high.fov_degrees == 50.0
    assert wide.fov_degrees == pytest.approx(2.0 * math.degrees(math.atan(0.5 * math.tan(math.radians(30.0)))))
    np.testing.assert_allclose(tall.origin, [0, 0, 1.9], atol=1e-9)  # 7 + 3 * 4 units
    place = np.array([0.9 * math.cos(math.radians(30)), 0.9 * math.sin(math.radians(30)), 1.9])
    np.testing.assert_allclose(wide.origin, place, atol=1e-9)  # of an instance of a node
    np.testing.assert_allclose(np.subtract(wide.target, wide.origin), [0, 0, -1], atol=1e-9)
    np.testing.assert_allclose(aimed.origin, [0.1, 0.2, 0.3])
    ahead = np.subtract(aimed.target, aimed.origin)
    np.testing.assert_allclose(ahead, [-1 / math.sqrt(5), -2 / math.sqrt(5), 0], atol=1e-9)
    assert wrt.load(folder / "a.dae", camera="k").camera.origin == pytest.approx((0.1, 0.3, -0.2))  # z is up


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("<ymag>5</ymag>", "", "has neither xmag nor ymag"),
        ("<yfov>50<", "<yfov>many<", "could not convert string to float"),
        ('instance_camera url="#wide"', 'instance_camera url="#none"', "its camera '#none' is not there"),
        ("<scale>1 2 3<", "<scale>0 0 0<", "a camera hangs on a node that is scaled to nothing"),
        (
            '<instance_camera url="#wide"/>',
            '<instance_camera url="#wide"/><instance_node url="#held"/>',
            "within itself",
        ),
    ],
)
def test_damaged_cameras_are_refused_in_one_line(folder, old, new, message):
    assert old in COMPLETE
    path = write(folder, "a.dae", COMPLETE.replace(old, new))
    with pytest.raises(wrt.InputError, match=rf"^{re.escape(str(path))}: .*{message}"):
        load_file(path)


@pytest.mark.parametrize(
    ("mode", "color", "amount", "is_opaque"),
    [
        ("A_ONE", "0 0 0 1", 1, True),
        ("A_ONE", "0 0 0 1", 0.5, False),
        ("A_ONE", "1 1 1 0.5", 1, False),
        ("RGB_ZERO", "0 0 0 0", 1, True),
        ("RGB_ZERO", "1 1 1 1", 0, True),
        ("RGB_ZERO", "1 1 1 1", 0.5, False),
        ("A_ZERO", "1 1 1 1", 1, False),
    ],
)
def test_transparency_is_named_unless_it_leaves_a_surface_opaque(folder, mode, color, amount, is_opaque):
    shown = f'<transparent opaque="{mode}"><color>{color}</color></transparent>'
    text = COMPLETE.replace("</phong>", f"{shown}<transparency><float>{amount}</float></transparency></phong>")
    _, messages = loaded(folder, etree.fromstring(text))
    assert ["partial transparency" in message for message in messages] == [True] * (not is_opaque)
