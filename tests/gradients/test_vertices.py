"""Derivatives by vertices and normals: closed forms, difference quotients, and what setting them does."""

import dataclasses

import numpy as np
import pytest
from support.grids import grid, with_bumps

import wrt
from wrt.gradients.places import Points
from wrt.scene.normals import following_normals, through_normals

Z = 4.5
"""The greatest z of a dozen numbers: a right program exceeds it once in 10,000 runs."""


def test_derivatives_through_normals_are_difference_quotients():
    """With two vertices in one place, a triangle without area, and an open edge."""
    mesh = with_bumps(grid((0, 0, 0), (1, 0, 0), (0, 0, 1)), 0.2, (0, 1, 0))
    seam = np.vstack([mesh.faces[1:], [[16, *mesh.faces[0, 1:]], [3, 3, 7]]])
    copied = np.append(np.arange(16), mesh.faces[0, 0])
    mesh = wrt.Mesh(mesh.vertices[copied], seam, mesh.normals[copied])
    gradient = np.random.default_rng(1).normal(size=(17, 3))
    found = through_normals(mesh, gradient)
    for seed in range(4):
        step = 1e-2 * np.random.default_rng(seed).normal(size=(17, 3))
        step[16] = step[copied[16]]

        def loss(scale, step=step):
            moved = (mesh.vertices + scale * step).astype(np.float32)
            return float((following_normals(mesh, moved).astype(np.float64) * gradient).sum())

        slope = (8.0 * (loss(0.5) - loss(-0.5)) - (loss(1.0) - loss(-1.0))) / 6.0
        assert (found * step).sum() == pytest.approx(slope, abs=2e-3 * np.abs(found * step).sum())


def test_names_and_what_is_refused():
    """Of shapes as they are in the world; before anything is compiled."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0, 1, 3), (0, 0, 0)), environment=wrt.ConstantEnvironment(1.0))
    scene.add(grid((0, 0, 0), (1, 0, 0), (0, 0, 1)), name="flat")
    scene.add(wrt.sphere(subdivisions=1), name="smooth")
    scene.add(wrt.sphere(exact=True), name="exact")
    scene.add(wrt.box(), transform=np.diag([2.0, 1.0, 1.0, 1.0]), name="turned")
    names = [name for name in wrt.parameters(scene) if name.endswith(("vertices", "normals"))]
    assert names == ["flat.vertices", "smooth.vertices", "smooth.normals"]
    renderer = wrt.Renderer(scene, width=8, height=8)
    with pytest.raises(wrt.InputError, match="no derivatives by vertices and normals in scenes with exact shapes"):
        renderer.gradients(np.ones((8, 8, 3)), ["flat.vertices"], spp=1)
    values = wrt.parameters(scene)
    with pytest.raises(wrt.InputError, match=r"flat\.vertices: a number is 2e\+12; rays reach to 1e\+12"):
        renderer.set_parameters({"flat.vertices": values["flat.vertices"] + 2e12})
    renderer.update_vertices(0, 2.0 * values["flat.vertices"])
    with pytest.raises(wrt.InputError, match="vertices were updated"):
        renderer.set_parameters({"flat.vertices": 3.0 * values["flat.vertices"]})


# --- Closed forms ----------------------------------------------------------------------------------

RAMP = np.linspace(0.2, 0.8, 8)[None, :, None] * np.ones((8, 1, 3))


def floor_under(light, colors, *, by_mirror, emission=0.0):
    """Return a renderer that sees one point of a floor of changing reflectance, directly or in a mirror."""
    value = wrt.ImageTexture(RAMP.astype(np.float32), wrap="clamp") if colors is None else wrt.VertexColor()
    origin, target = ((1, 3, 0.02), (0.03, 3, 0.02)) if by_mirror else ((0.03, 2, 0.02), (0.03, 0, 0.02))
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(origin, target, up=(0, 0, 1), fov_degrees=0.001))
    mirror = wrt.quad((-0.001, 2.969, -0.011), (0.062, 0.062, 0), (0, 0, 0.062))
    scene.add(mirror, material=wrt.Mirror(1.0), name="mirror")
    mesh = grid((-1, 0, -1), (2, 0, 0), (0, 0, 2), count=2, colors=colors)
    scene.add(
        dataclasses.replace(mesh, faces=mesh.faces[:, ::-1]),
        material=wrt.Diffuse(value),
        emission=emission,
        name="floor",
    )
    if light is not None:
        scene.add_light(light)
    return wrt.Renderer(scene, width=2, height=2, max_depth=3, threads=1)


COLORS = np.array([[0.2], [0.2], [0.9], [0.9]]) * np.ones(3)


@pytest.mark.slow
@pytest.mark.parametrize("by_mirror", [False, True])
@pytest.mark.parametrize("colors", [None, COLORS])
def test_a_floor_is_as_bright_as_its_height_slope_and_place_tell(colors, by_mirror):
    """L = ρ(x) E(p) n·l / π at the point p of the floor y = h + s (x − x0) where the ray x = x0 meets it.

    The floor slides by t along x, so that ρ is that of x0 − t.
    """
    place, x = np.array([0.03, 0.0, 0.02]), 0.03
    spot, towards = np.array([0.5, 1.5, 0.2]), np.array([0.3, 1.0, 0.2]) / np.sqrt(1.13)
    slope = 0.6 * 8 / 7 / 2 if colors is None else 0.7 / 2
    rho = 0.5 + slope * x if colors is None else 0.55 + slope * x
    d = spot - place
    r = np.linalg.norm(d)
    cases = (
        (wrt.PointLight(spot, 3.0), 3.0 * d[1] / r**3, 3.0 * (3 * d[1] ** 2 / r**5 - 1 / r**3), -3.0 * d[0] / r**3),
        (wrt.DirectionalLight(-towards, 2.0), 2.0 * towards[1], 0.0, -2.0 * towards[0]),
    )
    for light, lit, by_height, by_slope in cases:
        renderer = floor_under(light, colors, by_mirror=by_mirror)
        found = renderer.gradients(np.full((2, 2, 3), 1 / 12), "floor.vertices", spp=4)["floor.vertices"]
        vertices = wrt.parameters(renderer)["floor.vertices"]
        raised, slid = np.zeros((2, 4, 3))
        raised[:, 1], slid[:, 0] = vertices[:, 0] - x, 1.0
        assert renderer.render(spp=4).mean() == pytest.approx(rho * lit / np.pi, rel=1e-4)
        assert found[:, 1].sum() == pytest.approx(rho * by_height / np.pi, rel=1e-3, abs=1e-6)
        assert (found * raised).sum() == pytest.approx(rho * by_slope / np.pi, rel=1e-3)
        assert (found * slid).sum() == pytest.approx(-slope * lit / np.pi, rel=1e-3)
        assert found[:, 2].sum() == pytest.approx(0.0, abs=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(("wrap", "scale", "slope"), [("repeat", 1.0, 1.0), ("mirror", 3.0, -3.0)])
def test_an_image_that_shines_slides_along(wrap, scale, slope):
    """Where it is mirrored it falls."""
    image = wrt.ImageTexture(RAMP.astype(np.float32), wrap=wrap, scale=scale)
    renderer = floor_under(None, COLORS, by_mirror=False, emission=image)
    found = renderer.gradients(np.full((2, 2, 3), 1 / 12), "floor.vertices", spp=4)["floor.vertices"]
    assert found[:, 0].sum() == pytest.approx(-slope * 0.6 * 8 / 7 / 2, rel=1e-3)
    assert np.abs(found[:, 1:].sum(axis=0)).max() < 1e-5


# --- Difference quotients --------------------------------------------------------------------------


def room():
    """Return a room without a shadow: the camera sees a wall of three by three squares with normals, and no corner."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.1, 0.9, 0.9), (0, 1, -1), fov_degrees=35))
    pixels = np.random.default_rng(4).uniform(0.2, 0.8, (4, 4, 3)).astype(np.float32)
    wall = with_bumps(grid((-1, 0, -1), (2, 0, 0), (0, 2, 0)), 0.0, (0, 0, 1))
    scene.add(wall, material=wrt.Diffuse(wrt.ImageTexture(pixels)), name="wall")
    metal = wrt.RoughConductor(0.4, f0=(0.8, 0.7, 0.6))
    scene.add(grid((-1, 0, 1), (2, 0, 0), (0, 0, -2)), material=metal, name="floor")
    scene.add(grid((-1, 0, 1), (0, 0, -2), (0, 2, 0)), material=wrt.Diffuse((0.6, 0.3, 0.2)), name="left")
    scene.add(grid((1, 0, -1), (0, 0, 2), (0, 2, 0)), material=wrt.Diffuse(0.5), name="right")
    scene.add(grid((1, 0, 1), (-2, 0, 0), (0, 2, 0)), material=wrt.Diffuse(0.5), name="front")
    scene.add(grid((-1, 2, -1), (2, 0, 0), (0, 0, 2)), material=wrt.Diffuse(0.3), emission=(3, 4, 5), name="lamp")
    return scene


def field(seed):
    """Return a smooth motion of the room: a linear one, and a product of coordinates that folds its walls a little."""
    linear, product = np.random.default_rng(seed).normal(size=(2, 3, 3))
    return lambda p: (p - (0, 1, 0)) @ linear + 0.3 * ((p * p[:, [1, 2, 0]]) @ product)


NAMES = [f"{each}.vertices" for each in ("wall", "floor", "left", "right", "front", "lamp")]
SPP, SEEDS, SIZE = 128, 24, 10


@pytest.mark.slow
def test_means_are_those_of_difference_quotients(report):
    """All walls move together, so none covers another; normals of the wall that is seen follow, or turn alone."""
    renderer = wrt.Renderer(room(), width=SIZE, height=SIZE, max_depth=4, threads=2)
    start = wrt.parameters(renderer)
    motions = {
        f"motion {seed}": {name: field(seed)(start[name].astype(np.float64)) for name in NAMES} for seed in (1, 2)
    }
    motions["normals"] = {"wall.normals": np.random.default_rng(3).uniform((-0.2, 0.2, 0.0), 1.0, (16, 3))}
    d_image = np.random.default_rng(6).uniform(0.5, 1.5, (SIZE, SIZE, 3)) / SIZE**2
    differences, sizes = ({name: [] for name in motions} for _ in range(2))
    for seed in range(SEEDS):
        moving, turning = (
            renderer.gradients(d_image, names, spp=SPP, seed=1000 + seed) for names in (NAMES, ["wall.normals"])
        )
        for name, motion in motions.items():
            ends = []
            for step in (0.01, -0.01):
                renderer.set_parameters({each: start[each] + step * motion[each] for each in motion})
                renderer.seed = seed
                ends.append(float((renderer.render(spp=SPP).astype(np.float64) * d_image).sum()))
            renderer.set_parameters({each: start[each] for each in (*NAMES, "wall.normals")})
            found = {**moving, **turning}
            sizes[name].append(sum(float((found[each] * motion[each]).sum()) for each in motion))
            differences[name].append(sizes[name][-1] - (ends[0] - ends[1]) / 0.02)
    for name, of_seeds in differences.items():
        error, size = np.std(of_seeds, ddof=1) / np.sqrt(SEEDS), abs(np.mean(sizes[name]))
        z = np.mean(of_seeds) / error
        report(f"{name}, z", z, f"error {error / size:.1%} of {np.mean(sizes[name]):.4g}")
        assert abs(z) < Z, name
        assert error < 0.05 * size, name


@pytest.mark.slow
def test_setting_has_the_bits_of_a_new_renderer():
    """Also of a lamp, and of normals that follow or are given."""
    renderer = wrt.Renderer(room(), width=SIZE, height=SIZE, threads=2)
    start = wrt.parameters(renderer)
    moved = {name: start[name] + 0.05 * field(1)(start[name]) for name in NAMES}
    given = {"wall.normals": start["wall.normals"] + 0.1}
    for values in (moved, given, {**moved, **given}):
        renderer.set_parameters(values)
        fresh = wrt.Renderer(renderer.scene, width=SIZE, height=SIZE, threads=2)
        image = renderer.render(spp=8)
        np.testing.assert_array_equal(image, fresh.render(spp=8))
        renderer.set_parameters(start)
        assert not np.array_equal(image, renderer.render(spp=8))
    assert isinstance(start["wall.normals"], np.ndarray)
    assert Points(0, renderer.scene.shapes[0].mesh, "normals").value.tobytes() == start["wall.normals"].tobytes()
