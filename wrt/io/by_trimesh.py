"""COLLADA files, which trimesh reads with a library of an extra.

Format: Khronos Group 2008, "COLLADA: Digital Asset Schema Release 1.4.1". What it holds and trimesh passes over is
put in other words first: controllers, which are skins and morph targets, and a missing choice of the scene.
"""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path
from typing import Any

from wrt.errors import InputError, warn
from wrt.io.encodings import as_text
from wrt.io.mesh.parts import Contents
from wrt.io.mesh.trimesh_loaders import Beside, quiet
from wrt.io.safe_read import first_line, read_file

_BEGINNING = 1 << 16
"""Bytes at the start of a file that hold its description."""

_UP = re.compile(r"<(?:\w+:)?up_axis>\s*([XYZ])_UP\s*<")
_MOST_CONTROLLERS = 8
"""Controllers that are followed to a geometry: a skin may move a morphed mesh."""

_NO_TURN = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"


def read_by_trimesh(path: Path, data: bytes) -> Contents:
    """Return the content of a file as trimesh's objects hold it: meshes with materials, where they are.

    Raises:
        InputError: where the extra is not installed, or the file cannot be read.
    """
    import trimesh
    from trimesh.exchange.load import mesh_loaders

    from wrt.io.trimesh_objects import read_object

    kind = path.suffix.lower().removeprefix(".")
    if kind not in mesh_loaders:
        raise InputError(f"{path}: .{kind} files need further libraries: pip install 'wrt[formats]'")
    beside = Beside(path, images=False)
    with quiet():
        try:
            held, controllers = _without_controllers(data)
            scene = trimesh.load_scene(io.BytesIO(held), file_type=kind, resolver=beside)
        except ImportError as error:
            reason = f"{path}: .{kind} files need further libraries: pip install 'wrt[formats]' ({first_line(error)})"
            raise InputError(reason) from None
        except Exception as error:  # noqa: BLE001 - loaders raise undocumented exceptions on damaged files
            reason = first_line(error)
            raise InputError(f"{path}: not a whole {kind.upper()} file that can be read: {reason}") from None
    beside.tell()
    if controllers:
        warn(f"{path}: skins and morph targets are shown in their bind pose")
    if lost := [what for what in ("camera", "light") if f"instance_{what}".encode() in data]:
        warn(f"{path}: {' and '.join(f'{what}s' for what in lost)} of COLLADA files are left out")
    return read_object(scene, str(path))


def declared_up(path: Path) -> str | None:
    """Return the axis that a file says points up: x, y or z; None if it says nothing."""
    with contextlib.suppress(InputError):
        found = _UP.search(as_text(read_file(path, _BEGINNING)))
        return found[1].lower() if found else None
    return None


def _without_controllers(data: bytes) -> tuple[bytes, int]:
    """Return a document with plain geometry for each controller, in its bind pose, and a scene; and their number."""
    if b"instance_controller" not in data and b"instance_visual_scene" in data:
        return data, 0
    from lxml import etree

    root: Any = etree.fromstring(data, etree.XMLParser(resolve_entities=False, no_network=True))
    space = root.tag.rpartition("}")[0] + "}" if "}" in root.tag else ""
    controllers = {each.get("id"): each for each in root.iter(f"{space}controller")}
    instances = list(root.iter(f"{space}instance_controller"))
    for instance in instances:
        _replace(instance, controllers, space, etree)
    shown: Any = root.find(f".//{space}visual_scene[@id]")
    lacks_scene = root.find(f"{space}scene") is None and shown is not None
    if lacks_scene:
        scene = etree.SubElement(root, f"{space}scene")
        etree.SubElement(scene, f"{space}instance_visual_scene", url=f"#{shown.get('id')}")
    return bytes(etree.tostring(root)) if instances or lacks_scene else data, len(instances)


def _replace(instance: Any, controllers: dict[str, Any], space: str, etree: Any) -> None:
    """Make an instance of a controller one of its geometry; a skin's stands where the skin binds it, in the world."""
    source, place = instance.get("url", "")[1:], None
    for _ in range(_MOST_CONTROLLERS):
        tags = f"{space}skin", f"{space}morph"
        found = next((each for each in controllers.get(source, ()) if each.tag in tags), None)
        if found is None:
            break
        if found.tag == tags[0]:
            place = found.findtext(f"{space}bind_shape_matrix", _NO_TURN)
        source = found.get("source", "")[1:]
    instance.tag, instance.attrib["url"] = f"{space}instance_geometry", f"#{source}"
    for skeleton in instance.findall(f"{space}skeleton"):
        instance.remove(skeleton)
    scene = next(instance.iterancestors(f"{space}visual_scene"), None)
    if place is not None and scene is not None:
        node = etree.SubElement(scene, f"{space}node")
        etree.SubElement(node, f"{space}matrix").text = place
        node.append(instance)
