// Sixteen lanes at once: elements, arrays, single lanes, ranges. After numbers.h.

namespace lanes {
// Elements of vectors and matrices, at a place that is known or that each lane has for itself; a known one that is
// negative counts from the end. Rows that a matrix has not are zero: of a material's values, few may be kept.

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

// Where an element of a struct's vector is, or a row of its matrix: what Warp has as a pointer.
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
// By Warp's own function, lane by lane.
LANES_MATRIX Matrix<R, N, T> inverse(const Matrix<R, N, T>& a) {
    Matrix<R, N, T> r;
    for (int l = 0; l < WIDTH; ++l) set_lane(r, l, wp::inverse(lane(a, l)));
    return r;
}
#define LANES_EACH(l, mask) \
    for (unsigned rest_##l = lanes::bits(mask), l = 0; rest_##l && (l = __builtin_ctz(rest_##l), true); \
         rest_##l &= rest_##l - 1)

// Arrays. A field, OFFSET bytes after the begin of a record of SIZE bytes, in every lane's record of an array.

template<class T, int OFFSET, int SIZE> struct Place {
    const char* base;
    i16 record;  // in bytes: arrays of less than 2 GB
};
// Lanes that are elsewhere read the first record. Where all are, as after each has returned, there may be no record.
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

typedef float f4 __attribute__((ext_vector_type(4)));
typedef float f4_anywhere __attribute__((ext_vector_type(4), aligned(4)));
typedef float f8 __attribute__((ext_vector_type(8)));
typedef double double_anywhere __attribute__((aligned(4)));
typedef double d2 __attribute__((ext_vector_type(2)));
typedef double d8 __attribute__((ext_vector_type(8)));

LANES_INLINE f16 joined(f4 a, f4 b, f4 c, f4 d) {
    const f8 ab = __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7);
    const f8 cd = __builtin_shufflevector(c, d, 0, 1, 2, 3, 4, 5, 6, 7);
    return __builtin_shufflevector(ab, cd, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
}
struct FourRows {
    f16 r[4];
};
// Four numbers of each lane, at(lane), as four rows of all lanes.
template<class At> LANES_INLINE FourRows transposed(At at) {
    const f16 a = joined(at(0), at(4), at(8), at(12)), b = joined(at(1), at(5), at(9), at(13));
    const f16 c = joined(at(2), at(6), at(10), at(14)), d = joined(at(3), at(7), at(11), at(15));
#define LANES_LOW(p, q) __builtin_shufflevector(p, q, 0, 16, 1, 17, 4, 20, 5, 21, 8, 24, 9, 25, 12, 28, 13, 29)
#define LANES_HIGH(p, q) __builtin_shufflevector(p, q, 2, 18, 3, 19, 6, 22, 7, 23, 10, 26, 11, 27, 14, 30, 15, 31)
    const f16 ab = LANES_LOW(a, b), cd = LANES_LOW(c, d), ab_high = LANES_HIGH(a, b), cd_high = LANES_HIGH(c, d);
#define LANES_FIRST(p, q) __builtin_shufflevector(p, q, 0, 1, 16, 17, 4, 5, 20, 21, 8, 9, 24, 25, 12, 13, 28, 29)
#define LANES_LAST(p, q) __builtin_shufflevector(p, q, 2, 3, 18, 19, 6, 7, 22, 23, 10, 11, 26, 27, 14, 15, 30, 31)
    return {{LANES_FIRST(ab, cd), LANES_LAST(ab, cd), LANES_FIRST(ab_high, cd_high), LANES_LAST(ab_high, cd_high)}};
}
template<class S, class V> LANES_INLINE V gather_one_by_one(const char* base, i16 record) {
    typedef S numbers __attribute__((ext_vector_type(16)));
    numbers found;
    LANES_UNROLL for (int l = 0; l < WIDTH; ++l) found[l] = *(const S*)(base + record[l]);
    return __builtin_convertvector(found, V);
}

// Four bytes of every lane's record. The processor's gather takes 40 cycles for sixteen numbers (Zen 4); a load for
// each lane and a transposition give four neighbours in less, of which the compiler leaves out what nobody needs.
template<int OFFSET, int SIZE> LANES_INLINE f16 row(const char* base, i16 record, Mask exec) {
    const i16 safe = exec.v ? record : (i16)0;
    if constexpr (SIZE == 4) {
#if defined(__AVX512F__)
        return (f16)__builtin_ia32_gathersiv16sf((f16)0.0f, base, record, bits(exec), 1);
#else
        return gather_one_by_one<float, f16>(base, safe);
#endif
    } else if constexpr (SIZE == 8) {
        const auto at = [&](int l) __attribute__((always_inline)) { return *(const double_anywhere*)(base + safe[l]); };
        const d8 low = {at(0), at(1), at(2), at(3), at(4), at(5), at(6), at(7)};
        const d8 high = {at(8), at(9), at(10), at(11), at(12), at(13), at(14), at(15)};
        const f16 a = __builtin_bit_cast(f16, low), b = __builtin_bit_cast(f16, high);
        if constexpr (OFFSET == 0)
            return __builtin_shufflevector(a, b, 0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
        else return __builtin_shufflevector(a, b, 1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
    } else if constexpr (SIZE == 12) {
        return transposed([&](int l) __attribute__((always_inline)) {
                   const char* p = base + safe[l];
                   f4 v = __builtin_bit_cast(f4, (d2){*(const double_anywhere*)p, 0.0});
                   v[2] = *(const float*)(p + 8);
                   return v;
               })
            .r[OFFSET / 4];
    } else {
        constexpr int begin = (OFFSET & ~15) + 16 <= SIZE ? (OFFSET & ~15) : SIZE - 16;
        return transposed([&](int l) __attribute__((always_inline)) {
                   return (f4) * (const f4_anywhere*)(base + begin + safe[l]);
               })
            .r[(OFFSET - begin) / 4];
    }
}

// `gather<OFFSET, SIZE>(base, record, pointer to its type, exec)`: a field of every lane's record.
template<int OFFSET, int SIZE> LANES_INLINE Floats gather(const char* base, i16 record, float*, Mask exec) {
    return Floats(row<OFFSET, SIZE>(base, record, exec));
}
template<int OFFSET, int SIZE> LANES_INLINE Ints gather(const char* base, i16 record, int*, Mask exec) {
    return cast_int32(Floats(row<OFFSET, SIZE>(base, record, exec)));
}
template<int OFFSET, int SIZE> LANES_INLINE Uints gather(const char* base, i16 record, unsigned*, Mask exec) {
    return cast_uint32(Floats(row<OFFSET, SIZE>(base, record, exec)));
}
template<int OFFSET, int SIZE> LANES_INLINE Doubles gather(const char* base, i16 record, double*, Mask exec) {
    return Doubles(gather_one_by_one<double, d16>(base + OFFSET, exec.v ? record : (i16)0));
}
template<int OFFSET, int SIZE> LANES_INLINE Longs gather(const char* base, i16 record, wp::int64*, Mask exec) {
    return Longs(gather_one_by_one<wp::int64, l16>(base + OFFSET, exec.v ? record : (i16)0));
}
template<int OFFSET, int SIZE, class S> LANES_INLINE Uints gather_small(const char* base, i16 record, S*, Mask exec) {
    if constexpr (SIZE % 4 == 0) {
        const u16 all = __builtin_bit_cast(u16, row<(OFFSET & ~3), SIZE>(base, record, exec));
        return Uints((all >> (8 * (OFFSET & 3))) & (unsigned)(S)-1);
    } else return Uints(gather_one_by_one<S, u16>(base + OFFSET, exec.v ? record : (i16)0));
}
template<int OFFSET, int SIZE> LANES_INLINE Uints gather(const char* base, i16 record, wp::uint16* p, Mask exec) {
    return gather_small<OFFSET, SIZE>(base, record, p, exec);
}
template<int OFFSET, int SIZE> LANES_INLINE Uints gather(const char* base, i16 record, wp::uint8* p, Mask exec) {
    return gather_small<OFFSET, SIZE>(base, record, p, exec);
}
template<int OFFSET, int SIZE> LANES_INLINE Mask gather(const char* base, i16 record, bool*, Mask exec) {
    return gather_small<OFFSET, SIZE>(base, record, (wp::uint8*)nullptr, exec) != Uints(0u);
}
template<int OFFSET, int SIZE, int K, int N, class T, class S>
LANES_INLINE void gather_elements(T* elements, const char* base, i16 record, S* p, Mask exec) {
    if constexpr (K < N) {
        elements[K] = gather<OFFSET + K * (int)sizeof(S), SIZE>(base, record, p, exec);
        gather_elements<OFFSET, SIZE, K + 1, N>(elements, base, record, p, exec);
    }
}
template<int OFFSET, int SIZE, unsigned N, class S>
LANES_INLINE Vector<N, Wide<S>> gather(const char* base, i16 record, wp::vec_t<N, S>*, Mask exec) {
    Vector<N, Wide<S>> r;
    gather_elements<OFFSET, SIZE, 0, N>(r.c, base, record, (S*)nullptr, exec);
    return r;
}
template<int OFFSET, int SIZE, unsigned R, unsigned N, class S>
LANES_INLINE Matrix<R, N, Wide<S>> gather(const char* base, i16 record, wp::mat_t<R, N, S>*, Mask exec) {
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
LANES_INLINE Ints lane_numbers() { return Ints((i16){0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15}); }

// In every lane the number of another one.
LANES_INLINE f16 permuted(f16 x, i16 lanes) {
#if defined(__AVX512F__)
    return __builtin_ia32_permvarsf512(x, lanes);
#else
    f16 r;
    for (int k = 0; k < WIDTH; ++k) r[k] = x[lanes[k]];
    return r;
#endif
}

// Lanes from one group to another: those of which bits are set in `from` go, in order, to those set in `to`.

struct Move {
    unsigned short from, to;
};
// The lanes of which bits are set, one after the other.
LANES_INLINE i16 packed(i16 x, unsigned lanes) {
#if defined(__AVX512F__)
    return __builtin_ia32_compresssi512_mask(x, (i16)0, (unsigned short)lanes);
#else
    i16 r = 0;
    for (int k = 0; lanes; lanes &= lanes - 1) r[k++] = x[__builtin_ctz(lanes)];
    return r;
#endif
}
// What `packed` made, back in the lanes of which bits are set, the others of `to`.
LANES_INLINE i16 spread(i16 packed, i16 to, unsigned lanes) {
#if defined(__AVX512F__)
    return __builtin_ia32_expandsi512_mask(packed, to, (unsigned short)lanes);
#else
    for (int k = 0; lanes; lanes &= lanes - 1) to[__builtin_ctz(lanes)] = packed[k++];
    return to;
#endif
}
template<class E, class V> LANES_INLINE void move(Number<E, V>& to, const Number<E, V>& x, Move m) {
    if constexpr (sizeof(V) == 64) {
        const i16 moved = packed(__builtin_bit_cast(i16, x.v), m.from);
        to.v = __builtin_bit_cast(V, spread(moved, __builtin_bit_cast(i16, to.v), m.to));
        return;
    }
    for (; m.from; m.from &= m.from - 1, m.to &= m.to - 1) to.v[__builtin_ctz(m.to)] = x.v[__builtin_ctz(m.from)];
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
// Room of which bits are set, taken from the lowest: as much as there are lanes.
LANES_INLINE unsigned first_of(unsigned places, int count) {
    unsigned r = 0;
    for (; count > 0; --count, places &= places - 1) r |= places & -places;
    return r;
}
} // namespace lanes
