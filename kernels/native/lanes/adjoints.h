#pragma once
// The adjoints of functions in `numbers.h` and `memory.h`: Warp's, with the same order of operations in each lane.
//
// After the arguments come their adjoints, to which a function adds in the lanes of `exec`, and the adjoint of the
// result. What has no derivative, such as an index, has no adjoint here.
#include "lanes/memory.h"

namespace lanes {
LANES_INLINE void gain(Floats& to, Floats x, Mask exec) { to.v = choose(exec, to.v + x.v, to.v); }
LANES_INLINE void lose(Floats& to, Floats x, Mask exec) { to.v = choose(exec, to.v - x.v, to.v); }
LANES_VECTOR void gain(Vector<N, T>& to, const Vector<N, T>& x, Mask exec) { LANES_FOR gain(to.c[k], x.c[k], exec); }
LANES_VECTOR void lose(Vector<N, T>& to, const Vector<N, T>& x, Mask exec) { LANES_FOR lose(to.c[k], x.c[k], exec); }
LANES_MATRIX void gain(Matrix<R, N, T>& to, const Matrix<R, N, T>& x, Mask exec) {
    LANES_UNROLL for (int j = 0; j < R; ++j) LANES_FOR gain(to.c[j][k], x.c[j][k], exec);
}

// The result of a function of two numbers is one of them.
LANES_INLINE void adj_choice(Mask first, Floats a, Floats b, Floats& adj_a, Floats& adj_b, Floats adj, Mask exec) {
    const Mask no_a = a != a, no_b = b != b, takes_a = ~no_a & (no_b | first);
    gain(adj_a, adj, exec & takes_a);
    gain(adj_b, adj, exec & ~takes_a);
}
LANES_INLINE void adj_min(Floats a, Floats b, Floats& adj_a, Floats& adj_b, Floats adj, Mask exec) {
    adj_choice(a < b, a, b, adj_a, adj_b, adj, exec);
}
LANES_INLINE void adj_max(Floats a, Floats b, Floats& adj_a, Floats& adj_b, Floats adj, Mask exec) {
    adj_choice(a > b, a, b, adj_a, adj_b, adj, exec);
}
LANES_INLINE void adj_clamp(
    Floats x, Floats low, Floats high, Floats& adj_x, Floats& adj_low, Floats& adj_high, Floats adj, Mask exec
) {
    Floats adj_limited = 0.0f;
    adj_min(max(low, x), high, adj_limited, adj_high, adj, exec);
    adj_max(low, x, adj_low, adj_x, adj_limited, exec);
}
LANES_INLINE void adj_abs(Floats a, Floats& adj_a, Floats adj, Mask exec) {
    lose(adj_a, adj, exec & (a < Floats(0.0f)));
    gain(adj_a, adj, exec & ~(a < Floats(0.0f)));
}
template<class A, class B, class Adj_A, class Adj_B, class Adj>
LANES_INLINE void adj_where(Mask m, const A&, const B&, Adj_A& adj_a, Adj_B& adj_b, const Adj& adj, Mask exec) {
    gain(adj_a, adj, exec & m);
    gain(adj_b, adj, exec & ~m);
}
template<class A, class T> LANES_INLINE void adj_copy(const A&, T& adj_a, T& adj, Mask exec) {
    gain(adj_a, adj, exec);
    T none;
    clear(none);
    set(adj, none, exec);
}
LANES_INLINE void adj_to_float32(Floats, Floats& adj_a, Floats adj, Mask exec) { gain(adj_a, adj, exec); }
LANES_INLINE void adj_neg(Floats, Floats& adj_a, Floats adj, Mask exec) { gain(adj_a, Floats(-adj.v), exec); }
LANES_INLINE void adj_add(Floats, Floats, Floats& adj_a, Floats& adj_b, Floats adj, Mask exec) {
    gain(adj_a, adj, exec);
    gain(adj_b, adj, exec);
}
LANES_INLINE void adj_sub(Floats, Floats, Floats& adj_a, Floats& adj_b, Floats adj, Mask exec) {
    gain(adj_a, adj, exec);
    lose(adj_b, adj, exec);
}
LANES_INLINE void adj_mul(Floats a, Floats b, Floats& adj_a, Floats& adj_b, Floats adj, Mask exec) {
    gain(adj_a, mul(b, adj), exec);
    gain(adj_b, mul(a, adj), exec);
}
LANES_INLINE void adj_div(Floats, Floats b, Floats ratio, Floats& adj_a, Floats& adj_b, Floats adj, Mask exec) {
    gain(adj_a, div(adj, b), exec);
    lose(adj_b, div(mul(adj, ratio), b), exec);
}
LANES_INLINE void adj_sqrt(Floats, Floats root, Floats& adj_a, Floats adj, Mask exec) {
    gain(adj_a, mul(mul(0.5f, div(Floats(1.0f), root)), adj), exec);
}
LANES_INLINE void adj_lerp(
    Floats a, Floats b, Floats t, Floats& adj_a, Floats& adj_b, Floats& adj_t, Floats adj, Mask exec
) {
    gain(adj_a, mul(adj, sub(1.0f, t)), exec);
    gain(adj_b, mul(adj, t), exec);
    gain(adj_t, sub(mul(b, adj), mul(a, adj)), exec);
}
LANES_INLINE void adj_log(Floats a, Floats& adj_a, Floats adj, Mask exec) {
    gain(adj_a, mul(div(Floats(1.0f), a), adj), exec);
}
LANES_INLINE void adj_pow(Floats a, Floats b, Floats power, Floats& adj_a, Floats& adj_b, Floats adj, Mask exec) {
    gain(adj_a, mul(mul(b, pow(a, sub(b, 1.0f))), adj), exec);
    gain(adj_b, mul(mul(log(a), power), adj), exec);
}
LANES_INLINE void adj_acos(Floats a, Floats& adj_a, Floats adj, Mask exec) {
    const Floats d = sqrt(sub(1.0f, mul(a, a)));
    lose(adj_a, mul(div(Floats(1.0f), d), adj), exec & (d > Floats(0.0f)));
}
LANES_INLINE void adj_atan2(Floats y, Floats x, Floats& adj_y, Floats& adj_x, Floats adj, Mask exec) {
    const Floats d = add(mul(x, x), mul(y, y));
    const Mask some = exec & (d > Floats(0.0f));
    lose(adj_x, mul(div(y, d), adj), some);
    gain(adj_y, mul(div(x, d), adj), some);
}
LANES_INLINE Floats slope_of_erf(Floats a, Floats adj) { return mul(mul(M_2_SQRT_PI_F, exp(mul(Floats(-a.v), a))), adj); }
LANES_INLINE void adj_erf(Floats a, Floats& adj_a, Floats adj, Mask exec) { gain(adj_a, slope_of_erf(a, adj), exec); }
LANES_INLINE void adj_erfc(Floats a, Floats& adj_a, Floats adj, Mask exec) { lose(adj_a, slope_of_erf(a, adj), exec); }

// Vectors and matrices

#define LANES_ADJ(n) Vector<N, T>& adj_##n
LANES_VECTOR void adj_add(
    const Vector<N, T>&, const Vector<N, T>&, LANES_ADJ(a), LANES_ADJ(b), const Vector<N, T>& adj, Mask exec
) {
    gain(adj_a, adj, exec);
    gain(adj_b, adj, exec);
}
LANES_VECTOR void adj_sub(
    const Vector<N, T>&, const Vector<N, T>&, LANES_ADJ(a), LANES_ADJ(b), const Vector<N, T>& adj, Mask exec
) {
    gain(adj_a, adj, exec);
    lose(adj_b, adj, exec);
}
LANES_VECTOR void adj_neg(const Vector<N, T>&, LANES_ADJ(a), const Vector<N, T>& adj, Mask exec) {
    lose(adj_a, adj, exec);
}
LANES_VECTOR void adj_mul(
    const Vector<N, T>& a, same<T> s, LANES_ADJ(a), T& adj_s, const Vector<N, T>& adj, Mask exec
) {
    gain(adj_a, mul(adj, s), exec);
    gain(adj_s, dot(a, adj), exec);
}
LANES_VECTOR void adj_mul(
    same<T> s, const Vector<N, T>& a, T& adj_s, LANES_ADJ(a), const Vector<N, T>& adj, Mask exec
) {
    adj_mul(a, s, adj_a, adj_s, adj, exec);
}
LANES_VECTOR void adj_div(
    const Vector<N, T>& a, same<T> s, LANES_ADJ(a), T& adj_s, const Vector<N, T>& adj, Mask exec
) {
    lose(adj_s, div(dot(a, adj), mul(s, s)), exec);
    gain(adj_a, div(adj, s), exec);
}
LANES_VECTOR void adj_cw_mul(
    const Vector<N, T>& a, const Vector<N, T>& b, LANES_ADJ(a), LANES_ADJ(b), const Vector<N, T>& adj, Mask exec
) {
    gain(adj_a, cw_mul(b, adj), exec);
    gain(adj_b, cw_mul(a, adj), exec);
}
LANES_VECTOR void adj_cw_div(
    const Vector<N, T>&, const Vector<N, T>& b, const Vector<N, T>& ratio, LANES_ADJ(a), LANES_ADJ(b),
    const Vector<N, T>& adj, Mask exec
) {
    gain(adj_a, cw_div(adj, b), exec);
    lose(adj_b, cw_mul(adj, cw_div(ratio, b)), exec);
}
LANES_VECTOR void adj_dot(
    const Vector<N, T>& a, const Vector<N, T>& b, LANES_ADJ(a), LANES_ADJ(b), same<T> adj, Mask exec
) {
    gain(adj_a, mul(b, adj), exec);
    gain(adj_b, mul(a, adj), exec);
}
LANES_VECTOR void adj_cross(
    const Vector<N, T>& a, const Vector<N, T>& b, LANES_ADJ(a), LANES_ADJ(b), const Vector<N, T>& adj, Mask exec
) {
    gain(adj_a, cross(b, adj), exec);
    lose(adj_b, cross(a, adj), exec);
}
LANES_VECTOR void adj_length(const Vector<N, T>& a, same<T> size, LANES_ADJ(a), same<T> adj, Mask exec) {
    gain(adj_a, mul(div(a, size), adj), exec & (size > T(0)));
}
LANES_VECTOR void adj_normalize(
    const Vector<N, T>& a, const Vector<N, T>& unit, LANES_ADJ(a), const Vector<N, T>& adj, Mask exec
) {
    const T size = length(a), inverse_size = div(T(1), size);
    gain(adj_a, sub(mul(adj, inverse_size), mul(mul(unit, dot(unit, adj)), inverse_size)), exec & (size > T(0)));
}
LANES_VECTOR void adj_lerp(
    const Vector<N, T>& a, const Vector<N, T>& b, same<T> t, LANES_ADJ(a), LANES_ADJ(b), T& adj_t,
    const Vector<N, T>& adj, Mask exec
) {
    gain(adj_a, mul(adj, sub(T(1), t)), exec);
    gain(adj_b, mul(adj, t), exec);
    gain(adj_t, sub(dot(b, adj), dot(a, adj)), exec);
}
#define LANES_ADJ_OF_PAIRS(NAME) \
    LANES_VECTOR void NAME( \
        const Vector<N, T>& a, const Vector<N, T>& b, LANES_ADJ(a), LANES_ADJ(b), const Vector<N, T>& adj, Mask exec \
    ) { \
        LANES_FOR NAME(a.c[k], b.c[k], adj_a.c[k], adj_b.c[k], adj.c[k], exec); \
    }
LANES_ADJ_OF_PAIRS(adj_min)
LANES_ADJ_OF_PAIRS(adj_max)
LANES_VECTOR void adj_abs(const Vector<N, T>& a, LANES_ADJ(a), const Vector<N, T>& adj, Mask exec) {
    LANES_FOR adj_abs(a.c[k], adj_a.c[k], adj.c[k], exec);
}
// The first of the largest elements, NaN left out.
LANES_VECTOR void adj_max(const Vector<N, T>& a, LANES_ADJ(a), same<T> adj, Mask exec) {
    const T most = max(a);
    Mask left = exec;
    LANES_FOR {
        const Mask here = left & (a.c[k] == most);
        gain(adj_a.c[k], adj, here);
        left = left & ~here;
    }
    gain(adj_a.c[0], adj, left);
}
LANES_VECTOR void adj_extract(const Vector<N, T>&, int k, LANES_ADJ(a), same<T> adj, Mask exec) {
    gain(adj_a.c[k < 0 ? k + N : k], adj, exec);
}
LANES_VECTOR void adj_extract(const Vector<N, T>&, Ints i, LANES_ADJ(a), same<T> adj, Mask exec) {
    LANES_FOR gain(adj_a.c[k], adj, exec & (i == Ints(k)));
}
LANES_MATRIX void adj_extract(
    const Matrix<R, N, T>&, int j, Matrix<R, N, T>& adj_a, const Vector<N, T>& adj, Mask exec
) {
    if (j < R) LANES_FOR gain(adj_a.c[j < 0 ? j + R : j][k], adj.c[k], exec);
}
LANES_MATRIX void adj_extract(const Matrix<R, N, T>&, int j, int k, Matrix<R, N, T>& adj_a, same<T> adj, Mask exec) {
    if (j < R) gain(adj_a.c[j < 0 ? j + R : j][k < 0 ? k + N : k], adj, exec);
}
template<class T> LANES_INLINE void adj_vec_t(
    same<T>, same<T>, T& adj_a, same<T>& adj_b, const Vector<2, same<T>>& adj, Mask exec
) {
    gain(adj_a, adj.c[0], exec);
    gain(adj_b, adj.c[1], exec);
}
template<class T> LANES_INLINE void adj_vec_t(
    same<T>, same<T>, same<T>, T& adj_a, same<T>& adj_b, same<T>& adj_c, const Vector<3, same<T>>& adj, Mask exec
) {
    gain(adj_a, adj.c[0], exec);
    gain(adj_b, adj.c[1], exec);
    gain(adj_c, adj.c[2], exec);
}
LANES_VECTOR void adj_vec_t(same<T>, T& adj_a, const Vector<N, T>& adj, Mask exec) {
    LANES_FOR gain(adj_a, adj.c[k], exec);
}
LANES_VECTOR void adj_vec_t(const Vector<N, T>&, LANES_ADJ(a), const Vector<N, T>& adj, Mask exec) {
    gain(adj_a, adj, exec);
}
} // namespace lanes
