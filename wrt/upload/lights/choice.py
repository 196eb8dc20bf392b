"""Upload the lights and what selects one: an alias table by power alone, or a tree over the lights."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt.backend import current_backend
from wrt.backend.device import Device
from wrt.upload.arrays import require_countable
from wrt.upload.lights.table import LightTable
from wrt.upload.lights.tree import build_light_tree

LIGHT_CHOICES = ("auto", "power", "tree")
""""power": by power alone, the same everywhere; "tree": by a light tree; "auto": the better one for the light count."""

FEW_LIGHTS = 4
"""Up to this many finite lights, "auto" selects by power: the tree costs more than it saves (docs/notes/lights.md)."""


def upload_lights(data: Any, lights: LightTable, device: Device, choice: str = "auto") -> bool:
    """Fill the lights of a SceneData struct and the tables for selecting one; return whether these include a tree.

    The probabilities of the lights' records are filled in; `choice` is one of LIGHT_CHOICES.
    """
    backend = current_backend()
    k = backend.kernels("wrt.kernels.core.scene_data")
    bounds, weights = lights.bounds, lights.weights
    near = int(((bounds.power > 0.0) & ~bounds.is_far).sum())
    with_tree = near > 0 and (choice == "tree" or (choice == "auto" and near > FEW_LIGHTS))
    if with_tree:
        tree = build_light_tree(bounds)
        require_countable(tree.nodes.size, "numbers of the tree over lights")
        weights = np.where(bounds.is_far, bounds.power, 0.0)
        data.light_tree.nodes = backend.array(tree.nodes.ravel(), float, device.name)
        data.light_tree.parents = backend.array(tree.parents, int, device.name)
        data.light_tree.places = backend.array(tree.places, int, device.name)
        data.light_tree.scale = tree.scale
        data.light_tree.far = float(weights.sum())
    if weights.sum() > 0.0:
        table = make_alias_table(weights)
        lights.records["probability"] = table.probabilities
        data.light_thresholds = backend.array(table.thresholds, float, device.name)
        data.light_aliases = backend.array(table.aliases, int, device.name)
    data.lights = backend.array(lights.records, k.LightRecord, device.name)
    data.light_groups = backend.array(lights.groups, int, device.name)
    data.environment.light = lights.environment
    if len(lights.shapes):
        data.light_shapes = backend.array(lights.shapes, k.LightShape, device.name)
        data.light_boxes = backend.array(lights.boxes, k.LightBox, device.name)
        data.solid_light_shapes = lights.solid_count
        data.sun_light_shapes = lights.solid_count + lights.sun_count
    return with_tree


class AliasTable(NamedTuple):
    """Draws an index by its weight in constant time: slot i gives i with probability thresholds[i], else aliases[i].

    Attributes:
        thresholds: (N,) float32.
        aliases: (N,) int32.
        probabilities: (N,) float64 of each index, summing to 1.
    """

    thresholds: NDArray[np.float32]
    aliases: NDArray[np.int32]
    probabilities: NDArray[np.float64]


def make_alias_table(weights: ArrayLike) -> AliasTable:
    """Return the table for non-negative weights with a positive sum.

    This is the sweep of Hübschle-Schneider and Sanders (2019), with prefix sums in place of its sequential state:
    heavy slots, in order, fill up light slots until they become light and are filled by the next heavy one.
    """
    w = np.asarray(weights, dtype=np.float64)
    probabilities = w / w.sum()
    scaled = probabilities * len(w)
    thresholds = np.minimum(scaled, 1.0)
    aliases = np.arange(len(w), dtype=np.int32)
    light = np.flatnonzero(scaled < 1.0)
    heavy = np.flatnonzero(scaled >= 1.0)
    if len(light) and len(heavy):
        missing = np.cumsum(1.0 - scaled[light])
        spare = np.cumsum(scaled[heavy] - 1.0)
        filled = np.concatenate([[0.0], missing])
        donor = np.minimum(np.searchsorted(spare, filled[:-1], side="right"), len(heavy) - 1)
        aliases[light] = heavy[donor]
        # A heavy slot is exhausted when the light ones have taken more than all heavy ones so far can spare.
        last = np.searchsorted(filled, spare, side="left")
        remaining = 1.0 + spare - filled[np.minimum(last, len(light))]
        exhausted = (last <= len(light)) & (np.arange(len(heavy)) < len(heavy) - 1)
        thresholds[heavy] = np.where(exhausted, np.clip(remaining, 0.0, 1.0), 1.0)
        aliases[heavy[:-1]] = heavy[1:]
    return AliasTable(thresholds.astype(np.float32), aliases, probabilities)
