"""A pose moved until the surface's texture lies on that of a photo."""

import numpy as np

from vig.known_object.picture import MIN_COLOUR, Picture
from vig.known_object.surface import Surface
from vig_native import engine

PIXELS = 40  # longer side of the object in the picture
MOVES = np.array([0.02, 0.02, 0.02, 0.004, 0.004, 0.008])
"""Differences of a pose by which its derivatives are taken: radians about x, y, z; shares of the distance."""


def align(surface: Surface, picture: Picture, pose: np.ndarray) -> np.ndarray:
    """Return a pose (4, 4) after steps of Gauss-Newton on log colours, Cauchy's weights for what covers it.

    picture: Its camera is that of the pose. Light is solved for, as in `score_pose` of vig_native/pose.h.
    """
    photo = picture.native(surface)
    logs = np.log(picture.colour.clip(0, None) * np.float32(picture.exposure) + np.float32(MIN_COLOUR))
    for spread in (0.6, 0.4, 0.3, 0.2):
        coverage, base, normal, light = _draw_surface(surface, photo, pose)
        place = (coverage > 0.5) & (picture.seen > 0.5)
        count = int(place.sum())
        if count < 30:
            break
        columns = np.zeros((count, 3, 12))
        for number, size in enumerate(MOVES):
            covered, colour, *_ = _draw_surface(surface, photo, move_pose(pose, size * np.eye(6)[number]))
            columns[..., number] = (colour - base)[place] / size * (covered[place] > 0.5)[:, None]
        columns[..., 6:9] = np.eye(3)
        columns[..., 9:] = normal[place][:, None]
        error = (logs - base)[place] - light[:3] - (normal[place] @ light[3:])[:, None]
        weight = 1 / (1 + (error**2).sum(1) / (3 * spread**2))
        weighted = columns * weight[:, None, None]
        rows = np.einsum("nci,ncj->ij", weighted, columns)
        right = np.einsum("nci,nc->i", weighted, error)
        rows[np.diag_indices(12)] += 0.01 * rows.diagonal() + 1e-6
        pose = move_pose(pose, np.linalg.solve(rows, right)[:6].clip(-0.15, 0.15))
    return pose


def move_pose(pose: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Return a pose (4, 4) turned about its middle, radians (3,), and moved, shares (3,) of its distance."""
    turned = pose.copy()
    turned[:3, :3] = small_turns(by[None, :3])[0] @ pose[:3, :3]
    turned[:3, 3] = pose[:3, 3] + by[3:] * pose[2, 3]
    return turned


def small_turns(turns: np.ndarray) -> np.ndarray:
    """Return rotations (N, 3, 3) about vectors (N, 3) by about their lengths (Cayley): small turns."""
    x, y, z = turns.T / 2
    zero = np.zeros_like(x)
    skew = np.moveaxis(np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]), 2, 0)
    return np.linalg.solve(np.eye(3) - skew, np.eye(3) + skew)


def contiguous(rotations: np.ndarray, translations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return poses as the native library takes them."""
    return np.ascontiguousarray(rotations, np.float32), np.ascontiguousarray(translations, np.float32)


def _draw_surface(surface: Surface, photo: object, pose: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the covered share (n, n), log colours and normals (n, n, 3), and the light (6,)."""
    at = contiguous(pose[:3, :3], pose[:3, 3])
    coverage, colour, normal, _, light = engine.draw_pose(surface.mesh, photo, *at)
    return coverage, np.log(colour + np.float32(MIN_COLOUR)), normal, light
