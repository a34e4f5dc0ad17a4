"""Kernels of Eq. 4 at occlusion edges: analytic coverage, and the rows of its derivatives.

Between two neighbouring pixels an occlusion edge may pass, at a share t of the way from one centre to the
other. The nearer pixel is then partly the other's surface: by |t - 1/2|, which is its analytic coverage
along that direction. Log-likelihoods (not colours) are blended by it, so the objective is continuous and
differentiable in the edge's place. An edge is seen both by rows and by columns; the shares nx^2 and ny^2 of
its screen normal, interpolated along the edge, weigh the two, so that area is kept and nothing jumps where
one edge hands over to the next.
"""

import functools
from types import SimpleNamespace

import torch
import warp as wp

from vig.likelihood.functions import likelihood_functions
from vig.render.geometry import module_name
from vig.render.raster import NEAR, NOTHING

BEHIND_EDGE = 0.002
"""Metres by which the surface beyond an occlusion edge must lie behind it."""

BEFORE_EDGE = 0.04
"""Metres by which the edge's own surface may come forward within a pixel."""


@functools.cache
def boundary_kernels(dtype: torch.dtype, modes: int) -> SimpleNamespace:
    """The kernels of the edges for one scalar type and number of shape components."""
    f = likelihood_functions(dtype, modes)
    real, vec2, vec3, mat33, row_type = f.real, f.vec2, f.vec3, f.mat33, f.row_type
    normal_jacobian, Hit, View = f.normal_jacobian, f.Hit, f.View
    view_of, project, screen_cotangent = f.view_of, f.project, f.screen_cotangent
    add_motion, add_framing, hit_of, hit_row = f.add_motion, f.add_framing, f.hit_of, f.hit_row
    explained, emit_colour = f.explained, f.emit_colour
    azimuth, elevation = f.layout.azimuth, f.layout.elevation
    modes_, gradient_at = modes, f.layout.used
    behind_edge, before_edge, near = real(BEHIND_EDGE), real(BEFORE_EDGE), real(NEAR)
    module = module_name("likelihood", dtype, modes)

    @wp.func
    def add_vertex_motion(
        row: row_type,
        view: View,
        on_screen: vec2,
        in_camera: vec3,
        point: vec3,
        vertex: int,
        basis: wp.array2d(dtype=row_type),
    ):
        """Add what a vertex's motion does through its pixel coordinates and through its camera ones."""
        cotangent = screen_cotangent(view, point, on_screen) + in_camera
        row = add_motion(row, view, cotangent, point, basis[0, vertex], basis[1, vertex], basis[2, vertex])
        return add_framing(row, view, on_screen, project(view, point))

    @wp.func
    def add_normal_turn(
        row: row_type,
        view: View,
        cotangent: vec3,
        share: real,
        normal: vec3,
        inverse_length: real,
        dn_x: normal_jacobian,
        dn_y: normal_jacobian,
        dn_z: normal_jacobian,
    ):
        """Add share * cotangent . d(unit normal in the camera frame) / d(latents)."""
        world = wp.transpose(view.rotation) * cotangent
        tangent = (world - normal * wp.dot(world, normal)) * (inverse_length * share)
        for mode in range(modes_):
            row[mode] = row[mode] + (
                tangent[0] * dn_x[mode + 1] + tangent[1] * dn_y[mode + 1] + tangent[2] * dn_z[mode + 1]
            )
        turned = view.rotation * normal
        up = vec3(view.rotation[0, 2], view.rotation[1, 2], view.rotation[2, 2])
        row[azimuth] = row[azimuth] - share * wp.dot(cotangent, wp.cross(up, turned))
        row[elevation] = row[elevation] + share * (cotangent[2] * turned[1] - cotangent[1] * turned[2])
        return row

    @wp.kernel(module=module)
    def collect_rims(
        edges: wp.array2d(dtype=wp.int32),
        facing: wp.array2d(dtype=wp.uint8),
        counts: wp.array(dtype=wp.int32),
        rims: wp.array2d(dtype=wp.int32),
    ):
        """List the edges between a face turned to the eye and one turned away, or none."""
        image, edge = wp.tid()
        front = facing[image, edges[edge, 2]]
        beyond = edges[edge, 3]
        front_beyond = wp.uint8(0)
        if beyond >= 0:
            front_beyond = facing[image, beyond]
        if front != front_beyond:
            rims[image, wp.atomic_add(counts, image, 1)] = edge

    @wp.kernel(module=module)
    def boundary(
        points: wp.array2d(dtype=vec3),
        normals: wp.array2d(dtype=vec3),
        inverse_lengths: wp.array2d(dtype=real),
        attributes: wp.array2d(dtype=row_type),
        irradiances: wp.array2d(dtype=real),
        normal_rates: wp.array3d(dtype=normal_jacobian),
        basis: wp.array2d(dtype=row_type),
        faces: wp.array2d(dtype=wp.int32),
        edges: wp.array2d(dtype=wp.int32),
        facing: wp.array2d(dtype=wp.uint8),
        counts: wp.array(dtype=wp.int32),
        rims: wp.array2d(dtype=wp.int32),
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
        keep: wp.array2d(dtype=real),
        extra: wp.array2d(dtype=real),
        coverage: wp.array2d(dtype=real),
        used: wp.array(dtype=wp.int32),
        rows: wp.array2d(dtype=row_type),
        weighted: wp.array2d(dtype=row_type),
    ):
        image, index = wp.tid()
        if index >= counts[image]:
            return
        edge = rims[image, index]
        ia = edges[edge, 0]
        ib = edges[edge, 1]
        face = edges[edge, 2]
        beyond = edges[edge, 3]
        apex = faces[face, 0] + faces[face, 1] + faces[face, 2] - ia - ib
        other = edges[edge, 4]
        a = points[image, ia]
        b = points[image, ib]
        if wp.min(a[2], b[2]) < near:
            return
        fold = real(1.0)
        if beyond >= 0:
            if facing[image, face] == wp.uint8(0):
                ia = edges[edge, 1]
                ib = edges[edge, 0]
                apex, other = other, apex
                a, b = b, a
            outward = wp.cross(b - a, points[image, apex] - a)
            if wp.dot(outward, points[image, other] - a) > real(0.0):
                # A fold into the object. Near a rim it lies between two rims that are both crossed: counted
                # against them one crossing is left, and nothing jumps where such a pair appears.
                fold = real(-1.0)
        view = view_of(rotation[image], distance, intrinsics[image], width)
        sa = project(view, a)
        sb = project(view, b)
        if wp.max(sa[0], sb[0]) < real(0.0) or wp.min(sa[0], sb[0]) > real(width):
            return
        if wp.max(sa[1], sb[1]) < real(0.0) or wp.min(sa[1], sb[1]) > real(height):
            return
        na = view.rotation * normals[image, ia]
        nb = view.rotation * normals[image, ib]
        colour = albedo[image]
        which = photo[image]
        s = sigma[image]
        half = real(0.5)
        one = real(1.0)
        for axis in range(2):
            # u runs along the pair of pixels, v across: (x, y) for pairs in a row, (y, x) in a column.
            across = 1 - axis
            va = sa[across]
            vb = sb[across]
            length_v = vb - va
            lines = height
            steps = width
            inside = fold * wp.sign(length_v)
            if axis == 1:
                lines = width
                steps = height
                inside = -inside
            first = wp.max(int(wp.ceil(wp.min(va, vb) - half)), 0)
            last = wp.min(int(wp.ceil(wp.max(va, vb) - half)) - 1, lines - 1)
            for line in range(first, last + 1):
                share = (real(line) + half - va) / length_v
                u = sa[axis] + share * (sb[axis] - sa[axis])
                low = int(wp.floor(u - half))
                if low < 0 or low + 1 >= steps:
                    continue
                t = u - half - real(low)
                inner = low
                outer = low + 1
                if inside > real(0.0):
                    inner = low + 1
                    outer = low
                inner_x = inner
                inner_y = line
                outer_x = outer
                outer_y = line
                if axis == 1:
                    inner_x = line
                    inner_y = inner
                    outer_x = line
                    outer_y = outer
                inner_key = keys[image, inner_y * width + inner_x]
                outer_key = keys[image, outer_y * width + outer_x]
                if inner_key == wp.int64(NOTHING):
                    continue
                edge_depth = one / ((one - share) / a[2] + share / b[2])
                inner_pixel = vec2(real(inner_x) + half, real(inner_y) + half)
                outer_pixel = vec2(real(outer_x) + half, real(outer_y) + half)
                inner_hit = hit_of(
                    view,
                    image,
                    int(inner_key & wp.int64(0xFFFFFFFF)),
                    inner_pixel,
                    points,
                    irradiances,
                    faces,
                )
                if (
                    inner_hit.point[2] < edge_depth - before_edge
                    or inner_hit.point[2] > edge_depth + behind_edge
                ):
                    continue
                outer_hit = Hit()
                has_behind = outer_key != wp.int64(NOTHING)
                if has_behind:
                    outer_hit = hit_of(
                        view,
                        image,
                        int(outer_key & wp.int64(0xFFFFFFFF)),
                        outer_pixel,
                        points,
                        irradiances,
                        faces,
                    )
                    if outer_hit.point[2] < edge_depth + behind_edge:
                        continue

                normal = na * (one - share) + nb * share
                square = normal[0] * normal[0] + normal[1] * normal[1]
                if square < real(1e-12):
                    continue
                weight = fold * normal[axis] * normal[axis] / square
                blend = wp.abs(t - half)
                target_inner = (t < half) == (inside < real(0.0))
                target_x = outer_x
                target_y = outer_y
                if target_inner:
                    target_x = inner_x
                    target_y = inner_y
                at = target_y * width + target_x
                seen = observed[which, at]
                prior = log_prior[which, at]
                # The front surface's colour: the target's own, or the rim's where it reaches over.
                perspective = share * edge_depth / b[2]
                rim = irradiances[image, ia] * (one - perspective) + (irradiances[image, ib] * perspective)
                front_irradiance = rim
                if target_inner:
                    front_irradiance = inner_hit.irradiance
                front_fit = explained(seen, colour * front_irradiance, prior, s)
                back_fit = vec2(prior[2], real(0.0))
                if has_behind:
                    back_fit = explained(seen, colour * outer_hit.irradiance, prior, s)
                gain = front_fit[0] - back_fit[0]
                other_fit = front_fit
                if target_inner:
                    other_fit = back_fit
                wp.atomic_add(keep, image, at, -weight * blend)
                wp.atomic_add(extra, image, at, weight * blend * other_fit[0])
                if not has_behind:
                    covered = weight * blend
                    if target_inner:
                        covered = -covered
                    wp.atomic_add(coverage, image, at, covered)
                if differentiate == 0:
                    continue

                # Row of the edge's motion: the objective's own derivative through u and through weight.
                along_u = -inside * weight * gain
                along_weight = fold * blend * gain
                if target_inner:
                    along_weight = -along_weight
                slope = (sb[axis] - sa[axis]) / length_v
                on_a = (one - share) * along_u
                on_b = share * along_u
                # d weight / d normal in the image plane; columns have the complement of rows.
                turn = real(2.0) * normal[0] * normal[1] / (square * square) * along_weight
                if axis == 1:
                    turn = -turn
                on_normal = vec3(turn * normal[1], -turn * normal[0], real(0.0))
                on_share = wp.dot(on_normal, nb - na) / length_v
                across_a = -on_a * slope - (one - share) * on_share
                across_b = -on_b * slope - share * on_share
                screen_a = vec2(on_a, across_a)
                screen_b = vec2(on_b, across_b)
                if axis == 1:
                    screen_a = vec2(across_a, on_a)
                    screen_b = vec2(across_b, on_b)
                row = row_type()
                row = add_vertex_motion(row, view, screen_a, vec3(), a, ia, basis)
                row = add_vertex_motion(row, view, screen_b, vec3(), b, ib, basis)
                row = add_normal_turn(
                    row,
                    view,
                    on_normal,
                    one - share,
                    normals[image, ia],
                    inverse_lengths[image, ia],
                    normal_rates[image, ia, 0],
                    normal_rates[image, ia, 1],
                    normal_rates[image, ia, 2],
                )
                row = add_normal_turn(
                    row,
                    view,
                    on_normal,
                    share,
                    normals[image, ib],
                    inverse_lengths[image, ib],
                    normal_rates[image, ib, 0],
                    normal_rates[image, ib, 1],
                    normal_rates[image, ib, 2],
                )
                slot = wp.atomic_add(used, image, 1)
                if slot >= rows.shape[1]:
                    continue
                rows[image, slot] = row
                # Gauss-Newton has no residual here; the cusp of gain per pixel is taken one pixel wide.
                stiffness = curvature / (
                    (wp.abs(along_u) + real(0.1)) * wp.max(wp.dot(colour, colour), real(1e-6))
                )
                scaled = row * stiffness
                scaled[gradient_at] = one
                weighted[image, slot] = scaled

                # Row of the colour that the target pixel takes from across the edge.
                colour_weight = other_fit[1] * weight * blend / (s * s)
                if target_inner and has_behind:
                    slot = wp.atomic_add(used, image, 1)
                    emit_colour(
                        slot,
                        image,
                        hit_row(view, image, outer_hit, outer_pixel, attributes, basis),
                        colour_weight,
                        outer_hit.irradiance,
                        seen,
                        colour,
                        rows,
                        weighted,
                    )
                if not target_inner:
                    step = irradiances[image, ib] - irradiances[image, ia]
                    row = attributes[image, ia] * (one - perspective) + attributes[image, ib] * perspective
                    by_share = -step * edge_depth * edge_depth / (a[2] * b[2] * length_v)
                    by_depth = step * perspective * (one - perspective)
                    rim_a = vec2(real(0.0), by_share * (one - share))
                    rim_b = vec2(real(0.0), by_share * share)
                    if axis == 1:
                        rim_a = vec2(rim_a[1], rim_a[0])
                        rim_b = vec2(rim_b[1], rim_b[0])
                    row = add_vertex_motion(
                        row, view, rim_a, vec3(real(0.0), real(0.0), by_depth / a[2]), a, ia, basis
                    )
                    row = add_vertex_motion(
                        row, view, rim_b, vec3(real(0.0), real(0.0), -by_depth / b[2]), b, ib, basis
                    )
                    slot = wp.atomic_add(used, image, 1)
                    emit_colour(slot, image, row, colour_weight, rim, seen, colour, rows, weighted)

    return SimpleNamespace(collect_rims=collect_rims, boundary=boundary)
