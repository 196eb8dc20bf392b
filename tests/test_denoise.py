"""Denoised pictures are nearer to the truth, the same for any number of threads, and the noisy ones stay."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray

import wrt
from wrt.develop import denoise as denoising
from wrt.develop.denoise import denoise

needs_denoiser = pytest.mark.skipif(
    importlib.util.find_spec(denoising.PACKAGE) is None, reason="the extra wrt[denoise] is not installed"
)
SIZE = {"width": 64, "height": 64}


def rendered(scene: wrt.Scene, spp: int, **options: Any) -> wrt.Renderer:
    renderer = wrt.Renderer(scene, **{**SIZE, **options})
    for _ in renderer.passes(spp=spp, pass_seconds=5.0):
        pass
    return renderer


def error(image: NDArray[Any], truth: NDArray[Any]) -> float:
    """Return the mean squared relative error."""
    return float(np.sqrt((((image - truth) / (truth + 0.05)) ** 2).mean()))


@needs_denoiser
@pytest.mark.slow
def test_the_error_falls(report: Report) -> None:
    scene = wrt.load("cornell-box")
    truth = rendered(scene, 1024, seed=1).image()
    renderer = rendered(scene, 16)
    noisy, denoised = error(renderer.image(), truth), error(renderer.denoised(), truth)
    report("error of 16 samples over that after denoising", noisy / denoised)
    assert denoised < noisy / 2.0  # 4 and more at usual sizes


def mirror_room(**options: Any) -> wrt.Renderer:
    """A red and a green wall; the camera looks into a mirror, and through a pane of glass."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), fov_degrees=20.0))
    scene.add(wrt.quad((-9.0, -9.0, 4.0), (0.0, 18.0, 0.0), (18.0, 0.0, 0.0)), material=wrt.Diffuse((0.8, 0.1, 0.1)))
    scene.add(wrt.quad((-9.0, -9.0, -3.0), (9.0, 0.0, 0.0), (0.0, 18.0, 0.0)), material=wrt.Mirror((1.0, 1.0, 0.5)))
    scene.add(wrt.quad((0.0, -9.0, -3.0), (9.0, 0.0, 0.0), (0.0, 18.0, 0.0)), material=wrt.ThinDielectric(ior=1.0))
    scene.add(wrt.quad((0.0, -9.0, -4.0), (9.0, 0.0, 0.0), (0.0, 18.0, 0.0)), material=wrt.Diffuse((0.1, 0.8, 0.1)))
    scene.add_light(wrt.PointLight((0.0, 1.0, 0.0), intensity=10.0))
    return rendered(scene, 4, filter="box", **options)


@pytest.mark.slow
@needs_denoiser
def test_guides_look_into_mirrors_and_through_glass() -> None:
    renderer = mirror_room()
    before = renderer.film.state()
    renderer.denoised()
    after = renderer.film.state()
    assert all(np.array_equal(before[name], after[name]) for name in before)
    assert renderer._guides is not None
    guides = renderer._guides.layers()
    np.testing.assert_allclose(guides["albedo"][32, 10], (0.8, 0.1, 0.05), atol=1e-5)
    np.testing.assert_allclose(guides["normal"][32, 10], (0.0, 0.0, -1.0), atol=1e-5)
    np.testing.assert_allclose(guides["albedo"][32, 54], (0.1, 0.8, 0.1), atol=1e-5)
    np.testing.assert_allclose(guides["normal"][32, 54], (0.0, 0.0, 1.0), atol=1e-5)
    renderer.set_camera(wrt.PerspectiveCamera((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    for _ in renderer.passes(spp=1):
        pass
    np.testing.assert_allclose(renderer._guides.layers()["albedo"][32, 10], (0.8, 0.1, 0.1), atol=1e-5)


@needs_denoiser
def test_threads_and_gaps_do_not_matter() -> None:
    """One NaN would spoil the pixels around it, and automatic exposure has other bits for other threads."""
    image = np.random.default_rng(1).random((150, 200, 3), np.float32) * np.linspace(0.01, 20.0, 200)[:, None]
    albedo, normal = np.full_like(image, 0.5), np.zeros_like(image)
    one = denoise(image, albedo, normal, threads=1)
    assert np.array_equal(one, denoise(image, albedo, normal, threads=2))
    holed = image.copy().astype(np.float32)
    holed[70, 90] = np.nan
    holed[20, 30] = np.inf
    assert np.isfinite(denoise(holed)).all()
    assert not denoise(np.zeros((8, 8, 3))).any()


@needs_denoiser
def test_files_show_the_denoised_picture_and_keep_the_noisy_one(tmp_path: Path) -> None:
    import OpenEXR

    scene = wrt.load("cornell-box")
    scene.settings.denoise = True
    renderer = rendered(scene, 2, layers=["normal"])
    renderer.save(tmp_path / "a.exr")
    channels = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True).channels()
    shown = np.stack([channels[name].pixels for name in "RGB"], axis=2)
    noisy = np.stack([channels[f"noisy.{name}"].pixels for name in "RGB"], axis=2)
    assert np.array_equal(noisy, renderer.image())
    assert np.array_equal(shown, renderer.denoised())
    assert "normal.X" in channels
    assert not np.array_equal(shown, noisy)
    assert np.array_equal(wrt.render("cornell-box", spp=2, denoise=True, **SIZE), shown)


def test_what_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(denoising, "PACKAGE", "no_such_package")
    with pytest.raises(wrt.InputError, match=r"pip install 'wrt\[denoise\]'"):
        denoise(np.ones((4, 4, 3)))


@needs_denoiser
def test_mistakes_are_named() -> None:
    with pytest.raises(wrt.InputError, match="image must have shape"):
        denoise(np.ones((4, 4)))
    with pytest.raises(wrt.InputError, match="albedo must have the shape of the image"):
        denoise(np.ones((4, 4, 3)), np.ones((4, 5, 3)))
    with pytest.raises(wrt.InputError, match="renders only layers"):
        rendered(wrt.load("cornell-box"), 1, integrator="aov", layers=["normal"]).denoised()


@needs_denoiser
def test_the_kernel_of_the_guides_is_prepared_with_the_renderer() -> None:
    """The command line can go over from compiled kernels to Warp only until the renderer is made."""
    scene = wrt.load("cornell-box")
    assert wrt.Renderer(scene, **SIZE)._guides is None
    scene.settings.denoise = True
    assert wrt.Renderer(scene, **SIZE)._guides is not None
    assert wrt.Renderer(scene, **SIZE, integrator="aov", layers=("depth",))._guides is None
