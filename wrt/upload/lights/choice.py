"""Choose the method of light selection: by power alone, or with a tree over the lights."""

from __future__ import annotations

from typing import Any

import numpy as np

from wrt.backend import current_backend
from wrt.backend.device import Device
from wrt.upload.lights.alias import make_alias_table
from wrt.upload.lights.table import LightTable
from wrt.upload.lights.tree import build_light_tree
from wrt.upload.limits import require_countable

LIGHT_CHOICES = ("auto", "power", "tree")
""""power": by power alone, the same everywhere; "tree": by a light tree; "auto": the better one for the light count."""

FEW_LIGHTS = 4
"""Up to this many finite lights, "auto" selects by power: the tree costs more than it saves (docs/notes/lights.md)."""


def upload_light_choice(data: Any, lights: LightTable, device: Device, choice: str = "auto") -> bool:
    """Upload the tables for light selection, and return whether they include a tree.

    Args:
        data: SceneData; the records themselves are not uploaded here.
        lights: the lights of the scene, at least one; the probabilities of their records are filled in.
        device: the device.
        choice: one of LIGHT_CHOICES.
    """
    backend = current_backend()

    bounds = lights.bounds
    near = int(((bounds.power > 0.0) & ~bounds.is_far).sum())
    with_tree = near > 0 and (choice == "tree" or (choice == "auto" and near > FEW_LIGHTS))
    weights = lights.weights
    if with_tree:
        tree = build_light_tree(bounds)
        require_countable(tree.nodes.size, "numbers of the tree over lights")
        irradiance = np.where(bounds.is_far, bounds.power, 0.0)
        data.light_tree.nodes = backend.array(tree.nodes.ravel(), float, device.name)
        data.light_tree.parents = backend.array(tree.parents, int, device.name)
        data.light_tree.places = backend.array(tree.places, int, device.name)
        data.light_tree.scale = tree.scale
        data.light_tree.far = float(irradiance.sum())
        weights = irradiance
    if weights.sum() > 0.0:
        table = make_alias_table(weights)
        lights.records["probability"] = table.probabilities
        data.light_thresholds = backend.array(table.thresholds, float, device.name)
        data.light_aliases = backend.array(table.aliases, int, device.name)
    return with_tree
