"""The studio: training images of one object on plain and cluttered grounds, put together in layers."""

from vig_world.studio.scene import StudioScenes as StudioScenes
from vig_world.studio.studio import Studio as Studio
from vig_world.studio.studio import StudioImage as StudioImage
from vig_world.studio.studio import StudioSettings as StudioSettings
