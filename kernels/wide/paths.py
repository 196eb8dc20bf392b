"""A function that follows a path and the kernel that calls it, for many lanes of which each is where it is.

A path is a loop, and paths end after different numbers of rounds. The function becomes an object with what outlives a
round as its members, so that a round can be run for one group of sixteen paths after the other; the lanes of paths
that go on are moved together in between, and a round is always one of nearly full groups (Wald 2011, "Active thread
compaction for GPU path tracing"). The kernel becomes an object, too: with what a pixel keeps, and what it does before
and after each of its paths. `_DRIVER` runs them for a square of pixels, whose first rays lie side by side.
"""

import re
from typing import Any

from warp._src.codegen import constant_str

from wrt.kernels.wide.render import TILE
from wrt.kernels.wide.statements import NO_MORE, SET, VARIABLE, Body
from wrt.kernels.wide.types import Types, Unsupported

_PATH_LOOP = "while_0"
_SAMPLE_LOOP = "for_0"


class PathSteps:
    """A function with one loop, as an object whose rounds are run one at a time.

    Attributes:
        name: of the C++ struct.
        code: the struct, and `move` for it.
    """

    def __init__(self, types: Types, function: Any, fixed: list[Any]) -> None:
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
        local = "".join(body.declaration(v) for v in rounds)
        used_later = set(VARIABLE.findall("\n".join(body.lines[first:])))
        moved = [v.emit() for v in (*own, *kept) if v.emit() in used_later and body.declaration(v)]
        moved = [name for name in moved if not types.is_shared(body.variables[name].type)]

        body.keep_all = True
        begin = body.code(0, first)
        body.keep_all = False
        body.loops.append(_PATH_LOOP)
        step = body.code(first + 1, last - 1)
        body.loops.pop()
        end = body.code(last + 1, len(body.lines) - 1)
        result = returned[1]
        fixed_in = [f"const {types.wide(a.type)}& {a.emit()}_in" for a in fixed]
        own_in = [f"const {types.wide(a.type)}& {a.emit()}_in" for a in own]
        masks = "lanes::Mask exec = exec_in, returned_ = false"
        self.code = f"""
namespace {{
struct {self.name} {{
{"".join(f"    const {types.wide(a.type)}& {a.emit()};" for a in fixed)}
{"".join(f"    {types.wide(a.type)} {a.emit()};" for a in own)}
{_constants(constants)}{"".join(body.declaration(v) for v in kept)}
    {self.name}({", ".join(fixed_in)}) : {", ".join(f"{a.emit()}({a.emit()}_in)" for a in fixed)} {{}}
    void begin({", ".join(own_in)}, const lanes::Mask exec_in) {{
        {masks};
        {" ".join(f"lanes::set({a.emit()}, {a.emit()}_in, exec);" for a in own)}
{begin}
    }}
    // Run a round; return the lanes that go on.
    lanes::Mask step(const lanes::Mask exec_in) {{
        {masks}, broken_{_PATH_LOOP} = false, continued_{_PATH_LOOP} = false;
{local}
        do {{
{step}
        }} while (false);
        return exec_in & ~broken_{_PATH_LOOP};
    }}
    {types.wide(body.variables[result].type)} end(const lanes::Mask exec_in) {{
        {masks};
{end}
        return {result};
    }}
}};
LANES_INLINE void move({self.name}& to, const {self.name}& from, lanes::Move m) {{
    using lanes::move; {" ".join(f"move(to.{name}, from.{name}, m);" for name in moved)} }}
}} // namespace
"""


class SampledPixels:
    """A kernel that calls a function of `PathSteps` in a loop over samples, as an object for sixteen pixels.

    Attributes:
        code: C++ structs `Path` and `Pixels`, and the driver.
    """

    def __init__(self, types: Types, kernel: Any, function: Any) -> None:
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
        passed = m[2].partition("(")[2][:-1].split(", ")
        given = {a.emit() for a in body.adj.args}
        fixed = [(a, name) for a, name in zip(function.adj.args, passed, strict=True) if name in given]
        own = [name for name in passed if name not in given]
        steps = PathSteps(types, function, [a for a, _ in fixed])

        spans = {"before": (0, first), "start": (first + 2, call), "finish": (call + 1, last - 1)}
        spans["after"] = (last + 1, len(lines))
        used: dict[str, set[str]] = {}
        for phase, (begin, end) in spans.items():
            for line in lines[begin:end]:
                for name in VARIABLE.findall(line):
                    used.setdefault(name, set()).add(phase)
        for _, m in sets:
            if m[1] in body.pointers:
                for name in VARIABLE.findall(m[2]):
                    used.setdefault(name, set()).update(used.get(m[1], set()))
        for name in (*own, result, samples):
            used.setdefault(name, set()).update({"start", "finish"})
        variables = [v for v in body.adj.variables if v.constant is None]
        kept = [v for v in variables if len(used.get(v.emit(), ())) > 1]

        def local(phase: str) -> str:
            return "".join(body.declaration(v) for v in variables if used.get(v.emit()) == {phase})

        body.keep_all = True
        before = local("before") + body.code(0, first)
        body.loops.append(_SAMPLE_LOOP)
        start = local("start") + body.code(first + 2, call)
        # What follows the call within the same `if` waits until the path has ended.
        depth = len(body.blocks)
        close = _end_of_block(lines, call + 1, last - 1) if depth else call + 1
        if lines[close : close + depth] != ["}"] * depth:
            raise Unsupported(f"{kernel.key}: does more around where it calls {function.key}")
        start += "".join(f"    given_.{name} = {name};\n" for name in own) + "    begun_ = exec;\n"
        start += body.code(close, close + depth)
        body.keep_all = False
        rest = body.code(call + 1, close)
        finish = local("finish") + (f"    exec = begun_; if (lanes::any(exec)) {{\n{rest}    }}\n" if rest else "")
        finish += "    exec = sampled_;\n" + body.code(close + depth, last - 1)
        body.loops.pop()
        after = local("after") + body.code(last + 1, len(lines))

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
            + _DRIVER.replace("ARGUMENTS_IN", taken)
            .replace("ARGUMENTS", ", ".join(f"{a.emit()}_in" for a in arguments))
            .replace("FIXED", ", ".join(f"pool.pixels(g).{name}" for _, name in fixed))
        )


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


_DRIVER = """
struct Here {};
inline void* operator new(decltype(sizeof(0)), Here, void* p) { return p; }

namespace {
constexpr int GROUPS = TILE * TILE / lanes::WIDTH;

// Paths of as many groups as a square of the picture has, and what becomes of them.
struct Pool {
    alignas(64) char pixel_memory[sizeof(Pixels) * GROUPS], path_memory[sizeof(Path) * GROUPS];
    alignas(64) Result results[GROUPS];
    lanes::Mask live[GROUPS];
    int count;
    Pixels& pixels(int g) { return ((Pixels*)pixel_memory)[g]; }
    Path& path(int g) { return ((Path*)path_memory)[g]; }

    // Begin a path in each lane, where it is: the pixels of a group are neighbours.
    void begin_side_by_side() {
        for (int g = 0; g < count; ++g) {
            begin(path(g), pixels(g).given_, live[g] = pixels(g).begun_);
            path(g).home = lanes::Ints(lanes::WIDTH * g + lanes::lane_numbers().v);
        }
    }

    // Begin paths of sixteen samples of sixteen pixels: those of one pixel in one group.
    void begin_pixel_by_pixel() {
        constexpr int ROWS = sizeof(Given) / (4 * lanes::WIDTH);
        static_assert(sizeof(Given) % (4 * lanes::WIDTH) == 0, "what is given is not of numbers of four bytes alone");
        const auto row_of = [&](int sample, int row) { return (const float*)&pixels(sample).given_ + lanes::WIDTH * row; };
        alignas(64) Given given[4];
        for (int g = 0; g < lanes::WIDTH; ++g) {
            if (g % 4 == 0) {
                _Pragma("clang loop unroll(disable)") for (int row = 0; row < ROWS; ++row) {
                    const lanes::FourRows rows = lanes::transposed([&](int l) __attribute__((always_inline)) {
                        return (lanes::f4) * (const lanes::f4_anywhere*)(row_of(l, row) + g);
                    });
                    for (int k = 0; k < 4; ++k) ((lanes::f16*)&given[k])[row] = rows.r[k];
                }
            }
            unsigned samples = 0;
            for (int l = 0; l < lanes::WIDTH; ++l) samples |= (lanes::bits(pixels(l).begun_) >> g & 1) << l;
            begin(path(g), given[g % 4], live[g] = lanes::of_bits(samples));
            path(g).home = lanes::Ints(lanes::WIDTH * lanes::lane_numbers().v + g);
        }
    }

    // Follow all paths to their ends.
    void follow() {
        int groups = count;  // of which paths may go on
        while (groups > 0) {
            int left = 0;
            _Pragma("clang loop unroll(disable)") for (int g = 0; g < groups; ++g) {
                if (!lanes::any(live[g])) continue;
                const lanes::Mask going = path(g).steps.step(live[g]), done = live[g] & ~going;
                if (lanes::any(done)) leave(path(g), done);
                live[g] = going;
                left += __builtin_popcount(lanes::bits(going));
            }
            if (left == 0) break;
            if (4 * left <= 3 * lanes::WIDTH * groups) close_up(groups);
        }
    }

    void leave(Path& path, lanes::Mask done) {
        constexpr int ROWS = sizeof(Result) / (4 * lanes::WIDTH);
        static_assert(sizeof(Result) % (4 * lanes::WIDTH) == 0, "a result is not of numbers of four bytes alone");
        const Result result = path.steps.end(done);
        alignas(64) int homes[lanes::WIDTH];
        *(lanes::i16*)homes = path.home.v;
        LANES_EACH(l, done) {
            int* const to = (int*)&results[homes[l] / lanes::WIDTH] + homes[l] % lanes::WIDTH;
            const int* const from = (const int*)&result + l;
            for (int row = 0; row < ROWS; ++row) to[lanes::WIDTH * row] = from[lanes::WIDTH * row];
        }
    }

    // Move paths that go on together, into as few groups as hold them.
    void close_up(int& groups) {
        int to = 0;
        for (int g = 0; g < groups; ++g) {
            while (lanes::any(live[g]) && to < g) {
                const unsigned from = lanes::bits(live[g]), room = ~lanes::bits(live[to]) & 0xffff;
                if (room == 0) {
                    ++to;
                    continue;
                }
                const unsigned leave = lanes::first_of(from, __builtin_popcount(room));
                const unsigned enter = lanes::first_of(room, __builtin_popcount(from));
                move(path(to), path(g), lanes::Move{(unsigned short)leave, (unsigned short)enter});
                live[g] = lanes::of_bits(from & ~leave);
                live[to] = live[to] | lanes::of_bits(enter);
            }
        }
        while (groups > 0 && !lanes::any(live[groups - 1])) --groups;
    }
};

// A square of four by four pixels, of which some may be outside the picture.
struct Block {
    lanes::Ints threads;
    lanes::Mask inside;
    Block(const int tile, const int place, const int width, const int height) {
        const lanes::i16 numbers = lanes::lane_numbers().v;
        const int across = (width + TILE - 1) / TILE;
        const lanes::i16 x = TILE * (tile % across) + 4 * (place % 4) + (numbers & 3);
        const lanes::i16 y = TILE * (tile / across) + 4 * (place / 4) + (numbers >> 2);
        threads = lanes::Ints(y * width + x);
        inside = lanes::Mask((x < width) & (y < height));
    }
};
} // namespace

// Render a square of TILE x TILE pixels. 
static void render_tile(const int tile, const int width, const int height, ARGUMENTS_IN) {
    Pool pool;
    const auto add = [&](const Block& block) {
        const int g = pool.count++;
        new (Here(), &pool.pixels(g)) Pixels(ARGUMENTS);
        pool.pixels(g).begin(block.threads, block.inside);
        new (Here(), &pool.path(g)) Path(FIXED);
    };
    const auto start = [&]() -> bool {
        bool more = false;
        _Pragma("clang loop unroll(disable)") for (int g = 0; g < pool.count; ++g) {
            pool.pixels(g).start();
            more |= lanes::any(pool.pixels(g).sampled_);
        }
        return more;
    };
    pool.count = 0;
    int most = 0;
    for (int place = 0; place < GROUPS; ++place) {
        const Block block(tile, place, width, height);
        if (!lanes::any(block.inside)) continue;
        add(block);
        const lanes::Ints left = pool.pixels(pool.count - 1).left();
        LANES_EACH(l, block.inside) if (left.v[l] > most) most = left.v[l];
    }
    if (most < lanes::WIDTH) {
        while (start()) {
            pool.begin_side_by_side();
            pool.follow();
            for (int g = 0; g < pool.count; ++g) pool.pixels(g).finish(pool.results[g]);
        }
        for (int g = 0; g < pool.count; ++g) pool.pixels(g).after();
        return;
    }
    for (int place = 0; place < GROUPS; ++place) {
        const Block block(tile, place, width, height);
        if (!lanes::any(block.inside)) continue;
        pool.count = 0;
        for (int n = 0; n < lanes::WIDTH; ++n) {
            add(block);
            pool.pixels(n).share(n, lanes::WIDTH);
        }
        while (start()) {
            pool.begin_pixel_by_pixel();
            pool.follow();
            for (int n = 0; n < lanes::WIDTH; ++n) {
                pool.pixels(n).carry(pool.pixels((n + lanes::WIDTH - 1) % lanes::WIDTH));
                pool.pixels(n).finish(pool.results[n]);
            }
        }
        pool.pixels(lanes::WIDTH - 1).after();
    }
}
""".replace("TILE", str(TILE))
