"""Storage of a path function's variables: for the whole path, across parts of a round, or within one part."""

from dataclasses import dataclass

from wrt.spmd.ir import Function, Unsupported, Variable
from wrt.spmd.passes.rounds import Rounds
from wrt.spmd.passes.uniform import same_for_all
from wrt.spmd.passes.uses import Liveness, uses


@dataclass(frozen=True)
class Storage:
    """The variables of a path function, each in one of these lists.

    Attributes:
        constants: Constants.
        begins: Needed only before the loop.
        same: Set from constants before the loop, and never changed: recomputed instead of stored.
        kept: Needed in later rounds or after the loop: members of a path.
        across: Needed in several parts of a round: members, which move with the path only if they are in `moved`.
        local: Needed in one part of a round only.
        moved: The arguments and the variables of `kept` and `across` that a path takes along to another lane.
    """

    constants: list[Variable]
    begins: list[Variable]
    same: list[Variable]
    kept: list[Variable]
    across: list[Variable]
    local: list[Variable]
    moved: list[Variable]


def store(function: Function, rounds: Rounds, liveness: Liveness, own: list[Variable]) -> Storage:
    """Return the storage of variables.

    Args:
        function: The path function.
        rounds: The function, cut into parts.
        liveness: The liveness of its variables.
        own: Its arguments that differ between paths.

    Raises:
        Unsupported: A ray query uses something that no path stores.
    """
    constants, rest, in_round = [], [], []
    for v in function.variables:
        if v.constant is not None:
            constants.append(v)
        elif liveness.loops.get(v, ())[:1] == (rounds.loop.label,) and v not in liveness.outliving:
            in_round.append(v)
        else:
            rest.append(v)
    needed = uses([rounds.loop, *rounds.after]) | {rounds.result}
    begins = [v for v in rest if v not in needed]
    same = [v for v in rest if v in needed and same_for_all(function, v, rounds.before)]
    kept = [v for v in rest if v in needed and v not in same]
    used = [uses(part.statements) for part in rounds.parts]
    asked = {name for part in rounds.parts if (q := part.query) for name in (q.answer, q.ray, q.distance) if name}
    across = [v for v in in_round if v.name in asked or sum(v in names for names in used) > 1]
    if lost := asked - {v.name for v in (*own, *kept, *across)}:
        raise Unsupported(f"{function.key}: asks a ray query for {min(lost)}, which is not a variable of the path")
    shading = next(number for number, part in enumerate(rounds.parts) if part.shades)
    met, shaded = set().union(*used[:shading]), set().union(*used[shading:])
    moved = [v for v in (*own, *kept) if v in needed] + [v for v in across if v in met & shaded]
    local = [v for v in in_round if v not in across]
    return Storage(constants, begins, same, kept, across, local, moved)
