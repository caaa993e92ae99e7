"""The labs as a web page: `python -m uavdh_lite app`."""

PORT = 8866
SESSIONS = 8  # people at a time, each with a process of about 350 MB
IDLE_SECONDS = 1200  # after which a session that nobody uses is ended
