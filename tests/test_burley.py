"""Burley's material has the values of Mitsuba's principled models, and samples follow its density."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import Report
from support.bsdfs import Case, assert_finite, assert_weights, chi_square, hemisphere

import wrt

COLOR = (0.7, 0.3, 0.2)
BODIES = {
    "default": {},
    "tinted metal": {"metallic": 0.6, "roughness": 0.3, "spec_tint": 0.7, "anisotropic": 0.6},
    "cloth": {"sheen": 0.9, "sheen_tint": 0.4, "flatness": 0.7, "roughness": 0.8},
    "lacquer": {"clearcoat": 0.8, "clearcoat_gloss": 0.3, "specular": 0.7, "roughness": 0.4},
    "glass": {"spec_trans": 0.7, "eta": 1.4, "roughness": 0.5, "metallic": 0.2},
}
SHEETS = {
    "default": {},
    "leaf": {"diff_trans": 0.6, "flatness": 0.5, "sheen": 0.4, "sheen_tint": 0.8},
    "pane": {"spec_trans": 0.6, "eta": 1.6, "roughness": 0.5, "spec_tint": 0.5, "anisotropic": 0.4, "sheen": 0.3},
}
NAMES = {
    "anisotropic": "anisotropy",
    "spec_trans": "transmission",
    "spec_tint": "specular_tint",
    "clearcoat": "coat",
    "clearcoat_gloss": "coat_gloss",
    "eta": "ior",
}


def as_xml(values: dict[str, float], kind: str) -> str:
    """Return a scene file with the material."""
    numbers = "".join(f'<float name="{key}" value="{value}"/>' for key, value in values.items())
    color = f'<rgb name="base_color" value="{", ".join(map(str, COLOR))}"/>'
    bsdf = f'<bsdf type="{kind}">{numbers}{color}</bsdf>'
    return f'<scene version="3.0.0"><shape type="sphere">{bsdf}</shape></scene>'


def material(values: dict[str, float], *, thin: bool) -> wrt.Burley:
    """Return the material with Mitsuba's values."""
    given = {NAMES.get(name, name): value for name, value in values.items()}
    if "specular" in given:
        given["ior"] = 2.0 / (1.0 - (0.08 * given.pop("specular")) ** 0.5) - 1.0
    if "diff_trans" in given:
        given["diffuse_transmission"] = 0.5 * given.pop("diff_trans")
    return wrt.Burley(COLOR, thin_walled=thin, **given)


KINDS = [(name, False) for name in BODIES] + [(name, True) for name in SHEETS]


@pytest.mark.parametrize("front", [True, False], ids=["front", "back"])
@pytest.mark.parametrize(("name", "thin"), KINDS)
def test_values_are_those_of_mitsuba(name: str, thin: bool, front: bool, device: str, report: Report) -> None:
    pytest.importorskip("mitsuba", reason="the independent renderer is not installed")
    from support.mitsuba_scene import load_mitsuba

    mi = load_mitsuba()
    values = (SHEETS if thin else BODIES)[name]
    if not front and not thin and "spec_trans" not in values:
        pytest.skip("an opaque surface is the same on both sides, and black on one in Mitsuba")
    kind = "principledthin" if thin else "principled"
    theirs = mi.load_dict({"type": kind, "base_color": {"type": "rgb", "value": list(COLOR)}, **values})
    wo, wi = hemisphere(300, seed=80).astype(np.float32), hemisphere(300, seed=81).astype(np.float32)
    wi[::2, 2] *= -1.0
    side = np.float32([1.0, 1.0, 1.0 if front else -1.0])
    context, surface = mi.BSDFContext(), mi.SurfaceInteraction3f()
    expected = np.empty((len(wo), 3))
    for i in range(len(wo)):
        surface.wi = mi.Vector3f(*(wo[i] * side).tolist())
        expected[i] = np.array(theirs.eval(context, surface, mi.Vector3f(*(wi[i] * side).tolist())))
    case = Case(material(values, thin=thin), front)
    measured, pdf, _ = case.evaluate(wo, wi, device)
    if thin and "spec_trans" in values:
        # Mitsuba loses what facets transmit towards their own side.
        half = wo + wi * np.float32([1.0, 1.0, -1.0])
        lost = (wi[:, 2] < 0.0) & ((half * wi).sum(axis=1) >= 0.0)
        assert lost.sum() > 20
        assert not expected[lost].any()
        measured, expected, pdf = measured[~lost], expected[~lost], pdf[~lost]
    report(f"{name}: mean value", float(measured.mean()), float(expected.mean()))
    np.testing.assert_allclose(measured, expected, rtol=2e-3, atol=2e-5)
    assert (pdf[expected.max(axis=1) > 1e-3] > 0.0).all()


CASES = {
    "default": Case(material({}, thin=False)),
    "lacquer": Case(material(BODIES["lacquer"], thin=False)),
    "glass": Case(material(BODIES["glass"], thin=False)),
    "glass, back": Case(material(BODIES["glass"], thin=False), front=False),
    "pane": Case(material(SHEETS["pane"] | {"diff_trans": 0.5}, thin=True)),
}


@pytest.mark.parametrize(("name", "thin"), KINDS)
def test_files_of_mitsuba_are_read_without_a_warning(name: str, thin: bool, tmp_path: Path) -> None:
    values = (SHEETS if thin else BODIES)[name]
    file = tmp_path / "scene.xml"
    file.write_text(as_xml(values, "principledthin" if thin else "principled"), "utf-8")
    found = wrt.load(file, strict=True).shapes[0].material
    expected = material(values, thin=thin)
    if isinstance(found, wrt.TwoSided):
        found = found.front
    assert found == expected


@pytest.mark.parametrize("degrees", [30.0, 80.0])
@pytest.mark.parametrize("name", CASES)
def test_samples_follow_the_density(name: str, degrees: float, device: str, report: Report) -> None:
    result = chi_square(CASES[name], degrees, device, tests=2 * len(CASES))
    report(f"{name} at {degrees:g}°", result.statistic, result.dof, p=result.p)
    assert result.passed, result.message
    assert_weights(CASES[name], degrees, device)
    assert_finite(CASES[name], device)
