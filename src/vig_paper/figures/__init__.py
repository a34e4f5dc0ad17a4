"""Figures of an evaluation: the paper's Figures 3 to 5, reliability, and an animated fit."""

from vig_paper.figures.animation import fit_animation
from vig_paper.figures.curves import figure3, reliability_figure
from vig_paper.figures.drawing import choose, draw_figures, worst
from vig_paper.figures.photos import figure4, figure5

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
