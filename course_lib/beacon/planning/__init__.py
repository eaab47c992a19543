"""Kinodynamic planning for the quadrotor: scenes, collision tests, trees, the closed loop, and an independent checker.

Imports `beacon.quadrotor`, `models` and `constants`, and what knows no world; `checker` shares no code with the rest.
"""
