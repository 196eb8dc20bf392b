"""Integrators are chosen by name; direct light is a short path, and occlusion is what geometry says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT, Report
from support.statistics import t_test_mean

import wrt
from wrt.kernels.integrators.registry import INTEGRATORS as DEVICE_INTEGRATORS
from wrt.scene.scene import INTEGRATORS
from wrt.upload.integrators import integrator_features


def rendered(scene: wrt.Scene, spp: int, **options: Any) -> wrt.Renderer:
    renderer = wrt.Renderer(scene, **options)
    for _ in renderer.passes(spp=spp):
        pass
    return renderer


def room() -> wrt.Scene:
    scene = wrt.load("cornell-box")
    scene.environment = wrt.ConstantEnvironment(0.5)
    return scene


# --- By name ---------------------------------------------------------------------------------------


def test_every_name_has_a_kernel_and_no_other() -> None:
    features = wrt.Renderer(room(), width=1, height=1)._built.features
    needed = {integrator_features(features, name, wrt.RenderSettings()).integrator for name in INTEGRATORS}
    assert needed == set(DEVICE_INTEGRATORS)
    assert integrator_features(features, "path", wrt.RenderSettings()) == features


def test_the_scene_or_the_caller_chooses(tmp_path: Path) -> None:
    scene = room()
    assert wrt.Renderer(scene, width=2, height=2).integrator == "path"
    scene.settings.integrator = "ao"
    assert wrt.Renderer(scene, width=2, height=2).integrator == "ao"
    assert wrt.Renderer(scene, width=2, height=2, integrator="aov").integrator == "aov"
    np.testing.assert_array_equal(wrt.render(scene, width=2, height=2, spp=1, integrator="aov"), 0.0)
    with pytest.raises(wrt.InputError, match=r"integrator must be one of path, .*'bdpt'"):
        wrt.Renderer(scene, width=2, height=2, integrator="bdpt")


def test_a_scene_file_chooses(tmp_path: Path) -> None:
    file = tmp_path / "a.toml"
    file.write_text('[settings]\nintegrator = "whitted"\nmin_attenuation = 0.25\nao_distance = 2.0\n')
    settings = wrt.load(file).settings
    assert (settings.integrator, settings.min_attenuation, settings.ao_distance) == ("whitted", 0.25, 2.0)
    file.write_text('[settings]\nintegrator = "wittet"\n')
    with pytest.raises(wrt.InputError, match=r"a.toml: settings: integrator must be one of"):
        wrt.load(file)


@pytest.mark.parametrize(
    "change", [{"integrator": "aov"}, {"ao_distance": 0.5}, {"min_attenuation": 0.25}, {"jittered_rays": 3}]
)
def test_checkpoints_know_the_integrator(change: dict[str, Any], tmp_path: Path) -> None:
    options: dict[str, Any] = {"width": 4, "height": 4, "integrator": "ao"}
    first = rendered(room(), 3, **options)
    first.save_checkpoint(tmp_path / "a.ckpt")
    second = wrt.Renderer.resume(tmp_path / "a.ckpt", room())
    assert second.integrator == "ao"
    for renderer in (first, second):
        for _ in renderer.passes(spp=8):
            pass
    np.testing.assert_array_equal(first.image(), second.image())
    with pytest.raises(wrt.InputError, match=next(iter(change))):
        wrt.Renderer(room(), **{**options, **change}).load_checkpoint(tmp_path / "a.ckpt")


# --- Direct light ----------------------------------------------------------------------------------


@pytest.mark.parametrize("strategy", ["mis", "light", "bsdf"])
def test_direct_light_is_a_path_of_two_segments(strategy: str, device: str) -> None:
    options: dict[str, Any] = {"width": 24, "height": 24, "strategy": strategy, "device": device}
    direct = rendered(room(), 8, integrator="direct", **options)
    short = rendered(room(), 8, max_depth=2, **options)
    np.testing.assert_array_equal(direct.image(), short.image())
    assert direct._kernel.scalar is short._kernel.scalar
    long = rendered(room(), 8, **options)
    assert long.image().mean() > 1.1 * direct.image().mean()
    emitted = rendered(room(), 8, integrator="direct", max_depth=1, **options)
    np.testing.assert_array_equal(emitted.image(), rendered(room(), 8, max_depth=1, **options).image())


# --- Ambient occlusion -----------------------------------------------------------------------------

SIDE = 1000.0


def corner(x: float, *, wall: bool = True) -> wrt.Scene:
    """A floor, seen at the distance x from a wall, both without an end."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((x + 2.0, 3.0, 0.0), (x, 0.0, 0.0), fov_degrees=1e-3))
    scene.add(wrt.quad((0.0, 0.0, SIDE), (SIDE, 0.0, 0.0), (0.0, 0.0, -2.0 * SIDE)))
    if wall:
        scene.add(wrt.quad((0.0, 0.0, SIDE), (0.0, 0.0, -2.0 * SIDE), (0.0, SIDE, 0.0)))
    return scene


def mean_of(scene: wrt.Scene, device: str, **options: Any) -> tuple[float, float, int]:
    renderer = rendered(scene, 512, width=16, height=16, integrator="ao", device=device, **options)
    n = 512 * 256
    mean = float(renderer.image()[..., 0].astype(np.float64).mean())
    return mean, mean * (1.0 - mean) / n, n  # of samples that are 0 or 1


def test_nothing_hides_the_sky_from_a_plane(device: str) -> None:
    assert mean_of(corner(1.0, wall=False), device)[0] == 1.0


@pytest.mark.parametrize("limit", [None, 5.0, 1.5, 1.0])
def test_a_wall_hides_a_segment_of_the_sky(limit: float | None, device: str, report: Report) -> None:
    """Nusselt's analogue: directions that meet the wall within R project to the disk's segment beyond x/R.

    Its share of the disk is (θ − sinθ cosθ) / π with cosθ = x/R, and a half where there is no limit.
    """
    theta = np.pi / 2.0 if limit is None else np.arccos(1.0 / limit)
    expected = 1.0 - (theta - np.sin(theta) * np.cos(theta)) / np.pi
    mean, variance, n = mean_of(corner(1.0), device, ao_distance=limit)
    if limit == 1.0:
        assert mean == expected == 1.0
        return
    p = float(t_test_mean(mean, variance, n, expected))
    report(f"occlusion by a wall within {limit}", mean, float(expected), p=p)
    assert p > 0.01
    # Five per cent less of the wall would be noticed.
    assert t_test_mean(mean, variance, n, 1.0 - 0.95 * (1.0 - expected)) < 1e-4


def test_a_closed_box_hides_all_of_the_sky(device: str) -> None:
    outside = wrt.box((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 0.0, 0.0), (0.1, -1.0, 0.2), fov_degrees=5.0))
    scene.add(wrt.Mesh(outside.vertices, outside.faces[:, ::-1]))
    assert mean_of(scene, device)[0] == 0.0
    assert mean_of(scene, device, ao_distance=0.5)[0] == 1.0


def test_what_is_not_opaque_hides_its_share(device: str, report: Report) -> None:
    """A wall of opacity 0.3 hides 0.3 of a half."""
    scene = corner(1.0)
    glazed = wrt.Diffuse(opacity=0.3)
    scene.shapes[1] = wrt.Shape(scene.shapes[1].mesh, glazed)
    mean, variance, n = mean_of(scene, device)
    report("occlusion by a wall of opacity 0.3", mean, 0.85)
    assert t_test_mean(mean, variance, n, 0.85) > 0.01


def test_rays_that_meet_nothing_are_white(device: str) -> None:
    scene = corner(1.0)
    scene.camera = wrt.PerspectiveCamera((1.0, 1.0, 0.0), (2.0, 2.0, 0.0), fov_degrees=1.0)
    assert mean_of(scene, device)[0] == 1.0


def test_a_pane_hides_the_sky_with_and_without_layers(device: str) -> None:
    """What else is asked for changes nothing: a wall of glass hides half as one of plaster does."""
    scene = corner(1.0)
    scene.shapes[1] = wrt.Shape(scene.shapes[1].mesh, wrt.ThinDielectric())
    plain = rendered(scene, 64, width=8, height=8, integrator="ao", device=device)
    layered = rendered(scene, 64, width=8, height=8, integrator="ao", layers=("albedo",), device=device)
    np.testing.assert_array_equal(plain.image(), layered.image())
    assert plain.image().mean() == pytest.approx(0.5, abs=0.05)


def test_the_docs_name_every_integrator() -> None:
    text = (ROOT / "docs" / "integrators.md").read_text(encoding="utf-8")
    for name in INTEGRATORS:
        assert f"| `{name}` |" in text
