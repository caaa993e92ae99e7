# %% [markdown]
# # 14 · A real city
#
# Every city so far was invented, and so was its radio: path loss by a formula, and a yes or no for the line of sight. **Does the
# agent still fly over a place that exists, when its radio waves bounce off the walls?** The picture shows four places and a flight
# over each. The agent has seen none of them, and none like them.

# %% tags=["remove-cell"]
# Without uavdh_lite installed, as on Colab: install it from a wheel, or from the project's folder.
from glob import glob
from importlib.metadata import distributions

wheel = ""  # its address, if you were given one; a wheel that lies beside this notebook is found
places = ("..", ".", "../..", "../../..", *glob("*"))
project = [path for path in places if glob(f"{path}/uavdh_lite/city.py")]
if not any(distributions(name="uavdh_lite")):
    source = [*filter(None, [wheel]), *glob("uavdh_lite-*.whl"), *project]
    assert source, "upload the wheel beside this notebook, or set its address above"
    # %pip install -q "{source[0]}" ipywidgets
if project:
    # %cd -q {project[0]}/notebooks

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
# | **What you'll do** | Compare the paper's channel with a ray-traced one, link by link; fly in both; let the UAV measure its channel, and tell the agent |
# | **What you'll learn** | What a path loss model leaves out; why world and belief are two things; what measuring is worth, and what it cannot help |
# | **What you'll need** | Notebooks 1, 2, 12 and 13. 60 minutes to read, 40 seconds to run; 22 minutes of exercises |
#
# ## 14.1 Four places
#
# The scenes come with [Sionna RT](https://nvlabs.github.io/sionna/rt/), a ray tracer for radio waves. They were made from the buildings in OpenStreetMap: the old town of
# Munich, the streets south of Florence's cathedral, the open space around the Arc de Triomphe in Paris, and a level part of San Francisco.
# From each we took a square of 160 m and cut it into 16 × 16 cells.
#
# Three rules make it a city. A cell is a *tall building* if half of it or more is covered by something higher than the UAV flies, 10 m above
# the ground. It is a *low building* if half of it or more is built on, but not so high. The landing zone is the six free cells nearest to the middle.

# %%
import numpy as np
from matplotlib.figure import Figure

from uavdh_lite.beyond.measured import links, load_place, modelled_snr_db

# %%
munich = load_place("munich")
city, sight, possible = munich.city, munich.sight[0], links(munich)
print(f"{(possible & sight).sum() / possible.sum():.0%} of the pairs of cells see each other")

# %% [markdown]
# A wall now runs along the edge of a cell, and streets narrower than 10 m may have vanished. Keep that in mind for 14.3: our shadow map is an exact answer to a coarse question.
#
# ## 14.2 What a ray tracer does
#
# The paper's channel has two formulas, one for links with line of sight (LoS) and one for those without (NLoS):
#
# $$\mathrm{SNR} = \frac{P}{\sigma^2}\; d^{-\alpha_\ell}\; 10^{\eta_\ell/10}, \qquad \ell \in \{\text{LoS}, \text{NLoS}\} \qquad\text{(eq. 2)}$$
#
# It is a *statistical* model: behind *some* building, the SNR is lower by *about* so much. A **ray tracer** computes the link itself. It sends half a million rays or more
# from the device. A ray that meets a wall or the ground is reflected, and loses power by the laws of
# Fresnel for that material. A ray that passes an edge is also bent around it; this is **diffraction**. What arrives at the UAV's height is added up,
# cell by cell. The sum over the power sent is the **path gain**, and we have a table of it: `gain_db[device cell, UAV cell]`.
#
# Our table has up to five reflections or one diffraction, a carrier of 3.5 GHz, antennas that send equally in all directions, and no ray that
# passes through a wall. Powers are averaged over a cell and added without their phases, so there is no small-scale fading, the ups and downs within a wavelength
# of 9 cm, and we fly without any.
#
# Gains become SNRs only with a transmit power and a noise level. We shift all gains of a place by one
# offset, so that the pairs in sight have the mean SNR of the paper's model. *How loud* the place is comes from the paper, *where* it is loud from the rays.
#
# Take a device in a street in the west of the old town. **Before you run the cell:** where will the two maps differ most?

# %%
from uavdh_lite.environment import Environment
from uavdh_lite.plotting import draw_rates

# %%
device, model = (8, 1), Environment(city)  # row and column; the paper's radio over the same city
figure = Figure(figsize=(10, 4.2), layout="constrained")
radios = {"the paper's model": model, "ray-traced": munich}
for ax, (title, environment) in zip(figure.subplots(1, 2), radios.items()):
    draw_rates(ax, environment, device).set(title=title)
figure

# %% [markdown]
# On the left the shadows are sharp: a cell sees the device or it does not. On the right they have soft edges.
# Just behind a corner the rate is between the two, because the wave bends around the corner, and a wall opposite sends some of it on. White cells get no ray at all.
#
# ## 14.3 Link by link
#
# Now take all pairs of cells at once. Each point is a link; the lines are those of the paper.

# %%
from uavdh_lite.beyond.measured import distances_m
from uavdh_lite.plotting import BLUE, ORANGE

# %%
distance_m, traced_db, model_db = distances_m(munich), munich.mean_snr_db, modelled_snr_db(model)
audible = possible & np.isfinite(traced_db)

# %%
kinds = {"in sight": sight, "behind buildings": ~sight}
figure = Figure(figsize=(9, 3.8), layout="constrained")
for ax, (kind, state) in zip(figure.subplots(1, 2, sharey=True), kinds.items()):
    x = distance_m[audible & state]
    ax.plot(x, traced_db[audible & state], ".", ms=1.5, color=BLUE, rasterized=True)
    ax.plot(np.sort(x), model_db[audible & state][x.argsort()], color=ORANGE, lw=3)
    ax.set(title=kind, xlabel="distance, m", ylabel="SNR, dB", ylim=(-90, 25))
figure

# %% [markdown]
# Two clouds that could hardly be more different. Fit a straight line to each over $10\log_{10} d$. Its slope is $-\alpha$, the **path loss exponent**:

# %%
for kind, state in kinds.items():
    x, y = 10 * np.log10(distance_m[audible & state]), traced_db[audible & state]
    slope, level = np.polyfit(x, y, 1)
    silent = 1 - len(y) / (possible & state).sum()
    spread_db = np.std(y - slope * x)
    print(f"{kind:<17}exponent {-slope:.2f}, spread {spread_db:.1f} dB, no ray {silent:.0%}")

# %% [markdown]
# The paper has 2.27 and 3.64, with spreads of 1.4 and 2.2 dB. What the rays say:
#
# - **In sight** the exponent is *below* 2, that of free space, because walls and ground reflect ever more of the power along
#   the street. Radio engineers call this a *street canyon*. The points far below the line are the price of our
#   cells: the grid says "in sight", but a real corner is in the way.
# - **Behind buildings** a single line says little. At one distance, links differ by 60 dB: some lie behind a corner, some behind a whole
#   block, and a third have no ray at all.
# - **The spread is of another kind.** In the paper, the deviation $\eta$ is drawn anew for each device and slot. Here it belongs to the place: fly by again, and the
#   link is as bad as before. What is random for the model is a *map* that could be learned.
#
# Is the model a bad one, then? The rate is $\log_2(1+\mathrm{SNR})$. Below −20 dB it is next to nothing, whether at −30 or at −80 dB:

# %%
from uavdh_lite.channel import rate

rates = rate(model_db[possible]), rate(traced_db[possible])
print(f"correlation of the rates {np.corrcoef(*rates)[0, 1]:.2f}")

# %% [markdown]
# The rates agree well, since the large errors sit where nobody would send anything anyway.
# The picture adds up, for each cell of the UAV, how far the model is off over all devices.

# %%
error = np.where(possible, rate(traced_db) - rate(model_db), 0)
figure = Figure(figsize=(9, 3.8), layout="constrained")
for ax, (kind, state) in zip(figure.subplots(1, 2), kinds.items()):
    sums = np.where(state, error, 0).sum(axis=0).reshape(16, 16)
    picture = ax.imshow(np.where(city.no_fly, np.nan, sums), cmap="PuOr", vmin=-12, vmax=12)
    ax.set(title=kind, xlabel="column", ylabel="row")
figure.colorbar(picture, ax=figure.axes, label="ray-traced − model, data units a slot")
figure

# %% [markdown]
# Violet cells hear more than the model promises, orange ones less. In sight the model is too generous over the square: its line is steeper than that of the rays and has the same mean, so it
# promises too much nearby, where the data is.
# Behind buildings the rays bring *more*, next to the corners past which a UAV flies, because reflection and diffraction carry the signal into the shadow there.
#
# Beware: the ray tracer is a model, too. It knows no trees, no cars, no rough walls that scatter a wave, and no windows that let it in. Many heights in these scenes are assumptions.
# It shows what *another* radio does to our agent, and not what Munich's radio is.
#
# ## 14.4 Does the agent still fly?
#
# Three pilots fly 100 missions over Munich, in both radios: `any_city` from notebook 13, greedy, and the DDQN agent of the course, which knows Manhattan and
# nothing else. All have the failsafe. **Your guess first:** who suffers most from the change of radio?

# %%
from uavdh_lite.beyond.failsafe import SafeEnvironment
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.evaluation import evaluate
from uavdh_lite.planners import Greedy

agent = load_agent("any_city").over(city)
pilots = {"any_city": agent, "greedy": Greedy(munich),
          "DDQN": load_agent("manhattan_ddqn").over(city)}
worlds = {"model": SafeEnvironment(city), "ray-traced": munich}

# %%
flown = {(name, radio): evaluate(world, pilot, agent.scenario, 100, seed=0)
         for name, pilot in pilots.items() for radio, world in worlds.items()}
for (name, radio), flights in flown.items():
    record = flights.records()
    share = record["collected_and_landed"].mean()
    print(f"{name:<9}{radio:<11}{share:4.0%} collected, return {flights.returns.mean():5.1f}")

# %% [markdown]
# The DDQN agent is far behind, in either radio: it learned one city by heart, and was never meant to fly here. For the other two, the change of radio is small. Here is a mission from the middle
# of the field:

# %%
from uavdh_lite.plotting import caption, draw_trajectory

lead = flown["any_city", "ray-traced"].returns - flown["greedy", "ray-traced"].returns
figure, mission = Figure(figsize=(11, 4.2), layout="constrained"), int(lead.argsort()[60])
for ax, name in zip(figure.subplots(1, 3), pilots):
    path = flown[name, "ray-traced"].trajectory(mission)
    draw_trajectory(ax, munich, path)
    ax.set(title=name, xlabel=caption(path), ylabel="", xticks=[], yticks=[])
figure

# %% [markdown]
# One place and a hundred missions are not much. The recorded runs have three seeds of 300 missions in each of the four places and in both radios. What is
# printed is how much the return of `any_city` is ahead of greedy's, mission by mission:

# %%
from uavdh_lite.evaluation import bootstrap_interval
from uavdh_lite.storage import read_table

# %%
runs = read_table("../data/runs/real_city.csv.gz")
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
# What does such an interval cover? The last line is about *other missions over these four places*, and not about a fifth:
# missions over one place share its walls, and four places are too few to say how much places differ (11.5). That all four show a lead is worth more than a narrow interval.
#
# So the agent carries over: what it learned in invented cities with an invented radio still gives it a lead, though a smaller one. Why smaller?
#
# ## 14.5 World and belief
#
# The agent does not hear the world. It is *told*: one layer of its map says how much data a unit of time would bring over each cell (notebook 12). In the ray-traced
# world it was still told what the **paper's model** expects. There are two radios now:
#
# | | what it is | in the code |
# | --- | --- | --- |
# | **world** | decides what is really uploaded | the environment in which a policy flies, here `munich` |
# | **belief** | says what the agent expects | the environment of the agent's observation, here `SafeEnvironment(city)` |
#
# In the notebooks before, the two were the same. Now change the belief and leave the world as it is. At one end the agent is told the world's own table, which only a genie knows. At the other it is told that no data
# can be had anywhere.

# %%
from uavdh_lite.beyond.measured import MeasuredEnvironment, believing

# %%
silence = MeasuredEnvironment(city, mean_snr_db=np.full((256, 256), -np.inf))
beliefs = {"nothing": silence, "the model": model, "the truth": munich}
for name, belief in beliefs.items():
    flights = evaluate(munich, believing(agent, belief), agent.scenario, 100, seed=0)
    print(f"told {name:<10}return {flights.returns.mean():5.1f}")

# %% [markdown]
# Told nothing, the agent falls far behind, because it never had to learn what follows from buildings and devices. Between the model and the truth lies what there is to win by measuring.
#
# ## 14.6 Measure, then tell
#
# A UAV can measure. The schedule compares the SNRs of all devices, so each device sends a short known signal, a **pilot**. Let the UAV write down what it
# hears: the device's cell, its own cell, the SNR.

# %%
from uavdh_lite.beyond.measured import expected, heard
from uavdh_lite.streams import Use, stream

# %%
survey = evaluate(munich, agent, agent.scenario, 100, seed=12)
found = heard(munich, survey, stream(Use.LAB, 12))
print(f"{len(found.snr_db)} SNRs heard, some of them twice; {possible.sum()} pairs of cells")

# %% [markdown]
# What to make of the list? Two ways, one of them blunt:
#
# 1. **Two lines.** Fit a line to the SNRs in sight and one to those behind buildings, as in 14.3. The expected data is
#    the mean rate over their spread.
# 2. **Link by link.** Take these lines as the first guess, and correct each link by what was heard *nearby*: if a device in the next cell was heard 15 dB below the line from about here, this one probably
#    will be, too.
#
# For the second way, let $e$ be the errors of the line and $w$ weights that fall from 1 with the distance between the devices and between the UAVs, to 0.6 at one cell:
#
# $$\widehat{\mathrm{SNR}} = \text{line} + \frac{\sum w\,e}{1 + \sum w}$$
#
# The 1 below is the line's own weight, as if it were one measurement. Where nothing was heard, the line stays. This is **kernel smoothing** with shrinkage towards the line, a small relative of *kriging*, or Gaussian process regression.

# %%
beliefs = {"the model": model, "two lines": expected(model, found),
           "link by link": expected(model, found, nearby_cells=1.0), "the truth": munich}

# %%
figure = Figure(figsize=(12, 3.2), layout="constrained")
for ax, (name, belief) in zip(figure.subplots(1, 4), beliefs.items()):
    rates = np.where(city.no_fly, np.nan, belief.rate_map(8 * 16 + 1)).clip(1e-3)
    picture = ax.imshow(rates, norm="log", vmin=1e-3, vmax=10)
    flights = evaluate(munich, believing(agent, belief), agent.scenario, 100, seed=0)
    ax.set(title=f"{name}: return {flights.returns.mean():.1f}", xticks=[], yticks=[])
figure.colorbar(picture, ax=figure.axes, label="data units a slot")
figure

# %% [markdown]
# The same device as in 14.2, and the return of a hundred missions with each belief. With two lines the shadows stay sharp, since a line cannot say *which* link behind a building is
# good. Link by link, the edges soften where the survey has been.
#
# The recorded runs have three seeds, each with its own survey, over four places. How many earlier flights does it take?

# %%
from uavdh_lite.plotting import GREEN

# %%
counts, figure = (1, 10, 100), Figure(figsize=(10, 3.6), layout="constrained")
for ax, radio in zip(figure.subplots(1, 2, sharey=True), worlds):
    for kind, label, colour in (("line", "two lines", ORANGE), ("link", "link by link", BLUE)):
        told = [ahead(f"{kind}_{n}", radio).mean() for n in counts]
        ax.plot(counts, told, marker="o", color=colour, label=label)
    for policy, style in (("model", ":"), ("truth", "--")):
        ax.axhline(ahead(policy, radio).mean(), ls=style, color=GREEN, label=f"the {policy}")
    ax.set(title=radio, xscale="log", xlabel="earlier flights", ylabel="return ahead of greedy")
ax.legend(title="told")
figure

# %% [markdown]
# In the paper's radio there is nothing to win: already a single flight gives two lines that are as good as the formula that made the world. So the agent need not be told
# what only a genie knows.
#
# In the ray-traced radio, two lines win nothing either. They say more exactly how bad it is behind a building, and that is the wrong question. *Which* link is
# bad is what counts, and that takes the second way and many flights: with ten the curve has hardly moved, with a hundred it is about half-way to the truth. They pay for a place over
# which one flies every day. (The results page *Four real places* has the intervals.)
#
# ## 14.7 Before you fly there
#
# The guide *Fly over your own campus* on the site takes you from a map to a flight in five minutes. Before a real UAV takes off:
#
# 1. **Ask.** Where a UAV may fly, how high, and over whom is regulated almost everywhere.
# 2. **Check the map.** Heights are often assumed, and trees, cranes and wires are on no footprint.
# 3. **Measure before you trust.** Fly a survey at a safe height, compare it with both models, and tell the agent what you found.
# 4. **Keep the failsafe**, with a margin. Wind does not know that a move takes one unit of time.
#
# ## Recap
#
# - A ray tracer computes each link; a path loss model draws one line through all of them. Behind buildings it is off by tens of decibels, and yet the rates agree well.
# - The world decides what happens, the belief what the agent expects. Whoever evaluates an agent should say what each of them was.
# - A deviation that belongs to a place can be learned by flying there. One that is drawn anew in each slot cannot.
#
# ## Exercises
#
# The exercises of this notebook are in [`exercises/14_a_real_city`](exercises/14_a_real_city/14_a_real_city.ipynb).
#
# ## Further reading
#
# - Hoydis et al.: *Sionna RT: Differentiable Ray Tracing for Radio Propagation Modeling*, arXiv 2303.11103.
# - Esrafilian, Gangula, Gesbert: *Learning to Communicate in UAV-aided Wireless Networks: Map-based Approaches*, IEEE Internet of Things Journal 2019: measure, learn the channel, then plan.
