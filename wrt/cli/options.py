"""The options of `wrt render` and `wrt compile`, as the rest of the command line sees them."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

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
        device: name of the device, or of several GPUs.
        threads: CPU threads, or None for all cores.
        seed: the random seed.
        dask: address of a Dask scheduler, or None.
        turntable: number of frames, or None.
        frames: first and last frame, or None.
        fps: frames per second.
        part: number of a part, from 1, and number of parts; or None.
        output: the -o option: a picture, a folder, a video, frames or a part; or None.
        checkpoint: the file of the checkpoint, or None.
        resume: whether to continue from an earlier run.
        save_every: seconds between saves, or None for the default.
        force: whether `output` may be a file that wrt did not write.
        quiet: whether to print only errors and warnings.
        json: whether to print a summary as JSON.
        own_process: whether the process belongs to the command line.
    """

    inputs: tuple[str, ...]
    loading: Mapping[str, Any]
    settings: Mapping[str, Any]
    limits: Mapping[str, Any]
    own_process: bool
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
    def from_arguments(cls, arguments: Mapping[str, Any], *, own_process: bool) -> RenderOptions:
        """Sort the arguments of a command line, by name, into options."""
        from wrt.api import load, split_settings

        values = dict(arguments)
        limits = {name: values.pop(name, None) for name in LIMITS}
        width, height = values.pop("size") or (None, None)
        values |= {"width": width, "height": height, "denoise": values["denoise"] or None}
        settings, values = split_settings(values)
        loading = {name: values.pop(name) for name in inspect.signature(load).parameters if name in values}
        loading["parameters"] = dict(loading["parameters"] or ())
        inputs = tuple(values.pop("inputs"))
        return cls(inputs, loading, settings, limits, own_process=own_process, **values)
