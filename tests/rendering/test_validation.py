"""Scenes that cannot be rendered are refused before they reach the device; saved pictures name their settings."""

import contextlib
import re

import numpy as np
import OpenEXR
import pytest
import trimesh
from PIL import Image
from support.small_scenes import block_scene, finish

import wrt
from wrt.errors import InputWarning
from wrt.upload.prepare import check_attributes

CORNERS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
FACE = np.array([[0, 1, 2]])
MESH = wrt.Mesh(CORNERS, FACE)
MASKED = np.ma.masked_equal(CORNERS, 1.0)


def lit(*meshes):
    return wrt.Scene([wrt.Shape(mesh) for mesh in meshes], environment=wrt.ConstantEnvironment())


@pytest.mark.usefixtures("render_kernels_when_launched")
def test_scenes_too_large_or_too_small_for_rays_are_refused():
    for vertices, message in (
        (CORNERS * 1e30, "its vertices reach to 1e"),
        (CORNERS * 1e-20, "the scene is 1"),
        (CORNERS * 0.0 + 1.0, "all vertices of the scene are in one place"),
    ):
        with pytest.raises(wrt.InputError, match=message):
            wrt.Renderer(lit(wrt.Mesh(vertices, FACE)), width=4, height=4)
    wrt.Renderer(lit(wrt.Mesh(CORNERS * 1e-20, FACE), wrt.box()), width=4, height=4)  # a speck in a room


def test_what_a_scene_cannot_have_is_refused_when_made_and_when_rendered():
    for field, value, message in (
        ("environment", wrt.Diffuse(), "the scene's environment must be one of wrt's environments, not Diffuse"),
        ("shapes", [wrt.box()], "shapes must be a list of wrt.Shape, not of Mesh; "),
        ("lights", wrt.PointLight((0, 3, 0), intensity=1.0), "lights must be a list of wrt's lights, not PointLight"),
        ("settings", {"spp": 3}, "the scene's settings must be wrt.RenderSettings, not dict"),
    ):
        scene = lit(wrt.box())
        setattr(scene, field, value)
        uses = [lambda use=use, scene=scene: use(scene) for use in (wrt.Renderer, wrt.load, wrt.render)]
        for use in (lambda field=field, value=value: wrt.Scene(**{field: value}), *uses):
            with pytest.raises(wrt.InputError, match=f"^{re.escape(message)}"):
                use()
    with pytest.raises(AttributeError, match="enviroment"):
        wrt.Scene().enviroment = wrt.ConstantEnvironment()
    with pytest.raises(AttributeError, match="samples"):
        wrt.Scene().settings.samples = 16


def test_arrays_that_are_none_are_refused_in_one_line():
    for make, message in (
        (lambda: wrt.Mesh(CORNERS.astype(complex), FACE), "mesh: vertices must be an array of numbers"),
        # What files of simulations hold where there is nothing, such as 9.97e36, is masked when they are read.
        (lambda: wrt.Mesh(MASKED, FACE), "mesh: vertices must not have masked values; the first is number 1$"),
        (lambda: MESH.scaled((1.0, 2.0, 3.0)), r"mesh: a scale must be a number, not \(1.0, 2.0, 3.0\)$"),
        (lambda: MESH.rotated("y", 90.0), "axis must be three numbers, not 'y'$"),
        (lambda: MESH.rotated((0, 0, 0), 90.0), "axis must not be zero$"),
        (lambda: wrt.Motion(0.5, [np.eye(4)]), "motion times must be one or more finite numbers$"),
        (lambda: wrt.Motion.rotation((0, 1, 0), 90.0, times=0.5), "times must be two numbers, not 0.5$"),
    ):
        with pytest.raises(wrt.InputError, match=f"^{message}"):
            make()
        assert wrt.Mesh(np.ma.array(CORNERS), FACE).bounds[1, 0] == 1.0


def test_a_saved_picture_says_how_it_was_made(tmp_path):
    size = {"width": 8, "height": 6, "seed": 7}
    renderer = finish(wrt.Renderer(block_scene(), layers=("albedo", "depth"), **size), 3)
    renderer.save(tmp_path / "a.exr")
    file = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True)
    assert {"R", "G", "B", "albedo.R", "depth.Z"} <= set(file.channels())
    header = file.header()
    assert (header["Samples per pixel"], header["Seed"], header["Software"]) == ("3", "7", f"wrt {wrt.__version__}")
    assert float(header["Render seconds"]) >= 0.0
    with pytest.raises(wrt.InputError, match="layers go into OpenEXR files"):
        renderer.save(tmp_path / "a.png")
    finish(wrt.Renderer(block_scene(), **size), 2).save(tmp_path / "b.png")
    with Image.open(tmp_path / "b.png") as picture:
        assert picture.info["Samples per pixel"] == "2"


COLORED = wrt.Diffuse(wrt.VertexColor())
HALF, CODES = (wrt.ImageTexture(np.full((2, 2, 3), level), name) for level, name in ((0.5, "half"), (200.0, "wood")))
BRIGHT, DARK = (wrt.Mesh(CORNERS, FACE, colors=colors) for colors in (3.0 * CORNERS, CORNERS - 0.5))
LAID = wrt.Mesh(CORNERS, FACE, uvs=CORNERS[:, :2])
TOO_BRIGHT = "^shape: vertex colors must be linear, from 0 to 1; .* from 0 to 3$"


def test_vertex_colors_that_no_surface_has_are_refused():
    for shape, message in (
        (wrt.Shape(BRIGHT, wrt.Mix(wrt.Mirror(), COLORED)), TOO_BRIGHT),
        (wrt.Shape(BRIGHT, wrt.Diffuse(opacity=wrt.VertexColor())), TOO_BRIGHT),
        (wrt.Shape(DARK, COLORED), "^shape: vertex colors must be linear, from 0 to 1; .* from -0.5 to 0.5$"),
        (
            wrt.Shape(DARK, emission=wrt.VertexColor(2.0)),
            "^shape: vertex colors that shine must be at least 0, not -1$",
        ),
        (wrt.Shape(BRIGHT, emission=wrt.VertexColor()), None),
        (wrt.Shape(BRIGHT, wrt.Diffuse(wrt.VertexColor(1.0 / 3.0))), None),
        (wrt.Shape(MESH, COLORED), None),
        (wrt.Shape(LAID, wrt.Diffuse(HALF), emission=CODES), None),
    ):
        with pytest.raises(wrt.InputError, match=message) if message else contextlib.nullcontext():
            check_attributes([shape])


@pytest.mark.usefixtures("render_kernels_when_launched")
def test_images_that_cannot_be_shown_are_warned_of_and_warnings_name_the_line_outside_of_wrt():
    with pytest.warns(InputWarning, match=r"^texture wood: as reflectance it must be at most 1, but it reaches 200$"):
        check_attributes([wrt.Shape(LAID, wrt.Diffuse(CODES))])
    scene = wrt.Scene([wrt.Shape(MESH, wrt.Diffuse(HALF))], environment=wrt.ConstantEnvironment())
    for use in (
        lambda: check_attributes([wrt.Shape(MESH, emission=HALF)]),
        lambda: wrt.Renderer(scene, width=4, height=4),
    ):
        with pytest.warns(InputWarning, match="^shape: its material has an image, but its mesh no texture coordinates"):
            use()
    dust = trimesh.Scene([trimesh.creation.box(), trimesh.PointCloud(CORNERS)])
    ply = dust.geometry["geometry_1"].export(file_type="ply")
    for warned in (
        lambda: wrt.Renderer(wrt.Scene([wrt.Shape(MESH)]), width=4, height=4),
        lambda: wrt.load(dust),
        lambda: wrt.load(ply, file_type="ply"),
    ):
        with pytest.warns(UserWarning, match="the scene has no light|are drawn as spheres") as caught:
            warned()
        assert [warning.filename for warning in caught] == [__file__]
