"""One kernel for each set of features: never two for one set, never one for two."""

from __future__ import annotations

import itertools
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from conftest import ROOT

import wrt
from wrt.backend.device import Device
from wrt.backend.warp_backend import initialize_warp
from wrt.kernels.features import Features
from wrt.kernels.render import make_render_kernel
from wrt.upload.scene_data import build_scene

ENVIRONMENTS = ("none", "constant", "image")


def all_features() -> Iterator[Features]:
    names = sorted(("conductor", "dielectric", "diffuse", "mirror"))
    for n in range(1, len(names) + 1):
        for models in itertools.combinations(names, n):
            for textured, environment in itertools.product((False, True), ENVIRONMENTS):
                yield Features(models, textured, environment)


def hash_of(features: Features) -> bytes:
    initialize_warp()
    module = make_render_kernel(features).module
    return bytes(module.get_module_hash())


def test_names_tell_all_variants_apart() -> None:
    variants = list(all_features())
    assert len({features.name for features in variants}) == len(variants)
    assert all(features.name.isidentifier() for features in variants)


def test_modules_and_hashes_tell_variants_apart() -> None:
    """Each of these differs from the first in one feature alone."""
    base = Features(("diffuse", "mirror"), False, "constant")
    variants = [
        base,
        Features(("diffuse",), False, "constant"),
        Features(("mirror",), False, "constant"),
        Features(("conductor", "mirror"), False, "constant"),
        Features(("dielectric", "mirror"), False, "constant"),
        Features(("conductor", "diffuse", "mirror"), False, "constant"),
        Features(("diffuse", "mirror"), True, "constant"),
        Features(("diffuse", "mirror"), False, "none"),
        Features(("diffuse", "mirror"), False, "image"),
    ]
    modules = {make_render_kernel(features).module.name for features in variants}
    assert len(modules) == len(variants)
    hashes = {hash_of(features) for features in variants}
    assert len(hashes) == len(variants)


def test_equal_features_share_one_kernel() -> None:
    a = Features(("diffuse", "mirror"), False, "none")
    b = Features(tuple(name for name in ("diffuse", "mirror")), bool(0), "".join(["no", "ne"]))
    assert a == b
    assert make_render_kernel(a) is make_render_kernel(b)
    assert hash_of(a) == hash_of(b)


def scene(*materials: wrt.Material, environment: object = None) -> wrt.Scene:
    result = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0)))
    result.environment = environment or wrt.ConstantEnvironment(1.0)  # type: ignore[assignment]
    for i, material in enumerate(materials):
        result.add(wrt.quad((-9, -9, -i), (18, 0, 0), (0, 18, 0)), material=material)
    return result


def features_of(target: wrt.Scene) -> Features:
    return build_scene(target, Device("cpu")).features


def test_scenes_state_what_they_use() -> None:
    image = wrt.ImageEnvironment(np.ones((2, 4, 3), np.float32))
    texture = wrt.ImageTexture(np.ones((2, 2, 3), np.float32))
    expected = {
        Features(("diffuse",), False, "constant"): scene(wrt.Diffuse()),
        Features(("diffuse", "mirror"), False, "constant"): scene(wrt.Mirror(), wrt.Diffuse(), wrt.Mirror(0.5)),
        Features(("conductor", "dielectric"), False, "constant"): scene(wrt.Dielectric(), wrt.Conductor()),
        Features(("diffuse",), True, "constant"): scene(wrt.Diffuse(texture)),
        Features(("mirror",), True, "constant"): scene(wrt.Mirror(wrt.VertexColor())),
        Features(("diffuse",), False, "image"): scene(wrt.Diffuse(), environment=image),
        Features(("diffuse",), False, "none"): scene(wrt.Diffuse(), environment=wrt.ConstantEnvironment(0.0)),
    }
    for features, target in expected.items():
        assert features_of(target) == features
    # Values, sizes and numbers of shapes make no variant.
    assert features_of(scene(wrt.Diffuse(0.1), wrt.Diffuse(0.9))) == features_of(scene(wrt.Diffuse()))


def test_a_second_renderer_compiles_nothing() -> None:
    first = wrt.Renderer(scene(wrt.Diffuse(0.5)), width=4, height=4)
    before = cached(first)
    second = wrt.Renderer(scene(wrt.Diffuse(0.7), wrt.Diffuse(0.2)), width=5, height=3, seed=4)
    assert second._kernel.scalar is first._kernel.scalar
    assert before
    assert cached(second) == before


def cached(renderer: wrt.Renderer) -> dict[str, int]:
    """Return the files that Warp keeps of a renderer's kernel, with when they were written."""
    folder = Path(wp.config.kernel_cache_dir)
    return {str(p): p.stat().st_mtime_ns for p in folder.glob(f"wp_{renderer._kernel.scalar.module.name}_*/*")}


CODE = """
import json, sys
from pathlib import Path
import warp as wp
wp.config.kernel_cache_dir = sys.argv[1]
wp.config.log_level = wp.LOG_WARNING
import wrt
sys.path.insert(0, "tests")
from test_kernel_variants import scene

def middle(*materials, depth=2):
    renderer = wrt.Renderer(scene(*materials), width=3, height=3, max_depth=depth)
    for _ in renderer.passes(spp=4):
        pass
    return renderer.image()[1, 1].tolist()

def builds():
    return sorted(p.name for p in Path(wp.config.kernel_cache_dir).glob("wp_wrt.render*"))

wp.init()
result = {"before": builds()}
for name, material in {
    "diffuse": wrt.Diffuse(0.5), "mirror": wrt.Mirror(0.75), "diffuse again": wrt.Diffuse(0.25),
    "mirror again": wrt.Mirror(0.5), "red mirror": wrt.Mirror((1.0, 0.0, 0.0)),
}.items():
    result[name] = middle(material)
    result[name + ", builds"] = builds()
print(json.dumps(result))
"""


def run_with_cache(folder: Path) -> dict:
    done = subprocess.run([sys.executable, "-c", CODE, str(folder)], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.slow
def test_two_variants_in_one_process_are_two_kernels(tmp_path: Path) -> None:
    """From an empty cache: a diffuse scene, then a mirror, each right, and each built once.

    A variant that was taken for another one would show the other's picture, and only with a fresh cache.
    """
    wrt.Renderer(scene(wrt.Diffuse(0.5)), width=4, height=4)
    cache = Path(wp.config.kernel_cache_dir)
    # All but the render kernels comes from the cache of this process: it takes longest and is not in question.
    for folder in cache.glob("wp_wrt.kernels.*"):
        if not re.search(r"_p\d+_t\d+$", folder.name):  # that another process is just writing
            shutil.copytree(folder, tmp_path / cache.name / folder.name)
    first = run_with_cache(tmp_path)
    assert first["before"] == []
    expected = {"diffuse": [0.5] * 3, "mirror": [0.75] * 3, "diffuse again": [0.25] * 3, "mirror again": [0.5] * 3}
    for name, value in {**expected, "red mirror": [1.0, 0.0, 0.0]}.items():
        np.testing.assert_allclose(first[name], value, rtol=1e-6, err_msg=name)
    assert len(first["diffuse, builds"]) == 1
    assert len(first["mirror, builds"]) == 2
    assert first["red mirror, builds"] == first["mirror, builds"]
    # Another process finds them all, and sees the same.
    second = run_with_cache(tmp_path)
    assert second["before"] == first["mirror, builds"] == second["red mirror, builds"]
    for name in expected:
        assert second[name] == first[name]
