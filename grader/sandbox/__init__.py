"""Where a submission runs.

`server` launches a `zygote`, which forks a `worker` for each episode. `host` gives a worker its `program` and its steps
through a `channel`, in the frames of `wire`, and checks each `posterior` that comes back.
"""
