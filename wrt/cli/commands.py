"""The short commands. Each takes what handles signals and the options of its command, and returns the exit status."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wrt.cli.exit_status import EXPECTED, complain, failure, warn

if TYPE_CHECKING:
    from wrt.cli.signals import Interrupts


def _print(text: str) -> int:
    """Print the result of a command to standard output; return the exit status."""
    print(text, flush=True)
    return 0


def scenes(_: Interrupts) -> int:
    """List the built-in scenes."""
    from wrt.meshes import scene_descriptions

    descriptions = scene_descriptions()
    width = max(len(name) for name in descriptions)
    return _print("\n".join(f"{name:<{width}}  {description}" for name, description in descriptions.items()))


def schema(_: Interrupts) -> int:
    """Print the schema of scene files."""
    from wrt.io.toml.schema import schema_text

    return _print(schema_text().removesuffix("\n"))


def materials(_: Interrupts, *, name: str | None, presets: bool) -> int:
    """List the materials or the names of optical constants, or describe a material."""
    from wrt.describe.materials import explain_material, list_materials, list_presets
    from wrt.errors import InputError

    if not presets:
        return _print(list_materials() if name is None else explain_material(name))
    if name is not None:
        raise InputError("--presets lists the names for all materials; leave out NAME")
    return _print(list_presets())


def completion(_: Interrupts, *, shell: str) -> int:
    """Print the shell code for completion."""
    from wrt.cli.arguments.completion import shell_code

    return _print(shell_code(shell))


def info(
    _: Interrupts,
    *,
    sources: list[str],
    system: bool,
    memory: bool,
    size: tuple[int, int] | None,
    **arguments: Any,
) -> int:
    """Show what scenes or mesh files contain, or what wrt finds on this machine; return the highest exit status."""
    from wrt.cli.options import loading_options
    from wrt.errors import InputError

    loading = loading_options(arguments)
    if system:
        from wrt.cli.system import system_text

        _print(system_text())
    elif not sources:
        raise InputError("info: name a scene, or give --system")
    if size and not memory:
        raise InputError("--size is for --memory")
    from wrt.progress.bar import short_warnings

    highest = 0
    with short_warnings(warn):
        for number, source in enumerate(sources):
            name = source if len(sources) > 1 else ""
            try:
                text = _memory_text(source, size, loading) if memory else _contents_text(source, loading)
            except EXPECTED as error:
                highest = max(highest, failure(error, name=name))
                continue
            _print("\n" * (number > 0) + f"{name}\n" * bool(name) + text)
    return highest


def _memory_text(source: str, size: tuple[int, int] | None, loading: dict[str, Any]) -> str:
    from wrt.api import load
    from wrt.memory_needed import device_memory, memory_text

    scene = load(source, **loading)
    width, height = size or (scene.settings.width, scene.settings.height)
    return memory_text(device_memory(scene, width=width, height=height), width, height)


def _contents_text(source: str, loading: dict[str, Any]) -> str:
    from wrt.api import load_contents
    from wrt.describe.scene import scene_text

    return scene_text(load_contents(source, **loading))


def develop(
    interrupts: Interrupts,
    *,
    source: str,
    output: str | None,
    tone: str | None,
    exposure: float | str | None,
    force: bool,
) -> int:
    """Turn a picture of radiance into a PNG or a JPEG."""
    from wrt.develop.exposure import stops
    from wrt.errors import InputError, one_line
    from wrt.io.images import PICTURE, check_output, read_image, save_image
    from wrt.io.safe_write import free_path
    from wrt.scene.developing import DEFAULT_TONE, DEVELOPED_SUFFIXES, check_exposure

    default = Path(Path(source).stem + ".png")
    path = free_path(default, PICTURE) if output is None else check_output(output, force=force)
    if path.suffix.lower() not in DEVELOPED_SUFFIXES:
        raise InputError(f"{path}: a developed picture is a PNG or a JPEG; give it a name that ends in .png or .jpg")
    interrupts.unfinished = f"{path} was not written"
    image = read_image(Path(source))
    if output is None:
        path = free_path(default, PICTURE)  # again: it may be the source, which must stay
    chosen = stops(image, check_exposure(exposure))
    developed = save_image(path, image, tone=tone or DEFAULT_TONE, exposure=chosen, force=force)
    if developed is not None:
        if developed.warning:
            complain("warning", developed.warning)
        warn(f"{one_line(str(path))}  tone {developed.tone}  exposure {developed.stops:+.2f} stops")
    return 0


def convert(interrupts: Interrupts, *, source: str, output: str, force: bool, **arguments: Any) -> int:
    """Convert a scene or mesh to a scene file."""
    interrupts.unfinished = f"{output} was not written"
    from wrt.cli.options import loading_options
    from wrt.cli.views import load_seen
    from wrt.io.toml.writer import save_scene
    from wrt.progress.bar import short_warnings

    with short_warnings(warn):
        save_scene(output, load_seen(source, loading_options(arguments)), force=force)
    return 0


def compile(interrupts: Interrupts, *, general: bool, **arguments: Any) -> int:
    """Compile what renders of the scenes need; return the highest exit status.

    Raises:
        InputError: if nothing is to be compiled.
    """
    interrupts.unfinished = "before everything was compiled"
    from wrt.cli.options import RenderOptions
    from wrt.cli.views import each_model
    from wrt.errors import InputError
    from wrt.precompiling import compile_general, precompiled_by
    from wrt.progress.bar import short_warnings

    options = RenderOptions.from_arguments(arguments)
    if not options.inputs and not general:
        raise InputError("name a scene, or give --general")

    highest = 0
    with short_warnings(warn):
        for source in options.inputs:
            name = source if len(options.inputs) > 1 else ""
            try:
                for view in each_model(options):
                    scene = view.load(source)
                    _print(f"{source}: {precompiled_by(partial(view.make_renderer, scene))}")
            except EXPECTED as error:
                highest = max(highest, failure(error, name=name))
        if general:
            _print(f"general kernels: {compile_general(options.settings['sampler'])}")
    return highest
