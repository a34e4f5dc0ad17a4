// Vectors and matrices of three numbers, and the width of whole vector registers.
#pragma once
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace vig {

// Numbers that are worked on side by side: whole vector registers of a processor, in single precision one of AVX-512.
// Sums over them have this fixed order on every processor.
constexpr int LANES = 16;

template <class R> struct Vec2 {
    R x, y;
};

template <class R> struct Vec3 {
    R x, y, z;
    R operator[](int i) const { return i == 0 ? x : i == 1 ? y : z; }
};

template <class R> Vec3<R> operator+(Vec3<R> a, Vec3<R> b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
template <class R> Vec3<R> operator-(Vec3<R> a, Vec3<R> b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
template <class R> Vec3<R> operator*(Vec3<R> a, R s) { return {a.x * s, a.y * s, a.z * s}; }
template <class R> R dot(Vec3<R> a, Vec3<R> b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
template <class R> Vec3<R> cross(Vec3<R> a, Vec3<R> b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
template <class R> Vec3<R> load3(const R* at) { return {at[0], at[1], at[2]}; }
template <class R> void store3(R* at, Vec3<R> v) {
    at[0] = v.x;
    at[1] = v.y;
    at[2] = v.z;
}
template <class R> void add3(R* at, Vec3<R> v) {
    at[0] += v.x;
    at[1] += v.y;
    at[2] += v.z;
}

// Rows of a 3 x 3 matrix.
template <class R> struct Mat3 {
    Vec3<R> row[3];
    Vec3<R> operator*(Vec3<R> v) const { return {dot(row[0], v), dot(row[1], v), dot(row[2], v)}; }
    // The transposed matrix times v.
    Vec3<R> transposed(Vec3<R> v) const { return row[0] * v.x + row[1] * v.y + row[2] * v.z; }
};

// LANES numbers in vector registers.
typedef float Lanes32 __attribute__((vector_size(LANES * sizeof(float)), aligned(sizeof(float)), may_alias));
typedef double Lanes64 __attribute__((vector_size(LANES * sizeof(double)), aligned(sizeof(double)), may_alias));
template <class R> struct LanesOf;
template <> struct LanesOf<float> { typedef Lanes32 type; };
template <> struct LanesOf<double> { typedef Lanes64 type; };
template <class R> using Lanes = typename LanesOf<R>::type;

template <class R> const Lanes<R>& lanes_at(const R* numbers) { return *(const Lanes<R>*)numbers; }
template <class R> Lanes<R>& lanes_at(R* numbers) { return *(Lanes<R>*)numbers; }

// Add up LANES numbers: halves are added to halves, so that the sum is no chain of additions.
template <class R> R sum_lanes(const R* parts) {
    static_assert(LANES == 16, "halves of 16");
    R eight[8], four[4];
    for (int n = 0; n < 8; ++n)
        eight[n] = parts[n] + parts[n + 8];
    for (int n = 0; n < 4; ++n)
        four[n] = eight[n] + eight[n + 4];
    return (four[0] + four[2]) + (four[1] + four[3]);
}
template <class R> R sum_lanes(const Lanes<R>& parts) { return sum_lanes<R>((const R*)&parts); }


// Four numbers, as points of vertices are kept.
template <class R> struct Four {
    typedef R type __attribute__((vector_size(4 * sizeof(R)), aligned(sizeof(R)), may_alias));
};

#define VIG_BLOCKS(a, b, c, d) a, b, c, d, a + 4, b + 4, c + 4, d + 4, a + 8, b + 8, c + 8, d + 8, a + 12, b + 12, c + 12, d + 12
// Transpose the 4 x 4 blocks of four rows of LANES numbers.
template <class R> void transpose_blocks(Lanes<R>* rows) {
    const Lanes<R> a = rows[0], b = rows[1], c = rows[2], d = rows[3];
    const Lanes<R> low_ab = __builtin_shufflevector(a, b, VIG_BLOCKS(0, 16, 1, 17));
    const Lanes<R> high_ab = __builtin_shufflevector(a, b, VIG_BLOCKS(2, 18, 3, 19));
    const Lanes<R> low_cd = __builtin_shufflevector(c, d, VIG_BLOCKS(0, 16, 1, 17));
    const Lanes<R> high_cd = __builtin_shufflevector(c, d, VIG_BLOCKS(2, 18, 3, 19));
    rows[0] = __builtin_shufflevector(low_ab, low_cd, VIG_BLOCKS(0, 1, 16, 17));
    rows[1] = __builtin_shufflevector(low_ab, low_cd, VIG_BLOCKS(2, 3, 18, 19));
    rows[2] = __builtin_shufflevector(high_ab, high_cd, VIG_BLOCKS(0, 1, 16, 17));
    rows[3] = __builtin_shufflevector(high_ab, high_cd, VIG_BLOCKS(2, 3, 18, 19));
}
#undef VIG_BLOCKS

// Load rows of four numbers at LANES places, transposed: to[n] holds the n-th of each.
template <class R> void gather_four(const R* rows, const int* place, Lanes<R>* to) {
    typedef typename Four<R>::type Quad;
    for (int n = 0; n < 4; ++n) {
        Quad quad[4];
        for (int block = 0; block < 4; ++block)
            quad[block] = *(const Quad*)(rows + 4 * (size_t)place[4 * block + n]);
        const auto low = __builtin_shufflevector(quad[0], quad[1], 0, 1, 2, 3, 4, 5, 6, 7);
        const auto high = __builtin_shufflevector(quad[2], quad[3], 0, 1, 2, 3, 4, 5, 6, 7);
        to[n] = __builtin_shufflevector(low, high, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    }
    transpose_blocks<R>(to);
}

// The way back: add numbers to the rows at their places, one after the other; 0 where a lane is left over.
template <class R> void add_four(Lanes<R>* numbers, const int* place, R* rows) {
    typedef typename Four<R>::type Quad;
    transpose_blocks<R>(numbers);
    for (int block = 0; block < 4; ++block)
        for (int n = 0; n < 4; ++n)
            *(Quad*)(rows + 4 * (size_t)place[4 * block + n]) += *(const Quad*)((const R*)&numbers[n] + 4 * block);
}

}  // namespace vig
