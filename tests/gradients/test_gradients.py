"""`Renderer.gradients` against differences of pictures with the same random numbers, and what it refuses."""

import numpy as np
import pytest

import wrt

SMALL = {"width": 16, "height": 12, "sampler": "independent", "max_depth": 4}
SPP = 4


def room():
    """Return a corner whose picture is a polynomial of each parameter: no light is chosen by its power."""
    pixels = np.random.default_rng(1).uniform(0.2, 0.8, (5, 7, 3)).astype(np.float32)
    floor = wrt.Diffuse(wrt.ImageTexture(pixels, filter="trilinear", scale=2.0))
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.5, 1.5, 4.0), (0.0, 0.5, 0.0)))
    scene.add(wrt.quad((-2.0, 0.0, 2.0), (4.0, 0.0, 0.0), (0.0, 0.0, -4.0)), material=floor, name="floor")
    scene.add(wrt.quad((-2.0, 0.0, -2.0), (4.0, 0.0, 0.0), (0.0, 3.0, 0.0)), material=(0.3, 0.5, 0.7), name="wall")
    sign = wrt.quad((-1.0, 0.5, -1.0), (0.5, 0.0, 0.0), (0.0, 0.5, 0.0))
    unlit = wrt.Unlit(0.8)
    for mesh in (sign, sign.translated((1.0, 0.0, 0.0))):
        scene.add(mesh, material=unlit, name="sign")
    scene.environment = wrt.ConstantEnvironment((0.2, 0.3, 0.4))
    scene.add_light(wrt.PointLight((0.0, 2.0, 1.0), (3.0, 2.0, 4.0)))
    return scene


@pytest.fixture(scope="module")
def renderer():
    return wrt.Renderer(room(), **SMALL)


def image_with(renderer, values, spp=SPP):
    renderer.set_parameters(values)
    return renderer.render(spp=spp).astype(np.float64)


def test_gradients_are_those_of_the_picture(renderer):
    values = wrt.parameters(renderer)
    assert list(values) == [
        *("wall.reflectance", "sign.color", "point.intensity", "floor.reflectance.texels", "environment.radiance"),
        *(f"{name}.vertices" for name in ("floor", "wall", "sign", "sign#2")),
    ]
    values = {name: value for name, value in values.items() if "vertices" not in name}
    d_image = np.random.default_rng(2).normal(size=(12, 16, 3))
    gradients = renderer.gradients(d_image, spp=SPP)
    assert list(gradients) == list(values)
    rng = np.random.default_rng(3)
    for name, value in values.items():
        assert gradients[name].shape == value.shape
        assert gradients[name].dtype == np.float32
        chosen = list(np.ndindex(value.shape))
        for index in chosen if len(chosen) < 8 else rng.permutation(chosen)[:6]:
            step = np.zeros_like(value)
            step[tuple(index)] = 0.02
            above, below = (image_with(renderer, {**values, name: value + sign * step}) for sign in (1.0, -1.0))
            slope = float((d_image * (above - below)).sum()) / 0.04
            tolerance = 1e-3 * float(np.abs(gradients[name]).max())
            assert gradients[name][tuple(index)] == pytest.approx(slope, abs=tolerance), (name, index)


def test_a_name_that_the_picture_does_not_depend_on_is_told(renderer):
    scene = room()
    scene.add(wrt.quad((0.0, 0.0, 9.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)), material=(0.5, 0.5, 0.5), name="behind")
    hidden = wrt.Renderer(scene, **{**SMALL, "max_depth": 1})
    names = ["behind.reflectance", "environment.radiance"]
    with pytest.warns(wrt.InputWarning, match=r"does not depend on behind\.reflectance: all derivatives are 0"):
        gradients = hidden.gradients(np.ones((12, 16, 3)), names, spp=1)
    assert gradients["environment.radiance"].all()


def test_gradients_leave_the_picture_and_take_names_and_seeds(renderer):
    renderer.set_parameters({})
    image = renderer.render(spp=SPP)
    d_image = np.ones_like(image)
    chosen = renderer.gradients(d_image, ["floor.reflectance.texels"], spp=2)
    assert list(chosen) == ["floor.reflectance.texels"]
    np.testing.assert_array_equal(renderer.image(), image)
    alike, other = (renderer.gradients(d_image, chosen, spp=2, seed=seed) for seed in (renderer.seed, 5))
    np.testing.assert_array_equal(alike["floor.reflectance.texels"], chosen["floor.reflectance.texels"])
    assert not np.array_equal(other["floor.reflectance.texels"], chosen["floor.reflectance.texels"])


@pytest.mark.slow
def test_a_loss_that_squares_the_noise_is_biased_by_it_unless_gradients_have_another_seed():
    """At the right emission e the derivative of Σ (I − T)² is 0; with the noise of I it is 2/e Σ Var I."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 1.0, 3.0), (0.0, 0.3, 0.0)))
    scene.add(wrt.quad((-1.0, 0.0, 1.0), (2.0, 0.0, 0.0), (0.0, 0.0, -2.0)), material=(0.5, 0.5, 0.5), name="floor")
    scene.add(wrt.quad((-0.5, 1.5, -0.5), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)), emission=5.0, name="lamp")
    renderer = wrt.Renderer(scene, **{**SMALL, "max_depth": 2})
    target = renderer.render(spp=4096)
    variance = renderer.variance() * 4096.0
    same, other = [], []
    for seed in range(100):
        renderer.set_parameters({})
        renderer.seed = seed
        d_image = 2.0 * (renderer.render(spp=1) - target)
        for found, of_gradient in ((same, seed), (other, 1000 + seed)):
            gradients = renderer.gradients(d_image, "lamp.emission", spp=1, seed=of_gradient)
            found.append(float(gradients["lamp.emission"].sum()))
    for found, expected in ((same, 2.0 * variance.sum() / 5.0), (other, 0.0)):
        error = np.std(found, ddof=1) / np.sqrt(len(found))
        assert abs(np.mean(found) - expected) < 4.0 * error  # p = 6e-5
        assert error < 0.1 * variance.sum()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.zeros((16, 12, 3)),), "d_image must have the shape (12, 16, 3), not (16, 12, 3)"),
        ((np.full((12, 16, 3), np.inf),), "d_image must be finite"),
        ((np.zeros((12, 16, 3)), ["floor.reflectance"]), "there is no parameter 'floor.reflectance' (did you mean 'fl"),
        ((np.zeros((12, 16, 3)), 3), "names must be names of parameters, not 3"),
    ],
)
def test_errors(renderer, arguments, message):
    with pytest.raises(wrt.InputError) as error:
        renderer.gradients(*arguments)
    assert str(error.value).startswith(message)
