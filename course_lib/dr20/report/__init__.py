"""The homework report's filter: its method, each error a choice, and its listing in plain Python.

Imports `dr20`'s `models` and `constants`, and what knows no world.
"""
