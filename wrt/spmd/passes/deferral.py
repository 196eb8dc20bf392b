"""Deferral of statements until a ray query is answered.

Statements that the query does not need, such as random numbers, then run only for the paths that go on after it, next
to the first use of their results, which need not be stored while rays are traced.
"""

from wrt.spmd.ir import Set, Statement, Variable
from wrt.spmd.passes.uses import changes, through_pointer, uses


def deferred(
    before: list[Statement], query: Statement, after: list[Statement], outliving: set[Variable]
) -> tuple[list[Statement], list[Statement]]:
    """Return the statements before a query that cannot wait, and those after it with the deferred ones in place.

    Args:
        before: Statements of the round before the query.
        query: The query.
        after: Statements after it, up to the next query or the end of the round.
        outliving: Variables that are needed after the round.
    """
    round_ = [*before, query, *after]
    users: dict[Variable, list[int]] = {}
    for i, s in enumerate(round_):
        for v in uses([s]):
            users.setdefault(v, []).append(i)
    places: dict[int, int] = {}
    for i in reversed(range(len(before))):
        s = before[i]
        if not isinstance(s, Set) or s.variable in outliving or s.variable.is_pointer or through_pointer(s.value):
            continue
        place = min((places.get(k, k) for k in users[s.variable] if k > i), default=0)
        read = uses([s]) - {s.variable}
        if place > len(before) and not any(changes(round_[i + 1 : place], v) for v in read):
            places[i] = place
    kept = [s for i, s in enumerate(before) if i not in places]
    following = []
    for k, s in enumerate(after, len(before) + 1):
        following += [before[i] for i in sorted(places) if places[i] == k] + [s]
    return kept, following
