// Shared by both rasterisers, in a function that knows `real`, and `width` and `height` of the image:
// the pixels whose centres lie in a triangle's bounding box, columns x0 to x1 and rows y0 to y1, and whether
// there are any. (ax, ay) is a corner; the others are (bx, by) and (cx, cy) from it. NaN gives no pixels.
auto pixel_box = [&](real ax, real ay, real bx, real by, real cx, real cy, int& x0, int& x1, int& y0,
                     int& y1) {
    real low_x = bx < cx ? bx : cx, low_y = by < cy ? by : cy;
    real high_x = bx > cx ? bx : cx, high_y = by > cy ? by : cy;
    low_x = ax + (low_x < 0 ? low_x : 0) - real(0.5);
    low_y = ay + (low_y < 0 ? low_y : 0) - real(0.5);
    high_x = ax + (high_x > 0 ? high_x : 0) - real(0.5);
    high_y = ay + (high_y > 0 ? high_y : 0) - real(0.5);
    low_x = low_x > 0 ? low_x : 0;
    low_y = low_y > 0 ? low_y : 0;
    high_x = high_x < width - 1 ? high_x : width - 1;
    high_y = high_y < height - 1 ? high_y : height - 1;
    const int within = (high_x >= low_x) & (high_y >= low_y);
    // All are within the image, so that truncation rounds down; one more where it lost a part.
    x0 = within ? (int)low_x : 0;
    y0 = within ? (int)low_y : 0;
    x1 = within ? (int)high_x : -1;
    y1 = within ? (int)high_y : -1;
    x0 += (real)x0 < low_x;
    y0 += (real)y0 < low_y;
    return (x1 >= x0) & (y1 >= y0) & within;
};
