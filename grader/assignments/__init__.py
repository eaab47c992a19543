"""One file per world: variants, metrics, thresholds, and the exercises of its notebook."""
