"""The DR20, a robot that finds itself in a known map by five range rays; its wings are `report` and `recorded`.

Imports what knows no world: `filters`, `geometry`, `angles`, `ranges`, `recording`, `plotting`.
"""
