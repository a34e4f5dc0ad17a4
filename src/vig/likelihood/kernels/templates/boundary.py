"""Kernels of Eq. 4 at occlusion edges: collection of the edges, and blending across them."""

import warp as wp

from vig.likelihood.kernels.layout import LEAST_SQUARE

least_square = real(LEAST_SQUARE)


@wp.kernel(module=module)
def collect_edges(mesh: Mesh, chunk: int, vertices: Vertices, occluding: Occluding):
    """List the edges between a face turned to the eye and one turned away, or none; their ends are used."""
    image, part = wp.tid()
    first = part * chunk
    edge_count = wp.int32(0)
    for edge in range(first, wp.min(first + chunk, mesh.edges.shape[0])):
        beyond = mesh.edges[edge, 3]
        front_beyond = wp.uint8(0)
        if beyond >= 0:
            front_beyond = occluding.facing[image, beyond]
        # A border edge, which has no face beyond, occludes wherever its one face is turned to the eye.
        if occluding.facing[image, mesh.edges[edge, 2]] != front_beyond:
            occluding.occluding_edges[image, first + edge_count] = edge
            vertices.used[image, mesh.edges[edge, 0]] = wp.uint8(1)
            vertices.used[image, mesh.edges[edge, 1]] = wp.uint8(1)
            edge_count += 1
    occluding.counts[image, part] = edge_count


@wp.struct
class Task:
    """Values shared by all edges of an image that a thread takes, which is a `source` of rows."""

    eye: Eye
    noise: Noise
    curvature: real
    differentiate: int
    images: int
    source: int


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
    # Coverage changes at the silhouette alone, not where the object hides parts of itself.
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
            add_row(
                image,
                task.source,
                edge,
                blend,
                on_a,
                on_b,
                photos.albedo[image],
                task.curvature,
                mesh,
                task.eye,
                normal_rows,
            )
    return vec4(total[0] + blend.taken * blend.gain, painted[0], painted[1], painted[2])


@wp.kernel(module=module)
def boundary(
    mesh: Mesh,
    view: View,
    vertices: Vertices,
    photos: Photos,
    keys: wp.array2d(dtype=wp.int64),
    occluding: Occluding,
    chunk: int,
    lines: int,
    curvature: real,
    differentiate: int,
    images: int,
    totals: Totals,
    cotangents: Cotangents,
    normal_rows: NormalRows,
    pictures: Pictures,
):
    """Of an image's occlusion edges as many as there are threads apart: the blending's part of Eq. 4, its
    gradient with differentiate >= 1, rows of the normal matrix with 2, after those of `lines` sources."""
    image, part = wp.tid()
    task = Task()
    task.eye = eye_of(image, view)
    task.noise = noise_of(photos.sigma[image])
    task.curvature = curvature
    task.differentiate = differentiate
    task.images = images
    task.source = lines + part
    total = vec4()
    threads = occluding.counts.shape[1]
    # Edges are dealt out in turn, as their lengths on the screen differ much from part to part of the mesh.
    index = part
    for source in range(threads):
        count = occluding.counts[image, source]
        while index < count:
            number = occluding.occluding_edges[image, source * chunk + index]
            index += threads
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
        index -= count
    totals.values[image, part] = total[0]
    totals.on_albedo[image, part] = vec3(total[1], total[2], total[3])
