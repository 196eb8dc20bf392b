"""A transparent picture holds what covers each pixel; lights are hidden from the camera alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from numpy.typing import NDArray
from PIL import Image
from test_wide import differences, needs_lanes

import wrt
from wrt.develop.picture import develop_image

SIZE = {"width": 24, "height": 18}


def rendered(scene: wrt.Scene, *, spp: int = 4, **options: Any) -> wrt.Renderer:
    renderer = wrt.Renderer(scene, **{**SIZE, **options})
    for _ in renderer.passes(spp=spp):
        pass
    return renderer


def block(material: wrt.Material) -> wrt.Scene:
    """A box that covers a part of the picture, under a constant environment of 0.8."""
    camera = wrt.PerspectiveCamera((0.4, 0.5, 3.0), (0.0, 0.0, 0.0), fov_degrees=40.0)
    scene = wrt.Scene(camera=camera, environment=wrt.ConstantEnvironment(0.8))
    scene.add(wrt.box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)), material=material)
    return scene


def cover_of(renderer: wrt.Renderer) -> NDArray[np.float32]:
    alpha = renderer.alpha()
    assert alpha is not None
    assert alpha.min() == 0.0
    assert alpha.max() == 1.0
    assert ((alpha > 0.0) & (alpha < 1.0)).any()
    return alpha


def test_the_environment_is_hidden_but_lights_the_scene(device: str) -> None:
    renderer = rendered(block(wrt.Diffuse(0.5)), device=device, transparent=True)
    alpha = cover_of(renderer)
    # Light leaves a convex body after one reflection: each covered sample has a radiance of 0.5 x 0.8.
    np.testing.assert_allclose(renderer.image(), np.repeat(0.4 * alpha[:, :, None], 3, axis=2), atol=1e-6)
    opaque = rendered(block(wrt.Diffuse(0.5)), device=device)
    assert opaque.alpha() is None
    np.testing.assert_allclose(
        opaque.image(), renderer.image() + 0.8 * (1.0 - alpha[:, :, None]) * np.ones(3), atol=1e-5
    )
    assert renderer.layers() == {}


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["path", "whitted"])
def test_mirrors_show_the_environment(integrator: str) -> None:
    renderer = rendered(block(wrt.Mirror()), transparent=True, integrator=integrator)
    np.testing.assert_allclose(renderer.image(), np.repeat(0.8 * cover_of(renderer)[:, :, None], 3, axis=2), atol=1e-6)


@pytest.mark.slow
def test_holes_are_transparent() -> None:
    renderer = rendered(block(wrt.Diffuse(0.5, opacity=0.5)), spp=64, transparent=True)
    alpha = cover_of(rendered(block(wrt.Diffuse(0.5)), spp=64, transparent=True))
    inside = alpha == 1.0
    cover = renderer.alpha()
    assert cover is not None
    # A ray passes the front and then the back by one half each.
    assert cover[inside].mean() == pytest.approx(0.75, abs=0.02)
    assert renderer.image()[alpha == 0.0].max() == 0.0


def wall_with_lamp(*, lamp: bool = True, backwards: bool = False) -> wrt.Scene:
    """A wall that fills the picture, and between it and the camera a lamp that faces the camera or the wall."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0, 0, 3), (0, 0, 0), fov_degrees=40.0))
    scene.add(wrt.quad((-5, -5, 0), (10, 0, 0), (0, 10, 0)), material=wrt.Diffuse(0.5))
    scene.environment = wrt.ConstantEnvironment(0.8)
    edges: Any = ((0.8, 0, 0), (0, 0.8, 0)) if not backwards else ((0, 0.8, 0), (0.8, 0, 0))
    if lamp:
        scene.add_light(wrt.RectangleLight((-0.4, -0.4, 1.0), *edges, radiance=3.0))
    return scene


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["path", "whitted"])
def test_a_lamp_without_a_mesh_hides_nothing(integrator: str) -> None:
    # It shines away from the wall, so with the lamp hidden the picture is that without it.
    seen = rendered(wall_with_lamp(), integrator=integrator).image()
    assert seen.max() == pytest.approx(3.0)
    hidden = rendered(wall_with_lamp(), spp=64, integrator=integrator, transparent=True)
    np.testing.assert_array_equal(hidden.alpha(), np.ones((18, 24)))
    without = rendered(wall_with_lamp(lamp=False), spp=64, integrator=integrator).image()
    if integrator == "whitted":
        np.testing.assert_allclose(hidden.image(), without, rtol=1e-4)
    else:
        # The wall receives from the environment all that the lamp does not cover.
        assert hidden.image().max() < 0.5
        assert 0.25 < hidden.image()[9, 12, 0] < without.mean()
    lit = rendered(wall_with_lamp(backwards=True), spp=16, integrator=integrator, transparent=True).image()
    assert lit[9, 12].min() > 1.5 * hidden.image()[9, 12].max()  # its light is there


@pytest.mark.slow
@needs_lanes
def test_the_wide_kernel_has_the_same_bits() -> None:
    scene = wall_with_lamp()
    scene.shapes[:] = [scene.shapes[0], *block(wrt.Diffuse(0.4)).shapes]
    assert differences(scene, transparent=True, **SIZE) == []


# --- Files ----------------------------------------------------------------------------------------


def test_png_has_straight_alpha_and_the_others_associated(tmp_path: Path) -> None:
    colors = np.array([[[0.5, 0.25, 0.125], [0.25, 0.125, 0.0625], [0.0, 0.0, 0.0]]], np.float32)
    alpha = np.array([[1.0, 0.5, 0.0]], np.float32)
    for name in ("a.png", "a.exr", "a.npy"):
        wrt.save_image(tmp_path / name, colors, alpha=alpha)
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.mode == "RGBA"
        codes = np.asarray(picture)
    assert codes[0, :, 3].tolist() == [255, 128, 0]
    straight = np.array([[colors[0, 0], colors[0, 0], np.zeros(3)]])
    np.testing.assert_array_equal(codes[:, :, :3], develop_image(straight, tone="none", exposure=0.0))
    channels = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True).channels()
    np.testing.assert_array_equal(channels["A"].pixels, alpha)
    np.testing.assert_array_equal(channels["R"].pixels, colors[:, :, 0])
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), np.dstack([colors, alpha]))
    for name in ("a.exr", "a.npy"):
        np.testing.assert_array_equal(wrt.load_image(tmp_path / name), colors)
    wrt.save_image(tmp_path / "b.exr", np.dstack([colors, alpha]))
    assert (tmp_path / "b.exr").read_bytes() == (tmp_path / "a.exr").read_bytes()
    with pytest.raises(wrt.InputError, match="alpha must be"):
        wrt.save_image(tmp_path / "c.png", colors, alpha=np.ones((3, 1)))


def test_saving_and_resuming_keep_the_coverage(tmp_path: Path) -> None:
    renderer = rendered(block(wrt.Diffuse(0.5)), spp=2, transparent=True, layers=("depth",))
    renderer.save_checkpoint(tmp_path / "a.ckpt")
    whole = rendered(block(wrt.Diffuse(0.5)), spp=4, transparent=True, layers=("depth",))
    resumed = wrt.Renderer.resume(tmp_path / "a.ckpt", block(wrt.Diffuse(0.5)))
    for _ in resumed.passes(spp=4):
        pass
    np.testing.assert_array_equal(resumed.alpha(), whole.alpha())
    assert set(resumed.layers()) == {"depth"}
    with pytest.raises(wrt.InputError, match="transparent"):
        wrt.Renderer(block(wrt.Diffuse(0.5)), layers=("depth",), **SIZE).load_checkpoint(tmp_path / "a.ckpt")
    resumed.save(tmp_path / "a.exr")
    channels = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True).channels()
    assert set(channels) == {"R", "G", "B", "A", "depth.Z"}
    np.testing.assert_array_equal(channels["A"].pixels, whole.alpha())
    with pytest.raises(wrt.InputError, match="transparent must be"):
        wrt.RenderSettings(transparent=2)  # type: ignore[arg-type]
