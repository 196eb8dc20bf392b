"""The commands and their options."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Callable
from typing import Any

from wrt._version import __version__
from wrt.cli.arguments.parser import Once, Parser, parse_with
from wrt.cli.arguments.types import (
    choice,
    crop,
    definition,
    duration,
    exposure,
    finite,
    frames,
    interval,
    material,
    part,
    positive,
    share,
    size,
    view,
    whole,
)
from wrt.errors import InputError

AXES = ("x", "y", "z", "-x", "-y", "-z")

SHELLS = ("bash", "zsh", "fish")

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

SCENE = "built-in scene, scene file or mesh file, as for wrt render"

VALUES: dict[str, tuple[str, Callable[[str], Any], str]] = {
    "--spp": ("N", whole(1), "samples per pixel in total (default: from the scene)"),
    "--time": ("TIME", duration,
        "stop after this time, such as 90, 90s, 1m30s or 1:30; without --spp there is no sample limit"),
    "--noise": ("SHARE", share,
        "stop when the noise of the picture is below this share of its brightness, such as 1%% or 0.01"),
    "--size": ("WxH", size, "resolution: 640x480, 720p, 1080p or 4k (default: from the scene)"),
    "--crop": ("X0,Y0,X1,Y1", crop, "render only columns X0 to X1-1 and rows Y0 to Y1-1"),
    "--view": ("VIEW", view,
        "view the scene from AZIMUTH,ELEVATION in degrees, or from the front, right, back, left, top, bottom or "
        "three-quarter"),
    "--material": ("NAME", material, "material of a mesh, such as gold, glass or diffuse:0.8,0.2,0"),
    "--environment": ("FILE", str, "light the scene with an image, such as an .hdr, or with sky for sun and sky"),
    "--layers": ("NAMES", str, "layers to add to an .exr: albedo, normal, depth and others (see the docs)"),
    "--triangles": ("N", whole(1), "number of triangles of a procedural mesh"),
    "--device": ("NAME", str, "cpu, cuda or cuda:N (default: cpu)"),
    "--threads": ("N", whole(1), "number of CPU threads (default: one per core)"),
    "--dask": ("ADDRESS", str,
        "render on the workers of a Dask scheduler, such as tcp://head:8786, or on N processes of this machine: "
        "local:N"),
    "--seed": ("N", whole(0), "random seed (default: 0)"),
    "--max-depth": ("N", whole(1), "maximum number of path segments (default: from the scene)"),
    "--sampler": ("NAME", str, "independent, stratified, sobol or blue-noise (default: from the scene)"),
    "--integrator": ("NAME", str, "path, direct, whitted, ao or aov (default: from the scene)"),
    "--clamp-indirect": ("RADIANCE", positive, "limit the indirect radiance of each path; biased"),
    "--regularization": ("ALPHA", finite, "add this roughness to rough surfaces along a path; biased"),
    "--tone": ("NAME", str,
        "tone curve of a PNG or JPEG: soft, none, neutral, agx, aces, ocio or ocio:CONFIG,DISPLAY,VIEW (default: "
        "soft)"),
    "--exposure": ("STOPS", exposure,
        "brighten a PNG or JPEG by this many stops (factors of two), or auto (default: 0, and auto for pictures "
        "that would be mostly white or dark)"),
    "--turntable": ("N", whole(2),
        "render N frames once around the scene, to a video (.mp4, .webp or .gif) or to frames (cow_%%04d.png)"),
    "--frames": ("A-B", frames,
        "render frames A to B of a scene with keyframes or a glTF animation; frame f is at f / FPS seconds"),
    "--fps": ("FPS", positive, "frames per second (default: 24)"),
    "--part": ("I/N", part,
        "render only part I of N, from 1/N to N/N, to a file for wrt merge (default: INPUT-I-of-N.wrt)"),
    "--save-every": ("TIME", interval,
        "time between saves of picture and checkpoint during the render, or never (default: 60 s for the "
        "checkpoint; for the picture 2 s at first, then longer and longer)"),
    "--sensor": ("N", whole(0), "which sensor of a Mitsuba scene is the camera, from 0"),
    "--port": ("N", whole(1), "port of the page (default: the first free one from 8765 on)"),
}  # fmt: skip
"""Options that take a value: its name, its type and the help."""

DEFAULTS = {"--device": "cpu", "--seed": 0, "--fps": 24.0}

FLAGS = {
    "--denoise": "remove noise from the picture (needs the extra wrt[denoise])",
    "--transparent": "leave out the backdrop: the picture has an alpha channel",
    "--resume": "continue from the --checkpoint file if it exists; of an animation, render missing frames",
    "--quiet": "show only errors and warnings",
    "--json": "print a summary of each render to standard output as a line of JSON",
    "--force": "let -o overwrite a file that wrt did not write",
    "--confined": "refuse references to files outside the input's folder",
    "--strict": "treat unsupported content as an error, not a warning",
    "--presets": "list the names that metal, f0 and ior take, with values and sources",
    "--system": "show versions, threads, the kernel and the GPUs of this machine",
    "--memory": "show the memory that a picture takes on a GPU, by part",
    "--general": "also compile the kernels that render most other scenes, though slower (two minutes)",
    "--watch": "load the scene again whenever its file changes",
    "--no-browser": "only print the address of the page",
}
"""Options without a value, and their help."""

SPECIAL: dict[str, dict[str, Any]] = {
    "--output": {"metavar": "OUT", "action": Once},
    "--checkpoint": {"metavar": "FILE", "action": Once, "help": "save the state of the render here, for --resume"},
    "--adaptive": {
        "action": "store_true",
        "default": None,
        "help": "let parts of the picture that reach --noise stop before the others; slightly biased",
    },
    "--adaptive-unbiased": {
        "action": "store_const",
        "const": "unbiased",
        "dest": "adaptive",
        "help": "the same without bias: a sparse second render decides which parts stop",
    },
    "--frame": {
        "action": argparse.BooleanOptionalAction,
        "help": "ignore the input's camera and frame the scene; --no-frame keeps a camera that shows a mesh small",
    },
    "--define": {
        "dest": "parameters",
        "metavar": "NAME=VALUE",
        "action": "append",
        "type": definition,
        "help": "value of the parameter $NAME in a Mitsuba scene",
    },
    "--up": {
        "metavar": "AXIS",
        "choices": AXES,
        "type": choice(AXES),
        "help": "axis of a mesh that points up: x, y, z, -x, -y or -z",
    },
}

SHORT = {"--output": "-o", "--define": "-D"}

STUDIO = "--size --crop --view --frame --material --environment --transparent --layers --triangles"
INTEGRATION = "--sampler --integrator --clamp-indirect --regularization"
READING = "--define --sensor --confined --strict --up"


def parse(arguments: list[str]) -> argparse.Namespace:
    """Return the parsed arguments of a command line; their `run` is the function that executes the command.

    Raises:
        InputError: if the arguments are wrong.
        SystemExit: after --help and --version.
    """
    for argument in arguments:
        if "\0" in argument:
            raise InputError(f"{argument!r}: an argument must not contain a NUL character")
    return parse_with(make_parser(), _join_negative_values(arguments))


def _join_negative_values(arguments: list[str]) -> list[str]:
    """Write ``--up -z`` as ``--up=-z``, and ``--view -30,20`` likewise: argparse would read -z as an option."""
    joined: list[str] = []
    for argument in arguments:
        option = joined[-1] if joined else ""
        if (option == "--up" and argument in AXES) or (option == "--view" and argument.startswith("-")):
            joined[-1] = f"{option}={argument}"
        else:
            joined.append(argument)
    return joined


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

    def command(name: str, summary: str, details: str = "", *, module: str = "wrt.cli.commands") -> Parser:
        """Add a command; in its own help `details` follow the summary."""
        parser: Parser = commands.add_parser(
            name,
            help=summary,
            description=f"{summary[0].upper()}{summary[1:]}{details}.",
            formatter_class=argparse.RawDescriptionHelpFormatter if name == "render" else argparse.HelpFormatter,
            allow_abbrev=False,
        )
        parser.set_defaults(run=_imported_when_called(module, name))
        return parser

    command("scenes", "list the built-in scenes")
    command("schema", "print the JSON schema of scene files", ", for editors")

    materials = command("materials", "list the materials and their parameters, or describe one")
    materials.add_argument("name", metavar="NAME", nargs="?", help="describe this material, such as diffuse")
    _add(materials, "--presets")

    info = command(
        "info",
        "show what a scene or mesh file contains",
        ": shapes, materials, textures, lights and camera",
    )
    info.add_argument("source", metavar="SCENE", nargs="?", help=SCENE)
    _add(info, "--system --memory --size --confined", size="with --memory: the size of the picture")

    convert = command(
        "convert",
        "convert any scene or mesh to a scene file or GLB",
        ", with its arrays in a folder beside it. Both render to bit-identical pictures",
    )
    convert.add_argument("source", metavar="SCENE", help=SCENE)
    convert.add_argument(
        "output",
        metavar="OUT.toml",
        help="scene file to write, with its arrays in the folder OUT_files; or a GLB file for other programs",
    )
    _add(convert, "--up --force --confined", force="overwrite existing files")

    develop = command(
        "develop", "turn a picture of radiance into a PNG or a JPEG", " with an exposure and a tone curve"
    )
    develop.add_argument("source", metavar="PICTURE", help="picture of radiance: .exr, .hdr or .npy")
    written = "picture to write: .png or .jpg (default: PICTURE's name with .png)"
    _add(develop, "--output --tone --exposure --force", output=written)

    merge = command("merge", "merge the parts of a render to its picture", ", bit for bit", module="wrt.cli.parts")
    merge.add_argument(
        "inputs", metavar="PART", nargs="+", help="files that wrt render --part has written, in any order"
    )
    written = "picture to write: .png, .jpg, .exr or .npy"
    merge.add_argument("-o", "--output", metavar="OUT", action=Once, required=True, help=written)
    saved = "also save the state, for wrt render SCENE --resume"
    _add(merge, "--checkpoint --tone --exposure --force --quiet", checkpoint=saved)

    completion = command(
        "completion",
        "print shell code that completes wrt's commands and options",
        '. In bash and zsh: eval "$(wrt completion bash)"; in fish: wrt completion fish | source',
    )
    completion.add_argument("shell", metavar="SHELL", choices=SHELLS, type=choice(SHELLS), help=", ".join(SHELLS))

    compile = command(
        "compile",
        "compile the kernels that renders of scenes need",
        ", so that no render waits for a compiler: for images of containers and for clusters",
    )
    compile.add_argument("inputs", metavar="SCENE", nargs="*", help=f"{SCENE}, like the options below")
    _add(
        compile,
        f"--general --denoise {STUDIO} --device --threads {INTEGRATION} {READING}",
        denoise="also compile what removing noise needs",
    )

    live = command("view", "show a scene in the browser while it converges", module="wrt.cli.view")
    live.add_argument("source", metavar="SCENE", help=SCENE)
    _add(
        live,
        "--watch --no-browser --port --spp --size --device --threads --seed --up --confined",
        spp="samples per pixel at which rendering pauses (default: at least 1024)",
    )

    render = command("render", "render scenes and meshes to pictures", module="wrt.cli.render")
    render.epilog = EXAMPLES
    render.add_argument(
        "inputs",
        metavar="INPUT",
        nargs="+",
        help="built-in scene (see 'wrt scenes'), scene file (.toml, or Mitsuba .xml) or mesh file; several inputs are "
        "rendered in turn",
    )
    _add(
        render,
        f"--output --spp --time --noise --adaptive --adaptive-unbiased --denoise {STUDIO} --device --threads --dask "
        f"--seed --max-depth {INTEGRATION} --tone --exposure --turntable --frames --fps --part --checkpoint --resume "
        f"--save-every --force --quiet --json {READING}",
        output="picture to write: .png, .jpg, .exr or .npy (default: INPUT's name with .png, in the current folder); "
        "for several inputs, a folder",
        device="device to render on: cpu, cuda, cuda:N, or several GPUs: cuda:0,1 or cuda:all (default: cpu)",
    )
    return parser


def _imported_when_called(module: str, name: str) -> Callable[..., int]:
    """Return a function that imports `module` when called, and calls its function `name`."""

    def run(**options: Any) -> int:
        status: int = getattr(importlib.import_module(module), name)(**options)
        return status

    return run


def _add(parser: Parser, options: str, **helps: str) -> None:
    """Add options of the tables above to a command, some with another help."""
    for option in options.split():
        if option in VALUES:
            details: dict[str, Any] = dict(zip(("metavar", "type", "help"), VALUES[option], strict=True))
            details["default"] = DEFAULTS.get(option)
        elif option in FLAGS:
            details = {"action": "store_true", "help": FLAGS[option]}
        else:
            details = dict(SPECIAL[option])
        details["help"] = helps.get(option.removeprefix("--"), details.get("help"))
        names = [SHORT[option], option] if option in SHORT else [option]
        parser.add_argument(*names, **details)
