"""White materials cannot be seen in a white room, whatever varies over them; and all estimators find the same light."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import Report

import wrt

pytestmark = pytest.mark.slow


def test_white_materials_vanish_in_a_white_room(device: str, report: Report) -> None:
    """Textured roughness, tables that lie one behind the other, and a body; what shines besides is brighter by that."""
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
    for _ in renderer.passes(spp=256):
        pass
    image = renderer.image().astype(np.float64).reshape(16, 6, 16, 3)
    error = np.sqrt(renderer.variance().reshape(16, 6, 16, 3).sum(axis=(0, 2))) / 256
    for number, name in enumerate(["oren-nayar", "plastic", "brushed metal", "metal", "principled", "glass"]):
        tile = image[4:12, number, 2:14]
        expected = np.array([1.5, 1.0, 1.0]) if name == "principled" else np.ones(3)
        report(f"{name}: mean radiance", str(tile.mean(axis=(0, 1))), str(expected))
        assert (np.abs(tile.mean(axis=(0, 1)) - expected) < 0.006 + 6.0 * error[number]).all(), name
