"""Scene files: TOML tables that mirror wrt's dataclasses, with errors that name the key."""

from __future__ import annotations

import os
import typing
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, did_you_mean
from wrt.io import memory_limits
from wrt.io.file_type import hinting
from wrt.io.images import load_environment, read_image
from wrt.io.safe_read import PathLike, require_file
from wrt.io.toml.parse import read_toml
from wrt.io.toml.placement import after, joined, read_deformation, read_density, read_motion, read_places
from wrt.io.toml.scene_keys import (
    BOOLEAN,
    IMAGE_ENVIRONMENT,
    NORMAL_MAP,
    POINTS,
    SECTIONS,
    SHAPE,
    TEXT,
    TEXTURE,
    VERTEX_COLORS,
    array_of,
    own_fields,
)
from wrt.io.toml.tables import TableReader
from wrt.io.toml.values import Table, check_triangles, choice, points_of, table_of, text_of
from wrt.scene import shapes
from wrt.scene.camera import CAMERAS, Camera
from wrt.scene.environment import ENVIRONMENTS, ImageEnvironment
from wrt.scene.exact import quadrics
from wrt.scene.lights import LIGHTS, Light
from wrt.scene.materials import MATERIALS, Material
from wrt.scene.materials.composite import MAX_NESTING
from wrt.scene.materials.measured import Measurement
from wrt.scene.medium import MEDIA, Medium
from wrt.scene.mesh import Mesh, merge
from wrt.scene.motion import Motion
from wrt.scene.normals import CREASE_DEGREES
from wrt.scene.scene import RenderSettings, Scene, Shape, bake_transforms
from wrt.scene.textures import ImageTexture, NormalMap, VertexColor
from wrt.values import boolean, integer, number, sealed, vector


@memory_limits.one_load()
def load_scene(path: PathLike, triangles: int | None = None) -> Scene:
    """Read a scene file.

    Files that it names are found relative to it.

    Args:
        path: the TOML file.
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


class _SceneReader(TableReader):
    """Turns the tables of one file into a scene."""

    def __init__(self, path: Path, triangles: int | None) -> None:
        super().__init__(path)
        self.triangles = triangles
        self.triangles_used = False
        self.media: dict[str, Medium] = {}
        self.pixels: dict[tuple[str, bool], NDArray[np.float32]] = {}
        self.measurements: dict[str, Measurement] = {}
        self.textures: dict[tuple[Path, bool, str], ImageTexture] = {}
        self.mesh_files: dict[tuple[str, bool], list[Shape]] = {}

    def scene(self, tree: Table) -> Scene:
        self.check_keys(tree, SECTIONS)
        scene = Scene()
        with self.at("settings"):
            scene.settings = self.build(RenderSettings, table_of(tree.get("settings", {})))
        if "camera" in tree:
            with self.at("camera"):
                scene.camera = self.camera(table_of(tree["camera"]))
        if "environment" in tree:
            with self.at("environment"):
                scene.environment = self.environment(table_of(tree["environment"]))
        self.each(tree, "lights", lambda light: scene.add_light(self.light(light)))
        with self.at("media"):
            self.read_media(table_of(tree.get("media", {})))
        if "medium" in tree:
            with self.at("medium"):
                scene.medium = self.medium(tree["medium"])
        with self.at("materials"):
            materials = self.all_materials(table_of(tree.get("materials", {})))
        check_triangles(tree.get("shapes"), self.triangles)
        self.each(tree, "shapes", lambda shape: scene.shapes.extend(self.shape(shape, materials)))
        if self.triangles is not None and not self.triangles_used:
            raise InputError("a number of triangles was given, but no shape is of type 'many-triangles'")
        return scene

    def camera(self, table: Table) -> Camera:
        table = dict(table)
        cls = choice(table, CAMERAS, default="perspective")
        if "motion" in table:
            with self.at("origin"):
                center = vector(table.get("origin", cls.origin), "camera origin")
            with self.at("motion"):
                table["motion"] = read_motion(self, table_of(table["motion"]), center)
        made: Camera = self.build(cls, table)
        return made

    def light(self, table: Table) -> Light:
        table = dict(table)
        cls = choice(table, LIGHTS)
        if isinstance(table.get("texture"), dict):
            with self.at("texture"):
                table["texture"] = self.texture(table["texture"])
        made: Light = self.build(cls, table)
        return made

    def environment(self, table: Table) -> Any:
        cls = choice(table, ENVIRONMENTS)
        if cls is not ImageEnvironment:
            return self.build(cls, table)
        self.check_table(table, IMAGE_ENVIRONMENT, others=["type", *own_fields(ImageEnvironment)])
        scale = number(table.get("scale", 1.0), "scale", minimum=0.0)
        rotation = number(table.get("rotation_degrees", 0.0), "rotation_degrees")
        axis = vector(table.get("rotation_axis", (0.0, 1.0, 0.0)), "rotation_axis")
        with self.at("file"):
            file = self.beside(table["file"])
            return load_environment(file, scale=scale, rotation_degrees=rotation, rotation_axis=axis)

    def read_media(self, tables: Table) -> None:
        for name, table in tables.items():
            with self.at(name):
                make = choice(table_of(table), MEDIA, default="coefficients")
                if "density" in table:
                    with self.at("density"):
                        table = {**table, "density": read_density(self, table_of(table["density"]))}
                self.media[name] = self.build(make, table)

    def medium(self, name: Any) -> Medium:
        """Return a medium by its name."""
        if text_of(name) not in self.media:
            raise InputError(f"there is no [media.{name}]{did_you_mean(name, self.media)}")
        return self.media[name]

    def all_materials(self, tables: Table) -> dict[str, Material]:
        """Return all materials by name; a material may name others as its parts, in any order."""
        made: dict[str, Material] = {}
        open_names: list[str] = []

        def make(name: str) -> Material:
            if name not in made:
                if name in open_names:
                    raise InputError(f"{name!r} is made of itself")
                if len(open_names) > MAX_NESTING:
                    raise InputError(f"materials are nested more than {MAX_NESTING} deep")
                open_names.append(name)
                with self.at(name):
                    made[name] = self.material(table_of(tables[name]), part)
                open_names.pop()
            return made[name]

        def part(name: Any) -> Material:
            if text_of(name) not in tables:
                raise InputError(f"there is no [materials.{name}]{did_you_mean(name, tables)}")
            place, self.place = self.place, self.place[:2]
            try:
                return make(name)
            finally:
                self.place = place

        for name in tables:
            make(name)
        return made

    def material(self, table: Table, part: Callable[[Any], Material]) -> Material:
        """Return the material of a table; `part` finds others by name."""
        table = dict(table)
        cls = choice(table, MATERIALS)
        types = typing.get_type_hints(cls)
        for key, value in table.items():
            kind = types.get(key)
            if kind is Material or kind == Material | None:
                with self.at(key):
                    table[key] = part(value)
            elif kind == Medium | None:
                with self.at(key):
                    table[key] = self.medium(value)
            elif ImageTexture in typing.get_args(kind):
                with self.at(key):
                    table[key] = self.color_source(value, names=str in typing.get_args(kind))
            elif kind == NormalMap | None:
                with self.at(key):
                    table[key] = self.normal_map(table_of(value))
            elif kind is Measurement:
                with self.at(key):
                    table[key] = self.measurement(self.beside(value))
        result: Material = self.build(cls, table)
        return result

    def color_source(self, value: Any, *, names: bool) -> Any:
        """Return what a value that may vary stands for: a constant, vertex colours or an image; or itself if a name."""
        if isinstance(value, dict) and "texture" not in value and "vertex_colors" in value:
            self.check_table(value, VERTEX_COLORS, others=own_fields(VertexColor))
            if value["vertex_colors"] is not True:
                raise InputError(f"vertex_colors must be true, not {value['vertex_colors']!r}")
            return VertexColor(**{key: value[key] for key in own_fields(VertexColor) if key in value})
        if isinstance(value, str) and value != "vertex-colors":
            if names:
                return value
            raise InputError(f"must be a number, three numbers, {{ texture = FILE }} or 'vertex-colors', not {value!r}")
        if isinstance(value, str):
            return VertexColor()
        return self.texture(value) if isinstance(value, dict) else value

    def texture(self, table: Table) -> ImageTexture:
        """Return an image by its table; the same object for the same table, and its pixels once for all of them."""
        laid = own_fields(ImageTexture)
        self.check_table(table, TEXTURE, others=laid)
        linear = boolean(table.get("linear", False), "linear")
        with self.at("texture"):
            file = self.beside(table["texture"])
            pixels = self.image(file, linear=linear)
            options = {key: table[key] for key in laid if key in table}
            key = (file, linear, repr(sorted(options.items())))
            if key not in self.textures:
                self.textures[key] = ImageTexture(pixels, file.name, **options)
            return self.textures[key]

    def image(self, file: Path, *, linear: bool) -> NDArray[np.float32]:
        """Return an image; the same array for the same file, whichever path leads to it."""
        key = os.path.realpath(file), linear
        if key not in self.pixels:
            self.pixels[key] = sealed(read_image(file, linear=linear))
        return self.pixels[key]

    def normal_map(self, table: Table) -> NormalMap:
        self.check_table(table, NORMAL_MAP, others=own_fields(NormalMap))
        with self.at("texture"):
            file = self.beside(table["texture"])
            pixels = self.image(file, linear=True)
        options = {key: value for key, value in table.items() if key != "texture"}
        return NormalMap(pixels, name=file.name, **options)

    def measurement(self, file: Path) -> Measurement:
        """Return a measured reflectance; the same object for the same file."""
        from wrt.io.measured.measurement import load_measurement

        key = os.path.realpath(file)
        if key not in self.measurements:
            self.measurements[key] = load_measurement(file)
        return self.measurements[key]

    def shape(self, table: Table, materials: dict[str, Material]) -> list[Shape]:
        """Return a shape, or the several of a mesh file that keeps its own materials."""
        made = self.meshes(table)
        matrix = self.transform(table)
        material = None
        if "material" in table:
            with self.at("material"):
                material = materials.get(text_of(table["material"]))
                if material is None:
                    name = table["material"]
                    raise InputError(f"there is no [materials.{name}]{did_you_mean(name, materials)}")
        places = read_places(self, table)
        if "deformation" in table or any(isinstance(place, Motion) and not place.is_rigid for place in places):
            made = bake_transforms(made)
        if material is not None:
            made = joined(made)
        name = None
        if "name" in table:
            with self.at("name"):
                name = text_of(table["name"])
        with self.at("emission"):
            emission = self.color_source(table.get("emission", 0.0), names=False)
        if "deformation" in table and len(made) > 1:
            raise InputError("its file has several materials, but one mesh alone can be deformed; give a material")

        def moved(mesh: Mesh) -> Mesh:
            return mesh if matrix is None else mesh.transformed(matrix)

        memory_limits.take(memory_limits.SHAPES, len(made) * len(places) * memory_limits.BYTES_PER_SHAPE)
        result = []
        for shape in made:
            changes = read_deformation(self, table, shape.mesh, moved)
            own = shape.two_sided_emission and material is None
            two_sided = boolean(table.get("two_sided_emission", own), "two_sided_emission")
            looks = (material or shape.material, emission, two_sided, name or shape.name)
            if shape.transform is None:
                if matrix is not None:
                    memory_limits.take(memory_limits.MESHES, memory_limits.size_of(shape.mesh))
                mesh, first = moved(shape.mesh), None
            else:  # one of several places in its file, whose mesh is there once
                mesh, first = shape.mesh, after(matrix, shape.transform)
            result += [Shape(mesh, *looks, transform=after(place, first), deformation=changes) for place in places]
        return result

    def makers(self) -> dict[str, Callable[..., Mesh | list[Shape]]]:
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
        }

    def meshes(self, table: Table) -> list[Shape]:
        """Return the meshes of a shape before its transform; those from files bring materials."""
        made = self.call(choice(table, self.makers()), table, extra=SHAPE)
        if isinstance(made, Mesh):
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
        from wrt.io.npy import read_spheres

        with self.at("file"):
            return read_spheres(self.beside(file))

    def quadrics(self, file: Annotated[Any, TEXT]) -> Mesh:
        """Return exact disks and cylinders that `wrt convert` wrote.

        Args:
            file: a NumPy archive (.npz) of their arrays `boxes` (N, 2, 3) and `axes` (N, 3, 3).
        """
        from wrt.io.npy import read_quadrics

        with self.at("file"):
            return read_quadrics(self.beside(file))

    def mesh_file(self, file: Annotated[Any, TEXT], smooth: Annotated[Any, BOOLEAN] = True) -> list[Shape]:
        """Return the shapes of a mesh file.

        Those of a file that several shapes name share its memory.

        Args:
            file: the mesh: OBJ, PLY, STL, OFF, GLB, glTF or .npz.
            smooth: whether its own normals are used, and made where it has none; otherwise triangles are flat.
        """
        boolean(smooth, "smooth")
        with self.at("file"):
            path = self.beside(file)
            key = os.path.realpath(path), smooth
        if key not in self.mesh_files:
            with self.at("file"):
                from wrt.io.load_mesh import load_file

                loaded = load_file(path, smooth_degrees=CREASE_DEGREES if smooth else None).shapes
            if not smooth:
                flat = {id(shape.mesh): replace(shape.mesh, normals=None) for shape in loaded}
                loaded = [replace(shape, mesh=flat[id(shape.mesh)]) for shape in loaded]
            self.mesh_files[key] = loaded
        return self.mesh_files[key]

    def many_triangles(self, triangles: Annotated[Any, {"type": "integer", "minimum": 1000}]) -> Mesh:
        """Return a mountain range.

        Args:
            triangles: how many, 1,000 to 10,000,000.
        """
        from wrt.meshes.many_triangles import terrain

        self.triangles_used = True
        count = integer(triangles, "triangles", minimum=1, maximum=2**31 - 1)
        mesh: Mesh = terrain(count if self.triangles is None else self.triangles)
        return mesh
