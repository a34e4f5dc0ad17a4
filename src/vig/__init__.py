"""vig: vision as inverse graphics. Explains one object in one photo, even where it is hidden."""

__version__ = "0.1.0"
