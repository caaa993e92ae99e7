"""The labs as a web page: `python -m uavdh_lite app`."""
