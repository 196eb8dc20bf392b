"""Faults that `mutate.py` plants: a file, a text in it, the text in its place, and the tests that should notice."""

from . import cuda, light, media, pictures, quadrics, reflection, spheres
from .mutant import Mutant

MUTANTS: tuple[Mutant, ...] = (
    *reflection.FAULTS,
    *media.FAULTS,
    *light.FAULTS,
    *spheres.FAULTS,
    *quadrics.FAULTS,
    *pictures.FAULTS,
    *cuda.FAULTS,
)
"""All faults, by subject."""

__all__ = ["MUTANTS", "Mutant"]
