import os
from collections.abc import Callable
from dataclasses import fields, replace
from functools import partial

import numpy as np
import pytest
import torch
import trimesh

from tests.vig_renderer.conftest import World
from vig.scene import Camera, ObjectClass
from vig_renderer import (
    DirectionalLight,
    MeshObject,
    Pinhole,
    Rendering,
    Scene,
    Topology,
    jacobian,
    pyramid,
    render,
)
from vig_renderer.shading import smooth_normals
from vig_world.raster.rasterize import rasterize

SCENES = int(os.environ.get("VIG_GRADIENT_SCENES", "2"))
"""Random scenes whose every input is checked against central differences."""

AHEAD = Pinhole(40, 30, torch.tensor([50.0, 50]), torch.tensor([20.0, 15]), torch.eye(3), torch.zeros(3))


def ball(
    at: tuple[float, float, float], colour: tuple[float, float, float], radius: float = 0.1
) -> MeshObject:
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    return MeshObject(
        torch.tensor(mesh.vertices, dtype=torch.float32),
        Topology.of(mesh.faces, mesh.vertices),
        torch.tensor(colour),
        translation=torch.tensor(at),
    )


def numbers(rendering: Rendering) -> list[torch.Tensor]:
    """Everything that has a derivative, finite."""
    depth = torch.where(rendering.depth.isinf(), 0.0, rendering.depth)
    masks = rendering.full_masks, rendering.visible_masks, rendering.coverage
    return [rendering.rgb, *masks, depth, rendering.normals]


def check_gradients(made: World, rng: np.random.Generator, shading: str, samples: int) -> None:
    """Reverse derivative against central differences, for every input in a random direction; forward too."""
    weights: list[torch.Tensor] = []

    def loss(values: dict[str, torch.Tensor]) -> torch.Tensor:
        # Depth and normals, of the pixels' centres, jump at silhouettes: another test has them.
        images = numbers(render(made.build(values), shading, samples))[:4]
        if not weights:
            weights.extend(torch.from_numpy(rng.normal(size=image.shape)) for image in images)
        return sum((w * image).sum() for w, image in zip(weights, images, strict=True))

    def along(name: str, step: torch.Tensor) -> torch.Tensor:
        return loss({**made.inputs, name: made.inputs[name] + step})

    leaves = {name: value.clone().requires_grad_() for name, value in made.inputs.items()}
    gradients = torch.autograd.grad(loss(leaves), list(leaves.values()))
    for name, gradient in zip(leaves, gradients, strict=True):
        random = torch.from_numpy(rng.normal(size=gradient.shape))
        if not gradient.any():  # an object that is hidden altogether
            assert along(name, 1e-6 * random) == along(name, -1e-6 * random), name
            continue
        direction = gradient / gradient.norm() + 0.5 * random / random.norm()
        analytic = float((gradient * direction).sum())
        _, forward = torch.func.jvp(partial(along, name), (torch.zeros_like(direction),), (direction,))
        assert float(forward) == pytest.approx(analytic, rel=1e-8), name
        # Large steps may meet a jump (a T-junction), small ones are rounded off: one of them must agree.
        errors = []
        for step in (1e-6, 1e-7, 1e-8, 1e-5):
            numeric = float(along(name, step * direction) - along(name, -step * direction)) / (2 * step)
            errors.append(abs(numeric / analytic - 1))
            if errors[-1] < 1e-4:
                break
        assert min(errors) < 1e-4, (name, errors)


@pytest.mark.parametrize(("shading", "samples"), [("vertex", 1), ("pixel", 2)])
def test_every_input_has_the_derivative_of_central_differences(
    world: Callable[..., World], shading: str, samples: int
) -> None:
    for number in range(SCENES):
        rng = np.random.default_rng([7, number])
        check_gradients(world(rng), rng, shading, samples)


def test_depth_and_normals_have_derivatives_inside(world: Callable[..., World]) -> None:
    made = world(np.random.default_rng(3))
    rotation = made.inputs["front rotation"]
    inside = render(made.scene).visible_masks[0, 0] == 1

    def total(angle: torch.Tensor) -> torch.Tensor:
        c, s, zero = torch.cos(angle), torch.sin(angle), torch.zeros_like(angle)
        turn = torch.stack([c, -s, zero, s, c, zero, zero, zero, torch.ones_like(angle)]).view(3, 3)
        seen = render(made.build({**made.inputs, "front rotation": turn @ rotation}))
        return seen.depth[0][inside].sum() + seen.normals[0][inside].sum(0) @ seen.normals.new_tensor(
            [1, 2, 3]
        )

    angle = torch.zeros((), dtype=torch.float64, requires_grad=True)
    (analytic,) = torch.autograd.grad(total(angle), angle)
    numeric = (total(angle + 1e-6) - total(angle - 1e-6)).detach() / 2e-6
    torch.testing.assert_close(analytic, numeric, rtol=1e-5, atol=0)


def silhouette_gradients(made: World, rng: np.random.Generator) -> tuple[list[float], list[float]]:
    """A loss on flat colours by the front object's place: its gradient, and that of 8 x 8 samples a pixel."""
    k = torch.from_numpy(rng.normal(0, 0.15, (2, 3)))
    y, x = torch.meshgrid(torch.arange(32.0), torch.arange(32.0), indexing="ij")
    weights = torch.sin(x[..., None] * k[0] + y[..., None] * k[1] + torch.from_numpy(rng.uniform(0, 6, 3)))

    def loss(place: torch.Tensor, samples: int) -> torch.Tensor:
        scene = made.build({**made.inputs, "front translation": place})
        objects = [replace(item, light=None, texture=None) for item in scene.objects]
        objects[1] = replace(objects[1], albedo=objects[1].albedo[0])
        flat = replace(scene, objects=objects, lamp=None, background=made.inputs["background"][0, 0])
        return (weights * render(flat, samples=samples).rgb[0]).sum()

    place = made.inputs["front translation"].clone().requires_grad_()
    found = torch.autograd.grad(loss(place, 1), place)[0].tolist()
    place = place.detach()
    steps = torch.eye(3, dtype=torch.float64) * 0.003  # a third of a pixel
    return found, [float(loss(place + step, 8) - loss(place - step, 8)) / 0.006 for step in steps]


def test_a_silhouettes_gradient_is_that_of_a_finely_sampled_image(world: Callable[..., World]) -> None:
    # Smooth weights on flat colours: all of the gradient comes from edges.
    rng = np.random.default_rng(5)
    found, expected = np.concatenate([silhouette_gradients(world(rng), rng) for _ in range(12)], axis=1)
    assert (found @ expected) / (expected @ expected) == pytest.approx(1, abs=0.03)
    assert np.corrcoef(found, expected)[0, 1] > 0.99


def test_blended_images_are_those_of_many_samples(world: Callable[..., World]) -> None:
    rng = np.random.default_rng(6)
    for _ in range(3):
        made = world(rng, dtype=torch.float32)
        once, often = render(made.scene), render(made.scene, samples=8)
        plain = (once.object_id == 0).float() - often.visible_masks[:, 0]
        blended = once.visible_masks[:, 0] - often.visible_masks[:, 0]
        assert blended.square().sum() < 0.2 * plain.square().sum()
        for masks in ("visible_masks", "full_masks"):
            areas = getattr(once, masks).sum((2, 3)) - getattr(often, masks).sum((2, 3))
            assert areas.abs().max() < 1.5


def test_ids_depth_and_masks_say_what_is_seen() -> None:
    near, far = ball((0.0, 0, 0.5), (1.0, 0, 0)), ball((0.05, 0, 1), (0.0, 1, 0), 0.15)
    seen = render(Scene([far, near], AHEAD, background=torch.tensor([0.0, 0, 1])))
    assert seen.object_id[0, 15, 20] == 1 and seen.object_id[0, 0, 0] == -1
    assert seen.depth[0, 15, 20] == pytest.approx(0.4, abs=2e-3) and seen.depth[0, 0, 0].isinf()
    torch.testing.assert_close(seen.normals[0, 15, 20], torch.tensor([0.0, 0, -1]), atol=0.1, rtol=0)
    # No light: the colours are the albedos, and blended pixels mixtures of what is seen in them.
    colours = torch.tensor([[0.0, 1, 0], [1, 0, 0]])
    mixed = torch.einsum("bohw,oc->bhwc", seen.visible_masks, colours)
    mixed += (1 - seen.coverage)[..., None] * torch.tensor([0.0, 0, 1])
    torch.testing.assert_close(seen.rgb, mixed)
    assert (seen.visible_masks.sum(1) - seen.coverage).abs().max() < 1e-6
    # The full mask of a hidden ball is its disc: radius f r / sqrt(d^2 - r^2).
    for number, (distance, radius) in enumerate([(1, 0.15), (0.5, 0.1)]):
        disc = np.pi * (50 * radius) ** 2 / (distance**2 - radius**2)
        assert seen.full_masks[0, number].sum() == pytest.approx(disc, rel=0.04)
    assert (seen.full_masks[0, 1] - seen.visible_masks[0, 1]).abs().max() < 1e-6
    assert seen.visible_masks[0, 0].sum() < 0.8 * seen.full_masks[0, 0].sum()


def test_what_is_seen_is_what_the_rasteriser_sees(teapot: ObjectClass) -> None:
    camera = Camera.standard(target_height=teapot.target_height)
    model = teapot.shape_model
    item = MeshObject(torch.tensor(model.mean), Topology.of(model.faces, model.mean), torch.ones(3))
    view = Pinhole.on_sphere(camera, torch.tensor(0.7), torch.tensor(0.4))
    seen = render(Scene([item], view))
    expected = rasterize(model.mean, model.faces, view.rotation.numpy(), view.translation.numpy(), camera)
    assert (seen.triangle_id[0].numpy() != expected.face).mean() < 2e-3
    same = (seen.triangle_id[0].numpy() == expected.face) & (expected.face >= 0)
    np.testing.assert_allclose(seen.depth[0].numpy()[same], expected.depth[same], atol=1e-4)


def test_a_batch_is_its_images_one_by_one(world: Callable[..., World]) -> None:
    rng = np.random.default_rng(8)
    scenes = [world(rng).scene for _ in range(3)]
    scenes[1] = replace(scenes[1], objects=[], background=torch.rand(3, dtype=torch.float64))
    scenes[2] = replace(scenes[2], objects=scenes[2].objects[:1], background=None, lamp=None)
    for shading in ("vertex", "pixel"):
        together = render(scenes, shading)
        assert together.visible_masks.shape == (3, 2, 32, 32)
        for number, scene in enumerate(scenes):
            alone = render(scene, shading)
            for entry in fields(Rendering):
                mine, theirs = getattr(together, entry.name)[number], getattr(alone, entry.name)[0]
                if "masks" in entry.name:
                    assert not mine[len(scene.objects) :].any()
                    mine = mine[: len(scene.objects)]
                torch.testing.assert_close(mine, theirs)


def test_light_reaches_the_picture(world: Callable[..., World]) -> None:
    # A white ball seen from the front under light from behind the eye is as bright as the light says.
    item = replace(ball((0.0, 0, 0.5), (1.0, 1, 1)), light=torch.zeros(9))
    lamp = DirectionalLight(torch.tensor([0.0, 0, -3]), torch.tensor([0.3, 0.6, 0.9]))
    for shading in ("vertex", "pixel"):
        seen = render(Scene([item], AHEAD, lamp), shading).rgb[0, 15, 20]
        torch.testing.assert_close(seen, lamp.radiance, atol=0.01, rtol=0)
    assert not render(Scene([item], AHEAD)).rgb.any()  # a light of nothing is dark, no light is none


def test_a_texture_is_seen_in_perspective_and_far_away_as_its_mean() -> None:
    checks = torch.kron(torch.tensor([[0.0, 1], [1, 0]]).repeat(32, 32), torch.ones(1, 1))[..., None].expand(
        -1, -1, 3
    )
    corners = torch.tensor([[-1.0, 0.1, 0.2], [1, 0.1, 0.2], [1, 0.1, 40], [-1, 0.1, 40]])
    floor = MeshObject(
        corners,
        Topology.of(np.array([[0, 1, 2], [0, 2, 3]]), corners.numpy()),
        torch.ones(3),
        texture=pyramid(checks),
        texture_coordinates=torch.tensor([[0.0, 0], [1, 0], [1, 20], [0, 20]]),
    )
    seen = render(Scene([floor], AHEAD)).rgb[0, ..., 0]
    torch.testing.assert_close(seen[17, 15:25], torch.full((10,), 0.5), atol=0.02, rtol=0)
    half = replace(floor, texture=pyramid(torch.cat([torch.zeros(4, 8, 3), torch.ones(4, 8, 3)])))
    row = render(Scene([half], AHEAD)).rgb[0, 25, 20, 0]
    depth = 50 * 0.1 / 10.5  # of the floor in row 25
    v = (depth - 0.2) / 39.8 * 20  # linear in depth: v = 0.14, in the lower, white half of the image
    assert row.item() == pytest.approx(1.0) and 0 < v < 0.5


def test_the_jacobian_of_a_picture_is_that_of_its_rows(world: Callable[..., World]) -> None:
    made = world(np.random.default_rng(11), size=12)

    def picture(place: torch.Tensor) -> torch.Tensor:
        return render(made.build({**made.inputs, "front translation": place})).rgb

    value, rates = jacobian(picture, made.inputs["front translation"])
    assert rates.shape == (*value.shape, 3)
    expected = torch.autograd.functional.jacobian(picture, made.inputs["front translation"])
    torch.testing.assert_close(rates, expected)
    with pytest.raises(ValueError, match=r"\(P,\)"):
        jacobian(picture, torch.zeros(1, 3))


def test_what_cannot_be_drawn_is_refused(world: Callable[..., World]) -> None:
    """Other refusals are those of tests/vig/test_refusals.py."""
    made = world(np.random.default_rng(12))
    for name, value in made.inputs.items():
        broken = value.clone()
        broken.view(-1)[-1] = torch.nan
        with pytest.raises(
            ValueError, match="must be finite; 1 of" if name != "texture" else "must be finite"
        ):
            render(made.build({**made.inputs, name: broken}))
    with pytest.raises(ValueError, match="corners up to"):
        render(made.build({**made.inputs, "texture coordinates": made.inputs["texture coordinates"][:-1]}))


def test_an_image_is_the_crop_of_a_larger_one(world: Callable[..., World]) -> None:
    # Edges that leave the image are blended in its outermost pixels like anywhere else.
    made = world(np.random.default_rng(13))
    inputs = {**made.inputs, "centre": torch.tensor([5.0, 8], dtype=torch.float64)}
    scene = replace(made.build(inputs), background=torch.rand(3, dtype=torch.float64))
    camera = replace(scene.camera, width=44, height=40, centre=scene.camera.centre + torch.tensor([7.0, 3]))
    small, large = render(scene), render(replace(scene, camera=camera))
    assert small.coverage[0, 0].any() or small.coverage[0, :, 0].any()
    torch.testing.assert_close(small.rgb, large.rgb[:, 3:35, 7:39])
    torch.testing.assert_close(small.full_masks, large.full_masks[..., 3:35, 7:39])


@pytest.mark.parametrize("samples", [1, 3])
def test_the_background_is_where_nothing_is(samples: int) -> None:
    background = torch.rand(30, 40, 3)
    scene = Scene([ball((0.0, 0, 0.5), (1.0, 0, 0))], AHEAD, background=background)
    seen = render(scene, samples=samples)
    bare = seen.coverage[0] == 0
    assert 0.5 < bare.float().mean() < 0.9
    torch.testing.assert_close(seen.rgb[0][bare], background[bare])


def test_normals_given_with_an_object_turn_with_it(world: Callable[..., World]) -> None:
    made = world(np.random.default_rng(14))
    item = made.scene.objects[0]
    own = smooth_normals(item.vertices, item.topology.faces)
    with_normals = replace(made.scene, objects=[replace(item, normals=2 * own), made.scene.objects[1]])
    torch.testing.assert_close(render(with_normals).rgb, render(made.scene).rgb)
    turned = replace(item, normals=own.roll(1, dims=1))
    assert not torch.equal(render(replace(made.scene, objects=[turned])).rgb, render(made.scene).rgb)


@pytest.mark.parametrize("shading", ["vertex", "pixel"])
def test_second_derivatives_are_exact_where_no_edge_appears(shading: str) -> None:
    """Of a loss of two balls, one before the other, against central differences of its first derivative."""
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    vertices, topology = torch.from_numpy(np.array(mesh.vertices)), Topology.of(mesh.faces, mesh.vertices)
    light = torch.tensor([2.4, 0.3, 1.0, -0.6, 0.1, -0.2, 0.2, 0.1, -0.1]).double()
    kinds = {field.name: getattr(AHEAD, field.name) for field in fields(AHEAD)}
    camera = Pinhole(
        *(value.double() if isinstance(value, torch.Tensor) else value for value in kinds.values())
    )

    def slope(moved: torch.Tensor) -> torch.Tensor:
        moved = moved if moved.requires_grad else moved.clone().requires_grad_()
        colour, behind = torch.ones(3).double(), torch.tensor([0.03, 0.02, 0.8]).double()
        front = MeshObject(vertices, topology, moved[3:] * colour, translation=moved[:3], light=light)
        back = MeshObject(vertices, topology, 0.5 * colour, translation=behind, light=light)
        seen = render(Scene([front, back], camera), shading=shading)
        loss = seen.rgb.square().sum() + seen.coverage.square().sum()
        return torch.autograd.grad(loss, moved, create_graph=True)[0]

    at = torch.tensor([0.013, 0.0177, 0.5, 0.7]).double()
    start, step = at.clone().requires_grad_(), 1e-7
    rows = [torch.autograd.grad(part, start, retain_graph=True)[0] for part in slope(start)]
    ahead = [
        (slope(at + step * axis) - slope(at - step * axis)) / (2 * step) for axis in torch.eye(4).double()
    ]
    found, expected = torch.stack(rows), torch.stack(ahead, 1).detach()
    assert expected[:3, :3].abs().min() > 1
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-2)


def test_a_nearer_near_plane_draws_small_things_as_large_ones() -> None:
    """All lengths times .01, the near plane, too: the same picture, and depths times .01."""
    large = ball((0.02, 0.01, 0.3), (0.8, 0.4, 0.2))
    assert large.translation is not None
    small = replace(large, vertices=large.vertices * 0.01, translation=large.translation * 0.01)
    usual, close = render(Scene([large], AHEAD)), render(Scene([small], AHEAD), near=1e-4)
    assert render(Scene([small], AHEAD)).coverage.max() == 0
    torch.testing.assert_close(close.rgb, usual.rgb, atol=1e-4, rtol=0)
    torch.testing.assert_close(close.depth, 0.01 * usual.depth, atol=1e-7, rtol=1e-4)
    assert torch.equal(close.triangle_id, usual.triangle_id)
    assert float(render(Scene([large], AHEAD), near=0.25).depth.min()) > 0.25

    def seen(shift: torch.Tensor) -> torch.Tensor:
        moved = replace(small, vertices=small.vertices + shift)
        return render(Scene([moved], AHEAD), near=1e-4).coverage.sum()

    (backward,) = torch.autograd.grad(seen(at := torch.zeros(3, requires_grad=True)), at)
    torch.testing.assert_close(jacobian(seen, torch.zeros(3))[1], backward, rtol=1e-3, atol=1.0)
