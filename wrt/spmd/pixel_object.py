"""A kernel that calls a path function for each sample, as a C++ object for as many pixels as there are lanes.

Its members are a pixel's variables, and its functions the phases of the kernel: before all samples, before and after
each path, and after all samples. The driver, `kernels/native/lanes/pool.h`, runs them for a tile, a thousand paths at a
time.
"""

from dataclasses import dataclass
from itertools import chain

from wrt.kernels.native import text_of
from wrt.spmd import ir
from wrt.spmd.analysis import changes, range_of, uses
from wrt.spmd.emit import Emitter
from wrt.spmd.path_object import constants, path_object
from wrt.spmd.rounds import the_loop
from wrt.spmd.types import Types


@dataclass(frozen=True)
class _Phases:
    """The statements of a kernel, by phase.

    Attributes:
        loop: The loop over samples.
        samples: The range of samples.
        target: The end of that range.
        calling: The statement that calls the path function.
        call: That call.
        prologue: Statements before the loop.
        around: The `if`s around the call, outermost first.
        starts: Statements before the call in the loop, and in each of the `if`s.
        completion: Statements after the call within the innermost `if`.
        finish: Later statements in the loop.
        epilogue: Statements after the loop.
    """

    loop: ir.Loop
    samples: ir.Variable
    target: ir.Variable
    calling: ir.Set
    call: ir.Call
    prologue: list[ir.Statement]
    around: list[ir.If]
    starts: list[list[ir.Statement]]
    completion: list[ir.Statement]
    finish: list[ir.Statement]
    epilogue: list[ir.Statement]

    def start(self, innermost: list[ir.Statement]) -> list[ir.Statement]:
        """Return the statements before the path, with others in place of the call."""
        body = self.starts[-1] + innermost
        for block, first in zip(reversed(self.around), reversed(self.starts[:-1]), strict=True):
            body = [*first, ir.If(block.condition, block.negated, body, number=block.number)]
        return body


def pixel_object(types: Types, kernel: ir.Function, path: ir.Function, module: ir.Module) -> str:
    """Return the C++ structs `Path` and `Pixels` of a kernel and its path function, and their driver.

    Raises:
        Unsupported: They do not meet the requirements in `kernels/core/spmd_marks.py`.
    """
    phases = _phases(kernel, path)
    call, samples = phases.call, phases.samples
    fixed = [(a, v) for a, v in zip(path.arguments, call.arguments, strict=True) if v in kernel.arguments]
    varying = [v for v in call.arguments if v not in kernel.arguments]
    steps = path_object(types, path, module, [a for a, _ in fixed])

    used: dict[ir.Variable, set[str]] = {}
    spans = {
        "before": phases.prologue,
        "start": phases.start([]),
        "finish": [*phases.completion, *phases.finish],
        "after": phases.epilogue,
    }
    for phase, statements in spans.items():
        for v in uses(statements):
            used.setdefault(v, set()).add(phase)
    for v in (phases.calling.variable, samples):
        used.setdefault(v, set()).update({"start", "finish"})
    variables = [v for v in kernel.variables if v.constant is None]
    members = [v for v in variables if len(used.get(v, ())) > 1]
    carried = [v.name for v in members if changes(spans["finish"], v) and "after" in used[v]]
    arguments_in = ", ".join(f"const {a.ctype}& {a.name}_in" for a in kernel.arguments)
    emitter = Emitter(types, kernel)
    loop = phases.loop.label
    begin_path: list[ir.Statement] = [ir.Verbatim(f"given_.{v.name} = {v.name};") for v in varying]
    begin_path.append(ir.Verbatim("begun_ = exec;"))

    def local(phase: str) -> str:
        return emitter.declarations(v for v in variables if used.get(v) == {phase})

    emitter.keep_all = True
    before = local("before") + emitter.code(phases.prologue)
    start = local("start") + emitter.in_loop(loop, phases.start(begin_path))
    emitter.keep_all = False
    # Statements after the call within the same `if` wait until the path has ended.
    completion = emitter.in_loop(loop, phases.completion)
    finish = local("finish") + (
        f"    exec = begun_; if (lanes::any(exec)) {{\n{completion}    }}\n" if completion else ""
    )
    finish += "    exec = sampled_;\n" + emitter.in_loop(loop, phases.finish)
    # Scalar arguments become one number per lane.
    declared = "".join(
        f"    const {types.wide(a.type)}{'&' if types.is_shared(a.type) else ''} {a.name};\n" for a in kernel.arguments
    )
    declared += emitter.declarations(members) + constants([v for v in kernel.variables if v.constant is not None])
    name, result = f"pixels_{kernel.key}", phases.calling.variable
    masks = f"lanes::Mask returned_ = false, broken_{loop} = false, continued_{loop} = false;"
    given_members = "".join(f"    {types.wide(v.type)} {v.name};\n" for v in varying)
    given_values = ", ".join(f"given.{v.name}" for v in varying)
    shared_in = ", ".join(f"const {types.wide(a.type)}& {v.name}" for a, v in fixed)
    shared = ", ".join(v.name for _, v in fixed)
    arguments_given = ", ".join(f"{a.name}({a.name}_in)" for a in kernel.arguments)
    carry = "".join(f"        {v} = from.{v};\n" for v in carried)
    code = f"""\
typedef {types.wide(result.type)} Result;
namespace {{
typedef {steps.name} Steps;
// The arguments that each path begins with.
struct Given {{
{given_members}}};
struct Path {{
    {steps.name} steps;
    lanes::Ints home;  // the place where it began
    Path({shared_in})
        : steps({shared}) {{}}
}};
LANES_INLINE void begin(Path& path, const Given& given, const lanes::Mask exec) {{
    path.steps.begin({given_values}, exec);
}}
LANES_INLINE void move(Path& to, const Path& from, lanes::Move m) {{
    move(to.steps, from.steps, m);
    lanes::move(to.home, from.home, m);
}}
// A pixel for each lane, each with its current sample.
struct {name} {{
{declared}
    Given given_;
    lanes::Mask owned_, sampled_, begun_;
    lanes::Ints thread_;
    {name}({arguments_in}) : {arguments_given} {{}}
    void begin(const lanes::Ints& threads, const lanes::Mask exec_in) {{
        lanes::Mask exec = exec_in;
        {masks}
        owned_ = exec;
        thread_ = threads;
{before}
    }}
    lanes::Ints left() const {{ return lanes::sub({samples.name}.end, {samples.name}.i); }}
    // Skip the samples of other shares: this is number `n` of `among`.
    void share(int n, int among) {{
        {samples.name}.i = lanes::add({samples.name}.i, lanes::mul({samples.name}.step, lanes::Ints(n)));
        {samples.name}.step = lanes::mul({samples.name}.step, lanes::Ints(among));
    }}
    // Take over the sums of the previous sample.
    void carry(const {name}& from) {{
{carry}    }}
    // Begin the next sample of each pixel that has more: set `given_`, and the mask of paths that begin.
    void start() {{
        lanes::Mask exec = owned_ & lanes::more({samples.name});
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
        lanes::set({result.name}, result_, begun_);
{finish}
    }}
    void after() {{
        lanes::Mask exec = owned_;
        {masks}
{local("after") + emitter.code(phases.epilogue)}
    }}
}};
typedef {name} Pixels;
}} // namespace
"""
    driver: str = text_of("lanes/pool.h").replace("ROUND\n", steps.round).replace("ARGUMENTS_IN", arguments_in)
    driver = driver.replace("ARGUMENTS", ", ".join(f"{a.name}_in" for a in kernel.arguments))
    driver = driver.replace("TARGET", phases.target.name)
    return steps.code + code + driver.replace("FIXED", ", ".join(f"pool.pixels(g).{v.name}" for _, v in fixed))


def _phases(kernel: ir.Function, path: ir.Function) -> _Phases:
    loop = the_loop(kernel)
    samples = range_of(loop.body[0])
    ends = next((s.value for s in ir.walk(kernel.body) if isinstance(s, ir.Set) and s.variable is samples), None)
    target = ends.arguments[-1] if isinstance(ends, ir.Builtin) else None
    if samples is None or not isinstance(target, ir.Variable) or target not in kernel.arguments:
        raise ir.Unsupported(
            f"{kernel.key}: must loop over samples, `for index in range(first, last)`, where last is an argument"
        )
    around, starts, following = [], [], []
    body = loop.body[1:]
    while True:
        at = next((i for i, s in enumerate(body) if path.name in ir.calls([s])), None)
        starts.append(body[:at])
        following.append(body[at + 1 :] if at is not None else [])
        s = body[at] if at is not None else None
        if not isinstance(s, ir.If):
            break
        around.append(s)
        body = s.body
    calls = list(ir.calls(kernel.body)).count(path.name)
    if calls != 1 or not isinstance(s, ir.Set) or not isinstance(s.value, ir.Call) or any(chain(*following[1:-1])):
        raise ir.Unsupported(
            f"{kernel.key}: must call {path.key} once in its loop over samples, at the top level, or in the last of "
            "nested `if`s"
        )
    at = kernel.body.index(loop)
    return _Phases(
        loop=loop,
        samples=samples,
        target=target,
        calling=s,
        call=s.value,
        prologue=kernel.body[:at],
        around=around,
        starts=starts,
        completion=following[-1] if around else [],
        finish=following[0],
        epilogue=kernel.body[at + 1 :],
    )
