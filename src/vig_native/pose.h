// The pose of a textured mesh in a photo: how well one explains it, and a search near poses.
#pragma once
#include "vectors.h"
#include "visibility.h"

namespace vig {

constexpr float MIN_COLOUR = 0.02f;  // noise and haze of dark pixels

// A picture (height, width, 3) of linear RGB and its halves, one after the other.
struct Texture {
    struct Level {
        int width, height;
        size_t first;  // its first number among those of the mesh
    };
    std::vector<Level> levels;
};

// A mesh about its middle, metres. A face's colour is its texture's at uv, (0, 0) at the bottom left.
struct TexturedMesh {
    int vertices, faces;
    bool closed;  // then faces that look away are never seen
    std::vector<float> positions, normals, uv;      // (V, 3) twice, (F, 3, 2)
    std::vector<int32_t> corners, texture_of_face;  // (F, 3), (F,)
    std::vector<Texture> textures;
    std::vector<float> texels, octave;  // log(linear RGB + MIN_COLOUR) of all levels; (F,) log2 of the finest's texels per metre
};

struct RigidPose {
    Mat3<float> rotation;
    Vec3<float> translation;
};

// Weights of the parts of a pose's score; see `score_pose`.
struct PoseWeights {
    float sigma, share, gain_deviation, slope_deviation, pixels, outline, surroundings, unseen, box_deviation;
};

// A part of a photo, the object's box, and how far each of its pixels may show the object.
struct PosePhoto {
    int width, height;
    float focal, cx, cy;
    std::vector<float> log_colour, seen;  // (3, H * W) log(linear RGB + MIN_COLOUR); (H * W) from 0 to 1
    float total_seen;                     // sum of `seen`
    std::vector<float> surroundings;      // (H * W) log density of each log colour among the surroundings; or empty
    bool outlined;                        // whether `seen` is all of the object that is not hidden
    bool boxed;
    float box[4];                         // left, right, top, bottom
    float metres_per_pixel;               // about, which chooses the textures' levels
    PoseWeights weights;
};

constexpr int SAMPLES = 2;             // of each pixel, across and down

// A surface at a pixel of a pose: the covered share, log colour, normal in the camera's frame.
struct PosePixel {
    int place;
    float coverage;
    Vec3<float> log_colour, normal;
};

// Memory that evaluations of one thread share.
struct PoseScratch {
    std::vector<float> screen, rows;
    std::vector<uint8_t> facing;
    VisibilityBuffer<float> seen;
    std::vector<PosePixel> pixels;
};

// Draw a pose: the pixels that it covers, in order, and its bounds left, right, top, bottom; false behind the camera.
bool draw_pose(const TexturedMesh& mesh, const PosePhoto& photo, const RigidPose& pose, PoseScratch& scratch, float* bounds);

// The score of a pose: mean log-likelihood of seen pixels that it covers, under a gain of each channel and a light from one
// side (`light`, 6 numbers in log colour), robust to others; outline's overlap; distance from the box. Where the surroundings
// are known, in place of the mean: the sum of the log-likelihood beyond theirs. `inlier` (H * W) receives the probability
// that a pixel shows the surface.
double score_pose(const TexturedMesh& mesh, const PosePhoto& photo, const RigidPose& pose, PoseScratch& scratch,
                  double* light = nullptr, float* inlier = nullptr);

// The best pose that the simplex search of Nelder and Mead (1965) finds within some evaluations, from simplices of `steps`:
// radians, shares of the distance across and away.
double refine_pose(const TexturedMesh& mesh, const PosePhoto& photo, RigidPose& pose, int evaluations, const float* steps,
                   PoseScratch& scratch);

}  // namespace vig
