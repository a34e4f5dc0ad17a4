from vig.explainer import Explainer as Explainer
from vig.explanation import Explanation as Explanation
from vig.hints import Hints as Hints
from vig.inference.settings import Verdict as Verdict
from vig.io.errors import UserError as UserError
from vig.scene.camera import Camera as Camera
from vig.scene.latents import Latents as Latents
from vig.scene.object_class import ObjectClass as ObjectClass
from vig.several import SceneExplanation as SceneExplanation
from vig.several import explain_found as explain_found
from vig.several import explain_together as explain_together
from vig.video import Track as Track
from vig.video import TrackedFrame as TrackedFrame
from vig.video import TrackedPose as TrackedPose
from vig.video import Tracker as Tracker
from vig.video import track as track
from vig_renderer.rendering import render as render

__version__: str
