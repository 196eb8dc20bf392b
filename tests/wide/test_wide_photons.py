"""Wide kernels follow photons with the bits of the scalar kernel."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.caustic_scenes import SCENES
from support.small_scenes import image_of
from support.wide_scenes import LANES, needs_lanes

import wrt

SLOW = "nearly smooth"
SCENES_OF_MACHINERY = (
    *("instances", "mirror cylinder", "plastic floor", "pane", "holes", "tinted", "dispersive", "constant", "image"),
    *("shapes", "fog", "moving", "deforming", "bumpy", "nested"),
)
SETS = 0, 1, 7


def renderer_of(name: str, **options: Any) -> wrt.Renderer:
    """Return a renderer whose sets of photons fill no pool of the wide kernel."""
    options = {"width": 101, "height": 83, "seed": 5, "caustics": True, "max_depth": 10, **options}
    return wrt.Renderer(SCENES[name](), **options)


def sets_of(renderer: wrt.Renderer) -> list[dict[str, NDArray[Any]]]:
    """Return keys and photons of sets, in the order of keys."""
    found = []
    camera, _, scene, path = renderer._shared_inputs
    photons = renderer._photons
    assert photons is not None
    for number in SETS:
        photons.provide(number * photons.samples, camera, scene, path)
        keys = photons._keys.numpy().copy()
        stored = int(np.searchsorted(keys, 2**62))
        records = photons._arranged.numpy()[:stored].copy()
        found.append({"keys": keys, **{field: records[field] for field in records.dtype.names}})
    return found


@needs_lanes
@pytest.mark.parametrize(
    "name",
    [pytest.param(SLOW, marks=pytest.mark.slow)]
    + [pytest.param(n, marks=pytest.mark.machinery) for n in SCENES_OF_MACHINERY],
)
def test_the_same_bits(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WRT_WIDE", str(LANES))
    scalar = sets_of(renderer_of(name))
    renderer = renderer_of(name)
    assert renderer._photons is not None
    renderer._photons.wide.wait()
    assert renderer._photons.wide.lanes == LANES
    wide = sets_of(renderer)
    for number, alone, together in zip(SETS, scalar, wide, strict=True):
        stored = len(alone["turns"])
        assert 0.01 < stored / len(alone["keys"]) < 1.0
        for field, values in alone.items():
            assert values.tobytes() == together[field].tobytes(), f"{field} of set {number}"
    goes_on = np.concatenate([photons["was_scattered"] for photons in scalar]).any()
    assert goes_on == (name != "fog")


@needs_lanes
@pytest.mark.slow
def test_pictures_have_the_same_bits_by_any_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also if a render changes to the wide kernels, and with several threads."""
    scalar = image_of(renderer_of(SLOW), 10)
    monkeypatch.setenv("WRT_WIDE", str(LANES))
    renderer = renderer_of(SLOW, threads=2)
    image_of(renderer, 3)
    assert renderer.compile() > 0.0
    assert renderer._photons.wide.lanes == renderer.lanes == LANES
    np.testing.assert_array_equal(image_of(renderer, 10), scalar)
