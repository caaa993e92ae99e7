"""What a result was computed with: versions and kind of machine."""

import os
import platform
from importlib.metadata import version

from uavdh_lite import __version__


def provenance() -> dict:
    """Versions of the package, Python, torch and numpy, and the machine."""
    return {
        "version": __version__,
        "python": platform.python_version(),
        "torch": version("torch"),
        "numpy": version("numpy"),
        "machine": f"{os.cpu_count()}-core {platform.machine()}, {platform.system()}",
    }
