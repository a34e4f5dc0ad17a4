# %% [markdown]
# # Fit a photo
#
# One photo, its explanation, and what a robot and an augmented-reality
# application do with it. Each tutorial is a Python file that also runs as a
# notebook (Jupyter with jupytext, VS Code) and as a script.

# %%
import numpy as np
import torch
import trimesh
from PIL import Image
from scipy.spatial.transform import Rotation

import vig
from vig.renderer import MeshObject, Pinhole, Scene, Topology, render
from vig.scene import linear_from_srgb, srgb8_from_linear
from vig_app.examples import example_photos

photo = example_photos()[3].photo  # any path, PIL image or array will do
explainer = vig.Explainer("teapot")
found = explainer.explain(photo, box=(20, 20, 115, 110))
print(found.verdict, f"{found.confidence:.2f}:", found.reason)
print(
    f"azimuth {found.azimuth_deg:.1f}, elevation {found.elevation_deg:.1f} degrees"
)
print(f"{found.hidden_fraction:.0%} of the object's pixels are hidden")

# %% [markdown]
# The outline is that of the whole object; hidden pixels are pink.
# `panels` puts photo, rendering, residual, normals and mask side by side.

# %%
Image.fromarray(found.overlay()).resize((450, 450))

# %%
Image.fromarray(found.panels())

# %% [markdown]
# ## Other explanations
#
# A photo can have more than one explanation. The others come with their
# probabilities, and one can be chosen ([correcting a fit](../../hints/)).

# %%
for other in found.alternatives:
    print(
        f"azimuth {other.azimuth_deg:.0f}, with probability {other.probability:.2f}"
    )
chosen = explainer.explain(
    photo, box=(20, 20, 115, 110), hints=vig.Hints(azimuth_deg=found.azimuth_deg)
)
print("by choice:", chosen.verdict, f"{chosen.azimuth_deg:.1f}")

# %% [markdown]
# ## A grasp pose for a robot
#
# `pinhole_pose` gives the camera's intrinsics, `camera_from_object` (metres,
# OpenCV axes) and its covariance: x, y, z, then rotations about these axes. A
# grasp is fixed to the object; the adjoint transforms the covariance into the
# grasp's frame.

# %%
intrinsics, camera_from_object, covariance = found.pinhole_pose()
vertex = explainer.object_class.points["handle"]
handle = found.vertices[vertex]
object_from_grasp = np.eye(4)  # the gripper reaches along +X
object_from_grasp[:3, :3] = Rotation.from_euler("y", 90, degrees=True).as_matrix()
object_from_grasp[:3, 3] = handle
camera_from_grasp = camera_from_object @ object_from_grasp

# A rotation about the object's origin shifts the grasp by the lever, camera axes.
x, y, z = camera_from_object[:3, :3] @ handle
moved = np.eye(6)
moved[:3, 3:] = -np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
of_grasp = np.sqrt(np.diag(moved @ covariance @ moved.T))
print(
    "the gripper goes to", camera_from_grasp[:3, 3].round(3), "m before the camera"
)
print("standard deviations in mm:", (1000 * of_grasp[:3]).round(1))
print("and in degrees:", np.degrees(of_grasp[3:]).round(1))

# %% [markdown]
# Distances are as accurate as the class's usual size: a teapot half as large and
# half as far looks the same. The covariance does not include that; a table's plane
# or a depth pixel resolves it.
#
# ## Insert an object in the same light
#
# The light on the object is nine coefficients of spherical harmonics. A virtual
# object is rendered with this light and the photo's camera, and composited: a ball
# on the table of another photo, beside its teapot. The table darkens where the
# ball occludes light from above.

# %%
photo = example_photos()[0].photo
found = explainer.explain(photo)
latents, drawn_at = found.latents, 4
large = found.camera.scale(drawn_at)
view = torch.tensor(latents.azimuth[0]), torch.tensor(latents.elevation[0])
camera = Pinhole.on_sphere(large, *view)


def drawn(mesh, albedo):
    """A mesh in the object's frame, lit as the object is."""
    item = MeshObject(
        torch.tensor(mesh.vertices, dtype=torch.float32),
        Topology.of(mesh.faces, mesh.vertices),
        albedo=torch.tensor(albedo),
        light=torch.tensor(latents.light[0]),
    )
    return render(Scene([item], camera), samples=2)


radius = 0.025  # metres; the object stands on z = 0
eye, right = (
    np.array([np.sin(a), -np.cos(a)])
    for a in float(latents.azimuth[0]) + np.array([0.0, np.pi / 2])
)
beside = 0.11 * eye + 0.10 * right  # before the pot, on its right
ball = trimesh.creation.icosphere(subdivisions=4, radius=radius)
ball.apply_translation([*beside, radius])
picture = Image.open(photo).convert("RGB").resize((large.width, large.height))
picture = linear_from_srgb(np.asarray(picture) / 255)
for share in np.linspace(0.3, 1.2, 8):  # a soft shadow: discs that overlap
    disc = trimesh.creation.cylinder(share * radius, 1e-4)
    disc.apply_translation([*beside, 0.0])
    picture *= (
        1 - 0.12 * drawn(disc, [0.0, 0.0, 0.0]).coverage[0].numpy()[..., None]
    )
seen = drawn(ball, [0.75, 0.2, 0.1])
cover = seen.coverage[0].numpy()[..., None]
Image.fromarray(srgb8_from_linear(seen.rgb[0].numpy() + (1 - cover) * picture))

# %% [markdown]
# ## Save it
#
# `found.save("result")` writes `report.html` for people, `explanation.json`,
# pictures and `object.glb` ([file by file](../../explanation/));
# `found.export("result", ["bop", "ros"])` the formats of other tools.
