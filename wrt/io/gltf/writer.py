"""Writing GLB files: geometry, materials, cameras and lights of a scene, as far as glTF holds them.

Format: Khronos Group 2021, "glTF 2.0 Specification". One warning names what it cannot hold.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, warn
from wrt.io.gltf.buffers import Tree
from wrt.io.gltf.nearest import nearest
from wrt.io.gltf.written_materials import Store, WrittenMaterials
from wrt.io.safe_read import PathLike
from wrt.io.safe_write import Kind, require_writable, write_atomically
from wrt.linalg import norm
from wrt.scene import shapes
from wrt.scene.camera import Camera, OrthographicCamera, PerspectiveCamera
from wrt.scene.exact.analytic import Analytic
from wrt.scene.exact.quadrics import disk
from wrt.scene.lights import (
    DirectionalLight,
    DiskLight,
    Light,
    PointLight,
    RectangleLight,
    SphereLight,
    SpotLight,
)
from wrt.scene.materials import Diffuse, Null
from wrt.scene.mesh import Mesh
from wrt.scene.motion import Motion
from wrt.scene.scene import Scene, Shape
from wrt.scene.textures import ColorSource, ImageTexture, VertexColor, shines

GLB_SUFFIX = ".glb"
_FLOAT, _UNSIGNED = 5126, 5125
_NEAR = 0.01

GLB = Kind("", lambda _: False)
"""A GLB file, which a person may have made by other means."""


def save_glb(path: PathLike, scene: Scene, *, force: bool = False) -> None:
    """Write a GLB file.

    Args:
        path: ends in .glb.
        scene: the scene; a moving one as it is when the shutter opens.
        force: whether to replace an existing file.

    Raises:
        InputError: where it cannot be written.
    """
    file = Path(path)
    require_writable(file, GLB, force=force)
    writer = _Writer()
    data = writer.glb(scene)
    if writer.notes:
        warn(f"{file}: glTF cannot hold {'; '.join(writer.notes)}")
    write_atomically(file, lambda temporary: temporary.write_bytes(data), GLB, force=force)


class _Writer(Store):
    """Collects the content of a file; shared objects are written once."""

    def __init__(self) -> None:
        super().__init__()
        self._accessors: dict[tuple[int, str], int] = {}
        self._owners: list[Any] = []  # whose ids are keys
        self._materials = WrittenMaterials(self)

    def glb(self, scene: Scene) -> bytes:
        """Return the content of the file."""
        nodes: list[Tree] = []
        time = 0.0 if scene.camera is None else scene.camera.shutter_open
        for shape in [*scene.shapes, *(shape for light in scene.lights for shape in self._shapes_of(light))]:
            if isinstance(shape.material, Null):
                self.note("boundaries of media without a surface")
            else:
                nodes.append(self._node(shape, time))
        for light in scene.lights:
            nodes += self._light(light)
        punctual = "KHR_lights_punctual" in self.tree.get("extensions", {})
        any_shines = any("emissiveFactor" in material for material in self.tree.get("materials", []))
        if any_shines and not punctual and scene.environment is None:
            # A black lamp, as wrt and other programs light scenes that have no lamp; here meshes give the light.
            nodes.append(self._placed_light({"type": "point", "intensity": 0.0}, (0.0, 0.0, 0.0), (0.0, 0.0, -1.0)))
        if scene.camera is not None:
            # Readers take the first camera.
            cameras = sorted(scene.cameras.items(), key=lambda each: each[1] is not scene.camera)
            if not cameras or cameras[0][1] is not scene.camera:
                cameras.insert(0, ("camera", scene.camera))
            for name, camera in cameras:
                nodes += self._camera(name, camera, scene.settings.width / scene.settings.height)
        if scene.environment is not None:
            self.note("the environment")
        if scene.medium is not None:
            self.note("the medium around all")
        if any(shape.shadow_catcher for shape in scene.shapes):
            self.note("shadow catchers, which are ordinary surfaces there")
        self.tree |= {"scenes": [{"nodes": list(range(len(nodes)))}], "nodes": nodes}
        used = sorted(_extensions(self.tree))
        if used:
            self.tree["extensionsUsed"] = used
        self.tree["buffers"] = [{"byteLength": len(self.data)}]
        return _packed(self.tree, bytes(self.data))

    def _accessor(self, owner: Any, name: str, array: NDArray[Any]) -> int:
        """Return the number of an array of an object, which is written once."""
        key = id(owner), name
        if key not in self._accessors:
            self._owners.append(owner)
            entry: Tree = {
                "bufferView": self.view(np.ascontiguousarray(array).tobytes()),
                "count": len(array),
                "componentType": _UNSIGNED if array.dtype == np.uint32 else _FLOAT,
                "type": "SCALAR" if array.ndim == 1 else f"VEC{array.shape[1]}",
            }
            if name == "POSITION":
                entry |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
            self._accessors[key] = self.append("accessors", entry)
        return self._accessors[key]

    # --- Shapes -------------------------------------------------------------------------------------

    def _node(self, shape: Shape, time: float) -> Tree:
        mesh = shape.mesh
        if shape.deformation is not None:
            self.note("changing meshes")
            mesh = shape.deformation.at(time, mesh)
        if isinstance(shape.transform, Motion):
            self.note("motion within the exposure")
        if isinstance(mesh, Analytic):
            self.note("exact shapes: meshes stand for them")
            mesh = mesh.tessellated()
        node: Tree = {"name": shape.name, "mesh": self.once("meshes", {"primitives": [self._primitive(shape, mesh)]})}
        if shape.transform is not None:
            node["matrix"] = shape.transform_at(time).T.reshape(-1).tolist()
        return node

    def _primitive(self, shape: Shape, mesh: Mesh) -> Tree:
        material = nearest(shape.material, self.note)
        two_sided = shape.two_sided_emission or (shape.double_sided and not shines(shape.emission))
        described = self._materials.described(material, shape.emission, two_sided=two_sided)
        if shape.material.name:
            described["name"] = shape.material.name
        attributes = {"POSITION": self._accessor(mesh, "POSITION", mesh.vertices)}
        if mesh.normals is not None:
            attributes["NORMAL"] = self._accessor(mesh, "NORMAL", _of_unit_length(mesh.normals))
        if mesh.tangents is not None and mesh.normals is not None and mesh.tangents.any(axis=1).all():
            unit = _of_unit_length(mesh.tangents[:, :3])
            tangents = np.column_stack([unit, np.copysign(np.float32(1.0), mesh.tangents[:, 3])])
            attributes["TANGENT"] = self._accessor(mesh, "TANGENT", tangents)
        if mesh.uvs is not None:
            for k in range(mesh.uvs.shape[1] // 2):
                flipped = mesh.uvs[:, 2 * k : 2 * k + 2] * (1.0, -1.0) + (0.0, 1.0)
                attributes[f"TEXCOORD_{k}"] = self._accessor(mesh, f"TEXCOORD_{k}", flipped.astype(np.float32))
        colored = _uses_vertex_colors(material.base_color, alpha=False)
        alpha = _uses_vertex_colors(material.opacity, alpha=True)
        if mesh.colors is not None and (colored or alpha):
            if alpha and not colored:
                self.note("the alpha of vertex colours without these")
            colors = mesh.colors if alpha else mesh.colors[:, :3]
            attributes["COLOR_0"] = self._accessor(mesh, f"COLOR_0 {alpha}", colors)
        return {
            "attributes": attributes,
            "indices": self._accessor(mesh, "indices", mesh.faces.astype(np.uint32).reshape(-1)),
            "material": self.once("materials", described),
        }

    def _shapes_of(self, light: Light) -> list[Shape]:
        """Return the shape of a light that has a surface, or none."""
        mesh: Mesh
        if isinstance(light, RectangleLight):
            mesh = shapes.quad(light.origin, light.edge_u, light.edge_v)
        elif isinstance(light, DiskLight):
            mesh = disk(light.center, light.normal, light.radius)
        elif isinstance(light, SphereLight):
            mesh = shapes.sphere(light.center, light.radius, exact=True)
        else:
            return []
        two_sided = bool(getattr(light, "two_sided", False))
        return [Shape(mesh, Diffuse(0.0), light.radiance, two_sided, name=light.name or light.type_name)]  # type: ignore[arg-type]

    # --- Lights and cameras -------------------------------------------------------------------------

    def _light(self, light: Light) -> list[Tree]:
        """Return the node of a punctual light, if it is one."""
        named = {"name": light.name} if light.name else {}
        if isinstance(light, PointLight):
            described = {**named, "type": "point", **_amount(light.intensity)}
            return [self._placed_light(described, light.position, (0.0, 0.0, -1.0))]
        if isinstance(light, SpotLight):
            if light.falloff != "gltf":
                self.note("other falloffs of spots than its own")
            if light.texture is not None:
                self.note("images before spots")
            outer = min(math.radians(light.outer_degrees), 0.5 * math.pi)
            inner = min(math.radians(light.inner_degrees), outer - 1e-6)
            cone = {"innerConeAngle": inner, "outerConeAngle": outer}
            described = {**named, "type": "spot", **_amount(light.intensity), "spot": cone}
            return [self._placed_light(described, light.position, light.direction)]
        if isinstance(light, DirectionalLight):
            if light.angle_degrees:
                self.note("the diameter of the sun")
            described = {**named, "type": "directional", **_amount(light.irradiance)}
            return [self._placed_light(described, (0.0, 0.0, 0.0), light.direction)]
        if not isinstance(light, (RectangleLight, DiskLight, SphereLight)):
            self.note(f"lights of the type {light.type_name!r}")
        return []

    def _placed_light(self, described: Tree, position: Any, direction: Any) -> Tree:
        extensions = self.tree.setdefault("extensions", {})
        lights = extensions.setdefault("KHR_lights_punctual", {"lights": []})["lights"]
        lights.append(described)
        up = np.eye(3)[np.abs(direction).argmin()]
        right = np.cross(direction, up)
        right /= norm(right)
        rows = np.stack([right, np.cross(right, direction), np.asarray(direction, np.float64)])
        reference = {"KHR_lights_punctual": {"light": len(lights) - 1}}
        return {"matrix": _looking(rows, position), "extensions": reference}

    def _camera(self, name: str, camera: Camera, aspect: float) -> list[Tree]:
        """Return the node of a camera, if glTF has its kind."""
        if getattr(camera, "aperture_radius", 0.0) > 0.0:
            self.note("depth of field")
        if camera.motion is not None:
            self.note("motion of the camera")
        if isinstance(camera, PerspectiveCamera):
            if camera.shift_x or camera.shift_y:
                self.note("the shift of a lens")
            if camera.pixel_aspect != 1.0:
                self.note("pixels that are not square")
            if camera.distortion:
                self.note("the distortion of a lens")
            lens = {"yfov": math.radians(camera.fov_degrees), "aspectRatio": aspect, "znear": _NEAR}
            described = {"type": "perspective", "perspective": lens}
        elif isinstance(camera, OrthographicCamera):
            half = 0.5 * camera.view_height
            box = {"xmag": half * aspect, "ymag": half, "znear": 0.0, "zfar": 1e6}
            described = {"type": "orthographic", "orthographic": box}
        else:
            self.note(f"cameras of the type {camera.type_name!r}")
            return []
        number = self.once("cameras", described)
        return [{"name": name, "camera": number, "matrix": _looking(camera.frame(), camera.origin)}]


def _uses_vertex_colors(value: ColorSource, *, alpha: bool) -> bool:
    """Return whether vertex colours give or multiply a value, or their alpha if `alpha`."""
    if isinstance(value, VertexColor):
        return value.alpha or not alpha
    return isinstance(value, ImageTexture) and (value.vertex_alpha if alpha else value.vertex_colors)


def _of_unit_length(normals: NDArray[Any]) -> NDArray[np.float32]:
    """Return normals or tangents of length 1, as glTF wants them; those of no length point up."""
    length = np.linalg.norm(normals.astype(np.float64), axis=1, keepdims=True)
    return np.where(length > 0.0, normals / np.maximum(length, 1e-300), (0.0, 1.0, 0.0)).astype(np.float32)


def _amount(value: Any) -> Tree:
    """Return the colour and intensity of a light."""
    color = np.array(value, np.float64)
    most = float(color.max())
    return {"color": (color / most).tolist() if most > 0.0 else [0.0, 0.0, 0.0], "intensity": most}


def _looking(rows: NDArray[np.float64], origin: Any) -> list[float]:
    """Return the matrix of a node that looks along −z, from the rows right, up and forward; columns first."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([rows[0], rows[1], -rows[2]], axis=1)
    matrix[:3, 3] = origin
    return [float(x) for x in matrix.T.reshape(-1)]


def _extensions(tree: Any) -> set[str]:
    """Return the names of all extensions in a tree."""
    found: set[str] = set()
    if isinstance(tree, dict):
        found |= set(tree.get("extensions", {}))
    for value in tree.values() if isinstance(tree, dict) else tree if isinstance(tree, list) else ():
        found |= _extensions(value)
    return found


def _packed(tree: Tree, data: bytes) -> bytes:
    """Return a GLB of a tree and its binary data.

    Raises:
        InputError: when it is larger than the format can hold.
    """
    text = json.dumps(tree, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    size = 12 + 8 + len(text) + 8 + len(data)
    if size >= 2**32:
        raise InputError("the scene is too large for a GLB file, which holds 4 GB at most")
    parts = [b"glTF", (2).to_bytes(4, "little"), size.to_bytes(4, "little")]
    for kind, chunk in ((b"JSON", text), (b"BIN\0", data)):
        parts += [len(chunk).to_bytes(4, "little"), kind, chunk]
    return b"".join(parts)
