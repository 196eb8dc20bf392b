"""COLLADA, read by trimesh with a library of an extra, from documents rewritten so that they find all geometry.

Format: Khronos Group 2008, "COLLADA: Digital Asset Schema Release 1.4.1". The library passes over geometry by
controllers, which are skins and morph targets, over convex meshes, over all of a document that chooses no scene, and
over geometry whose material refers to something that is missing.
"""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path
from typing import Any

from wrt.errors import InputError, warn
from wrt.io.mesh.parts import Contents
from wrt.io.mesh.sidecars import Sidecars
from wrt.io.mesh.trimesh_loaders import reading_with_trimesh
from wrt.io.safe_read import as_text, first_line, read_file

_BEGINNING = 1 << 16
"""Bytes at the start of a file that hold its description."""

_UP = re.compile(r"<(?:\w+:)?up_axis>\s*([XYZ])_UP\s*<")

_MOST_CONTROLLERS = 8
"""Controllers that are followed to a geometry: a skin may move a morphed mesh."""

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
    if left_out := [f"{kind}s" for kind in ("camera", "light") if f"instance_{kind}".encode() in data]:
        warn(f"{path}: {' and '.join(left_out)} of COLLADA files are left out")
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


def _rewritten(data: bytes) -> tuple[bytes, list[str]]:
    """Return a document whose geometry is all found, each controller's in its bind pose, and notes on what changed."""
    from lxml import etree

    root: Any = etree.fromstring(data, etree.XMLParser(resolve_entities=False, no_network=True))
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
