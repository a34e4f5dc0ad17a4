"""The posed camera of a scene."""

import numpy as np

from vig.scene import ObjectClass
from vig_world.dataset.spec import Lens
from vig_world.raster.view import View


def test_the_pose_is_that_of_the_camera(packaged: ObjectClass) -> None:
    draws = np.random.default_rng(4).uniform([0, 0, -0.5, 0.9], [6.3, 1.5, 0.5, 4], (20, 4))
    for azimuth, elevation, roll, farther in draws.tolist():
        view = View.through(Lens(farther, roll), packaged, azimuth, elevation)
        angles = np.array([[azimuth], [elevation]], np.float64)
        rotation, translation = view.camera.pose(*angles)
        np.testing.assert_allclose(view.rotation, rotation[0], atol=1e-14)
        np.testing.assert_allclose(view.translation, translation[0], atol=1e-14)
