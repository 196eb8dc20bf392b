"""Ray trees are sums that can be written down: of mirrors, of a slab of glass, of lamps, of mixtures."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray

import wrt

FAR = 1000.0


def wall(z: float, *, facing: float) -> wrt.Mesh:
    """A large square at z, its front towards +z or −z."""
    return wrt.quad((-FAR * facing, -FAR, z), (2.0 * FAR * facing, 0.0, 0.0), (0.0, 2.0 * FAR, 0.0))


def renderer_of(scene: wrt.Scene, **options: Any) -> wrt.Renderer:
    """Return a renderer whose samples all lie in the middle of their pixels."""
    options = {"width": 1, "height": 1, "integrator": "whitted", **options}
    renderer = wrt.Renderer(scene, **options)
    renderer._inputs[2].zero_()
    return renderer


def seen(scene: wrt.Scene, *, spp: int = 1, **options: Any) -> NDArray[np.float64]:
    renderer = renderer_of(scene, **options)
    for _ in renderer.passes(spp=spp):
        pass
    return renderer.image().astype(np.float64)


def rays_of(scene: wrt.Scene, **options: Any) -> int:
    renderer = renderer_of(scene, **options)
    for _ in renderer.passes(spp=1):
        pass
    return renderer.rays


# --- Two mirrors -----------------------------------------------------------------------------------


def mirrors(reflectance: float) -> wrt.Scene:
    """Two mirrors face each other and shine with radiance 1; the camera is between them."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), fov_degrees=1.0))
    scene.add(wall(-1.0, facing=1.0), material=wrt.Mirror(reflectance), emission=1.0)
    scene.add(wall(1.0, facing=-1.0), material=wrt.Mirror(reflectance), emission=1.0)
    return scene


@pytest.mark.parametrize("depth", [1, 2, 3, 7, 20])
def test_two_mirrors_are_a_geometric_series_cut_by_depth(depth: int, device: str) -> None:
    image = seen(mirrors(0.8), max_depth=depth, min_attenuation=0.0, device=device)
    np.testing.assert_allclose(image, (1.0 - 0.8**depth) / (1.0 - 0.8), rtol=2e-6)
    assert rays_of(mirrors(0.8), max_depth=depth, min_attenuation=0.0, device=device) == depth


@pytest.mark.parametrize("limit", [0.5, 0.1, 0.03, 0.001])
def test_two_mirrors_are_a_geometric_series_cut_by_attenuation(limit: float, device: str, report: Report) -> None:
    """A ray after k reflections counts for 0.8^k and is followed where that is at least the limit."""
    rays = int(np.floor(np.log(limit) / np.log(0.8))) + 1
    found = rays_of(mirrors(0.8), max_depth=100, min_attenuation=limit, device=device)
    report(f"rays followed to {limit}", found, rays)
    assert found == rays
    image = seen(mirrors(0.8), max_depth=100, min_attenuation=limit, device=device)
    np.testing.assert_allclose(image, (1.0 - 0.8**rays) / 0.2, rtol=2e-6)


# --- A slab of glass -------------------------------------------------------------------------------

BEHIND, BEFORE = 1.0, 10.0


def slab(degrees: float, medium: wrt.Medium | None = None) -> wrt.Scene:
    """A slab between two walls that shine: seen through it the one behind, reflected the one before, by the camera."""
    angle = np.radians(degrees)
    origin = 3.0 * np.array([np.sin(angle), 0.0, np.cos(angle)])
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(tuple(origin), (0.0, 0.0, 0.0), fov_degrees=0.01))
    scene.add(wrt.box((-50.0, -50.0, -1.0), (50.0, 50.0, 0.0)), material=wrt.Dielectric(ior=1.5, interior=medium))
    scene.add(wall(-9.0, facing=1.0), material=wrt.Diffuse(0.0), emission=BEHIND)
    scene.add(wall(9.0, facing=-1.0), material=wrt.Diffuse(0.0), emission=BEFORE)
    return scene


def fresnel(degrees: float, eta: float) -> float:
    """Return the reflectance by the equations as the lecture gives them, of F_s and F_p."""
    cos_1 = np.cos(np.radians(degrees))
    cos_2 = np.sqrt(1.0 - (np.sin(np.radians(degrees)) / eta) ** 2)
    f_p = (eta * cos_1 - cos_2) / (eta * cos_1 + cos_2)
    f_s = (cos_1 - eta * cos_2) / (cos_1 + eta * cos_2)
    return float(0.5 * (f_p**2 + f_s**2))


def slab_tree(r: float, depth: int, limit: float = 0.0, crossing: float = 1.0) -> tuple[float, int]:
    """Return the radiance of the slab and the rays of its tree, followed ray by ray in double precision.

    `crossing` is the share of light that the slab's medium lets through on the way from one face to the other.
    """

    def follow(inside: bool, up: bool, weight: float, level: int) -> tuple[float, int]:
        if weight < limit or level > depth:
            return 0.0, 0
        if not inside and level > 1:  # on the way to a wall
            return weight * (BEFORE if up else BEHIND), 1
        weight *= crossing if inside else 1.0
        on = up if inside else False
        through = follow(not inside, on, weight * (1.0 - r), level + 1)
        back = follow(inside, not on, weight * r, level + 1)
        return through[0] + back[0], 1 + through[1] + back[1]

    return follow(False, False, 1.0, 1)


@pytest.mark.parametrize("degrees", [0.0, 45.0, 75.0])
def test_a_slab_sums_what_its_faces_reflect_and_refract(degrees: float, device: str, report: Report) -> None:
    r = fresnel(degrees, 1.5)
    for depth in (1, 2, 3, 4, 7, 12):
        sums = (
            BEFORE * (r * (depth >= 2) + sum((1.0 - r) ** 2 * r**k for k in range(1, depth - 2, 2)))
            + BEHIND * sum((1.0 - r) ** 2 * r**k for k in range(0, depth - 2, 2))
        )  # fmt: skip
        assert slab_tree(r, depth)[0] == pytest.approx(sums)
        found = float(seen(slab(degrees), max_depth=depth, min_attenuation=0.0, device=device)[0, 0, 0])
        assert found == pytest.approx(sums, rel=1e-5)
    report(f"radiance at {degrees:.0f} degrees", found, sums)
    # All reflections together: (1 + r)/(1 + r) of both shares.
    whole = BEFORE * 2.0 * r / (1.0 + r) + BEHIND * (1.0 - r) / (1.0 + r)
    assert found == pytest.approx(whole, rel=1e-5 + 2.0 * r**9)


@pytest.mark.parametrize("limit", [0.2, 0.05, 0.02, 0.005, 0.002, 1e-5])
def test_attenuation_prunes_the_tree_of_a_slab(limit: float, device: str, report: Report) -> None:
    """The squeeze of solid angles in glass does not count as attenuation, nor as gain."""
    radiance, rays = slab_tree(fresnel(60.0, 1.5), 64, limit)
    scene = slab(60.0)
    found = rays_of(scene, max_depth=64, min_attenuation=limit, device=device)
    report(f"rays followed to {limit}", found, rays)
    assert found == rays
    np.testing.assert_allclose(seen(scene, max_depth=64, min_attenuation=limit, device=device), radiance, rtol=1e-5)


# --- Media -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("limit", [0.05, 0.005, 1e-6])
def test_a_slab_absorbs_along_each_of_its_rays(limit: float, device: str) -> None:
    """Beer's law, source 002: I(x) = I(0) exp(−b x). What is absorbed counts for the limit on attenuation."""
    for absorption, degrees in ((1.0, 0.0), (0.3, 60.0)):
        distance = 1.0 / np.sqrt(1.0 - (np.sin(np.radians(degrees)) / 1.5) ** 2)
        scene = slab(degrees, wrt.Medium(absorption=absorption))
        left = float(np.exp(-absorption * distance))
        radiance, rays = slab_tree(fresnel(degrees, 1.5), 64, limit, left)
        assert rays < slab_tree(fresnel(degrees, 1.5), 64, limit)[1] or limit > 1e-3
        np.testing.assert_allclose(seen(scene, max_depth=64, min_attenuation=limit, device=device), radiance, rtol=2e-5)
        assert rays_of(scene, max_depth=64, min_attenuation=limit, device=device) == rays


def test_an_amber_cube_has_the_color_of_its_thickness(device: str) -> None:
    """Looked at straight; a path traces the same by random choices."""
    amber = (0.08, 0.6, 1.7)
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    scene.camera = wrt.PerspectiveCamera((0.0, 0.0, 9.0), (0.0, 0.0, 0.0), fov_degrees=0.01)
    scene.add(
        wrt.box((-0.5, -0.5, -1.0), (0.5, 0.5, 1.0)),
        material=wrt.Dielectric(ior=1.55, interior=wrt.Medium(absorption=amber)),
    )
    r, t = ((1.55 - 1.0) / (1.55 + 1.0)) ** 2, np.exp(-2.0 * np.array(amber))
    expected = r + (1.0 - r) ** 2 * t * (1.0 + r * t) / (1.0 - (r * t) ** 2)
    found = seen(scene, max_depth=20, min_attenuation=0.0, device=device)[0, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    assert found.max() - found.min() > 0.7


def test_media_dim_shadow_rays_and_shine(device: str) -> None:
    """A point light over a floor, and the camera, in a box of gas without a surface of its own."""
    gas = wrt.Medium(absorption=(0.1, 0.4, 0.9), emission=(0.5, 0.0, 0.2))
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 2.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 0.01))
    scene.add(wrt.box((-4.0, -4.0, -4.0), (4.0, 4.0, 4.0)), material=wrt.Null(interior=gas))
    scene.add(wrt.quad((-3.0, 0.0, 3.0), (6.0, 0.0, 0.0), (0.0, 0.0, -6.0)), material=wrt.Diffuse(0.5))
    scene.add_light(wrt.PointLight((0.0, 3.0, 0.0), intensity=10.0))
    absorption = np.array(gas.absorption)
    lit = 0.5 / np.pi * 10.0 / 3.0**2 * np.exp(-3.0 * absorption)
    along = np.array(gas.emission) * (1.0 - np.exp(-2.0 * absorption)) / absorption
    found = seen(scene, device=device)[0, 0]
    np.testing.assert_allclose(found, lit * np.exp(-2.0 * absorption) + along, rtol=1e-4)


def test_bodies_that_overlap_go_by_priority(device: str) -> None:
    """Water that reaches into the wall of its glass: the boundary within the wall is not there."""
    water = wrt.Dielectric(ior=1.33, interior=wrt.Medium(absorption=(1.0, 0.5, 0.2)), priority=1)
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    scene.camera = wrt.PerspectiveCamera((0.0, 0.0, 9.0), (0.0, 0.0, 0.0), fov_degrees=0.01)
    scene.add(wrt.box((-9.0, -9.0, 0.0), (9.0, 9.0, 1.0)), material=wrt.Dielectric(ior=1.5, priority=2))
    scene.add(wrt.box((-9.0, -9.0, -1.0), (9.0, 9.0, 0.5)), material=water)
    found = seen(scene, max_depth=2, min_attenuation=0.0, device=device)[0, 0]
    np.testing.assert_allclose(found, fresnel(0.0, 1.5), rtol=1e-5)  # of the front face, and nothing else yet
    found = seen(scene, max_depth=4, min_attenuation=0.0, device=device)[0, 0]
    a, b, c = fresnel(0.0, 1.5), fresnel(0.0, 1.5 / 1.33), fresnel(0.0, 1.33)
    water_left = np.exp(-1.0 * np.array((1.0, 0.5, 0.2)))
    straight = (1.0 - a) * (1.0 - b) * (1.0 - c) * water_left
    np.testing.assert_allclose(found, a + straight + (1.0 - a) ** 2 * b, rtol=1e-5)


# --- Lamps -----------------------------------------------------------------------------------------


def floor_under(light: wrt.PointLight | None = None, albedo: float = 0.6) -> wrt.Scene:
    """A floor from straight above, two metres wide, with a square of half a metre over its middle."""
    scene = wrt.Scene(
        camera=wrt.PerspectiveCamera(
            (0.0, 10.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), np.degrees(2 * np.arctan(0.1))
        )
    )
    scene.add(wrt.quad((-5.0, 0.0, 5.0), (10.0, 0.0, 0.0), (0.0, 0.0, -10.0)), material=wrt.Diffuse(albedo))
    if light is not None:
        scene.add_light(light)
        scene.add(wrt.quad((1.0, 1.0, 0.25), (0.5, 0.0, 0.0), (0.0, 0.0, -0.5)), material=wrt.Diffuse(0.0))
    return scene


def centres(n: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where on the floor the middles of the pixels lie."""
    middle = (np.arange(n) + 0.5) / n * 2.0 - 1.0
    return np.meshgrid(middle, middle)


def test_a_tube_lights_a_floor_as_the_side_that_is_seen(device: str) -> None:
    """Far from a short exact cylinder E = L cosθ 2 r l / d², of what it shows; its inside is hidden."""
    radius, length, radiance, place = 0.02, 0.1, 5.0, np.array([1.5, 3.0, 0.0])
    along = np.array([0.0, 0.0, 0.5 * length])
    for two_sided in (False, True):
        scene = floor_under()
        tube = wrt.cylinder(tuple(place - along), tuple(place + along), radius)
        scene.add(tube, material=wrt.Diffuse(0.0), emission=radiance, two_sided_emission=two_sided)
        distance = float(np.linalg.norm(place))
        expected = 0.6 / np.pi * radiance * 2.0 * radius * length * place[1] / distance**3
        np.testing.assert_allclose(seen(scene, device=device)[0, 0], expected, rtol=0.01)


def test_a_tube_that_shines_on_both_sides_counts_each_once_beyond_its_end(device: str) -> None:
    """Below its end E = L cosθ sinγ 2 r l / d² of the near wall; through the end π r² cosγ of the far one is seen.

    Of a slender tube the middle of the far wall is hidden, of a short one it is seen and counts like the near one.
    """
    radiance, place = 5.0, np.array([1.5, 3.0, 0.0])
    distance = float(np.linalg.norm(place))
    cosine, sine = place[1] / distance, place[0] / distance
    for radius, length, walls in ((0.002, 0.2, 1.0), (0.05, 0.002, 2.0)):
        along = np.array([0.0, 0.5 * length, 0.0])
        scene = floor_under()
        tube = wrt.cylinder(tuple(place - along), tuple(place + along), radius)
        scene.add(tube, material=wrt.Diffuse(0.0), emission=radiance, two_sided_emission=True)
        near = 0.6 / np.pi * radiance * cosine * sine * 2.0 * radius * length / distance**2
        found = seen(scene, device=device)[0, 0]
        np.testing.assert_allclose(found, walls * near, rtol=0.01)
        # All light of the path integrator: what shows of both walls is near wall and opening, or both walls whole.
        opening = 0.6 / np.pi * radiance * cosine * cosine * np.pi * radius**2 / distance**2
        expected = near + min(near, opening)
        path = seen(scene, spp=2**14, integrator="path", max_depth=2, device=device)[0, 0]
        np.testing.assert_allclose(path, expected, rtol=0.03)  # 3.8 standard deviations


def test_a_point_light_casts_a_hard_shadow(device: str) -> None:
    """Each pixel has I ρ cosθ / (π r²), or nothing where the way meets the square."""
    place, intensity = np.array([2.5, 2.0, 0.1]), 7.0
    scene = floor_under(wrt.PointLight(tuple(place), intensity=intensity))
    image = seen(scene, width=64, height=64, device=device)
    x, z = centres(64)
    r2 = (x - place[0]) ** 2 + place[1] ** 2 + (z - place[2]) ** 2
    # The way passes the height of the square, 1, half way to the light.
    at_x, at_z = 0.5 * (x + place[0]), 0.5 * (z + place[2])
    free = ~((at_x > 1.0) & (at_x < 1.5) & (np.abs(at_z) < 0.25))
    assert 0.02 < (~free).mean() < 0.5
    expected = free * 0.6 / np.pi * intensity * place[1] / r2**1.5
    np.testing.assert_allclose(image, np.repeat(expected[..., None], 3, axis=2), rtol=2e-5)


def test_triangles_shine_from_their_middle(device: str) -> None:
    """Of each triangle L A cosθ cosθ' ρ / (π r²)."""
    scene = floor_under()
    lamp = wrt.quad((-0.5, 3.0, -0.5), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    scene.add(lamp, material=wrt.Diffuse(0.0), emission=4.0)
    scene.camera = wrt.PerspectiveCamera(
        (0.0, 2.5, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), np.degrees(2 * np.arctan(0.4))
    )
    image = seen(scene, width=16, height=16, device=device)
    x, z = centres(16)
    expected = np.zeros((16, 16))
    for corners in lamp.vertices[lamp.faces].astype(np.float64):
        middle = corners.mean(axis=0)
        r2 = (x - middle[0]) ** 2 + 9.0 + (z - middle[2]) ** 2
        expected += 0.6 / np.pi * 4.0 * 0.5 * 9.0 / r2**2
    # A ray leaves the floor from 1.5e-5 above it, and ends as far below the lamp: of a distance to the fourth power.
    np.testing.assert_allclose(image[..., 1], expected, rtol=1e-4)


@pytest.mark.parametrize("image", [False, True], ids=["constant", "image"])
def test_ambient_light_is_the_mean_of_the_environment(image: bool, device: str) -> None:
    """A matt surface shows its reflectance times that, whatever stands in the way."""
    scene = floor_under(albedo=0.3)
    expected = 2.0
    if image:
        pixels = np.zeros((64, 4, 3), np.float32)
        pixels[:16] = 5.0  # the cap up to 45 degrees from the pole: (1 − cos 45°) / 2 of all directions
        scene.environment = wrt.ImageEnvironment(pixels, scale=2.0)
        expected = 10.0 * (1.0 - np.cos(np.pi / 4.0)) / 2.0
    else:
        scene.environment = wrt.ConstantEnvironment(expected)
    np.testing.assert_allclose(seen(scene, device=device), 0.3 * expected, rtol=1e-5)


@pytest.mark.parametrize(
    ("material", "tolerance"),
    [(wrt.Plastic(1.0), 0.02), (wrt.RoughConductor(alpha=0.3, f0=1.0, multiple_bounces=True), 0.05)],
    ids=["plastic", "rough-conductor"],
)
def test_white_surfaces_send_back_all_ambient_light(
    material: wrt.Material, tolerance: float, device: str, report: Report
) -> None:
    """The mirrored ray of a coat and sixteen directions for the rest make 1 for what is white."""
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    scene.camera = wrt.PerspectiveCamera((0.0, 1.0, 1.0), (0.0, 0.0, 0.0), fov_degrees=0.1)
    scene.add(wrt.quad((-1.0, 0.0, 1.0), (2.0, 0.0, 0.0), (0.0, 0.0, -2.0)), material=material)
    found = float(seen(scene, device=device).mean())
    report(f"{material.type_name} in a white furnace", found, 1.0)
    assert found == pytest.approx(1.0, abs=tolerance)


# --- Mixtures and what is not opaque ---------------------------------------------------------------


def test_mixtures_and_opacity_are_all_of_their_parts(device: str) -> None:
    """A sheet of opacity 0.7, a quarter of it mirror and the rest matt, between a sky and a wall that shines."""
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(2.0))
    scene.camera = wrt.PerspectiveCamera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), fov_degrees=0.1)
    material = wrt.Mix(wrt.Diffuse(0.5), wrt.Mirror(0.8), weight=0.25, opacity=0.7)
    scene.add(wrt.quad((-1.0, -1.0, 0.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0)), material=material)
    scene.add(wall(-5.0, facing=1.0), material=wrt.Mirror(0.5), emission=3.0)
    # Behind the sheet is the wall: its light, and what its mirror shows: the sheet's back, lit by ambient light, the
    # wall in the sheet's mirror, and so on; two walls as before, but for the sky through the sheet.
    matt, mirror, through = 0.7 * 0.75 * 0.5, 0.7 * 0.25 * 0.8, 0.3
    # The lamp behind shines on the sheet's back, which the camera does not see but in the wall.
    lamp = sum(3.0 * 0.5 * (2.0 * FAR) ** 2 * 25.0 / (2.0 * (FAR / 3.0) ** 2 + 25.0) ** 2 / np.pi for _ in range(2))
    shown = matt * 2.0 + mirror * 2.0
    wall_seen, weight = 0.0, 1.0
    for _ in range(40):  # alternately the wall, then the sheet's back
        wall_seen += weight * 3.0
        wall_seen += weight * 0.5 * (matt * (2.0 + lamp) + through * 2.0)
        weight *= 0.5 * mirror
    expected = shown + through * wall_seen
    image = seen(scene, max_depth=40, min_attenuation=1e-6, device=device)
    np.testing.assert_allclose(image, expected, rtol=1e-5)


# --- No random numbers -----------------------------------------------------------------------------


def glass_and_mirrors() -> wrt.Scene:
    scene = wrt.Scene(environment=wrt.ConstantEnvironment((0.2, 0.3, 0.4)))
    scene.camera = wrt.PerspectiveCamera((0.0, 1.5, 5.0), (0.0, 0.5, 0.0))
    scene.add(wrt.quad((-3.0, 0.0, 3.0), (6.0, 0.0, 0.0), (0.0, 0.0, -6.0)), material=wrt.Diffuse(0.5))
    scene.add(wrt.sphere((-0.7, 0.5, 0.0), 0.5, subdivisions=3), material=wrt.Dielectric())
    scene.add(wrt.sphere((0.7, 0.5, 0.0), 0.5, subdivisions=3), material=wrt.Mirror(0.9))
    scene.add(wrt.quad((-1.0, 3.0, -1.0), (2.0, 0.0, 0.0), (0.0, 0.0, 2.0)), emission=5.0)
    scene.add_light(wrt.PointLight((2.0, 2.0, 2.0), intensity=1.0))
    return scene


def test_the_picture_is_the_same_for_any_seed(device: str) -> None:
    """At the same points of the film: with a filter, the seed chooses these points."""
    one = seen(glass_and_mirrors(), width=48, height=32, seed=1, device=device)
    other = seen(glass_and_mirrors(), width=48, height=32, seed=2, spp=3, device=device)
    np.testing.assert_allclose(one, other, rtol=1e-6)
    assert one.std() > 0.05
    path = seen(glass_and_mirrors(), width=48, height=32, seed=1, integrator="path", device=device)
    assert (path != seen(glass_and_mirrors(), width=48, height=32, seed=2, integrator="path", device=device)).any()


@pytest.mark.usefixtures("render_kernels_when_launched")
def test_a_tree_without_limits_is_refused() -> None:
    with pytest.raises(wrt.InputError, match="min_attenuation"):
        renderer_of(glass_and_mirrors(), min_attenuation=0.0)
    renderer_of(glass_and_mirrors(), min_attenuation=0.0, max_depth=20)


# --- Jittered rays ---------------------------------------------------------------------------------

SKY = 0.1
SPECK = wrt.quad((0.0, -90.0, 0.0), (1e-3, 0.0, 0.0), (0.0, 0.0, 1e-3))
TOWARDS = np.array([-1.0, 1.0, 0.0]) / np.sqrt(2.0)
ACROSS = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)


def with_gloss() -> wrt.Scene:
    """A scene under a faint sky with a speck of each material of these tests, so that all share a kernel."""
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(SKY))
    for material in (wrt.Glossy(), wrt.Glossy(exponent=1.0), wrt.Mirror(), wrt.Diffuse(0.0)):
        scene.add(SPECK, material=material)
    scene.add_light(wrt.DiskLight((0.0, -95.0, 0.0), (0.0, -1.0, 0.0), 1e-3, radiance=1.0))
    return scene


def over_gloss(material: wrt.Material) -> wrt.Scene:
    """Gloss seen at 45 degrees from (1, 1, 0), so that the mirrored ray leads along TOWARDS."""
    scene = with_gloss()
    scene.camera = wrt.PerspectiveCamera((1.0, 1.0, 0.0), (0.0, 0.0, 0.0), fov_degrees=1e-4)
    scene.add(wrt.quad((-9.0, 0.0, 9.0), (18.0, 0.0, 0.0), (0.0, 0.0, -18.0)), material=material)
    return scene


def across_the_mirrored_ray(low: float) -> wrt.Mesh:
    """A wall two away from the gloss, perpendicular to the mirrored ray, from `low` along ACROSS to far beyond."""
    corner = 2.0 * TOWARDS + low * ACROSS + [0.0, 0.0, -4.0]
    return wrt.quad(tuple(corner), tuple(4.0 * ACROSS), (0.0, 0.0, 8.0))


@pytest.mark.parametrize("rays", [1, 16])
def test_jittered_rays_fill_the_square(rays: int, device: str, report: Report) -> None:
    """Source 002: r' = r + u U + v V with u, v uniform in ±a/2. At twice the distance the square is twice as wide."""
    side, low = 0.4, 0.15
    share = (0.5 * side * 2.0 - low) / (side * 2.0)
    radiance = np.array([1.0, 2.0, 3.0])
    scene = over_gloss(wrt.Glossy(0.8, side=side))
    scene.add(across_the_mirrored_ray(low), material=wrt.Diffuse(0.0), emission=tuple(radiance))
    found = seen(scene, spp=4096 // rays, jittered_rays=rays, device=device)[0, 0]
    report(f"red of the square, {rays} rays", found[0], 0.8 * (share + (1.0 - share) * SKY))
    np.testing.assert_allclose(found, 0.8 * (share * radiance + (1.0 - share) * SKY), rtol=0.01)


@pytest.mark.parametrize("exponent", [8.0, 200.0])
def test_jittered_rays_follow_the_lobe_of_phong(exponent: float, device: str) -> None:
    """Of a cone of half angle α around the mirrored direction light comes with the share 1 − cosⁿ⁺¹α."""
    scene = over_gloss(wrt.Glossy(0.8, exponent=exponent))
    radius = 2.0 * np.tan(np.radians(12.0))
    scene.add_light(wrt.DiskLight(tuple(2.0 * TOWARDS), tuple(-TOWARDS), radius, radiance=3.0))
    found = seen(scene, spp=4096, device=device)[0, 0]
    share = 1.0 - np.cos(np.radians(12.0)) ** (exponent + 1.0)
    np.testing.assert_allclose(found, 0.8 * (3.0 * share + (1.0 - share) * SKY), rtol=0.015)


def glossy_room() -> wrt.Scene:
    """Gloss beside gloss, a mirror, a lamp of triangles, one without extent, and a sky."""
    scene = with_gloss()
    scene.camera = wrt.PerspectiveCamera((0.0, 1.5, 4.0), (0.0, 0.4, 0.0), fov_degrees=50)
    scene.add(wrt.quad((-3.0, 0.0, 3.0), (6.0, 0.0, 0.0), (0.0, 0.0, -6.0)), material=wrt.Glossy(0.7, side=0.6))
    scene.add(wrt.quad((-2.0, 0.0, -1.5), (4.0, 0.0, 0.0), (0.0, 3.0, 0.0)), material=wrt.Glossy(0.9, exponent=20.0))
    scene.add(wrt.quad((-2.0, 0.0, 1.5), (0.0, 0.0, -3.0), (0.0, 2.0, 0.0)), material=wrt.Mirror(0.6))
    scene.add(wrt.quad((0.5, 1.0, -1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)), emission=4.0, material=wrt.Diffuse(0.0))
    scene.add_light(wrt.PointLight((1.0, 2.0, 2.0), intensity=2.0))
    return scene


@pytest.mark.parametrize("rays", [1, 5])
def test_a_tree_of_gloss_has_the_light_of_paths(rays: int, device: str, report: Report) -> None:
    """Where nothing is matt, trees of jittered rays are unbiased, and so are paths."""
    options: dict[str, Any] = {"width": 8, "height": 6, "max_depth": 6, "device": device, "sampler": "independent"}
    found = seen(glossy_room(), spp=512, min_attenuation=0.0, jittered_rays=rays, **options)
    path = seen(glossy_room(), spp=2048, integrator="path", **options)
    report(f"mean radiance, {rays} rays", found.mean(), path.mean())
    np.testing.assert_allclose(found.mean(axis=(0, 1)), path.mean(axis=(0, 1)), rtol=0.02)


def test_without_jittered_rays_gloss_has_direct_light(device: str) -> None:
    """With none, the camera's ray and shadow rays to both triangles of the lamp; with seven, those instead."""
    scene = over_gloss(wrt.Glossy(0.8, side=2.0))
    scene.add(across_the_mirrored_ray(-2.0), material=wrt.Diffuse(0.0), emission=1.0)
    assert rays_of(scene, jittered_rays=0, device=device) == 3
    assert rays_of(scene, jittered_rays=7, device=device) == 8


@pytest.mark.parametrize("bad", [-1, 17, 1.5])
def test_impossible_numbers_of_jittered_rays_are_refused(bad: float) -> None:
    with pytest.raises(wrt.InputError, match="jittered_rays"):
        wrt.RenderSettings(jittered_rays=bad)  # type: ignore[arg-type]
