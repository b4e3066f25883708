"""Error, cost, statistics, thresholds and runs: the harness measures, a technique never grades itself."""
