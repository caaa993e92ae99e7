# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Exercises 8 · Ablation: map centring
#
# These exercises go with notebook `08_ablation_map_centring`. You need numpy, means and standard
# deviations, and the p-value, which the page *Before you believe a surprise* explains.
#
# Write your answer where a cell raises `NotImplementedError`, then run the cell below it. The check
# says whether the answer is right, and if not, what is probably wrong. Hints are folded away below
# each task. Your code runs inside this notebook. If it never finishes, interrupt the kernel with
# the stop button.
#
# If you are still stuck after a quarter of an hour with all the hints, read the solution, close it,
# and write your own from memory. Solutions are in the folder `solutions`, beside `exercises`,
# unless somebody handed you a copy of the course without them.

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
import math
from itertools import combinations

import numpy as np

from uavdh_lite.course import checks

# %% [markdown]
# ## 8.1 · How many steps to a threshold (1 point, 8 minutes)
#
# During a training run the agent is validated now and then. The array `steps` gives the number of
# environment steps at each validation, in increasing order, and the array `values`, which is
# equally long, gives the results of the validations. The curve of such results rises, but falls
# back from time to time, so the first time that it crosses a threshold may be luck. Ask for more:
# the curve has to stay at or above the threshold for good.
#
# Find the first validation at which the value, like *all* later ones, is at least `threshold`, and
# return its number of environment steps. This number is an element of `steps`. Return `None` if there
# is no such validation, that is, if the last value is below `threshold`.
#
# <details><summary>Hint</summary>
#
# At which validations is the curve below the threshold? You are asked for the validation after the
# last of these. And what if no value is below the threshold, or if the very last one is?
# </details>
#
# <details><summary>Another hint</summary>
#
# Go through the validations backwards, with zip(steps[::-1], values[::-1]). At each value that is
# at least the threshold, keep its number of steps in place of the number that you kept before; stop
# at the first value below the threshold. If you have kept no number, return None.
# </details>

# %%
def steps_to(steps, values, threshold):
    """The environment steps at which the curve reaches the threshold for good, or None."""
    ### BEGIN SOLUTION
    reached = None
    for step, value in zip(steps[::-1], values[::-1]):
        if value < threshold:
            break
        reached = int(step)
    return reached
    ### END SOLUTION

# %%
checks.steps_to(steps_to)

# %% [markdown]
# The number of steps that you return is only as precise as the distance between two validations,
# and one unlucky validation late in the run can make it much larger, or leave you without any. The
# first crossing of the threshold, on the other hand, comes too early if an early validation is
# lucky.

# %% [markdown]
# ## 8.2 · Paired or not (2 points, 8 minutes)
#
# Two policies flew the *same* $n$ missions; `a` and `b` are their results, two arrays of shape
# (n,), where `a[k]` and `b[k]` belong to the same mission. By how much is the first policy ahead,
# and how certain is this lead?
#
# Return `(mean, low, high)`: the mean of $a - b$ and the ends of its 95 % interval. Use the normal
# approximation (1.96 standard errors), and divide by $n - 1$ in the standard deviation. Make use of
# the pairing, and leave `a` and `b` as they are.
#
# <details><summary>Hint</summary>
#
# Both policies flew the same missions, so every mission gives one difference. You have n
# differences, and you know how to give their mean with an interval.
# </details>
#
# <details><summary>Another hint</summary>
#
# With d = a − b, the ends of the interval are d.mean() ± 1.96 * d.std(ddof=1) / sqrt(n). The
# variances of a and of b do not appear.
# </details>

# %%
def lead(a, b):
    """Mean lead of a over b with its 95 % interval: (mean, low, high)."""
    ### BEGIN SOLUTION
    difference = a - b
    half = 1.96 * difference.std(ddof=1) / math.sqrt(len(difference))
    return difference.mean(), difference.mean() - half, difference.mean() + half
    ### END SOLUTION

# %%
checks.lead(lead)

# %% [markdown]
# ## 8.3 · A p-value for a few seeds (2 points, 15 minutes)
#
# Two kinds of training were run with a few seeds each. The results, one for each seed, are `a` and
# `b`, two short arrays of numbers that need not be equally long. If their means differ, could that
# be luck?
#
# Suppose that the kind of training makes no difference. Then only chance decided which of the
# values came into `a`, and every **split** of them, `len(a)` to a first group and the rest to a
# second, was as likely as the one observed. So look at all splits: in how many are the two means at
# least as far apart? If `a` is 8, 9 and `b` is 1, 2, then the means are 7 apart, and there are six
# splits:
#
# | first group | second group | difference of the means |
# | --- | --- | --- |
# | 8, 9 | 1, 2 | 7 (observed) |
# | 1, 2 | 8, 9 | −7 |
# | 1, 8 | 2, 9 | −1 |
# | 2, 9 | 1, 8 | 1 |
# | 1, 9 | 2, 8 | 0 |
# | 2, 8 | 1, 9 | 0 |
#
# In two of the six the means are at least 7 apart, so the **p-value** is 2/6: if the kind of
# training makes no difference, chance alone gives such a gap in one case of three.
#
# Return this share for any `a` and `b`: of *all* splits, the observed one included, those in which
# the difference of the means is, in absolute value, at least as large as the observed one. (This is
# the two-sided p-value of the exact permutation test.) Two equal values still count as two values.
# Let differences that agree to within 1e-9 count as equal, since sums of floats are rounded. You
# need only numpy and the standard library, and no random numbers.
#
# <details><summary>Hint</summary>
#
# Let a loop make the lines of the table, one for each split, and note for each whether the means
# are at least as far apart as those of `a` and `b`. The p-value is the share of the lines where
# they are.
# </details>
#
# <details><summary>Another hint</summary>
#
# itertools.combinations(range(len(a) + len(b)), len(a)) lists the places of the values that go to
# the first group; the other values form the second group. Count the splits for which
# abs(difference) >= abs(observed) - 1e-9, and divide this count by the number of all splits.
# </details>

# %%
def permutation_p(a, b):
    """The exact two-sided p-value of the difference of the means, a number from 0 to 1."""
    ### BEGIN SOLUTION
    values = np.concatenate([a, b])
    observed = abs(np.mean(a) - np.mean(b))
    as_large = []
    for chosen in combinations(range(len(values)), len(a)):
        first = np.isin(np.arange(len(values)), chosen)
        difference = abs(values[first].mean() - values[~first].mean())
        as_large.append(difference >= observed - 1e-9)
    return float(np.mean(as_large))
    ### END SOLUTION

# %%
checks.permutation_p(permutation_p)

# %% [markdown]
# The test assumes no particular distribution of the results, only that the runs are independent.
# But it tests a single statement, that both kinds have the same distribution of results, and does
# not say how large the difference is.
