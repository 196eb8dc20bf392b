"""A function that follows a path and the kernel that calls it, for many lanes of which each is where it is.

A path is a loop, and paths end after different numbers of rounds. The function becomes an object with what outlives a
round as its members, so that a round can be run for one group of sixteen paths after the other; the lanes of paths
that go on are moved together in between, and before surfaces are shaded, so that groups are nearly full (Wald 2011,
"Active thread compaction for GPU path tracing"). A round is cut into parts where it traces rays, so that those of all
groups are traced together: on the way to the next surface, and to a light where nothing can take a part of what comes
from it. The kernel becomes an object, too: with what a pixel keeps, and what it does before and after each of its
paths. `kernels/wide/pool.py` runs them for a square of pixels, whose first rays lie side by side.
"""

import re
from typing import Any, NamedTuple

from warp._src.codegen import constant_str

from wrt.kernels.wide.pool import DRIVER
from wrt.kernels.wide.questions import ASKED, Question, question_code
from wrt.kernels.wide.statements import NO_MORE, RANGE, SET, Body
from wrt.kernels.wide.types import Types, Unsupported

_PATH_LOOP = "while_0"
_SAMPLE_LOOP = "for_0"
_SHADED = re.compile(r" = \w*surface_at\w*\(")
"""The first of a round's statements for paths that have met a surface; others have ended before."""


class _Part(NamedTuple):
    """A part of a round.

    Attributes:
        question: which is asked before it, if one is.
        shades: whether it begins to shade what paths have met; those that met nothing have ended before.
        lines: its statements, by their numbers.
    """

    question: Question | None
    shades: bool
    lines: list[int]


class PathSteps:
    """A function with one loop, as an object whose rounds are run one at a time.

    Attributes:
        name: of the C++ struct.
        code: the struct, `move` for it, and what it asks.
        round: C++ of a round, for a pool.
    """

    def __init__(self, types: Types, function: Any, fixed: list[Any], functions: dict[str, str]) -> None:
        """Take a function that Warp has built, and those of its arguments that are the same for all paths.

        Raises:
            Unsupported: where it is not such a function.
        """
        body = Body(types, function)
        self.name = f"steps_{function.native_func}"
        first, last = _loop(body, _PATH_LOOP)
        returned = re.fullmatch(r"return (var_\w+);", body.lines[-1])
        if not returned:
            raise Unsupported(f"{function.key}: returns something else than a variable at its end")
        own = [a for a in body.adj.args if a not in fixed]

        parts = _parts(body, first, last)
        questions = [part.question for part in parts if part.question]
        if not questions or questions[0].distance or not all(q.distance for q in questions[1:]):
            raise Unsupported(f"{function.key}: traces other rays than one to what is next, then some to lights")

        # What is set in the loop and used in the same round alone need not be kept.
        rounds, kept, constants = [], [], []
        for v in body.adj.variables:
            loops = body.where_set.get(v.emit(), [])
            if v.constant is not None:
                constants.append(v)
            elif loops[:1] == [_PATH_LOOP] and v.emit() not in body.outliving:
                rounds.append(v)
            else:
                kept.append(v)
        # Nor what the beginning alone uses, nor what is the same for all paths at all times.
        later_on = body.used(range(first, len(body.lines)))
        begins = [v for v in kept if v.emit() not in later_on]
        same = [v for v in kept if v not in begins and body.same_for_all(v.emit(), first)]
        kept = [v for v in kept if v not in begins and v not in same]
        used = [body.used(part.lines) for part in parts]
        asking = {name for q in questions for name in (q.answer, q.ray, q.distance)}
        across = [v for v in rounds if v.emit() in asking or sum(v.emit() in names for names in used) > 1]
        rounds = [v for v in rounds if v not in across]
        members = {v.emit() for v in (*own, *kept, *across)}
        if not {q.scene for q in questions} <= {a.emit() for a in fixed} or not asking - {None} <= members:
            raise Unsupported(f"{function.key}: traces something else than its rays")
        local = "".join(body.declaration(v) for v in rounds)
        shading = next(number for number, part in enumerate(parts) if part.shades)
        met, shaded = set().union(*used[:shading]), set().union(*used[shading:])
        moved = [v.emit() for v in (*own, *kept) if v.emit() in later_on and body.declaration(v)]
        moved += [v.emit() for v in across if v.emit() in met & shaded]
        moved = [name for name in moved if not types.is_shared(body.variables[name].type)]

        body.keep_all = True
        begin = "".join(map(body.declaration, begins)) + "".join(map(body.declaration, same)) + body.code(range(first))
        body.keep_all = False
        names = {v.emit() for v in same}
        again = body.code([i for i in range(first) if body.set_by(i) in names])
        again = "".join(map(body.declaration, same)) + again
        body.loops.append(_PATH_LOOP)
        body.cut = _PATH_LOOP
        codes = [body.code(part.lines) for part in parts]
        body.loops.pop()
        end = body.code(range(last + 1, len(body.lines) - 1))
        result = returned[1]
        fixed_in = [f"const {types.wide(a.type)}& {a.emit()}_in" for a in fixed]
        own_in = [f"const {types.wide(a.type)}& {a.emit()}_in" for a in own]
        masks = "lanes::Mask exec = exec_in, returned_ = false"

        def part_code(number: int) -> str:
            answers = ""
            q = parts[number].question
            if q and q.distance:
                answers = f"{q.answer} = lanes::Mask(answer_{questions.index(q)}.v >= 0);"
            return f"""    lanes::Mask part_{number}(const lanes::Mask live) {{
        lanes::Mask exec = {"waiting" if number else "live"}, returned_ = false;
        lanes::Mask broken_{_PATH_LOOP} = false, continued_{_PATH_LOOP} = false;
        if (!lanes::any(exec)) return live;
        {answers}
{local}
{again}
        do {{
{codes[number]}
        }} while (false);
        waiting = exec;
        return live & ~broken_{_PATH_LOOP};
    }}
"""

        def question(number: int) -> str:
            q = questions[number]
            ray = types.wide(body.variables[q.ray].type)
            answer = "lanes::Ints" if number else types.wide(body.variables[q.answer].type)
            member = f"answer_{number}" if number else q.answer
            return question_code(q, f"Question{number}", self.name, member, (ray, answer), functions)

        further = "".join(f"    lanes::Ints answer_{k};\n" for k in range(1, len(questions)))
        self.code = f"""
namespace {{
struct {self.name} {{
{"".join(f"    const {types.wide(a.type)}& {a.emit()};" for a in fixed)}
{"".join(f"    {types.wide(a.type)} {a.emit()};" for a in own)}
{_constants(constants)}{"".join(body.declaration(v) for v in (*kept, *across))}
    lanes::Mask waiting = false;  // for an answer
{further}    {self.name}({", ".join(fixed_in)}) : {", ".join(f"{a.emit()}({a.emit()}_in)" for a in fixed)} {{}}
    void begin({", ".join(own_in)}, const lanes::Mask exec_in) {{
        {masks};
        {" ".join(f"lanes::set({a.emit()}, {a.emit()}_in, exec);" for a in own)}
{begin}
    }}
    // The parts of a round: each returns the lanes that go on.
{"".join(part_code(number) for number in range(len(parts)))}
    {types.wide(body.variables[result].type)} end(const lanes::Mask exec_in) {{
        {masks};
{again}
{end}
        return {result};
    }}
}};
LANES_INLINE void move({self.name}& to, const {self.name}& from, lanes::Move m) {{
    using lanes::move; {" ".join(f"move(to.{name}, from.{name}, m);" for name in (*moved, "waiting"))} }}
{"".join(question(number) for number in range(len(questions)))}
}} // namespace
"""
        self.round = ""
        for number, part in enumerate(parts):
            if part.question:
                self.round += f"            trace<Question{questions.index(part.question)}>(groups);\n"
            if part.shades:
                self.round += "            close_up_where_sparse(groups);\n"
            self.round += f"            run<&Steps::part_{number}>(groups);\n"


class SampledPixels:
    """A kernel that calls a function of `PathSteps` in a loop over samples, as an object for sixteen pixels.

    Attributes:
        code: C++ structs `Path` and `Pixels`, and the driver.
    """

    def __init__(self, types: Types, kernel: Any, function: Any, functions: dict[str, str]) -> None:
        """Take a kernel that Warp has built, and the function that follows its paths.

        Raises:
            Unsupported: where it is not such a kernel.
        """
        body = Body(types, kernel)
        lines = body.lines
        first, last = _loop(body, _SAMPLE_LOOP)
        sets = [(i, m) for i, line in enumerate(lines) if (m := SET.fullmatch(line))]
        calls = [(i, m) for i, m in sets if m[2].startswith(f"{function.native_func}(")]
        counted = NO_MORE.fullmatch(lines[first + 1])
        if len(calls) != 1 or not first < calls[0][0] < last or not counted:
            raise Unsupported(f"{kernel.key}: not one path in a loop over samples")
        call, m = calls[0]
        result, samples = m[1], counted[1]
        ranges = {found[1]: found[2].split(", ") for line in lines if (found := RANGE.fullmatch(line))}
        target = ranges[samples][-1]
        passed = m[2].partition("(")[2][:-1].split(", ")
        given = {a.emit() for a in body.adj.args}
        if target not in given:
            raise Unsupported(f"{kernel.key}: samples up to a number that is no argument")
        fixed = [(a, name) for a, name in zip(function.adj.args, passed, strict=True) if name in given]
        own = [name for name in passed if name not in given]
        steps = PathSteps(types, function, [a for a, _ in fixed], functions)

        spans = {"before": (0, first), "start": (first + 2, call), "finish": (call + 1, last - 1)}
        spans["after"] = (last + 1, len(lines))
        used: dict[str, set[str]] = {}
        for phase, (begin, end) in spans.items():
            for name in body.used(range(begin, end)):
                used.setdefault(name, set()).add(phase)
        for name in (result, samples):
            used.setdefault(name, set()).update({"start", "finish"})
        variables = [v for v in body.adj.variables if v.constant is None]
        kept = [v for v in variables if len(used.get(v.emit(), ())) > 1]

        def local(phase: str) -> str:
            return "".join(body.declaration(v) for v in variables if used.get(v.emit()) == {phase})

        body.keep_all = True
        before = local("before") + body.code(range(first))
        body.loops.append(_SAMPLE_LOOP)
        start = local("start") + body.code(range(first + 2, call))
        # What follows the call within the same `if` waits until the path has ended.
        depth = len(body.blocks)
        close = _end_of_block(lines, call + 1, last - 1) if depth else call + 1
        if lines[close : close + depth] != ["}"] * depth:
            raise Unsupported(f"{kernel.key}: does more around where it calls {function.key}")
        start += "".join(f"    given_.{name} = {name};\n" for name in own) + "    begun_ = exec;\n"
        start += body.code(range(close, close + depth))
        body.keep_all = False
        rest = body.code(range(call + 1, close))
        finish = local("finish") + (f"    exec = begun_; if (lanes::any(exec)) {{\n{rest}    }}\n" if rest else "")
        finish += "    exec = sampled_;\n" + body.code(range(close + depth, last - 1))
        body.loops.pop()
        after = local("after") + body.code(range(last + 1, len(lines)))

        arguments = body.adj.args
        taken = ", ".join(f"const {a.ctype()}& {a.emit()}_in" for a in arguments)
        masks = f"lanes::Mask returned_ = false, broken_{_SAMPLE_LOOP} = false, continued_{_SAMPLE_LOOP} = false;"
        # Numbers that all lanes are given become one of each lane.
        members = "".join(
            f"    const {types.wide(a.type)}{'&' if types.is_shared(a.type) else ''} {a.emit()};\n" for a in arguments
        )
        members += "".join(body.declaration(v) for v in kept)
        given = "".join(f"    {types.wide(body.variables[name].type)} {name};\n" for name in own)
        carried = [v.emit() for v in kept if body.changes(v.emit(), *spans["finish"]) and "after" in used[v.emit()]]
        constants = _constants([v for v in body.adj.variables if v.constant is not None])
        pixels = f"pixels_{kernel.key}"
        self.code = (
            steps.code
            + f"""
typedef {types.wide(body.variables[result].type)} Result;
namespace {{
typedef {steps.name} Steps;
// What a path begins with.
struct Given {{
{given}}};
struct Path {{
    {steps.name} steps;
    lanes::Ints home;  // where it was begun
    Path({", ".join(f"const {types.wide(a.type)}& {name}" for a, name in fixed)})
        : steps({", ".join(name for _, name in fixed)}) {{}}
}};
LANES_INLINE void begin(Path& path, const Given& given, const lanes::Mask exec) {{
    path.steps.begin({", ".join(f"given.{name}" for name in own)}, exec);
}}
LANES_INLINE void move(Path& to, const Path& from, lanes::Move m) {{
    move(to.steps, from.steps, m);
    lanes::move(to.home, from.home, m);
}}
struct {pixels} {{
{members}{constants}
    Given given_;
    lanes::Mask owned_, sampled_, begun_;
    lanes::Ints thread_;
    {pixels}({taken}) : {", ".join(f"{a.emit()}({a.emit()}_in)" for a in arguments)} {{}}
    void begin(const lanes::Ints& threads, const lanes::Mask exec_in) {{
        lanes::Mask exec = exec_in;
        {masks}
        owned_ = exec;
        thread_ = threads;
{before}
    }}
    lanes::Ints left() const {{ return lanes::sub({samples}.end, {samples}.i); }}
    // Leave out samples that others take: of `among` this is number `n`.
    void share(int n, int among) {{
        {samples}.i = lanes::add({samples}.i, lanes::mul({samples}.step, lanes::Ints(n)));
        {samples}.step = lanes::mul({samples}.step, lanes::Ints(among));
    }}
    // Take over the sums of the sample before.
    void carry(const {pixels}& from) {{
{"".join(f"        {name} = from.{name};{chr(10)}" for name in carried)}    }}
    // Begin the next sample of each pixel that has more: set `given_`, and the lanes whose paths begin.
    void start() {{
        lanes::Mask exec = owned_ & lanes::more({samples});
        {masks}
        sampled_ = exec;
        begun_ = false;
        if (lanes::any(exec)) {{
{start}
        }}
    }}
    void finish(const Result& result_) {{
        lanes::Mask exec = sampled_;
        {masks}
        if (!lanes::any(exec)) return;
        lanes::set({result}, result_, begun_);
{finish}
    }}
    void after() {{
        lanes::Mask exec = owned_;
        {masks}
{after}
    }}
}};
typedef {pixels} Pixels;
}} // namespace
"""
            + DRIVER.replace("ROUND\n", steps.round)
            .replace("ARGUMENTS_IN", taken)
            .replace("ARGUMENTS", ", ".join(f"{a.emit()}_in" for a in arguments))
            .replace("TARGET", target)
            .replace("FIXED", ", ".join(f"pool.pixels(g).{name}" for _, name in fixed))
        )


def _parts(body: Body, first: int, last: int) -> list[_Part]:
    """Return the parts of the loop that begins and ends with two lines."""
    asked = [(i, m) for i in range(first + 1, last) if (m := ASKED.fullmatch(body.lines[i]))]
    outermost = body.outermost(first + 1, last)
    asked = [(i, m) for i, m in asked if outermost[i] == i]
    starts, ends = [first, *(i for i, _ in asked)], [*(i for i, _ in asked), last - 1]
    questions = [None, *(Question(*m.groups()) for _, m in asked)]
    lines = [list(range(start + 1, end)) for start, end in zip(starts, ends, strict=True)]
    parts = [_Part(q, False, numbers) for q, numbers in zip(questions, lines, strict=True)]
    if not asked:
        return parts
    # What the first question does not need, such as random numbers, waits until it is known whose paths go on.
    later = body.later(first + 1, ends[0], ends[1])
    begun = [i for i in lines[0] if i not in later]
    following = [i for k in lines[1] for i in (*(j for j in sorted(later) if later[j] == k), k)]
    met = next((n for n, i in enumerate(following) if _SHADED.search(body.lines[i])), 0)
    around = [outermost[i] for i in following]
    cut = max((n + 1 for n in range(met) if around[n] != following[n] and around[n] != around[n + 1]), default=0)
    ended, shaded = _Part(questions[1], False, following[:cut]), _Part(None, True, following[cut:])
    return [_Part(None, False, begun), ended, shaded, *parts[2:]]


def _end_of_block(lines: list[str], first: int, end: int) -> int:
    """Return the number of the line that closes the block in which line `first` is."""
    depth = 1
    for i in range(first, end):
        depth += lines[i].endswith("{") - (lines[i] == "}")
        if depth == 0:
            return i
    raise Unsupported("an `if` without an end")


def _loop(body: Body, loop: str) -> tuple[int, int]:
    """Return the numbers of the first and last line of a function's outermost loop."""
    try:
        first, last = body.lines.index(f"start_{loop}:;"), body.lines.index(f"end_{loop}:;")
    except ValueError:
        raise Unsupported(f"{body.adj.fun_name}: no loop {loop}") from None
    if body.lines[last - 1] != f"goto start_{loop};":
        raise Unsupported(f"{body.adj.fun_name}: the loop {loop} ends otherwise than others")
    return first, last


def _constants(variables: list[Any]) -> str:
    return "".join(f"    static constexpr {v.ctype()} {v.emit()} = {constant_str(v.constant)};\n" for v in variables)
