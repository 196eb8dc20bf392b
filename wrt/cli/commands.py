"""All commands except `render`: each function takes the options and returns the exit status."""

from __future__ import annotations

import argparse

from wrt.cli.status import complain, give_up, warn


def _say(text: str) -> None:
    """Print a command's result to standard output."""
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
    from wrt.formats.scene_schema import schema_text

    _say(schema_text().removesuffix("\n"))
    return 0


def materials(options: argparse.Namespace) -> int:
    """List the materials, or describe one."""
    from wrt.describe_materials import explain_material, list_materials

    _say(list_materials() if options.name is None else explain_material(options.name))
    return 0


def completion(options: argparse.Namespace) -> int:
    """Print the shell code for completion."""
    from wrt.cli.completion import shell_code

    _say(shell_code(options.shell))
    return 0


def info(options: argparse.Namespace) -> int:
    """Show what a scene or mesh file contains."""
    from pathlib import Path

    from wrt.api import load
    from wrt.describe_scene import scene_text
    from wrt.files import confined_to
    from wrt.formats.meshes import MESH_SUFFIXES, load_file
    from wrt.progress import short_warnings

    with short_warnings(warn):
        # Describe the content of a mesh file, without the studio that `load` puts around it.
        path = Path(options.source)
        alone = path.suffix.lower() in MESH_SUFFIXES and path.is_file()
        if alone:
            with confined_to(path.parent if options.confined else None):
                scene = load_file(path)
        else:
            scene = load(options.source, confined=options.confined)
        _say(scene_text(scene))
    return 0


def convert(options: argparse.Namespace) -> int:
    """Convert a scene or mesh to a scene file."""
    from wrt.interrupts import Interrupts

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
    from wrt.formats.scene_writer import save_scene
    from wrt.progress import short_warnings

    with short_warnings(warn):
        scene = load(options.source, up=options.up, confined=options.confined)
        save_scene(options.output, scene, force=options.force)
