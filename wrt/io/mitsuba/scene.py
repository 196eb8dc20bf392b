"""Load a scene file of Mitsuba 3."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from wrt.errors import InputError
from wrt.io import memory_limits
from wrt.io.mitsuba.cameras import camera_of, settings_of, warn_of_clipping
from wrt.io.mitsuba.document import Document
from wrt.io.mitsuba.lights import ON_SHAPES, Emitters
from wrt.io.mitsuba.materials.readers import Materials
from wrt.io.mitsuba.materials.textures import Textures
from wrt.io.mitsuba.media import medium_of, surrounding
from wrt.io.mitsuba.plugin import Plugin, plugin_of
from wrt.io.mitsuba.shapes import Shapes
from wrt.io.mitsuba.surfaces import Detail
from wrt.io.safe_read import PathLike
from wrt.scene.medium import Medium
from wrt.scene.scene import Scene


@memory_limits.one_load()
def load_mitsuba(path: PathLike, *, parameters: Mapping[str, Any] | None = None, sensor: int | None = None) -> Scene:
    """Read a scene file of Mitsuba 3, in XML.

    Each unsupported feature causes an InputWarning, and the rest is read; docs/mitsuba.md lists what is supported.

    Args:
        path: the file.
        parameters: values of `$name`, which override the defaults in the file.
        sensor: which sensor is the camera, counted from 0; None is the first, with a warning if there are others.

    Raises:
        InputError: naming file and line, when a value in it cannot be used.
    """
    document = Document(Path(path), parameters or {})
    objects = _objects(document)
    kinds: dict[str, list[Plugin]] = {}
    for each in objects:
        kinds.setdefault(each.kind, []).append(each)
    for other in kinds.get("integrator", [])[1:]:
        other.warn("there is more than one integrator; left out")
    integrator = next(iter(kinds.get("integrator", [])), None)
    seen_by = _sensor(document, kinds.get("sensor", []), sensor)
    settings = settings_of(seen_by, integrator)
    camera = None if seen_by is None else camera_of(seen_by, settings)

    textures = Textures()
    detail = Detail(camera, settings.height)
    shapes = Shapes(Materials(textures), textures, detail)
    emitters = Emitters(textures)
    for emitter in kinds.get("emitter", []):
        emitters.add(emitter)
    made = [made for shape in kinds.get("shape", []) for made in shapes.shapes(shape)]
    if not made and shapes.lights:  # a scene needs a shape that rays can hit
        shapes = Shapes(Materials(textures), textures, detail, exact_lights=False)
        made = [made for shape in kinds["shape"] for made in shapes.shapes(shape)]
    scene = Scene(made, [*emitters.lights, *shapes.lights], emitters.environment, camera, settings)
    scene.medium = _around(seen_by, textures, shapes, scene)
    if settings.transparent and integrator is not None and any(shape.emits for shape in made):
        integrator.warn("'hide_emitters' hides environments and bare lights; surfaces that emit stay visible")
    if seen_by is not None:
        warn_of_clipping(seen_by, scene)
    if not scene.shapes:
        raise InputError(f"{path}: it has no supported shapes; there is nothing to render")
    return scene


def _sensor(document: Document, sensors: list[Plugin], index: int | None) -> Plugin | None:
    """Return the sensor of a number, or the first."""
    if index is None:
        if len(sensors) > 1:
            sensors[1].warn(f"the first of {len(sensors)} sensors is the camera; choose another by its number, from 0")
        return sensors[0] if sensors else None
    if not 0 <= index < len(sensors):
        there = f"its sensors are numbered from 0 to {len(sensors) - 1}" if sensors else "it has none"
        raise InputError(f"{document.path}: there is no sensor {index}; {there}")
    return sensors[index]


def _around(sensor: Plugin | None, textures: Textures, shapes: Shapes, scene: Scene) -> Medium | None:
    """Return the medium outside all shapes."""
    own = None if sensor is None else sensor.only("medium")
    seen_from = None if own is None else medium_of(own, textures)
    if own is not None and seen_from is None:
        return None  # a kind of medium that is not supported
    return surrounding(scene, seen_from, shapes.exteriors, shapes.interiors)


def _objects(document: Document) -> list[Plugin]:
    """Return the top-level objects of the scene, without those that only references use."""
    found = []
    for element in document.root.children:
        inner = document.find(element) if element.tag == "ref" else element
        if inner.tag in ("texture", "bsdf", "medium", "rgb", "spectrum", "float", "string", "phase", "volume"):
            continue
        if inner.tag not in ("shape", "emitter", "sensor", "integrator", "film", "sampler"):
            document.warn(inner, f"<{inner.label}> is not known here; left out")
            continue
        found.append(plugin_of(inner, document))
    # Emitters of shapes may stand at the top for references to them.
    return [each for each in found if not (each.type in ON_SHAPES and each.element in document.referenced)]
