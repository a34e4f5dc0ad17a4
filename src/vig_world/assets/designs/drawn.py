"""Random teapots: between two named designs, with spout, handle and proportions of their own."""

from __future__ import annotations

import functools
from dataclasses import fields, replace

import numpy as np

from vig_world.assets.designs.design import TRAINING_DESIGNS, TeapotDesign
from vig_world.assets.designs.teapot import teapot_vertices

BAILS = 0.25
"""Share of designs whose handle goes over the lid."""
_NUMBERS = tuple(field.name for field in fields(TeapotDesign) if field.name != "name")
_LENGTHS = ("_radius", "_height", "_reach", "_tip_height", "handle_top", "handle_bottom")
_HANDLE = ("handle_top", "handle_bottom", "handle_reach")


def drawn_design(rng: np.random.Generator, name: str) -> TeapotDesign:
    """A design drawn at random; one whose parts would not hold together is drawn again."""
    while True:
        design = _candidate(rng, name)
        if _holds_together(design):
            return design


@functools.lru_cache(maxsize=4)
def drawn_designs(count: int, seed: int = 0) -> tuple[TeapotDesign, ...]:
    """The first `count` designs of a seed."""
    return tuple(
        drawn_design(np.random.default_rng(np.random.SeedSequence([seed, number])), f"drawn {number}")
        for number in range(count)
    )


def _candidate(rng: np.random.Generator, name: str) -> TeapotDesign:
    one, other = (TRAINING_DESIGNS[int(i)] for i in rng.choice(len(TRAINING_DESIGNS), 2, replace=False))
    share = rng.beta(0.5, 0.5)
    values = {k: getattr(one, k) + share * (getattr(other, k) - getattr(one, k)) for k in _NUMBERS}
    wide, tall = np.exp(rng.normal(0, [0.1, 0.2]))
    for key in values:
        if key.endswith(("_height", "handle_top", "handle_bottom")):
            values[key] *= tall
        elif key in ("belly_radius", "base_radius", "neck_radius"):
            values[key] *= wide
    shoulder, belly = values["shoulder_height"], values["belly_radius"]
    values["neck_radius"] = np.clip(
        values["neck_radius"] * np.exp(rng.normal(0, 0.2)), 0.3 * belly, 0.85 * belly
    )
    values["base_radius"] = np.clip(
        values["base_radius"] * np.exp(rng.normal(0, 0.2)), 0.35 * belly, 0.95 * belly
    )
    values["belly_height"] = np.clip(
        values["belly_height"] * np.exp(rng.normal(0, 0.15)), 0.25 * shoulder, 0.75 * shoulder
    )
    for key in ("lid_height", "knob_height", "knob_radius", "foot_height"):
        values[key] *= np.exp(rng.normal(0, 0.35))
    # The spout: short or long, low or high, straight or curved, thin or thick.
    values["spout_reach"] *= np.exp(rng.normal(0, 0.35))
    values["spout_tip_height"] = shoulder * rng.uniform(0.75, 1.2)
    values["spout_base_height"] = np.clip(
        shoulder * rng.uniform(0.3, 0.65), 0, values["spout_tip_height"] - 0.03
    )
    values["spout_bend"] = float(np.clip(values["spout_bend"] + rng.normal(0, 0.15), 0.0, 0.6))
    values["spout_base_angle"] += rng.normal(0, 12)
    values["spout_tip_angle"] += rng.normal(0, 12)
    for key in ("spout_base_radius", "spout_tip_radius", "handle_thickness", "handle_width"):
        values[key] *= np.exp(rng.normal(0, 0.2))
    # The handle: an ear or a ring of any size.
    values["handle_top"] = shoulder * rng.uniform(0.68, 1.0)
    values["handle_bottom"] = values["handle_top"] - shoulder * rng.uniform(0.3, 0.62)
    values["handle_reach"] = belly * rng.uniform(0.25, 0.75)
    values["handle_peak"] = rng.uniform(0.4, 0.95)
    values["handle_rise"] = rng.uniform(-5, 40)
    if rng.random() < BAILS:
        values["bail_height"] = shoulder * rng.uniform(0.55, 1.3)
        values["bail_end"] = rng.uniform(0.75, 0.97)
        values["bail_roundness"] = rng.uniform(0.4, 0.8)
    return replace(one, name=name, **{key: float(value) for key, value in values.items()})


def _holds_together(design: TeapotDesign) -> bool:
    """Whether sizes are those of a pot, and handle and spout reach their places."""
    try:
        vertices = teapot_vertices(design)
    except (ValueError, FloatingPointError):
        return False
    length, width, height = np.ptp(vertices, axis=0)
    bail = design.bail_height > 0
    return bool(
        np.isfinite(vertices).all()
        and 0.12 < length < 0.4
        and 0.08 < width < 0.3
        and 0.07 < height < 0.36
        and design.handle_bottom > design.foot_height + 0.005
        and (bail or design.handle_top - design.handle_bottom > 2.2 * design.handle_thickness)
        and abs(vertices[:, 2].min()) < 1e-3
    )
