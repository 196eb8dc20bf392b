"""Light groups: layers of the light of some lights each, whose sum is the picture."""

import dataclasses

import numpy as np
import OpenEXR
import pytest
from scipy import stats
from support.covering_kernels import covering, render_by
from support.small_scenes import assert_same_arrays, finish
from support.statistics import sidak, two_sample_z
from support.wide_scenes import differences, needs_lanes

import wrt
from wrt.errors import InputError
from wrt.rendering.merge import merge
from wrt.upload.accel import instancing

SIZE = {"width": 24, "height": 18, "sampler": "independent", "max_depth": 8, "threads": 2}
GROUPED = {**SIZE, "layers": ("light_groups",)}


@pytest.fixture(autouse=True)
def _three_kernels(monkeypatch):
    """One for each of light groups, of clamped ones, and of pictures without."""
    monkeypatch.setattr(instancing, "WORTH_SHARING", 0)  # the beads are instances
    kernel = covering("dielectric", "diffuse", "null", media="scattering", instances="still", exact="spheres")

    def covers(features):
        of_picture = {name: getattr(features, name) for name in ("light_groups", "clamped", "caustics")}
        return dataclasses.replace(kernel, **of_picture)

    render_by(covers, monkeypatch)


def all_lights(only: str | None = None) -> wrt.Scene:
    """Return a room with each kind of light, a textured lamp, instances, glass and a glowing fog.

    With `only`, all lights of other groups are black.
    """

    def of(group, amount):
        return np.multiply(amount, only in (None, group or "rest")), {"group": group}

    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 1.4, 4.5), (0.0, 0.7, 0.0)))
    scene.add(wrt.quad((-3.0, 0.0, 3.0), (6.0, 0.0, 0.0), (0.0, 0.0, -6.0)), material=wrt.Diffuse(0.7))
    scene.add(wrt.quad((-3.0, 0.0, -2.0), (6.0, 0.0, 0.0), (0.0, 4.0, 0.0)), material=wrt.Diffuse(0.6))
    scene.add(wrt.sphere((-0.7, 0.5, 0.2), 0.5, subdivisions=2), material=wrt.Dielectric(1.5))
    image = np.random.default_rng(1).random((4, 4, 3)).astype(np.float32)

    amount, group = of("lamp", 6.0)
    lamp = wrt.quad((-1.0, 2.4, -1.0), (2.0, 0.0, 0.0), (0.0, 0.0, 2.0))
    emission = wrt.ImageTexture(image, factor=(float(amount),) * 3) if amount else 0.0
    scene.shapes.append(wrt.Shape(lamp, wrt.Diffuse(0.2), emission, **group))
    amount, group = of("beads", (1.0, 3.0, 1.0))
    bead = wrt.sphere((0.0, 0.0, 0.0), 0.1, exact=True)
    for x in (0.3, 0.6, 0.9):
        place = np.eye(4)
        place[:3, 3] = x, 0.2 + x, 0.4
        scene.shapes.append(wrt.Shape(bead, wrt.Diffuse(0.5), tuple(amount), transform=place, **group))
    amount, group = of(None, (0.0, 0.2, 0.4))
    glow = wrt.Null(interior=wrt.Medium(0.1, 0.3, emission=tuple(amount)))
    scene.add(wrt.box((0.4, 0.1, -0.6), (1.2, 0.9, 0.2)), material=glow)

    def light(cls, *arguments, amount, group, **options):
        amount, name = of(group, amount)
        return cls(*arguments, tuple(np.broadcast_to(amount, 3)), **options, **name)

    down = (0.3, -1.0, 0.1)
    scene.lights = [
        light(wrt.PointLight, (-1.5, 1.5, 1.0), amount=(2.0, 0.5, 0.5), group="bulbs"),
        light(wrt.SpotLight, (1.5, 2.0, 1.0), (-0.6, -1.0, -0.4), amount=(1.0, 2.0, 4.0), group="bulbs"),
        light(wrt.DirectionalLight, down, amount=0.2, group="sun"),
        light(wrt.DirectionalLight, (0.0, -0.3, 1.0), amount=(0.5, 0.4, 0.1), group="sun", angle_degrees=20.0),
        light(wrt.SphereLight, (-1.3, 0.9, -1.0), 0.3, amount=(0.0, 2.0, 3.0), group="shapes"),
        light(wrt.DiskLight, (1.6, 1.0, -1.0), (-1.0, 0.0, 1.0), 0.4, amount=2.0, group="shapes"),
        light(wrt.PointLight, (0.0, 1.5, 1.0), amount=(1.0, 0.3, 1.0), group=None),
    ]
    amount, group = of("sky", 1.0)
    scene.environment = wrt.ImageEnvironment(image, scale=float(amount), **group)
    return scene


GROUPS = ("lamp", "beads", "bulbs", "sun", "shapes", "sky")
NAMES = ("light_lamp", "light_beads", "light_bulbs", "light_sun", "light_shapes", "light_sky", "light_rest")


def assert_sum_is_the_picture(renderer):
    """The sum of the layers differs by rounding of the float32 sums along a path alone."""
    layers, image = renderer.layers(), renderer.image()
    assert tuple(layers) == NAMES
    np.testing.assert_allclose(sum(layer.astype(np.float64) for layer in layers.values()), image, rtol=3e-6)
    assert all(layer.any() for layer in layers.values())


def test_groups_add_up_to_the_picture_whose_bits_they_leave_alone():
    scene = all_lights()
    renderer = finish(wrt.Renderer(scene, **GROUPED), 3, 16)
    np.testing.assert_array_equal(renderer.image(), finish(wrt.Renderer(scene, **SIZE), 16).image())
    assert_sum_is_the_picture(renderer)


@pytest.mark.slow
def test_groups_are_clamped_as_the_picture_is():
    renderer = finish(wrt.Renderer(all_lights(), **GROUPED, clamp_indirect=0.05), 16)
    assert_sum_is_the_picture(renderer)


def blocks(image):
    """Return the means of nine parts of a picture, as one row of numbers."""
    return image.astype(np.float64).reshape(3, 6, 3, 8, 3).mean(axis=(1, 3)).ravel()


@pytest.mark.slow
def test_each_group_is_the_picture_of_its_lights_alone():
    seeds = range(1, 17)
    runs = [finish(wrt.Renderer(all_lights(), seed=seed, **GROUPED), 12).layers() for seed in seeds]
    values = []
    for name in NAMES:
        group = np.array([blocks(layers[name]) for layers in runs])
        scene = all_lights(only=name.removeprefix("light_"))
        alone = np.array([blocks(finish(wrt.Renderer(scene, seed=100 + seed, **SIZE), 12).image()) for seed in seeds])
        n = len(seeds)
        a, b = group.var(axis=0, ddof=1) / n, alone.var(axis=0, ddof=1) / n
        values.append(two_sample_z(group.mean(axis=0), a, alone.mean(axis=0), b, n_a=n, n_b=n))
    p = 2.0 * stats.norm.sf(np.abs(values))
    assert p.min() > sidak(1e-3, p.size)


@needs_lanes
@pytest.mark.machinery
@pytest.mark.parametrize("caustics", [False, True])
def test_wide_kernels_leave_the_same_bits(caustics):
    assert differences(all_lights(), **{**GROUPED, "threads": 1, "caustics": caustics}) == []


def test_checkpoints_and_parts_hold_groups(tmp_path):
    whole = finish(wrt.Renderer(all_lights(), **GROUPED), 4)
    begun = finish(wrt.Renderer(all_lights(), **GROUPED), 2)
    begun.save_checkpoint(tmp_path / "a.ckpt")
    resumed = finish(wrt.Renderer.resume(tmp_path / "a.ckpt", all_lights()), 4)
    assert_same_arrays(whole.layers(), resumed.layers())
    merged = merge([wrt.Renderer(all_lights(), **GROUPED).part(n, 2, spp=4) for n in (1, 2)])
    assert_same_arrays(whole.layers(), merged.layers())

    other = all_lights()
    other.lights[0] = dataclasses.replace(other.lights[0], group="sun")
    with pytest.raises(InputError, match="the scene's light groups"):
        wrt.Renderer.resume(tmp_path / "a.ckpt", other)


def test_files_hold_groups(tmp_path):
    wrt.save_scene(tmp_path / "scene.toml", all_lights())
    scene = wrt.load(tmp_path / "scene.toml")
    assert scene.light_groups == GROUPS
    assert [light.group for light in scene.lights] == [light.group for light in all_lights().lights]
    renderer = finish(wrt.Renderer(all_lights(), **GROUPED), 1)
    renderer.save(tmp_path / "scene.exr")
    channels = OpenEXR.File(str(tmp_path / "scene.exr"), separate_channels=True).channels()
    for name, layer in renderer.layers().items():
        for k, channel in enumerate("RGB"):
            np.testing.assert_array_equal(channels[f"{name}.{channel}"].pixels, layer[..., k])


def test_the_sun_of_a_sky_is_in_its_group():
    scene = all_lights(only="day")
    scene.environment = wrt.SunSkyEnvironment(group="day")
    layers = finish(wrt.Renderer(scene, **GROUPED), 1).layers()
    assert [name for name, layer in layers.items() if layer.any()] == ["light_day"]


@pytest.mark.parametrize("integrator", ["whitted", "ao", "aov"])
def test_other_integrators_refuse_groups(integrator):
    with pytest.raises(InputError, match="no layers of light groups"):
        wrt.Renderer(all_lights(), **GROUPED, integrator=integrator)


def test_impossible_groups_are_refused():
    scene = all_lights()
    scene.lights = [wrt.PointLight((0.0, 1.0, k), 1.0, group=f"light {k}") for k in range(13)]
    with pytest.raises(InputError, match="16 light groups, and a picture at most 15"):
        wrt.Renderer(scene, **GROUPED)
    for name in ("", "a\nb", 3, "a" * 65):
        with pytest.raises(InputError, match="group must be a name"):
            wrt.PointLight((0.0, 1.0, 0.0), 1.0, group=name)
