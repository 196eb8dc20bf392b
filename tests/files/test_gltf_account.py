"""Every key of glTF 2.0 and of the Khronos Group's extensions is used, without effect, or warned of."""

import io
import warnings
from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from support.mesh_files import add, add_view, data_uri, saved

from wrt.io.gltf import reader
from wrt.io.gltf.without_effect import WITHOUT_EFFECT

KEYS = {
    "": "accessors animations asset buffers bufferViews cameras extensions extensionsRequired -extensionsUsed images "
    "materials meshes nodes samplers scene scenes skins textures",
    "accessors": "bufferView byteOffset componentType count -max -min normalized sparse type",
    "accessors.sparse": "count indices values",
    "accessors.sparse.indices": "bufferView byteOffset componentType",
    "accessors.sparse.values": "bufferView byteOffset",
    "animations": "channels samplers",
    "animations.channels": "sampler target",
    "animations.channels.target": "extensions node path",
    "animations.channels.target.extensions": "!KHR_animation_pointer",
    "animations.samplers": "input interpolation output",
    "asset": "-copyright -generator minVersion version",
    "buffers": "-byteLength extensions uri",
    "buffers.extensions": "-KHR_meshopt_compression",
    "bufferViews": "buffer byteLength byteOffset byteStride extensions -target",
    "bufferViews.extensions": "KHR_meshopt_compression",
    "bufferViews.extensions.KHR_meshopt_compression": "buffer byteLength byteOffset byteStride count filter mode",
    "cameras": "orthographic perspective type",
    "cameras.orthographic": "-xmag ymag -zfar -znear",
    "cameras.perspective": "-aspectRatio yfov -zfar -znear",
    "extensions": "-KHR_interactivity KHR_lights_punctual KHR_materials_variants -KHR_xmp_json_ld",
    "extensions.KHR_lights_punctual": "lights",
    "extensions.KHR_lights_punctual.lights": "color intensity -range spot type",
    "extensions.KHR_lights_punctual.lights.spot": "innerConeAngle outerConeAngle",
    "extensions.KHR_materials_variants": "variants",
    "images": "bufferView -mimeType uri",
    "materials": "alphaCutoff alphaMode doubleSided emissiveFactor emissiveTexture extensions normalTexture "
    "-occlusionTexture pbrMetallicRoughness",
    "materials.pbrMetallicRoughness": "baseColorFactor baseColorTexture metallicFactor metallicRoughnessTexture "
    "roughnessFactor",
    "materials.normalTexture": "scale",
    "materials.extensions.KHR_materials_clearcoat.clearcoatNormalTexture": "scale",
    "meshes": "primitives weights",
    "meshes.primitives": "attributes extensions indices material mode targets",
    "meshes.primitives.attributes": "-COLOR_1 COLOR_0 JOINTS_0 NORMAL POSITION TANGENT TEXCOORD_0 -TEXCOORD_2 "
    "WEIGHTS_0 -_TEMPERATURE",
    "meshes.primitives.extensions": "!KHR_gaussian_splatting -KHR_materials_variants",
    "meshes.primitives.targets": "NORMAL POSITION TANGENT !TEXCOORD_0 !COLOR_0",
    "nodes": "camera children extensions matrix mesh rotation scale skin translation weights",
    "nodes.extensions": "EXT_mesh_gpu_instancing KHR_lights_punctual -KHR_node_hoverability -KHR_node_selectability "
    "KHR_node_visibility -KHR_xmp_json_ld",
    "nodes.extensions.EXT_mesh_gpu_instancing": "attributes",
    "nodes.extensions.EXT_mesh_gpu_instancing.attributes": "ROTATION SCALE TRANSLATION -_ID",
    "nodes.extensions.KHR_lights_punctual": "light",
    "nodes.extensions.KHR_node_visibility": "visible",
    "samplers": "magFilter minFilter wrapS wrapT",
    "scenes": "nodes",
    "skins": "inverseBindMatrices joints -skeleton",
    "textures": "extensions sampler source",
    "textures.extensions": "EXT_texture_webp KHR_texture_basisu",
    "textures.extensions.EXT_texture_webp": "source",
    "textures.extensions.KHR_texture_basisu": "source",
}
"""The keys of each object, "-" before a key without effect, "!" before one with a warning. `name`, `extras` and
what begins with KHR_materials_ or ends with Texture are below; Draco, which needs a library, is in another test."""

MATERIALS = {
    "anisotropy": "anisotropyRotation anisotropyStrength anisotropyTexture",
    "clearcoat": "clearcoatFactor clearcoatRoughnessFactor clearcoatRoughnessTexture clearcoatTexture "
    "clearcoatNormalTexture",
    "dispersion": "dispersion",
    "emissive_strength": "emissiveStrength",
    "ior": "ior",
    "iridescence": "iridescenceFactor iridescenceIor iridescenceTexture iridescenceThicknessMaximum "
    "iridescenceThicknessMinimum iridescenceThicknessTexture",
    "pbrSpecularGlossiness": "diffuseFactor diffuseTexture glossinessFactor specularFactor specularGlossinessTexture",
    "sheen": "sheenColorFactor sheenColorTexture sheenRoughnessFactor sheenRoughnessTexture",
    "specular": "specularColorFactor specularColorTexture specularFactor specularTexture",
    "transmission": "transmissionFactor transmissionTexture",
    "unlit": "",
    "volume": "attenuationColor attenuationDistance thicknessFactor -thicknessTexture",
}
"""The keys of KHR_materials_..."""

KEYS["materials.extensions"] = " ".join(f"KHR_materials_{name}" for name in MATERIALS)
KEYS["materials.extensions"] += " !KHR_materials_diffuse_transmission"
KEYS |= {f"materials.extensions.KHR_materials_{name}": keys for name, keys in MATERIALS.items()}
for place, keys in list(KEYS.items()):
    for key in keys.split():
        if key.endswith("Texture") and key[0] not in "-!":
            KEYS[f"{place}.{key}"] = f"index texCoord extensions {KEYS.get(f'{place}.{key}', '')}"
            KEYS[f"{place}.{key}.extensions"] = "KHR_texture_transform"
            KEYS[f"{place}.{key}.extensions.KHR_texture_transform"] = "offset rotation scale texCoord"

EXPECTED = {
    f"{place}.{key.lstrip('-!')}".lstrip("."): "without effect" if key[0] == "-" else "named" if key[0] == "!" else ""
    for place, keys in KEYS.items()
    for key in keys.split()
}


def material(*names: str) -> dict[str, Any]:
    """Return a material with extensions, whose keys all have an effect."""

    def value(key: str) -> object:
        if key.endswith("Texture"):
            transform = {"offset": [0, 0.1], "rotation": 0.1, "scale": [2, 2], "texCoord": 0}
            return {"index": 0, "texCoord": 1, "extensions": {"KHR_texture_transform": transform}}
        if "Color" in key or key in ("diffuseFactor", "specularFactor"):
            return [0.5, 0.6, 0.7]
        return 1.3 if key == "ior" else 0.5

    keys = {name: MATERIALS[name].replace("-", "").split() for name in names}
    found = {f"KHR_materials_{name}": {key: value(key) for key in keys[name]} for name in names}
    if "specular" in names:
        found["KHR_materials_specular"]["specularFactor"] = 0.5
    pbr = {key: value(key) for key in KEYS["materials.pbrMetallicRoughness"].split()}
    pbr["baseColorFactor"] = [0.5, 0.5, 0.5, 0.9]
    tree = {"pbrMetallicRoughness": pbr, "extensions": found}
    tree |= {key: value(key) for key in ("normalTexture", "emissiveTexture", "occlusionTexture")}
    tree["normalTexture"]["scale"] = 0.5
    if "clearcoat" in names:
        found["KHR_materials_clearcoat"]["clearcoatNormalTexture"]["scale"] = 0.25
    return {**tree, "emissiveFactor": [1, 1, 1], "alphaMode": "MASK", "alphaCutoff": 0.2, "doubleSided": True}


def complete_file() -> dict[str, Any]:
    """Return a file that has every key, each where it has an effect if it ever has one."""
    tree: dict[str, Any] = {"buffers": [], "bufferViews": [], "accessors": []}
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    position, corners = add(tree, points, max=[1, 1, 0], min=[0, 0, 0]), add(tree, [0, 1, 2], "<u2")
    tree["bufferViews"][corners]["byteOffset"] = 0
    tree["accessors"][position] |= {"byteOffset": 0}
    indices, values = (
        add_view(tree, np.array(rows, kind).tobytes()) for rows, kind in (([1], "<u2"), ([1] * 3, "<f4"))
    )
    tree["accessors"][position]["sparse"] = {
        "count": 1,
        "indices": {"bufferView": indices, "byteOffset": 0, "componentType": 5123},
        "values": {"bufferView": values, "byteOffset": 0},
    }
    packed = {"buffer": 0, "byteOffset": 0, "byteLength": 36, "byteStride": 12, "count": 3}
    packed |= {"mode": "ATTRIBUTES", "filter": "NONE"}
    view = {"byteStride": 12, "target": 34962, "extensions": {"KHR_meshopt_compression": packed}}
    tree["bufferViews"][position] = view  # what else it has is for readers that do not know the extension
    tree["buffers"][0]["extensions"] = {"KHR_meshopt_compression": {"fallback": True}}
    four = [[0, 0, 0, 0]] * 3
    attributes = {
        "POSITION": position,
        "NORMAL": position,
        "TANGENT": add(tree, [[1, 0, 0, 1]] * 3),
        "_TEMPERATURE": position,
        **{f"TEXCOORD_{k}": add(tree, points[:, :2], "<u2", normalized=True) for k in (0, 2)},
        **{f"COLOR_{k}": add(tree, points, "<u1") for k in (0, 1)},
    }
    joints = {"JOINTS_0": add(tree, four, "<u1"), "WEIGHTS_0": add(tree, [[1, 0, 0, 0]] * 3)}
    targets = [dict.fromkeys(("POSITION", "NORMAL", "TANGENT", "TEXCOORD_0", "COLOR_0"), position)]
    lit = {"attributes": attributes, "indices": corners, "mode": 4, "targets": targets}
    variants = {"KHR_materials_variants": {"mappings": [{"material": 1, "variants": [0]}]}}
    splats = {"attributes": {"POSITION": position}, "mode": 0, "extensions": {"KHR_gaussian_splatting": {}}}
    primitives = [{**lit, "material": k} for k in range(3)]
    skinned = {**primitives[0], "attributes": attributes | joints, "extensions": variants}
    tree["meshes"] = [{"primitives": [skinned, splats]}, {"primitives": primitives, "weights": [0.5]}]
    lit_names = [name for name in MATERIALS if name not in ("unlit", "pbrSpecularGlossiness")]
    tree["materials"] = [material(*lit_names), material("pbrSpecularGlossiness"), material("unlit")]
    tree["materials"][0]["extensions"]["KHR_materials_diffuse_transmission"] = {"diffuseTransmissionFactor": 0.5}
    # Keys that only count without the extension, and so are not in the other two.
    for key in ("metallicRoughnessTexture", "metallicFactor", "roughnessFactor"):
        for each in tree["materials"][1:]:
            del each["pbrMetallicRoughness"][key]
    for key in ("baseColorTexture", "baseColorFactor"):
        del tree["materials"][1]["pbrMetallicRoughness"][key]
    for key in ("normalTexture", "emissiveTexture", "emissiveFactor"):
        del tree["materials"][2][key]
    file = io.BytesIO()
    Image.fromarray(np.uint8([[[9, 99, 200, 100]]])).save(file, "PNG")
    picture = add_view(tree, file.getvalue())
    tree |= {
        "asset": {"version": "2.0", "minVersion": "2.0", "copyright": "nobody", "generator": "a test"},
        "images": [{"bufferView": picture, "mimeType": "image/png"}, {"uri": data_uri(file.getvalue())}],
        "samplers": [{"magFilter": 9728, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}],
        "textures": [{"source": 0, "sampler": 0}, {"extensions": {"EXT_texture_webp": {"source": 1}}}],
        "cameras": [
            {"type": "perspective", "perspective": {"yfov": 1, "znear": 1, "zfar": 9, "aspectRatio": 1}},
            {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "zfar": 9, "znear": 1}},
        ],
        "skins": [{"joints": [0], "skeleton": 0, "inverseBindMatrices": add(tree, np.eye(4).reshape(1, 16))}],
        "extensionsUsed": [],
        "extensionsRequired": [],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
    }
    tree["textures"].append({"extensions": {"KHR_texture_basisu": {"source": 1}}})
    for each, number in (("metallicRoughnessTexture", 1), ("baseColorTexture", 2)):
        tree["materials"][0]["pbrMetallicRoughness"][each]["index"] = number
    places = {name: add(tree, points[:1]) for name in ("TRANSLATION", "SCALE", "_ID")}
    places["ROTATION"] = add(tree, four[:1])
    node_extensions: dict[str, Any] = {
        "KHR_lights_punctual": {"light": 0},
        "KHR_node_visibility": {"visible": True},
        "KHR_node_hoverability": {"hoverable": True},
        "KHR_node_selectability": {"selectable": True},
        "KHR_xmp_json_ld": {"packet": 0},
    }
    tree["nodes"] = [
        {"children": [1, 2, 3], "matrix": np.eye(4).reshape(-1).tolist(), "camera": 0, "extensions": node_extensions},
        {"mesh": 0, "skin": 0, "weights": [0.5], "camera": 1},
        {"mesh": 1, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": places}}},
        {"translation": [0, 0, 0], "rotation": [0, 0, 0, 1], "scale": [1, 1, 1]},
    ]
    light = {"type": "spot", "color": [1, 1, 1], "intensity": 1, "range": 9}
    tree["extensions"] = {
        "KHR_lights_punctual": {"lights": [{**light, "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.2}}]},
        "KHR_materials_variants": {"variants": [{"name": "red"}]},
        "KHR_xmp_json_ld": {"packets": []},
        "KHR_interactivity": {"graphs": []},
    }
    sampler = {"input": add(tree, [0, 1]), "output": add(tree, points[:2]), "interpolation": "LINEAR"}
    pointer = {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": "/nodes/0/weights"}}}
    channels = [{"sampler": 0, "target": {"node": 3, "path": "translation"}}, {"target": pointer}]
    tree["animations"] = [{"channels": channels, "samplers": [sampler]}]
    return tree


def objects(value: Any, place: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the path and the content of each object whose keys the specification names."""
    if isinstance(value, list):
        for each in value:
            yield from objects(each, place)
    elif isinstance(value, dict):
        yield place, value
        for key, inner in list(value.items()):
            if (path := f"{place}.{key}".lstrip(".")) in KEYS:
                yield from objects(inner, path)


def unused(folder: Path, tree: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """Return the keys that the reader does not use, and whether they are without effect or named."""
    found: list[str] = []
    monkeypatch.setattr(reader, "warn_of_unused", lambda _, keys, __: found.extend(keys))
    monkeypatch.setattr("wrt.io.gltf.meshopt.decoded", lambda data, *_: data)
    path = saved(folder, tree)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of images that are none, of variants, of points
        reader.read_gltf(path, path.read_bytes(), 0.5)
    is_named = {key: not any(fnmatchcase(key, pattern) for pattern in WITHOUT_EFFECT) for key in found}
    return {key: "named" if named else "without effect" for key, named in is_named.items()}


def test_each_key_of_the_specification(tmp_path, monkeypatch):
    tree = complete_file()
    assert {f"{place}.{key}".lstrip(".") for place, value in objects(tree) for key in value} == set(EXPECTED)
    found = unused(tmp_path, tree, monkeypatch)
    assert {key: found.get(key, "") for key in EXPECTED | found} == EXPECTED


def test_unknown_values_of_enumerations_are_named_and_known_ones_are_not(tmp_path, monkeypatch):
    tree = complete_file()
    for known in (9728, 9729, 9984, 9985, 9986, 9987):
        tree["samplers"][0] |= {"minFilter": known, "magFilter": min(known, 9729), "wrapS": 33648, "wrapT": 10497}
        assert not [key for key in unused(tmp_path, tree, monkeypatch) if "samplers" in key]
    tree["samplers"][0] |= {"minFilter": 1, "magFilter": 9987, "wrapS": 33069, "wrapT": "REPEAT"}
    tree["materials"][0]["alphaMode"] = "ADD"
    tree["cameras"][0]["type"] = "fisheye"
    tree["animations"][0]["channels"][1]["target"] = {"node": 0, "path": "visible"}
    expected = {f"samplers.{text}" for text in ("minFilter 1", "magFilter 9987", "wrapS 33069", "wrapT 'REPEAT'")}
    expected |= {"materials.alphaMode 'ADD'", "cameras.type 'fisheye'", "animations.channels.target.path 'visible'"}
    found = unused(tmp_path, tree, monkeypatch)
    assert {key: found[key] for key in found if " " in key} == dict.fromkeys(expected, "named")


def test_unknown_keys_are_named_and_extras_are_not(tmp_path, monkeypatch):
    tree = complete_file()
    places = dict(objects(tree))
    for place, value in places.items():
        value["colour"] = 1
        if not place.endswith("attributes") and not place.endswith("extensions"):
            value |= {"extras": {"colour": 1}, "name": "a"}
            value.setdefault("extensions", {})["NEW"] = {}
    found = unused(tmp_path, tree, monkeypatch)
    expected = {f"{place}.colour".lstrip(".") for place in places}
    expected |= {f"{place}.extensions.NEW".lstrip(".") for place, value in places.items() if "extras" in value}
    kinds = {
        key for key, kind in found.items() if kind == "named" and key.endswith(("colour", "NEW", "extras", ".name"))
    }
    assert kinds == expected
