// One layer: which face is seen at each point of the grid, and the visible crossings of silhouette edges.
// The definitions are those of primitives/visibility.py and primitives/crossings.py.
struct View {
    const void* data;
    struct {
        int dims[2];
    } shape;
};
const auto draw = [&](const real* points_, const int* corners_, int end, wp::int64* keys_, wp::uint8* bytes) {
    const int first = 0, mesh = 0, image = 0, cull = 0, width = columns_of_grid, height = rows_of_grid;
    const View screen = {points_}, faces = {corners_}, keys = {keys_}, facing = {bytes};
#include "pixel_box.cc"
#include "draw_faces.cc"
};
// A crossing of a silhouette edge and a line of pixel centres.
struct Cell {
    int edge, axis, line, low, hidden, face, other, pixel;
    real x, y, limit;  // a face nearer than the limit hides it
};
const auto find = [&](whole layer, whole& silhouettes, whole& crossings) {
    const whole begin = t.starts[layer], end = t.starts[layer + 1];
    int* const face = t.face + layer * grid;
    whole vertices = 0, faces = 0;
    for (whole o = begin; o < end; ++o) {
        vertices += objects[o].vertices;
        faces += objects[o].face_count;
    }
    for (whole p = 0; p < grid && faces == 0; ++p)
        face[p] = -1;
    if (faces == 0)
        return;
    const whole first_vertex = objects[begin].first_vertex, first_face = objects[begin].first_face;
    bool cut = false;
    for (whole v = 0; v < vertices; ++v)
        cut |= !(t.points[3 * (first_vertex + v) + 2] >= NEAR);
    const whole screened = vertices + (cut ? 2 * faces : 0);
    const Space screen_space(t.fault, screened * 3 * sizeof(real));
    const Space joined_space(t.fault, (begin + 1 < end || cut ? 3 * faces : 0) * sizeof(int));
    const Space pieces_space(t.fault, (cut ? 8 * faces : 0) * sizeof(int));
    if (*t.fault)
        return;
    real* const screen = (real*)screen_space.at;
    for (whole v = 0; v < vertices; ++v)
        on_screen(t.points + 3 * (first_vertex + v), screen + 3 * v);
    // Corners of all faces; of the parts beyond the near plane; and of which face each is a part.
    int* const joined = (int*)joined_space.at;
    const int* corners = objects[begin].faces;
    if (begin + 1 < end || cut) {
        int* to = joined;
        for (whole o = begin; o < end; ++o)
            for (whole i = 0; i < 3 * objects[o].face_count; ++i)
                *to++ = objects[o].faces[i] + (int)(objects[o].first_vertex - first_vertex);
        corners = joined;
    }
    const int* parts = corners;
    whole part_count = faces;
    int* const pieces = (int*)pieces_space.at;
    int* const origin = pieces + 6 * faces;
    if (cut) {
        whole extra = vertices;
        part_count = 0;
        const auto push = [&](whole of, whole a, whole b, whole c) {
            const whole three[3] = {a, b, c};
            for (int i = 0; i < 3; ++i)
                pieces[3 * part_count + i] = (int)three[i];
            origin[part_count++] = (int)of;
        };
        for (whole f = 0; f < faces; ++f) {
            const int* const corner = corners + 3 * f;
            const real* p[3];
            bool behind[3];
            for (int i = 0; i < 3; ++i) {
                p[i] = t.points + 3 * (first_vertex + corner[i]);
                behind[i] = !(p[i][2] >= NEAR);
            }
            const int count = behind[0] + behind[1] + behind[2];
            if (count == 0)
                push(f, corner[0], corner[1], corner[2]);
            if (count == 0 || count == 3)
                continue;
            // The corner that is alone on its side of the plane comes first.
            const bool one = count == 1;
            const int alone = behind[0] == one ? 0 : behind[1] == one ? 1 : 2;
            const int b = (alone + 1) % 3, c = (alone + 2) % 3;
            for (int side = 0; side < 2; ++side) {
                // From the hidden end, in either face at an edge: both get the same point.
                const int other = side ? c : b;
                const real* const low = p[one ? alone : other];
                const real* const high = p[one ? other : alone];
                const real share = (NEAR - low[2]) / (high[2] - low[2]);
                const real place[3] = {low[0] + share * (high[0] - low[0]), low[1] + share * (high[1] - low[1]), NEAR};
                on_screen(place, screen + 3 * (extra + side));
            }
            if (!one)
                push(f, corner[alone], extra, extra + 1);
            // Of the four corners that remain a part's first is the farther one of b and c.
            else if (p[b][2] < p[c][2]) {
                push(f, corner[c], extra + 1, extra);
                push(f, corner[c], extra, corner[b]);
            } else {
                push(f, corner[b], corner[c], extra + 1);
                push(f, corner[b], extra + 1, extra);
            }
            extra += 2;
        }
        parts = pieces;
    }
    {
        const Space keys_space(t.fault, (grid + KEYS_MARGIN) * sizeof(wp::int64));
        const Space bytes(t.fault, part_count);
        if (*t.fault)
            return;
        wp::int64* const keys = (wp::int64*)keys_space.at;
        for (whole p = 0; p < grid + KEYS_MARGIN; ++p)
            keys[p] = NOTHING;
        draw(screen, parts, (int)part_count, keys, (wp::uint8*)bytes.at);
        for (whole p = 0; p < grid; ++p) {
            const int part = (int)(keys[p] & FACE_MASK);
            face[p] = keys[p] == NOTHING ? -1 : (int)first_face + (cut ? origin[part] : part);
        }
    }
    if (t.channels == 0)
        return;
    // Silhouette edges: both faces on one side of it on the screen, or one face only.
    const whole first_edge = silhouettes;
    const auto point_of = [&](whole v) { return t.points + 3 * (first_vertex + v); };
    for (whole o = begin; o < end; ++o) {
        const int shift = (int)(objects[o].first_vertex - first_vertex);
        const int face_shift = (int)(objects[o].first_face - first_face);
        for (whole e = 0; e < objects[o].edge_count; ++e) {
            const int* const edge = objects[o].edges + 6 * e;
            const whole a = edge[0] + shift, b = edge[1] + shift;
            const real* const sa = screen + 3 * a;
            if (sa[2] == 0 || screen[3 * b + 2] == 0)
                continue;
            if (edge[3] >= 0) {
                const real* const pa = point_of(a);
                const real x = pa[0] * sa[2], y = pa[1] * sa[2];
                const real* const pb = point_of(b);
                const real* const pc = point_of(edge[2] + shift);
                const real* const pd = point_of(edge[3] + shift);
                const real bx = pb[0] - x * pb[2], by = pb[1] - y * pb[2];
                const real here = bx * (pc[1] - y * pc[2]) - by * (pc[0] - x * pc[2]);
                const real there = bx * (pd[1] - y * pd[2]) - by * (pd[0] - x * pd[2]);
                if (!((here > 0 && there > 0) || (here < 0 && there < 0)))
                    continue;
            }
            int* const row = t.chosen + 4 * silhouettes++;
            row[0] = (int)(first_vertex + a);
            row[1] = (int)(first_vertex + b);
            row[2] = edge[4] + face_shift;
            row[3] = edge[5] < 0 ? -1 : edge[5] + face_shift;
        }
    }
    // Where they cross the lines of pixel centres.
    whole capacity = 4096, count = 0;
    Space found(t.fault, capacity * sizeof(Cell));
    if (*t.fault)
        return;
    Cell* cells = (Cell*)found.at;
    const int length[2] = {columns_of_grid, rows_of_grid};
    for (whole e = first_edge; e < silhouettes; ++e) {
        const real* const a = screen + 3 * (t.chosen[4 * e] - first_vertex);
        const real* const b = screen + 3 * (t.chosen[4 * e + 1] - first_vertex);
        for (int axis = 0; axis < 2; ++axis) {
            // u runs along the pair of pixels, v across: (x, y) for pairs in a row, (y, x) in a column.
            const real va = a[1 - axis], vb = b[1 - axis];
            const int lines = length[1 - axis], steps = length[axis];
            const real low = wp::min(va, vb), high = wp::max(va, vb);
            if (!(high >= real(0.5) && low <= lines))
                continue;
            const int last = (int)wp::floor(wp::min(high - real(0.5), real(lines - 1)));
            for (int line = (int)wp::ceil(wp::max(low - real(0.5), real(0))); line <= last; ++line) {
                const real v = line + real(0.5);
                // Half open, so that two edges that meet on a line cross it once.
                if ((va <= v) == (vb <= v))
                    continue;
                const real share = (v - va) / (vb - va), u = a[axis] + share * (b[axis] - a[axis]);
                if (!(u >= real(0.5) && u < steps - real(0.5)))
                    continue;
                if (count == capacity) {
                    Space more(t.fault, 2 * capacity * sizeof(Cell));
                    if (*t.fault)
                        return;
                    memcpy(more.at, cells, capacity * sizeof(Cell));
                    cells = (Cell*)more.at;
                    more.at = found.at;
                    found.at = cells;
                    capacity *= 2;
                }
                Cell& cell = cells[count];
                cell.edge = (int)e;
                cell.axis = axis;
                cell.line = line;
                cell.low = wp::min((int)(u - real(0.5)), steps - 2);
                cell.hidden = 0;
                cell.face = t.chosen[4 * e + 2];
                cell.other = t.chosen[4 * e + 3];
                cell.x = axis ? v : u;
                cell.y = axis ? u : v;
                // One over depth is linear on the screen.
                cell.limit = NEARER / ((1 - share) * a[2] + share * b[2]);
                cell.pixel = (int)cell.y * columns_of_grid + (int)cell.x;
                ++count;
            }
        }
    }
    // Crossings and faces that may hide them, tested side by side.
    constexpr int PAIRS = 1024, SIDE = 16;
    int pair_cell[PAIRS + SIDE], pair_face[PAIRS + SIDE], pairs = 0;
    const auto test = [&]() {
        for (int n = pairs; n < pairs + SIDE && pairs; ++n) {
            pair_cell[n] = pair_cell[0];
            pair_face[n] = pair_face[0];
        }
        const real* const place = t.points + 3 * first_vertex;
        for (int base = 0; base < pairs; base += SIDE) {
            real x[3][SIDE], y[3][SIDE], z[3][SIDE], limit[SIDE];
            int hides[SIDE];
            for (int k = 0; k < SIDE; ++k) {
                const Cell& cell = cells[pair_cell[base + k]];
                limit[k] = cell.limit;
                for (int i = 0; i < 3; ++i) {
                    const real* const p = place + 3 * (whole)corners[3 * (whole)pair_face[base + k] + i];
                    x[i][k] = p[0] * scale - (cell.x - MARGIN) * p[2];
                    y[i][k] = p[1] * scale - (cell.y - MARGIN) * p[2];
                    z[i][k] = p[2];
                }
            }
            // Homogeneous 2-D rasterisation (Olano and Greer 1997): no division, so that corners behind the eye do
            // no harm.
            for (int k = 0; k < SIDE; ++k) {
                const real a = x[1][k] * y[2][k] - y[1][k] * x[2][k], b = x[2][k] * y[0][k] - y[2][k] * x[0][k];
                const real c = x[0][k] * y[1][k] - y[0][k] * x[1][k], total = a + b + c;
                const real depth = (a * z[0][k] + b * z[1][k] + c * z[2][k]) / total;
                const bool inside = ((a >= 0) & (b >= 0) & (c >= 0)) | ((a <= 0) & (b <= 0) & (c <= 0));
                hides[k] = inside & (total != 0) & (depth >= NEAR) & (depth < limit[k]);
            }
            for (int k = 0; k < SIDE; ++k)
                cells[pair_cell[base + k]].hidden |= hides[k];
        }
        pairs = 0;
    };
    // Most that are hidden are so by what is seen in one of their two pixels.
    for (whole n = 0; n < count; ++n) {
        const Cell& cell = cells[n];
        const whole here = cell.axis ? (whole)cell.low * columns_of_grid + cell.line
                                     : (whole)cell.line * columns_of_grid + cell.low;
        for (int side = 0; side < 2; ++side) {
            const int seen = face[here + (side ? (cell.axis ? columns_of_grid : 1) : 0)] - (int)first_face;
            pair_cell[pairs] = (int)n;
            pair_face[pairs] = seen;
            pairs += (seen >= 0) & (cell.face != seen) & (cell.other != seen);
            if (pairs == PAIRS)
                test();
        }
    }
    test();
    // Those that are left in the order of their pixels: those of pixels p to p' are the ones from ends[p - 1] to ends[p'].
    const Space ends_space(t.fault, (grid + 1) * sizeof(int), true);
    const Space sorted(t.fault, count * sizeof(Cell));
    const Space sharers_space(t.fault, 2 * grid * sizeof(int), true);
    if (*t.fault)
        return;
    int* const ends = (int*)ends_space.at + 1;
    for (whole n = 0; n < count; ++n)
        ends[cells[n].pixel] += !cells[n].hidden;
    for (whole p = 0, sum = 0; p < grid; ++p) {
        const int here = ends[p];
        ends[p] = (int)sum;
        sum += here;
    }
    Cell* const unsorted = cells;
    cells = (Cell*)sorted.at;
    for (whole n = 0; n < count; ++n)
        if (!unsorted[n].hidden)
            cells[ends[unsorted[n].pixel]++] = unsorted[n];
    count = ends[grid - 1];
    constexpr real LITTLE = real(1e-3);
    for (whole base = 0; base < part_count; base += SIDE) {
        real x_low[SIDE], x_high[SIDE], y_low[SIDE], y_high[SIDE], nearest[SIDE];
        int x0[SIDE], x1[SIDE], y0[SIDE], y1[SIDE];
        for (int k = 0; k < SIDE; ++k) {
            const int* const corner = parts + 3 * wp::min(base + k, part_count - 1);
            const real* const a = screen + 3 * (whole)corner[0];
            const real* const b = screen + 3 * (whole)corner[1];
            const real* const c = screen + 3 * (whole)corner[2];
            x_low[k] = wp::min(a[0], wp::min(b[0], c[0])) - LITTLE;
            x_high[k] = wp::max(a[0], wp::max(b[0], c[0])) + LITTLE;
            y_low[k] = wp::min(a[1], wp::min(b[1], c[1])) - LITTLE;
            y_high[k] = wp::max(a[1], wp::max(b[1], c[1])) + LITTLE;
            nearest[k] = wp::max(a[2], wp::max(b[2], c[2]));
        }
        for (int k = 0; k < SIDE; ++k) {
            // Before the exact test: what lies outside the box or is nearer than all corners is not hidden.
            nearest[k] = (1 - LITTLE * LITTLE) / nearest[k];
            const bool there = (x_high[k] >= 0) & (y_high[k] >= 0) & (x_low[k] <= columns_of_grid) &
                               (y_low[k] <= rows_of_grid);
            x0[k] = there ? (int)(x_low[k] > 0 ? x_low[k] : 0) : 0;
            y0[k] = there ? (int)(y_low[k] > 0 ? y_low[k] : 0) : 0;
            x1[k] = there ? (int)(x_high[k] < columns_of_grid - 1 ? x_high[k] : columns_of_grid - 1) : 0;
            y1[k] = there ? (int)(y_high[k] < rows_of_grid - 1 ? y_high[k] : rows_of_grid - 1) : -1;
        }
        for (int k = 0; k < SIDE && base + k < part_count; ++k) {
            const int of = cut ? origin[base + k] : (int)(base + k);
            for (int y = y0[k]; y <= y1[k]; ++y) {
                const whole line = (whole)y * columns_of_grid;
                for (int n = ends[line + x0[k] - 1], last = ends[line + x1[k]]; n < last; ++n) {
                    const Cell& cell = cells[n];
                    pair_cell[pairs] = n;
                    pair_face[pairs] = of;
                    pairs += (cell.x >= x_low[k]) & (cell.x <= x_high[k]) & (cell.y >= y_low[k]) &
                             (cell.y <= y_high[k]) & (nearest[k] < cell.limit) & (cell.face != of) & (cell.other != of);
                    if (pairs == PAIRS)
                        test();
                }
            }
        }
    }
    test();
    // Those that nothing hides, and how many of them lie between the same two pixels.
    int* const sharers = (int*)sharers_space.at;
    for (int turn = 0; turn < 2; ++turn)
        for (whole n = 0; n < count; ++n) {
            const Cell& cell = cells[n];
            if (cell.hidden)
                continue;
            const int x = cell.axis ? cell.line : cell.low, y = cell.axis ? cell.low : cell.line;
            const int here = y * columns_of_grid + x;
            int& sharing = sharers[cell.axis * grid + here];
            if (turn == 0) {
                ++sharing;
                continue;
            }
            if (crossings < t.status[0]) {
                const int row[8] = {cell.edge, cell.axis, cell.line, cell.low, sharing, (int)layer, here,
                                    here + (cell.axis ? columns_of_grid : 1)};
                memcpy(t.crossing + 8 * crossings, row, sizeof(row));
            }
            ++crossings;
        }
    for (whole e = first_edge; e < silhouettes; ++e) {
        const int* const ends = t.chosen + 4 * e;
        const Slope slope = slope_of(screen + 3 * (ends[0] - first_vertex), screen + 3 * (ends[1] - first_vertex));
        for (int i = 0; i < 2; ++i) {
            t.joints[2 * (whole)ends[i]] += slope.steep;
            t.joints[2 * (whole)ends[i] + 1] += 1;
        }
    }
    for (whole v = first_vertex; v < first_vertex + vertices; ++v)
        t.joints[2 * v] /= wp::max(t.joints[2 * v + 1], real(1));
};
