// Scenes of the generator: assets with their poses, and the camera.
#pragma once
#include <memory>
#include <vector>

#include "../vectors.h"

namespace vig::world {

constexpr int MAX_LEVELS = 10;  // levels of a texture pyramid: up to 512 texels a side
constexpr int ATTRIBUTES = 5;    // a vertex's: normal and texture coordinates; for the object see `lit_asset`

struct Sphere {
    Vec3<float> centre;
    float radius;
};

// All levels of a pyramid, the finest first, row 0 on top: 8-bit square roots of linear RGB in the lowest bytes.
struct Texture {
    const uint32_t* texels = nullptr;
    int log_width = 0, log_height = 0;
    float repeats = 1;                  // per unit of texture coordinates
    std::shared_ptr<const void> owner;  // owner of the texels
};

// Some of a part's faces, one after the other, and the vertices that they have: drawn where their sphere is in the frame.
struct Cluster {
    Sphere sphere;
    int first_vertex, end_vertex, first_face, end_face;
};

struct Part {
    Sphere sphere;
    Texture texture;
    int slot;  // into the item's finishes, -1 none
    float roughness, mirror, metal, emission;
    int first_cluster, end_cluster;
};

// Irradiance lost at places: v0 + v123 . normal of values (z, y, x, 4), times `scale`. Cells are `cell` wide, x and y
// count cells' centres; plane s is rise[0] s + rise[1] s^2 above the origin, metres.
struct Grid {
    Vec3<float> origin = {0, 0, 0};
    float cell = 1, rise[2] = {1, 0};
    int size[3] = {0, 0, 0};  // along x, y, z; none where 0
    float scale = 0;
    std::vector<int16_t> values;
    // How many planes a height over the origin is: rise[0] s + rise[1] s^2 = above.
    float plane_of(float above) const {
        above = above > 0 ? above : 0;
        return 2 * above / (rise[0] + std::sqrt(rise[0] * rise[0] + 4 * rise[1] * above));
    }
};

struct Asset {
    int vertices = 0, faces = 0;
    Sphere sphere;
    std::vector<float> positions;   // (3, V) metres
    std::vector<float> attributes;  // (V, ATTRIBUTES)
    std::vector<int32_t> corners;   // (F, 3)
    std::vector<float> points;      // (N, 4) places on the surface and their areas, for shadows
    std::vector<Part> parts;
    std::vector<Cluster> clusters;
    Grid ambient;  // occlusion by its own surfaces
};

// Divide the faces of a part into clusters, which follow the asset's others; one where neighbours have distant numbers.
void add_clusters(Asset& asset, Part& part, int first_face, int end_face);

// Sphere round the vertices of faces `first` to `end` - 1.
Sphere bounding_sphere(const Asset& asset, int first_face, int end_face);

// The object, lit at its vertices (V, 3): their attributes are the unit normal, irradiance over pi, of light as polynomials
// (see `polynomial`) plus `added` (V,) where there is any, and the vertex's number.
std::shared_ptr<Asset> lit_asset(std::vector<int32_t> corners, const float* vertices, int count, const float* added,
                                 const float* irradiance);

// An asset in the world.
struct Item {
    std::shared_ptr<const Asset> asset;
    Mat3<double> rotation;  // world from asset
    Vec3<double> translation;
    int owner;
    bool is_target, is_support;     // the object; room and furniture
    std::vector<Texture> finishes;  // by slot; its own texture where one has no texels
};

struct Camera {
    Mat3<double> rotation;  // camera_from_world
    Vec3<double> translation;
    double focal, cx, cy, near;  // pixels; metres up to which things are clipped
    int width, height;
    Vec3<double> eye() const { return rotation.transposed(translation) * -1.0; }
    // The camera of an image with so many samples along each pixel's side.
    Camera sampled(int samples) const {
        return {rotation, translation, focal * samples, cx * samples, cy * samples, near, width * samples, height * samples};
    }
};

template <class R> Mat3<float> to_single(const Mat3<R>& m) {
    const auto row = [](Vec3<R> v) { return Vec3<float>{(float)v.x, (float)v.y, (float)v.z}; };
    return {{row(m.row[0]), row(m.row[1]), row(m.row[2])}};
}

// Polynomial of degree 2 of a unit vector: constant, y, z, x, xy, yz, 3 zz - 1, xz, xx - yy. Coefficients are those of
// spherical harmonics times their constants.
inline float polynomial(const float* c, Vec3<float> n) {
    return c[0] + c[1] * n.y + c[2] * n.z + c[3] * n.x + c[4] * n.x * n.y + c[5] * n.y * n.z + c[6] * (3 * n.z * n.z - 1)
        + c[7] * n.x * n.z + c[8] * (n.x * n.x - n.y * n.y);
}

// Room for `count` numbers, of which those that were there stay.
template <class T> T* grow(std::vector<T>& numbers, size_t count) {
    if (numbers.size() < count)
        numbers.resize(count * 5 / 4 + 64);
    return numbers.data();
}

}  // namespace vig::world
