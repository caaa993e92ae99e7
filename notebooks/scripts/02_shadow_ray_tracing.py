# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # 2 · Shadow ray tracing
#
# **Where must the UAV be to see a device, and how can a program find this out?**
#
# The code below puts a device at the cross. When the UAV is over a violet cell, a building blocks
# its view of the device. To colour this map, a program follows one straight ray from the device to
# each cell and asks what the ray crosses. The hard part is getting the answer right every time.

# %% tags=["remove-cell"]
# Without uavdh_lite installed, as on Colab: install it from a wheel, or from the project's folder.
from glob import glob
from importlib.metadata import distributions
from os import chdir

wheel = ""  # its address, if you were given one; a wheel that lies beside this notebook is found
places = ("..", ".", "../..", "../../..", *glob("*"))
project = [path for path in places if glob(f"{path}/uavdh_lite/city.py")]
if not any(distributions(name="uavdh_lite")):
    source = [*filter(None, [wheel]), *glob("uavdh_lite-*.whl"), *project]
    assert source, "upload the wheel beside this notebook, or set its address above"
    # %pip install -q "{source[0]}" ipywidgets
if project:
    chdir(f"{project[0]}/notebooks")

# %%
# %matplotlib inline
import numpy as np
from matplotlib.figure import Figure

from uavdh_lite.missions import environment_of
from uavdh_lite.plotting import draw_city, shadow_sum
from uavdh_lite.shadowing import crossed_cells, line_of_sight

environment, device = environment_of("manhattan"), (7, 9)
figure = Figure(figsize=(5.5, 5.5), layout="constrained")
hidden = shadow_sum(environment, [device[0] * 16 + device[1]])  # the number of its cell
ax = draw_city(figure.subplots(), environment.city, 4 * hidden)  # as violet as 4 hidden devices
ax.plot(*device[::-1], "X", ms=13)
figure

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Follow one ray with a pencil, and map the shadows of a city |
# | **What you'll learn** | Exact geometry without rounding, and what happens at a corner |
# | **What you'll need** | Notebook 1, the equation of a line. 35 minutes to read, 10 seconds to run; 30 minutes of exercises |
#
# Move the device: change `(7, 9)`, run the cell again, and watch the shadows change.
#
# ## 2.1 One ray
#
# A link runs in a straight line from the middle of the device's cell to the middle of the cell
# below the UAV. The link is blocked if, seen from above, this line crosses the inside of a
# building. It is also blocked if the line would have to slip through the corner that two diagonally
# adjacent buildings share. A blocked link is NLoS, and notebook 1 says how much weaker it is than a
# link in sight. (Such a link still works, because some of the signal arrives by reflection and by
# bending round edges, which is called *diffraction*.)
#
# This model of line of sight is flat: it ignores height. A UAV above a low building has no device
# in sight, although from a real roof you could look down into the street.
#
# Here is a ray from cell (0, 0) to cell (2, 5). The blue cells are those that it crosses:

# %% tags=["hide-input"]
def draw_ray(ax, rows, cols, cells, cmap="Blues"):
    shade = np.zeros((rows + 1, cols + 1))
    shade[tuple(np.transpose(cells))] = 1
    ax.pcolormesh(range(cols + 1), range(rows + 1), shade, cmap=cmap, vmax=2, ec="0.7", lw=0.5)
    ax.plot([0, cols], [0, rows], "ko-")
    ax.set(xlabel="column", ylabel="row", aspect="equal", yticks=range(rows + 1))
    ax.set(xlim=(-0.9, cols + 0.9), ylim=(rows + 0.7, -0.7))

figure = Figure(figsize=(5.5, 2.7), layout="constrained")
draw_ray(figure.subplots(), 2, 5, crossed_cells(2, 5))
figure

# %% [markdown]
# Two of the eight blue cells are only just clipped at a corner. How does the program know that the
# ray crosses them? The line through (0, 0) and $(R, C)$ consists of all points $(r, c)$ with
#
# $$R\,c - C\,r = 0.$$
#
# On one side of the line the number $R\,c - C\,r$ is positive, and on the other side it is
# negative. Its sign thus says on which side of the line a point lies, so let us compute the number
# at the corners of the cells. There $r$ and $c$ end in ½, so we double all the numbers to make them
# whole:

# %% tags=["hide-input"]
from uavdh_lite.plotting import BLUE, VERMILION

R, C = 2, 5
figure = Figure(figsize=(5.5, 2.9), layout="constrained")
ax = figure.subplots()
draw_ray(ax, R, C, crossed_cells(R, C))
for r, c in np.ndindex(R + 2, C + 2):
    sign = R * (2 * c - 1) - C * (2 * r - 1)
    box = {"boxstyle": "round", "fc": BLUE if sign > 0 else VERMILION, "lw": 0}
    ax.text(c - 0.5, r - 0.5, f"{sign:+d}", ha="center", va="center", color="white", bbox=box)
figure

# %% [markdown]
# Look at the cells one by one. A crossed cell has corners on both sides of the line, some positive
# (blue) and some negative (orange). Any other cell has four corners of the same colour, so the line
# misses it. **That is the test.**
#
# A program need not look at all four corners, because the number in the middle of the cell is
# enough. Take cell (1, 1). In its middle the number is $2 - 5 = -3$ (not doubled, unlike the
# numbers in the drawing). From there to a corner, the row and the column each change by ½, so the
# number changes by at most $(2 + 5)/2 = 3.5$, and at two opposite corners by exactly that, up at
# one and down at the other. One of them therefore has a positive number and the other a negative
# one, and the ray crosses the cell. In the middle of cell (0, 2) the number is 4, and a change of
# 3.5 cannot take it below 0: the ray misses this cell. In general, for the line:
#
# $$\text{crossed} \quad\Longleftrightarrow\quad |R\,c - C\,r| < \frac{|R| + |C|}{2}.$$
#
# Here is the test for all cells at once. Both sides of the inequality are doubled, so that they are
# whole numbers:

# %%
R, C = 2, 5
r, c = np.indices((R + 1, C + 1))
crossed = 2 * abs(R * c - C * r) < R + C
print(crossed.astype(int))
assert (np.argwhere(crossed) == crossed_cells(R, C)).all()

# %% [markdown]
# A line goes on for ever, but our ray ends at the UAV, so we test only the cells in the rectangle
# between the ray's two ends.
#
# All numbers in the test are whole, so nothing has to be rounded. This matters wherever a ray
# passes exactly through a corner, as many do in a city made of squares. In a larger city, the ray
# from (0, 0) to (7, 25) passes through the point at row 3.5 and column 12.5. In ordinary
# floating-point arithmetic, `7 / 25 * 12.5` is 3.5000000000000004, so the ray seems to miss it.
#
# ## 2.2 At a corner
#
# What would you expect to happen where a ray meets a corner?

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("touching_a_corner")

# %% [markdown]
# A diagonal ray passes exactly through corners, and at each of them it touches two more cells, one
# on either side. In the next figure, grey cells are buildings:

# %% tags=["hide-input"]
figure = Figure(figsize=(7, 2.7), layout="constrained")
for ax, cells in zip(figure.subplots(1, 3), ([(1, 2)], [(1, 2), (3, 2)], [(1, 2), (2, 1)])):
    buildings = np.zeros((4, 4), bool)
    buildings[tuple(np.transpose(cells))] = True
    draw_ray(ax, 3, 3, cells, cmap="Greys")
    ax.set_title("seen" if line_of_sight(buildings)[0, 0, 3, 3] else "blocked")
figure

# %% [markdown]
# One building that touches the ray at a corner does not block it, and neither do two buildings at
# different corners. Two buildings at the same corner do block it, because walls that meet leave no
# gap.
#
# Other rules are possible. What matters is that one rule holds at all corners and gives the same
# answer in both directions.
#
# ## 2.3 A whole city
#
# Which cells a ray crosses, counted from its start, depends only on how far it goes down and to the
# right. So the library works out the crossed cells once for each such displacement, and shifts the
# whole layer of buildings under the ray.
#
# The result is a table with four indices, two for the device's cell and two for the UAV's: $16^4 =
# 65{,}536$ answers to the question whether the two see each other. It need be computed only once
# per city, because buildings do not move. During a flight the program only looks up entries, so the
# devices may stand elsewhere in the next mission at no extra cost.

# %%
sight = line_of_sight(environment.city.buildings)
assert (sight == sight.transpose(2, 3, 0, 1)).all()

# %% [markdown]
# The last line swaps the two ends of every ray, and nothing changes: if the device sees the UAV,
# the UAV sees the device.
#
# How much of the city can be seen from each cell?

# %%
figure = Figure(figsize=(5.5, 4.4), layout="constrained")
ax = draw_city(figure.subplots(), environment.city)
picture = ax.imshow(100 * sight.mean(axis=(2, 3)), zorder=1.5)
figure.colorbar(picture, label="cells in sight, %")
figure

# %% [markdown]
# From a building, nothing is in sight. In a street you can see a long way in two directions, and at
# a crossing in up to four. For a UAV the bright cells are good places, because more devices are
# likely to be in sight from there.
#
# ## 2.4 Several devices
#
# With several devices the shadows add up. Here, as on the paper's maps, the shade of each cell
# shows how many devices are hidden from it:

# %%
devices = [(4, 4), (7, 9), (14, 11)]
hidden = shadow_sum(environment, [row * 16 + col for row, col in devices])
figure = Figure(figsize=(5.5, 5.5), layout="constrained")
ax = draw_city(figure.subplots(), environment.city, 1.6 * hidden)  # a deeper violet
ax.plot([col for _, col in devices], [row for row, _ in devices], "X", ms=13)
figure

# %%
print("cells with 0, 1, 2 and 3 devices hidden:", np.bincount(hidden.ravel()))

# %% [markdown]
# There is no cell from which all three devices are in sight; from the palest cells, two are.
# Hovering in one good place is not enough here, so the UAV has to travel. Which places should it
# visit, and in which order? Deciding this is the agent's task.
#
# ## Recap
#
# - A link is blocked if, seen from above, the ray crosses the inside of a building.
# - A ray crosses a cell between its ends if corners of the cell lie on both sides. Whole numbers
#   are enough to decide this, so nothing is rounded.
# - Two buildings on either side of a corner block the ray through it. One of them alone does not.
# - A table says for every pair of cells whether one is in sight of the other, and the answer is the
#   same in both directions. The deeper the violet of a cell, the more devices are hidden from it.
#
# ## Exercises
#
# The exercises of this notebook, with checks and hints, are in
# [`exercises/02_shadow_ray_tracing`](exercises/02_shadow_ray_tracing/02_shadow_ray_tracing.ipynb).
#
# ## Further reading
#
# - Amanatides and Woo: *A fast voxel traversal algorithm for ray tracing*, Eurographics 1987.
