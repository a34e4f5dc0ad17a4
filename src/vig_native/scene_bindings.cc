// Scenes of the public renderer in Python; see vig_renderer/native.py.
#include "arrays.h"

#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/vector.h>

#include <climits>

#include "scenes.h"

namespace vig {
namespace {

// Copies tables, so that later writes to them change nothing.
std::shared_ptr<Mesh> make_mesh(Input<int32_t> faces, Input<int32_t> texture_faces, Input<int32_t> edges, int vertices) {
    check_shape("faces", faces, {-1, 3});
    const int count = (int)faces.shape(0);
    check_shape("texture_faces", texture_faces, {count, 3});
    check_shape("edges", edges, {-1, 6});
    auto mesh = std::make_shared<Mesh>(Mesh{vertices, 0, copy(faces), copy(texture_faces), {}});
    const int edge_count = (int)edges.shape(0);
    for (int column = 0; column < 6; ++column)
        for (int e = 0; e < edge_count; ++e)
            mesh->edges.push_back(edges.data()[6 * (size_t)e + column]);
    check_table("faces", mesh->corners, 0, vertices);
    for (const int32_t row : mesh->texture_corners) {
        if (row < 0)
            throw std::invalid_argument("texture_faces must name rows of coordinates, 0 and up; they name " + std::to_string(row));
        mesh->texture_rows = std::max(mesh->texture_rows, (int64_t)row + 1);
    }
    const auto check_columns = [&](int first, int columns, int least, int end) {
        check_table("edges", mesh->edges.data() + (size_t)first * edge_count, (size_t)columns * edge_count, least, end);
    };
    check_columns(0, 3, 0, vertices);
    check_columns(3, 1, -1, vertices);
    check_columns(4, 1, 0, count);
    check_columns(5, 1, -1, count);
    return mesh;
}

// Scenes and the arrays that they point into.
template <class R> class BoundScenes {
  public:
    // levels: those of each mesh's texture (L, 3), or None. starts (L + 1): the meshes of each layer.
    BoundScenes(std::vector<std::shared_ptr<Mesh>> meshes, std::vector<Optional<int32_t>> levels,
                std::vector<int> places, std::vector<int> starts, int height, int width, int samples, double near, int masks,
                bool is_mask) {
        const int64_t rows = (int64_t)height * samples + 2 * MARGIN, columns = (int64_t)width * samples + 2 * MARGIN;
        // Numbers of lines and columns are exact in single precision.
        const int64_t longest = std::max(rows, columns);
        if (height < 1 || width < 1 || samples < 1 || longest > (1 << 24) - 4 || rows * columns > INT_MAX / 8)
            throw std::invalid_argument("an image must have a pixel or more and at most 268 million samples; got " +
                                        std::to_string(width) + " x " + std::to_string(height) + " pixels of " +
                                        std::to_string(samples) + " x " + std::to_string(samples) + " samples");
        if (levels.size() != meshes.size() || places.size() != meshes.size() || starts.empty() || starts.front() != 0 ||
            starts.back() != (int)meshes.size() || !std::is_sorted(starts.begin(), starts.end()))
            throw std::invalid_argument("levels and places must be as many as meshes, and starts lead from 0 to their number");
        int64_t vertices = 0, faces = 0;
        if (masks < 0 || (is_mask && masks != 1) || std::count(meshes.begin(), meshes.end(), nullptr))
            throw std::invalid_argument("meshes must be Mesh, and masks as many as a scene's objects, 1 where only they are drawn");
        for (size_t n = 0; n < meshes.size(); ++n) {
            if (!is_mask && (places[n] < 0 || places[n] >= masks))
                throw std::invalid_argument("places must be from 0 to " + std::to_string(masks - 1));
            Object<R> object{meshes[n], places[n], (int)vertices, (int)faces};
            if (levels[n]) {
                check_shape("levels", *levels[n], {-1, 3});
                object.levels = copy(*levels[n]);
            }
            vertices += meshes[n]->vertices;
            faces += meshes[n]->faces();
            scenes_.objects.push_back(std::move(object));
        }
        if (std::max(vertices, 3 * faces) > INT_MAX / 8)
            throw std::invalid_argument("scenes may have 89 million faces together; got " + std::to_string(faces));
        scenes_.starts = starts;
        scenes_.height = height;
        scenes_.width = width;
        scenes_.samples = samples;
        scenes_.near = (R)near;
        scenes_.masks = masks;
        scenes_.is_mask = is_mask;
    }

    // The inputs of each object in the order of `ObjectInput`; fills points and attributes. See `Scenes::place`.
    bool place(std::vector<std::vector<Optional<R>>> inputs, InOut<R> points, InOut<R> attributes, int threads) {
        bind(points, attributes);
        take_inputs(inputs);
        stage_ = Stage::placed;
        const nb::gil_scoped_release released;
        return scenes_.place(points.data(), attributes.data(), threads);
    }
    void bind(InOut<R> points, OptionalOut<R> attributes) {
        stage_ = Stage::bound;
        check_shape("points", points, {scenes_.vertex_count(), 3});
        scenes_.points = points.data();
        points_ = points;
        if (attributes) {
            check_shape("attributes", *attributes, {scenes_.vertex_count(), -1});
            scenes_.columns = (int)attributes->shape(1);
            if (scenes_.columns != 6 && scenes_.columns != 9)
                throw std::invalid_argument("attributes must have 6 or 9 columns; got " + std::to_string(scenes_.columns));
            scenes_.attributes = attributes->data();
            attributes_ = attributes;
        }
    }
    void find(bool edges, int threads) {
        need(stage_ >= Stage::bound);
        stage_ = std::min(stage_, Stage::placed);  // painted results are gone
        const nb::gil_scoped_release released;
        scenes_.layers.assign(layers(), {});
        scenes_.find(edges, threads);
    }
    // For each layer: face (grid), silhouettes (S, 4) and crossings (M, 7), see `Layer`.
    nb::list found() const {
        nb::list out;
        for (const Layer<R>& layer : scenes_.layers) {
            static_assert(sizeof(Silhouette) == 4 * sizeof(int32_t) && sizeof(Crossing) == 7 * sizeof(int32_t), "rows of numbers");
            const auto silhouettes = make<int32_t>({layer.silhouettes.size(), 4});
            const auto crossings = make<int32_t>({layer.crossings.size(), 7});
            std::copy(layer.silhouettes.begin(), layer.silhouettes.end(), (Silhouette*)silhouettes.data());
            std::copy(layer.crossings.begin(), layer.crossings.end(), (Crossing*)crossings.data());
            out.append(nb::make_tuple(make_copy(layer.face, {scenes_.grid()}), silhouettes, crossings));
        }
        return out;
    }
    void paint(Optional<R> background, OptionalOut<R> rgb, OptionalOut<R> coverage, InOut<R> visible, int threads) {
        need(scenes_.is_mask ? stage_ >= Stage::bound : stage_ >= Stage::placed && background && rgb);
        if (background) {
            const bool image = background->ndim() == 4;
            check_shape("background", *background, image ? shape(3) : std::vector<int64_t>{layers(), 3});
            background_ = background;
            scenes_.background = background->data();
            scenes_.background_is_image = image;
        }
        const Images<R> to = images<R>(rgb, coverage, std::optional(visible));
        stage_ = Stage::painted;
        const nb::gil_scoped_release released;
        scenes_.paint(to, threads);
    }
    // Pull back cotangents on images and on results of `place`: add to on_points and on_attributes, then to the inputs'
    // and the background's, each of its shape.
    void back(Optional<R> on_rgb, Optional<R> on_coverage, Optional<R> on_visible, InOut<R> on_points, OptionalOut<R> on_attributes,
              OptionalOut<R> on_background, std::vector<std::vector<OptionalOut<R>>> on_inputs, int threads) const {
        need(stage_ == Stage::painted);
        check_shape("on_points", on_points, {scenes_.vertex_count(), 3});
        need(scenes_.is_mask || on_attributes);
        if (on_attributes)
            check_shape("on_attributes", *on_attributes, {scenes_.vertex_count(), scenes_.columns});
        if (on_background)
            check_shape("on_background", *on_background,
                        scenes_.background_is_image ? shape(3) : std::vector<int64_t>{layers(), 3});
        const Images<const R> on = images<const R>(on_rgb, on_coverage, on_visible);
        std::vector<Cotangents<R>> to(scenes_.objects.size(), Cotangents<R>{});
        need(scenes_.is_mask || on_inputs.size() == to.size());
        for (size_t n = 0; n < on_inputs.size(); ++n) {
            need(on_inputs[n].size() == INPUTS);
            for (int i = 0; i < INPUTS; ++i)
                if (on_inputs[n][i]) {
                    check_count("a cotangent", n, i, on_inputs[n][i]->size(), {scenes_.objects[n].count[i]});
                    to[n][i] = on_inputs[n][i]->data();
                }
        }
        R *const points = on_points.data(), *const attributes = data_or_null(on_attributes);
        R* const to_background = data_or_null(on_background);
        const nb::gil_scoped_release released;
        std::vector<LightCotangent> on_lights(to.size());
        scenes_.paint_back(on, points, attributes, to_background, on_lights, to, threads);
        if (!scenes_.is_mask)
            scenes_.place_back(points, attributes, on_lights, to, threads);
    }
    void surface(InOut<R> depth, InOut<R> normals, InOut<int32_t> object, InOut<int32_t> triangle) const {
        need(scenes_.attributes && scenes_.samples == 1 && scenes_.layers.size() == (size_t)layers());
        check_shape("depth", depth, shape(0));
        check_shape("normals", normals, shape(3));
        check_shape("object_id", object, shape(0));
        check_shape("triangle_id", triangle, shape(0));
        const nb::gil_scoped_release released;
        scenes_.surface(depth.data(), normals.data(), object.data(), triangle.data());
    }
    void surface_back(Optional<R> on_depth, Optional<R> on_normals, InOut<R> on_points, InOut<R> on_attributes) const {
        need(scenes_.attributes && scenes_.samples == 1 && scenes_.layers.size() == (size_t)layers());
        if (on_depth)
            check_shape("on_depth", *on_depth, shape(0));
        if (on_normals)
            check_shape("on_normals", *on_normals, shape(3));
        check_shape("on_points", on_points, {scenes_.vertex_count(), 3});
        check_shape("on_attributes", on_attributes, {scenes_.vertex_count(), scenes_.columns});
        const nb::gil_scoped_release released;
        scenes_.surface_back(data_or_null(on_depth), data_or_null(on_normals), on_points.data(), on_attributes.data());
    }

  private:
    enum class Stage { made, bound, placed, painted } stage_ = Stage::made;
    Scenes<R> scenes_;
    std::vector<std::vector<Optional<R>>> inputs_;
    OptionalOut<R> points_, attributes_;
    Optional<R> background_;

    int64_t layers() const { return (int64_t)scenes_.starts.size() - 1; }
    // (L, H, W), or (L, H, W, channels).
    std::vector<int64_t> shape(int64_t channels) const {
        std::vector<int64_t> out = {layers(), scenes_.height, scenes_.width};
        if (channels)
            out.push_back(channels);
        return out;
    }
    static void need(bool condition) {
        if (!condition)
            throw std::invalid_argument("scenes must be placed, then painted, before they are pulled back or their surface is asked for");
    }
    static void check_count(const char* what, size_t object, int input, size_t count, std::initializer_list<int64_t> wanted) {
        if (std::find(wanted.begin(), wanted.end(), (int64_t)count) == wanted.end())
            throw std::invalid_argument(std::string(what) + " " + std::to_string(input) + " of object " + std::to_string(object) +
                                        " must have " + std::to_string(*wanted.begin()) + " numbers; got " +
                                        std::to_string(count));
    }
    template <class N, class A> Images<N> images(const A& rgb, const A& coverage, const A& visible) const {
        if (rgb)
            check_shape("rgb", *rgb, shape(3));
        if (coverage)
            check_shape("coverage", *coverage, shape(0));
        if (visible)
            check_shape("visible", *visible, {layers(), scenes_.masks, scenes_.height, scenes_.width});
        return {data_or_null(rgb), data_or_null(coverage), data_or_null(visible)};
    }
    void take_inputs(const std::vector<std::vector<Optional<R>>>& inputs) {
        if (inputs.size() != scenes_.objects.size())
            throw std::invalid_argument("inputs must be of " + std::to_string(scenes_.objects.size()) + " objects; got " +
                                        std::to_string(inputs.size()));
        std::vector<std::array<int64_t, INPUTS>> count(inputs.size());
        for (size_t n = 0; n < inputs.size(); ++n) {
            const Object<R>& object = scenes_.objects[n];
            const Mesh& mesh = *object.mesh;
            need(inputs[n].size() == INPUTS);
            const int64_t vertices = 3 * (int64_t)mesh.vertices;
            const std::initializer_list<int64_t> wanted[COORDINATES] = {{vertices}, {9}, {3}, {vertices}, {3, vertices}, {9, 27},
                                                                        {3}, {3}, {9}, {3}, {2}, {2}};
            for (int i = 0; i < INPUTS; ++i) {
                const bool needed = i == VERTICES || i == ALBEDO || (i >= CAMERA_ROTATION && i <= CENTRE) ||
                                    (i == RADIANCE && inputs[n][LAMP]) || (i >= COORDINATES && !object.levels.empty());
                if (needed && !inputs[n][i])
                    throw std::invalid_argument("input " + std::to_string(i) + " of object " + std::to_string(n) + " is missing");
                count[n][i] = inputs[n][i] ? inputs[n][i]->size() : 0;
                if (i < COORDINATES && inputs[n][i])
                    check_count("input", n, i, count[n][i], wanted[i]);
            }
            if (object.levels.empty())
                continue;
            for (size_t l = 0; l < object.levels.size(); l += 3) {
                const int64_t first = object.levels[l], rows = object.levels[l + 1], columns = object.levels[l + 2];
                if (first < 0 || rows < 1 || columns < 1 || 3 * (first + rows * columns) > count[n][TEXELS])
                    throw std::invalid_argument("levels must lie within the texels, and each texture must have one or more");
            }
            if (2 * mesh.texture_rows > count[n][COORDINATES])
                throw std::invalid_argument("a texture needs a row of texture_coordinates for each of its corners");
        }
        inputs_ = inputs;
        for (size_t n = 0; n < inputs.size(); ++n) {
            Object<R>& object = scenes_.objects[n];
            object.count = count[n];
            for (int i = 0; i < INPUTS; ++i)
                object.in[i] = i >= COORDINATES && object.levels.empty() ? nullptr : data_or_null(inputs_[n][i]);
        }
    }
};

template <class R> void bind_type(nb::module_& m, const char* name) {
    typedef BoundScenes<R> Bound;
    nb::class_<Bound>(m, name)
        .def(nb::init<std::vector<std::shared_ptr<Mesh>>, std::vector<Optional<int32_t>>, std::vector<int>,
                      std::vector<int>, int, int, int, double, int, bool>(),
             "meshes"_a, "levels"_a, "places"_a, "starts"_a, "height"_a, "width"_a, "samples"_a, "near"_a, "masks"_a,
             "is_mask"_a)
        .def("place", &Bound::place, "inputs"_a.noconvert(), "points"_a.noconvert(), "attributes"_a.noconvert(), "threads"_a)
        .def("bind", &Bound::bind, "points"_a.noconvert(), "attributes"_a.noconvert().none())
        .def("find", &Bound::find, "edges"_a, "threads"_a)
        .def("found", &Bound::found)
        .def("paint", &Bound::paint, "background"_a.noconvert().none(), "rgb"_a.noconvert().none(),
             "coverage"_a.noconvert().none(), "visible"_a.noconvert(), "threads"_a)
        .def("back", &Bound::back, "on_rgb"_a.noconvert().none(), "on_coverage"_a.noconvert().none(),
             "on_visible"_a.noconvert().none(), "on_points"_a.noconvert(), "on_attributes"_a.noconvert().none(),
             "on_background"_a.noconvert().none(), "on_inputs"_a.noconvert(), "threads"_a)
        .def("surface", &Bound::surface, "depth"_a.noconvert(), "normals"_a.noconvert(), "object_id"_a.noconvert(),
             "triangle_id"_a.noconvert())
        .def("surface_back", &Bound::surface_back, "on_depth"_a.noconvert().none(), "on_normals"_a.noconvert().none(),
             "on_points"_a.noconvert(), "on_attributes"_a.noconvert());
}

}  // namespace

void bind_scenes(nb::module_& m) {
    nb::class_<Mesh>(m, "Mesh")
        .def_ro("texture_rows", &Mesh::texture_rows)
        .def("tables", [](const Mesh& mesh) {  // faces and texture_faces (F, 3)
            const size_t faces = mesh.faces();
            return nb::make_tuple(make_copy(mesh.corners, {faces, 3}), make_copy(mesh.texture_corners, {faces, 3}));
        });
    m.def("mesh", &make_mesh, "faces"_a.noconvert(), "texture_faces"_a.noconvert(), "edges"_a.noconvert(), "vertices"_a);
    bind_type<float>(m, "Scenes32");
    bind_type<double>(m, "Scenes64");
}

}  // namespace vig
