"""Mitsuba's principled model, read from a file, reflects and transmits as much light as in Mitsuba."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.bsdfs import Case, hemisphere

import wrt

pytest.importorskip("mitsuba", reason="the independent renderer is not installed")

from support.mitsuba_scene import load_mitsuba

N = 3000
COLOR = (0.7, 0.3, 0.2)

MODELS = {
    "rough": {"roughness": 0.5},
    "glossy": {"roughness": 0.25, "specular": 0.8},
    "matt": {"roughness": 1.0, "specular": 0.2},
    "half a metal": {"roughness": 0.5, "metallic": 0.5},
    "metal": {"roughness": 0.5, "metallic": 1.0},
    "brushed": {"roughness": 0.6, "metallic": 1.0, "anisotropic": 0.7},
    "sheen": {"roughness": 0.5, "sheen": 1.0},
    "frosted": {"roughness": 0.6, "spec_trans": 1.0, "eta": 1.5},
}

BOUNDS = {"sheen": 0.04, "frosted": 0.1}
"""Fibres take from what is below in another way; rough glass reflects less of the little that it does."""


def directions() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return those to the eye, away from the horizon, and those to the light, of which every other is below."""
    wo, wi = hemisphere(2 * N, seed=80), hemisphere(2 * N, seed=81)
    wo = wo[wo[:, 2] > 0.1][:N]
    wi[1::2, 2] *= -1.0
    return wo.astype(np.float32), wi[: len(wo)].astype(np.float32)


def shares(values: NDArray[np.float64], wo: NDArray[np.float32], wi: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return what is reflected and what is transmitted of light that comes evenly from all sides, (2, 3)."""
    up, weighted = wi[:, 2] > 0.0, values * wo[:, 2:]
    return 4.0 * np.pi * np.stack([weighted[up].mean(axis=0), weighted[~up].mean(axis=0)])


@pytest.mark.filterwarnings("ignore::wrt.errors.InputWarning")
@pytest.mark.parametrize("name", MODELS)
def test_as_much_light_as_in_mitsuba(name: str, tmp_path: Path, device: str, report: Report) -> None:
    mi = load_mitsuba()
    wo, wi = directions()
    color = {"type": "rgb", "value": list(COLOR)}
    theirs = mi.load_dict({"type": "principled", "base_color": color, **MODELS[name]})
    context, surface = mi.BSDFContext(), mi.SurfaceInteraction3f()
    values = np.empty((len(wo), 3))
    for i in range(len(wo)):
        surface.wi = mi.Vector3f(*wo[i].tolist())
        values[i] = np.array(theirs.eval(context, surface, mi.Vector3f(*wi[i].tolist())))
    expected = shares(values, wo, wi)
    parameters = "".join(f'<float name="{key}" value="{value}"/>' for key, value in MODELS[name].items())
    (tmp_path / "scene.xml").write_text(
        f"""<scene version="3.0.0"><shape type="sphere"><bsdf type="principled">{parameters}
        <rgb name="base_color" value="{", ".join(map(str, COLOR))}"/></bsdf></shape></scene>"""
    )
    material = wrt.load(tmp_path / "scene.xml").shapes[0].material
    if isinstance(material, wrt.TwoSided):
        material = material.front
    measured = shares(Case(material).evaluate(wo, wi, device)[0], wo, wi)
    lit = expected > 0.01
    ratio = measured[lit] / expected[lit]
    report(f"{name}: reflected and transmitted, over Mitsuba's", ratio.round(4).tolist(), 1.0)
    np.testing.assert_allclose(ratio, 1.0, atol=BOUNDS.get(name, 0.025))
    if MODELS[name].get("metallic", 0.0) == 0.0:  # the same numbers without a change differ
        plain = wrt.Principled(
            COLOR, roughness=MODELS[name]["roughness"], transmission=MODELS[name].get("spec_trans", 0)
        )
        unchanged = shares(Case(plain).evaluate(wo, wi, device)[0], wo, wi)[lit] / expected[lit]
        assert np.abs(unchanged - 1.0).max() > 0.04
