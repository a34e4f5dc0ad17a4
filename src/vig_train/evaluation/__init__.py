"""Methods evaluated on datasets: the paper's metrics, its Table 1, and statistics."""
