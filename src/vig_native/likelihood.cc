#include "likelihood.h"

#include <algorithm>

namespace vig {

template <class R> Eye<R> eye_of(const R* point, const PointLayout& layout, const Camera& camera) {
    const double azimuth = point[layout.azimuth], elevation = point[layout.elevation];
    const R* const framing = point + layout.framing;
    const R sa = R(std::sin(azimuth)), ca = R(std::cos(azimuth)), se = R(std::sin(elevation)), ce = R(std::cos(elevation));
    const R sr = R(std::sin(double(framing[3]))), cr = R(std::cos(double(framing[3])));
    const Vec3<R> right = {ca, sa, 0}, down = {se * sa, -se * ca, -ce}, forward = {-ce * sa, ce * ca, -se};
    Eye<R> eye;
    // Roll about the optical axis, after the upright camera of azimuth and elevation.
    eye.rotation = {{right * cr - down * sr, right * sr + down * cr, forward}};
    eye.level = {cr, sr};
    eye.focal = R(camera.focal * std::exp(double(framing[2])));
    eye.cx = R(camera.cx) + framing[0] * camera.width;
    eye.cy = R(camera.cy) + framing[1] * camera.width;
    eye.distance = R(camera.distance);
    eye.target_height = R(camera.target_height);
    eye.width = camera.width;
    eye.height = camera.height;
    return eye;
}

template <class R> void Workspace<R>::fit(const Geometry<R>& geometry, const Photos<R>& photos) {
    const size_t vertices = geometry.vertices, width = geometry.width, pixels = photos.pixels();
    for (std::vector<R>* rows : {&world, &points, &normals})
        rows->resize(4 * (vertices + LANES));
    arms.resize(4 * geometry.largest_ring);
    shape_rows.resize(vertices * width);
    rest_rows.resize(vertices * REST);
    shadow_rates.resize(geometry.shadowed ? vertices * width : 0);
    visible.clear((int)pixels);
    facing.resize(geometry.faces);
    used.assign(vertices, 0);
    products.resize((width + REST) * (width + REST));
    posterior.resize(pixels + LANES);
    coefficients.assign(width, 0);
    row_count = 0;
    crossed.clear();
    motions.clear();
}

template <class R> R* Workspace<R>::add_rows(size_t row_width, size_t count) {
    const size_t from = row_count * row_width, end = from + count * row_width;
    row_count += count;
    if (rows.size() < end)
        rows.resize(std::max(2 * rows.size(), end + 1024 * row_width));
    return rows.data() + from;
}

namespace {

// Places of all vertices in the world, Eq. 1: (1, coefficients) times (mean, components), and on the screen.
template <class R> void place_vertices(Task<R>& task) {
    typedef Lanes<R> Row;
    const Eye<R>& eye = task.eye;
    const R near = R(0.01);  // metres; a triangle with a corner nearer than this is not drawn
    const R* rows = task.geometry.positions.data();
    const int modes = task.geometry.modes;
    for (int first = 0; first < task.geometry.vertices; first += LANES, rows += (modes + 1) * 3 * LANES) {
        Row world[4] = {};
        constexpr int PARTS = 3 * LANES / REGISTER;
        Register<R> sums[PARTS];
        for (int part = 0; part < PARTS; ++part)
            sums[part] = register_at(rows + part * REGISTER);
        for (int mode = 0; mode < modes; ++mode)
            for (int part = 0; part < PARTS; ++part)
                sums[part] += task.work.coefficients[mode] * register_at(rows + (mode + 1) * 3 * LANES + part * REGISTER);
        for (int part = 0; part < PARTS; ++part)
            register_at((R*)world + part * REGISTER) = sums[part];
        const Vec3<Row> point = eye.rotation * Vec3<Row>{world[0], world[1], world[2] - eye.target_height};
        // The camera's frame has its origin `distance` metres before the target.
        const Row depth = point.z + eye.distance, q = depth > near ? 1 / depth : Row{}, scale = eye.focal * q;
        Row screen[4] = {point.x * scale + eye.cx, point.y * scale + eye.cy, q, Row{}};
        scatter_four<R>(world, [&](int lane, Four<R> numbers) { four_at(task.work.world, first + lane) = numbers; });
        scatter_four<R>(screen, [&](int lane, Four<R> numbers) { four_at(task.work.points, first + lane) = numbers; });
    }
}

// products (W, W) = rows^T rows; W is a multiple of LANES. Blocks above the diagonal, then mirrored.
template <class R> void square_rows(const R* rows, size_t count, int width, R* products) {
    constexpr int TILE = 8;       // registers that are summed at once
    constexpr size_t NEAR = 128;  // rows that are taken at once, so that they stay in the nearest cache
    std::fill_n(products, (size_t)width * width, R(0));
    for (size_t first = 0; first < count; first += NEAR)
        for (int column = 0; column < width; column += REGISTER)
            for (int i = 0; i < column + REGISTER; i += TILE) {
                Register<R> sums[TILE];
                for (int j = 0; j < TILE; ++j)
                    sums[j] = register_at(products + (size_t)(i + j) * width + column);
                for (size_t line = first; line < std::min(first + NEAR, count); ++line) {
                    const R* const row = rows + line * width;
                    const Register<R> columns = register_at(row + column);
                    for (int j = 0; j < TILE; ++j)
                        sums[j] += row[i + j] * columns;
                }
                for (int j = 0; j < TILE; ++j)
                    register_at(products + (size_t)(i + j) * width + column) = sums[j];
            }
    for (int i = 0; i < width; ++i)
        for (int j = 0; j < i; ++j)
            products[(size_t)i * width + j] = products[(size_t)j * width + i];
}

// List the vertices in use: those of visible faces and of occlusion edges.
template <class R> void list_seen_vertices(Task<R>& task) {
    Workspace<R>& work = task.work;
    const int pixels = task.photos.pixels();
    static_assert(NO_FACE == -1, "the first place is that of no face");
    work.shown.assign(task.geometry.faces + 1, 0);
    for (int pixel = 0; pixel < pixels; ++pixel)
        work.shown[1 + work.visible.face[pixel]] = 1;
    for (int face = 0; face < task.geometry.faces; ++face)
        if (work.shown[1 + face])
            for (int n = 0; n < 3; ++n)
                work.used[task.geometry.corners[3 * (size_t)face + n]] = 1;
    work.seen_vertices.resize(task.geometry.vertices);
    int count = 0;
    for (int vertex = 0; vertex < task.geometry.vertices; ++vertex) {
        work.seen_vertices[count] = vertex;
        count += work.used[vertex] != 0;
    }
    work.seen_vertices.resize(count);
}

// Gradient (P',) and normal matrix (P', P') from their parts. A colour channel's row is albedo times the shared row, and
// irradiance in that channel's albedo place; summed over the channels only |albedo|^2, albedo and 1 are left of them.
template <class R>
void assemble(const Task<R>& task, const R* shape, const R* rest, const double* on_albedo, R* gradient, R* normal) {
    const PointLayout& layout = task.geometry.layout;
    const int width = task.geometry.width, row_width = width + REST;
    // The column of a row for each of a point's numbers, -1 for those that nothing depends on.
    std::vector<int> column(layout.size, -1);
    for (int mode = 0; mode < layout.modes; ++mode)
        column[layout.shape + mode] = mode;
    column[layout.azimuth] = width + AZIMUTH;
    column[layout.elevation] = width + ELEVATION;
    for (int channel = 0; channel < 3; ++channel)
        column[layout.albedo + channel] = width + IRRADIANCE;
    for (int lobe = 0; lobe < LOBES; ++lobe)
        column[layout.light + lobe] = width + LIGHT + lobe;
    for (int n = 0; n < 4; ++n)
        column[layout.framing + n] = width + FRAMING + n;
    const Vec3<R> colour = task.albedo;
    for (int i = 0; i < layout.size; ++i) {
        const int channel = i - layout.albedo, at = column[i];
        const bool painted = channel >= 0 && channel < 3;
        gradient[i] = painted ? R(on_albedo[channel]) : at < 0 ? 0 : at < width ? shape[at] : rest[at - width];
        for (int j = 0; normal && j < layout.size; ++j) {
            const int other = j - layout.albedo;
            const bool other_painted = other >= 0 && other < 3;
            // Sum over the channels of d colour / d one times d colour / d other, irradiance taken out.
            R factor = dot(colour, colour);
            if (painted)
                factor = other_painted ? R(channel == other) : colour[channel];
            else if (other_painted)
                factor = colour[other];
            const bool depends = at >= 0 && column[j] >= 0;
            normal[(size_t)i * layout.size + j] =
                depends ? factor * task.work.products[(size_t)at * row_width + column[j]] : 0;
        }
    }
}

}  // namespace

template <class R>
double evaluate(const Geometry<R>& geometry, const Photos<R>& photos, Workspace<R>& work, const R* point, int which,
                double sigma, int order, bool images, R* gradient, R* normal,
                const std::function<bool(double)>& worth) {
    const PointLayout& layout = geometry.layout;
    const size_t first = (size_t)which * photos.pixels() * 3, vertices = geometry.vertices;
    work.fit(geometry, photos);
    if (order) {
        for (std::vector<R>* rows : {&work.on_corner, &work.on_normal, &work.on_world})
            rows->assign(4 * vertices, 0);
    }
    if (images) {
        for (std::vector<R>* image : {&work.posterior, &work.coverage, &work.irradiance})
            image->assign(photos.pixels() + LANES, 0);
    }
    Task<R> task{geometry, photos, work, eye_of(point, layout, photos.camera), Noise<R>(sigma, photos.log_unit),
                 load3(point + layout.albedo), point + layout.light, photos.observed.data() + first,
                 photos.log_prior.data() + first, order, images};
    std::copy_n(point + layout.shape, layout.modes, work.coefficients.begin());
    place_vertices(task);
    draw_faces<R, 4>(work.points.data(), geometry.corners.data(), geometry.faces, photos.camera.width, photos.camera.height,
               true, work.visible, work.facing.data());
    work.edges.clear();
    if (photos.exact)
        find_occlusion_edges(task, work.edges);
    list_seen_vertices(task);
    shade(task);
    Gain<R> gain = explain_interior(task);
    if (photos.exact) {
        const Gain<R> more = blend_silhouette(task, work.edges);
        gain.value += more.value;
        for (int channel = 0; channel < 3; ++channel)
            gain.albedo[channel] += more.albedo[channel];
    }
    const double value = photos.background[which] + gain.value;
    if (!order || (worth && !worth(value)))
        return value;
    std::vector<R> shape(geometry.width, 0);
    R rest[REST] = {};
    unshade(task, shape.data(), rest);
    if (order > 1) {
        add_interior_rows(task);
        add_edge_rows(task);
        square_rows(work.rows.data(), work.row_count, geometry.width + REST, work.products.data());
    }
    assemble(task, shape.data(), rest, gain.albedo, gradient, order > 1 ? normal : nullptr);
    return value;
}

template Eye<VIG_REAL> eye_of(const VIG_REAL*, const PointLayout&, const Camera&);
template struct Workspace<VIG_REAL>;
template double evaluate(const Geometry<VIG_REAL>&, const Photos<VIG_REAL>&, Workspace<VIG_REAL>&, const VIG_REAL*, int, double,
                         int, bool, VIG_REAL*, VIG_REAL*, const std::function<bool(double)>&);

}  // namespace vig
