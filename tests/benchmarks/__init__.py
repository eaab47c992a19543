"""Benchmarks: accuracy and speed, printed as ratios to baselines measured in the same run. No test runs them."""
