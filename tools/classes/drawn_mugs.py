"""Random mugs: mixtures of the named ones, body and handle, a pure function of the random stream."""

import numpy as np

from tools.classes.mixing import Mixing, drawn_in_order, first_sound
from tools.classes.mug_flaws import flaws
from vig_world.assets.mugs.design import MUGS, MugDesign

MAX_TRIES = 200

_OF_HEIGHT = ("corner_height", "handle_top", "handle_bottom")
_OF_RADIUS = ("corner_inset", "handle_reach", "handle_lean", "handle_thickness", "handle_width")
MIXING = Mixing(
    groups=(
        ("height", "radius", "base", "bulge", "flare", "corner", "square", "foot"),
        ("wall", "floor", "lip", "rim"),
        ("handle_top", "handle_bottom", "handle_reach"),
        ("handle_p", "handle_f", "handle_l", "handle_r", "handle_d", "handle_u", "handle_s", "handle_tap"),
        ("handle_thickness", "handle_width"),
    ),
    units=(("height", _OF_HEIGHT), ("radius", _OF_RADIUS)),
    lengths=(*_OF_HEIGHT, *_OF_RADIUS, "height", "radius", "foot_height", "wall", "floor"),
    angles=("handle_rise", "handle_drop"),
    whole=(),
)


def draw_mug(rng: np.random.Generator, name: str = "drawn") -> MugDesign:
    """Draw a sound mug: body, wall, and the handle's place, curve and section each of two training designs.

    Raises RuntimeError when `MAX_TRIES` drawn designs in a row have flaws.
    """

    def draw() -> MugDesign:
        return MugDesign(**MIXING.absolute({"name": name} | MIXING.mixture(rng, lambda group: MUGS["train"])))

    return first_sound(draw, flaws, MAX_TRIES, "mugs")


def drawn_mugs(count: int, seed: int = 0) -> tuple[MugDesign, ...]:
    """Return the first `count` random mugs of a seed; a longer list begins with the shorter one."""
    return drawn_in_order(draw_mug, count, seed)
