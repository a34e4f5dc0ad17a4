# %% [markdown]
# # A pixel model of your own
#
# `vig.renderer` is differentiable in everything continuous, silhouettes included,
# so that another likelihood is a few lines of PyTorch. This tutorial estimates the
# pose of a known teapot, half hidden, with the squared error and with Geman and
# McClure's robust loss.

# %%
import math

import numpy as np
import torch
from PIL import Image

from vig.renderer import MeshObject, Pinhole, Scene, Topology, render
from vig.scene import ObjectClass, srgb8_from_linear

torch.set_num_threads(1)  # small pictures: further threads only wait
SIZE = 96
teapot = ObjectClass.load("teapot")
vertices = torch.tensor(teapot.shape_model.mean, dtype=torch.float32)
topology = Topology.of(teapot.shape_model.faces, teapot.shape_model.mean)
light = torch.tensor([2.4, 0.3, 1.0, -0.6, 0.1, -0.2, 0.2, 0.1, -0.1])
background = torch.full((3,), 0.1)


def draw(
    azimuth: torch.Tensor, elevation: torch.Tensor, samples: int = 1
) -> torch.Tensor:
    """The teapot from there, linear RGB (SIZE, SIZE, 3)."""
    item = MeshObject(
        vertices, topology, torch.tensor([0.6, 0.35, 0.2]), light=light
    )
    camera = Pinhole.on_sphere(teapot.camera(SIZE), azimuth, elevation)
    return render(
        Scene([item], camera, background=background), samples=samples
    ).rgb[0]


truth = torch.tensor([0.8, 0.45])
photo = draw(*truth, samples=4)
photo[:, : SIZE * 2 // 5] = torch.tensor(
    [0.05, 0.25, 0.1]
)  # something green stands before its left

# %% [markdown]
# Only the loss has to be written. Geman and McClure's grows like the square for
# small errors and saturates at one for large ones, so that an occluded pixel has
# hardly any gradient.


# %%
def square(error: torch.Tensor) -> torch.Tensor:
    return error.square().sum(-1).mean()


def geman_mcclure(error: torch.Tensor, scale: float = 0.1) -> torch.Tensor:
    squared = error.square().sum(-1) / scale**2
    return (squared / (1 + squared)).mean()


def fit(loss_of: object, steps: int = 80) -> tuple[torch.Tensor, float]:
    """Angles after Adam from 20 degrees beside the truth, and their error."""
    angles = (truth + torch.tensor([0.35, -0.2])).requires_grad_()
    optimizer = torch.optim.Adam([angles], lr=0.03)
    for _ in range(steps):
        optimizer.zero_grad()
        loss_of(draw(*angles) - photo).backward()
        optimizer.step()
    return angles.detach(), math.degrees(float((angles - truth).detach().norm()))


fits = {loss.__name__: fit(loss) for loss in (square, geman_mcclure)}
for name, (_, error) in fits.items():
    print(f"{name:14} ends {error:5.2f} degrees off")

# %%
rows = [photo, *(draw(*angles) for angles, _ in fits.values())]
strip = np.concatenate([srgb8_from_linear(row.numpy()) for row in rows], axis=1)
Image.fromarray(strip).resize((9 * SIZE, 3 * SIZE))

# %% [markdown]
# Left to right: the photo, the fit by the squared error, the fit by the robust
# loss. `vig.Explainer` does more: a mixture with a colour histogram of the rest of
# the photo, masks that couple neighbouring pixels, Levenberg-Marquardt with
# exact Jacobians from several starts ([the objective](../../objective/),
# [rendering](../../rendering/)).
