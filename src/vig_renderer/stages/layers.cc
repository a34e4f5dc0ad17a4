// What the passes over pictures share. Their grid has `samples` points a pixel each way, and a margin around.
const int columns_of_grid = (int)(t.width * t.samples) + 2 * MARGIN;
const int rows_of_grid = (int)(t.height * t.samples) + 2 * MARGIN;
const whole grid = (whole)columns_of_grid * rows_of_grid;
const real scale = (real)t.samples;
const real part = 1 / (scale * scale);
// A picture on the grid: colours (grid, 3), then a plane of each mask. Where number c of a point lies; and, of
// row y of the image, how far its first point and colours are from the beginning.
const int channels = (int)t.channels, colours = (int)(t.channels - t.masks);
const auto slot = [&](whole place, int c) {
    return c < colours ? 3 * place + c : c * grid + place;
};
const auto row_of = [&](whole y) { return (y * t.samples + MARGIN) * columns_of_grid + MARGIN; };

// An object of which a face numbered through is one; `last` is where the search begins.
const auto owner_of = [&](whole face, whole& last) {
    while (face < objects[last].first_face)
        --last;
    while (face >= objects[last].first_face + objects[last].face_count)
        ++last;
    return last;
};
// A face seen at a pixel's centre: its vertices, numbered through, from there (x and y still times the depth z),
// barycentric weights w = e / sum of e, e being twice the areas opposite each corner times two depths.
struct Seen {
    whole object, face, vertex[3];
    real x[3], y[3], z[3], e[3], w[3], inverse;
};
const auto see = [&](whole face, int column, int row, Seen& seen) {
    const Object& object = objects[owner_of(face, seen.object)];
    seen.face = face - object.first_face;
    const real dx = MARGIN - column - real(0.5), dy = MARGIN - row - real(0.5);
    for (int i = 0; i < 3; ++i) {
        seen.vertex[i] = object.first_vertex + object.faces[3 * seen.face + i];
        const real* const point = t.points + 3 * seen.vertex[i];
        seen.x[i] = point[0] * scale + dx * point[2];
        seen.y[i] = point[1] * scale + dy * point[2];
        seen.z[i] = point[2];
    }
    real* const e = seen.e;
    e[0] = seen.x[1] * seen.y[2] - seen.x[2] * seen.y[1];
    e[1] = seen.x[2] * seen.y[0] - seen.x[0] * seen.y[2];
    e[2] = seen.x[0] * seen.y[1] - seen.x[1] * seen.y[0];
    seen.inverse = 1 / (e[0] + e[1] + e[2]);
    for (int i = 0; i < 3; ++i)
        seen.w[i] = e[i] * seen.inverse;
};
// Cotangents on what is known of a seen point, and their way back to its corners.
struct Pulled {
    real w[3], e[3], x[3], y[3], z[3];
};
const auto pull_weights = [&](const Seen& seen, const Pulled& on, int column, int row) {
    const real mean = dot(seen.w, on.w);
    const real e[3] = {(on.w[0] - mean) * seen.inverse + on.e[0], (on.w[1] - mean) * seen.inverse + on.e[1],
                       (on.w[2] - mean) * seen.inverse + on.e[2]};
    const real* const x = seen.x;
    const real* const y = seen.y;
    const real on_x[3] = {e[2] * y[1] - e[1] * y[2], e[0] * y[2] - e[2] * y[0], e[1] * y[0] - e[0] * y[1]};
    const real on_y[3] = {e[1] * x[2] - e[2] * x[1], e[2] * x[0] - e[0] * x[2], e[0] * x[1] - e[1] * x[0]};
    const real dx = MARGIN - column - real(0.5), dy = MARGIN - row - real(0.5);
    for (int i = 0; i < 3; ++i) {
        real* const to = t.to_points + 3 * seen.vertex[i];
        const real gx = on_x[i] + on.x[i], gy = on_y[i] + on.y[i];
        to[0] += gx * scale;
        to[1] += gy * scale;
        to[2] += gx * dx + gy * dy + on.z[i];
    }
};
// Vertex attributes from column `first` on, interpolated; and the way back, which adds to on_w.
const auto mix = [&](const Seen& seen, int first, real* out) {
    for (int c = 0; c < 3; ++c)
        out[c] = 0;
    for (int i = 0; i < 3; ++i) {
        const real* const row = t.attributes + t.columns * seen.vertex[i] + first;
        for (int c = 0; c < 3; ++c)
            out[c] += seen.w[i] * row[c];
    }
};
const auto pull_mix = [&](const Seen& seen, int first, const real* g, real* on_w) {
    for (int i = 0; i < 3; ++i) {
        on_w[i] += dot(t.attributes + t.columns * seen.vertex[i] + first, g);
        real* const to = t.to_attributes + t.columns * seen.vertex[i] + first;
        for (int c = 0; c < 3; ++c)
            to[c] += seen.w[i] * g[c];
    }
};
// A vertex on the grid's screen: x, y and one over its depth, 0 nearer than NEAR.
const auto on_screen = [&](const real* point, real* out) {
    const real q = point[2] >= NEAR ? 1 / point[2] : 0;
    out[0] = point[0] * scale * q + MARGIN * (q != 0);
    out[1] = point[1] * scale * q + MARGIN * (q != 0);
    out[2] = q;
};
// A silhouette edge on the screen: along x and y, square of its length, and the square of its normal's x.
struct Slope {
    real x, y, square, steep;
};
const auto slope_of = [&](const real* a, const real* b) {
    Slope s;
    s.x = b[0] - a[0];
    s.y = b[1] - a[1];
    s.square = wp::max(s.x * s.x + s.y * s.y, real(1e-12));
    s.steep = s.y * s.y / s.square;
    return s;
};
// How a crossing blends its two pixels: `amount` of the difference goes to the one in whose half it lies.
struct Blend {
    whole first, second, target;  // the edge's ends, and the pixel that is blended
    real u0, v0, u1, v1, at, share, length, near0, near1, own, joint0, joint1, weight, amount;
};
const auto blend_of = [&](const int* crossing) {
    Blend m;
    m.first = t.chosen[4 * (whole)crossing[0]];
    m.second = t.chosen[4 * (whole)crossing[0] + 1];
    real a[3], b[3];
    on_screen(t.points + 3 * m.first, a);
    on_screen(t.points + 3 * m.second, b);
    const int axis = crossing[1];
    m.u0 = a[axis];
    m.v0 = a[1 - axis];
    m.u1 = b[axis];
    m.v1 = b[1 - axis];
    m.at = (crossing[2] + real(0.5) - m.v0) / (m.v1 - m.v0);
    m.share = m.u0 + m.at * (m.u1 - m.u0) - real(0.5) - crossing[3];
    const Slope slope = slope_of(a, b);
    // Within a pixel of an end, or over the whole edge where that is shorter, the joint's mean takes over.
    m.length = wp::max(wp::sqrt(slope.square), real(1));
    m.near0 = wp::max(1 - m.at * m.length, real(0));
    m.near1 = wp::max(1 - (1 - m.at) * m.length, real(0));
    m.own = slope.steep;
    m.joint0 = t.joints[2 * m.first];
    m.joint1 = t.joints[2 * m.second];
    const real weight = m.own + m.near0 * (m.joint0 - m.own) + m.near1 * (m.joint1 - m.own);
    m.weight = axis ? 1 - weight : weight;
    m.amount = m.weight * (real(0.5) - m.share) / crossing[4];
    m.target = m.share < real(0.5) ? crossing[6] : crossing[7];
    return m;
};
