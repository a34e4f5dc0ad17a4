// Unit normals in the camera's frame at each pixel's nearest sample.
//
// They are interpolated between vertices, as for shading; where that is nothing, or turned away from the face's
// own side, the face's own. The body of a function of `Task* const task`; `native.py` puts the declarations
// before it.

constexpr int S = SAMPLES;
const int W = task->width, columns = W / S, rows = task->height / S;
const float* const q_image = (const float*)task->q;
const int* const id_image = (const int*)task->ids;
const float* const faces = (const float*)task->faces;
const VisiblePart* const parts = (const VisiblePart*)task->parts;
const Item* const items = (const Item*)task->items;
float* const normals = (float*)task->normals;
const float inverse_focal = 1 / task->focal;
for (int row = 0; row < rows; ++row)
    for (int column = 0; column < columns; ++column) {
        float* const out = normals + 3 * (row * columns + column);
        out[0] = out[1] = out[2] = 0;
        float nearest = 0;
        int px = 0, py = 0;
        for (int y = row * S; y < (row + 1) * S; ++y)
            for (int x = column * S; x < (column + 1) * S; ++x)
                if (q_image[y * W + x] > nearest) {
                    nearest = q_image[y * W + x];
                    px = x;
                    py = y;
                }
        const int id = id_image[py * W + px];
        if (!(nearest > 0) || id < 0)
            continue;
        const float* const face = faces + 16 * (size_t)id;
        const int* const corner = (const int*)face + 9;
        const VisiblePart& part = parts[corner[3]];
        const float* const attributes = (const float*)part.attributes;
        const float off_x = px + 0.5f - face[0], off_y = py + 0.5f - face[1];
        const float b = face[5] * off_x + face[6] * off_y, c = face[7] * off_x + face[8] * off_y;
        const float b_more = face[3] - face[2], c_more = face[4] - face[2];
        const float z = 1 / (face[2] + b * b_more + c * c_more);
        const float wb = b * face[3] * z, wc = c * face[4] * z;
        // One over depth is linear on the screen; its slopes are the face's normal, which points away.
        const float x = (px + 0.5f - task->cx) * inverse_focal, y = (py + 0.5f - task->cy) * inverse_focal;
        const float slope_x = task->focal * (face[5] * b_more + face[7] * c_more);
        const float slope_y = task->focal * (face[6] * b_more + face[8] * c_more);
        const float away[3] = {slope_x, slope_y, 1 / z - slope_x * x - slope_y * y};
        float own[3], world[3], seen[3], turned = 0, squared = 0, flat = 0;
        for (int n = 0; n < 3; ++n) {
            const float first = attributes[5 * corner[0] + n];
            own[n] = first + wb * (attributes[5 * corner[1] + n] - first)
                + wc * (attributes[5 * corner[2] + n] - first);
        }
        const auto& R = items[part.item].rotation;
        for (int r = 0; r < 3; ++r)
            world[r] = R[r][0] * own[0] + R[r][1] * own[1] + R[r][2] * own[2];
        for (int r = 0; r < 3; ++r) {
            seen[r] = 0;
            for (int c = 0; c < 3; ++c)
                seen[r] += task->rotation[r][c] * world[c];
            turned += seen[r] * away[r];
            squared += seen[r] * seen[r];
            flat += away[r] * away[r];
        }
        const bool interpolated = squared > 1e-12f && turned < 0;
        const float scale = interpolated ? 1 / __builtin_sqrtf(squared) : -1 / __builtin_sqrtf(flat);
        for (int r = 0; r < 3; ++r)
            out[r] = scale * (interpolated ? seen[r] : away[r]);
    }
