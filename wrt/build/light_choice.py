"""How lights are chosen in a scene: by power alone, or by a tree over them."""

from __future__ import annotations

from typing import Any

import numpy as np

from wrt.build.alias import make_alias_table
from wrt.build.light_tree import build_light_tree
from wrt.build.lights import LightTable
from wrt.device import Device

LIGHT_CHOICES = ("auto", "power", "tree")
"""By power alone, the same everywhere; by a tree over the lights; or whichever is better for as many as there are."""

FEW_LIGHTS = 4
"""Up to as many lights that are somewhere are chosen by power where nothing else is asked for: the walk down the tree
costs more than it saves (docs/performance.md)."""


def upload_light_choice(data: Any, lights: LightTable, device: Device, choice: str = "auto") -> bool:
    """Give the scene's data and the records what choosing takes, and return whether that is a tree.

    Args:
        data: SceneData; the records themselves are not uploaded here.
        lights: of the scene, at least one; the probabilities of their records are filled in.
        device: where to.
        choice: one of LIGHT_CHOICES.
    """
    import warp as wp

    bounds = lights.bounds
    near = int(((bounds.power > 0.0) & ~bounds.is_far).sum())
    with_tree = near > 0 and (choice == "tree" or (choice == "auto" and near > FEW_LIGHTS))
    weights = lights.weights
    if with_tree:
        tree = build_light_tree(bounds)
        irradiance = np.where(bounds.is_far, bounds.power, 0.0)
        data.light_tree.nodes = wp.array(tree.nodes.ravel(), dtype=float, device=device.name)
        data.light_tree.parents = wp.array(tree.parents, dtype=int, device=device.name)
        data.light_tree.places = wp.array(tree.places, dtype=int, device=device.name)
        data.light_tree.scale = tree.scale
        data.light_tree.far = float(irradiance.sum())
        weights = irradiance
    if weights.sum() > 0.0:
        table = make_alias_table(weights)
        lights.records["probability"] = table.probabilities
        data.light_thresholds = wp.array(table.thresholds, dtype=float, device=device.name)
        data.light_aliases = wp.array(table.aliases, dtype=int, device=device.name)
    return with_tree
