"""The autograder. Arrows run down only: cli, doctor, grading, assignments, intake, then lessons, reports and sandbox.

`assignment`, `result` and `check` are the nouns that everyone shares; `course_lib` never imports any of this.
"""
