"""`load`: from a file, a mesh or an object to a scene."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import os
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from wrt.errors import InputError, InputWarning, did_you_mean, name_of
from wrt.io.archives import first_of, unpacked
from wrt.io.file_type import USD_SUFFIXES, renderable
from wrt.io.safe_read import PathLike, confined_to, confinement_folder
from wrt.scene.camera import Camera
from wrt.scene.developing import names_file
from wrt.scene.environment import Environment
from wrt.scene.materials import Material
from wrt.scene.mesh import Mesh
from wrt.scene.scene import RenderSettings, Scene, Shape
from wrt.studio.stage import FOR_ANIMATIONS, Stage
from wrt.studio.views import ViewLike
from wrt.values import ColorLike, number, one_of

MOST_NAMES = 10_000
"""Maximum number of file names in a folder to search for one similar to a missing file's."""

_UP = {**dict.fromkeys(("glb", "gltf", "npz", "usd", "usda", "usdc", "usdz"), "y"), "3mf": "z"}
"""The axis that points up in files of a type, by its specification."""


def load(
    source: Any,
    *,
    triangles: int | None = None,
    up: str | None = None,
    parameters: Mapping[str, Any] | None = None,
    camera: Camera | int | str | None = None,
    cameras: PathLike | None = None,
    smooth_degrees: float | None = None,
    strict: bool = False,
    confined: bool = False,
    view: ViewLike | None = None,
    frame: bool | None = None,
    material: Material | ColorLike | PathLike | None = None,
    environment: Environment | PathLike | None = None,
    transparent: bool = False,
    shadow_catcher: bool = False,
    double_sided: bool = False,
    aspect: float | None = None,
    time: float | None = None,
    point_radius: float | None = None,
    file_type: str | None = None,
) -> Scene:
    """Load a scene.

    Args:
        source: the name of a built-in scene, the path of a scene file (.toml, or .xml of Mitsuba 3) or of a mesh (OBJ,
            PLY, STL, OFF, GLB, glTF); an archive (.zip, .gz, .bz2, .xz) with one of these, or archive.zip/scene.xml;
            bytes or an open file; an object of trimesh, PyVista, Open3D, or with `vertices` and `faces`; a `Mesh`,
            or a `Scene` (returned unchanged). Meshes are put into a studio unless their file has lights; a camera in
            the file is kept if it shows the mesh well.
        triangles: number of triangles of a scene's procedural meshes.
        up: for meshes, the axis that points up: x, y, z, -x, -y or -z. The default is y for glTF and a `Mesh`, z for
            3MF, and what a COLLADA or USD file says. For other files it is the one of y and z on which the mesh stands;
            in doubt z for STL and OFF, and y for the others. A trimesh object follows the type of its file, and without
            one is treated like an OBJ file.
        parameters: values of the parameters `$name` of a Mitsuba scene.
        camera: a camera, for which the source keeps its place, too; or the name of one of the source's cameras, or its
            number from 0; by default the first, with a warning if there are several.
        cameras: a file of cameras, see `wrt.load_cameras`, which replace the source's; `camera` chooses among them. The
            source keeps its place, and gets no backdrop from the studio.
        smooth_degrees: for meshes without normals, edges folded by up to this angle are smoothed; 0 leaves them flat.
            The default is what the format says, or 60.
        strict: whether unsupported content raises an error instead of a warning.
        confined: whether to refuse references to files outside the source's folder, as for uploads.
        view: where to look from: "AZIMUTH,ELEVATION" or the two angles in degrees, or "front", "right", "back", "left",
            "top", "bottom" or "three-quarter". 0,0 is from the front, +z; the azimuth grows towards +x.
        frame: True frames everything except floors, backdrops and lamps, from the direction of the view or the camera;
            False keeps the camera. By default a camera in a mesh's file is replaced, with a warning, if the mesh fills
            less than half of its picture.
        material: replaces the materials of a mesh: a material, a colour, an image file, or a text such as "gold".
        environment: replaces the studio's light or the scene's environment: an environment, an image file, or "sky".
        transparent: leave out the studio's backdrop, and set `RenderSettings.transparent`.
        shadow_catcher: whether a mesh in the studio stands on flat ground that shows only its shadow, in place of the
            backdrop; the picture is transparent (docs/first-pictures.md).
        double_sided: whether everything is seen from behind, also what a file calls single-sided.
        aspect: width of the picture over its height, for framing; by default from the scene's settings.
        time: seconds, in the first animation of a glTF file or after the first time code of a USD file; by default the
            file is at rest, or at that first time.
        point_radius: radius of the spheres that points are drawn as, in the file's units; by default by their
            distances.
        file_type: type of bytes, or of an open file without a name, such as "glb".

    Raises:
        InputError: if the source cannot be used; the message names it and the cause.
    """
    if camera is not None and view is not None:
        raise InputError("a view replaces the source's camera; choose a view or a camera")
    if up is not None and (cameras is not None or isinstance(camera, Camera)):
        raise InputError("an up axis would turn the source, but not a camera that is not its own")
    others = _other_cameras(camera, cameras, confined)
    reading = _reading(triangles, up, parameters, None if others else camera, smooth_degrees, point_radius)
    if frame is None and view is None and (others or camera is not None):
        frame = False  # a camera that was chosen is kept
    stage = Stage(
        view, frame, material, environment, transparent, aspect, time, cameras=others, shadow_catcher=shadow_catcher
    )
    return _loaded(source, reading, stage, strict, confined, double_sided, file_type)


def load_contents(
    source: Any,
    *,
    up: str | None = None,
    parameters: Mapping[str, Any] | None = None,
    camera: int | str | None = None,
    smooth_degrees: float | None = None,
    point_radius: float | None = None,
    strict: bool = False,
    confined: bool = False,
    double_sided: bool = False,
) -> Scene:
    """Load a scene as `load` does, or what a mesh file holds, without a studio and where it is in the file."""
    reading = _reading(None, up, parameters, camera, smooth_degrees, point_radius)
    return _loaded(source, reading, Stage(is_bare=True), strict, confined, double_sided, None)


def _other_cameras(camera: Camera | int | str | None, cameras: PathLike | None, confined: bool) -> dict[str, Camera]:
    """Return the cameras that replace those of a source by their names, the one in use first."""
    if cameras is None:
        return {"camera": camera} if isinstance(camera, Camera) else {}
    from wrt.io.camera_files import load_cameras
    from wrt.io.cameras import number_of

    if isinstance(camera, Camera):
        raise InputError("choose a camera or a file of cameras")
    found = {name: each.camera for name, each in load_cameras(cameras, confined=confined).items()}
    first = list(found)[0 if camera is None else number_of(cameras, list(found), camera)]
    return {first: found[first], **found}


def _reading(
    triangles: int | None,
    up: str | None,
    parameters: Mapping[str, Any] | None,
    camera: Camera | int | str | None,
    smooth_degrees: float | None,
    point_radius: float | None,
) -> dict[str, Any]:
    smooth = None if smooth_degrees is None else number(smooth_degrees, "smooth_degrees", minimum=0.0)
    if up is not None:
        from wrt.studio.presentation import UP_ROTATIONS

        one_of(up, tuple(UP_ROTATIONS), "up")
    reading: dict[str, Any] = {"triangles": triangles, "up": up, "parameters": parameters or None, "camera": camera}
    return reading | {"smooth_degrees": smooth, "point_radius": point_radius}


def _loaded(
    source: Any,
    reading: _Reading,
    stage: Stage,
    strict: bool,
    confined: bool,
    double_sided: bool,
    file_type: str | None,
) -> Scene:
    with _strictly() if strict else contextlib.nullcontext(), unpacked(source, file_type) as file:
        folder = confinement_folder() if file is not source else _folder_of(source)
        with confined_to(folder) if confined else contextlib.nullcontext():
            scene = _load(file, reading, stage)
    if double_sided and not all(shape.double_sided for shape in scene.shapes):
        scene = dataclasses.replace(scene, shapes=[_both_sides(shape) for shape in scene.shapes])
    if confined and scene is not source and names_file(scene.settings.tone):
        # Such a configuration names further files, which OpenColorIO opens when a picture is developed.
        raise InputError(f"{source}: tone {scene.settings.tone!r} names a file, which is not read in confinement")
    return scene


def _both_sides(shape: Shape) -> Shape:
    return shape if shape.double_sided else dataclasses.replace(shape, double_sided=True)


def load_with_settings(source: Any, settings: Mapping[str, Any], **options: Any) -> Scene:
    """Load a scene to be rendered, and override its settings.

    Args:
        source: as for `load`.
        settings: values of fields of `wrt.RenderSettings` by name; None keeps the scene's own value.
        options: as for `load`; a width and a height among the settings are the aspect.

    Raises:
        InputError: see `load`; also if the picture is to be denoised and Open Image Denoise is not installed.
    """
    width, height = settings.get("width"), settings.get("height")
    if settings.get("background") is not None:
        options["transparent"] = True  # nothing else is behind what it shows
    scene = load(source, aspect=width / height if width and height else None, **options)
    scene = dataclasses.replace(scene, settings=scene.settings.changed(**settings))
    if scene.settings.denoise:
        from wrt.develop.denoise import require_denoiser

        require_denoiser()
    return scene


def split_settings(options: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Split keyword arguments into fields of `wrt.RenderSettings` and the others, which are options of `load`."""
    names = {field.name for field in dataclasses.fields(RenderSettings)} - {"transparent"}  # `load` sets that one
    settings = {name: value for name, value in options.items() if name in names}
    return settings, {name: value for name, value in options.items() if name not in names}


@contextlib.contextmanager
def _strictly() -> Iterator[None]:
    """Within the context, make each InputWarning an InputError."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", InputWarning)
        try:
            yield
        except InputWarning as warning:
            raise InputError(str(warning)) from None


def _folder_of(source: Any) -> Path | None:
    """Return the folder of `source` if it is a path."""
    return Path(source).parent if isinstance(source, (str, os.PathLike)) and not is_builtin(source) else None


def is_builtin(source: Any) -> bool:
    """Return whether a source is the name of a built-in scene; a file of that name comes first."""
    from wrt import meshes

    return isinstance(source, str) and source in meshes.scene_names() and not Path(source).is_file()


_Reading = Mapping[str, Any]
"""The options of `load` that apply to one kind of source each; None where an option is not given."""

_ONLY_FOR = {
    "triangles": "a number of triangles is for scenes with a procedural mesh",
    "up": "an up axis is for meshes, not for scenes",
    "parameters": "parameters are only for Mitsuba scenes (.xml)",
    "point_radius": "a radius of points is for mesh files and trimesh objects",
    "camera": "a camera is chosen in files that may have several; this has one at most",
    "smooth_degrees": "an angle up to which edges are smooth is for mesh files, not for scenes",
}


def _require_only(source: object, reading: _Reading, *applicable: str) -> None:
    """Raise InputError if an option is given that does not apply to a source."""
    for name, message in _ONLY_FOR.items():
        if name not in applicable and reading[name] is not None:
            raise InputError(f"{source}: {message}")


def _load(source: Any, reading: _Reading, stage: Stage) -> Scene:
    if isinstance(source, (str, os.PathLike)):
        return _load_path(source, reading, stage)
    kind = type(source).__name__
    if stage.time is not None:
        raise InputError(f"{kind}: {FOR_ANIMATIONS}")
    if isinstance(source, Scene):
        _require_only(kind, reading)
        source.check()
        return stage.shown(source)
    of_files = () if isinstance(source, Mesh) else ("smooth_degrees", "point_radius")
    _require_only(kind, reading, "up", *of_files)
    if isinstance(source, Mesh):
        from wrt.io.mesh.repair import bare_shape

        shapes = [bare_shape(source) if stage.material is None else Shape(source, name=source.name)]
        return stage.present(source, Scene(shapes), reading["up"] or "y")
    from wrt.io.load_mesh import load_object

    surface: dict[str, Any] = {name: reading[name] for name in of_files}
    from wrt.io.other_libraries import as_trimesh
    from wrt.io.trimesh_objects import file_type

    source = as_trimesh(source)
    scene = load_object(source, standalone=True, in_place=bool(stage.cameras), **surface)

    return _present(source, scene, reading["up"], file_type(source), stage)


def _load_path(source: PathLike, reading: _Reading, stage: Stage) -> Scene:
    from wrt import meshes
    from wrt.io.safe_read import naming_file

    path = Path(source)
    if not str(source):
        raise InputError("the name of the input is empty")
    if is_builtin(source):
        path = meshes.scene_path(str(source))
    elif not os.path.lexists(path):  # the reader has a better message for a broken link
        raise InputError(_missing_file(source))
    elif path.is_dir():
        found: list[str] = []
        with contextlib.suppress(OSError):
            scenes, mesh_files = renderable(path, itertools.islice(path.iterdir(), MOST_NAMES))
            found = [*scenes, *mesh_files]
        advice = (
            f"name a file in it, such as {path / found[0]}: {first_of(found)}" if found else "nothing in it is rendered"
        )
        raise InputError(f"{source}: is a directory; {advice}")
    suffix = path.suffix.lower()
    if suffix == ".xml":
        _require_only(source, reading, "parameters", "camera")
        from wrt.io.file_type import hinting
        from wrt.io.mitsuba.scene import load_mitsuba

        # Overflow is not reported here: values are checked where they are used.
        with naming_file(path), hinting(path), np.errstate(all="ignore"):
            return stage.shown(load_mitsuba(path, parameters=reading["parameters"], camera=reading["camera"]))
    if suffix == ".toml":
        _require_only(source, reading, "triangles")
        from wrt.io.toml.reader import load_scene

        loaded = load_scene(path, triangles=reading["triangles"])
        with naming_file(path):
            return stage.shown(loaded)
    surface = {name: reading[name] for name in ("smooth_degrees", "point_radius")}
    _require_only(source, reading, "up", "camera", *surface)
    from wrt.io.cameras import note_several, with_camera
    from wrt.io.load_mesh import load_file

    camera, up = reading["camera"], reading["up"]
    if stage.time is not None:
        from wrt.animation.timeline import reach_of_file

        stage = dataclasses.replace(stage, reach=reach_of_file(path, camera, up))
    # A bare file is not moved to the origin.
    in_place = stage.is_bare or bool(stage.cameras)
    scene = load_file(path, time=stage.time, standalone=stage.time is None, in_place=in_place, up=up, **surface)
    if up is not None and suffix in USD_SUFFIXES:
        up = "y"
    scene = with_camera(path, scene, camera)
    if stage.is_bare:
        return _upright(source, scene, up or "y", stage)
    if camera is None and stage.view is None and not stage.cameras:
        note_several(path, list(scene.cameras))
    if up is None and suffix == ".dae":
        from wrt.io.mesh.collada import declared_up

        up = declared_up(path)
    with naming_file(path):
        return _present(source, scene, up, suffix.removeprefix("."), stage)


def _missing_file(source: PathLike) -> str:
    """Return the error message for a missing file, with the most similar name."""
    from wrt import meshes

    path = Path(source)
    if str(source) == "-":
        return f"{source}: no such file; standard input is not read"
    if "://" in str(source):
        return f"{source}: no such file; download it first, and name the file"
    names: list[str] = []
    with contextlib.suppress(OSError, ValueError), os.scandir(path.parent) as entries:
        names = [entry.name for entry in itertools.islice(entries, MOST_NAMES)]
    message = f"{source}: no such file"
    if path.parent == Path():
        names += meshes.scene_names()
        if not path.suffix:
            message += f", and no built-in scene of that name ({', '.join(meshes.scene_names())})"
    return message + did_you_mean(path.name, names, likeness=0.75)  # above the default, since most names share a suffix


def _present(source: object, scene: Scene, up: str | None, kind: str, stage: Stage) -> Scene:
    """Return the content of a mesh file or object, with its own lights or in a studio.

    Args:
        source: the file or object, for messages.
        scene: its content.
        up: the up axis that was given, or None.
        kind: the file type, such as "stl"; empty if unknown.
        stage: how to show it.
    """
    neutral = kind in ("glb", "gltf")
    if stage.cameras:  # these are in the source's own coordinates, which stay
        return stage.present(source, scene, "y", neutral=neutral)
    if up is None and not (scene.lights or scene.camera):
        from wrt.studio.orientation import guess_up

        up = _UP.get(kind) or guess_up(scene.shapes, "z" if kind in ("stl", "off") else "y")
    if up is not None and (scene.lights or scene.camera):
        scene, up = _upright(name_of(source), scene, up, stage), "y"
    return stage.present(source, scene, up or "y", neutral=neutral)


def _upright(name: object, scene: Scene, up: str, stage: Stage) -> Scene:
    """Return the content of a file, turned to bring an axis to +y, or raise InputError if it cannot be turned."""
    if up == "y":
        return scene
    if scene.lights or stage.time is not None:
        raise InputError(f"{name}: an up axis is for files without lights and animations: it would not turn these")
    from wrt.studio.presentation import upright

    return upright(scene, up)
