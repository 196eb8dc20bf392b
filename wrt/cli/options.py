"""The commands and their options."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Callable

from wrt._version import __version__
from wrt.cli.arguments import choice, crop, definition, duration, finite, positive, size, whole
from wrt.cli.parser import Once, Parser, parse_with
from wrt.errors import InputError

SAVE_EVERY_SECONDS = 60.0
"""Default interval between saves of a render that has a checkpoint."""

AXES = ("x", "y", "z", "-x", "-y", "-z")

SHELLS = ("bash", "zsh", "fish")

CONFINED = "refuse a file that refers to files outside its own folder"

EXAMPLES = """\
examples:
  wrt render cornell-box
  wrt render teapot.ply --spp 256 -o teapot.exr
  wrt render room.toml --time 2m --size 1080p
  wrt render room.toml --spp 4096 --checkpoint room.ckpt --resume
  wrt render one.obj two.glb -o pictures/
  wrt info robot.glb
"""


def parse(arguments: list[str]) -> argparse.Namespace:
    """Return the parsed arguments of a command line; their `run` is the function that executes the command.

    Raises:
        InputError: where the arguments are wrong.
        SystemExit: after --help and --version.
    """
    for argument in arguments:
        if "\0" in argument:
            raise InputError(f"{argument!r}: an argument must not contain a NUL character")
    return parse_with(make_parser(), _join_axis(arguments))


def _join_axis(arguments: list[str]) -> list[str]:
    """Write ``--up -z`` as ``--up=-z``, since argparse would read -z as an option."""
    joined: list[str] = []
    for argument in arguments:
        if joined and joined[-1] == "--up" and argument in AXES:
            joined[-1] = f"--up={argument}"
        else:
            joined.append(argument)
    return joined


def _later(module: str, name: str) -> Callable[[argparse.Namespace], int]:
    """Return a function that imports `module` only when it is called, and then calls `name` of it."""

    def run(options: argparse.Namespace) -> int:
        status: int = getattr(importlib.import_module(module), name)(options)
        return status

    return run


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = Parser(
        prog="wrt",
        description="Progressive, physically based ray tracing of triangle meshes.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"wrt {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True, parser_class=Parser)

    def command(name: str, summary: str, more: str = "", *, module: str = "wrt.cli.commands") -> Parser:
        """Add a command; `more` follows the summary in the command's own help."""
        parser: Parser = commands.add_parser(
            name,
            help=summary,
            description=f"{summary[0].upper()}{summary[1:]}{more}.",
            formatter_class=argparse.RawDescriptionHelpFormatter if name == "render" else argparse.HelpFormatter,
            allow_abbrev=False,
        )
        parser.set_defaults(run=_later(module, name))
        return parser

    command("scenes", "list the built-in scenes")
    command("schema", "print the JSON schema of scene files", ", for editors")

    materials = command("materials", "list the materials and their parameters, or describe one")
    materials.add_argument("name", metavar="NAME", nargs="?", help="describe this material, such as diffuse")

    parts = ": shapes, materials, textures, lights and camera"
    info = command("info", "show what a scene or mesh file contains", parts)
    info.add_argument("source", metavar="SCENE", help="as for wrt render")
    info.add_argument("--confined", action="store_true", help=CONFINED)

    bits = ", with its arrays in a folder beside it. Both render to the same picture, bit for bit"
    convert = command("convert", "convert any scene or mesh to a scene file", bits)
    convert.add_argument("source", metavar="SCENE", help="as for wrt render")
    convert.add_argument("output", metavar="OUT.toml", help="scene file to write; its arrays go to folder OUT_files")
    convert.add_argument("--up", choices=AXES, type=choice(AXES), help="as for wrt render")
    convert.add_argument("--force", action="store_true", help="overwrite existing files")
    convert.add_argument("--confined", action="store_true", help=CONFINED)

    where = '. In bash and zsh: eval "$(wrt completion bash)"; in fish: wrt completion fish | source'
    completion = command("completion", "print shell code that completes wrt's commands and options", where)
    completion.add_argument("shell", metavar="SHELL", choices=SHELLS, type=choice(SHELLS), help=", ".join(SHELLS))

    render = command("render", "render scenes and meshes to pictures", module="wrt.cli.render")
    render.epilog = EXAMPLES
    _add_render_options(render)
    return parser


def _add_render_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "inputs",
        metavar="INPUT",
        nargs="+",
        help="built-in scene (see 'wrt scenes'), scene file (.toml, or Mitsuba .xml) or mesh file; several are "
        "rendered one after the other",
    )
    add(
        "-o",
        "--output",
        metavar="OUT",
        action=Once,
        help="picture to write: .png, .exr or .npy (default: INPUT's name with .png, in the current folder); with "
        "several inputs, a folder",
    )
    add("--spp", metavar="N", type=whole(1), help="samples per pixel in total (default: from the scene)")
    add(
        "--time",
        metavar="TIME",
        type=duration,
        help="stop after this time: 90, 90s, 1m30s or 1:30; without --spp there is no sample limit",
    )
    add("--size", metavar="WxH", type=size, help="resolution: 640x480, 720p, 1080p or 4k (default: from the scene)")
    add("--crop", metavar="X0,Y0,X1,Y1", type=crop, help="render only columns X0 to X1-1 and rows Y0 to Y1-1")
    add("--device", metavar="NAME", default="cpu", help="device to render on: cpu, cuda or cuda:N (default: cpu)")
    add("--threads", metavar="N", type=whole(1), help="number of CPU threads (default: one per core)")
    add("--seed", metavar="N", type=whole(0), default=0, help="random seed (default: 0)")
    add("--max-depth", metavar="N", type=whole(1), help="maximum number of path segments (default: from the scene)")
    add("--sampler", metavar="NAME", help="independent, stratified, sobol or blue-noise (default: from the scene)")
    add("--integrator", metavar="NAME", help="path, direct, whitted, ao or aov (default: from the scene)")
    add("--layers", metavar="NAMES", help="also write these to .exr: albedo,normal,depth and others (see the docs)")
    add("--clamp-indirect", metavar="RADIANCE", type=positive, help="limit of one path's indirect radiance; biased")
    add("--regularization", metavar="ALPHA", type=finite, help="roughness added to surfaces along a path; biased")
    add("--exposure", metavar="STOPS", type=finite, help="brighten a PNG by this many stops (factors of two)")
    add("--checkpoint", metavar="FILE", action=Once, help="save the render here, to continue it with --resume")
    add("--resume", action="store_true", help="continue from the --checkpoint file if it exists")
    add(
        "--save-every",
        metavar="TIME",
        type=duration,
        help=f"time between saves of checkpoint and picture (default: {SAVE_EVERY_SECONDS:.0f} with --checkpoint)",
    )
    add("--force", action="store_true", help="let -o overwrite a file that wrt did not write")
    add("--quiet", action="store_true", help="show only errors and warnings: no progress, no summary")
    add("--json", action="store_true", help="print a summary of each render to standard output, as one line of JSON")
    add("--triangles", metavar="N", type=whole(1), help="number of triangles, for scenes with a procedural mesh")
    add(
        "-D",
        "--define",
        metavar="NAME=VALUE",
        action="append",
        type=definition,
        help="value of the parameter $NAME in a Mitsuba scene",
    )
    add("--confined", action="store_true", help=CONFINED)
    add("--strict", action="store_true", help="fail where unsupported content would be left out with a warning")
    add(
        "--up",
        metavar="AXIS",
        choices=AXES,
        type=choice(AXES),
        help="axis of a mesh that points up: x, y, z, -x, -y or -z",
    )
