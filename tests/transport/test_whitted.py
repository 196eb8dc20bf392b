"""Ray trees are sums that can be written down: of mirrors, of a slab of glass, of lamps, of mixtures."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.fresnel import cook_torrance as fresnel
from support.small_scenes import finish

import wrt
from wrt.upload.integrators import mean_radiance

FAR = 1000.0
FAINT = 1e-9
"""Radiance of a sky that makes all scenes share kernels and is too faint to count."""

AMBER = wrt.Medium(absorption=(0.08, 0.6, 1.7))
SIMPLE = (wrt.Glossy(), wrt.Glossy(exponent=1.0), wrt.Mirror(), wrt.Diffuse(0.0), wrt.Dielectric(), wrt.Plastic())
SIMPLE += (wrt.RoughConductor(multiple_bounces=True),)
BODIES = (wrt.RoughDielectric(), wrt.Dielectric(interior=AMBER, priority=1), wrt.Null(interior=AMBER))
BODIES += (wrt.Mix(wrt.Diffuse(0.5), wrt.Mirror(0.8), opacity=0.7),)


def scene_from(origin: Any, target: Any = (0.0, 0.0, 0.0), *, sky: float = FAINT, bodies: bool = False, **view: Any):
    """Return a scene with a camera and, out of sight, a speck of each material and light, so that all share kernels.

    One kernel has `bodies`, which are media by priority, rough glass and mixtures; one is without.
    """
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(sky))
    scene.camera = wrt.PerspectiveCamera(tuple(origin), tuple(target), **{"fov_degrees": 0.01, **view})
    for material in SIMPLE + (BODIES if bodies else ()):
        scene.add(wrt.box((0.0, -90.001, 0.0), (1e-3, -90.0, 1e-3)), material=material)
    scene.add_light(wrt.DiskLight((0.0, -95.0, 0.0), (0.0, -1.0, 0.0), 1e-3, radiance=1.0))
    return scene


def wall(z: float, *, facing: float) -> wrt.Mesh:
    """A large square at z, its front towards +z or −z."""
    return wrt.quad((-FAR * facing, -FAR, z), (2.0 * FAR * facing, 0.0, 0.0), (0.0, 2.0 * FAR, 0.0))


def rendered(scene: wrt.Scene, device: str, *, spp: int = 1, size: tuple[int, int] = (1, 1), **options: Any):
    """Return a renderer whose samples all lie in the middle of their pixels."""
    options = {"integrator": "whitted", "sampler": "independent", "light_choice": "power", "device": device, **options}
    renderer = wrt.Renderer(scene, width=size[0], height=size[1], **options)
    renderer._inputs[2].zero_()
    return finish(renderer, spp)


def seen(scene: wrt.Scene, device: str, **options: Any) -> NDArray[np.float64]:
    return rendered(scene, device, **options).image().astype(np.float64)


def mirrors() -> wrt.Scene:
    """Two mirrors of 0.8 face each other and emit radiance 1; the camera is between them."""
    scene = scene_from((0.0, 0.0, 0.0), (0.0, 0.0, -1.0))
    scene.add(wall(-1.0, facing=1.0), material=wrt.Mirror(0.8), emission=1.0)
    scene.add(wall(1.0, facing=-1.0), material=wrt.Mirror(0.8), emission=1.0)
    return scene


@pytest.mark.parametrize(("depth", "limit", "rays"), [(1, 0.0, 1), (20, 0.0, 20), (99, 0.5, 4), (99, 0.001, 31)])
def test_two_mirrors_are_a_geometric_series_cut_by_depth_and_attenuation(
    depth: int, limit: float, rays: int, device: str
) -> None:
    """A ray after k reflections has the weight 0.8^k and is followed if that reaches the limit."""
    renderer = rendered(mirrors(), device, max_depth=depth, min_attenuation=limit)
    assert renderer.rays == rays
    np.testing.assert_allclose(renderer.image(), (1.0 - 0.8**rays) / 0.2, rtol=2e-6)


@pytest.mark.usefixtures("render_kernels_when_launched")
def test_a_tree_without_limits_is_refused() -> None:
    with pytest.raises(wrt.InputError, match="min_attenuation"):
        wrt.Renderer(mirrors(), width=1, height=1, integrator="whitted", min_attenuation=0.0)


BEHIND, BEFORE = 1.0, 10.0


def slab(degrees: float, medium: wrt.Medium | None = None) -> wrt.Scene:
    """A slab between two emissive walls: the camera sees one through it, and the one on its own side reflected."""
    angle = np.radians(degrees)
    scene = scene_from(3.0 * np.array([np.sin(angle), 0.0, np.cos(angle)]), bodies=medium is not None)
    scene.add(wrt.box((-50.0, -50.0, -1.0), (50.0, 50.0, 0.0)), material=wrt.Dielectric(ior=1.5, interior=medium))
    scene.add(wall(-9.0, facing=1.0), material=wrt.Diffuse(0.0), emission=BEHIND)
    scene.add(wall(9.0, facing=-1.0), material=wrt.Diffuse(0.0), emission=BEFORE)
    return scene


def slab_tree(r: float, depth: int, limit: float = 0.0, crossing: float = 1.0) -> tuple[float, int]:
    """Return the radiance of the slab and the rays of its tree, followed ray by ray in double precision.

    `crossing` is the transmittance of the slab's medium from one face to the other.
    """

    def follow(inside: bool, up: bool, weight: float, level: int) -> tuple[float, int]:
        if weight < limit or level > depth:
            return 0.0, 0
        if not inside and level > 1:  # towards a wall
            return weight * (BEFORE if up else BEHIND), 1
        weight *= crossing if inside else 1.0
        on = up if inside else False
        through = follow(not inside, on, weight * (1.0 - r), level + 1)
        back = follow(inside, not on, weight * r, level + 1)
        return through[0] + back[0], 1 + through[1] + back[1]

    return follow(False, False, 1.0, 1)


@pytest.mark.parametrize(
    ("depth", "limit", "absorption"),
    [
        *((1, 0.0, 0.0), (12, 0.0, 0.0), (64, 0.02, 0.0), (64, 0.002, 0.0)),
        pytest.param(64, 0.002, 0.3, marks=pytest.mark.slow),
    ],
)
def test_the_tree_of_a_slab_is_cut_by_depth_and_attenuation(
    depth: int, limit: float, absorption: float, device: str
) -> None:
    """The squeeze of solid angles in glass does not count as attenuation, nor as gain; what is absorbed does.

    Beer's law, source 002: I(x) = I(0) exp(−b x).
    """
    r = fresnel(np.cos(np.radians(60.0)), 1.5)
    crossing = float(np.exp(-absorption / np.sqrt(1.0 - (np.sin(np.radians(60.0)) / 1.5) ** 2)))
    radiance, rays = slab_tree(r, depth, limit, crossing)
    medium = wrt.Medium(absorption=absorption) if absorption else None
    renderer = rendered(slab(60.0, medium), device, max_depth=depth, min_attenuation=limit)
    assert renderer.rays == rays
    np.testing.assert_allclose(renderer.image(), radiance, rtol=2e-5)


@pytest.mark.slow
def test_an_amber_cube_has_the_color_of_its_thickness(device: str) -> None:
    scene = scene_from((0.0, 0.0, 9.0), sky=1.0, bodies=True)
    scene.add(wrt.box((-0.5, -0.5, -1.0), (0.5, 0.5, 1.0)), material=wrt.Dielectric(ior=1.55, interior=AMBER))
    r, t = fresnel(1.0, 1.55), np.exp(-2.0 * np.array(AMBER.absorption))
    expected = r + (1.0 - r) ** 2 * t * (1.0 + r * t) / (1.0 - (r * t) ** 2)
    found = seen(scene, device, max_depth=20, min_attenuation=0.0)[0, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    assert np.ptp(found) > 0.7


@pytest.mark.slow
def test_a_lamp_inside_tinted_rough_glass_shines_as_for_paths(device: str) -> None:
    """At all angles: with one lamp without extent, paths of two segments have hardly any noise either."""
    scene = scene_from((1.5, 0.4, 2.0), fov_degrees=30.0, bodies=True)
    glass = wrt.RoughDielectric(1.5, alpha=0.3, interior=AMBER)
    scene.add(wrt.box((-2.0, -2.0, -3.0), (2.0, 2.0, 0.0)), material=glass)
    scene.add_light(wrt.PointLight((0.0, 0.0, -0.5), intensity=2.0))
    tree, path = (seen(scene, device, size=(16, 12), max_depth=2, integrator=name) for name in ("whitted", "path"))
    assert (path > 1e-4).sum() > 60
    np.testing.assert_allclose(tree, path, rtol=2e-3, atol=1e-6)


@pytest.mark.slow
def test_media_dim_shadow_rays_and_shine(device: str) -> None:
    """A point light over a floor, and the camera, in a box of gas without a surface of its own."""
    gas = wrt.Medium(absorption=(0.1, 0.4, 0.9), emission=(0.5, 0.0, 0.2))
    scene = scene_from((0.0, 2.0, 0.0), up=(0.0, 0.0, -1.0), bodies=True)
    scene.add(wrt.box((-4.0, -4.0, -4.0), (4.0, 4.0, 4.0)), material=wrt.Null(interior=gas))
    scene.add(wrt.quad((-3.0, 0.0, 3.0), (6.0, 0.0, 0.0), (0.0, 0.0, -6.0)), material=wrt.Diffuse(0.5))
    scene.add_light(wrt.PointLight((0.0, 3.0, 0.0), intensity=10.0))
    absorption = np.array(gas.absorption)
    lit = 0.5 / np.pi * 10.0 / 3.0**2 * np.exp(-3.0 * absorption)
    along = np.array(gas.emission) * (1.0 - np.exp(-2.0 * absorption)) / absorption
    np.testing.assert_allclose(seen(scene, device)[0, 0], lit * np.exp(-2.0 * absorption) + along, rtol=1e-4)


@pytest.mark.slow
def test_bodies_that_overlap_go_by_priority(device: str) -> None:
    """Water that reaches into the wall of its glass: the boundary within the wall is not there."""
    tint = np.array((1.0, 0.5, 0.2))
    water = wrt.Dielectric(ior=1.33, interior=wrt.Medium(absorption=tuple(tint)), priority=1)
    scene = scene_from((0.0, 0.0, 9.0), sky=1.0, bodies=True)
    scene.add(wrt.box((-9.0, -9.0, 0.0), (9.0, 9.0, 1.0)), material=wrt.Dielectric(ior=1.5, priority=2))
    scene.add(wrt.box((-9.0, -9.0, -1.0), (9.0, 9.0, 0.5)), material=water)
    a, b, c = fresnel(1.0, 1.5), fresnel(1.0, 1.5 / 1.33), fresnel(1.0, 1.33)
    found = seen(scene, device, max_depth=2, min_attenuation=0.0)[0, 0]
    np.testing.assert_allclose(found, a, rtol=1e-5)  # of the front face, and nothing else yet
    found = seen(scene, device, max_depth=4, min_attenuation=0.0)[0, 0]
    straight = (1.0 - a) * (1.0 - b) * (1.0 - c) * np.exp(-tint)
    np.testing.assert_allclose(found, a + straight + (1.0 - a) ** 2 * b, rtol=1e-5)


@pytest.mark.slow
def test_mixtures_and_opacity_are_all_of_their_parts(device: str) -> None:
    """A sheet of opacity 0.7, a quarter of it mirror and the rest matt, between a sky and an emissive wall."""
    scene = scene_from((0.0, 0.0, 3.0), sky=2.0, bodies=True)
    material = wrt.Mix(wrt.Diffuse(0.5), wrt.Mirror(0.8), weight=0.25, opacity=0.7)
    scene.add(wrt.quad((-1.0, -1.0, 0.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0)), material=material)
    scene.add(wall(-5.0, facing=1.0), material=wrt.Diffuse(0.0), emission=3.0)
    expected = 0.7 * (0.75 * 0.5 + 0.25 * 0.8) * 2.0 + 0.3 * 3.0
    np.testing.assert_allclose(seen(scene, device, max_depth=4, min_attenuation=1e-6), expected, rtol=1e-5)


def floor_under(albedo: float = 0.6, height: float = 10.0, sky: float = FAINT) -> wrt.Scene:
    """A floor from straight above; the picture is two metres wide."""
    fov = np.degrees(2 * np.arctan(1.0 / height))
    scene = scene_from((0.0, height, 0.0), up=(0.0, 0.0, -1.0), fov_degrees=fov, sky=sky)
    scene.add(wrt.quad((-5.0, 0.0, 5.0), (10.0, 0.0, 0.0), (0.0, 0.0, -10.0)), material=wrt.Diffuse(albedo))
    return scene


@pytest.mark.slow
def test_triangles_shine_from_their_middle(device: str) -> None:
    """Of each triangle L A cosθ cosθ' ρ / (π r²)."""
    scene = floor_under(height=2.5)
    lamp = wrt.quad((-0.5, 3.0, -0.5), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    scene.add(lamp, material=wrt.Diffuse(0.0), emission=4.0)
    x, z = np.meshgrid(*2 * [(np.arange(16) + 0.5) / 8.0 - 1.0])
    expected = np.zeros((16, 16))
    for corners in lamp.vertices[lamp.faces].astype(np.float64):
        middle = corners.mean(axis=0)
        expected += 0.6 / np.pi * 4.0 * 0.5 * 9.0 / ((x - middle[0]) ** 2 + 9.0 + (z - middle[2]) ** 2) ** 2
    # A ray leaves the floor from 1.5e-5 above it, and ends as far below the lamp: of a distance to the fourth power.
    np.testing.assert_allclose(seen(scene, device, size=(16, 16))[..., 1], expected, rtol=1e-4)


@pytest.mark.slow
def test_tubes_shine_from_the_sides_that_are_seen(device: str) -> None:
    """Far below the end of an exact cylinder E = L cosθ sinγ 2 r l / d² of the near wall.

    The inside emits too. A slender tube hides the middle of its far wall; a short one shows it, and it counts like the
    near one.
    """
    radiance, place = 5.0, np.array([1.5, 3.0, 0.0])
    near_wall = 0.6 / np.pi * radiance * 2.0 * place[0] * place[1] / np.linalg.norm(place) ** 4
    for radius, length, walls in ((0.002, 0.2, 1.0), (0.05, 0.002, 2.0)):
        along = np.array((0.0, 0.5 * length, 0.0))
        scene = floor_under()
        tube = wrt.cylinder(tuple(place - along), tuple(place + along), radius)
        scene.add(tube, material=wrt.Diffuse(0.0), emission=radiance, two_sided_emission=True)
        np.testing.assert_allclose(seen(scene, device)[0, 0], walls * near_wall * radius * length, rtol=0.01)


def test_ambient_light_is_the_mean_of_the_environment(device: str) -> None:
    """A matt surface shows its reflectance times that, whatever stands in the way."""
    np.testing.assert_allclose(seen(floor_under(albedo=0.3, sky=2.0), device), 0.3 * 2.0, rtol=1e-5)
    pixels = np.zeros((64, 4, 3), np.float32)
    pixels[:16] = 5.0  # the cap up to 45 degrees from the pole: (1 − cos 45°) / 2 of all directions
    image = wrt.ImageEnvironment(pixels, scale=2.0)
    np.testing.assert_allclose(mean_radiance(wrt.Scene(environment=image)), 5.0 * (1.0 - np.sqrt(0.5)), rtol=1e-6)


@pytest.mark.parametrize(
    ("material", "tolerance"),
    [
        (wrt.Plastic(1.0), 0.02),
        pytest.param(wrt.RoughConductor(alpha=0.3, f0=1.0, multiple_bounces=True), 0.05, marks=pytest.mark.slow),
    ],
)
def test_white_surfaces_send_back_all_ambient_light(material: wrt.Material, tolerance: float, device: str) -> None:
    """The mirrored ray of a coat and sixteen directions for the rest make 1 for what is white."""
    scene = scene_from((0.0, 1.0, 1.0), sky=1.0, fov_degrees=0.1)
    scene.add(wrt.quad((-1.0, 0.0, 1.0), (2.0, 0.0, 0.0), (0.0, 0.0, -2.0)), material=material)
    assert float(seen(scene, device).mean()) == pytest.approx(1.0, abs=tolerance)


def test_the_picture_is_the_same_for_any_seed(device: str) -> None:
    """At the same points of the film: with a filter, the seed chooses these points."""
    scene = scene_from((0.0, 1.5, 5.0), (0.0, 0.5, 0.0), sky=0.3, fov_degrees=45.0)
    scene.add(wrt.quad((-3.0, 0.0, 3.0), (6.0, 0.0, 0.0), (0.0, 0.0, -6.0)), material=wrt.Diffuse(0.5))
    scene.add(wrt.sphere((-0.7, 0.5, 0.0), 0.5, subdivisions=3), material=wrt.Dielectric())
    scene.add(wrt.sphere((0.7, 0.5, 0.0), 0.5, subdivisions=3), material=wrt.Mirror(0.9))
    scene.add(wrt.quad((-1.0, 3.0, -1.0), (2.0, 0.0, 0.0), (0.0, 0.0, 2.0)), emission=5.0)
    scene.add_light(wrt.PointLight((2.0, 2.0, 2.0), intensity=1.0))
    first, second = (seen(scene, device, size=(48, 32), seed=seed, spp=seed) for seed in (1, 3))
    np.testing.assert_allclose(first, second, rtol=1e-6)
    assert first.std() > 0.05


SKY = 0.1
TOWARDS = np.array([-1.0, 1.0, 0.0]) / np.sqrt(2.0)
ACROSS = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)


def over_gloss(material: wrt.Material) -> wrt.Scene:
    """Gloss seen at 45 degrees from (1, 1, 0), so that the mirrored ray leads along TOWARDS."""
    scene = scene_from((1.0, 1.0, 0.0), sky=SKY, fov_degrees=1e-4)
    scene.add(wrt.quad((-9.0, 0.0, 9.0), (18.0, 0.0, 0.0), (0.0, 0.0, -18.0)), material=material)
    return scene


def across_the_mirrored_ray(low: float) -> wrt.Mesh:
    """A wall two away from the gloss, perpendicular to the mirrored ray, from `low` along ACROSS to far beyond."""
    corner = 2.0 * TOWARDS + low * ACROSS + [0.0, 0.0, -4.0]
    return wrt.quad(tuple(corner), tuple(4.0 * ACROSS), (0.0, 0.0, 8.0))


@pytest.mark.parametrize("rays", [1, 16])
def test_jittered_rays_fill_the_square(rays: int, device: str) -> None:
    """Source 002: r' = r + u U + v V with u, v uniform in ±a/2. At twice the distance the square is twice as wide."""
    side, low = 0.4, 0.15
    share = (0.5 * side * 2.0 - low) / (side * 2.0)
    radiance = np.array([1.0, 2.0, 3.0])
    scene = over_gloss(wrt.Glossy(0.8, side=side))
    scene.add(across_the_mirrored_ray(low), material=wrt.Diffuse(0.0), emission=tuple(radiance))
    found = seen(scene, device, size=(32, 32), spp=128 // rays, jittered_rays=rays).mean(axis=(0, 1))
    np.testing.assert_allclose(found, 0.8 * (share * radiance + (1.0 - share) * SKY), rtol=0.01)
    direct = over_gloss(wrt.Glossy(0.8, side=2.0))
    direct.add(across_the_mirrored_ray(-2.0), material=wrt.Diffuse(0.0), emission=1.0)
    # With none, the camera's ray and shadow rays to both triangles of the lamp; with jittered rays, those instead.
    assert rendered(direct, device, jittered_rays=0).rays == 3
    assert rendered(direct, device, jittered_rays=rays).rays == 1 + rays


def test_jittered_rays_follow_the_lobe_of_phong(device: str) -> None:
    """Of a cone of half angle α around the mirrored direction light comes with the share 1 − cosⁿ⁺¹α."""
    exponent = 8.0
    scene = over_gloss(wrt.Glossy(0.8, exponent=exponent))
    radius = 2.0 * np.tan(np.radians(12.0))
    scene.add_light(wrt.DiskLight(tuple(2.0 * TOWARDS), tuple(-TOWARDS), radius, radiance=3.0))
    found = seen(scene, device, size=(32, 32), spp=128).mean(axis=(0, 1))
    share = 1.0 - np.cos(np.radians(12.0)) ** (exponent + 1.0)
    np.testing.assert_allclose(found, 0.8 * (3.0 * share + (1.0 - share) * SKY), rtol=0.015)


@pytest.mark.slow
def test_a_tree_of_gloss_has_the_light_of_paths(device: str, report: Report) -> None:
    """Where nothing is matt, trees of jittered rays are unbiased, and so are paths.

    Gloss beside gloss, a mirror, a lamp of triangles, one without extent, and a sky.
    """
    scene = scene_from((0.0, 1.5, 4.0), (0.0, 0.4, 0.0), sky=SKY, fov_degrees=50.0)
    scene.add(wrt.quad((-3.0, 0.0, 3.0), (6.0, 0.0, 0.0), (0.0, 0.0, -6.0)), material=wrt.Glossy(0.7, side=0.6))
    scene.add(wrt.quad((-2.0, 0.0, -1.5), (4.0, 0.0, 0.0), (0.0, 3.0, 0.0)), material=wrt.Glossy(0.9, exponent=20.0))
    scene.add(wrt.quad((-2.0, 0.0, 1.5), (0.0, 0.0, -3.0), (0.0, 2.0, 0.0)), material=wrt.Mirror(0.6))
    scene.add(wrt.quad((0.5, 1.0, -1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)), emission=4.0, material=wrt.Diffuse(0.0))
    scene.add_light(wrt.PointLight((1.0, 2.0, 2.0), intensity=2.0))
    found = seen(scene, device, size=(8, 6), spp=512, min_attenuation=0.0, max_depth=6, jittered_rays=5)
    path = seen(scene, device, size=(8, 6), spp=2048, integrator="path", max_depth=6)
    report("mean radiance", found.mean(), path.mean())
    np.testing.assert_allclose(found.mean(axis=(0, 1)), path.mean(axis=(0, 1)), rtol=0.02)
