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

}  // namespace vig
