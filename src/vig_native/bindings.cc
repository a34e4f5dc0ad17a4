// The Python module: arrays in, arrays out. Shapes are checked here, before anything reads them; types by nanobind.
#include <nanobind/stl/function.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <climits>
#include <limits>
#include <mutex>

#include "arrays.h"
#include "images.h"
#include "likelihood.h"
#include "rays.h"
#include "search.h"
#include "threads.h"

namespace vig {

void bind_poses(nb::module_& m);
void bind_world(nb::module_& m);

namespace {

// Take links (8, H, W) that leave the image, or join pixels that are not both free, and keep sums of the others in range.
void close_links(int height, int width, const bool* free, int32_t* links) {
    constexpr int across[8] = {1, -1, 0, 0, 1, -1, -1, 1}, down[8] = {0, 0, 1, -1, 1, -1, 1, -1};
    for (int way = 0; way < 8; ++way)
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x) {
                const int to_x = x + across[way], to_y = y + down[way];
                const bool within = to_x >= 0 && to_x < width && to_y >= 0 && to_y < height;
                int32_t& link = links[((size_t)way * height + y) * width + x];
                if (!within || !free[(size_t)y * width + x] || !free[(size_t)to_y * width + to_x])
                    link = 0;
                link = std::clamp(link, 0, 1 << 29);
            }
}

// Columns of a point in the order of `PointLayout`.
PointLayout layout_of(const std::vector<int>& numbers) {
    if (numbers.size() != 8)
        throw std::invalid_argument("layout must be 8 numbers; got " + std::to_string(numbers.size()));
    const PointLayout layout{numbers[0], numbers[1], numbers[2], numbers[3],
                             numbers[4], numbers[5], numbers[6], numbers[7]};
    const auto fits = [&](int from, int count) { return from >= 0 && from <= layout.size - count; };
    if (layout.modes < 1 || layout.size > 4096 || layout.modes > layout.size || !fits(layout.shape, layout.modes) || !fits(layout.azimuth, 1) || !fits(layout.elevation, 1)
        || !fits(layout.albedo, 3) || !fits(layout.light, LOBES) || !fits(layout.framing, 4))
        throw std::invalid_argument("layout has blocks beyond its size");
    return layout;
}

template <class R>
Geometry<R> make_geometry(std::vector<int> layout, Input<R> positions, Input<int32_t> corners, Input<int32_t> edges,
                          Input<int32_t> ring_start, Input<int32_t> ring, Input<R> reflectance,
                          Optional<R> transfer) {
    Geometry<R> g;
    g.layout = layout_of(layout);
    g.modes = g.layout.modes;
    g.width = (g.modes + LANES - 1) / LANES * LANES;
    check_shape("positions", positions, {g.modes + 1, -1, 3});
    const size_t vertices = positions.shape(1);
    g.vertices = (int)vertices;
    check_shape("faces", corners, {-1, 3});
    check_shape("edges", edges, {-1, 5});
    check_shape("ring_start", ring_start, {g.vertices + 1});
    check_shape("ring", ring, {-1, 3});
    check_shape("reflectance", reflectance, {g.vertices});
    g.faces = (int)corners.shape(0);
    g.edges = (int)edges.shape(0);
    g.positions.assign((vertices + LANES - 1) / LANES * (g.modes + 1) * 3 * LANES, 0);
    for (size_t row = 0; row < (size_t)g.modes + 1; ++row)
        for (size_t vertex = 0; vertex < vertices; ++vertex)
            for (size_t axis = 0; axis < 3; ++axis)
                g.positions[((vertex / LANES * (g.modes + 1) + row) * 3 + axis) * LANES + vertex % LANES] =
                    positions.data()[(row * vertices + vertex) * 3 + axis];
    g.corners = copy(corners);
    g.edge_table = copy(edges);
    g.ring_start = copy(ring_start);
    g.ring = copy(ring);
    g.reflectance = copy(reflectance);
    check_table("faces", g.corners, 0, g.vertices);
    check_table("ring", g.ring, 0, g.vertices);
    check_table("ring_start", g.ring_start, 0, (int)ring.shape(0) + 1);
    g.largest_ring = 0;
    for (int vertex = 0; vertex < g.vertices; ++vertex)
        g.largest_ring = std::max(g.largest_ring, g.ring_start[vertex + 1] - g.ring_start[vertex]);
    for (int edge = 0; edge < g.edges; ++edge) {
        const int32_t* const row = &g.edge_table[5 * (size_t)edge];
        const bool beyond = row[3] >= 0;
        const auto is_corner = [&](int vertex) {
            const int32_t* const corner = &g.corners[3 * (size_t)row[2]];
            return vertex == corner[0] || vertex == corner[1] || vertex == corner[2];
        };
        if (std::min(row[0], row[1]) < 0 || std::max(row[0], row[1]) >= g.vertices || row[2] < 0 || row[2] >= g.faces
            || row[3] >= g.faces || (beyond && (row[4] < 0 || row[4] >= g.vertices))
            || !is_corner(row[0]) || !is_corner(row[1]))
            throw std::invalid_argument("edges has numbers out of range in row " + std::to_string(edge));
    }
    const auto by_mode = [&](const R* of, size_t rows, size_t columns, std::vector<R>& to) {
        to.assign(rows * columns * g.width, 0);
        for (int mode = 0; mode < g.modes; ++mode)
            for (size_t at = 0; at < rows * columns; ++at)
                to[at * g.width + mode] = of[(size_t)(1 + mode) * rows * columns + at];
    };
    by_mode(positions.data(), vertices, 3, g.basis);
    g.shadowed = transfer.has_value();
    if (g.shadowed) {
        check_shape("transfer", *transfer, {g.modes + 1, g.vertices, LOBES});
        g.transfer_mean.assign(vertices * REST, 0);
        for (size_t vertex = 0; vertex < vertices; ++vertex)
            std::copy_n(transfer->data() + vertex * LOBES, LOBES, &g.transfer_mean[vertex * REST + LIGHT]);
        by_mode(transfer->data(), vertices, LOBES, g.transfer_by_shape);
    }
    return g;
}

template <class R>
Photos<R> make_photos(std::tuple<double, double, double, double, double, int, int> camera, Input<R> observed,
                      Input<R> log_prior, int stride, bool exact, int density) {
    Photos<R> p;
    const auto [focal, cx, cy, target_height, distance, width, height] = camera;
    p.camera = {focal, cx, cy, target_height, distance, width, height};
    if (width < 1 || height < 1 || stride < 1 || (int64_t)height * width > INT_MAX / 4)
        throw std::invalid_argument("width, height and stride must be 1 or more, and fit into memory");
    bool known = false;
    with_density(density, [&](auto of) {
        known = true;
        p.log_unit = decltype(of)::LOG_UNIT;
    });
    if (!known)
        throw std::invalid_argument("density must be a place in DENSITIES; got " + std::to_string(density));
    check_shape("observed", observed, {-1, (int64_t)height * width, 3});
    check_shape("log_prior", log_prior, {(int64_t)observed.shape(0), (int64_t)height * width, 3});
    p.count = (int)observed.shape(0);
    p.stride = stride;
    p.exact = exact;
    p.density = density;
    const size_t pixels = p.pixels();
    const auto by_channel = [&](const R* of, std::vector<R>& to) {
        to.assign(p.count * pixels * 3 + LANES, 0);
        for (size_t photo = 0; photo < (size_t)p.count; ++photo)
            for (size_t channel = 0; channel < 3; ++channel)
                for (size_t at = 0; at < pixels; ++at)
                    to[(3 * photo + channel) * pixels + at] = of[3 * (photo * pixels + at) + channel];
    };
    by_channel(observed.data(), p.observed);
    by_channel(log_prior.data(), p.log_prior);
    for (int n = 0; n < p.count; ++n) {
        double sum = 0;
        for (size_t at = 0; at < pixels; ++at)
            sum += p.log_prior[(3 * (size_t)n + 2) * pixels + at];
        p.background.push_back(sum);
    }
    return p;
}

template <class R>
nb::tuple evaluate_points(const Geometry<R>& geometry, const Photos<R>& photos, Input<R> points, Input<int32_t> photo,
                          Input<double> sigma, int order, bool images, int threads) {
    const size_t size = geometry.layout.size, pixels = photos.pixels();
    check_shape("points", points, {-1, (int64_t)size});
    const size_t count = points.shape(0);
    check_shape("photo", photo, {(int64_t)count});
    check_shape("sigma", sigma, {(int64_t)count});
    check_table("photo", copy(photo), 0, photos.count);
    const size_t derived = order ? count : 0, curved = order > 1 ? count : 0, shown = images ? count : 0;
    const size_t height = photos.camera.height, width = photos.camera.width;
    const auto value = make<double>({count});
    const auto gradient = make<R>({derived, size}), normal = make<R>({curved, size, size});
    const auto posterior = make<R>({shown, height, width}), coverage = make<R>({shown, height, width});
    const auto irradiance = make<R>({shown, height, width});
    {
        const nb::gil_scoped_release released;
        threads = (int)std::clamp<size_t>(count, 1, std::max(threads, 1));
        run_threads(threads, [&](int thread) {
            Lent<Workspace<R>> lent;
            Workspace<R>& work = *lent;
            for (size_t n = thread; n < count; n += threads) {
                value.data()[n] = evaluate(geometry, photos, work, points.data() + n * size, photo.data()[n], sigma.data()[n],
                                           order, images, order ? gradient.data() + n * size : nullptr,
                                           order > 1 ? normal.data() + n * size * size : nullptr);
                if (images) {
                    std::copy_n(work.posterior.begin(), pixels, posterior.data() + n * pixels);
                    std::copy_n(work.irradiance.begin(), pixels, irradiance.data() + n * pixels);
                    std::transform(work.coverage.begin(), work.coverage.begin() + pixels, coverage.data() + n * pixels,
                                   [](R share) { return std::clamp(share, R(0), R(1)); });
                }
            }
        });
    }
    return nb::make_tuple(value, gradient, normal, posterior, coverage, irradiance);
}

template <class R>
Prior<R> make_prior(Input<R> mean, Input<R> precision, Input<R> heading_mean, Input<R> heading_precision,
                    Input<R> azimuths, double azimuth_precision, double fold, int azimuth, int light) {
    Prior<R> p;
    const int64_t size = mean.size();
    check_shape("mean", mean, {-1});
    check_shape("precision", precision, {size, size});
    check_shape("heading_mean", heading_mean, {heading_mean.size() ? LOBES : 0});
    check_shape("heading_precision", heading_precision, {(int64_t)heading_mean.size()});
    check_shape("azimuths", azimuths, {-1});
    if (azimuth < 0 || azimuth >= size || light < 0 || light > size - LOBES)
        throw std::invalid_argument("azimuth and light must be places in a point");
    p.size = (int)size;
    p.mean = copy(mean);
    p.precision = copy(precision);
    p.heading_mean = copy(heading_mean);
    p.heading_precision = copy(heading_precision);
    p.azimuths = copy(azimuths);
    p.azimuth_precision = R(azimuth_precision);
    p.fold = R(fold);
    p.azimuth = azimuth;
    p.light = light;
    return p;
}

// Search from starts (S, n): path (T + 1, S, n), values (S,), normals (S, n, n) if there is to be `curvature`, evaluations
// (S,), converged (S,).
// function_of(thread) makes the function that a thread calls.
template <class R, class F>
nb::tuple search_all(Input<R> starts, Input<R> lower, Input<R> upper, const SearchSettings& settings, bool curvature,
                     int threads, F&& function_of) {
    check_shape("starts", starts, {-1, -1});
    if (settings.iterations < 0 || settings.iterations > 1000000)
        throw std::invalid_argument("iterations must be 0 to 1,000,000; got " + std::to_string(settings.iterations));
    const size_t count = starts.shape(0), n = starts.shape(1), steps = settings.iterations + 1;
    check_shape("lower", lower, {(int64_t)n});
    check_shape("upper", upper, {(int64_t)n});
    curvature &= settings.iterations > 0;
    const auto path = make<R>({steps, count, n}), normal = make<R>({curvature ? count : 0, n, n});
    const auto value = make<double>({count});
    const auto evaluations = make<int64_t>({count});
    const auto converged = make<bool>({count});
    {
        const nb::gil_scoped_release released;
        threads = (int)std::clamp<size_t>(count, 1, std::max(threads, 1));
        run_threads(threads, [&](int thread) {
            Lent<Workspace<R>> lent;
            const Function<R> function = function_of(*lent);
            for (size_t s = thread; s < count; s += threads) {
                const SearchEnd end = search((int)n, function, starts.data() + s * n, lower.data(), upper.data(), settings,
                                             path.data() + s * n, count * n,
                                             curvature ? normal.data() + s * n * n : nullptr);
                value.data()[s] = end.value;
                evaluations.data()[s] = end.evaluations;
                converged.data()[s] = end.converged;
            }
        });
    }
    return nb::make_tuple(path, value, normal, evaluations, converged);
}

template <class R>
nb::tuple search_photo(const Geometry<R>& geometry, const Photos<R>& photos, const Prior<R>& prior, int photo,
                       double sigma, Input<R> starts, Input<R> lower, Input<R> upper, int iterations, double tolerance,
                       double damping, double give_up, bool curvature, int threads) {
    check_shape("starts", starts, {-1, geometry.layout.size});
    if (photo < 0 || photo >= photos.count || prior.size != geometry.layout.size)
        throw std::invalid_argument("photo or prior does not fit");
    return search_all<R>(starts, lower, upper, {iterations, tolerance, damping, give_up}, curvature, threads,
                         [&](Workspace<R>& work) {
                             return [&](const R* point, R* gradient, R* normal, const Worth& worth) {
                                 const double log_prior = prior.add_to(point, nullptr, nullptr);
                                 bool derived = false;
                                 const double value = evaluate(
                                     geometry, photos, work, point, photo, sigma, gradient ? 2 : 0, false, gradient, normal,
                                     [&](double likelihood) { return derived = worth(likelihood + log_prior); });
                                 if (derived)
                                     prior.add_to(point, gradient, normal);
                                 return value + log_prior;
                             };
                         });
}

// The same of any function in Python, called with a point (n,): value, gradient (n,) and normal matrix (n, n).
template <class R>
nb::tuple search_function(nb::callable function, Input<R> starts, Input<R> lower, Input<R> upper, int iterations,
                          double tolerance, double damping, double give_up) {
    const auto call = [&](const R* point, R* gradient, R* normal, const Worth& worth) {
        const nb::gil_scoped_acquire held;
        const size_t n = lower.size();
        const auto array = make<R>({n});
        std::copy(point, point + n, array.data());
        const auto [value, slope, curved] =
            nb::cast<std::tuple<double, Optional<R>, Optional<R>>>(
                function(array, gradient != nullptr));
        if (gradient && worth(value)) {
            if (!slope || !curved)
                throw std::invalid_argument("the function must return a gradient and a normal matrix");
            check_shape("gradient", *slope, {(int64_t)n});
            check_shape("normal", *curved, {(int64_t)n, (int64_t)n});
            std::copy(slope->data(), slope->data() + n, gradient);
            std::copy(curved->data(), curved->data() + n * n, normal);
        }
        return value;
    };
    return search_all<R>(starts, lower, upper, {iterations, tolerance, damping, give_up}, true, 1,
                         [&](Workspace<R>&) { return call; });
}

// Draw one mesh of points (V, 3) before a camera at the origin: face (H, W), weights of its corners (H, W, 3) and depth
// (H, W), -1, 0 and infinity where nothing is seen. Faces nearer than `near` to the camera's plane are not drawn.
template <class R>
nb::tuple rasterize(Input<R> points, Input<int32_t> corners, std::tuple<double, double, double, int, int> camera,
                    double near, bool cull) {
    check_shape("points", points, {-1, 3});
    check_shape("faces", corners, {-1, 3});
    check_table("faces", copy(corners), 0, (int)points.shape(0));
    const auto [focal, cx, cy, width, height] = camera;
    const size_t vertices = points.shape(0), faces = corners.shape(0);
    if (width < 1 || height < 1 || (int64_t)height * width > INT_MAX / 4 || std::max(vertices, faces) > INT_MAX / 4)
        throw std::invalid_argument("width and height must be 1 or more, and pixels, points and faces fit into memory");
    const auto weights = make<R>({(size_t)height, (size_t)width, 3}), depth = make<R>({(size_t)height, (size_t)width});
    VisibilityBuffer<R> seen;
    {
        const nb::gil_scoped_release released;
        std::vector<R> screen(3 * vertices);
        for (size_t v = 0; v < vertices; ++v) {
            const Vec3<R> point = load3(points.data() + 3 * v);
            const R q = 1 / point.z, scale = R(focal) * q;
            if (point.z > R(near))
                store3(&screen[3 * v], {point.x * scale + R(cx), point.y * scale + R(cy), q});
        }
        seen.clear(height * width);
        std::vector<uint8_t> facing(faces);
        draw_faces(screen.data(), corners.data(), (int)faces, width, height, cull, seen, facing.data());
        for (int y = 0, at = 0; y < height; ++y)
            for (int x = 0; x < width; ++x, ++at) {
                const int face = seen.face[at];
                const Fragment<R> here = face == NO_FACE ? Fragment<R>{{0, 0, 0}, std::numeric_limits<R>::infinity()}
                                                         : fragment_at(screen.data(), corners.data(), face, x, y);
                std::copy_n(here.weights, 3, weights.data() + 3 * (size_t)at);
                depth.data()[at] = here.depth;
            }
    }
    return nb::make_tuple(make_copy(seen.face, {(size_t)height, (size_t)width}), weights, depth);
}

// Cast rays from points against a mesh: blocked (V, 9), faces (V, R), weights (V, R, 3), see rays.h.
nb::tuple cast_rays(Input<float> vertices, Input<int32_t> corners, Input<double> points, Input<double> frames,
                    Input<double> patterns, Input<double> turns, double offset, int chunk) {
    check_shape("vertices", vertices, {-1, 3});
    check_shape("faces", corners, {-1, 3});
    check_table("faces", copy(corners), 0, (int)vertices.shape(0));
    check_shape("points", points, {-1, 3});
    const size_t count = points.shape(0);
    if (chunk < 1)
        throw std::invalid_argument("chunk must be 1 or more; got " + std::to_string(chunk));
    check_shape("frames", frames, {(int64_t)count, 3, 3});
    check_shape("patterns", patterns, {((int64_t)count + chunk - 1) / chunk, -1, 2});
    check_shape("turns", turns, {(int64_t)count});
    const size_t rays = patterns.shape(1);
    if (std::max({count, rays, corners.shape(0)}) > INT_MAX / 4)
        throw std::invalid_argument("points, rays and faces must fit into memory");
    const auto blocked = make<double>({count, (size_t)LOBES});
    const auto faces = make<int32_t>({count, rays});
    const auto weights = make<float>({count, rays, 3});
    {
        const nb::gil_scoped_release released;
        const RayMesh mesh(vertices.data(), corners.data(), (int)corners.shape(0));
        cast_hemisphere_rays(mesh, {(int)count, (int)rays, chunk, points.data(), frames.data(), patterns.data(), turns.data(), offset},
                             blocked.data(), faces.data(), weights.data());
    }
    return nb::make_tuple(blocked, faces, weights);
}

template <class R> void bind(nb::module_& m, const char* geometry, const char* photos, const char* prior) {
    nb::class_<Geometry<R>>(m, geometry);
    nb::class_<Photos<R>>(m, photos);
    nb::class_<Prior<R>>(m, prior).def(
        "add_to",
        [](const Prior<R>& self, Input<R> points, InOut<double> value, OptionalOut<R> gradient, OptionalOut<R> normal) {
            check_shape("points", points, {-1, self.size});
            const int64_t count = points.shape(0), n = self.size;
            check_shape("value", value, {count});
            if (gradient)
                check_shape("gradient", *gradient, {count, n});
            if (normal)
                check_shape("normal", *normal, {count, n, n});
            for (int64_t b = 0; b < count; ++b)
                value.data()[b] += self.add_to(points.data() + b * n, gradient ? gradient->data() + b * n : nullptr,
                                               normal ? normal->data() + b * n * n : nullptr);
        },
        "points"_a, "value"_a.noconvert(), "gradient"_a.noconvert().none(), "normal"_a.noconvert().none());
    m.def("geometry", &make_geometry<R>, "layout"_a, "positions"_a, "faces"_a, "edges"_a, "ring_start"_a, "ring"_a,
          "reflectance"_a, "transfer"_a.none());
    m.def("photos", &make_photos<R>, "camera"_a, "observed"_a, "log_prior"_a, "stride"_a, "exact"_a, "density"_a);
    m.def("prior", &make_prior<R>);
    m.def("evaluate", &evaluate_points<R>, "geometry"_a, "photos"_a, "points"_a, "photo"_a, "sigma"_a, "order"_a,
          "images"_a, "threads"_a);
    m.def("search", &search_photo<R>, "geometry"_a, "photos"_a, "prior"_a, "photo"_a, "sigma"_a, "starts"_a, "lower"_a,
          "upper"_a, "iterations"_a, "tolerance"_a, "damping"_a, "give_up"_a, "curvature"_a,
          "threads"_a);
    m.def("search_function", &search_function<R>, "function"_a, "starts"_a, "lower"_a, "upper"_a, "iterations"_a,
          "tolerance"_a, "damping"_a, "give_up"_a);
    m.def("rasterize", &rasterize<R>, "points"_a, "faces"_a, "camera"_a, "near"_a, "cull"_a);
}

}  // namespace

NB_MODULE(VIG_MODULE, m) {
    nb::set_leak_warnings(false);  // caches of modules hold assets until the process ends
    bind_world(m);
    bind<float>(m, "Geometry32", "Photos32", "Prior32");
    bind<double>(m, "Geometry64", "Photos64", "Prior64");
    nb::dict densities;  // names, in their order, and log normalisers
#define VIG_NAME(NAME) densities[#NAME] = density::NAME::LOG_UNIT;
    VIG_DENSITIES(VIG_NAME)
#undef VIG_NAME
    m.attr("DENSITIES") = densities;
    bind_scenes(m);
    bind_poses(m);
    m.def("minimum_cut", [](Input<bool> free, Input<int32_t> alone, InOut<int32_t> links) {
        check_shape("free", free, {-1, -1, -1});
        const size_t count = free.shape(0), height = free.shape(1), width = free.shape(2), size = height * width;
        check_shape("alone", alone, {(int64_t)count, (int64_t)height, (int64_t)width});
        check_shape("links", links, {(int64_t)count, 8, (int64_t)height, (int64_t)width});
        const auto visible = make<bool>({count, height, width});
        const nb::gil_scoped_release released;
        for (size_t n = 0; n < count; ++n) {
            close_links((int)height, (int)width, free.data() + n * size, links.data() + n * 8 * size);
            minimum_cut((int)height, (int)width, (const uint8_t*)free.data() + n * size, alone.data() + n * size,
                        links.data() + n * 8 * size, (uint8_t*)visible.data() + n * size);
        }
        return visible;
    }, "free"_a, "alone"_a, "links"_a.noconvert());
    m.def("cast_hemisphere_rays", &cast_rays, "vertices"_a, "faces"_a, "points"_a, "frames"_a, "patterns"_a, "turns"_a, "offset"_a,
          "chunk"_a);
    m.def("colour_density", [](Input<double> photo, Input<double> shares) {
        check_shape("shares", shares, {-1, -1, -1});
        const size_t count = shares.shape(0), height = shares.shape(1), width = shares.shape(2), size = height * width;
        check_shape("photo", photo, {(int64_t)height, (int64_t)width, 3});
        const auto density = make<double>({count, height, width});
        const nb::gil_scoped_release released;
        for (size_t n = 0; n < count; ++n)
            colour_density((int)size, photo.data(), shares.data() + n * size, density.data() + n * size);
        return density;
    });
}

}  // namespace vig
