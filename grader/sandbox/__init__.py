"""Where a submission runs: `host` outside, `zygote` and `worker` inside, `wire` between them."""
