"""Kernels of Eq. 4 at occlusion edges: analytic coverage, its cotangents, and rows of the edge's motion.

Between two neighbouring pixels an occlusion edge may pass, at a share t of the way from one centre to the
other. The nearer pixel is then partly the other's surface: by |t - 1/2|, which is its analytic coverage
along that direction. Log-likelihoods (not colours) are blended by it, so the objective is continuous and
differentiable in the edge's place (docs/objective.md says where it is not). An edge is seen both by rows and
by columns; the shares nx^2 and ny^2 of its screen normal, interpolated along the edge, weigh the two, so that
area is kept and nothing jumps where one edge hands over to the next.

`vig.likelihood.reference` computes the same value in plain torch.
"""

import functools
import math
from types import SimpleNamespace

import torch
import warp as wp

from vig.likelihood.kernels.edges import LEAST_SQUARE, edge_functions
from vig.likelihood.kernels.groups import argument_groups
from vig.likelihood.kernels.surface import surface_functions
from vig.likelihood.kernels.types import kernel_types, module_name
from vig.likelihood.pixel import LOG_UNIT

LEAST_BRIGHTNESS = 1e-6
"""Squared albedo by which rows of edges are divided at least: a black object has edges, too."""

LEAST_GAIN = 0.1
"""Nats per pixel added to an edge's gain, whose curvature would otherwise have a pole at no gain."""


@functools.cache
def pixel_functions(dtype: torch.dtype, modes: int) -> SimpleNamespace:
    """Eq. 3 at one pixel."""
    t = kernel_types(dtype, modes)
    real, vec2, vec3 = t.real, t.vec2, t.vec3
    log_unit = real(LOG_UNIT)
    # Beyond it the less likely of two components is lost in rounding.
    clear = real(-math.log(torch.finfo(dtype).eps))

    @wp.struct
    class Noise:
        """The Gaussian of a covered pixel: one over twice its variance, and its log normaliser."""

        half_precision: real
        log_normaliser: real

    @wp.func
    def noise_of(sigma: real):
        noise = Noise()
        noise.half_precision = real(0.5) / (sigma * sigma)
        noise.log_normaliser = real(-3.0) * wp.log(sigma) - log_unit
        return noise

    @wp.func
    def explained(observed: vec3, rendered: vec3, log_prior: vec3, noise: Noise):
        """(log-likelihood of a covered pixel, posterior of its being visible), Eq. 3."""
        error = observed - rendered
        inlier = log_prior[0] + noise.log_normaliser - wp.dot(error, error) * noise.half_precision
        gap = inlier - log_prior[1]
        if gap > clear:
            return vec2(inlier, real(1.0))
        if gap < -clear:
            return vec2(log_prior[1], real(0.0))
        ratio = wp.exp(-wp.abs(gap))
        share = real(1.0) / (real(1.0) + ratio)
        if gap < real(0.0):
            share = ratio * share
        return vec2(wp.max(inlier, log_prior[1]) + wp.log(real(1.0) + ratio), share)

    return SimpleNamespace(Noise=Noise, noise_of=noise_of, explained=explained)


@functools.cache
def blend_functions(dtype: torch.dtype, modes: int) -> SimpleNamespace:
    """What blending across a crossing adds to Eq. 4, and its derivatives."""
    t, groups, f = kernel_types(dtype, modes), argument_groups(dtype, modes), surface_functions(dtype, modes)
    p, e = pixel_functions(dtype, modes), edge_functions(dtype, modes)
    real, vec2, vec3, vec4, rest_row = t.real, t.vec2, t.vec3, t.vec4, t.rest_row
    Mesh, Vertices, Photos, Cotangents = groups.mesh, groups.vertices, groups.photos, groups.cotangents
    NormalRows, Eye, Noise = groups.normal_rows, f.Eye, p.Noise
    Edge, Crossing, Sides, along, explained = e.Edge, e.Crossing, e.Sides, e.along, p.explained
    camera_cotangent, pull_pixel, along_basis, moved = (
        f.camera_cotangent,
        f.pull_pixel,
        f.along_basis,
        f.moved,
    )
    least_brightness, least_gain = real(LEAST_BRIGHTNESS), real(LEAST_GAIN)
    half, one = real(0.5), real(1.0)

    @wp.struct
    class Blend:
        """What a target pixel takes of the front surface, or gives of it to what is behind.

        weight: of this axis, times fold. taken: weight times |t - 1/2|, negative when the target is the
        inner pixel and gives. front_irradiance: the target's own if it gives, else the edge's there, which
        stands `perspective` of the way from vertex i's. front_fit, back_fit: Eq. 3 of the target under
        either surface. gain: nats of the first over the second.
        """

        weight: real
        taken: real
        gives: bool
        at: wp.int32
        normal: vec3
        front_irradiance: real
        perspective: real
        observed: vec3
        front_fit: vec2
        back_fit: vec2
        gain: real

    @wp.func
    def blend_of(
        image: int,
        normal: vec3,
        edge: Edge,
        c: Crossing,
        sides: Sides,
        vertices: Vertices,
        photos: Photos,
        noise: Noise,
    ):
        blend = Blend()
        blend.normal = normal
        square = normal[0] * normal[0] + normal[1] * normal[1]
        blend.weight = edge.fold * normal[c.axis] * normal[c.axis] / square
        blend.gives = (c.t < half) == (c.inside < real(0.0))
        edge_q = (one - c.share) * edge.a[2] + c.share * edge.b[2]
        blend.perspective = c.share * edge.b[2] / edge_q
        lit_a = vertices.irradiances[image, edge.i]
        lit_b = vertices.irradiances[image, edge.j]
        blend.at = c.outer
        blend.front_irradiance = lit_a + blend.perspective * (lit_b - lit_a)
        blend.taken = blend.weight * wp.abs(c.t - half)
        if blend.gives:
            blend.at = c.inner
            blend.front_irradiance = sides.front_seen[0]
            blend.taken = -blend.taken
        which = photos.photo[image]
        colour = photos.albedo[image]
        prior = photos.log_prior[which, blend.at]
        blend.observed = photos.observed[which, blend.at]
        blend.front_fit = explained(blend.observed, colour * blend.front_irradiance, prior, noise)
        blend.back_fit = vec2(prior[2], real(0.0))
        if sides.has_behind:
            blend.back_fit = explained(blend.observed, colour * sides.behind_seen[0], prior, noise)
        blend.gain = blend.front_fit[0] - blend.back_fit[0]
        return blend

    @wp.func
    def pull_normal(image: int, edge: Edge, c: Crossing, blend: Blend, cotangents: Cotangents):
        """Pull the weight's cotangent back to the edge's normals; the one on `share` is returned."""
        normal = blend.normal
        square = normal[0] * normal[0] + normal[1] * normal[1]
        on_weight = edge.fold * wp.abs(c.t - half) * blend.gain
        if blend.gives:
            on_weight = -on_weight
        # d weight / d normal in the image; columns have the complement of rows.
        turn = real(2.0) * normal[0] * normal[1] / (square * square) * on_weight
        if c.axis == 1:
            turn = -turn
        on_normal = vec3(turn * normal[1], -turn * normal[0], real(0.0))
        wp.atomic_add(cotangents.on_normal, image, edge.i, on_normal * (one - c.share))
        wp.atomic_add(cotangents.on_normal, image, edge.j, on_normal * c.share)
        return wp.dot(on_normal, edge.normal_b - edge.normal_a)

    @wp.func
    def pull_front(
        image: int,
        on_front: real,
        on_share: real,
        edge: Edge,
        c: Crossing,
        perspective: real,
        vertices: Vertices,
        cotangents: Cotangents,
    ):
        """Pull a cotangent on the edge's irradiance, and one on `share`, back to the edge's ends."""
        edge_q = (one - c.share) * edge.a[2] + c.share * edge.b[2]
        step = vertices.irradiances[image, edge.j] - vertices.irradiances[image, edge.i]
        on_perspective = on_front * step
        by_q = on_perspective * c.share * (one - c.share) / (edge_q * edge_q)
        by_share = (on_share + on_perspective * edge.a[2] * edge.b[2] / (edge_q * edge_q)) / c.length
        on_a = along(c.axis, real(0.0), -(one - c.share) * by_share)
        on_b = along(c.axis, real(0.0), -c.share * by_share)
        lit_a = on_front * (one - perspective)
        lit_b = on_front * perspective
        wp.atomic_add(cotangents.on_corner, image, edge.i, vec4(on_a[0], on_a[1], -by_q * edge.b[2], lit_a))
        wp.atomic_add(cotangents.on_corner, image, edge.j, vec4(on_b[0], on_b[1], by_q * edge.a[2], lit_b))

    @wp.func
    def pull_blend(
        image: int,
        edge: Edge,
        c: Crossing,
        sides: Sides,
        blend: Blend,
        noise: Noise,
        vertices: Vertices,
        photos: Photos,
        cotangents: Cotangents,
    ):
        """Pull everything but the edge's motion along the line back; returns the cotangent on albedo."""
        colour = photos.albedo[image]
        precision = real(2.0) * noise.half_precision
        on_share = pull_normal(image, edge, c, blend, cotangents)
        error = blend.observed - colour * blend.front_irradiance
        strength = blend.taken * blend.front_fit[1] * precision
        painted = error * (strength * blend.front_irradiance)
        on_front = strength * wp.dot(colour, error)
        if blend.gives:
            pull_pixel(image, sides.front, c.inner_pixel, sides.front_seen, on_front, vertices, cotangents)
            on_front = real(0.0)
        pull_front(image, on_front, on_share, edge, c, blend.perspective, vertices, cotangents)
        if sides.has_behind:
            error = blend.observed - colour * sides.behind_seen[0]
            strength = -blend.taken * blend.back_fit[1] * precision
            painted = painted + error * (strength * sides.behind_seen[0])
            on_behind = strength * wp.dot(colour, error)
            pull_pixel(image, sides.behind, c.outer_pixel, sides.behind_seen, on_behind, vertices, cotangents)
        return painted

    @wp.func
    def add_row(
        slot: int, image: int, edge: Edge, on_a: vec3, on_b: vec3, mesh: Mesh, eye: Eye, rows: NormalRows
    ):
        """A row of the normal matrix from cotangents on the edge's screen points."""
        back = wp.transpose(eye.rotation)
        to_a = back * camera_cotangent(eye, edge.a, on_a)
        to_b = back * camera_cotangent(eye, edge.b, on_b)
        rows.normal_shape[image, slot] = along_basis(mesh, edge.i, to_a) + along_basis(mesh, edge.j, to_b)
        rows.normal_rest[image, slot] = moved(moved(rest_row(), eye, on_a, edge.a), eye, on_b, edge.b)

    @wp.func
    def pull_motion(
        image: int,
        edge: Edge,
        c: Crossing,
        blend: Blend,
        colour: vec3,
        curvature: real,
        mesh: Mesh,
        eye: Eye,
        cotangents: Cotangents,
        rows: NormalRows,
    ):
        """Pull the edge's motion along the line back to its ends; with curvature > 0 add its row.

        Gauss-Newton has no residual here: the cusp of gain per pixel is taken one pixel wide.
        """
        on_u = -c.inside * blend.weight * blend.gain
        slope = (edge.b[c.axis] - edge.a[c.axis]) / c.length
        on_a = along(c.axis, (one - c.share) * on_u, -(one - c.share) * on_u * slope)
        on_b = along(c.axis, c.share * on_u, -c.share * on_u * slope)
        wp.atomic_add(cotangents.on_corner, image, edge.i, vec4(on_a[0], on_a[1], real(0.0), real(0.0)))
        wp.atomic_add(cotangents.on_corner, image, edge.j, vec4(on_b[0], on_b[1], real(0.0), real(0.0)))
        if curvature > real(0.0):
            slot = wp.atomic_add(rows.row_count, image, 1)
            if slot < rows.normal_shape.shape[1]:
                brightness = wp.max(wp.dot(colour, colour), least_brightness)
                root = wp.sqrt(curvature / ((wp.abs(on_u) + least_gain) * brightness))
                add_row(slot, image, edge, on_a * root, on_b * root, mesh, eye, rows)

    return SimpleNamespace(blend_of=blend_of, pull_blend=pull_blend, pull_motion=pull_motion)


@functools.cache
def boundary_kernels(dtype: torch.dtype, modes: int) -> SimpleNamespace:
    """The kernels of the edges for one scalar type and number of shape components."""
    t, groups, f = kernel_types(dtype, modes), argument_groups(dtype, modes), surface_functions(dtype, modes)
    p, e, g = pixel_functions(dtype, modes), edge_functions(dtype, modes), blend_functions(dtype, modes)
    real, vec3, vec4 = t.real, t.vec3, t.vec4
    Mesh, View, Vertices, Photos = groups.mesh, groups.view, groups.vertices, groups.photos
    Occluding, Cotangents, Totals = groups.occluding, groups.cotangents, groups.totals
    NormalRows, Pictures = groups.normal_rows, groups.pictures
    Eye, Edge, Noise = f.Eye, e.Edge, p.Noise
    eye_of, noise_of, edge_of, in_frame = f.eye_of, p.noise_of, e.edge_of, e.in_frame
    lines_of, crossing_of, sides_of = e.lines_of, e.crossing_of, e.sides_of
    blend_of, pull_blend, pull_motion = g.blend_of, g.pull_blend, g.pull_motion
    least_square, one = real(LEAST_SQUARE), real(1.0)
    module = module_name("boundary", dtype, modes)

    @wp.kernel(module=module)
    def collect_edges(mesh: Mesh, chunk: int, occluding: Occluding):
        """List the edges between a face turned to the eye and one turned away, or none."""
        image, part = wp.tid()
        first = part * chunk
        for edge in range(first, wp.min(first + chunk, mesh.edges.shape[0])):
            beyond = mesh.edges[edge, 3]
            front_beyond = wp.uint8(0)
            if beyond >= 0:
                front_beyond = occluding.facing[image, beyond]
            if occluding.facing[image, mesh.edges[edge, 2]] != front_beyond:
                slot = wp.atomic_add(occluding.counts, image, 1)
                occluding.occluding_edges[image, slot] = edge

    @wp.struct
    class Task:
        """What is the same at all edges of an image."""

        eye: Eye
        noise: Noise
        curvature: real
        differentiate: int
        images: int

    @wp.func
    def cross_line(
        image: int,
        edge: Edge,
        axis: int,
        line: int,
        mesh: Mesh,
        view: View,
        vertices: Vertices,
        photos: Photos,
        keys: wp.array2d(dtype=wp.int64),
        task: Task,
        cotangents: Cotangents,
        normal_rows: NormalRows,
        pictures: Pictures,
    ):
        """(What blending where an edge crosses a line adds to Eq. 4, its derivative by albedo.)"""
        c = crossing_of(edge, axis, line, view)
        sides = sides_of(image, edge, c, mesh, vertices, keys)
        normal = edge.normal_a * (one - c.share) + edge.normal_b * c.share
        if not sides.crossed or normal[0] * normal[0] + normal[1] * normal[1] < least_square:
            return vec4()
        blend = blend_of(image, normal, edge, c, sides, vertices, photos, task.noise)
        if task.images != 0 and not sides.has_behind:
            wp.atomic_add(pictures.coverage, image, blend.at, blend.taken)
        painted = vec3()
        if task.differentiate != 0:
            painted = pull_blend(image, edge, c, sides, blend, task.noise, vertices, photos, cotangents)
            stiffness = task.curvature
            if task.differentiate < 2:
                stiffness = real(0.0)
            colour = photos.albedo[image]
            pull_motion(image, edge, c, blend, colour, stiffness, mesh, task.eye, cotangents, normal_rows)
        return vec4(blend.taken * blend.gain, painted[0], painted[1], painted[2])

    @wp.kernel(module=module)
    def boundary(
        mesh: Mesh,
        view: View,
        vertices: Vertices,
        photos: Photos,
        keys: wp.array2d(dtype=wp.int64),
        occluding: Occluding,
        threads: wp.int32,
        curvature: real,
        differentiate: int,
        images: int,
        totals: Totals,
        cotangents: Cotangents,
        normal_rows: NormalRows,
        pictures: Pictures,
    ):
        """Every `threads`th occlusion edge of an image: what blending across it adds to Eq. 4, the way back
        with differentiate >= 1, rows of the normal matrix with 2."""
        image, part = wp.tid()
        task = Task()
        task.eye = eye_of(image, view)
        task.noise = noise_of(photos.sigma[image])
        task.curvature = curvature
        task.differentiate = differentiate
        task.images = images
        total = vec4()
        for index in range(part, occluding.counts[image], threads):
            number = occluding.occluding_edges[image, index]
            edge = edge_of(image, number, mesh, vertices, occluding, task.eye)
            if not in_frame(edge, view):
                continue
            for axis in range(2):
                first, end = lines_of(edge, axis, view)
                for line in range(first, end):
                    total += cross_line(
                        image,
                        edge,
                        axis,
                        line,
                        mesh,
                        view,
                        vertices,
                        photos,
                        keys,
                        task,
                        cotangents,
                        normal_rows,
                        pictures,
                    )
        totals.values[image, part] = total[0]
        totals.on_albedo[image, part] = vec3(total[1], total[2], total[3])

    return SimpleNamespace(collect_edges=collect_edges, boundary=boundary)
