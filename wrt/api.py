"""`load` and `render`: from a file, mesh or scene to a picture."""

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
from numpy.typing import NDArray

from wrt.developing import names_file
from wrt.errors import InputError, InputWarning, did_you_mean, name_of, warn
from wrt.io.safe_read import PathLike, confined_to
from wrt.scene.environment import Environment
from wrt.scene.materials import Material
from wrt.scene.mesh import Mesh
from wrt.scene.scene import Scene, Shape
from wrt.studio.stage import FOR_ANIMATIONS, Stage, make_stage
from wrt.studio.views import ViewLike

MOST_NAMES = 10_000
"""Maximum number of file names in a folder to search for one similar to a missing file's."""
_WITH_AXES = ("glb", "gltf", "npz", "usd", "usda", "usdc", "usdz")
"""File types whose y axis points up."""

_FOR_MESHES = "an up axis is for meshes, not for scenes"
_FOR_PROCEDURAL = "a number of triangles is for scenes with a procedural mesh"


def load(
    source: Any,
    *,
    triangles: int | None = None,
    up: str | None = None,
    parameters: Mapping[str, Any] | None = None,
    sensor: int | None = None,
    strict: bool = False,
    confined: bool = False,
    view: ViewLike | None = None,
    frame: bool | None = None,
    material: Material | str | None = None,
    environment: Environment | PathLike | None = None,
    transparent: bool = False,
    aspect: float | None = None,
    time: float | None = None,
) -> Scene:
    """Load a scene.

    Args:
        source: the name of a built-in scene, the path of a scene file (.toml, or .xml of Mitsuba 3) or of a mesh (OBJ,
            PLY, STL, OFF, GLB, glTF), a trimesh object, a Mesh, or a Scene (returned unchanged).
            Meshes are put into a studio (see `wrt.studio.presentation`) unless their file has lights; a camera in the
            file is kept if it shows the mesh well. A trimesh object is read like its file, as far as trimesh keeps the
            file's content: materials, colours, up axis, camera and lights.
        triangles: number of triangles of a scene's procedural meshes.
        up: for meshes, the axis that points up: x, y, z, -x, -y or -z. The default is y for glTF, by its
            specification, and for a Mesh, which has wrt's axes; a COLLADA file names its own. For other files it is the
            one of y and z on which the mesh stands (see `wrt.studio.orientation.guess_up`); in doubt z for STL and OFF,
            as most programs write them, and y for the others. A trimesh object follows the type of the file it was
            loaded from; an object that was not loaded from a file, or was copied, is treated like an OBJ file.
        parameters: values of the parameters `$name` of a Mitsuba scene.
        sensor: which sensor of a Mitsuba scene is the camera, counted from 0; by default the first.
        strict: whether unsupported content raises an error instead of a warning.
        confined: whether to refuse references to files outside the source's folder, as is wise for uploads (see
            docs/security.md).
        view: where to look from, instead of the source's camera: "AZIMUTH,ELEVATION" or the two angles in degrees, or
            "front", "right", "back", "left", "top", "bottom" or "three-quarter". 0,0 is from the front, +z, and the
            azimuth grows towards +x. The studio's light comes from the camera's side.
        frame: True ignores the source's camera, and frames what it shows without floors, backdrops and lamps; False
            keeps the camera. Without a view a scene is framed from its camera's direction. By default a camera in a
            mesh's file is replaced, with a warning, if the mesh fills less than half of its picture.
        material: replaces the materials of a mesh: a material, or a text such as "gold" (see
            `wrt.scene.materials.named.named_material`).
        environment: replaces the studio's light, or the scene's own environment: an environment, an image file, or
            "sky" for a clear sky with the sun, at the radiance of an exposed picture.
        transparent: leave out the studio's backdrop, and set `RenderSettings.transparent`.
        aspect: width of the picture over its height, for framing; by default that of the scene's settings.
        time: the time, seconds, at which the first animation of a glTF file is; by default the file is at rest. Studio
            and camera are the same for all times.

    Raises:
        InputError: if the source cannot be used; the message names it and the cause.
    """
    stage = make_stage(
        view=view,
        frame=frame,
        material=material,
        environment=environment,
        transparent=transparent,
        aspect=aspect,
        time=time,
    )
    with _confined(source if confined else None), _strictly() if strict else contextlib.nullcontext():
        scene = _load(source, triangles, up, parameters, sensor, stage)
    if confined and scene is not source and names_file(scene.settings.tone):
        # Such a configuration names further files, which OpenColorIO opens when a picture is developed.
        raise InputError(f"{source}: tone {scene.settings.tone!r} names a file, which is not read in confinement")
    return scene


@contextlib.contextmanager
def _strictly() -> Iterator[None]:
    """Within the context, make each InputWarning an InputError."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", InputWarning)
        try:
            yield
        except InputWarning as warning:
            raise InputError(str(warning)) from None


def _confined(source: Any) -> contextlib.AbstractContextManager[None]:
    """Return a context that confines reading to the folder of `source` if it is a path."""
    is_path = isinstance(source, (str, os.PathLike)) and not _is_builtin(source)
    return confined_to(Path(source).parent if is_path else None)


def _is_builtin(source: Any) -> bool:
    from wrt import meshes

    return isinstance(source, str) and source in meshes.scene_names() and not Path(source).is_file()


def _load(
    source: Any,
    triangles: int | None,
    up: str | None,
    parameters: Mapping[str, Any] | None,
    sensor: int | None,
    stage: Stage,
) -> Scene:
    if isinstance(source, (str, os.PathLike)):
        return _load_path(source, triangles, up, parameters, sensor, stage)
    kind = type(source).__name__
    _refuse(parameters, sensor, kind)
    if triangles is not None:
        raise InputError(f"{kind}: {_FOR_PROCEDURAL}")
    if stage.time is not None:
        raise InputError(f"{kind}: {FOR_ANIMATIONS}")
    if isinstance(source, Scene):
        if up is not None:
            raise InputError(f"{kind}: {_FOR_MESHES}")
        source.check()
        return stage.shown(source)
    if isinstance(source, Mesh):
        from wrt.io.mesh.repair import bare_shape

        shapes = [bare_shape(source) if stage.material is None else Shape(source, name=source.name)]
        if up is None:
            _name_land(source.name, shapes, "y")
        return stage.present(source, Scene(shapes), up or "y")
    from wrt.io.load_mesh import load_object

    scene = load_object(source, alone=True)
    from wrt.io.trimesh_objects import file_type

    return _shown(source, scene, up, file_type(source), stage)


def _refuse(parameters: Mapping[str, Any] | None, sensor: int | None, source: object) -> None:
    """Raise InputError if there are parameters or a sensor, since the source is not a Mitsuba scene."""
    if parameters:
        raise InputError(f"{source}: parameters are only for Mitsuba scenes (.xml)")
    if sensor is not None:
        raise InputError(f"{source}: the number of a sensor is only for Mitsuba scenes (.xml)")


def _load_path(
    source: PathLike,
    triangles: int | None,
    up: str | None,
    parameters: Mapping[str, Any] | None,
    sensor: int | None,
    stage: Stage,
) -> Scene:
    from wrt import meshes
    from wrt.io.safe_read import naming_file

    path = Path(source)
    if not str(source):
        raise InputError("the name of the input is empty")
    if _is_builtin(source):
        path = meshes.scene_path(str(source))
    elif not os.path.lexists(path):  # the reader has a better message for a broken link
        raise InputError(_not_there(source))
    if path.suffix.lower() == ".xml":
        if up is not None or triangles is not None:
            raise InputError(f"{source}: an up axis and a number of triangles are not for Mitsuba scenes")
        from wrt.io.file_type import hinting
        from wrt.io.mitsuba.scene import load_mitsuba

        # Overflow is not reported here: values are checked where they are used.
        with naming_file(path), hinting(path), np.errstate(all="ignore"):
            return stage.shown(load_mitsuba(path, parameters=parameters, sensor=sensor))
    _refuse(parameters, sensor, source)
    if path.suffix.lower() == ".toml":
        if up is not None:
            raise InputError(f"{source}: {_FOR_MESHES}")
        from wrt.io.toml.reader import load_scene

        loaded = load_scene(path, triangles=triangles)
        with naming_file(path):
            return stage.shown(loaded)
    if triangles is not None:
        raise InputError(f"{source}: {_FOR_PROCEDURAL}")
    from wrt.io.load_mesh import load_file

    if stage.time is not None:
        from wrt.animation.file_animation import reach_of_file

        stage = dataclasses.replace(stage, reach=reach_of_file(path))
    scene = load_file(path, time=stage.time, alone=stage.time is None)
    if up is None and path.suffix.lower() == ".dae":
        from wrt.io.mesh.collada import declared_up

        up = declared_up(path)
    with naming_file(path):
        return _shown(source, scene, up, path.suffix.lower().removeprefix("."), stage)


def _not_there(source: str | os.PathLike[str]) -> str:
    """Return the error message for a missing file, with a hint at the nearest name."""
    from wrt import meshes

    path = Path(source)
    if str(source) == "-":
        return f"{source}: no such file; standard input is not read"
    if "://" in str(source):
        return f"{source}: no such file; download it first"
    known: list[str] = []
    with contextlib.suppress(OSError, ValueError), os.scandir(path.parent) as entries:
        known = [entry.name for entry in itertools.islice(entries, MOST_NAMES)]
    said = f"{source}: no such file"
    if path.parent == Path():
        known += meshes.scene_names()
        if not path.suffix:
            said += f", and no built-in scene of that name ({', '.join(meshes.scene_names())})"
    return said + did_you_mean(path.name, known, likeness=0.75)  # above the default, since most names share a suffix


def _shown(source: object, scene: Scene, up: str | None, kind: str, stage: Stage) -> Scene:
    """Return the content of a mesh file or object, with its own lights or in a studio.

    Args:
        source: the file or object, for messages.
        scene: its content.
        up: the given up axis, or None.
        kind: the file type, such as "stl"; empty if unknown.
        stage: how to show it.
    """
    name = name_of(source)
    if up is None and (kind == "npz" or kind not in _WITH_AXES) and not (scene.lights or scene.camera):
        from wrt.studio.orientation import guess_up

        up = "y" if kind in _WITH_AXES else guess_up(scene.shapes, "z" if kind in ("stl", "off") else "y")
        _name_land(name, scene.shapes, up)
    if up not in (None, "y") and (scene.lights or scene.camera):
        raise InputError(f"{name}: an up axis is for files without lights and cameras, since it would not turn these")
    return stage.present(source, scene, up or "y", neutral=kind in ("glb", "gltf"))


def _name_land(name: str, shapes: list[Shape], up: str) -> None:
    """Warn if shapes stand on an edge that may be land, whose axis nothing names."""
    from wrt.studio.orientation import land_axis

    axis = land_axis(shapes, up)
    if axis is not None:
        looks = f"it is thin along {axis} and faces that way"
        text = f'{name}: {looks}; if it is land, which lies, say up="{axis}", or --up {axis}'
        warn(text, UserWarning)


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
    noise: float | None = None,
    adaptive: bool | str | None = None,
    denoise: bool | None = None,
    device: str = "cpu",
    seed: int = 0,
    threads: int | None = None,
    max_depth: int | None = None,
    crop: tuple[int, int, int, int] | None = None,
    sampler: str | None = None,
    integrator: str | None = None,
    view: ViewLike | None = None,
    frame: bool | None = None,
    material: Material | str | None = None,
    environment: Environment | PathLike | None = None,
    transparent: bool = False,
    progress: bool | None = None,
) -> NDArray[np.float32]:
    """Render `source` and return (H, W, 3) float32 linear radiance, of the crop window if given.

    A transparent picture is (H, W, 4): its radiance, 0 where nothing is seen, and its coverage (associated alpha).

    `source`, `up`, `parameters`, `strict`, `view`, `frame`, `material`, `environment` and `transparent` are as for
    `load`, the other arguments as for `wrt.Renderer` and its `passes`; `denoise` removes noise, see
    `wrt.Renderer.denoised`. `progress` says whether to show the progress of the render; None is for a bar in
    terminals and notebooks and nothing elsewhere.

    Raises:
        InputError: if an argument cannot be used.
    """
    from wrt.develop.denoise import require_denoiser
    from wrt.progress.bar import ProgressBar
    from wrt.progress.terminal import bar_stream
    from wrt.rendering.passes import LONGEST_PASS
    from wrt.rendering.renderer import Renderer

    scene = load(
        source,
        up=up,
        parameters=parameters,
        strict=strict,
        view=view,
        frame=frame,
        material=material,
        environment=environment,
        transparent=transparent,
        aspect=width / height if width and height else None,
    )
    if denoise is not None:
        scene = dataclasses.replace(scene, settings=dataclasses.replace(scene.settings, denoise=denoise))
    if scene.settings.denoise:
        require_denoiser()  # before rendering
    renderer = Renderer(
        scene,
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
    watched = bar_stream() is not None if progress is None else progress
    seconds = None if watched else LONGEST_PASS
    with ProgressBar(_label_of(source), time_limit=time, wanted=watched) as bar:
        for done in renderer.passes(spp=spp, time=time, noise=noise, adaptive=adaptive, pass_seconds=seconds):
            bar.update(done)
    image, alpha = renderer.denoised() if scene.settings.denoise else renderer.image(), renderer.alpha()
    return image if alpha is None else np.dstack([image, alpha])


def _label_of(source: object) -> str:
    """Return a short name for a source."""
    return Path(source).stem if isinstance(source, (str, os.PathLike)) else "picture"
