"""Kernels of Eq. 4 at occlusion edges: analytic coverage, its cotangents, and rows of the edge's motion.

Between two neighbouring pixels an occlusion edge may pass, at a share t of the way from one centre to the
other. The nearer pixel is then partly the other's surface: by |t - 1/2|, which is its analytic coverage
along that direction. Log-likelihoods (not colours) are blended by it, so the objective is continuous and
differentiable in the edge's place (docs/objective.md lists where it is not). An edge is seen both by rows and
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
from vig.likelihood.kernels.groups import argument_groups, kernel_types, module_name
from vig.likelihood.kernels.surface import surface_functions
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
    real, vec2, vec3, vec4, shape_row, rest_row = t.real, t.vec2, t.vec3, t.vec4, t.shape_row, t.rest_row
    Mesh, Vertices, Photos, Cotangents = groups.mesh, groups.vertices, groups.photos, groups.cotangents
    NormalRows, Eye, Noise = groups.normal_rows, f.Eye, p.Noise
    Edge, Crossing, Sides, along, explained = e.Edge, e.Crossing, e.Sides, e.along, p.explained
    camera_cotangent, pull_pixel, add_basis, moved = f.camera_cotangent, f.pull_pixel, f.add_basis, f.moved
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
    def pull_colours(
        painted: vec3,
        image: int,
        c: Crossing,
        sides: Sides,
        blend: Blend,
        noise: Noise,
        vertices: Vertices,
        photos: Photos,
        cotangents: Cotangents,
    ):
        """Pull the colours on both sides back to their faces. Returns `painted` with what is added to the
        cotangent on albedo, and the cotangent on the edge's own irradiance."""
        colour = photos.albedo[image]
        precision = real(2.0) * noise.half_precision
        error = blend.observed - colour * blend.front_irradiance
        strength = blend.taken * blend.front_fit[1] * precision
        painted += error * (strength * blend.front_irradiance)
        on_edge = strength * wp.dot(colour, error)
        if blend.gives:
            pull_pixel(image, sides.front, c.inner_pixel, sides.front_seen, on_edge, vertices, cotangents)
            on_edge = real(0.0)
        if sides.has_behind:
            error = blend.observed - colour * sides.behind_seen[0]
            strength = -blend.taken * blend.back_fit[1] * precision
            painted += error * (strength * sides.behind_seen[0])
            on_behind = strength * wp.dot(colour, error)
            pull_pixel(image, sides.behind, c.outer_pixel, sides.behind_seen, on_behind, vertices, cotangents)
        return painted, on_edge

    @wp.func
    def motion_of(edge: Edge, c: Crossing, blend: Blend):
        """Cotangents on the screen points of the edge's ends, through u, where it crosses the line."""
        on_u = -c.inside * blend.weight * blend.gain
        on_a = (one - c.share) * on_u
        on_b = c.share * on_u
        slope = (edge.b[c.axis] - edge.a[c.axis]) / c.length
        return along(c.axis, on_a, -on_a * slope), along(c.axis, on_b, -on_b * slope)

    @wp.func
    def pull_edge(
        image: int,
        edge: Edge,
        c: Crossing,
        perspective: real,
        on_edge: real,
        on_share: real,
        motion_a: vec3,
        motion_b: vec3,
        vertices: Vertices,
        cotangents: Cotangents,
    ):
        """Pull cotangents on the edge's irradiance, on `share` and on u back to the edge's ends."""
        edge_q = (one - c.share) * edge.a[2] + c.share * edge.b[2]
        step = vertices.irradiances[image, edge.j] - vertices.irradiances[image, edge.i]
        on_perspective = on_edge * step
        by_q = on_perspective * c.share * (one - c.share) / (edge_q * edge_q)
        by_share = (on_share + on_perspective * edge.a[2] * edge.b[2] / (edge_q * edge_q)) / c.length
        on_a = motion_a + along(c.axis, real(0.0), -(one - c.share) * by_share)
        on_b = motion_b + along(c.axis, real(0.0), -c.share * by_share)
        lit_a = on_edge * (one - perspective)
        lit_b = on_edge * perspective
        wp.atomic_add(cotangents.on_corner, image, edge.i, vec4(on_a[0], on_a[1], -by_q * edge.b[2], lit_a))
        wp.atomic_add(cotangents.on_corner, image, edge.j, vec4(on_b[0], on_b[1], by_q * edge.a[2], lit_b))

    @wp.func
    def add_row(
        image: int,
        edge: Edge,
        blend: Blend,
        motion_a: vec3,
        motion_b: vec3,
        colour: vec3,
        curvature: real,
        mesh: Mesh,
        eye: Eye,
        rows: NormalRows,
    ):
        """The edge's motion along the line as a row of the normal matrix.

        Gauss-Newton has no residual here: the cusp of gain per pixel is taken one pixel wide.
        """
        slot = wp.atomic_add(rows.row_count, image, 1)
        if slot < rows.normal_shape.shape[1]:
            brightness = wp.max(wp.dot(colour, colour), least_brightness)
            steepness = wp.abs(blend.weight * blend.gain) + least_gain
            root = wp.sqrt(curvature / (steepness * brightness))
            back = wp.transpose(eye.rotation)
            on_a = motion_a * root
            on_b = motion_b * root
            row = add_basis(shape_row(), mesh, edge.i, back * camera_cotangent(eye, edge.a, on_a))
            row = add_basis(row, mesh, edge.j, back * camera_cotangent(eye, edge.b, on_b))
            rows.normal_shape[image, slot] = row
            rows.normal_rest[image, slot] = moved(moved(rest_row(), eye, on_a, edge.a), eye, on_b, edge.b)

    return SimpleNamespace(
        blend_of=blend_of,
        pull_normal=pull_normal,
        pull_colours=pull_colours,
        motion_of=motion_of,
        pull_edge=pull_edge,
        add_row=add_row,
    )


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
    blend_of, pull_normal, pull_colours = g.blend_of, g.pull_normal, g.pull_colours
    motion_of, pull_edge, add_row = g.motion_of, g.pull_edge, g.add_row
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
        total: vec4,
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
        """`total`, Eq. 4 and its derivative by albedo, with what blending across an edge on a line adds."""
        c = crossing_of(edge, axis, line, view)
        sides = sides_of(image, edge, c, mesh, vertices, keys)
        normal = edge.normal_a * (one - c.share) + edge.normal_b * c.share
        if not sides.crossed or normal[0] * normal[0] + normal[1] * normal[1] < least_square:
            return total
        blend = blend_of(image, normal, edge, c, sides, vertices, photos, task.noise)
        if task.images != 0 and not sides.has_behind:
            wp.atomic_add(pictures.coverage, image, blend.at, blend.taken)
        painted = vec3(total[1], total[2], total[3])
        if task.differentiate != 0:
            on_share = pull_normal(image, edge, c, blend, cotangents)
            painted, on_edge = pull_colours(
                painted, image, c, sides, blend, task.noise, vertices, photos, cotangents
            )
            on_a, on_b = motion_of(edge, c, blend)
            pull_edge(image, edge, c, blend.perspective, on_edge, on_share, on_a, on_b, vertices, cotangents)
            if task.differentiate > 1:
                colour = photos.albedo[image]
                add_row(image, edge, blend, on_a, on_b, colour, task.curvature, mesh, task.eye, normal_rows)
        return vec4(total[0] + blend.taken * blend.gain, painted[0], painted[1], painted[2])

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
                    total = cross_line(
                        total,
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
