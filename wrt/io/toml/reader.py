"""Scene files: TOML tables that mirror wrt's dataclasses, with errors that name the key."""

from __future__ import annotations

import functools
import inspect
import os
import typing
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, did_you_mean
from wrt.io import memory_limits
from wrt.io.file_type import hinting
from wrt.io.images import load_environment, read_image
from wrt.io.safe_read import PathLike, require_file
from wrt.io.toml import scene_keys
from wrt.io.toml.placement import after, joined, read_deformation, read_density, read_motion, read_places
from wrt.io.toml.scene_keys import BOOLEAN, POINTS, TEXT, Keys, array_of, own_fields
from wrt.io.toml.tables import Result, Table, TableReader, choice, points_of, read_toml, table_of, text_of
from wrt.scene import shapes
from wrt.scene.camera import CAMERAS, Camera
from wrt.scene.environment import ENVIRONMENTS, ImageEnvironment
from wrt.scene.exact import quadrics
from wrt.scene.exact.analytic import Analytic
from wrt.scene.exact.distances import SHAPES, DistanceShape
from wrt.scene.exact.quadrics import Quadrics
from wrt.scene.exact.spheres import Spheres
from wrt.scene.integrators import INTEGRATORS, Integrator, integrator_of
from wrt.scene.lights import LIGHTS
from wrt.scene.materials import MATERIALS, Material
from wrt.scene.materials.composite import MAX_NESTING
from wrt.scene.materials.measured import Measurement
from wrt.scene.medium import MEDIA, DensityGrid, Medium
from wrt.scene.mesh import Mesh, merge
from wrt.scene.motion import Motion
from wrt.scene.procedural import TEXTURES
from wrt.scene.scene import RenderSettings, Scene, Shape, bake_transforms
from wrt.scene.textures import ImageTexture, NormalMap, VertexColor
from wrt.values import boolean, sealed, text, vector

_hints_of = functools.cache(typing.get_type_hints)


@memory_limits.one_load()
def load_scene(path: PathLike, triangles: int | None = None) -> Scene:
    """Read a TOML file, which names other files relative to itself.

    Args:
        path: the file.
        triangles: replaces the number in every shape of type "many-triangles".

    Raises:
        InputError: naming the file and the key, when anything in it cannot be used, or when
            `triangles` is given and there is no such shape.
    """
    file = Path(path)
    require_file(file)
    reader = _SceneReader(file, triangles)
    with hinting(file), reader.at(""):
        return reader.scene(read_toml(file))


def shape_makers() -> dict[str, Callable[..., Any]]:
    """Return what makes shapes from keys of their own, by their `type`."""
    return dict(_SceneReader(Path(), None).makers())


def look_up(section: str, name: Any, objects: dict[str, Result]) -> Result:
    """Return the object of a section by its name, or raise InputError."""
    if text_of(name) not in objects:
        raise InputError(f"there is no [{section}.{name}]{did_you_mean(name, objects)}")
    return objects[name]


class _SceneReader(TableReader):
    """Turns the tables of one file into a scene."""

    def __init__(self, path: Path, triangles: int | None) -> None:
        super().__init__(path)
        self.triangles = triangles
        self.triangles_used = False
        self.media: dict[str, Medium] = {}
        self.materials: dict[str, Material] = {}
        self._material_tables: Table = {}
        self._open_materials: list[str] = []
        self._contents: dict[tuple[Any, ...], Any] = {}
        self._readers: dict[Any, Callable[[Any], Any]] = {
            Material: self.part,
            Medium: self.medium,
            Measurement: self.measurement,
            Integrator: self.integrator,
            NormalMap: lambda value: self.normal_map(table_of(value)),
            DensityGrid: lambda value: read_density(self, table_of(value)),
        }

    def scene(self, tree: Table) -> Scene:
        self.check_keys(tree, scene_keys.SECTIONS)
        scene = Scene()
        scene.settings = self.read(tree, "settings", partial(self.build, RenderSettings)) or scene.settings
        scene.camera = self.read(tree, "camera", self.camera)
        scene.environment = self.read(tree, "environment", self.environment)
        self.each(tree, "lights", lambda light: scene.add_light(self.build(choice(light, LIGHTS), light)))
        with self.at("media"):
            for name, table in table_of(tree.get("media", {})).items():
                with self.at(name):
                    self.media[name] = self.build(choice(table_of(table), MEDIA, default="coefficients"), table)
        scene.medium = self.read(tree, "medium", self.medium)
        with self.at("materials"):
            self._material_tables = table_of(tree.get("materials", {}))
            for name in self._material_tables:
                self.material(name)
        self.each(tree, "shapes", lambda shape: scene.shapes.extend(self.shape(shape)))
        if self.triangles is not None and not self.triangles_used:
            raise InputError("a number of triangles was given, but no shape is of type 'many-triangles'")
        return scene

    def build(self, make: Callable[..., Any], table: Any) -> Any:
        """Call a class or function with the keys of a table, whose `type` may only have named it.

        A value that its type hints take for an object names it, such as a medium, or is its table, such as a texture.
        """
        hints = _hints_of(make)
        arguments = dict(table_of(table))
        for key, value in arguments.items():
            kinds = typing.get_args(hints.get(key)) or (hints.get(key),)
            read = next((self._readers[kind] for kind in kinds if kind in self._readers), None)
            with self.at(key):
                if read is not None:
                    arguments[key] = read(value)
                elif ImageTexture in kinds:
                    arguments[key] = self.color_source(value, kinds)
        return self.call(make, arguments, extra=() if "type" in inspect.signature(make).parameters else ("type",))

    def integrator(self, value: Any) -> str | Integrator:
        """Return the integrator that a name or a table of its numbers stands for."""
        table = value if isinstance(value, dict) else {"type": value}
        found = integrator_of(table.get("type"), "integrator", words=INTEGRATORS)
        if isinstance(found, Integrator):
            made: Integrator = self.build(type(found), table)
            return made
        self.check_keys(table, ("type",))
        return found

    def camera(self, table: Table) -> Camera:
        cls = choice(table_of(table), CAMERAS, default="perspective")
        if "motion" in table:
            center = self.read(table, "origin", lambda value: vector(value, "camera origin")) or cls.origin
            motion = self.read(table, "motion", lambda value: read_motion(self, table_of(value), center))
            table = {**table, "motion": motion}
        made: Camera = self.build(cls, table)
        return made

    def environment(self, table: Table) -> Any:
        cls = choice(table_of(table), ENVIRONMENTS)
        if cls is not ImageEnvironment:
            return self.build(cls, table)
        keys = {key: value for key, value in table.items() if key != "type"}
        options = self.fields_of(keys, scene_keys.IMAGE_ENVIRONMENT, ImageEnvironment)
        with self.at("file"):
            return load_environment(self.file(table["file"]), **options)

    def medium(self, name: Any) -> Medium:
        """Return a medium by its name."""
        return look_up("media", name, self.media)

    def material(self, name: str) -> Material:
        """Return a material by its name; it may name others as its parts, in any order."""
        if name not in self.materials:
            if name in self._open_materials:
                raise InputError(f"{name!r} is made of itself")
            if len(self._open_materials) > MAX_NESTING:
                raise InputError(f"materials are nested more than {MAX_NESTING} deep")
            self._open_materials.append(name)
            with self.at(name):
                table = table_of(self._material_tables[name])
                self.materials[name] = self.build(choice(table, MATERIALS), table).named(name)
            self._open_materials.pop()
        return self.materials[name]

    def part(self, name: Any) -> Material:
        """Return a material that another one names."""
        look_up("materials", name, self._material_tables)
        place, self.place = self.place, self.place[:2]
        try:
            return self.material(name)
        finally:
            self.place = place

    def fields_of(self, table: Table, keys: Keys, cls: type[Any]) -> Table:
        """Return the keys of a table that are fields of a class; it may have no others but `keys`."""
        names = own_fields(cls)
        self.check_table(table, keys, names)
        return {name: table[name] for name in names if name in table}

    def color_source(self, value: Any, kinds: tuple[Any, ...]) -> Any:
        """Return a value that may vary over the surface: vertex colours, an image, a procedure, or a constant."""
        if isinstance(value, dict) and "texture" not in value and "type" in value:
            return self.build(choice(value, TEXTURES), value)
        if isinstance(value, dict) and "texture" not in value and "vertex_colors" in value:
            options = self.fields_of(value, scene_keys.VERTEX_COLORS, VertexColor)
            if value["vertex_colors"] is not True:
                raise InputError(f"vertex_colors must be true, not {value['vertex_colors']!r}")
            return VertexColor(**options)
        if value == "vertex-colors":
            return VertexColor()
        if isinstance(value, str) and str not in kinds and Path(value).suffix:
            raise InputError(f"must be a number, three numbers, {{ texture = FILE }} or 'vertex-colors', not {value!r}")
        return self.texture(value) if isinstance(value, dict) else value

    def texture(self, table: Table) -> ImageTexture:
        """Return an image by its table; the same object for the same table, and its pixels once for all of them."""
        options = self.fields_of(table, scene_keys.TEXTURE, ImageTexture)
        linear = boolean(table.get("linear", False), "linear")
        with self.at("texture"):
            file = self.file(table["texture"])
            pixels = self.image(file, linear=linear)
            key = (file, linear, repr(sorted(options.items())))
            return self.once(lambda: ImageTexture(pixels, file.name, **options), "texture", *key)

    def once(self, make: Callable[[], Result], *key: Any) -> Result:
        """Return what `make` returned the first time for a key."""
        if key not in self._contents:
            self._contents[key] = make()
        result: Result = self._contents[key]
        return result

    def image(self, file: Path, *, linear: bool) -> NDArray[np.float32]:
        """Return an image; the same array for the same file, whichever path leads to it."""
        return self.once(lambda: sealed(read_image(file, linear=linear)), "image", os.path.realpath(file), linear)

    def normal_map(self, table: Table) -> NormalMap:
        options = self.fields_of(table, scene_keys.NORMAL_MAP, NormalMap)
        with self.at("texture"):
            file = self.file(table["texture"])
            pixels = self.image(file, linear=True)
        return NormalMap(pixels, name=file.name, **options)

    def measurement(self, name: Any) -> Measurement:
        """Return a measured reflectance; the same object for the same file."""
        from wrt.io.measured.measurement import load_measurement

        file = self.file(name)
        return self.once(lambda: load_measurement(file), "measurement", os.path.realpath(file))

    def shape(self, table: Table) -> list[Shape]:
        """Return a shape, or the several of a mesh file that keeps its own materials."""
        made = self.meshes(table)
        matrix = self.transform(table) if scene_keys.TRANSFORM.keys() & table.keys() else None
        material = self.read(table, "material", lambda name: look_up("materials", name, self.materials))
        places = read_places(self, table)
        if "deformation" in table or any(isinstance(place, Motion) and not place.is_rigid for place in places):
            made = bake_transforms(made)
        if material is not None:
            made = joined(made)
        name = self.read(table, "name", lambda value: text(value, "a name"))
        emission = self.read(table, "emission", lambda value: self.color_source(value, ())) or 0.0
        if "deformation" in table and len(made) > 1:
            raise InputError("its file has several materials, but one mesh alone can be deformed; give a material")

        def moved(mesh: Mesh) -> Mesh:
            return mesh if matrix is None else mesh.transformed(matrix)

        memory_limits.take(memory_limits.SHAPES, len(made) * len(places) * memory_limits.BYTES_PER_SHAPE)
        result = []
        for shape in made:
            deformation = read_deformation(self, table, shape.mesh, moved)
            default = shape.two_sided_emission and material is None
            two_sided = boolean(table.get("two_sided_emission", default), "two_sided_emission")
            double_sided = boolean(table.get("double_sided", shape.double_sided), "double_sided")
            edges = boolean(table.get("edges", shape.edges), "edges")
            catches = boolean(table.get("shadow_catcher", False), "shadow_catcher")
            others = edges, catches, table.get("group", shape.group)
            looks = (material or shape.material, emission, two_sided, shape.name if name is None else name)
            if shape.transform is None:
                if matrix is not None:
                    memory_limits.take(memory_limits.MESHES, memory_limits.size_of(shape.mesh))
                mesh, first = moved(shape.mesh), None
            else:  # an instance in its file: the mesh is shared
                mesh, first = shape.mesh, after(matrix, shape.transform)
            result += [Shape(mesh, *looks, after(place, first), deformation, double_sided, *others) for place in places]
        return result

    def makers(self) -> dict[str, Callable[..., Any]]:
        """Return what makes shapes from keys of their own, by type."""
        return {
            "quad": shapes.quad,
            "box": shapes.box,
            "sphere": shapes.sphere,
            "spheres": self.spheres,
            "disk": quadrics.disk,
            "cylinder": quadrics.cylinder,
            "quadrics": self.quadrics,
            "polygon": self.polygon,
            "polygons": self.polygons,
            "mesh": self.mesh_file,
            "many-triangles": self.many_triangles,
            **SHAPES,
        }

    def meshes(self, table: Table) -> list[Shape]:
        """Return the meshes of a shape before its transform; those from files bring materials."""
        made = self.call(choice(table, self.makers()), table, extra=scene_keys.SHAPE)
        if isinstance(made, DistanceShape):
            made = made.mesh
        if isinstance(made, Mesh):
            memory_limits.take(memory_limits.MADE, memory_limits.size_of(made))
            return [Shape(made, name=f"{table['type']} {self.place[-1]}")]
        result: list[Shape] = made
        return result

    def polygon(self, corners: Annotated[Any, POINTS]) -> Mesh:
        """Return a flat convex polygon.

        Args:
            corners: in order, counter-clockwise seen from its front; at least three.
        """
        return shapes.polygon(points_of(corners, "corners"))

    def polygons(self, polygons: Annotated[Any, array_of(POINTS, 1)]) -> Mesh:
        """Return one mesh of many flat convex polygons.

        Args:
            polygons: the corners of each.
        """
        if not isinstance(polygons, list) or not polygons:
            raise InputError("polygons must be an array of arrays of corners")
        made = [shapes.polygon(points_of(corners, f"polygons[{i}]")) for i, corners in enumerate(polygons)]
        return merge(made, "polygons")

    def spheres(self, file: Annotated[Any, TEXT]) -> Mesh:
        """Return many exact spheres, such as particles.

        Args:
            file: a NumPy archive (.npz) of `centers` (N, 3), `radii` (N,) and perhaps `colors` (N, 3).
        """
        return self.arrays(file, Spheres)

    def quadrics(self, file: Annotated[Any, TEXT]) -> Mesh:
        """Return exact disks and cylinders that `wrt convert` wrote.

        Args:
            file: a NumPy archive (.npz) of their arrays `boxes` (N, 2, 3) and `axes` (N, 3, 3).
        """
        return self.arrays(file, Quadrics)

    def arrays(self, file: Any, cls: type[Analytic]) -> Mesh:
        from wrt.io.npy import read_exact

        with self.at("file"):
            return read_exact(self.file(file), cls)

    def mesh_file(self, file: Annotated[Any, TEXT], smooth: Annotated[Any, BOOLEAN] = True) -> list[Shape]:
        """Return the shapes of a mesh file.

        Those of a file that several shapes name share its memory.

        Args:
            file: the mesh: OBJ, PLY, STL, OFF, GLB, glTF or .npz.
            smooth: whether its own normals are used, and made where it has none unless its format says that it is flat;
                otherwise triangles are flat.
        """
        from wrt.io.load_mesh import load_file

        def load() -> list[Shape]:
            loaded = load_file(path, smooth_degrees=None if smooth else 0.0).shapes
            if smooth:
                return loaded
            flat = {id(shape.mesh): replace(shape.mesh, normals=None) for shape in loaded}
            return [replace(shape, mesh=flat[id(shape.mesh)]) for shape in loaded]

        boolean(smooth, "smooth")
        with self.at("file"):
            path = self.file(file)
            return self.once(load, "mesh", os.path.realpath(path), smooth)

    def many_triangles(self, triangles: Annotated[Any, {"type": "integer", "minimum": 1000}]) -> Mesh:
        """Return a mountain range.

        Args:
            triangles: how many, 1,000 to 10,000,000.
        """
        from wrt.meshes.many_triangles import terrain

        self.triangles_used = True
        mesh: Mesh = terrain(triangles if self.triangles is None else self.triangles)
        return mesh
