#pragma once
// Lines of the text of OBJ files (`kernels/files/obj_text.py`). The text ends with a newline and has no carriage returns.
#include "vectors.h"

namespace wrt {
typedef const unsigned char* Letters;
enum ObjLine { OBJ_V, OBJ_VT, OBJ_VN, OBJ_FACE, OBJ_OTHER, OBJ_EMPTY };

WRT_INLINE bool is_blank(const unsigned char c) { return c == ' ' || c == '\t'; }
WRT_INLINE bool ends_word(const unsigned char c) { return is_blank(c) || c == '\n' || c == '#'; }
WRT_INLINE Letters after_blanks(Letters p) {
    while (is_blank(*p)) ++p;
    return p;
}
WRT_INLINE Letters end_of_line(Letters p) {
    while (*p != '\n') ++p;
    return p;
}

// The kind of a line from its first letter, and where its words begin.
WRT_INLINE ObjLine kind_of(Letters& p) {
    p = after_blanks(p);
    if (*p == '\n' || *p == '#') return OBJ_EMPTY;
    const int letters = *p != 'v' || (p[1] != 't' && p[1] != 'n') ? 1 : 2;
    if ((*p != 'v' && *p != 'f') || !is_blank(p[letters])) return OBJ_OTHER;
    const ObjLine kind = *p == 'f' ? OBJ_FACE : letters == 1 ? OBJ_V : p[1] == 't' ? OBJ_VT : OBJ_VN;
    p += letters;
    return kind;
}

WRT_INLINE int count_words(Letters& p) {
    int words = 0;
    for (bool between = true; *p != '\n' && *p != '#'; ++p) {
        words += between && !is_blank(*p);
        between = is_blank(*p);
    }
    return words;
}

// The quotient of integers, correctly rounded: long division, to more bits than a double has.
WRT_INLINE double quotient(unsigned __int128 m, unsigned __int128 n) {
    int exponent = -55;
    while (!(m >> 126)) m <<= 1, --exponent;
    while (!(n >> 126)) n <<= 1, ++exponent;
    unsigned long long bits = 0;
    for (int k = 0; k < 56; ++k) {
        const bool fits = m >= n;
        bits = 2 * bits + fits;
        m = (fits ? m - n : m) << 1;
    }
    union { unsigned long long bits; double value; } scale = {(1023ull + exponent) << 52};
    return (double)(bits | (m != 0)) * scale.value;
}

// Reads a decimal number, correctly rounded (Clinger 1990: one operation of exact numbers is). False where it is none,
// has more than 19 digits, or is beyond 1e-19 to 1e22 or so.
WRT_INLINE bool read_decimal(Letters& p, double& value) {
    constexpr double POWERS[] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
                                 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};
    const bool minus = *p == '-';
    p += minus || *p == '+';
    const Letters begin = p;
    while (*p == '0') ++p;
    unsigned long long m = 0;
    Letters first = p;
    for (; *p >= '0' && *p <= '9'; ++p) m = 10 * m + (*p - '0');
    int digits = (int)(p - first), decimals = 0;
    bool is_number = p > begin;
    if (*p == '.') {
        const Letters point = p++;
        while (digits == 0 && *p == '0') ++p;
        first = p;
        for (; *p >= '0' && *p <= '9'; ++p) m = 10 * m + (*p - '0');
        decimals = (int)(p - point) - 1;
        digits += (int)(p - first);
        is_number |= decimals > 0;
    }
    if (!is_number || digits > 19) return false;
    if (*p == 'e' || *p == 'E') {
        const bool below = *++p == '-';
        p += below || *p == '+';
        const Letters power = p;
        int exponent = 0;
        for (; *p >= '0' && *p <= '9' && p < power + 4; ++p) exponent = 10 * exponent + (*p - '0');
        if (p == power) return false;
        decimals += below ? exponent : -exponent;
    }
    if (!ends_word(*p)) return false;
    if (m == 0) decimals = 0;
    if (m <= (1ull << 53) && decimals >= -22 && decimals <= 22) {
        value = decimals < 0 ? (double)m * POWERS[-decimals] : (double)m / POWERS[decimals];
    } else {
        if (decimals < 0 || decimals > 37) return false;
        unsigned __int128 power = 1;
        for (int k = 0; k < decimals; ++k) power *= 10;
        value = quotient(m, power);
    }
    value = minus && m ? -value : value;
    return true;
}

// Reads a number of vertex data as an index from 0; negative numbers count back from the `count` before the line.
WRT_INLINE bool read_index(Letters& p, const int count, int& index) {
    const bool minus = *p == '-';
    const Letters first = p += minus;
    int number = 0;
    for (; *p >= '0' && *p <= '9' && p < first + 9; ++p) number = 10 * number + (*p - '0');
    index = minus ? count - number : number - 1;
    return number > 0 && index >= 0;
}

// Counts what is in the lines of a chunk: lines of each kind, corners of faces, and words of the first line of each
// kind of vertex data.
template<class Text> WRT_INLINE void count_obj(const Text& text, const int chunk) {
    int* counts = text.counts.data + 9 * chunk;
    for (int k = 0; k < 9; ++k) counts[k] = 0;
    const Letters end = text.letters.data + text.starts.data[chunk + 1];
    for (Letters p = text.letters.data + text.starts.data[chunk]; p < end; ++p) {
        const ObjLine kind = kind_of(p);
        if (kind != OBJ_EMPTY) ++counts[kind];
        if (kind == OBJ_FACE) counts[5] += count_words(p);
        if (kind < OBJ_FACE && counts[6 + kind] == 0) counts[6 + kind] = count_words(p);
        p = end_of_line(p);
    }
}

template<class Number>
WRT_INLINE bool read_row(Letters& p, Number* rows, const int row, const int columns, const int most) {
    int k = 0;
    for (p = after_blanks(p); !ends_word(*p); p = after_blanks(p), ++k) {
        double value;
        if (!read_decimal(p, value)) return false;
        if (k < columns) rows[(size_t)row * columns + k] = (Number)value;
    }
    return k == columns || (k > columns && columns == most);
}

// Reads the lines of a chunk. `places` is how many lines of each kind and corners are before it. Returns false where
// something is not as in most files.
template<class Text> WRT_INLINE bool read_obj(const Text& text, const int chunk) {
    int at[6];
    for (int k = 0; k < 6; ++k) at[k] = text.counts.data[9 * chunk + k];
    const Letters end = text.letters.data + text.starts.data[chunk + 1];
    for (Letters p = text.letters.data + text.starts.data[chunk]; p < end; ++p) {
        const ObjLine kind = kind_of(p);
        const int n = kind == OBJ_EMPTY ? 0 : at[kind]++;
        if (kind == OBJ_V && !read_row(p, text.v.data, n, text.columns[0], text.most[0])) return false;
        if (kind == OBJ_VT && !read_row(p, text.vt.data, n, text.columns[1], text.most[1])) return false;
        if (kind == OBJ_VN && !read_row(p, text.vn.data, n, text.columns[2], text.most[2])) return false;
        if (kind == OBJ_FACE) {
            int count = 0;
            for (p = after_blanks(p); !ends_word(*p); p = after_blanks(p), ++count) {
                int* corner = text.corners.data + 3 * (size_t)at[5]++;
                corner[1] = corner[2] = -1;
                if (!read_index(p, at[0], corner[0])) return false;
                for (int k = 1; k < 3 && *p == '/'; ++k) {
                    if (*++p != '/' && !ends_word(*p) && !read_index(p, at[k], corner[k])) return false;
                }
                if (!ends_word(*p)) return false;
            }
            if (count == 0) return false;
            text.sizes.data[n] = count;
        }
        if (kind == OBJ_OTHER) {
            text.others.data[2 * n] = (int)(p - text.letters.data);
            text.others.data[2 * n + 1] = at[OBJ_FACE];
        }
        p = end_of_line(p);
    }
    return true;
}
} // namespace wrt
