"""What a file looks to be, whatever its name says: for messages about files that cannot be read as what they claim.

The first bytes are those that the formats' own specifications give, and that `file` looks at.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from wrt.errors import InputError
from wrt.files import read_file

HEAD = 4096
"""Bytes that are looked at."""

# A pattern for the beginning, what that is, the suffixes that such files have.
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
    (rb"PK\x03\x04", "a ZIP archive; unpack it", ()),
    (rb"\x1f\x8b|BZh|\xfd7zXZ\0|7z\xbc\xaf|\x28\xb5\x2f\xfd", "a compressed file; unpack it", ()),
    (rb"%PDF", "a PDF document", (".pdf",)),
    (rb"Kaydara FBX Binary", "an FBX file; export it as glTF", (".fbx",)),
    (rb"; FBX ", "an FBX file; export it as glTF", (".fbx",)),
    (rb"BLENDER", "a Blender file; export it as glTF", (".blend",)),
    (rb"version https://git-lfs", "a pointer of Git LFS, which stands for a file that has not been fetched", ()),
    (rb"glTF", "a GLB file", (".glb", ".gltf")),
    (rb"ply\r?\n", "a PLY file", (".ply",)),
    (rb"(ST)?C?N?4?n?OFF\s", "an OFF file", (".off",)),
    (rb"solid\b.*?\bfacet\s+normal\b", "an STL file", (".stl",)),
    (rb"<(!DOCTYPE )?html", "a web page", (".html", ".htm")),
    (rb"<(\?xml.*?<|!--.*?<)?scene\b", "a scene file of Mitsuba", (".xml",)),
    (rb"<\?xml.*?<COLLADA\b", "a COLLADA file; export it as glTF", (".dae",)),
    (rb"<\?xml", "an XML file", (".xml",)),
    (rb"\{.*?\"(asset|scenes|meshes|accessors|bufferViews|buffers)\"\s*:", "a glTF file", (".gltf", ".glb")),
    (rb"(v|vn|vt)[ \t]+[-+.\d]|(mtllib|usemtl|o|g)[ \t]", "an OBJ file", (".obj",)),
    (rb"newmtl\s", "the materials of an OBJ file", (".mtl",)),
    (rb"\[+(settings|camera|environment|lights|media|materials|shapes)\b", "a scene file", (".toml",)),
)

_RENDERED = ".glb", ".gltf", ".ply", ".off", ".stl", ".obj", ".npz", ".xml", ".toml"


def looks_like(data: bytes) -> tuple[str, tuple[str, ...]] | None:
    """Return what a file is that begins with `data`, and the suffixes of such files; None where nothing tells."""
    text = data[:HEAD].removeprefix(b"\xef\xbb\xbf").lstrip()
    while text.startswith(b"#"):
        text = text.partition(b"\n")[2].lstrip()
    for pattern, what, suffixes in _KINDS:
        if re.match(pattern, data, re.DOTALL) or re.match(pattern, text, re.DOTALL):
            return what, suffixes
    return None


def hint(path: Path) -> str | None:
    """Return what a file looks to be and what to do, None where that is what its suffix says, or nothing tells.

    Raises:
        InputError: where it cannot be read.
    """
    head = read_file(path, HEAD)
    found = looks_like(head)
    if found is None and path.stat().st_size == 84 + 50 * int.from_bytes(head[80:84], "little"):
        found = "a binary STL file", (".stl",)  # which may begin with anything
    if found is None:
        return None
    what, suffixes = found
    if path.suffix.lower() in suffixes:
        return (
            "it is an image, which a scene file can name as a texture or an environment" if " image" in what else None
        )
    return f"it looks to be {what}" + (
        f"; rename it to end in {suffixes[0]}" if suffixes and suffixes[0] in _RENDERED else ""
    )


@contextmanager
def hinting(path: Path) -> Iterator[None]:
    """Within the context, have an InputError about a file that is something else than its name says tell that."""
    try:
        yield
    except InputError:
        try:
            found = hint(path)
        except InputError:
            found = None
        if found is None:
            raise
        raise InputError(f"{path}: {found}") from None
