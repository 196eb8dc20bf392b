"""Clamped indirect light and roughening along the path: what they change, what they must not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Report

import wrt


def render(scene: wrt.Scene, spp: int, **options: Any) -> wrt.Renderer:
    renderer = wrt.Renderer(scene, **{"sampler": "independent", "width": 24, "height": 24, "seed": 3, **options})
    for _ in renderer.passes(spp=spp):
        pass
    return renderer


def hall(metal: wrt.Material) -> wrt.Scene:
    """A matt floor, on which a curved sheet of metal gathers the light of a small lamp."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 2.5, 2.5), (0.0, 0.0, 0.0), fov_degrees=40.0))
    scene.add(wrt.quad((-2.0, 0.0, 2.0), (4.0, 0.0, 0.0), (0.0, 0.0, -4.0)), material=wrt.Diffuse(0.6))
    scene.add(wrt.quad((-1.5, 0.0, -1.0), (3.0, 0.0, 0.0), (0.0, 2.0, 0.0)), material=metal)
    scene.add_light(wrt.PointLight((0.3, 1.2, 0.4), intensity=3.0))
    return scene


ROUGH = wrt.RoughConductor(0.03, f0=0.9)


# --- Clamping --------------------------------------------------------------------------------------


def test_clamping_leaves_emission_and_direct_light_alone(device: str) -> None:
    """Paths of one and two segments are the same bits, however low the limit."""
    scene = wrt.load("cornell-box")
    for depth in (1, 2):
        plain = render(scene, 8, max_depth=depth, device=device)
        clamped = render(scene, 8, max_depth=depth, clamp_indirect=1e-6, device=device)
        np.testing.assert_array_equal(plain.image(), clamped.image())
        assert plain.image().max() > 0.1
    # And all that a limit near 0 leaves of long paths is just that.
    np.testing.assert_allclose(render(scene, 8, clamp_indirect=1e-6, device=device).image(), plain.image(), atol=2e-6)


@pytest.mark.slow
def test_clamping_only_takes_away(device: str, report: Report) -> None:
    """In each sample, so in each pixel; the lower the limit the more; and a limit above all samples takes nothing."""
    scene = hall(ROUGH)
    plain = render(scene, 64, device=device)
    noise = []
    last = plain.image()
    for limit in (1e6, 1.0, 0.1):
        clamped = render(scene, 64, clamp_indirect=limit, device=device)
        assert (clamped.image() <= last * (1.0 + 1e-5)).all()
        if limit == 1e6:
            np.testing.assert_allclose(clamped.image(), plain.image(), rtol=1e-5)
        else:
            assert clamped.image().mean() < 0.999 * last.mean()
        last = clamped.image()
        noise.append(float(clamped.variance().sum() ** 0.5))
    report("noise without limit, to 1, to 0.1", " ".join(f"{x:.4g}" for x in noise))
    assert noise[2] < noise[1] < noise[0]


def test_clamping_keeps_colours(device: str) -> None:
    """The strongest channel of an indirect sample is at the limit, the others in proportion."""
    outside = wrt.box((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 0.0, 0.0), (0.3, 0.1, -1.0), fov_degrees=40.0))
    albedo = np.array([0.8, 0.4, 0.2])
    scene.add(wrt.Mesh(outside.vertices, outside.faces[:, ::-1]), material=wrt.Diffuse(tuple(albedo)), emission=1.0)
    options: dict[str, Any] = {"max_depth": 3, "strategy": "bsdf", "device": device}
    # Without noise: 1 + a directly, then a² by three segments.
    np.testing.assert_allclose(render(scene, 4, **options).image()[0, 0], 1.0 + albedo + albedo**2, rtol=1e-5)
    image = render(scene, 4, clamp_indirect=0.16, **options).image()
    np.testing.assert_allclose(image[0, 0], 1.0 + albedo + albedo**2 * (0.16 / 0.64), rtol=1e-5)


# --- Roughening along the path ---------------------------------------------------------------------


@pytest.mark.slow
def test_regularization_lowers_the_noise_of_glossy_caustics(device: str, report: Report) -> None:
    off = render(hall(ROUGH), 64, device=device)
    zero = render(hall(ROUGH), 64, regularization=0.0, device=device)
    np.testing.assert_array_equal(off.image(), zero.image())
    on = render(hall(ROUGH), 64, regularization=0.3, device=device)
    # On the floor; the metal itself is seen as it is.
    before, after = (float(r.variance()[12:].sum()) for r in (off, on))
    report("variance of a glossy caustic, off and on", before, after)
    assert after < 0.2 * before


def test_regularization_is_the_roughness_that_it_says(device: str) -> None:
    """What the metal gives the floor is what one of √(α² + r²) gives; where it is seen first, it is itself."""
    options: dict[str, Any] = {"max_depth": 3, "device": device}
    on = render(hall(ROUGH), 64, regularization=0.4, **options).image()
    rougher = wrt.RoughConductor(float(np.sqrt(0.03**2 + 0.4**2)), f0=0.9)
    np.testing.assert_allclose(on[16:], render(hall(rougher), 64, **options).image()[16:], rtol=2e-4)
    own = {"max_depth": 2, "device": device}
    seen_first = render(hall(ROUGH), 64, **own).image()
    np.testing.assert_array_equal(render(hall(ROUGH), 64, regularization=0.4, **own).image(), seen_first)
    assert (render(hall(rougher), 64, **own).image()[:8] != seen_first[:8]).any()


@pytest.mark.slow
@pytest.mark.parametrize("metal", [wrt.Diffuse(0.5), wrt.Mirror(0.9)], ids=["matt", "smooth"])
def test_without_rough_surfaces_nothing_changes(metal: wrt.Material, device: str) -> None:
    plain, on = (render(hall(metal), 8, regularization=r, device=device).image() for r in (0.0, 0.5))
    np.testing.assert_array_equal(plain, on)


# --- Settings --------------------------------------------------------------------------------------


@pytest.mark.slow
def test_checkpoints_know_both(tmp_path: Path) -> None:
    scene = wrt.load("cornell-box")
    first = render(scene, 3, clamp_indirect=0.5, regularization=0.25)
    first.save_checkpoint(tmp_path / "a.ckpt")
    second = wrt.Renderer.resume(tmp_path / "a.ckpt", scene)
    assert (second.settings.clamp_indirect, second.settings.regularization) == (0.5, 0.25)
    for renderer in (first, second):
        for _ in renderer.passes(spp=8):
            pass
    np.testing.assert_array_equal(first.image(), second.image())
    with pytest.raises(wrt.InputError, match=r"clamp_indirect \(0.5 there, None here\), regularization \(0.25 there"):
        wrt.Renderer(scene, sampler="independent", width=24, height=24, seed=3).load_checkpoint(tmp_path / "a.ckpt")


@pytest.mark.parametrize("wrong", [{"clamp_indirect": 0.0}, {"regularization": 1.5}, {"regularization": -0.1}])
def test_wrong_values_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(wrt.InputError, match=next(iter(wrong))):
        wrt.RenderSettings(**wrong)  # type: ignore[arg-type]
