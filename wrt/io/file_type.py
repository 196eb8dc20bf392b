"""The types of files that are rendered, by suffix, and the type of a file by its first bytes, for messages.

The signatures are those of the formats' specifications, as in the command `file`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from wrt.errors import InputError
from wrt.io.safe_read import read_file

GLTF_SUFFIXES = (".gltf", ".glb")
USD_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
ANIMATED_SUFFIXES = (*GLTF_SUFFIXES, *USD_SUFFIXES)  # suffixes of files that may be animated
STEP_SUFFIXES = (".step", ".stp")

ARRAYS_SUFFIX = ".npz"  # suffix of NumPy archives, whose meshes are not repaired

MESH_SUFFIXES = (
    *(".obj", ".ply", ".stl", ".off", *GLTF_SUFFIXES, ".3mf", ".dae"),
    *(*STEP_SUFFIXES, ARRAYS_SUFFIX, *USD_SUFFIXES),
)
"""Suffixes of mesh files, in lower or upper case."""

_TO_GLTF, _TO_PLY = "export it as glTF (.glb)", "reconstruct a surface of them, and save that as PLY"
_NOT_RENDERED = {
    ".fbx": f"an FBX file; {_TO_GLTF}",
    ".blend": f"a Blender file; in Blender, {_TO_GLTF}",
    ".max": f"a 3ds Max file; {_TO_GLTF} or USD",
    ".3ds": f"a 3D Studio file; {_TO_GLTF}, in Blender for example",
    ".skp": f"a SketchUp file; {_TO_GLTF} or COLLADA (.dae)",
    ".abc": f"an Alembic file; {_TO_GLTF} or USD",
    **dict.fromkeys((".ma", ".mb"), f"a Maya file; {_TO_GLTF} or USD"),
    ".c4d": f"a Cinema 4D file; {_TO_GLTF} or USD",
    ".pbrt": "a scene of pbrt; convert it to glTF or to a scene of Mitsuba",
    **dict.fromkeys((".wrl", ".x3d"), f"a VRML or X3D file; {_TO_GLTF}"),
    **dict.fromkeys((".igs", ".iges", ".sldprt", ".dwg", ".dxf"), "a CAD file; export it as STEP"),
    **dict.fromkeys((".las", ".laz", ".e57", ".xyz", ".pcd"), f"a file of points; {_TO_PLY}"),
    ".vdb": "an OpenVDB file; convert it to NanoVDB (.nvdb), which a scene file can name as a density",
    **dict.fromkeys((".nvdb", ".vol"), "a volume, which a scene file can name as a density"),
    ".bsdf": "a measured reflectance, which a scene file can name as a material",
    ".mtl": "the materials of an OBJ file; name that file",
    ".bin": "data of a glTF file; name the .gltf file",
    ".wrt": "a part of a picture; wrt merge makes the picture",
    ".ckpt": "a checkpoint; give it to --checkpoint with --resume, and name its scene",
}
"""What files of other types are and what to do, by suffix."""

HEAD = 4096  # bytes that are examined

# Pattern of the first bytes, type, suffixes of such files.
_KINDS: tuple[tuple[bytes, str, tuple[str, ...]], ...] = (
    (rb"\x89PNG\r\n", "a PNG image", (".png",)),
    (rb"\xff\xd8\xff", "a JPEG image", (".jpg", ".jpeg")),
    (rb"GIF8[79]a", "a GIF image", (".gif",)),
    (rb"II\*\0|MM\0\*", "a TIFF image", (".tif", ".tiff")),
    (rb"RIFF....WEBP", "a WebP image", (".webp",)),
    (rb"v/1\x01", "an OpenEXR image", (".exr",)),
    (rb"#\?(RADIANCE|RGBE)", "a Radiance HDR image", (".hdr", ".pic")),
    (rb"\x93NUMPY", "a NumPy array", (".npy",)),
    (rb"PK\x03\x04.{26}[^/]+\.npy", "a NumPy archive", (".npz",)),
    (rb"PK\x03\x04.{26}(3D|_rels|\[Content_Types)", "a 3MF file", (".3mf",)),
    (rb"PK\x03\x04.{26}[^/]+\.usd", "a USD archive", (".usdz",)),
    (rb"#usda 1\.", "a USD file", (".usda", ".usd")),
    (rb"PXR-USDC", "a USD file", (".usdc", ".usd")),
    (rb"ISO-10303-21;", "a STEP file", (".step", ".stp")),
    (rb"PK\x03\x04", "a ZIP archive", (".zip", ".zae")),
    (rb"\x1f\x8b", "a compressed file; rename it to end in its type and .gz", (".gz",)),
    (rb"BZh", "a compressed file; rename it to end in its type and .bz2", (".bz2",)),
    (rb"\xfd7zXZ\0|7z\xbc\xaf|\x28\xb5\x2f\xfd|Rar!", "a compressed file; unpack it", ()),
    (rb"%PDF", "a PDF document", (".pdf",)),
    (rb"Kaydara FBX Binary", "an FBX file; export it as glTF", ()),
    (rb"; FBX ", "an FBX file; export it as glTF", ()),
    (rb"BLENDER", "a Blender file; export it as glTF", ()),
    (rb"version https://git-lfs", "a Git LFS pointer to a file that has not been fetched", ()),
    (rb"glTF", "a GLB file", (".glb", ".gltf")),
    (rb"ply\r?\n", "a PLY file", (".ply",)),
    (rb"(ST)?C?N?4?n?OFF\s", "an OFF file", (".off",)),
    (rb"solid\b.*?\bfacet\s+normal\b", "an STL file", (".stl",)),
    (rb"<(!DOCTYPE )?html", "a web page", (".html", ".htm")),
    (rb"<\?xml.*?<COLLADA\b", "a COLLADA file", (".dae",)),
    (rb"<(\?xml.*?<|!--.*?<)?scene\b", "a scene file of Mitsuba", (".xml",)),
    (rb"<\?xml", "an XML file", (".xml",)),
    (rb"\{.*?\"(asset|scenes|meshes|accessors|bufferViews|buffers)\"\s*:", "a glTF file", (".gltf", ".glb")),
    (rb"(v|vn|vt)[ \t]+[-+.\d]|(mtllib|usemtl|o|g)[ \t]", "an OBJ file", (".obj",)),
    (
        rb"P(\s+[-+.\d]\S*){6}\s|p.{3,24}\0",
        "a surface of MNI's neuroimaging tools; convert it to PLY or Wavefront OBJ",
        (),
    ),
    (rb"newmtl\s", "the materials of an OBJ file", (".mtl",)),
    (rb"\[+(settings|camera|environment|lights|media|materials|shapes)\b", "a scene file", (".toml",)),
)

_RENDERED = (
    *(".glb", ".gltf", ".ply", ".off", ".stl", ".obj", ".3mf", ".dae", ".step"),
    *(".npz", ".xml", ".toml", ".usda", ".usdc", ".usdz", ".zip"),
)


def looks_like(data: bytes) -> tuple[str, tuple[str, ...]] | None:
    """Return the type of a file that begins with `data`, and the suffixes of such files; None if unknown."""
    text = data[:HEAD].removeprefix(b"\xef\xbb\xbf").lstrip()
    while text.startswith(b"#"):
        text = text.partition(b"\n")[2].lstrip()
    for pattern, what, suffixes in _KINDS:
        if re.match(pattern, data, re.DOTALL) or re.match(pattern, text, re.DOTALL):
            return what, suffixes
    return None


def hint(path: Path) -> str | None:
    """Return a hint at the type of a file and what to do; None if the type fits the suffix, or is unknown."""
    head = read_file(path, HEAD)
    found = looks_like(head)
    if found is None and path.stat().st_size == 84 + 50 * int.from_bytes(head[80:84], "little"):
        found = "a binary STL file", (".stl",)  # its header may begin with anything
    if found is None:
        return None
    what, suffixes = found
    if path.suffix.lower() not in suffixes:
        advice = f"; rename it to end in {suffixes[0]}" if suffixes and suffixes[0] in _RENDERED else ""
        return f"it looks to be {what}{advice}"
    return "it is an image, which a scene file can name as a texture or an environment" if " image" in what else None


def advice_on(path: Path) -> str | None:
    """Return what a file that is not rendered is and what to do; None if that is unknown."""
    kind = _NOT_RENDERED.get(path.suffix.lower())
    return f"it is {kind}" if kind else hint(path)


def renderable(folder: Path, files: Iterable[Path]) -> tuple[list[str], list[str]]:
    """Return the names of those files in a folder that can be rendered: the scenes and the meshes."""
    scenes: list[str] = []
    meshes: list[str] = []
    for file in sorted(each for each in files if each.is_file()):
        name, suffix = str(file.relative_to(folder)), file.suffix.lower()
        if name.startswith("__MACOSX/") or file.name.startswith("."):  # what macOS adds to archives
            continue
        if suffix in MESH_SUFFIXES:
            meshes.append(name)
        elif suffix in (".xml", ".toml"):
            with suppress(InputError):
                if (found := looks_like(read_file(file, HEAD))) and "scene file" in found[0]:
                    scenes.append(name)
    return scenes, meshes


@contextmanager
def hinting(path: Path) -> Iterator[None]:
    """Within the context, replace an InputError about a file with a wrong suffix by a hint at its type."""
    try:
        yield
    except InputError:
        advice = None
        with suppress(InputError):
            advice = hint(path)
        if advice is None:
            raise
        raise InputError(f"{path}: {advice}") from None
