"""The short commands. Each function takes the options of its command and returns the exit status."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import Any

from wrt.cli.exit_status import complain, outcome, warn


def _print(text: str) -> int:
    """Print the result of a command to standard output; return the exit status."""
    print(text, flush=True)
    return 0


def scenes(**_: object) -> int:
    """List the built-in scenes."""
    from wrt.meshes import scene_descriptions

    descriptions = scene_descriptions()
    width = max(len(name) for name in descriptions)
    return _print("\n".join(f"{name:<{width}}  {description}" for name, description in descriptions.items()))


def schema(**_: object) -> int:
    """Print the schema of scene files."""
    from wrt.io.toml.schema import schema_text

    return _print(schema_text().removesuffix("\n"))


def materials(*, name: str | None, presets: bool, **_: object) -> int:
    """List the materials or the names of optical constants, or describe a material."""
    from wrt.describe.materials import explain_material, list_materials, list_presets
    from wrt.errors import InputError

    if not presets:
        return _print(list_materials() if name is None else explain_material(name))
    if name is not None:
        raise InputError("--presets lists the names for all materials; leave out NAME")
    return _print(list_presets())


def completion(*, shell: str, **_: object) -> int:
    """Print the shell code for completion."""
    from wrt.cli.arguments.completion import shell_code

    return _print(shell_code(shell))


def info(
    *, source: str | None, system: bool, memory: bool, size: tuple[int, int] | None, confined: bool, **_: object
) -> int:
    """Show what a scene or mesh file contains, or what wrt finds on this machine."""
    from wrt.errors import InputError

    if system:
        from wrt.describe.system import system_text

        _print(system_text())
    if source is None:
        if system:
            return 0
        raise InputError("info: name a scene, or give --system")

    from wrt.api import load
    from wrt.describe.scene import scene_text
    from wrt.io.load_mesh import ARRAYS_SUFFIX, MESH_SUFFIXES, load_file
    from wrt.io.safe_read import confined_to
    from wrt.progress.bar import short_warnings

    if size and not memory:
        raise InputError("--size is for --memory")
    with short_warnings(warn):
        path = Path(source)
        if memory:
            from wrt.memory_needed import device_memory, memory_text

            scene = load(source, confined=confined)
            width, height = size or (scene.settings.width, scene.settings.height)
            text = memory_text(device_memory(scene, width=width, height=height), width, height)
        elif path.suffix.lower() in MESH_SUFFIXES and os.path.isfile(path):
            # A mesh file is described without the studio that `load` adds. `alone` moves a mesh to the origin, which
            # would hide its place in the file, but not one from arrays.
            with confined_to(path.parent if confined else None):
                text = scene_text(load_file(path, standalone=path.suffix.lower() == ARRAYS_SUFFIX))
        else:
            text = scene_text(load(source, confined=confined))
    return _print(text)


def develop(
    *,
    source: str,
    output: str | None,
    tone: str | None,
    exposure: float | str | None,
    force: bool,
    own_process: bool,
) -> int:
    """Turn a picture of radiance into a PNG or a JPEG."""
    from wrt.cli.signals import Interrupts
    from wrt.develop.exposure import stops
    from wrt.develop.settings import DEFAULT_TONE, DEVELOPED_SUFFIXES, check_exposure
    from wrt.errors import InputError, one_line
    from wrt.io.images import PICTURE, check_output, read_image, save_image
    from wrt.io.safe_write import free_path

    name = Path(Path(source).stem + ".png")
    path = free_path(name, PICTURE) if output is None else check_output(output, force=force)
    if path.suffix.lower() not in DEVELOPED_SUFFIXES:
        raise InputError(f"{path}: a developed picture is a PNG or a JPEG; give it a name that ends in .png or .jpg")

    def work() -> int:
        image = read_image(Path(source))
        # The default name again: it may be the source, which must stay.
        target = free_path(name, PICTURE) if output is None else path
        chosen = stops(image, check_exposure(exposure))
        developed = save_image(target, image, tone=tone or DEFAULT_TONE, exposure=chosen, force=force)
        if developed is not None:
            if developed.warning:
                complain("warning", developed.warning)
            warn(f"{one_line(str(target))}  tone {developed.tone}  exposure {developed.stops:+.2f} stops")
        return 0

    return Interrupts(f"{path} was not written", own_process=own_process).run(work)


def convert(*, source: str, output: str, up: str | None, force: bool, confined: bool, own_process: bool) -> int:
    """Convert a scene or mesh to a scene file."""
    from wrt.cli.signals import Interrupts

    def work() -> int:
        from wrt.api import load
        from wrt.io.toml.writer import save_scene
        from wrt.progress.bar import short_warnings

        with short_warnings(warn):
            save_scene(output, load(source, up=up, confined=confined), force=force)
        return 0

    return Interrupts(f"{output} was not written", own_process=own_process).run(work)


def compile(*, general: bool, own_process: bool, **arguments: Any) -> int:
    """Compile what renders of the scenes need; return the highest exit status.

    Raises:
        InputError: if nothing is to be compiled.
    """
    from wrt.backend import current_backend
    from wrt.cli.load import load_input, make_renderer
    from wrt.cli.options import RenderOptions
    from wrt.cli.signals import Interrupts
    from wrt.compiling.precompile import compile_general, precompiled_by
    from wrt.errors import InputError
    from wrt.progress.bar import short_warnings

    options = RenderOptions.from_arguments(arguments, own_process=own_process)
    if not options.inputs and not general:
        raise InputError("name a scene, or give --general")

    def compile_for(source: str) -> int:
        scene = load_input(source, options)
        return _print(f"{source}: {precompiled_by(lambda: make_renderer(scene, options))}")

    def work() -> int:
        highest = 0
        for source in options.inputs:
            name = source if len(options.inputs) > 1 else ""
            highest = max(highest, outcome(partial(compile_for, source), name=name))
        if general:
            _print(f"general kernels: {compile_general(options.settings['sampler'])}")
        return highest

    with short_warnings(warn):
        status = Interrupts("before everything was compiled", own_process=own_process).run(work)
        current_backend().finish()
    return status
