"""Files of densities: NumPy, Mitsuba's .vol and NanoVDB, in scene files, and what is wrong with them."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from support.mitsuba_files import write_vol

import wrt
from wrt.backend.warp_start import initialize_warp
from wrt.rendering.checkpoint import scene_fingerprint

VALUES = np.random.default_rng(3).random((3, 4, 5)).astype(np.float32)
BOX = ((-1.0, 0.5, -2.0), (1.0, 2.5, 0.0))


def density_of(folder: Path, density: str) -> wrt.DensityGrid:
    """Return the grid of a scene file with this table."""
    path = folder / "scene.toml"
    path.write_text(
        f'[media.smoke]\ntype = "albedo"\nalbedo = 0.9\nextinction = 3.0\ndensity = {{ {density} }}\n'
        '[materials.edge]\ntype = "null"\ninterior = "smoke"\n[[shapes]]\ntype = "box"\nmaterial = "edge"\n'
    )
    (medium,) = wrt.load(path).media
    assert medium.density is not None
    return medium.density


def test_arrays_archives_and_volumes_of_mitsuba(tmp_path: Path) -> None:
    np.save(tmp_path / "smoke.npy", VALUES)
    np.save(tmp_path / "colors.npy", np.full((2, 2, 2, 3), 0.25, np.float32))
    bounds = "lower = [-1, 0.5, -2], upper = [1, 2.5, 0], factor = 2.0"
    loaded = density_of(tmp_path, f'file = "smoke.npy", albedo = "colors.npy", {bounds}')
    np.testing.assert_array_equal(loaded.values, VALUES)
    np.testing.assert_array_equal(loaded.albedo, np.load(tmp_path / "colors.npy"))
    assert (loaded.lower, loaded.upper, loaded.factor, loaded.transform) == (*BOX, 2.0, None)
    turned = np.array([[0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 3.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    arrays = {"density": VALUES, "lower": BOX[0], "upper": BOX[1], "transform": turned, "emission": VALUES}
    np.savez(tmp_path / "smoke.npz", **arrays)
    loaded = density_of(tmp_path, 'file = "smoke.npz", translate = [0.0, 0.0, 5.0]')
    assert (loaded.lower, loaded.upper) == BOX
    np.testing.assert_array_equal(loaded.emission, VALUES)
    # The table's transform comes after the file's.
    np.testing.assert_array_equal(loaded.transform[:3, 3], [0.0, 3.0, 5.0])
    write_vol(tmp_path / "plain.vol", VALUES, *BOX)
    loaded = density_of(tmp_path, 'file = "plain.vol"')
    np.testing.assert_array_equal(loaded.values, VALUES)
    assert (loaded.lower, loaded.upper) == BOX
    np.savez(tmp_path / "several.npz", a=VALUES, b=2.0 * VALUES)
    np.testing.assert_array_equal(wrt.load_density(tmp_path / "several.npz", grid="b").values, 2.0 * VALUES)
    with pytest.raises(wrt.InputError, match=r"several\.npz: there is no array 'density' in it, but 'a', 'b'"):
        wrt.load_density(tmp_path / "several.npz")


def test_scenes_are_written_and_read_back(tmp_path: Path) -> None:
    colors = np.random.default_rng(4).random((2, 2, 1, 3)).astype(np.float32)
    place = np.diag([1.0, 2.0, 1.0, 1.0])
    grid = wrt.DensityGrid(VALUES, *BOX, transform=place, factor=0.3, albedo=colors, emission=VALUES)
    scene = wrt.Scene()
    scene.medium = wrt.Medium(0.1, 0.5, emission=0.2, density=grid)
    scene.add(wrt.sphere(), material=wrt.Null(interior=wrt.Medium(2.0, density=grid)))
    wrt.save_scene(tmp_path / "scene.toml", scene)
    assert scene_fingerprint(wrt.load(tmp_path / "scene.toml")) == scene_fingerprint(scene)
    assert len(list(tmp_path.glob("scene_files/density-*.npz"))) == 1


@pytest.mark.parametrize(("wrap", "mode"), [("repeat", "wrap"), ("mirror", "symmetric")])
def test_an_albedo_grid_of_a_homogeneous_medium_is_continued_over_the_shape(
    wrap: str, mode: Any, tmp_path: Path
) -> None:
    albedo = np.random.default_rng(7).random((2, 3, 4, 3)).astype(np.float32)
    write_vol(tmp_path / "albedo.vol", albedo)
    (tmp_path / "scene.xml").write_text(
        f"""<scene version="3.0.0"><shape type="cube"><bsdf type="null"/>
        <transform name="to_world"><scale x="0.6" y="0.9" z="0.2"/><translate x="1.2" y="0.5" z="0.5"/></transform>
        <medium type="homogeneous" name="interior"><float name="sigma_t" value="2"/>
        <volume type="gridvolume" name="albedo"><string name="filename" value="albedo.vol"/>
        <string name="wrap_mode" value="{wrap}"/></volume></medium></shape></scene>"""
    )
    (medium,) = wrt.load(tmp_path / "scene.xml", strict=True).media
    np.testing.assert_allclose(medium.extinction, 2.0)
    grid = medium.density
    assert grid is not None
    # Along x from 0.6 to 1.8, along y from -0.4 to 1.4, along z from 0.3 to 0.7: boxes 0 and 1, -1 to 1, and 0.
    np.testing.assert_allclose(grid.to_world, [[2, 0, 0, 0], [0, 3, 0, -1], [0, 0, 1, 0], [0, 0, 0, 1]])
    np.testing.assert_array_equal(grid.albedo, np.pad(albedo, [(0, 0), (3, 3), (0, 4), (0, 0)], mode=mode))
    np.testing.assert_array_equal(grid.values, 1.0)


def nanovdb(path: Path, values: np.ndarray, codec: str = "none") -> bytes:
    """Write a NanoVDB file by Warp, and return its bytes."""
    initialize_warp()
    place = {"min_world": (-1.0, 2.0, 0.5), "voxel_size": 0.25, "bg_value": 0.0}
    wp.Volume.load_from_numpy(values, device="cpu", **place).save_to_nvdb(str(path), codec=codec)
    return path.read_bytes()


@pytest.mark.parametrize("codec", ["none", "zip"])
def test_nanovdb(codec: str, tmp_path: Path) -> None:
    """Every value is at the point of the world where Warp's own lookups have it; some leaves are empty."""
    values = np.zeros((40, 24, 33), np.float32)
    values[3:20, 5:9, 17:30] = np.random.default_rng(6).random((17, 4, 13))
    values[30:35, 20:24, 0:5] = 2.0
    nanovdb(tmp_path / "smoke.nvdb", values, codec)
    grid = wrt.load_density(tmp_path / "smoke.nvdb")
    nz, ny, nx = grid.values.shape
    for index in ((3, 5, 17), (19, 8, 29), (10, 6, 20), (32, 21, 2), (0, 0, 0)):
        place = np.array([-1.0, 2.0, 0.5]) + 0.25 * np.array(index)
        cell = (np.linalg.inv(grid.to_world) @ [*place, 1.0])[:3] * (nx, ny, nz) - 0.5
        np.testing.assert_allclose(cell, np.rint(cell), atol=1e-4)
        i, j, k = np.rint(cell).astype(int)
        inside = 0 <= i < nx and 0 <= j < ny and 0 <= k < nz
        assert (grid.values[k, j, i] if inside else 0.0) == values[index]
    np.testing.assert_allclose(grid.values.sum(dtype=np.float64), values.sum(dtype=np.float64), rtol=1e-6)


def tree_of(data: bytes) -> int:
    """Return where a NanoVDB file has the tree of its grid."""
    return 16 + 176 + struct.unpack_from("<I", data, 16 + 136)[0] + 672


def test_uniform_blocks_of_nanovdb(tmp_path: Path) -> None:
    """A block of one value has no leaf, but a tile in the node above: here made by hand from one with a leaf."""
    values = np.zeros((16, 8, 8), np.float32)
    values[:8] = 3.0
    values[9, 1, 1] = 1.0
    data = bytearray(nanovdb(tmp_path / "smoke.nvdb", values))
    tree = tree_of(data)
    leaf, lower = (tree + offset for offset in struct.unpack_from("<2q", data, tree))
    # Drop the leaf that is all 3, which must be the first, and say so by a tile.
    assert struct.unpack_from("<I", data, tree + 32)[0] == 2
    assert (np.frombuffer(bytes(data), "<f4", 512, leaf + 96) == 3.0).all()
    struct.pack_into("<I", data, tree + 32, 1)
    struct.pack_into("<q", data, tree, leaf + 2144 - tree)
    data[lower + 32] |= 1
    data[lower + 544] &= 0xFE
    struct.pack_into("<f", data, lower + 1088, 3.0)
    (tmp_path / "tile.nvdb").write_bytes(data)
    with_leaf, tiled = (wrt.load_density(tmp_path / name) for name in ("smoke.nvdb", "tile.nvdb"))
    np.testing.assert_array_equal(with_leaf.values, tiled.values)
    assert with_leaf.to_world.tolist() == tiled.to_world.tolist()


def test_what_is_wrong_is_told(tmp_path: Path) -> None:
    write_vol(tmp_path / "smoke.vol", VALUES)
    vol = (tmp_path / "smoke.vol").read_bytes()
    nvdb = nanovdb(tmp_path / "smoke.nvdb", np.pad(VALUES, 8))
    leaf = tree_of(nvdb) + struct.unpack_from("<q", nvdb, tree_of(nvdb))[0]
    for name, data, text in (
        ("short.vol", vol[:-4], "take 240 bytes, but it is shorter"),
        ("other.vol", b"PK" + vol, "must begin with 'VOL'"),
        ("smoke.vdb", b" BDV", r"OpenVDB files cannot be read; .* nanovdb_convert smoke\.vdb smoke\.nvdb"),
        ("smoke.txt", b"1", r"must be a file of \.npy, \.npz, \.vol, \.nvdb"),
        ("short.nvdb", nvdb[:-100], "damaged, or not whole"),
        ("far.nvdb", nvdb[:leaf] + struct.pack("<i", -(2**30)) + nvdb[leaf + 4 :], "its volumes would take"),
    ):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(wrt.InputError, match=text) as error:
            density_of(tmp_path, f'file = "{name}"')
        assert name in str(error.value)
    with pytest.raises(wrt.InputError, match="there is no 'heat'"):
        wrt.load_density(tmp_path / "smoke.nvdb", grid="heat")
    np.save(tmp_path / "flat.npy", VALUES[0])
    with pytest.raises(wrt.InputError, match=r"media\.smoke\.density\.file: .*values must be \(nz, ny, nx\)"):
        density_of(tmp_path, 'file = "flat.npy"')
