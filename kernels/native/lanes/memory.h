#pragma once
// Several lanes at once: elements, arrays, single lanes, ranges.
#include "lanes/numbers.h"
#include "lanes/processors.h"

namespace lanes {
// Elements of vectors and matrices, at a constant index or at one for each lane; negative constants count from the end.
// Rows beyond the end of a matrix are zero: a material may store few of its values.

LANES_VECTOR T extract(const Vector<N, T>& a, int k) { return a.c[k < 0 ? k + N : k]; }
LANES_VECTOR T extract(const Vector<N, T>& a, Ints i) {
    T r = a.c[0];
    LANES_UNROLL for (int k = 1; k < N; ++k) r = blend(i == Ints(k), a.c[k], r);
    return r;
}
LANES_MATRIX Vector<N, T> extract(const Matrix<R, N, T>& a, int j) {
    Vector<N, T> r;
    clear(r);
    if (j < R) LANES_FOR r.c[k] = a.c[j < 0 ? j + R : j][k];
    return r;
}
LANES_MATRIX T extract(const Matrix<R, N, T>& a, int j, int k) { return extract(a, j).c[k < 0 ? k + N : k]; }
LANES_MATRIX Vector<N, T> extract(const Matrix<R, N, T>& a, Ints i) {
    Vector<N, T> r = extract(a, 0);
    LANES_UNROLL for (int j = 1; j < R; ++j) LANES_FOR r.c[k] = blend(i == Ints(j), a.c[j][k], r.c[k]);
    return r;
}
LANES_INLINE int extract(const wp::shape_t& a, int k) { return a.dims[k]; }

LANES_VECTOR void assign_inplace(Vector<N, T>& a, int k, same<T> x, Mask exec) { set(a.c[k < 0 ? k + N : k], x, exec); }
LANES_VECTOR void assign_inplace(Vector<N, T>& a, Ints i, same<T> x, Mask exec) {
    LANES_FOR set(a.c[k], x, exec & (i == Ints(k)));
}
LANES_MATRIX void assign_inplace(Matrix<R, N, T>& a, int j, const Vector<N, T>& x, Mask exec) {
    LANES_FOR set(a.c[j < 0 ? j + R : j][k], x.c[k], exec);
}
LANES_MATRIX void assign_inplace(Matrix<R, N, T>& a, Ints i, const Vector<N, T>& x, Mask exec) {
    LANES_UNROLL for (int j = 0; j < R; ++j) LANES_FOR set(a.c[j][k], x.c[k], exec & (i == Ints(j)));
}
LANES_MATRIX void assign_inplace(Matrix<R, N, T>& a, int j, int k, same<T> x, Mask exec) {
    set(a.c[j < 0 ? j + R : j][k < 0 ? k + N : k], x, exec);
}

// An element of a struct's vector or a row of its matrix, in place of Warp's pointer.
template<class Of, class I> struct Element {
    Of* of;
    I i;
    Element operator*() const { return *this; }
};
template<class Of, class I> LANES_INLINE Element<Of, I> indexref(Of* a, I i) { return {a, i}; }
template<int N, class T, class I> LANES_INLINE void set(const Element<Vector<N, T>, I>& to, const same<T>& x, Mask exec) {
    assign_inplace(*to.of, to.i, x, exec);
}
template<int R, int N, class T, class I>
LANES_INLINE void set(const Element<Matrix<R, N, T>, I>& to, const same<Vector<N, T>>& x, Mask exec) {
    assign_inplace(*to.of, to.i, x, exec);
}

// Single lanes

#define LANES_FUNCTION(name) [](const auto&... a) -> decltype(lanes::name(a...)) { return lanes::name(a...); }
// The result of `wide` if it takes these arguments, else that of `each`, which calls a function for one lane at a time.
template<class W, class E, class... A>
LANES_INLINE auto either(int, W wide, E, const A&... a) -> decltype(wide(a...)) { return wide(a...); }
template<class W, class E, class... A> LANES_INLINE auto either(long, W, E each, const A&...) { return each(); }

template<class T> LANES_INLINE auto lane(const T& x, int l) -> decltype(x.lane(l)) { return x.lane(l); }
template<class S> LANES_INLINE const wp::array_t<S>& lane(const wp::array_t<S>& x, int) { return x; }
template<class E, class V> LANES_INLINE E lane(const Number<E, V>& x, int l) { return x.v[l]; }
LANES_INLINE bool lane(const Mask& x, int l) { return bits(x) >> l & 1; }
LANES_VECTOR auto lane(const Vector<N, T>& x, int l) {
    wp::vec_t<N, decltype(lane(x.c[0], l))> r;
    LANES_FOR r[k] = lane(x.c[k], l);
    return r;
}
LANES_MATRIX auto lane(const Matrix<R, N, T>& x, int l) {
    wp::mat_t<R, N, decltype(lane(x.c[0][0], l))> r;
    LANES_UNROLL for (int j = 0; j < R; ++j) LANES_FOR r.data[j][k] = lane(x.c[j][k], l);
    return r;
}
template<class E, class V> LANES_INLINE void set_lane(Number<E, V>& x, int l, E s) { x.v[l] = s; }
LANES_INLINE void set_lane(Mask& x, int l, bool s) { x = of_bits((bits(x) & ~(1u << l)) | ((unsigned)s << l)); }
template<int N, class T, class S> LANES_INLINE void set_lane(Vector<N, T>& x, int l, const S& s) {
    LANES_FOR set_lane(x.c[k], l, s[k]);
}
template<int R, int N, class T, class S> LANES_INLINE void set_lane(Matrix<R, N, T>& x, int l, const S& s) {
    LANES_UNROLL for (int j = 0; j < R; ++j) LANES_FOR set_lane(x.c[j][k], l, s.data[j][k]);
}
// Warp's own function, called lane by lane.
LANES_MATRIX Matrix<R, N, T> inverse(const Matrix<R, N, T>& a) {
    Matrix<R, N, T> r;
    for (int l = 0; l < WIDTH; ++l) set_lane(r, l, wp::inverse(lane(a, l)));
    return r;
}
#define LANES_EACH(l, mask) \
    for (unsigned rest_##l = lanes::bits(mask), l = 0; rest_##l && (l = __builtin_ctz(rest_##l), true); \
         rest_##l &= rest_##l - 1)

// Arrays. A field at OFFSET bytes in a record of SIZE bytes, for the record of each lane.

template<class T, int OFFSET, int SIZE> struct Place {
    const char* base;
    ints record;  // in bytes: arrays of less than 2 GB
};
// Inactive lanes read the first record. If all are inactive, as after each has returned, there may be no record.
alignas(64) static const char nothing[1024] = {};
template<class T> LANES_INLINE Place<T, 0, sizeof(T)> address(const wp::array_t<T>& a, Ints i) {
    static_assert(sizeof(T) <= sizeof(nothing), "room for one record");
    return {a.data ? (const char*)a.data : nothing, i.v * (int)sizeof(T)};
}
template<class T> struct Bare {
    typedef T type;
};
template<class T> struct Bare<T&> : Bare<T> {};
template<class T> struct Bare<const T> : Bare<T> {};
template<class M, int BY, class T, int OFFSET, int SIZE>
LANES_INLINE Place<typename Bare<M>::type, OFFSET + BY, SIZE> member(Place<T, OFFSET, SIZE> p) {
    return {p.base, p.record};
}
#define LANES_MEMBER(array, index, field) \
    lanes::member<decltype((array).data->field), \
                  (int)__builtin_offsetof(lanes::Bare<decltype(*(array).data)>::type, field)>( \
        lanes::address(array, index))

typedef float f4_anywhere __attribute__((ext_vector_type(4), aligned(4)));
typedef float f8 __attribute__((ext_vector_type(8)));

// The numbers at(first), at(first + 4) and so on, side by side.
template<class At> LANES_INLINE floats joined(At at, int first) {
#if LANES_WIDTH == 4
    return at(first);
#else
    const f8 ab = __builtin_shufflevector(at(first), at(first + 4), 0, 1, 2, 3, 4, 5, 6, 7);
#if LANES_WIDTH == 8
    return ab;
#else
    const f8 cd = __builtin_shufflevector(at(first + 8), at(first + 12), 0, 1, 2, 3, 4, 5, 6, 7);
    return __builtin_shufflevector(ab, cd, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
#endif
#endif
}
struct FourRows {
    floats r[4];
};
// Transpose four numbers of each lane, at(lane), to four rows of all lanes.
template<class At> LANES_INLINE FourRows transposed(At at) {
    const floats a = joined(at, 0), b = joined(at, 1), c = joined(at, 2), d = joined(at, 3);
    constexpr int W = WIDTH;  // numbers of the second vector begin there
#define LANES_LOW(p, q) __builtin_shufflevector(p, q, LANES_FIRST_OF( \
    0, W, 1, W + 1, 4, W + 4, 5, W + 5, 8, W + 8, 9, W + 9, 12, W + 12, 13, W + 13))
#define LANES_HIGH(p, q) __builtin_shufflevector(p, q, LANES_FIRST_OF( \
    2, W + 2, 3, W + 3, 6, W + 6, 7, W + 7, 10, W + 10, 11, W + 11, 14, W + 14, 15, W + 15))
    const floats ab = LANES_LOW(a, b), cd = LANES_LOW(c, d), ab_high = LANES_HIGH(a, b), cd_high = LANES_HIGH(c, d);
#define LANES_FIRST(p, q) __builtin_shufflevector(p, q, LANES_FIRST_OF( \
    0, 1, W, W + 1, 4, 5, W + 4, W + 5, 8, 9, W + 8, W + 9, 12, 13, W + 12, W + 13))
#define LANES_LAST(p, q) __builtin_shufflevector(p, q, LANES_FIRST_OF( \
    2, 3, W + 2, W + 3, 6, 7, W + 6, W + 7, 10, 11, W + 10, W + 11, 14, 15, W + 14, W + 15))
    return {{LANES_FIRST(ab, cd), LANES_LAST(ab, cd), LANES_FIRST(ab_high, cd_high), LANES_LAST(ab_high, cd_high)}};
}
template<class S, class V> LANES_INLINE V gather_one_by_one(const char* base, ints record) {
    typedef S numbers __attribute__((ext_vector_type(WIDTH)));
    numbers found;
    LANES_UNROLL for (int l = 0; l < WIDTH; ++l) found[l] = *(const S*)(base + record[l]);
    return __builtin_convertvector(found, V);
}

// Four bytes of each lane's record. The processor's gather takes 40 cycles for sixteen numbers (Zen 4); a load per lane
// and a transposition give four neighbours in less, and the compiler removes unused ones.
template<int OFFSET, int SIZE> LANES_INLINE floats row(const char* base, ints record, Mask exec) {
    const ints safe = choose(exec, record, (ints)0);
    if constexpr (SIZE == 4) {
        return gathered(base, record, exec);
    } else if constexpr (SIZE == 8) {
        const auto at = [&](int l) __attribute__((always_inline)) { return *(const double_anywhere*)(base + safe[l]); };
        typedef double half __attribute__((ext_vector_type(WIDTH / 2)));
        half low, high;
        LANES_UNROLL for (int l = 0; l < WIDTH / 2; ++l) low[l] = at(l), high[l] = at(WIDTH / 2 + l);
        const floats a = __builtin_bit_cast(floats, low), b = __builtin_bit_cast(floats, high);
        if constexpr (OFFSET == 0)
            return __builtin_shufflevector(
                a, b, LANES_FIRST_OF(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30));
        else return __builtin_shufflevector(
            a, b, LANES_FIRST_OF(1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31));
    } else if constexpr (SIZE == 12) {
        return transposed([&](int l) __attribute__((always_inline)) { return three(base + safe[l]); }).r[OFFSET / 4];
    } else {
        constexpr int begin = (OFFSET & ~15) + 16 <= SIZE ? (OFFSET & ~15) : SIZE - 16;
        return transposed([&](int l) __attribute__((always_inline)) {
                   return (f4) * (const f4_anywhere*)(base + begin + safe[l]);
               })
            .r[(OFFSET - begin) / 4];
    }
}

// `gather<OFFSET, SIZE>(base, record, pointer to its type, exec)`: a field of each lane's record.
template<int OFFSET, int SIZE, class S> LANES_INLINE Wide<S> gather(const char* base, ints record, S*, Mask exec) {
    typedef decltype(Wide<S>().v) V;
    const ints safe = choose(exec, record, (ints)0);
    if constexpr (sizeof(S) == 4) return Wide<S>(__builtin_bit_cast(V, row<OFFSET, SIZE>(base, record, exec)));
    else if constexpr (sizeof(S) == 8) return Wide<S>(gather_one_by_one<S, V>(base + OFFSET, safe));
    else if constexpr (__is_same(S, bool))
        return gather<OFFSET, SIZE>(base, record, (wp::uint8*)nullptr, exec) != Uints(0u);
    else if constexpr (SIZE % 4 == 0) {
        const uints four_bytes = __builtin_bit_cast(uints, row<(OFFSET & ~3), SIZE>(base, record, exec));
        return Uints((four_bytes >> (8 * (OFFSET & 3))) & (unsigned)(S)-1);
    } else return Uints(gather_one_by_one<S, uints>(base + OFFSET, safe));
}
template<int OFFSET, int SIZE, int K, int N, class T, class S>
LANES_INLINE void gather_elements(T* elements, const char* base, ints record, S* p, Mask exec) {
    if constexpr (K < N) {
        elements[K] = gather<OFFSET + K * (int)sizeof(S), SIZE>(base, record, p, exec);
        gather_elements<OFFSET, SIZE, K + 1, N>(elements, base, record, p, exec);
    }
}
template<int OFFSET, int SIZE, unsigned N, class S>
LANES_INLINE Vector<N, Wide<S>> gather(const char* base, ints record, wp::vec_t<N, S>*, Mask exec) {
    Vector<N, Wide<S>> r;
    gather_elements<OFFSET, SIZE, 0, N>(r.c, base, record, (S*)nullptr, exec);
    return r;
}
template<int OFFSET, int SIZE, unsigned R, unsigned N, class S>
LANES_INLINE Matrix<R, N, Wide<S>> gather(const char* base, ints record, wp::mat_t<R, N, S>*, Mask exec) {
    Matrix<R, N, Wide<S>> r;
    gather_elements<OFFSET, SIZE, 0, R * N>(r.c[0], base, record, (S*)nullptr, exec);
    return r;
}

template<class T, int OFFSET, int SIZE> LANES_INLINE Wide<T> load(Place<T, OFFSET, SIZE> p, Mask exec) {
    return gather<OFFSET, SIZE>(p.base, p.record, (T*)nullptr, exec);
}
// An element of an array of two dimensions.
template<class T> struct Place2 {
    const wp::array_t<T>* of;
    Ints i, j;
};
template<class T> LANES_INLINE Place2<T> address(const wp::array_t<T>& a, Ints i, Ints j) { return {&a, i, j}; }
template<class T> LANES_INLINE Wide<T> load(const Place2<T>& p, Mask exec) {
    Wide<T> r;
    clear(r);
    LANES_EACH(l, exec) set_lane(r, l, *wp::address(*p.of, p.i.v[l], p.j.v[l]));
    return r;
}
template<class T> LANES_INLINE T load(T* p, Mask) { return *p; }
template<class T> LANES_INLINE T load(const T& p, Mask) { return p; }

template<class T> LANES_INLINE void array_store(const wp::array_t<T>& a, Ints i, const Wide<T>& x, Mask exec) {
    LANES_EACH(l, exec) a.data[i.v[l]] = lane(x, l);
}
template<class T> LANES_INLINE void array_store(const wp::array_t<T>& a, Ints i, Ints j, const Wide<T>& x, Mask exec) {
    LANES_EACH(l, exec) wp::array_store(a, i.v[l], j.v[l], lane(x, l));
}

template<class T> LANES_INLINE Wide<T> atomic_add(const wp::array_t<T>& a, Ints i, Wide<T> x, Mask exec) {
    Wide<T> before;
    LANES_EACH(l, exec) before.v[l] = wp::atomic_add(a, i.v[l], x.v[l]);
    return before;
}
// Lanes that add to one sum do so at once, unless that may overflow unnoticed. All of them then return the same old sum.
LANES_INLINE Longs add_exactly(const wp::array_t<wp::int64>& sums, Ints i, Longs x, Mask exec) {
    Longs before;
    const Mask large = exec & ~(abs(x) < Longs(1ll << 57));
    unsigned left = bits(exec);
    while (left) {
        const int first = __builtin_ctz(left), place = i.v[first];
        const unsigned here = any(large) ? 1u << first : left & bits(i == Ints(place));
        const long long total = __builtin_reduce_add(choose(of_bits(here), x.v, (longs)0));
        set(before, Longs(__atomic_fetch_add(&sums.data[place], total, __ATOMIC_RELAXED)), of_bits(here));
        left &= ~here;
    }
    return before;
}

// Ranges

struct Range {
    Ints i, end, step;
};
LANES_INLINE Range range(Ints end) { return {Ints(0), end, Ints(1)}; }
LANES_INLINE Range range(Ints begin, Ints end) { return {begin, end, Ints(1)}; }
LANES_INLINE Range range(Ints begin, Ints end, Ints step) { return {begin, end, step}; }
LANES_INLINE Range blend(Mask m, const Range& a, const Range& b) {
    return {blend(m, a.i, b.i), blend(m, a.end, b.end), blend(m, a.step, b.step)};
}
LANES_INLINE Mask more(const Range& r) {
    const Mask up = r.step > Ints(0);
    return (up & (r.i < r.end)) | (~up & (r.i > r.end));
}
LANES_INLINE Ints next(Range& r, Mask exec) {
    const Ints i = r.i;
    set(r.i, add(r.i, r.step), exec);
    return i;
}
LANES_INLINE Ints lane_numbers() {
    return Ints((ints){LANES_FIRST_OF(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15)});
}

// Lanes from one group to another: those at the set bits of `from` go, in order, to those of `to`.

struct Move {
    unsigned short from, to;
};
template<class E, class V> LANES_INLINE void move(Number<E, V>& to, const Number<E, V>& x, Move m) {
    if constexpr (sizeof(V) == sizeof(ints)) {
        to.v = __builtin_bit_cast(
            V, moved(__builtin_bit_cast(ints, x.v), m.from, __builtin_bit_cast(ints, to.v), m.to));
        return;
    }
    for (; m.from; m.from &= m.from - 1, m.to &= m.to - 1) to.v[__builtin_ctz(m.to)] = x.v[__builtin_ctz(m.from)];
}
LANES_INLINE void move(Range& to, const Range& x, Move m) {
    move(to.i, x.i, m);
    move(to.end, x.end, m);
    move(to.step, x.step, m);
}
LANES_INLINE void move(Mask& to, const Mask& x, Move m) {
    Ints numbers = to_int32(to);
    move(numbers, to_int32(x), m);
    to = numbers != Ints(0);
}
LANES_VECTOR void move(Vector<N, T>& to, const Vector<N, T>& x, Move m) { LANES_FOR move(to.c[k], x.c[k], m); }
LANES_MATRIX void move(Matrix<R, N, T>& to, const Matrix<R, N, T>& x, Move m) {
    LANES_UNROLL for (int j = 0; j < R; ++j) LANES_FOR move(to.c[j][k], x.c[j][k], m);
}
// The lowest `count` set bits of `places`, or all.
LANES_INLINE unsigned first_of(unsigned places, int count) {
    unsigned r = 0;
    for (; count > 0; --count, places &= places - 1) r |= places & -places;
    return r;
}
} // namespace lanes
