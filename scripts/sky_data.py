"""Write wrt/scene/skies/data/hosek_wilkie.npz: `python scripts/sky_data.py [FOLDER]`.

The tables were published by Hošek and Wilkie (3-clause BSD licence, beside the result): the parameters of the sky's
radiance in linear Rec. 709, and the spectral radiance of the sun with its limb darkening. They are read from
`sunsky_datasets.bin` in FOLDER, by default the copy in the installed mitsuba package.
"""

from __future__ import annotations

import math
import struct
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

RESULT = Path(__file__).resolve().parent.parent / "wrt" / "scene" / "skies" / "data" / "hosek_wilkie.npz"

TABLES = {
    "sky_shape": ("sky_params_rgb", (10, 2, 6, 3, 9)),
    "sky_radiance": ("sky_rad_rgb", (10, 2, 6, 3)),
    "sun_radiance": ("sun_rad_spec", (10, 45, 11, 4)),
    "sun_limb": ("sun_ld_spec", (11, 6)),
}
"""Names of the tables in the result and in the source, and their shapes."""

_FLOAT64 = 11


def read_tensors(path: Path) -> dict[str, NDArray[np.float64]]:
    """Return the double-precision tensors of a Mitsuba `TensorFile`."""
    data = path.read_bytes()
    if not data.startswith(b"tensor_file\0"):
        raise SystemExit(f"{path}: not a tensor file")
    (count,) = struct.unpack_from("<I", data, 14)
    place, result = 18, {}
    for _ in range(count):
        (length,) = struct.unpack_from("<H", data, place)
        name = data[place + 2 : place + 2 + length].decode()
        place += 2 + length
        dimensions, kind, start = struct.unpack_from("<HBQ", data, place)
        shape = struct.unpack_from(f"<{dimensions}Q", data, place + 11)
        place += 11 + 8 * dimensions
        if kind == _FLOAT64:
            result[name] = np.frombuffer(data, "<f8", math.prod(shape), start).reshape(shape)
    return result


def tables(folder: Path) -> dict[str, NDArray[np.float32]]:
    """Return the tables of the result."""
    tensors = read_tensors(folder / "sunsky_datasets.bin")
    for name, shape in TABLES.values():
        if tensors[name].shape != shape:
            raise SystemExit(f"{name} has the shape {tensors[name].shape}, not {shape}")
    return {key: tensors[name].astype(np.float32) for key, (name, _) in TABLES.items()}


def main() -> None:
    """Write the file."""
    if len(sys.argv) > 1:
        folder = Path(sys.argv[1])
    else:
        import mitsuba

        folder = Path(mitsuba.__file__).parent / "data" / "sunsky"
    np.savez_compressed(RESULT, **tables(folder))  # type: ignore[arg-type]


if __name__ == "__main__":
    main()
