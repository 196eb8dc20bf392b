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
    sidecars = Sidecars(path, images=False)
    with reading_with_trimesh(path, "dae"):
        try:
            document, notes = _rewritten(data)
            scene = trimesh.load_scene(io.BytesIO(document), file_type="dae", resolver=sidecars)
        except ImportError as error:
            raise InputError(f"{missing} ({first_line(error)})") from None
    sidecars.warn_of_changes()
    for note in notes:
        warn(f"{path}: {note}")
    if left_out := [f"{what}s" for what in ("camera", "light") if f"instance_{what}".encode() in data]:
        warn(f"{path}: {' and '.join(left_out)} of COLLADA files are left out")
    return read_object(scene, str(path))


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
    space = root.tag.rpartition("}")[0] + "}" if "}" in root.tag else ""
    for mesh in list(root.iter(f"{space}convex_mesh")):
        mesh.tag = f"{space}mesh"
    controllers = {each.get("id"): each for each in root.iter(f"{space}controller")}
    instances = list(root.iter(f"{space}instance_controller"))
    for instance in instances:
        _show_geometry(instance, controllers, space, etree)
    shown: Any = root.find(f".//{space}visual_scene[@id]")
    if root.find(f"{space}scene") is None and shown is not None:
        scene = etree.SubElement(root, f"{space}scene")
        etree.SubElement(scene, f"{space}instance_visual_scene", url=f"#{shown.get('id')}")
    notes = ["skins and morph targets are shown in their bind pose"] if instances else []
    if count := _replace_missing_images(root, space, etree):
        notes.append(f"textures that lead to no image are grey ({count})")
    if count := _remove_missing_materials(root, space):
        notes.append(f"uses of materials that are not there are left out ({count})")
    return bytes(etree.tostring(root)), notes


def _show_geometry(instance: Any, controllers: dict[str, Any], space: str, etree: Any) -> None:
    """Make an instance of a controller one of its geometry; a skin's stands where the skin binds it, in the world."""
    source, matrix = instance.get("url", "")[1:], None
    for _ in range(_MOST_CONTROLLERS):
        tags = f"{space}skin", f"{space}morph"
        found = next((each for each in controllers.get(source, ()) if each.tag in tags), None)
        if found is None:
            break
        if found.tag == tags[0]:
            matrix = found.findtext(f"{space}bind_shape_matrix", _IDENTITY)
        source = found.get("source", "")[1:]
    instance.tag, instance.attrib["url"] = f"{space}instance_geometry", f"#{source}"
    for skeleton in instance.findall(f"{space}skeleton"):
        instance.remove(skeleton)
    scene = next(instance.iterancestors(f"{space}visual_scene"), None)
    if matrix is not None and scene is not None:
        node = etree.SubElement(scene, f"{space}node")
        etree.SubElement(node, f"{space}matrix").text = matrix
        node.append(instance)


def _replace_missing_images(root: Any, space: str, etree: Any) -> int:
    """Make textures grey that lead to no image, and return their number."""
    images = {each.get("id") for each in root.iter(f"{space}image") if each.find(f"{space}init_from") is not None}
    count = 0
    for effect in root.iter(f"{space}effect"):
        surfaces, without_image = set(), set()
        for parameter in list(effect.iter(f"{space}newparam")):
            name = parameter.get("sid")
            image = parameter.findtext(f"{space}surface/{space}init_from")
            surface = parameter.findtext(f"{space}sampler2D/{space}source")
            if (image is not None and image not in images) or (surface is not None and surface not in surfaces):
                without_image.add(name)
                parameter.getparent().remove(parameter)
            elif image is not None:
                surfaces.add(name)
        for texture in [each for each in effect.iter(f"{space}texture") if each.get("texture") in without_image]:
            etree.SubElement(texture.getparent(), f"{space}color").text = _WITHOUT_IMAGE
            texture.getparent().remove(texture)
            count += 1
    return count


def _remove_missing_materials(root: Any, space: str) -> int:
    """Remove uses of materials that are missing or have no effect, and return their number."""
    effects = {f"#{each.get('id')}" for each in root.iter(f"{space}effect")}
    materials = set()
    for material in root.iter(f"{space}material"):
        effect = material.find(f"{space}instance_effect")
        if effect is not None and effect.get("url") in effects:
            materials.add(f"#{material.get('id')}")
    missing = [each for each in root.iter(f"{space}instance_material") if each.get("target") not in materials]
    for use in missing:
        use.getparent().remove(use)
    return len(missing)
