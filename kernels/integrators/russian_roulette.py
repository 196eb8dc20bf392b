"""Russian roulette: dim paths end by chance, and the survivors make up for them (Arvo and Kirk 1990)."""

import warp as wp

from wrt.kernels.integrators.path_state import PathState
from wrt.kernels.spmd_marks import inline_stage

# Shorter paths are never ended by roulette; the survival of longer ones follows the throughput. One that has lost
# nothing survives: light comes through many panes of clear glass.
ROULETTE_DEPTH = wp.constant(5)


@wp.func
@inline_stage
def russian_roulette(path: PathState, u: float) -> PathState:
    """End a path by chance according to its throughput, without the squeeze of solid angles inside glass."""
    survival = wp.max(path.throughput) * path.eta_scale
    if path.depth >= ROULETTE_DEPTH:
        survival = wp.min(survival, 1.0)
        path.is_done = path.is_done or not (u < survival)
        path.throughput = path.throughput / survival
    path.is_done = path.is_done or not (survival > 0.0)
    return path
