"""Pictures of an evaluation: the paper's Figures 3 to 5, reliability, and a fit as it moves."""

from vig_lab.figures.animation import fit_animation
from vig_lab.figures.choice import choose, worst
from vig_lab.figures.curves import figure3, reliability_figure
from vig_lab.figures.drawing import draw_figures
from vig_lab.figures.explained import figure4
from vig_lab.figures.lights import figure5

__all__ = [
    "choose",
    "draw_figures",
    "figure3",
    "figure4",
    "figure5",
    "fit_animation",
    "reliability_figure",
    "worst",
]
