// Small pictures of an object from many sides, compared with a photo.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace vig {

// Pictures (count, 7, size, size): covered share, linear RGB, normal in the camera's frame.
struct Views {
    static constexpr int PLANES = 7;
    const float* planes;
    int count, size;
};

// A photo (4, height, width): linear RGB, and how far a pixel is the object's; and the sum of the latter.
struct ViewPhoto {
    const float* planes;
    int height, width;
    double total_seen;
};

// A view turned by an angle and magnified by `scale` (cos and sin are times it), its middle at (x, y).
struct PlacedView {
    int view;
    float cos, sin, x, y, scale;
};

// How well a placed view explains the photo: log errors of the colours under the gain and the light that suit best, and the
// outlines' overlap, weighted by `outline`; pixels that the view covers and that are not the object's count `unseen`.
double score_view(const Views& views, const ViewPhoto& photo, const PlacedView& placed, float outline, float unseen);

}  // namespace vig
