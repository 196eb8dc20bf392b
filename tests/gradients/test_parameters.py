"""Parameters of a scene: their names and values, and setting them has the bits of a new Renderer."""

import dataclasses

import numpy as np
import pytest
from support.small_scenes import assert_same_arrays, finish

import wrt
from wrt.rendering import renderer as renderers

CAMERA = wrt.PerspectiveCamera((0.0, 1.0, 5.0), (0.0, 0.5, 0.0))
PANEL, SLIDE = np.linspace(0.1, 1.0, 12).reshape(2, 2, 3), np.linspace(0.0, 1.0, 18).reshape(3, 2, 3)
SKY = np.random.default_rng(1).random((4, 8, 3))
CODES = np.random.default_rng(3).integers(0, 256, (40, 33, 3))
SMALL = {"width": 24, "height": 18, "sampler": "independent", "max_depth": 6}


def rich_scene(
    grey=0.7,
    ior=1.4,
    tint=(0.5, 0.2, 0.1),
    checks=CODES / 255.0,
    roughness=0.4,
    alpha=(0.2, 0.3),
    eta=(0.2, 0.9, 1.1),
    base=0.3,
    lamp=(4.0, 3.0, 2.0),
    panel=PANEL,
    key=(3.0, 2.0, 1.0),
    power=(9.0, 9.0, 9.0),
    slide=SLIDE,
    sky=SKY,
    fog=(0.1, 0.2, 0.3),
):
    """Return a scene with values of every kind; some images are equal, or stored as codes."""

    def image(pixels, **options):
        return wrt.ImageTexture(np.asarray(pixels, np.float32), **options)

    scene = wrt.Scene(camera=CAMERA, environment=wrt.ImageEnvironment(np.asarray(sky, np.float32), scale=0.5))
    bumps = wrt.NormalMap(np.full((4, 4, 3), (0.6, 0.5, 0.9), np.float32), filter=True)
    rough = image(np.full((3, 5, 3), roughness))
    floor = wrt.Principled(image(checks, filter="trilinear"), roughness=rough, normal_map=bumps, coat=0.5)
    wall = wrt.Mix(wrt.Diffuse(tint), wrt.RoughConductor(alpha, eta=eta), weight=0.3)
    scene.add(wrt.quad((-3.0, 0.0, 3.0), (6.0, 0.0, 0.0), (0.0, 0.0, -6.0)), material=floor, name="floor")
    scene.add(wrt.quad((-2.0, 0.0, -2.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0)), material=wall, name="wall")
    scene.add(wrt.quad((0.0, 0.0, -2.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0)), material=wall, name="other")
    jar = wrt.Dielectric(ior, specular_transmittance=grey, interior=wrt.Medium(absorption=fog))
    scene.add(wrt.sphere((0.0, 0.5, 0.0), 0.4), material=jar, name="jar")
    painted = wrt.Diffuse(image(np.full((3, 5, 3), base)))
    scene.add(wrt.quad((1.0, 0.0, 0.5), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)), material=painted, name="board")
    scene.add(wrt.quad((-1.0, 3.0, -1.0), (2.0, 0.0, 0.0), (0.0, 0.0, 2.0)), emission=lamp, name="lamp")
    glowing = image(panel, factor=3.0)
    scene.add(wrt.quad((-3.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)), emission=glowing, name="lamp")
    scene.add_light(wrt.PointLight((1.0, 2.0, 3.0), power=power))
    scene.add_light(wrt.PointLight((-1.0, 2.0, 3.0), key, name="key"))
    scene.add_light(wrt.SpotLight((0.0, 3.0, 3.0), (0.0, -1.0, -1.0), 20.0, texture=image(slide)))
    return scene


CHANGES = {
    "jar.specular_transmittance": ("grey", (0.9, 0.8, 0.3)),
    "jar.ior": ("ior", 1.25),
    "wall.first.reflectance": ("tint", (0.1, 0.6, 0.7)),
    "floor.base_color.texels": ("checks", np.random.default_rng(4).random((40, 33, 3))),
    "floor.roughness.texels": ("roughness", np.full((3, 5), 0.125)),
    "wall.second.alpha": ("alpha", (0.5, 0.25)),
    "wall.second.eta": ("eta", (1.5, 0.3, 0.6)),
    "board.reflectance.texels": ("base", np.full((3, 5, 3), 0.625)),
    "lamp.emission": ("lamp", (1.0, 5.0, 2.0)),
    "lamp#2.emission.texels": ("panel", np.linspace(2.0, 0.5, 12).reshape(2, 2, 3)),
    "key.intensity": ("key", (0.0, 4.0, 8.0)),
    "point.power": ("power", (2.0, 3.0, 4.0)),
    "spot.texture.texels": ("slide", np.linspace(1.0, 2.0, 18).reshape(3, 2, 3)),
    "environment.texels": ("sky", np.random.default_rng(5).random((4, 8, 3))),
    "jar.interior.absorption": ("fog", (2.0, 0.0, 1.0)),
}


def expected_argument(name, value):
    return value[..., None] if name == "floor.roughness.texels" else value


def film_of(scene, device="cpu"):
    return finish(wrt.Renderer(scene, device=device, **SMALL), 2).film.state()


def test_setting_parameters_has_the_bits_of_a_new_renderer_without_building(device, monkeypatch):
    renderer = wrt.Renderer(rich_scene(), device=device, **SMALL)
    before = finish(renderer, 2).film.state()
    monkeypatch.setattr(renderers, "SceneUpload", None)  # nothing is built
    kept = renderer._built.data.bvh.nodes, renderer._kernel.scalar
    values = wrt.parameters(renderer)
    arguments = {}
    for name, (argument, value) in CHANGES.items():  # first one by one, each on top of those before
        renderer.set_parameters({name: value})
        arguments[argument] = expected_argument(name, value)
        np.testing.assert_array_equal(wrt.parameters(renderer)[name], np.asarray(value, np.float32), err_msg=name)
    assert (renderer._built.data.bvh.nodes, renderer._kernel.scalar) == kept
    after = finish(renderer, 2).film.state()
    renderer.set_parameters(values)  # and back, all at once
    assert_same_arrays(finish(renderer, 2).film.state(), before)
    monkeypatch.undo()
    expected = film_of(rich_scene(**arguments), device)
    assert not np.array_equal(before["total"], expected["total"])
    assert_same_arrays(after, expected)
    assert_same_arrays(film_of(renderer.scene, device), before)


@pytest.mark.parametrize("name", CHANGES)
def test_each_parameter_alone_has_the_bits_of_a_new_renderer(name):
    argument, value = CHANGES[name]
    renderer = wrt.Renderer(rich_scene(), **SMALL)
    before = finish(renderer, 2).film.state()
    renderer.set_parameters({name: value})
    expected = film_of(rich_scene(**{argument: expected_argument(name, value)}))
    assert not np.array_equal(before["total"], expected["total"])
    assert_same_arrays(finish(renderer, 2).film.state(), expected)


def test_names_and_shapes():
    shapes = {name: value.shape for name, value in wrt.parameters(rich_scene()).items()}
    expected = {name: np.shape(value) for name, (_, value) in CHANGES.items()}
    assert expected.items() <= shapes.items()
    assert [name for name in shapes if name.startswith(("wall", "other"))] == [
        "wall.first.reflectance",
        *("wall.second.alpha", "wall.second.eta", "wall.second.k", "wall.second.reflectance"),
        *("wall.vertices", "other.vertices"),
    ]
    assert shapes["floor.coat"] == ()
    assert [name for name in shapes if name.startswith("point.")] == ["point.power"]  # the amount that was given
    # A coat of 0 is another kernel, and a table is made from the roughness of a coat.
    for material, missing in ((wrt.Principled(), "coat"), (wrt.RoughPlastic(), "alpha"), (wrt.Null(), "priority")):
        scene = wrt.Scene([wrt.Shape(wrt.box(), material, name="it")])
        assert f"it.{missing}" not in wrt.parameters(scene)


def test_images_and_channels_are_one_parameter_where_they_share_an_array():
    pixels = np.random.default_rng(0).random((2, 3, 3)).astype(np.float32)
    both = wrt.ImageTexture(pixels)
    packed = [dataclasses.replace(both, channel=channel) for channel in "gb"]
    metal = wrt.Principled(both, roughness=packed[0], metallic=packed[1])
    surfaces = [wrt.Diffuse(both), wrt.Diffuse(wrt.ImageTexture(pixels)), dataclasses.replace(metal, base_color=0.5)]
    scene = wrt.Scene([wrt.Shape(wrt.quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), each, name="it") for each in surfaces])
    texels = {name: value.shape for name, value in wrt.parameters(scene).items() if "texels" in name}
    assert texels == {"it.reflectance.texels": (2, 3, 3), "it#2.reflectance.texels": (2, 3, 3)}
    scene.shapes = scene.shapes[2:]
    texels = {name: value.shape for name, value in wrt.parameters(scene).items() if "texels" in name}
    assert texels == {"it.metallic.texels": (2, 3), "it.roughness.texels": (2, 3)}


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"wall.first.reflectanc": 0.5}, "there is no parameter 'wall.first.reflectanc' (did you mean 'wall.first.r"),
        ({"wall.first.reflectance": 0.5}, "wall.first.reflectance must have the shape (3,), not ()"),
        ({"wall.first.reflectance": (0.5, 0.5, 1.5)}, "wall.first.reflectance: reflectance[2] must be at most 1"),
        ({"wall.second.alpha": (0.5, np.nan)}, "wall.second.alpha must be finite"),
        ({"floor.roughness.texels": np.full((3, 5), -1.0)}, "floor.roughness.texels: texture image: pixels must be fi"),
        ({"floor.roughness.texels": np.full((3, 5), 1e300)}, "floor.roughness.texels must be finite"),
        ({"floor.coat": 0.0}, "these values need another kernel (models ("),
        ({"lamp.emission": (0.0, 0.0, 0.0)}, "lamp.emission must stay above 0 in a channel"),
        ({"point.power": (0.0, -1.0, 0.0)}, "point.power[1] must be at least 0"),
        ({"environment.texels": np.full((4, 8, 3), -1.0)}, "environment.texels: environment environment: pixels must"),
        ({"jar.interior.absorption": "red"}, "jar.interior.absorption must be an array of numbers"),
    ],
)
def test_errors_name_the_parameter_and_change_nothing(values, message, shared_renderer):
    renderer = shared_renderer
    before = {name: array.numpy().tobytes() for name, array in arrays_of(renderer).items()}
    with pytest.raises(wrt.InputError) as error:
        renderer.set_parameters({"jar.specular_transmittance": (0.5, 0.5, 0.5), **values})
    assert str(error.value).startswith(message)
    assert {name: array.numpy().tobytes() for name, array in arrays_of(renderer).items()} == before


def test_what_has_no_parameters(shared_renderer):
    assert wrt.parameters(wrt.Scene()) == {}
    with pytest.raises(wrt.InputError, match=r"those of a wrt\.Scene or a wrt\.Renderer, not of a str"):
        wrt.parameters("still-life")
    with pytest.raises(wrt.InputError, match="must be a dictionary by the names of parameters, not a list"):
        shared_renderer.set_parameters([("jar.specular_transmittance", 0.5)])


def arrays_of(renderer):
    data = renderer._built.data
    return {name: getattr(data, name) for name in ("slots", "texels", "lights", "shapes", "media", "materials")}


@pytest.fixture(scope="module")
def shared_renderer():
    return wrt.Renderer(rich_scene(), **SMALL)


def test_what_has_no_derivative_has_no_name():
    """The indices of channels that part."""
    scene = wrt.Scene()
    for material in (wrt.Dielectric(1.5, dispersion=4.0), wrt.RoughDielectric(1.5, alpha=0.3, dispersion=4.0)):
        scene.add(wrt.quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), material=material, name=type(material).__name__)
    names = set(wrt.parameters(scene))
    assert "Dielectric.specular_transmittance" in names
    assert "RoughDielectric.alpha" in names
    assert not any("ior" in name or "dispersion" in name for name in names)
