"""Finds the pose of a textured teapot and the light on it from one picture, by gradient descent.

    python examples/fit_pose_and_light.py [--out DIRECTORY]

The gradient comes through `vig.renderer`. The picture is drawn with 4 x 4 samples a pixel, and noise is
added. The fit starts some 15 degrees and two centimetres off, under a flat grey light, and sees only the
picture: the loss is the plain mean square of the difference in colour. Prints the errors before and after; a
few seconds on one core.
"""

import argparse
import math
import time
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from vig.renderer import MeshObject, Pinhole, Scene, Topology, render
from vig.scene import ObjectClass, irradiance, srgb8_from_linear
from vig_renderer import pyramid

STEPS = 150
SIZE = 100


def rotation_of(vector: torch.Tensor) -> torch.Tensor:
    """Rotation matrix of a rotation vector (3,), radians."""
    zero = torch.zeros(())
    x, y, z = vector
    return torch.linalg.matrix_exp(torch.stack([zero, -z, y, z, zero, -x, -y, x, zero]).view(3, 3))


def checks(rng: np.random.Generator) -> torch.Tensor:
    """A texture (64, 64, 3) of coloured squares."""
    return torch.tensor(np.kron(rng.uniform(0.15, 0.9, (8, 8, 3)), np.ones((8, 8, 1))), dtype=torch.float32)


def angle_between(a: torch.Tensor, b: torch.Tensor) -> float:
    """Angle in degrees of the rotation from one orientation to the other."""
    cosine = (torch.trace(a.T @ b).item() - 1) / 2
    return math.degrees(math.acos(min(1.0, max(-1.0, cosine))))


def main() -> None:
    parser = argparse.ArgumentParser(description="Fit pose and light of a textured mesh to a picture.")
    parser.add_argument("--out", type=Path, help="write the picture, the start and the fit here, as fit.png")
    out = parser.parse_args().out
    torch.set_num_threads(1)
    rng = np.random.default_rng(0)

    teapot = ObjectClass.load("teapot")
    vertices = torch.tensor(teapot.shape_model.mean, dtype=torch.float32)
    topology = Topology.of(teapot.shape_model.faces, teapot.shape_model.mean)
    texture, coordinates = pyramid(checks(rng)), vertices[:, [0, 2]] * 6
    camera = Pinhole.on_sphere(teapot.camera(SIZE), torch.tensor(0.4), torch.tensor(0.5))
    background = torch.full((3,), 0.1)

    def draw(turn: torch.Tensor, shift: torch.Tensor, light: torch.Tensor, samples: int = 1) -> torch.Tensor:
        item = MeshObject(
            vertices,
            topology,
            torch.ones(3),
            rotation=rotation_of(turn),
            translation=shift,
            light=light,
            texture=texture,
            texture_coordinates=coordinates,
        )
        return render(Scene([item], camera, background=background), samples=samples).rgb[0]

    true_light = torch.tensor([2.4, 0.3, 1.0, -0.6, 0.1, -0.2, 0.2, 0.1, -0.1])
    truth = torch.tensor([0.1, -0.1, 0.2]), torch.tensor([0.01, -0.005, 0.01]), true_light
    photo = draw(*truth, samples=4)
    photo = photo + 0.01 * torch.tensor(rng.normal(size=photo.shape), dtype=torch.float32)

    turn = torch.tensor([0.22, 0.05, 0.0], requires_grad=True)
    shift = torch.tensor([-0.005, 0.005, 0.0], requires_grad=True)
    light = torch.tensor([2.0, *[0.0] * 8], requires_grad=True)
    start = draw(turn, shift, light).detach()

    directions = torch.tensor(rng.normal(size=(500, 3)), dtype=torch.float32)
    directions = directions / directions.norm(dim=1, keepdim=True)

    def errors() -> str:
        turned = angle_between(rotation_of(turn.detach()), rotation_of(truth[0]))
        shifted = 1000 * (shift.detach() - truth[1]).norm().item()
        lit = irradiance(light.detach(), directions) - irradiance(true_light, directions)
        return f"{turned:6.2f} degrees, {shifted:6.2f} mm, light {lit.square().mean().sqrt().item():.3f}"

    print(f"start: {errors()}")
    rates = [(turn, 0.02), (shift, 0.002), (light, 0.1)]
    optimizer = torch.optim.Adam([{"params": [what], "lr": rate} for what, rate in rates])
    decay = torch.optim.lr_scheduler.ExponentialLR(optimizer, 0.02 ** (1 / STEPS))
    began = time.perf_counter()
    for _ in range(STEPS):
        optimizer.zero_grad()
        loss = (draw(turn, shift, light) - photo).square().mean()
        loss.backward()
        optimizer.step()
        decay.step()
    seconds = time.perf_counter() - began
    print(f"fit:   {errors()}")
    print("light: root mean square error of what a white surface reflects, over all normals, seen or not")
    print(f"{STEPS} steps of {1000 * seconds / STEPS:.1f} ms; residual {loss.item() ** 0.5:.4f}, noise 0.01")
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        row = torch.cat([photo, start, draw(turn, shift, light).detach()], dim=1).numpy()
        Image.fromarray(srgb8_from_linear(row)).resize((9 * SIZE, 3 * SIZE), 0).save(out / "fit.png")
        print(out / "fit.png")


if __name__ == "__main__":
    main()
