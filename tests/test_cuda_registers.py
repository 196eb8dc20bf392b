"""`scripts/cuda_registers.py` looks at every kernel that CUDA runs, and reads its numbers rightly."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from types import ModuleType

import pytest
from conftest import ROOT
from test_cuda_compile import declared_kernels

from wrt.kernels import regeneration


@pytest.fixture(scope="module")
def script() -> Iterator[ModuleType]:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "scripts"))
        yield importlib.import_module("cuda_registers")


def test_no_kernel_is_left_out(script: ModuleType) -> None:
    declared = {name.removeprefix("wrt.kernels.") for name in declared_kernels()}
    left_out = {name for name in declared if name.rpartition(".")[2] in script.CPU_ONLY}
    assert len(left_out) == len(script.CPU_ONLY)
    rendered = {f"{of}.render_pass ({name})" for name in script.render_features() for of in ("render", "regeneration")}
    assert {name for name, _ in script.all_kernels()} == (declared - left_out) | rendered


def test_render_kernels_are_those_that_a_gpu_runs(script: ModuleType) -> None:
    """What a GPU adds to the features of a scene is decided in one place, and not again by the script."""
    kernels = dict(script.all_kernels())
    for name, features in script.render_features().items():
        assert not features.slot_loop
        assert kernels[f"regeneration.render_pass ({name})"] is regeneration.make_gpu_render_kernel(features)
        assert kernels[f"render.render_pass ({name})"] is regeneration.make_gpu_render_kernel(features, False)


@pytest.mark.parametrize(
    ("registers", "arch", "threads"), [(32, 90, 2048), (33, 90, 1536), (72, 90, 768), (32, 75, 1024), (255, 75, 256)]
)
def test_resident_threads(registers: int, arch: int, threads: int, script: ModuleType) -> None:
    """As NVIDIA's occupancy calculator has it, for blocks of 256."""
    assert script.resident_threads(registers, arch) == threads


SAID = {
    "cuobjdump": """
Resource usage:
 Common:
  GLOBAL:151 CONSTANT[3]:5720
 Function trace_rays_5f05_cuda_kernel_forward:
  REG:72 STACK:2320 SHARED:1024 LOCAL:0 CONSTANT[0]:848 TEXTURE:0 SURFACE:0 SAMPLER:0
""",
    "ptxas": """
ptxas info    : Compiling entry function 'trace_rays_5f05_cuda_kernel_forward' for 'sm_75'
ptxas info    : Function properties for trace_rays_5f05_cuda_kernel_forward
    2320 bytes stack frame, 8 bytes spill stores, 12 bytes spill loads
ptxas info    : Used 72 registers, used 0 barriers, 2320 bytes cumulative stack size
""",
}


@pytest.mark.parametrize("ptxas", ["ptxas", None])
def test_what_the_tools_say_is_read(ptxas: str | None, script: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    from wrt.kernels.accel.ray_batch import trace_rays

    monkeypatch.setattr(script, "run", lambda tool, *_: SAID[tool])
    spilled = {"spill_stores": 8, "spill_loads": 12} if ptxas else {}
    found = script.resources(trace_rays.module, 75, "cuobjdump", ptxas)
    assert found == {"trace_rays_5f05_cuda_kernel_forward": {"registers": 72, "stack": 2320, **spilled}}


def test_a_kernel_is_compiled_and_read(script: ModuleType) -> None:
    """The whole way, where the tool is installed."""
    from wrt.kernels.accel.ray_batch import trace_rays

    cuobjdump = script.find_tool("cuobjdump", "nvidia-cuda-cuobjdump")
    if cuobjdump is None:
        pytest.skip("cuobjdump is not installed: pip install nvidia-cuda-cuobjdump")
    used = script.resources(trace_rays.module, 90, cuobjdump, None)
    assert 0 < used[f"{trace_rays.get_mangled_name()}_cuda_kernel_forward"]["registers"] <= 255
