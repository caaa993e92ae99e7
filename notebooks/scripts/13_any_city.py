# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # 13 · Any city
#
# The agent of the course knows only one city. **Can one network fly over a city that it has never seen, as soon as that
# city is drawn?** The picture shows one flight over each of four such cities.

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

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import load_cities
from uavdh_lite.evaluation import evaluate
from uavdh_lite.plotting import caption, draw_trajectory

torch.set_num_threads(1)  # the network is small
agent = load_agent("any_city")
unseen = load_cities("random:100:1")
pilot = agent.over(unseen)
flown = evaluate(pilot.environment, pilot, agent.scenario, 300, seed=0)
kind_of = np.array([unseen[city].name.rsplit("_", 2)[0] for city in flown.start.city])

figure = Figure(figsize=(8, 8.6), layout="constrained")
for ax, kind in zip(figure.subplots(2, 2).flat, np.unique(kind_of)):
    path = flown.trajectory(int(np.argmax(kind_of == kind)))
    draw_trajectory(ax, pilot.environment, path)
    ax.set(title=kind.replace("_", " "), xlabel=caption(path), ylabel="", xticks=[], yticks=[])
figure

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Draw cities by the hundred, fly over one that you type yourself, compare seen with unseen cities, and look at the flights that go wrong |
# | **What you'll learn** | Why a centred map can carry over to a new city; what "unseen" proves; why missions in one city tell you less than missions in many cities; where a classic line algorithm goes wrong |
# | **What you'll need** | Notebooks 4, 8, 10 and 12. 55 minutes to read, 50 seconds to run; 22 minutes of exercises |
#
# ## 13.1 Cities by the thousand
#
# Nobody draws thousands of cities by hand. A generator draws them at random. They are of four kinds: streets with blocks, courtyards with
# gates, an old town with narrow lanes, and scattered houses.

# %%
from matplotlib.figure import Figure

from uavdh_lite.beyond.cities import CityGenerator
from uavdh_lite.plotting import draw_cities

figure = Figure(figsize=(10, 2.2), layout="constrained")
draw_cities(figure, CityGenerator().draw(6, seed=1), columns=6)
figure

# %% [markdown]
# Every city has what a mission needs: there are one to three landing zones, and every cell over which the UAV may fly can be reached.
# Equal seeds give equal cities, so `random:100:1` always means the same hundred: the first hundred of seed 1.
#
# Every city is really eight cities, at no extra cost (**data augmentation**). Turn it through a right angle, or mirror it, and you
# have another city with the same task. Only the actions have to turn with it, so that north becomes west, and so on.
#
# The agent `any_city` learned in cities of seed 0, with one of them drawn for each mission. Are any
# of the hundred cities of seed 1 among them? A city's *fingerprint* is a number computed from its
# cells (a **hash**):

# %%
import numpy as np
import torch

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import City, load_cities

torch.set_num_threads(1)  # the network is small
agent = load_agent("any_city")
unseen = load_cities("random:100:1")

# %%
learned = {city.fingerprint for city in agent.cities}
both = sum(city.fingerprint in learned for city in unseen)
print(f"{len(learned)} cities to learn in, {len(unseen)} to test in, {both} in both")

# %% [markdown]
# Here *unseen* means other cities, but from the same generator (nearly **in distribution**: all have 16 cells on a side, and those to
# learn in 8 to 16). The word promises nothing about cities that this generator would never draw.
#
# ## 13.2 Is one network enough?
#
# What has to change in the network? Hardly anything. It is the network of the agent `manhattan`,
# which copied a planner (notebook 12), except that its first fully connected layer is twice as
# wide. The maps that an agent sees have always shown buildings, no-fly zones and landing zones. But
# an agent with a single city can learn by heart what to do in each place, without looking at the
# buildings, whereas an agent that wakes up in another city each time has to look.
#
# Let `any_city` fly 300 missions over the hundred unseen cities. The greedy rule, a random pilot and an agent that has learned only in
# Manhattan fly the same missions. All four have the *failsafe*, so a move that would make it impossible to be home in time is never flown.

# %%
from uavdh_lite.evaluation import evaluate, groups_interval, mean_interval
from uavdh_lite.planners import Greedy, Random

BOTH, missions, pilot = "collected_and_landed", agent.scenario, agent.over(unseen)
pilots = {"any_city": pilot, "manhattan": load_agent("manhattan").over(unseen),
          "greedy": Greedy(pilot.environment), "random": Random()}

# %%
flights = {name: evaluate(pilot.environment, policy, missions, 300, seed=0)
           for name, policy in pilots.items()}
records = {name: flown.records() for name, flown in flights.items()}
for name, record in records.items():
    print(f"{name:<10}landed {record['landed'].mean():4.0%}  "
          f"collected and landed {record[BOTH].mean():5.1%}  return {record['return'].mean():5.1f}")

# %% [markdown]
# All flights land, so the pilots differ mainly in how much of the data they collect. The Manhattan
# specialist brings home far more than the random pilot, so some of what it learned holds elsewhere,
# too. But it falls well behind the agent that has learned in many cities. The unknown streets are
# one likely reason; another may be that the specialist was trained on narrower ranges of flying
# time, data and numbers of devices than `any_city`.
#
# The greedy rule is a strong rival here, because it knows the shortest route between any two cells of any city. Whether the
# difference between greedy and `any_city` is luck is a question for 13.5.
#
# What helps an agent in a new city? Compare the two frames of notebook 4, the map in place and the map centred on the UAV:

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("centred_in_a_new_city")

# %% [markdown]
# We measured the effect of centring: networks learned from reward in 2000 cities for 200,000 steps,
# with three seeds for each frame, and the best version of each network was kept. In new cities,
# those that saw the map centred brought home 72 % of the data, and those that saw it in place 60 %.
# But in the cities that they had learned in, the shares were 70 and 59 %. So what these runs show
# is faster learning, and not that a centred map carries over better; nor do they say what centring
# is worth in a new city after a long run. (The runs are in the table that 13.4 reads.)
#
# ## 13.3 Draw your own
#
# Type in a city, and fly over it. Ten cells on a side will do. `L` is the landing zone, `N` a no-fly zone, `B` a tall
# building, `b` a low one, and a dot a free cell. Change the city as you like:

# %%
mine = City.from_text("mine", """
    L L . . . . . . . .
    . . . B B . B B B .
    . . . B B . . . B .
    . b . . . . B . B .
    . b . B B . B . . .
    . . . B . . B B B .
    . N N . . . . . . .
    . N N . B B B . B .
    . . . . B . . . B .
    . . . . B B B . . .
""")

# %%
from uavdh_lite.player import play

own = agent.over(mine)
flight = evaluate(own.environment, own, missions, 1, seed=5)
play(own.environment, flight.trajectory(0))

# %% [markdown]
# The network was made for cities with 16 cells on a side. How does it cope with ten? No-fly cells are added to a smaller city
# until it has 16 cells on a side (**padding**), and in the centred map every city has such cells beyond its border. What these
# cells say is true: the UAV cannot get there. And because the agent learned in cities of eight to sixteen cells on a side, it
# has seen padded ones before. A larger city does not fit, because the first fully connected layer has a weight for every place
# on the map.
#
# In the labs you can do the same with the mouse: in the tool *Paint* (`python -m uavdh_lite app`), paint a city and let the agent fly.
#
# ## 13.4 Seen and unseen
#
# Does an agent do better in the cities that it learned in than in new ones? If it does, it has learned some of those cities by
# heart, and more cities may help.
#
# To see an agent learn by heart, give it fewer cities. Twelve networks learned from reward, with the failsafe and the told layers, in 1, 10,
# 100 or 2000 cities, with three seeds for each number of cities and 200,000 steps for each network. Each flew 500 missions over the cities that
# it had learned in, and 500 more over 300 other cities. Because the two sets of cities are not equally hard, greedy flew the same missions, and
# each network is compared with it:

# %%
from uavdh_lite.storage import data_folder, read_table

table = read_table(data_folder() / "runs/unseen_cities.csv.gz")

def shares(policy, learned_in, flown_over):
    wanted = {"policy": policy, "learned_in": learned_in, "flown_over": flown_over}
    return table[BOTH][np.all([table[name] == value for name, value in wanted.items()], axis=0)]

# %%
counts, points = (1, 10, 100, 2000), {"seen": [], "unseen": []}
for own in (f"random:{count}:0" for count in counts):
    for kind, cities in {"seen": own, "unseen": "random:300:9"}.items():
        points[kind].append(100 * (shares("centred", own, cities) - shares("greedy", "", cities)))
        ahead = " ".join(f"{value:+5.1f}" for value in points[kind][-1])
        print(f"{own:<13} {kind:<7}{ahead}")

# %%
from uavdh_lite.plotting import BLUE, VERMILION

figure = Figure(figsize=(6.5, 3.4), layout="constrained")
ax = figure.subplots()
for (kind, values), colour in zip(points.items(), (BLUE, VERMILION)):
    ax.plot(counts, np.mean(values, axis=1), color=colour, label=f"{kind} cities")
    ax.plot(counts, values, "o", color=colour, alpha=0.6)
ax.axhline(0, color="black", ls="--", label="greedy, the same missions")
ax.set(xscale="log", xticks=counts, xticklabels=counts)
ax.set(xlabel="cities to learn in", ylabel="points ahead of greedy")
ax.legend(fontsize="small")
figure

# %% [markdown]
# The curves approach each other. A single city is learned by heart: the network is level with greedy there, but almost twenty points
# behind it elsewhere. With ten cities, the gap between the curves is about twelve points, and with a hundred it is still about five.
# With 2000 cities it is gone.
#
# Notice what happens from left to right. The blue curve falls, because many cities are harder to know than one. The red
# curve rises, because what holds in many cities also holds in the next one. Where they meet, little is learned by heart
# any more, so what still holds the networks back is mainly something other than memorising. After only 200,000 steps,
# all twelve are far behind greedy in new cities. The agent `any_city` copied a planner first, and only then learned
# from reward, as notebook 12 explains.
#
# Between 100 and 2000 cities the red curve changes by less than the spread between seeds, so three short runs cannot tell
# whether more than a hundred cities help. And because all seeds learned in the same cities, their spread says nothing about
# other choices of ten or a hundred cities.

# %%
Quiz("what_unseen_proves")

# %% [markdown]
# ## 13.5 What is a mission worth?
#
# A hundred missions in one city say little about cities in general, because they all share the same walls. How much less is a
# mission worth if others share its city? Fly 400 missions in 12 cities, and compute the interval twice: once as if the missions
# were independent, and once with whole cities as what was drawn (a **clustered** interval), by Student's $t$ with one less than the
# number of cities.

# %%
few = agent.over(load_cities("random:12:7"))
flown = evaluate(few.environment, few, missions, 400, seed=2)
values = flown.records()[BOTH]
for what, groups in (("missions", None), ("cities", flown.start.city)):
    mean, low, high = mean_interval(values, groups)
    print(f"{what:<9}as drawn: {mean:.3f} ({low:.3f} to {high:.3f}), width {high - low:.3f}")

# %% [markdown]
# The second interval is clearly wider. Which one is right? If you want to know about these twelve
# cities, take the first. If you want to know about *cities in general*, take the second, because
# next time twelve others will be drawn. If each mission had a city of its own, the two intervals
# would be the same. If you can choose, therefore, take many cities, with few missions in each.
#
# Twelve cities say little about how much cities differ. Student's factor, 2.2 for twelve instead of 1.96, allows for
# that. A bootstrap over the cities would not: it would contain the true mean nine times in ten, and not nineteen
# times in twenty.

# %%
Quiz("draw_cities_again")

# %% [markdown]
# Now look at 13.2 again: is the agent ahead of greedy? Take the paired difference, and count whole cities:

# %%
lead = 100 * (records["any_city"][BOTH] - records["greedy"][BOTH])
cities = flights["any_city"].start.city
mean, low, high = groups_interval(lead, cities)
print(f"ahead by {mean:+.1f} points ({low:+.1f} to {high:+.1f})")

# %% [markdown]
# Read the interval, and not only the mean: the interval is several points wide, although there were a hundred
# cities. In 3000 other missions over 300 cities the lead was only 0.7 points, and its interval reached below
# 0 ([the results](../docs/results/four_ways.md)), so part of the lead here is probably luck. To tell so small
# a lead from luck, even 3000 missions are too few. The agent's return, however, was clearly higher than
# greedy's there, by 1.9 units (1.6 to 2.3).
#
# ## 13.6 Where it fails
#
# A mean hides the flights that went wrong. Of the 300 missions of 13.2, these are the three in which the agent is furthest behind greedy:

# %%
from uavdh_lite.plotting import caption, draw_trajectory

figure = Figure(figsize=(10, 4), layout="constrained")
for ax, mission in zip(figure.subplots(1, 3), lead.argsort()):
    path = flights["any_city"].trajectory(int(mission))
    draw_trajectory(ax, pilot.environment, path)
    ax.set(title=f"{lead[mission]:+.0f} points", xlabel=caption(path), ylabel="")
figure

# %% [markdown]
# The captions and the arrows show which of these explanations fits each flight:
#
# - Most of the flying time was used, but few arrows can be seen, because they lie on top of one another. The UAV went back and
#   forth, probably because several cells looked equally good to the network.
# - Much time was left when the UAV landed. In that case the agent gave up, although data was left and there was
#   time to collect it.
# - The data lies behind walls or a no-fly zone, so the route to it is long. The greedy rule looks that route up in
#   a table.
#
# Change `lead.argsort()` to `(-lead).argsort()`, and you will see the three missions in which greedy is furthest behind.
#
# ## 13.7 Shadows for every city
#
# Each city needs its own table of which cells see each other. The library computes it with the exact test of
# notebook 2. The authors of the paper trace their rays by a different method. In 1962 Jack Bresenham wrote an
# algorithm that draws a line as a row of pixels. The authors' variant of it walks from cell to cell and keeps
# a running error: how far the centre of the cell lies from the straight line. This error decides whether the
# next step goes along the row or the column. The authors' code sends a fan of such lines from the device to
# every cell on the border of the map, and a cell is in sight if some line reaches it before meeting a
# building.
#
# Many cities are a good test of such a program, even if you do not know the right answers. It is enough to know a property
# that all right answers must have (**property-based testing**):

# %%
Quiz("both_ways")

# %%
from uavdh_lite.course.bresenham import bresenham_fans

wrong, one_way = [], []
for city, sight in zip(few.environment.cities, few.environment.sight.reshape(-1, *[16] * 4)):
    fan = bresenham_fans(city.buildings)
    wrong.append((fan != sight).sum() / sight.sum())
    one_way.append((fan & ~fan.transpose(2, 3, 0, 1)).sum() / fan.sum())

# %%
for name, shares in (("wrong, of all links in sight", wrong), ("one direction only", one_way)):
    print(f"{name:<30}{np.mean(shares):4.0%} on average, {min(shares):.0%} to {max(shares):.0%}")
assert min(one_way) > 0.02

# %% [markdown]
# In each of the twelve cities, some links of the fan work in one direction only. The fan counts a
# cell as seen if a line that is aimed at another cell touches it, even at its edge, and different
# lines are drawn from the other end. Radio works the same both ways (**reciprocity**), so no
# measurement was needed to know that the fan is wrong. Here are the cells that a device sees in the last of these cities, by the exact
# test and by the fan:

# %%
from uavdh_lite.plotting import draw_city

device = tuple(np.argwhere(~city.buildings)[90])
figure = Figure(figsize=(9, 4.6), layout="constrained")
for ax, name, seen in zip(figure.subplots(1, 2), ("exact", "Bresenham's fan"), (sight, fan)):
    draw_city(ax, city, 4 * ~seen[device]).plot(*device[::-1], "X", ms=13)
    ax.set_title(name)
figure

# %% [markdown]
# The fan errs mostly by seeing too much: it looks round several corners that block the exact ray.
# Does that matter to an agent? We do not know, because we have not trained one with such shadows.
#
# ## Recap
#
# - A network with a single city can learn it by heart. One that wakes up in another city each time has to look.
# - In the centred map, a wall to the east looks the same in every city.
# - The more cities there are to learn in, the closer the scores over seen and unseen cities come to each other.
# - *Unseen* means little until you say where the cities come from, so name their source whenever you report a number for unseen cities.
# - Missions in one city share its walls. For a claim about cities, count whole cities.
# - If you test for a property that every right answer must have, you can find errors even where nobody knows the
#   answers.
#
# ## Exercises
#
# The exercises of this notebook are in [`exercises/13_any_city`](exercises/13_any_city/13_any_city.ipynb).
#
# ## Further reading
#
# - Cobbe, Klimov, Hesse, Kim, Schulman: *Quantifying Generalization in Reinforcement Learning*, ICML 2019: how many levels of a game an agent must train on
#   before it copes with new ones.
# - Kirk, Zhang, Grefenstette, Rocktäschel: *A Survey of Zero-shot Generalisation in Deep Reinforcement Learning*, JAIR 2023.
# - Bresenham: *Algorithm for computer control of a digital plotter*, IBM Systems Journal, 1965.
# - The page *One agent for any city* on the site, under Results.
