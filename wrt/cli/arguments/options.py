"""The commands and their options."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Callable

from wrt._version import __version__
from wrt.cli.arguments.parser import Once, Parser, parse_with
from wrt.cli.arguments.studio import add_studio_options
from wrt.cli.arguments.types import (
    choice,
    definition,
    duration,
    exposure,
    finite,
    frames,
    interval,
    part,
    positive,
    share,
    size,
    whole,
)
from wrt.errors import InputError

AXES = ("x", "y", "z", "-x", "-y", "-z")

SHELLS = ("bash", "zsh", "fish")

CONFINED = "refuse references to files outside the input's folder"

EXAMPLES = """\
examples:
  wrt render cornell-box
  wrt render teapot.ply --spp 256 -o teapot.exr
  wrt render room.toml --time 2m --size 1080p
  wrt render room.toml --spp 4096 --checkpoint room.ckpt --resume
  wrt render one.obj two.glb -o pictures/
  wrt develop room.exr -o room.png --tone agx --exposure auto
  wrt info robot.glb
"""


def parse(arguments: list[str]) -> argparse.Namespace:
    """Return the parsed arguments of a command line; their `run` is the function that executes the command.

    Raises:
        InputError: if the arguments are wrong.
        SystemExit: after --help and --version.
    """
    for argument in arguments:
        if "\0" in argument:
            raise InputError(f"{argument!r}: an argument must not contain a NUL character")
    return parse_with(make_parser(), _join_axis(arguments))


def _join_axis(arguments: list[str]) -> list[str]:
    """Write ``--up -z`` as ``--up=-z``, and ``--view -30,20`` likewise: argparse would read -z as an option."""
    joined: list[str] = []
    for argument in arguments:
        option = joined[-1] if joined else ""
        if (option == "--up" and argument in AXES) or (option == "--view" and argument.startswith("-")):
            joined[-1] = f"{option}={argument}"
        else:
            joined.append(argument)
    return joined


def _later(module: str, name: str) -> Callable[[argparse.Namespace], int]:
    """Return a function that imports `module` when called, and calls its function `name`."""

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
    materials.add_argument(
        "--presets", action="store_true", help="list the names that metal, f0 and ior take, with values and sources"
    )

    parts = ": shapes, materials, textures, lights and camera"
    _add_info_options(command("info", "show what a scene or mesh file contains", parts))

    bits = ", with its arrays in a folder beside it. Both render to bit-identical pictures"
    convert = command("convert", "convert any scene or mesh to a scene file or GLB", bits)
    convert.add_argument("source", metavar="SCENE", help="as for wrt render")
    convert.add_argument(
        "output",
        metavar="OUT.toml",
        help="scene file to write, with its arrays in the folder OUT_files; or a GLB file for other programs",
    )
    convert.add_argument("--up", choices=AXES, type=choice(AXES), help="as for wrt render")
    convert.add_argument("--force", action="store_true", help="overwrite existing files")
    convert.add_argument("--confined", action="store_true", help=CONFINED)

    tones = " with an exposure and a tone curve"
    develop = command("develop", "turn a picture of radiance into a PNG or a JPEG", tones)
    develop.add_argument("source", metavar="PICTURE", help="picture of radiance: .exr, .hdr or .npy")
    develop.add_argument(
        "-o",
        "--output",
        metavar="OUT",
        action=Once,
        help="picture to write: .png or .jpg (default: PICTURE's name with .png)",
    )
    _add_developing(develop.add_argument)
    develop.add_argument("--force", action="store_true", help="let -o overwrite a file that wrt did not write")

    merge = command("merge", "merge the parts of a render to its picture", ", bit for bit", module="wrt.cli.parts")
    _add_merge_options(merge)

    where = '. In bash and zsh: eval "$(wrt completion bash)"; in fish: wrt completion fish | source'
    completion = command("completion", "print shell code that completes wrt's commands and options", where)
    completion.add_argument("shell", metavar="SHELL", choices=SHELLS, type=choice(SHELLS), help=", ".join(SHELLS))

    before = ", so that no render waits for a compiler: for images of containers and for clusters"
    _add_compile_options(command("compile", "compile the kernels that renders of scenes need", before))

    view = command("view", "show a scene in the browser while it converges", module="wrt.cli.view")
    _add_view_options(view)

    render = command("render", "render scenes and meshes to pictures", module="wrt.cli.render")
    render.epilog = EXAMPLES
    _add_render_options(render)
    return parser


def _add_info_options(parser: Parser) -> None:
    """Add the options of wrt info."""
    add = parser.add_argument
    add("source", metavar="SCENE", nargs="?", help="as for wrt render")
    add("--system", action="store_true", help="show versions, threads, the kernel and the GPUs of this machine")
    add("--memory", action="store_true", help="show the memory that a picture takes on a GPU, by part")
    add("--size", metavar="WxH", type=size, help="with --memory: the picture's size")
    add("--confined", action="store_true", help=CONFINED)


def _add_merge_options(parser: Parser) -> None:
    """Add the options of wrt merge."""
    add = parser.add_argument
    add("inputs", metavar="PART", nargs="+", help="files that wrt render --part has written, in any order")
    add("-o", "--output", metavar="OUT", action=Once, required=True, help="picture to write: .png, .jpg, .exr or .npy")
    add("--checkpoint", metavar="FILE", action=Once, help="also save the state, for wrt render SCENE --resume")
    _add_developing(add)
    add("--force", action="store_true", help="let -o overwrite a file that wrt did not write")
    add("--quiet", action="store_true", help="show only errors and warnings")


def _add_limits(add: Callable[..., object]) -> None:
    """Add the options of what ends a render, and of what becomes of its noise."""
    add("--spp", metavar="N", type=whole(1), help="samples per pixel in total (default: from the scene)")
    add(
        "--time",
        metavar="TIME",
        type=duration,
        help="stop after this time: 90, 90s, 1m30s or 1:30; without --spp there is no sample limit",
    )
    add(
        "--noise",
        metavar="SHARE",
        type=share,
        help="stop when the noise of the picture is below this share of its brightness: 1%% or 0.01",
    )
    add(
        "--adaptive",
        action="store_true",
        default=None,
        help="let parts of the picture that reach --noise stop before the others; slightly biased",
    )
    add(
        "--adaptive-unbiased",
        action="store_const",
        const="unbiased",
        dest="adaptive",
        help="likewise without bias: a sparse second render decides which parts stop",
    )
    add("--denoise", action="store_true", help="remove noise from the picture (needs the extra wrt[denoise])")


def _add_developing(add: Callable[..., object]) -> None:
    """Add the options that make a PNG or JPEG of radiance."""
    add(
        "--tone",
        metavar="NAME",
        help="tone curve of a PNG or JPEG: soft, none, neutral, agx, aces, ocio or ocio:CONFIG,DISPLAY,VIEW (default: "
        "soft)",
    )
    add(
        "--exposure",
        metavar="STOPS",
        type=exposure,
        help="brighten a PNG or JPEG by this many stops (factors of two), or auto (default: 0, and auto for pictures "
        "that would be mostly white or dark)",
    )


def _add_frames(add: Callable[..., object]) -> None:
    """Add the options of animations."""
    add(
        "--turntable",
        metavar="N",
        type=whole(2),
        help="render N frames once around the scene, to a video (.mp4, .webp or .gif) or to frames (cow_%%04d.png)",
    )
    add(
        "--frames",
        metavar="A-B",
        type=frames,
        help="render frames A to B of a scene with keyframes or a glTF animation; frame f is at f / FPS seconds",
    )
    add("--fps", metavar="FPS", type=positive, default=24.0, help="frames per second (default: 24)")


def _add_saving(add: Callable[..., object]) -> None:
    """Add the options that say when and where a render is saved."""
    add(
        "--part",
        metavar="I/N",
        type=part,
        help="render only part I of N, from 1/N to N/N, to a file for wrt merge (default: INPUT-I-of-N.wrt)",
    )
    add("--checkpoint", metavar="FILE", action=Once, help="save the state of the render here, for --resume")
    add(
        "--resume",
        action="store_true",
        help="continue from the --checkpoint file if it exists; of an animation, render missing frames",
    )
    add(
        "--save-every",
        metavar="TIME",
        type=interval,
        help="time between saves of picture and checkpoint during the render, or never (default: after 2 s and then "
        "less and less often for the picture, 60 s for the checkpoint)",
    )
    add("--force", action="store_true", help="let -o overwrite a file that wrt did not write")


def _add_view_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("source", metavar="SCENE", help="as for wrt render")
    add("--watch", action="store_true", help="load the scene again whenever its file changes")
    add("--no-browser", action="store_true", help="only print the address of the page")
    add("--port", metavar="N", type=whole(1), help="port of the page (default: the first free one from 8765 on)")
    add("--spp", metavar="N", type=whole(1), help="samples per pixel at which to rest (default: at least 1024)")
    add("--size", metavar="WxH", type=size, help="as for wrt render, like the options below")
    add("--device", metavar="NAME", default="cpu", help="cpu, cuda or cuda:N (default: cpu)")
    add("--threads", metavar="N", type=whole(1), help="number of CPU threads (default: one per core)")
    add("--seed", metavar="N", type=whole(0), default=0, help="random seed (default: 0)")
    add("--up", metavar="AXIS", choices=AXES, type=choice(AXES), help="axis of a mesh that points up")
    add("--confined", action="store_true", help=CONFINED)


def _add_choices(add: Callable[..., object]) -> None:
    """Add the options of how light is found."""
    add("--sampler", metavar="NAME", help="independent, stratified, sobol or blue-noise (default: from the scene)")
    add("--integrator", metavar="NAME", help="path, direct, whitted, ao or aov (default: from the scene)")
    add("--clamp-indirect", metavar="RADIANCE", type=positive, help="limit the indirect radiance of each path; biased")
    add(
        "--regularization",
        metavar="ALPHA",
        type=finite,
        help="widen rough surfaces along a path by this roughness; biased",
    )


def _add_reading(add: Callable[..., object]) -> None:
    """Add the options of how an input is read."""
    add(
        "-D",
        "--define",
        metavar="NAME=VALUE",
        action="append",
        type=definition,
        help="value of the parameter $NAME in a Mitsuba scene",
    )
    add("--sensor", metavar="N", type=whole(0), help="which sensor of a Mitsuba scene is the camera, from 0")
    add("--confined", action="store_true", help=CONFINED)
    add("--strict", action="store_true", help="treat unsupported content as an error, not a warning")
    add(
        "--up",
        metavar="AXIS",
        choices=AXES,
        type=choice(AXES),
        help="axis of a mesh that points up: x, y, z, -x, -y or -z",
    )


def _add_compile_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("inputs", metavar="SCENE", nargs="*", help="as for wrt render, like the options below")
    add("--general", action="store_true", help="also the kernels that render most other scenes, slower (two minutes)")
    add("--denoise", action="store_true", help="also what removing noise needs")
    add_studio_options(parser)
    add("--device", metavar="NAME", default="cpu", help="cpu, cuda or cuda:N (default: cpu)")
    add("--threads", metavar="N", type=whole(1), help="number of CPU threads (default: one per core)")
    _add_choices(add)
    _add_reading(add)
    parser.set_defaults(dask=None, seed=0, max_depth=None, tone=None, exposure=None)


def _add_render_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "inputs",
        metavar="INPUT",
        nargs="+",
        help="built-in scene (see 'wrt scenes'), scene file (.toml, or Mitsuba .xml) or mesh file; several inputs are "
        "rendered in turn",
    )
    add(
        "-o",
        "--output",
        metavar="OUT",
        action=Once,
        help="picture to write: .png, .jpg, .exr or .npy (default: INPUT's name with .png, in the current folder); for "
        "several inputs, a folder",
    )
    _add_limits(add)
    add_studio_options(parser)
    add(
        "--device",
        metavar="NAME",
        default="cpu",
        help="device to render on: cpu, cuda, cuda:N, or several GPUs: cuda:0,1 or cuda:all (default: cpu)",
    )
    add("--threads", metavar="N", type=whole(1), help="number of CPU threads (default: one per core)")
    add(
        "--dask",
        metavar="ADDRESS",
        help="render on the workers of a Dask scheduler, such as tcp://head:8786, or local:N, N processes here",
    )
    add("--seed", metavar="N", type=whole(0), default=0, help="random seed (default: 0)")
    add("--max-depth", metavar="N", type=whole(1), help="maximum number of path segments (default: from the scene)")
    _add_choices(add)
    _add_developing(add)
    _add_frames(add)
    _add_saving(add)
    add("--quiet", action="store_true", help="show only errors and warnings")
    add("--json", action="store_true", help="print a summary of each render to standard output as a line of JSON")
    _add_reading(add)
