"""Densities on grids: volumes of Mitsuba and NanoVDB."""

from __future__ import annotations

from pathlib import Path

import numpy as np


def write_volumes(folder: Path) -> None:
    """Write a small volume of each kind, of numbers from 0 to 1."""
    import warp as wp

    values = np.linspace(0.0, 1.0, 24, dtype=np.float32).reshape(2, 3, 4)
    nz, ny, nx = values.shape
    header = b"VOL\3" + np.array([1, nx, ny, nz, 1], "<i4").tobytes()
    box = np.array([0, 0, 0, 1, 1, 1], "<f4").tobytes()
    (folder / "smoke.vol").write_bytes(header + box + values.tobytes())
    volume = wp.Volume.load_from_numpy(values.T, min_world=(-1.0, 2.0, 0.5), voxel_size=0.25, device="cpu")
    volume.save_to_nvdb(str(folder / "smoke.nvdb"), codec="zip")
