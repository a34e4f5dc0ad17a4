"""One evaluation of Eq. 4 as a list of recorded kernel launches over buffers that are kept."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any

import torch
import warp as wp

from vig.likelihood.kernels import PARTS, likelihood_kernels
from vig.render import NOTHING, warp_array
from vig.render.device import prepared
from vig.render.raster import KEYS_MARGIN
from vig.render.surface import LANES
from vig.scene.light import L_COUNT

if TYPE_CHECKING:
    from vig.likelihood.evaluate import Likelihood

BOUNDARY_ROWS = 4096
"""Rows of the normal matrix kept for occlusion edges, beyond those of the pixels."""


class Pass:
    """Evaluates B points of one `Likelihood`; nothing is allocated after it is made.

    value (B,) float64, gradient (B, P'), normal (B, P', P') and images (posterior, coverage, irradiance, each
    (B, H * W)) hold the last results; the next call overwrites them. So do screen (B, V, 3), and of the
    vertices in use (B, V): normals (B, V, 3), irradiances (B, V), and their rows of derivatives.
    """

    def __init__(self, likelihood: Likelihood, count: int):
        from vig.likelihood.evaluate import BOUNDARY_CURVATURE

        geometry, camera = likelihood.geometry, likelihood.camera
        self.geometry, self.count = geometry, count
        dtype, device, layout = geometry.dtype, geometry.device, geometry.layout
        k = likelihood_kernels(dtype, layout.modes)
        vertices, faces, edges = geometry.vertex_count, len(geometry.faces), len(geometry.edges)
        width, height = camera.width, camera.height
        size, stride = height * width, likelihood.stride

        def tensor(*shape: int, kind: torch.dtype = dtype) -> torch.Tensor:
            return torch.zeros(count, *shape, dtype=kind, device=device)

        def vectors(*shape: int) -> tuple[torch.Tensor, wp.array]:
            made = tensor(*shape, 3)
            return made, warp_array(made, k.vec3)

        def numbers(*shape: int, kind: torch.dtype = dtype) -> tuple[torch.Tensor, wp.array]:
            made = tensor(*shape, kind=kind)
            return made, warp_array(made, _WARP.get(kind, k.real))

        self.inputs = tensor(1 + layout.size)
        self.inputs[:, 0] = 1.0
        inputs = warp_array(self.inputs, k.real)
        self.albedo, albedo = vectors()
        self.photo, photo = numbers(kind=torch.int32)
        self.sigma, sigma = numbers()
        self.world, world = vectors(vertices)
        rotation = warp_array(tensor(3, 3), k.mat33)
        intrinsics, light = vectors()[1], warp_array(tensor(LANES), k.rest_row)
        self.screen, screen = vectors(vertices)
        self.normals, normals = vectors(vertices)
        inverse_lengths = numbers(vertices)[1]
        self.irradiances, irradiances = numbers(vertices)
        on_corner_, (on_normal_, on_normal) = tensor(vertices, 4), vectors(vertices)
        on_corner = warp_array(on_corner_, k.vec4)
        self.on_world, on_world = vectors(vertices)
        self.used, used = numbers(vertices, kind=torch.uint8)
        facing = numbers(faces, kind=torch.uint8)[1]
        self.keys, keys = numbers(size + KEYS_MARGIN, kind=torch.int64)
        rim_count_, rim_count = numbers(kind=torch.int32)
        rims = numbers(edges, kind=torch.int32)[1]
        self.row_count, row_count = numbers(kind=torch.int32)
        self._cleared = [on_corner_, on_normal_, self.on_world, self.used, rim_count_, self.row_count]
        across, down = -(-width // stride), -(-height // stride)
        self.rows = tensor(across * down + BOUNDARY_ROWS, layout.width)
        rows_shape = warp_array(self.rows[..., : layout.shape], k.shape_row)
        rows_rest = warp_array(self.rows[..., layout.shape :], k.rest_row)
        self.shape_rows, self.rest_rows = tensor(vertices, layout.shape), tensor(vertices, LANES)
        shape_rows = warp_array(self.shape_rows, k.shape_row)
        rest_rows = warp_array(self.rest_rows, k.rest_row)
        line_values, edge_values = numbers(PARTS)[1], numbers(PARTS)[1]
        line_albedo, edge_albedo = vectors(PARTS)[1], vectors(PARTS)[1]
        sums = warp_array(tensor(PARTS, LANES), k.rest_row)
        self.shape_gradient, shape_gradient = numbers(layout.modes)
        self.products, products = numbers(layout.width, layout.width)
        self.gradient, gradient = numbers(layout.size)
        self.normal, normal = numbers(layout.size, layout.size)
        self.value, value = numbers(kind=torch.float64)
        # Images are written where they are asked for only: until then they stay small.
        self.images = [tensor(size) for _ in range(3)]
        images = [warp_array(image, k.real) for image in self.images]
        columns = torch.tensor(layout.columns(), dtype=torch.int32, device=device)
        columns_wp = warp_array(columns, wp.int32)
        background = warp_array(likelihood.background, wp.float64)
        self._kept: list[Any] = [columns]
        self.shadow_rates, shadow_rates = numbers(1, 1)
        self.on_light, on_light = numbers(1)
        lobes = warp_array(tensor(1, L_COUNT), k.lobe_vector)
        shadowed = geometry.transfer is not None
        if shadowed:
            self.lobes = tensor(vertices, L_COUNT)
            lobes = warp_array(self.lobes, k.lobe_vector)
            self.shadow_rates, shadow_rates = numbers(layout.modes + 1, vertices)
            self.on_light, on_light = numbers(vertices)
            self._cleared.append(self.on_light)
        shadow = [int(shadowed), lobes]
        chunk = -(-vertices // PARTS)
        shared = [rotation, intrinsics, camera.distance]
        scene = [*shared, albedo, keys, likelihood.observed_wp, likelihood.log_prior_wp, photo, sigma]

        def record(kernel: wp.Kernel, dim: int | tuple[int, ...], arguments: list) -> Any:
            command = wp.launch(kernel, dim, arguments, device=device, record_cmd=True)
            self._kept.append((arguments, command))
            return prepared(command)

        self._look = record(
            k.look,
            count,
            [
                inputs,
                k.vec3(camera.focal, camera.cx, camera.cy),
                width,
                rotation,
                intrinsics,
                light,
            ],
        )

        def program(derivatives: int, shown: bool) -> list:
            steps = [
                record(
                    k.place,
                    (count, PARTS),
                    [
                        world,
                        rotation,
                        intrinsics,
                        k.vec3(0.0, 0.0, camera.target_height),
                        camera.distance,
                        chunk,
                        screen,
                    ],
                ),
                record(
                    k.rasterize_faces,
                    (count, PARTS),
                    [screen, geometry.faces_wp, -(-faces // PARTS), width, height, 1, keys, facing, used],
                ),
                record(
                    k.shade,
                    (count, PARTS),
                    [
                        world,
                        used,
                        light,
                        geometry.ring_start_wp,
                        geometry.ring_wp,
                        geometry.basis_wp,
                        *shadow,
                        shadow_rates,
                        chunk,
                        derivatives,
                        normals,
                        inverse_lengths,
                        irradiances,
                        shape_rows,
                        rest_rows,
                    ],
                ),
                record(
                    k.interior,
                    (count, PARTS),
                    [
                        screen,
                        irradiances,
                        geometry.faces_wp,
                        width,
                        -(-height // PARTS),
                        *scene[3:],
                        derivatives,
                        shown,
                        line_values,
                        line_albedo,
                        on_corner,
                        *images,
                    ],
                ),
            ]
            if derivatives > 1:
                steps.append(
                    record(
                        k.interior_rows,
                        (count, down),
                        [
                            screen,
                            irradiances,
                            shape_rows,
                            rest_rows,
                            geometry.basis_wp,
                            geometry.faces_wp,
                            width,
                            stride,
                            *shared,
                            keys,
                            sigma,
                            images[0],
                            row_count,
                            rows_shape,
                            rows_rest,
                        ],
                    )
                )
            if likelihood.silhouette == "exact":
                steps += [
                    record(
                        k.collect_rims,
                        (count, PARTS),
                        [geometry.edges_wp, -(-edges // PARTS), facing, rim_count, rims],
                    ),
                    record(
                        k.boundary,
                        (count, PARTS),
                        [
                            screen,
                            normals,
                            irradiances,
                            geometry.basis_wp,
                            geometry.faces_wp,
                            geometry.edges_wp,
                            facing,
                            rim_count,
                            rims,
                            PARTS,
                            width,
                            height,
                            *scene,
                            BOUNDARY_CURVATURE,
                            derivatives,
                            shown,
                            edge_values,
                            edge_albedo,
                            on_corner,
                            on_normal,
                            row_count,
                            rows_shape,
                            rows_rest,
                            images[1],
                        ],
                    ),
                ]
            if derivatives:
                steps.append(
                    record(
                        k.unshade,
                        (count, PARTS),
                        [
                            world,
                            screen,
                            used,
                            light,
                            *shared,
                            width,
                            geometry.ring_start_wp,
                            geometry.ring_wp,
                            *shadow,
                            chunk,
                            normals,
                            inverse_lengths,
                            irradiances,
                            on_corner,
                            on_normal,
                            on_world,
                            on_light,
                            sums,
                        ],
                    )
                )
            steps.append(record(k.add_values, count, [line_values, edge_values, background, photo, value]))
            return steps

        self._program = functools.cache(program)
        self._assemble = record(
            k.assemble,
            (count, layout.size),
            [
                columns_wp,
                shape_gradient,
                sums,
                line_albedo,
                edge_albedo,
                albedo,
                products,
                gradient,
                normal,
            ],
        )

    def __call__(
        self, points: torch.Tensor, photo: torch.Tensor, sigma: torch.Tensor, derivatives: int, images: bool
    ) -> None:
        """Evaluate points (B, P') of photos (B,) under noise sigma (B,).

        derivatives: 0 for the value alone, 1 for the gradient, too, 2 for the normal matrix as well.
        """
        modes = self.geometry.layout.modes
        self.inputs[:, 1:] = points
        self.albedo.copy_(self.inputs[:, modes + 3 : modes + 6])
        self.photo.copy_(photo)
        self.sigma.copy_(sigma)
        if images:
            for image in self.images:
                image.zero_()
        self.keys.fill_(NOTHING)
        for cleared in self._cleared:
            cleared.zero_()
        self._look()
        torch.mm(self.inputs[:, : modes + 1], self.geometry.positions, out=self.world.view(self.count, -1))
        transfer = self.geometry.transfer
        if transfer is not None:
            light = self.inputs[:, modes + 6 : modes + 15]
            torch.mm(self.inputs[:, : modes + 1], transfer, out=self.lobes.view(self.count, -1))
            torch.mm(light, transfer.view(-1, L_COUNT).T, out=self.shadow_rates.view(self.count, -1))
        for launch in self._program(derivatives, images):
            launch()
        if derivatives:
            on_world = self.on_world.view(self.count, -1)
            torch.mm(on_world, self.geometry.positions[1:].T, out=self.shape_gradient)
            if transfer is not None:
                rates = self.shadow_rates[:, 1:]
                self.shape_gradient += (rates @ self.on_light[:, :, None])[:, :, 0]
            if derivatives > 1:
                filled = self.row_count.tolist()
                for rows, count, product in zip(self.rows, filled, self.products, strict=True):
                    kept = rows[: min(count, len(rows))]
                    torch.mm(kept.T, kept, out=product)
            self._assemble()


_WARP = {
    torch.int32: wp.int32,
    torch.int64: wp.int64,
    torch.uint8: wp.uint8,
    torch.float64: wp.float64,
}
