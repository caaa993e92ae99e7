# %% [markdown]
# # 1 · The city and the channel
#
# A UAV can only collect what the radio channel lets through. This notebook builds that channel,
# number by number: how the signal fades with distance, what a building does to it, how much chance
# is in it, and how much data arrives. Data is counted in *data units*: one unit is what a device can
# send in one short time slot when its signal arrives exactly as strong as the noise, the random hiss in the receiver itself. At the end the notebook answers a
# question that the agent of the later notebooks has to learn: *where should the UAV be to serve a device?*

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
from uavdh_lite.environment import Environment
from uavdh_lite.plotting import draw_city

city = City.load("manhattan")
environment = Environment(city)
figure = Figure(figsize=(6.5, 6.5), layout="constrained")
draw_city(figure.subplots(), city).set_title("the city of the paper's Manhattan scenario, redrawn")
figure

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Take the city apart into layers, compute one link from the transmitter to the data unit, and map the rate over the whole city for a device |
# | **What you'll learn** | Log-distance path loss with and without line of sight, the cell-edge SNR and the link budget behind it, shadow fading, and why a place further away can be much better than a near one |
# | **What you'll need** | Logarithms, the normal distribution, a little numpy. 32 minutes to read, 10 seconds to run; 15 minutes of exercises |
#
# ## 1.1 Three layers
#
# The city is a grid of 16×16 cells of 10 m. Each cell answers three yes-or-no questions, and each
# question is a *layer*, a Boolean array:
#
# - May the UAV start and land here? (`landing`, hatched blue)
# - May it *not* fly here? (`no_fly`; hatched red where it is open ground that may not be entered)
# - Does a building here block radio links? (`buildings`)

# %%
for name in ("landing", "no_fly", "buildings"):
    layer = getattr(city, name)
    print(f"{name:<10} {layer.shape} {layer.dtype}, {layer.sum()} cells")

# %% [markdown]
# Buildings come in two heights. A tall one, dark grey in the figure, blocks the link *and* may not
# be flown over, so it is in two layers. A low one, beige, only blocks the link.

# %%
print("tall buildings:", (city.buildings & city.no_fly).sum(), "cells")
print("low buildings: ", (city.buildings & ~city.no_fly).sum(), "cells")
print("devices may stand on", len(city.device_cells), "cells")

# %% [markdown]
# A city comes from a picture with one pixel for each cell:
#
# | pixel | cell |
# | --- | --- |
# | black `#000000` | free |
# | blue `#0000ff` | landing zone |
# | red `#ff0000` | no-fly zone |
# | green `#00ff00` | low building |
# | yellow `#ffff00`, red and green at once | tall building |
#
# Real files have colours that are nearly right. Of red, green and blue, each counts as set from 224 on, and as not set up to 31:
# `#f9f900` is a tall building. In between, as in `#80ff00`, the loader stops and names the file and the pixel. If it
# guessed, you would fly over another city than you drew, and might never notice.
#
# ## 1.2 Path loss: the signal thins out
#
# Ratios of power span many powers of ten, so one writes them in *decibels*: $x_{\mathrm{dB}} = 10 \log_{10} x$.
# Then 10 dB is ten times, 20 dB a hundred times, 3 dB about twice, and products become sums.
#
# The ratio of received signal to noise, the SNR, falls with a power of the distance $d$ (paper,
# eq. 3):
#
# $$\mathrm{SNR} = \frac{P}{\sigma^2}\, d^{-\alpha}\, 10^{\eta/10}
# \qquad\text{or, in decibels,}\qquad
# \mathrm{SNR_{dB}} = \Big(\frac{P}{\sigma^2}\Big)_{\mathrm{dB}} - 10\,\alpha \log_{10} d + \eta$$
#
# Here $P$ is the power sent, $\sigma^2$ that of the noise, $d$ the distance in metres, and $\eta$ a random
# number of decibels, the subject of section 1.5; until then it is 0. In this notebook "30 m away" is a distance on the
# ground; $d$ is the way through the air, from a UAV 10 m up: $\sqrt{30^2 + 10^2} = 31.6$ m.
#
# The *path loss exponent* $\alpha$ is larger when a building is in between. Each tenfold distance
# costs $10\,\alpha$ dB:

# %%
channel = environment.channel
for name in ("los", "nlos"):
    exponent = getattr(channel, f"path_loss_exponent_{name}")
    print(f"{name:>4}: exponent {exponent}, {10 * exponent:.1f} dB for each tenfold distance")

# %% [markdown]
# LoS is *line of sight*, NLoS *non-line of sight*. At 100 m, a building costs
# $10\,(3.64 - 2.27)\log_{10} 100 = 27.4$ dB: the signal is 550 times weaker.
#
# ## 1.3 The link budget, number by number
#
# What is $P/\sigma^2$, transmit power over noise? The paper does not give it. It gives the
# *cell-edge SNR*: −15 dB between the middle of the map and a device in its corner, at ground level,
# with nothing in between. (In mobile radio a *cell* is the area that one transmitter serves: here the
# whole map, not a square of our grid.) From this the rest follows. First the distance:

# %%
edge_m = np.sqrt(2) * city.size * channel.cell_size_m / 2
print(f"from the middle to a corner: {edge_m:.1f} m")

# %% [markdown]
# The signal loses $10\,\alpha_{\mathrm{LoS}} \log_{10} d$ on the way. What arrives is −15 dB, so what
# was sent is that much more:

# %%
loss_db = 10 * channel.path_loss_exponent_los * np.log10(edge_m)
budget_db = channel.cell_edge_snr_db + loss_db
print(f"{channel.cell_edge_snr_db} dB + {loss_db:.2f} dB = {budget_db:.2f} dB")
assert np.isclose(budget_db, channel.transmit_snr_db(city.size))

# %% [markdown]
# That is the *link budget*: what a link has to spend, the SNR at a distance of 1 m. The last line checks our sum
# against the library's `transmit_snr_db`, which is these two lines again. The UAV flies 10 m high, so even straight above a device the distance is 10 m. (`mean_snr_db` takes the *squared* distance,
# whether there is line of sight, and the size of the city; it leaves the fading out.)

# %%
above_db = channel.transmit_snr_db(city.size) - channel.path_loss_db(np.float32(channel.altitude_m**2), True)
print(f"straight above the device: {above_db:.2f} dB")

# %% [markdown]
# The paper gives no second budget for links behind a building, and there is none: the transmitter does not know what
# stands in the way. If somebody set −15 dB at the edge for these links, too, they would need far more power:

# %%
nlos_budget_db = channel.cell_edge_snr_db + 10 * channel.path_loss_exponent_nlos * np.log10(edge_m)
at_30_m = nlos_budget_db - 10 * channel.path_loss_exponent_nlos * np.log10(np.hypot(30, channel.altitude_m))
in_sight = channel.transmit_snr_db(city.size) - channel.path_loss_db(np.float32(30**2 + channel.altitude_m**2), True)
print(f"budget {nlos_budget_db:.1f} dB; 30 m away {at_30_m:.1f} dB behind a building, {in_sight:.1f} dB in sight")

# %% [markdown]
# Then a building would make the link better, everywhere up to the edge. An agent would learn to hide.
#
# ## 1.4 From SNR to data
#
# While the UAV makes one move, there are four communication *slots* (notebook 3 draws them). In one slot
# a device can send (eq. 4)
#
# $$R = \log_2(1 + \mathrm{SNR})$$
#
# data units. A signal as strong as the noise, an SNR of 0 dB, makes $\log_2 2 = 1$ unit:

# %%
from uavdh_lite.channel import rate

for snr_db in (-15, 0, 10, above_db):
    print(f"{snr_db:>6.1f} dB -> {rate(snr_db):.2f} data units a slot")

# %% [markdown]
# A prediction first:

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("behind_a_corner")

# %% [markdown]
# Now the rate along a line away from the device, with and without line of sight:

# %%
ground_m = np.linspace(0, 160, 200)
squared_m2 = np.float32(ground_m**2 + channel.altitude_m**2)
figure = Figure(figsize=(9, 3.6), layout="constrained")
left, right = figure.subplots(1, 2)
for name, sight, style in (("LoS", True, "-"), ("NLoS", False, "--")):
    snr_db = channel.transmit_snr_db(city.size) - channel.path_loss_db(squared_m2, sight)
    left.plot(ground_m, snr_db, style, label=name)
    right.plot(ground_m, rate(snr_db), style, label=name)
left.set(xlabel="distance on the ground, m", ylabel="SNR without fading, dB")
right.set(xlabel="distance on the ground, m", ylabel="data units a slot")
left.legend()
figure

# %% [markdown]
# The left plot shows the channel, the right one what it is worth to the UAV. The same in numbers:

# %%
for ground in (0, 10, 20, 30, 100):
    squared = np.float32(ground**2 + channel.altitude_m**2)
    los, nlos = (rate(channel.transmit_snr_db(city.size) - channel.path_loss_db(squared, sight)) for sight in (True, False))
    print(f"{ground:>4} m: {los:.2g} data units a slot in sight, {nlos:.2g} behind a building")

# %% [markdown]
# - **Near is fast.** Two cells away the UAV gets more than a third of what it gets straight above the device, three
#   cells away a fifth. Far away in sight adds up, though: 100 m down a street brings little, but slot after slot.
# - **A building all but ends the link.** At 20 m it leaves about a fiftieth.
#
# ## 1.5 Shadow fading: the part that is luck
#
# Despite its name, shadow fading has nothing to do with the radio shadows that buildings cast on the
# map. Trees, signs and reflections make the signal stronger or weaker than the distance says. The model
# adds a normal draw $\eta$, in dB, for every slot and device, with a variance of 2 dB² with line of
# sight and 5 dB² without. (The paper writes it $\sigma^2$, too; it is not the noise.) A random generator wants the
# *standard deviation*, √2 dB and √5 dB:

# %%
generator = np.random.default_rng(0)
normal = generator.standard_normal(20_000)
for name, sight in (("LoS", True), ("NLoS", False)):
    spread_db = channel.fading_db(normal, sight).std()
    factor = 10 ** (channel.fading_db(normal, sight) / 10)
    print(f"{name:>4}: {spread_db:.2f} dB, a factor of {10 ** (spread_db / 10):.2f} up or down, {factor.mean():.2f} in the mean")

# %% [markdown]
# If you give the generator the variance, 5, in place of the standard deviation, you get a typical factor of $10^{5/10} = 3.2$ instead of 1.67. And though $\eta$ has the mean 0, the
# mean factor is above 1: 3 dB up doubles the signal, which adds 1, and 3 dB down halves it, which takes 0.5.

# %%
figure = Figure(figsize=(9, 3.4), layout="constrained")
left, right = figure.subplots(1, 2)
for name, sight in (("LoS", True), ("NLoS", False)):
    left.hist(channel.fading_db(normal, sight), 60, density=True, histtype="step", label=name)
snr_db = channel.transmit_snr_db(city.size) - channel.path_loss_db(np.float32(30**2 + channel.altitude_m**2), True)
right.hist(rate(snr_db + channel.fading_db(normal, True)), 60, density=True, histtype="step")
right.axvline(rate(snr_db), color="black", linestyle=":", label="without fading")
right.legend()
left.set(xlabel="shadow fading, dB", ylabel="density")
right.set(xlabel="data units a slot, 30 m away, LoS", ylabel="density")
left.legend()
figure

# %% [markdown]
# A symmetric spread in dB (left) becomes a lopsided spread in data units (right): its tail on the right is longer. Does luck help or hurt on average?

# %%
Quiz("luck_on_average")

# %% [markdown]
# Compute the mean rate with fading and the rate at the mean SNR in dB:

# %%
with_fading = rate(snr_db + channel.fading_db(normal, True)).mean()
print(f"without fading {rate(snr_db):.3f}, mean with fading {with_fading:.3f} data units")

# %% [markdown]
# A little more with fading, because the rate is a convex function of the SNR in dB:
# good luck gains more than bad luck loses. (*Convex*: it bends upwards, each decibel
# adds more than the one before. That the mean then lies above the value at the mean is Jensen's inequality.) The UAV cannot foresee the draws,
# only where they are good on average.
#
# ## 1.6 Move the constants
#
# Change the exponents, the fading and the cell-edge SNR and see what arrives (with a running kernel).

# %%
from dataclasses import replace

def draw_rates(alpha_los, alpha_nlos, fading_los_db, fading_nlos_db, edge_snr_db):
    own = replace(channel, path_loss_exponent_los=alpha_los, path_loss_exponent_nlos=alpha_nlos,
                  cell_edge_snr_db=edge_snr_db)  # a copy of the channel with these values
    figure = Figure(figsize=(6, 3.4), layout="constrained")
    ax = figure.subplots()
    for name, sight, spread_db in (("LoS", True, fading_los_db), ("NLoS", False, fading_nlos_db)):
        snr_db = own.transmit_snr_db(city.size) - own.path_loss_db(squared_m2, sight)
        ax.plot(ground_m, rate(snr_db), label=name)
        ax.fill_between(ground_m, rate(snr_db - spread_db), rate(snr_db + spread_db), alpha=0.25)
    ax.set(xlabel="distance on the ground, m", ylabel="data units a slot", ylim=(0, 6))
    ax.legend()
    return figure

# %%
import ipywidgets

from uavdh_lite.labs.widgets import explore

slider = ipywidgets.FloatSlider
explore(
    draw_rates,
    alpha_los=slider(value=2.27, min=1.5, max=4, step=0.01, description="α LoS"),
    alpha_nlos=slider(value=3.64, min=2, max=6, step=0.01, description="α NLoS"),
    fading_los_db=slider(value=1.41, min=0, max=6, step=0.01, description="fading LoS"),
    fading_nlos_db=slider(value=2.24, min=0, max=6, step=0.01, description="fading NLoS"),
    edge_snr_db=slider(value=-15, min=-30, max=10, step=1, description="edge SNR"),
)

# %%
draw_rates(2.27, 3.64, 1.41, 2.24, -15)

# %% [markdown]
# The bands show what one standard deviation of fading does. Did you notice that raising α LoS
# *raises* the rate near the device? The cell-edge SNR is held, so a steeper loss means that more
# must have been sent.
#
# ## 1.7 Where to serve a device
#
# The UAV moves from cell to cell, and the environment knows for every pair of cells whether they
# see each other (the next notebook computes that). Put a device among the buildings and map the
# rate that a UAV would get from hovering over each cell. (Cells are numbered row after row: row 4, column 7 has the number
# 4 · 16 + 7.)

# %%
import inspect

from uavdh_lite.channel import rate_map

print("".join(inspect.getsourcelines(rate_map)[0][-5:]))

# %%
device = (4, 7)
rates = np.where(city.no_fly, np.nan, rate_map(city, channel, environment.sight[0], device))
figure = Figure(figsize=(7, 6), layout="constrained")
ax = draw_city(figure.subplots(), city)
picture = ax.imshow(rates, cmap="viridis", norm="log", alpha=0.8, zorder=1.5)
ax.plot(device[1], device[0], "X", color="white", mec="black", ms=12, zorder=6)
figure.colorbar(picture, label="data units a slot, hovering")
figure

# %% [markdown]
# The white cross marks the device; cells left uncoloured may not be flown over. The scale is logarithmic: from one
# number to the next it is ten times as much. The rate is not a disc: it reaches far down the streets in line with the device, and
# drops at once round each corner. Which cells are best?

# %%
order = np.argsort(np.where(np.isnan(rates), -1, rates), axis=None)[::-1]
for cell in order[:5]:
    row, col = divmod(int(cell), city.size)
    print(f"cell ({row}, {col}): {rates[row, col]:.2f} data units a slot")

# %% [markdown]
# Here the best cell is the nearest. But compare three cells that are not:

# %%
for row, col, where in ((4, 4, "30 m down the street"), (7, 6, "32 m away, round a corner"),
                        (5, 6, "14 m away, above a low building")):
    print(f"cell ({row}, {col}): {rates[row, col]:.3f} data units a slot, {where}")

# %% [markdown]
# The corner costs 99 % of the data. And above the low building, half as far away as down the street, a tenth arrives: the
# roof below the UAV counts as in between. (Could it not look down from there? Not in this model, says notebook 2.) A UAV gets four slots in each step. From the best cell a device with 15 data units is empty in two
# steps.
#
# ## Recap
#
# - Three Boolean layers describe the city; everything else is computed from them.
# - $\mathrm{SNR_{dB}}$ is the budget, less $10\alpha\log_{10} d$, plus luck. The budget follows from the
#   cell-edge SNR.
# - The rate is $\log_2(1+\mathrm{SNR})$: near and in sight is what counts.
#
# ## Exercises
#
# A few with their answers. More, to write yourself, with checks and hints, are in
# [`exercises/01_city_and_channel`](exercises/01_city_and_channel/01_city_and_channel.ipynb).
#
# Cover the cell below the question, write your own, and let the cell after it check it.
#
# **1.** Up to which distance on the ground does the UAV get at least one data unit a slot, without
# fading? Write
# `reach_m(sight)`, in metres, 0 if not even straight above the device. (One data unit
# is an SNR of 0 dB.)

# %%
def reach_m(sight):
    exponent = channel.path_loss_exponent_los if sight else channel.path_loss_exponent_nlos
    distance_m = 10 ** (channel.transmit_snr_db(city.size) / (10 * exponent))
    return np.sqrt(max(distance_m**2 - channel.altitude_m**2, 0))

# %%
squared = np.float32(reach_m(True) ** 2 + channel.altitude_m**2)
assert np.isclose(rate(channel.transmit_snr_db(city.size) - channel.path_loss_db(squared, True)), 1, atol=1e-4)
assert reach_m(False) == 0
print(f"{reach_m(True):.1f} m in sight; behind a building never")

# %% [markdown]
# **2.** With the same cell-edge SNR, how does the budget change when the city has four times as many
# cells a side? Predict it from the formula, then compare.

# %%
predicted_db = 10 * channel.path_loss_exponent_los * np.log10(4)
computed_db = channel.transmit_snr_db(4 * city.size) - channel.transmit_snr_db(city.size)
assert np.isclose(predicted_db, computed_db)
print(f"{predicted_db:.2f} dB more")

# %% [markdown]
# ## Further reading
#
# - Bayerlein, Theile, Caccamo, Gesbert: *UAV Path Planning for Wireless Data Harvesting*, Globecom
#   2020, section II.
# - Goldsmith: *Wireless Communications*, chapter 2, on path loss and shadowing.
# - The next notebook: **2 · Shadow ray tracing**, where the lines of sight come from.
