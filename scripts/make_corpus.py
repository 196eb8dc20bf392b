#!/usr/bin/env python3
"""Write tests/corpus/seeds: small files of every kind that wrt reads, for scripts/fuzz.py to damage."""

from __future__ import annotations

import base64
import io
import json
import struct
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

SEEDS = ROOT / "tests" / "corpus" / "seeds"

VERTICES = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], np.float32)
FACES = np.array(
    [[0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4]]
    + [[2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5]]
)

OBJ_TEXTURED = """\
# a square and a triangle
mtllib paints.mtl
o square
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
vn 0 0 1
usemtl wood
s 1
f 1/1/1 2/2/1 3/3/1 4/4/1
g other
usemtl glass
f -4//-1 -3//-1 -2//-1
usemtl lamp
f 1/1 2/2 3/3
"""
OBJ_POLYGONS = """\
v 0 0 0 1 0 0
v 2 0 0 0 1 0
v 2 2 0 0 0 1
v 1 0.5 0 1 1 0
v 0 2 0 1 0 1
v 1 1 3 0.5 0.5 0.5
f 1 2 3 4 5
f 1 2 6
f 2 3 6
f 3 4 6 \\
 5
l 1 2
p 3
"""
MTL = """\
newmtl wood
Ka 0 0 0
Kd 0.8 0.7 0.6
Ks 0.2 0.2 0.2
Ns 96
illum 2
map_Kd -s 2 2 1 -o 0.1 0 0 colors.png
map_Bump -bm 0.5 grey.png
map_d -imfchan m colors.png

newmtl glass
Kd 1 1 1
Tf 0.9 1 0.9
Ni 1.5
d 0.1
illum 7

newmtl lamp
Kd 0 0 0
Ke 5 4 3
map_Ke colors.png
Pr 0.3
Pm 1.0
Pc 0.2
Pcr 0.1
Ps 0.4
aniso 0.5
map_Pr -clamp on grey.png
norm grey.png
"""
TOML_SHAPES = """\
[settings]
width = 64
height = 48
spp = 1
filter = "gaussian"
sampler = "sobol"
crop = [0, 0, 32, 24]
layers = ["albedo", "normal"]

[camera]
type = "perspective"
origin = [0, 1, 4]
target = [0, 0, 0]
fov_degrees = 40
aperture_radius = 0.01
focus_distance = 3.0
motion = { keys = [{ time = 0.0 }, { time = 1.0, translate = [1, 0, 0] }] }

[environment]
type = "image"
file = "sky.hdr"
scale = 0.5
rotation_degrees = 30

[[lights]]
type = "point"
position = [1, 2, 3]
intensity = [10, 9, 8]

[[lights]]
type = "spot"
position = [0, 3, 0]
direction = [0, -1, 0]
intensity = 20
inner_degrees = 10
outer_degrees = 20

[materials.wood]
type = "diffuse"
reflectance = { texture = "colors.png", scale = 2, rotation_degrees = 15, wrap = "mirror" }
normal_map = { texture = "grey.png", scale = 0.5 }

[materials.gold]
type = "rough-conductor"
alpha = 0.2

[materials.both]
type = "mix"
first = "wood"
second = "gold"
weight = 0.5

[[shapes]]
name = "floor"
type = "quad"
origin = [-1, 0, -1]
edge_u = [0, 0, 2]
edge_v = [2, 0, 0]
material = "both"

[[shapes]]
type = "box"
low = [-1, 0, -1]
high = [1, 1, 1]
scale = [1, 2, 1]
rotate = [{ axis = [0, 1, 0], degrees = 30 }]
translate = [0, 1, 0]

[[shapes]]
type = "sphere"
center = [0, 1, 0]
radius = 0.5
subdivisions = 2
emission = [1, 2, 3]
two_sided_emission = true

[[shapes]]
type = "polygons"
polygons = [[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]]

[[shapes]]
type = "mesh"
file = "box.off"
smooth = false
material = "gold"
instances = [{ translate = [2, 0, 0] }, { scale = 2, motion = { keys = [{ time = 0 }, { time = 1, scale = 2 }] } }]
"""
TOML_SKY = """\
[environment]
type = "sun-sky"
elevation_degrees = 40
turbidity = 3

[[lights]]
type = "directional"
direction = [0, -1, 0]
irradiance = 2.0

[[shapes]]
type = "many-triangles"
triangles = 1000

[[shapes]]
type = "polygon"
corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
material = "pane"

[materials.pane]
type = "thin-dielectric"
"""
XML_SCENE = """\
<scene version="3.0.0">
  <default name="spp" value="4"/>
  <integrator type="path"><integer name="max_depth" value="6"/></integrator>
  <sensor type="thinlens">
    <float name="fov" value="40"/>
    <float name="aperture_radius" value="0.01"/>
    <float name="focus_distance" value="4"/>
    <transform name="to_world"><lookat origin="0, 1, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="24"/>
    <rfilter type="tent"/></film>
    <sampler type="independent"><integer name="sample_count" value="$spp"/></sampler>
  </sensor>
  <bsdf type="twosided" id="wood"><bsdf type="diffuse">
    <texture type="bitmap" name="reflectance"><string name="filename" value="colors.png"/></texture>
  </bsdf></bsdf>
  <bsdf type="roughconductor" id="gold"><string name="material" value="Au"/><float name="alpha" value="0.2"/></bsdf>
  <bsdf type="principled" id="paint"><rgb name="base_color" value="0.8, 0.3, 0.1"/>
    <float name="roughness" value="0.4"/></bsdf>
  <shape type="sphere"><point name="center" x="0" y="1" z="0"/><float name="radius" value="0.5"/>
    <ref id="gold"/></shape>
  <shape type="rectangle">
    <transform name="to_world"><scale value="3"/><rotate x="1" angle="-90"/><translate y="-1"/></transform>
    <ref id="wood"/>
  </shape>
  <shape type="cylinder"><point name="p0" value="0 0 0"/><point name="p1" value="0 1 0"/><ref id="paint"/></shape>
  <shape type="ply"><string name="filename" value="little.ply"/><bsdf type="dielectric"/></shape>
  <shape type="obj"><string name="filename" value="polygons.obj"/><boolean name="face_normals" value="true"/></shape>
  <shape type="disk"><emitter type="area"><spectrum name="radiance" value="400:1, 700:5"/></emitter></shape>
  <emitter type="envmap"><string name="filename" value="sky.hdr"/><float name="scale" value="0.5"/></emitter>
  <emitter type="point"><point name="position" x="1" y="2" z="3"/><rgb name="intensity" value="#ff8000"/></emitter>
  <include filename="lamp.xml"/>
</scene>
"""
XML_INCLUDED = """\
<scene version="3.0.0">
  <shape type="shapegroup" id="group"><shape type="cube"/></shape>
  <shape type="instance"><ref id="group"/><transform name="to_world"><translate x="2"/></transform></shape>
  <emitter type="spot"><rgb name="intensity" value="3"/><float name="cutoff_angle" value="25"/></emitter>
</scene>
"""
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


def write(name: str, content: str | bytes) -> None:
    """Write a file of the corpus."""
    (SEEDS / name).write_bytes(content.encode() if isinstance(content, str) else content)


def ply(format_name: str) -> bytes:
    """Return a box with normals and colours, in one of PLY's three formats."""
    head = f"ply\nformat {format_name} 1.0\ncomment a box\nelement vertex 8\n"
    head += "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
    head += "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    head += "element face 12\nproperty list uchar int vertex_indices\nend_header\n"
    order = "<" if "little" in format_name else ">"
    rows = [(*v, *(2 * v - 1), *(int(x) for x in 255 * v)) for v in VERTICES]
    if format_name == "ascii":
        lines = [" ".join(f"{x:g}" for x in row) for row in rows] + [f"3 {a} {b} {c}" for a, b, c in FACES]
        return (head + "\n".join(lines) + "\n").encode()
    body = b"".join(struct.pack(f"{order}6f3B", *row) for row in rows)
    return head.encode() + body + b"".join(struct.pack(f"{order}B3i", 3, *map(int, face)) for face in FACES)


def measurement() -> bytes:
    """Return the tables of a measured reflectance, in the fewest numbers."""
    from wrt.io.measured.measurement import save_measurement
    from wrt.scene.materials import Measured

    file = io.BytesIO()
    save_measurement(file, Measured.example().measurement)
    return file.getvalue()


def strips() -> bytes:
    """Return a PLY of triangle strips."""
    head = "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    return (head + "0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 2 0\n1 2 1\n7 0 1 2 3 -1 4 5\n").encode()


def stl() -> dict[str, bytes]:
    """Return the box as a binary and as a text STL."""
    corners = VERTICES[FACES]
    binary = b"a box".ljust(80) + struct.pack("<I", len(corners))
    binary += b"".join(struct.pack("<12fH", 0, 0, 0, *c.ravel(), 0) for c in corners)
    text = "solid box\n"
    for triangle in corners[:4]:
        rows = "".join(f"vertex {x:g} {y:g} {z:g}\n" for x, y, z in triangle)
        text += f"facet normal 0 0 0\nouter loop\n{rows}endloop\nendfacet\n"
    return {"box.stl": binary, "text.stl": (text + "endsolid box\n").encode()}


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
    if not binary:
        return text
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


THREEMF = """\
<?xml version="1.0"?>
<model unit="millimeter" xmlns:m="m" xmlns:p="p"><resources>
<m:texture2d id="5" path="/3D/Textures/colors.png" contenttype="image/png"/>
<m:texture2dgroup id="6" texid="5"><m:tex2coord u="0" v="0"/><m:tex2coord u="1" v="0.5"/></m:texture2dgroup>
<m:colorgroup id="2"><m:color color="#FF0000"/><m:color color="#00FF0080"/></m:colorgroup>
<basematerials id="3"><base name="a" displaycolor="#FFFFFF"/><base name="b" displaycolor="#102030FF"/></basematerials>
<m:compositematerials id="4" matid="3" matindices="0 1"><m:composite values="0.25 0.75"/></m:compositematerials>
<object id="1" pid="3" pindex="1"><mesh>
<vertices><vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/><vertex x="1" y="1" z="0"/><vertex x="0" y="1" z="0"/>
</vertices>
<triangles><triangle v1="0" v2="1" v3="2" pid="2" p1="0" p2="1" p3="0"/><triangle v1="0" v2="2" v3="3" pid="6" p1="0"/>
<triangle v1="0" v2="3" v3="2" pid="4" p1="0"/></triangles></mesh></object>
<object id="7"><components><component objectid="1" transform="1 0 0 0 1 0 0 0 1 2 0 0"/>
<component p:path="/3D/other.model" objectid="1"/></components></object>
</resources><build><item objectid="1"/><item objectid="7" transform="2 0 0 0 2 0 0 0 2 0 0 5"/></build></model>
"""
THREEMF_PART = """\
<model unit="millimeter"><resources><object id="1"><mesh><vertices><vertex x="0" y="0" z="1"/>
<vertex x="1" y="0" z="1"/><vertex x="1" y="1" z="1"/></vertices>
<triangles><triangle v1="0" v2="1" v3="2"/></triangles></mesh></object>
</resources><build/></model>
"""


def threemf(image: bytes) -> bytes:
    """Return a 3MF archive of two parts, with colours, a texture, a mixture and components."""
    held = io.BytesIO()
    parts = {"3D/3dmodel.model": THREEMF, "3D/other.model": THREEMF_PART, "3D/Textures/colors.png": image}
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in parts.items():
            archive.writestr(zipfile.ZipInfo(name), data)
    return held.getvalue()


def main() -> None:
    """Write every file."""
    from PIL import Image

    import wrt
    from wrt.rendering.checkpoint import write_checkpoint

    SEEDS.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(1)
    rgba = rng.integers(0, 256, (6, 8, 4), np.uint8)
    Image.fromarray(rgba).save(SEEDS / "colors.png")
    Image.fromarray(rgba[..., 0]).save(SEEDS / "grey.png")
    Image.fromarray(rgba[..., 0]).convert("P").save(SEEDS / "palette.png")
    Image.fromarray(rgba[..., 2:]).save(SEEDS / "grey-alpha.png")
    Image.fromarray(rgba[..., 0] > 100).save(SEEDS / "bits.png")
    Image.fromarray(rng.integers(0, 65536, (4, 4), np.uint16)).save(SEEDS / "deep.png")
    Image.fromarray(rgba[..., :3]).save(SEEDS / "photo.jpg", quality=50)
    Image.fromarray(rgba[..., :3]).save(SEEDS / "raw.bmp")
    radiance = rng.random((8, 16, 3), np.float32) * 3
    wrt.save_image(SEEDS / "light.exr", radiance)
    wrt.save_image(SEEDS / "light.npy", radiance[:4, :4])
    mantissas = np.minimum(radiance * 64, 255).astype(np.uint8)
    pixels = np.concatenate([mantissas, np.full((8, 16, 1), 130, np.uint8)], axis=2)
    flat = b"".join(row.tobytes() for row in pixels)
    write("sky.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X 16\n" + flat)
    runs = b"".join(
        bytes([2, 2, 0, 16]) + b"".join(bytes([16]) + row[:, k].tobytes() for k in range(4)) for row in pixels
    )
    write("runs.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X 16\n" + runs)
    write("grey.bsdf", measurement())
    write("textured.obj", OBJ_TEXTURED)
    write("polygons.obj", OBJ_POLYGONS)
    write("paints.mtl", MTL)
    for name, format_name in (("text", "ascii"), ("little", "binary_little_endian"), ("big", "binary_big_endian")):
        write(f"{name}.ply", ply(format_name))
    write("strips.ply", strips())
    for name, data in stl().items():
        write(name, data)
    rows = [" ".join(f"{x:g}" for x in v) for v in VERTICES] + [f"3 {a} {b} {c}" for a, b, c in FACES]
    write("box.off", "OFF\n8 12 0\n" + "\n".join(rows) + "\n")
    write("quads.off", "OFF # comment\n8 2 0\n" + "\n".join(rows[:8]) + "\n4 0 1 3 2\n4 4 5 7 6\n")
    image = (SEEDS / "colors.png").read_bytes()
    write("scene.gltf", gltf(image, binary=False))
    write("scene.glb", gltf(image, binary=True))
    write("parts.3mf", threemf(image))
    write("nodes.dae", DAE)
    write("shapes.toml", TOML_SHAPES)
    write("sky.toml", TOML_SKY)
    write("plugins.xml", XML_SCENE)
    write("lamp.xml", XML_INCLUDED)
    np.savez(SEEDS / "box.npz", vertices=VERTICES, faces=FACES)
    np.savez_compressed(SEEDS / "packed.npz", vertices=VERTICES, faces=FACES, colors=VERTICES)
    count = np.full(12, 2, np.int32)
    arrays = {"total": rng.random((12, 3)), "total_of_squares": rng.random((12, 3)), "count": count, "rejected": count}
    write_checkpoint(SEEDS / "film.ckpt", {"wrt": "0", "width": 4, "height": 3, "seed": 0, "scene": {}}, arrays)


if __name__ == "__main__":
    main()
