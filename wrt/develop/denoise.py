"""Remove noise by Open Image Denoise (Áfra 2019 to 2025).

wrt works around two of its defaults. It scales pictures by their mean brightness, whose last bits depend on the number
of threads, so the scale is computed here. And it mistakes noise in albedo and normals for edges, so these are denoised
first.
"""

from __future__ import annotations

import importlib.util
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.linalg import weighted_sum

PACKAGE = "mitsuba_oidn"

MIDDLE_GREY = 0.18  # mean logarithmic luminance to which Open Image Denoise's automatic exposure scales a picture
_LEAST = 1e-8
_LUMINANCE = (0.212671, 0.715160, 0.072169)


def require_denoiser() -> None:
    """Raise InputError unless Open Image Denoise is installed."""
    if importlib.util.find_spec(PACKAGE) is None:
        raise InputError("denoising needs Open Image Denoise: pip install mitsuba-oidn")


def denoise(
    image: NDArray[np.floating[Any]],
    albedo: NDArray[np.floating[Any]] | None = None,
    normal: NDArray[np.floating[Any]] | None = None,
    *,
    threads: int | None = None,
) -> NDArray[np.float32]:
    """Remove most of a picture's noise; the bits are the same for any number of threads.

    Args:
        image: (H, W, 3) linear radiance, not negative; values that are not finite count as 0.
        albedo: (H, W, 3) reflectance of visible surfaces, 0 to 1; see `wrt.Renderer.denoised`.
        normal: (H, W, 3) shading normals in world space, of length 1 or less.
        threads: CPU threads; by default all cores.

    Raises:
        InputError: if the shapes of arrays differ, or Open Image Denoise is not installed.
    """
    require_denoiser()
    color = _clean(image, "image", 0.0, np.inf)
    guides = {}
    for name, values, low in (("albedo", albedo, 0.0), ("normal", normal, -1.0)):
        if values is not None:
            guides[name] = _filtered({name: _clean(values, name, low, 1.0)}, threads)
            if guides[name].shape != color.shape:
                raise InputError(f"{name} must have the shape of the image, {color.shape}, not {guides[name].shape}")
    if not color.any():
        return color
    options = {"hdr": True, "clean_aux": bool(guides), "input_scale": _scale(color)}
    return _filtered({"color": color, **guides}, threads, **options)


def _clean(values: NDArray[np.floating[Any]], name: str, low: float, high: float) -> NDArray[np.float32]:
    array = np.asarray(values, np.float32)
    if array.ndim != 3 or array.shape[2] != 3 or 0 in array.shape:
        raise InputError(f"{name} must have shape (H, W, 3), not {array.shape}")
    cleaned: NDArray[np.float32] = np.clip(np.where(np.isfinite(array), array, 0.0), low, high).astype(np.float32)
    return np.ascontiguousarray(cleaned)


def _scale(color: NDArray[np.float32]) -> float:
    """Return the factor that brings the picture's mean logarithmic luminance to a middle grey."""
    luminance = weighted_sum(color.astype(np.float64), _LUMINANCE)
    lit = luminance[luminance > _LEAST]
    if not len(lit):
        return 1.0
    return float(np.float32(MIDDLE_GREY / np.exp2(np.log2(lit).mean())))


def _filtered(images: dict[str, NDArray[np.float32]], threads: int | None, **options: Any) -> NDArray[np.float32]:
    """Filter the first image, guided by the others."""
    oidn = importlib.import_module(PACKAGE)
    output = np.empty_like(next(iter(images.values())))
    device = oidn.Device(oidn.DeviceType.CPU)
    if threads is not None:
        device.num_threads = threads
    filter = device.new_filter("RT")
    for name, values in images.items():
        filter.set_image(name, values)
    filter.set_image("output", output)
    # Half the time of the highest quality, with the same error: on three scenes of the benchmark at 16 samples per
    # pixel 0.043, 0.028 and 0.041 of radiance, against 0.044, 0.026 and 0.042.
    filter.quality = oidn.Quality.Balanced
    for name, value in options.items():
        setattr(filter, name, value)
    filter.execute()
    return output
