"""Kernels of `primitives/texture.py`: the look-up, its backward and its forward derivative."""

import math

import warp as wp

half = real(0.5)
one = real(1.0)
smallest = real(1e-12)
per_octave = real(0.5 / math.log(2.0))


@wp.struct
class Quad:
    """Four neighbouring texels and the place between them."""

    i00: wp.int32
    i01: wp.int32
    i10: wp.int32
    i11: wp.int32
    fx: real
    fy: real
    width: real
    height: real


@wp.func
def wrapped(i: int, count: int):
    r = i % count
    if r < 0:
        r = r + count
    return r


@wp.func
def quad_at(levels: wp.array2d(dtype=wp.int32), level: int, uv: vec2):
    q = Quad()
    start = levels[level, 0]
    height = levels[level, 1]
    width = levels[level, 2]
    q.width = real(width)
    q.height = real(height)
    # Whole turns of the texture are dropped first: large uv must not overflow.
    x = (uv[0] - wp.floor(uv[0])) * q.width - half
    y = (one - (uv[1] - wp.floor(uv[1]))) * q.height - half
    left = wp.floor(x)
    top = wp.floor(y)
    q.fx = x - left
    q.fy = y - top
    x0 = wrapped(int(left), width)
    x1 = wrapped(int(left) + 1, width)
    y0 = wrapped(int(top), height)
    y1 = wrapped(int(top) + 1, height)
    q.i00 = start + y0 * width + x0
    q.i01 = start + y0 * width + x1
    q.i10 = start + y1 * width + x0
    q.i11 = start + y1 * width + x1
    return q


@wp.func
def bilinear(texels: wp.array2d(dtype=real), q: Quad, c: int):
    upper = texels[q.i00, c] * (one - q.fx) + texels[q.i01, c] * q.fx
    lower = texels[q.i10, c] * (one - q.fx) + texels[q.i11, c] * q.fx
    return upper * (one - q.fy) + lower * q.fy


@wp.func
def slope(texels: wp.array2d(dtype=real), q: Quad, c: int):
    """Derivative of the bilinear value by u and v (v runs up, rows run down)."""
    along_x = (texels[q.i01, c] - texels[q.i00, c]) * (one - q.fy) + (
        texels[q.i11, c] - texels[q.i10, c]
    ) * q.fy
    along_y = (texels[q.i10, c] - texels[q.i00, c]) * (one - q.fx) + (
        texels[q.i11, c] - texels[q.i01, c]
    ) * q.fx
    return vec2(along_x * q.width, -along_y * q.height)


@wp.func
def scatter(result: wp.array2d(dtype=real), q: Quad, c: int, cotangent: real):
    wp.atomic_add(result, q.i00, c, cotangent * (one - q.fx) * (one - q.fy))
    wp.atomic_add(result, q.i01, c, cotangent * q.fx * (one - q.fy))
    wp.atomic_add(result, q.i10, c, cotangent * (one - q.fx) * q.fy)
    wp.atomic_add(result, q.i11, c, cotangent * q.fx * q.fy)


@wp.struct
class Detail:
    """The two levels used, the share of the coarser, and that share's derivative by the footprint."""

    fine: wp.int32
    coarse: wp.int32
    share: real
    rate: vec4


@wp.func
def detail_of(levels: wp.array2d(dtype=wp.int32), begin: int, end: int, footprint: vec4):
    d = Detail()
    d.fine = begin
    d.coarse = begin
    width = real(levels[begin, 2])
    height = real(levels[begin, 1])
    scale = vec4(width * width, height * height, width * width, height * height)
    # footprint: how (u, v) change to the next pixel in x and in y.
    weighted = wp.cw_mul(scale, footprint)
    # Mean square size of the pixel in texels; half its logarithm is the level.
    square = half * wp.dot(weighted, footprint)
    level = per_octave * wp.log(wp.max(square, smallest))
    if level <= real(0.0):
        return d
    if level >= real(end - begin - 1):
        d.fine = end - 1
        d.coarse = end - 1
        return d
    d.fine = begin + int(wp.floor(level))
    d.coarse = d.fine + 1
    # Trilinear: the two nearest levels, blended (Williams 1983).
    d.share = level - wp.floor(level)
    d.rate = weighted * (per_octave / square)
    return d


@wp.kernel(module=module)
def forward(
    texels: wp.array2d(dtype=real),
    levels: wp.array2d(dtype=wp.int32),
    first: wp.array(dtype=wp.int32),
    texture: wp.array(dtype=wp.int32),
    uv: wp.array(dtype=vec2),
    footprint: wp.array(dtype=vec4),
    result: wp.array2d(dtype=real),
):
    row = wp.tid()
    which = texture[row]
    if which < 0:
        for c in range(texels.shape[1]):
            result[row, c] = one
        return
    d = detail_of(levels, first[which], first[which + 1], footprint[row])
    fine = quad_at(levels, d.fine, uv[row])
    coarse = quad_at(levels, d.coarse, uv[row])
    for c in range(texels.shape[1]):
        value = bilinear(texels, fine, c)
        if d.share > real(0.0):
            value = value + d.share * (bilinear(texels, coarse, c) - value)
        result[row, c] = value


@wp.kernel(module=module)
def backward(
    texels: wp.array2d(dtype=real),
    levels: wp.array2d(dtype=wp.int32),
    first: wp.array(dtype=wp.int32),
    texture: wp.array(dtype=wp.int32),
    uv: wp.array(dtype=vec2),
    footprint: wp.array(dtype=vec4),
    cotangents: wp.array2d(dtype=real),
    on_texels: wp.array2d(dtype=real),
    on_uv: wp.array(dtype=vec2),
    on_footprint: wp.array(dtype=vec4),
):
    row = wp.tid()
    which = texture[row]
    if which < 0:
        return
    d = detail_of(levels, first[which], first[which + 1], footprint[row])
    fine = quad_at(levels, d.fine, uv[row])
    coarse = quad_at(levels, d.coarse, uv[row])
    by_uv = vec2()
    by_share = real(0.0)
    for c in range(texels.shape[1]):
        g = cotangents[row, c]
        scatter(on_texels, fine, c, g * (one - d.share))
        by_uv = by_uv + slope(texels, fine, c) * (g * (one - d.share))
        if d.coarse != d.fine:
            scatter(on_texels, coarse, c, g * d.share)
            by_uv = by_uv + slope(texels, coarse, c) * (g * d.share)
            by_share = by_share + g * (bilinear(texels, coarse, c) - bilinear(texels, fine, c))
    on_uv[row] = by_uv
    on_footprint[row] = d.rate * by_share


@wp.kernel(module=module)
def tangent(
    texels: wp.array2d(dtype=real),
    levels: wp.array2d(dtype=wp.int32),
    first: wp.array(dtype=wp.int32),
    texture: wp.array(dtype=wp.int32),
    uv: wp.array(dtype=vec2),
    footprint: wp.array(dtype=vec4),
    uv_moved: wp.array(dtype=vec2),
    footprint_moved: wp.array(dtype=vec4),
    result: wp.array2d(dtype=real),
):
    row = wp.tid()
    which = texture[row]
    if which < 0:
        for c in range(texels.shape[1]):
            result[row, c] = real(0.0)
        return
    d = detail_of(levels, first[which], first[which + 1], footprint[row])
    fine = quad_at(levels, d.fine, uv[row])
    coarse = quad_at(levels, d.coarse, uv[row])
    # The level of detail depends on the footprint, hence on the pose: its derivative counts.
    share_moved = wp.dot(d.rate, footprint_moved[row])
    for c in range(texels.shape[1]):
        value = wp.dot(slope(texels, fine, c), uv_moved[row]) * (one - d.share)
        if d.coarse != d.fine:
            value = value + wp.dot(slope(texels, coarse, c), uv_moved[row]) * d.share
            value = value + share_moved * (bilinear(texels, coarse, c) - bilinear(texels, fine, c))
        result[row, c] = value
