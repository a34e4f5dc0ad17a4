// Cotangents on points, attributes and lights, pulled back to the inputs of objects.
clear_cotangents();
for (whole o = 0; o < t.objects; ++o) {
    const Object& object = objects[o];
    const real* const* const in = object.in;
    real* const* const on = object.on;
    const whole count = object.vertices, first = object.first_vertex, columns = t.columns;
    const real* const light = t.lights + LIGHT_ROW * o;
    const real* const world = t.world + 3 * first;
    const real* const raw = t.raw + 3 * first;
    double on_light[LIGHT_ROW] = {}, on_eye[9] = {}, on_eye_place[3] = {}, on_focal[2] = {}, on_centre[2] = {};
    double on_turn[9] = {}, on_place[3] = {}, on_albedo[3] = {};
    if (t.on_lights)
        for (int i = 0; i < LIGHT_ROW; ++i)
            on_light[i] = t.on_lights[LIGHT_ROW * o + i];
    const Space cotangents(t.fault, 6 * count * sizeof(real), true);
    if (*t.fault)
        return;
    real* const on_raw = (real*)cotangents.at;
    real* const on_world = on_raw + 3 * count;
    if (t.on_attributes)
        for (whole v = 0; v < count; ++v) {
            const real* const g = t.on_attributes + columns * (first + v);
            if (on[ALBEDO] && object.albedo_rows > 1)
                for (int c = 0; c < 3; ++c)
                    on[ALBEDO][3 * v + c] += g[3 + c];
            else
                for (int c = 0; c < 3; ++c)
                    on_albedo[c] += g[3 + c];
            const real* const n = t.attributes + columns * (first + v);
            real on_n[3] = {g[0], g[1], g[2]}, ignored[3];
            if (columns == 9 && (g[6] != 0 || g[7] != 0 || g[8] != 0))
                pull_reflect(light, n, g + 6, on_n, on_light);
            if (on_n[0] != 0 || on_n[1] != 0 || on_n[2] != 0)
                pull_unit(n, unit(raw + 3 * v, ignored), on_n, on_raw + 3 * v);
        }
    if (t.on_points) {
        const real* const eye = in[EYE_ROTATION];
        for (whole v = 0; v < count; ++v) {
            const real* const g = t.on_points + 3 * (first + v);
            if (g[0] == 0 && g[1] == 0 && g[2] == 0)
                continue;
            const real* const place = world + 3 * v;
            const real pulled[3] = {g[0] * in[FOCAL][0], g[1] * in[FOCAL][1],
                                    g[0] * in[CENTRE][0] + g[1] * in[CENTRE][1] + g[2]};
            const real depth = dot(eye + 6, place) + in[EYE_TRANSLATION][2];
            for (int i = 0; i < 2; ++i) {
                on_focal[i] += g[i] * (dot(eye + 3 * i, place) + in[EYE_TRANSLATION][i]);
                on_centre[i] += g[i] * depth;
            }
            for (int i = 0; i < 3; ++i) {
                on_eye_place[i] += pulled[i];
                for (int j = 0; j < 3; ++j) {
                    on_eye[3 * i + j] += pulled[i] * place[j];
                    on_world[3 * v + j] += eye[3 * i + j] * pulled[i];
                }
            }
        }
    }
    if (in[NORMALS] && t.on_attributes) {
        for (whole v = 0; v < count; ++v)
            for (int i = 0; i < 3; ++i)
                for (int j = 0; j < 3; ++j) {
                    on_turn[3 * i + j] += on_raw[3 * v + i] * in[NORMALS][3 * v + j];
                    if (on[NORMALS])
                        on[NORMALS][3 * v + j] += (in[ROTATION] ? in[ROTATION][3 * i + j] : real(i == j)) * on_raw[3 * v + i];
                }
    } else if (t.on_attributes) {
        for (whole f = 0; f < object.face_count; ++f) {
            const int* const corner = object.faces + 3 * f;
            const whole at[3] = {3 * (whole)corner[0], 3 * (whole)corner[1], 3 * (whole)corner[2]};
            real g[3], u[3], w[3];
            for (int i = 0; i < 3; ++i) {
                g[i] = on_raw[at[0] + i] + on_raw[at[1] + i] + on_raw[at[2] + i];
                u[i] = world[at[1] + i] - world[at[0] + i];
                w[i] = world[at[2] + i] - world[at[0] + i];
            }
            if (g[0] == 0 && g[1] == 0 && g[2] == 0)
                continue;
            // The normal is the cross product of u and w.
            const real on_u[3] = {w[1] * g[2] - w[2] * g[1], w[2] * g[0] - w[0] * g[2], w[0] * g[1] - w[1] * g[0]};
            const real on_w[3] = {g[1] * u[2] - g[2] * u[1], g[2] * u[0] - g[0] * u[2], g[0] * u[1] - g[1] * u[0]};
            for (int i = 0; i < 3; ++i) {
                on_world[at[0] + i] -= on_u[i] + on_w[i];
                on_world[at[1] + i] += on_u[i];
                on_world[at[2] + i] += on_w[i];
            }
        }
    }
    for (whole v = 0; v < count; ++v)
        for (int i = 0; i < 3; ++i) {
            const real g = on_world[3 * v + i];
            on_place[i] += g;
            for (int j = 0; j < 3; ++j) {
                on_turn[3 * i + j] += g * in[VERTICES][3 * v + j];
                if (on[VERTICES])
                    on[VERTICES][3 * v + j] += (in[ROTATION] ? in[ROTATION][3 * i + j] : real(i == j)) * g;
            }
        }
    const auto add = [&](int input, const double* values, int count) {
        for (int i = 0; i < count && on[input]; ++i)
            on[input][i] += (real)values[i];
    };
    add(ROTATION, on_turn, 9);
    add(TRANSLATION, on_place, 3);
    add(EYE_ROTATION, on_eye, 9);
    add(EYE_TRANSLATION, on_eye_place, 3);
    add(FOCAL, on_focal, 2);
    add(CENTRE, on_centre, 2);
    if (object.albedo_rows == 1)
        add(ALBEDO, on_albedo, 3);
    if (on[LIGHT])
        for (int i = 0; i < 27; ++i)
            on[LIGHT][object.light_columns == 3 ? i : i / 3] += (real)on_light[i];
    if (on[LAMP]) {
        const real g[3] = {(real)on_light[SUN], (real)on_light[SUN + 1], (real)on_light[SUN + 2]};
        real n[3], pulled[3];
        const real inverse = unit(in[LAMP], n);
        pull_unit(n, inverse, g, pulled);
        for (int i = 0; i < 3; ++i)
            on[LAMP][i] += pulled[i];
    }
    add(RADIANCE, on_light + SUN_COLOUR, 3);
}
