"""A bare mesh is shown from where a person asks, lit from the camera's side, of the material that they name."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

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


def test_views_are_angles_or_names() -> None:
    assert view_angles("30,-20") == view_angles((30, -20)) == (30.0, -20.0)
    assert view_angles(" Right ") == (90.0, 0.0)
    for view, toward in (("front", (0, 0, 1)), ("right", (1, 0, 0)), ((45, 30), (0.375**0.5, 0.5, 0.375**0.5))):
        np.testing.assert_allclose(view_direction(view)[0], toward, atol=1e-15)
    # Seen from above, the front is at the lower edge of the picture.
    np.testing.assert_allclose(view_direction("top")[1], (0, 0, -1), atol=1e-15)
    np.testing.assert_allclose(view_direction((90, 90))[1], (-1, 0, 0), atol=1e-15)
    for wrong in ("frnt", "30", "a,b", "0,91", "1,2,3", "nan,0", 7, (1.0,), None):
        with pytest.raises(wrt.InputError, match=r"view[^\n]*$"):
            view_angles(wrong)


@pytest.mark.parametrize("aspect", [0.5, 2.0])
@pytest.mark.parametrize("view", [*VIEWS, (200.0, 45.0)])
def test_every_view_and_shape_of_picture_shows_the_whole_mesh(view: Any, aspect: float) -> None:
    camera = wrt.load(BLOCK, view=view, aspect=aspect).camera
    assert 0.6 < np.abs(on_film(camera, BLOCK.vertices, aspect)).max() < 0.95
    toward = np.subtract(camera.origin, camera.target)
    expected = np.array(view_direction(view)[0])
    np.testing.assert_allclose(toward / np.linalg.norm(toward), expected / np.linalg.norm(expected), atol=1e-6)


@pytest.mark.parametrize("aspect", [0.5, 16.0 / 9.0])
@pytest.mark.parametrize(
    "points",
    [
        wrt.sphere(subdivisions=2).vertices,
        wrt.box((-0.1, 0.0, -0.1), (0.1, 3.0, 0.1)).vertices,
        wrt.box((-3.0, 0.0, -0.1), (3.0, 0.2, 0.1)).vertices,
        wrt.sphere((1e3, 2e3, -5e2), 3.0, subdivisions=2).vertices,
        wrt.quad((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)).vertices,
    ],
    ids=["ball", "tall", "wide", "far away", "flat"],
)
def test_everything_just_fits(points: np.ndarray, aspect: float) -> None:
    places = on_film(frame_camera(points.astype(np.float64), aspect, margin=1.0), points, aspect)
    assert np.abs(places).max() <= 1.0 + 1e-6
    # The picture's frame is touched on both sides along one axis.
    assert any(v.max() > 0.999 and v.min() < -0.999 for v in places.T)


def test_one_point_is_framed_as_if_it_had_a_size() -> None:
    camera = frame_camera(np.zeros((1, 3)), 1.0)
    assert np.isfinite(camera.origin).all()
    assert camera.distance_in_focus > 0.5


def test_the_studio_turns_with_the_camera() -> None:
    azimuth, elevation = VIEWS["three-quarter"]
    turn = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # +z, the front, comes to +x
    quarter = np.eye(4)
    quarter[:3, :3] = turn
    here, there = wrt.load(BLOCK), wrt.load(BLOCK.transformed(quarter), view=(azimuth + 90.0, elevation))
    for one, other in zip(here.shapes, there.shapes, strict=True):
        np.testing.assert_allclose(one.mesh.transformed(quarter).vertices, other.mesh.vertices, atol=2e-5)
    lit = [np.cross(*np.diff(lamp_of(scene).vertices[:3], axis=0)) for scene in (here, there)]
    np.testing.assert_allclose(turn @ lit[0], lit[1], atol=1e-5)  # the lamp faces the mesh in both
    np.testing.assert_allclose(turn @ here.camera.origin, there.camera.origin, atol=1e-5)
    np.testing.assert_allclose(here.shapes[1].mesh.normals @ turn.T, there.shapes[1].mesh.normals, atol=1e-6)


def test_from_below_there_is_no_floor_in_the_way() -> None:
    assert {shape.name for shape in wrt.load(BLOCK, view="bottom").shapes} == {BLOCK.name, "key light"}
    assert lamp_of(wrt.load(BLOCK, view=(0, -10))).vertices[:, 1].max() < 0.0


def test_a_camera_that_shows_the_mesh_small_is_replaced_with_a_note(tmp_path: Path) -> None:
    tree = gltf_box(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    tree["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}]
    tree["nodes"].append({"camera": 0, "translation": [0.5, 0.5, 2.0]})
    kept = wrt.load(saved(tmp_path, tree))
    assert kept.camera.origin == (0.5, 0.5, 2.0)
    # Straight from the front: the studio is turned there.
    lamp = lamp_of(kept).vertices.mean(axis=0) - (0.5, 0.5, 0.0)
    assert abs(np.degrees(np.arctan2(lamp[0], lamp[2])) + 67.4) < 2.0
    tree["nodes"][1]["translation"] = [0.5, 0.5, 6.0]
    path = saved(tmp_path, tree)
    with pytest.warns(UserWarning, match=r"a\.gltf: its camera shows the mesh at 23% .* --no-frame"):
        framed = wrt.load(path)
    assert wrt.load(path, frame=False).camera.origin == (0.5, 0.5, 6.0) != framed.camera.origin
    assert wrt.load(path, frame=True).camera == framed.camera == wrt.load(path, view="three-quarter").camera
    with pytest.raises(wrt.InputError, match="cannot be kept"):
        wrt.load(path, frame=False, view="front")


def test_framing_a_scene_leaves_out_floors_lamps_and_what_its_camera_does_not_see() -> None:
    still = wrt.load("still-life")
    seen = subjects(still.shapes, still.camera)
    names = {shape.name for shape in seen}
    assert not names & {"backdrop", "window", "bounce card"}
    assert {"teapot", "blue cube"} < names
    framed = wrt.load("still-life", frame=True)
    assert [shape.name for shape in framed.shapes] == [shape.name for shape in still.shapes]
    np.testing.assert_allclose(framed.camera.frame(), still.camera.frame(), atol=1e-9)  # without a view, its direction
    for shape in seen:
        aspect = still.settings.width / still.settings.height
        assert np.abs(on_film(framed.camera, shape.outline, aspect)).max() < 1.0
    box = wrt.load("cornell-box")
    assert {shape.name for shape in subjects(box.shapes, box.camera)} == {s.name for s in box.shapes} - {"light"}
    # The given scene is as before.
    assert wrt.load(box, view="top").camera != box.camera == wrt.load("cornell-box").camera


def test_materials_by_name() -> None:
    gold = wrt.RoughConductor(metal="gold", alpha=0.15)
    for name, expected in (
        ("gold", gold),
        ("Au", gold),
        ("stainless steel", named_material("stainless-steel")),
        ("gold:alpha=0.4", wrt.RoughConductor(metal="gold", alpha=0.4)),
        ("gold:f0=0.9,0.5,0.1", wrt.RoughConductor(f0=(0.9, 0.5, 0.1), alpha=0.15)),
        ("diffuse:0.8,0.2,0.1", wrt.Diffuse((0.8, 0.2, 0.1))),
        ("plastic: reflectance=0.2 ; nonlinear=true", wrt.Plastic(0.2, nonlinear=True)),
        ("principled:0.5;metallic=1", wrt.Principled(base_color=0.5, metallic=1)),
        ("glass", wrt.Dielectric(ior="glass")),
    ):
        assert named_material(name) == expected
    for name in {*LOOKS, *MATERIALS} - {"measured"}:  # which needs a file
        assert isinstance(named_material(name), wrt.Material)
    plain, scene = wrt.load(BLOCK), wrt.load(BLOCK, material="gold")
    assert [shape.material for shape in scene.shapes] == [gold, *(shape.material for shape in plain.shapes[1:])]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ("glod", "did you mean 'gold'"),
        ("diffuse:reflectence=1", "did you mean 'reflectance'"),
        ("diffuse:2", "reflectance"),
        ("gold:metal=cheese", "cheese"),
        ("measured:opacity=0.5", "needs a measurement"),
        ("glass:interior=milk", "no parameter 'interior'"),
        ("gold:alpha=1;alpha=2", "given twice"),
        ("", "no material"),
        ("thin-dielectric:ior=a", "'a' is not a known dielectric"),
        (3, "material must be"),
    ],
)
def test_other_materials_are_refused(wrong: Any, said: str) -> None:
    with pytest.raises(wrt.InputError, match=rf"{said}[^\n]*$"):
        wrt.load(BLOCK, material=wrong)


def test_an_environment_takes_the_place_of_the_studio(tmp_path: Path) -> None:
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
    for wrong, said in (
        (1.0, "environment must be"),
        ("none.hdr", "none.hdr"),
        (write(tmp_path, "a.obj", ""), "a.obj"),
    ):
        with pytest.raises(wrt.InputError, match=said):
            wrt.load(BLOCK, environment=wrong)


@pytest.mark.slow
def test_a_studio_under_a_constant_environment_has_its_closed_form(device: str) -> None:
    options = {"material": wrt.Diffuse(0.5), "environment": wrt.ConstantEnvironment(0.8), "transparent": True}
    image = wrt.render(BLOCK, **options, spp=4, device=device, width=32, height=24)
    alpha = image[:, :, 3]
    assert set(np.unique(alpha[[0, -1]])) == {0.0}
    assert alpha[12, 16] == 1.0
    # Every path leaves a convex body after one reflection, so each covered sample has exactly this radiance.
    np.testing.assert_allclose(image[:, :, :3], 0.4 * alpha[:, :, None] * np.ones(3), atol=1e-5)


def test_the_options_reach_the_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: Any) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path, "a.obj", "v 0 0 0\nv 1 0 0\nv 0.5 1 0\nf 1 2 3\n")
    options = ["--view", "front", "--material", "diffuse:0.8,0.1,0.1", "--transparent"]
    assert main(["render", "a.obj", "--size", "24x18", "--spp", "1", "--quiet", *options]) == 0
    with Image.open("a.png") as picture:
        red, green, _, alpha = np.asarray(picture, np.float64).reshape(-1, 4).T
    assert {0, 255} <= set(alpha.tolist())
    assert (red[alpha == 255] > 2.0 * green[alpha == 255]).all()
    assert main(["render", "a.obj", "--view", "front", "--no-frame"]) == 2
    assert main(["render", "cornell-box", "--material", "gold"]) == 2
    error = capfd.readouterr().err
    assert "cannot be kept" in error
    assert "cornell-box.toml: a material is for meshes" in error


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
    size = np.linalg.norm(np.ptp(np.concatenate([part.vertices for part in parts]), axis=0))
    for scene in (
        present(shapes),
        present([shape.moved(quarter) for shape in shapes], up="z"),
        present([wrt.Shape(part, transform=np.diag([-1.0, 1.0, 1.0, 1.0])) for part in parts]),
        present(shapes, environment=HAZE),
    ):
        ground = next(shape for shape in scene.shapes if shape.name == "ground").bounds[0][1]
        assert -2e-4 * size < ground < -5e-5 * size if below else abs(ground) < 1e-7
