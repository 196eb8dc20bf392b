"""An independent reader and ray caster of unlit glTF files, which uses nothing of wrt.

Khronos Group 2021, "glTF 2.0 Specification"; KHR_materials_unlit: the colour is the base colour, which is the vertex
colour times the factor times the texture. Slow: every ray meets every triangle.
"""

from __future__ import annotations

import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

Array = NDArray[np.float64]

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_SIZES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


Window = tuple[int, int, tuple[int, int, int, int]]
"""Width and height of a picture, and what of it is looked at: first column and row, and those after the last."""


def srgb_to_linear(codes: NDArray[Any]) -> Array:
    """IEC 61966-2-1."""
    c = np.asarray(codes, np.float64)
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(value: Array) -> Array:
    v = np.clip(value, 0.0, 1.0)
    return np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1.0 / 2.4) - 0.055)


def split(path: Path) -> tuple[dict[str, Any], bytes]:
    """Return the JSON and the binary chunk of a GLB file (section 4.4)."""
    data = path.read_bytes()
    size = int.from_bytes(data[12:16], "little")
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def joined(tree: dict[str, Any], binary: bytes) -> bytes:
    """Return the GLB of a JSON and a binary chunk."""
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    binary += bytes(-len(binary) % 4)
    parts = [b"glTF", (2).to_bytes(4, "little"), (28 + len(text) + len(binary)).to_bytes(4, "little")]
    parts += [len(text).to_bytes(4, "little"), b"JSON", text, len(binary).to_bytes(4, "little"), b"BIN\0", binary]
    return b"".join(parts)


@dataclass
class Seen:
    """Triangles of one material, in the world."""

    corners: Array  # (T, 3, 3)
    uvs: Array  # (T, 3, 2), v down
    colors: Array  # (T, 3, 4), of the vertices times the factor
    image: Array  # (H, W, 4), linear
    cutoff: float | None
    blend: bool


class Reference:
    """A GLB file of which every primitive has a texture and coordinates, if any of floating-point numbers."""

    def __init__(self, path: Path) -> None:
        self.tree, self.binary = split(path)
        self.seen: list[Seen] = []
        roots = self.tree["scenes"][self.tree.get("scene", 0)]["nodes"]
        for root in roots:
            self._visit(self.tree["nodes"][root], np.eye(4))

    def _visit(self, node: dict[str, Any], above: Array) -> None:
        world = above @ np.array(node.get("matrix", np.eye(4).ravel()), np.float64).reshape(4, 4).T
        if "mesh" in node:
            for primitive in self.tree["meshes"][node["mesh"]]["primitives"]:
                self._add(primitive, world)
        if "camera" in node:
            self.view, self.fov = world, self.tree["cameras"][node["camera"]]["perspective"]["yfov"]
        for child in node.get("children", []):
            self._visit(self.tree["nodes"][child], world)

    def _accessor(self, number: int) -> NDArray[Any]:
        accessor = self.tree["accessors"][number]
        view = self.tree["bufferViews"][accessor["bufferView"]]
        kind, width = np.dtype(_TYPES[accessor["componentType"]]), _SIZES[accessor["type"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        strides = (view.get("byteStride", kind.itemsize * width), kind.itemsize)
        return np.ndarray((accessor["count"], width), kind, self.binary, start, strides)

    def _add(self, primitive: dict[str, Any], world: Array) -> None:
        attributes = primitive["attributes"]
        points = self._accessor(attributes["POSITION"]) @ world[:3, :3].T + world[:3, 3]
        faces = self._accessor(primitive["indices"]).reshape(-1, 3)
        material = self.tree["materials"][primitive["material"]]
        info = material["pbrMetallicRoughness"]["baseColorTexture"]
        image = self.tree["images"][self.tree["textures"][info["index"]]["source"]]
        view = self.tree["bufferViews"][image["bufferView"]]
        start = view.get("byteOffset", 0)
        codes = Image.open(io.BytesIO(self.binary[start : start + view["byteLength"]])).convert("RGBA")
        color = np.asarray(codes, np.float64) / 255.0
        color[..., :3] = srgb_to_linear(color[..., :3])
        mode = material.get("alphaMode", "OPAQUE")
        cutoff = material.get("alphaCutoff", 0.5) if mode == "MASK" else None
        uvs = self._accessor(attributes[f"TEXCOORD_{info.get('texCoord', 0)}"]).astype(np.float64)
        colors = np.ones((len(points), 4)) * material["pbrMetallicRoughness"].get("baseColorFactor", (1.0,) * 4)
        if "COLOR_0" in attributes:
            own = self._accessor(attributes["COLOR_0"])
            colors *= own / (1.0 if own.dtype.kind == "f" else np.iinfo(own.dtype).max)
        self.seen.append(Seen(points[faces], uvs[faces], colors[faces], color, cutoff, mode == "BLEND"))

    def rays(self, window: Window, shift: tuple[float, float]) -> tuple[Array, Array]:
        """Return the origin and the directions through points of a window's pixels, `shift` from their centres."""
        width, height, (x0, y0, x1, y1) = window
        x = (2.0 * (np.arange(x0, x1) + 0.5 + shift[0]) / width - 1.0) * np.tan(self.fov / 2.0) * width / height
        y = (1.0 - 2.0 * (np.arange(y0, y1) + 0.5 + shift[1]) / height) * np.tan(self.fov / 2.0)
        local = np.stack([*np.meshgrid(x, y), np.full((y1 - y0, x1 - x0), -1.0)], axis=-1).reshape(-1, 3)
        return self.view[:3, 3], local @ self.view[:3, :3].T

    def picture(self, window: Window, shift: tuple[float, float] = (0.0, 0.0)) -> tuple[Array, NDArray[Any]]:
        """Return the (H, W, 3) linear colours over black in a window, and where anything is seen at all.

        What lies in front covers what lies behind by its alpha ("over", Porter and Duff 1984).
        """
        origin, directions = self.rays(window, shift)
        hits: list[tuple[Array, Array]] = []  # distances and RGBA, of each triangle
        for seen in self.seen:
            for corners, uvs, colors in zip(seen.corners, seen.uvs, seen.colors, strict=True):
                t, w = _meet(origin, directions, corners)
                inside = np.isfinite(t)
                if not inside.any():
                    continue
                rgba = np.zeros((len(directions), 4))
                rgba[inside] = _bilinear(seen.image, w[inside] @ uvs) * (w[inside] @ colors)
                if seen.cutoff is not None:
                    rgba[:, 3] = np.where(rgba[:, 3] >= seen.cutoff, 1.0, 0.0)
                elif not seen.blend:
                    rgba[inside, 3] = 1.0
                hits.append((t, rgba))
        color, covered = _over(hits, len(directions))
        x0, y0, x1, y1 = window[2]
        return color.reshape(y1 - y0, x1 - x0, 3), covered.reshape(y1 - y0, x1 - x0)


def _meet(origin: Array, directions: Array, corners: Array) -> tuple[Array, Array]:
    """Return distances, infinite without a hit, and the barycentric coordinates (Möller and Trumbore 1997)."""
    a, e1, e2 = corners[0], corners[1] - corners[0], corners[2] - corners[0]
    p = np.cross(directions, e2)
    determinant = p @ e1
    with np.errstate(divide="ignore", invalid="ignore"):
        s = origin - a
        u = (p @ s) / determinant
        q = np.cross(s, e1)
        v = (directions @ q) / determinant
        t = (q @ e2) / determinant
    good = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 0.0) & np.isfinite(t)
    return np.where(good, t, np.inf), np.stack([1.0 - u - v, u, v], axis=-1)


def _bilinear(pixels: Array, uv: Array) -> Array:
    """Return what a repeating texture has at coordinates whose origin is its upper left corner (section 3.8.4)."""
    height, width = pixels.shape[:2]
    x, y = uv[:, 0] * width - 0.5, uv[:, 1] * height - 0.5
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - left)[:, None], (y - top)[:, None]
    rows, columns = (top % height, (top + 1) % height), (left % width, (left + 1) % width)
    upper = pixels[rows[0], columns[0]] * (1 - fx) + pixels[rows[0], columns[1]] * fx
    lower = pixels[rows[1], columns[0]] * (1 - fx) + pixels[rows[1], columns[1]] * fx
    return np.asarray(upper * (1 - fy) + lower * fy)


def _over(hits: list[tuple[Array, Array]], count: int) -> tuple[Array, NDArray[Any]]:
    """Return the colours of rays over black, and which met anything."""
    color, left = np.zeros((count, 3)), np.ones(count)
    if not hits:
        return color, left == 0.0
    distances, layers = (np.stack(each) for each in zip(*hits, strict=True))
    for rank in np.argsort(distances, axis=0):
        rgba = layers[rank, np.arange(count)]
        color += (left * rgba[:, 3])[:, None] * rgba[:, :3]
        left = left * (1.0 - rgba[:, 3])
    return color, np.isfinite(distances).any(axis=0)
