"""A bare mesh is shown from where a person asks, lit from the camera's side, of the material that they name."""

import math

import numpy as np
import pytest
from PIL import Image
from support.mesh_files import saved
from support.meshes import gltf_box, write

import wrt
from wrt.cli import main
from wrt.scene.materials import MATERIALS
from wrt.scene.materials.named import LOOKS, named_material
from wrt.studio.framing import frame_camera
from wrt.studio.presentation import present
from wrt.studio.subjects import subjects
from wrt.studio.views import VIEWS, view_angles, view_direction

BLOCK = wrt.box((-0.5, 0.0, -0.2), (0.5, 0.7, 0.2))
HAZE = wrt.ConstantEnvironment(2.0)


def on_film(camera: wrt.PerspectiveCamera, points: np.ndarray, aspect: float) -> np.ndarray:
    """Return (N, 2) places of points in the picture, from -1 to 1."""
    right, up, forward = camera.frame()
    offset = np.asarray(points, np.float64) - np.asarray(camera.origin)
    assert (offset @ forward > 0.0).all()
    half = math.tan(math.radians(camera.fov_degrees) / 2.0)
    return np.stack([offset @ right / aspect, offset @ up], axis=1) / (offset @ forward * half)[:, None]


def lamp_of(scene: wrt.Scene) -> wrt.Mesh:
    return next(shape.mesh for shape in scene.shapes if shape.emits)


def test_views_are_angles_or_names():
    assert view_angles("30,-20") == view_angles((30, -20)) == (30.0, -20.0)
    for view, toward in (("front", (0, 0, 1)), ("right", (1, 0, 0)), ((45, 30), (0.375**0.5, 0.5, 0.375**0.5))):
        np.testing.assert_allclose(view_direction(view)[0], toward, atol=1e-15)
    # Seen from above, the front is at the lower edge of the picture.
    np.testing.assert_allclose(view_direction("top")[1], (0, 0, -1), atol=1e-15)
    np.testing.assert_allclose(view_direction((90, 90))[1], (-1, 0, 0), atol=1e-15)
    for wrong in ("frnt", "30", "0,91", "nan,0", 7):
        with pytest.raises(wrt.InputError, match=r"view[^\n]*$"):
            view_angles(wrong)


@pytest.mark.parametrize("aspect", [0.5, 2.0])
@pytest.mark.parametrize("view", [*VIEWS, (200.0, 45.0)])
def test_every_view_and_shape_of_picture_shows_the_whole_mesh(view, aspect):
    camera = wrt.load(BLOCK, view=view, aspect=aspect).camera
    assert 0.6 < np.abs(on_film(camera, BLOCK.vertices, aspect)).max() < 0.95
    toward = np.subtract(camera.origin, camera.target)
    expected = np.array(view_direction(view)[0])
    np.testing.assert_allclose(toward / np.linalg.norm(toward), expected / np.linalg.norm(expected), atol=1e-6)


@pytest.mark.parametrize("aspect", [0.5, 16.0 / 9.0])
def test_everything_just_fits(aspect):
    tall, flat = wrt.box((-0.1, 0.0, -0.1), (0.1, 3.0, 0.1)), wrt.quad((0, 0, 0), (1, 0, 0), (0, 0, -1))
    for mesh in (tall, flat, wrt.sphere((1e3, 2e3, -5e2), 3.0, subdivisions=2)):
        points = mesh.vertices.astype(np.float64)
        places = on_film(frame_camera(points, aspect, margin=1.0), points, aspect)
        assert np.abs(places).max() <= 1.0 + 1e-6
        # The picture's frame is touched on both sides along one axis.
        assert any(v.max() > 0.999 and v.min() < -0.999 for v in places.T)


def test_the_studio_turns_with_the_camera_and_has_no_floor_in_its_way():
    azimuth, elevation = VIEWS["three-quarter"]
    quarter = np.eye(4)
    quarter[:3, :3] = [[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]  # +z, the front, comes to +x
    first, turned = wrt.load(BLOCK), wrt.load(BLOCK.transformed(quarter), view=(azimuth + 90.0, elevation))
    for shape, copy in zip(first.shapes, turned.shapes, strict=True):
        np.testing.assert_allclose(shape.mesh.transformed(quarter).vertices, copy.mesh.vertices, atol=2e-5)
        np.testing.assert_array_equal(shape.mesh.faces, copy.mesh.faces)  # the lamp faces the mesh in both
    np.testing.assert_allclose(quarter[:3, :3] @ first.camera.origin, turned.camera.origin, atol=1e-5)
    assert {shape.name for shape in wrt.load(BLOCK, view="bottom").shapes} == {BLOCK.name, "key light"}
    assert lamp_of(wrt.load(BLOCK, view=(0, -10))).vertices[:, 1].max() < 0.0


def test_a_camera_that_shows_the_mesh_small_is_replaced_with_a_note(tmp_path):
    tree = gltf_box(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    tree["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}]
    tree["nodes"].append({"camera": 0, "translation": [0.5, 0.5, 2.0]})
    close = wrt.load(saved(tmp_path, tree))
    assert close.camera.origin == (0.5, 0.5, 2.0)
    tree["nodes"][1]["translation"] = [0.5, 0.5, 6.0]
    path = saved(tmp_path, tree)
    with pytest.warns(UserWarning, match=r"a\.gltf: its camera shows the mesh at 23% .* --no-frame"):
        framed = wrt.load(path)
    assert wrt.load(path, frame=False).camera.origin == (0.5, 0.5, 6.0) != framed.camera.origin
    assert wrt.load(path, frame=True).camera == framed.camera == wrt.load(path, view="three-quarter").camera


def test_framing_a_scene_leaves_out_floors_lamps_and_what_its_camera_does_not_see():
    scene = wrt.load("still-life")
    visible = subjects(scene.shapes, scene.camera)
    assert {"teapot", "blue cube"} < {shape.name for shape in visible}
    assert not {"backdrop", "window", "bounce card"} & {shape.name for shape in visible}
    framed = wrt.load("still-life", frame=True)
    assert len(framed.shapes) == len(scene.shapes)
    np.testing.assert_allclose(framed.camera.frame(), scene.camera.frame(), atol=1e-9)  # without a view, its direction
    aspect = scene.settings.width / scene.settings.height
    assert all(np.abs(on_film(framed.camera, shape.outline, aspect)).max() < 1.0 for shape in visible)
    box = wrt.load("cornell-box")
    assert {shape.name for shape in subjects(box.shapes, box.camera)} == {s.name for s in box.shapes} - {"light"}


def test_materials_by_name_and_what_is_none():
    gold = wrt.RoughConductor(metal="gold", alpha=0.15)
    for name, expected in (
        ("gold", gold),
        ("Au", gold),
        ("gold:f0=0.9,0.5,0.1", wrt.RoughConductor(f0=(0.9, 0.5, 0.1), alpha=0.15)),
        ("diffuse:0.8,0.2,0.1", wrt.Diffuse((0.8, 0.2, 0.1))),
        ("plastic: reflectance=0.2 ; nonlinear=true", wrt.Plastic(0.2, nonlinear=True)),
        ("principled:0.5;metallic=1", wrt.Principled(base_color=0.5, metallic=1)),
    ):
        assert named_material(name) == expected
    for name in {*LOOKS, *MATERIALS} - {"measured"}:  # which needs a file
        assert isinstance(named_material(name), wrt.Material)
    plain, scene = wrt.load(BLOCK), wrt.load(BLOCK, material="gold")
    assert [shape.material for shape in scene.shapes] == [gold, *(shape.material for shape in plain.shapes[1:])]
    for wrong, message in (
        ("glod", "did you mean 'gold'"),
        ("diffuse:2", "reflectance"),
        ("measured:opacity=0.5", "needs a measurement"),
        ("glass:interior=milk", "no parameter 'interior'"),
        (3, "material must be"),
    ):
        with pytest.raises(wrt.InputError, match=rf"{message}[^\n]*$"):
            wrt.load(BLOCK, material=wrong)


def test_an_environment_takes_the_place_of_the_studio(tmp_path):
    path = tmp_path / "sky.exr"
    wrt.save_image(path, np.full((4, 8, 3), 0.5))
    scene = wrt.load(BLOCK, environment=path)
    assert isinstance(scene.environment, wrt.ImageEnvironment)
    assert [shape.name for shape in scene.shapes] == [BLOCK.name, "ground"]
    assert not any(shape.emits for shape in scene.shapes)
    assert wrt.load("cornell-box", environment=HAZE).environment == HAZE
    sky = wrt.load(BLOCK, view="back", environment="sky").environment
    assert isinstance(sky, wrt.SunSkyEnvironment)
    assert sky.sun_direction[2] < -0.2  # on the camera's side
    for wrong, message in ((1.0, "environment must be"), ("none.hdr", "none.hdr: no such file")):
        with pytest.raises(wrt.InputError, match=message):
            wrt.load(BLOCK, environment=wrong)


def test_the_options_reach_the_picture(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    write(tmp_path, "a.obj", "v 0 0 0\nv 1 0 0\nv 0.5 1 0\nf 1 2 3\n")
    options = ["--view", "front", "--material", "diffuse:0.8,0.1,0.1", "--transparent"]
    assert main(["render", "a.obj", "--size", "24x18", "--spp", "1", "--quiet", *options]) == 0
    with Image.open("a.png") as picture:
        red, green, _, alpha = np.asarray(picture, np.float64).reshape(-1, 4).T
    assert {0, 255} <= set(alpha.tolist())
    assert (red[alpha == 255] > 2.0 * green[alpha == 255]).all()
    for arguments, message in (
        (["a.obj", "--view", "front", "--no-frame"], "cannot be kept"),
        (["cornell-box", "--material", "gold"], "cornell-box.toml: a material is for meshes"),
    ):
        assert main(["render", *arguments]) == 2
        assert message in capfd.readouterr().err


def lid(height: float, *, up: float = 1.0) -> wrt.Mesh:
    """A square at a height that faces up, or down if `up` is -1."""
    return wrt.quad((-1, height, up), (2, 0, 0), (0, 0, -2.0 * up))


@pytest.mark.parametrize(
    ("parts", "below"),
    [
        pytest.param([BLOCK], False, id="a closed block hides its bottom"),
        pytest.param([BLOCK, lid(0.0)], True, id="a road at the height of a kerb's bottom"),
        pytest.param([BLOCK, lid(0.1)], False, id="a table"),
        pytest.param([lid(0.0, up=-1.0)], True, id="a sheet that faces down, seen from its back"),
        pytest.param([lid(0.0, up=-1.0), lid(0.5)], False, id="a bottom under a lid"),
    ],
)
def test_the_ground_is_below_what_lies_flat_and_is_seen(parts, below):
    shapes = [wrt.Shape(part) for part in parts]
    quarter = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # +y, up, comes to +z
    size = np.linalg.norm(np.ptp(np.concatenate([part.vertices for part in parts]), axis=0))
    for scene in (
        present(shapes),
        present([shape.moved(quarter) for shape in shapes], up="z"),
        present(shapes, environment=HAZE),
    ):
        ground = next(shape for shape in scene.shapes if shape.name == "ground").bounds[0][1]
        assert -2e-4 * size < ground < -5e-5 * size if below else abs(ground) < 1e-7
