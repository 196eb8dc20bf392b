"""What renders a pass: the kernel for the scene's features, and on CPUs that can the faster one in its place."""

from __future__ import annotations

from typing import Any

from wrt.device import Device
from wrt.wide import WideKernel


class RenderKernel:
    """The kernels of one picture.

    Attributes:
        seconds_compile: how long the first took to compile or to load.
    """

    def __init__(self, device: Device, features: Any, scene: Any, width: int, height: int) -> None:
        """Compile the kernel for features; `scene` is the record of its arrays, width and height those of the film."""
        from wrt.kernels.render import make_render_kernel

        self._device = device
        self._width, self._height = width, height
        self._kernel = make_render_kernel(features)
        self.seconds_compile = device.compile(self._kernel)
        self._wide = WideKernel(device, features, scene)

    def launch(self, inputs: list[Any], seconds_left: float) -> None:
        """Render a pass with the kernel's arguments; `seconds_left` tells if preparing to be faster is worth it."""
        self._wide.prepare(seconds_left)
        if self._wide.kernel is None:
            self._device.launch(self._kernel, self._width * self._height, inputs)
            return
        from wrt.kernels.wide.render import TILE

        self._device.launch(self._wide.kernel, -(-self._width // TILE) * -(-self._height // TILE), inputs)

    def wait_for_wide(self) -> None:
        """Return once the faster kernel is there, if it can be had."""
        self._wide.wait()

    @property
    def in_use(self) -> Any:
        """The kernel that the next pass is rendered with."""
        return self._wide.kernel or self._kernel
