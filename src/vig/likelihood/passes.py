"""One evaluation of Eq. 4 as a list of recorded kernel launches over buffers that are kept."""

from __future__ import annotations

import functools
import inspect
import weakref
from typing import TYPE_CHECKING, Any

import torch
import warp as wp

from vig.likelihood.kernels.layout import LANES
from vig.likelihood.kernels.load import CUDA_PARTS, PARTS, likelihood_kernels
from vig.search.native_descent import CLEAR, COMBINE, COPY, FILL, LAUNCH, PROJECT, SQUARE, Valuation
from vig_renderer import NOTHING, warp_array
from vig_renderer.device import Prepared, record
from vig_renderer.internals import group_fields, type_parts
from vig_renderer.raster import KEYS_MARGIN

if TYPE_CHECKING:
    from vig.likelihood.evaluate import Likelihood

BOUNDARY_ROWS = 16
"""Rows of the normal matrix kept for occlusion edges, per pixel of the image's width and height."""

LEAST_BOUNDARY_ROWS = 4096
"""Minimum of such rows: a small image may be full of edges."""

BOUNDARY_CURVATURE = 0.5
"""Share of an edge's gain per pixel that counts as curvature per pixel squared in the normal matrix."""


class Pass:
    """Evaluates B points of a `Likelihood` in buffers of its own; launches are recorded at their first use.

    On a GPU all goes to torch's current stream, nothing waits for a result, and after a first call nothing
    but tensors of torch is allocated: `torch.cuda.graph` can capture a call.

    The same pass serves other photos of the same geometry, size and settings: see `look_at`.

    value (B,) float64, gradient (B, P'), normal (B, P', P') and images (posterior, coverage, irradiance, each
    (B, H * W)) hold the last results; the next call overwrites them. So do all other buffers, by the names
    that the kernels' arguments have: screen (B, V, 3), and of the vertices in use normals (B, V, 3),
    irradiances (B, V) and their rows of derivatives, shape_rows and rest_rows.
    """

    def __init__(self, likelihood: Likelihood, count: int):
        geometry, camera = likelihood.geometry, likelihood.camera
        self.geometry, self.count, self.silhouette = geometry, count, likelihood.silhouette
        self.kind = count, *likelihood.kind
        self.layout, modes = geometry.layout, geometry.rows.modes
        self._kernels = k = likelihood_kernels(geometry.dtype, modes, likelihood.density)
        vertices, faces, edges = geometry.vertex_count, len(geometry.faces), len(geometry.edges)
        width, height, stride = camera.width, camera.height, likelihood.stride
        self._shared = {"vertices": vertices, "faces": faces, "edges": edges, "lines": height}
        self._shared["pixels"] = height * width
        self._down, across = -(-height // stride), -(-width // stride)
        edge_rows = max(LEAST_BOUNDARY_ROWS, BOUNDARY_ROWS * (width + height))
        # One thread after the other fills a single segment without gaps. Threads side by side have one each,
        # where their rows are in order; what they leave is zero and adds nothing to the product.
        self._alone = geometry.device == "cpu"
        # On a processor one thread takes an image, whose work is cut into parts that fit its cache.
        self._parts = PARTS if self._alone else CUDA_PARTS
        segments, length = 1, across * self._down + edge_rows
        if not self._alone:
            segments, length = self._down + self._parts, max(across, -(-edge_rows // self._parts))
        self._arguments: dict[str, Any] = {
            "width": width,
            "height": height,
            "stride": stride,
            "cull": 1,
            "lines": self._down,
            "curvature": BOUNDARY_CURVATURE,
            "shadowed": int(geometry.shadowed),
            "faces": geometry.faces_wp,
            "edges": geometry.edges_wp,
            "ring_start": geometry.ring_start_wp,
            "ring": geometry.ring_wp,
            "basis": geometry.basis_wp,
            "reflectance": geometry.reflectance_wp,
            "transfer_mean": geometry.transfer_mean_wp,
            "transfer_by_shape": geometry.transfer_by_shape_wp,
        }
        # Launches are recorded with no photos in place of the likelihood's, which they would keep alive.
        nothing = {
            name: wp.zeros((0,) * a.ndim, a.dtype, geometry.device)
            for name, a in likelihood.photo_arrays.items()
        }
        self._arguments |= likelihood.camera_arguments | nothing
        self._launches: list[tuple[Prepared, dict[str, Any]]] = []
        self.further_launches: dict[Any, Prepared] = {}  # of those who add to a `valuation`
        self.look_at(likelihood)
        made = self._buffer
        points = made("points", k.real, 1 + self.layout.size)
        points[:, 0] = 1.0
        self.points, self._blocks = points[:, 1:], self.layout.split(points[:, 1:])
        # The 1 before the shape coefficients takes the mean of what these are coefficients of.
        self._with_one = points[:, : 1 + self.layout["shape"].stop]
        self.albedo, self.photo = made("albedo", k.vec3), made("photo", wp.int32)
        self.sigma = made("sigma", k.real)
        (
            made("rotation", k.mat33),
            made("level", k.vec2),
            made("intrinsics", k.vec3),
            made("light", k.rest_row),
            made("coefficients", k.shape_row),
        )
        self.world, self.screen = made("world", k.vec3, vertices), made("screen", k.vec3, vertices)
        self.normals = made("normals", k.vec3, vertices)
        made("inverse_lengths", k.real, vertices), made("facing", wp.uint8, faces)
        self.irradiances = made("irradiances", k.real, vertices)
        self.shape_rows = made("shape_rows", k.shape_row, vertices)
        self.rest_rows = made("rest_rows", k.rest_row, vertices)
        self.keys = made("keys", wp.int64, height * width + KEYS_MARGIN)
        made("occluding_edges", wp.int32, edges)
        self.row_counts, self.used = made("row_counts", wp.int32, segments), made("used", wp.uint8, vertices)
        self.on_world = made("on_world", k.vec3, vertices)
        made("counts", wp.int32, self._parts)
        self._cleared = [self.row_counts, self.used, self.on_world]
        self._cleared += [made("on_corner", k.vec4, vertices), made("on_normal", k.vec3, vertices)]
        self.rows = self._rows(segments * length)
        if not self._alone:
            self._cleared.append(self.rows)
        for source in ("line", "edge"):
            made(f"{source}_values", k.real, self._parts), made(f"{source}_albedo", k.vec3, self._parts)
        made("sums", k.rest_row, self._parts), made("shadow_sums", k.shape_row, self._parts)
        self.shape_gradient = made("shape_gradient", k.real, modes)
        self.products = made("products", k.real, geometry.rows.width, geometry.rows.width)
        self.value = made("value", wp.float64)
        self.gradient = made("gradient", k.real, self.layout.size)
        self.normal = made("normal", k.real, self.layout.size, self.layout.size)
        self.images = [made(name, k.real, height * width) for name in ("posterior", "coverage", "irradiance")]
        self._columns = torch.tensor(geometry.rows.columns(), dtype=torch.int32, device=geometry.device)
        self._arguments["columns"] = warp_array(self._columns, wp.int32)
        shadowed = vertices if geometry.shadowed else 1
        made("lobe_changes", k.lobe_vector, shadowed), made("shadow_rates", k.shape_row, shadowed)
        self._look = self._record("look", count)
        self._assemble = self._record("assemble", (count, self.layout.size))
        self._program = functools.cache(self._recorded)

    def look_at(self, likelihood: Likelihood) -> None:
        """Take photos and camera of a likelihood, which differs from the one before in nothing else.

        The likelihood keeps them: a pass that outlives it refers to none of them.
        """
        self._likelihood = weakref.ref(likelihood)
        self._arguments |= likelihood.camera_arguments
        groups: dict[str, Any] = {}
        for launch, names in self._launches:
            self._exchange(launch, names, likelihood, groups)

    def looks_at(self, likelihood: Likelihood) -> bool:
        """Whether this pass holds the photos of `likelihood`."""
        return self._likelihood() is likelihood

    def _exchange(
        self, launch: Prepared, arguments: dict[str, Any], likelihood: Likelihood, groups: dict[str, Any]
    ) -> None:
        """groups: structs of the likelihood's arguments that were made, by name."""
        given = likelihood.camera_arguments | likelihood.photo_arrays
        for index, (name, argument) in enumerate(arguments.items()):
            if name in given:
                launch.exchange(index, given[name])
            elif name in self._kernels.structs and not given.keys().isdisjoint(group_fields(argument)):
                if name not in groups:
                    groups[name] = self._group(name, self._arguments | given)
                launch.exchange(index, groups[name])

    def __call__(
        self, points: torch.Tensor, photo: torch.Tensor, sigma: torch.Tensor, derivatives: int, images: bool
    ) -> None:
        """Evaluate points (B, P') of photos (B,) under noise sigma (B,).

        derivatives: 0 for the value alone, 1 for the gradient, too, 2 for the normal matrix as well.
        """
        self.points.copy_(points)
        self.albedo.copy_(self._blocks["albedo"])
        self.photo.copy_(photo)
        self.sigma.copy_(sigma)
        if images:
            for image in self.images:
                image.zero_()
        self.keys.fill_(NOTHING)
        for cleared in self._cleared:
            cleared.zero_()
        self._look()
        # World places of all vertices: (1, coefficients) times (mean, components), Eq. 1.
        torch.mm(self._with_one, self.geometry.positions, out=self.world.view(self.count, -1))
        for launch in self._program(derivatives, images):
            launch()
        if derivatives:
            on_world = self.on_world.view(self.count, -1)
            # And back: a cotangent on a place is one on each coefficient by its component.
            torch.mm(on_world, self.geometry.positions[1:].T, out=self.shape_gradient)
            if derivatives > 1 and not self._alone:
                torch.bmm(self.rows.mT, self.rows, out=self.products)
            elif derivatives > 1:
                # Rows are not padded on a processor: the product is of those that were written.
                filled = self.row_counts[:, 0].tolist()
                for rows, count, product in zip(self.rows, filled, self.products, strict=True):
                    rows_used = rows[: min(count, len(rows))]
                    torch.mm(rows_used.T, rows_used, out=product)
            self._assemble()

    def valuation(self, derivatives: bool) -> Valuation | None:
        """How native code values the first point once photo and sigma are set, with derivatives or alone.

        None on a GPU and where launches have no addresses.
        """
        launches = [self._look, self._assemble, *self._program(2 if derivatives else 0, False)]
        addresses = [launch.addresses for launch in launches]
        if not self._alone or None in addresses:
            return None
        look, assemble, *between = [(LAUNCH, *address) for address in addresses if address is not None]
        positions, world = self.geometry.positions, self.world.view(self.count, -1)
        lines, across = positions.shape

        at, on_world, rows = torch.Tensor.data_ptr, self.on_world, self.rows[0]
        assert self.geometry.rows.width % LANES == 0, "native code multiplies by whole vectors"
        steps = [
            (COPY, at(self.albedo), at(self._blocks["albedo"]), 3),
            (FILL, at(self.keys), self.keys[0].numel(), NOTHING),
            *((CLEAR, at(each), each[0].nbytes) for each in self._cleared),
            look,
            (COMBINE, at(world), at(self._with_one), at(positions), lines, across),
            *between,
        ]
        if derivatives:
            steps += [
                (PROJECT, at(self.shape_gradient), at(on_world), at(positions[1:]), lines - 1, across),
                (SQUARE, at(self.products), at(rows), at(self.row_counts), *rows.shape),
                assemble,
            ]
        results = self.value[:1], self.gradient[:1], self.normal[:1]
        return Valuation(self.points[0], *results, steps, self.further_launches)

    def _recorded(self, derivatives: int, images: bool) -> list[Prepared]:
        """The launches between placing the vertices in the world and the last matrix products."""
        parts = self.count, self._parts
        line = {"values": "line_values", "on_albedo": "line_albedo"}
        edge = {"values": "edge_values", "on_albedo": "edge_albedo"}
        flags, exact = {"differentiate": derivatives, "images": int(images)}, self.silhouette == "exact"
        steps = [
            self._record("place", parts, "vertices"),
            self._record("rasterize_faces", parts, "faces"),
            *([self._record("collect_edges", parts, "edges")] if exact else []),
            self._record("use_seen", parts, "pixels"),
            self._record("shade", parts, "vertices", flags),
            self._record("interior", parts, "lines", flags, line),
        ]
        if derivatives > 1:
            steps.append(self._record("interior_rows", (self.count, self._down)))
        if exact:
            steps.append(self._record("boundary", parts, "edges", flags, edge))
        if derivatives:
            steps.append(self._record("unshade", parts, "vertices"))
        steps.append(self._record("add_values", self.count))
        return steps

    def _record(
        self,
        name: str,
        dim: int | tuple[int, ...],
        shared_out: str | None = None,
        values: dict[str, Any] | None = None,
        renamed: dict[str, str] | None = None,
    ) -> Prepared:
        """Record a launch of a kernel, whose arguments are found by their names.

        shared_out: of what each thread takes a `chunk`. values: further arguments. renamed: which buffer
        stands for an argument of another name.
        """
        k, arguments = self._kernels, dict(self._arguments)
        kernel = getattr(k, name)
        arguments |= {argument: self._arguments[buffer] for argument, buffer in (renamed or {}).items()}
        arguments |= values or {}
        if shared_out is not None:
            arguments["chunk"] = -(-self._shared[shared_out] // self._parts)
        names = list(inspect.signature(kernel.func).parameters)
        arguments = {
            name: self._group(name, arguments) if name in k.structs else arguments[name] for name in names
        }
        inputs = list(arguments.values())
        launch = Prepared(record(kernel, dim, inputs, self.geometry.device))
        self._launches.append((launch, arguments))
        looked_at = self._likelihood()
        assert looked_at is not None
        self._exchange(launch, arguments, looked_at, {})
        return launch

    def _group(self, name: str, arguments: dict[str, Any]) -> Any:
        """A struct of arguments, whose fields are found by their names."""
        group = self._kernels.structs[name]
        made = group()
        for field in group_fields(group):
            setattr(made, field, arguments[field])
        return made

    def _buffer(self, name: str, kind: Any, *shape: int) -> torch.Tensor:
        """A kept tensor (B, *shape), with the kind's own axes behind, found by kernels by its name."""
        scalar, own = type_parts(kind)
        dtype = wp.dtype_to_torch(scalar)
        made = torch.zeros(self.count, *shape, *own, dtype=dtype, device=self.geometry.device)
        self._arguments[name] = warp_array(made, kind)
        return made

    def _rows(self, capacity: int) -> torch.Tensor:
        """Rows of the normal matrix (B, capacity, width), which kernels write in two parts."""
        geometry, k = self.geometry, self._kernels
        shape, width = geometry.rows.shape, geometry.rows.width
        rows = torch.zeros(self.count, capacity, width, dtype=geometry.dtype, device=geometry.device)
        self._arguments["normal_shape"] = warp_array(rows[..., :shape], k.shape_row)
        self._arguments["normal_rest"] = warp_array(rows[..., shape:], k.rest_row)
        return rows
