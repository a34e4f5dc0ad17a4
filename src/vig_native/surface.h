// The visible surface: a face on the screen, what is seen of it at a pixel and how cotangents pull back to its corners.
#pragma once
#include "likelihood.h"

namespace vig {

// From the face's first corner, its other two weights grow by by_second, by_third a pixel; q by slope from base; q times
// irradiance by lit_slope from lit_base.
template <class R> struct Surface {
    int i, j, k;
    R origin_x, origin_y;
    Vec2<R> by_second, by_third;
    R lit_base, base;
    Vec2<R> lit_slope, slope;
};

template <class R> Surface<R> surface_of(const Task<R>& task, int face) {
    const int32_t* const corners = &task.geometry.corners[3 * (size_t)face];
    Surface<R> s;
    s.i = corners[0];
    s.j = corners[1];
    s.k = corners[2];
    const R *const a = &task.work.points[4 * (size_t)s.i], *const b = &task.work.points[4 * (size_t)s.j];
    const R* const c = &task.work.points[4 * (size_t)s.k];
    const R bx = b[0] - a[0], by = b[1] - a[1], cx = c[0] - a[0], cy = c[1] - a[1];
    // Gradients of the barycentric weights of corners b and c on the screen (Cramer's rule).
    const R inverse = 1 / (bx * cy - by * cx);
    s.origin_x = a[0];
    s.origin_y = a[1];
    s.by_second = {cy * inverse, -cx * inverse};
    s.by_third = {-by * inverse, bx * inverse};
    // q and q times irradiance are linear on the screen: perspective-correct interpolation (Blinn 1992).
    const R lit_a = a[2] * a[3], lit_b = b[2] * b[3] - lit_a, lit_c = c[2] * c[3] - lit_a;
    const R q_b = b[2] - a[2], q_c = c[2] - a[2];
    s.lit_base = lit_a;
    s.lit_slope = {s.by_second.x * lit_b + s.by_third.x * lit_c, s.by_second.y * lit_b + s.by_third.y * lit_c};
    s.base = a[2];
    s.slope = {s.by_second.x * q_b + s.by_third.x * q_c, s.by_second.y * q_b + s.by_third.y * q_c};
    return s;
}

// The surface at a pixel: irradiance, and one over the depth.
template <class R> struct Seen {
    R irradiance, q;
};

template <class R> Seen<R> seen_at(const Surface<R>& s, Vec2<R> pixel) {
    const R x = pixel.x - s.origin_x, y = pixel.y - s.origin_y;
    const R q = s.base + s.slope.x * x + s.slope.y * y;
    return {(s.lit_base + s.lit_slope.x * x + s.lit_slope.y * y) / q, q};
}

// Pull a cotangent on the irradiance seen at one pixel back to the corners: `lit` and `depth` are the cotangents on q
// times irradiance and on q.
template <class R> void pull_pixel(Task<R>& task, const Surface<R>& s, Vec2<R> pixel, Seen<R> seen, R on_seen) {
    // irradiance = lit / q: d/d lit = 1 / q, d/d q = -irradiance / q.
    const R lit = on_seen / seen.q, depth = -lit * seen.irradiance;
    const R x = pixel.x - s.origin_x, y = pixel.y - s.origin_y;
    const R b = s.by_second.x * x + s.by_second.y * y, c = s.by_third.x * x + s.by_third.y * y;
    // A corner that moves carries the linear functions along: the value at the pixel changes against them.
    const R move_x = s.lit_slope.x * lit + s.slope.x * depth, move_y = s.lit_slope.y * lit + s.slope.y * depth;
    const int corner[3] = {s.i, s.j, s.k};
    const R share[3] = {1 - b - c, b, c};
    for (int n = 0; n < 3; ++n) {
        const R* const point = &task.work.points[4 * (size_t)corner[n]];
        R* const on = &task.work.on_corner[4 * (size_t)corner[n]];
        on[0] -= share[n] * move_x;
        on[1] -= share[n] * move_y;
        on[2] += share[n] * (point[3] * lit + depth);
        on[3] += share[n] * point[2] * lit;
    }
}

}  // namespace vig
