"""The command line: ``wrt render`` and what helps to use it.

Exit status: 0 when done; 1 when a file could not be written or memory ran out; 2 when something
given cannot be used; 130 and 143 when Ctrl-C or SIGTERM ended a render. What goes wrong is said in
one line on standard error. Only light modules are imported before there is work for the heavy ones.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import time
from typing import TYPE_CHECKING, NoReturn, cast

from wrt._version import __version__
from wrt.arguments import crop, definition, finite, positive, size, whole
from wrt.errors import InputError, one_line
from wrt.process import importing_renderer, no_collections, settle_in

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from wrt.interrupts import Interrupts
    from wrt.renderer import Renderer
    from wrt.scene import Scene

_IMPORTED_AT = time.perf_counter()

EXIT_FAILED = 1
EXIT_UNUSABLE = 2

SAVE_EVERY_SECONDS = 60.0
"""How often a render with a checkpoint saves itself unless told otherwise."""

AXES = ("x", "y", "z", "-x", "-y", "-z")

EXAMPLES = """\
examples:
  wrt render cornell-box
  wrt render teapot.ply --spp 256 -o teapot.exr
  wrt render room.toml --time 60 --size 1280x720
  wrt render room.toml --spp 4096 --checkpoint room.ckpt --resume
  wrt info robot.glb
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    Args:
        argv: the arguments; by default those of the process.
    """
    try:
        options = _parser().parse_args(_join_axis(sys.argv[1:] if argv is None else list(argv)))
        options.own_process = argv is None
        if options.own_process:
            settle_in()
        run = cast("Callable[[argparse.Namespace], int]", options.run)
        return run(options)
    except InputError as error:
        _complain("error", error)
        return EXIT_UNUSABLE
    except BrokenPipeError:
        # Whoever read our output has seen enough. Python would complain again while it shuts down.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_FAILED
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        _complain("error", f"{where}{error.strerror or error}")
        return EXIT_FAILED
    except MemoryError as error:
        _complain("error", f"not enough memory{f': {error}' if str(error) else ''}")
        return EXIT_FAILED
    except RuntimeError as error:
        if not str(error).startswith("Failed to allocate"):  # Warp's words for a MemoryError
            raise
        _complain("error", f"not enough memory: {error}")
        return EXIT_FAILED
    except KeyboardInterrupt:
        _complain("stopped", "nothing was rendered yet")
        return 130


def _complain(kind: str, what: object) -> None:
    print(f"wrt: {kind}: {one_line(str(what))}", file=sys.stderr, flush=True)


class _Parser(argparse.ArgumentParser):
    """argparse, with errors in one line like all the others."""

    def error(self, message: str) -> NoReturn:
        _complain("error", f"{message} (see '{self.prog} --help')")
        sys.exit(EXIT_UNUSABLE)


def _join_axis(arguments: list[str]) -> list[str]:
    """Write ``--up -z`` as ``--up=-z``, since argparse takes -z for an option."""
    joined: list[str] = []
    for argument in arguments:
        if joined and joined[-1] == "--up" and argument in AXES:
            joined[-1] = f"--up={argument}"
        else:
            joined.append(argument)
    return joined


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="wrt",
        description="Progressive, physically based ray tracing of triangle meshes.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"wrt {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True, parser_class=_Parser)

    def command(name: str, run: Callable[[argparse.Namespace], int], summary: str, more: str = "") -> _Parser:
        """Add a command; `more` is what its own help says after the summary."""
        parser: _Parser = commands.add_parser(
            name,
            help=summary,
            description=f"{summary[0].upper()}{summary[1:]}{more}.",
            formatter_class=argparse.RawDescriptionHelpFormatter if run is _render else argparse.HelpFormatter,
            allow_abbrev=False,
        )
        parser.set_defaults(run=run)
        return parser

    command("scenes", _scenes, "list the built-in scenes")
    command("schema", _schema, "print the JSON schema of scene files", ", for editors")

    materials = command("materials", _materials, "list the materials and their parameters, or explain one")
    materials.add_argument("name", metavar="NAME", nargs="?", help="explain this one, such as diffuse")

    parts = ": shapes, materials, textures, lights, camera"
    info = command("info", _info, "tell what is in a scene or a mesh file", parts)
    info.add_argument("source", metavar="SCENE", help="as for wrt render")

    bits = ", with its arrays beside it. It renders to the same bits"
    convert = command("convert", _convert, "write any scene or mesh as a scene file", bits)
    convert.add_argument("source", metavar="SCENE", help="as for wrt render")
    convert.add_argument("output", metavar="OUT.toml", help="the scene file; its arrays go to OUT_files")
    convert.add_argument("--up", choices=AXES, help="as for wrt render")

    render = command("render", _render, "render a scene or a mesh to a picture")
    render.epilog = EXAMPLES
    _add_render_options(render)
    return parser


def _add_render_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "input",
        metavar="INPUT",
        help="a built-in scene (see 'wrt scenes'), a scene file (.toml, or Mitsuba .xml) or a mesh file",
    )
    add("-o", "--output", metavar="OUT", help="the picture: .png, .exr or .npy (default: INPUT's name with .png, here)")
    add("--spp", metavar="N", type=whole(1), help="samples per pixel in all (default: the scene's own)")
    add("--time", metavar="SECONDS", type=positive, help="render for so long; alone, without limit of samples")
    add("--size", metavar="WxH", type=size, help="pixels, such as 640x480 (default: the scene's own)")
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
    add("--checkpoint", metavar="FILE", help="save the render there, to go on with later")
    add("--resume", action="store_true", help="go on from the checkpoint if there is one")
    add(
        "--save-every",
        metavar="SECONDS",
        type=positive,
        help=f"save checkpoint and picture this often (default: {SAVE_EVERY_SECONDS:.0f}, with --checkpoint)",
    )
    add("--quiet", action="store_true", help="no progress and no summary; errors and warnings only")
    add("--json", action="store_true", help="print a summary as JSON, the last line on standard output")
    add("--triangles", metavar="N", type=whole(1), help="triangles of a scene with a procedural mesh")
    add(
        "-D",
        "--define",
        metavar="NAME=VALUE",
        action="append",
        type=definition,
        help="what $NAME is in a Mitsuba scene",
    )
    add("--allow-outside", action="store_true", help="let a Mitsuba scene name files outside its own folder")
    add("--strict", action="store_true", help="refuse a file of which something would be left out")
    add("--up", metavar="AXIS", choices=AXES, help="which axis of a mesh points up: x, y, z, -x, -y or -z")


def _scenes(options: argparse.Namespace) -> int:
    from wrt.meshes import scene_descriptions

    descriptions = scene_descriptions()
    width = max(len(name) for name in descriptions)
    for name, description in descriptions.items():
        print(f"{name:<{width}}  {description}")
    sys.stdout.flush()
    return 0


def _schema(options: argparse.Namespace) -> int:
    from wrt.formats.scene_schema import schema_text

    sys.stdout.write(schema_text())
    sys.stdout.flush()
    return 0


def _materials(options: argparse.Namespace) -> int:
    from wrt.describe_materials import explain_material, list_materials

    print(list_materials() if options.name is None else explain_material(options.name), flush=True)
    return 0


def _info(options: argparse.Namespace) -> int:
    from pathlib import Path

    from wrt.api import load
    from wrt.describe_scene import scene_text
    from wrt.formats.meshes import MESH_SUFFIXES, load_file
    from wrt.progress import short_warnings

    with short_warnings(lambda line: print(line, file=sys.stderr)):
        # Of a mesh file, what is in it, and not the studio around it.
        alone = Path(options.source).suffix.lower() in MESH_SUFFIXES
        print(scene_text(load_file(options.source) if alone else load(options.source)))
    return 0


def _convert(options: argparse.Namespace) -> int:
    from wrt.api import load
    from wrt.formats.scene_writer import save_scene
    from wrt.progress import short_warnings

    with short_warnings(lambda line: print(line, file=sys.stderr)):
        save_scene(options.output, load(options.source, up=options.up))
    return 0


def _render(options: argparse.Namespace) -> int:
    from wrt.interrupts import Interrupts
    from wrt.progress import once, short_warnings

    said: set[str] = set()
    show = once(lambda line: print(line, file=sys.stderr, flush=True), said)  # while there is no bar yet
    with Interrupts() as interrupts, short_warnings(show):
        try:
            if not options.own_process or options.device != "cpu":
                return _render_until_interrupted(options, interrupts, said)
            from wrt.lean import run_lean

            return run_lean(lambda: _render_until_interrupted(options, interrupts, said))
        except KeyboardInterrupt:
            _complain("stopped", "nothing was rendered yet")
            return interrupts.exit_status


def _render_until_interrupted(options: argparse.Namespace, interrupts: Interrupts, said: set[str]) -> int:
    """Render; what was `said` before is not said again."""
    import dataclasses

    from wrt.pace import LONGEST_PASS
    from wrt.progress import ProgressBar, once, short_warnings

    output, checkpoint = _check_paths(options)
    with (
        ProgressBar(output.stem, time_limit=options.time, wanted=not options.quiet) as bar,
        short_warnings(say := once(bar.message, said)),
    ):
        with no_collections():
            from wrt.api import load
            from wrt.output import check_layers, save_render

            with importing_renderer(options.input):
                scene = load(
                    options.input,
                    triangles=options.triangles,
                    up=options.up,
                    parameters=dict(options.define or ()),
                    strict=options.strict,
                    allow_outside=options.allow_outside,
                )
            if options.exposure is not None:
                scene.settings = dataclasses.replace(scene.settings, exposure=options.exposure)
            renderer = _make_renderer(options, scene, checkpoint, say)
            check_layers(output, renderer)

        def save() -> None:
            if checkpoint is not None:  # first, since the picture can be had from it again
                with _naming(checkpoint):
                    renderer.save_checkpoint(checkpoint)
            with _naming(output):
                save_render(output, renderer)

        save_every = options.save_every or (SAVE_EVERY_SECONDS if checkpoint else float("inf"))
        spp = options.spp or (None if options.time else scene.settings.spp)
        saved_at = time.monotonic()
        stopped = False
        try:
            pass_seconds = save_every if save_every < LONGEST_PASS else None
            for progress in renderer.passes(spp=spp, time=options.time, pass_seconds=pass_seconds):
                bar.update(progress)
                if time.monotonic() - saved_at >= save_every:
                    interrupts.hold(save)
                    saved_at = time.monotonic()
            interrupts.disarm()
        except KeyboardInterrupt:
            if renderer.paths == 0:
                raise
            stopped = True
        save()
    if stopped:
        saved = f"{output} saved" if checkpoint is None else f"{output} and {checkpoint} saved"
        _complain("stopped", f"at {_samples(renderer)}; {saved}")
        return interrupts.exit_status
    _report(options, renderer, output)
    return 0


def _samples(renderer: Renderer) -> str:
    """Say how many samples pixels have: after a pass that was interrupted, not all have as many."""
    least, most = renderer.spp, int(renderer.film.counts.max())
    return f"{least if least == most else f'{least} to {most}'} samples per pixel"


def _check_paths(options: argparse.Namespace) -> tuple[Path, Path | None]:
    """Return where picture and checkpoint go, once it is sure that they could be written."""
    from pathlib import Path

    from wrt.files import require_place
    from wrt.formats.images import check_output

    if options.resume and options.checkpoint is None:
        raise InputError("--resume needs --checkpoint FILE, the file to go on from")
    output = check_output(options.output or f"{Path(options.input).stem or 'picture'}.png")
    if options.checkpoint is None:
        return output, None
    checkpoint = Path(options.checkpoint)
    require_place(checkpoint)
    for other, what in ((output, "the picture"), (Path(options.input), "the input")):
        if os.path.realpath(checkpoint) == os.path.realpath(other):  # unlike `resolve`, it takes links in circles
            raise InputError(f"{checkpoint}: the checkpoint would overwrite {what}; name another file")
    return output, checkpoint


def _make_renderer(
    options: argparse.Namespace, scene: Scene, checkpoint: Path | None, say: Callable[[str], None]
) -> Renderer:
    from wrt.layers import layer_names
    from wrt.renderer import Renderer

    width, height = options.size or (None, None)
    renderer = Renderer(
        scene,
        width=width,
        height=height,
        device=options.device,
        seed=options.seed,
        threads=options.threads,
        max_depth=options.max_depth,
        crop=options.crop,
        sampler=options.sampler,
        integrator=options.integrator,
        clamp_indirect=options.clamp_indirect,
        regularization=options.regularization,
        layers=None if options.layers is None else layer_names(options.layers),
    )
    if options.resume and checkpoint is not None:
        if not checkpoint.exists():
            say(f"wrt: no checkpoint {checkpoint} yet; starting from the beginning")
        else:
            renderer.load_checkpoint(checkpoint)
            if not options.quiet:
                say(f"wrt: going on from {checkpoint}, {_samples(renderer)}")
    return renderer


@contextlib.contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Within the context, have what keeps `path` from being written end as an OSError that names it."""
    try:
        yield
    except InputError as error:  # names the file; and that the path was good had been seen before
        raise OSError(str(error)) from error
    except OSError as error:
        raise OSError(f"{path}: cannot be written: {error.strerror or error}") from error


def _report(options: argparse.Namespace, renderer: Renderer, output: Path) -> None:
    """Say what a finished render came to."""
    from wrt.progress import noise_text, rate_text

    seconds = renderer.seconds_render
    paths_per_second = renderer.paths / seconds if seconds > 0.0 else 0.0
    if not options.quiet:
        parts = [
            one_line(str(output)),
            f"{renderer.film.width}x{renderer.film.height}",
            f"{renderer.spp} spp",
            f"{seconds:.1f} s",
            f"{rate_text(paths_per_second)} paths/s",
            noise_text(renderer.film.noise()),
        ]
        print("  ".join(part for part in parts if part), file=sys.stderr, flush=True)
    if options.json:
        import json

        mean = renderer.image().mean(axis=(0, 1), dtype="float64")
        summary = {
            "device": renderer.device.name,
            "threads": renderer.threads,
            "width": renderer.film.width,
            "height": renderer.film.height,
            "spp": renderer.spp,
            "seconds_total": _seconds_since_start(),
            "seconds_compile": renderer.seconds_compile,
            "seconds_render": seconds,
            "paths_per_second": paths_per_second,
            "rays_per_second": renderer.rays / seconds if seconds > 0.0 else 0.0,
            "mean_radiance": [float(channel) for channel in mean],
            "output": str(output),
        }
        print(json.dumps(summary), flush=True)


def _seconds_since_start() -> float:
    """Return the age of this process; where the system does not tell, the time since this module was imported."""
    imported = time.perf_counter() - _IMPORTED_AT
    try:
        with open("/proc/self/stat", encoding="ascii", errors="replace") as file:
            # Fields after the program's name, which may hold spaces; the 20th is the start in clock
            # ticks since the machine started (proc_pid_stat(5), field 22).
            ticks = int(file.read().rpartition(")")[2].split()[19])
        age = time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")
    except (OSError, AttributeError, ValueError, IndexError):
        return imported
    return max(age, imported)
