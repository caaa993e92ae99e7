"""UAV data harvesting with deep reinforcement learning (Bayerlein et al., Globecom 2020)."""

__version__ = "0.4.0"
