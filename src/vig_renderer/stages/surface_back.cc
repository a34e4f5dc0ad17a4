// Cotangents on depth and normals, pulled back to points and attributes.
clear_cotangents();
for (whole layer = 0; layer < t.layers; ++layer) {
    Seen seen = {t.starts[layer]};
    for (int y = 0; y < t.height; ++y)
        for (int x = 0; x < t.width; ++x) {
            const whole at = (layer * t.height + y) * t.width + x;
            const int face = t.face[layer * grid + (whole)(y + MARGIN) * columns_of_grid + x + MARGIN];
            if (face < 0)
                continue;
            see(face, x + MARGIN, y + MARGIN, seen);
            Pulled on = {};
            if (t.on_normal) {
                real sum[3], n[3], on_sum[3];
                mix(seen, 0, sum);
                const real inverse = unit(sum, n);
                pull_unit(n, inverse, t.on_normal + 3 * at, on_sum);
                pull_mix(seen, 0, on_sum, on.w);
            }
            if (t.on_depth)
                for (int i = 0; i < 3; ++i) {
                    on.w[i] += t.on_depth[at] * seen.z[i];
                    on.z[i] = t.on_depth[at] * seen.w[i];
                }
            pull_weights(seen, on, x + MARGIN, y + MARGIN);
        }
}
