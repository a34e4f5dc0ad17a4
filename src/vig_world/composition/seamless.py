"""Views that no seamless ground has space for, so that none need be tried."""

from __future__ import annotations

import math

import numpy as np

from vig_world.composition.place import EYE_CLEARANCE, LOWEST_EYE, MOST_NEAR
from vig_world.composition.stage import Actor
from vig_world.rooms.sweep import HEIGHT, RADIUS, SEGMENTS, STANDS, WALL

BEYOND = RADIUS * math.cos(math.pi / SEGMENTS) - math.sqrt(2) * STANDS
"""Metres from the object, wherever it stands, within which there is no wall."""
SURELY = 0.01
"""Metres, and share of the frame, by which a view must fail."""


def fits_seamless_ground(actor: Actor) -> bool:
    """Return whether some seamless ground may have a place for the object and its camera.

    False where the camera is in the ground or too high, sees over the wall behind the object, or where
    the ground is too near to it; none depends on the object's place.
    """
    view, height = actor.view, float(actor.view.eye[2])
    if not LOWEST_EYE * actor.small < height < HEIGHT - EYE_CLEARANCE * actor.small:
        return False
    camera = view.camera
    columns, rows = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    x, y = (columns - camera.cx) / camera.focal, (rows - camera.cy) / camera.focal
    rays = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3) @ view.rotation  # (N, 3) of depth 1
    if (-rays[:, 2] * actor.nearest > height).mean() > MOST_NEAR + SURELY:
        return False
    level, towards = np.linalg.norm(rays[:, :2], axis=1), -view.eye[:2]
    along = rays[:, :2] @ towards / level
    beside = (towards @ towards - along**2).clip(0)
    way = along + np.sqrt((BEYOND**2 - beside).clip(0))  # at least, to the wall
    rises = (beside < BEYOND**2) & (rays[:, 2] >= 0)
    return not (rises & (height + way * rays[:, 2] / level > WALL + SURELY)).any()
