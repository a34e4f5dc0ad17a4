"""The paper's recognition networks and their training."""
