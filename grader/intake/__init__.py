"""From files that anyone may send to programs: archives, notebooks and scripts, read in a process of its own.

Imports the nouns alone.
"""
