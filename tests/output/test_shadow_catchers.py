"""A shadow catcher shows what the other shapes do to its light, and nothing else.

Over a picture of the catchers alone, the picture has the luminance of the whole scene, and `shadow` its colours. Where
no shape changes the light, alpha is 0 and `shadow` is 1 to the bit.
"""

import dataclasses
import importlib.util

import numpy as np
import pytest
from PIL import Image
from support.covering_kernels import OF_PICTURES, rendering_with
from support.small_scenes import finish
from support.statistics import image_z_test

import wrt
from wrt.cli import main
from wrt.develop import denoise
from wrt.rendering.catchers import Caught, caught

kernels_of_the_file = rendering_with(OF_PICTURES, dataclasses.replace(OF_PICTURES, aovs=True))

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
SIZE = {"width": 32, "height": 24}
RED = wrt.Diffuse((0.8, 0.2, 0.1))


def table(*shapes: wrt.Shape, is_caught: bool = True, light: wrt.Light | None = None) -> wrt.Scene:
    """Shapes on a square of bluish ground that ends within the picture, under a lamp or another light."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 2.0, 5.0), (0.0, 0.4, 0.0), fov_degrees=40.0))
    ground = wrt.quad((-2.0, 0.0, 2.0), (4.0, 0.0, 0.0), (0.0, 0.0, -4.0))
    scene.add(ground, material=wrt.Diffuse((0.3, 0.5, 0.6)), shadow_catcher=is_caught)
    scene.shapes += shapes
    if light is None:
        scene.add(wrt.quad((-2.0, 3.0, -0.5), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)), emission=(9.0, 8.0, 6.0))
        scene.environment = wrt.ConstantEnvironment((0.2, 0.25, 0.4))
    else:
        scene.add_light(light)
    return scene


def ball(material: wrt.Material = RED, **options: object) -> wrt.Shape:
    return wrt.Shape(wrt.sphere((0.0, 0.6, 0.0), 0.5, subdivisions=3), material, **options)


@pytest.mark.parametrize("material", [RED, pytest.param(wrt.Mirror(), marks=pytest.mark.slow)])
def test_the_picture_over_the_catchers_is_the_whole_scene(material, report):
    """With the ball's edge and the ground's, and light that the ball sends to the ground."""
    own = wrt.Renderer(table(is_caught=False), transparent=True, **SIZE, seed=99).render(spp=4096)
    rare = (own[..., 3] > 0.0) & (own[..., 3] < 0.01)  # so few samples see the ground that their variance is unknown
    own[rare] = 0.0
    pictures: list[list[np.ndarray]] = [[], [], [], []]
    for seed in range(16):
        renderer = finish(wrt.Renderer(table(ball(material)), **SIZE, seed=seed, layers=("shadow",)), 64)
        picture = renderer.finished()
        whole = wrt.Renderer(table(ball(material), is_caught=False), transparent=True, **SIZE, seed=seed + 1000)
        expected = whole.render(spp=64)[..., :3]
        picture[rare] = expected[rare] = 0.0
        over = picture[..., :3] + (1.0 - picture[..., 3:]) * own[..., :3]
        bare = whole.alpha() * (renderer._caught().coverage == 0.0)
        pictures[0].append(over @ LUMINANCE[:, None])
        pictures[1].append(expected @ LUMINANCE[:, None])
        pictures[2].append(renderer.layers()["shadow"] * own[..., :3] * bare[..., None])
        pictures[3].append(expected * bare[..., None])
    means = [np.mean(each, axis=0) for each in pictures]
    variances = [np.var(each, axis=0, ddof=1) / 16 for each in pictures]
    for name, a, b in (("luminance", 0, 1), ("colours on the ground", 2, 3)):
        test = image_z_test(means[a], variances[a], means[b], variances[b], n_a=16, n_b=16)
        report(name, test.message)
        assert test.agrees(), test.message
    assert (np.abs(own[..., :3] @ LUMINANCE - means[1][..., 0]) > 0.02).mean() > 0.05  # the ball is seen


@pytest.mark.slow
def test_light_through_glass_falls_on_catchers(report):
    """Below a slab is (1 - R) / (1 + R) of the sun's light, and beside it all."""
    slab = wrt.Shape(wrt.box((-1.0, 0.6, -1.0), (1.0, 0.8, 1.0)), wrt.Dielectric(1.5))
    scene = table(slab, light=wrt.DirectionalLight((0.0, -1.0, 0.0), 1.0))
    scene.shapes[0] = dataclasses.replace(scene.shapes[0], material=wrt.Diffuse(1e-3))
    scene.camera = wrt.OrthographicCamera((0.0, 0.5, 0.01), (0.0, 0.0, 0.0), view_height=3.6)
    renderers = [
        wrt.Renderer(scene, **SIZE, seed=k, layers=("shadow", "position", "object"), caustics=True) for k in range(8)
    ]
    layers = [finish(each, 32).layers() for each in renderers]
    shadow = np.array([each["shadow"] for each in layers])
    off = np.abs(layers[0]["position"][..., ::2]).max(axis=2)
    off[layers[0]["object"] == 0] = np.inf
    below = shadow[:, off < 0.6].mean(axis=(1, 2))
    expected = 0.96 / 1.04
    report("share of the light below a slab", below.mean(), expected)
    assert below.std() < 0.02
    assert abs(below.mean() - expected) < 3.5 * below.std(ddof=1) / np.sqrt(8)
    free = (off > 1.4) & (off < 1.7)
    assert free.sum() > 16
    assert abs(shadow[:, free].mean() - 1.0) < 1e-4  # the ground reflects a thousandth, little of it to there


GLASS = wrt.Dielectric(1.5, interior=wrt.Medium(1.0))
BALLS = {
    "mesh": ball(),
    "instance": ball(transform=np.eye(4)),
    "body": ball(GLASS),
    "exact": wrt.Shape(wrt.sphere((0.0, 0.6, 0.0), 0.5, exact=True)),
}


@pytest.mark.parametrize("kind", ["mesh", *(pytest.param(name, marks=pytest.mark.slow) for name in list(BALLS)[1:])])
def test_nothing_is_changed_where_no_shadow_falls(kind, device):
    """A point light on the left, and direct light alone: the shadow is to the right of the ball."""
    light = wrt.PointLight((-3.0, 3.0, 0.5), intensity=20.0)
    scene = table(BALLS[kind], light=light)
    renderer = wrt.Renderer(
        scene, width=64, height=48, max_depth=2, device=device, layers=("shadow", "position", "alpha", "material")
    )
    finish(renderer, 3)
    half = (np.arange(64 * 48) % 2).astype(bool)
    with renderer.film.leaving_out(half, 8):  # as adaptive sampling does
        finish(renderer, 8)
    picture, layers = renderer.finished(), renderer.layers()
    is_ground = (layers["position"][..., 1] == 0.0) & (renderer._caught().coverage == 0.0)
    free = is_ground & (layers["position"][..., 0] < -0.7)
    assert free.sum() > 160
    assert (picture[free] == 0.0).all()
    assert (layers["shadow"][free] == 1.0).all()
    np.testing.assert_array_equal(layers["alpha"], picture[..., 3])
    away = layers["position"] - light.position
    nearest = np.linalg.norm(np.cross(away, np.array([0.0, 0.6, 0.0]) - light.position), axis=2)
    umbra = is_ground & (nearest < 0.2 * np.linalg.norm(away, axis=2))
    assert umbra.sum() > 4
    assert (picture[umbra] == (0.0, 0.0, 0.0, 1.0)).all()
    assert (layers["shadow"][umbra] == 0.0).all()


def test_lamps_light_catchers_and_are_seen(device):
    """They belong to the light that the catchers have of their own, with the shadow of their mesh."""
    lamp = ball(wrt.Emissive(2.0))
    picture = wrt.Renderer(table(lamp), **SIZE, device=device).render(spp=4)
    ground = picture[..., 3] == 0.0
    assert (picture[ground] == 0.0).all()
    assert set(np.unique(picture[..., 3] == 1.0)) == {False, True}
    np.testing.assert_allclose(picture[picture[..., 3] == 1.0][:, :3], 2.0, rtol=1e-6)


def test_what_two_films_give_in_closed_form():
    """Pixels: ground as before, half of red light, added light, black ground, half a shape over shaded ground, none."""
    total = np.array([(0.4, 0.4, 0.4), (0.2, 0.4, 0.4), (0.6, 0.4, 0.4), (0.3, 0.0, 0.0), (0.6, 0.6, 0.6), (0, 0, 0)])
    seen = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 0.0])
    lit = np.array([(*each, 1.0) for each in total])
    lit[4], lit[5] = (0.1, 0.1, 0.1, 0.5), 0.0
    alone = np.array([(0.4, 0.4, 0.4, 1.0)] * 6)
    alone[3], alone[5] = (0.0, 0.0, 0.0, 1.0), 0.0
    found = caught(*(np.float32(each)[None] for each in (total, seen, lit, alone)))
    shadow, added = np.ones((6, 3)), np.zeros((6, 3))
    shadow[1, 0], shadow[2, 0], shadow[4] = 0.5, 1.5, 0.5
    added[2, 0], added[3, 0] = 0.2, 0.3
    foreground = np.zeros((6, 3))
    foreground[4] = 0.5
    expected = Caught(foreground, np.array([0, 0, 0, 0, 0.5, 0]), added, np.array([0] * 6), shadow)
    expected = dataclasses.replace(expected, alpha=np.array([0, 0.5 * LUMINANCE[0], 0, 0, 0.75, 0]))
    for name, value in vars(expected).items():
        np.testing.assert_allclose(getattr(found, name)[0], value, atol=1e-6, err_msg=name)
    # 8-bit codes cannot add light: what is half as bright as white covers half.
    image, alpha = found.for_codes(2.0)
    np.testing.assert_allclose(alpha[0, 1:], (*LUMINANCE[0] * np.array([0.5, 0.4, 0.6]), 0.75, 0.0), atol=1e-6)
    np.testing.assert_allclose(image[0, 2:5, 0], (0.2 * LUMINANCE[0], 0.3 * LUMINANCE[0], 0.5), atol=1e-6)


def test_another_camera_and_other_values_restart_both_films(device):
    other = wrt.PerspectiveCamera((1.0, 2.0, 4.0), (0.0, 0.4, 0.0), fov_degrees=40.0)
    renderer = finish(wrt.Renderer(table(ball()), **SIZE, device=device), 4)
    renderer.image()
    renderer.set_camera(other)
    again = finish(renderer, 2).finished()
    fresh = wrt.Renderer(dataclasses.replace(table(ball()), camera=other), **SIZE, device=device).render(spp=2)
    np.testing.assert_array_equal(again, fresh)
    renderer.set_parameters({"quad#2.emission": (1.0, 2.0, 3.0), "quad.reflectance": (0.1, 0.2, 0.1)})
    again = finish(renderer, 2).finished()
    fresh = wrt.Renderer(renderer.scene, **SIZE, device=device).render(spp=2)
    np.testing.assert_array_equal(again, fresh)


def test_checkpoints_and_crops_need_no_second_film(tmp_path):
    scene = table(ball())
    whole = wrt.Renderer(scene, **SIZE).render(spp=5)
    finish(wrt.Renderer(scene, **SIZE), 2).save_checkpoint(tmp_path / "a.ckpt")
    resumed = finish(wrt.Renderer.resume(tmp_path / "a.ckpt", scene), 5)
    np.testing.assert_array_equal(resumed.finished(), whole)
    cropped = wrt.Renderer(scene, **SIZE, crop=(10, 8, 20, 16)).render(spp=5)
    np.testing.assert_array_equal(cropped, whole[8:16, 10:20])


def test_exposure_is_that_of_the_shapes(tmp_path):
    """Light on the ground is bright, and covers next to nothing."""
    renderer = finish(wrt.Renderer(table(ball()), **SIZE), 1)
    found = renderer._caught()
    bright = dataclasses.replace(found, added=np.float32(50.0 * (found.coverage == 0.0))[..., None].repeat(3, axis=2))
    bright = dataclasses.replace(bright, alpha=np.maximum(found.alpha, np.float32(1e-3)))
    stops = {}
    for name, picture in (("found", found), ("bright", bright)):
        renderer._catchers.caught = lambda *, denoised, picture=picture: picture
        stops[name] = renderer.save(tmp_path / f"{name}.png", exposure="auto").stops
    assert stops["bright"] == stops["found"] != 0.0


@pytest.mark.skipif(importlib.util.find_spec(denoise.PACKAGE) is None, reason="Open Image Denoise has no wheel here")
@pytest.mark.slow
def test_denoising_brings_it_nearer_to_the_truth(report):
    size = {"width": 128, "height": 96}
    truth = wrt.Renderer(table(ball()), **size).render(spp=256)
    noisy, denoised = (wrt.Renderer(table(ball()), **size, seed=1, denoise=on).render(spp=4) for on in (False, True))
    errors = [float(np.sqrt(((each - truth) ** 2).mean())) for each in (noisy, denoised)]
    report("error before and after denoising", errors)
    assert errors[1] < 0.7 * errors[0]
    assert np.abs(denoised[..., 3] - noisy[..., 3])[noisy[..., 3] == 1.0].max() == 0.0


def test_the_command_puts_meshes_on_a_catcher(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    wrt.save_scene(tmp_path / "ball.glb", wrt.Scene(shapes=[ball()]))
    small = ["--size", "48x36", "--spp", "4", "--quiet", "--view", "0,20"]
    assert main(["render", "ball.glb", "--shadow-catcher", *small]) == 0
    with Image.open("ball.png") as image:
        picture = np.asarray(image).astype(int)
    alpha = picture[..., 3]
    assert alpha[0].max() <= 2  # far from the ball
    assert (alpha == 255).mean() > 0.1
    shade = (alpha > 60) & (alpha < 200) & (picture[..., :3].max(axis=2) < 60)
    assert shade.sum() > 20
    assert main(["render", "ball.glb", "--shadow-catcher", "--background", "white", "-o", "white.png", *small]) == 0
    with Image.open("white.png") as image:
        white = np.asarray(image).astype(int)
    assert white.shape == (36, 48, 3)
    assert white[0].min() > 250
    assert white[shade].max() < 250
    (tmp_path / "a.toml").write_text(
        '[[shapes]]\ntype = "box"\nshadow_catcher = true\n[environment]\ntype = "constant"\n'
    )
    for arguments, message in (
        (["a.toml", "--shadow-catcher"], "a.toml: a shadow catcher is put under meshes"),
        (["a.toml", "-o", "a.jpg"], "a.jpg: a JPEG has no alpha"),
        (["a.toml", "--part", "1/2"], "no part of a picture with shadow catchers"),
        (["ball.glb", "--layers", "shadow", "-o", "a.exr"], "the layer 'shadow' needs"),
    ):
        assert main(["render", *arguments, *small[:5]]) == 2
        assert message in capfd.readouterr().err
