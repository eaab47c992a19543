"""From programs to results: error, time, the sequence of episodes, the secret, and a class on all cores.

Imports assignments, intake, sandbox and the nouns.
"""
