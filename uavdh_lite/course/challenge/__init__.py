"""A challenge for a class: hidden missions, isolated submissions, a leaderboard."""
