"""Derivatives by the index of smooth glass: closed forms, difference quotients, and what is refused.

Edges that are seen through glass have no derivative, so most scenes have none: what glass bends is smooth.
"""

import dataclasses

import numpy as np
import pytest
import warp as wp
from support.grids import grid, with_bumps

import wrt
from wrt.backend.device import Device
from wrt.backend.warp_start import initialize_warp
from wrt.kernels import bsdf as models
from wrt.kernels.bsdf import model_of
from wrt.kernels.core.features import Features
from wrt.kernels.gradients.bsdf import bending_slot, slots_without_derivative
from wrt.kernels.gradients.tangents import mirrored_tangent, reason_against, refracted_tangent

Z = 4.5
"""The greatest z of two dozen numbers: a right program exceeds it once in 5,000 runs."""

# --- Formulas --------------------------------------------------------------------------------------


@wp.kernel(module="unique", enable_backward=False)
def tangents(
    first: int,
    d: wp.array(dtype=wp.vec3),
    n: wp.array(dtype=wp.vec3),
    by_d: wp.array(dtype=wp.vec3),
    by_n: wp.array(dtype=wp.vec3),
    eta: float,
    by_eta: float,
    mirrored_out: wp.array(dtype=wp.vec3),
    refracted_out: wp.array(dtype=wp.vec3),
):
    i = first + wp.tid()
    mirrored_out[i] = mirrored_tangent(d[i], n[i], by_d[i], by_n[i])
    refracted_out[i] = refracted_tangent(d[i], n[i], eta, by_d[i], by_n[i], by_eta)


def mirrored(d, n):
    return d - 2.0 * (d * n).sum(1, keepdims=True) * n


def refracted(d, n, eta):
    """Return directions of Snell's law: the part along the surface shrinks by eta."""
    along = (d - (d * n).sum(1, keepdims=True) * n) / eta
    return along - n * np.sqrt(1.0 - (along**2).sum(1, keepdims=True))


@pytest.mark.parametrize("eta", [1.5, 1 / 1.3])
def test_directions_turn_as_difference_quotients_tell(eta, device):
    initialize_warp()
    rng, on = np.random.default_rng(1), Device(device, threads=1)
    n, side, *moves = rng.normal(size=(4, 200, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    along = np.cross(n, side)
    along *= rng.uniform(0.0, 0.7, (200, 1)) / np.linalg.norm(along, axis=1, keepdims=True)
    d = along - n * np.sqrt(1.0 - (along**2).sum(1, keepdims=True))
    by_d, by_n = (move - u * (u * move).sum(1, keepdims=True) for move, u in zip(moves, (d, n), strict=True))
    backend = on.backend
    outs = [backend.zeros(200, "vec3", on.name) for _ in range(2)]
    inputs = [*(backend.array(each.astype(np.float32), "vec3", on.name) for each in (d, n, by_d, by_n)), eta, 0.4]
    on.launch(tangents, 200, [*inputs, *outs])

    def moved(step):
        turned = [u + step * by for u, by in ((d, by_d), (n, by_n))]
        turned = [u / np.linalg.norm(u, axis=1, keepdims=True) for u in turned]
        return mirrored(*turned), refracted(*turned, eta + 0.4 * step)

    for found, above, below in zip(outs, moved(1e-5), moved(-1e-5), strict=True):
        np.testing.assert_allclose(backend.fetch(found), (above - below) / 2e-5, rtol=0.0, atol=1e-4)


# --- Names, and what is refused --------------------------------------------------------------------


def test_names_and_what_is_refused():
    """Before anything is compiled. Both sides' indices have names; without names there are no derivatives by them."""
    milk = wrt.Medium((1.0, 2.0, 3.0), 1.0)
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    scene.add(wrt.sphere(subdivisions=1), material=wrt.Dielectric(1.5, interior=milk), name="jar")
    assert {"jar.ior", "jar.exterior_ior"} <= set(wrt.parameters(scene))
    with pytest.raises(wrt.InputError, match=r"by the index of smooth glass in scenes with media or nested bodies"):
        wrt.Renderer(scene, width=8, height=8).gradients(np.ones((8, 8, 3)), "jar.ior", spp=1)
    prism = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    for i, dispersion in enumerate((0.0, 4.0)):
        glass = wrt.Dielectric(1.5, dispersion=dispersion)
        prism.add(wrt.sphere((3.0 * i, 0.0, 0.0), subdivisions=1), material=glass, name=f"{dispersion}")
    assert [name for name in wrt.parameters(prism) if "ior" in name] == ["0.0.ior", "0.0.exterior_ior"]
    with pytest.raises(wrt.InputError, match=r"by the index of smooth glass in scenes with dispersion"):
        wrt.Renderer(prism, width=8, height=8).gradients(np.ones((8, 8, 3)), "0.0.ior", spp=1)


def test_own_models_must_tell_where_light_goes():
    """A smooth one that only samples may turn light anywhere, so nothing is known of its index."""
    own = model_of("dielectric")._replace(specular=None)
    models.register_model("own_glass", own)
    name = models.current_name("own_glass")
    assert (bending_slot("dielectric"), bending_slot(name)) == (own.index_slot, -1)
    assert (slots_without_derivative("dielectric"), slots_without_derivative(name)) == ((), (own.index_slot,))
    assert reason_against(Features(("dielectric",), False, "none")) == ""
    assert reason_against(Features((name,), False, "none")) == "smooth models without `specular`"
    models.BSDFS.forget("own_glass")


# --- Closed forms ----------------------------------------------------------------------------------


def ramp(corner, u, v, low, high):
    """Return a parallelogram whose vertex colours rise along u."""
    mesh = wrt.quad(corner, u, v)
    shares = (mesh.vertices.astype(np.float64) - corner) @ np.asarray(u, float) / np.dot(u, u)
    return dataclasses.replace(mesh, colors=(low + (high - low) * shares[:, None] * np.ones(3)).astype(np.float32))


def fresnel(eta, cos_i):
    """Return reflectance and cosine on the far side."""
    cos_t = np.sqrt(1.0 - (1.0 - cos_i**2) / eta**2)
    s, p = (cos_i - eta * cos_t) / (cos_i + eta * cos_t), (eta * cos_i - cos_t) / (eta * cos_i + cos_t)
    return 0.5 * (s * s + p * p), cos_t


def slope(function, at):
    return (function(at + 1e-5) - function(at - 1e-5)) / 2e-5


TILT = np.radians(40.0)


def eye(tilt, axis=0):
    """Return a camera that sees one point of the block."""
    target = np.zeros(3)
    target[axis], target[2] = np.sin(tilt), -np.cos(tilt)
    return wrt.PerspectiveCamera((0, 0, 0), target, up=(0, 1, 0) if axis == 0 else (1, 0, 0), fov_degrees=0.001)


def faces_of_block(thickness=0.5, wedge=0.0, axis=0):
    """Return the two faces of a block of glass whose front is at z = −1; the wedge turns the one behind."""
    front, back = (wrt.quad((-4 * s, -4, 0), (8 * s, 0, 0), (0, 8, 0)) for s in (1, -1))
    turn = np.eye(3)
    turn[[axis, 2], [axis, 2]] = np.cos(wedge)
    turn[axis, 2], turn[2, axis] = np.sin(wedge), -np.sin(wedge)
    back = dataclasses.replace(back, vertices=(back.vertices @ turn.T).astype(np.float32))
    return front.translated((0, 0, -1)), back.translated((0, 0, -1 - thickness))


def with_glass(scene, faces, glass):
    for face in faces:
        scene.add(face, material=glass, name="glass")
    return scene


def through_block(tilt, wall, *glasses):
    """Return a scene of a wall at z = −3 that is seen through a block of glass, or of one for each of its faces."""
    scene = wrt.Scene(camera=eye(tilt))
    glasses = glasses or [wrt.Dielectric(1.6, 1.1)] * 2
    for face, glass in zip(faces_of_block(), glasses, strict=True):
        scene.add(face, material=glass, name="glass")
    mesh = ramp((-5, -5, -3), (10, 0, 0), (0, 10, 0), 0.1, 0.9)
    if wall == "shines":
        scene.add(mesh, material=wrt.Diffuse(0.0), emission=wrt.VertexColor(), name="wall")
    else:
        scene.add(mesh, material=wrt.Diffuse(wrt.VertexColor()))
        scene.add_light(wrt.PointLight((0.4, 0.3, -2.0), 2.0))
    return scene


def radiance_through_block(eta, tilt, wall, bounces):
    """Return what is seen: by 2k reflections within the block light comes from a place further along the wall."""
    reflected, cos_t = fresnel(eta, np.cos(tilt))
    total = 0.0
    for k in range(bounces + 1):
        x = 2.5 * np.tan(tilt) + 0.5 * (1 + 2 * k) * np.sin(tilt) / eta / cos_t
        value = 0.1 + 0.8 * (x + 5.0) / 10.0
        if wall == "lit":
            d = np.array([0.4 - x, 0.3, 1.0])
            value *= 2.0 * d[2] / np.linalg.norm(d) ** 3 / np.pi
        total += value * (1.0 - reflected) ** 2 * reflected ** (2 * k)
    return total


def require(report, name, found, expected, *, within):
    """Check the mean of estimates against what it should be, by their scatter."""
    error = np.std(found, ddof=1) / np.sqrt(len(found)) + 1e-5 * abs(expected)
    z = (np.mean(found) - expected) / error
    report(f"{name}, z", z, f"error {error / abs(expected):.2%} of {expected:.4g}")
    assert abs(z) < Z, name
    assert error < within * abs(expected), name


def gradients_by(renderer, names, spp, seeds):
    d_image = np.full(
        (renderer.film.height, renderer.film.width, 3), 1.0 / 3 / renderer.film.height / renderer.film.width
    )
    found = [renderer.gradients(d_image, names, spp=spp, seed=1000 + seed) for seed in range(seeds)]
    return {name: [float(each[name]) for each in found] for name in names}


@pytest.mark.parametrize(
    ("tilt", "wall", "depth", "bounces"),
    [(0.0, "shines", 3, 0), (TILT, "shines", 5, 1), (TILT, "lit", 4, 0)],
    ids=["upright", "shines", "lit"],
)
def test_a_block_of_glass_dims_and_shifts_the_wall_behind_it(tilt, wall, depth, bounces, report):
    """Also by the index around it. Upright glass shifts nothing: the wall is seen by (1 − R)²."""
    renderer = wrt.Renderer(through_block(tilt, wall), width=2, height=2, max_depth=depth, threads=1)
    found = gradients_by(renderer, ["glass.ior", "glass.exterior_ior"], 512, 16)
    seen = radiance_through_block(1.6 / 1.1, tilt, wall, bounces)
    assert renderer.render(spp=4096).mean() == pytest.approx(seen, rel=0.01)
    for name, function, at in (
        ("glass.ior", lambda n: n / 1.1, 1.6),
        ("glass.exterior_ior", lambda n: 1.6 / n, 1.1),
    ):
        expected = slope(lambda n, f=function: radiance_through_block(f(n), tilt, wall, bounces), at)
        require(report, name, found[name], expected, within=0.02)


def all_and_each(scene, names):
    """Return derivatives by the names, in one call and in a call for each."""
    renderer = wrt.Renderer(scene, width=2, height=2, max_depth=5, threads=1)
    d_image = np.ones((2, 2, 3))
    each = {name: renderer.gradients(d_image, name, spp=16)[name] for name in names}
    return renderer.gradients(d_image, names, spp=16), each


def test_faces_of_two_glasses_share_the_derivative_of_one():
    """With the same random numbers; each in a pass of its own."""
    two = [wrt.Dielectric(1.6, 1.1), wrt.Dielectric(1.6, 1.1)]
    found, each = all_and_each(through_block(TILT, "shines", *two), ["glass.ior", "glass#2.ior"])
    assert found == each
    whole, _ = all_and_each(through_block(TILT, "shines"), ["glass.ior"])
    assert found["glass.ior"] != pytest.approx(found["glass#2.ior"], rel=0.1)
    assert found["glass.ior"] + found["glass#2.ior"] == pytest.approx(whole["glass.ior"], rel=1e-4)


@pytest.mark.slow
def test_indices_go_along_with_vertices_and_values():
    names = ["glass.ior", "wall.vertices", "glass.specular_transmittance"]
    found, each = all_and_each(through_block(TILT, "shines"), names)
    for name in names:
        assert np.any(found[name])
        np.testing.assert_allclose(found[name], each[name], rtol=1e-5, atol=1e-5 * np.abs(each[name]).max())


@pytest.mark.slow
def test_longer_ways_through_coloured_glass_and_haze_are_darker(report):
    """The glass shines a little. Its two faces are one body."""
    front, back = faces_of_block()
    vertices, faces = np.vstack([front.vertices, back.vertices]), np.vstack([front.faces, back.faces + 4])
    inside, haze = 0.8, 0.3
    glass = wrt.Dielectric(1.5, interior=wrt.Medium(inside, emission=0.2))
    scene = wrt.Scene(camera=eye(TILT), medium=wrt.Medium(haze))
    scene.add(wrt.Mesh(vertices, faces), material=glass, name="glass")
    scene.add(wrt.quad((-5, -5, -3), (10, 0, 0), (0, 10, 0)), material=wrt.Diffuse(0.6))
    scene.add_light(wrt.PointLight((0.4, 0.3, -2.0), 2.0))

    def radiance(eta):
        reflected, cos_t = fresnel(eta, np.cos(TILT))
        length = 0.5 / cos_t
        passed, before = np.exp(-inside * length), np.exp(-haze / np.cos(TILT))
        x = 2.5 * np.tan(TILT) + length * np.sin(TILT) / eta
        d = np.array([0.4 - x, 0.3, 1.0])
        r = np.linalg.norm(d)
        wall = 0.6 * 2.0 * d[2] / r**3 / np.pi * np.exp(-haze * (r + 1.5 / np.cos(TILT)))
        # Radiance in glass is eta² times that outside.
        shines = 0.2 / eta**2 * (1.0 - passed) / inside * sum((reflected * passed) ** k for k in range(3))
        return before * (1.0 - reflected) * (shines + (1.0 - reflected) * passed * wall)

    renderer = wrt.Renderer(scene, width=2, height=2, max_depth=4, threads=1)
    found = gradients_by(renderer, ["glass.ior"], 512, 16)["glass.ior"]
    assert renderer.render(spp=4096).mean() == pytest.approx(radiance(1.5), rel=0.01)
    require(report, "glass.ior", found, slope(radiance, 1.5), within=0.02)


@pytest.mark.parametrize("axis", [0, 1], ids=["azimuth", "height"])
def test_a_prism_turns_what_is_seen_of_an_image_around(axis, report):
    """The image's radiance is linear in the azimuth, or in the angle from the zenith."""
    rows, columns = 32, 64
    shares = (np.arange(columns)[None] + 0.5) / columns if axis == 0 else (np.arange(rows)[:, None] + 0.5) / rows
    pixels = np.broadcast_to((4.0 * shares)[..., None], (rows, columns, 3)).astype(np.float32)
    wedge, tilt = np.radians(20.0), np.radians(-25.0)
    scene = wrt.Scene(camera=eye(tilt, axis), environment=wrt.ImageEnvironment(pixels))
    with_glass(scene, faces_of_block(wedge=wedge, axis=axis), wrt.Dielectric(1.5))

    def seen(d):
        share = 0.5 + np.arctan2(d[0], -d[2]) / 2 / np.pi if axis == 0 else np.arccos(d[1]) / np.pi
        return 4.0 * share

    def radiance(eta):
        d, n = np.zeros((2, 1, 3))
        d[0, [axis, 2]], n[0, 2] = (np.sin(tilt), -np.cos(tilt)), 1.0
        first, _ = fresnel(eta, np.cos(tilt))
        inside = refracted(d, n, eta)
        n_back = np.zeros((1, 3))
        n_back[0, [axis, 2]] = np.sin(wedge), np.cos(wedge)
        second, _ = fresnel(1.0 / eta, -(inside * n_back).sum())
        out = refracted(inside, n_back, 1.0 / eta)
        return first * seen(mirrored(d, n)[0]) + (1.0 - first) * (1.0 - second) * seen(out[0])

    renderer = wrt.Renderer(scene, width=2, height=2, max_depth=3, threads=1)
    found = gradients_by(renderer, ["glass.ior"], 512, 16)["glass.ior"]
    assert renderer.render(spp=4096).mean() == pytest.approx(radiance(1.5), rel=0.01)
    require(report, "glass.ior", found, slope(radiance, 1.5), within=0.02)


# --- Difference quotients --------------------------------------------------------------------------


def shining_room(radiance):
    """Return a ball around everything that shines inwards, by smooth colours; `radiance` is that in a direction."""
    mesh = wrt.sphere((0, 0, 0), 4.0, subdivisions=4)
    colors = radiance(*(mesh.vertices.T.astype(np.float64) / 4.0))[:, None] * (1.0, 0.8, 0.6)
    return wrt.Shape(
        dataclasses.replace(mesh, colors=colors.astype(np.float32)),
        wrt.Diffuse(0.0),
        emission=wrt.VertexColor(),
        two_sided_emission=True,
        name="room",
    )


def ball_in_shining_room():
    """A ball of glass with normals; light in it is also reflected."""
    room = shining_room(lambda x, y, z: 0.5 + 0.3 * np.sin(3.0 * x + 1.0) * np.cos(2.0 * z) + 0.2 * np.sin(4.0 * y - x))
    camera = wrt.PerspectiveCamera((0.3, 0.4, 3.0), (0, 0, 0), fov_degrees=45)
    scene = wrt.Scene([room], camera=camera)
    scene.add(wrt.sphere((0, 0, 0), 1.0, subdivisions=5), material=wrt.Dielectric(1.5), name="glass")
    return scene


def light_under_ball():
    """What a ball of glass throws onto a floor, which itself stands still, from a bright place in the sky."""
    room = shining_room(lambda x, y, z: 0.1 + 5.0 * np.maximum(y, 0.0) ** 8)
    camera = wrt.PerspectiveCamera((0.1, -0.4, 2.5), (0, -1.05, 0), fov_degrees=8)
    scene = wrt.Scene([room], camera=camera)
    floor = wrt.quad((-2, -1.05, 2), (4, 0, 0), (0, 0, -4))
    scene.add(floor, material=wrt.Principled((0.7, 0.6, 0.5), roughness=0.6), name="floor")
    scene.add(wrt.sphere((0, 0, 0), 0.7, subdivisions=5), material=wrt.Dielectric(1.5), name="glass")
    return scene


def room_behind_block():
    """A lit room behind a tilted block that reflects nothing: its walls stand still, and what is seen of them moves.

    The ceiling is a mirror, and the lamp shines less towards its edges, so that those count nothing in it.
    """
    camera = wrt.PerspectiveCamera((0.1, 0.9, 3.4), (0, 1, -1), fov_degrees=15)
    scene = wrt.Scene(camera=camera)
    turn = np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]])
    for face in faces_of_block(thickness=0.6):
        larger = face.vertices * (40, 40, 1) + (0, 0, 1)
        face = dataclasses.replace(face, vertices=(larger @ turn.T + (0, 0, 2.6)).astype(np.float32))
        scene.add(face, material=wrt.Dielectric(1.5, specular_reflectance=0.0), name="glass")
    pixels = np.random.default_rng(4).uniform(0.2, 0.8, (4, 4, 3)).astype(np.float32)
    wall = with_bumps(grid((-1, 0, -1), (2, 0, 0), (0, 2, 0)), 0.0, (0, 0, 1))
    normals = wall.normals + np.random.default_rng(3).uniform(-0.3, 0.3, wall.normals.shape).astype(np.float32)
    wall = dataclasses.replace(wall, normals=normals)
    rough = wrt.Principled(wrt.ImageTexture(pixels), metallic=0.5, roughness=0.5)
    scene.add(wall, material=rough, name="wall")
    metal = wrt.RoughConductor(0.4, f0=(0.8, 0.7, 0.6))
    scene.add(grid((-1, 0, 1), (2, 0, 0), (0, 0, -2)), material=metal, name="floor")
    scene.add(grid((-1, 0, 1), (0, 0, -2), (0, 2, 0)), material=wrt.Diffuse((0.6, 0.3, 0.2)), name="left")
    lamp = grid((1, 0, -1), (0, 0, 2), (0, 2, 0), count=7)
    tent = np.prod(1.0 - np.abs(2.0 * lamp.uvs - 1.0), axis=1, keepdims=True)
    lamp = dataclasses.replace(lamp, colors=(tent * (1.0, 0.9, 0.8)).astype(np.float32))
    scene.add(lamp, material=wrt.Diffuse(0.5), emission=wrt.VertexColor(factor=8.0), name="lamp")
    scene.add(grid((-1, 2, -1), (2, 0, 0), (0, 0, 2)), material=wrt.Conductor(f0=(0.9, 0.8, 0.7)), name="mirror")
    scene.add_light(wrt.PointLight((-0.3, 1.2, 0.3), 0.7))
    return scene


CASES = {
    "ball in shining room": (ball_in_shining_room, 32, 6),
    "light under ball": (light_under_ball, 64, 5),
    "room behind block": (room_behind_block, 64, 5),
}
SIZE, SEEDS, STEP = 12, 24, 0.01


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_means_are_those_of_difference_quotients(name, report):
    make, spp, depth = CASES[name]
    renderer = wrt.Renderer(make(), width=SIZE, height=SIZE, max_depth=depth, threads=2)
    found = gradients_by(renderer, ["glass.ior"], spp, SEEDS)["glass.ior"]
    quotients = []
    for seed in range(SEEDS):
        ends = []
        for step in (STEP, -STEP):
            renderer.set_parameters({"glass.ior": 1.5 + step})
            renderer.seed = seed
            ends.append(float(renderer.render(spp=spp).astype(np.float64).mean()))
        quotients.append((ends[0] - ends[1]) / (2 * STEP))
    differences = np.subtract(found, quotients)
    error, size = np.std(differences, ddof=1) / np.sqrt(SEEDS), abs(np.mean(quotients))
    z = np.mean(differences) / error
    scatter = np.std(found, ddof=1) / np.sqrt(SEEDS) / size
    report(f"{name}, z", z, f"error {error / size:.1%} of {np.mean(quotients):.4g}, of the gradient {scatter:.1%}")
    assert abs(z) < Z
    assert error < 0.04 * size
