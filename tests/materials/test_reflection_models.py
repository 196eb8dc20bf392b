"""What every reflection model must meet: samples follow the density, reciprocity, no energy made, nothing infinite."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest
from conftest import Report
from support.bsdfs import (
    FLAT,
    Bumpy,
    Case,
    Tilted,
    albedo,
    assert_finite,
    assert_nothing_goes_through,
    assert_weights,
    chi_square,
    reciprocity_error,
    sphere,
    transmission_error,
)
from support.kernels import uniforms
from support.measurements import ISOTROPIC, arbitrary, azimuths
from support.small_scenes import image_of

import wrt
from wrt.kernels.bsdf.lobes.principled_base import FEATURE_ROWS
from wrt.kernels.microfacet import DISTRIBUTIONS, MASKINGS
from wrt.scene.materials import MATERIALS
from wrt.scene.materials.measured import Measurement

P = wrt.Principled
GOLD, RGB = (1.0, 0.71, 0.29), (0.8, 0.4, 0.0)
WHITE = {"f0": 1.0, "multiple_bounces": True}
FILM = {"film_thickness": 350.0, "film_ior": 1.4}
VARIANCE = (0.03, 0.01)
TURNED = P((0.9, 0.6, 0.3), 0.3, 0.5, anisotropy=0.6, anisotropy_rotation=0.5, transmission=0.5)
LAYERED = dataclasses.replace(TURNED, coat=0.5, coat_roughness=0.35)
EVERYTHING = dataclasses.replace(LAYERED, sheen_color=(0.5, 0.3, 0.1), sheen_roughness=0.4, multiple_bounces=True)
LACQUER = wrt.Burley((0.7, 0.3, 0.2), coat=0.8, coat_gloss=0.3, roughness=0.4)
BURLEYS_GLASS = wrt.Burley((0.7, 0.3, 0.2), transmission=0.7, ior=1.4, metallic=0.2)
BURLEYS_PANE = wrt.Burley(RGB, thin_walled=True, transmission=0.6, diffuse_transmission=0.25, anisotropy=0.4, sheen=0.3)
MILK = P((0.9, 0.7, 0.5), roughness=0.6, transmission=0.5, specular=0.5)


class Row(NamedTuple):
    """A material and what is known of it.

    Attributes:
        case: the material from one side.
        angles: degrees at which samples are compared with the density; none for lobes finer than the cells, and deltas.
        quick: whether it is the one of its kind that runs before each commit.
        reciprocal, conserving: whether it is; some published models are not.
        weights: whether `evaluate` and `sample` agree to rounding; tables of measurements are tested by themselves.
    """

    case: Case
    angles: tuple[float, ...] = (60.0,)
    quick: bool = False
    reciprocal: bool = True
    conserving: bool = True
    weights: bool = True


def row(material: wrt.Material, *angles: float, back: bool = False, bumpy: bool = False, **properties: bool) -> Row:
    case = Bumpy(material, not back, VARIANCE) if bumpy else Case(material, not back)
    return Row(case, angles, **properties)


def tilted(material: wrt.Principled, *angles: float, back: bool = False) -> Row:
    """Return the row of a coat with normals of its own. Each layer is reciprocal with the cosine about its normal."""
    material = dataclasses.replace(material, coat_normal_map=FLAT)
    return Row(Tilted(material, not back, (0.3, -0.2, 1.0), (-0.25, 0.3, 1.0)), angles, reciprocal=False)


def metal(alpha: Any, distribution: str = "ggx", masking: str = "smith", **options: Any) -> wrt.RoughConductor:
    return wrt.RoughConductor(alpha, distribution=distribution, masking=masking, **options)


def glass(alpha: Any, ior: float = 1.5, **options: Any) -> wrt.RoughDielectric:
    return wrt.RoughDielectric(ior, alpha=alpha, **options)


def measured(tables: Measurement, *angles: float, quick: bool = False) -> Row:
    """Return the row of a material that is as reciprocal and keeps as much energy as its data."""
    return Row(Case(wrt.Measured(tables)), angles, quick, reciprocal=False, conserving=False, weights=False)


TABLE = {
    "diffuse": row(wrt.Diffuse((0.8, 0.5, 0.0)), 45, quick=True),
    "diffuse, back": row(wrt.Diffuse(1.0), 89, back=True),
    "oren-nayar": row(wrt.OrenNayar((0.9, 0.4, 0.0), 0.35), 80, quick=True),
    "oren-nayar, rough, back": row(wrt.OrenNayar((0.9, 0.4, 0.0), 0.5 * math.pi), 0, 45, 89, back=True),
    "mirror": row(wrt.Mirror((0.9, 0.5, 0.0)), quick=True),
    "square": row(wrt.Glossy(RGB, 0.3), quick=True, reciprocal=False),
    "phong": row(wrt.Glossy(RGB, exponent=20.0), 0, 60, 85, reciprocal=False),
    "copper": row(wrt.Conductor(), quick=True),
    "coloured mirror": row(wrt.Conductor(f0=GOLD)),
    "filmed copper": row(wrt.Conductor(**FILM)),
    # Rough metals
    "ggx": row(metal((0.1, 0.5)), 0, 60, 89, quick=True),
    "ggx 1": row(metal(1.0), 0, 89),
    "beckmann": row(metal((0.7, 0.2), "beckmann"), 45, 89),
    "beckmann 0.1, walter": row(metal(0.1, "beckmann", "walter"), 60),
    "blinn-phong": row(metal(0.3, "blinn-phong", "walter"), 0, 80),
    "abc": row(metal((100.0, 1.2), "abc", "cook-torrance"), 60),
    "sgd": row(metal((0.1, 0.6), "sgd", "kelemen"), 60),
    "separable": row(metal(0.4, masking="smith-separable"), 60),
    "implicit": row(metal(0.3, masking="implicit", f0=0.5), 45),
    "ggx, all bounces": row(metal(0.6, **WHITE), 0, 60, 89),
    "brushed beckmann, all bounces": row(metal((0.1, 0.4), "beckmann", **WHITE), 45),
    "filmed metal": row(metal(0.3, **FILM), 45),
    "beckmann 1e-3, 0.5": row(metal((1e-3, 0.5), "beckmann")),
    "ggx, bumpy": row(metal((0.1, 0.3), masking="smith-separable"), 0, 60, bumpy=True),
    "cook-torrance, bumpy": row(metal(0.2, masking="cook-torrance"), 60, bumpy=True),
    # Boundaries
    "glass": row(wrt.Dielectric(1.5), quick=True),
    "bubble, inside": row(wrt.Dielectric(1.0, exterior_ior=1.33), back=True),
    "glass by schlick": row(wrt.Dielectric(1.5, fresnel="schlick", specular_transmittance=0.5)),
    "prism": row(wrt.Dielectric(1.5, dispersion=4.0), back=True),
    "pane": row(wrt.ThinDielectric(1.5), quick=True),
    "null": row(wrt.Null(), quick=True),
    "ground glass": row(glass(0.3), 60, 89, quick=True),
    "ground glass, inside": row(glass(0.3), 0, 60, back=True),
    "ground glass 1": row(glass(1.0), 0, 80),
    "ground beckmann": row(glass(0.3, distribution="beckmann", masking="walter"), 60),
    "brushed glass, inside": row(glass((0.1, 0.5), 1.33), 60, back=True),
    "ground glass, all bounces": row(glass(0.6, multiple_bounces=True), 60),
    "brushed glass, all bounces, inside": row(glass((0.1, 0.5), 1.33, multiple_bounces=True), 60, back=True),
    "rough prism": row(glass(0.3, 1.7, dispersion=4.0), 45, 80, back=True),
    "ground glass, bumpy": row(glass(0.2), 60, bumpy=True),
    "ground glass, bumpy, inside": row(glass(0.2), 0, back=True, bumpy=True),
    # Plastics
    "plastic": row(wrt.Plastic(RGB), 45, 80, quick=True),
    "plastic, deep colours, back": row(wrt.Plastic(RGB, nonlinear=True), 89, back=True),
    "rough plastic": row(wrt.RoughPlastic(RGB, alpha=0.3, specular_reflectance=0.5), 45, 80, quick=True),
    "rough plastic 0.03, back": row(wrt.RoughPlastic(RGB, alpha=0.03), 80, back=True),
    "rough plastic 1": row(wrt.RoughPlastic(RGB, alpha=1.0, nonlinear=True, multiple_bounces=True), 0, 89),
    "beckmann plastic": row(wrt.RoughPlastic(RGB, alpha=0.3, distribution="beckmann", masking="walter"), 45),
    # The material of glTF
    "principled": row(P((0.8, 0.2, 0.0), metallic=0.5, roughness=0.4), 45, 80, quick=True),
    "specular-glossiness": row(P(0.0, ior=0.0, specular_color=GOLD, roughness=0.3), 80),
    "brushed": row(P(GOLD, metallic=0.7, roughness=0.4, anisotropy=0.8, anisotropy_rotation=0.5), 0, 60),
    "brushed plastic": row(P(1.0, roughness=0.4, anisotropy=0.8), 45),
    "clear body, inside": row(P(1.0, transmission=1.0), 45, back=True),
    "milk glass, inside": row(MILK, 0, 80, back=True),
    "coated body, inside": row(P(1.0, roughness=0.3, transmission=1.0, coat=1.0), back=True),
    "sheet": row(P((0.9, 0.7, 0.5), transmission=0.8, thin_walled=True), 45, 89),
    "coated": row(P((0.8, 0.1, 0.1), coat=1.0, coat_roughness=0.4), 45, 80),
    "velvet": row(P((0.2, 0.0, 0.1), sheen_color=(0.9, 0.5, 0.7), sheen_roughness=0.5), 60, 89),
    "half metal, all bounces": row(P(1.0, metallic=0.5, roughness=0.8, multiple_bounces=True), 45),
    "filmed": row(P(GOLD, metallic=0.5, roughness=0.4, **FILM), 45),
    "dispersive, inside": row(P(0.9, roughness=0.4, transmission=0.8, dispersion=3.0), 80, back=True),
    "everything": row(EVERYTHING, 0, 80),
    "everything, inside": row(EVERYTHING, 45, back=True),
    "everything, bumpy": row(LAYERED, 0, 85, bumpy=True),
    "everything, bumpy, inside": row(LAYERED, 60, back=True, bumpy=True),
    "coat tilted": tilted(P((0.9, 0.4, 0.2), roughness=0.4, coat=1.0, coat_roughness=0.5), 0, 60, 85),
    "everything, coat tilted": tilted(EVERYTHING, 45, 80),
    "everything, coat tilted, inside": tilted(EVERYTHING, 60, back=True),
    "sheet, coat tilted": tilted(P(0.9, transmission=0.8, thin_walled=True, coat=0.7, coat_roughness=0.3), 60),
    "sheet, bumpy": row(P(0.9, transmission=0.8, thin_walled=True), 60, bumpy=True),
    # Mitsuba's material: sheen, coat and diffuse base are added as they are.
    "burley": row(LACQUER, 30, 80, quick=True, conserving=False),
    "burley's glass": row(BURLEYS_GLASS, 30, reciprocal=False),
    "burley's glass, inside": row(BURLEYS_GLASS, 80, back=True, reciprocal=False),
    "burley's pane": row(BURLEYS_PANE, 30, 80, reciprocal=False, conserving=False),
    # Tables of random numbers
    "measured": measured(arbitrary(ISOTROPIC), 45, quick=True),
    "measured, quarter": measured(arbitrary(azimuths(4, 4)), 0, 45),
    "measured values alone": measured(arbitrary(ISOTROPIC, jacobian=False, seed=1), 80),
}


def names(**properties: bool) -> list[Any]:
    """Return the rows that have these properties as parameters, the quick ones unmarked."""
    rows = {name: row for name, row in TABLE.items() if all(getattr(row, k) == v for k, v in properties.items())}
    return [pytest.param(name, marks=() if row.quick else pytest.mark.slow) for name, row in rows.items()]


SEEN = [
    pytest.param(name, degrees, marks=() if row.quick and degrees == row.angles[-1] else pytest.mark.slow)
    for name, row in TABLE.items()
    for degrees in row.angles
]


@pytest.mark.parametrize(("name", "degrees"), SEEN)
def test_samples_follow_the_density(name: str, degrees: float, device: str, report: Report) -> None:
    """One more cell holds what is lost below the horizon: what the integral of the density lacks to 1."""
    samples = 2**16 if "film" in TABLE[name].case.name else 2**18
    result = chi_square(TABLE[name].case, degrees, device, tests=len(SEEN), samples=samples)
    report(f"{name} at {degrees:g}°", result.statistic, result.dof, p=result.p)
    assert result.passed, result.message


@pytest.mark.parametrize("name", names(weights=True))
def test_weight_is_value_over_density(name: str, device: str) -> None:
    for degrees in (0.0, 45.0, 89.0):
        assert_weights(TABLE[name].case, degrees, device)


@pytest.mark.parametrize("name", names(reciprocal=True))
def test_reciprocity(name: str, device: str, report: Report) -> None:
    """By reflection; and over η² through a boundary, where the two ways are seen from its two sides."""
    case = TABLE[name].case
    limit = 1e-3 if "film" in name else 1e-4  # sums of waves
    if not case.model.delta:
        error = reciprocity_error(case, device, n=50_000)
        report(f"{name}: f(wo, wi) and f(wi, wo)", error, f"< {limit}")
        assert error < limit
    if case.model.transmits and not case.model.delta and case.front and "dispersi" not in case.name:
        material: Any = case.material
        ior = getattr(material, "relative_ior", 1.0 if getattr(material, "thin_walled", False) else material.ior)
        of_most, largest = transmission_error(case, ior, device)
        report(f"{name}: f(wo, wi) η² and f(wi, wo), 99.9 % and all", of_most, largest)
        assert of_most < 2e-4
        assert largest < 1e-2


@pytest.mark.parametrize("name", names(conserving=True))
def test_no_energy_is_made(name: str, device: str, report: Report) -> None:
    """To 3.5σ; with multiple bounces to the error of their table as well."""
    case = TABLE[name].case
    slack = 3e-3 if case.material.table_key else 1e-5
    for degrees in (0.0, 45.0, 80.0, 89.0, 89.9):
        mean, error = albedo(case, degrees, device, samples=2**15)
        report(f"{name} at {degrees:g}°: largest albedo", float(mean.max()), "<= 1")
        assert (mean <= 1.0 + slack + 3.5 * error).all(), degrees


@pytest.mark.parametrize("name", names())
def test_values_are_finite_and_opaque_ones_let_nothing_through(name: str, device: str) -> None:
    case = TABLE[name].case
    assert_finite(case, device)
    if not case.model.transmits and not case.model.delta:
        assert_nothing_goes_through(case, device)


@pytest.mark.parametrize("name", [name for name, row in TABLE.items() if row.case.model.delta])
def test_deltas_have_no_value_for_chosen_directions(name: str, device: str) -> None:
    case, wo = TABLE[name].case, np.abs(sphere(5_000, seed=7))
    wi = np.concatenate([sphere(3_000, seed=8), (wo * [-1.0, -1.0, 1.0])[3_000:4_000], -wo[4_000:]])
    value, pdf, delta = case.evaluate(wo, wi, device)
    assert not value.any()
    assert not pdf.any()
    assert delta.all()
    found = case.sample(wo, uniforms(5_000, 3, seed=10), device)
    assert found["delta"].all()
    assert not found["pdf"].any()


def test_every_material_and_every_part_of_a_model_is_in_the_table() -> None:
    used = {type(row.case.material) for row in TABLE.values()}
    of_others = {wrt.Mix, wrt.TwoSided, wrt.Emissive, wrt.Unlit}
    assert used == set(MATERIALS.values()) - of_others
    parts = {part for row in TABLE.values() for part in row.case.name.split(":")}
    assert parts >= {*DISTRIBUTIONS, *MASKINGS, *FEATURE_ROWS, "multiple", "schlick", "conductor", "bumpy-ggx"}
    assert {type(row.case.material) for row in TABLE.values() if row.quick} == used


# --- White furnace ------------------------------------------------------------------------------------

ALPHAS = (1e-4, 0.01, 0.1, 0.2, 0.4, 0.7, 1.0)
ROUGHNESSES = (0.0, 0.1, 0.3, 0.5, 0.7, 1.0)


def furnace() -> Iterator[tuple[str, list[Case], float]]:
    """Yield materials that reflect and transmit all light, and by how much they may miss that."""
    yield "diffuse", [Case(wrt.OrenNayar(1.0, s)) for s in (0.0, 1e-4, 0.05, 0.35, 1.0, 0.5 * math.pi)], 1e-5
    sides = (True, False)
    clear = (wrt.Dielectric(1.5), wrt.Dielectric(1.0, 1.33), wrt.Dielectric(2.42), wrt.ThinDielectric(), wrt.Mirror())
    deltas = (*clear, wrt.Dielectric(1.5, dispersion=4.0))
    yield "deltas", [Case(material, front) for material in deltas for front in sides], 1e-6
    yield "plastic", [Case(wrt.Plastic(1.0)), Case(wrt.Plastic(1.0, 2.42, nonlinear=True))], 1e-5
    yield "rough plastic", [Case(wrt.RoughPlastic(1.0, alpha=a, multiple_bounces=True)) for a in ALPHAS[2:]], 0.01
    for name in ("ggx", "beckmann"):
        yield name, [Case(metal(a, name, **WHITE)) for a in (*ALPHAS, (0.05, 0.5), (1.0, 0.01))], 0.01
    glasses = [glass(a, ior, multiple_bounces=True) for ior in (1.05, 1.5, 2.42) for a in (1e-3, 0.1, 0.3, 1.0)]
    yield "ground glass", [Case(material, front) for material in glasses for front in sides], 0.005
    for name, options in (
        ("principled", {}),
        ("principled tint", {"specular_color": (20.0, 5.0, 1.0)}),
        ("principled, all bounces", {"multiple_bounces": True}),
    ):
        yield name, [Case(P(1.0, roughness=r, **options)) for r in ROUGHNESSES], 0.01
    white = [P(1.0, metallic=1.0, roughness=r, multiple_bounces=True) for r in ROUGHNESSES[1:]]
    yield "principled metal", [Case(material) for material in white], 0.01
    yield "clear body", [Case(P(1.0, roughness=0.0, transmission=1.0), front) for front in sides], 1e-3


FURNACE = {name: (cases, tolerance) for name, cases, tolerance in furnace()}
QUICK = ("diffuse", "deltas", "plastic", "ggx", "principled")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in FURNACE]
)
def test_white_surfaces_keep_all_light(name: str, device: str, report: Report) -> None:
    cases, tolerance = FURNACE[name]
    least, most = 1.0, 1.0
    for case in cases:
        for degrees in (0.0, 30.0, 60.0, 80.0, 85.0) if name == "clear body" else (0.0, 45.0, 60.0, 80.0, 89.0, 89.9):
            mean, error = albedo(case, degrees, device, samples=2**14)
            low = mean.max() if name == "principled tint" else mean.min()  # where its reflection is white
            least, most = min(least, float(low)), max(most, float(mean.max()))
            slack = tolerance + 3.5 * error.max()
            assert 1.0 - slack < low, f"{case} at {degrees:g}°"
            assert mean.max() < 1.0 + slack, f"{case} at {degrees:g}°"
    report(f"{name}: least and most of the light", least, most)


@pytest.mark.slow
@pytest.mark.parametrize("roughness", [0.1, 0.3])
def test_white_plastic_under_bumps_stays_white(roughness: float, device: str, report: Report) -> None:
    """Within 1 % but near the horizon, and nowhere above: its diffuse part gets what GGX of that energy leaves."""
    for sigma in (0.02, 0.1, 0.25):
        case = Bumpy(P(1.0, roughness=roughness), variance=(sigma**2, sigma**2))
        for degrees, least in ((0.0, 0.99), (45.0, 0.99), (70.0, 0.97), (85.0, 0.95)):
            mean, error = albedo(case, degrees, device, samples=2**15)
            report(f"roughness {roughness}, σ {sigma} at {degrees:g}°", float(mean[0]), 1.0)
            assert least - 3.5 * error[0] < mean[0] < 1.01 + 3.5 * error[0]


@pytest.mark.slow
def test_white_materials_vanish_in_a_white_room(device: str, report: Report) -> None:
    """Textured roughness, tables one behind the other, and a body; one that also emits is brighter by its emission."""
    levels = np.linspace(0.05, 1.0, 64, dtype=np.float32).reshape(8, 8, 1) * np.ones(3, np.float32)
    varying, white = wrt.ImageTexture(levels), {"f0": 1.0, "multiple_bounces": True}
    sheets = [
        wrt.OrenNayar(1.0, 1.0),
        wrt.RoughPlastic(1.0, alpha=varying, nonlinear=True, multiple_bounces=True),
        wrt.RoughConductor((0.2, 0.9), **white),
        wrt.RoughConductor(0.8, **white),
        wrt.Principled(wrt.ImageTexture(np.ones((2, 2, 3), np.float32)), roughness=varying, emission=(0.5, 0.0, 0.0)),
    ]
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    scene.camera = wrt.OrthographicCamera((0.0, 0.0, 6.0), (0.0, 0.0, 0.0), view_height=1.0)
    for x, material in enumerate(sheets):
        scene.add(wrt.quad((x - 3.0, -0.5, 0.0), (1, 0, 0), (0, 1, 0)), material=material)
    # Flat faces: below the horizon of interpolated normals a little light is always lost.
    ball = wrt.sphere((2.5, 0.0, 0.0), 0.45, subdivisions=3)
    glass = wrt.RoughDielectric(1.5, alpha=0.5, multiple_bounces=True)
    scene.add(wrt.Mesh(ball.vertices, ball.faces), material=glass)
    renderer = wrt.Renderer(scene, sampler="independent", width=96, height=16, seed=2, max_depth=1000, device=device)
    image = image_of(renderer, 256).astype(np.float64).reshape(16, 6, 16, 3)
    error = np.sqrt(renderer.variance().reshape(16, 6, 16, 3).sum(axis=(0, 2))) / 256
    for number, name in enumerate(["oren-nayar", "plastic", "brushed metal", "metal", "principled", "glass"]):
        tile = image[4:12, number, 2:14]
        expected = np.array([1.5, 1.0, 1.0]) if name == "principled" else np.ones(3)
        report(f"{name}: mean radiance", str(tile.mean(axis=(0, 1))), str(expected))
        assert (np.abs(tile.mean(axis=(0, 1)) - expected) < 0.006 + 6.0 * error[number]).all(), name
