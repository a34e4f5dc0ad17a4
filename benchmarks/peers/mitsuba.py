"""Mitsuba 3 (Jakob et al., 2022) on the same problem, on the CPU: `direct_projective` in `llvm_ad_rgb`.

One sample per pixel for the interior and one for the primary silhouettes, a box filter, a constant and a
directional light, and a squared pixel error differentiated with respect to vertex positions and both lights.
The derivative of cast shadows' edges (`sppi`) is off: the other renderers have none, and it costs seconds.
"""

import drjit as dr
import mitsuba as mi
import numpy as np
from drjit.detail import llvm_version

from benchmarks.case import Case
from benchmarks.peers import try_out

mi.set_variant("llvm_ad_rgb")
mi.set_log_level(mi.LogLevel.Error)  # it warns of objects that enter the frame; ours lies inside

VERTICES = "object.vertex_positions"
LIGHTS = ("sky.radiance.value", "sun.irradiance.value")


def set_threads(count: int) -> None:
    """How many threads it uses from now on."""
    dr.set_thread_count(count)


def compiler() -> str:
    """Version of the LLVM that compiles its kernels."""
    return ".".join(str(part) for part in llvm_version())


class Mitsuba:
    """Forward, and forward with gradient, at the case's guesses."""

    def __init__(self, case: Case):
        camera, faces = case.camera, case.model.faces
        self.photo = mi.TensorXf(case.photo.astype(np.float32))
        self.points = [mi.Float(points.astype(np.float32).ravel()) for points in case.points()]
        properties = mi.Properties()
        albedo = {"type": "rgb", "value": case.truth.albedo[0].tolist()}
        properties["object_bsdf"] = mi.load_dict({"type": "diffuse", "reflectance": albedo})
        mesh = mi.Mesh("object", len(case.model.mean), len(faces), has_vertex_normals=True, props=properties)
        state = mi.traverse(mesh)
        state["vertex_positions"], state["faces"] = self.points[0], mi.UInt32(faces.ravel())
        state.update()
        self.scene = mi.load_dict(
            {
                "type": "scene",
                "integrator": {"type": "direct_projective", "hide_emitters": True, "sppi": 0},
                "sensor": {
                    "type": "perspective",
                    "fov": float(np.degrees(2 * np.arctan(camera.width / 2 / camera.focal))),
                    "fov_axis": "x",
                    "near_clip": 0.01,
                    "to_world": mi.ScalarTransform4f().look_at([0, 0, 0], [0, 0, 1], [0, -1, 0]),
                    "film": {
                        "type": "hdrfilm",
                        "width": camera.width,
                        "height": camera.height,
                        "pixel_format": "rgb",
                        "component_format": "float32",
                        "rfilter": {"type": "box"},
                    },
                    "sampler": {"type": "independent", "sample_count": 1},
                },
                "object": mesh,
                "sky": {"type": "constant", "radiance": {"type": "rgb", "value": 0.5}},
                "sun": {
                    "type": "directional",
                    "direction": [0.2, 0.5, 0.6],
                    "irradiance": {"type": "rgb", "value": 2.0},
                },
            }
        )
        self.parameters = mi.traverse(self.scene)
        self.parameters.keep([VERTICES, *LIGHTS])
        self.lights = {name: type(self.parameters[name])(self.parameters[name]) for name in LIGHTS}

    def forward(self, index: int) -> None:
        """The squared error of a guess."""
        self._place(index, differentiable=False)
        with dr.suspend_grad():
            dr.eval(self._loss(index))
        dr.sync_thread()

    def gradient(self, index: int) -> dict[str, np.ndarray]:
        """The squared error's gradient with respect to vertex positions and lights."""
        self._place(index, differentiable=True)
        dr.backward(self._loss(index))
        found = {name: dr.grad(self.parameters[name]) for name in (VERTICES, *LIGHTS)}
        dr.eval(found)
        dr.sync_thread()
        return found

    def covered(self) -> int:
        """Pixels whose centre's ray meets the object at the first guess."""
        self._place(0, differentiable=False)
        height, width = self.photo.shape[:2]
        x, y = dr.meshgrid(dr.arange(mi.Float, width), dr.arange(mi.Float, height))
        centres = mi.Point2f((x + 0.5) / width, (y + 0.5) / height)
        rays, _ = self.scene.sensors()[0].sample_ray(0.0, 0.5, centres, mi.Point2f(0.5))
        return int(dr.count(self.scene.ray_test(rays))[0])

    def _place(self, index: int, differentiable: bool) -> None:
        """Move the mesh to a guess, which rebuilds its normals and its search tree."""
        self.parameters[VERTICES] = mi.Float(self.points[index % len(self.points)])
        for name, value in self.lights.items():
            self.parameters[name] = type(value)(value)
        if differentiable:
            for name in (VERTICES, *LIGHTS):
                dr.enable_grad(self.parameters[name])
        self.parameters.update()

    def _loss(self, index: int) -> mi.Float:
        image = mi.render(self.scene, self.parameters, spp=1, seed=index)
        return dr.sum(dr.square(image - self.photo))


if __name__ == "__main__":
    try_out(Mitsuba)
