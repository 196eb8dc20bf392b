"""Every answer that differs from Embree's, or from float64 arithmetic over all triangles, has a reason.

The reasons, and how near an edge a ray must pass to be excused, are derived in `support/exact_rays.py`.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from conftest import ROOT, Report
from numpy.typing import NDArray
from support.exact_rays import Model, Reason, exact_distances, explain, moeller, ulps, woop

import wrt
from wrt.rendering import intersector

pytestmark = pytest.mark.slow

Rays = tuple[NDArray[np.float32], NDArray[np.float32]]

COUNT = 66 * 66
"""Rays: more than a small batch, a square for the camera, and no multiple of what a thread takes."""

KERNELS = {"single": "trace_rays", "interleaved": "trace_interleaved", "packets": "trace_packets"}
CASES = [("ball", "coherent"), ("soup", "incoherent"), ("soup", "aimed"), ("far away", "diffuse")]
CASES += [("far away", "aimed")]


@pytest.fixture(scope="module")
def benchmark() -> Iterator[ModuleType]:
    """Return scripts/benchmarks/rays.py: its meshes, its rays, and Embree."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "scripts"))
        yield importlib.import_module("benchmarks.rays")


def soup(seed: int, count: int) -> wrt.Mesh:
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1.0, 1.0, (count, 1, 3)) + 0.3 * rng.normal(size=(count, 3, 3))
    return wrt.Mesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))


def case(benchmark: ModuleType, name: str, kind: str, count: int = COUNT) -> tuple[wrt.Mesh, Rays]:
    mesh = soup(4, 300) if name == "soup" else benchmark.bumpy_ball(300)
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


def trace(tracer: wrt.Intersector, rays: Rays, kernel: str, monkeypatch: pytest.MonkeyPatch) -> wrt.Hits:
    """Return what rays hit when traced with one of KERNELS, and assert that it was that one."""
    launched = []
    launch = tracer.device.launch

    def spy(what: Any, *rest: Any) -> None:
        launched.append(what.key)
        launch(what, *rest)

    size = intersector.SMALL_BATCH - 1 if kernel == "single" else len(rays[0])
    with monkeypatch.context() as patch:
        patch.setattr(tracer.device, "launch", spy)
        patch.setattr(tracer, "_coherent", lambda *_: kernel == "packets")
        pieces = [tracer.closest_hit(*(a[i : i + size] for a in rays)) for i in range(0, len(rays[0]), size)]
    if tracer.device.is_cpu:
        assert set(launched) == {KERNELS[kernel]}
    return wrt.Hits(*(np.concatenate(arrays) for arrays in zip(*pieces, strict=True)))


def judge(who: str, mesh: wrt.Mesh, rays: Rays, hits: Any, model: Model, report: Report) -> NDArray[np.bool_]:
    """Assert that each answer can be right, report how many are of each reason, and return which are open.

    Distances are right to four units in the last place, or, of a triangle seen edge on, to what rounding its edge
    functions may make of them.
    """
    triangle, t = hits
    found = explain(mesh.vertices[mesh.faces], *rays, triangle, model)
    counts = found.counts()
    report(f"{who} against float64", ", ".join(f"{n} {reason.value}" for reason, n in counts.items() if n))
    assert counts[Reason.NONE] == 0
    hit = triangle >= 0
    judge_distances(mesh, (rays[0][hit], rays[1][hit]), triangle[hit], t[hit], model)
    return found.open


def judge_distances(mesh: wrt.Mesh, rays: Rays, triangle: NDArray, t: NDArray, model: Model) -> None:
    exact, error = exact_distances(mesh.vertices[mesh.faces[triangle]], *rays, model)
    wrong, bound = ulps(t - exact, exact), ulps(error, exact)
    assert ((wrong <= 4.0) | (wrong <= bound)).all()


@pytest.mark.parametrize(("name", "kind"), CASES)
def test_every_difference_from_float64_is_explained(
    name: str, kind: str, benchmark: ModuleType, device: str, report: Report, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of all three kernels; where two answer alike, what is found of one holds for the other."""
    mesh, rays = case(benchmark, name, kind)
    tracer = wrt.Intersector(mesh, device=device)
    hits = {kernel: trace(tracer, rays, kernel, monkeypatch) for kernel in KERNELS}
    first = hits["single"]
    is_open = judge("wrt", mesh, rays, (first.triangle, first.t), woop, report)
    for kernel, other in hits.items():
        differ = (other.triangle != first.triangle) | (other.t != first.t)
        if differ.any():
            some = (rays[0][differ], rays[1][differ])
            judge(kernel, mesh, some, (other.triangle[differ], other.t[differ]), woop, report)
    # The bounds excuse few rays that were not aimed at edges: they are bounds, not a blank cheque.
    assert (is_open.mean() > 0.1) == (kind == "aimed")
    assert kind == "aimed" or is_open.mean() < 0.01


@pytest.mark.parametrize(("name", "kind"), [("many", "incoherent"), ("many", "coherent"), *CASES])
def test_every_difference_from_embree_is_explained(name: str, kind: str, benchmark: ModuleType, report: Report) -> None:
    """Both are judged by float64 arithmetic, each with the rounding of its own formula."""
    pytest.importorskip("embreex")
    if name == "many":
        mesh = benchmark.bumpy_ball(70_000)
        rays = benchmark.make_rays(kind, mesh, 1 << 17)
    else:
        mesh, rays = case(benchmark, name, kind)
    theirs = benchmark.embree_scene(mesh).run(*rays, output=1)
    ours = wrt.Intersector(mesh).closest_hit(*rays)
    triangle, t = theirs["primID"], theirs["tfar"]
    differ = ours.triangle != triangle
    report("answers that differ", int(differ.sum()), f"of {len(differ)}")
    if differ.any():
        some = (rays[0][differ], rays[1][differ])
        judge("wrt", mesh, some, (ours.triangle[differ], ours.t[differ]), woop, report)
        judge("Embree", mesh, some, (triangle[differ], t[differ]), moeller, report)
    # Where both name one triangle but not one distance, both are right to their rounding.
    apart = ~differ & (triangle >= 0)
    apart[apart] = ulps(ours.t[apart] - t[apart].astype(np.float64), t[apart]) > 4.0
    some = (rays[0][apart], rays[1][apart])
    judge_distances(mesh, some, ours.triangle[apart], ours.t[apart], woop)
    judge_distances(mesh, some, triangle[apart], t[apart], moeller)


@pytest.mark.parametrize(("model", "kind"), [(woop, "incoherent"), (moeller, "coherent")])
def test_wrong_answers_are_not_explained(model: Model, kind: str, benchmark: ModuleType, report: Report) -> None:
    """A hit kept silent, one made up, the far side, or a neighbour in place of the triangle: the test can fail."""
    mesh, rays = case(benchmark, "ball", kind, 900)
    corners = mesh.vertices[mesh.faces]
    right = explain(corners, *rays, np.full(900, -1), model).nearest
    hit = right >= 0
    others = np.delete(np.arange(len(mesh.faces)), np.unique(right[hit]))
    farther = explain(corners[others], *rays, np.full(900, -1), model).nearest
    wrong = {
        "silent": np.where(hit, -1, right),
        "made up": np.where(hit, right, 0),
        "far side": np.where(farther >= 0, others[farther], right),
        "neighbour": np.where(hit, (right + 1) % len(mesh.faces), right),
    }
    for name, answers in wrong.items():
        changed = answers != right
        found = explain(corners, *rays, answers, model)
        report(f"{name}: not explained", int((found.reason == Reason.NONE).sum()), int(changed.sum()))
        np.testing.assert_array_equal(found.reason, np.where(changed, Reason.NONE, Reason.SAME))
