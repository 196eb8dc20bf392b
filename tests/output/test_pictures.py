"""`wrt.render`, `wrt.show` and `Renderer.render`: what they return, and what they refuse."""

from __future__ import annotations

import io

import numpy as np
import pytest
import trimesh
from PIL import Image

import wrt
from wrt.cli import main
from wrt.scene.srgb import srgb_from_linear

SMALL = {"width": 32, "height": 24, "spp": 4}
RADIANCE = np.full((4, 6, 3), 0.5, np.float32)


def test_a_background_is_exact_and_stands_where_nothing_is_seen(tmp_path):
    scene = wrt.load("meshes/teapot.ply", view="front", transparent=True)
    transparent = wrt.render(scene, **SMALL, seed=1)
    assert transparent.shape == (24, 32, 4)
    for background in ("#336699", (0.1, 0.2, 0.3)):
        image = wrt.render("meshes/teapot.ply", view="front", background=background, **SMALL, seed=1)
        color = np.float32(wrt.RenderSettings(background=background).background)
        np.testing.assert_allclose(image, transparent[..., :3] + (1.0 - transparent[..., 3:]) * color, atol=1e-6)
        renderer = wrt.Renderer(scene, background=background, tone="agx", **SMALL)
        renderer.render()
        for suffix in ("png", "jpg"):
            renderer.save(tmp_path / f"a.{suffix}")
            codes = np.asarray(Image.open(tmp_path / f"a.{suffix}")).astype(int)
            assert codes.shape == (24, 32, 3)
            expected = np.rint(255.0 * srgb_from_linear(color)).astype(int)
            assert np.abs(codes[0, 0] - expected).max() <= (0 if suffix == "png" else 2)
    with pytest.raises(wrt.InputError, match="background must be a colour"):
        wrt.render("cornell-box", background="whyte")


def test_python_shows_a_background_as_the_shell_does(tmp_path):
    """A bright picture, whose highlights the tone curve compresses."""

    def pixels(name):
        return np.asarray(Image.open(tmp_path / name))

    options = {"view": "front", "material": "gold", "background": "white", **SMALL}
    image = wrt.render("meshes/teapot.ply", **options)
    assert image.max() > 2.0
    arguments = ["render", "meshes/teapot.ply", "--view", "front", "--material", "gold", "--size", "32x24"]
    assert main([*arguments, "--background", "white", "--spp", "4", "-o", f"{tmp_path / 'shell.png'}"]) == 0
    assert (pixels("shell.png")[0] == 255).all()
    for exposure in (None, 1.0):
        wrt.save_image(tmp_path / "a.png", image, exposure=exposure)
        assert np.array_equal(wrt.develop_image(image, exposure=exposure), pixels("a.png"))
        assert exposure or np.array_equal(pixels("a.png"), pixels("shell.png"))
        assert (pixels("a.png")[0] == 255).all()
    darker = wrt.develop_image(image * np.float32(0.5))
    assert np.array_equal(darker, wrt.develop_image(np.array(image) * np.float32(0.5)))
    image[0] = 0.0
    assert (wrt.develop_image(image)[0] == 0).all()
    renderer = wrt.Renderer(wrt.load("meshes/teapot.ply", transparent=True), background="white", **SMALL)
    renderer.render()
    assert (np.asarray(Image.open(io.BytesIO(renderer._repr_png_())))[0] == 255).all()


def test_layers_come_with_the_picture_and_a_camera_replaces_the_sources():
    camera = wrt.PerspectiveCamera(origin=(0, 0.1, 5), target=(0, 0.1, 0), fov_degrees=4)
    found = wrt.render("meshes/teapot.ply", camera=camera, layers=("depth", "object"), **SMALL)
    assert sorted(found) == ["depth", "image", "object"]
    assert found["depth"][found["object"] == 1].min() == pytest.approx(5.0, rel=0.05)
    assert sorted(wrt.render("cornell-box", integrator="aov", layers=("normal",), **SMALL)) == ["normal"]


def test_what_a_camera_of_ones_own_sees_stays_in_place(tmp_path):
    """By default a mesh is stood up, scaled and moved to the origin."""
    vertices = np.array([[0, 0, 0], [800, 0, 0], [0, 0, 800], [800, 0, 800]]) + (1e6, 0, 0)
    mesh = trimesh.Trimesh(vertices, [[0, 1, 2], [1, 3, 2]], process=False)
    mesh.export(tmp_path / "a.stl")
    camera = wrt.PerspectiveCamera((1e6 + 400, 900, 400), (1e6 + 400, 0, 400), up=(0, 0, 1), fov_degrees=20)
    for source in (mesh, tmp_path / "a.stl", wrt.Mesh(mesh.vertices, mesh.faces)):
        depth = wrt.render(source, camera=camera, layers=("depth",), **SMALL)["depth"]
        assert depth.min() == pytest.approx(900.0, rel=1e-4)
        with pytest.raises(wrt.InputError, match="an up axis would turn the source, but not a camera"):
            wrt.load(source, camera=camera, up="z")


def test_progress_is_called_and_a_renderer_without_samples_says_so(tmp_path):
    done: list[int] = []
    wrt.render("cornell-box", **SMALL, progress=lambda progress: done.append(progress.spp))
    assert done == sorted(done)
    assert done[-1] == 4
    renderer = wrt.Renderer(wrt.load("cornell-box"), layers=("depth",), **SMALL)
    renderer.passes(spp=4)  # not gone through
    for ask in (renderer.image, renderer.finished, renderer.layers, lambda: renderer.save(tmp_path / "a.exr")):
        with pytest.raises(wrt.InputError, match=r"there is no picture yet: call render\(spp=16\)"):
            ask()
    assert not list(tmp_path.iterdir())
    assert np.array_equal(renderer.render(spp=4), wrt.render("cornell-box", **SMALL))
    assert np.array_equal(wrt.load("cornell-box").render(**SMALL), renderer.image())


@pytest.mark.parametrize(
    ("image", "shape"),
    [
        (RADIANCE[..., 0], (4, 6, 3)),
        (RADIANCE[..., 0] > 0.0, (4, 6, 3)),
        (np.dstack([RADIANCE, RADIANCE[..., 0]]), (4, 6, 4)),
        (np.stack([RADIANCE, RADIANCE]), (2, 4, 6, 3)),
    ],
    ids=("one channel", "mask", "alpha", "stack"),
)
def test_pictures_of_every_shape_are_developed(image, shape, tmp_path):
    codes = wrt.develop_image(image, tone="none")
    assert codes.shape == shape
    white = np.rint(255.0 * srgb_from_linear(0.5)) if image.dtype != bool and shape[-1] == 3 else 255
    assert np.abs(codes[..., :3].astype(int) - white).max() <= 1
    if codes.ndim == 3:
        wrt.save_image(tmp_path / "a.png", image, tone="none")
        assert np.array_equal(np.asarray(Image.open(tmp_path / "a.png")), codes)


def test_a_picture_without_a_number_is_refused(tmp_path):
    for image in (np.full((4, 4, 3), np.nan), np.full((4, 4), np.inf)):
        with pytest.raises(wrt.InputError, match="has no finite value"):
            wrt.save_image(tmp_path / "a.png", image)
    assert not list(tmp_path.iterdir())


def test_a_picture_is_shown_or_the_reason_is_said(monkeypatch):
    shown: list[Image.Image] = []
    monkeypatch.setattr("PIL.ImageShow.show", lambda picture, title: shown.append(picture) or True)
    monkeypatch.setenv("DISPLAY", ":0")
    wrt.load("cornell-box").show(**SMALL)
    wrt.show(RADIANCE, tone="none")
    assert [picture.size for picture in shown] == [(32, 24), (6, 4)]
    monkeypatch.delenv("DISPLAY")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(wrt.InputError, match=r"no viewer of pictures; wrt\.save_image"):
        wrt.show(RADIANCE)


def test_scenes_are_saved_where_one_looks_for_it(tmp_path):
    scene = wrt.load("cornell-box")
    scene.save(tmp_path / "a.toml")
    assert len(wrt.load(tmp_path / "a.toml").shapes) == len(scene.shapes)
    with pytest.raises(wrt.InputError, match=r"wrt\.save_image writes pictures"):
        scene.save(tmp_path / "a.png")
