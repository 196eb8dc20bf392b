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
"""How often a render with a checkpoint saves itself unless told otherwise."""

AXES = ("x", "y", "z", "-x", "-y", "-z")

SHELLS = ("bash", "zsh", "fish")

CONFINED = "refuse a file that names others outside its own folder"

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
    """Return what the arguments of a command line say; `run` of it takes it and does it.

    Raises:
        InputError: where they cannot be understood.
        SystemExit: after --help and --version.
    """
    for argument in arguments:
        if "\0" in argument:
            raise InputError(f"{argument!r}: no name or value may hold a NUL character")
    return parse_with(make_parser(), _join_axis(arguments))


def _join_axis(arguments: list[str]) -> list[str]:
    """Write ``--up -z`` as ``--up=-z``, since argparse takes -z for an option."""
    joined: list[str] = []
    for argument in arguments:
        if joined and joined[-1] == "--up" and argument in AXES:
            joined[-1] = f"--up={argument}"
        else:
            joined.append(argument)
    return joined


def _later(module: str, name: str) -> Callable[[argparse.Namespace], int]:
    """Return a command's function, whose module is imported when it is called."""

    def run(options: argparse.Namespace) -> int:
        status: int = getattr(importlib.import_module(module), name)(options)
        return status

    return run


def make_parser() -> argparse.ArgumentParser:
    """Return what reads the command line."""
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
        """Add a command; `more` is what its own help says after the summary."""
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

    materials = command("materials", "list the materials and their parameters, or explain one")
    materials.add_argument("name", metavar="NAME", nargs="?", help="explain this one, such as diffuse")

    parts = ": shapes, materials, textures, lights, camera"
    info = command("info", "tell what is in a scene or a mesh file", parts)
    info.add_argument("source", metavar="SCENE", help="as for wrt render")
    info.add_argument("--confined", action="store_true", help=CONFINED)

    bits = ", with its arrays beside it. It renders to the same bits"
    convert = command("convert", "write any scene or mesh as a scene file", bits)
    convert.add_argument("source", metavar="SCENE", help="as for wrt render")
    convert.add_argument("output", metavar="OUT.toml", help="the scene file; its arrays go to OUT_files")
    convert.add_argument("--up", choices=AXES, type=choice(AXES), help="as for wrt render")
    convert.add_argument("--force", action="store_true", help="replace files that are there already")
    convert.add_argument("--confined", action="store_true", help=CONFINED)

    where = '. In bash and zsh: eval "$(wrt completion bash)"; in fish: wrt completion fish | source'
    completion = command("completion", "print what makes a shell complete wrt's words", where)
    completion.add_argument("shell", metavar="SHELL", choices=SHELLS, type=choice(SHELLS), help=", ".join(SHELLS))

    render = command("render", "render scenes or meshes to pictures", module="wrt.cli.render")
    render.epilog = EXAMPLES
    _add_render_options(render)
    return parser


def _add_render_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "inputs",
        metavar="INPUT",
        nargs="+",
        help="a built-in scene (see 'wrt scenes'), a scene file (.toml, or Mitsuba .xml) or a mesh file; of several, "
        "one is rendered after the other",
    )
    add(
        "-o",
        "--output",
        metavar="OUT",
        action=Once,
        help="the picture: .png, .exr or .npy (default: INPUT's name with .png, here); of several inputs, a folder",
    )
    add("--spp", metavar="N", type=whole(1), help="samples per pixel in all (default: the scene's own)")
    add(
        "--time",
        metavar="TIME",
        type=duration,
        help="render for so long: 90, 90s, 1m30s or 1:30; alone, without limit of samples",
    )
    add("--size", metavar="WxH", type=size, help="pixels: 640x480, 720p, 1080p or 4k (default: the scene's own)")
    add("--crop", metavar="X0,Y0,X1,Y1", type=crop, help="render this part alone: pixels from X0, Y0 up to X1, Y1")
    add("--device", metavar="NAME", default="cpu", help="cpu, cuda or cuda:N (default: cpu)")
    add("--threads", metavar="N", type=whole(1), help="CPU threads (default: every core)")
    add("--seed", metavar="N", type=whole(0), default=0, help="another seed, another noise (default: 0)")
    add("--max-depth", metavar="N", type=whole(1), help="most segments in a path (default: the scene's own)")
    add("--sampler", metavar="NAME", help="independent, stratified, sobol or blue-noise (default: the scene's own)")
    add("--integrator", metavar="NAME", help="path, direct, whitted, ao or aov (default: the scene's own)")
    add("--layers", metavar="NAMES", help="write these too, to .exr: albedo,normal,depth and others (see the docs)")
    add("--clamp-indirect", metavar="RADIANCE", type=positive, help="most indirect light of one path; biased")
    add("--regularization", metavar="ALPHA", type=finite, help="roughness that surfaces gain along a path; biased")
    add("--exposure", metavar="STOPS", type=finite, help="factors of two by which a PNG is brightened")
    add("--checkpoint", metavar="FILE", action=Once, help="save the render there, to go on with later")
    add("--resume", action="store_true", help="go on from the checkpoint if there is one")
    add(
        "--save-every",
        metavar="TIME",
        type=duration,
        help=f"save checkpoint and picture this often (default: {SAVE_EVERY_SECONDS:.0f}, with --checkpoint)",
    )
    add("--force", action="store_true", help="let -o replace a file that wrt has not made")
    add("--quiet", action="store_true", help="no progress and no summary; errors and warnings only")
    add("--json", action="store_true", help="print a summary of each render as a line of JSON on standard output")
    add("--triangles", metavar="N", type=whole(1), help="triangles of a scene with a procedural mesh")
    add(
        "-D",
        "--define",
        metavar="NAME=VALUE",
        action="append",
        type=definition,
        help="what $NAME is in a Mitsuba scene",
    )
    add("--confined", action="store_true", help=CONFINED)
    add("--strict", action="store_true", help="refuse a file of which something would be left out")
    add(
        "--up",
        metavar="AXIS",
        choices=AXES,
        type=choice(AXES),
        help="which axis of a mesh points up: x, y, z, -x, -y or -z",
    )
