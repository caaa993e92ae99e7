# %% [markdown]
# # Exercises 7 · Ablation: map centring
#
# They go with notebook `07_ablation_map_centring`. You need numpy, means and standard deviations; for 7.2 the idea of a
# p-value.
#
# Write your answer where a cell raises `NotImplementedError`, then run the cell below it: it says whether the answer is
# right, and if not, what is probably wrong. Stuck? Each exercise has three hints; for example `checks.steps_to.hint()` in
# a cell of your own gives the first, again gives the next.

# %%
# %matplotlib inline
from itertools import combinations
from math import comb

import numpy as np

from uavdh_lite.course import checks
from uavdh_lite.course.checks.ablation import recorded

# %% [markdown]
# ## 7.1 · How many steps to a threshold (1 point, 8 minutes)
#
# A training run is validated now and then. `steps` says after how many environment steps, in increasing order, and
# `values` what came out: two arrays of numbers, equally long. Such curves rise, but fall back in between. So the first
# crossing of a threshold, as in the tutorial, may be luck. Ask for more: that the curve stays there for good.
#
# Return the environment steps of the first validation from which on *all* values, up to the last, are at least
# `threshold`: an element of `steps`. Return `None` if there is none, that is, if the last value is below.

# %%
def steps_to(steps, values, threshold):
    """The environment steps from which on the curve stays at or above the threshold, or None."""
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
# Such a number is as coarse as the validations are apart, and one unlucky validation late in the run makes it much
# larger. What the first crossing says is too small after a lucky one.

# %% [markdown]
# ## 7.2 · A p-value for a few seeds (2 points, 15 minutes)
#
# Two kinds of training, a few seeds each, one result a seed: `a` and `b`, two short arrays of numbers, not always equally
# long. Say the kind made no difference. Then any other way to deal the same values out, `len(a)` of them to a first
# group and the rest to a second one, would have been as likely as the one observed. Two equal values still count as two.
#
# Go through *all* such splits. Return the share of them whose difference of the two groups' means is, in absolute value,
# at least as large as the observed one: the two-sided p-value of the exact permutation test. The observed split is one
# of them. Let differences that are equal up to 1e-9 count as equal, since sums of floats are rounded. numpy and the
# standard library are enough; no random numbers.

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
# The test assumes nothing about how results are distributed, but it can say something of these two groups only: which
# values there are is taken as given.

# %% [markdown]
# ## 7.3 · What the recorded runs show (3 points, 20 minutes)
#
# The cell below reads the validations of the recorded ablation (`data/runs/centring-manhattan.csv.gz`): a dict of columns, one
# row a validation. `variant` is `centred` or `non_centred`, `seed` the run of that kind, `steps` the environment steps,
# `collected_and_landed` the result, a share from 0 to 1. *A run* is one kind with one seed; *the end* is its last
# validation. All runs were validated at the same steps.
#
# Is each statement true? Compute what can be computed; a new recording may change it. The last entry is a number.
#
# | name | statement |
# | --- | --- |
# | `early` | At the first validation at 300,000 steps or later, every centred run is above every non-centred one. |
# | `spread` | At that validation, the two kinds' means over seeds differ by more than the larger of the two standard deviations between seeds (`ddof=1`). |
# | `swap` | At the end, at least one non-centred run is above at least one centred run. |
# | `steady` | No run, of either kind, ever falls by more than 0.05 from one validation to the next. |
# | `best` | If each run were reported by its best validation instead of its last, no run would look worse. |
# | `equal` | Whenever the kinds' means at the end differ by less than the spread between seeds, it follows that both kinds are equally good in the end. |
# | `missions` | To become surer that one *kind of training* is better, it does as well to validate these same runs on many more missions as to train more seeds. |
# | `any_city` | The centred runs rise faster here, therefore centring makes training faster in any city. |
# | `smallest_p` | (a number) With as many seeds of each kind as were recorded, the smallest p that the two-sided permutation test of 7.2 can give, whatever the values are: ? |

# %%
validation = recorded()
print({name: column[:2].tolist() for name, column in validation.items()})

# %%
# Replace the line below by your dict, with all nine names, or by what computes it:
# reading = {"early": True, ..., "smallest_p": 0.5}
### BEGIN SOLUTION
runs = {}
for kind in ("centred", "non_centred"):
    own = validation["variant"] == kind
    runs[kind] = np.array(
        [
            validation["collected_and_landed"][own & (validation["seed"] == seed)]
            for seed in np.unique(validation["seed"][own])
        ]
    )
yes, no = runs["centred"], runs["non_centred"]
at = np.argmax(np.unique(validation["steps"]) >= 300_000)
deviations = [np.std(one[:, at], ddof=1) for one in runs.values()]
extreme = 2 if len(yes) == len(no) else 1  # the mirrored split exists only for equal groups
reading = {
    "early": bool(yes[:, at].min() > no[:, at].max()),
    "spread": bool(abs(yes[:, at].mean() - no[:, at].mean()) > max(deviations)),
    "swap": bool(no[:, -1].max() > yes[:, -1].min()),
    "steady": all(bool((np.diff(one, axis=1) >= -0.05).all()) for one in runs.values()),
    "best": all(bool((one.max(axis=1) >= one[:, -1]).all()) for one in runs.values()),
    "equal": False,
    "missions": False,
    "any_city": False,
    "smallest_p": extreme / comb(len(yes) + len(no), len(yes)),
}
### END SOLUTION

# %%
checks.ablation_reading(reading)

# %% [markdown]
# `equal`, `missions` and `any_city` do not depend on the numbers: they claim more than any such table could show.
