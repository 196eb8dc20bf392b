"""Denoised pictures are nearer to the truth, the same for any number of threads, and the noisy ones stay."""

import importlib.util

import numpy as np
import OpenEXR
import pytest
from support.small_scenes import assert_same_arrays, finish

import wrt
from wrt.develop import denoise as denoising
from wrt.develop.denoise import denoise

needs_denoiser = pytest.mark.skipif(
    importlib.util.find_spec(denoising.PACKAGE) is None, reason="Open Image Denoise has no wheel here"
)
SIZE = {"width": 64, "height": 64}


def rendered(scene, spp, **options):
    return finish(wrt.Renderer(scene, **{**SIZE, **options}), spp, pass_seconds=5.0)


@needs_denoiser
@pytest.mark.slow
def test_denoising_halves_the_error(report):
    scene = wrt.load("cornell-box")
    truth = rendered(scene, 512, seed=1).image()
    renderer = rendered(scene, 16)

    def error(image):
        return float(np.sqrt((((image - truth) / (truth + 0.05)) ** 2).mean()))

    noisy, denoised = error(renderer.image()), error(renderer.denoised())
    report("error of 16 samples over that after denoising", noisy / denoised)
    assert denoised < noisy / 2.0  # 4 and more at usual sizes


@pytest.mark.slow
@needs_denoiser
def test_guides_look_into_mirrors_and_through_glass():
    """A red and a green wall; the camera looks into a mirror, and through a pane of glass."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), fov_degrees=20.0))
    right, up = (9.0, 0.0, 0.0), (0.0, 18.0, 0.0)
    scene.add(wrt.quad((-9.0, -9.0, 4.0), up, (18.0, 0.0, 0.0)), material=wrt.Diffuse((0.8, 0.1, 0.1)))
    scene.add(wrt.quad((-9.0, -9.0, -3.0), right, up), material=wrt.Mirror((1.0, 1.0, 0.5)))
    scene.add(wrt.quad((0.0, -9.0, -3.0), right, up), material=wrt.ThinDielectric(ior=1.0))
    scene.add(wrt.quad((0.0, -9.0, -4.0), right, up), material=wrt.Diffuse((0.1, 0.8, 0.1)))
    scene.add_light(wrt.PointLight((0.0, 1.0, 0.0), intensity=10.0))
    renderer = rendered(scene, 4, filter="box")
    before = renderer.film.state()
    renderer.denoised()
    assert_same_arrays(before, renderer.film.state())
    guides = renderer._guides.layers()
    for x, albedo, normal in ((10, (0.8, 0.1, 0.05), (0.0, 0.0, -1.0)), (54, (0.1, 0.8, 0.1), (0.0, 0.0, 1.0))):
        np.testing.assert_allclose(guides["albedo"][32, x], albedo, atol=1e-5)
        np.testing.assert_allclose(guides["normal"][32, x], normal, atol=1e-5)


@needs_denoiser
def test_denoising_does_not_depend_on_threads_or_missing_values():
    """One NaN would spoil the pixels around it, and automatic exposure has other bits for other threads."""
    image = np.random.default_rng(1).random((150, 200, 3), np.float32) * np.linspace(0.01, 20.0, 200)[:, None]
    albedo, normal = np.full_like(image, 0.5), np.zeros_like(image)
    one, two = (denoise(image, albedo, normal, threads=n) for n in (1, 2))
    np.testing.assert_array_equal(one, two)
    holed = image.astype(np.float32)
    holed[70, 90], holed[20, 30] = np.nan, np.inf
    assert np.isfinite(denoise(holed)).all()
    assert not denoise(np.zeros((8, 8, 3))).any()


@pytest.mark.slow
@needs_denoiser
def test_files_hold_the_denoised_and_the_noisy_picture(tmp_path):
    scene = wrt.load("cornell-box")
    scene.settings.denoise = True
    renderer = rendered(scene, 2, layers=["normal"])
    renderer.save(tmp_path / "a.exr")
    channels = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True).channels()
    shown, noisy = (np.stack([channels[p + n].pixels for n in "RGB"], axis=2) for p in ("", "noisy."))
    np.testing.assert_array_equal(noisy, renderer.image())
    np.testing.assert_array_equal(shown, renderer.denoised())
    assert "normal.X" in channels
    assert not np.array_equal(shown, noisy)


@needs_denoiser
@pytest.mark.usefixtures("render_kernels_when_launched")
def test_guides_are_prepared_with_the_renderer(monkeypatch):
    """The command line can go over from compiled kernels to Warp only until the renderer is made."""
    scene = wrt.load("cornell-box")
    assert wrt.Renderer(scene, **SIZE)._guides is None
    scene.settings.denoise = True
    assert wrt.Renderer(scene, **SIZE)._guides is not None
    layers_alone = wrt.Renderer(scene, **SIZE, integrator="aov", layers=("depth",))
    assert layers_alone._guides is None
    with pytest.raises(wrt.InputError, match="renders only layers"):
        layers_alone.denoised()
    with pytest.raises(wrt.InputError, match="albedo must have the shape of the image"):
        denoise(np.ones((4, 4, 3)), np.ones((4, 5, 3)))
    monkeypatch.setattr(denoising, "PACKAGE", "no_such_package")
    with pytest.raises(wrt.InputError, match="pip install mitsuba-oidn"):
        denoise(np.ones((4, 4, 3)))
