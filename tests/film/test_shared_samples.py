"""The filter "shared": a picture is the blend of its pixels' means that it should be, whatever was rendered at once."""

import dataclasses
import importlib.util

import numpy as np
import pytest
from scipy import special
from support.small_scenes import LAMP, assert_same_arrays, block_scene, finish

import wrt
from wrt.backend.device import Device
from wrt.develop import denoise
from wrt.rendering.film import Film
from wrt.rendering.reading import Reading

SHARE, SMOOTH = 0.075, 0.75
"""A neighbour's share, and the half width of the raised cosine; written down here a second time on purpose."""

SIZE = {"width": 24, "height": 17, "max_depth": 3, "filter": "shared"}
LAYERS = ("albedo", "normal", "alpha", "depth", "object", "crypto_object", "light_groups")
WHOLE = (0, 0, 24, 17)
CROPS = [(0, 0, 1, 1), (23, 16, 24, 17), (12, 8, 13, 9), (1, 1, 23, 16), (0, 3, 24, 5), (7, 0, 8, 17), WHOLE]


def grouped():
    scene = block_scene()
    scene.shapes = [scene.shapes[0], dataclasses.replace(LAMP, group="lamp")]
    return scene


@pytest.fixture(scope="module")
def renderer():
    return wrt.Renderer(grouped(), layers=LAYERS, **SIZE)


@pytest.fixture(scope="module")
def whole(renderer):
    return finish(renderer.sharing(), 5)


def wall(size, corner=(-99.0, -99.0)):
    """Return a camera that sees pixels of 1 m, and a wall of radiance 1 right of and above a corner."""
    camera = wrt.OrthographicCamera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), view_height=float(size[1]))
    scene = wrt.Scene(camera=camera, environment=wrt.ConstantEnvironment(0.0))
    scene.add(wrt.quad((*corner, 0.0), (999.0, 0.0, 0.0), (0.0, 999.0, 0.0)), material=wrt.Diffuse(0.5), emission=1.0)
    return scene


def step(x):
    """Return the integral of the picture's filter up to x, in pixels."""

    def integral_of_step(x):  # of a step that the raised cosine smooths
        t = np.clip(x / SMOOTH, -1.0, 1.0)
        inside = 0.25 + 0.5 * t + 0.25 * t**2 - (1.0 + np.cos(np.pi * t)) / (2.0 * np.pi**2)
        return np.where(x > SMOOTH, x, SMOOTH * inside)

    def of_samples(x):
        return integral_of_step(x + 0.5) - integral_of_step(x - 0.5)

    return (1.0 - 2.0 * SHARE) * of_samples(x) + SHARE * (of_samples(x - 1.0) + of_samples(x + 1.0))


@pytest.mark.parametrize("corner", [(0.2, 0.45), (-1.5, 0.8)])
def test_a_corner_has_the_profile_of_the_filter(corner, report):
    width, height = 12, 10
    renderer = wrt.Renderer(wall((width, height), corner), width=width, height=height, max_depth=1, filter="shared")
    image = finish(renderer, 4096).image()[..., 0]
    x, y = np.arange(width) + 0.5 - width / 2, height / 2 - 0.5 - np.arange(height)
    error = np.abs(image - step(x - corner[0]) * step(y - corner[1])[:, None]).max()
    report(f"largest error of a corner at {corner}", float(error), "< 0.002")
    assert error < 0.002


def test_an_edge_is_nearly_that_of_the_gaussian():
    """Which Mitsuba's files ask for, of a standard deviation of half a pixel."""
    x = np.linspace(-3.0, 3.0, 601)
    assert np.abs(step(x) - special.ndtr(2.0 * x)).max() < 0.02
    rise = np.interp(0.9, step(x), x) - np.interp(0.1, step(x), x)
    assert 0.97 < rise / (2.0 * 0.5 * special.ndtri(0.9)) < 1.05


@pytest.mark.parametrize("size", [(9, 7), (1, 5), (4, 1), (1, 1)])
def test_blending_is_a_symmetric_matrix_that_keeps_the_mean(size):
    reading = Reading(SHARE)
    pixels = size[0] * size[1]
    means = np.eye(pixels).reshape(size[1], size[0], pixels)
    matrix = reading.blended(means).reshape(pixels, pixels)
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-15)
    assert (matrix >= 0.0).all()
    np.testing.assert_allclose(reading.blended(means, squared=True).reshape(pixels, pixels), matrix**2, atol=1e-15)


def test_the_device_reads_what_the_host_reads(device):
    """With uneven numbers of samples, none in some pixels, and margins."""
    rng = np.random.default_rng(2)
    film = Film(7, 5, Device(device), reading=Reading(SHARE, (1, 0, 2, 1)))
    assert film.picture_size == (4, 4)
    state = film.state()
    state["count"] = count = rng.integers(0, 9, 35).astype(np.int32)
    samples = [rng.random((n, 3)) for n in count]
    state["total"] = np.stack([each.sum(axis=0) for each in samples])
    state["total_of_squares"] = np.stack([(each**2).sum(axis=0) for each in samples])
    film.restore(state)
    np.testing.assert_allclose(film.device_mean().numpy(), film.mean(), rtol=1e-6)
    np.testing.assert_allclose(film.reading.picture(film.snapshot()()), film.mean(), rtol=1e-6)
    means = (state["total"] / np.maximum(count, 1)[:, None]).reshape(5, 7, 3)
    np.testing.assert_allclose(film.mean(), Reading(SHARE).blended(means)[:4, 1:5], rtol=1e-6)
    with np.errstate(invalid="ignore", divide="ignore"):
        spread = state["total_of_squares"] / count[:, None] - (state["total"] / count[:, None]) ** 2
        variance = np.where(count[:, None] > 1, spread / (count[:, None] - 1.0), 0.0).reshape(5, 7, 3)
    error = np.sqrt(Reading(SHARE).blended(variance, squared=True))[(count > 1).reshape(5, 7)].sum()
    assert film.noise() == pytest.approx(error / means[(count > 1).reshape(5, 7)].sum(), rel=1e-9)


def test_independent_noise_falls_as_predicted(report):
    """A wall under an uneven sky, seen from above: all pixels are estimates of one number, and equally good."""
    sky = np.random.default_rng(3).random((8, 16, 3)).astype(np.float32)
    scene = wall((64, 48))
    scene.shapes[0] = wrt.Shape(scene.shapes[0].mesh, wrt.Diffuse(0.5))
    scene.environment = wrt.ImageEnvironment(sky)
    options = {"width": 64, "height": 48, "sampler": "independent", "max_depth": 2, "strategy": "bsdf"}
    renderer = finish(wrt.Renderer(scene, filter="shared", **options), 64)
    image, variance = renderer.image().astype(np.float64), renderer.variance()
    own = renderer.film.means().var(axis=(0, 1))
    factor = (1.0 - 2.0 * SHARE) ** 2 + 2.0 * SHARE**2
    ratio = float((image.var(axis=(0, 1)) / own).mean())
    report("variance over that without neighbours", ratio, factor**2)
    # Of 3072 variances the mean is right within 2.6 % (one standard deviation); of ratios less.
    assert ratio == pytest.approx(factor**2, rel=0.1)
    inside = variance[1:-1, 1:-1].mean(axis=(0, 1))
    np.testing.assert_allclose(image[1:-1, 1:-1].var(axis=(0, 1)) / inside, 1.0, atol=0.15)
    noise = np.sqrt(variance).mean() / image.mean()
    assert renderer.film.noise() == pytest.approx(noise, rel=1e-6)


@pytest.mark.parametrize("crop", CROPS)
def test_a_crop_is_a_part_of_the_whole_to_the_bit(renderer, whole, crop):
    x0, y0, x1, y1 = crop
    part = finish(renderer.sharing(crop=crop), 5)
    window = slice(y0, y1), slice(x0, x1)
    for name in ("image", "variance", "finished"):
        np.testing.assert_array_equal(getattr(part, name)(), getattr(whole, name)()[window], err_msg=name)
    np.testing.assert_array_equal(part.device_image().numpy(), whole.image()[window])
    expected = {name: values[window] for name, values in whole.layers().items()}
    assert_same_arrays(part.layers(), expected)


def test_layers_belong_to_the_picture(whole):
    """Groups of lights add up to it, and the coverage by objects is its alpha."""
    layers = whole.layers()
    groups = layers["light_lamp"].astype(np.float64) + layers["light_rest"]
    np.testing.assert_allclose(groups, whole.image(), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(layers["crypto_object"][..., 1].sum(axis=2), layers["alpha"], atol=1e-6)
    masks = sum(wrt.cryptomatte_mask(layers["crypto_object"], shape.name) for shape in whole.scene.shapes[:1])
    assert (masks[layers["object"] == 1] > 0.0).all()


@pytest.mark.parametrize("crop", [None, (2, 3, 20, 14)])
def test_parts_and_resumed_pictures_are_those_of_one_render(renderer, whole, tmp_path, crop):
    x0, y0, x1, y1 = crop or WHOLE
    window = renderer.sharing(crop=crop)
    merged = wrt.merge([window.part(number, 3, spp=5) for number in range(1, 4)])
    assert (merged.width, merged.height) == (x1 - x0, y1 - y0)
    expected = {name: values[y0:y1, x0:x1] for name, values in whole.layers().items()}
    for save in (finish(window, 2).save_checkpoint, merged.save_checkpoint):
        save(tmp_path / "a.ckpt")
        resumed = finish(wrt.Renderer.resume(tmp_path / "a.ckpt", renderer.scene), 5)
        for each in (resumed, merged):
            np.testing.assert_array_equal(each.image(), whole.image()[y0:y1, x0:x1])
            assert_same_arrays(each.layers(), expected)


def test_a_target_of_noise_takes_the_filter_into_account(report):
    """Independent noise of 0.73 is that of 0.54 of the samples."""

    def samples(filter):
        renderer = wrt.Renderer(block_scene(), width=48, height=36, max_depth=3, sampler="independent", filter=filter)
        return finish(renderer, noise=0.005).spp

    ratio = samples("shared") / samples("gaussian")
    report("samples over those of the Gaussian", ratio, 0.54)
    assert 0.45 < ratio < 0.62


@pytest.mark.parametrize("crop", [None, (3, 0, 20, 9)])
def test_gradients_are_those_of_the_picture(crop):
    """The picture is linear in the environment's radiance, without rounding, and a polynomial of reflectances."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.5, 1.5, 4.0), (0.0, 0.5, 0.0)))
    scene.add(wrt.quad((-2.0, 0.0, 2.0), (4.0, 0.0, 0.0), (0.0, 0.0, -4.0)), material=(0.6, 0.5, 0.4), name="floor")
    scene.add(wrt.quad((-2.0, 0.0, -2.0), (2.0, 0.0, 0.0), (0.0, 3.0, 0.0)), material=(0.3, 0.5, 0.7), name="wall")
    scene.environment = wrt.ConstantEnvironment((0.2, 0.3, 0.4))
    options = {"width": 24, "height": 17, "sampler": "independent", "max_depth": 4, "filter": "shared", "crop": crop}
    renderer = wrt.Renderer(scene, **options)
    d_image = np.random.default_rng(2).normal(size=renderer.render(spp=4).shape)
    found = renderer.gradients(d_image, spp=4)
    for name, value in wrt.parameters(renderer).items():
        if name not in found:
            continue
        for channel in range(3):
            change = 0.02 * np.eye(3)[channel]
            renderer.set_parameters({name: value + change})
            above = renderer.render(spp=4).astype(np.float64)
            renderer.set_parameters({name: value - change})
            slope = float((d_image * (above - renderer.render(spp=4))).sum()) / 0.04
            renderer.set_parameters({name: value})
            assert found[name][channel] == pytest.approx(slope, abs=1e-3 * float(np.abs(found[name]).max())), name


def test_shadow_catchers_of_a_crop():
    scene = block_scene()
    scene.add(wrt.quad((-2.0, -0.6, 2.0), (4.0, 0.0, 0.0), (0.0, 0.0, -4.0)), shadow_catcher=True)
    renderer = wrt.Renderer(scene, layers=("shadow",), **SIZE)
    whole, part = finish(renderer.sharing(), 3), finish(renderer.sharing(crop=(5, 4, 20, 17)), 3)
    np.testing.assert_array_equal(part.finished(), whole.finished()[4:17, 5:20])
    assert_same_arrays(part.layers(), {"shadow": whole.layers()["shadow"][4:17, 5:20]})


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec(denoise.PACKAGE) is None, reason="Open Image Denoise has no wheel here")
def test_denoised_pictures_are_no_worse(report):
    """Than with the Gaussian, each against its own converged picture; and a crop can be denoised."""
    scene = wrt.load("cornell-box")
    errors = {}
    for filter in ("gaussian", "shared"):
        renderer = wrt.Renderer(scene, width=96, height=96, filter=filter)
        truth = finish(wrt.Renderer(scene, width=96, height=96, filter=filter, seed=1), 2048).image()
        image = finish(renderer, 16).denoised()
        errors[filter] = float(np.sqrt((((image - truth) / (truth + 0.05)) ** 2).mean()))
    report("denoised error over that of the Gaussian", errors["shared"] / errors["gaussian"])
    assert errors["shared"] < errors["gaussian"]
    crop = finish(renderer.sharing(crop=(10, 20, 50, 90), denoise=True), 4)
    assert crop.finished().shape == crop.denoising_guides()["albedo"].shape == (70, 40, 3)
