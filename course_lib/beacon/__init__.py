"""A quadrotor in a room with four beacons: geometry, filters, planning; its wings are `planning` and `planar`.

Imports what knows no world: `filters`, `geometry`, `angles`, `ranges`, `scoring`, `recording`, `plotting`.
"""
