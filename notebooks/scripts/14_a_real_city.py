# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # 14 · A real city
#
# Every city so far was invented, and so was its radio channel: path loss by a formula, and a yes or no for the line of sight. **Does `any_city`
# still fly well over a real place, where radio waves bounce off the walls?** The picture shows four places that the agent has never seen, and a
# flight over each, from the triangle to the diamond. The deeper the violet of a cell, the more devices are hidden from it.

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

# %% jupyter={"source_hidden": true} tags=["hide-input"]
# %matplotlib inline
import numpy as np
import torch
from matplotlib.figure import Figure

from uavdh_lite.beyond.measured import load_place, shipped_places
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.evaluation import evaluate
from uavdh_lite.plotting import caption, draw_trajectory

torch.set_num_threads(1)  # the network is small
figure = Figure(figsize=(8, 8.6), layout="constrained")
for ax, name in zip(figure.subplots(2, 2).flat, shipped_places()):
    place, agent = load_place(name), load_agent("any_city")
    flown = evaluate(place, agent.over(place.city), agent.scenario, 40, seed=0)
    path = flown.trajectory(int(np.argsort(flown.start.data_initial.sum(1))[25]))
    draw_trajectory(ax, place, path)
    title = name.replace("_", " ").title()
    ax.set(title=title, xlabel=caption(path), ylabel="", xticks=[], yticks=[])
figure

# %% [markdown]
# Buildings © OpenStreetMap contributors, from the scenes of NVIDIA's Sionna RT.
#
# | | |
# | --- | --- |
# | **What you'll do** | Compare the paper's channel with a ray-traced one; fly in both; let the UAV measure the channel, and tell the agent what it measured |
# | **What you'll learn** | What a path loss model leaves out; why world and belief are two things; what measuring is worth |
# | **What you'll need** | Notebooks 1, 2, 12 and 13. 60 minutes to read, 40 seconds to run; 24 minutes of exercises |
#
# ## 14.1 Four places
#
# The places are scenes from [Sionna RT](https://nvlabs.github.io/sionna/rt/), a ray tracer for radio waves: the old town of
# Munich, the streets south of Florence's cathedral, the Arc de Triomphe, and a level part of San Francisco. Each is a square
# 160 m on a side, or 16×16 cells.
#
# A cell is a *tall building* if at least half of it is covered by something higher than 10 m, the height at which the UAV
# flies. Otherwise it is a *low building* if at least half of it is built on. The landing zone consists of the six free cells
# nearest to the middle.

# %%
from uavdh_lite.beyond.measured import links, modelled_snr_db

# %%
munich = load_place("munich")
city, sight, possible = munich.city, munich.sight[0], links(munich)
print(f"{(possible & sight).sum() / possible.sum():.0%} of the pairs of cells see each other")

# %% [markdown]
# This map is coarse, and the shadow map ignores heights: a shed 3 m high blocks a link as fully as a tower, even one to a
# UAV right above the shed.
#
# ## 14.2 What a ray tracer does
#
# The paper has one formula for links with line of sight (LoS) and one for those without (NLoS):
#
# $$\mathrm{SNR} = \frac{P}{\sigma^2}\; d^{-\alpha_\ell}\; 10^{\eta_\ell/10}, \qquad \ell \in \{\text{LoS}, \text{NLoS}\} \qquad\text{(eq. 2)}$$
#
# Here $d$ is in metres, and $P/\sigma^2$ includes the gain at 1 m. This is a *statistical* model:
# the drop behind a building depends only on the distance, and is 14 dB at 10 m and 27 dB at 100 m.
#
# A **ray tracer** computes each link separately. It sends a million rays from the device. Walls and the ground reflect a ray,
# with a loss that depends on the material, and an edge can bend it (**diffraction**). The tracer then adds up, cell by cell,
# what arrives at the UAV's height. The received power divided by the transmitted power is the **path gain**; in dB it is the path loss with
# its sign reversed. We have a table of gains, `gain_db[device cell, UAV cell]`, for a UAV 10 m above the ground and 8.5 m above the
# devices.
#
# In our tables a ray has up to five reflections or one diffraction, and none goes through a wall. Powers are averaged over the UAV's cell, and added
# without their phases, so there is no small-scale fading. In the ray-traced world we fly without $\eta$, so the two worlds differ in fading, too.
# ([The results](../docs/results/real_city.md) give all settings.)
#
# To get SNRs, we shift all the gains for a place by the same offset, chosen so that the mean SNR of
# the pairs in sight is that of the paper's model. In sight, therefore, the two models' *mean SNRs
# in dB* agree by construction, and the comparison tests *where* the signal goes. At a bandwidth of
# 1 MHz, these SNRs need only 0.1 µW of transmit power (at a noise figure of 5 dB). A real sensor
# sends with 40 to 60 dB more power, so even its hidden links would carry data (14.3).
#
# Take a device in a street in the west, and draw its rate to every cell, under both models. **Before you run
# the cell:** where will the two maps differ most?

# %%
from uavdh_lite.beyond.failsafe import SafeEnvironment
from uavdh_lite.plotting import draw_rates

# %%
device, model = (8, 1), SafeEnvironment(city)  # row and column; the paper's radio, same city
figure = Figure(figsize=(10, 4.2), layout="constrained")
radios = {"the paper's model": model, "ray-traced": munich}
for ax, (title, environment) in zip(figure.subplots(1, 2), radios.items()):
    draw_rates(ax, environment, device, limits=(1e-5, 10)).set_title(title)
figure.colorbar(ax.images[-1], ax=figure.axes, extend="min", label="data units a slot")
figure

# %% [markdown]
# On the right the bright area is wider, because the real street is more open than our 10 m grid
# suggests. Beyond its edge the rate falls by a factor of 3 to 60 within one cell, and deep in the
# shadow by more. In most cells it does not reach zero, because waves are bent around corners or
# reflected. In white cells the rate is below $10^{-5}$, or no ray arrives.
#
# ## 14.3 Link by link
#
# Each point below is a link:

# %%
from uavdh_lite.beyond.measured import distances_m
from uavdh_lite.plotting import draw_city, draw_links

# %%
distance_m, traced_db, model_db = distances_m(munich), munich.mean_snr_db, modelled_snr_db(model)
audible = possible & np.isfinite(traced_db)
kinds = {"in sight": sight, "behind buildings": ~sight}

# %%
figure = Figure(figsize=(9, 4), layout="constrained")
for ax, (kind, state) in zip(figure.subplots(1, 2, sharex=True, sharey=True), kinds.items()):
    draw_links(ax, *(values[possible & state] for values in (distance_m, traced_db, model_db)))
    ax.text(0.97, 0.93, kind, ha="right", transform=ax.transAxes)
figure.axes[0].legend(loc="lower left", markerscale=6)
figure

# %% [markdown]
# The left cloud hugs a line, but the right one does not. Fit a straight line in $10\log_{10} d$ to each. Its slope is minus the
# **path loss exponent** $\alpha$. (Links without a ray are left out.)

# %%
for kind, state in kinds.items():
    x, y = 10 * np.log10(distance_m[audible & state]), traced_db[audible & state]
    slope, level = np.polyfit(x, y, 1)
    silent = 1 - len(y) / (possible & state).sum()
    spread_db = np.std(y - slope * x)
    print(f"{kind:<17}exponent {-slope:.2f}, spread {spread_db:.1f} dB, no ray {silent:.0%}")

# %% [markdown]
# The paper's exponents are 2.27 and 3.64, with spreads of 1.4 and 2.2 dB.
#
# - **In sight** the exponent is *below* 2, the value in free space, because, far from the device, reflections from the ground and the
#   walls contribute about 3 dB on average here, and 5 to 7 dB in the narrow streets of Florence and San Francisco. This is the
#   **street canyon** effect. The 3 % of links far below the others are blocked by walls that our grid misses; without these links the
#   spread is 0.8 dB.
# - **Behind buildings** a single line says little: distance explains only 14 % of the variance. At the same distance, links
#   differ by 60 dB or more, and for a third of them the tracer finds no path.
# - **The spread differs in kind** from that in the paper, where $\eta$ is **shadow fading**, drawn anew for each device and
#   slot. Real shadow fading is correlated over 10 to 50 m, and the ray tracer's, behind buildings, over 20 to 35 m. Such fading
#   belongs to the place: fly by again, and the link is as bad as before. It is therefore a *map* that could be learned.
#
# Is the model bad, then? What counts for the agent is the rate, $\log_2(1+\mathrm{SNR})$, and below −20 dB that is next to nothing. So
# compare the rates:

# %%
from uavdh_lite.channel import rate

rates = rate(model_db[possible]), rate(traced_db[possible])
print(f"correlation of the rates {np.corrcoef(*rates)[0, 1]:.2f}")

# %% [markdown]
# The correlation is high because both rates are high nearby and in sight, and low elsewhere. In detail they agree less: behind
# buildings the correlation is only 0.54, and the RMS error over all pairs is more than half the mean rate, mostly because of
# short links in sight. Hidden links carry only 4 % of the summed rate *at this SNR level*; with a transmitter 40 dB stronger
# they would carry 16 %.
#
# The next figure shows, for each UAV cell, by how much the ray-traced rates exceed the model's, summed over all device cells:

# %%
error = np.where(possible, rate(traced_db) - rate(model_db), 0)
figure = Figure(figsize=(9, 3.8), layout="constrained")
for ax, (kind, state) in zip(figure.subplots(1, 2), kinds.items()):
    sums = np.where(state, error, 0).sum(axis=0).reshape(16, 16)
    scale = {"cmap": "PuOr", "vmin": -12, "vmax": 12, "zorder": 1.5}
    picture = draw_city(ax, city).imshow(np.where(city.no_fly, np.nan, sums), **scale)
    ax.set_title(kind)
label = "summed over all device cells:\nray-traced − model, data units a slot"
figure.colorbar(picture, ax=figure.axes, label=label, extend="both")
figure

# %% [markdown]
# In violet cells the UAV hears more than the model promises; in orange cells, less. For links in sight, the model's line is steeper than
# that of the rays, but its mean is the same. Therefore, up to 40 m, where most of the data is collected, the rays bring a sixth less than
# the model promises, and beyond 70 m nearly half more.
#
# Behind buildings, next to corners, the rays bring *more* than the model promises. Nine tenths of this
# surplus comes from links that are at most 3 dB below free space. Our shadow map calls them hidden, but the
# device is probably visible past a wall that does not fill its cell.
#
# The ray tracer is a model, too. It contains no trees or cars, so it is too optimistic. It also leaves out scattering by rough
# walls and waves that are bent twice, so deep in the shadow it is too pessimistic. It shows *one possible* channel, but not
# Munich's.
#
# ## 14.4 Does the agent still fly?
#
# Three pilots fly 100 missions over Munich with the failsafe: `any_city`, greedy, and the course's DDQN agent, which knows only
# Manhattan. **Guess first:** which of them suffers most from the change of model?

# %%
from uavdh_lite.planners import Greedy

agent = load_agent("any_city").over(city)
pilots = {"any_city": agent, "greedy": Greedy(munich),
          "DDQN": load_agent("manhattan_ddqn").over(city)}
worlds = {"model": model, "ray-traced": munich}

# %%
flown = {(name, radio): evaluate(world, pilot, agent.scenario, 100, seed=0)
         for name, pilot in pilots.items() for radio, world in worlds.items()}
for (name, radio), flights in flown.items():
    record = flights.records()
    share = record["collected_and_landed"].mean()
    print(f"{name:<9}{radio:<11}{share:4.0%} collected, return {flights.returns.mean():5.1f}")

# %% [markdown]
# The DDQN agent collects a little less than greedy here, and its return is far behind greedy's under either model: it flies
# until the failsafe sends it home, and the safety controller refuses more than ten of its actions in each mission. Only `any_city`
# suffers from the change of model, and only slightly.
#
# The recorded runs cover 900 missions (300 for each of three seeds) for each place and model. By how much
# does the return of `any_city` exceed greedy's?

# %%
from uavdh_lite.evaluation import bootstrap_interval
from uavdh_lite.storage import data_folder, read_table

# %%
runs = read_table(data_folder() / "runs/real_city.csv.gz")
places = np.unique(runs["place"])

# %%
def ahead(policy, radio, place=None):
    at = (runs["radio"] == radio) & ((runs["place"] == place) | (place is None))
    returns = [runs["return"][at & (runs["policy"] == name)] for name in (policy, "greedy")]
    return returns[0] - returns[1]

# %%
for place in (*places, None):
    for radio in worlds:
        mean, low, high = bootstrap_interval(ahead("model", radio, place))
        print(f"{place or 'all four':<15}{radio:<12}{mean:+.1f} ({low:+.1f} to {high:+.1f})")

# %% [markdown]
# The intervals are for *other missions over these four places*, and say nothing about a fifth place (13.5).
#
# The agent's mean return is 32.3 under the paper's model and 32.2 under the ray-traced one, where
# it loses 0.9 in Munich and 0.6 in Paris, and gains 1.0 in San Francisco. Greedy gains 0.9 on
# average, so the lead shrinks, mostly in Munich and Florence. Greedy is told nothing about the
# channel, so no wrong belief misleads it. How much would the agent gain if it knew the ray-traced
# rates?
#
# ## 14.5 World and belief
#
# The agent does not measure the channel. It is *told*: one layer of its map says how much data a unit of time would bring over each cell
# (notebook 12). Even in the ray-traced world, that layer is computed from the **paper's model**. So there are two channels. The **world**
# decides what is really uploaded: it is the environment in which a policy flies, here `munich`. The **belief** says what the agent expects:
# it is the environment from which its observation is computed, here `model`.
#
# Now change only the belief. At one extreme, the agent is told the world's own table, which only a genie
# could know. At the other, it is told silence: that no data can be collected.

# %%
from uavdh_lite.beyond.measured import MeasuredEnvironment, believing

# %%
silence = MeasuredEnvironment(city, mean_snr_db=np.full((256, 256), -np.inf))
beliefs = {"silence": silence, "the model": model, "the truth": munich}
for name, belief in beliefs.items():
    flights = evaluate(munich, believing(agent, belief), agent.scenario, 100, seed=0)
    print(f"told {name:<10}return {flights.returns.mean():5.1f}")

# %% [markdown]
# When told silence, the agent earns less, probably because in training it never had to find data without
# being told where it was. The gap between the last two returns is roughly what measuring can gain. But the
# truth is no upper bound for a network that was never trained with it, and over a hundred missions so small
# a gap may be chance.
#
# ## 14.6 Measure, then tell
#
# In each slot the device with the best SNR sends, so the UAV has to measure the SNRs of all devices. For this, each device
# sends a known signal, a **pilot signal**. We assume that it can be measured down to −30 dB; anything weaker counts as
# that. The UAV notes the device's cell, its own cell and the SNR, here without noise or position errors, which is the best
# case.

# %%
from uavdh_lite.beyond.measured import expected, heard
from uavdh_lite.streams import Use, stream

# %%
survey = evaluate(munich, agent, agent.scenario, 100, seed=12)
found = heard(munich, survey, stream(Use.LAB, 12))
pairs = len({*zip(found.device, found.uav, strict=True)})
print(f"{len(found.snr_db)} SNRs of {pairs} pairs of cells, out of {possible.sum()}")

# %% [markdown]
# There are two ways to turn these notes into a belief:
#
# 1. **Two lines.** Fit a line to the SNRs in sight and another to those behind buildings. Because links that are too weak to hear count as −30 dB, the
#    second line is much flatter than in 14.3 and, deep in the shadow, promises too much.
# 2. **Link by link.** Correct these lines by what was measured *nearby*: if a device in the next cell was 15 dB below the line, a device in this one
#    probably is, too.
#
# For the second way, let $e$ be the height of a measured SNR above its line, in dB. Each measurement gets a weight $w$,
# which is 1 for the same two cells and falls with distance, to 0.6 if the device or the UAV is one cell away:
#
# $$\widehat{\mathrm{SNR}} = \text{line} + \frac{\sum w\,e}{1 + \sum w}$$
#
# The 1 in the denominator is the line's own weight, so where nothing was measured nearby, the line's value stands. The weights
# ignore walls, which is crude. The method is **kernel smoothing**, a relative of Gaussian process regression.

# %%
beliefs = {"the model": model, "two lines": expected(model, found),
           "link by link": expected(model, found, nearby_cells=1.0), "the truth": munich}

# %%
figure = Figure(figsize=(12, 3.4), layout="constrained")
for ax, (name, belief) in zip(figure.subplots(1, 4), beliefs.items()):
    draw_rates(ax, belief, device, limits=(1e-5, 10))
    flights = evaluate(munich, believing(agent, belief), agent.scenario, 100, seed=0)
    ax.set(title=f"{name}: return {flights.returns.mean():.1f}", xticks=[], yticks=[])
figure.colorbar(ax.images[-1], ax=figure.axes, extend="min", label="data units a slot")
figure

# %% [markdown]
# Correcting link by link changes seven in ten of the measured hidden links by 3 dB or more, but hardly any links of the device drawn here.
#
# How many earlier flights does a good belief require? The recorded runs have twelve *surveys*: sets of earlier flights, one for each seed
# and place. Here is the agent's lead again (`line` stands for two lines, `link` for link by link; the number counts the flights):

# %%
for radio in worlds:
    seed = runs["seed"][(runs["radio"] == radio) & (runs["policy"] == "greedy")]
    for told in "model line_1 line_10 line_100 link_1 link_10 link_100 truth".split():
        lead = ahead(told, radio)
        surveys = [f"{lead[seed == one].mean():.2f}" for one in range(3)]
        print(f"{radio:<11}told {told:<9}{lead.mean():.2f}, by seed {', '.join(surveys)}")

# %% [markdown]
# Under the paper's model there is next to nothing to gain, because there the model is the truth: on
# average even a single flight gives two lines that are as good as the model's.
#
# Under the ray-traced model, two lines gain next to nothing: with ten flights, they change the return by −0.8 to +0.3,
# depending on the survey. What counts is *which* link is bad, and only the second way, with many flights, finds that out.
# Link by link, ten flights change the return by −0.3 to +0.9; a hundred gain about two thirds of what the truth would gain
# (95 % interval: 55 to 77 %). That is 0.77 units on a return of 32, gained mostly in Munich and San Francisco.
#
# ## 14.7 Before you fly there
#
# The guide *Fly over your own campus* shows how to make the map. Before a real UAV takes off:
#
# 1. **Ask** first: flying is regulated.
# 2. **Check the map.** Heights may be wrong, and trees, cranes and wires are missing.
# 3. **Measure before you trust the model**, at the height and with the antennas of the mission, and in sight of somebody who
#    can take over. First test the link by which you command the UAV. Know the UAV's position to better than a cell, which
#    satellite navigation between walls may not allow.
# 4. **Keep the failsafe**, with a margin.
#
# ## Recap
#
# - A ray tracer computes each link, whereas the paper's model has two lines for all links. Behind Munich's buildings, where a
#   ray arrives at all, the model is off by 21 dB (RMS).
# - `any_city` is ahead of greedy over four real places, but by less under the ray-traced model than under the paper's.
# - World and belief can differ. Measuring each link over many flights corrects the belief.
#
# ## Exercises
#
# The exercises of this notebook are in [`exercises/14_a_real_city`](exercises/14_a_real_city/14_a_real_city.ipynb).
#
# ## Further reading
#
# - Aït Aoudia et al.: *Sionna RT: Technical Report*, arXiv 2504.21719.
# - Esrafilian, Gangula, Gesbert: *Learning to Communicate in UAV-aided Wireless Networks: Map-based Approaches*, IEEE Internet of Things Journal 2019.
