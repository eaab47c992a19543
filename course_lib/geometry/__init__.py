"""Geometry on arrays: polygons, ray casting, occupancy grids. Knows no world."""
