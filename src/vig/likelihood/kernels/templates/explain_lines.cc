// Eq. 3 over the lines of an image that one thread takes, and its way back to the faces' corners.
// LANES covered pixels are taken at a time, side by side in vector registers on a processor; only the sums
// at the corners are formed one by one. `explained` and `pull_pixel` are the same for one pixel.
// Arguments and their types: `explain_lines` in interior.py.
const int width = view.width, size = photos.observed.shape.dims[1], which = photos.photo.data[image];
const size_t first_vertex = (size_t)image * vertices.screen.shape.dims[1], first_pixel = (size_t)which * size * 3;
const real* const points = (const real*)vertices.screen.data + first_vertex * 3;
const real* const lights = (const real*)vertices.irradiances.data + first_vertex;
const int* const corners = (const int*)mesh.faces.data;
const wp::int64* const key = (const wp::int64*)keys.data + (size_t)image * keys.shape.dims[1];
const real* const colours = (const real*)photos.observed.data + first_pixel;
const real* const priors = (const real*)photos.log_prior.data + first_pixel;
real* const pulled = (real*)cotangents.on_corner.data + first_vertex * 4;
real* const shown = (real*)pictures.posterior.data + (size_t)image * size;
const real* const albedo = (const real*)photos.albedo.data + (size_t)image * 3;
const real red = albedo[0], green = albedo[1], blue = albedo[2], sigma = ((const real*)photos.sigma.data)[image];
const real half_precision = real(0.5) / (sigma * sigma);
const real normaliser = -3 * wp::log(sigma) - LOG_UNIT;
real total[LANES] = {}, painted_r[LANES] = {}, painted_g[LANES] = {}, painted_b[LANES] = {};
const int end = (part + 1) * chunk * width < size ? (part + 1) * chunk * width : size;
int next = part * chunk * width;
while (true) {
    int pixel[LANES], face[LANES];
    int count = 0;
    // Compaction: only covered pixels take part, so that no lane computes background.
    for (; next < end && count < LANES; ++next) {
        pixel[count] = next;
        face[count] = (int)(key[next] & FACE_MASK);
        count += key[next] != NOTHING;
    }
    if (count == 0)
        break;
    // Lanes that are left over repeat the first pixel, and are not counted below.
    for (int lane = count; lane < LANES; ++lane) {
        pixel[lane] = pixel[0];
        face[lane] = face[0];
    }
    int i[LANES], j[LANES], k[LANES];
    real ax[LANES], ay[LANES], aq[LANES], bx[LANES], by[LANES], bq[LANES];
    real cx[LANES], cy[LANES], cq[LANES];
    real light_a[LANES], light_b[LANES], light_c[LANES];
    real c_r[LANES], c_g[LANES], c_b[LANES], log_seen[LANES], log_hidden[LANES], log_else[LANES];
    for (int lane = 0; lane < LANES; ++lane) {
        i[lane] = corners[3 * face[lane]];
        j[lane] = corners[3 * face[lane] + 1];
        k[lane] = corners[3 * face[lane] + 2];
    }
    for (int lane = 0; lane < LANES; ++lane) {
        ax[lane] = points[3 * i[lane]];
        ay[lane] = points[3 * i[lane] + 1];
        aq[lane] = points[3 * i[lane] + 2];
        bx[lane] = points[3 * j[lane]];
        by[lane] = points[3 * j[lane] + 1];
        bq[lane] = points[3 * j[lane] + 2];
        cx[lane] = points[3 * k[lane]];
        cy[lane] = points[3 * k[lane] + 1];
        cq[lane] = points[3 * k[lane] + 2];
        light_a[lane] = lights[i[lane]];
        light_b[lane] = lights[j[lane]];
        light_c[lane] = lights[k[lane]];
        c_r[lane] = colours[3 * pixel[lane]];
        c_g[lane] = colours[3 * pixel[lane] + 1];
        c_b[lane] = colours[3 * pixel[lane] + 2];
        log_seen[lane] = priors[3 * pixel[lane]];
        log_hidden[lane] = priors[3 * pixel[lane] + 1];
        log_else[lane] = priors[3 * pixel[lane] + 2];
    }
    real weight_b[LANES], weight_c[LANES], pull_x[LANES], pull_y[LANES], lit[LANES], depth[LANES];
    real visible[LANES], irr[LANES];
    for (int lane = 0; lane < LANES; ++lane) {
        const int y = pixel[lane] / width;
        const real off_x = pixel[lane] - y * width + real(0.5) - ax[lane];
        const real off_y = y + real(0.5) - ay[lane];
        const real b_x = bx[lane] - ax[lane], b_y = by[lane] - ay[lane];
        const real c_x = cx[lane] - ax[lane], c_y = cy[lane] - ay[lane];
        // Barycentric weights b and c of the second and third corner at the pixel's centre.
        const real inverse = 1 / (b_x * c_y - b_y * c_x);
        const real b = (c_y * off_x - c_x * off_y) * inverse;
        const real c = (b_x * off_y - b_y * off_x) * inverse;
        const real q_b = bq[lane] - aq[lane], q_c = cq[lane] - aq[lane];
        // Perspective-correct irradiance: (q times irradiance) / q.
        const real lit_a = aq[lane] * light_a[lane];
        const real lit_b = bq[lane] * light_b[lane] - lit_a, lit_c = cq[lane] * light_c[lane] - lit_a;
        const real per_q = 1 / (aq[lane] + b * q_b + c * q_c);
        const real seen = (lit_a + b * lit_b + c * lit_c) * per_q;
        const real error_r = c_r[lane] - red * seen;
        const real error_g = c_g[lane] - green * seen;
        const real error_b = c_b[lane] - blue * seen;
        const real square = error_r * error_r + error_g * error_g + error_b * error_b;
        // Eq. 3: log(p(visible) N(error) + p(hidden) u), as log-odds `gap` and the larger term.
        const real inlier = log_seen[lane] + normaliser + LOG_DENSITY(square * half_precision);
        const real gap = inlier - log_hidden[lane];
        const real far = gap < 0 ? -gap : gap;
        const real t = far < FARTHEST ? far : FARTHEST;
        // r = exp(-t) for t >= 0 and log(1 + r). In single precision by polynomials, whose loops become
        // vector instructions.
        real r, log_1_r;
        if (SINGLE) {
            // exp(-t) = 2^whole 2^f: 2^f by its Taylor series, 2^whole by the exponent's bits.
            const real e = t * real(-1.44269504088896341);
            const int whole = (int)(e - real(0.5));
            const real f = (e - whole) * real(0.693147180559945309);
            const real p = 1 + f * (1 + f * (real(0.5) + f * (real(0.16666667) + f * (real(0.04166666)
                + f * (real(0.00833333) + f * real(0.00138889))))));
            union { int bits; float value; } power;
            power.bits = (whole + 127) << 23;
            r = p * power.value;
            // log(1 + r) = 2 artanh(r / (2 + r)).
            const real s = r / (2 + r), s2 = s * s;
            log_1_r = 2 * s * (1 + s2 * (real(0.33333333) + s2 * (real(0.2)
                + s2 * (real(0.14285714) + s2 * (real(0.11111111) + s2 * (real(0.09090909)
                + s2 * real(0.07692308)))))));
        } else {
            r = wp::exp(-t);
            log_1_r = wp::log(1 + r);
        }
        const real most = 1 / (1 + r);
        const real share = gap < 0 ? r * most : most;
        // The value is the gain over background, whose sum over all pixels is a constant of the photo.
        const bool counted = lane < count;
        total[lane] += counted ? (gap < 0 ? log_hidden[lane] : inlier) + log_1_r - log_else[lane] : 0;
        const bool weighs = counted & (share > NEGLIGIBLE);
        // d log-likelihood / d colour = weight times error.
        const real weight = weighs ? 2 * half_precision * share * PULL(square * half_precision) : 0;
        painted_r[lane] += weight * error_r * seen;
        painted_g[lane] += weight * error_g * seen;
        painted_b[lane] += weight * error_b * seen;
        lit[lane] = weight * (red * error_r + green * error_g + blue * error_b) * per_q;
        depth[lane] = -lit[lane] * seen;
        // Corners' places enter through the weights b and c alone.
        const real along_b = lit[lane] * lit_b + depth[lane] * q_b;
        const real along_c = lit[lane] * lit_c + depth[lane] * q_c;
        pull_x[lane] = (b_y * along_c - c_y * along_b) * inverse;
        pull_y[lane] = (c_x * along_b - b_x * along_c) * inverse;
        weight_b[lane] = b;
        weight_c[lane] = c;
        visible[lane] = share;
        irr[lane] = seen;
    }
    if (differentiate) {
        for (int lane = 0; lane < count; ++lane) {
            shown[pixel[lane]] = visible[lane];
            if (lit[lane] == 0)
                continue;
            const int corner[3] = {i[lane], j[lane], k[lane]};
            const real share[3] = {1 - weight_b[lane] - weight_c[lane], weight_b[lane], weight_c[lane]};
            const real light[3] = {light_a[lane], light_b[lane], light_c[lane]};
            const real q[3] = {aq[lane], bq[lane], cq[lane]};
            for (int n = 0; n < 3; ++n) {
                real* const on = pulled + 4 * corner[n];
                wp::atomic_add(on, share[n] * pull_x[lane]);
                wp::atomic_add(on + 1, share[n] * pull_y[lane]);
                wp::atomic_add(on + 2, share[n] * (light[n] * lit[lane] + depth[lane]));
                wp::atomic_add(on + 3, share[n] * q[n] * lit[lane]);
            }
        }
    }
    if (images) {
        for (int lane = 0; lane < count; ++lane) {
            const size_t at = (size_t)image * size + pixel[lane];
            ((real*)pictures.posterior.data)[at] = visible[lane];
            ((real*)pictures.coverage.data)[at] = 1;
            ((real*)pictures.irradiance.data)[at] = irr[lane];
        }
    }
}
real sums[4] = {};
for (int lane = 0; lane < LANES; ++lane) {
    sums[0] += total[lane];
    sums[1] += painted_r[lane];
    sums[2] += painted_g[lane];
    sums[3] += painted_b[lane];
}
wp::index(totals.values, image, part) = sums[0];
wp::index(totals.on_albedo, image, part) = wp::vec_t<3, real>(sums[1], sums[2], sums[3]);
