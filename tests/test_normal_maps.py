"""Normal maps bend the shading normal as they say, tangents follow the texture, and far-away bumps become roughness."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from support.kernels import map_function

import wrt
from wrt.kernels import bsdf as models
from wrt.kernels.bsdf.record import Bsdf, BsdfSample, Model, no_sample, zero_pdf
from wrt.kernels.textures.normal_maps import bent_normal

# --- Materials that show what a reflection model is given --------------------------------------------


@wp.func
def shown_direction(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
    """Return the direction to the light in the local frame, in [0, 1]."""
    return wi * 0.5 + wp.vec3(0.5)


@wp.func
def shown_variance(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
    """Return the variance of normals along the frame's axes, and 1."""
    return wp.vec3(bsdf.normal_variance[0], bsdf.normal_variance[1], 1.0)


@wp.func
def never_sampled(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    return no_sample()


PROBES = {
    "probe_direction": Model(shown_direction, zero_pdf, never_sampled, slots=0),
    "probe_variance": Model(shown_variance, zero_pdf, never_sampled, slots=0, widens=True),
}


@dataclass(frozen=True)
class Probe(wrt.Material):
    """Shows what its model is given; with `tangents` it is a material that has axes."""

    shows: str = "probe_direction"
    tangents: bool = False

    type_name: ClassVar[str] = "probe"

    @property
    def model(self) -> str:
        return self.shows

    @property
    def needs_tangents(self) -> bool:
        return self.tangents


@pytest.fixture(scope="module", autouse=True)
def probes() -> Iterator[None]:
    for name, model in PROBES.items():
        models.register_model(name, model)
    yield
    for name in PROBES:
        models.BSDFS.forget(name)


# --- Scenes ------------------------------------------------------------------------------------------

FRONT = wrt.PerspectiveCamera((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), fov_degrees=30.0)
BACK = wrt.PerspectiveCamera((0.0, 0.0, -4.0), (0.0, 0.0, 0.0), fov_degrees=30.0)
SQUARE = ((-2.0, -2.0, 0.0), (4.0, 0.0, 0.0), (0.0, 4.0, 0.0))


def unit(*v: float) -> NDArray[np.float64]:
    return np.array(v) / np.linalg.norm(v)


def encoded(normals: NDArray) -> NDArray[np.float32]:
    """Return the colours c of unit normals 2c − 1."""
    return (0.5 * normals / np.linalg.norm(normals, axis=-1, keepdims=True) + 0.5).astype(np.float32)


def constant_map(*normal: float, **options: object) -> wrt.NormalMap:
    return wrt.NormalMap(encoded(np.broadcast_to(np.array(normal), (4, 4, 3))), **options)  # type: ignore[arg-type]


def bumps(slope: float, size: int = 32, seed: int = 1, **options: object) -> wrt.NormalMap:
    """Return a map of independent Gaussian slopes, one a texel, of root mean square `slope` along either axis."""
    slopes = np.random.default_rng(seed).normal(scale=slope, size=(size, size, 2))
    return wrt.NormalMap(encoded(np.dstack([slopes, np.ones((size, size))])), **options)  # type: ignore[arg-type]


def with_uvs(mesh: wrt.Mesh, matrix: object) -> wrt.Mesh:
    return wrt.Mesh(mesh.vertices, mesh.faces, mesh.normals, mesh.uvs @ np.array(matrix, np.float32).T)


def lit(mesh: wrt.Mesh, material: wrt.Material, towards: NDArray, camera: wrt.PerspectiveCamera = FRONT) -> wrt.Scene:
    """Return a mesh under sunlight of irradiance 1 from a direction."""
    scene = wrt.Scene(camera=camera)
    scene.add(mesh, material=material)
    scene.add_light(wrt.DirectionalLight(tuple(-towards), irradiance=1.0))
    return scene


def render(scene: wrt.Scene, device: str, spp: int = 1, size: int = 4) -> NDArray[np.float64]:
    image = wrt.render(scene, width=size, height=size, spp=spp, device=device, max_depth=2)
    return image.astype(np.float64)


# --- Tangents ----------------------------------------------------------------------------------------

LIGHT = unit(0.3, 0.5, 1.0)
TURN = np.radians(30.0)
UVS = {
    "as they are": ([[1.0, 0.0], [0.0, 1.0]], (1.0, 0.0), (0.0, 1.0)),
    "tiled": ([[7.0, 0.0], [0.0, 3.0]], (1.0, 0.0), (0.0, 1.0)),
    "turned by 90 degrees": ([[0.0, 1.0], [-1.0, 0.0]], (0.0, 1.0), (-1.0, 0.0)),
    "turned by 30 degrees": (
        [[np.cos(TURN), np.sin(TURN)], [-np.sin(TURN), np.cos(TURN)]],
        (np.cos(TURN), np.sin(TURN)),
        (-np.sin(TURN), np.cos(TURN)),
    ),
    "u mirrored": ([[-1.0, 0.0], [0.0, 1.0]], (-1.0, 0.0), (0.0, 1.0)),
    "v mirrored": ([[1.0, 0.0], [0.0, -1.0]], (1.0, 0.0), (0.0, -1.0)),
    "swapped": ([[0.0, 1.0], [1.0, 0.0]], (0.0, 1.0), (1.0, 0.0)),
}
"""A matrix on the coordinates of a square in x and y, and where u and v then grow."""


@pytest.mark.parametrize("camera", [FRONT, BACK], ids=["front", "back"])
@pytest.mark.parametrize("name", UVS)
def test_axes_follow_the_texture(name: str, camera: wrt.PerspectiveCamera, device: str) -> None:
    """Local x and y are where u and v grow, from both sides, and z is on the viewer's."""
    matrix, along_u, along_v = UVS[name]
    side = np.sign(camera.origin[2])
    towards = LIGHT * [1.0, 1.0, side]
    mesh = with_uvs(wrt.quad(*SQUARE), matrix)
    image = render(lit(mesh, Probe(tangents=True), towards, camera), device)
    expected = [towards[:2] @ along_u, towards[:2] @ along_v, side * towards[2]]
    np.testing.assert_allclose(2.0 * image - 1.0, np.broadcast_to(expected, image.shape), atol=1e-6)


@pytest.mark.parametrize(
    "matrix", [[[0.0, 0.0], [0.0, 0.0]], [[1.0, 0.0], [0.3, 0.0]], [[0.1, 0.7], [0.3, 2.1]]], ids=["point", "u", "line"]
)
def test_where_the_texture_has_no_area_some_frame_is_taken(matrix: object, device: str) -> None:
    mesh = with_uvs(wrt.quad(*SQUARE), matrix)
    image = 2.0 * render(lit(mesh, Probe(tangents=True), LIGHT), device) - 1.0
    np.testing.assert_allclose(image[..., 2], LIGHT[2], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(image, axis=2), 1.0, atol=1e-6)


def test_axes_stay_at_right_angles_where_normals_are_smooth(device: str) -> None:
    """On a slanted shading normal, x is the nearest direction to growing u, and y is across both."""
    normal = unit(0.4, 0.2, 1.0)
    mesh = with_uvs(wrt.quad(*SQUARE), [[1.0, 0.5], [0.0, 1.0]])
    smooth = wrt.Mesh(mesh.vertices, mesh.faces, np.tile(normal.astype(np.float32), (4, 1)), mesh.uvs)
    image = 2.0 * render(lit(smooth, Probe(tangents=True), LIGHT), device) - 1.0
    along_u = unit(1.0, 0.0, 0.0)  # v does not grow along x, and u grows along x on lines of constant v
    x = along_u - normal * (normal @ along_u)
    x /= np.linalg.norm(x)
    expected = [LIGHT @ x, LIGHT @ np.cross(normal, x), LIGHT @ normal]
    np.testing.assert_allclose(image, np.broadcast_to(expected, image.shape), atol=1e-6)


# --- Heights, and Mitsuba's conventions --------------------------------------------------------------


@pytest.mark.parametrize("convention", ["gltf", "mitsuba"])
def test_heights_tilt_the_surface_as_far_as_the_texture_is_stretched(convention: str, device: str) -> None:
    """Two ramps by one map: the normal is that of the displaced plane; Mitsuba's bumps shadow by G1 of GGX besides."""
    matrix = np.array([[0.5, 0.2], [-0.1, 0.8]])  # (u, v) of x and y in quarters of the square
    mesh = with_uvs(wrt.quad(*SQUARE), matrix)
    rows, columns = np.mgrid[0:64, 0:64]
    # Heights 0.9 u + 0.4 v between the middles of the first and last texels; v points up.
    heights = 0.3 * (columns + 0.5) / 64 + 0.4 / 3.0 * (1.0 - (rows + 0.5) / 64)
    bumps = wrt.NormalMap(
        np.repeat(heights[..., None], 3, axis=2).astype(np.float32), 3.0, heights=True, convention=convention
    )
    image = render(lit(mesh, Probe(normal_map=bumps, tangents=True), LIGHT), device)[1:3, 1:3]
    slopes = np.array([0.9, 0.4]) @ matrix / 4.0  # of height over x and y
    normal = unit(-slopes[0], -slopes[1], 1.0)
    share = 1.0
    if convention == "mitsuba":
        alpha2 = 0.125 * (1.0 / normal[2] ** 2 - 1.0)
        share = 2.0 / (1.0 + np.sqrt(1.0 + alpha2 * (1.0 / LIGHT[2] ** 2 - 1.0)))
    expected = share * (0.5 + 0.5 * LIGHT @ normal)
    np.testing.assert_allclose(image[..., 2], expected, rtol=2e-5)


@pytest.mark.parametrize("name", ["as they are", "v mirrored", "swapped"])
def test_mitsubas_y_is_across_the_normal_and_u(name: str, device: str) -> None:
    matrix, along_u, _ = UVS[name]
    mesh = with_uvs(wrt.quad(*SQUARE), matrix)
    material = Probe(normal_map=constant_map(0.2, 0.3, 1.0, convention="mitsuba"), tangents=True)
    image = render(lit(mesh, material, LIGHT), device)
    u = np.array([*along_u, 0.0])
    x, y, z = unit(0.2, 0.3, 1.0)
    normal = x * u + y * np.cross([0.0, 0.0, 1.0], u) + z * np.array([0.0, 0.0, 1.0])
    share = 2.0 / (1.0 + np.sqrt(1.0 + 0.125 * (1.0 / z**2 - 1.0) * (1.0 / LIGHT[2] ** 2 - 1.0)))
    np.testing.assert_allclose(image[..., 2], share * (0.5 + 0.5 * LIGHT @ normal), rtol=1e-4)


def test_filters_are_for_normals_of_gltf() -> None:
    for options in ({"heights": True}, {"convention": "mitsuba"}):
        with pytest.raises(wrt.InputError, match="filter is for normals"):
            constant_map(0.0, 0.0, 1.0, filter=True, **options)


# --- Anisotropy ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("camera", [FRONT, BACK], ids=["front", "back"])
@pytest.mark.parametrize("name", UVS)
def test_a_brushed_highlight_turns_with_the_texture(name: str, camera: wrt.PerspectiveCamera, device: str) -> None:
    """It is what the untouched square shows of a light at the same place relative to u and v."""
    matrix, along_u, along_v = UVS[name]
    material = wrt.RoughConductor((0.1, 0.4))
    far = wrt.PerspectiveCamera(tuple(50.0 * np.array(camera.origin)), (0.0, 0.0, 0.0), fov_degrees=0.1)
    side = np.sign(camera.origin[2])

    def brightness(mesh: wrt.Mesh, x: float, y: float) -> float:
        return float(render(lit(mesh, material, unit(x, y, side), far), device).mean())

    square = wrt.quad(*SQUARE)
    seen = []
    for degrees in (0.0, 25.0, 50.0, 90.0, 140.0):
        x, y = 0.5 * np.cos(np.radians(degrees)), 0.5 * np.sin(np.radians(degrees))
        on_u, on_v = x * along_u[0] + y * along_u[1], x * along_v[0] + y * along_v[1]
        seen.append(brightness(with_uvs(square, matrix), x, y))
        np.testing.assert_allclose(seen[-1], brightness(square, on_u, on_v), rtol=1e-3)
    assert max(seen) > 3.0 * min(seen)


# --- The normal --------------------------------------------------------------------------------------


@pytest.mark.parametrize("filtered", [False, True])
@pytest.mark.parametrize("shows", PROBES)
def test_a_flat_map_changes_nothing(shows: str, filtered: bool, device: str) -> None:
    flat = constant_map(0.0, 0.0, 1.0, filter=filtered)
    with_map = render(lit(wrt.quad(*SQUARE), Probe(shows, tangents=True, normal_map=flat), LIGHT), device)
    without = render(lit(wrt.quad(*SQUARE), Probe(shows, tangents=True), LIGHT), device)
    np.testing.assert_allclose(with_map, without, rtol=0.0, atol=0.0 if not filtered else 1e-6)


TILT = (0.35, -0.2, 1.0)


@pytest.mark.parametrize("scale", [1.0, 0.5, -1.0, 3.0])
def test_irradiance_is_that_of_the_tilted_normal(scale: float, device: str, report: Report) -> None:
    """E = n·l of the sun, with x and y of the map scaled."""
    scene = lit(wrt.quad(*SQUARE), wrt.Diffuse(0.5, normal_map=constant_map(*TILT, scale=scale)), LIGHT)
    stored = np.array(TILT) / np.linalg.norm(TILT)
    normal = unit(stored[0] * scale, stored[1] * scale, stored[2])
    measured = render(scene, device) * np.pi / 0.5
    report(f"scale {scale:g}: irradiance", float(measured.mean()), float(normal @ LIGHT))
    np.testing.assert_allclose(measured, normal @ LIGHT, rtol=2e-6)


def test_from_behind_a_bump_is_a_dent(device: str) -> None:
    """A sheet has one shape: its normal on the back is the opposite of that on the front."""
    material = wrt.Diffuse(0.5, normal_map=constant_map(*TILT))
    towards = unit(0.2, -0.4, -1.0)
    measured = render(lit(wrt.quad(*SQUARE), material, towards, BACK), device) * np.pi / 0.5
    np.testing.assert_allclose(measured, -unit(*TILT) @ towards, rtol=2e-6)


@pytest.mark.parametrize("name", UVS)
def test_the_normal_turns_with_the_texture(name: str, device: str) -> None:
    matrix, along_u, along_v = UVS[name]
    material = wrt.Diffuse(0.5, normal_map=constant_map(*TILT))
    mesh = with_uvs(wrt.quad(*SQUARE), matrix)
    tilt = np.array(TILT[0] * np.array(along_u) + TILT[1] * np.array(along_v))
    measured = render(lit(mesh, material, LIGHT), device) * np.pi / 0.5
    np.testing.assert_allclose(measured, unit(*tilt, 1.0) @ LIGHT, rtol=2e-6)


def test_each_part_of_a_mixture_has_its_own_normals(device: str) -> None:
    parts = [wrt.Diffuse(0.5, normal_map=constant_map(*TILT)), wrt.Diffuse(0.5)]
    for weight, normal in ((0.0, unit(*TILT)), (1.0, unit(0.0, 0.0, 1.0))):
        scene = lit(wrt.quad(*SQUARE), wrt.Mix(*parts, weight=weight), LIGHT)
        np.testing.assert_allclose(render(scene, device) * np.pi / 0.5, normal @ LIGHT, rtol=2e-6)


@wp.func
def bent_mirroring(n: wp.vec3, normal: wp.vec3, wo: wp.vec3) -> wp.vec3:
    return bent_normal(n, normal, wo, False)


@wp.func
def bent_matt(n: wp.vec3, normal: wp.vec3, wo: wp.vec3) -> wp.vec3:
    return bent_normal(n, normal, wo, True)


@pytest.mark.parametrize("matt", [False, True])
def test_bent_normals_face_the_viewer_and_mirror_to_above_the_surface(matt: bool, device: str, report: Report) -> None:
    """Those that did before stay as they are to the bit; what is bent is bent no further than it must be."""
    rng = np.random.default_rng(5)
    n = 200_000
    geometric, wo, normal = (rng.normal(size=(n, 3)) for _ in range(3))
    for v in (geometric, wo, normal):
        v /= np.linalg.norm(v, axis=1, keepdims=True)
    wo *= np.sign(np.sum(wo * geometric, axis=1))[:, None]
    wo[:1000] = geometric[:1000] * 1e-4 + np.cross(geometric[:1000], wo[:1000])  # grazing
    wo /= np.linalg.norm(wo, axis=1, keepdims=True)
    normal[1000:3000] = geometric[1000:3000] + 1e-5 * normal[1000:3000]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal *= np.where(np.sum(normal * geometric, axis=1) < -0.5, -1.0, 1.0)[:, None]
    bent = map_function(bent_matt if matt else bent_mirroring, normal, geometric, wo, device=device).astype(np.float64)
    assert np.isfinite(bent).all()
    np.testing.assert_allclose(np.linalg.norm(bent, axis=1), 1.0, atol=1e-6)

    def elevation(m: NDArray) -> NDArray:
        facing = np.sum(m * wo, axis=1)
        return facing if matt else 2.0 * facing * np.sum(m * geometric, axis=1) - np.sum(wo * geometric, axis=1)

    least = np.minimum(0.02, 0.5 * np.sum(wo * geometric, axis=1))
    before, after = elevation(normal), elevation(bent)
    assert (after - least).min() > -1e-5
    assert (np.sum(bent * wo, axis=1) > 0.0).all()
    kept = (before > least + 1e-5) & (matt | (np.sum(normal * geometric, axis=1) > 1e-5))
    np.testing.assert_array_equal(bent[kept], normal[kept].astype(np.float32))
    changed = before < least - 1e-5
    assert changed.sum() > 10_000
    report("height over the least", float((after - least)[changed].max()), 0.0)
    assert (after - least)[changed].max() < 1e-5
    # In the plane of both normals, on the same side.
    plane = np.cross(geometric[changed], normal[changed])
    plane /= np.linalg.norm(plane, axis=1, keepdims=True)
    assert np.abs(np.sum(plane * bent[changed], axis=1)).max() < 1e-4
    assert (np.sum(np.cross(geometric[changed], bent[changed]) * plane, axis=1) > -1e-6).all()
    assert (np.sum(bent * geometric, axis=1) >= np.sum(normal * geometric, axis=1) - 1e-5)[changed].all()


def test_steep_bumps_seen_flat_are_finite_and_not_black(device: str) -> None:
    """Every mirror direction is above the surface, so all of them see the sky: no speckles at all."""
    scene = wrt.Scene(
        camera=wrt.PerspectiveCamera((0.0, -4.0, 0.12), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), fov_degrees=5.0)
    )
    scene.add(wrt.quad(*SQUARE), material=wrt.Mirror(normal_map=bumps(1.0)))
    scene.environment = wrt.ConstantEnvironment(1.0)
    np.testing.assert_allclose(render(scene, device, spp=64, size=16), 1.0, rtol=1e-6)


# --- Against Mitsuba ---------------------------------------------------------------------------------


def mapped_room() -> wrt.Scene:
    """A bumpy floor and wall around a box, lit by a lamp and a sky."""
    from test_against_mitsuba import CAMERA, lamp, sky

    scene = lamp(wrt.Scene(camera=CAMERA, environment=sky()))
    floor = wrt.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6))
    wall = wrt.quad((-3, 0, -1.5), (6, 0, 0), (0, 4, 0))
    maps = (bumps(0.25, 16, 7), bumps(0.2, 8, 8, scale=1.25))
    scene.add(with_uvs(floor, [[2.0, 1.0], [-1.0, 2.0]]), material=wrt.Diffuse((0.6, 0.5, 0.4), normal_map=maps[0]))
    scene.add(with_uvs(wall, [[3.0, 0.0], [0.0, 2.0]]), material=wrt.Diffuse((0.3, 0.5, 0.7), normal_map=maps[1]))
    scene.add(wrt.box((-0.5, 0.0, -0.5), (0.3, 0.7, 0.3)).rotated((0, 1, 0), 20.0), material=wrt.Diffuse(0.7))
    return scene


@pytest.mark.slow
def test_picture_agrees_with_mitsuba(device: str, report: Report) -> None:
    pytest.importorskip("mitsuba", reason="the independent renderer is not installed")
    from support.mitsuba_scene import render_reference
    from support.statistics import image_z_test

    # One bounce: further ones see the floor at grazing angles, where wrt bends normals and Mitsuba's are black.
    expected = render_reference(mapped_room(), width=48, height=36, max_depth=2, spp=512)
    without = mapped_room()
    without.shapes = [
        wrt.Shape(s.mesh, wrt.Diffuse(s.material.reflectance), s.emission, name=s.name)  # type: ignore[attr-defined]
        for s in without.shapes
    ]
    for scene, agrees in ((mapped_room(), True), (without, False)):
        renderer = wrt.Renderer(
            scene, sampler="independent", width=48, height=36, device=device, max_depth=2, filter="box", seed=1
        )
        for _ in renderer.passes(spp=256):
            pass
        result = image_z_test(
            renderer.image(),
            renderer.variance(),
            expected.mean,
            expected.variance,
            n_a=renderer.spp,
            n_b=expected.runs,
        )
        if agrees:
            report(
                "mean against Mitsuba, per cent", f"{100.0 * result.relative_difference[1]:+.3f}", 0, p=result.mean_p
            )
        assert result.agrees() == agrees, result.message


# --- From the outside --------------------------------------------------------------------------------


def test_scene_files_read_maps_as_data(tmp_path: Path) -> None:
    from PIL import Image

    codes = np.random.default_rng(4).integers(0, 256, (3, 5, 3)).astype(np.uint8)
    Image.fromarray(codes).save(tmp_path / "n.png")
    (tmp_path / "a.toml").write_text(
        '[materials.a]\ntype = "diffuse"\nreflectance = { texture = "n.png" }\nnormal_map = { texture = "n.png" }\n'
        '[materials.b]\ntype = "mirror"\nnormal_map = { texture = "n.png", scale = 0.5, filter = true }\n'
        '[[shapes]]\ntype = "sphere"\nmaterial = "a"\n[[shapes]]\ntype = "sphere"\nmaterial = "b"\n'
    )
    a, b = (shape.material for shape in wrt.load(tmp_path / "a.toml").shapes)
    assert a.normal_map is not None
    assert b.normal_map is not None
    np.testing.assert_array_equal(a.normal_map.pixels, codes.astype(np.float32) / np.float32(255.0))
    assert isinstance(a, wrt.Diffuse)
    assert isinstance(a.reflectance, wrt.ImageTexture)
    assert a.reflectance.pixels.mean() < 0.9 * a.normal_map.pixels.mean()
    assert (a.normal_map.scale, a.normal_map.filter) == (1.0, False)
    assert (b.normal_map.scale, b.normal_map.filter) == (0.5, True)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("normal_map = 1", "a.toml: materials.a.normal_map: must be a table, not 1"),
        ("normal_map = { scale = 1 }", "a.toml: materials.a.normal_map: the key 'texture' is missing"),
        ('normal_map = { texture = "n.npy", s = 1 }', "a.toml: materials.a.normal_map.s: unknown key"),
        ('normal_map = { texture = "x.png" }', "x.png: no such file"),
        ('normal_map = { texture = "n.npy", scale = "a" }', "normal map scale must be a number, not 'a'"),
        ('normal_map = { texture = "n.npy", filter = 1 }', "normal map filter must be true or false, not 1"),
        ('normal_map = { texture = "2.npy" }', "normal map 2.npy: pixels must be 0 to 1, not 2"),
    ],
)
def test_mistakes_in_scene_files_are_named(text: str, message: str, tmp_path: Path) -> None:
    np.save(tmp_path / "n.npy", np.ones((2, 2, 3), np.float32))
    np.save(tmp_path / "2.npy", np.full((2, 2, 3), 2.0, np.float32))
    (tmp_path / "a.toml").write_text(f'[materials.a]\ntype = "diffuse"\n{text}\n')
    with pytest.raises(wrt.InputError) as caught:
        wrt.load(tmp_path / "a.toml")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_mistakes_in_python_are_named() -> None:
    with pytest.raises(wrt.InputError, match=r"normal_map must be a wrt\.NormalMap, not ImageTexture"):
        wrt.Diffuse(normal_map=wrt.ImageTexture(np.ones((2, 2, 3))))  # type: ignore[arg-type]
    with pytest.raises(wrt.InputError, match="a mix has no normals of its own; give normal_map to its parts"):
        wrt.Mix(normal_map=constant_map(0.0, 0.0, 1.0))
    with pytest.raises(wrt.InputError, match="pixels must be"):
        wrt.NormalMap(np.ones((2, 2)))  # type: ignore[arg-type]


def test_an_image_texture_is_taken_as_it_is() -> None:
    texture = wrt.ImageTexture(encoded(np.array([[TILT]])))
    np.testing.assert_array_equal(wrt.NormalMap(texture).pixels, texture.pixels)


@pytest.mark.usefixtures("render_kernels_when_launched")
def test_scenes_without_pay_nothing() -> None:
    """Their kernels are made without tangents, and hold no coordinates."""
    plain = wrt.Renderer(lit(wrt.quad(*SQUARE), wrt.Diffuse(0.5), LIGHT), width=2, height=2)
    assert not plain._built.features.tangents
    assert plain._built.data.uvs is None
    mapped = wrt.Diffuse(0.5, normal_map=constant_map(*TILT))
    assert wrt.Renderer(lit(wrt.quad(*SQUARE), mapped, LIGHT), width=2, height=2)._built.features.tangents


def test_checkpoints_know_the_map() -> None:
    from wrt.rendering.fingerprint import scene_fingerprint

    def digest(normal_map: wrt.NormalMap | None) -> str:
        return scene_fingerprint(lit(wrt.quad(*SQUARE), wrt.Diffuse(normal_map=normal_map), LIGHT))["materials"]

    maps = [None, constant_map(*TILT), constant_map(0.0, 0.0, 1.0), constant_map(*TILT, scale=0.5)]
    maps.append(constant_map(*TILT, filter=True))
    assert len({digest(m) for m in maps}) == len(maps)
