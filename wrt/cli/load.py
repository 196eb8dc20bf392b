"""The scene and the renderer that the options of `wrt render` ask for."""

from __future__ import annotations

import argparse
import functools
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from wrt.rendering.renderer import Renderer
    from wrt.scene.scene import Scene


def load_input(options: argparse.Namespace, *, time: float | None = None) -> Scene:
    """Return the scene of the input as the options show it, at a time of its animation or else at rest."""
    import dataclasses

    from wrt.api import load

    scene = load(
        options.input,
        triangles=options.triangles,
        up=options.up,
        parameters=dict(options.define or ()),
        sensor=options.sensor,
        strict=options.strict,
        confined=options.confined,
        view=options.view,
        frame=options.frame,
        material=options.material,
        environment=options.environment,
        transparent=options.transparent,
        aspect=options.size and options.size[0] / options.size[1],
        time=time,
    )
    given = {name: getattr(options, name) for name in ("tone", "exposure") if getattr(options, name) is not None}
    scene.settings = dataclasses.replace(scene.settings, **given)
    if options.denoise or scene.settings.denoise:
        from wrt.develop.denoise import require_denoiser

        scene.settings = dataclasses.replace(scene.settings, denoise=True)
        require_denoiser()  # before rendering
    return scene


def make_renderer(options: argparse.Namespace, scene: Scene) -> Renderer:
    """Return a renderer with the settings of the options."""
    from wrt.rendering.renderer import Renderer
    from wrt.scene.layers import layer_names

    make: Any = Renderer
    if options.dask is not None:
        from wrt.distributed.head import DistributedRenderer

        make = functools.partial(DistributedRenderer, client=_client(options.dask))
    elif options.device.startswith("cuda:") and not options.device[5:].isdecimal():
        from wrt.distributed.processes import devices_of

        devices = devices_of(options.device) or [options.device]
        if len(devices) == 1:
            options.device = devices[0]
        else:
            from wrt.distributed.head import DistributedRenderer

            make = functools.partial(DistributedRenderer, client=_processes(tuple(devices)))
    width, height = options.size or (None, None)
    renderer: Renderer = make(
        scene,
        width=width,
        height=height,
        device=options.device,
        seed=options.seed,
        threads=options.threads,
        max_depth=options.max_depth,
        crop=options.crop,
        sampler=options.sampler,
        integrator=options.integrator,
        clamp_indirect=options.clamp_indirect,
        regularization=options.regularization,
        layers=None if options.layers is None else layer_names(options.layers),
    )
    return renderer


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
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # of what Dask logs, wrt's own error names the cause
    atexit.register(client.close, timeout=5)
    return client
