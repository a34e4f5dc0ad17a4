"""The generator: stochastic furnished scenes, two renderers of them, datasets, from (seed, index)."""
