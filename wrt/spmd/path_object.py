"""A path function as a C++ object whose rounds run one part at a time, for groups of paths.

Paths end after different numbers of rounds. So the function becomes an object whose members are the variables that
outlive a part of a round, and a pool (`kernels/native/lanes/pool.h`) runs the parts for one group after the other.
"""

from dataclasses import dataclass

from warp._src.codegen import constant_str

from wrt.spmd.emit import Emitter
from wrt.spmd.ir import Function, Variable
from wrt.spmd.passes.demands import Module, check_path_function
from wrt.spmd.passes.rounds import Rounds, cut
from wrt.spmd.passes.storage import Storage, store
from wrt.spmd.passes.uses import set_by
from wrt.spmd.ray_queries import ray_query_code
from wrt.spmd.templates import fill
from wrt.spmd.types import Types


@dataclass(frozen=True)
class PathObject:
    """A path function for several lanes.

    Attributes:
        name: The name of the C++ struct.
        code: The struct, its `move`, and its ray queries.
        round: C++ of a round, for a pool.
    """

    name: str
    code: str
    round: str


def path_object(types: Types, function: Function, module: Module, shared: list[Variable]) -> PathObject:
    """Return a path function as an object; `shared` are its arguments that are the same for all paths.

    Raises:
        Unsupported: It does not meet the requirements in `kernels/core/spmd_marks.py`.
    """
    check_path_function(function, shared, module)
    emitter = Emitter(types, function)
    own = [a for a in function.arguments if a not in shared]
    rounds = cut(function, module, emitter.liveness)
    storage = store(function, rounds, emitter.liveness, own)
    name = f"steps_{function.name}"
    emitter.keep_all = True
    begin = emitter.declarations([*storage.begins, *storage.same]) + emitter.code(rounds.before)
    emitter.keep_all = False
    same = emitter.declarations(storage.same) + emitter.code(s for s in rounds.before if set_by(s) in storage.same)
    parts = _parts(emitter, rounds, storage, same)
    queries = [part.query for part in rounds.parts if part.query]
    moved = [v.name for v in storage.moved if emitter.declaration(v) and not types.is_shared(v.type)]
    code = fill(
        "path.h",
        STEPS=name,
        SHARED="".join(f"    const {types.wide(a.type)}& {a.name};" for a in shared),
        OWN="".join(f"    {types.wide(a.type)} {a.name};" for a in own),
        CONSTANTS=constants(storage.constants),
        KEPT=emitter.declarations([*storage.kept, *storage.across]),
        ANSWERS="".join(f"    lanes::Ints answer_{k};\n" for k in range(1, len(queries))),
        SHARED_IN=arguments_in(types, shared),
        SHARED_GIVEN=", ".join(f"{a.name}({a.name}_in)" for a in shared),
        OWN_IN=arguments_in(types, own),
        OWN_GIVEN=" ".join(f"lanes::set({a.name}, {a.name}_in, exec);" for a in own),
        BEGIN=begin,
        PARTS="".join(parts),
        RESULT_TYPE=types.wide(rounds.result.type),
        SAME=same,
        END=emitter.code(rounds.after),
        RESULT=rounds.result.name,
        MOVES=" ".join(f"move(to.{v}, from.{v}, m);" for v in (*moved, "waiting")),
        QUERIES="".join(_queries(types, function, module, name, rounds)),
    )
    return PathObject(name, code, _round(rounds))


def constants(variables: list[Variable]) -> str:
    """Return the declarations of constants as members."""
    return "".join(f"    static constexpr {v.ctype} {v.name} = {constant_str(v.constant)};\n" for v in variables)


def arguments_in(types: Types, variables: list[Variable]) -> str:
    """Return the parameters of a function that sets variables."""
    return ", ".join(f"const {types.wide(a.type)}& {a.name}_in" for a in variables)


def _parts(emitter: Emitter, rounds: Rounds, storage: Storage, same: str) -> list[str]:
    out = []
    queries = 0
    for number, part in enumerate(rounds.parts):
        answer = ""
        if part.query and part.query.distance:
            answer = f"{part.query.answer} = lanes::Mask(answer_{queries}.v >= 0);"
        queries += part.query is not None
        out.append(
            fill(
                "part.h",
                NUMBER=str(number),
                ENTERING="waiting" if number else "live",
                LOOP=rounds.loop.label,
                ANSWER=answer,
                LOCAL=emitter.declarations(storage.local),
                SAME=same,
                CODE=emitter.in_loop(rounds.loop.label, part.statements, cut=True),
            )
        )
    return out


def _queries(types: Types, function: Function, module: Module, steps: str, rounds: Rounds) -> list[str]:
    """Return the C++ types of the ray queries."""
    variables = {v.name: v for v in (*function.arguments, *function.variables)}
    names = {f.key: f.name for f in module.functions.values()}
    queries = [part.query for part in rounds.parts if part.query]
    out = []
    for number, q in enumerate(queries):
        answer = "lanes::Ints" if number else types.wide(variables[q.answer].type)
        member = f"answer_{number}" if number else q.answer
        of = (types.wide(variables[q.ray].type), answer)
        out.append(ray_query_code(q, f"RayQuery{number}", steps, member, of, names))
    return out


def _round(rounds: Rounds) -> str:
    """Return the statements of a pool's round."""
    lines = []
    queries = 0
    for number, part in enumerate(rounds.parts):
        if part.query:
            lines.append(f"trace<RayQuery{queries}>(groups);")
            queries += 1
        if part.shades:
            lines.append("close_up_where_sparse(groups);")
        lines.append(f"run<&Steps::part_{number}>(groups);")
    return "".join(f"            {line}\n" for line in lines)
