// Drawing: from items to samples, fragments, light and pixels.
#pragma once

#include "../visibility.h"
#include "scene.h"
#include "shadows.h"

namespace vig::world {

constexpr int SAMPLES = 2, PIXEL_SAMPLES = SAMPLES * SAMPLES;  // along a pixel's side, and of a pixel

// The faces that one part of an item has among all that are drawn, from `first` on; those that were cut at the near plane
// have a range of their own.
struct Range {
    int first, item;
    const Part* part;
};

// A pixel's samples of one face, shaded in their middle.
struct Fragment {
    int face, pixel, range;
    float x, y, share;  // place, samples; of the pixel
};

// Light as polynomials of a unit vector (see `polynomial`): irradiance over pi by normals, radiance by directions; its main
// direction and the radiance of its highlight; the object's colour.
struct Light {
    float irradiance[9], radiance[9];
    Vec3<float> sun;
    float highlight;
    Vec3<float> albedo;
};

// A vertex as shading reads it: attributes of its asset, place on the screen and one over depth.
struct Vertex {
    float attributes[ATTRIBUTES], x, y, q;
};

// A point of a face: its depth, metres, and the weights of the second and third corner.
struct SurfacePoint {
    float z, b, c;
};

// One picture after the other, and the memory that they take.
class Drawing {
  public:
    // Draw items with so many samples along each pixel's side; `shaded`: for the methods after `hidden`.
    void rasterise(const std::vector<Item>& items, const Camera& camera, int samples, bool shaded);
    // Depth along the optical axis, metres, inf where nothing is, and the item's owner, -1 there, of each sample.
    void depth(float* far, int32_t* owner) const;
    // Draw the object alone (H, W), at the origin: whether it covers at least half of the samples of each pixel.
    void silhouette(const Item& target, const Camera& camera, bool* mask);
    // The share of N samples at which something is hidden already, or nearer than the object's depth.
    double hidden(const int64_t* samples, const float* own, const uint8_t* already, int count) const;

    // The depth of each pixel's nearest sample, and how many samples show the object, and supports.
    void collect(float* depth, uint8_t* seen, uint8_t* support);
    // Add the light of all fragments to the pixels; of the object only with an albedo.
    void shade(const Light& light, const Grid& shadow);
    // Where the object's samples lie, pixel by pixel: rows of places and normals in the world, irradiance, vertices.
    struct Surface {
        std::vector<float> points, normals, irradiance;  // (N, 3), (N, 3), (N,)
        std::vector<int32_t> vertices, pixels;
    };
    void surface(const uint8_t* seen, Surface& to) const;
    // Add colours (N, 3) of the object's samples, of which a pixel has `seen`.
    void add_colours(const Surface& samples, const float* colours, const uint8_t* seen);
    // Unit normals (H, W, 3) in the camera's frame at each pixel's nearest sample, 0 where nothing is.
    void normals(float* to) const;
    // The pixels as 8-bit sRGB (H, W, 3).
    void encode(uint8_t* image) const;

  private:
    int range_of(int face, int last) const;
    void add_part(const Item& item, const Part& part, bool shaded);
    void clip(const Asset& asset, const int32_t* corner, bool shaded);
    SurfacePoint interpolate(int face, float x, float y) const;
    void shade_range(int number, const int* sorted, int count, const Light& light, const Grid& shadow);

    Camera camera_;  // of samples
    std::vector<Item> items_;
    Mat3<float> turn_;  // camera from the item's asset
    Vec3<float> shift_;
    VisibilityBuffer<float> seen_;
    int vertex_count_ = 0, corner_count_ = 0;
    std::vector<float> screen_;               // (vertices, 3): x, y, one over depth
    std::vector<Vertex> vertices_;            // the same with their attributes
    std::vector<int32_t> corners_;            // (faces, 3), of those vertices
    std::vector<int32_t> cut_;                // the corners of faces that were cut at the near plane
    std::vector<uint8_t> facing_;
    std::vector<Range> ranges_;
    std::vector<Fragment> fragments_;
    std::vector<int> sorted_, ends_;
    std::vector<float> linear_;  // (pixels, 3)
};

// 8-bit sRGB of linear light, exactly rounded.
uint8_t encode_srgb(float linear);

}  // namespace vig::world
