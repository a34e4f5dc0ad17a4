// Blending across occlusion edges: analytic coverage, its cotangents, its motion.
// Between two neighbouring pixels an occlusion edge may pass, at a share t of the way from one centre to the other. The
// nearer pixel is then partly the other's surface: by |t - 1/2|, which is its analytic coverage along that direction.
// Log-likelihoods (not colours) are blended by it, so the objective is continuous and differentiable in the edge's place
// (docs/objective.md lists where it is not). An edge is seen both by rows and by columns; the shares nx^2 and ny^2 of its
// screen normal, interpolated along the edge, weigh the two, so that area is kept and nothing jumps where one edge hands
// over to the next. tests/vig/likelihood/reference.py computes the same value in plain torch.
#include <algorithm>

#include "likelihood.h"

namespace vig {
namespace {

constexpr double BEHIND_EDGE = 0.002;       // metres by which the surface beyond an occlusion edge must lie behind it
constexpr double BEFORE_EDGE = 0.04;        // metres by which the edge's own surface may come forward within a pixel
constexpr double MIN_SQUARE = 1e-12;      // squared length in the image of an edge's normal below which it is rounding
constexpr double MIN_BRIGHTNESS = 1e-6;   // squared albedo by which edges' rows are divided at least
constexpr double MIN_GAIN = 0.1;          // nats per pixel added to an edge's gain: its curvature would have a pole
constexpr double CURVATURE = 0.5;           // share of a gain per pixel that counts as curvature per pixel squared
constexpr int BOUNDARY_ROWS = 16;           // of the normal matrix kept for edges, per pixel of width and height
constexpr int MIN_BOUNDARY_ROWS = 4096;   // a small image may be full of edges

// From the face's first corner, its other two weights grow by by_second, by_third a pixel; q by slope from base; q times
// irradiance by lit_slope from lit_base.
template <class R> struct Surface {
    int i, j, k;
    R origin_x, origin_y;
    Vec2<R> by_second, by_third;
    R lit_base, base;
    Vec2<R> lit_slope, slope;
};

template <class R> Surface<R> surface_of(const Task<R>& task, int face) {
    const int32_t* const corners = &task.geometry.corners[3 * (size_t)face];
    Surface<R> s;
    s.i = corners[0];
    s.j = corners[1];
    s.k = corners[2];
    const R *const a = &task.work.points[4 * (size_t)s.i], *const b = &task.work.points[4 * (size_t)s.j];
    const R* const c = &task.work.points[4 * (size_t)s.k];
    const R bx = b[0] - a[0], by = b[1] - a[1], cx = c[0] - a[0], cy = c[1] - a[1];
    // Gradients of the barycentric weights of corners b and c on the screen (Cramer's rule).
    const R inverse = 1 / (bx * cy - by * cx);
    s.origin_x = a[0];
    s.origin_y = a[1];
    s.by_second = {cy * inverse, -cx * inverse};
    s.by_third = {-by * inverse, bx * inverse};
    // q and q times irradiance are linear on the screen: perspective-correct interpolation (Blinn 1992).
    const R lit_a = a[2] * a[3], lit_b = b[2] * b[3] - lit_a, lit_c = c[2] * c[3] - lit_a;
    const R q_b = b[2] - a[2], q_c = c[2] - a[2];
    s.lit_base = lit_a;
    s.lit_slope = {s.by_second.x * lit_b + s.by_third.x * lit_c, s.by_second.y * lit_b + s.by_third.y * lit_c};
    s.base = a[2];
    s.slope = {s.by_second.x * q_b + s.by_third.x * q_c, s.by_second.y * q_b + s.by_third.y * q_c};
    return s;
}

// The surface at a pixel: irradiance, and one over the depth.
template <class R> struct Seen {
    R irradiance, q;
};

template <class R> Seen<R> seen_at(const Surface<R>& s, Vec2<R> pixel) {
    const R x = pixel.x - s.origin_x, y = pixel.y - s.origin_y;
    const R q = s.base + s.slope.x * x + s.slope.y * y;
    return {(s.lit_base + s.lit_slope.x * x + s.lit_slope.y * y) / q, q};
}

// Pull a cotangent on the irradiance seen at one pixel back to the corners: `lit` and `depth` are the cotangents on q
// times irradiance and on q.
template <class R> void pull_pixel(Task<R>& task, const Surface<R>& s, Vec2<R> pixel, Seen<R> seen, R on_seen) {
    // irradiance = lit / q: d/d lit = 1 / q, d/d q = -irradiance / q.
    const R lit = on_seen / seen.q, depth = -lit * seen.irradiance;
    const R x = pixel.x - s.origin_x, y = pixel.y - s.origin_y;
    const R b = s.by_second.x * x + s.by_second.y * y, c = s.by_third.x * x + s.by_third.y * y;
    // A corner that moves carries the linear functions along: the value at the pixel changes against them.
    const R move_x = s.lit_slope.x * lit + s.slope.x * depth, move_y = s.lit_slope.y * lit + s.slope.y * depth;
    const int corner[3] = {s.i, s.j, s.k};
    const R share[3] = {1 - b - c, b, c};
    for (int n = 0; n < 3; ++n) {
        const R* const point = &task.work.points[4 * (size_t)corner[n]];
        R* const on = &task.work.on_corner[4 * (size_t)corner[n]];
        on[0] -= share[n] * move_x;
        on[1] -= share[n] * move_y;
        on[2] += share[n] * (point[3] * lit + depth);
        on[3] += share[n] * point[2] * lit;
    }
}

// An occlusion edge from vertex i to j, seen from the face turned to the camera: screen points. fold is -1 where
// both faces lie on one side of it and the one beyond is nearer: near the silhouette such a fold lies between two edges
// that are both crossed; counted against them one crossing is left, and nothing jumps where a pair appears.
template <class R> struct Edge {
    int i, j;
    Vec3<R> a, b;
    R fold;
};

template <class R> Edge<R> edge_of(const Task<R>& task, int number) {
    const Geometry<R>& geometry = task.geometry;
    const Workspace<R>& work = task.work;
    const int32_t* const row = &geometry.edge_table[5 * (size_t)number];
    const int32_t* const corners = &geometry.corners[3 * (size_t)row[2]];
    Edge<R> edge;
    edge.i = row[0];
    edge.j = row[1];
    // The three corners' numbers less the edge's two leave the third.
    int apex = corners[0] + corners[1] + corners[2] - edge.i - edge.j, other = row[4];
    // The edge is taken from the face that is turned to the camera, so that the object lies to one side of it.
    if (!work.facing[row[2]]) {
        std::swap(edge.i, edge.j);
        std::swap(apex, other);
    }
    edge.a = load3(&work.points[4 * (size_t)edge.i]);
    edge.b = load3(&work.points[4 * (size_t)edge.j]);
    edge.fold = 1;
    if (row[3] >= 0) {
        const Vec3<R> to_apex = load3(&work.points[4 * (size_t)apex]) - edge.a;
        const Vec3<R> to_other = load3(&work.points[4 * (size_t)other]) - edge.a;
        if (dot(cross(edge.b - edge.a, to_apex), to_other) < 0)
            edge.fold = -1;
    }
    return edge;
}

// Whether an edge is before the camera and its box touches the image.
template <class R> bool in_frame(const Edge<R>& edge, const Eye<R>& eye) {
    return std::min(edge.a.z, edge.b.z) > 0 && std::max(edge.a.x, edge.b.x) >= 0
        && std::min(edge.a.x, edge.b.x) <= eye.width && std::max(edge.a.y, edge.b.y) >= 0
        && std::min(edge.a.y, edge.b.y) <= eye.height;
}

// Where an edge passes between two pixels in a row (axis 0) or column (axis 1), `share` of the edge's way from a to b and
// t of the way from the lower pixel. inside: fold, with the sign of the axis' side on which the edge's object lies.
// inner, outer: the pixels on its two sides, as places in the image and as image points. gives: whether the nearer pixel,
// the target, is the inner one.
template <class R> struct Crossing {
    int axis, inner, outer;
    R share, length, t, inside;
    bool in_image, gives;
    Vec2<R> inner_pixel, outer_pixel;
};

// u runs along the line, v across.
template <class R> Crossing<R> crossing_of(const Edge<R>& edge, int axis, int line, const Eye<R>& eye) {
    Crossing<R> c;
    c.axis = axis;
    c.length = edge.b[1 - axis] - edge.a[1 - axis];
    c.share = (line + R(0.5) - edge.a[1 - axis]) / c.length;
    c.inside = (c.length < 0) != (axis == 1) ? -edge.fold : edge.fold;
    const R u = edge.a[axis] + c.share * (edge.b[axis] - edge.a[axis]);
    // The last pixel whose centre is before the crossing.
    const R before = std::floor(u - R(0.5));
    const int size = axis == 0 ? eye.width : eye.height;
    c.in_image = before >= 0 && before + 1 < size;
    if (!c.in_image)
        return c;
    const int low = (int)before, inner = c.inside > 0 ? low + 1 : low, outer = c.inside > 0 ? low : low + 1;
    c.t = u - R(0.5) - low;
    // Beyond the half-way point the nearer pixel is the other one.
    c.gives = (c.t < R(0.5)) == (c.inside < 0);
    c.inner = axis == 0 ? line * eye.width + inner : inner * eye.width + line;
    c.outer = axis == 0 ? line * eye.width + outer : outer * eye.width + line;
    const R across = line + R(0.5), in = inner + R(0.5), out = outer + R(0.5);
    c.inner_pixel = axis == 0 ? Vec2<R>{in, across} : Vec2<R>{across, in};
    c.outer_pixel = axis == 0 ? Vec2<R>{out, across} : Vec2<R>{across, out};
    return c;
}

// The surfaces that the two pixels show, with their visible values there; the front one's where its pixel is the target.
template <class R> struct Sides {
    bool has_behind;
    Surface<R> front, behind;
    Seen<R> front_seen, behind_seen;
};

// False unless the inner pixel shows the edge's surface, and the outer one shows a surface behind the edge.
template <class R> bool sides_of(const Task<R>& task, const Edge<R>& edge, const Crossing<R>& c, Sides<R>& sides) {
    const int inner = task.work.visible.face[c.inner], outer = task.work.visible.face[c.outer];
    if (inner == NO_FACE)
        return false;
    // q is linear along the edge on the screen, depth is not.
    const R edge_depth = 1 / ((1 - c.share) * edge.a.z + c.share * edge.b.z);
    // The edge must be where the inner pixel's surface is, else another surface hides it there.
    const R ahead = edge_depth - 1 / task.work.visible.q[c.inner];
    if (!(ahead <= R(BEFORE_EDGE) && ahead >= -R(BEHIND_EDGE)))
        return false;
    sides.has_behind = outer != NO_FACE;
    if (sides.has_behind && !(1 / task.work.visible.q[c.outer] >= edge_depth + R(BEHIND_EDGE)))
        return false;
    if (c.gives) {
        sides.front = surface_of(task, inner);
        sides.front_seen = seen_at(sides.front, c.inner_pixel);
    }
    if (sides.has_behind) {
        sides.behind = surface_of(task, outer);
        sides.behind_seen = seen_at(sides.behind, c.outer_pixel);
    }
    return true;
}

template <class R> Vec3<R> normal_at(const Task<R>& task, int vertex) {
    return load3(&task.work.normals[4 * (size_t)vertex]);
}

// How much of the front surface a target pixel takes, or gives to the surface behind.
// weight: this axis's, times fold. taken: weight times |t - 1/2|, negative when the target is the inner pixel and gives.
// front_irradiance: the target's own if it gives, else the edge's there, which stands `perspective` of the way from
// vertex i's. front_fit, back_fit: Eq. 3 of the target under either surface. gain: nats of the first over the second.
template <class R> struct Blend {
    R weight, taken, front_irradiance, perspective, gain;
    int at;
    Vec3<R> normal, observed;
    Explained<R> front_fit, back_fit;
};

template <class D, class R>
Blend<R> blend_of(const Task<R>& task, Vec3<R> normal, const Edge<R>& edge, const Crossing<R>& c, const Sides<R>& sides) {
    Blend<R> blend;
    blend.normal = normal;
    // cos^2 of the angle between the edge's normal and this axis: the two axes' weights add up to 1.
    const R along = normal[c.axis];
    blend.weight = edge.fold * along * along / (normal.x * normal.x + normal.y * normal.y);
    const R edge_q = (1 - c.share) * edge.a.z + c.share * edge.b.z;
    // Share of the way in space from i to j, of a share of the way on the screen.
    blend.perspective = c.share * edge.b.z / edge_q;
    const R lit_a = task.work.points[4 * (size_t)edge.i + 3], lit_b = task.work.points[4 * (size_t)edge.j + 3];
    blend.at = c.gives ? c.inner : c.outer;
    blend.front_irradiance = c.gives ? sides.front_seen.irradiance : lit_a + blend.perspective * (lit_b - lit_a);
    blend.taken = blend.weight * std::abs(c.t - R(0.5)) * (c.gives ? -1 : 1);
    const Vec3<R> prior = task.pixel(task.log_prior, blend.at);
    blend.observed = task.pixel(task.observed, blend.at);
    blend.front_fit = explain_pixel<D>(blend.observed, task.albedo * blend.front_irradiance, prior, task.noise);
    // Behind the silhouette stands the background, whose likelihood is in the prior.
    blend.back_fit = {prior.z, 0};
    if (sides.has_behind)
        blend.back_fit = explain_pixel<D>(blend.observed, task.albedo * sides.behind_seen.irradiance, prior, task.noise);
    blend.gain = blend.front_fit.log_likelihood - blend.back_fit.log_likelihood;
    return blend;
}

// Pull the weight's cotangent back to the edge's normals; the one on `share` is returned.
template <class R> R pull_normal(Task<R>& task, const Edge<R>& edge, const Crossing<R>& c, const Blend<R>& blend) {
    const Vec3<R> normal = blend.normal;
    const R square = normal.x * normal.x + normal.y * normal.y;
    const R on_weight = edge.fold * std::abs(c.t - R(0.5)) * blend.gain * (c.gives ? -1 : 1);
    // d weight / d normal in the image; columns have the complement of rows.
    const R turn = 2 * normal.x * normal.y / (square * square) * on_weight * (c.axis == 1 ? -1 : 1);
    const Vec3<R> on_normal = {turn * normal.y, -turn * normal.x, 0};
    add3(&task.work.on_normal[4 * (size_t)edge.i], on_normal * (1 - c.share));
    add3(&task.work.on_normal[4 * (size_t)edge.j], on_normal * c.share);
    return dot(task.eye.rotation.transposed(on_normal), normal_at(task, edge.j) - normal_at(task, edge.i));
}

// Pull the colours on both sides back to their faces and to albedo; the cotangent on the edge's own irradiance is
// returned.
template <class D, class R>
R pull_colours(Task<R>& task, const Crossing<R>& c, const Sides<R>& sides, const Blend<R>& blend, Gain<R>& gain) {
    const R half_precision = task.noise.half_precision;
    const auto pull = [&](R taken, R posterior, R irradiance) {
        const Vec3<R> error = blend.observed - task.albedo * irradiance;
        const R strength = taken * posterior * 2 * half_precision * D::pull(dot(error, error) * half_precision);
        for (int channel = 0; channel < 3; ++channel)
            gain.albedo[channel] += error[channel] * (strength * irradiance);
        return strength * dot(task.albedo, error);
    };
    R on_edge = pull(blend.taken, blend.front_fit.visible, blend.front_irradiance);
    if (c.gives) {
        pull_pixel(task, sides.front, c.inner_pixel, sides.front_seen, on_edge);
        on_edge = 0;
    }
    if (sides.has_behind) {
        const R on_behind = pull(-blend.taken, blend.back_fit.visible, sides.behind_seen.irradiance);
        pull_pixel(task, sides.behind, c.outer_pixel, sides.behind_seen, on_behind);
    }
    return on_edge;
}

// (x, y) of a point at u along an axis and v across it.
template <class R> Vec3<R> on_axis(int axis, R u, R v) { return axis == 0 ? Vec3<R>{u, v, 0} : Vec3<R>{v, u, 0}; }

// Pull cotangents on the edge's irradiance, on `share` and on u (in motion_a, motion_b) back to the edge's ends.
template <class R>
void pull_edge(Task<R>& task, const Edge<R>& edge, const Crossing<R>& c, R perspective, R on_edge, R on_share,
               Vec3<R> motion_a, Vec3<R> motion_b) {
    const R edge_q = (1 - c.share) * edge.a.z + c.share * edge.b.z;
    const R on_perspective = on_edge * (task.work.points[4 * (size_t)edge.j + 3] - task.work.points[4 * (size_t)edge.i + 3]);
    // d perspective / d (q of i, q of j), by the quotient rule.
    const R by_q = on_perspective * c.share * (1 - c.share) / (edge_q * edge_q);
    const R by_share = (on_share + on_perspective * edge.a.z * edge.b.z / (edge_q * edge_q)) / c.length;
    const Vec3<R> on_a = motion_a + on_axis(c.axis, R(0), -(1 - c.share) * by_share);
    const Vec3<R> on_b = motion_b + on_axis(c.axis, R(0), -c.share * by_share);
    const auto add = [&](int vertex, Vec3<R> on, R on_q, R lit) {
        R* const to = &task.work.on_corner[4 * (size_t)vertex];
        to[0] += on.x;
        to[1] += on.y;
        to[2] += on_q;
        to[3] += lit;
    };
    add(edge.i, on_a, -by_q * edge.b.z, on_edge * (1 - perspective));
    add(edge.j, on_b, by_q * edge.a.z, on_edge * perspective);
}

// The edge's motion along the line, for a row of the normal matrix. Gauss-Newton has no residual here: the cusp of gain per
// pixel is taken one pixel wide.
template <class R>
void keep_motion(Task<R>& task, const Edge<R>& edge, const Blend<R>& blend, Vec3<R> motion_a, Vec3<R> motion_b) {
    const R brightness = std::max(dot(task.albedo, task.albedo), R(MIN_BRIGHTNESS));
    const R steepness = std::abs(blend.weight * blend.gain) + R(MIN_GAIN);
    // (root x motion)^2 = curvature x steepness: a second derivative of the gain's size in a pixel.
    const R root = std::sqrt(R(CURVATURE) / (steepness * brightness));
    task.work.crossed.insert(task.work.crossed.end(), {edge.i, edge.j});
    for (const Vec3<R> v : {edge.a, motion_a * root, edge.b, motion_b * root})
        task.work.motions.insert(task.work.motions.end(), {v.x, v.y, v.z, 0});
}

// The first line of pixels whose centres are at or after a place across them, at most `lines`; 0 for NaN.
template <class R> int line_after(R place, int lines) {
    const R line = std::ceil(place - R(0.5));
    return line > 0 ? line < lines ? (int)line : lines : 0;
}

template <class D, class R> Gain<R> blend_edges(Task<R>& task, const std::vector<int32_t>& edges) {
    Gain<R> gain;
    const Eye<R>& eye = task.eye;
    const size_t most = std::max(MIN_BOUNDARY_ROWS, BOUNDARY_ROWS * (eye.width + eye.height));
    for (const int number : edges) {
        const Edge<R> edge = edge_of(task, number);
        if (!in_frame(edge, eye))
            continue;
        for (int axis = 0; axis < 2; ++axis) {
            // The lines of pixels that the edge crosses; their centres are at half-integers.
            const R va = edge.a[1 - axis], vb = edge.b[1 - axis];
            const int lines = axis == 0 ? eye.height : eye.width;
            const int first = line_after(std::min(va, vb), lines), end = line_after(std::max(va, vb), lines);
            for (int line = first; line < end; ++line) {
                const Crossing<R> c = crossing_of(edge, axis, line, eye);
                Sides<R> sides;
                if (!c.in_image || !sides_of(task, edge, c, sides))
                    continue;
                const Vec3<R> in_world = normal_at(task, edge.i) * (1 - c.share) + normal_at(task, edge.j) * c.share;
                const Vec3<R> normal = eye.rotation * in_world;
                if (normal.x * normal.x + normal.y * normal.y < R(MIN_SQUARE))
                    continue;
                const Blend<R> blend = blend_of<D>(task, normal, edge, c, sides);
                gain.value += blend.taken * blend.gain;
                // Coverage changes at the silhouette alone, not where the object hides parts of itself.
                if (task.images && !sides.has_behind)
                    task.work.coverage[blend.at] += blend.taken;
                if (!task.order)
                    continue;
                const R on_share = pull_normal(task, edge, c, blend);
                const R on_edge = pull_colours<D>(task, c, sides, blend, gain);
                // taken grows by weight for each pixel that the edge moves outwards, whichever pixel is the target.
                const R on_u = -c.inside * blend.weight * blend.gain, on_a = (1 - c.share) * on_u, on_b = c.share * on_u;
                // Where the ends move across the line, the crossing slides along the edge.
                const R slope = (edge.b[axis] - edge.a[axis]) / c.length;
                const Vec3<R> motion_a = on_axis(axis, on_a, -on_a * slope), motion_b = on_axis(axis, on_b, -on_b * slope);
                pull_edge(task, edge, c, blend.perspective, on_edge, on_share, motion_a, motion_b);
                if (task.order > 1 && task.work.crossed.size() < 2 * most)
                    keep_motion(task, edge, blend, motion_a, motion_b);
            }
        }
    }
    return gain;
}

}  // namespace

template <class R> void find_occlusion_edges(Task<R>& task, std::vector<int32_t>& edges) {
    const Geometry<R>& geometry = task.geometry;
    edges.resize(geometry.edges);
    size_t count = 0;
    for (int number = 0; number < geometry.edges; ++number) {
        const int32_t* const row = &geometry.edge_table[5 * (size_t)number];
        // A border edge, which has no face beyond, occludes wherever its one face is turned to the camera.
        const uint8_t beyond = row[3] >= 0 ? task.work.facing[row[3]] : 0;
        edges[count] = number;
        count += task.work.facing[row[2]] != beyond;
    }
    edges.resize(count);
    for (const int number : edges)
        for (int end = 0; end < 2; ++end)
            task.work.used[geometry.edge_table[5 * (size_t)number + end]] = 1;
}

template <class R> Gain<R> blend_silhouette(Task<R>& task, const std::vector<int32_t>& edges) {
    Gain<R> gain;
    with_density(task.photos.density, [&](auto density) { gain = blend_edges<decltype(density)>(task, edges); });
    return gain;
}

template <class R> void add_edge_rows(Task<R>& task) {
    typedef Lanes<R> Row;
    Workspace<R>& work = task.work;
    const Eye<R>& eye = task.eye;
    const size_t width = task.geometry.width, all = work.crossed.size() / 2;
    for (size_t first = 0; first < all; first += LANES) {
        const int count = (int)std::min<size_t>(LANES, all - first);
        Row rest[LANES] = {};
        R axes[2][LANES][4];
        for (int end = 0; end < 2; ++end) {
            int place[2][LANES];
            for (int lane = 0; lane < LANES; ++lane)
                for (int n = 0; n < 2; ++n)
                    place[n][lane] = 4 * ((int)first + std::min(lane, count - 1)) + 2 * end + n;
            Row at[4], moved[4];
            gather_four(work.motions.data(), place[0], at);
            gather_four(work.motions.data(), place[1], moved);
            const Vec3<Row> spot = {at[0], at[1], at[2]}, motion = {moved[0], moved[1], moved[2]};
            add_motion(eye, motion, spot, rest);
            const Vec3<Row> axis = eye.rotation.transposed(camera_cotangent(eye, spot, motion));
            Row parts[4] = {axis.x, axis.y, axis.z, Row{}};
            scatter_four<R>(parts, [&](int lane, Four<R> numbers) { four_at(axes[end][lane]) = numbers; });
        }
        transpose<R>(rest);
        R* to = work.add_rows(width + REST, count);
        for (int lane = 0; lane < count; ++lane, to += width + REST) {
            std::fill_n(to, width, R(0));
            for (int end = 0; end < 2; ++end)
                add_basis(task.geometry, work.crossed[2 * (first + lane) + end], load3(axes[end][lane]), to);
            lanes_at(to + width) = rest[lane];
        }
    }
}

template void find_occlusion_edges(Task<VIG_REAL>&, std::vector<int32_t>&);
template Gain<VIG_REAL> blend_silhouette(Task<VIG_REAL>&, const std::vector<int32_t>&);
template void add_edge_rows(Task<VIG_REAL>&);

}  // namespace vig
