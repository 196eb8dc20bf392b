"""Writing scene files: reading one back gives the same scene, bit for bit.

Tables mirror the dataclasses, without default values. Arrays (meshes, images, instances, deformations) are NumPy files
beside the scene file, since no other format keeps their bits; images that came from 8 bits become PNG files.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import os
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io.images import codes_of, save_codes
from wrt.io.measured.measurement import save_measurement
from wrt.io.npy import arrays_of_exact
from wrt.io.safe_read import PathLike, is_input
from wrt.io.safe_write import Kind, new_folder, output_path, require_writable, write_atomically
from wrt.linalg import product
from wrt.scene.camera import CAMERAS
from wrt.scene.environment import ENVIRONMENTS, ImageEnvironment
from wrt.scene.exact.analytic import Analytic
from wrt.scene.exact.distances import SHAPES, Distances
from wrt.scene.exact.quadrics import Quadrics
from wrt.scene.integrators import Integrator
from wrt.scene.lights import LIGHTS
from wrt.scene.materials import MATERIALS, Material
from wrt.scene.materials.measured import Measurement
from wrt.scene.medium import DensityGrid, Medium
from wrt.scene.mesh import VERTEX_ATTRIBUTES
from wrt.scene.motion import Motion
from wrt.scene.procedural import TEXTURES
from wrt.scene.scene import Scene, Shape, require_scene
from wrt.scene.textures import ImageTexture, NormalMap, Texture, VertexColor

Table = dict[str, Any]

_ARRAYS = re.compile(
    r"(mesh|spheres|quadrics|image|normals|environment|places|deformation|density|measurement)-\d+\.(np[yz]|png|bsdf)"
)
"""Names of array and image files."""

_MOST_FOLDERS = 100

SCENE = Kind("", lambda _: False)  # a scene file; a person may have written or edited it


def save_scene(path: PathLike, scene: Scene, *, force: bool = False) -> None:
    """Write a scene file, and beside it a folder with its arrays; or a GLB file.

    The folder is named like the file, with `_files` in place of the suffix, or `_files-2` if that exists. The scene
    file is written last, so that an old one stays whole until then. It is replaced only with `force`, and never if
    this process has read it.

    Args:
        path: ends in .toml, or in .glb for other programs: one warning then names what glTF cannot hold.
        scene: the scene.
        force: whether to replace a scene file and its arrays.

    Raises:
        InputError: where it cannot be written, or holds what is not registered, or not numbers, text and arrays.
    """
    file = output_path(path, "a scene file")
    require_scene(scene, str(file))
    if file.suffix.lower() == ".glb":
        from wrt.io.gltf.writer import save_glb

        save_glb(file, scene, force=force)
        return
    import tomli_w

    if file.suffix.lower() != ".toml":
        raise InputError(f"{file}: the name of a scene file must end in .toml or .glb; wrt.save_image writes pictures")
    require_writable(file, SCENE, force=force)
    replaces = force and file.exists()
    arrays = next((folder for folder in _folders(file) if not os.path.lexists(folder)), None)
    if arrays is None:
        raise InputError(f"{file}: there are {_MOST_FOLDERS} folders for its arrays already; name another file")
    with new_folder(arrays) as folder:
        text = tomli_w.dumps(_Writer(folder, arrays.name).scene(scene))
        write_atomically(file, lambda temporary: _write_text(temporary, text), SCENE, force=force)
    if replaces:
        for folder in _folders(file):
            if folder != arrays:
                _remove_arrays(folder)


def _folders(file: Path) -> Iterator[Path]:
    """Yield the folders that may hold the arrays of a scene file."""
    first = file.with_name(f"{file.stem}_files")
    yield first
    yield from (first.with_name(f"{first.name}-{number}") for number in range(2, _MOST_FOLDERS))


def _remove_arrays(folder: Path) -> None:
    """Remove the files of `save_scene` from a folder, unless this process has read them."""
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            if _ARRAYS.fullmatch(path.name) and not path.is_symlink() and not is_input(path):
                path.unlink()
        folder.rmdir()


class _Writer:
    """Turns objects into tables; shared objects are written once."""

    def __init__(self, folder: Path, called: str) -> None:
        """Write arrays into a folder that the scene file will refer to as `called`."""
        self.folder, self.called = folder, called
        self.counts: Counter[str] = Counter()
        self.names: dict[int, str] = {}
        self.kept: list[Any] = []  # named objects, kept so that their ids stay unique
        self.materials: Table = {}
        self.media: Table = {}

    def scene(self, scene: Scene) -> Table:
        tree: Table = {
            "settings": self.fields(scene.settings),
            "camera": scene.camera and self.typed(scene.camera, CAMERAS),
            "environment": scene.environment and self.environment(scene.environment),
            "lights": [self.typed(light, LIGHTS) for light in scene.lights] or None,
        }
        shapes = [self.shapes(list(group)) for _, group in itertools.groupby(scene.shapes, _key_of_group)]
        tree["medium"] = scene.medium and self.medium(scene.medium)
        tree |= {"media": self.media or None, "materials": self.materials or None, "shapes": shapes}
        return {key: table for key, table in tree.items() if table is not None}

    def typed(self, thing: Any, classes: dict[str, Any]) -> Table:
        """Return the table of an object of one of several classes."""
        name = next((name for name, cls in classes.items() if cls is type(thing)), None)
        if name is None:
            raise InputError(f"{type(thing).__name__}: a scene file holds only what is registered")
        return {"type": name, **self.fields(thing)}

    def fields(self, thing: Any, *, without: tuple[str, ...] = ()) -> Table:
        """Return the fields of a dataclass that differ from their defaults."""
        table = {}
        for field in dataclasses.fields(thing):
            value = getattr(thing, field.name)
            if value is None or field.name in without or _is_default(value, field):
                continue
            table[field.name] = self.value(value)
        return table

    def value(self, value: Any) -> Any:
        """Return a value as TOML has it."""
        if isinstance(value, (ImageTexture, NormalMap)):
            is_normals = isinstance(value, NormalMap)
            pixels: Any = value.pixels
            table = self.image("normals" if is_normals else "image", pixels, linear=is_normals)
            return {**table, **self.fields(value, without=("pixels", "name"))}
        if isinstance(value, VertexColor):
            return {"vertex_colors": True, **self.fields(value)}
        if isinstance(value, Texture):
            return self.typed(value, TEXTURES)
        if isinstance(value, Medium):
            return self.medium(value)
        if isinstance(value, DensityGrid):
            return self.density(value)
        if isinstance(value, Measurement):
            return self.written("measurement", value, ".bsdf", lambda handle: save_measurement(handle, value))
        if isinstance(value, Motion):
            return self.motion(value)
        if isinstance(value, Material):
            return self.material(value)
        if isinstance(value, Integrator):
            return {"type": value.type_name, **self.fields(value)}
        if isinstance(value, (list, tuple)):
            return [self.value(item) for item in value]
        if isinstance(value, (np.ndarray, np.generic)):
            return value.tolist()
        if not isinstance(value, (bool, int, float, str, dict)):
            raise InputError(f"a scene file cannot hold a {type(value).__name__}")
        return value

    def environment(self, environment: Any) -> Table:
        if isinstance(environment, ImageEnvironment):
            file = self.array("environment", environment.pixels, environment.pixels)
            return {"type": "image", "file": file, **self.fields(environment, without=("pixels", "name"))}
        return self.typed(environment, ENVIRONMENTS)

    def medium(self, medium: Medium) -> str:
        return self.named(medium, "medium", self.media, lambda: self.fields(medium))

    def density(self, density: DensityGrid) -> Table:
        names = ("lower", "upper", "transform", "albedo", "emission")
        file = self.arrays("density", density, {"density": density.values, **_arrays_of(density, *names)})
        return {"file": file, **self.fields(density, without=("values", "name", *names))}

    def material(self, material: Material) -> str:
        return self.named(material, "material", self.materials, lambda: self.typed(material, MATERIALS))

    def named(self, thing: Any, kind: str, tables: Table, make: Any) -> str:
        """Return the name of an object's table, which is made the first time."""
        if id(thing) not in self.names:
            self.kept.append(thing)
            table = make()  # parts first, so that a file defines names before it uses them
            self.names[id(thing)] = f"{kind}-{len(tables)}"
            tables[self.names[id(thing)]] = table
        return self.names[id(thing)]

    def motion(self, motion: Motion) -> Table:
        keys = [
            {"time": time, "matrix": matrix[:3].tolist()}
            for time, matrix in zip(motion.times.tolist(), motion.transforms, strict=True)
        ]
        return {"center": list(motion.center), "keys": keys}

    def shapes(self, shapes: list[Shape]) -> Table:
        """Return one table for shapes that differ only in their transform."""
        shape, mesh = shapes[0], shapes[0].mesh
        table: Table = {"type": "mesh", "name": shape.name}
        if isinstance(mesh, Distances):
            table |= self.typed(mesh.description, SHAPES)
            shapes = [_with_own_matrix(each, mesh) for each in shapes]
            shape = shapes[0]
        elif isinstance(mesh, Analytic):
            table["type"] = "quadrics" if isinstance(mesh, Quadrics) else "spheres"
            table["file"] = self.arrays(table["type"], mesh, arrays_of_exact(mesh))
        else:
            arrays = _arrays_of(mesh, "vertices", "faces", *VERTEX_ATTRIBUTES, "sides")
            table["file"] = self.arrays("mesh", mesh, arrays)
        table["material"] = self.material(shape.material)
        if shape.emits and shape.emission is not shape.material.emission and shape.emission != shape.material.emission:
            table["emission"] = self.value(shape.emission)
        if shape.two_sided_emission:
            table["two_sided_emission"] = True
        if not shape.double_sided:
            table["double_sided"] = False
        if shape.shadow_catcher:
            table["shadow_catcher"] = True
        if not shape.edges:
            table["edges"] = False
        if shape.group is not None:
            table["group"] = shape.group
        if isinstance(shape.transform, Motion):
            table["motion"] = self.motion(shape.transform)
        elif shape.transform is not None:
            places = np.stack([np.asarray(each.transform) for each in shapes])
            table["instances"] = self.array("places", shape, places)
        if shape.deformation is not None:
            arrays = _arrays_of(shape.deformation, "times", "vertices", "normals")
            table["deformation"] = {"file": self.arrays("deformation", shape.deformation, arrays)}
        return table

    def image(self, kind: str, pixels: NDArray[np.float32], *, linear: bool) -> Table:
        """Return the keys of a texture, an image of 8 bits if its values are those of one; `linear` is the default."""
        for is_linear in (linear, not linear):
            codes = codes_of(pixels, linear=is_linear)
            if codes is not None:
                file = self.written(kind, pixels, ".png", lambda handle, codes=codes: save_codes(handle, codes))
                return {"texture": file} | ({} if is_linear == linear else {"linear": is_linear})
        return {"texture": self.array(kind, pixels, pixels)}

    def array(self, kind: str, owner: Any, array: NDArray[Any]) -> str:
        """Write an array once per owner; return its file name relative to the scene file."""
        return self.written(kind, owner, ".npy", lambda handle: np.save(handle, array))

    def arrays(self, kind: str, owner: Any, arrays: dict[str, NDArray[Any]]) -> str:
        return self.written(kind, owner, ".npz", lambda handle: np.savez(handle, **arrays))  # type: ignore[arg-type]

    def written(self, kind: str, owner: Any, suffix: str, save: Any) -> str:
        if id(owner) not in self.names:
            self.kept.append(owner)
            self.names[id(owner)] = name = f"{kind}-{self.counts[kind]}{suffix}"
            self.counts[kind] += 1

            def write(temporary: Path) -> None:
                with temporary.open("wb") as handle:
                    save(handle)

            write_atomically(self.folder / name, write, SCENE)
        return f"{self.called}/{self.names[id(owner)]}"


def _write_text(file: Path, text: str) -> None:
    file.write_text(text, encoding="utf-8")


def _key_of_group(shape: Shape) -> tuple[Any, ...]:
    """Return what instances of one shape have in common: all but where they are."""
    if shape.transform is None or isinstance(shape.transform, Motion):
        return (id(shape),)
    objects = (id(each) for each in (shape.mesh, shape.material, shape.deformation))
    flags = (shape.two_sided_emission, shape.double_sided, shape.edges, shape.shadow_catcher, shape.group)
    return (*objects, shape.name, *flags, shape.emission)


def _with_own_matrix(shape: Shape, mesh: Distances) -> Shape:
    """Return a shape whose transform is from the own space of its distance function."""
    if np.array_equal(mesh.matrix, np.eye(4)) and not mesh.turned:
        return shape
    if mesh.turned or isinstance(shape.transform, Motion):
        raise InputError(
            f"{shape.name}: a scene file cannot hold an own shape that is inside out, or moves after a transform"
        )
    return dataclasses.replace(shape, transform=product(shape.transform_at(0.0), mesh.matrix))


def _arrays_of(thing: Any, *names: str) -> dict[str, NDArray[Any]]:
    """Return the arrays that an object has, by name."""
    return {name: np.asarray(value) for name in names if (value := getattr(thing, name)) is not None}


def _is_default(value: Any, field: dataclasses.Field[Any]) -> bool:
    if field.default is dataclasses.MISSING or not isinstance(value, (bool, int, float, str, tuple)):
        return False
    return bool(value == field.default or (isinstance(value, tuple) and value == (field.default,) * len(value) != ()))
