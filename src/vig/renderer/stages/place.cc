// Objects before their cameras: homogeneous screen points, normals and attributes of vertices, and lights.
// status[0] becomes 1 where an input is not finite.
const auto finite = [](const real* x, whole count) {
    real sums[16] = {};
    whole i = 0;
    for (; i + 16 <= count; i += 16)
        for (int k = 0; k < 16; ++k)
            sums[k] += x[i + k] * 0;
    for (; i < count; ++i)
        sums[0] += x[i] * 0;
    real sum = 0;
    for (int k = 0; k < 16; ++k)
        sum += sums[k];
    return sum == 0;
};
if (!finite(t.background, t.background_numbers))
    t.status[0] = 1;
for (whole o = 0; o < t.objects; ++o) {
    const Object& object = objects[o];
    const whole count = object.vertices, columns = t.columns;
    const whole sizes[INPUTS] = {3 * count, 9, 3, 3 * count, 3 * object.albedo_rows, 9 * object.light_columns,
                                 3, 3, 9, 3, 2, 2, 2 * object.coordinate_rows, 3 * object.texel_rows};
    for (int i = 0; i < INPUTS; ++i)
        if (object.in[i] && !finite(object.in[i], sizes[i]))
            t.status[0] = 1;
    const real* const* const in = object.in;
    real* const light = t.lights + LIGHT_ROW * o;
    for (int i = 0; i < LIGHT_ROW; ++i)
        light[i] = 0;
    light[LIT] = in[LIGHT] || in[LAMP];
    if (in[LIGHT])
        for (int i = 0; i < 27; ++i)
            light[i] = in[LIGHT][object.light_columns == 3 ? i : i / 3];
    if (in[LAMP]) {
        unit(in[LAMP], light + SUN);
        for (int c = 0; c < 3; ++c)
            light[SUN_COLOUR + c] = in[RADIANCE][c];
    }
    real* const world = t.world + 3 * object.first_vertex;
    real* const raw = t.raw + 3 * object.first_vertex;
    const auto turn = [&](const real* turned, const real* v, real* out) {
        for (int i = 0; i < 3; ++i)
            out[i] = turned ? dot(turned + 3 * i, v) : v[i];
    };
    for (whole v = 0; v < count; ++v) {
        turn(in[ROTATION], in[VERTICES] + 3 * v, world + 3 * v);
        if (in[TRANSLATION])
            for (int i = 0; i < 3; ++i)
                world[3 * v + i] += in[TRANSLATION][i];
    }
    if (in[NORMALS]) {
        for (whole v = 0; v < count; ++v)
            turn(in[ROTATION], in[NORMALS] + 3 * v, raw + 3 * v);
    } else {
        for (whole i = 0; i < 3 * count; ++i)
            raw[i] = 0;
        for (whole f = 0; f < object.face_count; ++f) {
            const int* const corner = object.faces + 3 * f;
            const real* const a = world + 3 * corner[0];
            const real* const b = world + 3 * corner[1];
            const real* const c = world + 3 * corner[2];
            const real u[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
            const real w[3] = {c[0] - a[0], c[1] - a[1], c[2] - a[2]};
            const real n[3] = {u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]};
            for (int k = 0; k < 3; ++k)
                for (int i = 0; i < 3; ++i)
                    raw[3 * corner[k] + i] += n[i];
        }
    }
    const real* const focal = in[FOCAL];
    const real* const centre = in[CENTRE];
    for (whole v = 0; v < count; ++v) {
        real* const row = t.attributes + columns * (object.first_vertex + v);
        real* const point = t.points + 3 * (object.first_vertex + v);
        unit(raw + 3 * v, row);
        for (int c = 0; c < 3; ++c)
            row[3 + c] = in[ALBEDO][object.albedo_rows > 1 ? 3 * v + c : c];
        if (columns == 9)
            reflect(light, row, row + 6);
        real seen[3];
        turn(in[EYE_ROTATION], world + 3 * v, seen);
        for (int i = 0; i < 3; ++i)
            seen[i] += in[EYE_TRANSLATION][i];
        // Homogeneous: x and y times depth, divided only where a pixel is known to be beyond the near plane.
        point[0] = seen[0] * focal[0] + centre[0] * seen[2];
        point[1] = seen[1] * focal[1] + centre[1] * seen[2];
        point[2] = seen[2];
    }
}
