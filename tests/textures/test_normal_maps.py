"""Normal maps bend the shading normal as they say, and tangents follow the texture."""

from __future__ import annotations

import dataclasses
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray
from PIL import Image
from support.bumps import (
    FRONT,
    PROBES,
    SQUARE,
    WITH_PROBES,
    Probe,
    constant_map,
    encoded,
    lit,
    rendered,
    unit,
    with_uvs,
)
from support.bumps import registered_probes as registered_probes
from support.covering_kernels import rendering_with
from support.kernels import map_function
from support.mesh_files import add, attributes, data_uri, saved
from support.meshes import gltf_box
from support.principled_reference import dot
from support.ray_trees import unit as units

import wrt
from wrt.io.gltf.writer import save_glb
from wrt.io.load_mesh import load_file
from wrt.kernels.textures.normal_maps import bent_normal
from wrt.upload.accel import instancing

BACK = wrt.PerspectiveCamera((0.0, 0.0, -4.0), (0.0, 0.0, 0.0), fov_degrees=30.0)
LIGHT = unit(0.3, 0.5, 1.0)
TILT = (0.35, -0.2, 1.0)
TURN = np.radians(30.0)
COS, SIN = float(np.cos(TURN)), float(np.sin(TURN))
UVS: dict[str, tuple[Any, Any, Any]] = {
    "tiled": ([[7.0, 0.0], [0.0, 3.0]], (1.0, 0.0), (0.0, 1.0)),
    "turned": ([[COS, SIN], [-SIN, COS]], (COS, SIN), (-SIN, COS)),
    "mirrored": ([[-1.0, 0.0], [0.0, 1.0]], (-1.0, 0.0), (0.0, 1.0)),
    "swapped": ([[0.0, 1.0], [1.0, 0.0]], (0.0, 1.0), (1.0, 0.0)),
}
"""A matrix on the coordinates of a square in x and y, and where u and v then grow."""


one_kernel = rendering_with(WITH_PROBES)


def square(matrix: object = ((1.0, 0.0), (0.0, 1.0))) -> wrt.Mesh:
    return with_uvs(wrt.quad(*SQUARE), matrix)


def bumps(slope: float, size: int = 32, seed: int = 1, **options: Any) -> wrt.NormalMap:
    """Return a map of independent Gaussian slopes, one a texel, of root mean square `slope` along either axis."""
    slopes = np.random.default_rng(seed).normal(scale=slope, size=(size, size, 2))
    return wrt.NormalMap(encoded(np.dstack([slopes, np.ones((size, size))])), **options)


def assert_local(image: NDArray, expected: list[float], atol: float = 1e-6) -> None:
    """The probe shows this direction to the light, everywhere."""
    np.testing.assert_allclose(2.0 * image - 1.0, np.broadcast_to(expected, image.shape), atol=atol)


# --- Tangents ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "side"), [("turned", 1.0), ("turned", -1.0), ("mirrored", 1.0)])
def test_axes_follow_the_texture(name: str, side: float, device: str) -> None:
    """Local x and y are where u and v grow, from both sides, and z is on the viewer's: so brushed metals turn."""
    assert wrt.RoughConductor((0.1, 0.4)).needs_tangents
    matrix, along_u, along_v = UVS[name]
    camera = FRONT if side > 0.0 else BACK
    towards = LIGHT * [1.0, 1.0, side]
    image = rendered(lit(square(matrix), Probe(tangents=True), towards, camera), device)
    assert_local(image, [towards[:2] @ along_u, towards[:2] @ along_v, side * towards[2]])


def test_where_the_texture_has_no_area_some_frame_is_taken(device: str) -> None:
    line = [[0.1, 0.7], [0.3, 2.1]]
    image = 2.0 * rendered(lit(square(line), Probe(tangents=True), LIGHT), device) - 1.0
    np.testing.assert_allclose(image[..., 2], LIGHT[2], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(image, axis=2), 1.0, atol=1e-6)


def test_axes_stay_at_right_angles_where_normals_are_smooth(device: str) -> None:
    """On a slanted shading normal, x is the nearest direction to growing u, and y is across both."""
    normal = unit(0.4, 0.2, 1.0)
    mesh = square([[1.0, 0.5], [0.0, 1.0]])  # u grows along x on lines of constant v
    smooth = wrt.Mesh(mesh.vertices, mesh.faces, np.tile(normal.astype(np.float32), (4, 1)), mesh.uvs)
    x = unit(*(np.array([1.0, 0.0, 0.0]) - normal * normal[0]))
    image = rendered(lit(smooth, Probe(tangents=True), LIGHT), device)
    assert_local(image, [LIGHT @ x, LIGHT @ np.cross(normal, x), LIGHT @ normal])


# --- Tangents of meshes ------------------------------------------------------------------------------


@pytest.mark.parametrize(("sign", "side"), [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0)])
@pytest.mark.parametrize("backwards", [1.0, -1.0])
def test_tangents_of_a_mesh_replace_the_directions_of_its_texture(
    sign: float, side: float, backwards: float, device: str
) -> None:
    """x is the tangent made perpendicular to the normal, y is normal × tangent times the sign, as in glTF 3.7.2.1.

    Normals that point away from the fronts count as they are.
    """
    normal, tangent = unit(0.2, -0.1, 1.0), np.array([0.3, 1.0, 0.4])
    mesh = square(UVS["turned"][0])
    normals = np.tile(backwards * normal, (4, 1)).astype(np.float32)
    tangents = np.tile([*tangent, sign], (4, 1)).astype(np.float32)
    mesh = wrt.Mesh(mesh.vertices, mesh.faces, normals, mesh.uvs, tangents=tangents)
    x = unit(*(tangent - normal * (normal @ tangent)))
    y = sign * np.cross(backwards * normal, x)
    towards = LIGHT * [1.0, 1.0, side]
    scene = lit(mesh, Probe(tangents=True), towards, FRONT if side > 0.0 else BACK)
    assert_local(rendered(scene, device), [towards @ x, towards @ y, side * towards @ normal])
    mesh = dataclasses.replace(mesh, tangents=np.zeros((4, 4)))  # none
    scene.shapes[0] = dataclasses.replace(scene.shapes[0], mesh=mesh)
    u = UVS["turned"][1]
    x = unit(*(np.array([*u, 0.0]) - normal * (normal[:2] @ u)))
    assert_local(rendered(scene, device), [towards @ x, towards @ np.cross(normal, x), side * towards @ normal])


@pytest.mark.parametrize(("sign", "mirror"), [(1, 1), (-1, 1), (1, -1)])
def test_the_tangents_of_a_gltf_file(sign: int, mirror: int, tmp_path: Path, device: str) -> None:
    """A mirrored node mirrors its bumps."""
    tree = gltf_box(np.array([[-2, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]]), np.array([[0, 1, 2], [0, 2, 3]]))
    attributes(tree)["NORMAL"] = add(tree, np.tile([0.0, 0.0, 1.0], (4, 1)))
    attributes(tree)["TEXCOORD_0"] = add(tree, np.eye(4, 2))
    attributes(tree)["TANGENT"] = add(tree, np.tile([0.0, 127.0, 0.0, sign * 127.0], (4, 1)), "<i1", normalized=True)
    tree["nodes"][0]["scale"] = [mirror, 1, 1]
    texels = io.BytesIO()
    Image.fromarray(np.full((2, 2, 3), (191, 64, 255), np.uint8)).save(texels, "png")
    tree |= {"images": [{"uri": data_uri(texels.getvalue(), "image/png")}], "textures": [{"source": 0}]}
    tree["materials"], tree["meshes"][0]["primitives"][0]["material"] = [{"normalTexture": {"index": 0}}], 0
    (shape,) = load_file(saved(tmp_path, tree)).shapes
    scene = lit(shape.mesh, wrt.Diffuse(0.5, normal_map=shape.material.normal_map), LIGHT)  # type: ignore[attr-defined]
    bitangent = sign * np.cross([0.0, 0.0, 1.0], [0.0, 1.0, 0.0]) * [mirror, 1.0, 1.0]
    slopes = 2.0 * np.array([191, 64, 255]) / 255.0 - 1.0
    expected = unit(*(slopes @ [[0.0, 1.0, 0.0], bitangent, [0.0, 0.0, 1.0]])) @ LIGHT
    np.testing.assert_allclose(rendered(scene, device) * np.pi / 0.5, expected, rtol=1e-5)

    written = tmp_path / "b.glb"
    save_glb(written, wrt.Scene(shapes=[shape]))
    found, given = load_file(written).shapes[0].mesh, shape.mesh
    np.testing.assert_array_equal(found.tangents[found.faces], given.tangents[given.faces])
    del attributes(tree)["NORMAL"]  # "the provided tangents (if present) MUST be ignored"
    assert load_file(saved(tmp_path, tree)).shapes[0].mesh.tangents is None


@pytest.mark.slow
@pytest.mark.parametrize("moves", [False, True])
def test_instances_and_deformed_meshes_take_their_tangents_along(
    moves: bool, monkeypatch: pytest.MonkeyPatch, device: str
) -> None:
    """As a mesh that is transformed before it is uploaded."""
    monkeypatch.setattr(instancing, "WORTH_SHARING", 0)
    ball = wrt.sphere(subdivisions=3)
    across = np.cross((0.1, 0.2, 1.0), ball.normals)
    sign = np.sign(ball.vertices[:, :1] - 0.1)
    ball = dataclasses.replace(ball, tangents=np.hstack([across, np.where(sign == 0.0, 1.0, sign)]))
    place = np.diag([-1.2, 1.2, 1.2, 1.0])
    place[:3, 3] = 0.1, 0.2, 0.3
    options: dict[str, Any] = {"transform": place}
    if moves:
        keys = [ball.vertices, ball.vertices * 2.0]
        options = {"deformation": wrt.Deformation([0.0, 1.0], keys, [ball.normals, ball.normals])}
        place = np.diag([1.5, 1.5, 1.5, 1.0])
    images = []
    for mesh, how in ((ball, options), (ball.transformed(place), {})):
        camera = dataclasses.replace(FRONT, shutter_open=0.5, shutter_close=0.5)
        scene = lit(mesh, Probe(tangents=True), LIGHT, camera)
        scene.shapes[0] = dataclasses.replace(scene.shapes[0], **how)
        scene.add(mesh, transform=np.eye(4) + np.outer([0.0, 0.0, 99.0, 0.0], [0, 0, 0, 1]))  # behind the camera
        images.append(rendered(scene, device, size=32))
    difference = np.abs(images[0] - images[1])
    assert np.median(images[1]) > 0.01
    assert np.quantile(difference, 0.97) < 1e-3 * images[1].max()


# --- Heights, and Mitsuba's conventions --------------------------------------------------------------


def masked(normal: NDArray) -> float:
    """Return how Mitsuba darkens bumps: G1 of GGX, of a roughness by the tilt (Estevez, Lecocq and Stein 2019)."""
    alpha2 = 0.125 * (1.0 / normal[2] ** 2 - 1.0)
    return float(2.0 / (1.0 + np.sqrt(1.0 + alpha2 * (1.0 / LIGHT[2] ** 2 - 1.0))))


@pytest.mark.parametrize(("convention", "tangents"), [("gltf", False), ("mitsuba", False), ("gltf", True)])
def test_heights_tilt_the_surface_as_far_as_the_texture_is_stretched(
    convention: str, tangents: bool, device: str
) -> None:
    """Two ramps by one map: the normal of the displaced plane, whatever the tangents of the mesh."""
    matrix = np.array([[0.5, 0.2], [-0.1, 0.8]])  # (u, v) of x and y in quarters of the square
    rows, columns = np.mgrid[0:64, 0:64]
    # Heights 0.9 u + 0.4 v between the middles of the first and last texels; v points up.
    heights = 0.3 * (columns + 0.5) / 64 + 0.4 / 3.0 * (1.0 - (rows + 0.5) / 64)
    pixels = np.repeat(heights[..., None], 3, axis=2).astype(np.float32)
    material = Probe(normal_map=wrt.NormalMap(pixels, 3.0, heights=True, convention=convention), tangents=True)
    slopes = np.array([0.9, 0.4]) @ matrix / 4.0  # of height over x and y
    normal = unit(-slopes[0], -slopes[1], 1.0)
    scene = lit(square(matrix), material, LIGHT)
    if tangents:
        mesh = dataclasses.replace(scene.shapes[0].mesh, tangents=np.tile([0.0, 1.0, 0.0, -1.0], (4, 1)))
        scene.shapes[0] = dataclasses.replace(scene.shapes[0], mesh=mesh)
    share = masked(normal) if convention == "mitsuba" else 1.0
    image = rendered(scene, device)[1:3, 1:3]
    np.testing.assert_allclose(image[..., 2], share * (0.5 + 0.5 * LIGHT @ normal), rtol=2e-5)


@pytest.mark.parametrize("name", ["mirrored", "swapped"])
def test_mitsubas_y_is_across_the_normal_and_u(name: str, device: str) -> None:
    matrix, along_u, _ = UVS[name]
    material = Probe(normal_map=constant_map(0.2, 0.3, 1.0, convention="mitsuba"), tangents=True)
    u, z = np.array([*along_u, 0.0]), np.array([0.0, 0.0, 1.0])
    normal = np.stack([u, np.cross(z, u), z], axis=1) @ unit(0.2, 0.3, 1.0)
    image = rendered(lit(square(matrix), material, LIGHT), device)
    np.testing.assert_allclose(image[..., 2], masked(normal) * (0.5 + 0.5 * LIGHT @ normal), rtol=1e-4)


# --- The normal --------------------------------------------------------------------------------------


@pytest.mark.parametrize("filtered", [False, True])
@pytest.mark.parametrize("shows", PROBES)
def test_a_flat_map_changes_nothing(shows: str, filtered: bool, device: str) -> None:
    flat = constant_map(0.0, 0.0, 1.0, filter=filtered)
    images = [rendered(lit(square(), Probe(shows, True, normal_map=m), LIGHT), device) for m in (flat, None)]
    np.testing.assert_allclose(*images, rtol=0.0, atol=1e-6 if filtered else 0.0)


@pytest.mark.parametrize(
    ("name", "scale", "side"),
    [("mirrored", 1.0, 1.0), ("swapped", 1.0, 1.0), ("tiled", -0.5, 1.0), ("turned", 3.0, -1.0)],
)
def test_irradiance_is_that_of_the_tilted_normal(name: str, scale: float, side: float, device: str) -> None:
    """E = n·l, with x and y of the map scaled. The back of a sheet has the opposite normal: a bump is a dent there."""
    matrix, along_u, along_v = UVS[name]
    towards, camera = (LIGHT, FRONT) if side > 0.0 else (unit(0.2, -0.4, -1.0), BACK)
    scene = lit(square(matrix), wrt.Diffuse(0.5, normal_map=constant_map(*TILT, scale=scale)), towards, camera)
    tilt = scale * (TILT[0] * np.array(along_u) + TILT[1] * np.array(along_v))
    expected = side * unit(*tilt, 1.0) @ towards
    np.testing.assert_allclose(rendered(scene, device) * np.pi / 0.5, expected, rtol=2e-6)


def test_each_part_of_a_mixture_has_its_own_normals(device: str) -> None:
    parts = [wrt.Diffuse(0.5, normal_map=constant_map(*TILT)), wrt.Diffuse(0.5)]
    for weight, normal in ((0.0, unit(*TILT)), (1.0, unit(0.0, 0.0, 1.0))):
        scene = lit(square(), wrt.Mix(*parts, weight=weight), LIGHT)
        np.testing.assert_allclose(rendered(scene, device) * np.pi / 0.5, normal @ LIGHT, rtol=2e-6)


@wp.func
def bent_mirroring(n: wp.vec3, normal: wp.vec3, wo: wp.vec3) -> wp.vec3:
    return bent_normal(n, normal, wo, False)


@wp.func
def bent_matt(n: wp.vec3, normal: wp.vec3, wo: wp.vec3) -> wp.vec3:
    return bent_normal(n, normal, wo, True)


@pytest.mark.parametrize("matt", [False, True])
def test_normals_are_bent_just_so_far_that_light_comes_from_above(matt: bool, device: str) -> None:
    """The mirrored ray, or of matt surfaces the viewer, rises as far as it must; other normals stay, to the bit."""
    rng = np.random.default_rng(5)
    geometric, wo, normal = (units(rng.normal(size=(100_000, 3))) for _ in range(3))
    wo *= np.sign(dot(wo, geometric))[:, None]
    normal *= np.where(dot(normal, geometric) < -0.5, -1.0, 1.0)[:, None]
    bent = map_function(bent_matt if matt else bent_mirroring, normal, geometric, wo, device=device).astype(np.float64)

    def elevation(m: NDArray) -> NDArray:
        return dot(m, wo) if matt else 2.0 * dot(m, wo) * dot(m, geometric) - dot(wo, geometric)

    least = np.minimum(0.02, 0.5 * dot(wo, geometric))
    is_high_enough = (elevation(normal) > least + 1e-5) & (matt | (dot(normal, geometric) > 1e-5))
    np.testing.assert_array_equal(bent[is_high_enough], normal[is_high_enough].astype(np.float32))
    changed = elevation(normal) < least - 1e-5
    assert changed.sum() > 5000
    np.testing.assert_allclose(elevation(bent)[changed], least[changed], atol=1e-5)


def test_steep_bumps_seen_flat_are_finite_and_not_black(device: str) -> None:
    """Every mirror direction is above the surface, so all of them see the sky: no speckles at all."""
    camera = wrt.PerspectiveCamera((0.0, -4.0, 0.12), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), fov_degrees=5.0)
    scene = wrt.Scene(camera=camera, environment=wrt.ConstantEnvironment(1.0))
    scene.add(square(), material=wrt.Mirror(normal_map=bumps(1.0)))
    np.testing.assert_allclose(rendered(scene, device, spp=64, size=16), 1.0, rtol=1e-6)


# --- From the outside --------------------------------------------------------------------------------


def test_scene_files_read_maps_as_data(tmp_path: Path) -> None:
    codes = np.random.default_rng(4).integers(0, 256, (3, 5, 3)).astype(np.uint8)
    Image.fromarray(codes).save(tmp_path / "n.png")
    (tmp_path / "a.toml").write_text(
        '[materials.a]\ntype = "diffuse"\nreflectance = { texture = "n.png" }\n'
        'normal_map = { texture = "n.png", scale = 0.5, filter = true }\n[[shapes]]\ntype = "sphere"\nmaterial = "a"\n'
    )
    (shape,) = wrt.load(tmp_path / "a.toml").shapes
    normal_map, reflectance = shape.material.normal_map, shape.material.reflectance
    np.testing.assert_array_equal(normal_map.pixels, codes.astype(np.float32) / np.float32(255.0))
    assert reflectance.pixels.mean() < 0.9 * normal_map.pixels.mean()
    assert (normal_map.scale, normal_map.filter) == (0.5, True)
    np.testing.assert_array_equal(wrt.NormalMap(reflectance).pixels, reflectance.pixels)
