// The world in Python: everything that native code reads is checked here.
#include "../arrays.h"

#include <nanobind/stl/pair.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <cmath>

#include "../threads.h"
#include "layout.h"

namespace vig {

using namespace world;

namespace {

constexpr int MAX_PIXELS = 1 << 26;  // samples of an image

Vec3<double> vector3(const char* name, nb::handle given) { return load3(array_of<double>(name, given, {3}).data()); }

Mat3<double> matrix3(const char* name, nb::handle given) {
    const double* const m = array_of<double>(name, given, {3, 3}).data();
    return {{load3(m), load3(m + 3), load3(m + 6)}};
}

void check(bool fits, const char* what) {
    if (!fits)
        throw std::invalid_argument(what);
}

// A texture that keeps its texels alive.
Texture texture_of(const Input<uint32_t>& texels, size_t first, int log_width, int log_height, float repeats) {
    check(log_width >= 0 && log_height >= 0 && log_width < MAX_LEVELS && log_height < MAX_LEVELS,
          "log_size of a texture must be 0 to 9");
    size_t needed = 0;
    for (int level = 0; level <= std::min(log_width, log_height); ++level)
        needed += (size_t)1 << (log_width + log_height - 2 * level);
    check(first <= texels.size() && needed <= texels.size() - first, "texels must hold all levels of a texture");
    return {texels.data() + first, log_width, log_height, repeats, std::make_shared<Input<uint32_t>>(texels)};
}

// parts (P, 5): end among the faces, first texel, log2 of the texture's width and height, slot or -1. materials (P, 4):
// roughness, mirror, metal, emission. ambient: values (z, y, x, 4) and origin, cell, scale (5,).
std::shared_ptr<Asset> make_asset(nb::handle vertices, nb::handle attributes, nb::handle faces, nb::handle parts,
                                  nb::handle materials, nb::handle texels, nb::handle points, nb::handle ambient,
                                  nb::handle ambient_frame) {
    auto made = std::make_shared<Asset>();
    Asset& asset = *made;
    const auto places = array_of<float>("vertices", vertices, {-1, 3});
    const size_t V = places.shape(0);
    check(V > 0 && V < (1 << 26), "an asset must have vertices, fewer than 2^26");
    asset.vertices = (int)V;
    asset.attributes = copy(array_of<float>("attributes", attributes, {(int64_t)V, ATTRIBUTES}));
    asset.corners = copy(array_of<int32_t>("faces", faces, {-1, 3}));
    check(asset.corners.size() < (1 << 28), "an asset must have fewer than 2^26 faces");
    asset.faces = (int)asset.corners.size() / 3;
    check_table("faces", asset.corners, 0, asset.vertices);
    asset.points = copy(array_of<float>("points", points, {-1, 4}));
    asset.positions.resize(3 * V);
    for (size_t v = 0; v < V; ++v)
        for (int r = 0; r < 3; ++r)
            asset.positions[r * V + v] = places.data()[3 * v + r];
    asset.sphere = bounding_sphere(asset, 0, asset.faces);
    const auto table = array_of<int32_t>("parts", parts, {-1, 5});
    const auto stuff = array_of<float>("materials", materials, {(int64_t)table.shape(0), 4});
    const auto colours = array_of<uint32_t>("texels", texels, {-1});
    int first = 0;
    for (size_t n = 0; n < table.shape(0); ++n) {
        const int32_t* const row = table.data() + 5 * n;
        const float* const m = stuff.data() + 4 * n;
        check(row[0] >= first && row[0] <= asset.faces && row[1] >= 0 && row[4] >= -1,
              "parts must have ends in ascending order among the faces, a texel, and slots from -1");
        Part part{{}, texture_of(colours, row[1], row[2], row[3], 1), row[4], m[0], m[1], m[2], m[3], 0, 0};
        add_clusters(asset, part, first, row[0]);
        asset.parts.push_back(part);
        first = row[0];
    }
    if (!ambient.is_none()) {
        const auto values = array_of<int16_t>("ambient", ambient, {-1, -1, -1, 4});
        const float* const frame = array_of<float>("ambient_frame", ambient_frame, {5}).data();
        for (int axis = 0; axis < 3; ++axis)
            asset.ambient.size[axis] = (int)values.shape(2 - axis);
        check(std::min({values.shape(0), values.shape(1), values.shape(2)}) > 1 && values.size() < INT32_MAX && frame[3] > 0,
              "ambient must have two planes or more along each axis, and cells a width");
        asset.ambient.origin = load3(frame);
        asset.ambient.cell = asset.ambient.rise[0] = frame[3];
        asset.ambient.scale = frame[4];
        asset.ambient.values = copy(values);
    }
    return made;
}

std::shared_ptr<Asset> make_lit_asset(nb::handle faces, nb::handle vertices, nb::handle added, nb::handle irradiance) {
    const auto places = array_of<float>("vertices", vertices, {-1, 3});
    auto corners = copy(array_of<int32_t>("faces", faces, {-1, 3}));
    check_table("faces", corners, 0, (int)places.shape(0));
    const float* const change = added.is_none() ? nullptr : array_of<float>("added", added, {(int64_t)places.shape(0)}).data();
    return lit_asset(std::move(corners), places.data(), (int)places.shape(0), change,
                     array_of<float>("irradiance", irradiance, {9}).data());
}

// finishes: by slot texels, log2 of width and height and repeats per metre, or None.
typedef std::vector<std::optional<std::tuple<nb::object, std::pair<int, int>, float>>> Finishes;
Item make_item(std::shared_ptr<Asset> asset, nb::handle rotation, nb::handle translation, int owner, bool is_support,
               const Finishes& finishes) {
    check(asset != nullptr, "an item must have an asset");
    Item item{asset, matrix3("rotation", rotation), vector3("translation", translation), owner, false, is_support, {}};
    for (const auto& each : finishes) {
        item.finishes.emplace_back();
        if (each) {
            const auto& [texels, log_size, repeats] = *each;
            item.finishes.back() = texture_of(array_of<uint32_t>("texels", texels, {-1}), 0, log_size.first, log_size.second, repeats);
        }
    }
    return item;
}

Camera make_camera(nb::handle rotation, nb::handle translation, double focal, double cx, double cy, double near, int width,
                   int height) {
    check(width > 0 && height > 0 && (int64_t)width * height <= MAX_PIXELS / PIXEL_SAMPLES,
          "an image must have from 1 to 16 million pixels");
    check(focal > 0 && near > 0 && std::isfinite(focal + cx + cy), "focal and near must be positive numbers, cx and cy finite");
    return {matrix3("rotation", rotation), vector3("translation", translation), focal, cx, cy, near, width, height};
}

nb::tuple draw_depth(const std::vector<Item>& items, const Camera& camera) {
    const auto far = make<float>({(size_t)camera.height, (size_t)camera.width});
    const auto owner = make<int32_t>({(size_t)camera.height, (size_t)camera.width});
    {
        const nb::gil_scoped_release released;
        Lent<Drawing> drawing;
        drawing->rasterise(items, camera, 1, false);
        drawing->depth(far.data(), owner.data());
    }
    return nb::make_tuple(far, owner);
}

nb::tuple settle_items(const std::vector<Item>& items, const Camera& camera, nb::handle motion, std::pair<double, double> ends,
                       nb::handle indices, nb::handle depths, nb::handle hidden, double level, double tolerance) {
    const auto numbers = array_of<int64_t>("indices", indices, {-1});
    const int64_t count = numbers.size();
    check(count > 0 && count <= MAX_PIXELS, "the object must have pixels");
    for (int64_t n = 0; n < count; ++n)
        check(numbers.data()[n] >= 0 && numbers.data()[n] < camera.width * camera.height, "indices must be pixels of the image");
    const ObjectPixels pixels = {(int)count, numbers.data(), array_of<float>("depths", depths, {count}).data(),
                                 (const uint8_t*)array_of<bool>("hidden", hidden, {count}).data()};
    const Vec3<double> way = vector3("motion", motion);
    double offset = 0;
    const char* reason;
    const auto far = make<float>({(size_t)camera.height, (size_t)camera.width});
    {
        const nb::gil_scoped_release released;
        Lent<Drawing> drawing;
        reason = settle(*drawing, items, camera, way, ends.first, ends.second, pixels, level, tolerance, offset);
        drawing->depth(far.data(), nullptr);
    }
    return nb::make_tuple(reason, offset, far);
}

Sky sky_of(const Input<float>& slopes, const Input<float>& weights) {
    return {(int)slopes.shape(0), slopes.data(), weights.data()};
}

// light: irradiance (9,), radiance (9,), direction and radiance of the highlight (4,), the object's albedo (3,).
nb::tuple draw_picture(Item target, const std::vector<Item>& items, const Camera& camera,
                       std::tuple<nb::object, nb::object, nb::object, nb::object> light, nb::handle slopes, nb::handle weights,
                       float reach, std::optional<nb::callable> colouring, bool normals) {
    const size_t H = camera.height, W = camera.width;
    Light lights;
    std::copy_n(array_of<float>("irradiance", std::get<0>(light), {9}).data(), 9, lights.irradiance);
    std::copy_n(array_of<float>("radiance", std::get<1>(light), {9}).data(), 9, lights.radiance);
    const auto sun = array_of<float>("sun", std::get<2>(light), {4});
    lights.sun = load3(sun.data());
    lights.highlight = sun.data()[3];
    lights.albedo = load3(array_of<float>("albedo", std::get<3>(light), {3}).data()) * (colouring ? 0.0f : 1.0f);
    const auto directions = array_of<float>("slopes", slopes, {-1, 2});
    const auto losses = array_of<float>("weights", weights, {(int64_t)directions.shape(0), 4});
    target.is_target = true;
    std::vector<Item> all = {target};
    all.insert(all.end(), items.begin(), items.end());
    const auto image = make<uint8_t>({H, W, 3}), seen = make<uint8_t>({H, W}), support = make<uint8_t>({H, W});
    const auto far = make<float>({H, W});
    std::optional<Output<float>> direction;
    if (normals)
        direction = make<float>({H, W, 3});
    {
        const nb::gil_scoped_release released;
        Lent<Drawing> drawing;
        Lent<SweepSpace> space;
        cast_shadows(*space, all, sky_of(directions, losses), reach);
        drawing->rasterise(all, camera, SAMPLES, true);
        drawing->collect(far.data(), seen.data(), support.data());
        drawing->shade(lights, space->grid);
        if (colouring) {
            Drawing::Surface samples;
            drawing->surface(seen.data(), samples);
            const nb::gil_scoped_acquire held;
            const size_t count = samples.pixels.size();
            const nb::object given =
                (*colouring)(make_copy(samples.points, {count, 3}), make_copy(samples.normals, {count, 3}),
                             make_copy(samples.irradiance, {count}), make_copy(samples.vertices, {count}));
            drawing->add_colours(samples, array_of<float>("colours", given, {(int64_t)count, 3}).data(), seen.data());
        }
        drawing->encode(image.data());
        if (normals)
            drawing->normals(direction->data());
    }
    return nb::make_tuple(image, far, seen, support, direction);
}

nb::tuple sweep_room(nb::handle opacity, float cell, nb::handle slopes, nb::handle weights, float reach) {
    const auto cells = array_of<float>("opacity", opacity, {-1, -1, -1});
    const size_t Z = cells.shape(0) + 1, Y = cells.shape(1), X = cells.shape(2);
    check(X % LANES == 0 && cells.size() > 0 && cells.size() < (1 << 26) && cell > 0,
          "opacity must be as wide as a multiple of 16, and cells must have a width");
    const auto directions = array_of<float>("slopes", slopes, {-1, 2});
    const auto losses = array_of<float>("weights", weights, {(int64_t)directions.shape(0), 4});
    Lent<SweepSpace> space;
    Grid& grid = space->grid;
    grid.cell = grid.rise[0] = cell;
    grid.rise[1] = 0;
    grid.size[0] = (int)X;
    grid.size[1] = (int)Y;
    grid.size[2] = (int)Z;
    space->opacity = copy(cells);
    sweep(*space, sky_of(directions, losses), reach);
    return nb::make_tuple(make_copy(grid.values, {Z, Y, X, 4}), grid.scale);
}

// supports (S, 8): turn, clearance, behind, half (2), centre (3); chosen (N,) supports; draws (N, 5); solids (M, 14):
// four sides, low, high. Returns states (N,) and turns, spots and slides (N, 7).
nb::tuple propose_places(nb::handle supports, nb::handle chosen, nb::handle draws, nb::handle body, nb::handle outline,
                         nb::handle solids, bool hiding, double body_height, nb::handle eye, double ahead, double slid,
                         double clearance, double lowest, double highest, double edge, double near_ray, double wall_share) {
    static_assert(sizeof(Support) == 8 * sizeof(double) && sizeof(Solid) == 14 * sizeof(double), "rows of numbers");
    const auto table = array_of<double>("supports", supports, {-1, 8}), walls = array_of<double>("outline", outline, {-1, 2});
    const auto bodies = array_of<double>("body", body, {-1, 2}), furniture = array_of<double>("solids", solids, {-1, 14});
    const auto numbers = array_of<int64_t>("chosen", chosen, {-1});
    const size_t count = numbers.size();
    const auto random = array_of<double>("draws", draws, {(int64_t)count, 5});
    const PlaceSearch search = {bodies.data(), walls.data(), (const Solid*)furniture.data(), (int)bodies.shape(0),
                                (int)walls.shape(0), (int)furniture.shape(0), hiding, body_height, vector3("eye", eye),
                                ahead, slid, clearance, lowest, highest, edge, near_ray, wall_share};
    const auto states = make<int32_t>({count});
    const auto poses = make<double>({count, 7});
    for (size_t n = 0; n < count; ++n) {
        check(numbers.data()[n] >= 0 && (size_t)numbers.data()[n] < table.shape(0), "chosen must be numbers of supports");
        const Place place = search.propose(((const Support*)table.data())[numbers.data()[n]], random.data() + 5 * n);
        double* const pose = poses.data() + 7 * n;
        states.data()[n] = place.state;
        pose[0] = place.turn;
        std::copy_n(place.spot, 3, pose + 1);
        std::copy_n(place.slide, 3, pose + 4);
    }
    return nb::make_tuple(states, poses);
}

// numbers (12,): the object's middle row and column, its front and depth, scale, margin, nearest, gap, widest gap, half (2),
// clearance and hand inside: see `Stage`.
Stage make_stage(const Camera& camera, nb::handle sums, int pixel_count, bool closer, nb::handle ahead, nb::handle aside,
                 nb::handle support, nb::handle support_origin, const std::vector<double>& n) {
    check(n.size() == 13 && pixel_count > 0, "a stage must have 13 numbers, and the object pixels");
    Stage stage = {camera, copy(array_of<int64_t>("sums", sums, {camera.height + 1, camera.width + 1})), pixel_count, closer,
                   {n[0], n[1]}, vector3("ahead", ahead), vector3("aside", aside), n[2], n[3], n[4], n[5], n[6], n[7], n[8],
                   matrix3("support", support), vector3("support_origin", support_origin), {n[9], n[10]}, n[11], n[12]};
    return stage;
}

// uniform (N, 3) for "standing", else (N, 7); normal (N, 3); props (P, Q, 3), in turn one for each draw; hands (N, Q, 3) or
// none. Returns the number of the first draw that has room, and the occluder; or None.
nb::object draw_occluders(const Stage& stage, const std::string& name, nb::handle uniform, nb::handle normal, nb::handle props, nb::handle hands,
                          int thin, double level, double hidden, std::pair<double, double> ends) {
    const int kind = int(std::find(std::begin(OCCLUDER_KINDS), std::end(OCCLUDER_KINDS), name) - OCCLUDER_KINDS);
    check(kind <= BOARD && thin >= 0 && thin < 3, "kind must be standing, in hand, arm, twig or board, and thin an axis");
    const bool stands = kind == STANDING;
    const auto u = array_of<double>("uniform", uniform, {-1, stands ? 3 : 7});
    const int64_t count = u.shape(0);
    const auto around = array_of<double>("normal", normal, {stands ? 0 : count, 3});
    const auto clouds = array_of<double>("props", props, {-1, -1, 3}), arms = array_of<double>("hands", hands, {-1, -1, 3});
    check(clouds.size() > 0 && (arms.shape(0) == 0 || (int64_t)arms.shape(0) == count),
          "props must have points, and each draw a hand or none");
    const OccluderRequest request = {(OccluderKind)kind, thin, level, hidden, ends.first, ends.second};
    const size_t size = clouds.shape(1), hand_size = arms.shape(1);
    for (int64_t n = 0; n < count; ++n) {
        Occluder drawn;
        const Cloud prop = {clouds.data() + 3 * size * (n % clouds.shape(0)), (int)size};
        const Cloud hand = {arms.data() + 3 * hand_size * n, arms.shape(0) ? (int)hand_size : 0};
        if (!draw_occluder(stage, request, prop, hand, u.data() + u.shape(1) * n, around.data() + 3 * n, drawn))
            continue;
        const auto numbers = make<double>({9, 3});
        const Vec3<double> rows[9] = {drawn.turn.row[0], drawn.turn.row[1], drawn.turn.row[2],
                                      drawn.hand_turn.row[0], drawn.hand_turn.row[1], drawn.hand_turn.row[2],
                                      drawn.position, drawn.hand_position, drawn.motion};
        for (int r = 0; r < 9; ++r)
            store3(numbers.data() + 3 * r, rows[r]);
        return nb::make_tuple(n, numbers, drawn.least, drawn.most, drawn.front, drawn.bound);
    }
    return nb::none();
}

}  // namespace

void bind_world(nb::module_& m) {
    nb::class_<Asset>(m, "Asset").def_ro("vertices", &Asset::vertices).def_ro("faces", &Asset::faces);
    nb::class_<Item>(m, "Item");
    nb::class_<Camera>(m, "Camera");
    nb::class_<Stage>(m, "Stage");
    m.attr("SAMPLES") = SAMPLES;
    m.attr("PLACE_GOOD") = (int)PLACE_GOOD;
    m.attr("PLACE_TOO_SMALL") = (int)PLACE_TOO_SMALL;
    m.attr("PLACE_EYE") = (int)PLACE_EYE;
    m.attr("PLACE_OPEN") = (int)PLACE_OPEN;
    m.def("asset", &make_asset, "vertices"_a, "attributes"_a, "faces"_a, "parts"_a, "materials"_a, "texels"_a, "points"_a,
          "ambient"_a.none() = nb::none(), "ambient_frame"_a.none() = nb::none());
    m.def("lit_asset", &make_lit_asset, "faces"_a, "vertices"_a, "added"_a.none(), "irradiance"_a);
    m.def("item", &make_item, "asset"_a, "rotation"_a, "translation"_a, "owner"_a, "is_support"_a, "finishes"_a);
    m.def("camera", &make_camera, "rotation"_a, "translation"_a, "focal"_a, "cx"_a, "cy"_a, "near"_a, "width"_a, "height"_a);
    m.def("draw_depth", &draw_depth, "items"_a, "camera"_a);
    m.def("settle", &settle_items, "items"_a, "camera"_a, "motion"_a, "ends"_a, "indices"_a, "depths"_a, "hidden"_a, "level"_a,
          "tolerance"_a);
    m.def("draw_picture", &draw_picture, "target"_a, "items"_a, "camera"_a, "light"_a, "slopes"_a, "weights"_a, "reach"_a,
          "colouring"_a.none(), "normals"_a);
    m.def("silhouette", [](const Item& target, const Camera& camera) {
        const auto mask = make<bool>({(size_t)camera.height, (size_t)camera.width});
        const nb::gil_scoped_release released;
        Lent<Drawing>()->silhouette(target, camera, mask.data());
        return mask;
    });
    m.def("sweep", &sweep_room, "opacity"_a, "cell"_a, "slopes"_a, "weights"_a, "reach"_a);
    m.def("encode_srgb", [](nb::handle linear) {
        const auto values = array_of<float>("linear", linear, {-1});
        const auto levels = make<uint8_t>({values.size()});
        std::transform(values.data(), values.data() + values.size(), levels.data(), encode_srgb);
        return levels;
    });
    m.def("propose_places", &propose_places, "supports"_a, "chosen"_a, "draws"_a, "body"_a, "outline"_a, "solids"_a, "hiding"_a,
          "body_height"_a, "eye"_a, "ahead"_a, "slid"_a, "clearance"_a, "lowest"_a, "highest"_a, "edge"_a, "near_ray"_a,
          "wall_share"_a);
    m.def("stage", &make_stage, "camera"_a, "sums"_a, "pixel_count"_a, "closer"_a, "ahead"_a, "aside"_a, "support"_a,
          "support_origin"_a, "numbers"_a);
    m.def("draw_occluder", &draw_occluders, "stage"_a, "kind"_a, "uniform"_a, "normal"_a, "props"_a, "hands"_a, "thin"_a,
          "level"_a, "hidden"_a, "ends"_a);
}

}  // namespace vig
