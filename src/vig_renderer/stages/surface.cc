// Of the surface at pixels' centres: depth, unit normals and numbers of object and triangle; face is of the grid.
for (whole layer = 0; layer < t.layers; ++layer) {
    Seen seen = {t.starts[layer]};
    for (int y = 0; y < t.height; ++y)
        for (int x = 0; x < t.width; ++x) {
            const whole at = (layer * t.height + y) * t.width + x;
            const int face = t.face[layer * grid + (whole)(y + MARGIN) * columns_of_grid + x + MARGIN];
            if (face < 0) {
                t.depth[at] = (real)(1e300 * 1e300);  // infinity
                t.normal[3 * at] = t.normal[3 * at + 1] = t.normal[3 * at + 2] = 0;
                t.object_id[at] = t.triangle_id[at] = -1;
                continue;
            }
            see(face, x + MARGIN, y + MARGIN, seen);
            real sum[3];
            mix(seen, 0, sum);
            unit(sum, t.normal + 3 * at);
            t.depth[at] = dot(seen.w, seen.z);
            t.object_id[at] = (int)objects[seen.object].place;
            t.triangle_id[at] = (int)seen.face;
        }
}
