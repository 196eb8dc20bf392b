"""Mitsuba 3 as one of the renderers that are compared: python mitsuba_worker.py FOLDER --device VARIANT, see worker.py.

The folder has scene.json, which `write_scene` makes, or names a file of Mitsuba's own format.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

STARTED = time.perf_counter()

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parent))


def write_scene(scene: dict[str, Any], folder: Path) -> None:
    """Write a dictionary for `mitsuba.load_dict` as scene.json, with its images beside it."""
    import mitsuba as mi
    import numpy as np

    images = 0

    def plain(value: Any) -> Any:
        nonlocal images
        if isinstance(value, dict):
            return {key: plain(item) for key, item in value.items()}
        if isinstance(value, mi.ScalarTransform4f):
            return {"matrix": np.array(value.matrix, np.float64).tolist()}
        if isinstance(value, mi.Bitmap):
            images += 1
            file = folder / f"image_{images}.npy"
            np.save(file, np.array(value))
            return {"image": str(file)}
        return value

    (folder / "scene.json").write_text(json.dumps(plain(scene)), encoding="utf-8")


def square_text(file: Path, size: int, *, box: bool = False) -> str:
    """Return a file's scene with what it includes, `size` pixels a side, and perhaps a box filter."""
    root = ElementTree.parse(file).getroot()
    while includes := [(parent, child) for parent in root.iter() for child in parent.iterfind("include")]:
        for parent, include in includes:
            included = ElementTree.parse(file.parent / include.attrib["filename"]).getroot()
            index = list(parent).index(include)
            parent[index : index + 1] = list(included)
    for film in root.iter("film"):
        for entry in film.iterfind("integer"):
            if entry.get("name") in {"width", "height"}:
                entry.set("value", str(size))
        for entry in film.iterfind("rfilter") if box else ():
            entry.set("type", "box")
    return ElementTree.tostring(root, encoding="unicode")


def load_square(file: Path, size: int, *, box: bool = False, **values: str) -> Any:
    """Return the scene of `square_text`: a camera that is loaded keeps the field of view that it found for its film.

    `values` are those of the file's parameters.
    """
    import mitsuba as mi

    mi.file_resolver().prepend(str(file.parent))
    return mi.load_string(square_text(file, size, box=box), **values)


class MitsubaWorker:
    """A dictionary with its meshes in PLY files."""

    def __init__(self, folder: Path, variant: str) -> None:
        import mitsuba as mi
        from worker import shared_file

        mi.set_variant(variant)
        imported = time.perf_counter()
        self.mi = mi
        shared = shared_file(folder)
        if shared:
            self.scene = load_square(shared.file, shared.size, box=shared.box, **shared.values)
        else:
            tree = self.restored(json.loads((folder / "scene.json").read_text(encoding="utf-8")))
            self.scene = mi.load_dict(tree)
        loaded = time.perf_counter()
        self.seconds = {"import": imported - STARTED, "load": loaded - imported}
        self.image: Any = None

    def restored(self, value: Any) -> Any:
        """Return what `write_scene` wrote as it was."""
        import numpy as np

        if isinstance(value, dict):
            if set(value) == {"matrix"}:
                return self.mi.ScalarTransform4f(np.array(value["matrix"]))
            if set(value) == {"image"}:
                return self.mi.Bitmap(np.load(value["image"]))
            return {key: self.restored(item) for key, item in value.items()}
        return value

    def about(self) -> dict[str, Any]:
        """Return version, variant and seconds."""
        return {"version": self.mi.__version__, "variant": self.mi.variant(), "seconds": self.seconds}

    def render(self, spp: int, seed: int) -> float:
        """Render a new picture and return the seconds."""
        import numpy as np

        started = time.perf_counter()
        # As an array: that waits for it. Seeds far apart, as each picture takes many in a row (scalar variants).
        self.image = np.array(self.mi.render(self.scene, spp=spp, seed=1_000_003 * (seed + 1)))
        return time.perf_counter() - started

    def gradients(self, d_image: Any, names: list[str], spp: int, seed: int) -> dict[str, Any]:
        """Return the derivatives of a loss by parameters."""
        import drjit as dr
        import numpy as np

        parameters = self.mi.traverse(self.scene)
        # Copies: an environment replaces what it is given by an image with other borders, which is no leaf.
        leaves = {name: type(parameters[name])(parameters[name]) for name in names}
        for name, leaf in leaves.items():
            dr.enable_grad(leaf)
            parameters[name] = leaf
        parameters.update()
        seeds = {"seed": 1_000_003 * (seed + 1), "spp": spp}
        self.scene.integrator().render_backward(self.scene, parameters, self.mi.TensorXf(d_image), sensor=0, **seeds)
        found = {name: np.array(dr.grad(leaf)) for name, leaf in leaves.items()}
        for name, leaf in leaves.items():
            parameters[name] = dr.detach(leaf)
        parameters.update()
        return found

    def picture(self) -> Any:
        """Return (H, W, 3) float32."""
        return self.image

    def save(self, path: str) -> None:
        """Write the last picture as PNG."""
        self.mi.util.write_bitmap(path, self.mi.TensorXf(self.image) if hasattr(self.mi, "TensorXf") else self.image)


if __name__ == "__main__":
    from worker import serve

    serve(MitsubaWorker)
