"""Load a scene file of Mitsuba 3."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from wrt.errors import InputError
from wrt.io import memory_limits
from wrt.io.cameras import note_several, number_of, unique
from wrt.io.mitsuba.cameras import SENSORS, camera_of, settings_of, warn_of_clipping
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
def load_mitsuba(
    path: PathLike, *, parameters: Mapping[str, Any] | None = None, camera: int | str | None = None
) -> Scene:
    """Read a scene file of Mitsuba 3, in XML.

    Each unsupported feature causes an InputWarning, and the rest is read; docs/mitsuba.md lists what is supported.

    Args:
        path: the file.
        parameters: values of `$name`, which override the defaults in the file.
        camera: the id or the number of the sensor that is the camera, counted from 0; by default the first, with a
            warning if there are more.

    Raises:
        InputError: naming file and line, when a value in it cannot be used.
    """
    document = Document(Path(path), parameters or {})
    objects: dict[str, list[Plugin]] = {kind: [] for kind in ("shape", "emitter", "sensor", "integrator")}
    for each in _objects(document):
        objects.setdefault(each.kind, []).append(each)
    integrator = first_of("integrator", objects["integrator"])
    sensors = _sensors(objects["sensor"])
    camera_plugin = _chosen(document, sensors, camera)
    settings = settings_of(camera_plugin, integrator)
    taken = None if camera_plugin is None else camera_of(camera_plugin, settings)

    textures = Textures()
    media = Media(textures)
    lights, environment = emitters_of(objects["emitter"], textures)
    shapes = Shapes(textures, media, Detail(taken, settings.height))
    made = shapes.all_of(objects["shape"])
    if not made:
        raise InputError(f"{path}: it has no supported shapes; there is nothing to render")
    scene = Scene(made, [*lights, *shapes.lights], environment, taken, settings)
    scene.medium = media.around(camera_plugin, scene)
    if settings.transparent and integrator is not None and any(shape.emits for shape in made):
        integrator.warn("'hide_emitters' hides environments and bare lights; surfaces that emit stay visible")
    if camera_plugin is not None:
        warn_of_clipping(camera_plugin, scene)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the other cameras were not asked for
        for name, plugin in sensors.items():
            other = taken if plugin is camera_plugin else camera_of(plugin, settings_of(plugin, integrator))
            scene.cameras |= {} if other is None else {name: other}
    for plugin in document.plugins.values():
        plugin.finish()
    return scene


def _sensors(plugins: list[Plugin]) -> dict[str, Plugin]:
    """Return sensors by id: the cameras, or all if there are none."""
    cameras = [each for each in plugins if each.type in SENSORS] or plugins
    for each in plugins:
        if each not in cameras:
            each.warn_of_all("this kind of sensor is not known; left out")
    return dict(zip(unique(each.element.attributes.get("id", "") for each in cameras), cameras, strict=True))


def _chosen(document: Document, sensors: dict[str, Plugin], choice: int | str | None) -> Plugin | None:
    """Return the sensor of an id or a number, or the first."""
    names = list(sensors)
    if choice is not None:
        return sensors[names[number_of(document.path, names, choice)]]
    note_several(document.path, names)
    return next(iter(sensors.values()), None)


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
