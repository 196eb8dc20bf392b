"""Russian roulette: dim paths end by chance, and the survivors make up for them (Arvo and Kirk 1990)."""

import warp as wp

from wrt.kernels.integrators.path_state import PathState
from wrt.kernels.spmd_marks import inline_stage

# Shorter paths are never ended by roulette; the survival of longer ones follows the throughput.
ROULETTE_DEPTH = wp.constant(5)
ROULETTE_LIMIT = wp.constant(0.95)


@wp.func
@inline_stage
def russian_roulette(path: PathState, u: float) -> PathState:
    """End a path by chance according to its throughput, without the squeeze of solid angles inside glass."""
    survival = wp.max(path.throughput) * path.eta_scale
    if path.depth >= ROULETTE_DEPTH:
        survival = wp.min(survival, ROULETTE_LIMIT)
        path.is_done = path.is_done or not (u < survival)
        path.throughput = path.throughput / survival
    path.is_done = path.is_done or not (survival > 0.0)
    return path
