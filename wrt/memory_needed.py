"""`device_memory`: the memory that a picture will take on a device."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from wrt.api import load
from wrt.backend import current_backend
from wrt.rendering.catchers import any_catchers, without_others
from wrt.rendering.film import BYTES_PER_PIXEL
from wrt.rendering.film_aovs import bytes_per_pixel
from wrt.rendering.guides import LAYERS as GUIDES
from wrt.rendering.reading import window_of
from wrt.scene.layers import CATCHER
from wrt.studio.framing import with_camera
from wrt.upload.memory import SceneMemory
from wrt.upload.prepare import PreparedScene

_PARTS = ("geometry", "trees", "materials", "lights", "film", "layers")


@dataclass(frozen=True)
class DeviceMemory:
    """Bytes that a picture takes on a device, by part; see `device_memory`.

    Attributes:
        geometry: vertices and triangles.
        trees: the ray trees.
        materials: materials, images, normal maps, the environment and grids of media.
        lights: the table of lights and the tree over them.
        film: sums of samples for each pixel, also those of guides for denoising and of shadow catchers.
        layers: layers besides radiance.
        kept: all of these, for as long as the renderer lives.
        peak: the most at once, while trees are built.
        peak_if_cut: the same if the builder has to cut large triangles.
        editing: more that images take from the first `set_parameters`, or gradients by pixels, on.
        gradients: more that `Renderer.gradients` takes while it runs.
    """

    geometry: int
    trees: int
    materials: int
    lights: int
    film: int
    layers: int
    kept: int
    peak: int
    peak_if_cut: int
    editing: int
    gradients: int


def device_memory(
    source: Any,
    *,
    width: int | None = None,
    height: int | None = None,
    device: str = "cuda",
    layers: Sequence[str] | None = None,
    denoise: bool | None = None,
) -> DeviceMemory:
    """Return the memory that a picture will take on a device, before anything is built or taken there.

    The peak is right within 5 %; a driver takes some hundred megabytes more for itself and for the stacks of kernels.
    A `wrt.Renderer` compares the peak with what is free, before it builds.

    Args:
        source: as for `wrt.load`, or a scene.
        width: pixels; by default the scene's own setting, as for height, layers and denoise.
        height: pixels.
        device: "cpu", or "cuda" for any GPU, present or not. On the CPU geometry may be shared with the scene.
        layers: names of layers besides radiance.
        denoise: whether the picture will be denoised.

    Raises:
        InputError: see `wrt.load` and `wrt.Renderer`.
    """
    scene = load(source)
    settings = scene.settings.changed(width=width, height=height, layers=layers, denoise=denoise)
    scene = with_camera(scene, settings.width / settings.height)
    scenes, films = [scene], [settings.film_layers]
    if any_catchers(scene) and settings.integrator != "aov" and not settings.wireframe:
        scenes.append(without_others(scene))
        seen = settings.changed(transparent=True)
        films = [(*each.film_layers, CATCHER) for each in (seen, dataclasses.replace(seen, layers=()))]
    coordinates = "uv" in settings.layers
    of_scenes = [
        SceneMemory(PreparedScene(each), is_cpu=device == "cpu", texture_coordinates=coordinates) for each in scenes
    ]
    x0, y0, x1, y1 = window_of(settings)
    pixels, of_layers = (x1 - x0) * (y1 - y0), [bytes_per_pixel(film, scene.light_groups) for film in films]
    film = pixels * BYTES_PER_PIXEL * len(films) * (1 + settings.denoise)
    of_layers_and_guides = pixels * (sum(of_layers) + len(films) * settings.denoise * bytes_per_pixel(GUIDES))
    kept = sum(each.lasting for each in of_scenes) + film + of_layers_and_guides
    # The film comes before the scene, that of guides after it.
    first, last = of_scenes[0], of_scenes[-1]
    building = pixels * (BYTES_PER_PIXEL + of_layers[0]) + first.lasting
    finishing = kept if last is first else kept + last.scratch
    return DeviceMemory(
        sum(each.geometry for each in of_scenes),
        sum(each.trees for each in of_scenes),
        sum(each.materials for each in of_scenes),
        sum(each.lights for each in of_scenes),
        film,
        of_layers_and_guides,
        kept,
        peak=max(finishing, building + first.scratch),
        peak_if_cut=max(finishing, building + first.scratch_if_cut),
        editing=sum(each.editing for each in of_scenes),
        gradients=first.gradients + 12 * pixels,
    )


def memory_text(memory: DeviceMemory, width: int, height: int) -> str:
    """Return lines about what a picture of width x height pixels takes on a GPU, and which GPU here has that."""
    parts = [(name, _size(getattr(memory, name))) for name in _PARTS if getattr(memory, name)]
    peak = f"{_size(memory.peak)} while the ray tree is built"
    if memory.peak_if_cut > memory.peak:
        peak += f"; {_size(memory.peak_if_cut)} if it cuts large triangles"
    rows = [*parts, ("in all", _size(memory.kept)), ("at most", peak)]
    backend = current_backend()
    for name in (f"cuda:{number}" for number in range(backend.gpus())):
        free = backend.memory_of(name)
        fits = memory.peak <= free
        rows.append((name, f"{_size(free)} free: {'enough' if fits else 'not enough'}"))
    return "\n".join([f"memory of a picture of {width}x{height} on a GPU", *(f"  {a:<9} {b}" for a, b in rows)])


def _size(number: int) -> str:
    return f"{number / 1e9:.2f} GB" if number >= 1e9 else f"{number / 1e6:.1f} MB"
