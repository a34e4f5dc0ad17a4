"""The paper's robust pixel model, Eq. 3.

Its alpha is learned, as the paper proposes: the mean share of the teapot that is visible in the training
images. The paper's code has 0.9, under which fits end farther from the truth
(docs/occlusion.md).
"""

from vig.likelihood.pixel import PixelModel

ROBUST = PixelModel(sigma=0.03, alpha=0.55)
