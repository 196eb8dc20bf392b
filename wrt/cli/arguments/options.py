"""The commands and their options."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

from wrt._version import __version__
from wrt.cli.arguments import types
from wrt.cli.arguments.parser import Once, Parser, parse_with
from wrt.cli.arguments.types import choice, positive, whole
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


def _value(metavar: str, type: Callable[[str], Any], help: str, **settings: Any) -> dict[str, Any]:
    """Return argparse's settings of an option that takes a value."""
    return {"metavar": metavar, "type": type, "help": help, **settings}


def _flag(help: str, **settings: Any) -> dict[str, Any]:
    """Return argparse's settings of an option without a value."""
    return {"action": "store_true", "help": help, **settings}


OPTIONS: dict[str, dict[str, Any]] = {
    "--spp": _value("N", whole(1), "samples per pixel in total (default: from the scene)"),
    "--time": _value("TIME", types.duration,
        "stop after this time, such as 90, 90s, 1m30s or 1:30; without --spp there is no sample limit"),
    "--noise": _value("SHARE", types.share,
        "stop when the noise of the picture is below this share of its brightness, such as 1%% or 0.01"),
    "--size": _value("WxH", types.size, "resolution: 640x480, 720p, 1080p or 4k (default: from the scene)"),
    "--crop": _value("X0,Y0,X1,Y1", types.crop, "render only columns X0 to X1-1 and rows Y0 to Y1-1"),
    "--view": _value("VIEW", types.checked_by("wrt.studio.views", "view_angles"),
        "view the scene from AZIMUTH,ELEVATION in degrees, or from the front, right, back, left, top, bottom or "
        "three-quarter"),
    "--material": _value("NAME", types.checked_by("wrt.io.objects", "material_of"),
        "material of a mesh, such as gold, glass, red, #ff8800, diffuse:0.8,0.2,0 or an image for its texture",
        dest="material"),
    "--background": _value("COLOR", types.color,
        "colour behind what is shown, such as white or #f4f4f4, instead of the backdrop"),
    "--edges": _flag("draw the edges of triangles and polygons over the picture", default=None),
    "--wireframe": _flag("draw only these lines, on the background or on white", default=None),
    "--edge-width": _value("PIXELS", types.positive, "width of the lines of --edges and --wireframe (default: 1)"),
    "--edge-color": _value("COLOR", types.color, "their colour, such as white or #f4f4f4 (default: black)"),
    "--environment": _value("FILE", str, "light the scene with an image, such as an .hdr, or with sky for sun and sky"),
    "--layers": _value("NAMES", str, "layers to add to an .exr: albedo, normal, depth and others (see the docs)"),
    "--triangles": _value("N", whole(1), "number of triangles of a procedural mesh"),
    "--device": _value("NAME", str, "cpu, cuda or cuda:N (default: cpu)", default="cpu"),
    "--threads": _value("N", whole(1), "number of CPU threads (default: one per core)"),
    "--dask": _value("ADDRESS", str,
        "render on the workers of a Dask scheduler, such as tcp://head:8786, or on N processes of this machine: "
        "local:N"),
    "--seed": _value("N", whole(0), "random seed (default: 0)", default=0),
    "--max-depth": _value("N", whole(1), "maximum number of path segments (default: from the scene)"),
    "--sampler": _value("NAME", str, "independent, stratified, sobol or blue-noise (default: from the scene)"),
    "--integrator": _value("NAME", str, "path, direct, whitted, ao, aov, or one of --with (default: from the scene)"),
    "--clamp-indirect": _value("RADIANCE", positive, "limit the indirect radiance of each path; biased"),
    "--regularization": _value("ALPHA", types.finite, "add this roughness to rough surfaces along a path; biased"),
    "--tone": _value("NAME", str,
        "tone curve of a PNG or JPEG: soft, none, neutral, agx, aces, ocio or ocio:CONFIG,DISPLAY,VIEW (default: "
        "soft)"),
    "--exposure": _value("STOPS", types.exposure,
        "brighten a PNG or JPEG by this many stops (factors of two), or auto (default: 0, and auto for pictures "
        "that would be mostly white or dark)"),
    "--turntable": _value("N", whole(2),
        "render N frames once around the scene, to a video (.mp4, .webp or .gif) or to frames (cow_%%04d.png)"),
    "--frames": _value("A-B", types.frames,
        "render frames A to B of a scene with keyframes or a glTF or USD animation; frame f is at f / FPS seconds"),
    "--fps": _value("FPS", positive, "frames per second (default: 24)", default=24.0),
    "--part": _value("I/N", types.part,
        "render only part I of N, from 1/N to N/N, to a file for wrt merge (default: INPUT-I-of-N.wrt)"),
    "--save-every": _value("TIME", types.interval,
        "time between saves of picture and checkpoint during the render, or never (default: 60 s for the "
        "checkpoint; for the picture 2 s at first, then longer and longer)"),
    "--camera": _value("NAME", str, "name or number, from 0, of one of the input's cameras (default: the first)",
        dest="camera"),
    "--cameras": _value("FILE", str, "render the input through the cameras of transforms.json, or of a folder with "
        "COLMAP's cameras.txt and images.txt: all, or the one that --camera names"),
    "--port": _value("N", whole(1), "port of the page (default: the first free one from 8765 on)"),
    "--denoise": _flag("remove noise from the picture"),
    "--transparent": _flag("leave out the backdrop: the picture has an alpha channel"),
    "--caustics": _flag("follow photons for the light that glass, mirrors and water throw; slightly biased",
        default=None),
    "--shadow-catcher": _flag("put a mesh on ground that shows only its shadow: the picture has an alpha channel"),
    "--double-sided": _flag("show the backs of all surfaces, also of single-sided ones"),
    "--resume": _flag("continue from the --checkpoint file if it exists; of an animation, render missing frames"),
    "--quiet": _flag("show only errors and warnings"),
    "--json": _flag("print a summary of each render to standard output as a line of JSON"),
    "--force": _flag("let -o overwrite a file that wrt did not write"),
    "--confined": _flag("refuse references to files outside the input's folder"),
    "--strict": _flag("treat unsupported content as an error, not a warning"),
    "--presets": _flag("list the names that metal, f0 and ior take, with values and sources"),
    "--system": _flag("show versions, threads, the kernel and the GPUs of this machine"),
    "--memory": _flag("show the memory that a picture takes on a GPU, by part"),
    "--general": _flag("also compile the kernels that render most other scenes, though slower (two minutes)"),
    "--watch": _flag("load the scene again whenever its file changes"),
    "--no-browser": _flag("only print the address of the page"),
    "--adaptive": _flag("let parts of the picture that reach --noise stop before the others; slightly biased",
        default=None),
    "--frame": {
        "action": argparse.BooleanOptionalAction,
        "help": "ignore the input's camera and frame the scene; --no-frame keeps a camera that shows a mesh small",
    },
    "--output": _value("OUT", str,
        "picture to write: .png, .jpg, .exr or .npy (default: INPUT's name with .png, in the current folder); for "
        "several inputs, a folder", action=Once),
    "--checkpoint": _value("FILE", str, "save the state of the render here, for --resume", action=Once),
    "--define": _value("NAME=VALUE", types.definition, "value of the parameter $NAME in a Mitsuba scene",
        dest="parameters", action="append"),
    "--with": _value("FILE", str, "first run a Python file that registers models of your own",
        dest="models", action="append"),
    "--crease": _value("DEGREES", whole(0),
        "smooth edges that are folded by up to this angle in meshes without normals; 0 is flat (default: what the "
        "format says, or 60)", dest="smooth_degrees"),
    "--up": _value("AXIS", choice(AXES), "axis of a mesh that points up: x, y, z, -x, -y or -z", choices=AXES),
    "--point-radius": _value("R", types.positive, "radius of the spheres that a file's points are drawn as, in its "
        "units (default: by their distances)"),
}  # fmt: skip

ALIASES = {"--output": "-o", "--define": "-D", "--camera": "--sensor", "--material": "--color"}
"""Second names; Mitsuba calls a camera a sensor, and a colour is a material."""

STUDIO = (
    "--size --crop --view --frame --material --background --environment --transparent --shadow-catcher --edges "
    "--wireframe --edge-width --edge-color --layers --triangles"
)
INTEGRATION = "--sampler --integrator --caustics --clamp-indirect --regularization"
READING = "--with --define --camera --confined --strict --up --crease --point-radius --double-sided"


def parse(arguments: list[str]) -> argparse.Namespace:
    """Return the parsed arguments of a command line; `module` and `function` name what executes the command.

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


ARGUMENTS: dict[str, dict[str, Any]] = {
    "NAME": {"dest": "name", "nargs": "?", "help": "describe this material, such as diffuse"},
    "SCENES": {"dest": "sources", "nargs": "*", "metavar": "SCENE", "help": "built-in scenes, scene or mesh files"},
    "SCENE": {"dest": "source", "help": "built-in scene, scene file or mesh file, as for wrt render"},
    "OUT.toml": {
        "dest": "output",
        "help": "scene file to write, with its arrays in the folder OUT_files; or a GLB file for other programs",
    },
    "PICTURE": {"dest": "source", "help": "picture of radiance: .exr, .hdr or .npy"},
    "PART": {"dest": "inputs", "nargs": "+", "help": "files that wrt render --part has written, in any order"},
    "SHELL": {"dest": "shell", "choices": SHELLS, "type": choice(SHELLS), "help": ", ".join(SHELLS)},
    "INPUT": {
        "dest": "inputs",
        "nargs": "+",
        "help": "built-in scene (see 'wrt scenes'), scene file (.toml, or Mitsuba .xml) or mesh file; several inputs "
        "are rendered in turn",
    },
}
"""Arguments that are not options."""


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

    def command(name: str, words: str, summary: str, **changes: Any) -> Parser:
        """Add a command with arguments and options of the tables above.

        Args:
            name: its name.
            words: its arguments and options.
            summary: what it does; the list of commands shows the part up to a vertical bar.
            changes: a different help, or other settings, of some arguments.
        """
        short, _, details = summary.partition("|")
        added: Parser = commands.add_parser(
            name,
            help=short,
            description=f"{short[0].upper()}{short[1:]}{details}.",
            formatter_class=argparse.RawDescriptionHelpFormatter if name == "render" else argparse.HelpFormatter,
            allow_abbrev=False,
        )
        added.set_defaults(command=name)
        for word in words.split():
            _add(added, word, changes.get(word.removeprefix("--").lower(), {}))
        return added

    one_camera = {
        "help": "take the camera of transforms.json, or of a folder with COLMAP's cameras.txt and images.txt: the "
        "first, or the one that --camera names"
    }
    command("scenes", "", "list the built-in scenes")
    command("schema", "--with", "print the JSON schema of scene files|, for editors")
    command("materials", "NAME --presets --with", "list the materials and their parameters, or describe one")
    command(
        "info",
        f"SCENES --system --memory --size {READING}",
        "show what scenes or mesh files contain|: shapes, materials, textures, lights and camera",
        size={"help": "with --memory: the size of the picture"},
    )
    command(
        "convert",
        f"SCENE OUT.toml --force --cameras {READING}",
        "convert any scene or mesh to a scene file or GLB|, with its arrays in a folder beside it. Both render to "
        "bit-identical pictures",
        force={"help": "overwrite existing files"},
        cameras=one_camera,
    )
    command(
        "develop",
        "PICTURE --output --tone --exposure --force",
        "turn a picture of radiance into a PNG or a JPEG| with an exposure and a tone curve",
        output={"help": "picture to write: .png or .jpg (default: PICTURE's name with .png)"},
    )
    command(
        "merge",
        "PART --output --checkpoint --tone --exposure --force --quiet",
        "merge the parts of a render to its picture|, bit for bit",
        output={"required": True, "help": "picture to write: .png, .jpg, .exr or .npy"},
        checkpoint={"help": "also save the state, for wrt render SCENE --resume"},
    )
    command(
        "completion",
        "SHELL",
        "print shell code that completes wrt's commands and options|. In bash and zsh: "
        'eval "$(wrt completion bash)"; in fish: wrt completion fish | source',
    )
    command(
        "compile",
        f"INPUT --general --denoise {STUDIO} --device --threads {INTEGRATION} --cameras {READING}",
        "compile the kernels that renders of scenes need|, so that no render waits for a compiler: for images of "
        "containers and for clusters",
        input={"nargs": "*", "metavar": "SCENE", "help": f"{ARGUMENTS['SCENE']['help']}, like the options below"},
        denoise={"help": "also compile what removing noise needs"},
    )
    command(
        "view",
        f"SCENE --watch --no-browser --port --spp --size --device --threads --seed --cameras {READING}",
        "show a scene in the browser while it converges",
        spp={"help": "samples per pixel at which rendering pauses (default: at least 1024)"},
        cameras=one_camera,
    )
    render = command(
        "render",
        f"INPUT --output --spp --time --noise --adaptive --denoise {STUDIO} --device --threads "
        f"--dask --seed --max-depth {INTEGRATION} --tone --exposure --turntable --frames --fps --part --checkpoint "
        f"--resume --save-every --force --quiet --json --cameras {READING}",
        "render scenes and meshes to pictures",
        device={"help": "device to render on: cpu, cuda, cuda:N, or several GPUs: cuda:0,1 or cuda:all (default: cpu)"},
    )
    render.epilog = EXAMPLES
    return parser


def _add(parser: Parser, word: str, changes: dict[str, Any]) -> None:
    """Add an argument or option of the tables above to a command, with some of its settings changed."""
    if word.startswith("--"):
        parser.add_argument(*([ALIASES[word]] if word in ALIASES else []), word, **{**OPTIONS[word], **changes})
    else:
        settings = {"metavar": word, **ARGUMENTS[word], **changes}
        parser.add_argument(settings.pop("dest"), **settings)
