"""The kernels of a pass: the scalar one, and the wide one that replaces it on CPUs that can run it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from wrt.backend import current_backend
from wrt.backend.device import Device
from wrt.compiling import general
from wrt.rendering.wide_kernel import WideKernel
from wrt.upload.accel.bvh import kernels_of_building


class RenderKernel:
    """The kernels of one picture.

    Attributes:
        scalar: the kernel that runs a thread for each pixel.
        read: features that this kernel reads of the scene, which may have fewer.
        records: its arguments that hold arrays, to be set before the first pass.
        seconds_after: time that other pictures of the same kernel take after this one.
    """

    def __init__(self, device: Device, features: Any, width: int, height: int) -> None:
        """Create the kernels for the features of a scene and a film of width x height pixels."""
        self.records: tuple[Any, ...] = ()
        self.seconds_after = 0.0
        self._device, self._features = device, features
        self._width, self._height = width, height
        self.read = general.readiest(features, device.backend.builds)
        self.scalar = current_backend().call(*general.MAKE, self.read)
        self._wide: WideKernel | None = None

    def compile(self, compile: Callable[[Any], None]) -> None:
        """Compile all kernels that are still needed, with the function of `Device.compiling`."""
        film = current_backend().kernels("wrt.kernels.film.film")
        # The largest first, then those needed last: building the tree meanwhile compiles from the other end.
        for kernel in (self.scalar, film.film_noise, *reversed(kernels_of_building())):
            compile(kernel)

    def expect(self, seconds: float) -> None:
        """Load the wide kernel before the first pass, if that is quick, for a render that takes so long at least."""
        self._wide_kernel().expect(seconds + self.seconds_after)

    def launch(self, inputs: list[Any], seconds_left: float) -> None:
        """Render a pass with the kernel's arguments; `seconds_left` decides whether to load the wide kernel."""
        wide = self._wide_kernel()
        wide.prepare(seconds_left + self.seconds_after)
        if wide.kernel is None:
            spared = int(wide.is_being_compiled)
            self._device.launch(self.scalar, self._width * self._height, inputs, spared=spared, cancellable=True)
            return
        tiles = -(-self._width // wide.tile) * -(-self._height // wide.tile)
        self._device.launch(wide.kernel, tiles, inputs, cancellable=True)

    def share_wide(self, other: RenderKernel) -> None:
        """Use the wide kernel of `other` if it is for the same features, instead of loading another."""
        if other._features == self._features:
            self._wide = other._wide_kernel()

    def wait_for_wide(self) -> None:
        """Return once the wide kernel is loaded, if there is one."""
        self._wide_kernel().wait()

    @property
    def is_being_compiled(self) -> bool:
        """True while another process compiles the wide kernel."""
        return self._wide_kernel().is_being_compiled

    @property
    def seconds_beside(self) -> float:
        """Seconds that another process has spent compiling the wide kernel so far."""
        return self._wide_kernel().seconds

    @property
    def lanes(self) -> int:
        """Paths that the kernel of the next pass follows at once."""
        return self._wide_kernel().lanes

    @property
    def in_use(self) -> Any:
        """The kernel of the next pass."""
        return self._wide_kernel().kernel or self.scalar

    def _wide_kernel(self) -> WideKernel:
        if self._wide is None:
            self._wide = WideKernel(self._device, self._features, self.records)
        return self._wide
