"""Kernels of Eq. 4 inside the silhouette: value and cotangents, and rows of the normal matrix."""

import functools
import math
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from vig.likelihood.kernels.functions import likelihood_functions
from vig.likelihood.kernels.vertices import module_name
from vig.renderer.raster import FACE_MASK, NOTHING

NEGLIGIBLE = 1e-9
"""Posterior of being visible below which a pixel moves nothing: most of what is hidden."""


@functools.cache
def interior_kernels(dtype: torch.dtype, modes: int) -> SimpleNamespace:
    """The kernels for one scalar type and number of shape components, compiled at first use."""
    f = likelihood_functions(dtype, modes)
    real, vec2, vec3, vec4, mat33 = f.real, f.vec2, f.vec3, f.vec4, f.mat33
    shape_row, rest_row = f.shape_row, f.rest_row
    eye_of, camera_cotangent, surface_of, seen_at = f.eye_of, f.camera_cotangent, f.surface_of, f.seen_at
    moved, face_mask, negligible = f.moved, wp.int64(FACE_MASK), real(NEGLIGIBLE)
    explain_lines = _explain_lines(real, vec3, vec4)
    module = module_name("interior", dtype, modes)

    @wp.kernel(module=module)
    def interior(
        screen: wp.array2d(dtype=vec3),
        irradiances: wp.array2d(dtype=real),
        faces: wp.array2d(dtype=wp.int32),
        width: wp.int32,
        chunk: wp.int32,
        albedo: wp.array(dtype=vec3),
        keys: wp.array2d(dtype=wp.int64),
        observed: wp.array2d(dtype=vec3),
        log_prior: wp.array2d(dtype=vec3),
        photo: wp.array(dtype=wp.int32),
        sigma: wp.array(dtype=real),
        differentiate: wp.int32,
        images: wp.int32,
        values: wp.array2d(dtype=real),
        on_albedo: wp.array2d(dtype=vec3),
        on_corner: wp.array2d(dtype=vec4),
        posterior: wp.array2d(dtype=real),
        coverage: wp.array2d(dtype=real),
        irradiance: wp.array2d(dtype=real),
    ):
        """A chunk of an image's lines. values: what its covered pixels gain over background."""
        image, part = wp.tid()
        explain_lines(
            image,
            part,
            chunk,
            screen,
            irradiances,
            faces,
            width,
            albedo[image],
            keys,
            observed,
            log_prior,
            photo[image],
            sigma[image],
            differentiate,
            images,
            values,
            on_albedo,
            on_corner,
            posterior,
            coverage,
            irradiance,
        )

    @wp.kernel(module=module)
    def interior_rows(
        screen: wp.array2d(dtype=vec3),
        irradiances: wp.array2d(dtype=real),
        shape_rows: wp.array2d(dtype=shape_row),
        rest_rows: wp.array2d(dtype=rest_row),
        basis: wp.array2d(dtype=shape_row),
        faces: wp.array2d(dtype=wp.int32),
        width: wp.int32,
        stride: wp.int32,
        rotation: wp.array(dtype=mat33),
        intrinsics: wp.array(dtype=vec3),
        distance: real,
        keys: wp.array2d(dtype=wp.int64),
        sigma: wp.array(dtype=real),
        posterior: wp.array2d(dtype=real),
        row_count: wp.array(dtype=wp.int32),
        normal_shape: wp.array2d(dtype=shape_row),
        normal_rest: wp.array2d(dtype=rest_row),
    ):
        """Every `stride`th pixel of every `stride`th line stands for its square of them in the normal matrix:
        a row of irradiance, scaled by the root of its weight."""
        image, line = wp.tid()
        y = line * stride
        eye = eye_of(rotation[image], distance, intrinsics[image], width)
        back = wp.transpose(eye.rotation)
        per_row = real(stride) / sigma[image]
        for column in range((width + stride - 1) / stride):
            x = column * stride
            at = y * width + x
            key = keys[image, at]
            visible = real(0.0)
            if key != wp.int64(NOTHING):
                visible = posterior[image, at]
            if visible > negligible:
                slot = wp.atomic_add(row_count, image, 1)
                surface = surface_of(image, int(key & face_mask), faces, screen, irradiances)
                pixel = vec2(real(x) + real(0.5), real(y) + real(0.5))
                seen = seen_at(surface, pixel)
                off = pixel - surface.origin
                size = per_row * wp.sqrt(visible)
                inverse = size / seen[1]
                v = wp.dot(surface.by_second, off) * screen[image, surface.j][2] * inverse
                w = wp.dot(surface.by_third, off) * screen[image, surface.k][2] * inverse
                u = size - v - w
                slide = (surface.slope * seen[0] - surface.lit_slope) * inverse
                spot = vec3(pixel[0], pixel[1], seen[1])
                on_spot = vec3(slide[0], slide[1], real(0.0))
                cotangent = (back * camera_cotangent(eye, spot, on_spot)) / size
                normal_rest[image, slot] = moved(
                    rest_rows[image, surface.i] * u
                    + rest_rows[image, surface.j] * v
                    + rest_rows[image, surface.k] * w,
                    eye,
                    on_spot,
                    spot,
                )
                a = cotangent * u
                b = cotangent * v
                c = cotangent * w
                normal_shape[image, slot] = (
                    shape_rows[image, surface.i] * u
                    + shape_rows[image, surface.j] * v
                    + shape_rows[image, surface.k] * w
                    + basis[surface.i, 0] * a[0]
                    + basis[surface.i, 1] * a[1]
                    + basis[surface.i, 2] * a[2]
                    + basis[surface.j, 0] * b[0]
                    + basis[surface.j, 1] * b[1]
                    + basis[surface.j, 2] * b[2]
                    + basis[surface.k, 0] * c[0]
                    + basis[surface.k, 1] * c[1]
                    + basis[surface.k, 2] * c[2]
                )

    return SimpleNamespace(interior=interior, interior_rows=interior_rows, **vars(f))


def _explain_lines(real: type, vec3: type, vec4: type) -> Any:
    """Eq. 3 over lines of pixels and its way back to the faces' corners, in C++ for the sake of its speed.

    16 covered pixels are taken at a time, side by side in vector registers on a processor; only the sums at
    the corners are formed one by one. `explained` and `pull_pixel` say the same for one pixel.
    """
    single = real is wp.float32
    # exp(-t) for t >= 0 and log(1 + r) for r in [0, 1]: by polynomials in single precision, whose loops
    # become vector instructions.
    decay = """
            const real e = t * real(-1.44269504088896341);
            const int whole = (int)(e - real(0.5));
            const real f = (e - whole) * real(0.693147180559945309);
            const real p = 1 + f * (1 + f * (real(0.5) + f * (real(0.16666667) + f * (real(0.04166666)
                + f * (real(0.00833333) + f * real(0.00138889))))));
            union { int bits; float value; } power;
            power.bits = (whole + 127) << 23;
            const real r = p * power.value;
            const real s = r / (2 + r), s2 = s * s;
            const real log_1_r = 2 * s * (1 + s2 * (real(0.33333333) + s2 * (real(0.2)
                + s2 * (real(0.14285714) + s2 * (real(0.11111111) + s2 * (real(0.09090909)
                + s2 * real(0.07692308)))))));
    """
    plain = """
            const real r = wp::exp(-t);
            const real log_1_r = wp::log(1 + r);
    """
    snippet = f"""
    constexpr int LANES = 16;
    typedef {"float" if single else "double"} real;
    const real* const points = (const real*)screen.data + (size_t)image * screen.shape.dims[1] * 3;
    const real* const lights = (const real*)irradiances.data + (size_t)image * irradiances.shape.dims[1];
    const int* const corners = (const int*)faces.data;
    const int size = observed.shape.dims[1];
    const wp::int64* const key = (const wp::int64*)keys.data + (size_t)image * keys.shape.dims[1];
    const real* const photos = (const real*)observed.data + (size_t)photo * size * 3;
    const real* const priors = (const real*)log_prior.data + (size_t)photo * size * 3;
    real* const pulled = (real*)on_corner.data + (size_t)image * on_corner.shape.dims[1] * 4;
    real* const shown = (real*)posterior.data + (size_t)image * posterior.shape.dims[1];
    const real red = albedo[0], green = albedo[1], blue = albedo[2];
    const real half_precision = real(0.5) / (sigma * sigma);
    const real normaliser = -3 * wp::log(sigma) - real({3 * math.log(math.sqrt(2 * math.pi))!r});
    real total[LANES] = {{}}, painted_r[LANES] = {{}}, painted_g[LANES] = {{}}, painted_b[LANES] = {{}};
    const int end = (part + 1) * chunk * width < size ? (part + 1) * chunk * width : size;
    int next = part * chunk * width;
    while (true) {{
        int pixel[LANES], face[LANES];
        int count = 0;
        for (; next < end && count < LANES; ++next) {{
            pixel[count] = next;
            face[count] = (int)(key[next] & {FACE_MASK});
            count += key[next] != wp::int64({NOTHING});
        }}
        if (count == 0)
            break;
        for (int lane = count; lane < LANES; ++lane) {{
            pixel[lane] = pixel[0];
            face[lane] = face[0];
        }}
        int i[LANES], j[LANES], k[LANES];
        real ax[LANES], ay[LANES], aq[LANES], bx[LANES], by[LANES], bq[LANES];
        real cx[LANES], cy[LANES], cq[LANES];
        real light_a[LANES], light_b[LANES], light_c[LANES];
        real c_r[LANES], c_g[LANES], c_b[LANES], log_seen[LANES], log_hidden[LANES], log_else[LANES];
        for (int lane = 0; lane < LANES; ++lane) {{
            i[lane] = corners[3 * face[lane]];
            j[lane] = corners[3 * face[lane] + 1];
            k[lane] = corners[3 * face[lane] + 2];
        }}
        for (int lane = 0; lane < LANES; ++lane) {{
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
            c_r[lane] = photos[3 * pixel[lane]];
            c_g[lane] = photos[3 * pixel[lane] + 1];
            c_b[lane] = photos[3 * pixel[lane] + 2];
            log_seen[lane] = priors[3 * pixel[lane]];
            log_hidden[lane] = priors[3 * pixel[lane] + 1];
            log_else[lane] = priors[3 * pixel[lane] + 2];
        }}
        real weight_b[LANES], weight_c[LANES], pull_x[LANES], pull_y[LANES], lit[LANES], depth[LANES];
        real visible[LANES], irr[LANES];
        for (int lane = 0; lane < LANES; ++lane) {{
            const int y = pixel[lane] / width;
            const real off_x = pixel[lane] - y * width + real(0.5) - ax[lane];
            const real off_y = y + real(0.5) - ay[lane];
            const real b_x = bx[lane] - ax[lane], b_y = by[lane] - ay[lane];
            const real c_x = cx[lane] - ax[lane], c_y = cy[lane] - ay[lane];
            const real inverse = 1 / (b_x * c_y - b_y * c_x);
            const real b = (c_y * off_x - c_x * off_y) * inverse;
            const real c = (b_x * off_y - b_y * off_x) * inverse;
            const real q_b = bq[lane] - aq[lane], q_c = cq[lane] - aq[lane];
            const real lit_a = aq[lane] * light_a[lane];
            const real lit_b = bq[lane] * light_b[lane] - lit_a, lit_c = cq[lane] * light_c[lane] - lit_a;
            const real per_q = 1 / (aq[lane] + b * q_b + c * q_c);
            const real seen = (lit_a + b * lit_b + c * lit_c) * per_q;
            const real error_r = c_r[lane] - red * seen;
            const real error_g = c_g[lane] - green * seen;
            const real error_b = c_b[lane] - blue * seen;
            const real square = error_r * error_r + error_g * error_g + error_b * error_b;
            const real inlier = log_seen[lane] + normaliser - square * half_precision;
            const real gap = inlier - log_hidden[lane];
            const real far = gap < 0 ? -gap : gap;
            const real t = far < 80 ? far : 80;
            {decay if single else plain}
            const real most = 1 / (1 + r);
            const real share = gap < 0 ? r * most : most;
            const bool counted = lane < count;
            total[lane] += counted ? (gap < 0 ? log_hidden[lane] : inlier) + log_1_r - log_else[lane] : 0;
            const bool weighs = counted & (share > real({NEGLIGIBLE}));
            const real weight = weighs ? 2 * half_precision * share : 0;
            painted_r[lane] += weight * error_r * seen;
            painted_g[lane] += weight * error_g * seen;
            painted_b[lane] += weight * error_b * seen;
            lit[lane] = weight * (red * error_r + green * error_g + blue * error_b) * per_q;
            depth[lane] = -lit[lane] * seen;
            const real along_b = lit[lane] * lit_b + depth[lane] * q_b;
            const real along_c = lit[lane] * lit_c + depth[lane] * q_c;
            pull_x[lane] = (b_y * along_c - c_y * along_b) * inverse;
            pull_y[lane] = (c_x * along_b - b_x * along_c) * inverse;
            weight_b[lane] = b;
            weight_c[lane] = c;
            visible[lane] = share;
            irr[lane] = seen;
        }}
        if (differentiate) {{
            for (int lane = 0; lane < count; ++lane) {{
                shown[pixel[lane]] = visible[lane];
                if (lit[lane] == 0)
                    continue;
                const int corner[3] = {{i[lane], j[lane], k[lane]}};
                const real share[3] = {{1 - weight_b[lane] - weight_c[lane], weight_b[lane], weight_c[lane]}};
                const real light[3] = {{light_a[lane], light_b[lane], light_c[lane]}};
                const real q[3] = {{aq[lane], bq[lane], cq[lane]}};
                for (int n = 0; n < 3; ++n) {{
                    real* const on = pulled + 4 * corner[n];
                    wp::atomic_add(on, share[n] * pull_x[lane]);
                    wp::atomic_add(on + 1, share[n] * pull_y[lane]);
                    wp::atomic_add(on + 2, share[n] * (light[n] * lit[lane] + depth[lane]));
                    wp::atomic_add(on + 3, share[n] * q[n] * lit[lane]);
                }}
            }}
        }}
        if (images) {{
            for (int lane = 0; lane < count; ++lane) {{
                const size_t at = (size_t)image * size + pixel[lane];
                ((real*)posterior.data)[at] = visible[lane];
                ((real*)coverage.data)[at] = 1;
                ((real*)irradiance.data)[at] = irr[lane];
            }}
        }}
    }}
    real sums[4] = {{}};
    for (int lane = 0; lane < LANES; ++lane) {{
        sums[0] += total[lane];
        sums[1] += painted_r[lane];
        sums[2] += painted_g[lane];
        sums[3] += painted_b[lane];
    }}
    wp::index(values, image, part) = sums[0];
    wp::index(on_albedo, image, part) = wp::vec_t<3, real>(sums[1], sums[2], sums[3]);
    """

    @wp.func_native(snippet=snippet)
    def explain_lines(
        image: wp.int32,
        part: wp.int32,
        chunk: wp.int32,
        screen: wp.array2d(dtype=vec3),
        irradiances: wp.array2d(dtype=real),
        faces: wp.array2d(dtype=wp.int32),
        width: wp.int32,
        albedo: vec3,
        keys: wp.array2d(dtype=wp.int64),
        observed: wp.array2d(dtype=vec3),
        log_prior: wp.array2d(dtype=vec3),
        photo: wp.int32,
        sigma: real,
        differentiate: wp.int32,
        images: wp.int32,
        values: wp.array2d(dtype=real),
        on_albedo: wp.array2d(dtype=vec3),
        on_corner: wp.array2d(dtype=vec4),
        posterior: wp.array2d(dtype=real),
        coverage: wp.array2d(dtype=real),
        irradiance: wp.array2d(dtype=real),
    ): ...

    return explain_lines
