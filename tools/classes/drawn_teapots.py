"""Random designs: mixtures of the named ones, part by part, a pure function of the random stream."""

from collections.abc import Sequence

import numpy as np

from tools.classes.mixing import Mixing, drawn_in_order, first_sound
from tools.classes.teapot_flaws import flaws
from vig_world.assets.designs.design import HANDLES, TEAPOTS, Handle, TeapotDesign

SHARES: dict[Handle, float] = {"behind": 0.7, "above": 0.22, "straight": 0.08}
"""Probability of each handle."""

MAX_TRIES = 200

_OF_SHOULDER = ("belly_height", "spout_base_height", "spout_tip_height", "handle_top", "handle_bottom")
_OF_NECK = ("lid_height", "knob_height", "knob_radius")
_OF_BELLY = (
    *("base_radius", "shoulder_height", "neck_radius", "bail_height"),
    *("spout_reach", "spout_base_radius", "spout_tip_radius", "handle_reach"),
)
MIXING = Mixing(
    groups=(
        ("belly", "square", "lobe", "base", "shoulder", "neck", "upper", "rim", "foot"),
        ("lid",),
        ("knob",),
        ("spout", "mouth"),
        ("handle", "bail"),
    ),
    units=(("belly_radius", _OF_BELLY), ("shoulder_height", _OF_SHOULDER), ("neck_radius", _OF_NECK)),
    lengths=(
        *_OF_SHOULDER,
        *_OF_NECK,
        *_OF_BELLY,
        *("belly_radius", "foot_height", "neck_height", "lid_thickness", "handle_thickness", "handle_width"),
    ),
    angles=("spout_base_angle", "spout_tip_angle", "mouth_tilt", "handle_rise", "handle_drop"),
    whole=("handle", "lobes"),
)
"""Heights of spout and handle are mixed as ratios to the shoulder's."""


def draw_design(
    rng: np.random.Generator, name: str = "drawn", handles: tuple[Handle, ...] = HANDLES
) -> TeapotDesign:
    """Draw a sound design: body, lid, knob, spout and handle each of a mixture of two training designs.

    Raises RuntimeError when `MAX_TRIES` drawn designs in a row have flaws.
    """
    shares = np.array([SHARES[handle] for handle in handles])
    handle = handles[int(rng.choice(len(handles), p=shares / shares.sum()))]
    with_handle = [design for design in TEAPOTS["train"] if design.handle == handle]

    def chosen(group: tuple[str, ...]) -> Sequence[TeapotDesign]:
        return with_handle if "handle" in group else TEAPOTS["train"]

    def draw() -> TeapotDesign:
        return TeapotDesign(**MIXING.absolute({"name": name} | MIXING.mixture(rng, chosen)))

    return first_sound(draw, flaws, MAX_TRIES, f"designs with a handle {handle}")


def drawn_designs(
    count: int, handles: tuple[Handle, ...] = HANDLES, seed: int = 0
) -> tuple[TeapotDesign, ...]:
    """Return the first `count` random designs of a seed; a longer list begins with the shorter one.

    handles: the kinds drawn, in proportion to `SHARES`.
    """
    return drawn_in_order(lambda rng, name: draw_design(rng, name, handles), count, seed)
