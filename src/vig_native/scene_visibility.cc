// Visible faces on a layer's grid of samples, and crossings of visible silhouette edges with its lines. An edge is one
// where both its faces lie on one side of it on the screen, or where it has one only; a crossing is visible unless a face
// hides it: exact for the polygons, no tolerance in metres, no normals.
#include <limits>

#include "scenes.h"
#include "threads.h"

namespace vig {
namespace {

// Corners of a layer's faces, vertices counted from the layer's first; of the parts that are left of them beyond the near
// plane, whose further vertices follow on the screen; and the face of each part.
struct Parts {
    const int32_t* corners;
    int faces;
    std::vector<int32_t> joined, parts, origin;  // joined: `corners` of several meshes
    bool is_cut() const { return !origin.empty(); }
    const int32_t* drawn() const { return is_cut() ? parts.data() : corners; }
    int count() const { return is_cut() ? (int)origin.size() : faces; }
    int face_of(int part) const { return is_cut() ? origin[part] : part; }
    void push(int face, int a, int b, int c) {
        parts.insert(parts.end(), {a, b, c});
        origin.push_back(face);
    }
};

// Clip faces at the near plane. A part's first corner is its farthest: near ones may lie far outside the image,
// and interpolation from there would be inexact.
template <class R> void clip_faces(const R* points, R scale, R near, Parts& faces, std::vector<R>& screen) {
    for (int f = 0; f < faces.faces; ++f) {
        const int32_t* const corner = faces.corners + 3 * (size_t)f;
        const R* p[3];
        bool behind[3];
        for (int i = 0; i < 3; ++i) {
            p[i] = points + 3 * (size_t)corner[i];
            behind[i] = !(p[i][2] >= near);
        }
        const int count = behind[0] + behind[1] + behind[2];
        if (count == 0)
            faces.push(f, corner[0], corner[1], corner[2]);
        if (count == 0 || count == 3)
            continue;
        // The corner that is alone on its side of the plane comes first.
        const bool one = count == 1;
        const int alone = behind[0] == one ? 0 : behind[1] == one ? 1 : 2, b = (alone + 1) % 3, c = (alone + 2) % 3;
        const int extra = (int)(screen.size() / 3);
        for (const int other : {b, c}) {
            // From the hidden end, in either face at an edge: both get the same point.
            const R *const low = p[one ? alone : other], *const high = p[one ? other : alone];
            const R share = (near - low[2]) / (high[2] - low[2]);
            const R point[3] = {low[0] + share * (high[0] - low[0]), low[1] + share * (high[1] - low[1]), near};
            const Vec3<R> at = on_grid(point, scale, near);
            screen.insert(screen.end(), {at.x, at.y, at.z});
        }
        if (!one)
            faces.push(f, corner[alone], extra, extra + 1);
        else if (p[b][2] < p[c][2]) {
            faces.push(f, corner[c], extra + 1, extra);
            faces.push(f, corner[c], extra, corner[b]);
        } else {
            faces.push(f, corner[b], corner[c], extra + 1);
            faces.push(f, corner[b], extra + 1, extra);
        }
    }
    if (faces.origin.empty())  // all is behind: one part that covers nothing
        faces.push(0, 0, 0, 0);
}

// On which side of the edge from a to b, on the screen, point c lies; c may be behind the camera.
template <class R> R side(const R* a, const R* b, const R* c) {
    const R x = a[0] / a[2], y = a[1] / a[2];
    return (b[0] - x * b[2]) * (c[1] - y * c[2]) - (b[1] - y * b[2]) * (c[0] - x * c[2]);
}

// Put an object's silhouette edges into `to`. points (V, 3) homogeneous and screen (V, 3) of the layer, in which the object's
// vertices begin at `shift`.
template <class R>
void find_silhouettes(const Object<R>& object, int shift, const R* points, const R* screen, std::vector<Silhouette>& to) {
    const int count = object.mesh->edge_count();
    const int32_t* const table = object.mesh->edges.data();
    const R *const own = points + 3 * (size_t)shift, *const own_screen = screen + 3 * (size_t)shift;
    for (int base = 0; base < count; base += LANES) {
        R x[4][LANES], y[4][LANES], q[4][LANES];
        int chosen[LANES], exact[LANES];
        for (int corner = 0; corner < 4; ++corner)
            for (int k = 0; k < LANES; ++k) {
                const int32_t vertex = table[(size_t)corner * count + std::min(base + k, count - 1)];
                const R* const at = own_screen + 3 * (size_t)std::max(vertex, 0);
                x[corner][k] = at[0];
                y[corner][k] = at[1];
                q[corner][k] = at[2];
            }
        for (int k = 0; k < LANES; ++k) {
            const R bx = x[1][k] - x[0][k], by = y[1][k] - y[0][k];
            const R here = bx * (y[2][k] - y[0][k]) - by * (x[2][k] - x[0][k]);
            const R there = bx * (y[3][k] - y[0][k]) - by * (x[3][k] - x[0][k]);
            const int ahead = (q[0][k] > 0) & (q[1][k] > 0);
            exact[k] = ahead & ((q[2][k] <= 0) | (q[3][k] <= 0));
            chosen[k] = ahead & (((here > 0) & (there > 0)) | ((here < 0) & (there < 0)));
        }
        for (int k = 0; k < LANES && base + k < count; ++k) {
            const auto column = [&](int number) { return table[(size_t)number * count + base + k]; };
            const bool border = column(3) < 0;
            if (border)
                chosen[k] = (q[0][k] > 0) & (q[1][k] > 0);
            else if (exact[k]) {
                const auto at = [&](int corner) { return own + 3 * (size_t)column(corner); };
                const R here = side(at(0), at(1), at(2)), there = side(at(0), at(1), at(3));
                chosen[k] = (here > 0 && there > 0) || (here < 0 && there < 0);
            }
            if (chosen[k])
                to.push_back({column(0) + object.first_vertex, column(1) + object.first_vertex,
                              column(4) + object.first_face, column(5) < 0 ? -1 : column(5) + object.first_face});
        }
    }
}

// A crossing before it is known whether a face, one nearer than `limit`, hides it. x and y on the grid's screen.
template <class R> struct Candidate {
    int edge, axis, line, low, face, other, pixel;
    bool hidden;
    R x, y, limit;
};

// Crossings and faces that may hide them, tested side by side.
template <class R> class Occlusion {
  public:
    std::vector<Candidate<R>> candidates;

    Occlusion(const R* points, const int32_t* corners, R scale, R near)
        : points_(points), corners_(corners), scale_(scale), near_(near) {}

    void add(int candidate, int face, bool may_hide) {
        candidate_[pairs_] = candidate;
        face_[pairs_] = face;
        pairs_ += may_hide;
        if (pairs_ == PAIRS)
            test();
    }

    void test() {
        for (int n = pairs_; n < pairs_ + LANES && pairs_; ++n) {
            candidate_[n] = candidate_[0];
            face_[n] = face_[0];
        }
        for (int base = 0; base < pairs_; base += LANES) {
            R x[3][LANES], y[3][LANES], z[3][LANES], limit[LANES];
            int hides[LANES];
            for (int k = 0; k < LANES; ++k) {
                const Candidate<R>& at = candidates[candidate_[base + k]];
                limit[k] = at.limit;
                for (int i = 0; i < 3; ++i) {
                    const R* const p = points_ + 3 * (size_t)corners_[3 * (size_t)face_[base + k] + i];
                    x[i][k] = p[0] * scale_ - (at.x - MARGIN) * p[2];
                    y[i][k] = p[1] * scale_ - (at.y - MARGIN) * p[2];
                    z[i][k] = p[2];
                }
            }
            // Homogeneous 2-D rasterisation (Olano and Greer 1997): no division, so that corners behind the camera do no
            // harm.
            for (int k = 0; k < LANES; ++k) {
                const R a = x[1][k] * y[2][k] - y[1][k] * x[2][k], b = x[2][k] * y[0][k] - y[2][k] * x[0][k];
                const R c = x[0][k] * y[1][k] - y[0][k] * x[1][k], total = a + b + c;
                const R depth = (a * z[0][k] + b * z[1][k] + c * z[2][k]) / total;
                const bool inside = ((a >= 0) & (b >= 0) & (c >= 0)) | ((a <= 0) & (b <= 0) & (c <= 0));
                hides[k] = inside & (total != 0) & (depth >= near_) & (depth < limit[k]);
            }
            for (int k = 0; k < LANES; ++k)
                candidates[candidate_[base + k]].hidden |= hides[k] != 0;
        }
        pairs_ = 0;
    }

  private:
    static constexpr int PAIRS = 1024;
    const R* points_;
    const int32_t* corners_;
    R scale_, near_;
    int candidate_[PAIRS + LANES], face_[PAIRS + LANES], pairs_ = 0;
};

// Put the crossings of an edge from a to b and the lines of the grid into `to`.
template <class R>
void cross_lines(const Silhouette& edge, int number, Vec3<R> a, Vec3<R> b, const int size[2], std::vector<Candidate<R>>& to) {
    // A face hides a crossing where it is nearer by more than rounding.
    constexpr R NEARER = R(1) - (sizeof(R) == sizeof(float) ? R(1e-5) : R(1e-9));
    for (int axis = 0; axis < 2; ++axis) {
        // u runs along the pair of pixels, v across: (x, y) for pairs in a row, (y, x) in a column.
        const R ua = a[axis], ub = b[axis], va = a[1 - axis], vb = b[1 - axis];
        const int lines = size[1 - axis], steps = size[axis];
        const R low = std::min(va, vb), high = std::max(va, vb);
        if (!(high >= R(0.5) && low <= lines))
            continue;
        const int last = (int)std::floor(std::min(high - R(0.5), R(lines - 1)));
        for (int line = (int)std::ceil(std::max(low - R(0.5), R(0))); line <= last; ++line) {
            const R v = line + R(0.5);
            // Half open, so that two edges that meet on a line cross it once.
            if ((va <= v) == (vb <= v))
                continue;
            const R share = (v - va) / (vb - va), u = ua + share * (ub - ua);
            if (!(u >= R(0.5) && u < steps - R(0.5)))
                continue;
            const R x = axis ? v : u, y = axis ? u : v;
            // One over depth is linear on the screen.
            to.push_back({number, axis, line, std::min((int)(u - R(0.5)), steps - 2), edge.face, edge.other,
                          (int)y * size[0] + (int)x, false, x, y, NEARER / ((1 - share) * a.z + share * b.z)});
        }
    }
}

// Hide candidates behind faces: first those that the surface at one of their two pixels hides, which are most; then, in
// the order of their pixels, those within the box of any part.
template <class R>
void mark_hidden(Occlusion<R>& occlusion, const Parts& faces, const std::vector<R>& screen, const int32_t* seen, int first_face,
          int columns, int rows) {
    std::vector<Candidate<R>>& candidates = occlusion.candidates;
    for (size_t n = 0; n < candidates.size(); ++n) {
        const Candidate<R> at = candidates[n];
        const size_t here = at.axis ? (size_t)at.low * columns + at.line : (size_t)at.line * columns + at.low;
        for (int side = 0; side < 2; ++side) {
            const int number = seen[here + (side ? (at.axis ? columns : 1) : 0)], face = number - first_face;
            occlusion.add((int)n, face, number >= 0 && at.face != number && at.other != number);
        }
    }
    occlusion.test();
    // Those of pixels p to p' are candidates ends[p] to ends[p' + 1].
    std::vector<int> ends((size_t)columns * rows + 1);
    for (const Candidate<R>& at : candidates)
        ends[at.pixel + 1] += !at.hidden;
    for (size_t p = 1; p < ends.size(); ++p)
        ends[p] += ends[p - 1];
    std::vector<Candidate<R>> sorted(ends.back());
    {
        std::vector<int> next(ends.begin(), ends.end() - 1);
        for (const Candidate<R>& at : candidates)
            if (!at.hidden)
                sorted[next[at.pixel]++] = at;
    }
    candidates.swap(sorted);
    if (candidates.empty())
        return;
    constexpr R LITTLE = R(1e-3);
    const int32_t* const parts = faces.drawn();
    for (int base = 0; base < faces.count(); base += LANES) {
        R x_low[LANES], x_high[LANES], y_low[LANES], y_high[LANES], nearest[LANES];
        int x0[LANES], x1[LANES], y0[LANES], y1[LANES];
        for (int k = 0; k < LANES; ++k) {
            const int32_t* const corner = parts + 3 * (size_t)std::min(base + k, faces.count() - 1);
            const R *const a = &screen[3 * (size_t)corner[0]], *const b = &screen[3 * (size_t)corner[1]];
            const R* const c = &screen[3 * (size_t)corner[2]];
            x_low[k] = std::min(a[0], std::min(b[0], c[0])) - LITTLE;
            x_high[k] = std::max(a[0], std::max(b[0], c[0])) + LITTLE;
            y_low[k] = std::min(a[1], std::min(b[1], c[1])) - LITTLE;
            y_high[k] = std::max(a[1], std::max(b[1], c[1])) + LITTLE;
            nearest[k] = std::max(a[2], std::max(b[2], c[2]));
        }
        for (int k = 0; k < LANES; ++k) {
            // Before the exact test: points outside the box or nearer than all corners are not hidden.
            nearest[k] = (1 - LITTLE * LITTLE) / nearest[k];
            const bool there = (x_high[k] >= 0) & (y_high[k] >= 0) & (x_low[k] <= columns) & (y_low[k] <= rows);
            x0[k] = there ? (int)(x_low[k] > 0 ? x_low[k] : 0) : 0;
            y0[k] = there ? (int)(y_low[k] > 0 ? y_low[k] : 0) : 0;
            x1[k] = there ? (int)(x_high[k] < columns - 1 ? x_high[k] : columns - 1) : 0;
            y1[k] = there ? (int)(y_high[k] < rows - 1 ? y_high[k] : rows - 1) : -1;
        }
        for (int k = 0; k < LANES && base + k < faces.count(); ++k) {
            const int face = faces.face_of(base + k), number = face + first_face;
            for (int y = y0[k]; y <= y1[k]; ++y) {
                const size_t line = (size_t)y * columns;
                for (int n = ends[line + x0[k]], last = ends[line + x1[k] + 1]; n < last; ++n) {
                    const Candidate<R>& at = candidates[n];
                    occlusion.add(n, face,
                                  (at.x >= x_low[k]) & (at.x <= x_high[k]) & (at.y >= y_low[k]) & (at.y <= y_high[k]) &
                                      (nearest[k] < at.limit) & (at.face != number) & (at.other != number));
                }
            }
        }
    }
    occlusion.test();
}

}  // namespace

template <class R> void Scenes<R>::find(bool edges, int threads) {
    layers.resize(starts.size() - 1);
    share_out(layers.size(), threads_for(layers.size() * grid(), threads), [&](size_t number) { find_layer((int)number, edges); });
}

template <class R> void Scenes<R>::find_layer(int number, bool edges) {
    Layer<R>& layer = layers[number];
    layer.begin = starts[number];
    layer.end = starts[number + 1];
    const int columns = grid_columns(), rows = grid_rows();
    const R scale = (R)samples;
    Parts faces = {};
    int vertices = 0;
    for (int o = layer.begin; o < layer.end; ++o) {
        faces.faces += objects[o].mesh->faces();
        if (layer.end - layer.begin > 1)
            for (const int32_t corner : objects[o].mesh->corners)
                faces.joined.push_back(corner + vertices);
        vertices += objects[o].mesh->vertices;
    }
    if (faces.faces == 0) {
        layer.face.assign(grid(), NO_FACE);
        return;
    }
    faces.corners = layer.end - layer.begin > 1 ? faces.joined.data() : objects[layer.begin].mesh->corners.data();
    const int first_vertex = objects[layer.begin].first_vertex, first_face = objects[layer.begin].first_face;
    const R* const place = points + 3 * (size_t)first_vertex;
    std::vector<R> screen(3 * (size_t)vertices);
    bool reaches_behind = false;
    for (int v = 0; v < vertices; ++v) {
        store3(&screen[3 * (size_t)v], on_grid(place + 3 * (size_t)v, scale, near));
        reaches_behind |= !(place[3 * (size_t)v + 2] >= near);
    }
    if (reaches_behind)
        clip_faces(place, scale, near, faces, screen);
    VisibilityBuffer<R> seen;
    std::vector<uint8_t> facing(faces.count());
    seen.clear((int)grid());
    draw_faces(screen.data(), faces.drawn(), faces.count(), columns, rows, false, seen, facing.data());
    layer.face = std::move(seen.face);
    for (size_t n = 0; faces.is_cut() && n < grid(); ++n)
        layer.face[n] = layer.face[n] < 0 ? NO_FACE : faces.origin[layer.face[n]];
    for (int32_t& face : layer.face)
        face = face < 0 ? NO_FACE : first_face + face;
    if (!edges)
        return;
    const auto screen_point = [&](int v) { return load3(&screen[3 * (size_t)v]); };
    for (int o = layer.begin; o < layer.end; ++o)
        find_silhouettes(objects[o], objects[o].first_vertex - first_vertex, place, screen.data(), layer.silhouettes);
    Occlusion<R> occlusion(place, faces.corners, scale, near);
    const int size[2] = {columns, rows};
    layer.joints.assign(2 * (size_t)vertices, 0);
    for (size_t e = 0; e < layer.silhouettes.size(); ++e) {
        const Silhouette& edge = layer.silhouettes[e];
        const int ends[2] = {edge.first - first_vertex, edge.second - first_vertex};
        const Vec3<R> a = screen_point(ends[0]), b = screen_point(ends[1]);
        cross_lines(edge, (int)e, a, b, size, occlusion.candidates);
        const Slope<R> slope(a, b);
        for (const int end : ends) {
            layer.joints[2 * (size_t)end] += slope.steep;
            layer.joints[2 * (size_t)end + 1] += 1;
        }
    }
    for (int v = 0; v < vertices; ++v)
        layer.joints[2 * (size_t)v] /= std::max(layer.joints[2 * (size_t)v + 1], R(1));
    mark_hidden(occlusion, faces, screen, layer.face.data(), first_face, columns, rows);
    std::vector<int> sharers(2 * grid());
    const auto here_of = [&](const Candidate<R>& at) {
        return at.axis ? at.low * columns + at.line : at.line * columns + at.low;
    };
    for (const Candidate<R>& at : occlusion.candidates)
        sharers[at.axis * grid() + here_of(at)] += !at.hidden;
    for (const Candidate<R>& at : occlusion.candidates)
        if (!at.hidden)
            layer.crossings.push_back({at.edge, at.axis, at.line, at.low, sharers[at.axis * grid() + here_of(at)],
                                       here_of(at), here_of(at) + (at.axis ? columns : 1)});
}

template class Scenes<VIG_REAL>;

}  // namespace vig
