"""The path of a render's picture, and what is written to it."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from wrt._version import __version__
from wrt.errors import InputError
from wrt.formats.images import PICTURE, check_output, save_image
from wrt.layer_pictures import picture_of
from wrt.renderer import Renderer
from wrt.safe_write import free_place


def picture_place(
    given: str | None, *, default: str, force: bool = False, taken: Collection[Path] = frozenset()
) -> Path:
    """Return the path of a render's picture, after checking that it may be written.

    Args:
        given: the path that was asked for, or None.
        default: the path to use then; a similar name is chosen if a file there may not be replaced.
        force: see `wrt.save_image`.
        taken: paths of other pictures, which must not be replaced either.

    Raises:
        InputError: where it cannot be written there, or would replace another file; see `wrt.safe_write`. The files
            that the scene reads are known only after it was loaded.
    """
    if given is not None:
        return check_output(given, force=force)
    return free_place(Path(default), PICTURE, taken=taken, force=force)


def check_layers(path: Path, renderer: Renderer) -> None:
    """Raise InputError where the layers of a render cannot go into a file, before they are rendered.

    OpenEXR files hold them all. Without light, which is integrator "aov", a PNG may show one of them.
    """
    layers = renderer.settings.layers
    lightless = renderer.integrator == "aov"
    if lightless and not layers:
        raise InputError("integrator aov shows layers alone; name some, such as albedo,normal,depth")
    shown = path.suffix.lower() == ".png" and lightless and len(layers) == 1
    if layers and path.suffix.lower() != ".exr" and not shown:
        raise InputError(f"{path}: layers go into OpenEXR files; give it a name that ends in .exr")


def save_render(path: Path, renderer: Renderer, *, force: bool = False) -> None:
    """Write what has been rendered so far: light, layers, and how they were made.

    Args:
        path: ends in .png, .exr or .npy.
        renderer: whose picture it is.
        force: see `wrt.save_image`.

    Raises:
        InputError: see `check_layers` and `wrt.save_image`.
    """
    check_layers(path, renderer)
    notes = {
        "Software": f"wrt {__version__}",
        "Integrator": renderer.integrator,
        "Samples per pixel": renderer.spp,
        "Seed": renderer.seed,
        "Render seconds": f"{renderer.seconds_render:.1f}",
    }
    exposure = renderer.settings.exposure
    layers = renderer.layers()
    if path.suffix.lower() == ".exr":
        image = None if renderer.integrator == "aov" else renderer.image()
        save_image(path, image, metadata=notes, layers=layers, force=force)
    elif layers:
        ((name, values),) = layers.items()
        save_image(path, picture_of(name, values), metadata=notes, force=force)
    else:
        save_image(path, renderer.image(), exposure=exposure, metadata=notes, force=force)
