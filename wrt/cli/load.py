"""The scene and the renderer for the options of `wrt render`."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from wrt.cli.options import RenderOptions
    from wrt.rendering.renderer import Renderer
    from wrt.scene.scene import Scene


def load_input(source: str, options: RenderOptions, *, time: float | None = None) -> Scene:
    """Load an input with the options' settings, at a time of its animation or else at rest."""
    from wrt.api import load_with_settings

    return load_with_settings(source, options.settings, **options.loading, time=time)


def make_renderer(scene: Scene, options: RenderOptions) -> Renderer:
    """Return a renderer on the options' device, on several GPUs, or on the workers of a Dask cluster."""
    device, cluster = options.device, None
    if options.dask is not None:
        cluster = _client(options.dask)
    elif device.startswith("cuda:") and not device[5:].isdecimal():
        from wrt.distributed.processes import devices_of

        devices = devices_of(device) or [device]
        device = devices[0]
        if len(devices) > 1:
            cluster = _processes(tuple(devices))
    if cluster is None:
        from wrt.rendering.renderer import Renderer

        return Renderer(scene, device=device, seed=options.seed, threads=options.threads)
    from wrt.distributed.head import DistributedRenderer

    return DistributedRenderer(scene, client=cluster, device=options.device, seed=options.seed, threads=options.threads)


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
