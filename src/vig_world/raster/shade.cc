// Shades fragments: textures, light, gloss.
//
// Fragments come sorted by the part of an asset they belong to, so that 16 with the same material go side by
// side through vector registers.
//
// The body of a function of `Task* const task`; `native.py` puts the declarations before it.

constexpr int S = SAMPLES;
const float* const faces = (const float*)task->faces;
const Item* const items = (const Item*)task->items;
const VisiblePart* const parts = (const VisiblePart*)task->parts;
const Fragment* const fragments = (const Fragment*)task->fragments;
const int* const sorted = (const int*)task->sorted;
float* const linear = (float*)task->linear;
typedef float Floats __attribute__((ext_vector_type(4)));
typedef short Shorts __attribute__((ext_vector_type(4), aligned(2)));
float back[3][3], eye[3];  // world from camera
for (int r = 0; r < 3; ++r) {
    double sum = 0;
    for (int c = 0; c < 3; ++c) {
        back[r][c] = task->rotation[c][r];
        sum -= task->rotation[c][r] * task->translation[c];
    }
    eye[r] = sum;
}
const float inverse_focal = 1 / task->focal;
const Grid* const shadow = (const Grid*)task->shadow;
const float reach = shadow->origin[0] * shadow->origin[0];  // the grid's half width, squared
const float* const E = task->irradiance;
const float* const L = task->radiance;

// Irradiance lost at 16 places (metres of the grid's frame) by what the grid knows, for surfaces' normals.
auto lost = [&](const Grid& grid, const float* x, const float* y, const float* z, const float* nx,
                const float* ny, const float* nz, float* result) {
    const float a = grid.rise[0], b = 4 * grid.rise[1], inverse = 1 / grid.cell, scale = grid.scale;
    const float from_x = grid.origin[0], from_y = grid.origin[1], from_z = grid.origin[2];
    const int X = grid.size[0], Y = grid.size[1], plane = X * Y;
    const float last_x = X - 1.001f, last_y = Y - 1.001f, last_z = grid.size[2] - 1.001f;
    const Shorts* const values = (const Shorts*)grid.values;
    int cell[LANES];
    float fx[LANES], fy[LANES], fz[LANES];
    for (int lane = 0; lane < LANES; ++lane) {
        float at_x = (x[lane] - from_x) * inverse, at_y = (y[lane] - from_y) * inverse;
        const float above = z[lane] - from_z > 0 ? z[lane] - from_z : 0;
        float at_z = 2 * above / (a + __builtin_sqrtf(a * a + b * above));  // rise0 s + rise1 s^2 = above
        at_x = at_x > 0 ? at_x : 0;
        at_y = at_y > 0 ? at_y : 0;
        at_x = at_x < last_x ? at_x : last_x;
        at_y = at_y < last_y ? at_y : last_y;
        at_z = at_z < last_z ? at_z : last_z;
        const int ix = at_x, iy = at_y, iz = at_z;
        fx[lane] = at_x - ix;
        fy[lane] = at_y - iy;
        fz[lane] = at_z - iz;
        cell[lane] = iz * plane + iy * X + ix;
    }
    for (int lane = 0; lane < LANES; ++lane) {
        const Shorts* const low = values + cell[lane];
        const Shorts* const high = low + plane;
        auto along = [&](const Shorts* here) {
            const Floats first = __builtin_convertvector(here[0], Floats);
            return first + fx[lane] * (__builtin_convertvector(here[1], Floats) - first);
        };
        const Floats low_0 = along(low), low_1 = along(low + X);
        const Floats high_0 = along(high), high_1 = along(high + X);
        const Floats below = low_0 + fy[lane] * (low_1 - low_0), over = high_0 + fy[lane] * (high_1 - high_0);
        const Floats value = below + fz[lane] * (over - below);
        result[lane] = scale * (value[0] + value[1] * nx[lane] + value[2] * ny[lane] + value[3] * nz[lane]);
    }
};

int start = 0;
for (int slot = 0; slot < task->part_count; ++slot) {
    const int end = parts[slot].count;
    if (start == end)
        continue;
    const Part& part = *(const Part*)parts[slot].part;
    const Item& item = items[parts[slot].item];
    const float* const attributes = (const float*)parts[slot].attributes;
    const char* const asset = (const char*)item.asset;
    const Header& header = *(const Header*)asset;
    float R[3][3];  // world from asset
    for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c)
            R[r][c] = item.rotation[r][c];
    const wp::uint32* texels = (const wp::uint32*)(asset + part.texels);
    int log_width = part.log_size[0], log_height = part.log_size[1];
    float repeats = 1;
    if (part.slot >= 0 && item.finishes) {
        const Finish& finish = ((const Finish*)item.finishes)[part.slot];
        if (finish.texels) {
            texels = (const wp::uint32*)finish.texels;
            log_width = finish.log_size[0];
            log_height = finish.log_size[1];
            repeats = finish.repeats;
        }
    }
    const float texture_width = repeats * (1 << log_width), texture_height = repeats * (1 << log_height);
    const int deepest = log_width < log_height ? log_width : log_height;
    int level_start[MOST_LEVELS];
    for (int level = 0, at = 0; level <= deepest; ++level) {
        level_start[level] = at;
        at += 1 << (log_width + log_height - 2 * level);
    }
    Grid ambient = {};
    float reference = 1;
    if (header.occlusion) {
        ambient = *(const Grid*)(asset + header.occlusion);
        ambient.values = (wp::int64)(asset + header.occlusion + sizeof(Grid));
        // The light is what arrives at the object, its own ambient occlusion included: occlusion elsewhere is
        // relative to that. At least 0.3 of the light is assumed to be left there, which bounds the ratio.
        float x[LANES], y[LANES], z[LANES], mx[LANES], my[LANES], mz[LANES], less[LANES];
        for (int lane = 0; lane < LANES; ++lane) {
            const float up = 1.25f * ambient.cell - item.translation[2];
            const float from_x = -item.translation[0], from_y = -item.translation[1];
            x[lane] = R[0][0] * from_x + R[1][0] * from_y + R[2][0] * up;
            y[lane] = R[0][1] * from_x + R[1][1] * from_y + R[2][1] * up;
            z[lane] = R[0][2] * from_x + R[1][2] * from_y + R[2][2] * up;
            mx[lane] = R[2][0];
            my[lane] = R[2][1];
            mz[lane] = R[2][2];
        }
        lost(ambient, x, y, z, mx, my, mz, less);
        reference = less[0] < 0 ? 1 : 1 / wp::max(1 - less[0], 0.3f);
    }
    // A highlight's exponent 2^sharpness, of a Blinn-Phong lobe as wide as the roughness, from 8 to 128.
    int sharpness = 3;
    const float lobe_width = part.roughness * part.roughness;
    while (sharpness < 7 && lobe_width * lobe_width * (1 << sharpness) < 1)
        ++sharpness;
    const float glint = task->sun[3] * ((1 << sharpness) + 1);
    const float smooth = (1 - part.roughness) * (1 - part.roughness);

    for (int base = start; base < end; base += LANES) {
        const int count = end - base < LANES ? end - base : LANES;
        int pixel[LANES];
        float share[LANES], red[LANES], green[LANES], blue[LANES];
        float px[LANES], py[LANES], ax[LANES], ay[LANES], aq[LANES], bq[LANES], cq[LANES];
        float bdx[LANES], bdy[LANES], cdx[LANES], cdy[LANES];
        float at[5][LANES], to_b[5][LANES], to_c[5][LANES];
        for (int lane = 0; lane < LANES; ++lane) {
            const Fragment& fragment = fragments[sorted[base + (lane < count ? lane : 0)]];
            const float* const face = faces + 16 * (size_t)fragment.face;
            const int* const corner = (const int*)face + 9;
            pixel[lane] = fragment.pixel;
            share[lane] = fragment.share;
            px[lane] = fragment.x;
            py[lane] = fragment.y;
            ax[lane] = face[0];
            ay[lane] = face[1];
            aq[lane] = face[2];
            bq[lane] = face[3];
            cq[lane] = face[4];
            bdx[lane] = face[5];
            bdy[lane] = face[6];
            cdx[lane] = face[7];
            cdy[lane] = face[8];
            for (int n = 0; n < 5; ++n) {
                at[n][lane] = attributes[5 * corner[0] + n];
                to_b[n][lane] = attributes[5 * corner[1] + n];
                to_c[n][lane] = attributes[5 * corner[2] + n];
            }
        }
        float z[LANES], ux[LANES], uy[LANES], vx[LANES], vy[LANES];
        for (int lane = 0; lane < LANES; ++lane) {
            const float off_x = px[lane] - ax[lane], off_y = py[lane] - ay[lane];
            const float b = bdx[lane] * off_x + bdy[lane] * off_y, c = cdx[lane] * off_x + cdy[lane] * off_y;
            const float b_more = bq[lane] - aq[lane], c_more = cq[lane] - aq[lane];
            z[lane] = 1 / (aq[lane] + b * b_more + c * c_more);
            const float wb = b * bq[lane] * z[lane], wc = c * cq[lane] * z[lane];
            for (int n = 0; n < 5; ++n) {
                to_b[n][lane] -= at[n][lane];
                to_c[n][lane] -= at[n][lane];
                at[n][lane] += wb * to_b[n][lane] + wc * to_c[n][lane];
            }
            // How the weights change over the screen, and with them the place in the texture, in texels.
            const float qdx = bdx[lane] * b_more + cdx[lane] * c_more;
            const float qdy = bdy[lane] * b_more + cdy[lane] * c_more;
            const float scale = z[lane] * S;
            const float wbdx = scale * (bdx[lane] * bq[lane] - wb * qdx);
            const float wbdy = scale * (bdy[lane] * bq[lane] - wb * qdy);
            const float wcdx = scale * (cdx[lane] * cq[lane] - wc * qdx);
            const float wcdy = scale * (cdy[lane] * cq[lane] - wc * qdy);
            ux[lane] = (wbdx * to_b[3][lane] + wcdx * to_c[3][lane]) * texture_width;
            uy[lane] = (wbdy * to_b[3][lane] + wcdy * to_c[3][lane]) * texture_width;
            vx[lane] = (wbdx * to_b[4][lane] + wcdx * to_c[4][lane]) * texture_height;
            vy[lane] = (wbdy * to_b[4][lane] + wcdy * to_c[4][lane]) * texture_height;
        }
        if (item.is_target) {
            for (int lane = 0; lane < LANES; ++lane) {
                red[lane] = task->albedo[0] * at[3][lane];
                green[lane] = task->albedo[1] * at[3][lane];
                blue[lane] = task->albedo[2] * at[3][lane];
            }
        } else {
            // Texture: two taps along the longer axis of the pixel's footprint, bilinear, in the level in
            // which half the longer axis or the shorter one is nearest to a texel.
            int index[2][4][LANES];
            float fx[2][LANES], fy[2][LANES];
            for (int lane = 0; lane < LANES; ++lane) {
                const float along_x = ux[lane] * ux[lane] + vx[lane] * vx[lane];
                const float along_y = uy[lane] * uy[lane] + vy[lane] * vy[lane];
                const bool x_longer = along_x > along_y;
                const float longer = x_longer ? along_x : along_y, shorter = x_longer ? along_y : along_x;
                // Two taps cover an anisotropy of up to 4 in area.
                const float footprint = shorter > 0.25f * longer ? shorter : 0.25f * longer;
                union { float real; int bits; } doubled = {2 * footprint};
                int level = ((doubled.bits >> 23) - 127) >> 1;  // round(log2(sqrt(footprint)))
                level = level > 0 ? level : 0;
                level = level < deepest ? level : deepest;
                const int width = 1 << (log_width - level), height = 1 << (log_height - level);
                const float less = 1.0f / (1 << level);
                // Row 0 is the texture's upper edge, where v = 1.
                const float u = at[3][lane] * texture_width * less;
                const float v = (repeats - at[4][lane] * repeats) * (1 << log_height) * less;
                const float du = 0.25f * less * (x_longer ? ux[lane] : uy[lane]);
                const float dv = -0.25f * less * (x_longer ? vx[lane] : vy[lane]);
                for (int tap = 0; tap < 2; ++tap) {
                    const float x = (tap ? u + du : u - du) - 0.5f, y = (tap ? v + dv : v - dv) - 0.5f;
                    const float left = floorf(x), top = floorf(y);
                    fx[tap][lane] = x - left;
                    fy[tap][lane] = y - top;
                    const int x0 = (int)left & (width - 1), x1 = ((int)left + 1) & (width - 1);
                    const int y0 = (int)top & (height - 1), y1 = ((int)top + 1) & (height - 1);
                    const int first = level_start[level];
                    index[tap][0][lane] = first + y0 * width + x0;
                    index[tap][1][lane] = first + y0 * width + x1;
                    index[tap][2][lane] = first + y1 * width + x0;
                    index[tap][3][lane] = first + y1 * width + x1;
                }
            }
            for (int lane = 0; lane < LANES; ++lane)
                red[lane] = green[lane] = blue[lane] = 0;
            for (int tap = 0; tap < 2; ++tap)
                for (int corner = 0; corner < 4; ++corner)
                    for (int lane = 0; lane < LANES; ++lane) {
                        const wp::uint32 texel = texels[index[tap][corner][lane]];
                        const float wx = corner & 1 ? fx[tap][lane] : 1 - fx[tap][lane];
                        const float wy = corner & 2 ? fy[tap][lane] : 1 - fy[tap][lane];
                        const float weight = wx * wy * (0.5f / (255.0f * 255.0f));
                        const float r = (int)(texel & 255), g = (int)(texel >> 8 & 255);
                        const float b = (int)(texel >> 16);
                        red[lane] += weight * r * r;
                        green[lane] += weight * g * g;
                        blue[lane] += weight * b * b;
                    }
            // Where the fragment is and how its surface is turned, in the world.
            float wx[LANES], wy[LANES], wz[LANES], nx[LANES], ny[LANES], nz[LANES];
            float rx[LANES], ry[LANES], rz[LANES], facing[LANES], full[LANES], left[LANES];
            for (int lane = 0; lane < LANES; ++lane) {
                const float cx = (px[lane] - task->cx) * inverse_focal;
                const float cy = (py[lane] - task->cy) * inverse_focal;
                const float dx = back[0][0] * cx + back[0][1] * cy + back[0][2];
                const float dy = back[1][0] * cx + back[1][1] * cy + back[1][2];
                const float dz = back[2][0] * cx + back[2][1] * cy + back[2][2];
                wx[lane] = eye[0] + z[lane] * dx;
                wy[lane] = eye[1] + z[lane] * dy;
                wz[lane] = eye[2] + z[lane] * dz;
                const float ax = at[0][lane], ay = at[1][lane], az = at[2][lane];
                // 1e-12: a degenerate normal stays finite.
                const float unit = 1 / __builtin_sqrtf(ax * ax + ay * ay + az * az + 1e-12f);
                const float x = unit * (R[0][0] * ax + R[0][1] * ay + R[0][2] * az);
                const float y = unit * (R[1][0] * ax + R[1][1] * ay + R[1][2] * az);
                const float z = unit * (R[2][0] * ax + R[2][1] * ay + R[2][2] * az);
                nx[lane] = x;
                ny[lane] = y;
                nz[lane] = z;
                const float e = E[0] + E[1] * y + E[2] * z + E[3] * x + E[4] * x * y + E[5] * y * z
                    + E[6] * (3 * z * z - 1) + E[7] * x * z + E[8] * (x * x - y * y);
                full[lane] = e > 0 ? e : 0;
                const float length = 1 / __builtin_sqrtf(dx * dx + dy * dy + dz * dz);
                const float away = (x * dx + y * dy + z * dz) * length;
                facing[lane] = away < 0 ? -away : 0;
                rx[lane] = dx * length - 2 * away * x;
                ry[lane] = dy * length - 2 * away * y;
                rz[lane] = dz * length - 2 * away * z;
            }
            for (int lane = 0; lane < LANES; ++lane) {
                // Further away the light differs from the object's, and is taken to be more even.
                const float far = wx[lane] * wx[lane] + wy[lane] * wy[lane] + wz[lane] * wz[lane];
                const float even = EVEN * far / (far + 1);
                full[lane] += even * (E[0] - full[lane]);
                left[lane] = 1;
            }
            float x[LANES], y[LANES], z[LANES], less[LANES];
            if (header.occlusion) {
                // In the asset's frame, far enough off the surface not to look up the surface's own cells.
                float shift[3], mx[LANES], my[LANES], mz[LANES];
                for (int r = 0; r < 3; ++r)
                    shift[r] = item.translation[r];
                const float ahead = 1.25f * ambient.cell;
                for (int lane = 0; lane < LANES; ++lane) {
                    const float from_x = wx[lane] - shift[0], from_y = wy[lane] - shift[1];
                    const float from_z = wz[lane] - shift[2];
                    mx[lane] = R[0][0] * nx[lane] + R[1][0] * ny[lane] + R[2][0] * nz[lane];
                    my[lane] = R[0][1] * nx[lane] + R[1][1] * ny[lane] + R[2][1] * nz[lane];
                    mz[lane] = R[0][2] * nx[lane] + R[1][2] * ny[lane] + R[2][2] * nz[lane];
                    x[lane] = R[0][0] * from_x + R[1][0] * from_y + R[2][0] * from_z + ahead * mx[lane];
                    y[lane] = R[0][1] * from_x + R[1][1] * from_y + R[2][1] * from_z + ahead * my[lane];
                    z[lane] = R[0][2] * from_x + R[1][2] * from_y + R[2][2] * from_z + ahead * mz[lane];
                }
                lost(ambient, x, y, z, mx, my, mz, less);
                for (int lane = 0; lane < LANES; ++lane)
                    left[lane] = reference * (1 - (less[lane] > 0 ? less[lane] : 0));
            }
            // Props cast shadows: start outside the cells that they fill themselves.
            const float ahead = item.is_support ? 0 : 1.2f * shadow->cell;
            int within = 0;
            for (int lane = 0; lane < LANES; ++lane) {
                x[lane] = wx[lane] + ahead * nx[lane];
                y[lane] = wy[lane] + ahead * ny[lane];
                z[lane] = wz[lane] + ahead * nz[lane];
                const bool above = wz[lane] > -GROUND_DEPTH;
                within |= above & (x[lane] * x[lane] < reach) & (y[lane] * y[lane] < reach);
            }
            if (within) {
                lost(*shadow, x, y, z, nx, ny, nz, less);
                for (int lane = 0; lane < LANES; ++lane) {
                    const float taken = wz[lane] > -GROUND_DEPTH && less[lane] > 0 ? less[lane] : 0;
                    left[lane] *= 1 - taken / (full[lane] + 1e-6f);  // 1e-6: a dark side loses nothing of 0
                }
            }
            float lobe[LANES];
            for (int lane = 0; lane < LANES; ++lane) {
                const float* const sun = task->sun;
                const float towards = rx[lane] * sun[0] + ry[lane] * sun[1] + rz[lane] * sun[2];
                lobe[lane] = towards > 0 ? towards : 0;
            }
            for (int n = 0; n < sharpness; ++n)
                for (int lane = 0; lane < LANES; ++lane)
                    lobe[lane] *= lobe[lane];
            const float bright = part.emission, metal = part.metal, plain = 1 - metal, mirror = part.mirror;
            for (int lane = 0; lane < LANES; ++lane) {
                const float open = left[lane] > LEAST_LIGHT
                    ? left[lane] < MOST_LIGHT ? left[lane] : MOST_LIGHT : LEAST_LIGHT;
                const float x = rx[lane], y = ry[lane], z = rz[lane];
                float l = L[0] + L[1] * y + L[2] * z + L[3] * x + L[4] * x * y + L[5] * y * z
                    + L[6] * (3 * z * z - 1) + L[7] * x * z + L[8] * (x * x - y * y);
                l = l > 0 ? l : 0;
                const float graze = 1 - facing[lane], graze2 = graze * graze;
                const float fresnel = mirror + (1 - mirror) * smooth * graze2 * graze2 * graze;
                const float gloss = open * (l + glint * lobe[lane]);
                const float diffuse = plain * open * full[lane] + bright + metal * gloss;
                red[lane] = red[lane] * diffuse + fresnel * gloss;
                green[lane] = green[lane] * diffuse + fresnel * gloss;
                blue[lane] = blue[lane] * diffuse + fresnel * gloss;
            }
        }
        for (int lane = 0; lane < count; ++lane) {
            float* const here = linear + 3 * pixel[lane];
            here[0] += share[lane] * wp::min(wp::max(red[lane], 0.0f), 1.0f);
            here[1] += share[lane] * wp::min(wp::max(green[lane], 0.0f), 1.0f);
            here[2] += share[lane] * wp::min(wp::max(blue[lane], 0.0f), 1.0f);
        }
    }
    start = end;
}
