"""Each function for lanes gives in every lane the bits of Warp's function."""

from __future__ import annotations

import re

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from wrt.backend.processor import WIDTHS
from wrt.kernels.native import at_file_level
from wrt.spmd.library import library

pytestmark = pytest.mark.machinery

# For each check what is done: `lanes` is the namespace of one of both. Names that end in `s` are vectors or matrices.
# a, b, c: any floats; t: 0 to 1; x, y: floats that integers hold; d, e: doubles; i, j: integers, j not 0; k: 0 to 31;
# k2, k4, i64, j64: integers from 0 to 1, 3, and 63; step: odd, from −7 to 7; u, w: unsigned, w not 0; n: long; m: a
# mask; v2 to v4, w2 to w4: vectors; q, r: matrices 3x3; g: 2x4.
CHECKS = [
    *(f"lanes::{name}({p}, {q})" for name in ("add", "sub", "mul", "min", "max") for p, q in ("ab", "ij", "uw", "de")),
    *(f"lanes::{name}({p}, {q})" for name in ("bit_and", "bit_or", "bit_xor") for p, q in ("ij", "uw", "nn")),
    *(f"lanes::{name}({p})" for name in ("neg", "abs") for p in ("a", "i", "d", "v2", "v3", "v4")),
    *(f"lanes::{name}(a)" for name in ("sign", "floor", "ceil", "sqrt", "sin", "cos", "tan", "acos", "asin", "atan")),
    *(f"lanes::{name}(a)" for name in ("exp", "log", "log2", "erf", "erfc", "tanh")),
    *(f"lanes::{name}({v}, {w})" for name in ("add", "sub", "cw_mul", "cw_div", "dot", "min", "max")
      for v, w in (("v2", "w2"), ("v3", "w3"), ("v4", "w4"))),
    *(f"lanes::{name}({v})" for name in ("length", "length_sq", "normalize", "min", "max") for v in ("v2", "v3", "v4")),
    *(f"lanes::{name}({v}, a)" for name in ("mul", "div") for v in ("v2", "v3", "v4")),
    *(f"lanes::clamp({', '.join(of)})" for of in ("abc", "iji", "uwu", "ded")),
    "lanes::atan2(a, b)", "lanes::pow(a, b)", "lanes::erfinv(t)", "lanes::sqrt(d)",
    "lanes::lerp(a, b, t)", "lanes::lerp(v3, w3, t)", "lanes::isfinite(a)", "lanes::isfinite(v3)",
    "lanes::div(a, b)", "lanes::div(d, e)", "lanes::div(i, j)", "lanes::mod(i, j)", "lanes::mod(u, w)",
    "lanes::floordiv(i, j)", "lanes::rshift(i, k)", "lanes::lshift(u, lanes::to_uint32(k))",
    "lanes::rshift(u, lanes::to_uint32(k))", "lanes::invert(i)", "lanes::invert(u)",
    "lanes::cross(v3, w3)", "lanes::mul(q, v3)", "lanes::mul(g, v4)", "lanes::mul(q, a)", "lanes::transpose(g)",
    "lanes::inverse(q)", "lanes::inverse(r)", "lanes::where(m, a, b)", "lanes::where(m, v3, w3)",
    "lanes::where(m, a, 2.0f)", "lanes::where(m, 1, i)",
    "lanes::to_int32(x)", "lanes::to_uint32(y)", "lanes::to_float32(i)", "lanes::to_float32(u)", "lanes::to_float32(n)",
    "lanes::to_float32(d)", "lanes::to_float64(a)", "lanes::to_int64(i)", "lanes::to_int32(n)", "lanes::to_int32(m)",
    "lanes::to_float32(m)", "lanes::div(u, w)", "lanes::floordiv(u, w)",
    "lanes::div(n, lanes::to_int64(j))", "lanes::mod(n, lanes::to_int64(j))",
    "lanes::sign(i)", "lanes::floor(d)", "lanes::abs(n)", "lanes::to_bool(a)", "lanes::to_bool(i)", "lanes::to_bool(d)",
    "lanes::vec3d(v3)", "lanes::mat2(a)", "lanes::total(i64, j64, step)",
    "lanes::extract(v4, 0)", "lanes::extract(v4, -1)", "lanes::extract(v3, -3)", "lanes::extract(v4, k4)",
    "lanes::extract(q, 1, -1)", "lanes::extract(q, -2, 0)", "lanes::extract(g, -1)",
    "lanes::extract(g, k2)",
]  # fmt: skip
COMPARISONS = [f"({p} {op} {q})" for op in ("<", ">", "<=", ">=", "==", "!=") for p, q in ("ab", "ij", "uw", "de")]
COMPARISONS += [f"({v} {op} {w})" for op in ("==",) for v, w in (("v3", "w3"), ("v2", "v2"))]

# What Warp has by other names, and comparisons of results.
HELPERS = """
namespace lanes {
LANES_INLINE auto vec3d(Vector<3, Floats> a) { return make_vec<3, Doubles>(a); }
LANES_INLINE auto mat2(Floats a) { return make_mat<2, 2, Floats>(a); }
LANES_INLINE Ints total(Ints begin, Ints end, Ints step) {
    Range r = range(begin, end, step);
    Ints sum = 0;
    for (Mask exec = more(r); any(exec); exec = exec & more(r)) set(sum, add(sum, next(r, exec)), exec);
    return sum;
}
}
namespace wp {
inline auto mat2(float a) { return mat_t<2, 2, float>(a); }
inline int total(int begin, int end, int step) {
    range_t r = range(begin, end, step);
    int sum = 0;
    while (iter_cmp(r)) sum += iter_next(r);
    return sum;
}
}
// The same bits, or both not a number.
template<class A, class B> bool same(A a, B other) {
    const A b = (A)other;
    return (a != a && b != b) || __builtin_memcmp(&a, &b, sizeof(A)) == 0;
}
template<unsigned N, class T> bool same(const wp::vec_t<N, T>& a, const wp::vec_t<N, T>& b) {
    for (unsigned k = 0; k < N; ++k) if (!same(a[k], b[k])) return false;
    return true;
}
template<unsigned R, unsigned N, class T> bool same(const wp::mat_t<R, N, T>& a, const wp::mat_t<R, N, T>& b) {
    for (unsigned j = 0; j < R; ++j)
        for (unsigned k = 0; k < N; ++k) if (!same(a.data[j][k], b.data[j][k])) return false;
    return true;
}
struct Some {
    const float* f;
    const int* i;
    float number(int of, int l) const { return f[lanes::WIDTH * of + l]; }
    int integer(int of, int l) const { return i[lanes::WIDTH * of + l]; }
};
template<int N> wp::vec_t<N, float> some_vector(Some s, int first, int l) {
    wp::vec_t<N, float> r;
    for (int k = 0; k < N; ++k) r[k] = s.number(first + k, l);
    return r;
}
template<int R, int N> wp::mat_t<R, N, float> some_matrix(Some s, int first, int l) {
    wp::mat_t<R, N, float> r;
    for (int k = 0; k < R * N; ++k) r.data[k / N][k % N] = s.number(first + k, l);
    return r;
}
template<class M, class One> void count(int& failed, const M& many, const One& one) {
    for (int l = 0; l < lanes::WIDTH; ++l) failed += !same(lanes::lane(many, l), one(l));
}
"""

# What One and Many have, from the numbers of lane l.
ARGUMENTS = {
    "a": ("float", "s.number(0, l)"),
    "b": ("float", "s.number(1, l)"),
    "c": ("float", "s.number(2, l)"),
    "t": ("float", "s.number(3, l)"),
    "x": ("float", "(float)(s.integer(0, l) >> 3)"),
    "y": ("float", "(float)((unsigned)s.integer(1, l) >> 3)"),
    "d": ("double", "(double)a * 1.00000000001"),
    "e": ("double", "(double)b * 1.00000000001"),
    "i": ("int", "s.integer(0, l)"),
    "j": ("int", "s.integer(1, l) == 0 ? 7 : s.integer(1, l)"),
    "k": ("int", "s.integer(2, l) & 31"),
    "k2": ("int", "k & 1"),
    "k4": ("int", "k & 3"),
    "i64": ("int", "i & 63"),
    "j64": ("int", "j & 63"),
    "step": ("int", "(k & 14) - 7"),
    "u": ("unsigned", "(unsigned)i"),
    "w": ("unsigned", "(unsigned)j"),
    "n": ("wp::int64", "(wp::int64)i * 1000003"),
    "m": ("bool", "(s.integer(2, l) & 64) != 0"),
    **{
        f"{name}{n}": (f"wp::vec_t<{n}, float>", f"some_vector<{n}>(s, {first}, l)")
        for name, first in (("v", 4), ("w", 8))
        for n in (2, 3, 4)
    },
    "q": ("wp::mat_t<3, 3, float>", "some_matrix<3, 3>(s, 4, l)"),
    "r": ("wp::mat_t<3, 3, float>", "some_matrix<3, 3>(s, 4, l / 2)"),
    "g": ("wp::mat_t<2, 4, float>", "some_matrix<2, 4>(s, 5, l)"),
}
NUMBERS, INTEGERS = 13, 3
GROUPS = 200

SPECIAL = [0.0, -0.0, 1.0, -1.0, 0.5, np.inf, -np.inf, np.nan, 1e-40, -1e-45, 3.4e38, -1e30, 1e-30, 2.5, -2.5, 1e10]


def code(lanes: int, checks: list[str]) -> str:
    """Return C++ of `check_all`, which counts in how many lanes each check fails."""
    members = {"One": "", "Many": ""}
    fill = ""
    for name, (of, value) in ARGUMENTS.items():
        members["One"] += f"    {of} {name};\n"
        members["Many"] += f"    lanes::Wide<{of}> {name};\n"
        fill += f"        {name} = {value};\n"
    functions = {"One": "", "Many": ""}
    calls = ""
    for k, check in enumerate(checks):
        call = f"lanes::Mask{check}" if check in COMPARISONS else check
        functions["Many"] += f"    auto check_{k}() const {{ return {call}; }}\n"
        one = re.sub(r"lanes::(?:to_)?", "wp::", check).replace("wp::bool", "bool")
        functions["One"] += f"    auto check_{k}() const {{ return {one}; }}\n"
        calls += f"    count(failed[{k}], many.check_{k}(), [&](int l) {{ return ones[l].check_{k}(); }});\n"
    sets = "".join(f"lanes::set_lane({name}, l, ones[l].{name}); " for name in ARGUMENTS)
    text = f"""{HELPERS}
struct One {{
{members["One"]}
    One() {{}}
    One(Some s, int l) {{
{fill}    }}
{functions["One"]}}};
struct Many {{
{members["Many"]}
    Many(const One* ones) {{ for (int l = 0; l < lanes::WIDTH; ++l) {{ {sets}}} }}
{functions["Many"]}}};
static void check_all(Some s, int* failed) {{
    One ones[lanes::WIDTH];
    for (int l = 0; l < lanes::WIDTH; ++l) ones[l] = One(s, l);
    const Many many(ones);
{calls}}}
"""
    return library(lanes) + text


def numbers(groups: int, lanes: int) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Return floats and integers of all sizes, including special values."""
    rng = np.random.default_rng(11)
    shape = (groups, NUMBERS, lanes)
    floats = (rng.normal(size=shape) * 10.0 ** rng.integers(-3, 4, shape)).astype(np.float32)
    special = rng.random(shape) < 0.15
    floats[special] = rng.choice(np.array(SPECIAL, np.float32), special.sum())
    floats[0, :2, 0] = 0.0, -0.0
    floats[:, 3] = rng.random((groups, lanes))
    integers = rng.integers(-(2**31) + 1, 2**31, (groups, INTEGERS, lanes))
    integers >>= rng.integers(0, 31, integers.shape)
    return floats, integers.astype(np.int32)


def failures(checks: list[str], lanes: int) -> dict[str, int]:
    """Return in how many lanes each check failed."""
    checks_h = at_file_level(code(lanes, checks), "checks")

    @wp.func_native("check_all({floats.data, integers.data}, failed.data);")
    def check(floats: wp.array(dtype=float), integers: wp.array(dtype=int), failed: wp.array(dtype=int)):
        checks_h()

    @wp.kernel(module="unique", enable_backward=False)
    def check_group(floats: wp.array(dtype=float), integers: wp.array(dtype=int), failed: wp.array(dtype=int)):
        check(floats, integers, failed)

    failed = wp.zeros(len(checks), dtype=int, device="cpu")
    for floats, integers in zip(*numbers(GROUPS, lanes), strict=True):
        arrays = [
            wp.array(floats.ravel(), dtype=float, device="cpu"),
            wp.array(integers.ravel(), dtype=int, device="cpu"),
        ]
        wp.launch(check_group, dim=1, inputs=[*arrays, failed], device="cpu")
    return {name: int(n) for name, n in zip(checks, failed.numpy(), strict=True) if n}


@pytest.mark.parametrize("lanes", WIDTHS)
def test_functions_of_lanes_are_those_of_one(lanes: int) -> None:
    assert failures(CHECKS + COMPARISONS, lanes=lanes) == {}
