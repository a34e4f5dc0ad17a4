// Vectors and matrices of three numbers, or of three times LANES side by side, and whole vector registers.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <vector>

namespace vig {

// Numbers that are worked on side by side: whole vector registers of a processor, in single precision one of AVX-512.
// Sums over them have this fixed order on every processor.
constexpr int LANES = 16;

// Numbers in one vector register, in single precision: loops over columns take so many, as compilers keep sums of more
// than one register in memory.
#if defined(__AVX512F__)
constexpr int REGISTER = 16;
#elif defined(__AVX__)
constexpr int REGISTER = 8;
#else
constexpr int REGISTER = 4;
#endif

template <class R> struct Vec2 {
    R x, y;
};

template <class R> struct Vec3 {
    R x, y, z;
    R operator[](int i) const { return i == 0 ? x : i == 1 ? y : z; }
};

template <class A, class B> auto operator+(Vec3<A> a, Vec3<B> b) -> Vec3<decltype(a.x + b.x)> {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class A, class B> auto operator-(Vec3<A> a, Vec3<B> b) -> Vec3<decltype(a.x - b.x)> {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class R, class S> Vec3<R> operator*(Vec3<R> a, S s) { return {a.x * s, a.y * s, a.z * s}; }
template <class A, class B> auto dot(Vec3<A> a, Vec3<B> b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
template <class R> Vec3<R> cross(Vec3<R> a, Vec3<R> b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
template <class R> Vec3<R> by_channel(Vec3<R> a, Vec3<R> b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
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
    template <class T> Vec3<T> operator*(Vec3<T> v) const { return {dot(row[0], v), dot(row[1], v), dot(row[2], v)}; }
    // The transposed matrix times v.
    template <class T> Vec3<T> transposed(Vec3<T> v) const {
        return {row[0].x * v.x + row[1].x * v.y + row[2].x * v.z, row[0].y * v.x + row[1].y * v.y + row[2].y * v.z,
                row[0].z * v.x + row[1].z * v.y + row[2].z * v.z};
    }
};

// The numbers of two vectors at the given places, those of the second counted on.
#if __has_builtin(__builtin_shufflevector)
#define VIG_SHUFFLE(a, b, ...) __builtin_shufflevector(a, b, __VA_ARGS__)
#else  // GCC 11
template <class R, class V, class... Places> auto shuffle(const V& a, const V& b, Places... places) {
    constexpr int count = sizeof(V) / sizeof(R);
    typedef R type __attribute__((vector_size(sizeof...(Places) * sizeof(R))));
    return type{(places < count ? a[places] : b[places - count])...};
}
#define VIG_SHUFFLE(a, b, ...) shuffle<R>(a, b, __VA_ARGS__)
#endif

// LANES numbers, those of a register, and four, as points of vertices are kept; in memory they lie anywhere (Loose).
#define VIG_VECTOR(NAME, COUNT)                                                                                        \
    template <class R> struct NAME##Of;                                                                                \
    template <> struct NAME##Of<float> {                                                                               \
        typedef float type __attribute__((vector_size(COUNT * sizeof(float))));                                        \
        typedef float loose __attribute__((vector_size(COUNT * sizeof(float)), aligned(sizeof(float)), may_alias));    \
    };                                                                                                                 \
    template <> struct NAME##Of<double> {                                                                              \
        typedef double type __attribute__((vector_size(COUNT * sizeof(double))));                                      \
        typedef double loose __attribute__((vector_size(COUNT * sizeof(double)), aligned(sizeof(double)), may_alias)); \
    };                                                                                                                 \
    template <class R> using NAME = typename NAME##Of<R>::type;                                                        \
    template <class R> using Loose##NAME = typename NAME##Of<R>::loose;
VIG_VECTOR(Lanes, LANES)
VIG_VECTOR(Register, REGISTER)
VIG_VECTOR(Four, 4)
#undef VIG_VECTOR

template <class R> const LooseLanes<R>& lanes_at(const R* numbers) { return *(const LooseLanes<R>*)numbers; }
template <class R> LooseLanes<R>& lanes_at(R* numbers) { return *(LooseLanes<R>*)numbers; }
template <class R> const LooseRegister<R>& register_at(const R* numbers) { return *(const LooseRegister<R>*)numbers; }
template <class R> LooseRegister<R>& register_at(R* numbers) { return *(LooseRegister<R>*)numbers; }
template <class R> const LooseFour<R>& four_at(const R* numbers) { return *(const LooseFour<R>*)numbers; }
template <class R> LooseFour<R>& four_at(R* numbers) { return *(LooseFour<R>*)numbers; }
// Apply a function to a number, or to LANES side by side (T): a loop, which becomes vector instructions. For vectors
// wider than its registers GCC compiles comparisons and `?:` number by number.
template <class F, class T, class... More> T by_lane(F&& f, T x, const More&... more) {
    if constexpr (std::is_floating_point_v<T>)
        return f(x, more...);
    else {
        typedef std::remove_reference_t<decltype(x[0])> R;
        for (int k = 0; k < LANES; ++k)
            ((R*)&x)[k] = f(((const R*)&x)[k], ((const R*)&more)[k]...);
        return x;
    }
}
template <class T> T root(T x) {
    return by_lane([](auto x) { return std::sqrt(x); }, x);
}
template <class T> T above_zero(T x) {
    return by_lane([](auto x) { return x > 0 ? x : 0; }, x);
}

// One of LANES vectors side by side, by way of memory, as numbers of a register are slow to take out one by one.
template <class R> Vec3<R> lane(const Vec3<Lanes<R>>& v, int k) {
    return {((const R*)&v.x)[k], ((const R*)&v.y)[k], ((const R*)&v.z)[k]};
}
template <class R> void set_lane(Vec3<Lanes<R>>& v, int k, Vec3<R> to) {
    ((R*)&v.x)[k] = to.x;
    ((R*)&v.y)[k] = to.y;
    ((R*)&v.z)[k] = to.z;
}
// A row of (., 4).
template <class R> const LooseFour<R>& four_at(const std::vector<R>& rows, int place) {
    return four_at(rows.data() + 4 * (size_t)place);
}
template <class R> LooseFour<R>& four_at(std::vector<R>& rows, int place) {
    return four_at(rows.data() + 4 * (size_t)place);
}

// Add up the LANES numbers of each of some rows: halves are added to halves, so that no sum is a chain of additions.
template <int COUNT, class R> void sum_rows(const Lanes<R>* rows, R* sums) {
    static_assert(LANES == 16, "halves of 16");
    R four[COUNT][4];
    for (int row = 0; row < COUNT; ++row) {
        const R* const parts = (const R*)&rows[row];
        R eight[8];
        for (int n = 0; n < 8; ++n)
            eight[n] = parts[n] + parts[n + 8];
        for (int n = 0; n < 4; ++n)
            four[row][n] = eight[n] + eight[n + 4];
    }
    for (int row = 0; row < COUNT; ++row)
        sums[row] = (four[row][0] + four[row][2]) + (four[row][1] + four[row][3]);
}
template <class R> R sum_lanes(const Lanes<R>& parts) {
    R sum;
    sum_rows<1, R>(&parts, &sum);
    return sum;
}

// The cross product of the first three, and 0.
template <class R> Four<R> cross_fours(Four<R> a, Four<R> b) {
    return VIG_SHUFFLE(a, a, 1, 2, 0, 3) * VIG_SHUFFLE(b, b, 2, 0, 1, 3)
        - VIG_SHUFFLE(a, a, 2, 0, 1, 3) * VIG_SHUFFLE(b, b, 1, 2, 0, 3);
}

// Places a, b, c, d of each block of four.
#if defined(__AVX512F__)
#define VIG_BLOCKS(a, b, c, d)                                                                                         \
    a, b, c, d, a + 4, b + 4, c + 4, d + 4, a + 8, b + 8, c + 8, d + 8, a + 12, b + 12, c + 12, d + 12
#elif defined(__AVX__)
#define VIG_BLOCKS(a, b, c, d) a, b, c, d, a + 4, b + 4, c + 4, d + 4
#else
#define VIG_BLOCKS(a, b, c, d) a, b, c, d
#endif
// Transpose the 4 x 4 blocks of four registers.
template <class R> void transpose_registers(Register<R>* rows) {
    constexpr int N = REGISTER;
    const Register<R> a = rows[0], b = rows[1], c = rows[2], d = rows[3];
    const Register<R> low_ab = VIG_SHUFFLE(a, b, VIG_BLOCKS(0, N, 1, N + 1));
    const Register<R> high_ab = VIG_SHUFFLE(a, b, VIG_BLOCKS(2, N + 2, 3, N + 3));
    const Register<R> low_cd = VIG_SHUFFLE(c, d, VIG_BLOCKS(0, N, 1, N + 1));
    const Register<R> high_cd = VIG_SHUFFLE(c, d, VIG_BLOCKS(2, N + 2, 3, N + 3));
    rows[0] = VIG_SHUFFLE(low_ab, low_cd, VIG_BLOCKS(0, 1, N, N + 1));
    rows[1] = VIG_SHUFFLE(low_ab, low_cd, VIG_BLOCKS(2, 3, N + 2, N + 3));
    rows[2] = VIG_SHUFFLE(high_ab, high_cd, VIG_BLOCKS(0, 1, N, N + 1));
    rows[3] = VIG_SHUFFLE(high_ab, high_cd, VIG_BLOCKS(2, 3, N + 2, N + 3));
}
#undef VIG_BLOCKS

// The same of four rows of a register, or of LANES numbers.
template <class R, class Row> void transpose_blocks(Row* rows) {
    for (int part = 0; part < int(sizeof(Row) / sizeof(R)); part += REGISTER) {
        Register<R> four[4];
        for (int n = 0; n < 4; ++n)
            four[n] = register_at((const R*)&rows[n] + part);
        transpose_registers<R>(four);
        for (int n = 0; n < 4; ++n)
            register_at((R*)&rows[n] + part) = four[n];
    }
}

// A register of fours in a row: four(n) is the n-th.
template <class R, class F> Register<R> join_fours(F&& four) {
    if constexpr (REGISTER == 4) {
        return four(0);
    } else {
        const auto low = VIG_SHUFFLE(four(0), four(1), 0, 1, 2, 3, 4, 5, 6, 7);
        if constexpr (REGISTER == 8) {
            return low;
        } else {
            const auto high = VIG_SHUFFLE(four(2), four(3), 0, 1, 2, 3, 4, 5, 6, 7);
            return VIG_SHUFFLE(low, high, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
        }
    }
}

// Load rows (., 4) at as many places, transposed: to[n] holds the n-th of each.
template <class R, class Row> void gather_four(const R* rows, const int* place, Row* to) {
    for (int part = 0; part < int(sizeof(Row) / sizeof(R)); part += REGISTER) {
        Register<R> four[4];
        for (int n = 0; n < 4; ++n)
            four[n] = join_fours<R>(
                [&](int block) -> Four<R> { return four_at(rows + 4 * (size_t)place[part + 4 * block + n]); });
        transpose_registers<R>(four);
        for (int n = 0; n < 4; ++n)
            register_at((R*)&to[n] + part) = four[n];
    }
}

// The way back: call use(lane, four numbers) for every lane in order.
template <class R, class Row, class F> void scatter_four(Row* numbers, F&& use) {
    transpose_blocks<R>(numbers);
    for (int block = 0; block < int(sizeof(Row) / sizeof(Four<R>)); ++block)
        for (int n = 0; n < 4; ++n)
            use(4 * block + n, four_at((const R*)&numbers[n] + 4 * block));
}

// Transpose LANES columns of LANES numbers.
template <class R> void transpose(Lanes<R>* columns) {
    Lanes<R> blocks[LANES];
    for (int n = 0; n < LANES; n += 4)
        transpose_blocks<R>(columns + n);
    std::copy_n(columns, LANES, blocks);
    for (int lane = 0; lane < LANES; ++lane)
        for (int n = 0; n < LANES; n += 4)
            four_at((R*)&columns[lane] + n) = four_at((const R*)&blocks[n + lane % 4] + lane / 4 * 4);
}

}  // namespace vig
