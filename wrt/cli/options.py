"""The options of `wrt render` and `wrt compile`, and the scene and the renderer that they describe."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from wrt.rendering.renderer import Renderer
    from wrt.scene.scene import Scene

LIMITS = ("spp", "time", "noise", "adaptive")


@dataclass(frozen=True)
class RenderOptions:
    """What to render, how, and where to save it.

    A new field of `wrt.RenderSettings` or a new option of `wrt.load` needs only its option in
    `wrt.cli.arguments.options`: it arrives here among `settings` or `loading`.

    Attributes:
        inputs: the scenes.
        loading: options of `wrt.load`.
        settings: fields of `wrt.RenderSettings`; None for the scene's own values.
        limits: when rendering ends, arguments of `wrt.Renderer.passes`.
        part: number of a part, from 1, and number of parts.
        output: a picture, a folder, a video, frames or a part.

    The other attributes are options of these names, and None where they were not given.
    """

    inputs: tuple[str, ...]
    loading: Mapping[str, Any]
    settings: Mapping[str, Any]
    limits: Mapping[str, Any]
    device: str = "cpu"
    threads: int | None = None
    seed: int = 0
    dask: str | None = None
    turntable: int | None = None
    frames: tuple[int, int] | None = None
    fps: float = 24.0
    part: tuple[int, int] | None = None
    output: str | None = None
    checkpoint: str | None = None
    resume: bool = False
    save_every: float | None = None
    force: bool = False
    quiet: bool = False
    json: bool = False

    @classmethod
    def from_arguments(cls, arguments: Mapping[str, Any]) -> RenderOptions:
        """Sort the arguments of a command line, by name, into options."""
        from wrt.api import split_settings

        values = dict(arguments)
        limits = {name: values.pop(name, None) for name in LIMITS}
        width, height = values.pop("size") or (None, None)
        values |= {"width": width, "height": height, "denoise": values["denoise"] or None}
        settings, values = split_settings(values)
        loading = loading_options(values)
        inputs = tuple(values.pop("inputs"))
        return cls(inputs, loading, settings, limits, **values)

    @property
    def can_go_on(self) -> bool:
        """Whether another picture of the command may succeed where one failed."""
        return True

    def load(self, source: str, *, time: float | None = None) -> Scene:
        """Load an input with these settings, at a time of its animation or else at rest."""
        from wrt.api import load_with_settings

        return load_with_settings(source, self.settings, **self.loading, time=time)

    def make_renderer(self, scene: Scene) -> Renderer:
        """Return a renderer on the device, on several GPUs, or on the workers of a Dask cluster."""
        device, cluster = self.device, None
        if self.dask is not None:
            cluster = _client(self.dask)
        elif device.startswith("cuda:") and not device[5:].isdecimal():
            from wrt.distributed.processes import devices_of

            devices = devices_of(device) or [device]
            device = devices[0]
            if len(devices) > 1:
                cluster = _processes(tuple(devices))
        if cluster is None:
            from wrt.rendering.renderer import Renderer

            return Renderer(scene, device=device, seed=self.seed, threads=self.threads)
        from wrt.distributed.head import DistributedRenderer

        return DistributedRenderer(scene, client=cluster, device=self.device, seed=self.seed, threads=self.threads)


def loading_options(values: dict[str, Any]) -> dict[str, Any]:
    """Remove the options of `wrt.load` from arguments by name, and return them."""
    from wrt.api import load

    loading = {name: values.pop(name) for name in inspect.signature(load).parameters if name in values}
    return loading | {"parameters": dict(loading["parameters"] or ())}


@functools.cache
def _processes(devices: tuple[str, ...]) -> Any:
    """Return the processes of several GPUs, the same for all inputs."""
    from wrt.distributed.processes import Processes

    return Processes(devices)


@functools.cache
def _client(address: str) -> Any:
    """Return the client of an address, the same for all inputs; it is closed when the process ends."""
    import atexit
    import logging

    from wrt.distributed.dask_cluster import client_of

    client = client_of(address)
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # wrt's own error names the cause
    atexit.register(client.close, timeout=5)
    return client
