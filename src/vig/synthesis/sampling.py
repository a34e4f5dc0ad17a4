"""Draws a scene from (seed, index): latents, light, room, and props that hide a chosen share."""

from __future__ import annotations

from collections import Counter

import numpy as np
import torch

from vig.scene import SHAPE_LIMIT, ObjectClass
from vig.synthesis import assets
from vig.synthesis.occlusion import Stage, draw_prop, hide, measure
from vig.synthesis.room import draw_room
from vig.synthesis.spec import SPLITS, Placed, SceneSpec, Split

MAX_OCCLUSION = 0.9
NONE_SHARE = 0.05
"""Share of scenes with nothing in front of the object, on top of the flat distribution."""
LOWEST_ELEVATION = 0.05
TOLERANCE = 0.015
ATTEMPTS = 40


def stream(seed: int, index: int, split: Split, purpose: int) -> np.random.Generator:
    """The generator of one purpose of one sample: a pure function of its arguments."""
    return np.random.default_rng(np.random.SeedSequence([seed, index, SPLITS.index(split), purpose]))


def sample(object_class: ObjectClass, seed: int, index: int, split: Split = "train") -> SceneSpec:
    """The scene number `index` of a seed.

    Latents and the target occlusion are drawn first and never redrawn, so their distributions are exactly
    the documented ones: shape N(0, 1) clipped to 3, azimuth uniform, elevation uniform in [0.05, pi/2],
    albedo uniform in [0.2, 0.8], occlusion zero for a share of 0.05 and else uniform in [0, 0.9]. Only rooms
    and placements are thrown away, until the hidden share of the object is within 0.015 of the target.

    Raises:
        RuntimeError: no placement reached the target in 40 rooms.
    """
    rng = stream(seed, index, split, 0)
    modes = object_class.shape_model.modes
    shape = np.clip(rng.standard_normal(modes), -SHAPE_LIMIT, SHAPE_LIMIT)
    azimuth, elevation = rng.uniform(0, 2 * np.pi), rng.uniform(LOWEST_ELEVATION, np.pi / 2)
    albedo = rng.uniform(0.2, 0.8, 3)
    panorama, turn = int(rng.integers(assets.PANORAMAS[split])), rng.uniform(0, 2 * np.pi)
    light = assets.light(split, panorama, turn)
    target = 0.0 if rng.uniform() < NONE_SHARE else rng.uniform(0, MAX_OCCLUSION)

    coefficients = torch.tensor(shape, dtype=torch.float32)[None]
    vertices = object_class.shape_model.vertices(coefficients)[0].numpy()
    rejected: Counter[str] = Counter()
    for attempt in range(ATTEMPTS):
        rng = stream(seed, index, split, 1 + attempt)
        room = draw_room(rng, split, azimuth, vertices)
        stage = Stage.empty(object_class, vertices, azimuth, elevation, room, split)
        if not hide(stage, target, rng, rejected):
            rejected["room"] += 1
            continue
        strew(stage, rng, rejected)
        occlusion = measure(object_class, vertices, stage.props, azimuth, elevation, split)
        if abs(occlusion - target) > TOLERANCE:
            rejected["tolerance"] += 1
            continue
        return SceneSpec(
            seed=seed,
            index=index,
            split=split,
            shape=tuple(shape.tolist()),
            azimuth=azimuth,
            elevation=elevation,
            albedo=tuple(albedo.tolist()),
            light=tuple(light.tolist()),
            panorama=panorama,
            panorama_angle=turn,
            target=target,
            occlusion=occlusion,
            cause="occluder" if occlusion > 0 else "none",
            room=room,
            props=tuple(stage.props),
            rejected=dict(sorted(rejected.items())),
        )
    raise RuntimeError(f"sample {index} of seed {seed}: no scene hides {target:.3f}; {dict(rejected)}")


def strew(stage: Stage, rng: np.random.Generator, rejected: Counter[str]) -> None:
    """Stand clutter round the object, in and out of view, hiding nothing of it."""
    wanted = int(rng.integers(2, 10))
    near, far = stage.visible_ground()
    for _ in range(3 * wanted):
        if wanted == 0:
            return
        family, asset = draw_prop(rng, stage.split)
        ahead = rng.uniform(near, far)
        aside = rng.uniform(-1, 1) * (0.45 * (ahead - near) + 0.25)
        xy = ahead * stage.ahead + aside * stage.aside
        position = (float(xy[0]), float(xy[1]), 0.0)
        placed = Placed(family, asset, position, (0.0, 0.0, rng.uniform(0, 2 * np.pi)), "clutter")
        reason = stage.try_clutter(placed)
        if reason:
            rejected[f"clutter {reason}"] += 1
        else:
            wanted -= 1
