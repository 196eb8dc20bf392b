"""docs/own-light.md: its program runs, its model is right, and a light of one's own is as good as a built-in one."""

from __future__ import annotations

import functools
import importlib.util
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import warp as wp
from conftest import ROOT, Report
from support.covering_kernels import render_with
from support.irradiance import EVERY_LIGHT, check, disk_irradiance, floor_scene, irradiance, pixel_mean
from support.kernels import uniforms, upload
from support.statistics import chi_square_test

import wrt
from wrt.backend.device import Device
from wrt.backend.warp_backend import initialize_warp
from wrt.kernels.geometry.rays import Ray, Receiver
from wrt.kernels.lights.disk import MODEL as DISK
from wrt.kernels.lights.record import LightModel
from wrt.kernels.lights.shapes import BUILT_IN, LIGHT_SHAPES
from wrt.kernels.scene.scene_data import LightRecord, LightShape
from wrt.scene.lights import LIGHTS
from wrt.upload.scene_data import build_scene

pytestmark = pytest.mark.slow

(CODE,) = re.findall(r"^```python\n(.*?)^```$", (ROOT / "docs" / "own-light.md").read_text("utf-8"), re.M | re.S)

INNER, OUTER, HEIGHT = 0.4, 0.7, 1.0


@functools.cache
def example() -> ModuleType:
    """Return the page's program as a module, from a file since Warp reads it; it registers its light."""
    path = Path(tempfile.mkdtemp()) / "ring.py"
    path.write_text(CODE, "utf-8")
    spec = importlib.util.spec_from_file_location("ring", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module", autouse=True)
def _forget() -> Iterator[None]:
    """Leave the registers as they were found, for tests of other files that look at every light."""
    LIGHTS.setdefault("ring", example().RingLight)
    yield
    LIGHTS.pop("ring", None)


@pytest.fixture(autouse=True)
def one_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    render_with([replace(EVERY_LIGHT, light_shapes=(*BUILT_IN, "ring"))], monkeypatch)


def ring() -> wrt.Light:
    return example().RingLight((0.0, HEIGHT, 0.0), (0.0, -1.0, 0.0), INNER, OUTER, radiance=1.0)


def test_the_program_runs_and_its_light_is_reflected(tmp_path: Path) -> None:
    (tmp_path / "ring.py").write_text(CODE, "utf-8")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "ring.py"], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    image = wrt.load_image(tmp_path / "ring.png")
    # By the law of reflection the ball shows the ring around its middle, which shows the hole.
    green = image[256, 256:330, 1]
    assert green[:15].max() < 0.15
    assert green[25:33].min() > 0.3
    assert green[40:].max() < 0.15


@functools.cache
def kernel_of(model: LightModel) -> wp.Kernel:
    """Return the kernel that draws ways to a light, and asks `pdf` about where rays along them meet it."""
    model_sample, model_pdf, meet, shines_back = model.sample, model.pdf, model.meet, model.shines_back

    @wp.kernel(module="unique", enable_backward=False)
    def draw(shape: LightShape, receiver: Receiver, u: wp.array(dtype=wp.vec2), out: wp.array2d(dtype=wp.vec3)):
        i = wp.tid()
        light = LightRecord()
        light.value = wp.vec3(1.0)
        s = model_sample(light, shape, receiver, u[i])
        ray = Ray()
        ray.origin = receiver.position
        ray.direction = s.wi
        t = meet(shape, ray)
        asked = 0.0
        if shines_back(light, shape, ray):
            asked = model_pdf(shape, receiver, s.wi, t)
        out[0, i] = s.wi * t
        out[1, i] = wp.vec3(s.pdf, asked, 0.0)

    return draw


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (6.0, 0.95, 1.0)])
def test_samples_follow_the_density(place: tuple[float, float, float], device: str, report: Report) -> None:
    """Over cells of the ring, between circles and radii; on its back it has no density."""
    initialize_warp()
    n, cells = 2**18, (16, 24)
    shape, receiver = LightShape(), Receiver()
    for key, value in ring().shape().items():  # type: ignore[union-attr]
        setattr(shape, key, (wp.vec2 if key == "size" else wp.vec3)(*value))
    u = upload(uniforms(n, 2, seed=int(place[0])), wp.vec2, device)

    def drawn(position: tuple[float, float, float]) -> np.ndarray:
        receiver.position = wp.vec3(*position)
        out = wp.empty((2, n), dtype=wp.vec3, device=device)
        wp.launch(kernel_of(LIGHT_SHAPES.model_of("ring")), n, [shape, receiver, u], [out], device=device)
        return out.numpy().astype(np.float64)

    way, densities = drawn(place)
    asked = densities[:, 1]
    np.testing.assert_allclose(densities[:, 0], asked, rtol=2e-4)
    x, y, z = (way + place).T
    np.testing.assert_allclose(y, HEIGHT, atol=1e-5)
    r2 = x * x + z * z
    on_ring = np.clip(r2, INNER**2, OUTER**2)
    np.testing.assert_allclose(r2, on_ring, atol=1e-5)
    limits = [[INNER**2, OUTER**2], [-np.pi, np.pi]]
    counts, *_ = np.histogram2d(on_ring, np.arctan2(z, x), bins=cells, range=limits)
    # Of a direction with the density p, the point has p cosθ / d² over the area: the same everywhere.
    over_area = asked * (HEIGHT - place[1]) / np.linalg.norm(way, axis=1) ** 3
    np.testing.assert_allclose(over_area, 1.0 / (np.pi * (OUTER**2 - INNER**2)), rtol=2e-4)
    result = chi_square_test(counts, np.full(cells, n / counts.size), tests=2, samples=n, total_tolerance=2e-3)
    report(f"ring from {place}", result.statistic, result.dof, p=result.p)
    assert result.passed, result.message
    assert not drawn((0.1, 2.0, 0.3))[1].any()


@pytest.mark.parametrize("strategy", ["mis", "light", "bsdf"])
def test_estimators_agree_with_the_closed_form(strategy: str, device: str, report: Report) -> None:
    """The irradiance of a ring is that of a disk less that of its hole."""
    scene = floor_scene(eye=0.9)
    scene.add_light(ring())
    spp = 2048 if strategy == "bsdf" else 512
    where, measured, variance = irradiance(scene, device, spp, strategy=strategy)

    def exact(x: np.ndarray, z: np.ndarray) -> np.ndarray:
        return disk_irradiance(x, z, HEIGHT, OUTER) - disk_irradiance(x, z, HEIGHT, INNER)

    check(f"ring, {strategy}", measured, variance, pixel_mean(exact, where), spp, report)


def test_it_is_a_light_like_any_other(tmp_path: Path, device: str) -> None:
    """In scene files and beside all other kinds, through the tree as by power."""
    (tmp_path / "scene.toml").write_text(
        '[camera]\norigin = [0, 0.5, 3]\n[[lights]]\ntype = "ring"\ncenter = [0, 2, 0]\nnormal = [0, -1, 0]\n'
        '[[lights]]\ntype = "sphere"\ncenter = [2, 2, 0]\nradiance = 1\n'
        '[[lights]]\ntype = "point"\nposition = [0, 3, 2]\nintensity = 1.0\n'
        '[[lights]]\ntype = "directional"\ndirection = [0, -1, 0.1]\nangle_degrees = 9\n'
        '[[shapes]]\ntype = "quad"\norigin = [-4, -0.5, 4]\nedge_u = [8, 0, 0]\nedge_v = [0, 0, -8]\n'
    )
    scene = wrt.load(tmp_path / "scene.toml")
    assert scene.lights[0] == example().RingLight((0.0, 2.0, 0.0), (0.0, -1.0, 0.0))
    assert build_scene(scene, Device("cpu")).features.light_shapes == (*BUILT_IN, "ring")
    means = []
    for choice in ("power", "tree"):
        options = {"device": device, "light_choice": choice, "sampler": "independent", "max_depth": 2}
        renderer = wrt.Renderer(scene, width=16, height=12, **options)
        for _ in renderer.passes(spp=512):
            pass
        means.append(renderer.image().mean())
    assert means[0] == pytest.approx(means[1], rel=0.02)
    with pytest.raises(wrt.InputError, match=r"outer must be greater than 0\.6"):
        example().RingLight((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.6)


def test_what_cannot_be_registered_is_refused() -> None:
    before, families = dict(LIGHTS), dict(LIGHT_SHAPES.families)
    half = "half: a light that rays can meet needs both"
    for name, model, message in (
        ("", DISK, "type_name '' is empty or taken"),
        ("disk", DISK, "type_name 'disk' is empty or taken"),
        ("ring", DISK, "type_name 'ring' is empty or taken"),
        ("half", DISK._replace(shines_back=None), half),
        ("half", DISK._replace(pdf=None), "half: a light needs a `pdf` if it has"),
    ):
        cls = type("Mine", (wrt.Light,), {"type_name": name} if name else {})
        with pytest.raises(wrt.InputError) as caught:
            wrt.register_light(cls, model)
        assert str(caught.value).startswith(f"Mine: {message}")
    assert (before, families) == (LIGHTS, LIGHT_SHAPES.families)
    with pytest.raises(wrt.InputError, match=r"a light must be one of .*, not Mine"):
        floor_scene().add_light(cls())
