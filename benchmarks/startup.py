"""How long Python takes to start, and what the package adds to it.

python benchmarks/startup.py

Each line is the best of five processes. The last column is what it takes beyond `python -c pass`.
"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

STARTS = {
    "python -c pass": ("-c", "pass"),
    "import uavdh_lite": ("-c", "import uavdh_lite"),
    "uavdh_lite --help": ("-m", "uavdh_lite", "--help"),
    "uavdh_lite evaluate --help": ("-m", "uavdh_lite", "evaluate", "--help"),
    "uavdh_lite train --help": ("-m", "uavdh_lite", "train", "--help"),
    "import numpy": ("-c", "import numpy"),
    "import numpy, torch": ("-c", "import numpy, torch"),
    "import uavdh_lite.training": ("-c", "import uavdh_lite.training"),
}


def seconds(*arguments: str, processes: int = 5) -> float:
    """The shortest time that a Python process takes."""
    times = []
    for _ in range(processes):
        started = time.perf_counter()
        subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
        times.append(time.perf_counter() - started)
    return min(times)


if __name__ == "__main__":
    base = seconds("-c", "pass")
    for name, arguments in STARTS.items():
        taken = seconds(*arguments)
        print(f"{name:<28}{taken:6.2f} s{taken - base:+7.2f} s")
    with tempfile.TemporaryDirectory() as folder:
        arguments = ("-m", "uavdh_lite", "demo", "--out", str(Path(folder) / "demo.png"))
        taken = seconds(*arguments, processes=1)
    print(f"{'uavdh_lite demo':<28}{taken:6.2f} s{taken - base:+7.2f} s")
