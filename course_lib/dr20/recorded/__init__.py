"""Monte Carlo localization of a recorded robot by its laser, in a map made of its own first laps.

Imports `geometry`, `recording` and what knows no world.
"""
