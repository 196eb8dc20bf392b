"""Calls of Warp for a GPU, for which something stands in: which one they reach, and what happens without memory."""

import re
from types import SimpleNamespace
from typing import Any

import pytest
import warp as wp
from support.emulated_cuda.backend import GPU, emulated_cuda
from support.kernels import upload

from wrt.backend import current_backend
from wrt.backend.backend import Backend, Kernel
from wrt.backend.cuda import warp_errors
from wrt.backend.cuda.warp_errors import on_device
from wrt.backend.device import Device
from wrt.cli import main
from wrt.errors import NotEnoughMemory

CUDA_SAYS = "Warp CUDA error 2: out of memory (in function wp_alloc_device_async, warp.cu:812)"


class StandIn:
    """A GPU of Warp's that is not there.

    How many of its contexts are entered, whether Warp's library writes its errors, how often CUDA forgot one.
    """

    is_cuda, is_cpu, context = True, False, 7
    __hash__ = None  # as Warp's devices, which compare by their contexts

    def __init__(self) -> None:
        self.inside, self.writes, self.forgotten = 0, 1, 0
        self.context_guard = self
        self.runtime = SimpleNamespace(core=self)

    def __str__(self) -> str:
        return "cuda:1"

    def __enter__(self) -> None:
        self.inside += 1

    def __exit__(self, *_: object) -> None:
        self.inside -= 1

    def wp_is_error_output_enabled(self) -> int:
        return self.writes

    def wp_set_error_output_enabled(self, value: int) -> None:
        self.writes = value

    def wp_cuda_context_check(self, context: int) -> int:
        assert (context, self.writes) == (7, 0)
        self.forgotten += 1
        return 0


def sorted_pairs(backend: Any) -> Any:
    keys, values = upload([3.0, 1.0, 0.0, 0.0], float, "cpu"), upload([5, 6, 0, 0], int, "cpu")
    backend.sort_pairs(keys, values, 2)
    return values.numpy()[:2].tolist()


@pytest.fixture
def second_gpu(monkeypatch):
    """Take every array to be on the second GPU."""
    gpu = StandIn()
    Device("cpu")
    monkeypatch.setattr(warp_errors, "_cuda", lambda device: gpu)
    return gpu


def test_functions_of_warp_run_on_the_gpu_of_their_arrays(second_gpu, monkeypatch):
    """Warp runs them on the current GPU of the thread."""
    for name, call, expected in (
        ("array_scan", lambda backend: backend.sums_before(upload([3, 4, 5], int, "cpu")).numpy().tolist(), [0, 3, 7]),
        ("array_sum", lambda backend: backend.total(upload([3.0, 4.0], float, "cpu")), 7.0),
        ("radix_sort_pairs", sorted_pairs, [6, 5]),
    ):
        calls, real = [], getattr(wp.utils, name)

        def recorded(*arguments, calls=calls, real=real, **options):
            calls.append((second_gpu.inside, second_gpu.writes))
            return real(*arguments, **options)

        monkeypatch.setattr(wp.utils, name, recorded)
        assert call(current_backend()) == expected
        assert calls == [(1, 0)]
        assert (second_gpu.inside, second_gpu.writes, second_gpu.forgotten) == (0, 1, 0)


def test_memory_that_runs_out_is_reported_once(second_gpu):
    allocation = "Failed to allocate 2147483648 bytes on device 'cuda:1'"
    for number, (message, figure) in enumerate(((allocation, ": 2.15 GB more were needed"), (CUDA_SAYS, "")), start=1):
        with pytest.raises(NotEnoughMemory) as caught, on_device("cuda:1"):
            raise RuntimeError(message)
        assert str(caught.value).startswith(f"memory ran out on cuda:1{figure}; ")
        assert (second_gpu.inside, second_gpu.writes, second_gpu.forgotten) == (0, 1, number)


def test_other_errors_stay_what_they_are_and_a_launch_may_lack_memory_for_its_stack(second_gpu, monkeypatch):
    with pytest.raises(RuntimeError, match="illegal") as caught, on_device("cuda:1"):
        raise RuntimeError("an illegal memory access")
    assert not isinstance(caught.value, NotEnoughMemory)
    assert second_gpu.forgotten == 0

    def fail(*_, **__):
        raise RuntimeError(f"Error launching kernel: render_pass on device cuda:1: {CUDA_SAYS}")

    monkeypatch.setattr(wp, "launch", fail)
    with pytest.raises(NotEnoughMemory, match="memory ran out on cuda:1; "):
        Backend().launch(Kernel("", "", lambda: None), 0, 1, [], "cuda:1")


@pytest.mark.machinery
@pytest.mark.parametrize("name", ["radix_sort_pairs", "array_sum"])
def test_no_tree_is_built_where_warp_finds_no_memory_of_its_own(name, monkeypatch, tmp_path, capfd):
    """These functions of Warp's then return and have done nothing."""
    picture = tmp_path / "picture.png"
    options = ["--device", GPU, "--size", "8x8", "--spp", "1", "--quiet", "-o", str(picture)]
    with emulated_cuda(optimization=0):
        monkeypatch.setattr(wp.utils, name, lambda *_, **__: None)
        assert main(["render", "cornell-box", *options]) == 1
    printed = capfd.readouterr().err
    # Arrays of the emulated GPU say that they are on the CPU.
    assert re.match(r"wrt: error: memory ran out on (cuda:0|cpu); ", printed)
    assert printed.count("\n") == 1
    assert not picture.exists()
