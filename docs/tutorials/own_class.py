# %% [markdown]
# # A class of your own
#
# A folder of meshes becomes a class: each mesh is rotated upright, a template is
# registered to it, and their variation becomes the shape model. The meshes here
# are jars, surfaces of revolution; yours may be `.glb`, `.obj`, `.ply`, `.stl`.

# %%
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import torch
import trimesh
from PIL import Image

from vig.renderer import MeshObject, Pinhole, Scene, Topology, render
from vig.scene import ObjectClass, srgb8_from_linear

folder = Path(tempfile.mkdtemp())
(folder / "jars").mkdir()
rng = np.random.default_rng(0)
for number in range(5):
    foot, belly, neck, height = rng.uniform(
        [0.3, 0.5, 0.2, 1.0], [0.45, 0.8, 0.35, 1.6]
    )
    heights = np.array([0.0, 0.01, 0.45, 0.85, 1.0, 1.0]) * height
    outline = np.interp(
        np.linspace(0, 5, 40), range(6), [0.0, foot, belly, neck, neck * 1.2, 0.0]
    )
    rises = np.interp(np.linspace(0, 5, 40), range(6), heights)
    trimesh.creation.revolve(np.stack([outline, rises], 1), sections=40).export(
        folder / "jars" / f"jar{number}.ply"
    )

build = ["class", "build", folder / "jars", "--out", folder / "jar"]
build += ["--symmetry", "any-turn", "--length", "0.3", "--vertices", "900"]
build += ["--no-recognizer"]  # it takes two minutes
done = subprocess.run(
    [sys.executable, "-m", "vig", *build],
    check=True,
    capture_output=True,
    text=True,
)
print(done.stdout.replace(str(folder), "FOLDER"))

# %% [markdown]
# The pack documents the result: `card.md` with the numbers, and a picture of
# each stage. The shapes of the class from its mean along the first three
# components, two standard deviations to either side:

# %%
jar = ObjectClass.load(folder / "jar")
model = jar.shape_model
print(f"{model.modes} components, {len(model.mean)} vertices")


def picture(coefficients: torch.Tensor) -> np.ndarray:
    """A shape of the class, (150, 150, 3) uint8."""
    vertices = model.vertices(coefficients[None])[0]
    item = MeshObject(
        vertices,
        Topology.of(model.faces, model.mean),
        torch.tensor([0.5, 0.6, 0.7]),
        light=LIGHT,
    )
    camera = Pinhole.on_sphere(
        jar.camera(150), torch.tensor(0.5), torch.tensor(0.3)
    )
    scene = Scene([item], camera, background=torch.ones(3))
    return srgb8_from_linear(render(scene, samples=2).rgb[0].numpy())


LIGHT = torch.tensor([2.4, 0.3, 1.0, -0.6, 0.1, -0.2, 0.2, 0.1, -0.1])
rows = []
for component in range(min(3, model.modes)):
    unit = torch.nn.functional.one_hot(torch.tensor(component), model.modes).float()
    rows.append(
        np.concatenate(
            [picture(amount * unit) for amount in (-2.0, -1.0, 0.0, 1.0, 2.0)],
            axis=1,
        )
    )
Image.fromarray(np.concatenate(rows))

# %% [markdown]
# Its network remains to be trained, a quarter of an hour on two cores (without
# `--no-recognizer` there is a quick one at once); then the class fits photos like
# any other:
#
#     vig class train jar --minutes 15
#     vig fit photo.jpg --class jar --out result
#
# Five jars make a narrow class; ten or twenty meshes of one kind a good one
# ([your own class](../../own_class/)).
