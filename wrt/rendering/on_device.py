"""The film of a Renderer on its device, for other frameworks there."""

from __future__ import annotations

from typing import Any

from wrt.rendering.movable import Movable


class OnDevice(Movable):
    """The part of a Renderer that shares the film as Warp arrays."""

    def device_image(self) -> Any:
        """Return `image` as a (H, W) wp.array of vec3 on the renderer's device.

        Other frameworks share it without a copy, as (H, W, 3): by DLPack, `torch.from_dlpack(image)` or
        `jax.dlpack.from_dlpack(image)`, and by `__cuda_array_interface__`, or `__array_interface__` on the CPU. On a
        GPU it is made on Warp's current stream.
        """
        self._go_over_to_warp()
        return self.film.device_mean()

    def device_film(self) -> dict[str, Any]:
        """Return the film itself as (H, W) Warp arrays on the renderer's device, without a copy; only read them.

        They change with each pass, and hold the next picture after `update_vertices` or `set_camera`. Other frameworks
        share them as `device_image`; dividing `total` by `count` gives the picture, in double precision.

        Returns:
            "total" and "total_of_squares", vec3d sums of samples and of their squares; "count", int32 samples, and
            "rejected", int32 of these that were not finite and count as black; "rays", int64 rays traced.
        """
        self._go_over_to_warp()
        return self.film.on_device()
