"""A ball of each material that Mitsuba 3 has too, under a sky with a bright patch, looks as Mitsuba draws it.

Faceted balls, so that both programs mean the same by a normal, compared by `image_z_test` as in
test_against_mitsuba.py. What the two do differently by design is bridged here, as derived in
test_plastic_of_mitsuba.py: how much light a coat sends back to its base is a mean of 64 values, or a fit, in Mitsuba.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import pytest
from conftest import Report

import wrt

pytest.importorskip("mitsuba", reason="the independent renderer is not installed")

from support.covering_kernels import covering, render_with
from support.mitsuba_scene import Reference, render_reference
from support.statistics import sidak
from test_against_mitsuba import Case, compare
from test_plastic_of_mitsuba import COLOR, MASKING, FittedPlastic, internal_of

from wrt.backend.device import Device
from wrt.scene.textures import ColorSource
from wrt.upload.materials import model_name
from wrt.upload.tables.material_tables import table
from wrt.values import Vec3

pytestmark = pytest.mark.slow

CAMERA = wrt.PerspectiveCamera(origin=(0.6, 0.8, 4.0), target=(0.0, 0.0, 0.0), fov_degrees=29.0)


def ball() -> wrt.Mesh:
    """A ball of 320 flat triangles; texture coordinates are longitude and height, without a seam in any triangle."""
    sphere = wrt.sphere(subdivisions=2)
    corners = sphere.vertices[sphere.faces].astype(np.float64)
    longitude = np.arctan2(corners[..., 0], corners[..., 2])
    longitude += 2.0 * np.pi * np.rint((longitude[:, :1] - longitude) / (2.0 * np.pi))
    uvs = np.stack([longitude, corners[..., 1]], axis=2).reshape(-1, 2).astype(np.float32)
    return wrt.Mesh(corners.reshape(-1, 3), np.arange(len(uvs)).reshape(-1, 3), uvs=uvs, name="ball")


def sky() -> wrt.ImageEnvironment:
    """Random colours, with bright patches 11 degrees wide here and there: what is sharp and what is blurred shows."""
    random = np.random.default_rng(5)
    pixels = random.random((16, 32, 3)).astype(np.float32)
    pixels[random.random((16, 32)) < 0.06] = (9.0, 7.0, 5.0)
    return wrt.ImageEnvironment(pixels, scale=0.5, rotation_degrees=37.0)


def scene_of(material: wrt.Material) -> wrt.Scene:
    scene = wrt.Scene(camera=CAMERA, environment=sky())
    scene.add(ball(), material=material)
    return scene


class CoatedAsInMitsuba(wrt.RoughPlastic):
    """Rough plastic whose coat sends the base's light back as often as Mitsuba's: 1 / (1 − R) by its mean for R."""

    @property
    def slots(self) -> tuple[ColorSource, ...]:
        color, *others = super().slots
        eta = self.relative_ior
        theirs = internal_of(self.distribution, self.alpha, eta, "cpu")
        ours = float(table(self.table_key, Device("cpu"))[2])
        return (tuple((1.0 - ours) / (1.0 - theirs) * x for x in color), *others)


def facets(alpha: float | tuple[float, float], distribution: str) -> dict[str, Any]:
    """Return the arguments of a rough material, masked as in Mitsuba."""
    return {"alpha": alpha, "distribution": distribution, "masking": MASKING[distribution]}


def coated(alpha: float, distribution: str = "ggx", color: Vec3 = COLOR, **arguments: Any) -> CoatedAsInMitsuba:
    return CoatedAsInMitsuba(color, multiple_bounces=False, **facets(alpha, distribution), **arguments)


def metal(alpha: float | tuple[float, float], distribution: str = "ggx", **arguments: Any) -> wrt.RoughConductor:
    return wrt.RoughConductor(**facets(alpha, distribution), **arguments)


def ground_glass(alpha: float | tuple[float, float], distribution: str = "ggx") -> wrt.RoughDielectric:
    return wrt.RoughDielectric(**facets(alpha, distribution), **TINTS)


BLACK = (0.0, 0.0, 0.0)
TINTS = {"specular_reflectance": (0.9, 0.5, 0.7), "specular_transmittance": (0.6, 0.9, 1.0)}
GOLD = (1.0, 0.78, 0.34)

MATERIALS: dict[str, tuple[wrt.Material, wrt.Material]] = {
    "rough conductor, ggx": (metal(0.3), metal(0.33)),
    "rough conductor, ggx, brushed": (metal((0.15, 0.5)), metal((0.5, 0.15))),
    "rough conductor, beckmann": (metal(0.3, "beckmann"), metal(0.33, "beckmann")),
    "rough conductor, beckmann, brushed": (metal((0.5, 0.15), "beckmann"), metal((0.45, 0.15), "beckmann")),
    "rough conductor by its colour": (metal(0.2, f0=GOLD), metal(0.22, f0=GOLD)),
    "rough dielectric, ggx": (ground_glass(0.3), ground_glass(0.33)),
    "rough dielectric, ggx, brushed": (ground_glass((0.1, 0.4)), ground_glass((0.4, 0.1))),
    "rough dielectric, beckmann": (ground_glass(0.1, "beckmann"), ground_glass(0.11, "beckmann")),
    "dielectric, tinted": (wrt.Dielectric(1.5, **TINTS), wrt.Dielectric(1.55, **TINTS)),
    "thin dielectric, tinted": (wrt.ThinDielectric(1.5, **TINTS), wrt.ThinDielectric(1.55, **TINTS)),
    "plastic": (FittedPlastic(COLOR), FittedPlastic(COLOR, 1.55)),
    "plastic, deep colours": (FittedPlastic(COLOR, nonlinear=True), FittedPlastic(COLOR, nonlinear=False)),
    "rough plastic, coat alone": (
        coated(0.2, color=BLACK, specular_reflectance=(1.0, 0.5, 0.2)),
        coated(0.22, color=BLACK, specular_reflectance=(1.0, 0.5, 0.2)),
    ),
    "rough plastic, ggx": (coated(0.2), coated(0.22)),
    "rough plastic, beckmann": (coated(0.2, "beckmann"), coated(0.22, "beckmann")),
    "principled metal": (
        wrt.Principled(GOLD, metallic=1.0, roughness=0.3),
        wrt.Principled(GOLD, metallic=1.0, roughness=0.315),
    ),
}
"""Each with a wrong one, which must be told from it: a roughness 10 % off (5 % before it is squared), or along the
other axis; another index.

Metal in `principled` has Smith's masking correlated here, and not in Mitsuba: at this roughness that is some per cent
at the rim alone. Rough glass by Beckmann has a low roughness, where Walter's fit, by which Mitsuba weighs what it draws
exactly, differs at the rim alone: at α = 0.3 four boundaries on the way may make it 0.3 %."""

CASE = Case(wrt.Scene, max_depth=16, spp=512, reference_spp=512, size=(32, 32))
SIGNIFICANCE = sidak(0.01, len(MATERIALS))
KERNEL = covering(*{model_name(material) for material, _ in MATERIALS.values()})


@pytest.fixture(autouse=True)
def one_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    """Render all balls with one kernel, which still chooses the model of each."""
    render_with([KERNEL], monkeypatch)


@functools.cache
def reference(name: str) -> Reference:
    width, height = CASE.size
    scene = scene_of(MATERIALS[name][0])
    return render_reference(scene, width=width, height=height, max_depth=CASE.max_depth, spp=CASE.reference_spp, seed=3)


@pytest.mark.parametrize("name", MATERIALS)
def test_ball_looks_alike(name: str, device: str, report: Report) -> None:
    result = compare(scene_of(MATERIALS[name][0]), CASE, reference(name), device, CASE.spp)
    report("mean against Mitsuba, per cent", f"{100.0 * result.relative_difference[1]:+.3f}", 0, p=result.mean_p)
    report("smallest p of 4x4 blocks; their spread", result.block_p, p=result.spread_p)
    report("share of pixels that pass", result.pass_fraction, ">= 0.995", p=result.p_min)
    assert result.agrees(significance=SIGNIFICANCE), result.message


@pytest.mark.parametrize("name", MATERIALS)
def test_another_material_would_be_seen(name: str, report: Report) -> None:
    result = compare(scene_of(MATERIALS[name][1]), CASE, reference(name), "cpu", CASE.spp)
    report("p", min(result.mean_p, result.spread_p, result.block_p), f"< {sidak(SIGNIFICANCE, 3):.2g}")
    assert not result.agrees(significance=SIGNIFICANCE), result.message
