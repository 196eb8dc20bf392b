"""Every answer that differs from Embree's is right within rounding, by float64 arithmetic over all triangles.

The reasons, and how near an edge a ray must pass to be excused, are derived in `support/exact_rays.py`.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from types import ModuleType

import numpy as np
import pytest
from conftest import ROOT, Report
from support.exact_rays import Reason, exact_distances, explain, ulps
from support.ray_trees import Rays, soup_mesh

import wrt

pytestmark = pytest.mark.slow

COUNT = 66 * 66
"""Rays: a square for the camera."""

CASES = [("many", "coherent"), ("soup", "incoherent"), ("soup", "aimed"), ("far away", "diffuse")]


@pytest.fixture(scope="module")
def benchmark() -> Iterator[ModuleType]:
    """Return scripts/benchmarks/rays.py: its meshes, its rays, and Embree."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "scripts"))
        yield importlib.import_module("benchmarks.rays")


def case(benchmark: ModuleType, name: str, kind: str, count: int = COUNT) -> tuple[wrt.Mesh, Rays]:
    mesh = soup_mesh(4, 300) if name == "soup" else benchmark.bumpy_ball(70_000 if name == "many" else 300)
    origins, directions = benchmark.make_rays("incoherent" if kind == "aimed" else kind, mesh, count)
    if name == "far away":
        offset = np.float32([1000.0, -500.0, 2000.0])
        mesh, origins = wrt.Mesh(mesh.vertices + offset, mesh.faces), origins + offset
    if kind == "aimed":  # at edges and, one in three, at corners
        rng = np.random.default_rng(1)
        corners = mesh.vertices[mesh.faces[rng.integers(0, len(mesh.faces), count)]].astype(np.float64)
        weight = np.where(rng.random((count, 1)) < 1.0 / 3.0, 0.0, rng.random((count, 1)))
        directions = (corners[:, 0] + weight * (corners[:, 1] - corners[:, 0]) - origins).astype(np.float32)
    return mesh, (origins, directions)


@pytest.mark.parametrize(("name", "kind"), CASES)
def test_every_difference_from_embree_is_explained(name: str, kind: str, benchmark: ModuleType, report: Report) -> None:
    pytest.importorskip("embreex")
    mesh, rays = case(benchmark, name, kind, 1 << 17 if name == "many" else COUNT)
    theirs = benchmark.embree_scene(mesh).run(*rays, output=1)
    ours = wrt.Intersector(mesh).closest_hit(*rays)
    triangle, t = theirs["primID"], theirs["tfar"].astype(np.float64)
    corners, differ = mesh.vertices[mesh.faces], ours.triangle != triangle
    report("answers that differ", int(differ.sum()), f"of {len(differ)}")
    if differ.any():
        counts = explain(corners, rays[0][differ], rays[1][differ], ours.triangle[differ]).counts()
        report("against float64", ", ".join(f"{n} {reason.value}" for reason, n in counts.items() if n))
        assert counts[Reason.NONE] == 0
    # Distances are right to four units in the last place, or, of a triangle seen edge on, to what rounding its edge
    # functions may make of them. Distances that Embree has as well need no other judge.
    hit = ours.triangle >= 0
    hit[hit] = differ[hit] | (ulps(ours.t[hit] - t[hit], t[hit]) > 4.0)
    exact, error = exact_distances(corners[ours.triangle[hit]], rays[0][hit], rays[1][hit])
    wrong, bound = ulps(ours.t[hit] - exact, exact), ulps(error, exact)
    assert ((wrong <= 4.0) | (wrong <= bound)).all()


def test_wrong_answers_are_not_explained(benchmark: ModuleType, report: Report) -> None:
    """A hit kept silent, one made up, the far side, or a neighbour in place of the triangle: the test can fail."""
    mesh, rays = case(benchmark, "ball", "incoherent", 900)
    corners = mesh.vertices[mesh.faces]
    right = explain(corners, *rays, np.full(900, -1)).nearest
    hit = right >= 0
    not_hit = np.delete(np.arange(len(mesh.faces)), np.unique(right[hit]))
    farther = explain(corners[not_hit], *rays, np.full(900, -1)).nearest
    wrong = {
        "silent": np.where(hit, -1, right),
        "made up": np.where(hit, right, 0),
        "far side": np.where(farther >= 0, not_hit[farther], right),
        "neighbour": np.where(hit, (right + 1) % len(mesh.faces), right),
    }
    for name, answers in wrong.items():
        changed = answers != right
        found = explain(corners, *rays, answers)
        report(f"{name}: not explained", int((found.reason == Reason.NONE).sum()), int(changed.sum()))
        np.testing.assert_array_equal(found.reason, np.where(changed, Reason.NONE, Reason.SAME))
