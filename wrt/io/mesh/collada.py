"""COLLADA documents in the words that trimesh and its library understand.

Format: Khronos Group 2008, "COLLADA: Digital Asset Schema Release 1.4.1". The library passes over geometry by
controllers, which are skins and morph targets, over convex meshes, over all of a document that chooses no scene, and
over geometry whose material refers to something that is not there.
"""

from __future__ import annotations

from typing import Any

_MOST_CONTROLLERS = 8
"""Controllers that are followed to a geometry: a skin may move a morphed mesh."""

_NO_TURN = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"
_WITHOUT_IMAGE = "0.8 0.8 0.8 1"


def in_plain_words(data: bytes) -> tuple[bytes, list[str]]:
    """Return a document whose geometry is all found, each controller's in its bind pose, and notes on what changed."""
    from lxml import etree

    root: Any = etree.fromstring(data, etree.XMLParser(resolve_entities=False, no_network=True))
    space = root.tag.rpartition("}")[0] + "}" if "}" in root.tag else ""
    for mesh in list(root.iter(f"{space}convex_mesh")):
        mesh.tag = f"{space}mesh"
    controllers = {each.get("id"): each for each in root.iter(f"{space}controller")}
    instances = list(root.iter(f"{space}instance_controller"))
    for instance in instances:
        _replace(instance, controllers, space, etree)
    shown: Any = root.find(f".//{space}visual_scene[@id]")
    if root.find(f"{space}scene") is None and shown is not None:
        scene = etree.SubElement(root, f"{space}scene")
        etree.SubElement(scene, f"{space}instance_visual_scene", url=f"#{shown.get('id')}")
    notes = ["skins and morph targets are shown in their bind pose"] if instances else []
    notes += _without_lost_images(root, space, etree) + _without_lost_materials(root, space)
    return bytes(etree.tostring(root)), notes


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


def _without_lost_images(root: Any, space: str, etree: Any) -> list[str]:
    """Make textures grey that lead to no image, and return a note on them if there are any."""
    images = {each.get("id") for each in root.iter(f"{space}image") if each.find(f"{space}init_from") is not None}
    count = 0
    for effect in root.iter(f"{space}effect"):
        surfaces, lost = set(), set()
        for parameter in list(effect.iter(f"{space}newparam")):
            name = parameter.get("sid")
            image = parameter.findtext(f"{space}surface/{space}init_from")
            surface = parameter.findtext(f"{space}sampler2D/{space}source")
            if (image is not None and image not in images) or (surface is not None and surface not in surfaces):
                lost.add(name)
                parameter.getparent().remove(parameter)
            elif image is not None:
                surfaces.add(name)
        for texture in [each for each in effect.iter(f"{space}texture") if each.get("texture") in lost]:
            etree.SubElement(texture.getparent(), f"{space}color").text = _WITHOUT_IMAGE
            texture.getparent().remove(texture)
            count += 1
    return [f"textures that lead to no image are grey ({count})"] if count else []


def _without_lost_materials(root: Any, space: str) -> list[str]:
    """Take the uses of materials that are not there, and return a note on them if there are any."""
    effects = {f"#{each.get('id')}" for each in root.iter(f"{space}effect")}
    found = set()
    for material in root.iter(f"{space}material"):
        effect = material.find(f"{space}instance_effect")
        if effect is not None and effect.get("url") in effects:
            found.add(f"#{material.get('id')}")
    lost = [each for each in root.iter(f"{space}instance_material") if each.get("target") not in found]
    for use in lost:
        use.getparent().remove(use)
    return [f"uses of materials that are not there are left out ({len(lost)})"] if lost else []
