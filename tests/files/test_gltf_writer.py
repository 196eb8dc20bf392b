"""A scene written as GLB and read back is the same, as far as glTF holds it."""

import dataclasses
import warnings
from pathlib import Path

import numpy as np
import pytest
from support.bsdfs import FLAT
from support.mesh_files import check_values, values_of
from support.meshes import area_vector
from support.outputs import run
from support.same_scenes import differences

import wrt
from wrt.errors import InputError
from wrt.io.load_mesh import load_file
from wrt.scene.srgb import of_codes

RNG = np.random.default_rng(5)
CODES = RNG.integers(0, 256, (6, 5, 3))


def picture(*, linear: bool) -> np.ndarray:
    """Return pixels that an image of eight bits holds."""
    return of_codes(linear=linear)[CODES]


COLORS = wrt.ImageTexture(
    picture(linear=False), scale=(2.0, 0.5), rotation_degrees=30.0, offset=(0.25, -0.5), wrap=("mirror", "clamp")
)
LAID = {"scale": COLORS.scale, "rotation_degrees": 30.0, "offset": COLORS.offset, "wrap": COLORS.wrap}
NUMBERS = wrt.ImageTexture(picture(linear=True), channel="g", **LAID)
QUAD = wrt.quad((0, 0, 0), (1, 0, 0), (0, 1, 0))
BUMPS = wrt.NormalMap(np.maximum(picture(linear=True), np.float32([0, 0, 0.5])), 0.5)

MATERIALS = {
    "textured": wrt.Principled(dataclasses.replace(COLORS, factor=(0.5, 1.0, 0.25)), roughness=NUMBERS),
    "glass": wrt.Principled(
        1.0, roughness=0.0, transmission=1.0, ior=1.25, interior=wrt.Medium.from_color((0.5, 0.75, 1.0), 0.5)
    ),
    "soap": wrt.Principled(
        film=wrt.ImageTexture(picture(linear=True), channel="g"), film_thickness=350.0, film_ior=1.5
    ),
    "sheet": wrt.Principled(0.5, transmission=0.5, thin_walled=True, specular=0.5, specular_color=(1.5, 1.0, 0.5)),
    "layers": wrt.Principled(coat=0.5, coat_roughness=0.25, sheen_color=(0.5, 0.25, 0.0), sheen_roughness=0.5),
    "brushed": wrt.Principled(metallic=1.0, anisotropy=0.5, anisotropy_rotation=0.75),
    "lamp": wrt.Principled(0.0, specular=0.0, emission=(8.0, 4.0, 2.0)),
    "screen": wrt.Principled(0.0, emission=wrt.ImageTexture(picture(linear=False) / picture(linear=False).max())),
    "veil": wrt.Principled(opacity=0.5),
    "leaf": wrt.Principled(COLORS, opacity=wrt.ImageTexture(picture(linear=True), channel="r", cutoff=0.5, **LAID)),
    "lacquer": wrt.Principled(coat=0.5, normal_map=BUMPS, coat_normal_map=wrt.NormalMap(BUMPS.pixels, 0.25, uv_set=1)),
    "flat lacquer": wrt.Principled(coat=0.5, normal_map=BUMPS, coat_normal_map=FLAT),
    "bumpy lacquer": wrt.Principled(coat=0.5, normal_map=BUMPS),
    "bumpy": wrt.Principled(normal_map=BUMPS),
}
EXACT = [name for name in MATERIALS if name not in ("screen", "bumpy") and "lacquer" not in name]


def again(scene: wrt.Scene, path: Path) -> tuple[wrt.Scene, list[str]]:
    """Write a scene, read it, and return it with the warnings of writing."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        wrt.save_scene(path, scene, force=True)
    messages = [str(each.message) for each in caught]
    return load_file(path), messages


@pytest.mark.parametrize("name", EXACT)
def test_materials_come_back(name, tmp_path):
    scene = wrt.Scene()
    scene.add(QUAD, material=MATERIALS[name].named("paint"))
    found, messages = again(scene, tmp_path / "a.glb")
    assert messages == []
    (read,), material = found.shapes, scene.shapes[0].material
    values = {field.name: getattr(material, field.name) for field in dataclasses.fields(material)}
    assert values.pop("name") == read.material.name
    images = {key: value for key, value in values.items() if isinstance(value, wrt.ImageTexture)}
    for key, image in images.items():
        back = getattr(read.material, key)
        assert (back.wrap, back.filter, back.cutoff) == (image.wrap, image.filter, image.cutoff)
        np.testing.assert_allclose(back.placement, np.eye(2, 3), atol=1e-6)
        # Textures that all lie alike move the coordinates of the mesh instead.
        moved = QUAD.uvs @ image.placement[:, :2].T + image.placement[:, 2]
        np.testing.assert_allclose(read.mesh.uvs, moved, atol=1e-6)
    if interior := values.pop("interior"):
        np.testing.assert_allclose(read.material.interior.absorption, interior.absorption, rtol=1e-5)
    check_values(read.material, **{key: values_of(value) for key, value in values.items()})
    np.testing.assert_allclose(read.emission, scene.shapes[0].emission, rtol=1e-6)


@pytest.mark.parametrize("name", [name for name in MATERIALS if "lacquer" in name])
def test_normals_of_coats_come_back(name, tmp_path):
    scene = wrt.Scene()
    material = MATERIALS[name]
    scene.add(dataclasses.replace(QUAD, uvs=np.hstack([QUAD.uvs, 0.5 * QUAD.uvs])), material=material)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of coordinates that the tangents do not follow
        read = again(scene, tmp_path / "a.glb")[0].shapes[0].material
    for given, found in ((material.normal_map, read.normal_map), (material.coat_normal_map, read.coat_normal_map)):
        assert (given is None) == (found is None)
        if given is not None:
            np.testing.assert_allclose(found.pixels, given.pixels, atol=1.0 / 510 + 1e-6)
            assert (found.scale, found.uv_set) == (given.scale, given.uv_set)
            np.testing.assert_allclose(found.placement, given.placement, atol=1e-9)


def test_normals_screens_and_films_come_back_to_a_step_of_their_images(tmp_path):
    scene = wrt.Scene()
    thickness = dataclasses.replace(NUMBERS, factor=(700.0,) * 3)
    for k, material in enumerate((MATERIALS["bumpy"], MATERIALS["screen"], wrt.Principled(film_thickness=thickness))):
        scene.add(QUAD.translated((2 * k, 0, 0)), material=material)
    bumpy, screen, film = (shape.material for shape in again(scene, tmp_path / "a.glb")[0].shapes)
    np.testing.assert_allclose(bumpy.normal_map.pixels, MATERIALS["bumpy"].normal_map.pixels, atol=1.0 / 510 + 1e-6)
    assert bumpy.normal_map.scale == 0.5
    shown = screen.emission.pixels * np.float32(screen.emission.factor)
    np.testing.assert_allclose(shown, MATERIALS["screen"].emission.pixels, atol=0.005)
    read = film.film_thickness
    found = read.pixels[..., "rgb".index(read.channel)] * read.factor[0]
    step = np.ptp(thickness.pixels) * 700.0 / 255.0
    np.testing.assert_allclose(found, thickness.pixels[..., 1] * 700.0, atol=0.5 * step + 1e-3)


def test_geometry_lights_and_camera_come_back(tmp_path):
    scene = wrt.Scene()
    ball = wrt.sphere((0.1, 0.2, 0.3), 0.5, subdivisions=2)
    colored = dataclasses.replace(ball, colors=RNG.random((len(ball.vertices), 3)).astype(np.float32))
    place = np.diag([1.0, 2.0, 0.5, 1.0])
    place[:3, 3] = 1.0, 2.0, 3.0
    scene.add(colored, material=wrt.Principled(wrt.VertexColor()), name="ball")
    paint = wrt.Principled(0.5)
    for k in range(2):
        quad = dataclasses.replace(QUAD, normals=np.tile(np.float32([0, 0, 1]), (4, 1)))
        scene.add(quad, material=paint, transform=place + k * np.eye(4, k=3), name="placed")
    scene.lights = [
        wrt.PointLight((0, 1, 2), intensity=(1.0, 2.0, 4.0), name="key"),
        wrt.SpotLight((0, 1, 2), (1, 2, 3), intensity=7.0, falloff="gltf", inner_degrees=10.0, outer_degrees=35.0),
        wrt.DirectionalLight((1, 2, 3), irradiance=(0.5, 1.0, 0.25)),
    ]
    scene.camera = wrt.PerspectiveCamera((3, 2, 1), (0, 0.5, 0), fov_degrees=33.0)
    found, messages = again(scene, tmp_path / "a.glb")
    assert messages == []
    np.testing.assert_allclose(found.camera.frame(), scene.camera.frame(), atol=1e-6)
    assert found.camera.fov_degrees == pytest.approx(33.0)
    found.camera, found.cameras = scene.camera, scene.cameras  # whose target may lie farther away
    assert {name: amount for name, amount in differences(scene, found).items() if amount > 1e-5} == {}


def test_matt_surfaces_and_lamps_are_held_and_one_line_names_what_is_left_out(tmp_path):
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(0.5))
    scene.add(QUAD, material=wrt.Diffuse((0.5, 0.4, 0.2)))
    scene.add(QUAD, material=wrt.RoughConductor(0.2, metal="gold"))
    scene.add_light(wrt.ProjectorLight((0, 1, 2), (0, 0, -1)))
    scene.add_light(wrt.RectangleLight((-0.5, 2.5, -0.5), (1, 0, 0), (0, 0, 1), radiance=6.0))
    found, (line,) = again(scene, tmp_path / "a.glb")
    matt, _, lamp = found.shapes
    assert (matt.material.base_color, matt.material.specular) == (pytest.approx((0.5, 0.4, 0.2)), 0.0)
    assert lamp.emission == pytest.approx((6.0, 6.0, 6.0))
    np.testing.assert_allclose(area_vector(lamp.mesh), (0.0, -1.0, 0.0), atol=1e-6)
    for words in ("the environment", "metals by their refractive index", "lights of the type 'projector'"):
        assert words in line
    assert "\n" not in line


def test_convert_writes_a_glb_and_replaces_nothing_without_leave(tmp_path):
    out = tmp_path / "box.glb"
    out.write_bytes(b"mine")
    assert run("convert", "cornell-box", str(out)) == 2
    assert out.read_bytes() == b"mine"
    assert run("convert", "cornell-box", str(out), "--force") == 0
    assert len(load_file(out).shapes) == len(wrt.load("cornell-box").shapes)
    with pytest.raises(InputError, match=r"\.toml or \.glb"):
        wrt.save_scene(tmp_path / "a.gltf", wrt.load("cornell-box"))
