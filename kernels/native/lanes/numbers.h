#pragma once
// The numbers, vectors and matrices of a kernel for several lanes.
//
// Each function has the name of Warp's, and does the same in each lane, in the same order of operations: pictures are
// the same, bit for bit. Constants stay numbers of one lane; they convert to lanes.
#include "lanes/masks.h"

namespace lanes {
#define LANES_FOR LANES_UNROLL for (int k = 0; k < N; ++k)
#define LANES_VECTOR template<int N, class T> LANES_INLINE
#define LANES_MATRIX template<int R, int N, class T> LANES_INLINE

template<class E, class V> struct Number {
    V v;
    Number() {}
    Number(E x) : v(x) {}
};
#define LANES_NUMBER(NAME, ELEMENT, VECTOR) \
    struct NAME : Number<ELEMENT, VECTOR> { \
        using Number::Number; \
        explicit NAME(VECTOR x) { v = x; } \
    };
LANES_NUMBER(Floats, float, floats)
LANES_NUMBER(Ints, int, ints)
LANES_NUMBER(Uints, unsigned, uints)
LANES_NUMBER(Longs, long long, longs)
LANES_NUMBER(Doubles, double, doubles)

template<int N, class T> struct Vector {
    T c[N];
    Vector() {}
    template<class S> Vector(const wp::vec_t<N, S>& a) { LANES_FOR c[k] = T(a[k]); }
};
template<int R, int N, class T> struct Matrix {
    T c[R][N];
    Matrix() {}
    template<class S> Matrix(const wp::mat_t<R, N, S>& a) {
        LANES_UNROLL for (int j = 0; j < R; ++j) LANES_FOR c[j][k] = T(a.data[j][k]);
    }
};

// The type of lanes for a type of one lane; small integers are stored in 32 bits.
template<class T> struct WideOf;
template<class T> using Wide = typename WideOf<T>::type;
#define LANES_WIDE(OF, TYPE) \
    template<> struct WideOf<OF> { \
        typedef TYPE type; \
    };
LANES_WIDE(float, Floats)
LANES_WIDE(int, Ints)
LANES_WIDE(unsigned, Uints)
LANES_WIDE(wp::uint16, Uints)
LANES_WIDE(wp::uint8, Uints)
LANES_WIDE(wp::int64, Longs)
LANES_WIDE(double, Doubles)
LANES_WIDE(bool, Mask)
template<unsigned N, class S> struct WideOf<wp::vec_t<N, S>> {
    typedef Vector<N, Wide<S>> type;
};
template<unsigned R, unsigned N, class S> struct WideOf<wp::mat_t<R, N, S>> {
    typedef Matrix<R, N, Wide<S>> type;
};

template<class T> struct Same {
    typedef T type;
};
// An argument from which no template parameter is deduced.
template<class T> using same = typename Same<T>::type;

// Selection and arithmetic. The least and the most of a number and a NaN is the number; of equal numbers, such as 0 and
// -0, the first.

#define LANES_ARITHMETIC(T) \
    LANES_INLINE T blend(Mask m, T a, T b) { return T(choose(m, a.v, b.v)); } \
    LANES_INLINE void clear(T& x) { x.v = 0; } \
    LANES_INLINE T min(T a, T b) { return T(a.v != a.v ? b.v : (b.v < a.v ? b.v : a.v)); } \
    LANES_INLINE T max(T a, T b) { return T(a.v != a.v ? b.v : (b.v > a.v ? b.v : a.v)); } \
    LANES_INLINE T add(T a, T b) { return T(a.v + b.v); } \
    LANES_INLINE T sub(T a, T b) { return T(a.v - b.v); } \
    LANES_INLINE T mul(T a, T b) { return T(a.v * b.v); } \
    LANES_INLINE T neg(T a) { return T(0 - a.v); } \
    LANES_INLINE T clamp(T a, T low, T high) { return min(max(low, a), high); } \
    LANES_INLINE Mask operator<(T a, T b) { return Mask::of(a.v < b.v); } \
    LANES_INLINE Mask operator>(T a, T b) { return Mask::of(a.v > b.v); } \
    LANES_INLINE Mask operator<=(T a, T b) { return Mask::of(a.v <= b.v); } \
    LANES_INLINE Mask operator>=(T a, T b) { return Mask::of(a.v >= b.v); } \
    LANES_INLINE Mask operator==(T a, T b) { return Mask::of(a.v == b.v); } \
    LANES_INLINE Mask operator!=(T a, T b) { return Mask::of(a.v != b.v); } \
    LANES_INLINE Mask to_bool(T a) { return a != T(0); }
LANES_ARITHMETIC(Floats)
LANES_ARITHMETIC(Ints)
LANES_ARITHMETIC(Uints)
LANES_ARITHMETIC(Longs)
LANES_ARITHMETIC(Doubles)
LANES_VECTOR Vector<N, T> blend(Mask m, const Vector<N, T>& a, const Vector<N, T>& b) {
    Vector<N, T> r;
    LANES_FOR r.c[k] = blend(m, a.c[k], b.c[k]);
    return r;
}
LANES_MATRIX Matrix<R, N, T> blend(Mask m, const Matrix<R, N, T>& a, const Matrix<R, N, T>& b) {
    Matrix<R, N, T> r;
    LANES_UNROLL for (int j = 0; j < R; ++j) LANES_FOR r.c[j][k] = blend(m, a.c[j][k], b.c[j][k]);
    return r;
}
LANES_VECTOR void clear(Vector<N, T>& x) { LANES_FOR clear(x.c[k]); }
LANES_MATRIX void clear(Matrix<R, N, T>& x) {
    LANES_UNROLL for (int j = 0; j < R; ++j) LANES_FOR clear(x.c[j][k]);
}

// Set the lanes of `exec`; all lanes have the same arrays.
template<class T, class S> LANES_INLINE void set(T& to, const S& from, Mask exec) { to = blend(exec, T(from), to); }
template<class S> LANES_INLINE void set(wp::array_t<S>& to, const wp::array_t<S>& from, Mask) { to = from; }
// The same if lanes outside of `set_before` may take any value: copying large structs is cheaper than blending them.
template<class T, class S> LANES_INLINE void set_first(T& to, const S& from, Mask exec, Mask set_before) {
    if (bits(set_before) == 0) to = T(from);
    else set(to, from, exec);
}
template<class S> LANES_INLINE wp::array_t<S> blend(Mask, const wp::array_t<S>& a, const wp::array_t<S>& b) {
    return a.data ? a : b;
}

// A value of one lane converted to lanes; lanes stay unchanged.
template<class T, bool is_number = __is_arithmetic(T)> struct LanesOf {
    typedef T type;
};
template<class T> struct LanesOf<T, true> {
    typedef Wide<T> type;
};
template<unsigned N, class S> struct LanesOf<wp::vec_t<N, S>, false> {
    typedef Vector<N, Wide<S>> type;
};
template<class A, class B> LANES_INLINE auto where(Mask m, const A& a, const B& b) {
    return blend(m, typename LanesOf<A>::type(a), typename LanesOf<B>::type(b));
}

#define LANES_BITS(T) \
    LANES_INLINE T bit_xor(T a, T b) { return T(a.v ^ b.v); } \
    LANES_INLINE T bit_and(T a, T b) { return T(a.v & b.v); } \
    LANES_INLINE T bit_or(T a, T b) { return T(a.v | b.v); } \
    LANES_INLINE T invert(T a) { return T(~a.v); } \
    LANES_INLINE T rshift(T a, T b) { return T(a.v >> b.v); } \
    LANES_INLINE T lshift(T a, T b) { return T(a.v << b.v); }
LANES_BITS(Ints)
LANES_BITS(Uints)
LANES_BITS(Longs)
// For constants.
template<class S, bool is_number = __is_arithmetic(S)> struct Constant {};
template<class S> struct Constant<S, true> {
    typedef S type;
};
#define LANES_CONSTANT template<class S> static inline __attribute__((always_inline)) typename Constant<S>::type
LANES_CONSTANT add(S a, S b) { return a + b; }
LANES_CONSTANT sub(S a, S b) { return a - b; }
LANES_CONSTANT mul(S a, S b) { return a * b; }
LANES_CONSTANT div(S a, S b) { return a / b; }
LANES_CONSTANT neg(S a) { return 0 - a; }
LANES_CONSTANT min(S a, S b) { return wp::min(a, b); }
LANES_CONSTANT max(S a, S b) { return wp::max(a, b); }
LANES_CONSTANT clamp(S a, S low, S high) { return min(max(low, a), high); }
LANES_CONSTANT abs(S a) { return wp::abs(a); }
LANES_CONSTANT floordiv(S a, S b) { return wp::floordiv(a, b); }
LANES_CONSTANT mod(S a, S b) { return wp::mod(a, b); }
LANES_CONSTANT bit_xor(S a, S b) { return a ^ b; }
LANES_CONSTANT bit_and(S a, S b) { return a & b; }
LANES_CONSTANT bit_or(S a, S b) { return a | b; }
LANES_CONSTANT rshift(S a, S b) { return a >> b; }
LANES_CONSTANT lshift(S a, S b) { return a << b; }

LANES_INLINE Floats abs(Floats a) { return Floats(__builtin_elementwise_abs(a.v)); }
LANES_INLINE Ints abs(Ints a) { return Ints(__builtin_elementwise_abs(a.v)); }
LANES_INLINE Longs abs(Longs a) { return Longs(__builtin_elementwise_abs(a.v)); }
LANES_INLINE Doubles abs(Doubles a) { return Doubles(__builtin_elementwise_abs(a.v)); }
LANES_INLINE Floats sign(Floats a) { return Floats(a.v < 0.0f ? (floats)-1.0f : (floats)1.0f); }
LANES_INLINE Ints sign(Ints a) { return Ints(a.v < 0 ? (ints)-1 : (ints)1); }
LANES_INLINE Floats floor(Floats a) { return Floats(__builtin_elementwise_floor(a.v)); }
LANES_INLINE Doubles floor(Doubles a) { return Doubles(__builtin_elementwise_floor(a.v)); }
LANES_INLINE Floats ceil(Floats a) { return Floats(__builtin_elementwise_ceil(a.v)); }
LANES_INLINE Floats sqrt(Floats a) { return Floats(__builtin_elementwise_sqrt(a.v)); }
LANES_INLINE Doubles sqrt(Doubles a) { return Doubles(__builtin_elementwise_sqrt(a.v)); }
LANES_INLINE float sqrt(float a) { return wp::sqrt(a); }
LANES_INLINE double sqrt(double a) { return wp::sqrt(a); }
LANES_INLINE Floats lerp(Floats a, Floats b, Floats t) { return Floats(a.v * (1.0f - t.v) + b.v * t.v); }
LANES_INLINE Mask isfinite(Floats a) {
    return Mask::of(__builtin_elementwise_abs(a.v) <= 3.4028235e38f);
}
LANES_INLINE Floats div(Floats a, Floats b) { return Floats(a.v / b.v); }
LANES_INLINE Doubles div(Doubles a, Doubles b) { return Doubles(a.v / b.v); }
// Inactive lanes may divide by 0. Doubles hold 32-bit integers exactly; no quotient is rounded to the next integer.
LANES_INLINE Ints div(Ints a, Ints b) {
    const ints divisor = b.v == 0 ? (ints)1 : b.v;
    const doubles quotient = __builtin_convertvector(a.v, doubles) / __builtin_convertvector(divisor, doubles);
    return Ints(__builtin_convertvector(quotient, ints));
}
LANES_INLINE Ints mod(Ints a, Ints b) { return Ints(a.v - div(a, b).v * b.v); }
LANES_INLINE Ints floordiv(Ints a, Ints b) {
    const ints quotient = div(a, b).v, rest = a.v - quotient * b.v;
    return Ints(quotient + ((rest != 0) & ((rest ^ b.v) < 0)));
}
LANES_INLINE Uints div(Uints a, Uints b) { return Uints(a.v / (b.v == 0u ? (uints)1u : b.v)); }
LANES_INLINE Uints mod(Uints a, Uints b) { return Uints(a.v % (b.v == 0u ? (uints)1u : b.v)); }
LANES_INLINE Uints floordiv(Uints a, Uints b) { return div(a, b); }
LANES_INLINE Longs div(Longs a, Longs b) { return Longs(a.v / (b.v == 0 ? (longs)1 : b.v)); }
LANES_INLINE Longs mod(Longs a, Longs b) { return Longs(a.v % (b.v == 0 ? (longs)1 : b.v)); }

// Functions without an instruction call Warp's own, lane by lane.
#define LANES_OF_ONE(NAME) \
    LANES_INLINE Floats NAME(Floats a) { \
        Floats r; \
        for (int l = 0; l < WIDTH; ++l) r.v[l] = wp::NAME(a.v[l]); \
        return r; \
    }
#define LANES_OF_TWO(NAME) \
    LANES_INLINE Floats NAME(Floats a, Floats b) { \
        Floats r; \
        for (int l = 0; l < WIDTH; ++l) r.v[l] = wp::NAME(a.v[l], b.v[l]); \
        return r; \
    }
LANES_OF_ONE(sin)
LANES_OF_ONE(cos)
LANES_OF_ONE(tan)
LANES_OF_ONE(acos)
LANES_OF_ONE(asin)
LANES_OF_ONE(atan)
LANES_OF_ONE(exp)
LANES_OF_ONE(log)
LANES_OF_ONE(log2)
LANES_OF_ONE(erf)
LANES_OF_ONE(erfc)
LANES_OF_ONE(erfinv)
LANES_OF_ONE(tanh)
LANES_OF_TWO(atan2)
LANES_OF_TWO(pow)

// Conversions

#define LANES_CONVERSION(NAME, TO, VECTOR, ELEMENT) \
    template<class S> LANES_INLINE TO NAME(S a) { \
        if constexpr (__is_arithmetic(S)) return TO((ELEMENT)a); \
        else return TO(__builtin_convertvector(a.v, VECTOR)); \
    } \
    LANES_INLINE TO NAME(Mask a) { return TO(choose(a, (VECTOR)1, (VECTOR)0)); }
LANES_CONVERSION(to_float32, Floats, floats, float)
LANES_CONVERSION(to_int32, Ints, ints, int)
LANES_CONVERSION(to_uint32, Uints, uints, unsigned)
LANES_CONVERSION(to_int64, Longs, longs, long long)
LANES_CONVERSION(to_float64, Doubles, doubles, double)
LANES_INLINE Mask to_bool(bool a) { return a; }
LANES_INLINE Mask to_bool(Mask a) { return a; }
LANES_INLINE Ints cast_int32(Floats a) { return Ints(__builtin_bit_cast(ints, a.v)); }
LANES_INLINE Uints cast_uint32(Floats a) { return Uints(__builtin_bit_cast(uints, a.v)); }
LANES_INLINE Floats cast_float32(Ints a) { return Floats(__builtin_bit_cast(floats, a.v)); }
LANES_INLINE Floats cast_float32(Uints a) { return Floats(__builtin_bit_cast(floats, a.v)); }
template<class T> LANES_INLINE T copy(const T& a) { return a; }

// Vectors and matrices

#define LANES_OF_EACH(NAME) \
    LANES_VECTOR Vector<N, T> NAME(const Vector<N, T>& a) { \
        Vector<N, T> r; \
        LANES_FOR r.c[k] = NAME(a.c[k]); \
        return r; \
    }
#define LANES_OF_PAIRS(NAME, OF_NUMBERS) \
    LANES_VECTOR Vector<N, T> NAME(const Vector<N, T>& a, const Vector<N, T>& b) { \
        Vector<N, T> r; \
        LANES_FOR r.c[k] = OF_NUMBERS(a.c[k], b.c[k]); \
        return r; \
    }
LANES_VECTOR Vector<N, T> neg(const Vector<N, T>& a) {
    Vector<N, T> r;
    LANES_FOR r.c[k] = T(-a.c[k].v);  // for 0 it is -0, unlike the negation of numbers
    return r;
}
LANES_OF_EACH(abs)
LANES_OF_PAIRS(add, add)
LANES_OF_PAIRS(sub, sub)
LANES_OF_PAIRS(cw_mul, mul)
LANES_OF_PAIRS(cw_div, div)
LANES_OF_PAIRS(min, min)
LANES_OF_PAIRS(max, max)
LANES_VECTOR Vector<N, T> mul(const Vector<N, T>& a, same<T> b) {
    Vector<N, T> r;
    LANES_FOR r.c[k] = mul(a.c[k], b);
    return r;
}
LANES_VECTOR Vector<N, T> mul(same<T> b, const Vector<N, T>& a) { return mul(a, b); }
LANES_VECTOR Vector<N, T> div(const Vector<N, T>& a, same<T> b) {
    Vector<N, T> r;
    LANES_FOR r.c[k] = div(a.c[k], b);
    return r;
}
LANES_VECTOR Vector<N, T> lerp(const Vector<N, T>& a, const Vector<N, T>& b, Floats t) {
    Vector<N, T> r;
    LANES_FOR r.c[k] = lerp(a.c[k], b.c[k], t);
    return r;
}
LANES_VECTOR T min(const Vector<N, T>& a) {
    T r = a.c[0];
    LANES_UNROLL for (int k = 1; k < N; ++k) r = min(r, a.c[k]);
    return r;
}
LANES_VECTOR T max(const Vector<N, T>& a) {
    T r = a.c[0];
    LANES_UNROLL for (int k = 1; k < N; ++k) r = max(r, a.c[k]);
    return r;
}
LANES_VECTOR T dot(const Vector<N, T>& a, const Vector<N, T>& b) {
    T r = mul(a.c[0], b.c[0]);
    if constexpr (N > 3) r = add(T(0), r);  // not -0
    LANES_UNROLL for (int k = 1; k < N; ++k) r = add(r, mul(a.c[k], b.c[k]));
    return r;
}
LANES_VECTOR T length_sq(const Vector<N, T>& a) { return dot(a, a); }
LANES_VECTOR T length(const Vector<N, T>& a) { return sqrt(dot(a, a)); }
LANES_VECTOR Vector<N, T> normalize(const Vector<N, T>& a) {
    const T size = length(a);
    const Mask some = size > T(0);
    const T divisor = blend(some, size, T(1));
    Vector<N, T> r;
    LANES_FOR r.c[k] = blend(some, div(a.c[k], divisor), T(0));
    return r;
}
template<class T> LANES_INLINE Vector<3, T> cross(const Vector<3, T>& a, const Vector<3, T>& b) {
    Vector<3, T> r;
    r.c[0] = sub(mul(a.c[1], b.c[2]), mul(a.c[2], b.c[1]));
    r.c[1] = sub(mul(a.c[2], b.c[0]), mul(a.c[0], b.c[2]));
    r.c[2] = sub(mul(a.c[0], b.c[1]), mul(a.c[1], b.c[0]));
    return r;
}
LANES_VECTOR Mask isfinite(const Vector<N, T>& a) {
    Mask r = isfinite(a.c[0]);
    LANES_UNROLL for (int k = 1; k < N; ++k) r = r & isfinite(a.c[k]);
    return r;
}
LANES_VECTOR Mask operator==(const Vector<N, T>& a, const Vector<N, T>& b) {
    Mask r = a.c[0] == b.c[0];
    LANES_UNROLL for (int k = 1; k < N; ++k) r = r & (a.c[k] == b.c[k]);
    return r;
}
LANES_VECTOR Mask operator!=(const Vector<N, T>& a, const Vector<N, T>& b) { return ~(a == b); }
LANES_MATRIX Vector<R, T> mul(const Matrix<R, N, T>& a, const Vector<N, T>& b) {
    Vector<R, T> r;
    LANES_UNROLL for (int j = 0; j < R; ++j) {
        r.c[j] = mul(a.c[j][0], b.c[0]);
        LANES_UNROLL for (int k = 1; k < N; ++k) r.c[j] = add(r.c[j], mul(a.c[j][k], b.c[k]));
    }
    return r;
}
LANES_MATRIX Matrix<R, N, T> mul(const Matrix<R, N, T>& a, same<T> b) {
    Matrix<R, N, T> r;
    LANES_UNROLL for (int j = 0; j < R; ++j) LANES_FOR r.c[j][k] = mul(a.c[j][k], b);
    return r;
}
LANES_MATRIX Matrix<R, N, T> add(const Matrix<R, N, T>& a, const Matrix<R, N, T>& b) {
    Matrix<R, N, T> r;
    LANES_UNROLL for (int j = 0; j < R; ++j) LANES_FOR r.c[j][k] = add(a.c[j][k], b.c[j][k]);
    return r;
}
LANES_MATRIX Matrix<N, R, T> transpose(const Matrix<R, N, T>& a) {
    Matrix<N, R, T> r;
    LANES_UNROLL for (int j = 0; j < R; ++j) LANES_FOR r.c[k][j] = a.c[j][k];
    return r;
}

// From nothing, from one number for all elements, from another vector, or from each element.
template<class T, int N, class S> LANES_INLINE void fill(Vector<N, T>& r, const S& x) { LANES_FOR r.c[k] = T(x); }
template<class T, int N> LANES_INLINE void fill(Vector<N, T>& r, const Vector<N, T>& x) { r = x; }
template<class T, int N, class S> LANES_INLINE void fill(Vector<N, T>& r, const Vector<N, S>& x) {
    LANES_FOR r.c[k] = T(__builtin_convertvector(x.c[k].v, decltype(r.c[k].v)));
}
template<int N, class T, class... A> LANES_INLINE Vector<N, T> make_vec(A... a) {
    Vector<N, T> r;
    if constexpr (sizeof...(a) == 0) clear(r);
    else if constexpr (sizeof...(a) == 1) (fill(r, a), ...);
    else {
        int k = 0;
        ((r.c[k++] = T(a)), ...);
    }
    return r;
}
template<int R, int N, class T, class... A> LANES_INLINE Matrix<R, N, T> make_mat(A... a) {
    Matrix<R, N, T> r;
    if constexpr (sizeof...(a) == 0) clear(r);
    else if constexpr (sizeof...(a) == 1) {
        LANES_UNROLL for (int j = 0; j < R; ++j) LANES_FOR r.c[j][k] = (T(a), ...);
    } else {
        int k = 0;
        ((r.c[k / N][k % N] = T(a), ++k), ...);
    }
    return r;
}
} // namespace lanes
