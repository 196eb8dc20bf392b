"""Tables of lights do not depend on the code that a library of linear algebra chooses for the processor."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
from conftest import ROOT

from wrt.sums import weighted_sum

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


def digests(core: str) -> list[str]:
    """Return digests of tables and of a sky, made by a process whose OpenBLAS has the code of this processor."""
    environment = {**os.environ, "OPENBLAS_CORETYPE": core, "PYTHONPATH": str(ROOT)}
    run = subprocess.run([sys.executable, "-c", TABLES], env=environment, capture_output=True, text=True, check=True)
    return run.stdout.split()


def test_tables_are_the_same_by_the_code_of_another_processor() -> None:
    first = digests("Haswell")
    assert len(first) == 4
    assert digests("SkylakeX") == first


def test_a_weighted_sum_is_the_product() -> None:
    colors = np.random.default_rng(2).random((7, 5, 3), dtype=np.float32)
    found = weighted_sum(colors, (0.2, 0.7, 0.1))
    assert found.dtype == np.float32
    assert np.allclose(found, colors @ np.array([0.2, 0.7, 0.1]), rtol=1e-6)
