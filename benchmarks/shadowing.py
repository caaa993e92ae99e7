"""Time and memory of the shadow maps by map size, exact against Bresenham.

    python benchmarks/shadowing.py

`ratio` is exact over Bresenham. Memory is the most that numpy held at a time.
"""

import time
import tracemalloc

from uavdh_lite.city import City
from uavdh_lite.shadowing import METHODS, line_of_sight


def measure(buildings, method: str) -> tuple[float, float]:
    """Best of three in seconds, and the peak memory in MB."""
    seconds = []
    for _ in range(3):
        started = time.perf_counter()
        line_of_sight(buildings, method)
        seconds.append(time.perf_counter() - started)
    tracemalloc.start()
    line_of_sight(buildings, method)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return min(seconds), peak / 1e6


if __name__ == "__main__":
    print(f"{'city':<12}{'size':>5}{'exact':>10}{'bresenham':>11}{'ratio':>7}{'exact MB':>10}")
    for name in ("manhattan", "harbour", "metropolis"):
        city = City.load(name)
        (exact, memory), (bresenham, _) = (measure(city.buildings, m) for m in METHODS)
        print(
            f"{name:<12}{city.size:>5}{exact:>9.3f}s{bresenham:>10.3f}s{exact / bresenham:>7.1f}"
            f"{memory:>10.1f}"
        )
