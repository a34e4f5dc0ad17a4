#include "visibility.h"

#include <limits>

namespace vig {

template <class R, int STRIDE>
void draw_faces(const R* screen, const int32_t* corners, int faces, int width, int height, bool cull,
                VisibilityBuffer<R>& seen, uint8_t* facing) {
    // A centre that lies beyond a face's edge by rounding only is covered, so that no gap opens between neighbours.
    constexpr R SLACK = -4 * std::numeric_limits<R>::epsilon();
    // LANES faces are set up side by side and culled before one is drawn. Comparisons are put so that NaN draws nothing.
    for (int base = 0; base < faces; base += LANES) {
        int i[LANES], j[LANES], k[LANES], drawn[LANES], x0[LANES], x1[LANES], y0[LANES], y1[LANES];
        R ax[LANES], ay[LANES], aq[LANES], bx[LANES], by[LANES], bq[LANES], cx[LANES], cy[LANES], cq[LANES];
        for (int lane = 0; lane < LANES; ++lane) {
            const int face = base + lane < faces ? base + lane : faces - 1;
            i[lane] = corners[3 * face];
            j[lane] = corners[3 * face + 1];
            k[lane] = corners[3 * face + 2];
        }
        const auto load = [&](const int* corner, R* x, R* y, R* q) {
            if constexpr (STRIDE == 4) {
                Lanes<R> point[4];
                gather_four(screen, corner, point);
                lanes_at(x) = point[0];
                lanes_at(y) = point[1];
                lanes_at(q) = point[2];
            } else {
                for (int lane = 0; lane < LANES; ++lane) {
                    x[lane] = screen[STRIDE * (size_t)corner[lane]];
                    y[lane] = screen[STRIDE * (size_t)corner[lane] + 1];
                    q[lane] = screen[STRIDE * (size_t)corner[lane] + 2];
                }
            }
        };
        load(i, ax, ay, aq);
        load(j, bx, by, bq);
        load(k, cx, cy, cq);
        for (int lane = 0; lane < LANES; ++lane) {
            bx[lane] -= ax[lane];
            by[lane] -= ay[lane];
            cx[lane] -= ax[lane];
            cy[lane] -= ay[lane];
        }
        // The weights b and c of two corners and q are linear on the screen: slopes from (ax, ay).
        R bdx[LANES], bdy[LANES], cdx[LANES], cdy[LANES], qdx[LANES], qdy[LANES];
        for (int lane = 0; lane < LANES; ++lane) {
            // Twice the signed area; its sign is the facing.
            const R area = bx[lane] * cy[lane] - by[lane] * cx[lane], inverse = 1 / area;
            const int ahead = (aq[lane] > 0) & (bq[lane] > 0) & (cq[lane] > 0);
            // Clockwise on the screen, whose y points down, is counter-clockwise from outside.
            const int turned = ahead & (area < 0);
            const int away = ahead & (area > 0) & !cull;
            const PixelBox box =
                pixel_box(ax[lane], ay[lane], bx[lane], by[lane], cx[lane], cy[lane], width, height);
            x0[lane] = box.x0;
            x1[lane] = box.x1;
            y0[lane] = box.y0;
            y1[lane] = box.y1;
            drawn[lane] = turned | ((turned | away) & int(box.covers)) << 1;
            bdx[lane] = cy[lane] * inverse;
            bdy[lane] = -cx[lane] * inverse;
            cdx[lane] = -by[lane] * inverse;
            cdy[lane] = bx[lane] * inverse;
            qdx[lane] = bdx[lane] * (bq[lane] - aq[lane]) + cdx[lane] * (cq[lane] - aq[lane]);
            qdy[lane] = bdy[lane] * (bq[lane] - aq[lane]) + cdy[lane] * (cq[lane] - aq[lane]);
        }
        for (int lane = 0; lane < LANES && base + lane < faces; ++lane) {
            facing[base + lane] = drawn[lane] & 1;
            if (drawn[lane] < 2)
                continue;
            const R b_step = bdx[lane], c_step = cdx[lane], q_step = qdx[lane];
            const R from_x = R(0.5) - ax[lane];
            const int last = x1[lane], face = base + lane;
            for (int y = y0[lane]; y <= y1[lane]; ++y) {
                const R off_y = y + R(0.5) - ay[lane];
                const R b_row = bdy[lane] * off_y, c_row = cdy[lane] * off_y, q_row = aq[lane] + qdy[lane] * off_y;
                // LANES pixels at once, without a branch; those beyond the face's box keep their values.
                for (int x = x0[lane]; x <= last; x += LANES) {
                    R* const nearest = seen.q.data() + (size_t)y * width + x;
                    int32_t* const nearest_face = seen.face.data() + (size_t)y * width + x;
                    for (int step = 0; step < LANES; ++step) {
                        const R off_x = (R)(x + step) + from_x;
                        const R b = b_row + b_step * off_x, c = c_row + c_step * off_x, q = q_row + q_step * off_x;
                        const bool covered = (b >= SLACK) & (c >= SLACK) & (1 - b - c >= SLACK);
                        const bool nearer = covered & (x + step <= last) & (q > nearest[step]);
                        nearest[step] = nearer ? q : nearest[step];
                        nearest_face[step] = nearer ? face : nearest_face[step];
                    }
                }
            }
        }
    }
}

template <class R> Fragment<R> fragment_at(const R* screen, const int32_t* corners, int face, int x, int y) {
    const auto corner = [&](int k) { return load3(screen + 3 * (size_t)corners[3 * (size_t)face + k]); };
    const Vec3<R> a = corner(0), b = corner(1) - a, c = corner(2) - a;
    const R off_x = (R)x + R(0.5) - a.x, off_y = (R)y + R(0.5) - a.y, area = b.x * c.y - b.y * c.x;
    // On the screen weights times q are linear.
    const R wb = (c.y * off_x - c.x * off_y) / area, wc = (b.x * off_y - b.y * off_x) / area;
    const R qa = (1 - wb - wc) * a.z, qb = wb * (b.z + a.z), qc = wc * (c.z + a.z), q = qa + qb + qc;
    return {{qa / q, qb / q, qc / q}, 1 / q};
}

template Fragment<VIG_REAL> fragment_at(const VIG_REAL*, const int32_t*, int, int, int);
template void draw_faces<VIG_REAL, 3>(const VIG_REAL*, const int32_t*, int, int, int, bool, VisibilityBuffer<VIG_REAL>&, uint8_t*);
template void draw_faces<VIG_REAL, 4>(const VIG_REAL*, const int32_t*, int, int, int, bool, VisibilityBuffer<VIG_REAL>&, uint8_t*);

}  // namespace vig
