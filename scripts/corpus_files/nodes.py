"""Files of nodes with meshes, cameras and lights: glTF, GLB, COLLADA."""

from __future__ import annotations

import base64
import json
import struct
from typing import Any

import numpy as np

DAE = """\
<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="inch" meter="0.0254"/><up_axis>Z_UP</up_axis></asset>
<library_cameras><camera id="eye"><optics><technique_common><perspective><yfov>35</yfov><znear>0.1</znear>
<zfar>90</zfar></perspective></technique_common></optics></camera></library_cameras>
<library_lights><light id="lamp"><technique_common><point><color>1 0.9 0.8</color></point></technique_common></light>
</library_lights>
<library_images><image id="i"><init_from>colors.png</init_from></image></library_images>
<library_effects><effect id="paint"><profile_COMMON>
<newparam sid="f"><surface type="2D"><init_from>i</init_from></surface></newparam>
<newparam sid="s"><sampler2D><source>f</source></sampler2D></newparam>
<technique sid="t"><phong><emission><color>0 0.1 0 1</color></emission><diffuse><texture texture="s" texcoord="UV"/>
</diffuse><specular><color>0.5 0.5 0.5 1</color></specular><shininess><float>20</float></shininess>
<transparency><float>0.9</float></transparency></phong></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#paint"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="12">0 0 0 1 0 0 1 2 0 0 2 3</float_array><technique_common>
<accessor source="#pa" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<source id="n"><float_array id="na" count="3">0 0 1</float_array><technique_common><accessor source="#na" count="1"
stride="3"><param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor>
</technique_common></source>
<source id="t"><float_array id="ta" count="8">0 0 1 0 1 1 0 1</float_array><technique_common><accessor source="#ta"
count="4" stride="2"><param name="S" type="float"/><param name="T" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles material="M" count="1"><input semantic="VERTEX" source="#v" offset="0"/>
<input semantic="NORMAL" source="#n" offset="1"/><input semantic="TEXCOORD" source="#t" offset="2" set="0"/>
<p>0 0 0 1 0 1 2 0 2</p></triangles>
<polylist material="M" count="1"><input semantic="VERTEX" source="#v" offset="0"/>
<input semantic="TEXCOORD" source="#t" offset="1"/><vcount>4</vcount><p>0 0 1 1 2 2 3 3</p></polylist>
</mesh></geometry></library_geometries>
<library_controllers><controller id="skin"><skin source="#g">
<bind_shape_matrix>1 0 0 5 0 1 0 0 0 0 1 0 0 0 0 1</bind_shape_matrix></skin></controller></library_controllers>
<library_nodes><node id="lent"><scale>1 2 1</scale><instance_geometry url="#g"/></node></library_nodes>
<library_visual_scenes><visual_scene id="w">
<node id="top"><translate>0 0 7</translate><rotate>0 1 0 30</rotate><node id="below">
<matrix>1 0 0 0 0 1 0 2 0 0 1 0 0 0 0 1</matrix><instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="M" target="#m"><bind_vertex_input semantic="UV" input_semantic="TEXCOORD" input_set="0"/>
</instance_material></technique_common></bind_material></instance_geometry></node></node>
<node id="moved"><instance_controller url="#skin"/></node><node><instance_node url="#lent"/></node>
<node><lookat>0 5 9 0 0 0 0 1 0</lookat><instance_camera url="#eye"/><instance_light url="#lamp"/></node>
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#w"/></scene></COLLADA>
"""


def files(image: bytes) -> dict[str, str | bytes]:
    """Return the content of each file by its name; a PNG image is what they hold as a texture."""
    return {
        "scene.gltf": gltf(image, binary=False),
        "scene.glb": gltf(image, binary=True),
        "nodes.dae": DAE,
    }


def gltf(image: bytes, *, binary: bool) -> bytes:
    """Return two nodes of one textured and coloured triangle, with a camera and a light, as glTF or GLB."""
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()
    uvs = np.array([[0, 0], [1, 0], [0, 1]], "<f4").tobytes()
    indices = np.array([0, 1, 2, 0], "<u2").tobytes()
    colors = np.array([[255, 128, 0, 255], [0, 255, 64, 128], [255] * 4], "<u1").tobytes()
    blocks = [positions, uvs, indices, image + b"\0" * (-len(image) % 4), colors]
    starts = np.cumsum([0] + [len(block) for block in blocks]).tolist()
    data = b"".join(blocks)
    views = [{"buffer": 0, "byteOffset": s, "byteLength": len(b)} for s, b in zip(starts, blocks, strict=False)]
    encoded = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    attributes = {"POSITION": 0, "TEXCOORD_0": 1, "TEXCOORD_1": 1, "COLOR_0": 3}
    tree: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_lights_punctual", "KHR_texture_transform", "KHR_materials_clearcoat"],
        "extensions": {"KHR_lights_punctual": {"lights": [{"type": "spot", "intensity": 5, "spot": {}}]}},
        "scene": 0,
        "scenes": [{"nodes": [0, 2]}],
        "nodes": [
            {"mesh": 0, "children": [1], "translation": [0, 1, 0]},
            {"mesh": 0, "rotation": [0, 0, 0.7071068, 0.7071068], "scale": [1, 2, 1]},
            {"camera": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 5, 1], "children": [3]},
            {"extensions": {"KHR_lights_punctual": {"light": 0}}},
        ],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 2, "material": 0}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5123, "count": 3, "type": "SCALAR"},
            {"bufferView": 4, "componentType": 5121, "count": 3, "type": "VEC4", "normalized": True},
        ],
        "materials": [
            {
                "pbrMetallicRoughness": {
                    "baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform": {"scale": [2, 2]}}},
                    "baseColorFactor": [1, 0.5, 0.5, 0.5],
                    "metallicFactor": 0.1,
                    "metallicRoughnessTexture": {"index": 1, "texCoord": 1},
                },
                "normalTexture": {"index": 1, "scale": 0.5},
                "emissiveFactor": [0.1, 0, 0],
                "alphaMode": "MASK",
                "alphaCutoff": 0.4,
                "extensions": {"KHR_materials_clearcoat": {"clearcoatFactor": 0.5}},
            }
        ],
        "textures": [{"source": 0, "sampler": 0}, {"source": 1}],
        "samplers": [{"wrapS": 33071, "magFilter": 9728}],
        "images": [{"bufferView": 3, "mimeType": "image/png"}, {"uri": "grey.png"}],
        "bufferViews": views,
        "buffers": [{"byteLength": len(data)} if binary else {"byteLength": len(data), "uri": encoded}],
    }
    text = json.dumps(tree, indent=None if binary else 1).encode()
    return _glb(text, data) if binary else text


def draco() -> bytes:
    """Return a GLB file of a coloured tetrahedron whose mesh is compressed by Draco."""
    import DracoPy

    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.uint32)
    colors = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [99, 99, 99]], np.uint8)
    packed = DracoPy.encode(points, faces, colors=colors, tex_coord=points[:, :2].astype(float), preserve_order=True)
    in_draco = {"POSITION": 2, "COLOR_0": 0, "TEXCOORD_0": 1}
    extension = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": in_draco}}
    primitive = {"attributes": {"POSITION": 0, "COLOR_0": 1, "TEXCOORD_0": 2}, "indices": 3, "extensions": extension}
    tree: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "extensionsUsed": list(extension),
        "extensionsRequired": list(extension),
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": [
            {"componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1]},
            {"componentType": 5121, "count": 4, "type": "VEC3", "normalized": True},
            {"componentType": 5126, "count": 4, "type": "VEC2"},
            {"componentType": 5125, "count": 12, "type": "SCALAR"},
        ],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": len(packed)}],
        "buffers": [{"byteLength": len(packed)}],
    }
    return _glb(json.dumps(tree).encode(), packed + b"\0" * (-len(packed) % 4))


def _glb(text: bytes, data: bytes) -> bytes:
    """Return a GLB file of JSON and a whole number of words."""
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
