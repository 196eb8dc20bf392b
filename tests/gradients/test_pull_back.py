"""Derivatives by what kernels read become derivatives by parameters: the transpose of what the upload does."""

import numpy as np
import pytest

import wrt
from wrt.backend.device import Device
from wrt.gradients.parameters import edited, places_of
from wrt.gradients.places import BendingIndex, Points
from wrt.gradients.sums import DeviceSums
from wrt.scene.materials import MATERIALS
from wrt.upload.scene_data import SceneUpload

QUAD = wrt.quad((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
PIXELS = np.random.default_rng(1).uniform(0.2, 0.8, (5, 7, 3)).astype(np.float32)
GREY = np.repeat(PIXELS[..., :1], 3, axis=2)
FOG = wrt.Medium((0.3, 0.2, 0.5), (0.1, 0.4, 0.2), emission=(0.1, 0.3, 0.2))


def image(pixels=PIXELS, **options):
    return wrt.ImageTexture(pixels, **options)


MORE = {
    "principled": wrt.Principled(
        ior=1.4,
        anisotropy=0.3,
        anisotropy_rotation=0.4,
        transmission=0.6,
        dispersion=0.3,
        film_thickness=300.0,
        coat=0.2,
        coat_roughness=0.1,
        interior=FOG,
        sheen_color=(0.1, 0.2, 0.3),
        sheen_roughness=0.4,
    ),
    "textured": wrt.Principled(
        image(filter="trilinear", factor=(0.5, 1.0, 0.8)), image(channel="b"), image(channel="g"), coat=image(GREY)
    ),
    "sgd": wrt.RoughConductor((0.1, 0.6), distribution="sgd", f0=0.7),
    "bounces": wrt.RoughConductor(0.3, multiple_bounces=True),
    "dispersive": wrt.Dielectric(1.5, 1.1, dispersion=0.4),
    "schlick": wrt.Conductor(f0=image(wrap="clamp")),
    "parts": wrt.TwoSided(wrt.Mix(wrt.Diffuse(0.3), wrt.Glossy(0.5)), wrt.OrenNayar(0.2)),
}
SURFACES = {f"a {name}": cls.example() for name, cls in MATERIALS.items()} | MORE


def scene_with(material=None, **options):
    scene = wrt.Scene(**options)
    scene.add(QUAD, material=material or wrt.Diffuse(), name="it")
    scene.add(QUAD, material=wrt.Diffuse(0.4), emission=(3.0, 1.0, 2.0), name="lamp")
    return scene


def lit_scene():
    scene = scene_with(environment=wrt.ImageEnvironment(PIXELS, scale=3.0))
    lights = (
        wrt.PointLight((0.0, 1.0, 0.0), power=5.0),
        wrt.DirectionalLight((0.0, -1.0, 0.0), (1.0, 2.0, 3.0), angle_degrees=4.0),
        wrt.RectangleLight((0.0, 2.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), radiance=2.0),
        wrt.SpotLight((0.0, 3.0, 0.0), (1.0, -1.0, 0.0), (4.0, 5.0, 6.0), texture=image()),
    )
    for light in lights:
        scene.add_light(light)
    scene.add(QUAD, emission=image(factor=5.0, filter="trilinear"), name="panel")
    return scene


def harmonic_scene():
    coefficients = np.random.default_rng(2).uniform(-0.5, 1.0, (4, 3))
    return scene_with(environment=wrt.SphericalHarmonicsEnvironment(coefficients, scale=2.0))


def arrays_of(data, values):
    """Return what kernels read of a scene by name, in the order of the derivatives."""
    triangles = sum(values.light_counts)
    lights = data.lights.numpy()["value"].copy()
    lights[:triangles] = 0.0  # they follow from the emissions, by which there are derivatives
    found = {"slots": data.slots.numpy()["value"], "emission": data.shapes.numpy()["emission"], "lights": lights}
    found["texels"] = np.zeros((0, 3)) if data.texels is None else data.texels.numpy()
    environment = data.environment
    found["environment"] = environment.radiance[None]
    found["environment_texels"] = np.zeros((0, 3)) if environment.texels is None else environment.texels.numpy()
    media = data.media.numpy()
    found |= {f"media_{name}": media[name] for name in ("absorption", "scattering", "emission")}
    return {name: array.astype(np.float64) for name, array in found.items()}


def assert_transposed(scene):
    """Compare with central differences of a random linear function of what kernels read."""
    built = SceneUpload(scene, Device("cpu")).finish()
    built.values.change(scene)
    rng = np.random.default_rng(7)
    arrays = arrays_of(built.data, built.values)
    # All are positive, or kinks where harmonics are cut off at 0 would count for much.
    sums = {name: rng.uniform(size=array.shape) for name, array in arrays.items()}
    places = {name: place for name, place in places_of(scene).items() if not isinstance(place, Points)}
    materials = built.values.materials
    indices = {}
    for place in places.values():
        if isinstance(place, BendingIndex):
            number = materials.number_of(place.material)
            indices[number] = sums["slots"][materials.first_slots[number] + place.slot].sum()
    device_sums = DeviceSums(built.values, built.data, sums, indices=indices)
    gradients = {name: place.gradient(device_sums) for name, place in places.items()}

    def loss(name, value):
        built.values.change(edited(scene, {name: value}))
        arrays = arrays_of(built.data, built.values)
        return sum(float((sums[key] * array).sum()) for key, array in arrays.items())

    rounding = 2.0**-24 * max(np.abs(sums[key] * array).max(initial=0.0) for key, array in arrays.items())
    for name, place in places.items():
        value = place.value
        assert gradients[name].shape == value.shape
        chosen = list(np.ndindex(value.shape))
        for index in chosen if len(chosen) < 8 else rng.permutation(chosen)[:12]:
            step = np.zeros(value.shape)
            step[tuple(index)] = 0.02 * max(float(value[tuple(index)]), 0.1)
            inward = -1.0 if value[tuple(index)] + step.max() > 1.0 else 1.0
            tolerance = 2e-3 * np.abs(gradients[name]).max() + rounding / step.max()
            # By three values on one side, as some lie at the end of their range: exact for parabolas.
            at = [loss(name, value + k * inward * step) for k in (0.0, 1.0, 2.0)]
            slope = inward * (-1.5 * at[0] + 2.0 * at[1] - 0.5 * at[2]) / step.max()
            assert gradients[name][tuple(index)] == pytest.approx(slope, abs=tolerance), (name, index)
    return set(gradients)


@pytest.mark.parametrize("name", SURFACES)
def test_the_derivative_by_each_field_of_each_material_is_that_of_its_slots(name):
    assert_transposed(scene_with(SURFACES[name]))


def test_the_derivatives_by_lights_environments_and_media():
    names = assert_transposed(lit_scene())
    assert names >= {"environment.texels", "directional.irradiance", "spot.texture.texels", "panel.emission.texels"}
    assert assert_transposed(scene_with(medium=FOG)) >= {
        f"medium.{name}" for name in ("absorption", "scattering", "emission")
    }
    assert assert_transposed(harmonic_scene()) >= {"environment.coefficients"}
    assert "environment.radiance" in assert_transposed(scene_with(environment=wrt.ConstantEnvironment(0.3)))
