// Cotangents on pictures pulled back to points, attributes, lights and backgrounds. status: see paint.cc.
clear_cotangents();
clear(t.to_background, 3 * t.layers * (t.background_is_image ? t.height * t.width : 1));
const whole crossings = t.status[1], silhouettes = t.status[2];
whole next = 0;
const Space cotangents(t.fault, (3 * t.vertices + silhouettes) * sizeof(real), true);
if (*t.fault)
    return;
real* const on_places = (real*)cotangents.at;
real* const on_joints = on_places + 2 * t.vertices;
real* const on_steep = on_joints + t.vertices;
for (whole layer = 0; layer < t.layers; ++layer) {
    const int* const face = t.face + layer * grid;
    const whole first = next;
    while (next < crossings && t.crossing[8 * next + 5] == layer)
        ++next;
    // What the two pixels of each crossing give to its target; added when all have been read.
    const Space exchanged(t.fault, (next - first) * channels * sizeof(real));
    const Space picture(t.fault, grid * channels * sizeof(real), true);
    if (*t.fault)
        return;
    real* const given = (real*)exchanged.at;
    real* const pulled = (real*)picture.at;
    const auto spread = [&](const real* from, whole step, real* to) {
        for (whole n = 0; n < t.width * step && t.samples == 1; ++n)
            to[n] += from[n];
        if (t.samples == 1)
            return;
        for (whole j = 0; j < t.samples; ++j)
            for (whole i = 0; i < t.samples; ++i)
                for (whole x = 0; x < t.width; ++x)
                    for (whole c = 0; c < step; ++c)
                        to[(j * columns_of_grid + x * t.samples + i) * step + c] += from[x * step + c] * part;
    };
    for (whole y = 0; y < t.height; ++y) {
        const whole at = (layer * t.height + y) * t.width;
        if (t.on_rgb)
            spread(t.on_rgb + 3 * at, 3, pulled + 3 * row_of(y));
        for (whole m = 0; m < t.masks; ++m) {
            real* const to = pulled + slot(row_of(y), colours + (int)m);
            if (t.on_coverage)
                spread(t.on_coverage + at, 1, to);
            if (t.on_visible)
                spread(t.on_visible + ((layer * t.masks + m) * t.height + y) * t.width, 1, to);
        }
    }
    for (whole n = first; n < next; ++n) {
        const int* const row = t.crossing + 8 * n;
        const Blend m = blend_of(row);
        real on_amount = 0;
        for (int c = 0; c < channels; ++c) {
            const real g = pulled[slot(m.target, c)];
            given[(n - first) * channels + c] = m.amount * g;
            on_amount += g * t.steps[n * channels + c];
        }
        if (on_amount == 0)
            continue;
        on_amount /= row[4];
        const int axis = row[1];
        const real on_weight = on_amount * (real(0.5) - m.share) * (axis ? -1 : 1);
        const real on_share = -on_amount * m.weight;
        const real on_near0 = m.near0 > 0 ? on_weight * (m.joint0 - m.own) : 0;
        const real on_near1 = m.near1 > 0 ? on_weight * (m.joint1 - m.own) : 0;
        on_steep[row[0]] += on_weight * (1 - m.near0 - m.near1);
        on_joints[m.first] += on_weight * m.near0;
        on_joints[m.second] += on_weight * m.near1;
        const real on_at = on_share * (m.u1 - m.u0) + m.length * (on_near1 - on_near0);
        const real on_length = -m.at * on_near0 - (1 - m.at) * on_near1;
        const real across = on_at / (m.v1 - m.v0);
        real* const to_a = on_places + 2 * m.first;
        real* const to_b = on_places + 2 * m.second;
        to_a[axis] += on_share * (1 - m.at);
        to_b[axis] += on_share * m.at;
        to_a[1 - axis] += across * (m.at - 1);
        to_b[1 - axis] -= across * m.at;
        if (m.length > 1) {
            // The length is that of the edge; 1 where it is shorter.
            const real along_u = on_length * (m.u1 - m.u0) / m.length, along_v = on_length * (m.v1 - m.v0) / m.length;
            to_a[axis] -= along_u;
            to_b[axis] += along_u;
            to_a[1 - axis] -= along_v;
            to_b[1 - axis] += along_v;
        }
    }
    for (whole n = first; n < next; ++n)
        for (int c = 0; c < channels; ++c) {
            const real g = given[(n - first) * channels + c];
            pulled[slot(t.crossing[8 * n + 7], c)] += g;
            pulled[slot(t.crossing[8 * n + 6], c)] -= g;
        }
    Seen seen = {t.starts[layer]};
    double behind[3] = {};
    double on_light[LIGHT_ROW] = {};
    whole lit_object = -1;
    const auto keep_light = [&]() {
        for (int i = 0; i < LIGHT_ROW && lit_object >= 0 && t.to_lights; ++i) {
            t.to_lights[LIGHT_ROW * lit_object + i] += (real)on_light[i];
            on_light[i] = 0;
        }
    };
    for (int row = 0; row < rows_of_grid && colours; ++row)
        for (int column = 0; column < columns_of_grid; ++column) {
            const whole place = (whole)row * columns_of_grid + column;
            const real* const g = pulled + 3 * place;
            if (g[0] == 0 && g[1] == 0 && g[2] == 0)
                continue;
            if (face[place] < 0) {
                if (t.to_background && t.background_is_image) {
                    real* const to = background_at(layer, row, column, t.to_background);
                    for (int c = 0; c < 3; ++c)
                        to[c] += g[c];
                } else {
                    for (int c = 0; c < 3; ++c)
                        behind[c] += g[c];
                }
                continue;
            }
            see(face[place], column, row, seen);
            if (seen.object != lit_object) {
                keep_light();
                lit_object = seen.object;
            }
            real albedo[3], light[3], texture[3], on_albedo[3], on_lit[3], on_texture[3];
            Pulled on = {};
            mix(seen, 3, albedo);
            light_at(seen, light);
            texture_at(seen, texture);
            for (int c = 0; c < 3; ++c) {
                on_albedo[c] = g[c] * light[c] * texture[c];
                on_lit[c] = g[c] * albedo[c] * texture[c];
                on_texture[c] = g[c] * albedo[c] * light[c];
            }
            pull_mix(seen, 3, on_albedo, on.w);
            pull_light(seen, on_lit, on.w, on_light);
            pull_texture(seen, on_texture, on);
            pull_weights(seen, on, column, row);
        }
    keep_light();
    if (t.to_background && !t.background_is_image)
        for (int c = 0; c < 3; ++c)
            t.to_background[3 * layer + c] += (real)behind[c];
}
const auto to_point = [&](whole v, const real* screen, real gx, real gy) {
    real* const to = t.to_points + 3 * v;
    to[0] += gx * screen[2] * scale;
    to[1] += gy * screen[2] * scale;
    to[2] -= (gx * (screen[0] - MARGIN) + gy * (screen[1] - MARGIN)) * screen[2];
};
for (whole e = 0; e < silhouettes; ++e) {
    const whole ia = t.chosen[4 * e], ib = t.chosen[4 * e + 1];
    const real g = on_steep[e] + on_joints[ia] / t.joints[2 * ia + 1] + on_joints[ib] / t.joints[2 * ib + 1];
    if (g == 0)
        continue;
    real a[3], b[3];
    on_screen(t.points + 3 * ia, a);
    on_screen(t.points + 3 * ib, b);
    const Slope s = slope_of(a, b);
    // Steepness is y^2 / (x^2 + y^2), the square of the length held above a least one.
    const real on_square = s.square > real(1e-12) ? -g * s.steep / s.square : 0;
    const real gx = 2 * s.x * on_square, gy = 2 * s.y * (g / s.square + on_square);
    to_point(ia, a, -gx, -gy);
    to_point(ib, b, gx, gy);
}
for (whole v = 0; v < t.vertices; ++v)
    if (on_places[2 * v] != 0 || on_places[2 * v + 1] != 0) {
        real place[3];
        on_screen(t.points + 3 * v, place);
        to_point(v, place, on_places[2 * v], on_places[2 * v + 1]);
    }
