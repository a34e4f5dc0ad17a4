#include "rays.h"

#include <algorithm>
#include <limits>

#include "mesh.h"

namespace vig {
namespace {

constexpr float FAR = std::numeric_limits<float>::infinity();

// Bit n of the result is lane n, 0 or 1.
unsigned bits_of(const int32_t* lanes) {
    unsigned bits = 0;
    for (int lane = 0; lane < LANES; ++lane)
        bits |= (unsigned)lanes[lane] << lane;
    return bits;
}

// Order items (at, at + count) by median splits across the longest side of their centres (F, 3). The first part is always
// LANES times a power of two, so that the items of a node follow each other.
void split(const float* centres, int32_t* at, size_t count) {
    if (count <= LANES)
        return;
    Vec3<float> low = load3(centres + 3 * (size_t)at[0]), high = low;
    for (size_t i = 1; i < count; ++i) {
        const Vec3<float> centre = load3(centres + 3 * (size_t)at[i]);
        low = {std::min(low.x, centre.x), std::min(low.y, centre.y), std::min(low.z, centre.z)};
        high = {std::max(high.x, centre.x), std::max(high.y, centre.y), std::max(high.z, centre.z)};
    }
    const Vec3<float> side = high - low;
    const int axis = side.x >= side.y && side.x >= side.z ? 0 : side.y >= side.z ? 1 : 2;
    size_t first = LANES;
    while (2 * first < count)
        first *= 2;
    std::nth_element(at, at + first, at + count, [=](int32_t a, int32_t b) {
        return centres[3 * (size_t)a + axis] < centres[3 * (size_t)b + axis];
    });
    split(centres, at, first);
    split(centres, at + first, count - first);
}

}  // namespace

RayMesh::RayMesh(const float* vertices, const int32_t* corners, int faces) {
    std::vector<float> centres(3 * (size_t)faces);
    std::vector<int32_t> order;
    for (int face = 0; face < faces; ++face) {
        // A third of each corner: their sum could overflow.
        Vec3<float> centre = {0, 0, 0};
        for (int k = 0; k < 3; ++k)
            centre = centre + load3(vertices + 3 * (size_t)corners[3 * (size_t)face + k]) * (1 / 3.f);
        store3(&centres[3 * (size_t)face], centre);
        if (std::isfinite(centre.x) && std::isfinite(centre.y) && std::isfinite(centre.z))
            order.push_back(face);
    }
    split(centres.data(), order.data(), order.size());
    // Empty boxes and triangles of NaN, which no ray meets, fill up leaves and nodes.
    Node empty;
    std::fill_n(&empty.bound[0][0][0], 3 * LANES, FAR);
    std::fill_n(&empty.bound[1][0][0], 3 * LANES, -FAR);
    Leaf none;
    std::fill_n(&none.corner[0][0][0], 9 * LANES, std::numeric_limits<float>::quiet_NaN());
    std::fill_n(none.face, LANES, NO_HIT);
    const auto nodes_for = [](size_t children) { return (children + LANES - 1) / LANES; };
    leaves_.assign(nodes_for(order.size()), none);
    levels_.emplace_back(nodes_for(leaves_.size()), empty);
    for (size_t at = 0; at < order.size(); ++at) {
        const size_t leaf = at / LANES, lane = at % LANES;
        leaves_[leaf].face[lane] = order[at];
        for (int k = 0; k < 3; ++k)
            for (int axis = 0; axis < 3; ++axis) {
                const float number = vertices[3 * (size_t)corners[3 * (size_t)order[at] + k] + axis];
                leaves_[leaf].corner[k][axis][lane] = number;
                auto& bound = levels_[0][leaf / LANES].bound;
                bound[0][axis][leaf % LANES] = std::min(bound[0][axis][leaf % LANES], number);
                bound[1][axis][leaf % LANES] = std::max(bound[1][axis][leaf % LANES], number);
            }
    }
    while (levels_.back().size() > 1) {
        const std::vector<Node>& below = levels_.back();
        std::vector<Node> above(nodes_for(below.size()), empty);
        for (size_t n = 0; n < below.size(); ++n)
            for (int axis = 0; axis < 3; ++axis) {
                const auto &low = below[n].bound[0][axis], &high = below[n].bound[1][axis];
                above[n / LANES].bound[0][axis][n % LANES] = *std::min_element(low, low + LANES);
                above[n / LANES].bound[1][axis][n % LANES] = *std::max_element(high, high + LANES);
            }
        levels_.push_back(std::move(above));
    }
}

Hit RayMesh::first_hit(Vec3<float> origin, Vec3<float> direction) const {
    Hit best = {NO_HIT, false, FAR, {0, 0, 0}};
    const float reach = origin.x + origin.y + origin.z + direction.x + direction.y + direction.z;
    if (leaves_.empty() || !std::isfinite(reach))
        return best;
    const float from[3] = {origin.x, origin.y, origin.z}, along[3] = {direction.x, direction.y, direction.z};
    float inverse[3];
    for (int axis = 0; axis < 3; ++axis)
        inverse[axis] = 1 / (std::abs(along[axis]) > 1e-20f ? along[axis] : std::copysign(1e-20f, along[axis]));
    // Woop, Benthin and Wald 2013: the ray is sheared onto the axis z that it mostly follows. Two triangles that share an
    // edge compute the same number for it, so that no ray passes between them.
    int z = std::abs(along[0]) > std::abs(along[1]) ? 0 : 1;
    z = std::abs(along[2]) > std::abs(along[z]) ? 2 : z;
    int x = (z + 1) % 3, y = (z + 2) % 3;
    if (along[z] < 0)
        std::swap(x, y);  // keeps the sense of rotation
    const float shear_x = along[x] / along[z], shear_y = along[y] / along[z], shear_z = 1 / along[z];
    const float from_x = from[x], from_y = from[y], from_z = from[z];

    // A leaf or node to visit: the distance of its box, 0 for a leaf or 1 and its level, its number. A level adds LANES - 1
    // at most, and 2^31 triangles have 7 levels.
    struct Visit {
        float distance;
        uint32_t level;
        size_t number;
    } stack[8 * LANES];
    stack[0] = {0, (uint32_t)levels_.size(), 0};
    for (int size = 1; size > 0;) {
        const Visit visit = stack[--size];
        // Some units in the last place farther, so that rounding loses no box.
        const float farthest = best.distance * 1.000001f;
        int32_t met[LANES];
        if (visit.distance > farthest)
            continue;
        if (visit.level > 0) {
            const Node& node = levels_[visit.level - 1][visit.number];
            float near[LANES], far[LANES];
            for (int lane = 0; lane < LANES; ++lane)
                near[lane] = 0, far[lane] = farthest;
            for (int axis = 0; axis < 3; ++axis) {
                const float* const enter = node.bound[inverse[axis] < 0][axis];
                const float* const leave = node.bound[!(inverse[axis] < 0)][axis];
                const float start = from[axis], scale = inverse[axis];
                for (int lane = 0; lane < LANES; ++lane) {
                    const float in = (enter[lane] - start) * scale;
                    const float out = (leave[lane] - start) * scale * 1.000001f;
                    near[lane] = in > near[lane] ? in : near[lane];
                    far[lane] = out < far[lane] ? out : far[lane];
                }
            }
            for (int lane = 0; lane < LANES; ++lane)
                met[lane] = near[lane] <= far[lane];
            // The nearest on top of the stack.
            const int bottom = size;
            for (unsigned bits = bits_of(met); bits; bits &= bits - 1) {
                const int lane = __builtin_ctz(bits);
                int place = size++;
                for (; place > bottom && stack[place - 1].distance < near[lane]; --place)
                    stack[place] = stack[place - 1];
                stack[place] = {near[lane], visit.level - 1, visit.number * LANES + lane};
            }
            continue;
        }
        const Leaf& leaf = leaves_[visit.number];
        float weight[3][LANES], total[LANES], distance[LANES];
        for (int lane = 0; lane < LANES; ++lane) {
            float px[3], py[3], pz[3];
            for (int k = 0; k < 3; ++k) {
                pz[k] = leaf.corner[k][z][lane] - from_z;
                px[k] = leaf.corner[k][x][lane] - from_x - shear_x * pz[k];
                py[k] = leaf.corner[k][y][lane] - from_y - shear_y * pz[k];
            }
            const float u = px[2] * py[1] - py[2] * px[1];
            const float v = px[0] * py[2] - py[0] * px[2];
            const float w = px[1] * py[0] - py[1] * px[0];
            const float sum = u + v + w, away = (u * pz[0] + v * pz[1] + w * pz[2]) * shear_z / sum;
            weight[0][lane] = u, weight[1][lane] = v, weight[2][lane] = w;
            total[lane] = sum, distance[lane] = away;
            const int inside = ((u >= 0) & (v >= 0) & (w >= 0)) | ((u <= 0) & (v <= 0) & (w <= 0));
            met[lane] = inside & (sum != 0) & (away > 0) & (away <= farthest);
        }
        for (unsigned bits = bits_of(met); bits; bits &= bits - 1) {
            const int lane = __builtin_ctz(bits);
            const int32_t face = leaf.face[lane];
            if (distance[lane] > best.distance || (distance[lane] == best.distance && face > best.face))
                continue;
            best = {face, total[lane] < 0, distance[lane], {}};
            for (int k = 0; k < 3; ++k)
                best.weights[k] = weight[k][lane] / total[lane];
        }
    }
    return best;
}

void cast_hemisphere_rays(const RayMesh& mesh, const HemisphereRays& from, double* blocked, int32_t* faces, float* weights) {
    const double pi = std::acos(-1.0);
    const double y0 = 0.5 / std::sqrt(pi), y1 = std::sqrt(0.75 / pi), y2 = 0.5 * std::sqrt(15 / pi),
                 y20 = 0.25 * std::sqrt(5 / pi);
    std::vector<Vec3<double>> local(from.rays);  // the chunk's, before a point turns them
    for (int point = 0; point < from.points; ++point) {
        const double* const cells = from.patterns + 2 * (size_t)from.rays * (point / from.chunk);
        for (int ray = 0; point % from.chunk == 0 && ray < from.rays; ++ray) {
            const double across = std::sqrt(cells[2 * ray]), angle = 2 * pi * cells[2 * ray + 1];
            local[ray] = {across * std::cos(angle), across * std::sin(angle), std::sqrt(1 - cells[2 * ray])};
        }
        const double* const frame = from.frames + 9 * (size_t)point;
        const Vec3<double> first = load3(frame), second = load3(frame + 3), normal = load3(frame + 6);
        const double turn = 2 * pi * from.turns[point], c = std::cos(turn), s = std::sin(turn);
        const Vec3<double> tangent = first * c + second * s, bitangent = second * c - first * s;
        const Vec3<double> start = load3(from.position + 3 * (size_t)point) + normal * from.offset;
        const auto single = [](Vec3<double> v) { return Vec3<float>{float(v.x), float(v.y), float(v.z)}; };
        double* const total = blocked + (size_t)LOBES * point;
        std::fill_n(total, LOBES, 0.0);
        for (int ray = 0; ray < from.rays; ++ray) {
            const Vec3<double> w = tangent * local[ray].x + bitangent * local[ray].y + normal * local[ray].z;
            const Hit hit = mesh.first_hit(single(start), single(w));
            const size_t at = (size_t)point * from.rays + ray;
            faces[at] = hit.behind ? SEEN_FROM_BEHIND : hit.face;
            std::copy_n(hit.weights, 3, weights + 3 * at);
            if (hit.face == NO_HIT)
                continue;
            const double basis[LOBES] = {y0, y1 * w.y, y1 * w.z, y1 * w.x, y2 * w.x * w.y, y2 * w.y * w.z,
                                         y20 * (3 * w.z * w.z - 1), y2 * w.x * w.z, 0.5 * y2 * (w.x * w.x - w.y * w.y)};
            for (int lobe = 0; lobe < LOBES; ++lobe)
                total[lobe] += basis[lobe];
        }
    }
}

}  // namespace vig
