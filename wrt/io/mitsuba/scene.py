"""Load a scene file of Mitsuba 3."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from wrt.errors import InputError
from wrt.io import memory_limits
from wrt.io.mitsuba.cameras import camera_of, settings_of, warn_of_clipping
from wrt.io.mitsuba.document import Document
from wrt.io.mitsuba.lights import ON_SHAPES, emitters_of
from wrt.io.mitsuba.media import Media
from wrt.io.mitsuba.plugin import Plugin, first_of, plugin_of
from wrt.io.mitsuba.shapes import Shapes
from wrt.io.mitsuba.surfaces import Detail
from wrt.io.mitsuba.textures import Textures
from wrt.io.safe_read import PathLike
from wrt.scene.scene import Scene


@memory_limits.one_load()
def load_mitsuba(path: PathLike, *, parameters: Mapping[str, Any] | None = None, sensor: int | None = None) -> Scene:
    """Read a scene file of Mitsuba 3, in XML.

    Each unsupported feature causes an InputWarning, and the rest is read; docs/mitsuba.md lists what is supported.

    Args:
        path: the file.
        parameters: values of `$name`, which override the defaults in the file.
        sensor: which sensor is the camera, counted from 0; by default the first, with a warning if there are more.

    Raises:
        InputError: naming file and line, when a value in it cannot be used.
    """
    document = Document(Path(path), parameters or {})
    objects: dict[str, list[Plugin]] = {kind: [] for kind in ("shape", "emitter", "sensor", "integrator")}
    for each in _objects(document):
        objects.setdefault(each.kind, []).append(each)
    integrator = first_of("integrator", objects["integrator"])
    camera_plugin = _sensor(document, objects["sensor"], sensor)
    settings = settings_of(camera_plugin, integrator)
    camera = None if camera_plugin is None else camera_of(camera_plugin, settings)

    textures = Textures()
    media = Media(textures)
    lights, environment = emitters_of(objects["emitter"], textures)
    shapes = Shapes(textures, media, Detail(camera, settings.height))
    made = shapes.all_of(objects["shape"])
    if not made:
        raise InputError(f"{path}: it has no supported shapes; there is nothing to render")
    scene = Scene(made, [*lights, *shapes.lights], environment, camera, settings)
    scene.medium = media.around(camera_plugin, scene)
    if settings.transparent and integrator is not None and any(shape.emits for shape in made):
        integrator.warn("'hide_emitters' hides environments and bare lights; surfaces that emit stay visible")
    if camera_plugin is not None:
        warn_of_clipping(camera_plugin, scene)
    for plugin in document.plugins.values():
        plugin.finish()
    return scene


def _sensor(document: Document, sensors: list[Plugin], index: int | None) -> Plugin | None:
    """Return the sensor of a number, or the first."""
    if index is None:
        if len(sensors) > 1:
            sensors[1].warn(f"the first of {len(sensors)} sensors is the camera; choose another by its number, from 0")
        return sensors[0] if sensors else None
    if not 0 <= index < len(sensors):
        numbers = f"its sensors are numbered from 0 to {len(sensors) - 1}" if sensors else "it has none"
        raise InputError(f"{document.path}: there is no sensor {index}; {numbers}")
    return sensors[index]


def _objects(document: Document) -> list[Plugin]:
    """Return the top-level objects of the scene, except objects that only references use."""
    objects = []
    for element in document.root.children:
        inner = document.find(element) if element.tag == "ref" else element
        if inner.tag in ("texture", "bsdf", "medium", "rgb", "spectrum", "float", "string", "phase", "volume"):
            continue
        if inner.tag not in ("shape", "emitter", "sensor", "integrator", "film", "sampler"):
            document.warn(inner, f"<{inner.label}> is not known here; left out")
            continue
        objects.append(plugin_of(inner, document))
    # Emitters of shapes may stand at the top for references to them.
    return [each for each in objects if not (each.type in ON_SHAPES and each.element in document.referenced)]
