"""DEODR (de La Gorce, Paragios and Fleet, 2008; github.com/martinResearch/DEODR) on the same problem.

Used as its own mesh fitters use it: its numpy interface, a Gouraud-shaded mesh under a directional and an
ambient light, silhouettes antialiased over one pixel, a squared pixel error differentiated with respect to
vertices, pose, light and colour, in float64 on one thread, the only way it runs.
"""

import numpy as np
from deodr.differentiable_renderer import Camera, Scene3D, renderScene, renderSceneB
from deodr.triangulated_mesh import ColoredTriMesh

from benchmarks.case import Case
from benchmarks.peers import try_out

AMBIENT, DIRECTIONAL = 0.5, np.array([0.2, 0.5, 0.6])
"""Light in the camera's frame; the direction is where the light goes to, its length the intensity."""


class Deodr:
    """Forward, and forward with gradient, at the case's guesses."""

    def __init__(self, case: Case):
        camera = case.camera
        self.points, self.photo = case.points(), case.photo
        albedo = np.tile(case.truth.albedo, (len(case.model.mean), 1))
        self.mesh = ColoredTriMesh(case.model.faces, self.points[0], colors=albedo)
        self.scene = Scene3D(integer_pixel_centers=False)
        self.scene.set_mesh(self.mesh)
        self.scene.set_light(DIRECTIONAL, AMBIENT)
        self.scene.set_background_color(np.zeros(3))
        intrinsic = np.array([[camera.focal, 0, camera.cx], [0, camera.focal, camera.cy], [0, 0, 1]])
        self.camera = Camera(np.eye(3, 4), intrinsic, camera.height, camera.width)

    def render(self, index: int) -> np.ndarray:
        """The image (H, W, 3) of a guess."""
        self.mesh.set_vertices(self.points[index % len(self.points)])
        return self.scene.render(self.camera)

    def forward(self, index: int) -> float:
        """The squared error of a guess."""
        difference = self.render(index) - self.photo
        return float(np.vdot(difference, difference))

    def gradient(self, index: int) -> dict[str, np.ndarray]:
        """The squared error's gradient with respect to all that DEODR differentiates, pose included."""
        difference = self.render(index) - self.photo
        np.vdot(difference, difference)
        self.scene.render_backward(2 * difference)
        by_vertex = self.mesh._vertices_b
        return {
            "vertices": by_vertex,
            "rotation": self.mesh.vertices.T @ by_vertex,
            "translation": by_vertex.sum(0),
            "directional": self.scene.light_directional_b,
            "ambient": np.array(self.scene.light_ambient_b),
            "colour": self.mesh.vertices_colors_b.sum(0),
        }

    def covered(self) -> int:
        """Pixels that show the object at the first guess, antialiasing off."""
        self.scene.sigma = 0
        image = self.render(0)
        self.scene.sigma = 1
        return int((image > 0).any(axis=2).sum())


class DeodrRasterizer:
    """DEODR's compiled core alone: vertices are already projected and shaded, and gradients end there."""

    def __init__(self, case: Case):
        whole = Deodr(case)
        self.photo, self.scenes = case.photo, []
        for index in range(len(whole.points)):
            whole.render(index)
            self.scenes.append(whole.scene.scene_2d)
        self.image, self.depth = np.empty(self.photo.shape), np.empty(self.photo.shape[:2])

    def gradient(self, index: int) -> dict[str, np.ndarray]:
        """The squared error's gradient with respect to projected vertices and their colours."""
        scene = self.scenes[index % len(self.scenes)]
        scene.clear_gradients()
        renderScene(scene, 1.0, self.image, self.depth, check_valid=False)
        difference = self.image - self.photo
        renderSceneB(scene, 1.0, self.image, self.depth, 2 * difference, check_valid=False)
        return {"projected": scene.ij_b, "colours": scene.colors_b}


if __name__ == "__main__":
    try_out(Deodr)
