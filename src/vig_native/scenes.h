// Scenes of meshes for the public renderer: vertices on the screen, visible surfaces on a grid of samples, visible
// occlusion edges, pictures; and the way back from pictures to every input.
#pragma once
#include <algorithm>
#include <array>
#include <limits>
#include <memory>

#include "rows.h"
#include "visibility.h"

namespace vig {

// Pixels drawn around a picture and cut off again, so that its border is blended like its middle.
constexpr int MARGIN = 1;

// A mesh that does not move, numbers checked. F faces of V vertices, E edges.
struct Mesh {
    int vertices;
    int64_t texture_rows;                  // rows of texture coordinates that its corners name
    std::vector<int32_t> corners;          // (F, 3)
    std::vector<int32_t> texture_corners;  // (F, 3) rows of the texture coordinates
    // (6, E) vertices a and b, third vertex of the face on either side, those two faces; -1 where there is none.
    std::vector<int32_t> edges;
    int faces() const { return (int)(corners.size() / 3); }
    int edge_count() const { return (int)(edges.size() / 6); }
};

// Inputs that place, colour and light an object, arrays of numbers, some absent. The last two are a texture's.
enum ObjectInput {
    VERTICES, ROTATION, TRANSLATION, NORMALS, ALBEDO, SKY, LAMP, RADIANCE, CAMERA_ROTATION, CAMERA_TRANSLATION, FOCAL,
    CENTRE, COORDINATES, TEXELS, INPUTS
};

template <class R> struct Object {
    std::shared_ptr<const Mesh> mesh;
    int place;                      // in its scene's list
    int first_vertex, first_face;   // where its own begin in the numbering of all objects
    std::array<const R*, INPUTS> in = {};
    std::array<int64_t, INPUTS> count = {};  // numbers of each input
    std::vector<int32_t> levels = {};  // (L, 3) first texel, height and width of each level of its texture
    bool has_colours() const { return count[ALBEDO] > 3; }  // of its vertices
    bool has_rgb_light() const { return count[SKY] == 27; }
};
template <class R> using Cotangents = std::array<R*, INPUTS>;  // null where nobody asks; added to

// Light on an object: spherical harmonics of each channel, and a distant lamp.
template <class R> struct Light {
    R sky[3][LOBES] = {};
    Vec3<R> lamp = {}, radiance = {};
    bool is_on = false;    // without any light an object shows its albedo
    bool is_grey = false;  // all channels of `sky` are one
};
// Cotangents on a light, summed in double precision.
struct LightCotangent {
    double sky[3][LOBES] = {}, lamp[3] = {}, radiance[3] = {};
};

// A silhouette edge: its two vertices and two faces, numbered through; -1 for none.
struct Silhouette {
    int first, second, face, other;
};
// Where silhouette `edge` visibly crosses the line between the centres of two neighbours, `here` and `there` on the grid:
// along a row (axis 0) or column (1) number `line`, after neighbour `low`. sharers: crossings between the same two.
struct Crossing {
    int edge, axis, line, low, sharers, here, there;
};

// One layer: objects `begin` to `end` drawn together, on a grid of samples.
template <class R> struct Layer {
    int begin, end;
    std::vector<int32_t> face;            // (grid) numbered through, or NO_FACE
    std::vector<Silhouette> silhouettes;
    std::vector<Crossing> crossings;
    std::vector<R> joints;                // (vertices of the layer, 2) mean steepness of silhouettes that meet, their number
    std::vector<R> steps;                 // (crossings, channels) differences of the two neighbours
};

// Images and cotangents on them; null where there is none. L layers.
template <class R> struct Images {
    R *rgb, *coverage, *visible;  // (L, H, W, 3), (L, H, W), (L, masks, H, W)
};

template <class R> class Sampler;

template <class R> class Scenes {
  public:
    std::vector<Object<R>> objects;
    std::vector<int> starts;      // (L + 1) objects of layer l are starts[l] to starts[l + 1]
    int height, width, samples;   // samples x samples points a pixel
    int masks;                    // in each layer: one for each object, or one for all where nothing else is drawn
    bool is_mask = false;         // draw coverage alone
    int columns = 0;              // attributes: unit normal, albedo and, if 9, the light that is reflected at the vertex
    R near;                       // metres; nothing nearer is drawn
    const R *points = nullptr, *attributes = nullptr;  // (V, 3) homogeneous: x z, y z, z; (V, columns)
    const R* background = nullptr;  // (L, 3), or (L, H, W, 3)
    bool background_is_image = false;
    std::vector<Layer<R>> layers;

    int grid_columns() const { return width * samples + 2 * MARGIN; }
    int grid_rows() const { return height * samples + 2 * MARGIN; }
    size_t grid() const { return (size_t)grid_columns() * grid_rows(); }
    int vertex_count() const;
    int colours() const { return is_mask ? 0 : 3; }
    int channels() const { return colours() + masks; }

    // Points and attributes from the inputs; false where an input is not finite or a focal length not above 0.
    bool place(R* points, R* attributes, int threads);
    // Add to the inputs' cotangents those on points, attributes and lights (O).
    void place_back(const R* on_points, const R* on_attributes, const std::vector<LightCotangent>& on_lights,
                    std::vector<Cotangents<R>>& on_inputs, int threads) const;
    // Fill `layers`: visible faces and, with `edges`, visible occlusion edges.
    void find(bool edges, int threads);
    void paint(Images<R> to, int threads);
    // Add cotangents on images to those on points, attributes, background, lights and textures.
    void paint_back(Images<const R> on, R* on_points, R* on_attributes, R* on_background,
                    std::vector<LightCotangent>& on_lights, std::vector<Cotangents<R>>& on_inputs, int threads) const;
    // The surface at pixels' centres, one sample a pixel: depth, unit normals, numbers of object and triangle; -1 and
    // infinity where there is none.
    void surface(R* depth, R* normals, int32_t* object, int32_t* triangle) const;
    void surface_back(const R* on_depth, const R* on_normals, R* on_points, R* on_attributes) const;

  private:
    std::vector<R> world_, raw_;        // (V, 3) metres; normals before they are of length one
    std::vector<Light<R>> lights_;

    // The pixel of a layer whose one sample is at a place on the grid.
    size_t pixel(size_t layer, size_t place) const {
        return (layer * height + place / grid_columns() - MARGIN) * width + place % grid_columns() - MARGIN;
    }
    void find_layer(int number, bool edges);
    void paint_layer(int number, Images<R> to);
    void paint_layer_back(int number, Images<const R> on, R* on_points, R* on_attributes, R* on_background,
                          std::vector<LightCotangent>& on_lights, std::vector<Cotangents<R>>& on_inputs) const;
    friend class Sampler<R>;
};

// A vector of length one, and one over the length before; vectors shorter than 1e-15 become zero. Scaled first, as squares
// may leave the range of numbers.
template <class T> Vec3<T> unit(Vec3<T> v, T& inverse) {
    const auto shrink_of = [](auto x, auto y, auto z) {
        auto size = x * 0;
        for (const auto number : {x, y, z}) {
            const auto length = number < 0 ? -number : number;
            size = length > size ? length : size;
        }
        return size > 1e-15f ? 1 / size : 0;
    };
    const T shrink = by_lane(shrink_of, v.x, v.y, v.z);
    v = v * shrink;
    const T less = by_lane([](auto square) { return square > 0 ? 1 / std::sqrt(square) : 0; }, T(dot(v, v)));
    inverse = shrink * less;
    return v * less;
}
// Pull a cotangent on a unit vector n back to the vector that was made of length one.
template <class T> Vec3<T> pull_unit(Vec3<T> n, T inverse, Vec3<T> on) { return (on - n * dot(n, on)) * inverse; }

// Reflection of a white surface of unit normal n: max(0, sum A_l L_lm Y_lm(n)) + radiance max(0, n . lamp); LANES at a time.
template <class R> Vec3<Lanes<R>> reflect(const Light<R>& light, Vec3<Lanes<R>> n) {
    typedef Lanes<R> Row;
    const Row one = Row{} + R(1);
    if (!light.is_on)
        return {one, one, one};
    Row row[LOBES], sum = {}, out[3];
    lobes<R>(n, row);
    const Row cosine = above_zero<Row>(dot(n, light.lamp));
    for (int c = 0; c < 3; ++c) {
        if (c == 0 || !light.is_grey) {
            sum = Row{};
            for (int l = 0; l < LOBES; ++l)
                sum += row[l] * light.sky[c][l];
        }
        out[c] = above_zero(sum) + cosine * light.radiance[c];
    }
    return {out[0], out[1], out[2]};
}
// Pull a cotangent on it back to the normal and, added, to the light.
template <class R>
Vec3<Lanes<R>> pull_reflect(const Light<R>& light, Vec3<Lanes<R>> n, Vec3<Lanes<R>> on, LightCotangent& on_light) {
    typedef Lanes<R> Row;
    Vec3<Row> to = {};
    if (!light.is_on)
        return to;
    // Normals of points that overflow are no numbers, and nothing is pulled there.
    const Row any = n.x + n.y + n.z;
    for (Row* const numbers : {&n.x, &n.y, &n.z, &on.x, &on.y, &on.z})
        *numbers = by_lane([](R number, R any) { return any == any ? number : 0; }, *numbers, any);
    const auto where_lit = [](R on, R lit) { return lit >= 0 ? on : 0; };
    Row row[LOBES], sum = {}, g = {};
    lobes<R>(n, row);
    for (int c = 0; c < 3; ++c) {
        if (c == 0 || !light.is_grey) {
            sum = g = Row{};
            for (int l = 0; l < LOBES; ++l)
                sum += row[l] * light.sky[c][l];
        }
        g += by_lane(where_lit, on[c], sum);
        if (light.is_grey && c < 2)
            continue;
        for (int l = 0; l < LOBES; ++l)
            on_light.sky[c][l] += sum_lanes<R>(row[l] * g);
        to = to + light_slope(light.sky[c], n) * g;
    }
    const Row cosine = dot(n, light.lamp), pulled = by_lane(where_lit, Row(dot(on, light.radiance)), cosine);
    to = to + Vec3<Row>{pulled * light.lamp.x, pulled * light.lamp.y, pulled * light.lamp.z};
    for (int c = 0; c < 3; ++c) {
        on_light.lamp[c] += sum_lanes<R>(pulled * n[c]);
        on_light.radiance[c] += sum_lanes<R>(above_zero(cosine) * on[c]);
    }
    return to;
}

// A homogeneous point on the grid's screen: x, y and one over its depth, which is 0 nearer than `near` and if products
// of two points would overflow.
template <class R> Vec3<R> on_grid(const R* point, R scale, R near) {
    const R most = std::sqrt(std::numeric_limits<R>::max()) / 8;
    const bool fits = std::fabs(point[0] * scale) < most && std::fabs(point[1] * scale) < most && point[2] < most;
    const R q = fits && point[2] >= near ? 1 / point[2] : 0, margin = q != 0 ? R(MARGIN) : R(0);
    return {q != 0 ? point[0] * scale * q + margin : 0, q != 0 ? point[1] * scale * q + margin : 0, q};
}

// A silhouette edge on the screen: along x and y, square of its length, and the square of its normal's x.
template <class R> struct Slope {
    R x, y, square, steep;
    Slope(Vec3<R> a, Vec3<R> b) : x(b.x - a.x), y(b.y - a.y), square(std::max(x * x + y * y, R(1e-12))), steep(y * y / square) {}
};

}  // namespace vig
