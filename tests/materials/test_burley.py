"""Burley's material has the values of Mitsuba's principled models, and is read from its files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import Report
from support.bsdfs import Case, ask_mitsuba, hemisphere

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
KINDS = [(name, False) for name in BODIES] + [(name, True) for name in SHEETS]


def material(values: dict[str, float], *, thin: bool) -> wrt.Burley:
    """Return the material with Mitsuba's values."""
    given = {NAMES.get(name, name): value for name, value in values.items()}
    if "specular" in given:
        given["ior"] = 2.0 / (1.0 - (0.08 * given.pop("specular")) ** 0.5) - 1.0
    if "diff_trans" in given:
        given["diffuse_transmission"] = 0.5 * given.pop("diff_trans")
    return wrt.Burley(COLOR, thin_walled=thin, **given)


@pytest.mark.parametrize(
    ("name", "thin"),
    [pytest.param(*kind, marks=pytest.mark.slow if kind[1] or kind[0] == "glass" else ()) for kind in KINDS],
)
def test_values_are_those_of_mitsuba(name: str, thin: bool, device: str, report: Report) -> None:
    """From both sides, but of opaque bodies, which are black from inside in Mitsuba and the same on both sides here."""
    pytest.importorskip("mitsuba", reason="the independent renderer is not installed")
    values = (SHEETS if thin else BODIES)[name]
    color = {"type": "rgb", "value": list(COLOR)}
    theirs = {"type": "principledthin" if thin else "principled", "base_color": color, **values}
    for front in (True, False) if thin or "spec_trans" in values else (True,):
        wo, wi = hemisphere(300, seed=80).astype(np.float32), hemisphere(300, seed=81).astype(np.float32)
        wi[::2, 2] *= -1.0
        expected, _ = ask_mitsuba(theirs, wo, wi, front=front)
        measured, pdf, _ = Case(material(values, thin=thin), front).evaluate(wo, wi, device)
        if thin and "spec_trans" in values:
            # Mitsuba loses what facets transmit towards their own side.
            half = wo + wi * np.float32([1.0, 1.0, -1.0])
            lost = (wi[:, 2] < 0.0) & ((half * wi).sum(axis=1) >= 0.0)
            assert lost.sum() > 20
            assert not expected[lost].any()
            measured, expected, pdf = measured[~lost], expected[~lost], pdf[~lost]
        report(f"{name}, front {front}: mean value", float(measured.mean()), float(expected.mean()))
        np.testing.assert_allclose(measured, expected, rtol=2e-3, atol=2e-5)
        assert (pdf[expected.max(axis=1) > 1e-3] > 0.0).all()


@pytest.mark.parametrize(("name", "thin"), KINDS)
def test_files_of_mitsuba_are_read_without_a_warning(name: str, thin: bool, tmp_path: Path) -> None:
    values = (SHEETS if thin else BODIES)[name]
    numbers = "".join(f'<float name="{key}" value="{value}"/>' for key, value in values.items())
    color = f'<rgb name="base_color" value="{", ".join(map(str, COLOR))}"/>'
    bsdf = f'<bsdf type="{"principledthin" if thin else "principled"}">{numbers}{color}</bsdf>'
    file = tmp_path / "scene.xml"
    file.write_text(f'<scene version="3.0.0"><shape type="sphere">{bsdf}</shape></scene>', "utf-8")
    found = wrt.load(file, strict=True).shapes[0].material
    assert getattr(found, "front", found) == material(values, thin=thin)
