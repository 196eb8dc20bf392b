// What single PTX instructions compute (PTX ISA, NVIDIA). Registers hold bits; F and D read them as numbers.
typedef unsigned char u8; typedef unsigned short u16; typedef unsigned int u32; typedef unsigned long long u64;
typedef signed char s8; typedef short s16; typedef int s32; typedef long long s64;
typedef u8 b8; typedef u16 b16; typedef u32 b32; typedef u64 b64;
typedef float f32; typedef double f64; typedef bool pred;
// Inlined where the compiler optimises. Elsewhere calls make a third of the code, which compiles in a third of the time.
#define OP static inline

extern "C" {
void* memcpy(void*, const void*, unsigned long);
float exp2f(float); float log2f(float); float sinf(float); float cosf(float);
float rintf(float); float floorf(float); float ceilf(float); float truncf(float); float fmaf(float, float, float);
double rint(double); double floor(double); double ceil(double); double trunc(double); double fma(double, double, double);
}

OP f32 F(u32 x) { return __builtin_bit_cast(f32, x); }
OP f64 D(u64 x) { return __builtin_bit_cast(f64, x); }
OP u32 bits(f32 x) { return __builtin_bit_cast(u32, x); }
OP u64 bits(f64 x) { return __builtin_bit_cast(u64, x); }

template<class T> OP T load(u64 address) { T x; memcpy(&x, (const void*)address, sizeof x); return x; }
template<class T> OP void store(u64 address, T x) { memcpy((void*)address, &x, sizeof x); }

template<class T> constexpr u32 width = 8 * sizeof(T);
template<class T> struct unsigned_of { typedef T type; };
template<> struct unsigned_of<s16> { typedef u16 type; };
template<> struct unsigned_of<s32> { typedef u32 type; };
template<> struct unsigned_of<s64> { typedef u64 type; };

// Shifts by the width and more leave nothing, or copies of the sign.
template<class T> OP T shl(T x, u32 n) { return n >= width<T> ? (T)0 : (T)(x << n); }
template<class T> OP T shr(T x, u32 n) { return n >= width<T> ? (x < (T)0 ? (T)-1 : (T)0) : (T)(x >> n); }
OP u32 shf_l(u32 low, u32 high, u32 n) { return (u32)(((u64)high << 32 | low) << n >> 32); }
OP u32 shf_r(u32 low, u32 high, u32 n) { return (u32)(((u64)high << 32 | low) >> n); }
OP u32 at_most_32(u32 n) { return n > 32 ? 32 : n; }

OP u32 brev(u32 x) { return __builtin_bitreverse32(x); }
OP u64 brev(u64 x) { return __builtin_bitreverse64(x); }
OP u32 clz(u32 x) { return x ? (u32)__builtin_clz(x) : 32; }
OP u32 clz(u64 x) { return x ? (u32)__builtin_clzll(x) : 64; }
OP u32 popc(u64 x) { return (u32)__builtin_popcountll(x); }
// The lowest bits of a in place of those of b from `place` on; of place and count only the lowest byte counts.
template<class T> OP T bfi(T a, T b, u32 place, u32 count) {
    const T mask = shl((T)((count & 255) >= width<T> ? (T)-1 : (T)(((T)1 << (count & 255)) - 1)), place & 255);
    return (T)((b & ~mask) | (shl(a, place & 255) & mask));
}
// The highest bit that differs from the sign, by its place or by the shift that moves it to the top.
template<class T> OP u32 bfind(T x) {
    typedef typename unsigned_of<T>::type U;
    const U y = (U)(x < (T)0 ? ~x : x);
    return y ? width<T> - 1 - clz(y) : 0xffffffffu;
}
template<class T> OP u32 bfind_shift(T x) {
    const u32 place = bfind(x);
    return place == 0xffffffffu ? place : width<T> - 1 - place;
}

// PTX leaves division by zero open; a CPU would stop the process.
template<class T> OP T quotient(T a, T b) { return b == 0 ? (T)-1 : b == (T)-1 && (T)-1 < 0 ? (T)(0 - (u64)a) : (T)(a / b); }
template<class T> OP T remainder(T a, T b) { return b == 0 ? a : b == (T)-1 && (T)-1 < 0 ? (T)0 : (T)(a % b); }
OP u16 mul_hi(u16 a, u16 b) { return (u16)((u32)a * b >> 16); }
OP s16 mul_hi(s16 a, s16 b) { return (s16)((s32)a * b >> 16); }
OP u32 mul_hi(u32 a, u32 b) { return (u32)((u64)a * b >> 32); }
OP s32 mul_hi(s32 a, s32 b) { return (s32)((s64)a * b >> 32); }
OP u64 mul_hi(u64 a, u64 b) { return (u64)((unsigned __int128)a * b >> 64); }
OP s64 mul_hi(s64 a, s64 b) { return (s64)((__int128)a * b >> 64); }

// Of a number and NaN the number is the least and the most; -0 is less than 0.
template<class T> OP T least(T a, T b) {
    if (a != a && b != b) return sizeof(T) == 4 ? (T)F(0x7fffffffu) : (T)D(0x7fffffffffffffffull);
    return a != a ? b : b != b ? a : a == b ? (bits(a) >> (width<T> - 1) ? a : b) : a < b ? a : b;
}
template<class T> OP T most(T a, T b) {
    if (a != a && b != b) return least(a, b);
    return a != a ? b : b != b ? a : a == b ? (bits(a) >> (width<T> - 1) ? b : a) : a > b ? a : b;
}
OP f32 multiply_add(f32 a, f32 b, f32 c) { return __builtin_fmaf(a, b, c); }
OP f64 multiply_add(f64 a, f64 b, f64 c) { return __builtin_fma(a, b, c); }
OP f32 root(f32 x) { return __builtin_sqrtf(x); }
OP f64 root(f64 x) { return __builtin_sqrt(x); }
OP f32 magnitude(f32 x) { return __builtin_fabsf(x); }
OP f64 magnitude(f64 x) { return __builtin_fabs(x); }
OP f32 with_sign_of(f32 sign, f32 x) { return __builtin_copysignf(x, sign); }
OP f64 with_sign_of(f64 sign, f64 x) { return __builtin_copysign(x, sign); }
OP f32 flushed(f32 x) { return magnitude(x) < 1.17549435e-38f ? with_sign_of(x, 0.0f) : x; }

OP f32 to_nearest(f32 x) { return rintf(x); }
OP f64 to_nearest(f64 x) { return rint(x); }
OP f32 to_lower(f32 x) { return floorf(x); }
OP f64 to_lower(f64 x) { return floor(x); }
OP f32 to_upper(f32 x) { return ceilf(x); }
OP f64 to_upper(f64 x) { return ceil(x); }
OP f32 to_zero(f32 x) { return truncf(x); }
OP f64 to_zero(f64 x) { return trunc(x); }
// A number without fraction as an integer, the nearest there is. NaN becomes 0, or the highest bit alone if either
// type has 64 bits.
template<class I, class T> OP I integer(T x) {
    constexpr I low = (I)-1 < 0 ? (I)((u64)1 << (width<I> - 1)) : (I)0, high = (I)~low;
    if (x != x) return sizeof(T) == 8 || sizeof(I) == 8 ? (I)((u64)1 << (width<I> - 1)) : (I)0;
    const f64 limit = (I)-1 < 0 ? (f64)((u64)1 << (width<I> - 1)) : 2.0 * (f64)((u64)1 << (width<I> - 1));
    return (f64)x >= limit ? high : (f64)x <= (f64)low ? low : (I)x;
}
// Threads run one after another, so that nothing can come between the load and the store.
template<class T, class Operation> OP T atomic(u64 address, Operation operation) {
    const T old = load<T>(address);
    store<T>(address, operation(old));
    return old;
}
