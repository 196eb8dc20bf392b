"""COLLADA, read by trimesh with a library of an extra, from documents rewritten so that they find all geometry.

Format: Khronos Group 2008, "COLLADA: Digital Asset Schema Release 1.4.1". The library passes over geometry by
controllers, which are skins and morph targets, over convex meshes, over all of a document that chooses no scene, and
over geometry whose material refers to something that is missing.
"""

from __future__ import annotations

import contextlib
import copy
import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from wrt.errors import InputError, warn
from wrt.io.account import warn_of_unused
from wrt.io.mesh.collada_cameras import cameras_of, local_matrix
from wrt.io.mesh.parts import Contents, as_specified
from wrt.io.mesh.sidecars import Sidecars
from wrt.io.mesh.trimesh_loaders import reading_with_trimesh
from wrt.io.safe_read import as_text, first_line, read_file

_BEGINNING = 1 << 16
"""Bytes at the start of a file that hold its description."""

_UP = re.compile(r"<(?:\w+:)?up_axis>\s*([XYZ])_UP\s*<")

_MOST_CONTROLLERS = 8
"""Controllers that are followed to a geometry: a skin may move a morphed mesh."""

_READ = {
    "COLLADA": "asset scene library_visual_scenes library_nodes library_materials library_effects library_images "
    "library_geometries library_cameras",
    "asset": "unit up_axis",
    "scene": "instance_visual_scene",
    "library_visual_scenes": "visual_scene",
    "visual_scene": "node",
    "library_nodes": "node",
    "node": "node matrix translate rotate scale lookat instance_node instance_geometry instance_camera",
    "instance_geometry": "bind_material",
    "bind_material": "technique_common",
    "technique_common": "instance_material accessor perspective orthographic",
    "library_materials": "material",
    "material": "instance_effect",
    "library_effects": "effect",
    "effect": "profile_COMMON",
    "profile_COMMON": "newparam technique image",
    "newparam": "surface sampler2D",
    "surface": "init_from",
    "sampler2D": "source",
    "technique": "constant lambert phong blinn",
    **dict.fromkeys(("constant", "lambert", "phong", "blinn"), "diffuse emission shininess"),
    "diffuse": "color texture",
    "emission": "color",
    "shininess": "float",
    "library_images": "image",
    "image": "init_from",
    "library_geometries": "geometry",
    "geometry": "mesh",
    "mesh": "source vertices polylist polygons triangles",
    "source": "float_array technique_common",
    "accessor": "param",
    "vertices": "input",
    "polylist": "input vcount p",
    "polygons": "input p",
    "triangles": "input p",
    "library_cameras": "camera",
    "camera": "optics",
    "optics": "technique_common",
    "perspective": "xfov yfov aspect_ratio",
    "orthographic": "xmag ymag aspect_ratio",
}
"""Elements that trimesh, its library and the reader of cameras read, by the element that they are in."""

_ATTRIBUTES = {
    *("url", "target", "symbol", "semantic", "source", "offset", "stride", "material", "texture", "meter"),
}
"""Attributes of these that are read."""

_SEMANTICS = ("VERTEX", "POSITION", "NORMAL", "COLOR", "TEXCOORD")

_NEUTRAL = {
    **dict.fromkeys(("specular", "reflective", "reflectivity", "skew"), 0.0),
    **dict.fromkeys(("wrap_s", "wrap_t"), ("WRAP",)),
    "magfilter": ("LINEAR", "NONE"),
}
"""The number, or the words, at which an element has no effect."""

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
    "library_controllers": "skins and morph targets, which are named where they stand",
    "library_lights": "lights, which are named where they stand",
    "library_physics*": "how bodies move",
    "library_force_fields": "how bodies move",
    "instance_physics_scene": "how bodies move",
    "index_of_refraction": "of light that passes surfaces, which is left out where they are transparent",
    "minfilter": "textures are filtered by what a pixel covers",
    "mipfilter": "textures are filtered by what a pixel covers",
    "evaluate_scene": "how other renderers make a picture",
    "*.count": "what an element has is counted",
    "float_array.*": "how the numbers were rounded",
    "input.set": "which set of coordinates a texture has; a mesh with several is named",
    "texture.texcoord": "the same",
    "param.*": "the library takes the values in order",
    "surface.type": "images of a sampler2D are flat",
    "node.layer": "how programs sort nodes",
    "node.type": "whether it is a joint",
    "COLLADA.version": "1.4 and 1.5 are read alike",
    "*.id": "a name for references",
    "*.sid": "the same",
    "*.name": "a name for people",
    "*.base": "where references start",
    "*.schemaLocation": "where the schema is",
    "znear": "a bound of a depth buffer",
    "zfar": "the same",
    "modified": "about the file",
    "revision": "about the file",
    "subject": "about the file",
    "title": "about the file",
}
"""Elements and attributes that do not change a picture, and why."""

_NUMBERS = {"matrix": 16, "bind_shape_matrix": 16, "translate": 3, "rotate": 4, "scale": 3, "lookat": 9}
"""Numbers in each kind of transform; the library ignores transforms with more or fewer."""

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
            from lxml import etree

            root, notes = _rewritten(data)
            unused = list(_unused(root))
            with as_specified(path, "COLLADA"):
                cameras = cameras_of(root)
            for each in list(root.iter("{*}library_cameras", "{*}instance_camera")):  # the library needs their znear
                each.getparent().remove(each)
            document = etree.tostring(root)
            scene = trimesh.load_scene(io.BytesIO(document), file_type="dae", resolver=files)
            lost = list(_passed_over(root, document, set(scene.geometry)))
            if lost and not scene.geometry:
                raise InputError(f"{path}: {lost[0]}")
            notes += [f"{reason}; it is left out" for reason in lost]
        except ImportError as error:
            raise InputError(f"{missing} ({first_line(error)})") from None
    for message in dict.fromkeys([*files.messages, *(f"{path}: {note}" for note in notes)]):
        warn(message)
    warn_of_unused(path, unused, WITHOUT_EFFECT)
    contents = read_object(scene, str(path))
    contents.cameras = cameras
    return contents


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


def _unused(element: Any) -> Iterator[str]:
    """Yield the kinds of elements and attributes below an element that are not read; of a whole its name alone."""
    name = _local(element.tag)
    semantics = [each.get("semantic") for each in element.iterchildren("{*}input")]
    yield from (f"an input {kind}" for kind in semantics if kind not in _SEMANTICS)
    yield from (f"another set of {kind}" for kind in ("COLOR", "TEXCOORD") if semantics.count(kind) > 1)
    yield from (f"{name}.{_local(key)}" for key in element.attrib if _local(key) not in _ATTRIBUTES)
    read = _READ.get(name, "").split()
    if any(_local(child.tag) in ("transparent", "transparency") for child in element) and not _is_opaque(element):
        yield "partial transparency"
    for child in element.iterchildren(tag="{*}*"):
        inner = _local(child.tag)
        if inner in read:
            yield from _unused(child)
        elif inner not in ("transparent", "transparency") and not _is_neutral(child, inner):
            yield f"a texture of {name}" if inner == "texture" else inner


def _is_neutral(element: Any, name: str) -> bool:
    """Return whether an element that is not read has the value at which it has no effect."""
    neutral, words = _NEUTRAL.get(name), "".join(element.itertext()).split()[:3]  # without alpha
    if neutral is None or not words:
        return False
    with contextlib.suppress(ValueError):
        return words[0] in neutral if isinstance(neutral, tuple) else all(float(word) == neutral for word in words)
    return False


def _is_opaque(shader: Any) -> bool:
    """Return whether a shader's transparency leaves it opaque (chapter 7, "Determining transparency")."""
    transparent = shader.find("{*}transparent")
    mode = "A_ONE" if transparent is None else transparent.get("opaque", "A_ONE")
    if mode not in ("A_ONE", "RGB_ZERO") or (transparent is not None and transparent.find("{*}texture") is not None):
        return False
    with contextlib.suppress(ValueError):
        color = shader.findtext("{*}transparent/{*}color", "1 1 1 1").split()
        amount = float(shader.findtext("{*}transparency/{*}float", "1"))
        return all(amount * float(x) == (mode == "A_ONE") for x in (color[3:4] if mode == "A_ONE" else color[:3]))
    return False


def _local(tag: str) -> str:
    return tag.rpartition("}")[2]


def _rewritten(data: bytes) -> tuple[Any, list[str]]:
    """Return the root of a document whose geometry is all found, skins in their bind pose, and notes on changes."""
    from lxml import etree

    root = etree.fromstring(data, etree.XMLParser(resolve_entities=False, no_network=True))
    for each in root.iter(*(f"{{*}}{name}" for name in _NUMBERS)):
        if reason := _no_numbers(each, _NUMBERS[_local(each.tag)]):
            raise InputError(reason)
    for mesh in list(root.iter("{*}convex_mesh")):
        mesh.tag = mesh.tag.replace("convex_mesh", "mesh")
    for place in root.iter("{*}lookat"):  # the library turns it the other way
        holder = place.makeelement("node")
        holder.append(copy.copy(place))
        place.text = " ".join(map(repr, local_matrix(holder).reshape(-1).tolist()))
        place.tag = place.tag.replace("lookat", "matrix")
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
    return root, notes


def _passed_over(root: Any, document: bytes, read: set[str]) -> Iterator[str]:
    """Yield what is wrong with each geometry of a document that a node shows, and that the library does not return."""
    shown = {instance.get("url", "")[1:] for instance in root.iter("{*}instance_geometry")} - read
    geometries = [
        each for each in root.iter("{*}geometry") if each.get("id") in shown and each.find("{*}mesh") is not None
    ]
    if not geometries:
        return
    from collada import Collada
    from collada.common import DaeError
    from collada.geometry import Geometry

    library = Collada(io.BytesIO(document), ignore=[DaeError])
    for geometry in geometries:
        try:
            Geometry.load(library, {}, geometry)
        except DaeError as error:
            reasons = map(_no_numbers, geometry.iter(*(f"{{*}}{name}" for name in ("float_array", "p", "vcount"))))
            yield f"geometry {geometry.get('id')!r} cannot be read: {next(filter(None, reasons), error.msg)}"


def _no_numbers(element: Any, count: int | None = None) -> str | None:
    """Return what is wrong with an element that should hold numbers, and how many; None if nothing is."""
    words, name = (element.text or "").split(), _local(element.tag)
    for word in words:
        try:
            float(word)
        except ValueError:
            advice = "; numbers have decimal points, not commas" if "," in word else ""
            return f"{word[:40]!r} in a {name} is not a number{advice}"
    return f"a {name} has {len(words)} numbers, not {count}" if count not in (None, len(words)) else None


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
    """Remove uses of materials that are missing or have no effect of the common profile, and return their number."""
    effects = {f"#{each.get('id')}" for each in root.iter("{*}effect") if each.find("{*}profile_COMMON") is not None}
    materials = set()
    for material in root.iter("{*}material"):
        effect = material.find("{*}instance_effect")
        if effect is not None and effect.get("url") in effects:
            materials.add(f"#{material.get('id')}")
    missing = [each for each in root.iter("{*}instance_material") if each.get("target") not in materials]
    for use in missing:
        use.getparent().remove(use)
    return len(missing)
