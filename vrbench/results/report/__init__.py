"""Pages of HTML: a run's report, and a leaderboard as a static site."""
