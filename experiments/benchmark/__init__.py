"""The comparison of optimisers: problems, runs, statistics and the report."""
