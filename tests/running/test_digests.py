"""Pictures keep their bits: films of many small scenes are those recorded in tests/data/digests.json.

A change that is meant to alter pictures records them anew: `python scripts/digests.py record`. Processors and C
libraries compute a few functions to other digits, so the file has a section for each kind of arithmetic that films were
recorded with.
"""

import dataclasses
import json
from typing import Any

import pytest
from conftest import ROOT
from support.covering_kernels import OF_PICTURES, render_by, render_with
from support.digests import SIZES, arithmetic, cases, film_digest, rendered

from wrt.backend.warp_start import initialize_warp

RECORDED: dict[str, dict[str, str]] = json.loads((ROOT / "tests" / "data" / "digests.json").read_text(encoding="utf-8"))
CASES = cases()
NEIGHBOURS = "picture-materials-", "picture-thin-films"
"""Pictures of many models, whose kernels take 10 to 20 s to compile. They are rendered by the kernels of a picture that
differs only in its many lights, with the same bits."""


@pytest.fixture(scope="module")
def recorded():
    """Films recorded with the arithmetic of this processor and C library; none if it is of another kind."""
    initialize_warp()
    return RECORDED.get(arithmetic(), {})


def test_every_case_is_recorded():
    assert set(CASES) == {name for films in RECORDED.values() for name in films}


SLOW = (*SIZES, *(f"picture-{kind}" for kind in ("camera", "light", "tutorial", "studio", "city")))
"""What the films that are rendered with --all begin with, other than the quick ones: pictures share one kernel. The
kernels of all others take two minutes to compile."""


def marks_of(name: str) -> Any:
    if name.startswith("plain"):
        return ()
    return pytest.mark.slow if name.startswith(SLOW) else pytest.mark.machinery


@pytest.mark.parametrize("name", [pytest.param(name, marks=marks_of(name)) for name in CASES])
def test_films_keep_their_bits(name, recorded, monkeypatch):
    """With another arithmetic each film still shows something: it is brighter here than there."""
    if name.startswith(NEIGHBOURS):
        render_by(lambda features: dataclasses.replace(features, light_tree=True), monkeypatch)
    elif name.startswith("picture-"):
        render_with([OF_PICTURES], monkeypatch)
    renderer = rendered(CASES[name])
    if renderer.renders_light and renderer.film.pixels > 1:
        assert renderer.image().std() > 0.0
    if name not in recorded:
        pytest.skip("recorded on processors and with C libraries that compute other digits")
    assert film_digest(renderer) == recorded[name]
