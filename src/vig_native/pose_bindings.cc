// The pose of a textured mesh: arrays in, arrays out.
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <climits>
#include <cstring>

#include "arrays.h"
#include "pose.h"
#include "pose_views.h"
#include "threads.h"

namespace vig {

namespace {

// `levels` (L, 4): texture, width, height, first number of its texels; in order, a texture's finest first.
TexturedMesh make_mesh(Input<float> positions, Input<int32_t> corners, Input<float> normals, Input<float> uv,
                       Input<int32_t> texture_of_face, Input<int64_t> levels, Input<float> texels, Input<float> octave, bool closed) {
    check_shape("positions", positions, {-1, 3});
    check_shape("faces", corners, {-1, 3});
    const int64_t vertices = positions.shape(0), faces = corners.shape(0);
    check_shape("normals", normals, {vertices, 3});
    check_shape("uv", uv, {faces, 3, 2});
    check_shape("texture_of_face", texture_of_face, {faces});
    check_shape("levels", levels, {-1, 4});
    check_shape("texels", texels, {-1});
    check_shape("octave", octave, {faces});
    if (std::max(vertices, faces) > INT_MAX / 8 || vertices < 1 || faces < 1)
        throw std::invalid_argument("positions and faces must be 1 or more, and fit into memory");
    TexturedMesh mesh{(int)vertices, (int)faces, closed, copy(positions), copy(normals), copy(uv), copy(corners),
                      copy(texture_of_face), {}, copy(texels), copy(octave)};
    for (float& texel : mesh.texels)
        texel = std::log(std::max(texel, 0.0f) + MIN_COLOUR);
    for (size_t i = 0; i < levels.shape(0); ++i) {
        const int64_t* const level = levels.data() + 4 * i;
        const bool next = level[0] == (int64_t)mesh.textures.size(), same = level[0] + 1 == (int64_t)mesh.textures.size();
        const bool sized = std::min(level[1], level[2]) >= 1 && std::max(level[1], level[2]) <= 1 << 15 && level[3] >= 0;
        if (!(next || same) || !sized || level[3] + 3 * level[1] * level[2] > (int64_t)texels.shape(0))
            throw std::invalid_argument("levels has numbers out of range in row " + std::to_string(i));
        if (next)
            mesh.textures.emplace_back();
        mesh.textures.back().levels.push_back({(int)level[1], (int)level[2], (size_t)level[3]});
    }
    check_table("faces", mesh.corners, 0, vertices);
    check_table("texture_of_face", mesh.texture_of_face, 0, (int64_t)mesh.textures.size());
    for (const auto* const numbers : {&mesh.octave, &mesh.uv})
        for (const float number : *numbers)
            if (!(std::abs(number) < 1e6f))
                throw std::invalid_argument("octave and uv must be finite, within a million");
    return mesh;
}

PosePhoto make_photo(Input<float> colour, Input<float> seen, std::tuple<double, double, double> camera,
                     std::optional<std::vector<float>> box, Optional<float> surroundings, bool outlined, float metres_per_pixel,
                     std::vector<float> weights) {
    check_shape("colour", colour, {-1, -1, 3});
    const int64_t height = colour.shape(0), width = colour.shape(1);
    check_shape("seen", seen, {height, width});
    if (height < 1 || width < 1 || std::max(height, width) > 4096)
        throw std::invalid_argument("colour must have 1 to 4096 pixels a side");
    if (weights.size() != 9 || (box && box->size() != 4) || !(metres_per_pixel > 0 && metres_per_pixel < 1e9f))
        throw std::invalid_argument("weights must be 9 numbers, and box 4; metres_per_pixel above 0");
    const auto [focal, cx, cy] = camera;
    PosePhoto photo{(int)width, (int)height, (float)focal, (float)cx, (float)cy, {}, copy(seen), 0, {}, outlined, box.has_value(), {},
                    metres_per_pixel, {}};
    std::memcpy(&photo.weights, weights.data(), sizeof photo.weights);
    static_assert(sizeof photo.weights == 9 * sizeof(float));
    const size_t area = (size_t)height * width;
    if (surroundings) {
        check_shape("surroundings", *surroundings, {height, width});
        photo.surroundings = copy(*surroundings);
    }
    photo.log_colour.resize(3 * area);
    for (size_t i = 0; i < area; ++i) {
        photo.total_seen += photo.seen[i];
        for (int c = 0; c < 3; ++c)
            photo.log_colour[c * area + i] = std::log(std::max(colour.data()[3 * i + c], 0.0f) + MIN_COLOUR);
    }
    if (box)
        std::copy_n(box->begin(), 4, photo.box);
    return photo;
}

RigidPose pose_at(const float* rotation, const float* translation) {
    return {{{load3(rotation), load3(rotation + 3), load3(rotation + 6)}}, load3(translation)};
}

void check_poses(const Input<float>& rotations, const Input<float>& translations) {
    check_shape("rotations", rotations, {-1, 3, 3});
    check_shape("translations", translations, {(int64_t)rotations.shape(0), 3});
}

}  // namespace

void bind_poses(nb::module_& m) {
    nb::class_<TexturedMesh>(m, "TexturedMesh");
    nb::class_<PosePhoto>(m, "PosePhoto");
    m.def("textured_mesh", &make_mesh, "positions"_a, "faces"_a, "normals"_a, "uv"_a, "texture_of_face"_a, "levels"_a,
          "texels"_a, "octave"_a, "closed"_a);
    m.def("pose_photo", &make_photo, "colour"_a, "seen"_a, "camera"_a, "box"_a.none(), "surroundings"_a.none(), "outlined"_a,
          "metres_per_pixel"_a, "weights"_a);
    m.attr("MIN_COLOUR") = MIN_COLOUR;
    // Scores (N,) of poses; with `evaluations` they are refined first: rotations (N, 3, 3), translations (N, 3), scores (N,).
    m.def("refine_poses", [](const TexturedMesh& mesh, const PosePhoto& photo, Input<float> rotations, Input<float> translations,
                             int evaluations, std::tuple<float, float, float> steps, int threads) {
        check_poses(rotations, translations);
        const size_t count = rotations.shape(0);
        const auto turned = make<float>({count, 3, 3}), moved = make<float>({count, 3});
        const auto scores = make<double>({count});
        const float by[3] = {std::get<0>(steps), std::get<1>(steps), std::get<2>(steps)};
        {
            const nb::gil_scoped_release released;
            share_out(count, threads, [&](size_t n) {
                const Lent<PoseScratch> scratch;
                RigidPose pose = pose_at(rotations.data() + 9 * n, translations.data() + 3 * n);
                scores.data()[n] = evaluations > 0 ? refine_pose(mesh, photo, pose, evaluations, by, *scratch)
                                                   : score_pose(mesh, photo, pose, *scratch);
                for (int i = 0; i < 3; ++i)
                    store3(turned.data() + 9 * n + 3 * i, pose.rotation.row[i]);
                store3(moved.data() + 3 * n, pose.translation);
            });
        }
        return nb::make_tuple(turned, moved, scores);
    }, "mesh"_a, "photo"_a, "rotations"_a, "translations"_a, "evaluations"_a, "steps"_a, "threads"_a);
    // One pose (3, 3), (3,): covered share (H, W), linear colour (H, W, 3) unlit, normals (H, W, 3), probability (H, W) that
    // a pixel shows the surface, and the light (6,).
    m.def("draw_pose", [](const TexturedMesh& mesh, const PosePhoto& photo, Input<float> rotation, Input<float> translation) {
        check_shape("rotation", rotation, {3, 3});
        check_shape("translation", translation, {3});
        const size_t height = photo.height, width = photo.width;
        const auto coverage = make<float>({height, width}), colour = make<float>({height, width, 3}), normal = make<float>({height, width, 3});
        const auto inlier = make<float>({height, width});
        const auto light = make<double>({6});
        std::fill_n(coverage.data(), coverage.size(), 0.0f);
        std::fill_n(colour.data(), colour.size(), 0.0f);
        std::fill_n(normal.data(), normal.size(), 0.0f);
        std::fill_n(inlier.data(), inlier.size(), 0.0f);
        std::fill_n(light.data(), 6, 0.0);
        {
            const nb::gil_scoped_release released;
            const Lent<PoseScratch> scratch;
            const RigidPose pose = pose_at(rotation.data(), translation.data());
            scratch->pixels.clear();
            score_pose(mesh, photo, pose, *scratch, light.data(), inlier.data());
            for (const PosePixel& pixel : scratch->pixels) {
                coverage.data()[pixel.place] = pixel.coverage;
                const Vec3<float> c = pixel.log_colour;
                store3(colour.data() + 3 * (size_t)pixel.place,
                       {std::exp(c.x) - MIN_COLOUR, std::exp(c.y) - MIN_COLOUR, std::exp(c.z) - MIN_COLOUR});
                store3(normal.data() + 3 * (size_t)pixel.place, pixel.normal);
            }
        }
        return nb::make_tuple(coverage, colour, normal, inlier, light);
    }, "mesh"_a, "photo"_a, "rotation"_a, "translation"_a);
    // Scores (N,) of placed views: numbers (N,), placements (N, 5): cos, sin, x, y, scale; see pose_views.h.
    m.def("score_views", [](Input<float> views, Input<float> photo, Input<int32_t> numbers, Input<float> placements, float outline,
                            float unseen, int threads) {
        check_shape("views", views, {-1, Views::PLANES, -1, -1});
        check_shape("views", views, {-1, Views::PLANES, (int64_t)views.shape(2), (int64_t)views.shape(2)});
        check_shape("photo", photo, {4, -1, -1});
        check_shape("numbers", numbers, {-1});
        const size_t count = numbers.shape(0);
        check_shape("placements", placements, {(int64_t)count, 5});
        check_table("numbers", numbers.data(), count, 0, (int64_t)views.shape(0));
        if (std::max({views.shape(2), photo.shape(1), photo.shape(2)}) > 4096 || std::min(photo.shape(1), photo.shape(2)) < 1)
            throw std::invalid_argument("views and photo must have 1 to 4096 pixels a side");
        for (size_t i = 0; i < placements.size(); ++i)
            if (!(std::abs(placements.data()[i]) < 1e5f))
                throw std::invalid_argument("placements must be finite, within 100000");
        const auto scores = make<double>({count});
        const nb::gil_scoped_release released;
        ViewPhoto seen{photo.data(), (int)photo.shape(1), (int)photo.shape(2), 0};
        for (size_t i = 3 * photo.size() / 4; i < photo.size(); ++i)
            seen.total_seen += photo.data()[i];
        const Views all{views.data(), (int)views.shape(0), (int)views.shape(2)};
        share_out(count, threads, [&](size_t n) {
            const float* const p = placements.data() + 5 * n;
            scores.data()[n] = score_view(all, seen, {numbers.data()[n], p[0], p[1], p[2], p[3], p[4]}, outline, unseen);
        });
        return scores;
    }, "views"_a, "photo"_a, "numbers"_a, "placements"_a, "outline"_a, "unseen"_a, "threads"_a);
}

}  // namespace vig
