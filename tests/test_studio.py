"""A bare mesh is shown from where a person asks, lit from the camera's side, of the material that they name."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.meshes import gltf_box, write

import wrt
from wrt.cli import main
from wrt.scene.materials import MATERIALS
from wrt.scene.materials.named import LOOKS, named_material
from wrt.studio.presentation import present
from wrt.studio.subjects import share_of_picture, subjects
from wrt.studio.views import VIEWS, view_angles, view_direction

SMALL = {"width": 32, "height": 24}
BLOCK = wrt.box((-0.5, 0.0, -0.2), (0.5, 0.7, 0.2))


def on_film(camera: wrt.Camera, points: np.ndarray, aspect: float) -> np.ndarray:
    """Return (N, 2) places of points in the picture, from -1 to 1."""
    assert isinstance(camera, wrt.PerspectiveCamera)
    right, up, forward = camera.frame()
    offset = points - np.asarray(camera.origin)
    half = math.tan(math.radians(camera.fov_degrees) / 2.0)
    return np.stack([offset @ right / aspect, offset @ up], axis=1) / (offset @ forward * half)[:, None]


# --- Views ----------------------------------------------------------------------------------------


def test_views_are_angles_or_names() -> None:
    assert view_angles("30,-20") == view_angles((30, -20)) == (30.0, -20.0)
    assert view_angles(" Right ") == (90.0, 0.0)
    np.testing.assert_allclose(view_direction("front")[0], (0, 0, 1), atol=1e-15)
    np.testing.assert_allclose(view_direction("right")[0], (1, 0, 0), atol=1e-15)
    np.testing.assert_allclose(view_direction((45, 30))[0], (math.sqrt(0.375), 0.5, math.sqrt(0.375)))
    for name in VIEWS:
        toward, up = view_direction(name)
        wrt.PerspectiveCamera(toward, (0.0, 0.0, 0.0), up)  # refuses an up direction along the view
    # Seen from above, the front is at the lower edge of the picture.
    np.testing.assert_allclose(view_direction("top")[1], (0, 0, -1), atol=1e-15)
    np.testing.assert_allclose(view_direction((90, 90))[1], (-1, 0, 0), atol=1e-15)


@pytest.mark.parametrize("wrong", ["frnt", "30", "a,b", "0,91", "1,2,3", "nan,0", 7, (1.0,), None])
def test_other_views_are_refused(wrong: Any) -> None:
    with pytest.raises(wrt.InputError, match="view") as caught:
        view_angles(wrong)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("aspect", [0.5, 2.0])
@pytest.mark.parametrize("view", [*VIEWS, (200.0, 45.0)])
def test_every_view_and_shape_of_picture_shows_the_whole_mesh(view: Any, aspect: float) -> None:
    scene = wrt.load(BLOCK, view=view, aspect=aspect)
    assert scene.camera is not None
    places = on_film(scene.camera, np.asarray(BLOCK.vertices, np.float64), aspect)
    assert 0.6 < np.abs(places).max() < 0.95
    toward = np.subtract(scene.camera.origin, scene.camera.target)
    expected = np.array(view_direction(view)[0])
    np.testing.assert_allclose(toward / np.linalg.norm(toward), expected / np.linalg.norm(expected), atol=1e-6)


def test_the_studio_turns_with_the_camera() -> None:
    azimuth, elevation = VIEWS["three-quarter"]
    quarter = np.eye(4)
    quarter[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]  # +z, the front, comes to +x
    here = wrt.load(BLOCK)
    there = wrt.load(BLOCK.transformed(quarter), view=(azimuth + 90.0, elevation))
    for one, other in zip(here.shapes, there.shapes, strict=True):
        np.testing.assert_allclose(one.mesh.transformed(quarter).vertices, other.mesh.vertices, atol=2e-5)
    lit = [np.cross(*np.diff(scene.shapes[-1].mesh.vertices[:3], axis=0)) for scene in (here, there)]
    np.testing.assert_allclose(quarter[:3, :3] @ lit[0], lit[1], atol=1e-5)  # the lamp faces the mesh in both
    assert here.camera is not None
    assert there.camera is not None
    np.testing.assert_allclose(quarter[:3, :3] @ here.camera.origin, there.camera.origin, atol=1e-5)
    assert here.shapes[1].mesh.normals is not None
    turned = here.shapes[1].mesh.normals @ quarter[:3, :3].T
    np.testing.assert_allclose(turned, there.shapes[1].mesh.normals, atol=1e-6)


def test_from_below_there_is_no_floor_in_the_way() -> None:
    names = {shape.name for shape in wrt.load(BLOCK, view="bottom").shapes}
    assert names == {BLOCK.name, "key light"}
    lamp = next(shape for shape in wrt.load(BLOCK, view=(0, -10)).shapes if shape.emits)
    assert lamp.mesh.vertices[:, 1].max() < 0.0


# --- A file's camera ------------------------------------------------------------------------------


def with_camera(folder: Path, distance: float) -> Path:
    """Write a triangle of side 1 and a camera in front of its corner."""
    tree = gltf_box(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4"), np.array([[0, 1, 2]]))
    tree["nodes"] = [{"mesh": 0}, {"camera": 0, "translation": [0.5, 0.5, distance]}]
    tree["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}]
    return Path(write(folder, "seen.gltf", json.dumps(tree)))


def test_a_camera_that_shows_the_mesh_small_is_replaced_with_a_note(tmp_path: Path) -> None:
    near, far = (0.5, 0.5, 2.0), (0.5, 0.5, 6.0)
    path = with_camera(tmp_path, 2.0)
    kept = wrt.load(path)
    assert kept.camera is not None
    assert kept.camera.origin == near
    # Straight from the front: the studio is turned there.
    lamp = next(shape for shape in kept.shapes if shape.emits)
    assert abs(np.degrees(np.arctan2(*(lamp.mesh.vertices.mean(axis=0) - (0.5, 0.5, 0.0))[[0, 2]])) + 67.4) < 2.0
    path = with_camera(tmp_path, 6.0)
    with pytest.warns(UserWarning, match=r"seen\.gltf: its camera shows the mesh at 23% .* --no-frame"):
        framed = wrt.load(path)
    assert framed.camera is not None
    assert framed.camera.origin != far
    same = wrt.load(path, frame=False).camera
    assert same is not None
    assert same.origin == far
    assert wrt.load(path, frame=True).camera == framed.camera == wrt.load(path, view="three-quarter").camera
    with pytest.raises(wrt.InputError, match="cannot be kept"):
        wrt.load(path, frame=False, view="front")


def test_the_share_of_a_picture() -> None:
    square = np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 0.0]])
    half = math.tan(math.radians(20.0))
    camera = wrt.PerspectiveCamera((0, 0, 5), (0, 0, 0), fov_degrees=40.0)
    assert share_of_picture(camera, square, 2.0) == pytest.approx(1.0 / (5.0 * half))
    assert share_of_picture(camera, square + (0.0, 5.0 * half, 0.0), 2.0) == pytest.approx(0.5 / (5.0 * half))
    assert share_of_picture(camera, square + (0.0, 9.0, 0.0), 2.0) == 0.0
    assert share_of_picture(camera, square + (0.0, 0.0, 9.0), 2.0) == 0.0  # behind the camera
    assert share_of_picture(camera, np.array([[0.0, 0, -5], [0, 0, 9]]), 2.0) == 1.0  # all around it
    flat = wrt.OrthographicCamera((0, 0, 5), (0, 0, 0), view_height=8.0)
    assert share_of_picture(flat, square, 2.0) == pytest.approx(0.25)
    assert share_of_picture(wrt.PanoramaCamera(), square, 2.0) == 1.0


def test_framing_a_scene_leaves_out_floors_lamps_and_what_its_camera_does_not_see() -> None:
    still = wrt.load("still-life")
    names = {shape.name for shape in subjects(still.shapes, still.camera)}
    assert not names & {"backdrop", "window", "bounce card"}
    assert {"teapot", "blue cube"} < names
    framed = wrt.load("still-life", frame=True)
    assert framed.shapes == still.shapes or [s.name for s in framed.shapes] == [s.name for s in still.shapes]
    assert framed.camera is not None
    assert still.camera is not None
    np.testing.assert_allclose(framed.camera.frame(), still.camera.frame(), atol=1e-9)  # without a view, its direction
    aspect = still.settings.width / still.settings.height
    for shape in subjects(still.shapes, still.camera):
        places = on_film(framed.camera, np.asarray(shape.outline, np.float64), aspect)
        assert np.abs(places).max() < 1.0
    box = wrt.load("cornell-box")
    assert {shape.name for shape in subjects(box.shapes, box.camera)} == {s.name for s in box.shapes} - {"light"}
    above = wrt.load(box, view="top")
    assert above is not box  # and the given scene is as before
    assert above.camera != box.camera == wrt.load("cornell-box").camera


# --- Material -------------------------------------------------------------------------------------


def test_materials_by_name() -> None:
    assert named_material("gold") == named_material("Au") == wrt.RoughConductor(metal="gold", alpha=0.15)
    assert named_material("stainless steel") == named_material("stainless-steel")
    assert named_material("gold:alpha=0.4") == wrt.RoughConductor(metal="gold", alpha=0.4)
    assert named_material("gold:f0=0.9,0.5,0.1") == wrt.RoughConductor(f0=(0.9, 0.5, 0.1), alpha=0.15)
    assert named_material("diffuse:0.8,0.2,0.1") == wrt.Diffuse((0.8, 0.2, 0.1))
    assert named_material("plastic: reflectance=0.2 ; nonlinear=true") == wrt.Plastic(0.2, nonlinear=True)
    assert named_material("principled:0.5;metallic=1") == wrt.Principled(base_color=0.5, metallic=1)
    assert named_material("glass") == wrt.Dielectric(ior="glass")
    for name in (*LOOKS, *MATERIALS):
        if name != "measured":  # which needs a file
            assert isinstance(named_material(name), wrt.Material)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ("glod", "did you mean 'gold'"),
        ("diffuse:reflectence=1", "did you mean 'reflectance'"),
        ("diffuse:2", "reflectance"),
        ("gold:metal=cheese", "cheese"),
        ("measured", "needs a measurement"),
        ("measured:opacity=0.5", "needs a measurement"),
        ("glass:interior=milk", "no parameter 'interior'"),
        ("gold:alpha=1;alpha=2", "given twice"),
        ("", "no material"),
        ("thin-dielectric:ior=a", "'a' is not a known dielectric"),
    ],
)
def test_other_materials_are_refused(wrong: str, said: str) -> None:
    with pytest.raises(wrt.InputError, match=said) as caught:
        named_material(wrong)
    assert "\n" not in str(caught.value)


def test_a_material_replaces_that_of_the_mesh_alone() -> None:
    plain, scene = wrt.load(BLOCK), wrt.load(BLOCK, material="gold")
    assert scene.shapes[0].material == named_material("gold")
    assert [shape.material for shape in scene.shapes[1:]] == [shape.material for shape in plain.shapes[1:]]
    with pytest.raises(wrt.InputError, match=r"cornell-box\.toml: a material is for meshes"):
        wrt.load("cornell-box", material="gold")
    with pytest.raises(wrt.InputError, match="material must be"):
        wrt.load(BLOCK, material=3)  # type: ignore[arg-type]


# --- Environment ----------------------------------------------------------------------------------


def test_an_environment_takes_the_place_of_the_studio(tmp_path: Path) -> None:
    path = tmp_path / "sky.exr"
    wrt.save_image(path, np.full((4, 8, 3), 0.5))
    scene = wrt.load(BLOCK, environment=path)
    assert isinstance(scene.environment, wrt.ImageEnvironment)
    assert [shape.name for shape in scene.shapes] == [BLOCK.name, "ground"]
    assert not any(shape.emits for shape in scene.shapes)
    lit = wrt.load("cornell-box", environment=wrt.ConstantEnvironment(2.0))
    assert lit.environment == wrt.ConstantEnvironment(2.0)
    sky = wrt.load(BLOCK, view="back", environment="sky").environment
    assert isinstance(sky, wrt.SunSkyEnvironment)
    assert sky.sun_direction is not None
    assert sky.sun_direction[2] < -0.2  # on the camera's side
    with pytest.raises(wrt.InputError, match=r"none\.hdr"):
        wrt.load(BLOCK, environment="none.hdr")
    with pytest.raises(wrt.InputError, match="environment must be"):
        wrt.load(BLOCK, environment=1.0)  # type: ignore[arg-type]


def test_a_studio_under_a_constant_environment_has_its_closed_form(device: str) -> None:
    image = wrt.render(
        BLOCK, material=wrt.Diffuse(0.5), environment=wrt.ConstantEnvironment(0.8), transparent=True, spp=4,
        device=device, **SMALL,
    )  # fmt: skip
    assert image.shape == (24, 32, 4)
    alpha = image[:, :, 3]
    assert set(np.unique(alpha[[0, -1]])) == {0.0}
    assert alpha[12, 16] == 1.0
    # Every path leaves a convex body after one reflection, so each covered sample has exactly this radiance.
    np.testing.assert_allclose(image[:, :, :3], 0.4 * alpha[:, :, None] * np.ones(3), atol=1e-5)


# --- The command line -----------------------------------------------------------------------------

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0.5 1 0\nf 1 2 3\n"


def test_the_options_reach_the_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from PIL import Image

    monkeypatch.chdir(tmp_path)
    Path("a.obj").write_text(TRIANGLE)
    common = ["render", "a.obj", "--size", "24x18", "--spp", "1", "--quiet"]
    assert main([*common, "--view", "-90,20", "-o", "left.png"]) == 0
    assert main([*common, "--view", "front", "--material", "diffuse:0.8,0.1,0.1", "--transparent"]) == 0
    with Image.open("a.png") as picture:
        assert picture.mode == "RGBA"
        codes = np.asarray(picture)
    assert {0, 255} <= set(codes[:, :, 3].ravel().tolist())
    assert (codes[codes[:, :, 3] == 255][:, 0] > 2.0 * codes[codes[:, :, 3] == 255][:, 1]).all()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["a.obj", "--view", "sideways"], "view must be"),
        (["a.obj", "--material", "cheese"], "no material 'cheese'"),
        (["a.obj", "--environment", "none.hdr"], "none.hdr"),
        (["a.obj", "--environment", "a.obj"], "a.obj"),
        (["cornell-box", "--material", "gold"], "a material is for meshes"),
        (["a.obj", "--no-frame", "--view", "front"], "cannot be kept"),
    ],
)
def test_mistakes_are_told_in_one_line(
    arguments: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.obj").write_text(TRIANGLE)
    assert main(["render", *arguments]) in (1, 2)
    error = capfd.readouterr().err
    assert said in error
    assert "Traceback" not in error
    assert not list(tmp_path.glob("*.png"))


# --- The ground -----------------------------------------------------------------------------------


def lid(height: float, *, up: bool = True) -> wrt.Mesh:
    """A square at a height that faces up or down."""
    return wrt.quad((-1, height, 1), (2, 0, 0), (0, 0, -2)) if up else wrt.quad((-1, height, -1), (2, 0, 0), (0, 0, 2))


@pytest.mark.parametrize(
    ("parts", "below"),
    [
        pytest.param([BLOCK], False, id="a closed block hides its bottom"),
        pytest.param([BLOCK, lid(0.0)], True, id="a road at the height of a kerb's bottom"),
        pytest.param([BLOCK, lid(0.1)], False, id="a table"),
        pytest.param([lid(0.0, up=False)], True, id="a sheet that faces down, seen from its back"),
        pytest.param([lid(0.0, up=False), lid(0.5)], False, id="a bottom under a lid"),
    ],
)
def test_the_ground_is_below_what_lies_flat_and_is_seen(parts: list[wrt.Mesh], below: bool) -> None:
    shapes = [wrt.Shape(part) for part in parts]
    quarter = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # +y, up, comes to +z
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    for scene in (
        present(shapes),
        present([shape.moved(quarter) for shape in shapes], up="z"),
        present([wrt.Shape(part, transform=mirror) for part in parts]),
        present(shapes, environment=wrt.ConstantEnvironment(1.0)),
    ):
        ground = next(shape for shape in scene.shapes if shape.name == "ground").bounds[0][1]
        size = np.linalg.norm(np.ptp(np.concatenate([part.vertices for part in parts]), axis=0))
        assert -2e-4 * size < ground < -5e-5 * size if below else abs(ground) < 1e-7
