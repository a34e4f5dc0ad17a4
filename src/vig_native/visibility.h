// Visibility: which triangle is seen at each pixel's centre.
#pragma once
#include <vector>

#include "vectors.h"

namespace vig {

constexpr int NO_FACE = -1;

// The surface at each pixel (H * W): the nearest face, or NO_FACE, and one over its depth there, or 0. LANES more follow
// the last pixel, as so many are drawn at a time. The first of faces at the same depth is seen.
template <class R> struct VisibilityBuffer {
    std::vector<int32_t> face;
    std::vector<R> q;
    void clear(int pixels) {
        face.assign(pixels + LANES, NO_FACE);
        q.assign(pixels + LANES, 0);
    }
};

// The pixels whose centres lie in a triangle's bounding box, and whether there are any.
struct PixelBox {
    int x0, x1, y0, y1;
    bool covers;
};

// (ax, ay) is a corner; the others are (bx, by) and (cx, cy) from it. NaN gives no pixels.
template <class R> inline PixelBox pixel_box(R ax, R ay, R bx, R by, R cx, R cy, int width, int height) {
    R low_x = bx < cx ? bx : cx, low_y = by < cy ? by : cy;
    R high_x = bx > cx ? bx : cx, high_y = by > cy ? by : cy;
    low_x = ax + (low_x < 0 ? low_x : 0) - R(0.5);
    low_y = ay + (low_y < 0 ? low_y : 0) - R(0.5);
    high_x = ax + (high_x > 0 ? high_x : 0) - R(0.5);
    high_y = ay + (high_y > 0 ? high_y : 0) - R(0.5);
    low_x = low_x > 0 ? low_x : 0;
    low_y = low_y > 0 ? low_y : 0;
    high_x = high_x < width - 1 ? high_x : width - 1;
    high_y = high_y < height - 1 ? high_y : height - 1;
    const int within = (high_x >= low_x) & (high_y >= low_y);
    PixelBox box;
    // All are within the image, so that truncation rounds down; one more where it lost a part.
    box.x0 = within ? (int)low_x : 0;
    box.y0 = within ? (int)low_y : 0;
    box.x1 = within ? (int)high_x : -1;
    box.y1 = within ? (int)high_y : -1;
    box.x0 += (R)box.x0 < low_x;
    box.y0 += (R)box.y0 < low_y;
    box.covers = (box.x1 >= box.x0) & (box.y1 >= box.y0) & within;
    return box;
}

// Draw faces (F, 3) of vertices on the screen (V, STRIDE), (x, y, q, ...), q = 0 at or behind the camera: such faces
// are not drawn; `facing` (F,): those turned to the camera. With `cull` only these are drawn.
template <class R, int STRIDE = 3>
void draw_faces(const R* screen, const int32_t* corners, int faces, int width, int height, bool cull,
                VisibilityBuffer<R>& seen, uint8_t* facing);

// Where a pixel's centre lies on a face of these: the perspective-correct weights of its corners, and its depth.
template <class R> struct Fragment {
    R weights[3], depth;
};
template <class R> Fragment<R> fragment_at(const R* screen, const int32_t* corners, int face, int x, int y);

}  // namespace vig
