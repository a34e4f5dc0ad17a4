"""The paper's experiments: evaluation, ablations, figures, the paper's networks, reproduction."""
