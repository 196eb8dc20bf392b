"""Derivatives by values that decide what is sampled have the mean of difference quotients, and that of closed forms."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import pytest
from conftest import Report

import wrt
from wrt.gradients.backward import Backward

SIZE = 12
SEEDS = 24
Z = 4.5
"""The greatest z of about thirty numbers: a right program exceeds it once in 5,000 runs."""


class Value(NamedTuple):
    """Rows of an array of the scene that change together, and the step of the difference quotient."""

    key: str
    rows: tuple[int, ...]
    step: float


class Case(NamedTuple):
    """A scene, the samples per pixel of a seed, the values, and other settings."""

    scene: Callable[[], wrt.Scene]
    spp: int
    values: dict[str, Value]
    settings: Mapping[str, Any] = MappingProxyType({})


def room(*shapes: tuple[wrt.Mesh, wrt.Material], **options: Any) -> wrt.Scene:
    """Return things on a floor before a wall, in the light of an environment with a bright side."""
    sky = np.full((8, 16, 3), 0.4, np.float32)
    sky[2:4, 9:13] = (6.0, 5.0, 4.0)
    camera = wrt.PerspectiveCamera(origin=(0, 1.0, 3.4), target=(0, 0.7, 0), fov_degrees=35)
    scene = wrt.Scene(camera=camera, **{"environment": wrt.ImageEnvironment(sky), **options})
    scene.add(wrt.quad((-3, 0, 3), (6, 0, 0), (0, 0, -5)), material=wrt.Diffuse((0.5, 0.4, 0.3)))
    scene.add(wrt.quad((-3, 0, -2), (6, 0, 0), (0, 4, 0)), material=wrt.Diffuse((0.3, 0.5, 0.6)))
    for mesh, material in shapes:
        scene.add(mesh, material=material)
    return scene


BALL = wrt.sphere((0.0, 0.7, 0.0), 0.65)
PANE = wrt.quad((-0.7, 0.0, 0.6), (1.4, 0.0, 0.0), (0.0, 1.4, 0.0))
MILK = wrt.Medium((0.2, 0.3, 0.1), (1.5, 1.0, 2.0), g=0.3, emission=(0.1, 0.0, 0.0))


def on_ball(material: wrt.Material) -> Callable[[], wrt.Scene]:
    return lambda: room((BALL, material))


def slot(row: int, step: float) -> Value:
    """Return a row of the slots after those of floor and wall."""
    return Value("slots", (2 + row,), step)


CASES = {
    "metal": Case(
        on_ball(wrt.RoughConductor(0.3)), 64, {"alpha": slot(0, 0.03), "eta": slot(2, 0.03), "k": slot(3, 0.03)}
    ),
    "principled": Case(
        on_ball(wrt.Principled((0.15, 0.1, 0.05), 0.4, 0.5)),
        64,
        {"color": slot(0, 0.03), "metallic": slot(1, 0.03), "roughness": slot(2, 0.03), "ior": slot(5, 0.05)},
    ),
    "plastic": Case(on_ball(wrt.Plastic((0.6, 0.4, 0.2))), 64, {"color": slot(0, 0.03), "specular": slot(1, 0.03)}),
    "rough glass": Case(
        on_ball(wrt.RoughDielectric(1.5, alpha=0.4)), 256, {"alpha": slot(0, 0.04), "through": slot(3, 0.03)}
    ),
    "film": Case(
        on_ball(wrt.RoughConductor(0.3, metal="Ti", film_thickness=150.0, film_ior=1.8)),
        64,
        {"alpha": slot(0, 0.03), "thickness": slot(4, 2.0), "index": slot(5, 0.03)},
    ),
    "pane": Case(lambda: room((PANE, wrt.ThinDielectric(1.5))), 256, {"ior": slot(0, 0.1), "through": slot(2, 0.03)}),
    "milk": Case(
        lambda: room((wrt.box((-0.6, 0.1, -0.6), (0.6, 1.3, 0.6)), wrt.Null(interior=MILK))),
        256,
        {"absorption": Value("media_absorption", (0,), 0.05), "scattering": Value("media_scattering", (0,), 0.1)},
        {"max_scatterings": 30},
    ),
    "long paths": Case(
        lambda: room((BALL, wrt.Diffuse(0.8)), (wrt.quad((-3, 0, -2), (0, 4, 0), (0, 0, 5)), wrt.Diffuse(0.9))),
        64,
        {"ball": slot(0, 0.03), "wall": slot(1, 0.03)},
        {"max_depth": 12},
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_means_are_those_of_difference_quotients(name: str, report: Report) -> None:
    """Of the mean of the picture, over seeds."""
    case = CASES[name]
    options = {"width": SIZE, "height": SIZE, "max_depth": 5, "threads": 2, **case.settings}
    renderer = wrt.Renderer(case.scene(), **options)
    backward, data = Backward(renderer), renderer._built.data
    arrays = {
        "slots": data.slots.rows["value"],
        **({} if data.media is None else {"media_absorption": data.media.rows["absorption"]}),
        **({} if data.media is None else {"media_scattering": data.media.rows["scattering"]}),
    }

    def mean(seed: int) -> float:
        renderer.seed = seed
        renderer._clear()
        renderer.render(spp=case.spp)
        return float(renderer.film.data.total.rows.mean()) / case.spp

    differences: dict[str, list[float]] = {value: [] for value in case.values}
    sizes: dict[str, list[float]] = {value: [] for value in case.values}
    upstream = np.full((SIZE, SIZE, 3), 1.0 / (3 * SIZE * SIZE))
    for seed in range(SEEDS):
        # Other random numbers, so that the noise of both is known.
        found = backward.run(upstream, case.spp, 1000 + seed)
        for value, (key, rows, step) in case.values.items():
            values, ends = arrays[key], []
            before = values[list(rows)].copy()
            for sign in (1.0, -1.0):
                values[list(rows)] = before + sign * step
                ends.append(mean(seed))
            values[list(rows)] = before
            derivative = found[key][list(rows)].sum()
            differences[value].append(derivative - (ends[0] - ends[1]) / (2.0 * step))
            sizes[value].append(derivative)
    for value, of_seeds in differences.items():
        error = np.std(of_seeds, ddof=1) / np.sqrt(SEEDS)
        size = abs(np.mean(sizes[value]))
        z = np.mean(of_seeds) / error
        report(f"{name}: {value}, z", z, f"error {error / size:.1%} of {np.mean(sizes[value]):.4g}")
        assert abs(z) < Z, value
        assert error < 0.06 * size, value


@pytest.mark.parametrize("depth", [4, 200])
def test_furnace(depth: int, report: Report) -> None:
    """Walls of albedo a that emit 1 have the radiance 1 / (1 − a), whose derivative is 1 / (1 − a)².

    Of the first `depth` segments they have Σ aᵏ. Roulette ends most of the longer paths.
    """
    albedo = np.array([0.8, 0.6, 0.7])
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(origin=(0, 0, 0), target=(0, 0, 1)))
    mesh = wrt.box((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
    scene.add(mesh, material=wrt.Diffuse(albedo), emission=1.0, two_sided_emission=True)
    renderer = wrt.Renderer(scene, width=8, height=8, max_depth=depth, threads=2)
    backward = Backward(renderer)
    upstream = np.full((8, 8, 3), 1.0 / 64.0)
    of_seeds = [backward.run(upstream, 64, seed) for seed in range(16)]
    slots, emission = (np.array([each[key][0] for each in of_seeds]) for key in ("slots", "emission"))
    k = np.arange(depth)[:, None]
    for name, found, expected in (
        ("albedo", slots, (k[1:] * albedo ** (k[1:] - 1)).sum(0)),
        ("emission", emission, (albedo**k).sum(0)),
    ):
        error = found.std(axis=0, ddof=1) / np.sqrt(len(found)) + 1e-5 * expected
        z = (found.mean(axis=0) - expected) / error
        report(f"furnace, {depth} segments: {name}, z", np.abs(z).max(), f"error {(error / expected).max():.2%}")
        assert np.abs(z).max() < Z
        assert (error < 0.02 * expected).all()
