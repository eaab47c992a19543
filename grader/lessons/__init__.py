"""One source becomes both notebooks, and what checks say of a wrong answer.

Imports course_lib alone.
"""
