"""Figures of an evaluation: the paper's Figures 3 to 5, and reliability."""

from vig_paper.figures.drawing import draw_figures as draw_figures
