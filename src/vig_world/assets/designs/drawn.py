"""Random designs: mixtures of the named ones, part by part, a pure function of the random stream."""

from __future__ import annotations

from dataclasses import asdict, fields
from typing import Any

import numpy as np

from vig_world.assets.designs.design import HANDLES, TRAINING_DESIGNS, Handle, TeapotDesign
from vig_world.assets.designs.flaws import flaws

SHARES: dict[Handle, float] = {"behind": 0.7, "above": 0.22, "straight": 0.08}
"""How often each handle is drawn."""

JITTER = 0.06
"""Standard deviation of each length's logarithm about its mixture's."""
ANGLE_JITTER = 4.0
"""Degrees, the same of angles."""

MOST_TRIES = 200

_GROUPS = (
    ("belly", "square", "lobe", "base", "shoulder", "neck", "upper", "rim", "foot"),
    ("lid",),
    ("knob",),
    ("spout", "mouth"),
    ("handle", "bail"),
)
_KINDS = ("name", "handle", "lobes")
_OF_SHOULDER = ("belly_height", "spout_base_height", "spout_tip_height", "handle_top", "handle_bottom")
_OF_NECK = ("lid_height", "knob_height", "knob_radius")
_OF_BELLY = (
    *("base_radius", "shoulder_height", "neck_radius", "bail_height"),
    *("spout_reach", "spout_base_radius", "spout_tip_radius", "handle_reach"),
)
_ANGLES = ("spout_base_angle", "spout_tip_angle", "mouth_tilt", "handle_rise", "handle_drop")
_LENGTHS = (
    *_OF_SHOULDER,
    *_OF_NECK,
    *_OF_BELLY,
    *("belly_radius", "foot_height", "neck_height", "lid_thickness", "handle_thickness", "handle_width"),
)


def draw_design(
    rng: np.random.Generator, name: str = "drawn", handles: tuple[Handle, ...] = HANDLES
) -> TeapotDesign:
    """Draw a sound design: body, lid, knob, spout and handle each of a mixture of two training designs.

    Lengths are mixed as ratios (heights of spout and handle to the shoulder's), so that a part fits another
    body. Raises RuntimeError when `MOST_TRIES` drawn designs in a row have flaws.
    """
    shares = np.array([SHARES[handle] for handle in handles])
    handle = handles[int(rng.choice(len(handles), p=shares / shares.sum()))]
    for _ in range(MOST_TRIES):
        design = _mixture(rng, handle, name)
        if not flaws(design):
            return design
    raise RuntimeError(f"{MOST_TRIES} drawn designs with a handle {handle} had flaws, the last: {design}")


def drawn_designs(
    count: int, handles: tuple[Handle, ...] = HANDLES, seed: int = 0
) -> tuple[TeapotDesign, ...]:
    """The first `count` random designs of a seed; a longer list begins with the shorter one.

    handles: the kinds drawn, in proportion to `SHARES`.
    """
    return tuple(
        draw_design(
            np.random.default_rng(np.random.SeedSequence([seed, index])), f"drawn {seed}.{index}", handles
        )
        for index in range(count)
    )


def _mixture(rng: np.random.Generator, handle: Handle, name: str) -> TeapotDesign:
    with_handle = [design for design in TRAINING_DESIGNS if design.handle == handle]
    mixed: dict[str, Any] = {"name": name, "handle": handle}
    for group in _GROUPS:
        designs = with_handle if "handle" in group else TRAINING_DESIGNS
        first, second = (_relative(designs[index]) for index in rng.integers(len(designs), size=2))
        weight = rng.uniform(0.5, 1.0)
        for key in first:
            if key.startswith(group) and key not in _KINDS:
                mixed[key] = weight * first[key] + (1.0 - weight) * second[key]
        if "lobe" in group:
            mixed["lobes"] = first["lobes"]
    for key in _LENGTHS:
        mixed[key] *= np.exp(rng.normal(0.0, JITTER))
    for key in _ANGLES:
        mixed[key] += rng.normal(0.0, ANGLE_JITTER)
    return _absolute(mixed)


def _relative(design: TeapotDesign) -> dict[str, Any]:
    """A design's parameters, lengths that depend on the body's size as ratios."""
    d = asdict(design)
    return {key: value / _unit(d, key) if key in _LENGTHS else value for key, value in d.items()}


def _absolute(relative: dict[str, Any]) -> TeapotDesign:
    """The design of ratios; `_relative` undone."""
    d = dict(relative)
    for key in (*_OF_BELLY, *_OF_SHOULDER, *_OF_NECK):  # in the order in which units come to be known
        d[key] = relative[key] * _unit(d, key)
    names = [field.name for field in fields(TeapotDesign)]
    return TeapotDesign(**{key: _plain(d[key]) for key in names})


def _unit(d: dict[str, Any], key: str) -> float:
    units = (("belly_radius", _OF_BELLY), ("shoulder_height", _OF_SHOULDER), ("neck_radius", _OF_NECK))
    for unit, keys in units:
        if key in keys:
            return float(d[unit])
    return 1.0


def _plain(value: Any) -> Any:
    return round(float(value), 5) if isinstance(value, float) else value
