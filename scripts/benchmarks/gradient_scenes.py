"""Scenes whose derivatives are compared with Mitsuba's `prb`, and the names of parameters in each renderer."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from peers.mitsuba_scene import load_mitsuba, to_mitsuba
from peers.mitsuba_worker import write_scene
from peers.peer import OWN, prepare, prepare_file

import wrt
from benchmarks.scenes import GGX, ROOT

Arrays = Mapping[str, NDArray[np.float64]]

FILES = ROOT / "scripts" / "data" / "gradients"
"""Mitsuba's files. Derivatives are those by their parameters, the `<default>` elements."""

FIELDS = {
    "reflectance": ("bsdf.brdf_0.reflectance.value",),
    "reflectance.texels": ("bsdf.brdf_0.reflectance.data",),
    "alpha": ("bsdf.brdf_0.alpha_u.value", "bsdf.brdf_0.alpha_v.value"),
    "eta": ("bsdf.brdf_0.eta.value",),
    "k": ("bsdf.brdf_0.k.value",),
    "roughness": ("bsdf.brdf_0.roughness.value",),
    "base_color.texels": ("bsdf.brdf_0.base_color.data",),
    "emission": ("emitter.radiance.value",),
}
"""Mitsuba's names below a shape's, by the end of wrt's."""


def room(**materials: Any) -> wrt.Scene:
    """Return a box with a lamp, open in front, with materials by the names of walls."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0, 1, 3.4), (0, 1, 0), fov_degrees=40.0))
    walls = {
        "floor": ((-1, 0, 1), (2, 0, 0), (0, 0, -2), (0.3, 0.5, 0.4)),
        "ceiling": ((-1, 2, -1), (2, 0, 0), (0, 0, 2), (0.7, 0.65, 0.6)),
        "back": ((-1, 0, -1), (2, 0, 0), (0, 2, 0), (0.7, 0.7, 0.6)),
        "left": ((-1, 0, 1), (0, 0, -2), (0, 2, 0), (0.6, 0.3, 0.2)),
        "right": ((1, 0, -1), (0, 0, 2), (0, 2, 0), (0.2, 0.5, 0.3)),
    }
    for name, (corner, u, v, color) in walls.items():
        scene.add(wrt.quad(corner, u, v), material=materials.get(name, wrt.Diffuse(color)), name=name)
    scene.add(wrt.quad((-0.4, 1.98, -0.4), (0.8, 0, 0), (0, 0, 0.8)), emission=(9.0, 8.0, 7.0), name="lamp")
    return scene


def diffuse() -> wrt.Scene:
    """Return a box of diffuse walls."""
    return room()


def metal() -> wrt.Scene:
    """Return a box with a floor of rough copper."""
    return room(floor=wrt.RoughConductor(alpha=0.3, **GGX))


def principled() -> wrt.Scene:
    """Return a box with a textured metal at its back: Mitsuba has the same model of such a Principled."""
    pixels = np.random.default_rng(3).uniform(0.2, 0.8, (8, 8, 3))
    return room(back=wrt.Principled(wrt.ImageTexture(pixels), metallic=1.0, roughness=0.5))


def environment() -> wrt.Scene:
    """Return a block on a floor in the light of an image."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((1, 1.5, 3.4), (0, 0.3, 0), fov_degrees=40.0))
    scene.add(wrt.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4)), material=wrt.Diffuse((0.3, 0.5, 0.4)), name="floor")
    scene.add(wrt.box((-0.4, 0, -0.4), (0.4, 0.8, 0.4)), material=wrt.Diffuse((0.6, 0.3, 0.2)), name="block")
    scene.environment = wrt.ImageEnvironment(np.random.default_rng(4).uniform(0.2, 3.0, (8, 16, 3)).astype(np.float32))
    return scene


CASES: dict[str, tuple[Callable[[], wrt.Scene], tuple[str, ...]]] = {
    "diffuse": (diffuse, ("floor.reflectance", "left.reflectance", "lamp.emission")),
    "metal": (metal, ("floor.alpha", "floor.eta", "floor.k", "lamp.emission")),
    "principled": (principled, ("back.roughness", "back.base_color.texels", "left.reflectance")),
    "environment": (environment, ("environment.texels", "floor.reflectance", "block.reflectance")),
}
"""Scenes, and the parameters by which they are differentiated."""


def mitsuba_names(scene: wrt.Scene, name: str) -> list[str]:
    """Return what Mitsuba calls a parameter: the sum of the derivatives by these is that by wrt's."""
    if name == "environment.texels":
        return ["environment.data"]
    shape, _, field = name.partition(".")
    number = [each.name for each in scene.shapes].index(shape)
    return [f"shape_{number}.{end}" for end in FIELDS[field]]


def as_ours(name: str, gradient: NDArray[np.float64], shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return Mitsuba's derivative by a parameter in wrt's layout; see `to_mitsuba` for textures."""
    if name == "environment.texels":
        # A column is repeated on either side, and between two rows their mean is.
        gradient = gradient.reshape(2 * shape[0] + 1, shape[1] + 2, 3)
        columns = gradient[:, 1:-1].copy()
        columns[:, -1] += gradient[:, 0]
        columns[:, 0] += gradient[:, -1]
        rows = columns[1::2] + 0.5 * (columns[:-1:2] + columns[2::2])
        rows[0] += 0.5 * columns[0]
        rows[-1] += 0.5 * columns[-1]
        return rows
    gradient = gradient.reshape(shape)
    return gradient[::-1] if name.endswith(".texels") else gradient


class Compared(Protocol):
    """A scene for both renderers, and the derivatives that they have in common.

    Attributes:
        ours: parameters by which wrt differentiates.
        theirs: those of Mitsuba.
    """

    ours: list[str]
    theirs: list[str]

    def prepare_mitsuba(self) -> None:
        """Write the scene for Mitsuba.

        Raises:
            ImportError: if it is not installed.
        """

    def from_ours(self, found: Arrays) -> Arrays:
        """Return the derivatives to compare, from wrt's."""

    def from_theirs(self, found: Arrays) -> Arrays:
        """Return the derivatives to compare, from Mitsuba's."""


class ComparedScene(Compared):
    """A scene of wrt's: the derivatives by its parameters."""

    def __init__(self, name: str, folder: Path, size: int, depth: int) -> None:
        """Write it for wrt, with `size` pixels on each side and paths of at most `depth` segments."""
        make, names = CASES[name]
        self.scene, self._folder = make(), folder
        self.scene.settings = wrt.RenderSettings(width=size, height=size, max_depth=depth, filter="box")
        self._shapes = {key: value.shape for key, value in wrt.parameters(self.scene).items()}
        self.ours = list(names)
        self.theirs = [key for each in names for key in mitsuba_names(self.scene, each)]
        prepare(OWN, self.scene, folder)

    def prepare_mitsuba(self) -> None:
        """Write the scene for Mitsuba; see Compared."""
        settings = self.scene.settings
        size = {"width": settings.width, "height": settings.height}
        tree = to_mitsuba(self.scene, self._folder, **size, max_depth=settings.max_depth)
        tree["integrator"]["type"] = "prb"
        write_scene(tree, self._folder)

    def from_ours(self, found: Arrays) -> Arrays:
        """Return derivatives of wrt; see Compared."""
        return found

    def from_theirs(self, found: Arrays) -> Arrays:
        """Return derivatives of Mitsuba; see Compared."""
        sums = {key: np.sum([found[each] for each in mitsuba_names(self.scene, key)], axis=0) for key in self.ours}
        return {key: as_ours(key, value, self._shapes[key]) for key, value in sums.items()}


STEP = 0.01
"""Change of a file's number, relative to itself. Differences show what depends on it, and how much."""


class ComparedFile(Compared):
    """A file of Mitsuba's: the derivative by the logarithm of each of its parameters, or of an image along one other.

    How a renderer's own parameters depend on the file's is found by reading it with other values.
    """

    def __init__(self, name: str, folder: Path, size: int) -> None:
        """Copy the file, and write images beside it for those parameters that name one."""
        self._file = Path(shutil.copy(FILES / f"{name}.xml", folder))
        defaults = {e.attrib["name"]: e.attrib["value"] for e in ElementTree.parse(self._file).iter("default")}
        self._integrator = {"path": "prb", "volpath": "prbvolpath"}[defaults.pop("integrator")]
        self._changes = {key: self._changed(value) for key, value in defaults.items()}
        values = {"integrator": self._integrator}
        prepare_file(self._file, size, box=True, folder=folder, values=values)
        self._slopes = self._slopes_of(lambda values: wrt.parameters(wrt.load(self._file, parameters=values)))
        self.ours, self.theirs = self._names(self._slopes), []

    def prepare_mitsuba(self) -> None:
        """Write the scene for Mitsuba; see Compared."""
        mi = load_mitsuba()

        def read(values: dict[str, str]) -> dict[str, Any]:
            scene = mi.load_file(str(self._file), **values)  # kept, as its parameters refer to it
            found = mi.traverse(scene)
            return {name: np.array(found[name]) for name in found.keys()}  # noqa: SIM118 - iterated over it yields pairs

        self._their_slopes = self._slopes_of(read)
        self.theirs = self._names(self._their_slopes)

    def from_ours(self, found: Arrays) -> Arrays:
        """Return derivatives of wrt; see Compared."""
        return self._along(self._slopes, found)

    def from_theirs(self, found: Arrays) -> Arrays:
        """Return derivatives of Mitsuba; see Compared."""
        return self._along(self._their_slopes, found)

    def _changed(self, value: str) -> tuple[str, ...]:
        """Return less and more of a value, and write the images if it names one.

        As PNG: on one core Mitsuba 3.9.1 never ends reading EXR.
        """
        from PIL import Image

        if not value.endswith(".png"):
            numbers = np.array(value.split(), float)
            return tuple(" ".join(map(str, factor * numbers)) for factor in (1.0 - STEP, 1.0 + STEP))
        rng = np.random.default_rng(len(value))
        pixels = rng.integers(80, 220, (8, 16, 3), dtype=np.uint8)
        direction = (20.0 * rng.uniform(size=pixels.shape) ** 4).astype(int)
        names = value, f"less-{value}", f"more-{value}"
        for file, sign in zip(names, (0, -1, 1), strict=True):
            Image.fromarray(np.uint8(pixels + sign * direction)).save(self._file.parent / file)
        return names[1:]

    def _slopes_of(self, read: Callable[[dict[str, str]], dict[str, Any]]) -> dict[str, dict[str, NDArray[np.float64]]]:
        """Return the derivatives of a renderer's parameters by each of the file's, if they are not 0."""
        slopes = {}
        for key, ends in self._changes.items():
            less, more = (read({key: end}) for end in ends)
            pairs = {name: [each[name] for each in (less, more)] for name in less}
            changed = {name: pair for name, pair in pairs.items() if (pair[0] != pair[1]).any()}
            slopes[key] = {name: (b.astype(float) - a) / (2.0 * STEP) for name, (a, b) in changed.items()}
        return slopes

    @staticmethod
    def _names(slopes: Mapping[str, Arrays]) -> list[str]:
        return sorted({name for each in slopes.values() for name in each})

    @staticmethod
    def _along(slopes: Mapping[str, Arrays], found: Arrays) -> Arrays:
        return {
            key: np.array(sum(np.vdot(slope, found[name]) for name, slope in each.items()))
            for key, each in slopes.items()
        }


SCENES = (*CASES, *sorted(path.stem for path in FILES.glob("*.xml")))
"""Names of all."""


def compared(name: str, folder: Path, size: int, depth: int) -> Compared:
    """Return one of SCENES, written into a folder."""
    return ComparedScene(name, folder, size, depth) if name in CASES else ComparedFile(name, folder, size)
