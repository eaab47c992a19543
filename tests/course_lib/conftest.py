"""Settings for these tests: examples are the same in every run, and nothing is timed."""

from hypothesis import settings

settings.register_profile("course_lib", deadline=None, derandomize=True, max_examples=60)
settings.load_profile("course_lib")
