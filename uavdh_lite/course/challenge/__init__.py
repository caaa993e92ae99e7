"""A challenge for a class: hidden scenarios, isolated submissions, a leaderboard."""
