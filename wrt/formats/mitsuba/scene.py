"""A scene file of Mitsuba 3 as a scene."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from wrt.errors import InputError
from wrt.files import PathLike
from wrt.formats import growth
from wrt.formats.mitsuba.cameras import camera_of, settings_of, warn_of_clipping
from wrt.formats.mitsuba.document import Document
from wrt.formats.mitsuba.lights import Emitters
from wrt.formats.mitsuba.materials import Materials
from wrt.formats.mitsuba.media import medium_of, surrounding
from wrt.formats.mitsuba.plugin import Plugin, plugin_of
from wrt.formats.mitsuba.shapes import Shapes
from wrt.formats.mitsuba.surfaces import Detail
from wrt.formats.mitsuba.textures import Textures
from wrt.medium import Medium
from wrt.scene import Scene


@growth.one_load()
def load_mitsuba(path: PathLike, *, parameters: Mapping[str, Any] | None = None) -> Scene:
    """Read a scene file of Mitsuba 3, in XML.

    What wrt has not is told in an InputWarning each, and the rest is read; docs/mitsuba.md says what that is.

    Args:
        path: the file.
        parameters: what `$name` stands for in it, in place of its own defaults.

    Raises:
        InputError: naming file and line, where something in it cannot be used.
    """
    document = Document(Path(path), parameters or {})
    objects = _objects(document)
    kinds: dict[str, list[Plugin]] = {}
    for each in objects:
        kinds.setdefault(each.kind, []).append(each)
    for other in [*kinds.get("sensor", [])[1:], *kinds.get("integrator", [])[1:]]:
        other.warn("there is one before it; left out")
    sensor, integrator = (next(iter(kinds.get(kind, [])), None) for kind in ("sensor", "integrator"))
    settings = settings_of(sensor, integrator)
    camera = None if sensor is None else camera_of(sensor, settings)

    textures = Textures()
    detail = Detail(camera, settings.height)
    shapes = Shapes(Materials(textures), textures, detail)
    emitters = Emitters(textures)
    for emitter in kinds.get("emitter", []):
        emitters.add(emitter)
    made = [made for shape in kinds.get("shape", []) for made in shapes.shapes(shape)]
    if not made and shapes.lights:  # a picture must have something that can be hit
        shapes = Shapes(Materials(textures), textures, detail, exact_lights=False)
        made = [made for shape in kinds["shape"] for made in shapes.shapes(shape)]
    scene = Scene(made, [*emitters.lights, *shapes.lights], emitters.environment, camera, settings)
    scene.medium = _around(sensor, textures, shapes, scene)
    if sensor is not None:
        warn_of_clipping(sensor, scene)
    if not scene.shapes:
        raise InputError(f"{path}: no shapes in it that are known; there is nothing to render")
    return scene


def _around(sensor: Plugin | None, textures: Textures, shapes: Shapes, scene: Scene) -> Medium | None:
    """Return the medium that fills the space outside of all bodies."""
    own = None if sensor is None else sensor.only("medium")
    seen_from = None if own is None else medium_of(own, textures)
    if own is not None and seen_from is None:
        return None  # a kind of medium that is not supported
    return surrounding(scene, seen_from, shapes.exteriors, shapes.interiors)


def _objects(document: Document) -> list[Plugin]:
    """Return the scene's own objects; what only has an id is made where it is referred to."""
    found = []
    for element in document.root.children:
        inner = document.find(element) if element.tag == "ref" else element
        if inner.tag in ("texture", "bsdf", "medium", "rgb", "spectrum", "float", "string", "phase", "volume"):
            continue
        if inner.tag not in ("shape", "emitter", "sensor", "integrator", "film", "sampler"):
            document.warn(inner, f"<{inner.label}> is not known here; left out")
            continue
        found.append(plugin_of(inner, document))
    return found
