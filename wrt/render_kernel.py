"""What renders a pass: the kernel for the scene's features, and on CPUs that can the faster one in its place."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from wrt.build.bvh import kernels_of_building
from wrt.device import Device
from wrt.wide import WideKernel


class RenderKernel:
    """The kernels of one picture.

    Attributes:
        usual: the kernel that runs a thread for each pixel.
        records: those of its arguments that lead to arrays, to be set before the first pass.
    """

    def __init__(self, device: Device, features: Any, width: int, height: int) -> None:
        """Take a scene's features, and the size of the film in pixels."""
        from wrt.kernels.render import make_render_kernel

        self.records: tuple[Any, ...] = ()
        self._device, self._features = device, features
        self._width, self._height = width, height
        self.usual = make_render_kernel(features)
        self._wide: WideKernel | None = None

    def compile(self, compile: Callable[[Any], None]) -> None:
        """Have all be compiled that is needed from here on, by `Device.compiling`."""
        from wrt.kernels.film import film_noise

        # The largest, then those needed last: meanwhile the tree is built, which compiles from the other end.
        for kernel in (self.usual, film_noise, *reversed(kernels_of_building())):
            compile(kernel)

    def launch(self, inputs: list[Any], seconds_left: float) -> None:
        """Render a pass with the kernel's arguments; `seconds_left` tells if preparing to be faster is worth it."""
        faster = self._faster()
        faster.prepare(seconds_left)
        if faster.kernel is None:
            self._device.launch(self.usual, self._width * self._height, inputs, spared=int(faster.is_being_compiled))
            return
        from wrt.kernels.wide.render import TILE

        self._device.launch(faster.kernel, -(-self._width // TILE) * -(-self._height // TILE), inputs)

    def wait_for_wide(self) -> None:
        """Return once the faster kernel is there, if it can be had."""
        self._faster().wait()

    @property
    def is_being_compiled(self) -> bool:
        """Whether another process is at the faster kernel."""
        return self._faster().is_being_compiled

    @property
    def seconds_beside(self) -> float:
        """Seconds that another process has spent compiling the wide kernel so far."""
        return self._faster().seconds

    @property
    def in_use(self) -> Any:
        """The kernel that the next pass is rendered with."""
        return self._faster().kernel or self.usual

    def _faster(self) -> WideKernel:
        if self._wide is None:
            self._wide = WideKernel(self._device, self._features, self.records)
        return self._wide
