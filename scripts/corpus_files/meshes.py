"""Files of meshes and their materials: OBJ, MTL, PLY, STL, OFF, 3MF."""

from __future__ import annotations

import io
import struct
import zipfile

import numpy as np

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


def files(image: bytes) -> dict[str, str | bytes]:
    """Return the content of each file by its name; a PNG image is what they hold as a texture."""
    rows = [" ".join(f"{x:g}" for x in v) for v in VERTICES] + [f"3 {a} {b} {c}" for a, b, c in FACES]
    return {
        "textured.obj": OBJ_TEXTURED,
        "polygons.obj": OBJ_POLYGONS,
        "paints.mtl": MTL,
        "text.ply": ply("ascii"),
        "little.ply": ply("binary_little_endian"),
        "big.ply": ply("binary_big_endian"),
        "strips.ply": strips(),
        **stl(),
        "box.off": "OFF\n8 12 0\n" + "\n".join(rows) + "\n",
        "quads.off": "OFF # comment\n8 2 0\n" + "\n".join(rows[:8]) + "\n4 0 1 3 2\n4 4 5 7 6\n",
        "parts.3mf": threemf(image),
    }


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


def threemf(image: bytes) -> bytes:
    """Return a 3MF archive of two parts, with colours, a texture, a mixture and components."""
    held = io.BytesIO()
    parts = {"3D/3dmodel.model": THREEMF, "3D/other.model": THREEMF_PART, "3D/Textures/colors.png": image}
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in parts.items():
            archive.writestr(zipfile.ZipInfo(name), data)
    return held.getvalue()
