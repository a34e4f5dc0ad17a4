// What a call gets: one table of 64-bit numbers, sizes and addresses, filled by `native.py`.
enum { VERTICES, ROTATION, TRANSLATION, NORMALS, ALBEDO, LIGHT, LAMP, RADIANCE, EYE_ROTATION, EYE_TRANSLATION,
       FOCAL, CENTRE, COORDINATES, TEXELS, INPUTS };
typedef wp::int64 whole;
struct Object {
    const real* in[INPUTS];  // 0 where there is none
    real* on[INPUTS];        // cotangents on them, zero at first; 0 where nobody asks
    const int *faces, *edges, *texture_faces, *levels;  // levels: see `Pyramid`
    whole vertices, face_count, edge_count, first_vertex, first_face, place, albedo_rows, light_columns;
    whole coordinate_rows, texel_rows, level_count;
};
struct Arguments {
FIELDS
};
const Arguments& t = *(const Arguments*)table;
const Object* const objects = (const Object*)(table + sizeof(Arguments));
constexpr int LIGHT_ROW = 34, SUN = 27, SUN_COLOUR = 30, LIT = 33;
// What t.fault[0] becomes; see `native.py`.
enum { NOT_FINITE = 1, OUT_OF_RANGE, NO_MEMORY };
// Memory until the end of its block; null, and told as a fault, where there is none.
struct Space {
    void* at;
    Space(whole* fault, whole bytes, bool cleared = false) : at(malloc(bytes + 1)) {
        if (!at)
            *fault = NO_MEMORY;
        else if (cleared)
            memset(at, 0, bytes);
    }
    ~Space() { free(at); }
};
// Whether the numbers of a table of 3 or 6 columns are from 0 to ends[column] - 1, in two columns of 6 from -1 on.
// Tables are checked in each call, as others may have written to them.
const auto within = [](const int* numbers, whole count, const whole* ends, bool border) {
    constexpr int LANES = 24;
    unsigned last[LANES], more[LANES], outside[LANES] = {}, any = 0;
    for (int k = 0; k < LANES; ++k) {
        last[k] = (unsigned)(ends[k % 6] - 1);
        more[k] = border && (k % 6 == 3 || k % 6 == 5);
    }
    // Differences below zero have the highest bit.
    whole n = 0;
    for (; n + LANES <= count; n += LANES)
        for (int k = 0; k < LANES; ++k)
            outside[k] |= (numbers[n + k] + more[k]) | (last[k] - numbers[n + k]);
    for (int k = 0; n + k < count; ++k)
        outside[k] |= (numbers[n + k] + more[k]) | (last[k] - numbers[n + k]);
    for (int k = 0; k < LANES; ++k)
        any |= outside[k];
    return any >> 31 == 0;
};
const auto all_within = [&](const int* faces, const Object& object, whole end) {
    const whole ends[6] = {end, end, end, end, end, end};
    return within(faces, 3 * object.face_count, ends, false);
};
for (whole o = 0; o < t.objects; ++o) {
    const Object& object = objects[o];
    bool fits = all_within(object.faces, object, object.vertices);
    if (object.in[TEXELS])
        fits &= object.level_count > 0 && all_within(object.texture_faces, object, object.coordinate_rows);
    for (whole l = 0; l < object.level_count && object.in[TEXELS]; ++l) {
        const int* const level = object.levels + 3 * l;
        fits &= level[0] >= 0 && level[1] > 0 && level[2] > 0;
        fits &= level[0] + (whole)level[1] * level[2] <= object.texel_rows;
    }
    if (!fits) {
        t.fault[0] = OUT_OF_RANGE;
        return;
    }
}

const auto dot = [](const real* a, const real* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; };
// Of length one; short vectors become zero. Scaled first, as squares may leave the range of numbers.
const auto unit = [](const real* v, real* out) {
    real size = 0;
    for (int i = 0; i < 3; ++i)
        size = wp::max(size, wp::abs(v[i]));
    real length = 0;
    for (int i = 0; i < 3; ++i) {
        out[i] = size > SHORTEST ? v[i] / size : 0;
        length += out[i] * out[i];
    }
    const real inverse = length > 0 ? 1 / wp::sqrt(length) : 0;
    for (int i = 0; i < 3; ++i)
        out[i] *= inverse;
    return size > SHORTEST ? inverse / size : 0;  // one over the length
};
// What a cotangent g on the unit vector n is on the vector itself, `inverse` being one over its length.
const auto pull_unit = [](const real* n, real inverse, const real* g, real* out) {
    const real along = n[0] * g[0] + n[1] * g[1] + n[2] * g[2];
    for (int i = 0; i < 3; ++i)
        out[i] = (g[i] - n[i] * along) * inverse;
};
// Lobes A_l Y_lm of a normal.
const auto lobes_of = [](const real* n, real* lobes) {
    const real x = n[0], y = n[1], z = n[2];
    const real all[9] = {C0, C1 * y, C1 * z, C1 * x, C2 * x * y, C2 * y * z, C20 * (3 * z * z - 1), C2 * x * z,
                         C2 / 2 * (x * x - y * y)};
    for (int i = 0; i < 9; ++i)
        lobes[i] = all[i];
};
// What a white surface of normal n reflects; a light is 9 x 3 coefficients, the sun's direction and colour, lit.
const auto reflect = [&](const real* light, const real* n, real* out) {
    real lobes[9];
    lobes_of(n, lobes);
    real sum[3] = {};
    for (int l = 0; l < 9; ++l)
        for (int c = 0; c < 3; ++c)
            sum[c] += lobes[l] * light[3 * l + c];
    const real cosine = wp::max(n[0] * light[SUN] + n[1] * light[SUN + 1] + n[2] * light[SUN + 2], real(0));
    for (int c = 0; c < 3; ++c)
        out[c] = light[LIT] != 0 ? wp::max(sum[c], real(0)) + cosine * light[SUN_COLOUR + c] : 1;
};
// A cotangent g on it: added to on_n and, in double precision, to on_light.
const auto pull_reflect = [&](const real* light, const real* n, const real* g, real* on_n, double* on_light) {
    if (light[LIT] == 0)
        return;
    real lobes[9], sum[3] = {}, by_lobe[9];
    lobes_of(n, lobes);
    for (int l = 0; l < 9; ++l)
        for (int c = 0; c < 3; ++c)
            sum[c] += lobes[l] * light[3 * l + c];
    const real up[3] = {sum[0] >= 0 ? g[0] : 0, sum[1] >= 0 ? g[1] : 0, sum[2] >= 0 ? g[2] : 0};
    for (int l = 0; l < 9; ++l) {
        by_lobe[l] = dot(up, light + 3 * l);
        for (int c = 0; c < 3; ++c)
            on_light[3 * l + c] += lobes[l] * up[c];
    }
    const real x = n[0], y = n[1], z = n[2];
    on_n[0] += C1 * by_lobe[3] + C2 * (y * by_lobe[4] + z * by_lobe[7] + x * by_lobe[8]);
    on_n[1] += C1 * by_lobe[1] + C2 * (x * by_lobe[4] + z * by_lobe[5] - y * by_lobe[8]);
    on_n[2] += C1 * by_lobe[2] + C2 * (y * by_lobe[5] + x * by_lobe[7]) + 6 * C20 * z * by_lobe[6];
    const real* const sun = light + SUN;
    const real* const colour = light + SUN_COLOUR;
    const real cosine = dot(n, sun);
    if (cosine >= 0) {
        const real pulled = dot(g, colour);
        for (int c = 0; c < 3; ++c) {
            on_n[c] += pulled * sun[c];
            on_light[SUN + c] += pulled * n[c];
            on_light[SUN_COLOUR + c] += cosine * g[c];
        }
    }
};
// How many numbers an input of an object has.
const auto numbers_of = [](const Object& object, int input) {
    const whole vertices = 3 * object.vertices;
    const whole counts[INPUTS] = {vertices, 9, 3, vertices, 3 * object.albedo_rows, 9 * object.light_columns,
                                  3, 3, 9, 3, 2, 2, 2 * object.coordinate_rows, 3 * object.texel_rows};
    return counts[input];
};
const auto clear = [](real* numbers, whole count) {
    if (numbers)
        memset(numbers, 0, count * sizeof(real));
};
// What is added to is cleared here: torch would share that out to its threads.
const auto clear_cotangents = [&]() {
    clear(t.to_points, 3 * t.vertices);
    clear(t.to_attributes, t.columns * t.vertices);
    clear(t.to_lights, LIGHT_ROW * t.objects);
    for (whole o = 0; o < t.objects; ++o)
        for (int i = 0; i < INPUTS; ++i)
            clear(objects[o].on[i], numbers_of(objects[o], i));
};
