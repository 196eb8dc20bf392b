"""One line from anything renderable to a picture."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import os
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.camera import Camera
from wrt.errors import InputError, did_you_mean
from wrt.files import confined_to
from wrt.mesh import Mesh
from wrt.presentation import SETTINGS, present
from wrt.scene import Scene, Shape

MOST_NAMES = 10_000
"""File names of a folder that are searched for one like a missing file's."""
_WITH_AXES = ("glb", "gltf", "npz")
"""File types whose y axis points up."""

_FOR_MESHES = "an up axis goes with a mesh, not with a scene"
_FOR_PROCEDURAL = "a number of triangles goes with a scene that has a procedural mesh"


def load(
    source: Any,
    *,
    triangles: int | None = None,
    up: str | None = None,
    parameters: Mapping[str, Any] | None = None,
    strict: bool = False,
    confined: bool = False,
) -> Scene:
    """Return the scene that `source` stands for.

    Args:
        source: the name of a built-in scene, the path of a scene file (.toml, or .xml of Mitsuba 3) or of a mesh (OBJ,
            PLY, STL, OFF, GLB, glTF), a trimesh object, a Mesh, or a Scene (returned as it is).
            Meshes are put into a studio (see `wrt.presentation`), unless their file has lights of its own; a
            camera of its own is kept. A trimesh object is read like its file, as far as trimesh keeps the file's
            content: materials, colours, up axis, camera and lights.
        triangles: size of the procedural meshes of a scene that has some.
        up: for meshes, the axis that points up: x, y, z, -x, -y or -z. By default y for glTF, which says so, and for
            a Mesh, which has wrt's own axes; for files that do not say, the one of y and z on which the mesh stands
            (see `wrt.orientation.guess_up`), and in doubt z for STL and OFF, which most programs write with z up, and
            y for the others. For a trimesh object the type of the file it was loaded from decides; an object that was
            not loaded from a file, or was copied, is treated like an OBJ file.
        parameters: for Mitsuba's scenes, what `$name` stands for in them.
        strict: whether what would be left out with a warning is an error instead.
        confined: whether to refuse a file that refers to files outside its own folder, as is wise for uploads (see
            docs/security.md).

    Raises:
        InputError: where the source cannot be used, naming it and the cause.
    """
    with _confined(source if confined else None):
        if not strict:
            return _load(source, triangles, up, parameters)
        from wrt.formats.parts import InputWarning

        with warnings.catch_warnings():
            warnings.simplefilter("error", InputWarning)
            try:
                return _load(source, triangles, up, parameters)
            except InputWarning as warning:
                raise InputError(str(warning)) from None


def _confined(source: Any) -> contextlib.AbstractContextManager[None]:
    """Return a context that confines reading to the folder of `source` if it is a path; otherwise to nothing."""
    is_path = isinstance(source, (str, os.PathLike)) and not _is_builtin(source)
    return confined_to(Path(source).parent if is_path else None)


def _is_builtin(source: Any) -> bool:
    from wrt import meshes

    return isinstance(source, str) and source in meshes.scene_names() and not Path(source).is_file()


def _load(source: Any, triangles: int | None, up: str | None, parameters: Mapping[str, Any] | None) -> Scene:
    if isinstance(source, (str, os.PathLike)):
        return _load_path(source, triangles, up, parameters)
    kind = type(source).__name__
    _refuse(parameters, kind)
    if triangles is not None:
        raise InputError(f"{kind}: {_FOR_PROCEDURAL}")
    if isinstance(source, Scene):
        if up is not None:
            raise InputError(f"{kind}: {_FOR_MESHES}")
        return source
    if isinstance(source, Mesh):
        return _present([Shape(source, name=source.name)], up or "y")
    from wrt.formats.meshes import load_object

    scene = load_object(source)
    from wrt.formats.trimesh_objects import file_type

    return _shown("trimesh", scene, up, file_type(source))


def _refuse(parameters: Mapping[str, Any] | None, source: object) -> None:
    """Raise InputError if there are parameters, for a source that is not a Mitsuba scene."""
    if parameters:
        raise InputError(f"{source}: parameters go with a Mitsuba scene (.xml), and with nothing else")


def _load_path(
    source: str | os.PathLike[str], triangles: int | None, up: str | None, parameters: Mapping[str, Any] | None
) -> Scene:
    from wrt import meshes
    from wrt.files import naming

    path = Path(source)
    if not str(source):
        raise InputError("the name of what is to be rendered is empty")
    if _is_builtin(source):
        path = meshes.scene_path(str(source))
    elif not os.path.lexists(path):  # for a broken link, the reader has a better message
        raise InputError(_not_there(source))
    if path.suffix.lower() == ".xml":
        if up is not None or triangles is not None:
            raise InputError(f"{source}: an up axis and a number of triangles are not for Mitsuba's scenes")
        from wrt.formats.kinds import hinting
        from wrt.formats.mitsuba.scene import load_mitsuba

        # What comes of numbers out of range is checked where it is used.
        with naming(path), hinting(path), np.errstate(all="ignore"):
            return load_mitsuba(path, parameters=parameters)
    _refuse(parameters, source)
    if path.suffix.lower() == ".toml":
        if up is not None:
            raise InputError(f"{source}: {_FOR_MESHES}")
        from wrt.formats.scene_toml import load_scene

        return load_scene(path, triangles=triangles)
    if triangles is not None:
        raise InputError(f"{source}: {_FOR_PROCEDURAL}")
    from wrt.formats.meshes import load_file

    scene = load_file(path)
    with naming(path):
        return _shown(source, scene, up, path.suffix.lower().removeprefix("."))


def _not_there(source: str | os.PathLike[str]) -> str:
    """Return the error message for a missing file, with a hint at the nearest name."""
    from wrt import meshes

    path = Path(source)
    known: list[str] = []
    with contextlib.suppress(OSError, ValueError), os.scandir(path.parent) as entries:
        known = [entry.name for entry in itertools.islice(entries, MOST_NAMES)]
    said = f"{source}: no such file"
    if path.parent == Path():
        known += meshes.scene_names()
        if not path.suffix:
            said += f", and no built-in scene of that name ({', '.join(meshes.scene_names())})"
    return said + did_you_mean(path.name, known, likeness=0.75)  # higher than usual: most names share a suffix


def _shown(source: object, scene: Scene, up: str | None, kind: str) -> Scene:
    """Return the content of a mesh file or an object, with its own lights or else in a studio.

    Args:
        source: the file or object, for messages.
        scene: its content.
        up: the axis that points up, if it was given.
        kind: the type of the file, such as "stl"; empty where it is not known.
    """
    if up is None and kind not in _WITH_AXES and not (scene.lights or scene.camera):
        from wrt.orientation import guess_up

        up = guess_up(scene.shapes, "z" if kind in ("stl", "off") else "y")
    if up not in (None, "y") and (scene.lights or scene.camera):
        raise InputError(f"{source}: an up axis is for files without lights and cameras, which would not turn with it")
    if scene.lights:
        scene.settings = dataclasses.replace(SETTINGS)
        return scene
    return _present(scene.shapes, up or "y", scene.camera)


def _present(shapes: list[Shape], up: str, camera: Camera | None = None) -> Scene:
    scene = present(shapes, up=up, rescale=camera is None)
    scene.camera = camera or scene.camera
    return scene


def render(
    source: Any,
    *,
    up: str | None = None,
    parameters: Mapping[str, Any] | None = None,
    strict: bool = False,
    width: int | None = None,
    height: int | None = None,
    spp: int | None = None,
    time: float | None = None,
    device: str = "cpu",
    seed: int = 0,
    threads: int | None = None,
    max_depth: int | None = None,
    crop: tuple[int, int, int, int] | None = None,
    sampler: str | None = None,
    integrator: str | None = None,
) -> NDArray[np.float32]:
    """Render `source` and return (H, W, 3) float32 linear radiance, of the part that `crop` names.

    `source`, `up`, `parameters` and `strict` are those of `load`, the other arguments those of `wrt.Renderer` and its
    `passes`.

    Raises:
        InputError: where something given cannot be used.
    """
    from wrt.pace import LONGEST_PASS
    from wrt.renderer import Renderer

    renderer = Renderer(
        load(source, up=up, parameters=parameters, strict=strict),
        width=width,
        height=height,
        device=device,
        seed=seed,
        threads=threads,
        max_depth=max_depth,
        crop=crop,
        sampler=sampler,
        integrator=integrator,
    )
    for _ in renderer.passes(spp=spp, time=time, pass_seconds=LONGEST_PASS):  # nobody looks at it in between
        pass
    return renderer.image()
