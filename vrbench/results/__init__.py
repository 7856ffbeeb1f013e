"""Results: bundles, metric tables, leaderboards."""
