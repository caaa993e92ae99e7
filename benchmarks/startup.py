"""How long the import takes beyond numpy and torch, and the demo in all.

python benchmarks/startup.py
"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path


def seconds(*arguments: str) -> float:
    """Best of three runs of a Python process."""
    times = []
    for _ in range(3):
        started = time.perf_counter()
        subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
        times.append(time.perf_counter() - started)
    return min(times)


if __name__ == "__main__":
    base = seconds("-c", "import numpy, torch")
    for module in ("uavdh_lite", "uavdh_lite.training"):
        own = seconds("-c", f"import numpy, torch, {module}")
        print(f"import {module}: {own - base:.2f} s beyond numpy and torch ({base:.2f} s)")
    with tempfile.TemporaryDirectory() as folder:
        demo = seconds("-m", "uavdh_lite", "demo", "--out", str(Path(folder) / "demo.png"))
    print(f"demo: {demo:.1f} s, {demo / base:.1f} times the import of numpy and torch")
