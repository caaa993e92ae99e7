# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # 1 · The city and the channel
#
# **A device waits in the street. Where should the UAV hover to fetch the device's data?**
#
# The code below draws the answer for one device, the white cross. Over a yellow cell the UAV gets
# data quickly, and over a dark one hardly any. The UAV may not fly over the grey buildings or the
# hatched zone. By the end of this notebook you will be able to compute the data rate behind every
# colour, once you know which cells are in sight of the device.

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
from uavdh_lite.plotting import draw_rates

environment = environment_of("manhattan")
city, channel = environment.city, environment.channel
figure = Figure(figsize=(6, 5), layout="constrained")
draw_rates(figure.subplots(), environment, device=(4, 7))
figure

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Follow one signal from the transmitter to the data, and find good places to hover |
# | **What you'll learn** | Decibels, path loss, link budget, Shannon's rate, shadow fading |
# | **What you'll need** | Notebook 0, logarithms, the normal distribution. 40 minutes to read, 10 seconds to run; 25 minutes of exercises |
#
# The bright area is not a disc: it reaches far down two streets and hardly bends round corners,
# because buildings are in the way.
#
# ## 1.1 Three layers
#
# The city is a grid of 16 × 16 cells, each 10 m wide. For each cell there are three yes-or-no
# questions, the *layers* of the map:

# %% tags=["hide-input"]
figure = Figure(figsize=(9, 3.2), layout="constrained")
for ax, name in zip(figure.subplots(1, 3), ("landing", "no_fly", "buildings")):
    ax.imshow(getattr(city, name), cmap="Greys")
    ax.set(title=name, xlabel="column", ylabel="row")
figure

# %% [markdown]
# Black means yes. May the UAV start and land here? Is it forbidden to fly here? Does a building
# here block radio signals?
#
# Compare the second layer with the third. A cell that is black in both is a *tall* building: the
# UAV may not enter it, and it blocks radio signals. Black only in the third layer would be a *low*
# building, which may be flown over, and black only in the second a no-fly zone. The paper's UAV is
# “not allowed to fly over buildings” at all, so this city has no low ones. A device may stand
# anywhere except on a building or in a landing zone.
#
# ## 1.2 Path loss
#
# A radio signal gets weaker as it travels. The loss spans many powers of ten, so engineers use a
# logarithmic scale, the *decibel*: $x_{\mathrm{dB}} = 10 \log_{10} x$. Thus 10 dB is a factor of
# ten, 20 dB a factor of a hundred, 3 dB about a factor of two, and −10 dB a tenth. On this scale,
# products become sums.
#
# What counts is how strong the signal is compared with the noise in every receiver. The ratio of
# their powers is the *signal-to-noise ratio*, SNR. It falls as a power of the distance $d$ in
# metres (paper, eq. 2):
#
# $$\mathrm{SNR} = \frac{P}{\sigma^2} \cdot d^{-\alpha_l} \cdot 10^{\eta_l/10}$$
#
# Here $P$ is the transmitted power, $\sigma^2$ the power of the noise, and $\eta_l$ stands for luck
# (1.5). In decibels the same equation becomes a sum:
#
# $$\mathrm{SNR_{dB}} = \Big(\frac{P}{\sigma^2}\Big)_{\mathrm{dB}} - 10\,\alpha_l \log_{10} d + \eta_l$$
#
# The term in the middle is the *path loss*, and $\alpha_l$ the *path-loss exponent*: 2.27 if there
# is *line of sight* (LoS), and 3.64 if there is none (NLoS), because a building is in the way:

# %% tags=["hide-input"]
distance_m = np.geomspace(10, 200)
figure = Figure(figsize=(5.5, 3.4), layout="constrained")
ax = figure.subplots()
ax.semilogx(distance_m, 10 * 2.27 * np.log10(distance_m), "-", label="LoS")
ax.semilogx(distance_m, 10 * 3.64 * np.log10(distance_m), "--", label="NLoS")
ax.set(xlabel="distance through the air, m", ylabel="path loss, dB")
ax.legend()
figure

# %% [markdown]
# Ten times the distance adds 22.7 dB in sight and 36.4 dB behind a building. In empty space it
# would be 20 dB: the power spreads over a sphere, whose area grows with the square of the distance,
# so the exponent would be 2. The gap between the lines is the loss that a building adds. At 100 m
# it is 27.4 dB: the signal is some 550 times weaker.
#
# The distance $d$ is measured through the air. The UAV flies 10 m high, so 30 m on the ground is
# $\sqrt{30^2 + 10^2} = 31.6$ m through the air, and even directly above a device, $d$ is 10 m.
#
# ## 1.3 The link budget
#
# How strong is the transmitter? Instead of $P/\sigma^2$, the paper states the *cell-edge SNR*: an
# unobstructed link along the ground, from the middle of the map to a device in a corner, has an SNR
# of −15 dB. (This “cell” is not one of our grid cells, but the area that a base station serves,
# here the whole map.) To find $P/\sigma^2$, compute the path loss of this link and add it to the
# SNR at the corner:

# %%
edge_m = np.sqrt(2) * 16 * 10 / 2
budget_db = -15 + 10 * 2.27 * np.log10(edge_m)
print(f"to the corner: {edge_m:.1f} m, budget: {budget_db:.1f} dB")
assert np.isclose(budget_db, channel.transmit_snr_db(16))

# %% [markdown]
# We call $P/\sigma^2$ in decibels the *link budget*, the SNR that a link would have at 1 m. It is
# the same behind a building, because the transmitter is no weaker. Apart from luck, one subtraction
# now gives any link's SNR:

# %%
def snr_db(ground_m, exponent):
    return budget_db - 10 * exponent * np.log10(np.hypot(ground_m, 10))


print(f"above the device {snr_db(0, 2.27):.1f} dB, 30 m away {snr_db(30, 2.27):.1f} dB")

# %% [markdown]
# ## 1.4 From SNR to data
#
# How much data can a link carry? Claude Shannon found the limit in 1948. In one communication
# *slot* a device can send (paper, eq. 1)
#
# $$R = \log_2(1 + \mathrm{SNR})$$
#
# data units. (In real systems $R$ is the *spectral efficiency*, in bits per second per hertz.) One
# move takes four such slots. When signal and noise are equally strong, the SNR is 1, and a slot
# carries $\log_2 2 = 1$ unit.
#
# Why a logarithm? If a slot is to carry one unit more, the receiver must tell twice as many
# different signals apart in the same noise. Signals are points in a plane, so they need twice the
# area, and area is proportional to power. To *add* one unit of data at a high SNR, you have to
# *multiply* the power by two.
#
# First make a prediction:

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("behind_a_corner")

# %%
from uavdh_lite.channel import rate  # this formula, for SNRs in dB; exercise 1.1 asks you for it

for distance in (0, 10, 20, 30, 100):
    los, nlos = rate(snr_db(distance, 2.27)), rate(snr_db(distance, 3.64))
    print(f"{distance:>4} m: {los:.3f} data units per slot in sight, {nlos:.4f} behind a building")

# %% tags=["hide-input"]
ground_m = np.linspace(0, 120)
figure = Figure(figsize=(5.5, 3.4), layout="constrained")
ax = figure.subplots()
ax.plot(ground_m, rate(snr_db(ground_m, 2.27)), "-", label="LoS")
ax.plot(ground_m, rate(snr_db(ground_m, 3.64)), "--", label="NLoS")
ax.set(xlabel="distance on the ground, m", ylabel="data units per slot")
ax.legend()
figure

# %% [markdown]
# - **Twice the distance** through the air costs 6.8 dB in sight and 11 dB behind a building. At a
#   high SNR, each loss of 3 dB takes one unit away from a slot. At a low SNR the rate is nearly
#   proportional to the SNR, so it falls to a fifth in sight and a twelfth behind a building.
# - **A building all but ends the link.** Even at a distance of 10 m on the ground, it cuts the data
#   by more than nine tenths.
#
# ## 1.5 Shadow fading
#
# Trees, signs and vehicles make a signal stronger or weaker than the distance alone would suggest.
# This is *shadow fading*. It stands for things that the map does not show. The model adds $\eta_l$
# to the SNR: a normally distributed number of decibels with mean 0 and a variance of 2 dB² in sight
# and 5 dB² behind a building, where the signal comes by several detours, drawn anew for every slot
# and device. Why normal, and why in
# decibels? Each obstacle multiplies the power by some factor, so in decibels the effects add up,
# and a sum of many independent effects is nearly normal. Such a power is called *log-normal*.
#
# Reflections add a second kind, *small-scale* or *multipath fading*, which varies over a few
# centimetres; in eq. 2 the SNR is already averaged over it. And a device sends at exactly the rate
# that its link bears, whereas many real senders choose a rate beforehand, and lose the slot if the
# link turns out worse (an *outage*). [What the model
# assumes](../docs/tutorials/what_the_model_assumes.md) says what either costs.
#
# In a real street, shadow fading is *correlated*: the tree that is in the way now may still be in
# the way one step later. The authors' code draws it anew in every slot, and so do we, so that the
# agent need not remember its luck.
#
# In decibels, good and bad luck cancel out on average. Do they also in the amount of data?

# %%
Quiz("luck_on_average")

# %% [markdown]
# For the mean rate, weight the rate for each value of the fading by its probability density.

# %%
luck_db, mean_db = np.linspace(-12, 12, 481), snr_db(30, 2.27)

# %%
for kind, variance, exponent in (("in sight", 2, 2.27), ("behind a building", 5, 3.64)):
    likely = np.exp(-(luck_db**2) / (2 * variance))
    alone = snr_db(30, exponent)
    lucky = np.average(rate(alone + luck_db), weights=likely)
    print(f"30 m {kind}: {rate(alone):.3f} without fading, {lucky:.3f} with it, on average")
    assert lucky > rate(alone)

# %% [markdown]
# In sight, fading helps a little; behind a building it raises the rate by about a seventh. In the
# next figure the dashed line joins a slot with bad luck to one with good luck.

# %% tags=["hide-input"]
axis_db, ends_db = np.linspace(-12, 8), mean_db + np.array([-6, 6])
figure = Figure(figsize=(5.5, 3.4), layout="constrained")
ax = figure.subplots()
ax.plot(axis_db, rate(axis_db))
ax.plot(ends_db, rate(ends_db), "o--", label="6 dB of bad luck, 6 dB of good luck")
ax.plot(mean_db, rate(ends_db).mean(), "D", label="their mean")
ax.plot(mean_db, rate(mean_db), "ks", label="no luck")
ax.set(xlabel="SNR, dB", ylabel="data units per slot")
ax.legend()
figure

# %% [markdown]
# Because the curve bends upwards (it is *convex*), the mean of the two slots is above the curve:
# good luck gains more than bad luck loses (*Jensen's inequality*).
#
# ## 1.6 Where to hover
#
# Compare four places. Distances are measured on the ground, and the last column counts the steps of
# four slots that 15 data units take without fading:

# %%
for name, ground, exponent in (
    ("above the device", 0, 2.27),
    ("30 m down the street", 30, 2.27),
    ("14 m away, behind a building", 14.1, 3.64),
    ("36 m away, round a corner", 36.1, 3.64),
):
    here = rate(snr_db(ground, exponent))
    print(f"{name:<32}{here:.4f} data units per slot, {np.ceil(15 / (4 * here)):>4.0f} steps")

# %% [markdown]
# - Down the street, hovering takes six steps. Flying two cells nearer and back takes only four,
#   because data comes in on the way.
# - Round the corner, fetching the data would take longer than any flight lasts.
#
# So the answer to the question at the top is: anywhere *in sight* of the device and not too far
# away. Which places these are, the agent must find out.
#
# ## Recap
#
# - The SNR in dB is the link budget, minus the path loss $10\,\alpha_l \log_{10} d$, plus luck.
# - A slot carries $\log_2(1 + \mathrm{SNR})$ data units, and a step has four slots.
#
# ## Exercises
#
# The exercises of this notebook, with checks and hints, are in
# [`exercises/01_city_and_channel`](exercises/01_city_and_channel/01_city_and_channel.ipynb).
#
# ## Further reading
#
# - Bayerlein et al., Globecom 2020, section II, the system model.
# - Goldsmith: *Wireless Communications*, chapter 2, on path loss and shadowing.
