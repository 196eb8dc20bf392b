"""COLLADA, read by trimesh with a library of an extra, from documents rewritten so that they find all geometry.

Format: Khronos Group 2008, "COLLADA: Digital Asset Schema Release 1.4.1". The library passes over geometry by
controllers, which are skins and morph targets, over convex meshes, over all of a document that chooses no scene, and
over geometry whose material refers to something that is missing.
"""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from wrt.errors import InputError, warn
from wrt.io.account import warn_of_unused
from wrt.io.mesh.parts import Contents
from wrt.io.mesh.sidecars import Sidecars
from wrt.io.mesh.trimesh_loaders import reading_with_trimesh
from wrt.io.safe_read import as_text, first_line, read_file

_BEGINNING = 1 << 16
"""Bytes at the start of a file that hold its description."""

_UP = re.compile(r"<(?:\w+:)?up_axis>\s*([XYZ])_UP\s*<")

_MOST_CONTROLLERS = 8
"""Controllers that are followed to a geometry: a skin may move a morphed mesh."""

_READ = {
    *("COLLADA", "asset", "unit", "up_axis", "scene", "instance_visual_scene", "library_visual_scenes"),
    *("visual_scene", "library_nodes", "node", "matrix", "translate", "rotate", "scale", "lookat"),
    *("instance_node", "instance_geometry", "bind_material", "technique_common", "instance_material"),
    *("library_materials", "material", "instance_effect", "library_effects", "effect", "profile_COMMON"),
    *("technique", "constant", "lambert", "phong", "blinn", "diffuse", "emission", "shininess"),
    *("transparent", "color", "float", "texture", "newparam", "surface", "sampler2D", "source"),
    *("init_from", "library_images", "image", "library_geometries", "geometry", "mesh", "vertices"),
    *("input", "polylist", "polygons", "triangles", "p", "ph", "h", "vcount", "float_array", "accessor"),
    "param",
}
"""Elements that trimesh and its library read."""

_ATTRIBUTES = {
    *("id", "name", "sid", "url", "target", "symbol", "semantic", "source", "offset", "set", "count"),
    *("stride", "type", "material", "texture", "texcoord", "meter", "version", "digits", "magnitude"),
    "layer",
}
"""Attributes of these that are read, or that name something."""

_SEMANTICS = ("VERTEX", "POSITION", "NORMAL", "COLOR", "TEXCOORD")

_NEUTRAL = {"specular": 0.0, "reflective": 0.0, "reflectivity": 0.0, "transparency": 1.0}
"""Values at which an element has no effect."""

_NEUTRAL_WORDS = {"magfilter": ("LINEAR", "NONE"), "wrap_s": ("WRAP",), "wrap_t": ("WRAP",)}
"""The same of elements with a word."""

WITHOUT_EFFECT = {
    "accessor.*": "the library finds the values by their count and stride",
    "ambient": "light from everywhere, which paths compute",
    "animation*": "files are read at rest",
    "asset.*": "about the file",
    "bind_vertex_input": "which set of coordinates a texture has; a mesh with several is named",
    "contributor": "about the file",
    "created": "about the file",
    "extra": "what a program keeps for itself, apart from bump maps, which are read",
    "format": "images tell their type",
    "keywords": "about the file",
    "library_animation*": "files are read at rest",
    "library_cameras": "cameras, which are named where they stand",
    "library_controllers": "skins and morph targets, which are named where they stand",
    "library_lights": "lights, which are named where they stand",
    "library_physics*": "how bodies move",
    "library_force_fields": "how bodies move",
    "instance_physics_scene": "how bodies move",
    "index_of_refraction": "of light that passes surfaces, which is left out where they are transparent",
    "minfilter": "textures are filtered by what a pixel covers",
    "mipfilter": "textures are filtered by what a pixel covers",
    "evaluate_scene": "how other renderers make a picture",
    "*.base": "where references start",
    "*.schemaLocation": "where the schema is",
    "modified": "about the file",
    "revision": "about the file",
    "subject": "about the file",
    "title": "about the file",
}
"""Elements and attributes that do not change a picture, and why."""

_IDENTITY = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"
_WITHOUT_IMAGE = "0.8 0.8 0.8 1"


def read_collada(path: Path, data: bytes) -> Contents:
    """Return the content of a file as trimesh's objects hold it: meshes with materials, where they are.

    Raises:
        InputError: where the extra is not installed, or the file cannot be read.
    """
    import trimesh
    from trimesh.exchange.load import mesh_loaders

    from wrt.io.trimesh_objects import read_object

    missing = f"{path}: .dae files need further libraries: pip install 'wrt[formats]'"
    if "dae" not in mesh_loaders:
        raise InputError(missing)
    files = _NamedFiles(path)
    with reading_with_trimesh(path, "dae"):
        try:
            document, notes = _rewritten(data)
            scene = trimesh.load_scene(io.BytesIO(document), file_type="dae", resolver=files)
        except ImportError as error:
            raise InputError(f"{missing} ({first_line(error)})") from None
    for message in dict.fromkeys([*files.messages, *(f"{path}: {note}" for note in notes)]):
        warn(message)
    warn_of_unused(path, _unused(_root_of(document)), WITHOUT_EFFECT)
    return read_object(scene, str(path))


class _NamedFiles(Sidecars):
    """A resolver for trimesh, which hides warnings and errors.

    Attributes:
        messages: what to warn of.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.messages: list[str] = []

    def get(self, name: str) -> bytes:
        try:
            file, note = self.located(name)
        except InputError as error:
            self.messages.append(f"{error}; it is left out")
            raise
        self.messages += [note] if note else []
        return read_file(file)

    __getitem__ = get


def declared_up(path: Path) -> str | None:
    """Return the axis that a file says points up: x, y or z; None if it does not say."""
    with contextlib.suppress(InputError):
        found = _UP.search(as_text(read_file(path, _BEGINNING)))
        return found[1].lower() if found else None
    return None


def _root_of(data: bytes) -> Any:
    """Return the root element of a document."""
    from lxml import etree

    return etree.fromstring(data, etree.XMLParser(resolve_entities=False, no_network=True))


def _unused(element: Any) -> Iterator[str]:
    """Yield the kinds of elements and attributes that are not read, from an element on; of a whole its name alone."""
    name = _local(element.tag)
    if name not in _READ:
        neutral = (
            _has_all(element, _NEUTRAL[name]) if name in _NEUTRAL else element.text in _NEUTRAL_WORDS.get(name, ())
        )
        if not neutral:
            yield name
        return
    semantics = [each.get("semantic") for each in element.iterchildren("{*}input")]
    yield from (f"an input {kind}" for kind in semantics if kind not in _SEMANTICS)
    yield from (f"another set of {kind}" for kind in ("COLOR", "TEXCOORD") if semantics.count(kind) > 1)
    for key in element.attrib:
        is_opaque = element.get(key) == "A_ONE" or (element.get(key) == "RGB_ZERO" and _has_all(element, 0.0))
        if _local(key) not in _ATTRIBUTES and not (name == "transparent" and key == "opaque" and is_opaque):
            yield f"{name}.{_local(key)}"
    for child in element.iterchildren(tag="{*}*"):
        if (name, _local(child.tag)) == ("emission", "texture"):
            yield "a texture of emission"
        else:
            yield from _unused(child)


def _has_all(element: Any, value: float) -> bool:
    """Return whether the number of an element, or each channel of its colour, is a value."""
    numbers = "".join(element.itertext()).split()[:3]  # without alpha
    with contextlib.suppress(ValueError):
        return bool(numbers) and all(float(each) == value for each in numbers)
    return False


def _local(tag: str) -> str:
    return tag.rpartition("}")[2]


def _rewritten(data: bytes) -> tuple[bytes, list[str]]:
    """Return a document whose geometry is all found, each controller's in its bind pose, and notes on what changed."""
    from lxml import etree

    root = _root_of(data)
    for mesh in list(root.iter("{*}convex_mesh")):
        mesh.tag = mesh.tag.replace("convex_mesh", "mesh")
    controllers = {each.get("id"): each for each in root.iter("{*}controller")}
    instances = list(root.iter("{*}instance_controller"))
    for instance in instances:
        _show_geometry(instance, controllers)
    shown: Any = root.find(".//{*}visual_scene[@id]")
    if root.find("{*}scene") is None and shown is not None:
        _add(_add(root, "scene"), "instance_visual_scene").set("url", f"#{shown.get('id')}")
    notes = ["skins and morph targets are shown in their bind pose"] if instances else []
    if count := _replace_missing_images(root):
        notes.append(f"textures that lead to no image are grey ({count})")
    if count := _remove_missing_materials(root):
        notes.append(f"uses of materials that are not there are left out ({count})")
    return bytes(etree.tostring(root)), notes


def _add(parent: Any, name: str, text: str | None = None) -> Any:
    """Return a new last child of an element, in its namespace."""
    space, brace, _ = parent.tag.rpartition("}")
    child = parent.makeelement(space + brace + name)
    child.text = text
    parent.append(child)
    return child


def _show_geometry(instance: Any, controllers: dict[str, Any]) -> None:
    """Make an instance of a controller one of its geometry; a skin's stands where the skin binds it, in the world."""
    source, matrix = instance.get("url", "")[1:], None
    for _ in range(_MOST_CONTROLLERS):
        controller = controllers.get(source)
        if controller is None or (deformer := next(controller.iterchildren("{*}skin", "{*}morph"), None)) is None:
            break
        if deformer.tag.endswith("skin"):
            matrix = deformer.findtext("{*}bind_shape_matrix", _IDENTITY)
        source = deformer.get("source", "")[1:]
    instance.tag = instance.tag.replace("instance_controller", "instance_geometry")
    instance.set("url", f"#{source}")
    for skeleton in instance.findall("{*}skeleton"):
        instance.remove(skeleton)
    scene = next(instance.iterancestors("{*}visual_scene"), None)
    if matrix is not None and scene is not None:
        node = _add(scene, "node")
        _add(node, "matrix", matrix)
        node.append(instance)


def _replace_missing_images(root: Any) -> int:
    """Make textures grey that lead to no image, and return their number."""
    images = {each.get("id") for each in root.iter("{*}image") if each.find("{*}init_from") is not None}
    count = 0
    for effect in root.iter("{*}effect"):
        surfaces, without_image = set(), set()
        for parameter in list(effect.iter("{*}newparam")):
            name = parameter.get("sid")
            image = parameter.findtext("{*}surface/{*}init_from")
            surface = parameter.findtext("{*}sampler2D/{*}source")
            if (image is not None and image not in images) or (surface is not None and surface not in surfaces):
                without_image.add(name)
                parameter.getparent().remove(parameter)
            elif image is not None:
                surfaces.add(name)
        for texture in [each for each in effect.iter("{*}texture") if each.get("texture") in without_image]:
            _add(texture.getparent(), "color", _WITHOUT_IMAGE)
            texture.getparent().remove(texture)
            count += 1
    return count


def _remove_missing_materials(root: Any) -> int:
    """Remove uses of materials that are missing or have no effect, and return their number."""
    effects = {f"#{each.get('id')}" for each in root.iter("{*}effect")}
    materials = set()
    for material in root.iter("{*}material"):
        effect = material.find("{*}instance_effect")
        if effect is not None and effect.get("url") in effects:
            materials.add(f"#{material.get('id')}")
    missing = [each for each in root.iter("{*}instance_material") if each.get("target") not in materials]
    for use in missing:
        use.getparent().remove(use)
    return len(missing)
