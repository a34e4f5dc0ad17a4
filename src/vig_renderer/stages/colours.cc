// Light and texture at a seen point and the background where nothing is; and their ways back.
const auto light_at = [&](const Seen& seen, real* out) {
    if (t.columns == 9) {
        mix(seen, 6, out);
    } else {
        real sum[3], n[3];
        mix(seen, 0, sum);
        unit(sum, n);
        reflect(t.lights + LIGHT_ROW * seen.object, n, out);
    }
};
const auto pull_light = [&](const Seen& seen, const real* g, real* on_w, double* on_light) {
    if (t.columns == 9) {
        pull_mix(seen, 6, g, on_w);
    } else {
        real sum[3], n[3], on_n[3] = {}, on_sum[3];
        mix(seen, 0, sum);
        const real inverse = unit(sum, n);
        pull_reflect(t.lights + LIGHT_ROW * seen.object, n, g, on_n, on_light);
        pull_unit(n, inverse, on_n, on_sum);
        pull_mix(seen, 0, on_sum, on_w);
    }
};
// Texture look-up: bilinear in two levels of the pyramid, linear between them (Williams 1983); derivatives of the
// weights along the screen, wx and wy, are quotients of those of e, ex and ey.
struct Lookup {
    real ex[3], ey[3], wx[3], wy[3], sum_x, sum_y, share, rate[4], fx[2], fy[2], width[2], height[2];
    int levels;
    whole corner[3], texel[2][4];
};
const auto wrapped = [](int i, int count) { return (i % count + count) % count; };
const auto look_up = [&](const Seen& seen, Lookup& k) {
    const Object& object = objects[seen.object];
    real uv[2] = {}, foot[4] = {};
    for (int i = 0; i < 3; ++i) {
        const int n = (i + 1) % 3, m = (i + 2) % 3;
        // A step of one pixel moves a corner by its depth.
        k.ex[i] = seen.z[m] * seen.y[n] - seen.z[n] * seen.y[m];
        k.ey[i] = seen.x[m] * seen.z[n] - seen.x[n] * seen.z[m];
    }
    k.sum_x = k.ex[0] + k.ex[1] + k.ex[2];
    k.sum_y = k.ey[0] + k.ey[1] + k.ey[2];
    for (int i = 0; i < 3; ++i) {
        k.corner[i] = object.texture_faces[3 * seen.face + i];
        k.wx[i] = (k.ex[i] - seen.w[i] * k.sum_x) * seen.inverse;
        k.wy[i] = (k.ey[i] - seen.w[i] * k.sum_y) * seen.inverse;
        const real* const at = object.in[COORDINATES] + 2 * k.corner[i];
        for (int c = 0; c < 2; ++c) {
            uv[c] += seen.w[i] * at[c];
            foot[c] += k.wx[i] * at[c];
            foot[2 + c] += k.wy[i] * at[c];
        }
    }
    // Mean square size of the pixel in texels; half its logarithm is the level.
    const real size[2] = {(real)object.levels[2], (real)object.levels[1]};
    real square = 0;
    for (int i = 0; i < 4; ++i) {
        k.rate[i] = size[i % 2] * size[i % 2] * foot[i];
        square += k.rate[i] * foot[i] / 2;
    }
    const real level = PER_OCTAVE * wp::log(wp::max(square, real(1e-12)));
    const whole last = object.level_count - 1;
    k.levels = level > 0 && level < last ? 2 : 1;
    const whole fine = level > 0 ? (level < last ? (whole)level : last) : 0;
    k.share = k.levels == 2 ? level - fine : 0;
    for (int i = 0; i < 4; ++i)
        k.rate[i] *= PER_OCTAVE / square;
    for (int n = 0; n < k.levels; ++n) {
        const int* const row = object.levels + 3 * (fine + n);
        const int height = row[1], width = row[2];
        k.height[n] = height;
        k.width[n] = width;
        // Whole turns of the texture are dropped first: large uv must not overflow.
        const real x = (uv[0] - wp::floor(uv[0])) * width - real(0.5);
        const real y = (1 - (uv[1] - wp::floor(uv[1]))) * height - real(0.5);
        const int left = (int)wp::floor(x), top = (int)wp::floor(y);
        k.fx[n] = x - left;
        k.fy[n] = y - top;
        for (int i = 0; i < 4; ++i) {
            const int column = wrapped(left + i % 2, width), line = wrapped(top + i / 2, height);
            k.texel[n][i] = 3 * (row[0] + (whole)line * width + column);
        }
    }
};
const auto bilinear = [&](const Lookup& k, int n, const real* texels, int c) {
    const whole* const at = k.texel[n];
    const real upper = texels[at[0] + c] * (1 - k.fx[n]) + texels[at[1] + c] * k.fx[n];
    const real lower = texels[at[2] + c] * (1 - k.fx[n]) + texels[at[3] + c] * k.fx[n];
    return upper * (1 - k.fy[n]) + lower * k.fy[n];
};
const auto texture_at = [&](const Seen& seen, real* out) {
    const real* const texels = objects[seen.object].in[TEXELS];
    Lookup k;
    if (texels)
        look_up(seen, k);
    for (int c = 0; c < 3; ++c) {
        out[c] = texels ? bilinear(k, 0, texels, c) : 1;
        if (texels && k.share > 0)
            out[c] += k.share * (bilinear(k, 1, texels, c) - out[c]);
    }
};
const auto pull_texture = [&](const Seen& seen, const real* g, Pulled& on) {
    const Object& object = objects[seen.object];
    const real* const texels = object.in[TEXELS];
    if (!texels)
        return;
    Lookup k;
    look_up(seen, k);
    real on_uv[2] = {}, on_share = 0;
    for (int n = 0; n < k.levels; ++n) {
        const real part = n ? k.share : 1 - k.share, fx = k.fx[n], fy = k.fy[n];
        const real shares[4] = {(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy};
        const whole* const at = k.texel[n];
        for (int c = 0; c < 3; ++c) {
            for (int i = 0; i < 4 && object.on[TEXELS]; ++i)
                object.on[TEXELS][at[i] + c] += part * g[c] * shares[i];
            const real* const t0 = texels + c;
            const real right = (t0[at[1]] - t0[at[0]]) * (1 - fy) + (t0[at[3]] - t0[at[2]]) * fy;
            const real down = (t0[at[2]] - t0[at[0]]) * (1 - fx) + (t0[at[3]] - t0[at[1]]) * fx;
            on_uv[0] += part * g[c] * right * k.width[n];
            on_uv[1] -= part * g[c] * down * k.height[n];  // v runs up, rows run down
            if (k.levels == 2)
                on_share += (n ? g[c] : -g[c]) * bilinear(k, n, texels, c);
        }
    }
    real on_foot[4] = {}, on_wx[3], on_wy[3], mean_x = 0, mean_y = 0, by_inverse = 0;
    for (int i = 0; i < 4 && k.levels == 2; ++i)
        on_foot[i] = k.rate[i] * on_share;
    for (int i = 0; i < 3; ++i) {
        const real* const at = object.in[COORDINATES] + 2 * k.corner[i];
        for (int c = 0; c < 2 && object.on[COORDINATES]; ++c)
            object.on[COORDINATES][2 * k.corner[i] + c] +=
                on_uv[c] * seen.w[i] + on_foot[c] * k.wx[i] + on_foot[2 + c] * k.wy[i];
        on_wx[i] = on_foot[0] * at[0] + on_foot[1] * at[1];
        on_wy[i] = on_foot[2] * at[0] + on_foot[3] * at[1];
        mean_x += on_wx[i] * seen.w[i];
        mean_y += on_wy[i] * seen.w[i];
        by_inverse += on_wx[i] * k.wx[i] + on_wy[i] * k.wy[i];
        on.w[i] += on_uv[0] * at[0] + on_uv[1] * at[1];
        on.w[i] -= (on_wx[i] * k.sum_x + on_wy[i] * k.sum_y) * seen.inverse;
    }
    for (int i = 0; i < 3; ++i) {
        const int n = (i + 1) % 3, m = (i + 2) % 3;
        const real gx = (on_wx[i] - mean_x) * seen.inverse, gy = (on_wy[i] - mean_y) * seen.inverse;
        on.e[i] -= by_inverse * seen.inverse;
        on.z[m] += gx * seen.y[n] - gy * seen.x[n];
        on.z[n] += gy * seen.x[m] - gx * seen.y[m];
        on.y[n] += gx * seen.z[m];
        on.y[m] -= gx * seen.z[n];
        on.x[m] += gy * seen.z[n];
        on.x[n] -= gy * seen.z[m];
    }
};
// The background's colour (or where its cotangent lies) at a point of the grid; its border goes on in the margin.
const auto background_at = [&](whole layer, int row, int column, auto* background) {
    if (!t.background_is_image)
        return background + 3 * layer;
    const whole y = wp::min(wp::max((whole)row - MARGIN, (whole)0) / t.samples, t.height - 1);
    const whole x = wp::min(wp::max((whole)column - MARGIN, (whole)0) / t.samples, t.width - 1);
    return background + 3 * ((layer * t.height + y) * t.width + x);
};
