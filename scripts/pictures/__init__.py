"""What `gallery.py` renders: a module for each page of the documentation that shows pictures."""

from __future__ import annotations

from . import (
    cameras,
    city,
    integrators,
    lights,
    materials,
    media,
    motion,
    particles,
    presets,
    spectral,
    studio,
    tone,
    tutorial,
)
from .picture import Drawing

GROUPS: dict[str, dict[str, Drawing]] = {
    "materials": materials.PICTURES,
    "presets": presets.PICTURES,
    "spectral": spectral.PICTURES,
    "cameras": cameras.PICTURES,
    "lights": lights.PICTURES,
    "city": city.PICTURES,
    "integrators": integrators.PICTURES,
    "motion": motion.PICTURES,
    "particles": particles.PICTURES,
    "media": media.PICTURES,
    "tone": tone.PICTURES,
    "studio": studio.PICTURES,
    "tutorial": tutorial.PICTURES,
}
"""By group, what makes each picture, by the name of its file."""
