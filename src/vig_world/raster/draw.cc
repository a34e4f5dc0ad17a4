// The rasteriser: which face is nearest at each sample.
//
// As in `vig_renderer.raster`, 16 faces are set up side by side in vector registers and culled before one is
// drawn; here whole parts, and clusters of their faces, outside the frame are skipped first, faces that reach
// behind the camera are clipped at the near plane, and depth and face lie in two buffers of 32 bits, so that
// twice as many samples fit a register.
//
// The body of a function of `Task* const task`; `native.py` puts the declarations before it.

typedef float Floats __attribute__((ext_vector_type(8), aligned(4)));
typedef int Ints __attribute__((ext_vector_type(8), aligned(4)));
const Floats eight = {0, 1, 2, 3, 4, 5, 6, 7};
typedef float real;
const int width = task->width, height = task->height;
#include <pixel_box>
float* const q_image = (float*)task->q;
int* const id_image = (int*)task->ids;
float* const screen = (float*)task->screen;
const Item* const items = (const Item*)task->items;
VisiblePart* const parts = (VisiblePart*)task->parts;
float* const faces = (float*)task->faces;
float* const clipped = (float*)task->clipped;
const float f = task->focal, mid_x = task->cx, mid_y = task->cy, near = task->near;
const bool keep = task->keep;
int part_count = 0, face_count = 0, clipped_count = 0;
for (int n = 0; n < width * height; ++n) {
    q_image[n] = 0;
    id_image[n] = -1;
}

// A face with corners a, a + b, a + c on the screen and their q = 1 / depth, drawn in a box of samples.
// Weights of b and c are linear over the screen, and so is q.
auto fill = [&](int id, float ax, float ay, float aq, float bx, float by, float bq, float cx, float cy,
                float cq, int x0, int x1, int y0, int y1, const int* corner) {
    const float inverse = 1 / (bx * cy - by * cx);
    const float bdx = cy * inverse, bdy = -cx * inverse, cdx = -by * inverse, cdy = bx * inverse;
    const float b_more = bq - aq, c_more = cq - aq;
    if (keep) {
        id = face_count++;
        float* const face = faces + 16 * (size_t)id;
        face[0] = ax; face[1] = ay; face[2] = aq; face[3] = bq; face[4] = cq;
        face[5] = bdx; face[6] = bdy; face[7] = cdx; face[8] = cdy;
        int* const numbers = (int*)face + 9;
        for (int m = 0; m < 4; ++m)
            numbers[m] = corner[m];
    }
    for (int y = y0; y <= y1; ++y) {
        const float off_y = y + 0.5f - ay, b_row = bdy * off_y, c_row = cdy * off_y;
        // Eight samples at once, without a branch; those beyond the box keep what they hold.
        for (int x = x0; x <= x1; x += 8) {
            Floats* const q_here = (Floats*)(q_image + y * width + x);
            Ints* const id_here = (Ints*)(id_image + y * width + x);
            const Floats q_held = *q_here, off_x = eight + (x + 0.5f - ax);
            const Floats b = b_row + bdx * off_x, c = c_row + cdx * off_x, q = aq + b * b_more + c * c_more;
            const Ints nearer = (b >= -SLACK) & (c >= -SLACK) & (1 - b - c >= -SLACK) & (q > q_held)
                & (eight <= (float)(x1 - x));
            *q_here = nearer ? q : q_held;
            *id_here = nearer ? Ints(id) : *id_here;
        }
    }
};

for (int item_number = 0; item_number < task->item_count; ++item_number) {
    const Item& item = items[item_number];
    const char* const asset = (const char*)item.asset;
    const Header& header = *(const Header*)asset;
    float R[3][3], T[3];  // camera from asset
    for (int r = 0; r < 3; ++r) {
        double shift = task->translation[r];
        for (int c = 0; c < 3; ++c) {
            double sum = 0;
            for (int k = 0; k < 3; ++k)
                sum += task->rotation[r][k] * item.rotation[k][c];
            R[r][c] = sum;
            shift += task->rotation[r][c] * item.translation[c];
        }
        T[r] = shift;
    }
    // Whether a sphere is in the frame: not behind the near plane, nor beyond one of the four sides.
    auto in_frame = [&](const float* sphere) {
        float p[3];
        for (int r = 0; r < 3; ++r)
            p[r] = R[r][0] * sphere[0] + R[r][1] * sphere[1] + R[r][2] * sphere[2] + T[r];
        const float radius = sphere[3];
        if (!(p[2] + radius > near))
            return false;
        const float ends[4] = {mid_x, width - mid_x, mid_y, height - mid_y};
        for (int side = 0; side < 4; ++side) {
            const float along = side < 2 ? p[0] : p[1], end = ends[side];
            const float beyond = f * (side & 1 ? along : -along) - end * p[2];
            if (beyond > 0 && beyond * beyond > radius * radius * (f * f + end * end))
                return false;
        }
        return true;
    };
    if (!in_frame(header.sphere))
        continue;
    const float* const px = (const float*)(asset + header.positions);
    const float* const py = px + header.vertex_count;
    const float* const pz = py + header.vertex_count;
    const float* const attributes = (const float*)(asset + header.attributes);
    const int* const corners = (const int*)(asset + header.corners);
    const Cluster* const clusters = (const Cluster*)(asset + header.clusters);
    for (int part_number = 0; part_number < header.part_count; ++part_number) {
        const Part& part = ((const Part*)(asset + header.parts))[part_number];
        if (!in_frame(part.sphere))
            continue;
        const int slot = part_count;
        part_count += 2;
        for (int side = 0; side < 2; ++side)
            parts[slot + side] = {(wp::int64)&part, (wp::int64)(side ? clipped : attributes), item_number, 0,
                                  item.is_target, item.is_support};

        auto clip = [&](const int* corner) {
            float in[3][8], out[4][8];
            int count = 0;
            for (int m = 0; m < 3; ++m) {
                const int v = corner[m];
                for (int r = 0; r < 3; ++r)
                    in[m][r] = R[r][0] * px[v] + R[r][1] * py[v] + R[r][2] * pz[v] + T[r];
                for (int a = 0; a < 5; ++a)
                    in[m][3 + a] = attributes[5 * v + a];
            }
            for (int m = 0; m < 3; ++m) {
                const float* const here = in[m];
                const float* const next = in[(m + 1) % 3];
                const float ahead = here[2] - near, then = next[2] - near;
                if (ahead >= 0) {
                    for (int a = 0; a < 8; ++a)
                        out[count][a] = here[a];
                    ++count;
                }
                if ((ahead >= 0) != (then >= 0)) {
                    const float t = ahead / (ahead - then);
                    for (int a = 0; a < 8; ++a)
                        out[count][a] = here[a] + t * (next[a] - here[a]);
                    ++count;
                }
            }
            const int first = clipped_count;
            float flat[4][3];
            for (int m = 0; m < count; ++m) {
                const float q = 1 / out[m][2];
                flat[m][0] = f * out[m][0] * q + mid_x;
                flat[m][1] = f * out[m][1] * q + mid_y;
                flat[m][2] = q;
                for (int a = 0; a < 5; ++a)
                    clipped[5 * (size_t)(first + m) + a] = out[m][3 + a];
            }
            if (count >= 3)
                clipped_count += count;
            for (int m = 1; m + 1 < count; ++m) {
                // From the farthest corner, as the near ones may lie far outside the image: what is small
                // stays exact.
                int order[3] = {0, m, m + 1};
                while (flat[order[0]][2] > flat[order[1]][2] || flat[order[0]][2] > flat[order[2]][2]) {
                    const int moved = order[0];
                    order[0] = order[1];
                    order[1] = order[2];
                    order[2] = moved;
                }
                const float* const a = flat[order[0]];
                const float* const b = flat[order[1]];
                const float* const c = flat[order[2]];
                const float bx = b[0] - a[0], by = b[1] - a[1], cx = c[0] - a[0], cy = c[1] - a[1];
                if (!(bx * cy - by * cx < 0))
                    continue;
                float low_x = wp::min(a[0], wp::min(b[0], c[0])) - 0.5f;
                float low_y = wp::min(a[1], wp::min(b[1], c[1])) - 0.5f;
                float high_x = wp::max(a[0], wp::max(b[0], c[0])) - 0.5f;
                float high_y = wp::max(a[1], wp::max(b[1], c[1])) - 0.5f;
                low_x = wp::max(low_x, 0.0f);
                low_y = wp::max(low_y, 0.0f);
                high_x = wp::min(high_x, width - 1.0f);
                high_y = wp::min(high_y, height - 1.0f);
                if (!(low_x <= high_x && low_y <= high_y))
                    continue;
                const int numbers[4] = {first + order[0], first + order[1], first + order[2], slot + 1};
                fill(item.owner, a[0], a[1], a[2], bx, by, b[2], cx, cy, c[2], (int)low_x, (int)high_x,
                     (int)low_y, (int)high_y, numbers);
            }
        };

        for (int number = part.clusters[0]; number < part.clusters[1]; ++number) {
            const Cluster& cluster = clusters[number];
            if (!in_frame(cluster.sphere))
                continue;
            for (int v = cluster.vertices[0]; v < cluster.vertices[1]; ++v) {
                const float x = R[0][0] * px[v] + R[0][1] * py[v] + R[0][2] * pz[v] + T[0];
                const float y = R[1][0] * px[v] + R[1][1] * py[v] + R[1][2] * pz[v] + T[1];
                const float z = R[2][0] * px[v] + R[2][1] * py[v] + R[2][2] * pz[v] + T[2];
                const float q = z > near ? 1 / z : 0;
                screen[3 * v] = f * x * q + mid_x;
                screen[3 * v + 1] = f * y * q + mid_y;
                screen[3 * v + 2] = q;
            }
            const int end = cluster.faces[1];
            for (int base = cluster.faces[0]; base < end; base += LANES) {
                int corner[LANES][4], drawn[LANES], x0[LANES], x1[LANES], y0[LANES], y1[LANES];
                float ax[LANES], ay[LANES], aq[LANES], bx[LANES], by[LANES], bq[LANES];
                float cx[LANES], cy[LANES], cq[LANES];
                for (int lane = 0; lane < LANES; ++lane) {
                    const int face = base + lane < end ? base + lane : end - 1;
                    const int i = corners[3 * face], j = corners[3 * face + 1], k = corners[3 * face + 2];
                    corner[lane][0] = i;
                    corner[lane][1] = j;
                    corner[lane][2] = k;
                    corner[lane][3] = slot;
                    ax[lane] = screen[3 * i];
                    ay[lane] = screen[3 * i + 1];
                    aq[lane] = screen[3 * i + 2];
                    bx[lane] = screen[3 * j];
                    by[lane] = screen[3 * j + 1];
                    bq[lane] = screen[3 * j + 2];
                    cx[lane] = screen[3 * k];
                    cy[lane] = screen[3 * k + 1];
                    cq[lane] = screen[3 * k + 2];
                }
                int any = 0;
                for (int lane = 0; lane < LANES; ++lane) {
                    bx[lane] -= ax[lane];
                    by[lane] -= ay[lane];
                    cx[lane] -= ax[lane];
                    cy[lane] -= ay[lane];
                    const float area = bx[lane] * cy[lane] - by[lane] * cx[lane];
                    const int ahead = (aq[lane] > 0) + (bq[lane] > 0) + (cq[lane] > 0);
                    // Clockwise on the screen, whose y points down, is counter-clockwise from outside.
                    const int turned = (ahead == 3) & (area < 0);
                    const int covers = turned & pixel_box(ax[lane], ay[lane], bx[lane], by[lane], cx[lane],
                                                          cy[lane], x0[lane], x1[lane], y0[lane], y1[lane]);
                    drawn[lane] = covers | ((ahead == 1) | (ahead == 2)) << 1;
                    any |= drawn[lane];
                }
                if (!any)
                    continue;
                for (int lane = 0; lane < LANES && base + lane < end; ++lane) {
                    if (drawn[lane] & 2)
                        clip(corner[lane]);
                    else if (drawn[lane])
                        fill(item.owner, ax[lane], ay[lane], aq[lane], bx[lane], by[lane], bq[lane], cx[lane],
                             cy[lane], cq[lane], x0[lane], x1[lane], y0[lane], y1[lane], corner[lane]);
                }
            }
        }
    }
}
task->part_count = part_count;
task->face_count = face_count;
task->clipped_count = clipped_count;
