"""What the reader of Mitsuba's scene files takes, warns of and refuses."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from support.mesh_files import check_refused
from support.meshes import write
from support.mitsuba_files import write_files

import wrt
import wrt.scene.materials.presets
from wrt.cli import main
from wrt.errors import InputWarning
from wrt.io.mitsuba.coats import as_in_mitsuba
from wrt.io.mitsuba.optics import named_conductor
from wrt.scene.exact.analytic import Analytic
from wrt.scene.exact.quadrics import Quadrics
from wrt.scene.exact.spheres import Spheres

BALL = '<shape type="sphere"/>'
SCENE = '<scene version="3.0.0">{}</scene>'


def written(folder: Path, body: str, name: str = "scene.xml", version: str = "3.0.0") -> Path:
    return write(folder, name, f'<scene version="{version}">\n{body}\n</scene>\n')


def loaded(folder: Path, body: str, **options: object) -> wrt.Scene:
    return wrt.load(written(folder, body), **options)


def sensor(inside: str = "", *, size: tuple[int, int] = (320, 200), film: str = "", kind: str = "perspective") -> str:
    width, height = (f'<integer name="{k}" value="{v}"/>' for k, v in zip(("width", "height"), size, strict=True))
    return f'<sensor type="{kind}">{inside}<film type="hdrfilm">{width}{height}{film}</film></sensor>'


def at(z: float) -> str:
    return f'<transform name="to_world"><lookat origin="0, 0, {z}" target="0, 0, -9" up="0, 1, 0"/></transform>'


def material(folder: Path, bsdf: str) -> wrt.Material:
    """The material of a ball, which is closed and so needs no black back."""
    return loaded(folder, sensor(at(5.0)) + f'<shape type="sphere">{bsdf}</shape>').shapes[0].material


def test_scenes_of_the_tests_are_read_without_a_warning(tmp_path):
    write_files(tmp_path)
    for path in sorted(tmp_path.glob("*.xml")):
        if path.stem not in ("view", "lamp"):  # which have nothing to see
            assert wrt.load(path, strict=True).shapes


def test_settings(tmp_path):
    depths = '<integer name="max_depth" value="7"/><integer name="rr_depth" value="3"/>'
    sampler = '<sampler type="ldsampler"><integer name="sample_count" value="16"/></sampler>'
    path = f'<integrator type="path">{depths}</integrator>'
    settings = loaded(tmp_path, path + sensor(sampler, film='<rfilter type="tent"/>') + BALL).settings
    assert (settings.width, settings.height, settings.spp) == (320, 200, 16)
    assert (settings.max_depth, settings.filter, settings.sampler) == (7, "tent", "sobol")
    for film in ("", '<rfilter type="gaussian"/>'):
        assert loaded(tmp_path, sensor(film=film) + BALL).settings.filter == "shared"
    # As Mitsuba 0.6 wrote it.
    old = (path + sensor()).replace("max_depth", "maxDepth") + BALL
    assert wrt.load(written(tmp_path, old, version="0.6.0")).settings.max_depth == 7
    assert loaded(tmp_path, '<integrator type="direct"/>' + BALL).settings.integrator == "direct"
    prb = f'<integrator type="prbvolpath">{depths}</integrator>'
    assert loaded(tmp_path, prb + BALL, strict=True).settings.max_scatterings == 6
    settings = loaded(tmp_path, '<integrator type="depth"/>' + BALL).settings
    assert (settings.integrator, settings.layers) == ("aov", ("depth",))
    names = '<string name="aovs" value="a:albedo,n:sh_normal"/>'
    aovs = f'<integrator type="aov">{names}<integrator type="path"/></integrator>'
    assert loaded(tmp_path, aovs + BALL).settings.layers == ("albedo", "normal")


@pytest.mark.parametrize(("axis", "divisor"), [("smaller", 1.0), ("larger", 1.6), ("diagonal", np.hypot(1.6, 1.0))])
def test_field_of_view(axis, divisor, tmp_path):
    fov = f'<float name="fov" value="40"/><string name="fov_axis" value="{axis}"/>'
    camera = loaded(tmp_path, sensor(fov) + BALL).camera
    assert np.tan(np.radians(camera.fov_degrees) / 2) == pytest.approx(np.tan(np.radians(20.0)) / divisor)


def test_a_sensor_is_chosen_by_its_number(tmp_path):
    left_out = '<sensor type="radiancemeter"/>' + sensor(kind="orthographic").replace(
        "sensor type", 'sensor id="b" type'
    )
    path = written(tmp_path, sensor() + sensor(size=(8, 8), kind="orthographic") + BALL)
    assert isinstance(wrt.load(path, camera=0).camera, wrt.PerspectiveCamera)
    second = wrt.load(path, camera="1")
    assert isinstance(second.camera, wrt.OrthographicCamera)
    assert (second.settings.width, second.settings.height) == (8, 8)
    with pytest.raises(wrt.InputError, match="there is no camera 2; it has 0 'camera', 1 'camera_1'"):
        wrt.load(path, camera=2)
    with pytest.warns(UserWarning, match="of its cameras, 0 'camera', 1 'camera_1', the first is taken"):
        assert list(wrt.load(path, strict=True).cameras) == ["camera", "camera_1"]
    with pytest.warns(InputWarning, match="sensor 'radiancemeter': this kind of sensor is not known; left out"):
        assert isinstance(loaded(tmp_path, left_out + BALL, camera="b").camera, wrt.OrthographicCamera)
    with pytest.raises(wrt.InputError, match="only for Mitsuba scenes"):
        wrt.load("cornell-box", parameters={"a": 1})


def test_default_materials_agree_with_mitsuba(tmp_path):
    assert isinstance(material(tmp_path, '<bsdf type="conductor"/>'), wrt.Mirror)
    unknown = '<bsdf type="conductor"><string name="material" value="Uuo"/></bsdf>'
    with pytest.warns(InputWarning, match="'Uuo' is not known; aluminium stands in"):
        assert material(tmp_path, unknown) == wrt.Conductor(*named_conductor("Al"))
    glass = material(tmp_path, '<bsdf type="roughdielectric"/>')
    assert glass == wrt.RoughDielectric(1.5046, 1.000277, 0.1, "beckmann", "walter")
    coat = material(tmp_path, '<bsdf type="roughplastic"/>')
    base = as_in_mitsuba(0.5, 0.1, "beckmann", 1.49 / 1.000277, nonlinear=False)
    assert coat == wrt.RoughPlastic(base, 1.49, 1.000277, 0.1, "beckmann", "walter", multiple_bounces=False)
    # A mask has holes from behind, too.
    mask = '<bsdf type="mask"><float name="opacity" value="0.25"/><bsdf type="diffuse"/></bsdf>'
    found = loaded(tmp_path, f'<shape type="rectangle">{mask}</shape>').shapes[0].material
    assert [part.opacity for part in found.parts] == [0.25, 0.25]


def test_parameters(tmp_path):
    body = '<default name="r" value="0.2"/><shape type="sphere"><float name="radius" value="$r"/></shape>'
    assert loaded(tmp_path, body).bounds[1, 0] == pytest.approx(0.2)
    assert loaded(tmp_path, body, parameters={"r": 3}).bounds[1, 0] == pytest.approx(3.0)
    with pytest.raises(wrt.InputError, match="the parameter 's' is not in the scene"):
        loaded(tmp_path, body, parameters={"s": 3})
    with pytest.raises(wrt.InputError, match=r"line 2: the parameter \$s has no value"):
        loaded(tmp_path, body.replace("$r", "${s}"))


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # pytest makes errors of them
def test_command_line(tmp_path, capfd):
    size = '<default name="size" value="64"/>' + sensor(at(4.0)).replace('"320"', '"$size"').replace("200", "$size")
    path = written(tmp_path, size + '<shape type="sphere"><emitter type="area"/></shape><shape type="heightfield"/>')
    command = ["render", str(path), "-D", "size=8", "--spp", "1", "-o", str(tmp_path / "a.npy")]
    assert main(command) == 0
    assert np.load(tmp_path / "a.npy").shape == (8, 8, 3)
    assert "shape 'heightfield': this kind of shape is not known; left out" in capfd.readouterr().err
    assert main([*command, "--strict"]) == 2


def test_outlines_are_off_by_less_than_half_a_pixel(tmp_path, report):
    view = sensor('<float name="fov" value="30"/>' + at(4.0), size=(4000, 4000))
    place = '<transform name="to_world"><scale x="1" y="1.001" z="1"/></transform>'  # a sphere would stay exact
    mesh = loaded(tmp_path, f'{view}<shape type="sphere">{place}</shape>').shapes[0].mesh
    middles = (mesh.vertices / (1.0, 1.001, 1.0))[mesh.faces].astype(np.float64).mean(axis=1)
    pixel = 2.0 * np.tan(np.radians(15.0)) * 3.0 / 4000.0
    depth = float((1.0 - np.linalg.norm(middles, axis=-1)).max() / pixel)
    report("depth of faces, pixels", depth, "< 0.5")
    assert 0.1 < depth < 0.5


PLACE = '<transform name="to_world"><scale {}/><rotate x="1" angle="30"/><translate x="2"/></transform>'
TUBE = '<point name="p0" x="1"/><point name="p1" x="1" z="3"/><float name="radius" value="0.5"/>'
FLIP = '<boolean name="flip_normals" value="true"/>'


@pytest.mark.parametrize(
    ("kind", "size", "extra", "front", "area"),
    [
        ("disk", 'value="2"', "", 1.0, 4.0 * np.pi),
        ("disk", 'x="1" y="-2" z="3"', FLIP, -1.0, 2.0 * np.pi),
        ("cylinder", 'x="2" y="2" z="-1"', TUBE, -1.0, 6.0 * np.pi),
        ("cylinder", 'value="2"', TUBE + FLIP, 1.0, 12.0 * np.pi),
        ("sphere", 'x="2" y="-2" z="2"', '<point name="center" x="1"/>' + FLIP, None, 16.0 * np.pi),
        ("cylinder", 'x="1" y="2" z="1"', "", None, None),
        ("sphere", 'x="1" y="2" z="1"', "", None, None),
    ],
)
def test_round_shapes_are_exact_where_possible(kind, size, extra, front, area, tmp_path):
    """A disk under any map, spheres and cylinders as long as they are round; others are triangles."""
    (shape,) = loaded(tmp_path, f'<shape type="{kind}">{PLACE.format(size)}{extra}</shape>', strict=True).shapes
    mesh = shape.mesh
    if area is None:
        assert not isinstance(mesh, Analytic)
        return
    assert isinstance(mesh, Spheres if kind == "sphere" else Quadrics)
    assert mesh.areas == pytest.approx(area, rel=1e-5)
    assert np.all(mesh.inside_out == (FLIP in extra))
    if front:
        np.testing.assert_allclose(mesh.fronts, [[0.0, -0.5 * front, np.sqrt(0.75) * front]], atol=1e-6)
    else:
        np.testing.assert_allclose(mesh.centers, [[4.0, 0.0, 0.0]], atol=1e-6)


def test_instances_share_a_mesh_and_comments_may_hold_hyphens(tmp_path):
    comment = "<!-- a -- b\n<shape> ---- -->"
    group = f'{comment}<shape type="shapegroup" id="a"><shape type="sphere"/></shape>{comment}'
    place = '<transform name="to_world"><translate x="{}"/></transform>'
    instances = "".join(f'<shape type="instance"><ref id="a"/>{place.format(i)}</shape>' for i in range(3))
    shapes = loaded(tmp_path, group + instances).shapes
    assert [shape.transform[0, 3] for shape in shapes] == [0.0, 1.0, 2.0]
    assert len({id(shape.mesh) for shape in shapes}) == 1
    with pytest.raises(wrt.InputError, match="line 4: shape 'obj': names no file"):  # lines are still counted
        loaded(tmp_path, f'{comment}\n<shape type="obj"/>')


def test_named_conductors_agree_with_mitsuba(report):
    """All that Mitsuba comes with, to the four digits that are kept; and a name that only `materials.presets` has."""
    mi = pytest.importorskip("mitsuba", reason="the independent renderer is not installed")
    mi.set_variant("scalar_rgb")
    level = mi.logger().log_level()
    mi.set_log_level(mi.LogLevel.Error)  # it tells of colours outside of its gamut
    names = {path.name.split(".")[0] for path in (Path(mi.__file__).parent / "data" / "ior").glob("*.spd")}
    names -= {"AlSb", "AlSb_palik"}
    for name in names:
        theirs = mi.traverse(mi.load_dict({"type": "conductor", "material": name}))
        for ours, key in zip(named_conductor(name), ("eta.value", "k.value"), strict=True):
            np.testing.assert_allclose(ours, np.array(theirs[key]).ravel(), rtol=6e-4, atol=1e-7, err_msg=name)
    mi.set_log_level(level)
    report("conductors", len(names), "as in Mitsuba")
    assert len(names) > 30
    assert named_conductor("Pt") == wrt.scene.materials.presets.metal_ior("platinum")


ERRORS = {
    '<shape type="sphere">': r"not well-formed XML",
    '<shape type="sphere"><ref id="paint"/></shape>': r"line 2: no object has the id 'paint'",
    '<shape type="obj"/>': r"line 2: shape 'obj': names no file",
    '<shape type="obj"><string name="filename" value="lfs.obj"/></shape>': r"line 2: .*lfs\.obj: .* a Git LFS pointer",
    '<include filename="scene.xml"/>': r"line 2: 'scene.xml' includes itself",
    '<shape type="sphere"><float name="radius" value="big"/></shape>': r"line 2: float 'radius': not a number in 'big'",
    '<shape type="sphere"><string name="radius" value="1"/></shape>': r"must be given by <float>, not by <string>",
    '<shape type="sphere"><transform name="to_world"><spin/></transform></shape>': r"<spin> is not a transform",
    '<bsdf type="diffuse" id="a"/><bsdf type="diffuse" id="a"/>': r"the id 'a' is used twice",
    '<shape type="sphere"><bsdf type="bumpmap" id="x"><ref id="x"/></bsdf></shape>': r"contains itself",
    '<shape type="sphere"><bdsf type="diffuse"/></shape>': r"<bdsf> is not known here \(did you mean 'bsdf'\?\)",
    '<emitter type="point"/>': r"it has no supported shapes",
}


@pytest.mark.parametrize("body", ERRORS)
def test_bad_files_are_refused_in_one_line(body, tmp_path):
    write(tmp_path, "lfs.obj", "version https://git-lfs.github.com/spec/v1\noid sha256:f7\nsize 184302\n")
    path = written(tmp_path, body)
    with pytest.raises(wrt.InputError, match=ERRORS[body]) as caught:
        wrt.load(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_other_files_and_exponential_references_are_refused(tmp_path):
    deep = "<shape>" * 200 + "</shape>" * 200
    entity, address = 'scene [<!ENTITY a "aaaa">]', 'scene SYSTEM "http://localhost/x.dtd"'
    scenes = f"<!DOCTYPE {entity}>{SCENE.format('&a;')}", f"<!DOCTYPE {address}>{SCENE.format('')}", SCENE.format(deep)
    for text in (*scenes, "", "scene", "<scene", "<html/>"):
        check_refused("scene.xml: ", wrt.load, write(tmp_path, "scene.xml", text))
    for i in range(12):
        written(tmp_path, f'<include filename="{i + 1}.xml"/>' * 3, f"{i}.xml")
    written(tmp_path, BALL, "12.xml")
    with pytest.raises(wrt.InputError, match="more than 1000 files are included"):
        wrt.load(tmp_path / "0.xml")
    blend = '<bsdf type="blendbsdf" id="b{0}"><ref id="b{1}"/><ref id="b{1}"/></bsdf>'
    nested = "".join(blend.format(i, i + 1) for i in range(40)) + '<bsdf type="diffuse" id="b40"/>'
    group = '<shape type="shapegroup" id="a"><shape type="instance"><ref id="b"/></shape></shape>'
    group += '<shape type="shapegroup" id="b"><shape type="cube"/></shape><shape type="instance"><ref id="a"/></shape>'
    for message, body in (
        ("nested more than 7 deep", nested + '<shape type="sphere"><ref id="b0"/></shape>'),
        ("must not hold groups or instances", group),
    ):
        with pytest.raises(wrt.InputError, match=message):
            loaded(tmp_path, body)


NEAR = sensor('<float name="near_clip" value="1e-7"/>' + at(-1.000001).replace("-9", "0"), size=(4000, 4000))
LEFT_OUT = {
    '<shape type="sphere"><bsdf type="hair"/></shape>': "bsdf 'hair'",
    '<shape type="sphere"><bsdf type="diffuse"><float name="reflectence" value="1"/></bsdf></shape>': "did you mean",
    '<emitter type="beam"/>' + BALL: "emitter 'beam'",
    '<sensor type="fluencemeter"/>' + BALL: "sensor 'fluencemeter'",
    sensor(film='<rfilter type="lanczos"/>') + BALL: "'blackman-harris' stands in",
    sensor('<float name="far_clip" value="5"/>' + at(5.0)) + BALL: "near_clip",
    NEAR + '<shape type="cylinder"><transform name="to_world"><scale x="2"/></transform></shape>': "768 segments",
    '<integrator type="ptracer"/>' + BALL: "'path' stands in",
    '<integrator type="path"><boolean name="hide_emitters" value="true"/></integrator>'
    '<shape type="sphere"><emitter type="area"/></shape>': "hide",
    '<shape type="sphere"><bsdf type="diffuse"><rgb name="reflectance" value="2"/></bsdf></shape>': "clipped to 1",
    '<shape type="sphere"><bsdf type="diffuse"><texture type="noise" name="reflectance"/></bsdf></shape>': "'noise'",
    '<emitter type="sunsky"><float name="hour" value="23"/></emitter>' + BALL: "below the horizon",
    '<emitter type="sky"/>' + BALL: "taken as a 'sunsky'",
    "".join(
        f'<shape type="sphere"><bsdf type="null"/><medium type="homogeneous" name="exterior">{text}</medium></shape>'
        for text in ("", '<float name="sigma_t" value="2"/>')
    )
    + BALL: "its 'exterior' is left out: another medium fills",
}


@pytest.mark.parametrize("body", LEFT_OUT)
def test_parts_that_are_left_out_are_named(body, tmp_path):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert loaded(tmp_path, body).shapes
    messages = [str(each.message) for each in caught if each.category is InputWarning]
    assert any(LEFT_OUT[body] in message for message in messages), messages
    assert len(set(messages)) == len(messages) == len(caught)
    assert all(": line " in message and "\n" not in message for message in messages)
    with pytest.raises(wrt.InputError, match=re.escape(messages[0])):
        loaded(tmp_path, body, strict=True)


HAZE = '<rgb name="sigma_t" value="0.9, 0.7, 0.5"/><rgb name="albedo" value="0.5"/>'
SMOKE = '<rgb name="sigma_t" value="0.3"/><rgb name="albedo" value="0.5"/>'


def body(radius: float, *media: tuple[str, str]) -> str:
    inner = "".join(f'<medium type="homogeneous" name="{name}">{text}</medium>' for name, text in media)
    return f'<shape type="sphere"><float name="radius" value="{radius}"/><bsdf type="null"/>{inner}</shape>'


def seen_from(z: float, medium: str = "") -> str:
    return sensor(at(z) + (f'<medium type="homogeneous">{medium}</medium>' if medium else ""))


NESTED = [body(0.5, ("exterior", HAZE), ("interior", SMOKE)), body(1.0, ("interior", HAZE))]


def test_the_surrounding_medium_is_not_inside_any_body(tmp_path):
    for parts, around in (
        (NESTED, None),
        ([*NESTED, seen_from(5.0, SMOKE)], SMOKE),
        ([*NESTED, seen_from(5.0, HAZE)], HAZE),  # the same haze inside and outside
        ([*NESTED, seen_from(0.75, HAZE)], None),  # the camera is in the haze of the larger body
        ([*NESTED, seen_from(0.25, SMOKE)], None),  # and in the smaller one
        ([body(0.5, ("exterior", HAZE), ("interior", SMOKE))], HAZE),  # of no shape's inside
        ([body(0.5, ("exterior", SMOKE)), body(1.0, ("interior", HAZE), ("exterior", SMOKE))], SMOKE),
        ([seen_from(0.75, HAZE), body(1.0, ("interior", HAZE), ("exterior", SMOKE))], SMOKE),
    ):
        scene = loaded(tmp_path, "".join(parts) + BALL, strict=True)
        media = {None: None, HAZE: wrt.Medium((0.45, 0.35, 0.25), (0.45, 0.35, 0.25)), SMOKE: wrt.Medium(0.15, 0.15)}
        assert scene.medium == media[around]
