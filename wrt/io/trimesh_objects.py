"""Reads trimesh objects like their files: as parts with materials, cameras and lights.

A PBRMaterial is converted to a glTF material, a SimpleMaterial to the statements of an MTL file, and the cameras and
lights of a scene to those of glTF. The readers of these formats do the rest. What trimesh drops when it loads a file,
such as samplers, texture transforms and extensions of glTF, is missing.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import OF_TRIMESH, InputError, warn
from wrt.io.account import warn_of_unused
from wrt.io.gltf.buffers import Buffers, Tree
from wrt.io.gltf.images import GltfImages
from wrt.io.gltf.materials import GltfMaterials
from wrt.io.gltf.scene import light_of
from wrt.io.mesh.mtl import MtlMaterials
from wrt.io.mesh.parts import Contents, Part, decoded, matching, placed, points_of, viewpoint
from wrt.io.mesh.sidecars import Sidecars
from wrt.io.mesh.stl import colors_of
from wrt.io.mesh.trimesh_loaders import is_stand_in
from wrt.io.texture_images import Source
from wrt.linalg import product
from wrt.scene.camera import Camera, PerspectiveCamera
from wrt.scene.lights import Light
from wrt.scene.normals import corner_weighted_normals

_GLTF_FILES = ("glb", "gltf")  # file types whose vertex colours are linear, and flat without normals

_COMPUTED, _MOSTLY = 1e-9, 0.99
"""Normals count as computed by trimesh if a share of at least _MOSTLY is within _COMPUTED of the normals of faces.
Normals from files differ by 1e-8 or more, as they are rounded to single precision or to decimal digits."""

_IN_PBR = ("baseColorTexture", "metallicRoughnessTexture", "metallicFactor", "roughnessFactor")
_BESIDE_PBR = ("normalTexture", "occlusionTexture", "emissiveTexture", "alphaMode", "alphaCutoff", "doubleSided")


TANGENTS = "TANGENT"
"""The attribute of vertices with their tangents, (N, 4), as glTF calls it."""

WITHOUT_EFFECT = {
    "*attribute '*normal*'": "trimesh hands over normals of vertices, and those of faces follow from the corners",
    "face attribute 'stl'": "the words of an STL file, whose colours are read",
}
"""What of a mesh does not change a picture: patterns of kinds, and the reason.

Its `metadata` are notes of whoever made it, except for extensions of glTF.
"""


_WITH_UNITS = ("3mf", "dae")
"""Types of files for which trimesh keeps the unit of length."""


def file_type(source: Any) -> str:
    """Return the type of the file that an object was loaded from, such as "stl"; empty if unknown, as for copies."""
    return str(source.source.file_type or "").lower()


def read_object(source: Any, name: str = OF_TRIMESH) -> Contents:
    """Return a part for each mesh and material of a `trimesh.Trimesh` or a `trimesh.Scene`, its camera and its lights.

    Messages call the object by `name`.
    """
    import trimesh

    if isinstance(source, trimesh.parent.Geometry) and not isinstance(source, trimesh.Scene):
        alone, world = _Reader(source, name), _to_metres(source, name)
        parts = alone.parts(name, source)
        alone.warn_of_unused()
        return Contents([placed(part, [world]) for part in parts] if world[0, 0] != 1.0 else parts)
    if not isinstance(source, trimesh.Scene):
        kinds = "a path, wrt.Scene, wrt.Mesh, or a mesh of trimesh, PyVista, Open3D or with vertices and faces"
        raise InputError(f"expected {kinds}, not {type(source).__name__}; wrt.Mesh takes arrays")
    reader = _Reader(source, name)
    places: dict[str, list[NDArray[np.float64]]] = {}
    world = _to_metres(source, name)
    for node in source.graph.nodes_geometry:
        matrix = _place_of(source, node, name)
        if matrix is not None:
            places.setdefault(source.graph[node][1], []).append(product(world, matrix))
    parts = [
        placed(part, found)
        for geometry, found in places.items()
        for part in reader.parts(str(geometry), source.geometry[geometry])
    ]
    reader.warn_of_unused()
    return Contents(parts, _lights(source, name), _cameras(source))


def _to_metres(source: Any, name: str) -> NDArray[np.float64]:
    """Return the (4, 4) transform to metres of an object from a file whose format has units."""
    from trimesh.units import unit_conversion

    world = np.eye(4)
    if file_type(source) in _WITH_UNITS and source.units is not None:
        try:
            world[range(3), range(3)] = unit_conversion(source.units, "meters")
        except (KeyError, ValueError):
            warn(f"{name}: its unit of length {source.units!r} is unknown; taken as metres")
    return world


def _place_of(scene: Any, node: Any, name: str) -> NDArray[np.float64] | None:
    """Return the (4, 4) transform of a node; None where trimesh has dropped its parents, such as glTF camera nodes."""
    try:
        return np.asarray(scene.graph.get(node)[0], np.float64)
    except ValueError:
        warn(f"{name}: node {node!r} is left out: nothing leads to it; trimesh drops nodes with cameras when it loads")
        return None
    except AssertionError:  # trimesh would repair rotations that are slightly off, and finds infinite places wrong
        raise InputError(f"{name}: node {node!r} is at no finite place") from None


class _HeldImages(GltfImages):
    """Images of trimesh materials, which are in memory already; one object counts as one image."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, {"images": [], "textures": [], "samplers": []}, Buffers(path, {}, b""))
        self._held: list[Any] = []

    def reference(self, image: Any) -> Tree:
        """Return a texture reference to an image."""
        number = next((number for number, each in enumerate(self._held) if each is image), len(self._held))
        if number == len(self._held):
            self._held.append(image)
            self._tree["images"].append({"uri": str(number)})
            self._tree["textures"].append({"source": number})
        return {"index": number}

    def _bytes(self, number: int) -> Source:
        image: Source = self._held[number]
        return image


class _Reader:
    """Reads the meshes of one object, each material and image once."""

    def __init__(self, source: Any, name: str) -> None:
        """Take the object, and what messages call it."""
        self._name = name
        self._type = file_type(source)
        self._is_gltf = self._type in _GLTF_FILES
        self._path = Path(source.source.file_path or OF_TRIMESH)
        self._resolver = source.source.resolver
        self._sidecars = Sidecars(self._path) if source.source.file_path else None
        self._images = _HeldImages(Path(name))
        self._descriptions: list[Tree] = []
        self._physical = GltfMaterials(Path(name), self._descriptions, self._images)
        self._numbers: dict[int, int] = {}
        self._simple = MtlMaterials(Path(name), self._find)
        self._maps: dict[str, Any] = {}

    def warn_of_unused(self) -> None:
        """Warn of what the materials so far have and wrt does not use."""
        self._simple.warn_of_unused()

    def parts(self, name: str, mesh: Any) -> list[Part]:
        """Return the parts of a `trimesh.Trimesh`, one for each of its materials; none if it has no triangles."""
        import trimesh
        from trimesh.visual.material import MultiMaterial, PBRMaterial

        if isinstance(mesh, trimesh.PointCloud):
            part = points_of(name, np.asarray(mesh.vertices, np.float64).reshape(-1, 3))
            if np.size(mesh.colors):
                self._take_colors(part, mesh.colors)
            self._account(mesh)
            return [part]
        if not isinstance(mesh, trimesh.Trimesh):
            warn(f"{self._name}: {name!r} is left out: a {type(mesh).__name__} has no triangles")
            return []
        smoothing = 0 if self._is_gltf else None
        part = Part(name, np.asarray(mesh.vertices), np.asarray(mesh.faces), _given_normals(mesh), smoothing=smoothing)
        tangents = np.asarray(mesh.vertex_attributes.get(TANGENTS, ()), np.float64)
        part.tangents = tangents if tangents.shape == (len(part.vertices), 4) else None
        part.double_sided = not self._is_gltf  # the default material of glTF has one side
        visual = mesh.visual
        if visual.kind in ("vertex", "face"):
            self._take_colors(part, visual.vertex_colors if visual.kind == "vertex" else visual.face_colors)
        elif visual.kind is None and "stl" in mesh.face_attributes:
            words, header = np.asarray(mesh.face_attributes["stl"]), str(mesh.metadata.get("header", ""))
            part.face_colors = colors_of(self._name, words, header.encode("latin-1", "replace"))
        self._account(mesh)
        if visual.kind != "texture":
            return [part]
        part.uvs = matching(visual.uv, len(mesh.vertices))
        material = visual.material
        colors = matching(visual.vertex_attributes.get("color"), len(mesh.vertices))
        if colors is not None:
            part.colors = decoded(np.array(colors), linear=self._is_gltf or isinstance(material, PBRMaterial))
        if not isinstance(material, MultiMaterial):
            return [self._with_material(part, material)]
        numbers = np.asarray(() if visual.face_materials is None else visual.face_materials)
        if numbers.shape != (len(mesh.faces),) or not len(material) or not set(numbers) <= set(range(len(material))):
            warn(f"{self._name}: {name!r} does not say which of its {len(material)} materials each face has; left out")
            return [part]
        return [
            self._with_material(replace(part, faces=part.faces[numbers == number]), material.get(number))
            for number in np.unique(numbers).tolist()
        ]

    def _take_colors(self, part: Part, colors: Any) -> None:
        """Give a part colours of its vertices or its faces, which trimesh does not check to be as many as these.

        They have no alpha if they come from glTF, where only a material can enable it.
        """
        values = decoded(np.asarray(colors).reshape(-1, 4), linear=self._is_gltf)
        values = values[:, :3] if self._is_gltf else values
        if len(values) in (1, len(part.vertices)):
            part.colors = np.broadcast_to(values, (len(part.vertices), values.shape[1]))
        elif len(values) == len(part.faces):
            part.face_colors = values
        else:
            counts = f"{len(part.vertices)} vertices and {len(part.faces)} faces"
            warn(f"{self._name}: the {len(values)} colours of {part.name!r} are left out: it has {counts}")

    def _account(self, mesh: Any) -> None:
        """Warn of what a mesh carries and the reader does not use."""
        given: Mapping[str, Any] = getattr(mesh, "vertex_attributes", {})
        used = {TANGENTS} if np.shape(given.get(TANGENTS, ())) == (len(mesh.vertices), 4) else set()
        kinds = [f"vertex attribute {name!r}" for name in given if name not in used]
        kinds += [f"face attribute {name!r}" for name in getattr(mesh, "face_attributes", ())]
        if mesh.visual.kind == "texture":
            names = set(mesh.visual.vertex_attributes.keys()) - {"uv", "color"}
            kinds += [f"vertex attribute {name!r} of its texture" for name in sorted(names)]
        kinds += [f"extension {name}" for name in mesh.metadata.get("gltf_extensions") or {}]
        warn_of_unused(self._name, kinds, WITHOUT_EFFECT)

    def _with_material(self, part: Part, material: Any) -> Part:
        """Return a part with its material, and with the texture coordinates and colours that the material needs."""
        from trimesh.visual.material import PBRMaterial, SimpleMaterial

        if isinstance(material, PBRMaterial):
            number = self._numbers.setdefault(id(material), len(self._descriptions))
            if number == len(self._descriptions):
                self._descriptions.append(self._described(material))
            return self._physical.dressed(part, number, {} if part.uvs is None else {0: part.uvs})
        if isinstance(material, SimpleMaterial):
            if statements := self._statements(material):
                return self._simple.dressed(part, str(material.name or ""), statements, number=id(material))
        elif material is not None:
            warn(f"{self._name}: a {type(material).__name__} of {part.name!r} is left out: unknown type of material")
        return part

    def _described(self, material: Any) -> Tree:
        """Return a PBRMaterial as glTF describes it (section 3.9)."""

        def values_of(names: tuple[str, ...]) -> Tree:
            values = {name: getattr(material, name) for name in names}
            return {
                name: self._images.reference(value) if name.endswith("Texture") else value
                for name, value in values.items()
                if value is not None
            }

        known = {*_IN_PBR, *_BESIDE_PBR, "baseColorFactor", "emissiveFactor", "name"}
        warn_of_unused(self._name, [f"{key} of a material" for key in sorted(set(material._data) - known)], {})
        described = {"name": material.name, "pbrMetallicRoughness": values_of(_IN_PBR), **values_of(_BESIDE_PBR)}
        if self._type == "dae":  # trimesh's default is that of glTF; COLLADA does not hide backs
            described["doubleSided"] = True
        if material.baseColorFactor is not None:
            described["pbrMetallicRoughness"]["baseColorFactor"] = (np.asarray(material.baseColorFactor) / 255).tolist()
        if material.emissiveFactor is not None:
            described["emissiveFactor"] = np.asarray(material.emissiveFactor).tolist()
        return described

    def _statements(self, material: Any) -> dict[str, Any]:
        """Return a SimpleMaterial as the statements of an MTL file.

        trimesh keeps the file's own statements in `kwargs`, and colours rounded to 8 bits in the attributes. The file's
        colours are used where they round to the attributes.
        """
        from trimesh.visual.color import DEFAULT_COLOR

        statements = dict(material.kwargs)
        for key, rounded in (("kd", material.diffuse), ("ks", material.specular)):
            if key in statements and _rounds_to(statements[key], rounded):
                continue
            statements.pop(key, None)
            if not np.array_equal(rounded, DEFAULT_COLOR):  # the default stands for no colour
                statements[key] = (rounded[:3] / 255.0).tolist()
                if key == "kd" and 0 < rounded[3] < 255:
                    statements.setdefault("d", [str(rounded[3] / 255.0)])
        if "ns" in statements or material.glossiness != 1.0:  # 1 is the default
            statements["ns"] = material.glossiness
        if material.image is not None and not is_stand_in(material.image):
            statements["map_kd"] = [self._label(material.image)]
        return statements

    def _label(self, image: Any) -> str:
        """Return a name by which `_find` finds an image."""
        name = str(image.info.get("file_path") or "image")
        labels = itertools.chain([name], (f"{name} {number}" for number in itertools.count(2)))
        return next(label for label in labels if self._maps.setdefault(label, image) is image)

    def _find(self, name: str) -> Source:
        """Return the image with a label from `_label`, or an image file beside the object's file."""
        if name in self._maps:
            image: Source = self._maps[name]
            return image
        if self._sidecars is not None:
            return self._sidecars.find(name)
        try:
            data: bytes = self._resolver.get(name)
        except Exception:  # noqa: BLE001 - resolvers of archives and of the network fail in ways of their own
            raise InputError(f"trimesh: image {name!r}, which a material names, cannot be looked up") from None
        return data


def _rounds_to(value: Any, rounded: NDArray[np.uint8]) -> bool:
    """Return whether a colour rounds to one of 8 bits, as a SimpleMaterial rounds it."""
    from trimesh.visual.color import to_rgba

    try:
        return np.array_equal(to_rgba(np.array(value, np.float64)), rounded)
    except (TypeError, ValueError):  # it is not a colour
        return False


def _given_normals(mesh: Any) -> NDArray[np.float64] | None:
    """Return the vertex normals, or None if trimesh has computed them from the faces.

    trimesh keeps both in its cache and has no public way to ask whether a mesh has any: asking for
    them computes them, which without scipy takes a time that is quadratic in the vertices.
    """
    if "vertex_normals" not in mesh._cache.cache:
        return None
    normals, vertices = np.asarray(mesh.vertex_normals), np.asarray(mesh.vertices, np.float64)
    if normals.shape != vertices.shape or not len(mesh.faces):
        return None
    with np.errstate(all="ignore"):
        computed = corner_weighted_normals(vertices, np.asarray(mesh.faces))
        near = (np.abs(normals - computed) < _COMPUTED).all(axis=1)
    return None if near.mean() >= _MOSTLY else normals


def _cameras(scene: Any) -> list[tuple[str, Camera]]:
    """Return a scene's camera, if it has one; `scene.camera` would create one."""
    if not scene.has_camera:
        return []
    if file_type(scene) in _GLTF_FILES:
        # trimesh keeps only the innermost transform of a camera: the camera is misplaced if a parent node has one too.
        edges = scene.graph.transforms.edge_data
        parents = {above for above, _ in edges}
        for (_, frame), edge in edges.items():
            # trimesh names its own lights like this.
            ends = "geometry" in edge or _extension(edge) or str(frame).startswith(("light_", scene.camera.name))
            if (frame in parents or not ends) and not np.array_equal(edge.get("matrix", np.eye(4)), np.eye(4)):
                warn("trimesh: its camera is left out: trimesh drops the transforms of its parent nodes in a glTF file")
                return []
    lens: dict[str, Any] = {"fov_degrees": float(scene.camera.fov[1])}
    # In trimesh, the horizontal angle of a camera from a glTF file is the vertical one times the aspect ratio.
    if file_type(scene) not in _GLTF_FILES or not getattr(scene.camera, "_focal_computed", False):
        fx, fy = scene.camera.focal
        lens["pixel_aspect"] = float(fy) / float(fx)
    return [(str(scene.camera.name), PerspectiveCamera(**viewpoint(np.asarray(scene.camera_transform)), **lens))]


def _lights(scene: Any, name: str) -> list[Light]:
    """Return the lights that a scene was given, or that trimesh keeps from a glTF file.

    trimesh adds two lights to a scene without any when it shows it; these are left out. Messages name the scene.
    """
    found: list[tuple[Tree, Any]] = []  # each as glTF describes it, and the name of its node
    own_lights = getattr(scene, "_lights", None) or []
    for light in [] if all(_is_automatic(light) for light in own_lights) else own_lights:
        kind = type(light).__name__.removesuffix("Light").lower()
        color = (np.asarray(light.color)[:3] / 255.0).tolist()
        cone = {key: getattr(light, key) for key in ("innerConeAngle", "outerConeAngle") if hasattr(light, key)}
        found.append(({"type": kind, "color": color, "intensity": light.intensity, "spot": cone}, light.name))
    carried = _extension({"metadata": scene.metadata}).get("lights", [])
    for (_, frame), edge in scene.graph.transforms.edge_data.items():
        number = _extension(edge).get("light")
        if number is not None and 0 <= number < len(carried):
            found.append((carried[number], frame))
    places = ((light, _place_of(scene, frame, name)) for light, frame in found)
    return [light_of(light, matrix) for light, matrix in places if matrix is not None]


def _extension(holder: Tree) -> Tree:
    """Return a glTF file's lights extension, which trimesh keeps in the metadata of a scene or of an edge to a node."""
    metadata = holder.get("metadata") or {}
    found: Tree = metadata.get("gltf_extensions", {}).get("KHR_lights_punctual", {})
    return found


def _is_automatic(light: Any) -> bool:
    """Return whether a light looks like one that trimesh adds by itself."""
    from trimesh.scene.lighting import _DEFAULT_RGBA, PointLight

    return isinstance(light, PointLight) and light.intensity == 1.0 and np.array_equal(light.color, _DEFAULT_RGBA)
