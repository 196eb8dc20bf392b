"""Binary files of glTF 2.0."""

from __future__ import annotations

import json
from typing import Any


def joined(tree: dict[str, Any], binary: bytes) -> bytes:
    """Return the GLB of a JSON and a binary chunk (Khronos Group 2021, "glTF 2.0 Specification", section 4.4)."""
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    binary += bytes(-len(binary) % 4)
    parts = [b"glTF", (2).to_bytes(4, "little"), (28 + len(text) + len(binary)).to_bytes(4, "little")]
    parts += [len(text).to_bytes(4, "little"), b"JSON", text, len(binary).to_bytes(4, "little"), b"BIN\0", binary]
    return b"".join(parts)
