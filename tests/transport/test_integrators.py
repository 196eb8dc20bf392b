"""Integrators are chosen by name; direct light is a short path, and occlusion is what geometry says.

Clamped indirect light and roughening along the path: what they change, what they must not.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT, Report
from support.covering_kernels import rendering_with
from support.media import KERNELS
from support.small_scenes import finish, image_of
from support.statistics import t_test_mean

import wrt
from wrt.backend import current_backend
from wrt.kernels.integrators.registry import INTEGRATORS as DEVICE_INTEGRATORS
from wrt.scene.integrators import INTEGRATORS
from wrt.upload.integrators import integrator_features


def rendered(scene: wrt.Scene, spp: int, size: int = 24, **options: Any) -> wrt.Renderer:
    options = {"sampler": "independent", "seed": 3, **options}
    renderer = wrt.Renderer(scene, width=size, height=size, **options)
    return finish(renderer, spp) if spp else renderer


few_kernels = rendering_with(*KERNELS)


def room() -> wrt.Scene:
    scene = wrt.load("cornell-box")
    scene.environment = wrt.ConstantEnvironment(0.5)
    return scene


@pytest.mark.usefixtures("render_kernels_when_launched")
def test_integrators_are_chosen_by_name() -> None:
    scene = room()
    features = wrt.Renderer(scene, width=1, height=1)._built.features
    device_names = {integrator_features(features, name, wrt.RenderSettings()).integrator for name in INTEGRATORS}
    assert device_names == set(DEVICE_INTEGRATORS)
    text = (ROOT / "docs" / "integrators.md").read_text(encoding="utf-8")
    assert all(f"| `{name}` |" in text for name in INTEGRATORS)
    scene.settings.integrator = "ao"
    assert wrt.Renderer(scene, width=2, height=2).integrator == "ao"
    with pytest.raises(wrt.InputError, match=r"integrator must be one of path, .*'bdpt'"):
        wrt.Renderer(scene, width=2, height=2, integrator="bdpt")


@pytest.mark.slow
@pytest.mark.parametrize("settings", [{"integrator": "ao"}, {"clamp_indirect": 0.5, "regularization": 0.25}])
def test_a_checkpoint_knows_its_settings(settings: dict[str, Any], tmp_path: Path) -> None:
    first = rendered(room(), 3, size=4, **settings)
    first.save_checkpoint(tmp_path / "a.ckpt")
    second = wrt.Renderer.resume(tmp_path / "a.ckpt", room())
    np.testing.assert_array_equal(image_of(first, 8), image_of(second, 8))
    changes = {"integrator": "path", "ao_distance": 0.5, "min_attenuation": 0.25, "jittered_rays": 3}
    for name, value in (
        changes if "integrator" in settings else {"clamp_indirect": 0.4, "regularization": 0.5}
    ).items():
        with pytest.raises(wrt.InputError, match=name):
            rendered(room(), 0, size=4, **{**settings, name: value}).load_checkpoint(tmp_path / "a.ckpt")


@pytest.mark.slow
def test_direct_light_is_a_path_of_two_segments(device: str) -> None:
    direct = rendered(room(), 8, integrator="direct", device=device)
    short = rendered(room(), 8, max_depth=2, device=device)
    np.testing.assert_array_equal(direct.image(), short.image())
    modules = {current_backend().kernel_of(each._kernel.scalar).module for each in (direct, short)}
    assert len(modules) == 1
    assert rendered(room(), 8, device=device).image().mean() > 1.1 * direct.image().mean()


SIDE = 1000.0


def corner(*, wall: wrt.Material | None = None) -> wrt.Scene:
    """A floor, seen one metre from a wall, both without an end, and a speck that is not opaque."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((3.0, 3.0, 0.0), (1.0, 0.0, 0.0), fov_degrees=1e-3))
    scene.add(wrt.quad((0.0, 0.0, SIDE), (SIDE, 0.0, 0.0), (0.0, 0.0, -2.0 * SIDE)))
    speck = wrt.quad((0.0, -9.0, 0.0), (1e-3, 0.0, 0.0), (0.0, 0.0, 1e-3))
    scene.add(speck, material=wrt.Diffuse(opacity=0.5))
    scene.add(speck, material=wrt.ThinDielectric())
    if wall is not None:
        scene.add(wrt.quad((0.0, 0.0, SIDE), (0.0, 0.0, -2.0 * SIDE), (0.0, SIDE, 0.0)), material=wall)
    return scene


def occlusion(scene: wrt.Scene, device: str, **options: Any) -> tuple[float, float, int]:
    image = rendered(scene, 512, size=16, integrator="ao", device=device, **options).image()
    n, mean = 512 * 256, float(image[..., 0].astype(np.float64).mean())
    return mean, mean * (1.0 - mean) / n, n  # of samples that are 0 or 1


@pytest.mark.slow
@pytest.mark.parametrize("limit", [None, 1.5])
def test_a_wall_hides_a_segment_of_the_sky(limit: float | None, device: str, report: Report) -> None:
    """Nusselt's analogue: directions that meet the wall within R project to the disk's segment beyond x/R.

    Its share of the disk is (θ − sinθ cosθ) / π with cosθ = x/R, and a half where there is no limit.
    """
    theta = np.pi / 2.0 if limit is None else np.arccos(1.0 / limit)
    expected = 1.0 - (theta - np.sin(theta) * np.cos(theta)) / np.pi
    mean, variance, n = occlusion(corner(wall=wrt.Diffuse()), device, ao_distance=limit)
    p = float(t_test_mean(mean, variance, n, expected))
    report(f"occlusion by a wall within {limit}", mean, float(expected), p=p)
    assert p > 0.01
    # Five per cent less of the wall would be noticed.
    assert t_test_mean(mean, variance, n, 1.0 - 0.95 * (1.0 - expected)) < 1e-4


@pytest.mark.slow
def test_what_is_not_opaque_hides_its_share(device: str) -> None:
    """A wall of opacity 0.3 hides 0.3 of a half, and glass all of it."""
    for wall, expected in ((wrt.Diffuse(opacity=0.3), 0.85), (wrt.ThinDielectric(), 0.5)):
        mean, variance, n = occlusion(corner(wall=wall), device)
        assert t_test_mean(mean, variance, n, expected) > 0.01


ROUGH = wrt.RoughConductor(0.03, f0=0.9)


def hall(metal: wrt.Material) -> wrt.Scene:
    """A matt floor, on which a sheet of metal gathers the light of a small lamp; and a speck of rough metal."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 2.5, 2.5), (0.0, 0.0, 0.0), fov_degrees=40.0))
    scene.add(wrt.quad((-2.0, 0.0, 2.0), (4.0, 0.0, 0.0), (0.0, 0.0, -4.0)), material=wrt.Diffuse(0.6))
    scene.add(wrt.quad((-1.5, 0.0, -1.0), (3.0, 0.0, 0.0), (0.0, 2.0, 0.0)), material=metal)
    for material in (ROUGH, wrt.Mirror(0.9)):
        scene.add(wrt.quad((0.0, -9.0, 0.0), (1e-3, 0.0, 0.0), (0.0, 0.0, -1e-3)), material=material)
    scene.add_light(wrt.PointLight((0.3, 1.2, 0.4), intensity=3.0))
    return scene


@pytest.mark.slow
def test_clamping_takes_away_from_indirect_light_alone(device: str, report: Report) -> None:
    """In each sample, so in each pixel; the lower the limit the more; and a limit above all samples takes nothing."""
    scene = hall(ROUGH)
    direct = rendered(scene, 8, max_depth=2, device=device).image()
    np.testing.assert_array_equal(rendered(scene, 8, max_depth=2, clamp_indirect=1e-6, device=device).image(), direct)
    # All that a limit near 0 leaves of long paths is just that.
    np.testing.assert_allclose(rendered(scene, 8, clamp_indirect=1e-6, device=device).image(), direct, atol=2e-5)
    limits = (None, 1e6, 1.0, 0.1)
    free, high, one, low = (rendered(scene, 64, clamp_indirect=limit, device=device) for limit in limits)
    np.testing.assert_allclose(high.image(), free.image(), rtol=1e-5)
    for higher, lower in ((free, one), (one, low)):
        assert (lower.image() <= higher.image() * (1.0 + 1e-5)).all()
        assert lower.image().mean() < 0.999 * higher.image().mean()
    noise = [float(renderer.variance().sum() ** 0.5) for renderer in (free, one, low)]
    report("noise without limit, to 1, to 0.1", " ".join(f"{x:.4g}" for x in noise))
    assert noise[2] < noise[1] < noise[0]


@pytest.mark.slow
def test_clamping_keeps_colours(device: str) -> None:
    """The strongest channel of an indirect sample is at the limit, the others in proportion."""
    outside = wrt.box((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
    scene = hall(ROUGH)
    scene.camera = wrt.PerspectiveCamera((0.0, 50.0, 0.0), (0.3, 50.1, -1.0), fov_degrees=40.0)
    albedo = np.array([0.8, 0.4, 0.2])
    inside = wrt.Mesh(outside.vertices + np.float32([0, 50, 0]), outside.faces[:, ::-1])
    scene.add(inside, material=wrt.Diffuse(tuple(albedo)), emission=1.0)
    options: dict[str, Any] = {"max_depth": 3, "strategy": "bsdf", "device": device}
    # Without noise: 1 + a directly, then a² by three segments.
    np.testing.assert_allclose(rendered(scene, 4, **options).image()[0, 0], 1.0 + albedo + albedo**2, rtol=1e-5)
    image = rendered(scene, 4, clamp_indirect=0.16, **options).image()
    np.testing.assert_allclose(image[0, 0], 1.0 + albedo + albedo**2 * (0.16 / 0.64), rtol=1e-5)


@pytest.mark.slow
def test_regularization_is_the_roughness_that_it_says(device: str, report: Report) -> None:
    """What the metal gives the floor is what one of √(α² + r²) gives; where it is seen first, it is itself."""
    options: dict[str, Any] = {"max_depth": 3, "device": device}
    on = rendered(hall(ROUGH), 64, regularization=0.4, **options)
    rougher = wrt.RoughConductor(float(np.sqrt(0.03**2 + 0.4**2)), f0=0.9)
    np.testing.assert_allclose(on.image()[16:], rendered(hall(rougher), 64, **options).image()[16:], rtol=2e-4)
    short = {"max_depth": 2, "device": device}
    seen_first = rendered(hall(ROUGH), 64, **short).image()
    np.testing.assert_array_equal(rendered(hall(ROUGH), 64, regularization=0.4, **short).image(), seen_first)
    assert (rendered(hall(rougher), 64, **short).image()[:8] != seen_first[:8]).any()
    # On the floor, the noise of glossy caustics is lower.
    off = rendered(hall(ROUGH), 64, **options)
    without, regularized = (float(r.variance()[12:].sum()) for r in (off, on))
    report("variance of a glossy caustic, off and on", without, regularized)
    assert regularized < 0.2 * without
