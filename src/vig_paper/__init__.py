"""The paper's own experiments: its networks and optimisers, ablations, figures, tables, `vig reproduce`.

Only in a clone: the wheel is without it.
"""
