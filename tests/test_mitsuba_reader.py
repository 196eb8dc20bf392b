"""What the reader of Mitsuba's scene files takes, warns of and refuses."""

from __future__ import annotations

import re
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, Report
from PIL import Image
from support.mitsuba_files import SCENES, write_files

import wrt
import wrt.scene.materials.presets
from wrt.errors import InputWarning
from wrt.io.mitsuba.materials.coats import as_in_mitsuba
from wrt.io.mitsuba.materials.metals import named_conductor
from wrt.scene.exact.analytic import Analytic
from wrt.scene.exact.quadrics import Quadrics
from wrt.scene.exact.spheres import Spheres

BALL = '<shape type="sphere"/>'


def written(folder: Path, body: str, name: str = "scene.xml", version: str = "3.0.0") -> Path:
    path = folder / name
    path.write_text(f'<scene version="{version}">\n{body}\n</scene>\n')
    return path


def loaded(folder: Path, body: str, **options: object) -> wrt.Scene:
    return wrt.load(written(folder, body), **options)


def material(folder: Path, bsdf: str) -> wrt.Material:
    """The material of a ball, which is closed and so needs no black back."""
    camera = '<sensor type="perspective"><transform name="to_world"><translate z="-5"/></transform></sensor>'
    return loaded(folder, f'{camera}<shape type="sphere">{bsdf}</shape>').shapes[0].material


# --- What is taken --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scenes")
    write_files(folder)
    return folder


@pytest.mark.parametrize("name", sorted(path.stem for path in SCENES.glob("*.xml")))
def test_scenes_of_the_tests_are_read_without_a_warning(name: str, scenes: Path) -> None:
    if name not in ("view", "lamp"):  # which have nothing to see
        assert wrt.load(scenes / f"{name}.xml", strict=True).shapes


def test_settings(tmp_path: Path) -> None:
    settings = loaded(
        tmp_path,
        """<integrator type="path">
            <integer name="max_depth" value="7"/><integer name="rr_depth" value="3"/>
        </integrator>
        <sensor type="perspective">
            <film type="hdrfilm"><integer name="width" value="320"/><integer name="height" value="200"/>
                <rfilter type="tent"/></film>
            <sampler type="ldsampler"><integer name="sample_count" value="16"/></sampler>
        </sensor>"""
        + BALL,
    ).settings
    assert (settings.width, settings.height, settings.spp) == (320, 200, 16)
    assert (settings.max_depth, settings.filter, settings.sampler) == (7, "tent", "sobol")


@pytest.mark.parametrize(
    ("axis", "degrees"),
    [
        ("x", 2 * np.degrees(np.arctan(np.tan(np.radians(20.0)) / 1.6))),
        ("y", 40.0),
        ("smaller", 40.0),
        ("larger", 2 * np.degrees(np.arctan(np.tan(np.radians(20.0)) / 1.6))),
        ("diagonal", 2 * np.degrees(np.arctan(np.tan(np.radians(20.0)) / np.hypot(1.6, 1.0)))),
    ],
)
def test_field_of_view(axis: str, degrees: float, tmp_path: Path) -> None:
    camera = loaded(
        tmp_path,
        f"""<sensor type="perspective"><float name="fov" value="40"/><string name="fov_axis" value="{axis}"/>
        <film type="hdrfilm"><integer name="width" value="320"/><integer name="height" value="200"/></film></sensor>"""
        + BALL,
    ).camera
    assert isinstance(camera, wrt.PerspectiveCamera)
    assert camera.fov_degrees == pytest.approx(degrees)


def test_depth_is_a_layer(tmp_path: Path) -> None:
    settings = loaded(tmp_path, '<integrator type="depth"/>' + BALL).settings
    assert (settings.integrator, settings.layers) == ("aov", ("depth",))
    names = '<string name="aovs" value="a:albedo,n:sh_normal"/>'
    aovs = f'<integrator type="aov">{names}<integrator type="path"/></integrator>'
    assert loaded(tmp_path, aovs + BALL).settings.layers == ("albedo", "normal")


def test_metals_by_name(tmp_path: Path) -> None:
    gold = material(tmp_path, '<bsdf type="conductor"><string name="material" value="Au"/></bsdf>')
    assert gold == wrt.Conductor(*named_conductor("Au"))  # type: ignore[misc]
    assert isinstance(material(tmp_path, '<bsdf type="conductor"/>'), wrt.Mirror)
    with pytest.warns(InputWarning, match="'Uuo' is not known; aluminium stands in"):
        other = material(tmp_path, '<bsdf type="conductor"><string name="material" value="Uuo"/></bsdf>')
    assert other == wrt.Conductor(*named_conductor("Al"))  # type: ignore[misc]


def test_defaults_are_mitsuba_s(tmp_path: Path) -> None:
    glass = material(tmp_path, '<bsdf type="roughdielectric"/>')
    assert glass == wrt.RoughDielectric(1.5046, 1.000277, 0.1, "beckmann", "walter")
    coat = material(tmp_path, '<bsdf type="roughplastic"/>')
    base = as_in_mitsuba(0.5, 0.1, "beckmann", 1.49 / 1.000277, nonlinear=False)
    assert coat == wrt.RoughPlastic(base, 1.49, 1.000277, 0.1, "beckmann", "walter", multiple_bounces=False)


def test_parameters(tmp_path: Path) -> None:
    body = '<default name="r" value="0.2"/><shape type="sphere"><float name="radius" value="$r"/></shape>'
    assert loaded(tmp_path, body).bounds[1, 0] == pytest.approx(0.2)
    assert loaded(tmp_path, body, parameters={"r": 3}).bounds[1, 0] == pytest.approx(3.0)
    with pytest.raises(wrt.InputError, match="the parameter 's' is not in the scene"):
        loaded(tmp_path, body, parameters={"s": 3})
    with pytest.raises(wrt.InputError, match=r"line 2: the parameter \$s has no value"):
        loaded(tmp_path, body.replace("$r", "${s}"))


@pytest.mark.slow
def test_command_line(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        """<default name="size" value="64"/><sensor type="perspective">
        <transform name="to_world"><translate z="-4"/></transform><film type="hdrfilm">
        <integer name="width" value="$size"/><integer name="height" value="$size"/></film></sensor>
        <shape type="sphere"><emitter type="area"/></shape><shape type="heightfield"/>""",
    )
    command = [
        sys.executable,
        "-m",
        "wrt",
        "render",
        str(path),
        "-D",
        "size=8",
        "--spp",
        "1",
        "-o",
        str(tmp_path / "a.npy"),
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert np.load(tmp_path / "a.npy").shape == (8, 8, 3)
    assert done.stderr.count("warning") == 1
    assert "line 5: shape 'heightfield': this kind of shape is not known; left out" in done.stderr
    refused = subprocess.run([*command, "--strict"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert refused.returncode == 2
    assert "heightfield" in refused.stderr


@pytest.mark.parametrize("kind", ["sphere", "cylinder"])
def test_outlines_are_off_by_less_than_half_a_pixel(kind: str, tmp_path: Path, report: Report) -> None:
    body = f"""<sensor type="perspective"><float name="fov" value="30"/>
        <transform name="to_world"><lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm"><integer name="width" value="4000"/><integer name="height" value="4000"/></film></sensor>
        <shape type="{kind}"><transform name="to_world"><scale x="1" y="1.001" z="1"/></transform></shape>"""
    mesh = loaded(tmp_path, body).shapes[0].mesh
    assert not isinstance(mesh, Analytic)
    vertices = mesh.vertices / (1.0, 1.001, 1.0)
    corners = vertices[mesh.faces].astype(np.float64)
    points = corners if kind == "sphere" else corners[..., :2]
    if kind == "sphere":
        inside = 1.0 - np.linalg.norm(points.mean(axis=1), axis=-1)
    else:
        # A cylinder's triangles have an upright edge, on the circle.
        inside = (1.0 - np.linalg.norm(0.5 * (points + np.roll(points, 1, axis=1)), axis=-1)).max(axis=1)
    pixel = 2.0 * np.tan(np.radians(15.0)) * 3.0 / 4000.0
    report(f"{kind}: depth of faces, pixels", float(inside.max() / pixel), "< 0.5")
    assert 0.1 < inside.max() / pixel < 0.5
    assert np.allclose(np.linalg.norm(vertices[..., : 2 if kind != "sphere" else 3], axis=-1).max(), 1.0)


def test_too_near_is_told(tmp_path: Path) -> None:
    place = '<transform name="to_world"><translate z="-1.000001"/></transform>'
    film = '<film type="hdrfilm"><integer name="width" value="4000"/><integer name="height" value="4000"/></film>'
    near = f'<sensor type="perspective"><float name="near_clip" value="1e-7"/>{place}{film}</sensor>'
    with pytest.warns(InputWarning, match="limited to 768 segments"):
        loaded(tmp_path, near + '<shape type="cylinder"><transform name="to_world"><scale x="2"/></transform></shape>')


def test_disks_and_cylinders_stay_such(tmp_path: Path) -> None:
    """A disk under any map, a cylinder as long as it is round and straight; others are triangles without a word."""
    place = '<transform name="to_world"><scale {}/><rotate x="1" angle="30"/><translate x="2"/></transform>'
    flip = '<boolean name="flip_normals" value="true"/>'
    tube = '<point name="p0" x="1"/><point name="p1" x="1" z="3"/><float name="radius" value="0.5"/>'
    body = (
        f'<shape type="disk">{place.format("""value="2" """)}</shape>'
        f'<shape type="disk">{place.format("""x="1" y="-2" z="3" """)}{flip}</shape>'
        f'<shape type="cylinder">{tube}{place.format("""x="2" y="2" z="-1" """)}</shape>'
        f'<shape type="cylinder">{tube}{place.format("""value="2" """)}{flip}</shape>'
        f'<shape type="cylinder">{tube}{place.format("""x="1" y="2" z="1" """)}</shape>'
    )
    *exact, cut = (shape.mesh for shape in loaded(tmp_path, body, strict=True).shapes)
    assert not isinstance(cut, Quadrics)
    turned = np.array([[1.0, 0.0, 0.0], [0.0, np.sqrt(0.75), -0.5], [0.0, 0.5, np.sqrt(0.75)]])
    front = turned @ (0.0, 0.0, 1.0)
    for mesh, area, axis, inside_out in zip(
        exact,
        (4 * np.pi, 2 * np.pi, 2 * np.pi * 1.0 * 3.0, 2 * np.pi * 1.0 * 6.0),
        (front, -front, -front, front),
        (False, True, False, True),
        strict=True,
    ):
        assert isinstance(mesh, Quadrics)
        assert mesh.areas == pytest.approx(area, rel=1e-5)
        assert np.allclose(mesh.fronts, [axis], atol=1e-6)
        assert mesh.inside_out == inside_out
    assert np.allclose(exact[3].bounds.mean(axis=0), np.array([2.0, 0.0, 0.0]) + turned @ (2.0, 0.0, 3.0), atol=1e-5)


def test_spheres_stay_spheres(tmp_path: Path) -> None:
    """Turned, mirrored and scaled alike along all axes; others become triangles without a word."""
    place = '<transform name="to_world"><scale {}/><rotate x="1" angle="30"/><translate x="2"/></transform>'
    round_ = '<shape type="sphere"><point name="center" x="1"/><float name="radius" value="0.5"/>{}{}</shape>'
    flip = '<boolean name="flip_normals" value="true"/>'
    kinds = ('value="-2"', 'x="2" y="-2" z="2"', 'x="1" y="2" z="1"')
    body = "".join(round_.format(place.format(kind), flip if i == 1 else "") for i, kind in enumerate(kinds))
    first, second, third = (shape.mesh for shape in loaded(tmp_path, body, strict=True).shapes)
    assert isinstance(first, Spheres)
    assert isinstance(second, Spheres)
    assert not isinstance(third, Spheres)
    assert np.allclose(first.centers, [[0.0, 0.0, 0.0]], atol=1e-6)
    assert np.allclose(second.centers, [[4.0, 0.0, 0.0]], atol=1e-6)
    assert np.allclose([first.radii, second.radii], 1.0)
    assert [first.inside_out[0], second.inside_out[0]] == [False, True]


def test_clipping_is_told_where_it_shows(tmp_path: Path) -> None:
    place = '<transform name="to_world"><translate z="-5"/></transform>'
    far = f'<sensor type="perspective"><float name="far_clip" value="{{}}"/>{place}</sensor>'
    loaded(tmp_path, far.format(7.0) + BALL, strict=True)
    with pytest.warns(InputWarning, match="near_clip"):
        loaded(tmp_path, far.format(5.0) + BALL)


# --- Colours --------------------------------------------------------------------------------------

SPECTRA = [
    '<spectrum name="{}" value="0.5"/>',
    '<spectrum name="{}" value="400:0.1, 500:0.2, 600:0.8, 700:0.3"/>',
    '<spectrum name="{}" value="380:0.9 480:0.7 520:0.2 780:0.1"/>',
    '<spectrum name="{}" type="d65"/>',
    '<rgb name="{}" value="0.2 0.4 0.6"/>',
    '<float name="{}" value="0.3"/>',
]


@pytest.mark.parametrize("text", SPECTRA)
def test_colours_are_mitsuba_s(text: str, tmp_path: Path, report: Report) -> None:
    pytest.importorskip("mitsuba", reason="the independent renderer is not installed")
    from support.mitsuba_scene import load_mitsuba

    mi = load_mitsuba()
    scene = loaded(tmp_path, f'<emitter type="constant">{text.format("radiance")}</emitter>' + BALL)
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(0, 0, 1)
    xml = '<{0} version="3.0.0" type="{1}">{2}</{0}>'
    light = np.array(mi.load_string(xml.format("emitter", "constant", text.format("radiance"))).eval(si))
    ours = np.array(scene.environment.radiance)
    report("light", np.round(ours, 4).tolist(), np.round(light, 4).tolist())
    assert ours == pytest.approx(light, rel=2e-3, abs=2e-3)
    surface = mi.load_string(xml.format("bsdf", "diffuse", text.format("reflectance")))
    reflected = np.pi * np.array(surface.eval(mi.BSDFContext(), si, mi.Vector3f(0, 0, 1)))
    ours = np.array(material(tmp_path, f'<bsdf type="diffuse">{text.format("reflectance")}</bsdf>').reflectance)
    report("reflectance", np.round(ours, 4).tolist(), np.round(reflected, 4).tolist())
    assert ours == pytest.approx(reflected, rel=4e-3, abs=4e-3)


def test_a_black_body_is_as_bright_as_its_temperature_says(tmp_path: Path) -> None:
    """At 6504 K it is nearly D65; the Y of its colour, ∫ B y dλ / ∫ y dλ, is about Planck's B at 555 nm."""
    spectrum = '<spectrum name="radiance" type="blackbody"><float name="temperature" value="6504"/></spectrum>'
    body = f'<emitter type="constant">{spectrum}</emitter>'
    radiance = np.array(loaded(tmp_path, body + BALL).environment.radiance)
    assert radiance.max() / radiance.min() < 1.12
    metres = 555e-9
    planck = (
        2e-9
        * 6.62607015e-34
        * 299792458.0**2
        / metres**5
        / np.expm1(6.62607015e-34 * 299792458.0 / (metres * 1.380649e-23 * 6504))
    )
    assert radiance @ (0.2126, 0.7152, 0.0722) == pytest.approx(planck, rel=0.02)


def test_instances_share_a_mesh(tmp_path: Path) -> None:
    group = '<shape type="shapegroup" id="a"><shape type="sphere"/></shape>'
    place = '<transform name="to_world"><translate x="{}"/></transform>'
    instances = "".join(f'<shape type="instance"><ref id="a"/>{place.format(i)}</shape>' for i in range(3))
    shapes = loaded(tmp_path, group + instances).shapes
    assert [shape.transform[0, 3] for shape in shapes] == [0.0, 1.0, 2.0]
    assert len({id(shape.mesh) for shape in shapes}) == 1


def test_textures_may_be_called_spectra_as_in_mitsuba_2(tmp_path: Path) -> None:
    inner = '<{0} name="reflectance" type="checkerboard"><rgb name="color0" value="1 0 0"/></{0}>'
    text = f'<bsdf type="diffuse">{inner}</bsdf>'
    one, other = (material(tmp_path, text.format(word)).reflectance for word in ("texture", "spectrum"))
    np.testing.assert_array_equal(one.pixels, other.pixels)


def test_a_mesh_that_was_not_fetched_is_called_so(tmp_path: Path) -> None:
    (tmp_path / "ball.obj").write_text("version https://git-lfs.github.com/spec/v1\noid sha256:f7\nsize 184302\n")
    with pytest.raises(wrt.InputError, match=r"line 2: shape 'obj': \S*ball\.obj: it looks to be a Git LFS pointer"):
        loaded(tmp_path, '<shape type="obj"><string name="filename" value="ball.obj"/></shape>')


def test_scenes_of_versions_before_2_mean_what_they_meant(tmp_path: Path) -> None:
    Image.fromarray(np.full((2, 2, 3), 90, np.uint8)).save(tmp_path / "a.png")
    body = """<shape type="sphere"><bsdf type="diffuse"><texture type="bitmap" name="reflectance">
        <string name="filename" value="a.png"/><string name="filterType" value="ewa"/></texture></bsdf></shape>
        <shape type="sphere"><bsdf type="diffuse"><spectrum name="reflectance" value="0.1, 0.2 0.3"/></bsdf></shape>
        <emitter type="sunsky"><vector name="sunDirection" x="0.6" y="0.8"/></emitter>"""
    with pytest.warns(InputWarning, match="taken as a 'sunsky' of Mitsuba 3"):
        scene = wrt.load(written(tmp_path, body, version="0.5.0"))
    image, plain = (shape.material for shape in scene.shapes)
    assert image.front.reflectance.filter == "trilinear"
    assert plain.front.reflectance == pytest.approx((0.1, 0.2, 0.3))
    (sun,) = scene.lights
    np.testing.assert_allclose(sun.direction, (-0.6, -0.8, 0.0), atol=1e-6)
    assert np.asarray(sun.irradiance).min() > 0.0


def test_comments_may_hold_hyphens_as_in_mitsuba(tmp_path: Path) -> None:
    comment = "<!-- a -- b\n<shape> ---- -->"
    (shape,) = loaded(tmp_path, f'{comment}<shape type="sphere"/>{comment}').shapes
    assert shape.name == "sphere"
    with pytest.raises(wrt.InputError, match="line 4: shape 'obj': names no file"):  # lines are still counted
        loaded(tmp_path, f'{comment}\n<shape type="obj"/>')


def test_conductors_by_name_are_mitsuba_s(report: Report) -> None:
    """All that Mitsuba comes with, to the four digits that are kept; and a name that only `materials.presets` has."""
    mi = pytest.importorskip("mitsuba", reason="the independent renderer is not installed")
    mi.set_variant("scalar_rgb")
    level = mi.logger().log_level()
    mi.set_log_level(mi.LogLevel.Error)  # it tells of colours outside of its gamut
    names = {path.name.split(".")[0] for path in (Path(mi.__file__).parent / "data" / "ior").glob("*.spd")}
    assert {"Ag", "Cu_palik", "a-C"} <= names
    for name in names - {"AlSb", "AlSb_palik"}:
        theirs = mi.traverse(mi.load_dict({"type": "conductor", "material": name}))
        ours = named_conductor(name)
        assert ours is not None
        for own, key in zip(ours, ("eta.value", "k.value"), strict=True):
            np.testing.assert_allclose(own, np.array(theirs[key]).ravel(), rtol=6e-4, atol=1e-7, err_msg=name)
    mi.set_log_level(level)
    report("conductors", len(names) - 2, "as in Mitsuba")
    assert named_conductor("Ni") == named_conductor("ni_palik")
    assert named_conductor("Pt") == wrt.scene.materials.presets.metal_ior("platinum")
    assert named_conductor("unobtainium") is None


# --- What is refused ------------------------------------------------------------------------------

ERRORS = {
    '<shape type="sphere">': r"not well-formed XML",
    '<shape type="sphere"><ref id="paint"/></shape>': r"line 2: no object has the id 'paint'",
    '<shape type="obj"/>': r"line 2: shape 'obj': names no file",
    f'<emitter type="sunsky"><integer name="year" value="{10**400}"/></emitter>': r"'year' is out of range: 1000",
    '<emitter type="sunsky"><float name="turbidity" value="11"/></emitter>': r"turbidity must be at most 10",
    '<emitter type="sunsky"><float name="hour"/><vector name="sun_direction" x="1"/></emitter>': r"not both",
    '<shape type="obj"><string name="filename" value="no.obj"/></shape>': r"line 2: .*no\.obj: no such file",
    '<shape type="obj"><string name="filename" value="/dev/null"/></shape>': r"is a pipe or a device, not a file",
    '<include filename="scene.xml"/>': r"line 2: 'scene.xml' includes itself",
    '<include filename="../none.xml"/>': r"line 2: .*none.xml: no such file",
    '<shape type="sphere"><float name="radius" value="big"/></shape>': r"line 2: float 'radius': not a number in 'big'",
    '<shape type="sphere"><float name="radius" value="nan"/></shape>': r"numbers must be finite",
    '<shape type="sphere"><float name="radius" value="-1"/></shape>': r"'radius' must be greater than 0",
    '<shape type="sphere"><string name="radius" value="1"/></shape>': r"must be given by <float>, not by <string>",
    '<shape type="sphere"><transform name="to_world"><spin/></transform></shape>': r"<spin> is not a transform",
    '<shape type="sphere"><transform name="to_world"><scale value="0"/></transform></shape>': r"can be inverted",
    '<shape type="sphere"><transform name="to_world"><matrix value="1 2 3"/></transform></shape>': r"takes 9 or 16",
    '<bsdf type="diffuse" id="a"/><bsdf type="diffuse" id="a"/>': r"the id 'a' is used twice",
    '<shape type="sphere"><bsdf type="twosided"/></shape>': r"takes one bsdf or two, not 0",
    '<shape type="sphere"><bsdf type="dielectric"><string name="int_ior" value="glas"/></bsdf></shape>': r"'glas' is",
    '<shape type="sphere"><bsdf type="bumpmap" id="x"><ref id="x"/></bsdf></shape>': r"contains itself",
    '<shape type="sphere"><bdsf type="diffuse"/></shape>': r"<bdsf> is not known here \(did you mean 'bsdf'\?\)",
    '<sensor type="perspective"><float name="fov" value="200"/></sensor><shape type="sphere"/>': r"'fov' must be",
    '<emitter type="point"/>': r"it has no supported shapes",
}


@pytest.mark.parametrize("body", ERRORS)
def test_bad_files_are_refused_in_one_line(body: str, tmp_path: Path) -> None:
    (tmp_path / "scene").mkdir()
    path = written(tmp_path / "scene", body)
    with pytest.raises(wrt.InputError) as caught:
        wrt.load(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    assert re.search(ERRORS[body], message), message


@pytest.mark.parametrize(
    "text",
    [
        '<!DOCTYPE scene [<!ENTITY a "aaaa">]><scene version="3.0.0">&a;</scene>',
        '<!DOCTYPE scene SYSTEM "http://localhost/x.dtd"><scene version="3.0.0"/>',
        "",
        "scene",
        "<scene",
        "<html/>",
        '<scene version="3.0.0">' + "<shape>" * 200 + "</shape>" * 200 + "</scene>",
    ],
)
def test_what_is_no_scene_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(text)
    with pytest.raises(wrt.InputError) as caught:
        wrt.load(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_includes_that_multiply_are_refused(tmp_path: Path) -> None:
    for i in range(12):
        written(tmp_path, f'<include filename="{i + 1}.xml"/>' * 3, f"{i}.xml")
    written(tmp_path, BALL, "12.xml")
    with pytest.raises(wrt.InputError, match="more than 1000 files are included"):
        wrt.load(tmp_path / "0.xml")


def test_references_that_multiply_take_no_time(tmp_path: Path) -> None:
    nested = "".join(
        f'<bsdf type="blendbsdf" id="b{i}"><ref id="b{i + 1}"/><ref id="b{i + 1}"/></bsdf>' for i in range(40)
    )
    body = nested + '<bsdf type="diffuse" id="b40"/><shape type="sphere"><ref id="b0"/></shape>'
    with pytest.raises(wrt.InputError, match="nested more than 7 deep"):
        loaded(tmp_path, body)
    group = '<shape type="shapegroup" id="{0}"><shape type="instance"><ref id="{1}"/></shape></shape>'
    body = (
        group.format("a", "b") + group.format("b", "c") + '<shape type="shapegroup" id="c"><shape type="cube"/></shape>'
    )
    with pytest.raises(wrt.InputError, match="must not hold groups or instances"):
        loaded(tmp_path, body + '<shape type="instance"><ref id="a"/></shape>')


def test_parameters_are_for_xml() -> None:
    with pytest.raises(wrt.InputError, match="parameters are only for Mitsuba scenes"):
        wrt.load("cornell-box", parameters={"a": 1})


LEFT_OUT = {
    '<shape type="sphere"><bsdf type="hair"/></shape>': "bsdf 'hair'",
    '<shape type="sphere"><bsdf type="diffuse"><float name="reflectence" value="1"/></bsdf></shape>': "did you mean",
    '<emitter type="beam"/><shape type="sphere"/>': "emitter 'beam'",
    '<sensor type="fluencemeter"/><shape type="sphere"/>': "sensor 'fluencemeter'",
    '<integrator type="ptracer"/><shape type="sphere"/>': "'path' stands in",
    '<integrator type="path"><boolean name="hide_emitters" value="true"/></integrator>'
    '<shape type="sphere"><emitter type="area"/></shape>': "hide",
    '<sensor type="perspective"><film type="hdrfilm"><rfilter type="lanczos"/></film></sensor><shape type="sphere"/>': (
        "'blackman-harris' stands in"
    ),
    '<shape type="sphere"><bsdf type="diffuse"><rgb name="reflectance" value="2"/></bsdf></shape>': "clipped to 1",
    '<shape type="sphere"><bsdf type="diffuse"><texture type="noise" name="reflectance"/></bsdf></shape>': "'noise'",
    '<emitter type="sunsky"><boolean name="complex_sun" value="true"/></emitter><shape type="sphere"/>': "limb",
    '<emitter type="sunsky"><float name="hour" value="23"/></emitter><shape type="sphere"/>': "below the horizon",
    '<emitter type="sky"/><shape type="sphere"/>': "taken as a 'sunsky'",
}


@pytest.mark.parametrize("body", LEFT_OUT)
def test_what_is_left_out_is_told(body: str, tmp_path: Path) -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert loaded(tmp_path, body).shapes
    messages = [str(each.message) for each in caught]
    assert all(issubclass(each.category, InputWarning) for each in caught)
    assert any(LEFT_OUT[body] in message for message in messages), messages
    assert len(set(messages)) == len(messages)
    assert all(": line " in message and "\n" not in message for message in messages)
    with pytest.raises(wrt.InputError, match=re.escape(messages[0])):
        loaded(tmp_path, body, strict=True)


# --- What fills the space around bodies -----------------------------------------------------------

HAZE = '<rgb name="sigma_t" value="0.9, 0.7, 0.5"/><rgb name="albedo" value="0.5"/>'
SMOKE = '<rgb name="sigma_t" value="0.3"/><rgb name="albedo" value="0.5"/>'
CAMERA = '<transform name="to_world"><lookat origin="0, 0, {z}" target="0, 0, -9" up="0, 1, 0"/></transform>'


def body(radius: float, *media: tuple[str, str]) -> str:
    inner = "".join(f'<medium type="homogeneous" name="{name}">{text}</medium>' for name, text in media)
    return f'<shape type="sphere"><float name="radius" value="{radius}"/><bsdf type="null"/>{inner}</shape>'


def sensor(z: float, medium: str = "") -> str:
    inside = f'<medium type="homogeneous">{medium}</medium>' if medium else ""
    return f'<sensor type="perspective">{CAMERA.format(z=z)}{inside}</sensor>'


NESTED = [body(0.5, ("exterior", HAZE), ("interior", SMOKE)), body(1.0, ("interior", HAZE))]


@pytest.mark.parametrize(
    ("parts", "around"),
    [
        (NESTED, None),
        (NESTED[::-1], None),
        ([*NESTED, sensor(5.0)], None),
        ([*NESTED, sensor(5.0, SMOKE)], SMOKE),
        ([*NESTED, sensor(5.0, HAZE)], HAZE),  # the same haze inside and outside
        ([*NESTED, sensor(0.75, HAZE)], None),  # the camera is in the haze of the larger body
        ([*NESTED, sensor(0.25, SMOKE)], None),  # and in the smaller one
        ([*NESTED, body(0.2, ("exterior", SMOKE))], None),
        ([body(0.5, ("exterior", HAZE), ("interior", SMOKE))], HAZE),  # of no shape's inside
        ([body(0.5, ("exterior", SMOKE)), body(1.0, ("interior", HAZE), ("exterior", SMOKE))], SMOKE),
        ([sensor(0.75, HAZE), body(1.0, ("interior", HAZE), ("exterior", SMOKE))], SMOKE),
    ],
)
def test_the_space_around_has_the_medium_that_is_in_no_body(parts: list[str], around: str, tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = loaded(tmp_path, "".join(parts) + BALL)
    expected = {None: None, HAZE: wrt.Medium((0.45, 0.35, 0.25), (0.45, 0.35, 0.25)), SMOKE: wrt.Medium(0.15, 0.15)}
    assert scene.medium == expected[around]


def test_a_second_medium_around_is_told(tmp_path: Path) -> None:
    shapes = body(0.5, ("exterior", HAZE)) + body(1.0, ("exterior", SMOKE))
    with pytest.warns(InputWarning, match=r"line 2: shape 'sphere': its 'exterior' is left out: another medium fills"):
        assert loaded(tmp_path, shapes + BALL).medium == wrt.Medium((0.45, 0.35, 0.25), (0.45, 0.35, 0.25))


@pytest.mark.slow
def test_naming_what_is_around_an_inner_body_changes_no_bit(tmp_path: Path, device: str) -> None:
    glass = '<shape type="sphere"><float name="radius" value="0.4"/><bsdf type="dielectric"/>{}</shape>'
    haze = '<medium type="homogeneous" name="{}">' + HAZE + "</medium>"
    rest = body(1.0, ("interior", HAZE)) + sensor(5.0) + '<emitter type="constant"/>'
    named, plain = (
        wrt.render(loaded(tmp_path, glass.format(text) + rest), width=16, height=12, spp=4, device=device)
        for text in (haze.format("exterior"), "")
    )
    assert plain.mean() > 0.5
    np.testing.assert_array_equal(named, plain)
