"""Two renderers of one scene: a fast rasteriser and Cycles."""
