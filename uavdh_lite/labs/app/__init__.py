"""The labs as a web page: `python -m uavdh_lite app`."""

PORT = 8866
IDLE_SECONDS = 1200  # after which a session that nobody uses is ended
