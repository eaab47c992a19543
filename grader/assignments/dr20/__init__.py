"""The DR20 in its room: what is graded (`declaration`), what the notebook asks (`exercises`), and its checks.

Imports `grader.lessons`, the nouns, and its own world of `course_lib`.
"""
