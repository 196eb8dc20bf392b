"""`render` and `show`: from a file, a mesh, an object or a scene to a picture."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from wrt.api import load_with_settings, split_settings
from wrt.errors import InputError
from wrt.rendering.passes import Progress


def render(
    source: Any,
    *,
    spp: int | None = None,
    time: float | None = None,
    noise: float | None = None,
    adaptive: bool | None = None,
    device: str = "cpu",
    seed: int = 0,
    threads: int | None = None,
    client: Any = None,
    progress: bool | Callable[[Progress], object] | None = None,
    **options: Any,
) -> Any:
    """Render `source` and return (H, W, 3) float32 linear radiance, of the crop window if there is one.

    A transparent picture is (H, W, 4): its radiance, 0 where nothing is seen, and its coverage (associated alpha). Over
    a background it is (H, W, 3); `save_image`, `develop_image` and `show` leave that colour exact. With
    `layers`, the result is a dictionary of them by name (see `wrt.Renderer.layers`) and of the picture as "image".

    Args:
        source: as for `load`.
        spp: samples per pixel; without spp, time and noise, the scene's settings decide.
        time: seconds of rendering.
        noise: relative noise of the picture at which rendering ends, see `wrt.Renderer.noise`.
        adaptive: whether tiles that reach this noise stop before the others, see `wrt.Renderer.passes`.
        device: "cpu", "cuda" or "cuda:N".
        seed: 0 to 2³² − 1; different seeds give statistically independent pictures.
        threads: CPU threads; by default all cores.
        client: a Dask client, to render on its cluster (docs/clusters.md).
        progress: whether to show progress; by default a bar in terminals and notebooks, and nothing elsewhere. A
            function is called with the Progress after each pass.
        options: fields of `wrt.RenderSettings`, which override the scene's own, and options of `load`.

    Raises:
        InputError: if an argument cannot be used.
    """
    from wrt.progress.bar import ProgressBar
    from wrt.progress.terminal import bar_stream
    from wrt.rendering.renderer import Renderer

    settings, loading = split_settings(options)
    scene = load_with_settings(source, settings, **loading)
    where: dict[str, Any] = {"device": device, "seed": seed, "threads": threads}
    if client is None:
        renderer = Renderer(scene, **where)
    else:
        from wrt.distributed.head import DistributedRenderer

        renderer = DistributedRenderer(scene, client=client, **where)
    is_watched = progress is True or (progress is None and bar_stream() is not None)
    limits: dict[str, Any] = {"spp": spp, "time": time, "noise": noise, "adaptive": adaptive}
    name = Path(source).stem if isinstance(source, (str, os.PathLike)) else "picture"
    with ProgressBar(name, time_limit=time, is_shown=is_watched) as bar:
        called = progress if callable(progress) else bar.update
        longest = None if is_watched or callable(progress) else renderer.longest_pass
        image = renderer.render(**limits, progress=called, pass_seconds=longest)
    layers = renderer.layers()
    if not layers:
        return image
    return {"image": image, **layers} if renderer.has_picture else layers


def show(source: Any, **options: Any) -> None:
    """Show a picture: in the cell of a notebook, otherwise in the system's viewer.

    Args:
        source: a picture as `develop_image` takes it; anything else is rendered, see `render`.
        options: of `develop_image` for a picture, otherwise of `render`.

    Raises:
        InputError: if it cannot be used, or there is neither a notebook nor a viewer.
    """
    from PIL import Image, ImageShow

    from wrt.develop.picture import develop_image

    if not isinstance(source, np.ndarray):
        source, options = render(source, **options), {}
        if isinstance(source, dict):
            source = source["image"]
    picture = Image.fromarray(develop_image(source, **options))
    from wrt import _above

    if _above.viewer().display(picture):
        return
    screen = sys.platform != "linux" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if not screen or not ImageShow.show(picture, "wrt"):
        raise InputError("there is no viewer of pictures; wrt.save_image(path, picture) writes a file")
