"""This machine in words: its processor, its devices, and which kernel renders on it."""

from __future__ import annotations

import os
import platform

from wrt.backend import current_backend, prebuilt
from wrt.backend.cuda.gpus import dotted
from wrt.backend.memory import memory_left
from wrt.backend.processor import NEEDED, SWITCH, lanes_here, lanes_of, processor_flags
from wrt.compiling import later
from wrt.slices import available_threads


def system_text() -> str:
    """Return lines on versions, threads, kernels, memory and GPUs of this machine."""
    import wrt

    backend = current_backend()
    rows = {
        "wrt": f"{wrt.__version__}, Warp {backend.version}, Python {platform.python_version()}",
        "system": f"{platform.system()}, {platform.machine()}",
        "threads": str(available_threads()),
        "CPU kernel": kernel_text(),
        "compiled": prebuilt_text(),
        "compiling": later_text(),
        "memory": f"{memory_left() / 1e9:.1f} GB free for this process",
        **gpu_rows(),
    }
    width = max(map(len, rows))
    return "\n".join(f"{name:<{width}}  {text}" for name, text in rows.items())


def gpu_rows() -> dict[str, str]:
    """Return the versions of CUDA, and each GPU by its name for `--device`."""
    backend = current_backend()
    versions = backend.cuda_versions()
    driver = "no driver" if versions.driver is None else f"the driver supports {dotted(versions.driver)}"
    gpus = {f"cuda:{number}": backend.describe_gpu(f"cuda:{number}") for number in range(backend.gpus())}
    if not gpus:
        gpus = {"GPUs": (versions.problem or "none was found").partition(";")[0]}
    required = dotted(versions.required)
    return {"CUDA": f"{dotted(versions.toolkit)} compiles kernels, {required} is needed, {driver}", **gpus}


def kernel_text() -> str:
    """Return which kernel renders on the CPU, and why."""
    lanes, fitting = lanes_here(), lanes_of(processor_flags())
    if lanes != fitting:
        why = f"as {SWITCH}={os.environ[SWITCH]} says"
    elif lanes:
        why = f"the processor has {', '.join(sorted(NEEDED[lanes]))}"
    else:
        why = f"the processor lacks {', '.join(sorted(NEEDED[min(NEEDED)] - processor_flags()))}"
    return f"wide, {lanes} paths at a time ({why})" if lanes else f"scalar ({why})"


def prebuilt_text() -> str:
    """Return which kernels came compiled with the package."""
    files, level = current_backend().artefacts.prebuilt["files"], prebuilt.level_here()
    count = sum(name.startswith("wrt.render.") for name in files)
    if not count:
        return "nothing came with the package, so each kind of scene compiles its kernels first"
    return f"{count} render kernels came with the package, for x86-64-{level} ({prebuilt.SWITCH}=0 ignores them)"


def later_text() -> str:
    """Return whether wide kernels are compiled for later renders, and why not."""
    if not lanes_here():
        return "during renders"
    if later.is_wanted():
        now = "one is compiled now" if later.is_running() else "none is being compiled"
        return f"after renders too, for the next, where that pays; {now} ({later.SWITCH}=0 forbids that)"
    switched_off = os.environ.get(later.SWITCH) == "0"
    return f"during renders, as {later.SWITCH if switched_off else later.BUILD_MACHINE} says"
