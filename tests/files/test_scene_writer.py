"""A scene that is written and read again is the same scene, to the bit."""

import dataclasses
import tempfile
from pathlib import Path

import numpy as np
import pytest

import wrt
from wrt.rendering.checkpoint import scene_fingerprint
from wrt.scene.environment import SphericalHarmonicsEnvironment, SunSkyEnvironment
from wrt.scene.materials import MATERIALS
from wrt.scene.medium import Medium

RNG = np.random.default_rng(4)
PIXELS = RNG.random((3, 4, 3)).astype(np.float32)
WOOD = wrt.ImageTexture(PIXELS, "wood", channel="g", factor=0.7, wrap=("clamp", "mirror"), filter="nearest", cutoff=0.1)
PLACE = np.array([[0.3, 0.1, 0, 1 / 3], [0, 0.7, 0.2, 0.1], [0, 0, -1.3, 7], [0, 0, 0, 1]])


def again(scene: wrt.Scene, folder: Path) -> wrt.Scene:
    file = Path(tempfile.mkdtemp(dir=folder)) / "scene.toml"
    wrt.save_scene(file, scene)
    return wrt.load(file)


def assert_same(a: wrt.Scene, b: wrt.Scene) -> None:
    assert scene_fingerprint(a) == scene_fingerprint(b)
    assert a.settings == b.settings
    assert [shape.name for shape in a.shapes] == [shape.name for shape in b.shapes]
    # What is shared stays so: that decides how it is kept on the device.
    for field in ("mesh", "material"):
        numbers = [
            [[id(getattr(s, field)) for s in scene.shapes].index(id(getattr(s, field))) for s in scene.shapes]
            for scene in (a, b)
        ]
        assert numbers[0] == numbers[1], field


@pytest.mark.parametrize("name", ["cornell-box", "still-life"])
def test_built_in_scenes(name, tmp_path):
    scene = wrt.load(name)
    assert_same(scene, again(scene, tmp_path))


def materials() -> list[wrt.Material]:
    """Return every material as it comes, and with values of every kind."""
    water, milk = Medium.from_color((0.3, 0.5, 0.9), 0.37), Medium((0.1, 0.2, 0.3), (1.0, 2.0, 1 / 3), 0.3, 0.2)
    bumps = wrt.NormalMap(PIXELS, scale=0.3, filter=True, wrap="clamp")
    made = [cls.example() for cls in MATERIALS.values() if cls not in (wrt.Mix, wrt.TwoSided)]
    made += [
        wrt.Diffuse(wrt.VertexColor(factor=0.4), opacity=WOOD, normal_map=bumps),
        wrt.Conductor(metal="gold"),
        wrt.RoughConductor(WOOD, eta=(0.2, 0.9, 1.1), k=(3.9, 2.4, 2.1), distribution="beckmann"),
        wrt.Dielectric(1.33, interior=water, priority=3),
        wrt.RoughDielectric("diamond", interior=milk),
        wrt.Principled(WOOD, ior=1.7, transmission=0.4, interior=water, emission=(1.0, 2.0, 3.0), anisotropy=0.3),
    ]
    coat = wrt.NormalMap(PIXELS, uv_scale=(2.0, 0.5), uv_rotation_degrees=30.0, uv_offset=(0.1, 0.2), uv_set=1)
    made.append(wrt.Principled(coat=0.5, coat_normal_map=coat))
    mix = wrt.Mix(made[0], wrt.Dielectric(1.33), WOOD)
    return [*made, mix, wrt.TwoSided(made[1], mix), wrt.Emissive(WOOD), wrt.Unlit(WOOD)]


def test_every_kind_of_value_is_kept(tmp_path):
    scene = wrt.Scene(settings=wrt.RenderSettings(17, 13, 3, 9, "box", "sobol", 0.5, (1, 2, 9, 8)))
    quad = wrt.quad((0, 0, 0), (1, 0, 0.2), (0, 1, 1 / 3))
    colored = dataclasses.replace(quad, colors=RNG.random((4, 3)).astype(np.float32))
    for number, material in enumerate(materials()):
        mesh = colored if number % 2 else quad
        scene.add(mesh.translated((number, 0, 0)), material=material, name=f"nr {number}")
    scene.add(quad, emission=WOOD, two_sided_emission=True, double_sided=False, edges=False, name="screen")
    scene.add(quad, material=wrt.Diffuse(0.3), transform=PLACE, name="placed", shadow_catcher=True)
    for k in range(3):
        scene.add(quad, material=scene.shapes[0].material, transform=PLACE + k * np.eye(4, k=3), name="copies")
    spin = wrt.Motion.rotation((0, 1, 0.3), 500.0, (1.0, 2.0, 1 / 3), (0.0, 0.7), (0, 1, 0))
    scene.add(quad, transform=spin, name="spinning")
    changes = wrt.Deformation(np.array([0.0, 0.3, 1.0]), RNG.random((3, 4, 3)).astype(np.float32))
    scene.add(quad, deformation=changes, transform=PLACE, name="changing")
    scene.medium = Medium(0.01, 0.02, 0.5)
    scene.environment = wrt.ImageEnvironment(PIXELS, 0.3, 33.3)
    scene.camera = wrt.PerspectiveCamera(
        (0, 1, 1 / 3),
        fov_degrees=33.3,
        shutter_close=0.5,
        motion=wrt.Motion.translation((0, 0.1, 0)),
        aperture_radius=0.1,
    )
    assert_same(scene, again(scene, tmp_path))


def test_lights_cameras_and_environments(tmp_path):
    scene = wrt.Scene()
    scene.add(wrt.quad((0, 0, 0), (1, 0, 0), (0, 1, 0)))
    scene.lights = [
        wrt.PointLight((0, 1, 2), power=(1.0, 2.0, 1 / 3), name="key"),
        wrt.SpotLight((0, 1, 2), (1, 2, 3), intensity=7.0, outer_degrees=60.0, texture=WOOD, up=(1, 0, 1 / 3)),
        wrt.ProjectorLight((0, 1, 2), (1, 2, 3), (0, 0, 1 / 3), texture=WOOD, color=(1, 2, 1 / 3), fov_degrees=33.3),
        wrt.DirectionalLight((1, 2, 3), color=0.3, angle_degrees=0.53),
        wrt.RectangleLight((0, 0, 0), (1, 0, 0), (0, 1 / 3, 0), power=3.0, two_sided=True),
        wrt.DiskLight((0, 0, 0), (0.3, 1, 0), 0.7, radiance=(1, 2, 3)),
        wrt.SphereLight((0, 0, 0), 1 / 3, power=(1, 2, 3)),
    ]
    environments = [
        wrt.ConstantEnvironment((0.1, 0.2, 1 / 3)),
        SunSkyEnvironment(),
        SphericalHarmonicsEnvironment(RNG.random((9, 3))),
        None,
    ]
    cameras = [
        wrt.OrthographicCamera(view_height=1 / 3, aperture="polygon", aperture_radius=0.1),
        wrt.PanoramaCamera(horizontal_degrees=100.0),
        wrt.FisheyeCamera(),
        None,
    ]
    for environment, camera in zip(environments, cameras, strict=True):
        scene.environment, scene.camera = environment, camera
        assert_same(scene, again(scene, tmp_path))
