"""`--device emulated-cuda`: the kernel tests on the emulator, without those that are about the host."""

from __future__ import annotations

import contextlib

import pytest

from support.emulated_cuda.backend import emulated_cuda

_NAMES = "Warp says that arrays of the emulated GPU are on the CPU"
_PROCESS = "the process that it starts has no emulated GPU"

LEFT_OUT: dict[str, str] = {
    "test_intersector.py::test_warp_arrays_come_back_as_warp_arrays": _NAMES,
    "test_intersector.py::test_limits_in_a_warp_array": _NAMES,
    "test_instances.py::test_warp_arrays": _NAMES,
    "test_refit.py::test_instances_follow_their_mesh": _NAMES,
    "test_refit.py::test_vertices_as_a_warp_array_are_not_copied": _NAMES,
    "test_refit.py::test_what_is_refused_changes_nothing[Warp]": _NAMES,
    "test_tree_layout.py::test_a_tree_is_built_where_sums_of_coordinates_overflow": _PROCESS,
    "test_tree_layout.py::test_rays_that_are_not_finite_meet_nothing": _PROCESS,
    "test_pace.py": "the emulator is too slow for what is said about seconds",
}
"""Files, or tests as FILE::NAME or with one of their parameters as FILE::NAME[ID], that the emulator cannot run."""


class EmulatedCuda:
    """Gives the process an emulated GPU, and leaves out the tests that it is not for."""

    def __init__(self) -> None:
        self._open = contextlib.ExitStack()

    def pytest_sessionstart(self) -> None:
        """Begin to emulate."""
        self._open.enter_context(emulated_cuda(optimization=0))

    def pytest_sessionfinish(self) -> None:
        """Stop emulating."""
        self._open.close()

    def pytest_collection_modifyitems(self, config: pytest.Config, items: list[pytest.Item]) -> None:
        """Deselect tests that launch no kernels, and those of LEFT_OUT."""
        left_out = [item for item in items if not _runs(item)]
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if _runs(item)]


def _runs(item: pytest.Item) -> bool:
    if not isinstance(item, pytest.Function) or "device" not in item.fixturenames:
        return False
    test = f"{item.path.name}::{item.originalname}"
    return not {item.path.name, test, *(f"{test}[{part}]" for part in item.callspec.id.split("-"))} & set(LEFT_OUT)
