"""The integrators `aov` and `depth` of Mitsuba's scene files, by both."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray

pytest.importorskip("mitsuba", reason="the independent renderer is not installed")

from support.mitsuba_files import render_by_mitsuba, write_files
from support.mitsuba_scene import load_mitsuba
from support.statistics import image_z_test

import wrt

pytestmark = pytest.mark.slow

Array = NDArray[np.float64]
CHANNELS = {"albedo": 3, "depth": 1, "position": 3, "uv": 2, "geometric_normal": 3, "normal": 3}
"""Layers in the order of the file."""

SPP = 256


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    result = tmp_path_factory.mktemp("layers")
    write_files(result)
    return result


def layers(path: Path) -> dict[str, Array]:
    renderer = wrt.Renderer(wrt.load(path), seed=1, sampler="independent")
    for _ in renderer.passes(spp=SPP):
        pass
    shape = (renderer.height, renderer.width, -1)
    return {name: values.astype(np.float64).reshape(shape) for name, values in renderer.layers().items()}


def smooth(values: Array) -> NDArray[np.bool_]:
    """Return where the pixels around are alike, inside of one surface."""
    result = np.zeros(values.shape[:2], bool)
    centre = values[1:-1, 1:-1]
    near = [values[1 + y : values.shape[0] - 1 + y, 1 + x : values.shape[1] - 1 + x] for y, x in NEIGHBOURS]
    result[1:-1, 1:-1] = np.all([np.abs(each - centre).max(axis=-1) < 0.15 for each in near], axis=0)
    return result


NEIGHBOURS = [(y, x) for y in (-1, 0, 1) for x in (-1, 0, 1) if (y, x) != (0, 0)]


def worst(ours: Array, theirs: Array, inside: NDArray[np.bool_]) -> float:
    """Return the largest difference, in steps from a pixel to the next.

    wrt has the value at the sample nearest to the pixel's middle, Mitsuba the mean over the pixel.
    """
    steps = np.max([np.abs(np.roll(theirs, offset, (0, 1)) - theirs).max(axis=-1) for offset in NEIGHBOURS], axis=0)
    return float((np.abs(ours - theirs).max(axis=-1) / (steps + 1e-3))[inside].max())


def test_layers_are_mitsuba_s(folder: Path, report: Report) -> None:
    path = folder / "layers.xml"
    expected = render_layers(path)
    changed = folder / "changed.xml"
    changed.write_text(path.read_text().replace('name="fov" value="46"', 'name="fov" value="44"'))
    own, wrong = layers(path), layers(changed)
    assert set(own) == set(CHANNELS)
    inside = within(expected)
    for name, (mean, variance) in expected.items():
        if name in ("depth", "position", "uv"):
            report(f"{name}: largest difference in pixels", worst(own[name], mean, inside), "< 0.2")
            assert worst(own[name], mean, inside) < 0.2
            assert worst(wrong[name], mean, inside) > 0.4
        else:
            # What rounding leaves of zeros would differ by any factor.
            results = [
                image_z_test(each[name] + 1.0, variance, mean + 1.0, variance, n_a=16, n_b=16) for each in (own, wrong)
            ]
            report(name, results[0].message)
            assert results[0].agrees(), results[0].message
            assert not results[1].agrees(), results[1].message


def within(expected: dict[str, tuple[Array, Array]]) -> NDArray[np.bool_]:
    """Return which pixels have surroundings of one surface."""
    result = smooth(expected["geometric_normal"][0]) & (np.linalg.norm(expected["normal"][0], axis=2) > 0.99)
    result &= smooth(expected["depth"][0])
    assert 200 < result.sum() < 600
    return result


@functools.cache
def render_layers(path: Path) -> dict[str, tuple[Array, Array]]:
    """Return mean and variance of the mean of each layer."""
    mi = load_mitsuba()
    scene = mi.load_file(str(path))
    runs = np.stack([np.array(mi.render(scene, spp=SPP // 16, seed=k), dtype=np.float64) for k in range(16)])
    result, first = {}, runs.shape[3] - sum(CHANNELS.values())
    for name, count in CHANNELS.items():
        part = runs[..., first : first + count]
        result[name] = part.mean(axis=0), part.var(axis=0, ddof=1) / len(runs)
        first += count
    return result


def test_depth_is_mitsuba_s(folder: Path, report: Report) -> None:
    path = folder / "depth.xml"
    expected = render_by_mitsuba(path, spp=SPP).mean[..., :1]
    own = layers(path)["depth"]
    inside = within(render_layers(folder / "layers.xml"))
    report("largest difference in pixels", worst(own, expected, inside), "< 0.2")
    assert worst(own, expected, inside) < 0.2
    changed = folder / "changed.xml"
    changed.write_text(path.read_text().replace('name="fov" value="46"', 'name="fov" value="44"'))
    assert worst(layers(changed)["depth"], expected, inside) > 0.4
