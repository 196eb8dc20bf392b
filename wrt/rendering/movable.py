"""How a Renderer that runs compiled kernels goes over to Warp, when something needs a kernel that is not compiled."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

from wrt.backend import current_backend, is_own_process, note_compiled, using
from wrt.backend.builds import NotCompiled
from wrt.backend.device import Device
from wrt.rendering.film import Film
from wrt.rendering.noise.pilot import Pilot

if TYPE_CHECKING:
    from wrt.rendering.guides import Guides

Result = TypeVar("Result")


class Movable(ABC):
    """The part of a Renderer that keeps to a backend, or moves to Warp's."""

    device: Device
    film: Film
    _pilot: Pilot | None
    _guides: Guides | None
    _inputs: list[Any]

    @abstractmethod
    def _build(self) -> None:
        """Build the scene on the device, and compile its kernel."""

    @abstractmethod
    def _prepare(self) -> list[Any]:
        """Return the arguments of the kernel."""

    def with_backend(self, work: Callable[[], Result]) -> Result:
        """Call `work` with the renderer's backend, and return its result.

        If that needs a kernel that is not compiled, build the scene again with Warp, keep the picture, and call again.
        """
        try:
            with using(self.device.backend):
                return work()
        except NotCompiled:
            if is_own_process():  # what else it has made with this backend must be made again, too
                raise
        self._go_over_to_warp()
        with using(self.device.backend):
            result = work()
        note_compiled()
        return result

    def _go_over_to_warp(self) -> None:
        """Build the scene again with Warp, unless it was."""
        if self.device.backend.builds is None:
            return
        with using(current_backend()):
            self.device = Device(self.device.name, threads=self.device.threads)
            self.film.move(self.device)
            if self._pilot is not None:
                self._pilot.film.move(self.device)
            self._build()
            self._inputs = self._prepare()
            self._guides = None
