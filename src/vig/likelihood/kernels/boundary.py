"""Kernels of Eq. 4 at occlusion edges: analytic coverage, its cotangents, and rows of the edge's motion.

Between two neighbouring pixels an occlusion edge may pass, at a share t of the way from one centre to the
other. The nearer pixel is then partly the other's surface: by |t - 1/2|, which is its analytic coverage
along that direction. Log-likelihoods (not colours) are blended by it, so the objective is continuous and
differentiable in the edge's place (docs/objective.md says where it is not). An edge is seen both by rows and
by columns; the shares nx^2 and ny^2 of its screen normal, interpolated along the edge, weigh the two, so that
area is kept and nothing jumps where one edge hands over to the next.
"""

import functools
from types import SimpleNamespace

import torch
import warp as wp

from vig.likelihood.kernels.functions import likelihood_functions
from vig.likelihood.kernels.vertices import module_name
from vig.renderer.raster import FACE_MASK, NOTHING

BEHIND_EDGE = 0.002
"""Metres by which the surface beyond an occlusion edge must lie behind it."""

BEFORE_EDGE = 0.04
"""Metres by which the edge's own surface may come forward within a pixel."""


@functools.cache
def boundary_kernels(dtype: torch.dtype, modes: int) -> SimpleNamespace:
    """The kernels of the edges for one scalar type and number of shape components."""
    f = likelihood_functions(dtype, modes)
    real, vec2, vec3, vec4, mat33 = f.real, f.vec2, f.vec3, f.vec4, f.mat33
    shape_row, rest_row = f.shape_row, f.rest_row
    Surface = f.Surface
    eye_of, camera_cotangent, surface_of, seen_at = f.eye_of, f.camera_cotangent, f.surface_of, f.seen_at
    pull_pixel, moved, noise_of, explained = f.pull_pixel, f.moved, f.noise_of, f.explained
    behind_edge, before_edge, face_mask = real(BEHIND_EDGE), real(BEFORE_EDGE), wp.int64(FACE_MASK)
    module = module_name("boundary", dtype, modes)

    @wp.kernel(module=module)
    def collect_rims(
        edges: wp.array2d(dtype=wp.int32),
        chunk: wp.int32,
        facing: wp.array2d(dtype=wp.uint8),
        counts: wp.array(dtype=wp.int32),
        rims: wp.array2d(dtype=wp.int32),
    ):
        """List the edges between a face turned to the eye and one turned away, or none."""
        image, part = wp.tid()
        first = part * chunk
        for edge in range(first, wp.min(first + chunk, edges.shape[0])):
            beyond = edges[edge, 3]
            front_beyond = wp.uint8(0)
            if beyond >= 0:
                front_beyond = facing[image, beyond]
            if facing[image, edges[edge, 2]] != front_beyond:
                rims[image, wp.atomic_add(counts, image, 1)] = edge

    @wp.func
    def along(axis: int, u: real, v: real):
        """(x, y) of what lies u along an axis and v across it."""
        if axis == 0:
            return vec3(u, v, real(0.0))
        return vec3(v, u, real(0.0))

    @wp.kernel(module=module)
    def boundary(
        screen: wp.array2d(dtype=vec3),
        normals: wp.array2d(dtype=vec3),
        irradiances: wp.array2d(dtype=real),
        basis: wp.array2d(dtype=shape_row),
        faces: wp.array2d(dtype=wp.int32),
        edges: wp.array2d(dtype=wp.int32),
        facing: wp.array2d(dtype=wp.uint8),
        counts: wp.array(dtype=wp.int32),
        rims: wp.array2d(dtype=wp.int32),
        threads: wp.int32,
        width: wp.int32,
        height: wp.int32,
        rotation: wp.array(dtype=mat33),
        intrinsics: wp.array(dtype=vec3),
        distance: real,
        albedo: wp.array(dtype=vec3),
        keys: wp.array2d(dtype=wp.int64),
        observed: wp.array2d(dtype=vec3),
        log_prior: wp.array2d(dtype=vec3),
        photo: wp.array(dtype=wp.int32),
        sigma: wp.array(dtype=real),
        curvature: real,
        differentiate: wp.int32,
        images: wp.int32,
        values: wp.array2d(dtype=real),
        on_albedo: wp.array2d(dtype=vec3),
        on_corner: wp.array2d(dtype=vec4),
        on_normal: wp.array2d(dtype=vec3),
        row_count: wp.array(dtype=wp.int32),
        normal_shape: wp.array2d(dtype=shape_row),
        normal_rest: wp.array2d(dtype=rest_row),
        coverage: wp.array2d(dtype=real),
    ):
        """Every `threads`th rim of an image: what blending across it adds to Eq. 4, the way back with
        differentiate >= 1, rows of the normal matrix with 2."""
        image, part = wp.tid()
        eye = eye_of(rotation[image], distance, intrinsics[image], width)
        back = wp.transpose(eye.rotation)
        noise = noise_of(sigma[image])
        precision = real(2.0) * noise.half_precision
        colour = albedo[image]
        brightness = wp.max(wp.dot(colour, colour), real(1e-6))
        which = photo[image]
        half = real(0.5)
        one = real(1.0)
        total = real(0.0)
        painted = vec3()
        for index in range(part, counts[image], threads):
            edge = rims[image, index]
            ia = edges[edge, 0]
            ib = edges[edge, 1]
            face = edges[edge, 2]
            beyond = edges[edge, 3]
            fold = real(1.0)
            a = screen[image, ia]
            b = screen[image, ib]
            if beyond >= 0:
                apex = faces[face, 0] + faces[face, 1] + faces[face, 2] - ia - ib
                other = edges[edge, 4]
                if facing[image, face] == wp.uint8(0):
                    swap = ia
                    ia = ib
                    ib = swap
                    swap = apex
                    apex = other
                    other = swap
                    a = screen[image, ia]
                    b = screen[image, ib]
                # The two faces lie on one side of the edge: a fold if that beyond is nearer, else a rim.
                c = screen[image, apex]
                d = screen[image, other]
                volume = wp.dot(
                    wp.cross(
                        vec3(b[0] - a[0], b[1] - a[1], b[2] - a[2]),
                        vec3(c[0] - a[0], c[1] - a[1], c[2] - a[2]),
                    ),
                    vec3(d[0] - a[0], d[1] - a[1], d[2] - a[2]),
                )
                if volume < real(0.0):
                    # A fold into the object. Near a rim it lies between two rims that are both crossed:
                    # counted against them one crossing is left, and nothing jumps where a pair appears.
                    fold = real(-1.0)
            inside_frame = (
                wp.min(a[2], b[2]) > real(0.0)
                and wp.max(a[0], b[0]) >= real(0.0)
                and wp.min(a[0], b[0]) <= real(width)
                and wp.max(a[1], b[1]) >= real(0.0)
                and wp.min(a[1], b[1]) <= real(height)
            )
            steps = wp.where(inside_frame, 2, 0)
            na = eye.rotation * normals[image, ia]
            nb = eye.rotation * normals[image, ib]
            for axis in range(steps):
                # u runs along the pair of pixels, v across: (x, y) for pairs in a row, (y, x) in a column.
                across = 1 - axis
                va = a[across]
                length_v = b[across] - va
                lines = height
                size = width
                inside = fold * wp.sign(length_v)
                if axis == 1:
                    lines = width
                    size = height
                    inside = -inside
                first = wp.max(int(wp.ceil(wp.min(va, b[across]) - half)), 0)
                last = wp.min(int(wp.ceil(wp.max(va, b[across]) - half)) - 1, lines - 1)
                for line in range(first, last + 1):
                    share = (real(line) + half - va) / length_v
                    u = a[axis] + share * (b[axis] - a[axis])
                    low = int(wp.floor(u - half))
                    inner_key = wp.int64(NOTHING)
                    outer_key = wp.int64(NOTHING)
                    inner = low
                    outer = low + 1
                    if inside > real(0.0):
                        inner = low + 1
                        outer = low
                    inner_spot = along(axis, real(inner) + half, real(line) + half)
                    outer_spot = along(axis, real(outer) + half, real(line) + half)
                    inner_pixel = vec2(inner_spot[0], inner_spot[1])
                    outer_pixel = vec2(outer_spot[0], outer_spot[1])
                    inner_at = int(inner_spot[1]) * width + int(inner_spot[0])
                    outer_at = int(outer_spot[1]) * width + int(outer_spot[0])
                    if low >= 0 and low + 1 < size:
                        inner_key = keys[image, inner_at]
                        outer_key = keys[image, outer_at]
                    crossed = inner_key != wp.int64(NOTHING)
                    edge_q = (one - share) * a[2] + share * b[2]
                    edge_depth = one / edge_q
                    front = Surface()
                    behind = Surface()
                    front_seen = vec2()
                    behind_seen = vec2()
                    has_behind = outer_key != wp.int64(NOTHING)
                    if crossed:
                        front = surface_of(image, int(inner_key & face_mask), faces, screen, irradiances)
                        front_seen = seen_at(front, inner_pixel)
                        ahead = edge_depth - one / front_seen[1]
                        crossed = ahead <= before_edge and ahead >= -behind_edge
                    if crossed and has_behind:
                        behind = surface_of(image, int(outer_key & face_mask), faces, screen, irradiances)
                        behind_seen = seen_at(behind, outer_pixel)
                        crossed = one / behind_seen[1] >= edge_depth + behind_edge
                    normal = na * (one - share) + nb * share
                    square = normal[0] * normal[0] + normal[1] * normal[1]
                    if crossed and square >= real(1e-12):
                        weight = fold * normal[axis] * normal[axis] / square
                        t = u - half - real(low)
                        blend = wp.abs(t - half)
                        target_inner = (t < half) == (inside < real(0.0))
                        at = outer_at
                        # The front surface's colour: the target's own, or the rim's where it reaches over.
                        perspective = share * b[2] / edge_q
                        rim_step = irradiances[image, ib] - irradiances[image, ia]
                        front_irradiance = irradiances[image, ia] + perspective * rim_step
                        if target_inner:
                            at = inner_at
                            front_irradiance = front_seen[0]
                        seen = observed[which, at]
                        prior = log_prior[which, at]
                        front_fit = explained(seen, colour * front_irradiance, prior, noise)
                        back_fit = vec2(prior[2], real(0.0))
                        if has_behind:
                            back_fit = explained(seen, colour * behind_seen[0], prior, noise)
                        gain = front_fit[0] - back_fit[0]
                        # What the target pixel takes of the front surface, or gives of it to what is behind.
                        taken = weight * blend
                        if target_inner:
                            taken = -taken
                        total = total + taken * gain
                        if images != 0 and not has_behind:
                            wp.atomic_add(coverage, image, at, taken)
                        if differentiate != 0:
                            # The edge's motion: through u and through the weight.
                            along_u = -inside * weight * gain
                            along_weight = fold * blend * gain
                            if target_inner:
                                along_weight = -along_weight
                            slope = (b[axis] - a[axis]) / length_v
                            on_a = (one - share) * along_u
                            on_b = share * along_u
                            # d weight / d normal in the image; columns have the complement of rows.
                            turn = real(2.0) * normal[0] * normal[1] / (square * square) * along_weight
                            if axis == 1:
                                turn = -turn
                            on_normal_here = vec3(turn * normal[1], -turn * normal[0], real(0.0))
                            wp.atomic_add(on_normal, image, ia, on_normal_here * (one - share))
                            wp.atomic_add(on_normal, image, ib, on_normal_here * share)
                            on_share = wp.dot(on_normal_here, nb - na)
                            edge_a = along(axis, on_a, -on_a * slope)
                            edge_b = along(axis, on_b, -on_b * slope)
                            on_qa = real(0.0)
                            on_qb = real(0.0)
                            on_light_a = real(0.0)
                            on_light_b = real(0.0)
                            # The colours on both sides of the edge.
                            front_error = seen - colour * front_irradiance
                            front_weight = taken * front_fit[1] * precision
                            on_front = front_weight * wp.dot(colour, front_error)
                            painted = painted + front_error * (front_weight * front_irradiance)
                            if target_inner:
                                pull_pixel(
                                    image,
                                    front,
                                    inner_pixel,
                                    front_seen,
                                    on_front,
                                    screen,
                                    irradiances,
                                    on_corner,
                                )
                            else:
                                on_light_a = on_front * (one - perspective)
                                on_light_b = on_front * perspective
                                on_perspective = on_front * rim_step
                                on_share = on_share + on_perspective * a[2] * b[2] / (edge_q * edge_q)
                                by_q = on_perspective * share * (one - share) / (edge_q * edge_q)
                                on_qa = -by_q * b[2]
                                on_qb = by_q * a[2]
                            if has_behind:
                                behind_error = seen - colour * behind_seen[0]
                                behind_weight = -taken * back_fit[1] * precision
                                painted = painted + behind_error * (behind_weight * behind_seen[0])
                                pull_pixel(
                                    image,
                                    behind,
                                    outer_pixel,
                                    behind_seen,
                                    behind_weight * wp.dot(colour, behind_error),
                                    screen,
                                    irradiances,
                                    on_corner,
                                )
                            by_share = on_share / length_v
                            share_a = along(axis, real(0.0), -(one - share) * by_share)
                            share_b = along(axis, real(0.0), -share * by_share)
                            pull_a = edge_a + share_a
                            pull_b = edge_b + share_b
                            wp.atomic_add(on_corner, image, ia, vec4(pull_a[0], pull_a[1], on_qa, on_light_a))
                            wp.atomic_add(on_corner, image, ib, vec4(pull_b[0], pull_b[1], on_qb, on_light_b))

                            # Gauss-Newton has no residual here; the cusp of gain per pixel is taken one
                            # pixel wide. The row is of u alone.
                            slot = normal_shape.shape[1]
                            if differentiate > 1:
                                slot = wp.atomic_add(row_count, image, 1)
                            if slot < normal_shape.shape[1]:
                                root = wp.sqrt(curvature / ((wp.abs(along_u) + real(0.1)) * brightness))
                                edge_a = edge_a * root
                                edge_b = edge_b * root
                                to_a = back * camera_cotangent(eye, a, edge_a)
                                to_b = back * camera_cotangent(eye, b, edge_b)
                                normal_shape[image, slot] = (
                                    basis[ia, 0] * to_a[0]
                                    + basis[ia, 1] * to_a[1]
                                    + basis[ia, 2] * to_a[2]
                                    + basis[ib, 0] * to_b[0]
                                    + basis[ib, 1] * to_b[1]
                                    + basis[ib, 2] * to_b[2]
                                )
                                normal_rest[image, slot] = moved(
                                    moved(rest_row(), eye, edge_a, a), eye, edge_b, b
                                )
        values[image, part] = total
        on_albedo[image, part] = painted

    return SimpleNamespace(collect_rims=collect_rims, boundary=boundary)
