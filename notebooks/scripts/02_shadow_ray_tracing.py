# %% [markdown]
# # 2 · Shadow ray tracing
#
# Whether the UAV hears a device depends on what stands between them. This notebook decides it for
# every pair of cells, first for one ray with a pencil, then for all 65,536 pairs of a city at once.

# %% tags=["remove-cell"]
# Without uavdh_lite installed, as on Colab: find the project's folder and install it from there.
from glob import glob
from importlib.metadata import distributions

project = [path for path in ("..", ".", *glob("*")) if glob(f"{path}/uavdh_lite/city.py")]
assert project, "the project's folder is not here: clone or upload it, then run this cell again"
# %cd -q {project[0]}/notebooks
if not any(distributions(name="uavdh_lite")):
    print("installing uavdh_lite from its folder")
    # %pip install -q .. ipywidgets

# %%
# %matplotlib inline
import numpy as np
from matplotlib.figure import Figure

from uavdh_lite.city import City
from uavdh_lite.plotting import ORANGE, draw_city
from uavdh_lite.shadowing import crossed_cells, line_of_sight

city = City.load("manhattan")
sight = line_of_sight(city.buildings)
device = (4, 4)
figure = Figure(figsize=(6, 6), layout="constrained")
ax = draw_city(figure.subplots(), city, shadow_sum=4 * ~sight[device])
ax.plot(device[1], device[0], "X", color=ORANGE, mec="white", ms=13)
ax.set_title("violet: where the device at the cross cannot be seen")
figure

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Follow one ray from cell to cell, turn it into a test with whole numbers, compute whole shadow maps, and compare with the rasterised rays that the paper's authors used |
# | **What you'll learn** | Exact geometry without rounding, what "blocked" means at a corner, where Bresenham's lines go wrong, and what it costs |
# | **What you'll need** | Notebook 1, the equation of a line. 28 minutes to read, 10 seconds to run; 12 minutes of exercises |
#
# ## 2.1 One ray
#
# A link goes from the middle of the device's cell to the middle of the cell below the UAV. It is
# blocked if the straight segment between them crosses the inside of a building's cell, seen from above:
# the model is flat, and any building blocks, however high it or the UAV is. (So a UAV above a low
# building has no line of sight to anyone.) Which cells does the segment cross? From (0, 0) to (2, 5):

# %%
crossed = crossed_cells(2, 5)
print(crossed.tolist())

# %%
def draw_ray(rows, cols):
    figure = Figure(figsize=(5.5, 3.2), layout="constrained")
    ax = figure.subplots()
    for row, col in crossed_cells(rows, cols):
        ax.fill_between([col - 0.5, col + 0.5], row - 0.5, row + 0.5, color="#9DC3E6")
    ax.plot([0, cols], [0, rows], "o-", color="black")
    low, high = min(cols, 0) - 1, max(cols, 0) + 1
    ax.set(xticks=range(low, high + 1), yticks=range(min(rows, 0) - 1, max(rows, 0) + 2))
    ax.set(xlabel="column", ylabel="row", aspect="equal")
    ax.set_xticks(np.arange(low, high) + 0.5, minor=True)
    ax.set_yticks(np.arange(min(rows, 0) - 1, max(rows, 0) + 1) + 0.5, minor=True)
    ax.grid(which="minor")
    ax.invert_yaxis()
    return figure

draw_ray(2, 5)

# %% [markdown]
# How does the program know? For each cell it asks whether the line passes the cell's square or not.
# The line through (0, 0) and $(R, C)$ is the set of points $(r, c)$ with $R\,c - C\,r = 0$. The left side
# is (up to a factor) the distance of a point from the line. At a corner of a square of side 1, row and
# column differ from its middle's by ±½, so $R\,c - C\,r$ differs by at most $(|R| + |C|)/2$. So the line
# misses the square's inside exactly if
#
# $$|R\,c - C\,r| \;\ge\; \frac{|R| + |C|}{2}.$$
#
# A segment ends, a line does not: only cells in the rectangle from (0, 0) to $(R, C)$ are asked. All
# are whole numbers once both sides are doubled, so there is no rounding and no tolerance. Check
# it for the cell (1, 1) by hand, then for all:

# %%
R, C = 2, 5
for row, col in ((1, 1), (1, 3), (2, 3), (0, 2)):
    left, right = 2 * abs(R * col - C * row), abs(R) + abs(C)
    print((row, col), f"{left} < {right}: {'crossed' if left < right else 'missed'}")

# %% [markdown]
# Look at (1, 1): $2\cdot|2 \cdot 1 - 5 \cdot 1| = 6 < 7$. The picture shows how near it was. The
# library's own lines are these:

# %%
import inspect

lines = inspect.getsource(crossed_cells).splitlines()
print("\n".join(lines[-4:]))

# %% [markdown]
# ### At the corners

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("touching_a_corner")

# %% [markdown]
# A diagonal ray passes exactly through corners. Touching is not crossing: with `<` and not `<=`, the
# cells that it only touches stay out.

# %%
print(crossed_cells(3, 3).tolist())
draw_ray(3, 3)

# %% [markdown]
# One case needs a rule of its own. Two buildings touch at a corner, and a ray goes exactly through it: it
# crosses neither, but walls that meet leave no gap. Such a pair blocks the ray; `passed_corners` lists the
# pairs. A careful reader may decide otherwise; what matters is that it is *one* decision, and the same in
# both directions. If the device sees the UAV, the UAV sees the device:

# %%
pairs = sight.reshape(256, 256)
assert (pairs == pairs.T).all()
free = ~city.buildings.ravel()
print(f"{pairs.mean():.1%} of all pairs see each other, {pairs[free][:, free].mean():.1%} of the pairs of free cells")

# %% [markdown]
# ## 2.2 All rays at once
#
# The cells that a ray crosses depend only on the displacement $(R, C)$, not on where it starts. So for
# each displacement the library shifts the building layer by each crossed cell and joins the results:
# one line of array code treats all pairs with this displacement. For (0, 3), by hand:

# %%
buildings = city.buildings
height, width = 16, 16 - 3
blocked = np.zeros((height, width), bool)
for row, col in crossed_cells(0, 3):
    blocked |= buildings[row : row + height, col : col + width]
rows, cols = np.indices(blocked.shape)
assert (sight[rows, cols, rows, cols + 3] == ~blocked).all()
print(blocked.size, "pairs decided in", len(crossed_cells(0, 3)), "operations")

# %% [markdown]
# ## 2.3 Move the device
#
# The shadow map of a device is a slice of the table, so moving the device costs nothing. Move it
# along a street and watch the shadows sweep.

# %%
def draw_shadow(row, col):
    figure = Figure(figsize=(5.5, 5.5), layout="constrained")
    dark = 4 * ~sight[row, col]  # as dark as if hidden from four devices
    ax = draw_city(figure.subplots(), city, shadow_sum=dark)
    ax.plot(col, row, "X", color=ORANGE, mec="white", ms=13)
    ax.set_title(f"seen from {sight[row, col].mean():.0%} of the cells")
    return figure

# %%
import ipywidgets

from uavdh_lite.labs.widgets import explore

explore(
    draw_shadow,
    row=ipywidgets.IntSlider(value=7, min=0, max=15, description="row"),
    col=ipywidgets.IntSlider(value=9, min=0, max=15, description="column"),
)

# %%
draw_shadow(7, 9)

# %% [markdown]
# A building itself sees nothing: put the device into one and everything is dark. Devices are never
# placed there, so this never matters in an episode.
#
# ## 2.4 Several devices: the shading of the paper's figures
#
# The paper shades each cell by the number of devices that are hidden from it: the deeper, the more.
# Sum the maps:

# %%
devices = [(4, 4), (7, 9), (14, 11)]
hidden = sum(~sight[row, col] for row, col in devices)
figure = Figure(figsize=(6, 6), layout="constrained")
ax = draw_city(figure.subplots(), city, shadow_sum=hidden)
for row, col in devices:
    ax.plot(col, row, "X", color=ORANGE, mec="white", ms=13)
for number in np.unique(hidden):
    print(f"{(hidden == number).sum():>4} cells from which {number} devices are hidden")
figure

# %% [markdown]
# A white cell would be one from which the UAV sees all three. There is none, no place to hover and
# serve everyone. The UAV has to travel, and that is why there is something to learn.
#
# ## 2.5 Bresenham's lines, and where they differ
#
# The authors' code traces rays with Bresenham's algorithm, which was made to draw lines on a screen.
# It steps from cell to cell and picks the nearest to the line, so it skips cells that the line
# crosses only a little. Rays go from the device to each cell of the border, and a cell counts as seen
# if some ray reaches it before it meets a building.

# %%
Quiz("both_ways")

# %%
fan = line_of_sight(city.buildings, "bresenham")
rays = fan.reshape(256, 256)
asked = free[:, None] & free & ~np.eye(256, dtype=bool)  # device and UAV over different free cells
print(f"The two differ in {(rays != pairs)[asked].mean():.1%} of the pairs of different free cells.")
print(f"In {(rays != rays.T)[asked].mean():.1%} of them Bresenham's lines connect one way only.")

# %%
worst = np.argmax((rays != pairs).sum(axis=1) * free)
row, col = divmod(int(worst), 16)
figure = Figure(figsize=(10, 5), layout="constrained")
for ax, name, table in zip(figure.subplots(1, 2), ("exact", "Bresenham"), (sight, fan)):
    draw_city(ax, city, shadow_sum=4 * ~table[row, col])
    ax.plot(col, row, "X", color=ORANGE, mec="white", ms=13)
    ax.set_title(name)
figure

# %% [markdown]
# This is the device for which the two differ most. Does it matter for the agent? It learns with
# whatever shadows it is given, so mostly not; but a channel that works in one direction only is hard
# to explain, and exact costs little, as the next section measures. The library's default is exact.
#
# ## 2.6 What it costs
#
# A city of $M$ cells a side has $M^4$ pairs, so doubling the side makes sixteen times the pairs. On a
# random city of growing size:

# %%
import time

def seconds(size, method):
    drawn, best = np.random.default_rng(0).random((size, size)) < 0.2, np.inf
    for _ in range(3):  # the quickest of three: other programs only make it slower
        started = time.process_time()
        line_of_sight(drawn, method)
        best = min(best, time.process_time() - started)
    return best

sizes = (8, 12, 16, 24, 32)
cost = {m: [seconds(size, m) for size in sizes] for m in ("exact", "bresenham")}

# %%
figure = Figure(figsize=(5.5, 3.6), layout="constrained")
ax = figure.subplots()
for method, times in cost.items():
    ax.loglog(sizes, times, "o-", label=method)
ax.loglog(sizes, cost["exact"][-1] * (np.array(sizes) / 32) ** 4, ":", label="slope 4")
ax.set_xticks(sizes, map(str, sizes))
ax.set(xlabel="cells a side", ylabel="processor time, s")
ax.minorticks_off()
ax.legend()
figure

# %% [markdown]
# Exact takes many times as long as the fan of rays; how many times depends on the size and on the machine. But
# it is done once for a city, and flying only looks things up. In cities of these sizes much of the time is the
# fixed price of each array operation, not the number of pairs: so the curve of exact is flatter than the slope
# of 4.
#
# ## Recap
#
# - A link is blocked if its segment crosses the open inside of a building's cell: a comparison of
#   whole numbers.
# - Which cells are crossed depends only on the displacement, so one array operation decides all pairs
#   that share it.
# - Exact lines of sight are symmetric; Bresenham's fan is not, and differs in some pairs.
#
# ## Exercises
#
# A few with their answers. More, to write yourself, with checks and hints, are in
# [`exercises/02_shadow_ray_tracing`](exercises/02_shadow_ray_tracing/02_shadow_ray_tracing.ipynb).
#
# **1.** How many cells does the segment from (0, 0) to $(R, C)$ cross if $R$ and $C$ have no common
# divisor? Find the formula from a few cases. (Odd and even are different; try both odd.)

# %%
def crossed_count(rows, cols):
    both_odd = rows % 2 == 1 and cols % 2 == 1
    return rows + cols if both_odd else rows + cols + 1

# %%
from math import gcd

for rows, cols in [(r, c) for r in range(1, 9) for c in range(1, 9) if gcd(r, c) == 1]:
    assert crossed_count(rows, cols) == len(crossed_cells(rows, cols)), (rows, cols)

# %% [markdown]
# (When both are odd, the middle of the segment is exactly on a corner, and one crossing is saved.)
#
# **2.** Which cell of the city sees the most other cells? Print it and its share.

# %%
share = sight.mean(axis=(2, 3))
best = divmod(int(share.argmax()), 16)
assert not city.buildings[best] and (share <= share[best]).all()
print(best, f"{share[best]:.0%}")

# %% [markdown]
# ## Further reading
#
# - Bresenham: *Algorithm for computer control of a digital plotter*, IBM Systems Journal, 1965.
# - Amanatides and Woo: *A fast voxel traversal algorithm for ray tracing*, Eurographics 1987, the
#   usual way to visit crossed cells one by one.
# - The next notebook: **3 · The environment**, where these links carry data.
