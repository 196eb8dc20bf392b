"""Files of the RGL material database (.bsdf): measured reflectances, as colours or as spectra.

Format: Dupuy and Jakob 2018, and the plugin `measured` of Mitsuba 3. Spectra are seen under D65, as all reflectances
that wrt reads from Mitsuba's files.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io import memory_limits
from wrt.io.measured.observer import REFLECTANCE_RESPONSE, WAVELENGTHS
from wrt.io.measured.tensor_file import read_tensors, write_tensors
from wrt.io.safe_read import PathLike, naming_file, read_file
from wrt.linalg import product
from wrt.scene.materials.measured import Measurement
from wrt.values import sealed

_TABLES = ("phi_i", "theta_i", "ndf", "sigma", "vndf", "luminance")
_POLARIZED = ("theta_h", "theta_d", "phi_d", "M")


@memory_limits.one_load()
def load_measurement(path: PathLike) -> Measurement:
    """Return a measured reflectance from a file of the RGL material database.

    A file of spectra becomes linear Rec. 709 as seen under D65. Colours outside of that space are clipped at 0.

    Args:
        path: a file of colours (`..._rgb.bsdf`) or of spectra (`..._spec.bsdf`).

    Raises:
        InputError: when it cannot be read, lacks an array, or holds numbers that cannot be used.
    """
    file = Path(path)
    data = read_file(file)
    with naming_file(file):
        return _measurement(read_tensors(data), file.name)


def _measurement(fields: dict[str, NDArray[Any]], name: str) -> Measurement:
    if all(key in fields for key in _POLARIZED):
        raise InputError("holds Mueller matrices of a polarised measurement, which are not supported")
    content = "spectra" if "wavelengths" in fields else "rgb"
    needed = (*_TABLES, content)
    missing = [key for key in needed if key not in fields]
    if missing:
        raise InputError(f"is no measured reflectance: it lacks {', '.join(map(repr, missing))}")
    for key in needed:
        if fields[key].dtype != np.float32:
            raise InputError(f"{key!r} must be of float32 numbers, not {fields[key].dtype}")
    tables = {key: sealed(fields[key].copy()) for key in _TABLES}
    values = fields[content]
    if values.ndim != 5 or values.size == 0:
        raise InputError(f"{content!r} must have five dimensions, not the shape {values.shape}")
    if not np.isfinite(values).all():
        raise InputError(f"{content!r} has values that are not finite")
    rgb = values if content == "rgb" else _colors(values, fields["wavelengths"])
    jacobian = fields.get("jacobian")
    has_jacobian = jacobian is None or bool(jacobian.any())
    return Measurement(**tables, rgb=sealed(np.maximum(rgb, np.float32(0.0))), jacobian=has_jacobian, name=name)


def _colors(spectra: NDArray[np.float32], wavelengths: NDArray[Any]) -> NDArray[np.float32]:
    """Return (P, T, 3, N, N) linear Rec. 709 of (P, T, L, N, N) spectra, linear between their wavelengths, nm."""
    if wavelengths.shape != spectra.shape[2:3]:
        raise InputError(f"'wavelengths' must be {spectra.shape[2]} numbers, not of the shape {wavelengths.shape}")
    nodes = wavelengths.astype(np.float64)
    if not np.isfinite(nodes).all() or (np.diff(nodes) <= 0.0).any():
        raise InputError("'wavelengths' must ascend")
    shares = np.stack([np.interp(WAVELENGTHS, nodes, row) for row in np.eye(len(nodes))])
    weights = product(shares, REFLECTANCE_RESPONSE)
    rgb = np.empty((*spectra.shape[:2], 3, *spectra.shape[3:]), np.float32)
    for place in np.ndindex(*spectra.shape[:2]):  # a slice at a time: in double precision all may not fit in memory
        rgb[place] = np.einsum("lc,l...->c...", weights, spectra[place].astype(np.float64))
    return rgb


def save_measurement(file: BinaryIO, measurement: Measurement) -> None:
    """Write a measurement as a file of colours, which `load_measurement` reads back bit for bit."""
    text = np.frombuffer(measurement.name.encode(), np.uint8)
    tables = {key: getattr(measurement, key) for key in (*_TABLES, "rgb")}
    jacobian = np.array([measurement.jacobian], np.uint8)
    write_tensors(file, {"description": text, **tables, "jacobian": jacobian})
