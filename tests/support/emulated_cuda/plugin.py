"""`--device emulated-cuda`: the kernel tests on the emulator, without tests of the host.

Left out is also what is marked `not_emulated`: where Warp says that arrays of the emulated GPU are on the CPU, where a
process is started, which has no emulated GPU, and where a claim is about seconds.
"""

from __future__ import annotations

import contextlib

import pytest

from support.emulated_cuda.backend import emulated_cuda


class EmulatedCuda:
    """Gives the process an emulated GPU, and leaves out the tests that it is not for."""

    def __init__(self) -> None:
        self._open = contextlib.ExitStack()

    def pytest_sessionstart(self) -> None:
        self._open.enter_context(emulated_cuda(optimization=0))

    def pytest_sessionfinish(self) -> None:
        self._open.close()

    def pytest_collection_modifyitems(self, config: pytest.Config, items: list[pytest.Item]) -> None:
        config.hook.pytest_deselected(items=[item for item in items if not _runs(item)])
        items[:] = [item for item in items if _runs(item)]


def _runs(item: pytest.Item) -> bool:
    return "device" in getattr(item, "fixturenames", ()) and item.get_closest_marker("not_emulated") is None
