"""The beacon unit's filters on the ground, for recordings of real robots: three states, wheels, calibration.

Imports `recording` and what knows no world.
"""
