// Pictures: colours and masks of each layer at the points of its grid, blended at crossings, averaged over samples.
// status[0]: in, for how many crossings there is space. status[1], status[2]: out, crossings and edges found.
whole silhouettes = 0, crossings = 0;
clear(t.joints, 2 * t.vertices);
for (whole o = 0; o < t.objects; ++o) {
    const Object& object = objects[o];
    const whole vertices = object.vertices, faces = object.face_count;
    const whole ends[6] = {vertices, vertices, vertices, vertices, faces, faces};
    if (!within(object.edges, 6 * object.edge_count, ends, true)) {
        t.fault[0] = OUT_OF_RANGE;
        return;
    }
}
for (whole layer = 0; layer < t.layers; ++layer) {
    const whole first = crossings;
    find(layer, silhouettes, crossings);
    if (*t.fault)
        return;
    if (channels == 0 || crossings > t.status[0])
        continue;
    const int* const face = t.face + layer * grid;
    const Space numbers(t.fault, grid * channels * sizeof(real), true);
    if (*t.fault)
        return;
    real* const picture = (real*)numbers.at;
    Seen seen = {t.starts[layer]};
    const real* const behind = t.background + 3 * layer;
    const bool black = colours && !t.background_is_image && behind[0] == 0 && behind[1] == 0 && behind[2] == 0;
    for (int row = 0; row < rows_of_grid; ++row)
        for (int column = 0; column < columns_of_grid; ++column) {
            const whole place = (whole)row * columns_of_grid + column;
            real* const out = picture + 3 * place;
            if (face[place] < 0) {
                if (colours && !black)
                    memcpy(out, background_at(layer, row, column, t.background), 3 * sizeof(real));
                continue;
            }
            if (colours == 0) {
                picture[place] = 1;
                continue;
            }
            see(face[place], column, row, seen);
            picture[slot(place, 3 + (int)objects[seen.object].place)] = 1;
            real albedo[3], light[3], texture[3];
            mix(seen, 3, albedo);
            light_at(seen, light);
            texture_at(seen, texture);
            for (int c = 0; c < 3; ++c)
                out[c] = albedo[c] * light[c] * texture[c];
        }
    for (whole n = first; n < crossings; ++n)
        for (int c = 0; c < channels; ++c) {
            const int* const row = t.crossing + 8 * n;
            t.steps[n * channels + c] = picture[slot(row[7], c)] - picture[slot(row[6], c)];
        }
    for (whole n = first; n < crossings; ++n) {
        const Blend m = blend_of(t.crossing + 8 * n);
        for (int c = 0; c < channels; ++c)
            picture[slot(m.target, c)] += m.amount * t.steps[n * channels + c];
    }
    // Means of the samples, without the margin.
    const auto reduce = [&](const real* from, whole step, real* to) {
        if (t.samples == 1) {
            memcpy(to, from, t.width * step * sizeof(real));
            return;
        }
        for (whole n = 0; n < t.width * step; ++n) {
            const real* const first = from + n / step * t.samples * step + n % step;
            real sum = 0;
            for (whole j = 0; j < t.samples; ++j)
                for (whole i = 0; i < t.samples; ++i)
                    sum += first[(j * columns_of_grid + i) * step];
            to[n] = sum * part;
        }
    };
    for (whole y = 0; y < t.height; ++y) {
        const whole at = (layer * t.height + y) * t.width;
        if (colours)
            reduce(picture + 3 * row_of(y), 3, t.rgb + 3 * at);
        for (whole x = 0; x < t.width && t.coverage; ++x)
            t.coverage[at + x] = 0;
        for (whole m = 0; m < t.masks; ++m) {
            real* const to = t.visible + ((layer * t.masks + m) * t.height + y) * t.width;
            reduce(picture + slot(row_of(y), colours + (int)m), 1, to);
            for (whole x = 0; x < t.width && t.coverage; ++x)
                t.coverage[at + x] += to[x];
        }
    }
}
t.status[1] = crossings;
t.status[2] = silhouettes;
