"""A path function as a C++ object whose rounds run one part at a time, for groups of paths.

Paths end after different numbers of rounds. So the function becomes an object whose members are the variables that
outlive a part of a round, and a pool (`kernels/native/lanes/pool.h`) runs the parts for one group after the other.
"""

from dataclasses import dataclass

from warp._src.codegen import constant_str

from wrt.kernels.core.ray_tree import INFINITE_DISTANCE
from wrt.spmd.analysis import Liveness, same_for_all, set_by, uses
from wrt.spmd.emit import Emitter
from wrt.spmd.ir import Function, Module, Unsupported, Variable
from wrt.spmd.library import trees_of
from wrt.spmd.rounds import RayQuery, Rounds, check_path_function, cut, uncut
from wrt.spmd.types import Types


@dataclass(frozen=True)
class Storage:
    """The variables of a path function, each in one of these lists.

    Attributes:
        constants: Constants.
        begins: Needed only before the loop.
        same: Set from constants before the loop, and never changed: recomputed instead of stored.
        rounds: Needed in later rounds or after the loop: members of a path.
        across: Needed in several parts of a round: members, which move with the path only if they are in `moved`.
        local: Needed in one part of a round only.
        moved: The arguments and the variables of `rounds` and `across` that a path takes along to another lane.
    """

    constants: list[Variable]
    begins: list[Variable]
    same: list[Variable]
    rounds: list[Variable]
    across: list[Variable]
    local: list[Variable]
    moved: list[Variable]


def store(function: Function, rounds: Rounds, liveness: Liveness, varying: list[Variable]) -> Storage:
    """Return where the variables of a path function are stored; `varying` are its arguments that differ between paths.

    Raises:
        Unsupported: A ray query uses something that no path stores.
    """
    constants, outer, in_round = [], [], []
    for v in function.variables:
        if v.constant is not None:
            constants.append(v)
        elif liveness.loops.get(v, ())[:1] == (rounds.loop.label,) and v not in liveness.outliving:
            in_round.append(v)
        else:
            outer.append(v)
    lasting = uses([rounds.loop, *rounds.epilogue]) | {rounds.result}
    begins = [v for v in outer if v not in lasting]
    same = [v for v in outer if v in lasting and same_for_all(function, v, rounds.prologue)]
    in_rounds = [v for v in outer if v in lasting and v not in same]
    used = [uses(part.statements) for part in rounds.parts]
    queried = {v for part in rounds.parts if (q := part.query) for v in (q.answer, q.ray, q.distance) if v}
    across = [v for v in in_round if v in queried or sum(v in variables for variables in used) > 1]
    if missing := queried.difference(varying, in_rounds, across):
        first = min(v.name for v in missing)
        raise Unsupported(f"{function.key}: asks a ray query for {first}, which is not a variable of the path")
    shading = next((number for number, part in enumerate(rounds.parts) if part.shades), 0)
    moving = set().union(*used[:shading]) & set().union(*used[shading:])
    moved = [v for v in (*varying, *in_rounds) if v in lasting] + [v for v in across if v in moving]
    local = [v for v in in_round if v not in across]
    return Storage(constants, begins, same, in_rounds, across, local, moved)


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
    emitter = Emitter(types, function)
    varying = [a for a in function.arguments if a not in shared]
    if "path_function" in function.marks:
        check_path_function(function, shared, module)
        rounds = cut(function, module, emitter.liveness)
    elif (found := uncut(function)) is not None:
        rounds = found
    else:
        return _whole_object(types, function, shared, varying)
    storage = store(function, rounds, emitter.liveness, varying)
    name = f"steps_{function.name}"
    emitter.keep_all = True
    begin = emitter.declarations([*storage.begins, *storage.same]) + emitter.code(rounds.prologue)
    emitter.keep_all = False
    same = emitter.declarations(storage.same) + emitter.code(s for s in rounds.prologue if set_by(s) in storage.same)
    names = {f.key: f.name for f in module.functions.values()}
    parts: list[str] = []
    queries: list[str] = []
    steps: list[str] = []
    for number, part in enumerate(rounds.parts):
        answered = ""
        if (q := part.query) is not None:
            # The first query finds the next surface; the others are for shadow rays, whose answers are integers.
            k = len(queries)
            answer = f"answer_{k}" if k else q.answer.name
            queries.append(_ray_query(types, q, f"RayQuery{k}", name, answer, names))
            steps.append(f"trace<RayQuery{k}>(groups);")
            if q.distance:
                answered = f"{q.answer.name} = lanes::Mask({answer}.v >= 0);"
        if part.shades:
            steps.append("close_up_where_sparse(groups);")
        steps.append(f"run<&Steps::part_{number}>(groups);")
        code = emitter.in_loop(rounds.loop.label, part.statements, cut=True)
        parts.append(
            f"""\
    lanes::Mask part_{number}(const lanes::Mask live) {{
        lanes::Mask exec = {"waiting & live" if number else "live"}, returned_ = false;
        lanes::Mask broken_{rounds.loop.label} = false, continued_{rounds.loop.label} = false;
        if (!lanes::any(exec)) return live;
        {answered}
{emitter.declarations(storage.local)}
{same}
        do {{
{code}
        }} while (false);
        waiting = exec;
        return live & ~broken_{rounds.loop.label};
    }}
"""
        )
    moved = [v for v in storage.moved if emitter.declaration(v) and not types.is_shared(v.type)]
    answers = "".join(f"    lanes::Ints answer_{k};\n" for k in range(1, len(queries)))
    members_set = ", ".join(f"{a.name}({a.name}_in)" for a in shared)
    code = f"""\
namespace {{
// A path: the variables that outlive a part of a round.
struct {name} {{
{_members(types, shared, varying)}
{constants(storage.constants)}
{emitter.declarations([*storage.rounds, *storage.across])}
    lanes::Mask waiting = false;  // for an answer
{answers}
    {name}({_parameters(types, shared)}) : {members_set} {{}}
    void begin({_parameters(types, varying)}, const lanes::Mask exec_in) {{
        lanes::Mask exec = exec_in, returned_ = false;
        {_sets(varying)}
{begin}
    }}
    // The parts of a round: each returns the lanes that go on.
{"".join(parts)}
    {types.wide(rounds.result.type)} end(const lanes::Mask exec_in) {{
        lanes::Mask exec = exec_in, returned_ = false;
{same}
{emitter.code(rounds.epilogue)}
        return {rounds.result.name};
    }}
}};
{_move(name, moved, "waiting")}
{"".join(queries)}
}} // namespace
"""
    return PathObject(name, code, "".join(f"            {line}\n" for line in steps))


def _whole_object(types: Types, function: Function, shared: list[Variable], varying: list[Variable]) -> PathObject:
    """Return a function that cannot be cut as an object without rounds, which calls it at the end."""
    name, result = f"steps_{function.name}", types.wide(function.result)
    members_set = ", ".join(f"{a.name}({a.name}_in)" for a in shared)
    code = f"""\
namespace {{
struct {name} {{
{_members(types, shared, varying)}
    lanes::Mask waiting = false;  // for an answer, which none does
    {name}({_parameters(types, shared)}) : {members_set} {{}}
    void begin({_parameters(types, varying)}, const lanes::Mask exec) {{
        {_sets(varying)}
    }}
    lanes::Mask no_round(lanes::Mask) {{ return false; }}
    {result} end(const lanes::Mask exec) {{
        return wide_{function.name}({", ".join(a.name for a in function.arguments)}, exec);
    }}
}};
{_move(name, varying)}
}} // namespace
"""
    return PathObject(name, code, "            run<&Steps::no_round>(groups);\n")


def _members(types: Types, shared: list[Variable], varying: list[Variable]) -> str:
    """Return the declarations of the arguments as members."""
    all_share = "".join(f"    const {types.wide(a.type)}& {a.name};" for a in shared)
    return all_share + "\n" + "".join(f"    {types.wide(a.type)} {a.name};" for a in varying)


def _sets(varying: list[Variable]) -> str:
    return " ".join(f"lanes::set({a.name}, {a.name}_in, exec);" for a in varying)


def _move(name: str, variables: list[Variable], *others: str) -> str:
    """Return the function that moves paths with these members to other lanes."""
    moves = " ".join(f"move(to.{member}, from.{member}, m);" for member in (*(v.name for v in variables), *others))
    return f"""\
LANES_INLINE void move({name}& to, const {name}& from, lanes::Move m) {{
    using lanes::move; {moves} }}"""


def _ray_query(types: Types, query: RayQuery, name: str, steps: str, answer: str, functions: dict[str, str]) -> str:
    """Return the C++ type of a ray query, with which `kernels/native/lanes/ray_queries.h` traces a pool's rays.

    Args:
        types: The types.
        query: The statement.
        name: The name of the type.
        steps: The type of the paths.
        answer: Their member for the answer.
        functions: Names in Warp's C++ by those in Python.
    """
    nearest = query.distance is None
    answer_type = types.wide(query.answer.type) if nearest else "lanes::Ints"
    trees = trees_of(next(key for key, own in functions.items() if own == query.function), functions)
    call = f"wide_{query.function}(steps.{query.scene.name}, ray"
    if trees is None:
        kind = f"AskedEach<{name}, {answer_type}>"
        blocked = f"lanes::choose({call}, reach, exec), (lanes::ints)0, (lanes::ints)-1)"
        ask = f"{call}, exec)" if nearest else f"lanes::Ints({blocked})"
        declaration = "Answer ask(const Steps& steps, const Ray& ray, lanes::Floats reach, lanes::Mask exec)"
        member = f"static {declaration} {{ return {ask}; }}"
    elif surface := next((own for key, own in functions.items() if key.startswith("find_surface_of_surfaces")), None):
        kind = f"SurfacesTogether<{name}, lanes::{trees}, {str(not nearest).lower()}>"
        entered = f"wide_{functions['_entered' if trees == 'InOneTree' else '_instance_entered']}(found, exec)"
        any_hit = f"lanes::Mask({str(not nearest).lower()})"
        found = f"wide_{surface}(steps.{query.scene.name}, ray, {entered}, lanes::Floats(0.0f), {any_hit}, exec)"
        parameters = "const Steps& steps, const Ray& ray, Found found, lanes::Mask exec"
        answer_of = "" if nearest else ".triangle"
        member = f"template<class Found> static Answer surface({parameters}) {{ return {found}{answer_of}; }}"
    elif nearest:
        kind = f"NearestTogether<{name}, lanes::{trees}>"
        hit = f"wide_{functions['_hit' if trees == 'InOneTree' else '_instance_hit']}(found, exec)"
        member = f"template<class Found> static Answer as_hit(Found found, lanes::Mask exec) {{ return {hit}; }}"
    else:
        kind, member = f"AnyTogether<{name}, lanes::{trees}>", ""
    reach = f"steps.{query.distance.name}" if query.distance else f"lanes::Floats({INFINITE_DISTANCE!r}f)"
    return f"""\
// The ray query {query.function}.
struct {name} : lanes::{kind} {{
    typedef {steps} Steps;
    typedef {types.wide(query.ray.type)} Ray;
    typedef {answer_type} Answer;
    static const auto& scene(const Steps& steps) {{ return steps.{query.scene.name}; }}
    static const Ray& ray(const Steps& steps) {{ return steps.{query.ray.name}; }}
    static lanes::Floats reach(const Steps& steps) {{ return {reach}; }}
    static Answer& answer(Steps& steps) {{ return steps.{answer}; }}
    {member}
}};
"""


def constants(variables: list[Variable]) -> str:
    """Return the declarations of constants as members."""
    return "".join(f"    static constexpr {v.ctype} {v.name} = {constant_str(v.constant)};\n" for v in variables)


def _parameters(types: Types, variables: list[Variable]) -> str:
    """Return the parameters of a function that sets variables."""
    return ", ".join(f"const {types.wide(a.type)}& {a.name}_in" for a in variables)
