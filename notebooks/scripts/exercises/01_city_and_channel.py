# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Exercises 1 · The city and the channel
#
# These exercises go with notebook `01_city_and_channel`. You need logarithms, the normal
# distribution and a little numpy.
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
import numpy as np

from uavdh_lite.course import checks
from uavdh_lite.channel import Channel
from uavdh_lite.channel import rate as library_rate

channel = Channel()

# %% [markdown]
# ## 1.1 · Rate from SNR (1 point, 5 minutes)
#
# In a communication slot a link carries $\log_2(1 + \mathrm{SNR})$ data units. Write a function
# that computes this rate. The SNR in the formula is a ratio of powers, but the function is given
# the SNR in decibels, either a single number or a whole array.
#
# <details><summary>Hint</summary>
#
# The rate is log2(1 + SNR), where the SNR is a plain ratio of powers. What is 0 dB as a ratio? And
# 10 dB?
# </details>
#
# <details><summary>Another hint</summary>
#
# Adding 10 dB multiplies the power by ten, so the decibels belong in an exponent. What is its base?
# The 1 is added to the ratio, and numpy has a function for the logarithm to base 2.
# </details>

# %%
def rate(snr_db):
    """Data units in one slot at this SNR in dB; a number or an array."""
    ### BEGIN SOLUTION
    return np.log2(1 + 10 ** (snr_db / 10))
    ### END SOLUTION

# %%
checks.rate_from_snr(rate)

# %% [markdown]
# ## 1.2 · How much distance is a building worth? (2 points, 10 minutes)
#
# Over a distance of $d$ metres the path loss is $10\,\alpha \log_{10} d$ decibels, with
# $\alpha_\mathrm{LoS} = 2.27$ in sight and $\alpha_\mathrm{NLoS} = 3.64$ behind a building
# (`channel.path_loss_exponent_los`, `..._nlos`). Here $d$ is the length of the link through the
# air, so the height of the UAV is already taken into account.
#
# A device stands behind a building, `nlos_distance_m` metres away from the UAV. At what distance
# would a device *in sight* have the same path loss?
#
# <details><summary>Hint</summary>
#
# The path loss in dB is 10 α log10(d). Set the loss with α_LoS at the unknown distance equal to the
# loss with α_NLoS at the given distance.
# </details>
#
# <details><summary>Another hint</summary>
#
# Solve for the logarithm of the unknown distance. A factor in front of a logarithm becomes an
# exponent inside it.
# </details>

# %%
def same_loss_m(nlos_distance_m):
    """The distance in sight, m, at which the path loss is that of the blocked link."""
    ### BEGIN SOLUTION
    return nlos_distance_m ** (channel.path_loss_exponent_nlos / channel.path_loss_exponent_los)
    ### END SOLUTION

# %%
checks.same_path_loss(same_loss_m)

# %% [markdown]
# Both formulas give the same path loss at 1 m. The UAV flies 10 m above the devices, so it is
# always more than 1 m away from them, and a building always adds to the path loss.

# %% [markdown]
# ## 1.3 · What fading does to the mean rate (2 points, 10 minutes)
#
# Shadow fading adds a normally distributed random number of decibels, with mean 0, to the SNR in
# every slot. Is the mean rate then equal to the rate at the mean SNR? Write a function that
# estimates the mean rate by simulating `draws` slots. The mean SNR in dB is `snr_db`. Each slot has
# its own fading, which is drawn from `generator`, a `numpy.random.Generator`, and has the variance
# `variance_db2`, in dB². Turn SNRs into rates with the library's function, which is imported above
# as `library_rate`.
#
# <details><summary>Hint</summary>
#
# Draw many SNRs around the mean SNR, turn each into a rate, and average the rates, in that order.
# </details>
#
# <details><summary>Another hint</summary>
#
# Does generator.normal expect a variance? Add the fading to the SNR while the SNR is still in dB.
# Compute one rate for each draw, and take the mean of these rates last.
# </details>

# %%
def mean_rate(snr_db, variance_db2, draws, generator):
    """The mean of the rate over the fading, data units per slot."""
    ### BEGIN SOLUTION
    fading_db = generator.normal(0, np.sqrt(variance_db2), draws)
    return library_rate(snr_db + fading_db).mean()
    ### END SOLUTION

# %%
checks.mean_rate(mean_rate)

# %% [markdown]
# As a function of the SNR in decibels, the rate bends upwards everywhere, and most strongly at 0
# dB, so lucky draws gain more than unlucky ones lose, and fading raises the mean rate. Far above 0
# dB the rate is almost a straight line, and fading hardly changes its mean. Far below 0 dB fading
# adds only a little data, but that little is a larger share of what arrives.
