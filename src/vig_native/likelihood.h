// Eq. 4 of one point, a guess of latents and framing: value, exact gradient and Gauss-Newton matrix.
#pragma once
#include <functional>
#include <memory>

#include "density.h"
#include "mesh.h"
#include "rows.h"
#include "visibility.h"

namespace vig {

// N photos of one size and the prior of their pixels, and how they are explained.
template <class R> struct Photos {
    Camera camera;
    int count, stride, density;
    bool exact;                      // silhouettes move the objective; else the mask is constant within an evaluation
    double log_unit;                 // log normaliser of the density for sigma = 1
    std::vector<R> observed;         // (N, 3, H * W) linear RGB, and LANES more, as so many are read at a time
    std::vector<R> log_prior;        // (N, 3, H * W) visible, hidden, background, and LANES more
    std::vector<double> background;  // (N,) log-likelihood of all pixels as background
    int pixels() const { return camera.width * camera.height; }
};

// Memory of one evaluation, kept from one to the next. Sizes as in `Geometry`; H, W of the photos.
template <class R> struct Workspace {
    std::vector<R> world, points;                      // (V, 4) x, y, z, 0 in metres; x, y, q, irradiance where in use
    std::vector<uint8_t> used;                         // (V,) 1: on a visible face or an occlusion edge, 2: with shape row
    std::vector<R> normals;                            // (V, 4) unit, world, and one over the length before
    std::vector<R> shape_rows, rest_rows;              // (V, W), (V, REST) derivatives of the irradiances
    std::vector<R> shadow_rates;                       // (V, W) part of the shape rows, see `shadow`
    VisibilityBuffer<R> visible;                       // (H * W)
    std::vector<uint8_t> facing, shown;                // (F,); (1 + F,) none, faces: whether at any pixel
    std::vector<int32_t> seen_vertices, edges;         // vertices in use; occlusion edges; in their order
    std::vector<R> arms;                               // (., 4) cotangents on the places of a ring
    std::vector<R> on_corner, on_normal, on_world;     // (V, 4) by point; by normal in the camera's frame; by world place
    std::vector<int32_t> row_pixels, row_vertices;     // pixels with rows in the normal matrix; corners of their faces
    std::vector<int32_t> crossed;                      // (., 2) ends of the edge of each crossing
    std::vector<R> motions;                            // (., 4, 4) first end on the screen and its root motion; second end
    std::vector<R> rows;                               // rows of the normal matrix, (., W + REST)
    std::vector<R> products;                           // (W + REST, W + REST)
    std::vector<R> posterior, coverage, irradiance;    // (H * W) images, and LANES more as in `VisibilityBuffer`
    std::vector<R> coefficients;                       // (W,)
    size_t row_count;
    void fit(const Geometry<R>& geometry, const Photos<R>& photos);
    // The next rows of the normal matrix, to be written.
    R* add_rows(size_t row_width, size_t count);
};

// A point as it is evaluated.
template <class R> struct Task {
    const Geometry<R>& geometry;
    const Photos<R>& photos;
    Workspace<R>& work;
    Eye<R> eye;
    Noise<R> noise;
    Vec3<R> albedo;
    const R* light;      // (LOBES,)
    const R *observed, *log_prior;  // (3, H * W) of the point's photo
    int order;           // 0: the value alone, 1: with gradient, 2: with normal matrix
    bool images;
    // A pixel of one of the two.
    Vec3<R> pixel(const R* image, size_t at) const {
        const size_t plane = photos.pixels();
        return {image[at], image[plane + at], image[2 * plane + at]};
    }
};

// Log-likelihood gained over background, and its derivative by albedo.
template <class R> struct Gain {
    double value = 0;
    double albedo[3] = {};
};

// shading.cc: normals, irradiances and the rest of their rows of the vertices in use; the shape part of rows; and the way
// back of all cotangents: those on the screen, irradiance and normals become those on world places, and on pose, light and
// framing (rest, REST) and on shape through the transfer (shape, W).
template <class R> void shade(Task<R>& task);
template <class R> void write_shape_rows(Task<R>& task);
template <class R> void unshade(Task<R>& task, R* shape, R* rest);
// interior.cc: covered pixels; rows of the normal matrix, a row for every stride-th pixel of every stride-th line.
template <class R> Gain<R> explain_interior(Task<R>& task);
template <class R> void add_interior_rows(Task<R>& task);
// silhouette.cc: marks the ends of occlusion edges as used; blends across these edges; rows of their crossings.
template <class R> void find_occlusion_edges(Task<R>& task, std::vector<int32_t>& edges);
template <class R> Gain<R> blend_silhouette(Task<R>& task, const std::vector<int32_t>& edges);
template <class R> void add_edge_rows(Task<R>& task);

// Evaluate a point (P',) of photo `which` under noise sigma. gradient (P',) and normal (P', P') are written where the
// order asks for them and the value is worth it; images stay in the workspace.
template <class R>
double evaluate(const Geometry<R>& geometry, const Photos<R>& photos, Workspace<R>& work, const R* point, int which,
                double sigma, int order, bool images, R* gradient, R* normal,
                const std::function<bool(double)>& worth = nullptr);

}  // namespace vig
