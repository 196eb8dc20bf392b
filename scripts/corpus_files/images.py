"""Images of every kind: PNG, JPEG, BMP, OpenEXR, NumPy, Radiance HDR."""

from __future__ import annotations

from pathlib import Path

import numpy as np


def write_images(folder: Path, rng: np.random.Generator) -> None:
    """Write images of random pixels."""
    from PIL import Image

    import wrt

    rgba = rng.integers(0, 256, (6, 8, 4), np.uint8)
    Image.fromarray(rgba).save(folder / "colors.png")
    Image.fromarray(rgba[..., 0]).save(folder / "grey.png")
    Image.fromarray(rgba[..., 0]).convert("P").save(folder / "palette.png")
    Image.fromarray(rgba[..., 2:]).save(folder / "grey-alpha.png")
    Image.fromarray(rgba[..., 0] > 100).save(folder / "bits.png")
    Image.fromarray(rng.integers(0, 65536, (4, 4), np.uint16)).save(folder / "deep.png")
    Image.fromarray(rgba[..., :3]).save(folder / "photo.jpg", quality=50)
    Image.fromarray(rgba[..., :3]).save(folder / "raw.bmp")
    radiance = rng.random((8, 16, 3), np.float32) * 3
    wrt.save_image(folder / "light.exr", radiance, force=True)
    wrt.save_image(folder / "light.npy", radiance[:4, :4], force=True)
    mantissas = np.minimum(radiance * 64, 255).astype(np.uint8)
    pixels = np.concatenate([mantissas, np.full((8, 16, 1), 130, np.uint8)], axis=2)
    flat = b"".join(row.tobytes() for row in pixels)
    (folder / "sky.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X 16\n" + flat)
    runs = b"".join(
        bytes([2, 2, 0, 16]) + b"".join(bytes([16]) + row[:, k].tobytes() for k in range(4)) for row in pixels
    )
    (folder / "runs.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X 16\n" + runs)
