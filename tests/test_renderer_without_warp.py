"""In a process that has not imported Warp, a Renderer runs compiled kernels, and goes over to Warp where it must."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from test_compiled_backend import without_notes

BEGIN = """
import json, sys
import numpy as np
import wrt
scene = wrt.load("cornell-box")

def has_warp():
    return "warp" in sys.modules

def renderer_with(spp, scene=scene):
    renderer = wrt.Renderer(scene, width=24, height=24)
    for _ in renderer.passes(spp=spp):
        pass
    return renderer

def digest(*arrays):
    import hashlib
    return [hashlib.sha256(np.ascontiguousarray(array)).hexdigest() for array in arrays]
"""

RENDER = """
renderer = renderer_with(3)
print(json.dumps([has_warp(), digest(renderer.image(), wrt.render("cornell-box", width=24, height=24, spp=3))]))
"""

WITHOUT_WARP = """
import tempfile
from pathlib import Path

renderer = renderer_with(1)
list(renderer.passes(noise=0.2, adaptive="unbiased", spp=8))
camera = wrt.PerspectiveCamera(origin=(0.3, 1.0, 3.9), target=(0.0, 1.0, 0.0), fov_degrees=39)
renderer.set_camera(camera)
list(renderer.passes(spp=2))
with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "film"
    renderer.save_checkpoint(path)
    resumed = wrt.Renderer.resume(path, renderer.scene)
list(resumed.passes(spp=4))
seen = digest(resumed.image(), resumed.variance(), renderer.part(1, 2, spp=2).arrays["total"])
views = [view.image for view in wrt.render_views(scene, [camera, scene.camera], width=24, height=24, spp=2)]
print(json.dumps([has_warp(), seen + digest(*views)]))
"""

GOES_OVER = """
made = []
for needs in (
    lambda renderer: renderer.denoising_guides()["albedo"],
    lambda renderer: renderer.update_vertices(0, scene.shapes[0].mesh.vertices + np.float32(0.01)),
    lambda renderer: renderer.device_image().numpy(),
):
    renderer = renderer_with(2)
    passes = renderer.passes(spp=5)
    next(passes)
    before = renderer.image(), renderer.rays
    moved = needs(renderer)
    if moved is not None:
        assert np.array_equal(renderer.image(), before[0]) and renderer.rays == before[1]
        list(passes)
    else:
        list(renderer.passes(spp=5))
    assert renderer.spp == 5
    made += digest(renderer.image()) + ([] if moved is None else digest(moved))
print(json.dumps([has_warp(), made]))
"""

PRECOMPILE = "print(json.dumps([True, [str(wrt.precompile(scene, denoise=True)) != '']]))"


def run(folder: Path, variables: dict[str, str], script: str, begin: str = BEGIN) -> tuple[bool, list[Any]]:
    """Run a script; return whether it has imported Warp, and what it found."""
    command = [sys.executable, "-W", "error", "-c", begin + script]
    process = subprocess.run(command, cwd=folder, env=variables, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stderr
    has_warp, found = json.loads(process.stdout)
    return has_warp, found


@pytest.fixture
def variables(tmp_path: Path) -> dict[str, str]:
    return without_notes(tmp_path)


@pytest.mark.parametrize(
    "script", [pytest.param(RENDER, id="render"), pytest.param(WITHOUT_WARP, id="everything", marks=pytest.mark.slow)]
)
def test_the_second_process_is_without_warp_and_has_the_same_bits(
    script: str, tmp_path: Path, variables: dict[str, str]
) -> None:
    first = run(tmp_path, variables, script)
    assert first[0]
    assert run(tmp_path, variables, script) == (False, first[1])
    # Where user code has imported Warp, it gets Warp's arrays.
    assert run(tmp_path, variables, script, "import warp\n" + BEGIN) == (True, first[1])


def test_what_is_not_compiled_moves_the_picture_to_warp(tmp_path: Path, variables: dict[str, str]) -> None:
    run(tmp_path, variables, RENDER)
    with_warp = run(tmp_path, variables, GOES_OVER, "import warp\n" + BEGIN)
    assert run(tmp_path, variables, GOES_OVER) == with_warp


@pytest.mark.slow
def test_guides_are_noted_for_the_next_process(tmp_path: Path, variables: dict[str, str]) -> None:
    guides = "normals = renderer_with(2).denoising_guides()['normal']\nprint(json.dumps([has_warp(), digest(normals)]))"
    run(tmp_path, variables, RENDER)
    first = run(tmp_path, variables, guides.replace("has_warp()", "True"))
    assert run(tmp_path, variables, guides) == (False, first[1])


def test_kernels_are_compiled_beforehand_where_others_stand_in(tmp_path: Path, variables: dict[str, str]) -> None:
    run(tmp_path, variables, PRECOMPILE)
    assert run(tmp_path, variables, RENDER)[0] is False


OF_A_USER = """
import warp as wp

@wp.kernel
def sums(values: wp.array(dtype=float), total: wp.array(dtype=float)):
    tile = wp.tile_load(values, shape=8)
    wp.tile_store(total, wp.tile_sum(tile))

wp.config.enable_cpu_blocks = True
wp.init()
values, total = (make(n, dtype=float, device="cpu") for make, n in ((wp.ones, 8), (wp.zeros, 1)))
"""


@pytest.mark.slow
def test_cooperative_kernels_of_users_go_on_to_work(tmp_path: Path, variables: dict[str, str]) -> None:
    """Loading kernels without Warp gives its library functions that must not replace Warp's own."""
    run(tmp_path, variables, RENDER)
    started = "from wrt.backend import current_backend\ncurrent_backend().start()\n"
    compiled = "assert renderer_with(1).device.backend.builds is not None\n"
    launch = "wp.launch_tiled(sums, dim=[1], inputs=[values, total], block_dim=8, device='cpu')\n"
    script = tmp_path / "script.py"
    script.write_text(BEGIN + started + OF_A_USER + compiled + launch + "print(total.numpy().tolist())")
    process = subprocess.run([sys.executable, script], env=variables, capture_output=True, text=True, check=False)
    assert process.stdout.splitlines()[-1:] == ["[8.0]"], process.stderr
