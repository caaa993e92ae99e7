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
from matplotlib.patches import Rectangle

from uavdh_lite.city import City
from uavdh_lite.plotting import BLUE, ORANGE, SKY_BLUE, TALL, VERMILION, draw_city
from uavdh_lite.shadowing import crossed_cells, line_of_sight, passed_corners

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
# | **What you'll do** | Follow one ray from cell to cell, turn it into a test with whole numbers, compute whole shadow maps, and compare with sampled rays and with the rasterised rays that the paper's authors used |
# | **What you'll learn** | Exact geometry without rounding, what "blocked" means at a corner, and where Bresenham's lines go wrong |
# | **What you'll need** | Notebook 1, the equation of a line. 42 minutes to read, 20 seconds to run; 12 minutes of exercises. An appendix, 3 minutes more, says what it costs |
#
# ## 2.1 One ray
#
# A link goes from the middle of the device's cell to the middle of the cell below the UAV. It is
# blocked if the straight segment between them crosses the inside of a building's cell, seen from above.
# The model is flat: the shadows know no heights. A low building may be flown over, yet a UAV above it has no line of
# sight to anyone, though from above a low roof one would really see the street. That is a simplification, not physics.
# Which cells does the segment cross? From (0, 0) to (2, 5):

# %%
crossed = crossed_cells(2, 5)
print(crossed.tolist())

# %%
def paint(ax, cells, **style):
    for row, col in cells:
        ax.add_patch(Rectangle((col - 0.5, row - 0.5), 1, 1, **style))

def draw_ray(ax, rows, cols, cells=(), margin=0):
    paint(ax, cells, color=SKY_BLUE, alpha=0.6, lw=0)
    ax.plot([0, cols], [0, rows], "o-", color="black", zorder=3)
    for axis, end in ((ax.xaxis, cols), (ax.yaxis, rows)):
        axis.set_ticks(range(-margin, end + margin + 1))
        axis.set_ticks(np.arange(-margin, end + margin) + 0.5, minor=True)
    ax.grid(which="minor", color="0.6")
    ax.tick_params(which="both", length=0)
    ax.set(xlabel="column", ylabel="row", aspect="equal", xlim=(-margin - 0.5, cols + margin + 0.5),
           ylim=(rows + margin + 0.5, -margin - 0.5))

# %%
figure = Figure(figsize=(5.5, 2.7), layout="constrained")
draw_ray(figure.subplots(), 2, 5, crossed)
figure

# %% [markdown]
# The blue cells are crossed, two of them only just. How does the program know? The line through (0, 0)
# and $(R, C)$ is the set of points $(r, c)$ with $R\,c - C\,r = 0$. On one side of it this number is
# positive, on the other side negative. Compute it at the corners of the cells, doubled, so that it
# is whole:

# %%
R, C = 2, 5
figure = Figure(figsize=(5.5, 2.9), layout="constrained")
ax = figure.subplots()
draw_ray(ax, R, C, crossed)
for r, c in np.ndindex(R + 2, C + 2):
    value = R * (2 * c - 1) - C * (2 * r - 1)  # twice the number at row r - 1/2, column c - 1/2
    box = {"boxstyle": "round", "fc": BLUE if value > 0 else VERMILION, "lw": 0}
    ax.text(c - 0.5, r - 0.5, f"{value:+d}", ha="center", va="center", color="white", fontsize=9, bbox=box)
figure

# %% [markdown]
# A crossed cell has corners on both sides of the line: plus and minus, blue and red. The other cells
# have four corners of one colour, so the line passes them by. That is the whole test.
#
# It needs only the middle of a cell, not its corners. From the middle to a corner, row and column change
# by ½. So $R\,c - C\,r$ changes by $(|R| + |C|)/2$ at the two corners where it changes most. In the middle of cell
# (1, 1) it is $2 - 5 = -3$, and at these corners $-3 \pm 3.5$: one is above 0. So
# the line crosses the cell. In the middle of (0, 2) it is 4, and $4 - 3.5$ is still above 0: all corners have one sign, and
# the line passes by. It misses the inside of a cell if the number in the middle is, without its sign, at least that large:
#
# $$|R\,c - C\,r| \;\ge\; \frac{|R| + |C|}{2}.$$
#
# Here is $2\,|R\,c - C\,r|$ in the middle of each cell. The dashed lines are where it equals
# $|R| + |C| = 7$:

# %%
figure = Figure(figsize=(5.5, 3.6), layout="constrained")
ax = figure.subplots()
draw_ray(ax, R, C, crossed, margin=1)
for r, c in np.ndindex(R + 3, C + 3):
    number = 2 * abs(R * (c - 1) - C * (r - 1))
    ax.plot(c - 1, r - 1, ".", color=BLUE if number < R + C else "0.6")
    ax.text(c - 0.95, r - 1.12, number, fontsize=9, zorder=5, bbox={"fc": "white", "lw": 0, "pad": 0.5})
for side in (-1, 1):
    ax.axline((side * (R + C) / (2 * R), 0), slope=R / C, color=BLUE, ls="--", lw=1)
ax.add_patch(Rectangle((-0.5, -0.5), C + 1, R + 1, fill=False, lw=2.5))
figure

# %% [markdown]
# Cells with less than 7 have their middle between the dashed lines: the blue dots. (1, 1) is just inside with 6, (0, 2)
# just outside with 8. A segment ends, a line does not: so only cells in the thick rectangle, from
# (0, 0) to $(R, C)$, are asked. All numbers are whole, so there is no rounding and no tolerance. The
# library's own lines are these:

# %%
import inspect

lines = inspect.getsource(crossed_cells).splitlines()
print("\n".join(lines[-4:]))

# %% [markdown]
# How does one test such a program? Comparing it with one in floating-point numbers will not do. The ray to (7, 25) passes exactly through a corner, at row 3.5 and column 12.5. Where is
# it there in floating-point numbers, and where in fractions?

# %%
from fractions import Fraction

print("floating point:", 7 / 25 * 12.5, "  fractions:", Fraction(7, 25) * Fraction(25, 2))

# %% [markdown]
# In floating point it misses the corner. Two such programs can round in the same way and agree on a wrong answer. So the
# library's tests compare with a slow program that uses fractions only.

# %% [markdown]
# ### At the corners

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("touching_a_corner")

# %% [markdown]
# A diagonal ray passes exactly through corners. At each corner it touches two more cells, one on either
# side. Touching is not crossing: with `<` and not `<=`, they stay out. The library lists them as pairs:

# %%
figure = Figure(figsize=(3.6, 3.6), layout="constrained")
ax = figure.subplots()
draw_ray(ax, 3, 3, crossed_cells(3, 3))
for letter, pair in zip("abc", passed_corners(3, 3)):
    for row, col in pair:
        ax.text(col, row, letter, ha="center", va="center")
figure

# %% [markdown]
# Four cells are crossed. The two cells with the same letter are a pair: they meet where the ray passes
# between them. What if there are buildings in them?

# %%
figure = Figure(figsize=(7, 2.7), layout="constrained")
for ax, cells in zip(figure.subplots(1, 3), ([(1, 2)], [(1, 2), (3, 2)], [(1, 2), (2, 1)])):
    blocks = np.zeros((4, 4), bool)
    blocks[tuple(zip(*cells))] = True
    draw_ray(ax, 3, 3)
    paint(ax, cells, **TALL)
    ax.set_title("seen" if line_of_sight(blocks)[0, 0, 3, 3] else "blocked")
figure

# %% [markdown]
# One building of a pair does not block the ray, nor do two of different pairs. Both of one pair do: walls
# that meet leave no gap. One could decide otherwise; what matters is that it is *one* decision, and the
# same in both directions. `sight` is a table with four indices: `sight[r, c, R, C]` says whether cell $(r, c)$ sees cell
# $(R, C)$. Numbered row after row, that is 256 by 256 cells. If the device sees the UAV, the UAV sees the device:

# %%
pairs = sight.reshape(256, 256)
assert (pairs == pairs.T).all()
free = ~city.buildings.ravel()
print(f"{pairs.mean():.1%} of all pairs see each other, {pairs[free][:, free].mean():.1%} of the pairs of free cells")

# %% [markdown]
# ### Why not sample the ray?
#
# A simpler program walks along the ray in small steps and notes in which cell it is. Here are steps as
# long as a cell:

# %%
def sample(start, end, step):
    way = np.subtract(end, start)
    length = np.hypot(way[..., :1], way[..., 1:]).clip(step)  # not 0, which would divide by 0
    for walked in np.arange(0, length.max() + step, step):
        yield start + np.minimum(walked / length, 1) * way

# %%
points = np.array(list(sample(np.array([0, 0]), (2, 5), step=1)))
found = set(map(tuple, np.rint(points).astype(int).tolist()))
missed = set(map(tuple, crossed.tolist())) - found

# %%
figure = Figure(figsize=(5.5, 2.7), layout="constrained")
ax = figure.subplots()
draw_ray(ax, 2, 5, found)
ax.plot(points[:, 1], points[:, 0], "o", color=ORANGE, mec="black", zorder=4)
paint(ax, missed, facecolor="none", edgecolor=VERMILION, hatch="///", lw=2)
figure

# %% [markdown]
# The steps jump over the hatched cells, because the ray stays in each of them for less than one step. A building there would be
# missed. How often does that decide? Count the pairs of cells that get the wrong answer, in both cities of the paper and in
# one where every fifth cell, drawn at random, is a building:

# %%
def wrong_pairs(buildings, step):
    cells = np.argwhere(np.ones_like(buildings))
    blocked = np.zeros((256, 256), bool)
    for points in sample(cells[:, None], cells, step):
        row, col = np.moveaxis(np.rint(points).astype(int), -1, 0)
        blocked |= buildings[row, col]
    return np.argwhere(blocked == line_of_sight(buildings).reshape(256, 256))  # `blocked` should be its opposite

# %%
maps = {"manhattan": city.buildings, "open_field": City.load("open_field").buildings,
        "random": np.random.default_rng(0).random((16, 16)) < 0.2}

# %%
print(f"{'step, cells':<14}", *(f"{name:>12}" for name in maps))
for step in (1, 1 / 2, 1 / 4, 1 / 8, 1 / 16):
    print(f"{step:<14}", *(f"{len(wrong_pairs(buildings, step)):>12}" for buildings in maps.values()))

# %% [markdown]
# Smaller steps make fewer mistakes, but how small is small enough depends on the city. In the random city
# some mistakes stay. Does the ray pass between two buildings at their common corner there, with no point in either?

# %%
def between_two(buildings, start, end):
    return any(buildings[tuple(start + one)] and buildings[tuple(start + other)]
               for one, other in passed_corners(*(end - start)))

# %%
wrong = np.stack(np.divmod(wrong_pairs(maps["random"], 1 / 16), 16), axis=-1)
print(sum(between_two(maps["random"], *pair) for pair in wrong), "of", len(wrong))

# %% [markdown]
# In all of them. The exact test has no step to choose.
#
# ## 2.2 All rays at once
#
# The cells that a ray crosses depend only on the displacement $(R, C)$, not on where it starts. So for
# each displacement the library shifts the building layer by each crossed cell and joins the results: one array operation
# for each crossed cell (and one for each pair of cells at a corner that the ray passes), and all pairs with this displacement
# are decided. For (0, 3), by hand:

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
# A building itself sees nothing: put the device into one and everything is dark. No device is ever placed there. But a UAV
# above a low building is just as blind, as 2.1 said.
#
# ## 2.4 Several devices: the shading of the paper's figures
#
# The paper shades each cell by the number of devices that are hidden from it: the more are hidden, the deeper the shade.
# Sum the maps (here with the shades further apart than in other figures):

# %%
devices = [(4, 4), (7, 9), (14, 11)]
hidden = sum(~sight[row, col] for row, col in devices)
figure = Figure(figsize=(6, 6), layout="constrained")
ax = draw_city(figure.subplots(), city, shadow_sum=np.array([0, 0.4, 1.8, 5])[hidden])
for row, col in devices:
    ax.plot(col, row, "X", color=ORANGE, mec="white", ms=13)
for number in np.unique(hidden):
    print(f"{(hidden == number).sum():>4} cells with {number} of 3 devices hidden")
figure

# %% [markdown]
# A white cell would be one from which the UAV sees all three. For these devices there is none: the ten palest cells see
# two. So there is no place to hover and serve everyone, and the UAV has to travel. (For other devices there may be one.)
#
# ## 2.5 Bresenham's lines, and where they differ
#
# The authors' code traces rays with a variant of Bresenham's algorithm, which was made to draw lines on a screen.
# It goes from cell to cell, one row or one column at a time, and a running error says which of the two. A step along the
# columns lowers the error by $|R|$, a step along the rows raises it by $|C|$. So the path takes columns and rows in the
# ratio $|C| : |R|$ and stays near the ray. The start value and the comparison are the authors':

# %%
def bresenham(rows, cols):
    path, error = [(0, 0)], abs(cols) - abs(rows)
    while path[-1] != (rows, cols):
        row, col = path[-1]
        if 4 * error > abs(cols) - abs(rows):  # the rule of the authors' code
            path, error = [*path, (row, col + np.sign(cols))], error - abs(rows)
        else:
            path, error = [*path, (row + np.sign(rows), col)], error + abs(cols)
    return path

# %%
def compare(ax, path, title):
    exact, path = set(map(tuple, crossed.tolist())), set(path)
    draw_ray(ax, 2, 5, path)
    paint(ax, path - exact, facecolor="none", edgecolor="0.3", hatch="..", lw=0)
    paint(ax, exact - path, facecolor="none", edgecolor=VERMILION, hatch="///", lw=2)
    ax.set_title(title)

# %%
figure = Figure(figsize=(5.5, 2.7), layout="constrained")
compare(figure.subplots(), bresenham(2, 5), "Bresenham, from (0, 0)")
figure

# %% [markdown]
# Bresenham's line skips the hatched cell, which the ray clips, and takes the dotted one, which the ray only
# comes near.

# %%
Quiz("both_ways")

# %%
figure = Figure(figsize=(5.5, 2.7), layout="constrained")
back = [(2 + row, 5 + col) for row, col in bresenham(-2, -5)]
compare(figure.subplots(), back, "Bresenham, from (2, 5)")
figure

# %% [markdown]
# From the other end, the same ray skips another cell. So a building can block one direction only.
#
# The Bresenham of textbooks also takes diagonal steps: one cell in each column, in the row nearest to the ray. For the
# ray from (0, 0) to (1, 2) two rows are equally near in column 1, and the rounding decides. Here it keeps the row of the start:

# %%
def textbook(rows, cols):  # for rays with more columns than rows
    nearest = np.ceil(abs(rows * np.arange(abs(cols) + 1) / cols) - 0.5)  # a tie keeps the row
    return [(int(np.sign(rows) * row), int(np.sign(cols) * k)) for k, row in enumerate(nearest)]

# %%
for line in (textbook, bresenham):
    back = [(int(1 + row), int(2 + col)) for row, col in line(-1, -2)]
    print(f"{line.__name__:<10}there {[(int(r), int(c)) for r, c in line(1, 2)]}, back {back}")

# %% [markdown]
# A building at (0, 1) would block the textbook line in one direction only. The variant takes both cells on this ray, and
# is asymmetric on others, such as the one to (2, 5) above.
#
# In the authors' code rays go from the device to each cell of the border, and a cell counts as seen if some ray
# reaches it before it meets a building. The library's `method="bresenham"` does the same:

# %%
device, border, seen = (4, 4), [0, 15], set()
for row, col in np.ndindex(16, 16):
    for r, c in bresenham(row - 4, col - 4) if row in border or col in border else ():
        if city.buildings[4 + r, 4 + c]:
            break
        seen.add((4 + r, 4 + c))

# %%
fan = line_of_sight(city.buildings, "bresenham")
assert seen == set(map(tuple, np.argwhere(fan[device])))

# %% [markdown]
# How many pairs does that change in the city?

# %%
rays = fan.reshape(256, 256)
asked = free[:, None] & free & ~np.eye(256, dtype=bool)  # device and UAV over different free cells

# %%
wrong, one_way = (rays != pairs) & asked, (rays != rays.T) & asked
links, both = asked.sum(), (wrong & wrong.T).sum() // 2
print(f"{links} links, from a device to a UAV: Bresenham and exact differ in {wrong.sum()}, {wrong.sum() / links:.1%}")
print(f"{links // 2} pairs of cells, two links each: one link wrong in {one_way.sum() // 2}, "
      f"{one_way.sum() / links:.1%}, both in {both}")

# %% [markdown]
# A pair with one wrong link is connected one way only. The second share is nearly twice the first, because there are half
# as many pairs as links.

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
# This is the device for which the two differ most. Does it matter for the agent? We do not know: no agent was trained
# with Bresenham's shadows. But radio works both ways: a channel that connects in one direction only is hard to explain.
# The library's default is exact.
#
# ## Recap
#
# - A link is blocked if its segment crosses the open inside of a building's cell: a comparison of
#   whole numbers.
# - Which cells are crossed depends only on the displacement, so a few array operations decide all pairs
#   that share it.
# - Two buildings that meet at a corner block the ray between them.
# - Samples along a ray jump over cells.
# - Exact lines of sight are symmetric; Bresenham's fan is not, and some of its links are wrong.
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
# (The segment crosses $R$ lines between rows and $C$ lines between columns, and enters a new cell at each. With the first cell
# that is $R + C + 1$. When both are odd, two of these lines are crossed at once, at a corner in the middle: one less.)
#
# **2.** Which cell of the city sees the most other cells? Print it and its share.

# %%
share = sight.mean(axis=(2, 3))
best = divmod(int(share.argmax()), 16)
assert not city.buildings[best] and (share <= share[best]).all()
print(best, f"{share[best]:.0%}")

# %% [markdown]
# ## Appendix: what it costs
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

# %%
for size in (8, 16, 32):
    exact, fan_of_rays = seconds(size, "exact"), seconds(size, "bresenham")
    print(f"{size:>2} cells a side: exact {1000 * exact:6.1f} ms, Bresenham {1000 * fan_of_rays:6.1f} ms")

# %% [markdown]
# The times are those of one machine. Exact takes roughly ten times as long here, but still a fraction of a second. (The
# times grow less than sixteenfold from row to row: in small cities most of the time goes into calling the array operations.)
# And it is done once for a city: the table is kept, $16^4$ = 65,536 Boolean values, and flying only looks things up.
#
# ## Further reading
#
# - Bresenham: *Algorithm for computer control of a digital plotter*, IBM Systems Journal, 1965.
# - Amanatides and Woo: *A fast voxel traversal algorithm for ray tracing*, Eurographics 1987, the
#   usual way to visit crossed cells one by one.
# - The next notebook: **3 · The environment**, where these links carry data.
