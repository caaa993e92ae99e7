# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Exercises 14 · A real city
#
# These exercises go with notebook `14_a_real_city`. You need numpy, and means of products.
#
# Write your answer where a cell raises `NotImplementedError`, then run the cell below it. The check says whether the answer is
# right, and if not, what is probably wrong. Hints are folded away below each task. Your code runs inside this notebook. If it
# never finishes, interrupt the kernel with the stop button.
#
# If you are still stuck after a quarter of an hour with all the hints, read the solution, close it, and write your own from
# memory. Solutions are in the folder `solutions`, beside `exercises`, unless somebody handed you a copy of the course without
# them.

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

from uavdh_lite.course import checks

# %% [markdown]
# ## 14.1 · How far does a shadow reach? (2 points, 12 minutes)
#
# In the paper, shadow fading is drawn anew for each slot. In a real street it belongs to the place, so neighbouring cells
# resemble each other (notebook 14, section 14.3). How far does this resemblance reach? A UAV flies down a straight street past
# one device. In each cell, take the **residual**: how far the measured SNR is above the fitted line.
#
# - `left_db`: array of shape $(N,)$, the residuals in dB, cell by cell; $N \ge 2$, and not all values are equal
# - `step_m`: the distance from one cell to the next, in m
#
# Subtract the mean first. The *correlation* at a distance of $k$ cells is the mean product of all pairs of values that are $k$
# cells apart, divided by the mean square of all values. It is 1 at $k=0$. Return the first distance, in metres, at which it is
# below $1/e$. This distance is called the **decorrelation distance**.
#
# An example: the residuals 4, 4, −4, −4 and steps of 10 m. One cell apart, the products are 16, −16 and 16, with a mean of
# 5.3, and the mean square is 16: the correlation is 0.33, which is below $1/e = 0.37$, so the distance is 10 m.
#
# <details><summary>Hint</summary>
#
# How do you get all pairs that are $k$ cells apart without a loop over cells? Think of two slices
# of one array.
# </details>
#
# <details><summary>Another hint</summary>
#
# `off[k:] * off[:-k]` gives all the products. Begin with k = 1, and go on as long as their mean, divided by
# `np.mean(off**2)`, is not below 1/e. The distance is k times step_m.
# </details>

# %%
def reach_m(left_db, step_m):
    """The first distance, m, at which the residuals are hardly correlated any more."""
    ### BEGIN SOLUTION
    off = left_db - left_db.mean()
    for k in range(1, len(off)):
        if np.mean(off[k:] * off[:-k]) / np.mean(off**2) < 1 / np.e:
            return k * step_m
    ### END SOLUTION

# %%
checks.shadow_reach(reach_m)

# %% [markdown]
# Why is there always such a distance? All products of two *different* values add up to minus half the sum of the squares,
# because the mean was subtracted. Therefore, at some distance the mean product is negative.

# %% [markdown]
# ## 14.2 · Believe what you heard (2 points, 12 minutes)
#
# A fitted line says what SNR to expect of a link. Nearby, a few SNRs were measured. What should the agent believe about this link? As in
# notebook 14, section 14.6,
#
# $$\widehat{\mathrm{SNR}} = \text{line} + \frac{\sum_i w_i\,(\text{heard}_i - \text{line})}{1 + \sum_i w_i}$$
#
# - `line_db`: what the line says, one number, dB,
# - `heard_db`: array of shape $(N,)$, what was heard nearby, dB; $N$ may be 0,
# - `weight`: array of shape $(N,)$, the weight of each measurement, from 0 (far away) to 1 (here).
#
# Return the SNR to believe, one number. In the notebook the line's value differs from place to place; here it is the same for the link and for what was heard near it.
#
# An example: the line says −10 dB. Right here, −20 dB was heard, with a weight of 1. The line and the measurement count equally, so
# believe −15 dB.
#
# <details><summary>Hint</summary>
#
# Start with the example. How far is the measurement off? How much of that do you believe?
# </details>
#
# <details><summary>Another hint</summary>
#
# With numpy, weight * (heard_db - line_db) gives all the products at once. What is np.sum of an empty array?
# </details>

# %%
def corrected(line_db, heard_db, weight):
    """The SNR of a link, dB: the line, corrected by what was heard nearby."""
    ### BEGIN SOLUTION
    error_db = heard_db - line_db
    return line_db + np.sum(weight * error_db) / (1 + np.sum(weight))
    ### END SOLUTION

# %%
checks.corrected(corrected)
