// Objects before their cameras: homogeneous screen points, normals and attributes of vertices, and lights.
// NOT_FINITE: an input is not finite or a focal length not above zero.
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
    t.fault[0] = NOT_FINITE;
for (whole o = 0; o < t.objects; ++o) {
    const Object& object = objects[o];
    const whole count = object.vertices, columns = t.columns;
    for (int i = 0; i < INPUTS; ++i)
        if (object.in[i] && !finite(object.in[i], numbers_of(object, i)))
            t.fault[0] = NOT_FINITE;
    const real* const* const in = object.in;
    if (!(in[FOCAL][0] > 0 && in[FOCAL][1] > 0))
        t.fault[0] = NOT_FINITE;
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
    const real* const eye = in[EYE_ROTATION];
    const real* const eye_place = in[EYE_TRANSLATION];
    // Vertices side by side; those that are left over repeat the last and are not written.
    constexpr int SIDE = 16;
    for (whole base = 0; base < count; base += SIDE) {
        real n[3][SIDE], at[3][SIDE], size[SIDE], length[SIDE], lit[3][SIDE], seen[3][SIDE];
        for (int k = 0; k < SIDE; ++k) {
            const whole v = 3 * wp::min(base + k, count - 1);
            for (int i = 0; i < 3; ++i) {
                n[i][k] = raw[v + i];
                at[i][k] = world[v + i];
            }
        }
        for (int k = 0; k < SIDE; ++k) {
            // As `unit`.
            size[k] = wp::max(wp::max(wp::abs(n[0][k]), wp::abs(n[1][k])), wp::abs(n[2][k]));
            for (int i = 0; i < 3; ++i)
                n[i][k] = size[k] > SHORTEST ? n[i][k] / size[k] : 0;
            length[k] = n[0][k] * n[0][k] + n[1][k] * n[1][k] + n[2][k] * n[2][k];
        }
        for (int k = 0; k < SIDE; ++k)
            length[k] = length[k] > 0 ? 1 / wp::sqrt(length[k]) : 0;
        for (int i = 0; i < 3; ++i)
            for (int k = 0; k < SIDE; ++k)
                n[i][k] *= length[k];
        for (int c = 0; c < 3 && columns == 9; ++c) {
            const real* const l = light + c;
            for (int k = 0; k < SIDE; ++k) {
                // As `reflect`.
                const real x = n[0][k], y = n[1][k], z = n[2][k];
                const real sky = C0 * l[0] + C1 * (y * l[3] + z * l[6] + x * l[9]) + C20 * (3 * z * z - 1) * l[18] +
                                 C2 * (x * y * l[12] + y * z * l[15] + x * z * l[21] + (x * x - y * y) / 2 * l[24]);
                const real cosine = x * light[SUN] + y * light[SUN + 1] + z * light[SUN + 2];
                lit[c][k] = (sky > 0 ? sky : 0) + (cosine > 0 ? cosine : 0) * light[SUN_COLOUR + c];
            }
        }
        for (int i = 0; i < 3; ++i)
            for (int k = 0; k < SIDE; ++k)
                seen[i][k] = eye[3 * i] * at[0][k] + eye[3 * i + 1] * at[1][k] + eye[3 * i + 2] * at[2][k] + eye_place[i];
        // Homogeneous: x and y times depth, divided only where a pixel is known to be beyond the near plane.
        for (int i = 0; i < 2; ++i)
            for (int k = 0; k < SIDE; ++k)
                seen[i][k] = seen[i][k] * focal[i] + centre[i] * seen[2][k];
        for (int k = 0; k < SIDE && base + k < count; ++k) {
            real* const row = t.attributes + columns * (object.first_vertex + base + k);
            real* const point = t.points + 3 * (object.first_vertex + base + k);
            for (int i = 0; i < 3; ++i) {
                row[i] = n[i][k];
                row[3 + i] = in[ALBEDO][object.albedo_rows > 1 ? 3 * (base + k) + i : i];
                if (columns == 9)
                    row[6 + i] = light[LIT] != 0 ? lit[i][k] : 1;
                point[i] = seen[i][k];
            }
        }
    }
}
