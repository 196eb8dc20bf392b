"""The pictures that `gallery.py` renders: a module for each page of the documentation that shows them."""

from __future__ import annotations

from . import (
    cameras,
    caustics,
    city,
    integrators,
    inverse,
    lights,
    materials,
    media,
    motion,
    own,
    particles,
    presets,
    tone,
    tutorial,
)
from .picture import Drawing

MODULES = (
    materials,
    presets,
    cameras,
    lights,
    caustics,
    city,
    integrators,
    motion,
    own,
    particles,
    media,
    tone,
    tutorial,
    inverse,
)

GROUPS: dict[str, dict[str, Drawing]] = {module.__name__.rpartition(".")[2]: module.PICTURES for module in MODULES}
"""By group, what makes each picture, by the name of its file."""
