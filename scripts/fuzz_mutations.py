"""Ways to damage a file: bytes, numbers, words, lines, trees of JSON, chunks of PNG, and what 3MF archives hold.

All randomness comes from one `random.Random`, so a seed identifies an input; Hypothesis passes its own.
"""

from __future__ import annotations

import io
import json
import re
import struct
import zipfile
import zlib
from collections.abc import Callable, Sequence
from random import Random
from typing import Any

_NUMBERS = """
0 -0 1 -1 2 0.5 -0.5 3 7 1e-45 1e-30 1e-12 1e12 1e20 1e38 3.5e38 1e39 -1e39 1e308 1e400 nan -nan inf -inf +inf
255 256 65535 65536 100000 2147483647 2147483648 -2147483649 4294967295 4294967296 1099511627776
9223372036854775807 9223372036854775808 18446744073709551616 99999999999999999999999999
x 0x10 1_000 1,5 1/0 ٣ ½ --1 1e . 1.2.3
"""
NUMBERS = (*_NUMBERS.split(), "")
"""Replacements of numbers in text."""

_VALUES = r"""
-1 0 1 1e400 inf nan -inf 1e30 1e-30 2147483648 10 9223372036854775808 true 1979-05-27 100000
"" "x" "../../../../etc/passwd" "/dev/zero" "." "\u0000" "vertex-colors" [] {} [[]] [{}] [1,2] [1,2,3] [1,2,3,4]
["a","b","c"] [nan,inf,0] [1e39,1e39,1e39] {a=1} {texture="colors.png"} {texture="missing.png"}
"""
TOML_VALUES = (*_VALUES.split(), "[" * 300 + "]" * 300, "{ a = " * 300 + "1" + " }" * 300, "9" * 5000)
"""Replacements of values in scene files."""

JSON_VALUES = (
    *(None, True, -1, 0, 1, 2, 0.5, 255, 5121, 5125, 5126, 65536, 2**31, 2**32, 2**40, 2**63, -(2**31), 10**400, 1e39),
    *(float("nan"), float("inf"), "", "x", "SCALAR", "VEC2", "VEC3", "MAT4", "data:,", "data:;base64,AA", "/dev/zero"),
    *("../../../../etc/passwd", "colors.png", "missing.png", "scene.glb", [], {}, [[]], [{}], [0], [0, 0]),
    *([1e39, 0, 0], [float("nan")] * 3, [0] * 16, [0] * 100),
)
"""Replacements of values in glTF files."""

_NUMBER = re.compile(rb"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_WORD = re.compile(rb"[A-Za-z_][\w.-]*")
_TOML_LINE = re.compile(rb"^(\s*)([\w-]+)(\s*=\s*)(.*)$", re.MULTILINE)
_XML_TEXT = re.compile(rb'(?<=")[^"]*(?=")')
_XML_TAG = re.compile(rb"<[^<>]*>")
_XML_TAGS = (
    b'<include filename="input.xml"/>',
    b'<include filename="../../../../etc/passwd"/>',
    b'<include filename="/dev/zero"/>',
    b'<!DOCTYPE a [<!ENTITY b "bbbbbbbbbb"><!ENTITY c "&b;&b;&b;&b;">]>',
    b'<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]>',
    b"&b;",
    b"<![CDATA[",
    b"<!--",
    b'<default name="n" value="$n$n$n"/>',
    b'<ref id="x"/>',
    b"<x>" * 2000,
    b'<default name="n" value="' + b"n" * 300 + b'"/>' + b'<default name="n" value="$n$n$n$n"/>' * 2,
    *(b'<default name="n%d" value="%s"/>' % (i, (b"$n%d" % (i - 1)) * 10 if i else b"n" * 10) for i in range(8)),
    b'<shape type="merge" id="m">' + b'<ref id="s"/>' * 300 + b"</shape>",
    b'<shape type="cube" id="s"/>',
    b'<ref id="m"/>' * 300,
    b'<shape type="shapegroup" id="g">' + b'<shape type="cube"/>' * 300 + b"</shape>",
    b'<shape type="instance"><ref id="g"/></shape>' * 300,
    b'<shape type="sphere"/>' * 300,
    b'<medium type="homogeneous" name="exterior"/><medium type="homogeneous" name="interior"/>',
)


def mutate(rng: Random, kind: str, data: bytes, siblings: Sequence[bytes]) -> bytes:
    """Return a file with one to eight damages.

    Args:
        rng: where all choices come from.
        kind: the file's suffix, without its dot.
        data: the whole file.
        siblings: files of the same kind, for pieces to insert.
    """
    damages = _DAMAGES.get(kind, _BINARY)
    for _ in range(1 + int(min(rng.expovariate(0.7), 7.0))):
        data = rng.choice(damages)(rng, data, siblings)[:_LARGEST]
    return data


_LARGEST = 1 << 18


def _span(rng: Random, data: bytes) -> tuple[int, int]:
    start = rng.randint(0, len(data))
    return start, min(len(data), start + 2 ** rng.randint(0, 8))


def _flip(rng: Random, data: bytes, siblings: Sequence[bytes]) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.randint(1, 8) if changed else 0):
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _bytes(rng: Random, data: bytes, siblings: Sequence[bytes]) -> bytes:
    start, stop = _span(rng, data)
    fill = rng.choice([b"\0", b"\xff", b"\x80", b"\n", b" ", b"\x7f", bytes([rng.randrange(256)])])
    return data[:start] + fill * (stop - start) + data[stop:]


def _delete(rng: Random, data: bytes, siblings: Sequence[bytes]) -> bytes:
    start, stop = _span(rng, data)
    return data[:start] + data[stop:]


def _duplicate(rng: Random, data: bytes, siblings: Sequence[bytes]) -> bytes:
    start, stop = _span(rng, data)
    times = rng.choice([1, 1, 1, 2, 10, 1000])
    return data[:stop] + data[start:stop] * times + data[stop:]


def _truncate(rng: Random, data: bytes, siblings: Sequence[bytes]) -> bytes:
    return data[: rng.randint(0, len(data))]


def _splice(rng: Random, data: bytes, siblings: Sequence[bytes]) -> bytes:
    sibling = rng.choice(siblings)
    return data[: rng.randint(0, len(data))] + sibling[rng.randint(0, len(sibling)) :]


def _insert(rng: Random, data: bytes, siblings: Sequence[bytes]) -> bytes:
    start, stop = _span(rng, sibling := rng.choice(siblings))
    place = rng.randint(0, len(data))
    return data[:place] + sibling[start:stop] + data[place:]


def _packed(rng: Random, data: bytes, siblings: Sequence[bytes]) -> bytes:
    """Overwrite bytes with a number of some width."""
    form = rng.choice(["<H", ">H", "<I", ">I", "<q", ">q", "<f", ">f", "<d", ">d"])
    if form[1] in "fd":
        number: float = rng.choice([float("nan"), float("inf"), -1.0, 0.0, 1e38, 1e-45, -0.0])
    else:
        bits = 8 * struct.calcsize(form) - (form[1] == "q")
        number = min(max(rng.choice([0, 1, 2, 3, 2**15, 2**24, 2**31, 2**40, 2**bits - 1, 2**bits]), 0), 2**bits - 1)
    place = rng.randint(0, max(len(data) - struct.calcsize(form), 0))
    return data[:place] + struct.pack(form, number) + data[place + struct.calcsize(form) :]


def _number(rng: Random, data: bytes, siblings: Sequence[bytes]) -> bytes:
    return _replaced(rng, data, _NUMBER, lambda _: rng.choice(NUMBERS).encode())


def _word(rng: Random, data: bytes, siblings: Sequence[bytes]) -> bytes:
    words = _WORD.findall(rng.choice(siblings)) or [b""]
    return _replaced(rng, data, _WORD, lambda _: rng.choice(words))


def _lines(rng: Random, data: bytes, siblings: Sequence[bytes]) -> bytes:
    lines = data.split(b"\n")
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    action = rng.choice(("delete", "copy", "swap", "cut"))
    if action == "delete":
        del lines[i]
    elif action == "copy":
        lines.insert(j, lines[i])
    elif action == "swap":
        lines[i], lines[j] = lines[j], lines[i]
    else:
        lines[i] = lines[i][: rng.randint(0, len(lines[i]))]
    return b"\n".join(lines)


def _replaced(rng: Random, data: bytes, pattern: re.Pattern[bytes], make: Callable[[bytes], bytes]) -> bytes:
    found = list(pattern.finditer(data))
    if not found:
        return data
    match = rng.choice(found)
    return data[: match.start()] + make(match.group()) + data[match.end() :]


def _toml_value(rng: Random, data: bytes, siblings: Sequence[bytes]) -> bytes:
    found = list(_TOML_LINE.finditer(data))
    if not found:
        return data
    match = rng.choice(found)
    value = rng.choice(TOML_VALUES).encode()
    if rng.random() < 0.2:  # the value of another key
        value = rng.choice(found).group(4)
    key = rng.choice(found).group(2) if rng.random() < 0.2 else match.group(2)
    line = match.group(1) + key + match.group(3) + value
    return data[: match.start()] + line + data[match.end() :]


def _toml_table(rng: Random, data: bytes, siblings: Sequence[bytes]) -> bytes:
    """Repeat a table many times, or give a key many dotted parts."""
    if rng.random() < 0.5:
        tables = re.split(rb"(?m)^(?=\[)", data)
        i = rng.randrange(len(tables))
        return b"".join([*tables[:i], tables[i] * rng.choice([2, 30, 1000]), *tables[i + 1 :]])
    parts = rng.choice([2, 60, 300, 20000])
    return _replaced(rng, data, _TOML_LINE, lambda line: b".".join([b"a"] * parts) + b"." + line.lstrip())


def _bom(rng: Random, data: bytes, siblings: Sequence[bytes]) -> bytes:
    """Encode text as editors on Windows do: with a byte-order mark, perhaps in UTF-16."""
    if rng.random() < 0.5:
        return b"\xef\xbb\xbf" + data
    return data.decode("utf-8", "replace").encode("utf-16")


def _xml_text(rng: Random, data: bytes, siblings: Sequence[bytes]) -> bytes:
    words = [word for sibling in siblings for word in _XML_TEXT.findall(sibling)] + [n.encode() for n in NUMBERS]
    return _replaced(rng, data, _XML_TEXT, lambda _: rng.choice(words))


def _xml_tag(rng: Random, data: bytes, siblings: Sequence[bytes]) -> bytes:
    tags = _XML_TAG.findall(rng.choice(siblings)) + list(_XML_TAGS)
    return _replaced(rng, data, _XML_TAG, lambda old: rng.choice([b"", old + old, old + rng.choice(tags)]))


def _json(rng: Random, data: bytes, siblings: Sequence[bytes]) -> bytes:
    """Change the JSON tree of a glTF or GLB file; a GLB's lengths are corrected or not."""
    binary = data[:4] == b"glTF"
    size = int.from_bytes(data[12:16], "little")
    text, buffer = (data[20 : 20 + size], data[20 + size :]) if binary else (data, b"")
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError):
        return data
    _change(rng, tree)
    text = json.dumps(tree).encode()
    if not binary:
        return text
    text += b" " * (-len(text) % 4)
    wrong = rng.choice([0, 0, 0, 0, 0, 0, 4, -4, 2**31])
    chunk = struct.pack("<I", (len(text) + wrong) % 2**32) + data[16:20] + text + buffer
    return data[:8] + struct.pack("<I", 12 + len(chunk)) + chunk


def _change(rng: Random, tree: Any) -> None:
    """Replace, delete, copy or rename something in a tree of lists and dictionaries."""
    places: list[tuple[Any, Any]] = []
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        if not isinstance(node, (dict, list)):
            continue
        keys = list(node) if isinstance(node, dict) else list(range(len(node)))
        places += [(node, key) for key in keys]
        waiting += [node[key] for key in keys]
    if not places:
        return
    node, key = rng.choice(places)
    action = rng.choice(("delete", "copy", "rename", "repeat", "replace", "replace"))
    if action == "delete":
        del node[key]
    elif action == "copy":
        source, source_key = rng.choice(places)
        node[key] = json.loads(json.dumps(source[source_key]))
    elif action == "rename" and isinstance(node, dict):
        node[str(rng.choice(places)[1])] = node.pop(key)
    elif action == "repeat" and isinstance(node[key], list):
        node[key] += node[key] * rng.choice([1, 10, 1000])
    else:
        node[key] = rng.choice(JSON_VALUES)


def _png_size(rng: Random, data: bytes, siblings: Sequence[bytes]) -> bytes:
    """Change width, height, bit depth and colour type of a PNG and make it black: a few bytes for many pixels."""
    formats = [(1, 0), (8, 0), (16, 0), (8, 2), (16, 2), (1, 3), (8, 3), (8, 4), (16, 4), (8, 6), (16, 6)]
    bits, colors = rng.choice(formats)
    width, height = (rng.choice([1, 7, 300, 4096, 16384, 2**20, 2**24]) for _ in range(2))
    row = 1 + width * bits * {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}[colors] // 8
    size = min(row * height, 2**26)
    header = struct.pack(">IIBBBBB", width, height, bits, colors, 0, 0, rng.randrange(2))
    palette = [(b"PLTE", bytes(3)), (b"tRNS", b"\0")] if colors == 3 else []
    pixels = zlib.compress(bytes(size), 9)
    return data[:8] + _png_chunks([(b"IHDR", header), *palette, (b"IDAT", pixels), (b"IEND", b"")])


def _png_chunks(chunks: Sequence[tuple[bytes, bytes]]) -> bytes:
    """Return chunks of a PNG, of name and content each, with check sums that fit."""
    return b"".join(struct.pack(">I", len(c)) + n + c + struct.pack(">I", zlib.crc32(n + c)) for n, c in chunks)


def _json_copies(rng: Random, data: bytes, siblings: Sequence[bytes]) -> bytes:
    """Make many primitives, meshes, nodes or images of a text glTF file share the same data."""
    try:
        tree = json.loads(data)
        times = rng.choice([10, 300, 3000])
        if rng.random() < 0.5:
            for mesh in tree["meshes"]:
                mesh["primitives"] *= times
        else:
            nodes = [{"mesh": k % len(tree["meshes"])} for k in range(times)]
            tree.update(nodes=nodes, scenes=[{"nodes": list(range(times))}], scene=0)
        if rng.random() < 0.3:
            for accessor in tree["accessors"]:
                accessor["count"] *= rng.choice([1, 1000, 10**6])
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return data
    return json.dumps(tree).encode()


def _png_chunk(rng: Random, data: bytes, siblings: Sequence[bytes]) -> bytes:
    """Change a chunk of a PNG and make its check sum fit."""
    chunks, place = [], 8
    while place + 12 <= len(data):
        size = int.from_bytes(data[place : place + 4], "big")
        chunks.append((data[place + 4 : place + 8], data[place + 8 : place + 8 + size]))
        place += 12 + size
    if not chunks:
        return data
    i = rng.randrange(len(chunks))
    name, content = chunks[i]
    chunks[i] = (name, rng.choice([_flip, _packed, _bytes, _truncate, _duplicate])(rng, content, siblings))
    return data[:8] + _png_chunks(chunks)


_BINARY = (_flip, _bytes, _delete, _duplicate, _truncate, _splice, _insert, _packed, _packed)
_TEXT = (*_BINARY[:7], _number, _number, _number, _word, _lines, _lines)
_MIXED = (*_BINARY, _number, _word, _lines)


def _member(rng: Random, data: bytes, siblings: Sequence[bytes]) -> bytes:
    """Damage a file within a ZIP archive as one of its kind, and write an archive with it."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = {info: archive.read(info) for info in archive.infolist()}
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, ValueError, NotImplementedError, RuntimeError):
        return data
    # Models matter more than images.
    places = [info for info in members for _ in range(1 if info.filename.endswith(".png") else 2)]
    if not places:
        return data
    place = rng.choice(places)
    kind = place.filename.rpartition(".")[2]
    damages = _DAMAGES[kind if kind in ("png", "npy", "usda", "usdc") else "xml"]
    members[place] = rng.choice(damages)(rng, members[place], (members[place],))
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w") as archive:
        for info, content in members.items():
            archive.writestr(zipfile.ZipInfo(info.filename), content, info.compress_type)
    return written.getvalue()


_DAMAGES = {
    **dict.fromkeys(("3mf", "npz", "ckpt", "wrt", "usdz"), (*_BINARY, *(_member,) * 20)),
    **dict.fromkeys(("obj", "mtl", "off", "usda", "txt"), (*_TEXT, _bom)),
    "usdc": _BINARY,
    **dict.fromkeys(("ply", "stl", "hdr", "npy"), _MIXED),
    **dict.fromkeys(("gltf", "json"), (*_TEXT, *(_json,) * 12, _json_copies, _bom)),
    "glb": (*_BINARY, *(_json,) * 10),
    "toml": (*_TEXT, *(_toml_value,) * 12, _toml_table, _toml_table, _bom),
    **dict.fromkeys(("dae", "xml"), (*_TEXT, *(_xml_text, _xml_tag) * 5, _bom)),
    "png": (*_BINARY, *(_png_chunk,) * 5, _png_size, _png_size),
}
