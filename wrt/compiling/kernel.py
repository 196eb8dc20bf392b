"""Compile a render kernel for some features, wide or scalar, for other processes.

The wide one of a long render is compiled in a child process that ends with the render; see `wrt.rendering.wide_kernel`.
"""

from __future__ import annotations

import ctypes
import dataclasses
import json
import os
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

from wrt import child
from wrt.backend import current_backend
from wrt.backend.describe import call_name
from wrt.backend.device import Device

SCALAR = 1
"""The lanes of a scalar kernel."""


def has_wide(features: Any) -> bool:
    """Return whether there may be a wide kernel for these features: it traces rays."""
    return bool(features.integrator != "aov")


_PR_SET_PDEATHSIG = 1  # of Linux's prctl.h


RENDER, PHOTONS = "render", "photons"
"""What most kernels do, and what one that follows photons does. Those of gradients are called "radiance" and "replay":
see `wrt.gradients.kernels`."""


def declaration(features: Any, lanes: int, part: str = RENDER) -> tuple[Any, ...]:
    """Return the module, the name and the arguments of the function that declares a kernel."""
    if part == PHOTONS:
        if lanes == SCALAR:
            return "wrt.kernels.integrators.photons", "make_photon_kernel", features
        return "wrt.spmd.kernel", "make_wide_photon_kernel", features, lanes
    if part != RENDER:
        return "wrt.spmd.kernel", "make_wide_gradient_kernel", features, part, lanes
    if lanes == SCALAR:
        return "wrt.kernels.render", "make_render_kernel", features
    return "wrt.spmd.kernel", "make_wide_render_kernel", features, lanes


def name_of_kernel(features: Any, lanes: int, part: str = RENDER) -> str:
    """Return the name in the table of artefacts of the kernel with these features and lanes."""
    module, function, *arguments = declaration(features, lanes, part)
    return call_name(module, function, tuple(arguments))


def as_json(features: Any) -> str:
    """Return features as text, for another process."""
    return json.dumps(dataclasses.asdict(features))


def from_json(text: str) -> Any:
    """Return the features that `as_json` wrote."""
    from wrt.kernels.core.features import Features

    described = json.loads(text)
    return Features(**{name: tuple(value) if isinstance(value, list) else value for name, value in described.items()})


def command(module: str, *arguments: str) -> list[str]:
    """Return the command that runs `main` of a module of wrt in another process with these arguments.

    Raises:
        OSError: if the path of the interpreter is not known.
    """
    return child.command(f"from {module} import main; sys.exit(main(sys.argv))", *arguments)


def start(module: str, *arguments: str, **options: Any) -> subprocess.Popen[bytes]:
    """Run `main` of a module of wrt in another process, which reads nothing and prints nothing.

    Raises:
        OSError: if it cannot be started.
    """
    null = subprocess.DEVNULL
    return subprocess.Popen(command(module, *arguments), stdin=null, stdout=null, stderr=null, **options)


def is_compiled(features: Any, lanes: int, part: str = RENDER) -> bool:
    """Return whether the kernel is compiled and in the cache."""
    return current_backend().artefacts.has(name_of_kernel(features, lanes, part))


def compile_kernel(
    features: Any, lanes: int, uses: Callable[[Device], object] | None = None, part: str = RENDER
) -> None:
    """Compile the kernel in this process, with all that `uses` then needs on the device, for other processes.

    Raises:
        Unsupported: when the scalar kernel cannot be translated.
        OSError: when there is not enough disk space.
    """
    device = Device("cpu")
    device.backend.kernels("wrt.kernels.native.constants").TILE  # noqa: B018  # which a wide kernel needs, too
    device.compile(device.backend.call(*declaration(features, lanes, part)))
    if uses is not None:
        uses(device)
    device.backend.artefacts.save()


def main(arguments: list[str]) -> int:
    """Compile the kernel for features given as JSON, or from a file of code that the parent has generated.

    The arguments are the program's name, the features or the file, the lanes, the kernel's part, the id of the parent
    process, and the folders of Warp's kernels and of the table of artefacts if the usual one fails. This process ends
    with its parent. Concurrent processes compile one after the other.
    """
    import warp as wp

    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C reaches every process of the terminal's foreground group
    _end_with_parent()
    if os.getppid() != int(arguments[4]):
        return 1  # the parent ended before the line above
    artefacts = current_backend().artefacts
    if arguments[5:]:
        wp.config.kernel_cache_dir, table = arguments[5:]
        artefacts.folders.append(Path(table))
    what, lanes, part = arguments[1], int(arguments[2]), arguments[3]
    with artefacts.lock():
        artefacts.refresh()
        if os.path.isabs(what):
            compile_generated(json.loads(Path(what).read_text(encoding="utf-8")))
        elif not is_compiled(features := from_json(what), lanes, part):
            compile_kernel(features, lanes, part=part)
    return 0


def compile_generated(code: Any) -> None:
    """Compile code that another process has generated, unless that is done; raises as `compile_code` does."""
    from wrt.backend.generated import compile_code

    if not current_backend().artefacts.has(code["call"]):
        compile_code(current_backend(), code)


def _end_with_parent() -> None:
    """Ask the system to kill this process when its parent ends for any reason."""
    prctl = getattr(ctypes.CDLL(None), "prctl", None)
    if prctl is not None:
        prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)  # a background job may ignore other signals
