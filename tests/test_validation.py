"""What no ray could meet is refused before it reaches the device; what a renderer saves says how it was made."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import wrt
from wrt.errors import InputWarning
from wrt.upload.accel.geometry import device_vectors
from wrt.upload.attributes import check_attributes

CORNERS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
FACE = np.array([[0, 1, 2]])


@pytest.mark.parametrize(
    ("vertices", "message"),
    [
        (CORNERS * 1e30, "its vertices reach to 1e"),
        (CORNERS * 1e-20, "the scene is 1"),
        (CORNERS * 0.0 + 1.0, "all vertices of the scene are in one place"),
    ],
)
def test_scenes_too_large_or_too_small_for_rays_are_refused(vertices: np.ndarray, message: str) -> None:
    scene = wrt.Scene(environment=wrt.ConstantEnvironment())
    scene.add(wrt.Mesh(vertices, FACE), name="part")
    with pytest.raises(wrt.InputError, match=message):
        wrt.Renderer(scene, width=4, height=4)


def test_a_speck_in_a_room_is_no_mistake() -> None:
    scene = wrt.Scene(environment=wrt.ConstantEnvironment())
    scene.add(wrt.Mesh(CORNERS * 1e-20, FACE))
    scene.add(wrt.box())
    assert np.isfinite(wrt.render(scene, width=4, height=4, spp=1)).all()


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("environment", 0.5, "the scene's environment must be one of wrt's environments, not float"),
        ("environment", wrt.Diffuse(), "the scene's environment must be one of wrt's environments, not Diffuse"),
        ("camera", (0.0, 0.0, 1.0), "the scene's camera must be one of wrt's cameras, not tuple"),
        ("shapes", None, "shapes must be a list of wrt.Shape, not NoneType; "),
        ("shapes", [wrt.box()], "shapes must be a list of wrt.Shape, not of Mesh; "),
        ("lights", wrt.PointLight((0, 3, 0), intensity=1.0), "lights must be a list of wrt's lights, not PointLight"),
        ("lights", [3], "lights must be a list of wrt's lights, not of int"),
        ("settings", {"spp": 3}, "the scene's settings must be wrt.RenderSettings, not dict"),
        ("medium", 3, "the scene's medium must be a wrt.Medium, not int"),
    ],
)
def test_what_a_scene_cannot_have_is_refused_when_made_and_when_rendered(field: str, value: Any, message: str) -> None:
    with pytest.raises(wrt.InputError) as made:
        wrt.Scene(**{field: value})
    assert str(made.value).startswith(message)
    scene = wrt.Scene(environment=wrt.ConstantEnvironment())
    scene.add(wrt.box())
    setattr(scene, field, value)
    for use in (wrt.Renderer, wrt.load, wrt.render):
        with pytest.raises(wrt.InputError) as used:
            use(scene)
        assert str(used.value).startswith(message)


def test_misspelt_names_are_refused() -> None:
    scene = wrt.Scene()
    with pytest.raises(AttributeError, match="enviroment"):
        scene.enviroment = wrt.ConstantEnvironment()  # type: ignore[attr-defined]
    with pytest.raises(AttributeError, match="samples"):
        scene.settings.samples = 16  # type: ignore[attr-defined]


def test_arrays_that_are_no_numbers_are_refused_in_one_line() -> None:
    with pytest.raises(wrt.InputError, match=r"mesh: vertices must be an array of numbers"):
        wrt.Mesh(CORNERS.astype(complex), FACE)
    with pytest.raises(wrt.InputError, match=r"texture image: pixels must be an array of numbers"):
        wrt.ImageTexture([["a"]])  # type: ignore[arg-type]


def test_masked_values_are_not_taken_for_numbers() -> None:
    """What files of simulations hold where there is nothing, such as 9.97e36, is masked when they are read."""
    masked = np.ma.masked_equal(CORNERS, 1.0)
    with pytest.raises(wrt.InputError, match=r"^mesh: vertices must not have masked values; the first is number 1$"):
        wrt.Mesh(masked, FACE)
    with pytest.raises(wrt.InputError, match=r"^spheres: radii must not have masked values; the first is number 2$"):
        wrt.spheres(CORNERS, np.ma.masked_equal([1.0, 1.0, 0.0], 0.0))
    with pytest.raises(wrt.InputError, match=r"^x: vertices must not have masked values; the first is number 1$"):
        device_vectors("x: vertices", masked, "cpu")
    assert wrt.Mesh(np.ma.array(CORNERS), FACE).bounds[1, 0] == 1.0


def test_a_saved_picture_says_how_it_was_made(tmp_path: Path) -> None:
    import OpenEXR
    from PIL import Image

    renderer = wrt.Renderer(wrt.load("cornell-box"), width=8, height=6, seed=7, layers=("albedo", "depth"))
    for _ in renderer.passes(spp=3):
        pass
    renderer.save(tmp_path / "a.exr")
    file = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True)
    assert {"R", "G", "B", "albedo.R", "depth.Z"} <= set(file.channels())
    header = file.header()
    assert (header["Samples per pixel"], header["Seed"], header["Software"]) == ("3", "7", f"wrt {wrt.__version__}")
    assert float(header["Render seconds"]) >= 0.0
    with pytest.raises(wrt.InputError, match="layers go into OpenEXR files"):
        renderer.save(tmp_path / "a.png")
    plain = wrt.Renderer(wrt.load("cornell-box"), width=8, height=6, seed=7)
    for _ in plain.passes(spp=2):
        pass
    plain.save(tmp_path / "b.png")
    with Image.open(tmp_path / "b.png") as picture:
        assert picture.info["Samples per pixel"] == "2"


COLORED = wrt.Diffuse(wrt.VertexColor())


@pytest.mark.parametrize("material", [COLORED, wrt.Mix(wrt.Mirror(), COLORED), wrt.Diffuse(opacity=wrt.VertexColor())])
def test_vertex_colors_that_no_surface_has_are_refused(material: wrt.Material) -> None:
    for colors, said in ((np.full((3, 3), 200.0), "200 to 200"), (CORNERS - 0.5, "-0.5 to 0.5")):
        with pytest.raises(wrt.InputError, match=f"^part: vertex colors must be linear, from 0 to 1; .* from {said}$"):
            check_attributes([wrt.Shape(wrt.Mesh(CORNERS, FACE, colors=colors), material, name="part")])
    bright = wrt.Mesh(CORNERS, FACE, colors=3.0 * CORNERS)
    check_attributes([wrt.Shape(bright, emission=wrt.VertexColor()), wrt.Shape(wrt.Mesh(CORNERS, FACE), material)])
    check_attributes([wrt.Shape(bright, wrt.Diffuse(wrt.VertexColor(1.0 / 3.0)))])
    dark = wrt.Mesh(CORNERS, FACE, colors=CORNERS - 0.5)
    for emission, shining in ((wrt.VertexColor(2.0), wrt.Diffuse()), (0.0, wrt.Emissive(wrt.VertexColor(2.0)))):
        with pytest.raises(wrt.InputError, match=r"^shape: vertex colors that shine must be at least 0, not -1$"):
            check_attributes([wrt.Shape(dark, shining, emission=emission)])


def test_images_that_cannot_be_shown_as_they_are_are_named() -> None:
    half, codes = (
        wrt.ImageTexture(np.full((2, 2, 3), level), name) for level, name in ((0.5, "half"), (200.0, "wood"))
    )
    bare, laid = wrt.Mesh(CORNERS, FACE), wrt.Mesh(CORNERS, FACE, uvs=CORNERS[:, :2])
    check_attributes([wrt.Shape(laid, wrt.Diffuse(half), emission=codes)])
    with pytest.warns(InputWarning, match=r"^texture wood: as reflectance it must be at most 1, but it reaches 200$"):
        check_attributes([wrt.Shape(laid, wrt.Diffuse(codes))])
    for shape in (wrt.Shape(bare, wrt.Diffuse(half)), wrt.Shape(bare, emission=half)):
        with pytest.warns(
            InputWarning, match=r"^shape: its material has an image, but its mesh no texture coordinates"
        ):
            check_attributes([shape])
    scene = wrt.Scene([wrt.Shape(bare, wrt.Diffuse(half))], environment=wrt.ConstantEnvironment())
    with pytest.warns(InputWarning, match="no texture coordinates"):
        wrt.Renderer(scene, width=4, height=4)


def test_warnings_name_the_line_outside_of_wrt() -> None:
    scene = wrt.Scene([wrt.Shape(wrt.Mesh(CORNERS, FACE))])
    dust = trimesh.Scene([trimesh.creation.box(), trimesh.PointCloud(CORNERS)])
    for warned in (lambda: wrt.Renderer(scene, width=4, height=4), lambda: wrt.load(dust)):
        with pytest.warns(UserWarning, match="the scene has no light|is left out") as caught:
            warned()
        assert [warning.filename for warning in caught] == [__file__]


@pytest.mark.parametrize(
    ("move", "message"),
    [
        (lambda mesh: mesh.scaled((1.0, 2.0, 3.0)), "mesh: a scale must be a number, not (1.0, 2.0, 3.0)"),
        (lambda mesh: mesh.translated(3.0), "mesh: an offset must be three numbers, not 3.0"),
        (lambda mesh: mesh.translated((1.0, 2.0)), "mesh: an offset must be three numbers, not (1.0, 2.0)"),
        (lambda mesh: mesh.rotated("y", 90.0), "mesh: an axis must be three numbers, not 'y'"),
        (lambda mesh: mesh.rotated((0, 0, 0), 90.0), "mesh: an axis must have a length above 0"),
        (lambda mesh: mesh.rotated((0, 1, 0), "90"), "mesh: degrees must be a number, not '90'"),
    ],
)
def test_movements_of_meshes_that_are_none_are_refused(move: Callable[[wrt.Mesh], wrt.Mesh], message: str) -> None:
    with pytest.raises(wrt.InputError) as caught:
        move(wrt.Mesh(CORNERS, FACE))
    assert str(caught.value) == message


def test_one_time_is_no_list_of_times() -> None:
    with pytest.raises(wrt.InputError, match=r"^motion times must be one or more finite numbers$"):
        wrt.Motion(0.5, [np.eye(4)])  # type: ignore[arg-type]
    with pytest.raises(wrt.InputError, match=r"^deformation times must be one or more finite numbers$"):
        wrt.Deformation(0.5, CORNERS[None])  # type: ignore[arg-type]
    with pytest.raises(wrt.InputError, match=r"^times must be two numbers, not 0.5$"):
        wrt.Motion.rotation((0, 1, 0), 90.0, times=0.5)  # type: ignore[arg-type]
    with pytest.raises(wrt.InputError, match=r"^times must be two numbers, not 0.5$"):
        wrt.Motion.translation((0, 1, 0), times=0.5)  # type: ignore[arg-type]
