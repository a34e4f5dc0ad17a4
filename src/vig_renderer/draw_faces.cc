// Draw the faces from `first` to `end` of a mesh: the least key of each pixel, which faces are turned to the eye
// (facing). 16 faces are set up side by side and culled before one is drawn.
// A centre that lies beyond a face's edge by rounding only is covered (SLACK), so that no gap opens between two
// neighbours. Comparisons are put so that NaN draws nothing.
constexpr int LANES = 16;
const real* const points = (const real*)screen.data + (size_t)mesh * screen.shape.dims[1] * 3;
const int* const corners = (const int*)faces.data;
wp::int64* const key = (wp::int64*)keys.data + (size_t)image * keys.shape.dims[1];
wp::uint8* const front = (wp::uint8*)facing.data + (size_t)mesh * facing.shape.dims[1];
for (int base = first; base < end; base += LANES) {
    int i[LANES], j[LANES], k[LANES], drawn[LANES], x0[LANES], x1[LANES], y0[LANES], y1[LANES];
    real ax[LANES], ay[LANES], aq[LANES], bx[LANES], by[LANES], bq[LANES];
    real cx[LANES], cy[LANES], cq[LANES], area[LANES];
    for (int lane = 0; lane < LANES; ++lane) {
        const int face = base + lane < end ? base + lane : end - 1;
        i[lane] = corners[3 * face];
        j[lane] = corners[3 * face + 1];
        k[lane] = corners[3 * face + 2];
    }
    for (int lane = 0; lane < LANES; ++lane) {
        ax[lane] = points[3 * i[lane]];
        ay[lane] = points[3 * i[lane] + 1];
        aq[lane] = points[3 * i[lane] + 2];
        bx[lane] = points[3 * j[lane]] - ax[lane];
        by[lane] = points[3 * j[lane] + 1] - ay[lane];
        bq[lane] = points[3 * j[lane] + 2];
        cx[lane] = points[3 * k[lane]] - ax[lane];
        cy[lane] = points[3 * k[lane] + 1] - ay[lane];
        cq[lane] = points[3 * k[lane] + 2];
    }
    for (int lane = 0; lane < LANES; ++lane) {
        // Twice the signed area; its sign is the facing.
        area[lane] = bx[lane] * cy[lane] - by[lane] * cx[lane];
        const bool ahead = (aq[lane] > 0) & (bq[lane] > 0) & (cq[lane] > 0);
        // Clockwise on the screen, whose y points down, is counter-clockwise from outside.
        const int turned = ahead & (area[lane] < 0);
        const int away = ahead & (area[lane] > 0) & (cull == 0);
        const int covers = pixel_box(ax[lane], ay[lane], bx[lane], by[lane], cx[lane], cy[lane], x0[lane],
                                     x1[lane], y0[lane], y1[lane]);
        drawn[lane] = turned | ((turned | away) & covers) << 1;
    }
    for (int lane = 0; lane < LANES && base + lane < end; ++lane) {
        front[base + lane] = drawn[lane] & 1;
        if (drawn[lane] < 2)
            continue;
        const real inverse = 1 / area[lane];
        // The two weights and q are linear: their slopes, once for each face.
        const real bdx = cy[lane] * inverse, bdy = -cx[lane] * inverse;
        const real cdx = -by[lane] * inverse, cdy = bx[lane] * inverse;
        const real qdx = bdx * (bq[lane] - aq[lane]) + cdx * (cq[lane] - aq[lane]);
        const real qdy = bdy * (bq[lane] - aq[lane]) + cdy * (cq[lane] - aq[lane]);
        for (int y = y0[lane]; y <= y1[lane]; ++y) {
            const real off_y = y + real(0.5) - ay[lane];
            const real b_row = bdy * off_y, c_row = cdy * off_y, q_row = aq[lane] + qdy * off_y;
#ifdef __CUDA_ARCH__
            for (int x = x0[lane]; x <= x1[lane]; ++x) {
                const real off_x = x + real(0.5) - ax[lane];
                const real b = b_row + bdx * off_x, c = c_row + cdx * off_x;
                if (b >= SLACK && c >= SLACK && 1 - b - c >= SLACK) {
                    // Depth in the high bits and the face in the low ones: the least key is the nearest face.
                    const wp::int64 far = FARTHEST - (wp::int64)((q_row + qdx * off_x) * DEPTH_STEPS);
                    wp::atomic_min(key + y * width + x, far << FACE_BITS | (base + lane));
                }
            }
#else
            // Eight pixels at once, without a branch; those beyond the face's box keep what they hold.
            for (int x = x0[lane]; x <= x1[lane]; x += 8) {
                wp::int64* const here = key + y * width + x;
                for (int step = 0; step < 8; ++step) {
                    const real off_x = x + step + real(0.5) - ax[lane];
                    const real b = b_row + bdx * off_x, c = c_row + cdx * off_x;
                    const bool covered = (b >= SLACK) & (c >= SLACK) & (1 - b - c >= SLACK);
                    const wp::int64 far = FARTHEST - (wp::int64)((q_row + qdx * off_x) * DEPTH_STEPS);
                    const wp::int64 drawn = far << FACE_BITS | (base + lane);
                    const bool nearer = covered & (x + step <= x1[lane]) & (drawn < here[step]);
                    here[step] = nearer ? drawn : here[step];
                }
            }
#endif
        }
    }
}
