"""All commands except `render`. Each function takes the options and returns the exit status."""

from __future__ import annotations

import argparse
import os

from wrt.cli.exit_status import complain, give_up, warn


def _say(text: str) -> None:
    """Print a result to standard output."""
    print(text, flush=True)


def scenes(options: argparse.Namespace) -> int:
    """List the built-in scenes."""
    from wrt.meshes import scene_descriptions

    descriptions = scene_descriptions()
    width = max(len(name) for name in descriptions)
    _say("\n".join(f"{name:<{width}}  {description}" for name, description in descriptions.items()))
    return 0


def schema(options: argparse.Namespace) -> int:
    """Print the schema of scene files."""
    from wrt.io.toml.schema import schema_text

    _say(schema_text().removesuffix("\n"))
    return 0


def materials(options: argparse.Namespace) -> int:
    """List the materials or the names of optical constants, or describe a material."""
    from wrt.describe.materials import explain_material, list_materials
    from wrt.describe.presets import list_presets
    from wrt.errors import InputError

    if options.presets:
        if options.name is not None:
            raise InputError("--presets lists the names for all materials; leave out NAME")
        _say(list_presets())
        return 0
    _say(list_materials() if options.name is None else explain_material(options.name))
    return 0


def completion(options: argparse.Namespace) -> int:
    """Print the shell code for completion."""
    from wrt.cli.arguments.completion import shell_code

    _say(shell_code(options.shell))
    return 0


def info(options: argparse.Namespace) -> int:
    """Show what a scene or mesh file contains, or what wrt finds on this machine."""
    from pathlib import Path

    from wrt.errors import InputError

    if options.system:
        from wrt.describe.system import system_text

        _say(system_text())
    if options.source is None:
        if options.system:
            return 0
        raise InputError("info: name a scene, or give --system")

    from wrt.api import load
    from wrt.describe.scene import scene_text
    from wrt.io.load_mesh import ARRAYS_SUFFIX, MESH_SUFFIXES, load_file
    from wrt.io.safe_read import confined_to
    from wrt.progress.bar import short_warnings

    if options.size and not options.memory:
        raise InputError("--size is for --memory")
    with short_warnings(warn):
        if options.memory:
            _say(_memory(options))
            return 0
        # A mesh file is described without the studio that `load` adds.
        path = Path(options.source)
        alone = path.suffix.lower() in MESH_SUFFIXES and os.path.isfile(path)
        if alone:
            with confined_to(path.parent if options.confined else None):
                # What is alone is moved to the origin too, which would hide where the file has it; arrays are not.
                scene = load_file(path, alone=path.suffix.lower() == ARRAYS_SUFFIX)
        else:
            scene = load(options.source, confined=options.confined)
        _say(scene_text(scene))
    return 0


def _memory(options: argparse.Namespace) -> str:
    """Return what a picture of a scene takes on a GPU."""
    from wrt.api import load
    from wrt.memory_needed import device_memory, memory_text

    scene = load(options.source, confined=options.confined)
    width, height = options.size or (scene.settings.width, scene.settings.height)
    return memory_text(device_memory(scene, width=width, height=height), width, height)


def develop(options: argparse.Namespace) -> int:
    """Turn a picture of radiance into a PNG or a JPEG."""
    from pathlib import Path

    from wrt.cli.signals import Interrupts
    from wrt.develop.exposure import stops
    from wrt.develop.settings import DEVELOPED_SUFFIXES, check_exposure
    from wrt.errors import InputError, one_line
    from wrt.io.images import PICTURE, check_output, read_image, save_image
    from wrt.io.safe_write import free_path

    with Interrupts((lambda status: give_up(status, nothing)) if options.own_process else None) as interrupts:
        if options.output is None:
            output = free_path(Path(Path(options.source).stem + ".png"), PICTURE)
        else:
            output = check_output(options.output, force=options.force)
        nothing = f"{output} was not written"
        if output.suffix.lower() not in DEVELOPED_SUFFIXES:
            raise InputError(
                f"{output}: a developed picture is a PNG or a JPEG; give it a name that ends in .png or .jpg"
            )
        try:
            image = read_image(Path(options.source))
            if options.output is None:
                output = free_path(output, PICTURE)  # again: it may be the source, which must stay
            given = {} if options.tone is None else {"tone": options.tone}
            given["exposure"] = stops(image, check_exposure(options.exposure))
            developed = save_image(output, image, **given, force=options.force)
        except KeyboardInterrupt:
            complain("stopped", nothing)
            return interrupts.exit_status
    if developed is not None:
        if developed.warning:
            complain("warning", developed.warning)
        warn(f"{one_line(str(output))}  tone {developed.tone}  exposure {developed.stops:+.2f} stops")
    return 0


def convert(options: argparse.Namespace) -> int:
    """Convert a scene or mesh to a scene file."""
    from wrt.cli.signals import Interrupts

    nothing = f"{options.output} was not written"
    with Interrupts((lambda status: give_up(status, nothing)) if options.own_process else None) as interrupts:
        try:
            _convert(options)
        except KeyboardInterrupt:
            complain("stopped", nothing)
            return interrupts.exit_status
    return 0


def _convert(options: argparse.Namespace) -> None:
    from wrt.api import load
    from wrt.io.toml.writer import save_scene
    from wrt.progress.bar import short_warnings

    with short_warnings(warn):
        scene = load(options.source, up=options.up, confined=options.confined)
        save_scene(options.output, scene, force=options.force)


def compile(options: argparse.Namespace) -> int:
    """Compile what renders of the scenes need; return the highest exit status.

    Raises:
        InputError: if nothing is to be compiled.
    """
    from wrt.backend import current_backend
    from wrt.cli.exit_status import outcome
    from wrt.cli.signals import Interrupts
    from wrt.progress.bar import short_warnings

    if not options.inputs and not options.general:
        from wrt.errors import InputError

        raise InputError("name a scene, or give --general")
    worst, nothing = 0, "before everything was compiled"
    ending = (lambda status: give_up(status, nothing)) if options.own_process else None
    with Interrupts(ending) as interrupts, short_warnings(warn):
        try:
            for source in options.inputs:
                options.input = source
                several = source if len(options.inputs) > 1 else ""
                worst = max(worst, outcome(lambda: _compile(options), name=several))
            if options.general:
                worst = max(worst, outcome(lambda: _compile_general(options), name="general kernels"))
        except KeyboardInterrupt:
            complain("stopped", nothing)
            worst = interrupts.exit_status
        current_backend().finish()
    return worst


def _compile_general(options: argparse.Namespace) -> int:
    """Compile the general kernels, and say what was compiled."""
    from wrt.compiling.precompile import compile_general

    _say(f"general kernels: {compile_general(options.sampler)}")
    return 0


def _compile(options: argparse.Namespace) -> int:
    """Compile what a render of the input needs, and say what was compiled."""
    from wrt.backend.kernel_cache import compiled_modules
    from wrt.cli.load import load_input, make_renderer
    from wrt.compiling.precompile import precompiled

    with compiled_modules() as modules:
        scene = load_input(options)
        renderer = make_renderer(options, scene)
    _say(f"{options.input}: {precompiled(renderer, tuple(sorted(modules)))}")
    return 0
