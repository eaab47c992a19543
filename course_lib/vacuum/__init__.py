"""Two vacuum robots in one room: ETH Zurich, Recursive Estimation, spring 2015, exercise 2.

Imports what knows no world: `filters`, `angles`, `ranges`, `recording`, `plotting`.
"""
