# %% [markdown]
# # Exercises 14 · A real city
#
# These exercises go with notebook `14_a_real_city`. You need numpy and a straight line.
#
# Write your answer where a cell raises `NotImplementedError`, then run the cell below it. The check says whether the answer is
# right, and if not, what is probably wrong. Hints are folded away below each task. Your code runs inside this notebook.
# If it never finishes, interrupt the kernel with the stop button.

# %%
# %matplotlib inline
import numpy as np

from uavdh_lite.course import checks

# %% [markdown]
# ## 14.1 · The exponent of a place (2 points, 10 minutes)
#
# You measured the links of a place and want its path loss exponent. You are given
#
# - `distance_m`: $(N,)$, the distance of each link in metres,
# - `snr_db`: $(N,)$, its SNR in dB; −inf where nothing was heard.
#
# Fit the line $\mathrm{SNR} = \text{level} - \alpha \cdot 10 \log_{10} d$ by least squares to the links that were heard. Return $\alpha$ and
# $\sigma$, the root of the mean square of what the line leaves over. At least two links were heard, at different distances.
#
# An example: 0 dB at 10 m and −20 dB at 100 m. There $10 \log_{10} d$ is 10 and 20, so the slope is −2, $\alpha$ is 2 and $\sigma$ is 0.
#
# <details><summary>Hint</summary>
#
# np.polyfit(x, y, 1) gives slope and level. Which links does it get, and which x?
# </details>
#
# <details><summary>Another hint</summary>
#
# heard = np.isfinite(snr_db) selects the links; np.std(y - slope * x - level) is σ, because what a fitted line leaves over has the mean 0.
# </details>

# %%
def exponent(distance_m, snr_db):
    """The path loss exponent α, and the spread σ around the line, dB."""
    ### BEGIN SOLUTION
    heard = np.isfinite(snr_db)
    x, y = 10 * np.log10(distance_m[heard]), snr_db[heard]
    slope, level = np.polyfit(x, y, 1)
    return -slope, np.std(y - slope * x - level)
    ### END SOLUTION

# %%
checks.exponent(exponent)

# %% [markdown]
# ## 14.2 · Believe what you heard (2 points, 12 minutes)
#
# A line says what to expect of a link. Nearby, a few SNRs were measured. What should the agent believe of this link? As in 14.6,
#
# $$\widehat{\mathrm{SNR}} = \text{line} + \frac{\sum_i w_i\,(\text{heard}_i - \text{line})}{1 + \sum_i w_i}$$
#
# - `line_db`: what the line says, one number, dB,
# - `heard_db`: $(N,)$, what was heard nearby, dB; $N$ may be 0,
# - `weight`: $(N,)$, the weight of each, from 0, far away, to 1, here.
#
# Return the SNR to believe, one number. In the notebook the line's value differs from place to place; here it is the same for the link and for what was heard near it.
#
# An example: the line says −10 dB. Right here −20 dB was heard, with the weight 1. Line and measurement count the same, so believe −15 dB.
#
# <details><summary>Hint</summary>
#
# Start with the example. How far is the measurement off? How much of that do you believe?
# </details>
#
# <details><summary>Another hint</summary>
#
# With numpy, weight * (heard_db - line_db) are all products at once. What is np.sum of an empty array?
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
