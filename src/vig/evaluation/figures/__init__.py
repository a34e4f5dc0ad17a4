"""Pictures of an evaluation: the paper's Figures 3 to 5, reliability, and a fit as it moves."""

from vig.evaluation.figures.animation import fit_animation
from vig.evaluation.figures.choice import choose, worst
from vig.evaluation.figures.curves import figure3, reliability_figure
from vig.evaluation.figures.drawing import draw_figures
from vig.evaluation.figures.explained import figure4
from vig.evaluation.figures.lights import figure5

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
