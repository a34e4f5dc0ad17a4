#include "scene.h"

#include <algorithm>

namespace vig::world {
namespace {

constexpr int CLUSTER_FACES = 64;
// Vertices that all clusters of a part project, over those that it has, up to which it is divided: each cluster's are
// projected anew, and numbers that are spread over the mesh would cost more than the faces that are left out.
constexpr double MAX_SHARED = 2;
constexpr float ANYWHERE = 1e6f;  // metres: the radius of a sphere that is always in the frame

Cluster cluster_of(const Asset& asset, int first, int end) {
    Cluster cluster{bounding_sphere(asset, first, end), 0, 0, first, end};
    if (end > first) {
        const auto ends = std::minmax_element(&asset.corners[3 * (size_t)first], asset.corners.data() + 3 * (size_t)end);
        cluster.first_vertex = *ends.first;
        cluster.end_vertex = *ends.second + 1;
    }
    return cluster;
}

}  // namespace

Sphere bounding_sphere(const Asset& asset, int first_face, int end_face) {
    const float* const p = asset.positions.data();
    const int V = asset.vertices;
    double low[3] = {1e30, 1e30, 1e30}, high[3] = {-1e30, -1e30, -1e30}, squared = 0;
    for (int n = 3 * first_face; n < 3 * end_face; ++n)
        for (int r = 0; r < 3; ++r) {
            low[r] = std::min<double>(low[r], p[r * V + asset.corners[n]]);
            high[r] = std::max<double>(high[r], p[r * V + asset.corners[n]]);
        }
    if (end_face <= first_face)
        return {{0, 0, 0}, 0};
    const Vec3<double> middle = {(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, (low[2] + high[2]) / 2};
    for (int n = 3 * first_face; n < 3 * end_face; ++n) {
        const int v = asset.corners[n];
        const Vec3<double> off = Vec3<double>{p[v], p[V + v], p[2 * V + v]} - middle;
        squared = std::max(squared, dot(off, off));
    }
    return {{(float)middle.x, (float)middle.y, (float)middle.z}, float(std::sqrt(squared) * 1.0001 + 1e-6)};
}

void add_clusters(Asset& asset, Part& part, int first_face, int end_face) {
    part.sphere = bounding_sphere(asset, first_face, end_face);
    part.first_cluster = (int)asset.clusters.size();
    const Cluster whole = cluster_of(asset, first_face, end_face);
    double projected = 0;
    for (int first = first_face; first < end_face; first += CLUSTER_FACES) {
        asset.clusters.push_back(cluster_of(asset, first, std::min(first + CLUSTER_FACES, end_face)));
        projected += asset.clusters.back().end_vertex - asset.clusters.back().first_vertex;
    }
    if (projected > MAX_SHARED * (whole.end_vertex - whole.first_vertex)) {
        asset.clusters.resize(part.first_cluster);
        asset.clusters.push_back(whole);
    }
    part.end_cluster = (int)asset.clusters.size();
}

std::shared_ptr<Asset> lit_asset(std::vector<int32_t> corners, const float* vertices, int count, const float* added,
                                 const float* irradiance) {
    auto made = std::make_shared<Asset>();
    Asset& asset = *made;
    asset.vertices = count;
    asset.faces = (int)corners.size() / 3;
    asset.corners = std::move(corners);
    asset.positions.resize(3 * (size_t)count);
    asset.points.resize(4 * (size_t)count);
    asset.attributes.assign(ATTRIBUTES * (size_t)count, 0);
    for (int v = 0; v < count; ++v)
        for (int r = 0; r < 3; ++r)
            asset.positions[(size_t)r * count + v] = asset.points[4 * v + r] = vertices[3 * v + r];
    // Area-weighted normals, and the areas that vertices stand for.
    for (int face = 0; face < asset.faces; ++face) {
        const int32_t* const corner = &asset.corners[3 * face];
        const Vec3<float> a = load3(vertices + 3 * corner[0]);
        const Vec3<float> across = cross(load3(vertices + 3 * corner[1]) - a, load3(vertices + 3 * corner[2]) - a);
        const float third = std::sqrt(dot(across, across)) * (1.0f / 6);
        for (int m = 0; m < 3; ++m) {
            add3(&asset.attributes[ATTRIBUTES * corner[m]], across);
            asset.points[4 * corner[m] + 3] += third;
        }
    }
    for (int v = 0; v < count; ++v) {
        float* const at = &asset.attributes[ATTRIBUTES * v];
        const Vec3<float> sum = load3(at);
        const float length = std::sqrt(dot(sum, sum));
        const Vec3<float> normal = sum * (length > 0 ? 1 / length : 0);
        store3(at, normal);
        at[3] = std::max(polynomial(irradiance, normal) + (added ? added[v] : 0), 0.0f);
        at[4] = (float)v;
    }
    asset.sphere = {{0, 0, 0}, ANYWHERE};
    asset.parts.push_back({asset.sphere, {}, -1, 1, 0, 0, 0, 0, 1});
    asset.clusters.push_back({asset.sphere, 0, count, 0, asset.faces});
    return made;
}

}  // namespace vig::world
