"""Procedural household props, each a pure function of a random generator."""

from collections.abc import Callable

import numpy as np

from vig.synthesis.props import containers, nature, objects, printed, tableware
from vig.synthesis.props.material import Material, Prop

FAMILIES: dict[str, Callable[[np.random.Generator], Prop]] = {
    make.__name__: make
    for make in (
        tableware.bowl,
        tableware.plate,
        tableware.mug,
        tableware.jug,
        tableware.tumbler,
        tableware.candle,
        tableware.shaker,
        tableware.egg_cup,
        containers.can,
        containers.bottle,
        containers.jar,
        containers.tin,
        containers.pen_pot,
        containers.cutlery,
        containers.tissue_box,
        printed.book,
        printed.book_stack,
        printed.printed_box,
        printed.carton,
        printed.frame,
        printed.napkin,
        printed.crumpled_cloth,
        printed.toy_blocks,
        nature.apple,
        nature.orange,
        nature.lemon,
        nature.pear,
        nature.banana,
        nature.vase_plant,
        nature.pot_plant,
        objects.ball,
        objects.lamp,
        objects.clock,
        objects.speaker,
    )
}
"""Every family of props by name: a function from a generator to a Prop."""

__all__ = ["FAMILIES", "Material", "Prop"]
