"""Pictures do not depend on the code that a library of linear algebra chooses for the processor."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from collections.abc import Iterator

import numpy as np
from conftest import ROOT

from wrt.backend.processor import processor_flags
from wrt.sums import weighted_sum

CORES = "Haswell", "SkylakeX" if "avx512f" in processor_flags() else "Sandybridge"
"""Processors whose code in OpenBLAS differs and runs here: with AVX2, and with AVX-512 or without fused operations."""

LEFT_TO_BLAS = {
    *(f"np.{name}" for name in ("dot", "inner", "vdot", "matmul", "tensordot", "vecdot", "convolve", "correlate")),
    *(f"np.polynomial.{kind}gauss" for kind in ("legendre.leg", "hermite.herm")),
    "np.polyfit",
    "np.roots",
}

TABLES = """
import hashlib
import numpy as np
import wrt
from wrt.upload.lights.environment import LUMINANCE
from wrt.upload.lights.environment_sampling import environment_tables
from wrt.sums import weighted_sum

pixels = np.random.default_rng(1).random((64, 128, 3), dtype=np.float32)
tables = environment_tables(weighted_sum(pixels, LUMINANCE), np.eye(3))
sky, _ = wrt.SunSkyEnvironment().image_and_sun()
for array in (tables.cells, tables.bins, np.float64(tables.flux), sky.pixels):
    print(hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest())
"""


PLACES = """
import hashlib
import numpy as np
import wrt
from wrt.linalg import gauss_legendre
from wrt.scene.exact.quadrics import cylinder, disk
from wrt.scene.motion import Motion, rotation_matrix
from wrt.upload.accel.instances import instance_records
from wrt.upload.accel.swept_boxes import swept_boxes

random = np.random.default_rng(3)
transforms = np.tile(np.eye(4), (200, 1, 1))
transforms[:, :3] = random.normal(size=(200, 3, 4)) * [1.0, 1e-2, 30.0, 5.0]
mesh = wrt.Mesh(random.random((300, 3)), np.arange(300).reshape(-1, 3), normals=random.normal(size=(300, 3)))
mesh = mesh.transformed(transforms[0])
turns = np.tile(np.eye(4), (9, 1, 1))
for k, turn in enumerate(turns):
    turn[:3, :3] = rotation_matrix((1.0, 2.0, 3.0), 40.0 * k) @ np.diag([1.0, 1.0 + k, 0.3])
motion = Motion(np.arange(9.0), turns, (0.1, 0.2, 0.3)).after(transforms[1])
box = np.array([[[-0.1, -0.2, -0.3], [0.4, 0.5, 0.6]]])
camera = wrt.PerspectiveCamera(origin=(0.1, 0.7, 3.3), target=(0.31, -0.2, 0.17), up=(0.1, 1.0, 0.2))
u, v = 0.7 * rotation_matrix((0.3, 0.1, 0.9), 33.0)[:2]
light = wrt.RectangleLight((0.1, 0.2, 0.3), tuple(u), tuple(v), (1.0, 1.0, 1.0))
turned = np.eye(4)
turned[:3, :3] = 1.7 * rotation_matrix((3.0, 1.0, 2.0), 77.0)
shapes = [shape.transformed(turned) for shape in (disk(), cylinder(), wrt.spheres([[0.1, 0.2, 0.3]], [0.7]))]
arrays = {
    "instances": instance_records(transforms).view(np.uint8),
    "vertices": mesh.vertices,
    "normals": mesh.normals,
    **motion.parts._asdict(),
    "motion": motion.at(np.linspace(0.0, 8.0, 333)),
    "swept": swept_boxes(motion, np.zeros(1), box, 1.0, (0.0, 8.0), 4),
    "camera": camera.frame(),
    **light.shape(),
    "corners": light.extent().corners,
    **{f"exact {k}": x for k, x in enumerate(x for shape in shapes for x in (shape.vertices, shape.normals))},
    **{f"quadrature {k}": x for k, x in enumerate(gauss_legendre(64))},
}
for name, array in arrays.items():
    print(name.replace(" ", "-"), hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest())
"""


def digests(script: str, core: str) -> list[str]:
    """Return what a script prints in a process whose OpenBLAS has the code of this processor."""
    environment = {**os.environ, "OPENBLAS_CORETYPE": core, "PYTHONPATH": str(ROOT)}
    run = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    return run.stdout.splitlines()


def test_tables_are_the_same_by_the_code_of_another_processor() -> None:
    first = digests(TABLES, CORES[0])
    assert len(first) == 4
    assert digests(TABLES, CORES[1]) == first


def test_places_are_the_same_by_the_code_of_another_processor() -> None:
    first = digests(PLACES, CORES[0])
    assert len(first) > 20
    assert digests(PLACES, CORES[1]) == first


def test_nothing_calls_the_library_of_linear_algebra() -> None:
    example = "a @ np.linalg.inv(a) + np.dot(a, a) * np.linalg.norm(a[0]) + np.linalg.norm(a, 2, axis=(0, 1))"
    assert len(list(library_calls(example))) == 5
    files = {path.relative_to(ROOT): path.read_text(encoding="utf-8") for path in (ROOT / "wrt").rglob("*.py")}
    assert {path: calls for path, text in files.items() if (calls := list(library_calls(text)))} == {}


def library_calls(source: str) -> Iterator[str]:
    """Yield the lines where code calls what NumPy leaves to BLAS or LAPACK; lengths along an axis are NumPy's own."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, ast.MatMult):
            yield f"line {node.lineno}: @"
        elif isinstance(node, ast.Call):
            name = ast.unparse(node.func)
            own = name == "np.linalg.norm" and len(node.args) == 1 and "axis" in {k.arg for k in node.keywords}
            if name in LEFT_TO_BLAS or (re.fullmatch(r"np\.linalg\.[a-z]+", name) and not own):
                yield f"line {node.lineno}: {name}"


def test_a_weighted_sum_is_the_product() -> None:
    colors = np.random.default_rng(2).random((7, 5, 3), dtype=np.float32)
    found = weighted_sum(colors, (0.2, 0.7, 0.1))
    assert found.dtype == np.float32
    assert np.allclose(found, colors @ np.array([0.2, 0.7, 0.1]), rtol=1e-6)
