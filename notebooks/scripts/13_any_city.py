# %% [markdown]
# # 13 · Any city
#
# The agents of the notebooks before this one know one city each. Here one network flies over cities that it has never
# seen, the moment they are drawn. It was trained like the agent of notebook 12, but over two thousand cities, with one of
# them drawn for each mission.

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
import inspect
from dataclasses import replace

import numpy as np
import torch
from matplotlib.figure import Figure

from uavdh_lite.beyond.cities import CityGenerator
from uavdh_lite.beyond.failsafe import MaskedNetwork
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import City, load_cities
from uavdh_lite.course.quiz import Quiz
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import bootstrap_interval, evaluate
from uavdh_lite.planners import Greedy, Random
from uavdh_lite.plotting import BLUE, VERMILION, caption, draw_cities, draw_trajectory
from uavdh_lite.scenario import find_scenario
from uavdh_lite.streams import Use, stream

torch.set_num_threads(1)

# %%
agent = load_agent("any_city")
missions = agent.scenario
unseen = load_cities("random:100:1")
there = agent.over(unseen)
flown = evaluate(there.environment, there, missions, 300, seed=0)

# %%
city_of = flown.start.city  # of each mission, the number of its city
kind_of = np.array([unseen[city].name.rsplit("_", 2)[0] for city in city_of])  # as in old_town_1_17
figure = Figure(figsize=(10, 11), layout="constrained")
for ax, kind in zip(figure.subplots(2, 2).flat, np.unique(kind_of)):
    first = int(np.argmax(kind_of == kind))
    draw_trajectory(ax, there.environment, flown.trajectory(first))
    ax.set_title(kind.replace("_", " "))
figure

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Draw cities by the hundred, fly an agent over one that you have just typed, compare seen with unseen cities, look at one mission in eight views, and fine-tune |
# | **What you'll learn** | Why a centred map can carry over to a new city; what "unseen" proves; why missions in one city are worth less than missions in many; what the symmetry of a map is good for |
# | **What you'll need** | Notebooks 4, 8 and 12. 57 minutes to read, 60 seconds to run; 45 minutes of exercises |
#
# The four flights above are the first over each kind of city, drawn as in notebook 0. The agent was trained in none of these cities. Its missions
# have wider ranges than those of the notebooks before:

# %%
for name in ("manhattan", "any_city"):
    ranges = find_scenario(name)
    print(f"{name:<10}devices {ranges.devices}, data of each {ranges.data}, flying time {ranges.flying_time}")

# %% [markdown]
# ## 13.1 Cities by the thousand
#
# Nobody draws thousands of cities by hand. `CityGenerator` does it at random, in four kinds: streets with blocks, scattered houses,
# courtyards with gates, and an old town with narrow lanes.

# %%
figure = Figure(figsize=(12, 3.4), layout="constrained")
draw_cities(figure, CityGenerator().draw(6, seed=1), columns=6)
figure

# %% [markdown]
# Every city has what a city needs: one to three landing zones, and every cell over which the UAV may fly can be
# reached. Equal seeds give equal cities, so `random:100:1` names a hundred of them for good: the first hundred of
# seed 1. The cities that the agent learned in are of seed 0. Are any of the hundred among them?

# %%
learned = {city.fingerprint for city in agent.cities}
print(f"{len(learned)} different cities to learn in, {len(unseen)} to test in, "
      f"{sum(city.fingerprint in learned for city in unseen)} in both")

# %% [markdown]
# That is what *unseen* means here: other cities, but from the same generator. It says nothing yet of cities that
# no such generator would draw. (A person drew Manhattan: exercise 2 flies there.)
#
# ## 13.2 Is one network enough?
#
# What has to change in the network for that? Nothing. Its input always showed buildings, no-fly zones and landing
# zones. An agent that only ever sees one city can learn its streets by heart instead of looking. An agent that is in
# another city each time has to look.
#
# So let three others fly over the unseen cities, too: the `manhattan` agent of notebook 12, a random pilot, and the greedy
# rule, which knows the shortest way between any two cells of any city. All have the failsafe of notebook 12.

# %%
others = {"manhattan": load_agent("manhattan").over(unseen), "random": Random(), "greedy": Greedy(there.environment)}
flights = {"any_city": flown} | {name: evaluate(there.environment, pilot, missions, 300, seed=0)
                                 for name, pilot in others.items()}
CRAL = "collected_and_landed"  # the share of the data if the UAV has landed, 0 if it has not
records = {name: flown.records() for name, flown in flights.items()}
for name, record in records.items():
    print(f"{name:<10}landed {record['landed'].mean():.0%}   "
          f"collected and landed {record[CRAL].mean():.1%}   return {record['return'].mean():5.1f}   "
          f"time used {record['time_used'].mean():.0%}")
collected = {name: record[CRAL] for name, record in records.items()}
assert collected["any_city"].mean() > collected["manhattan"].mean() + 0.02

# %% [markdown]
# All land. The specialist of Manhattan collects far more than the random pilot, so it uses at least the devices on its map. But
# it collects less than the agent that learned in many cities. The unknown streets are one reason; missions unlike its own, fewer
# steps of training and a single view of the map may be others. Whether that one is ahead of
# greedy, which knows all distances exactly while the network sees most of the map blurred, 13.4 asks with an interval.
# (`any_city` looks at each mission in eight views and acts on the mean. 13.5 says how, and what that adds.)

# %%
Quiz("centred_in_a_new_city")

# %% [markdown]
# ## 13.3 Draw your own
#
# Type a city, and fly. Ten cells on a side will do. `L` is the landing zone, `N` a no-fly zone, `B` a tall building, `b` a
# low one, and a dot a free cell:

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
pilot = agent.over(mine)
flight = evaluate(pilot.environment, pilot, missions, 1, seed=5)

# %%
figure = Figure(figsize=(9, 4.4), layout="constrained")
left, right = figure.subplots(1, 2)
draw_trajectory(left, pilot.environment, flight.trajectory(0))
right.imshow(pilot.observation(flight.start)[0][0, 1], cmap="Reds", vmin=0, vmax=1.6)
right.plot(15, 15, "o", color=BLUE)
right.set(title="the no-fly layer around the UAV", xlabel="cell, the UAV is at 15", ylabel="cell")
figure

# %% [markdown]
# The network was made for 16 cells on a side. A smaller city is surrounded by no-fly cells (right), as every city is at its
# border: they say what is true, that the UAV cannot get there. Free cells would promise room. So the same network takes
# any city up to that size. A larger one does not fit: the first fully connected layer has a weight for each place on the map.
#
# The radio is that of the small city. Its edge, and not the frame's, has an SNR of −15 dB (notebook 1). How much stronger
# would the signal be with the frame's constants? $P/\sigma^2$ goes with the size to the power 2.27:

# %%
for size, frame in ((10, 16), (16, 50)):
    factor = (frame / size) ** 2.27
    print(f"{size} cells in a frame of {frame}: {factor:.1f} times, {10 * np.log10(factor):.1f} dB")

# %% [markdown]
# So with the frame's constants a small city would be an easier task than it is. That is why they are not used.
#
# The labs do the same with the mouse: in the city editor of notebook 10, paint a city and press *fly*.
#
# ## 13.4 Seen and unseen
#
# Does it know the cities that it learned in better than new ones? If so, it has learned some of them by heart, and more cities
# would help. Fly as many missions as in 13.2 over cities that it learned in:

# %%
seen = load_cities("random:100:0")  # a hundred of these
assert all(city.fingerprint in learned for city in seen)
known = agent.over(seen)
here = {name: evaluate(known.environment, pilot, missions, 300, seed=0)
        for name, pilot in (("agent", known), ("greedy", Greedy(known.environment)))}
ahead = {"unseen": (collected["any_city"] - collected["greedy"], flown.start.city),
         "seen": (here["agent"].records()[CRAL] - here["greedy"].records()[CRAL],
                  here["agent"].start.city)}

# %%
def points(values, cities):
    """The mean in points, with the interval for other cities of the kind: it draws whole cities again."""
    return "{:+z.1f} points ({:+z.1f} to {:+z.1f})".format(*(100 * x for x in bootstrap_interval(values, groups=cities)))

for name, (lead, cities) in ahead.items():
    print(f"{name:<7}ahead of greedy by {points(lead, cities)}")

# %% [markdown]
# The cities differ, and so do the missions in them. So each line compares with greedy on the same missions: that takes
# most of the luck out. (Why whole cities are drawn again is below, in *What is a mission worth?*) The two sets are independent, so
# the half widths add in squares: the leads would have to be about three points apart to tell. They are not, so there is no gap
# to be seen, though one of two points could hide here.
#
# And is the agent ahead of greedy in unseen cities, as 13.2 asked? Perhaps: with these 300 missions the interval starts at
# about 0. Twenty times as many missions say "hardly in data": a lead between −0.2 and +0.9 points. In return it is ahead, as
# it flies home sooner (`docs/results/any_city.md`, on the site under Results).

# %%
Quiz("what_unseen_proves")

# %% [markdown]
# ### How many cities does it take?
#
# To see learning by heart, give the network fewer cities. These agents learned in 1, 10, 100 or 2000 of them, for
# 200,000 steps each, with three seeds. (The shipped agent had nine million, in three runs, each of which went on from the one before.) All looked at the map in one view only (13.5). They flew
# 500 missions over the cities that they learned in, and 500 over 300 others. These sets are not equally hard. So greedy
# flies the same missions, and each agent is compared with it:

# %%
from uavdh_lite.storage import read_table

table = read_table("../data/runs/unseen_cities.csv.gz")
counts = (1, 10, 100, 2000)

def three_seeds(**wanted):
    return table[CRAL][np.all([table[name] == value for name, value in wanted.items()], axis=0)]

def by_greedy(cities):
    environment = Environment(agent.cities if cities == "random:2000:0" else load_cities(cities))
    return evaluate(environment, Greedy(environment), missions, 500, seed=9).records()[CRAL].mean()

# %%
scores = {"seen": [], "unseen": []}
rule = {name: by_greedy(name) for name in ("random:300:9", *(f"random:{count}:0" for count in counts))}
assert np.isclose(rule["random:300:9"], three_seeds(variant="greedy")[0], atol=1e-4)
for count in counts:
    runs = {"learned_in": f"random:{count}:0", "variant": "global_local", "views": 1}
    for name, cities in (("seen", f"random:{count}:0"), ("unseen", "random:300:9")):
        scores[name].append(100 * (three_seeds(**runs, flown_over=cities) - rule[cities]))
    print(f"{count:>4} cities: " + ", ".join(f"{name} {' '.join(f'{s:+.1f}' for s in scores[name][-1])}" for name in scores))

# %%
figure = Figure(figsize=(6.5, 3.6), layout="constrained")
ax = figure.subplots()
for (name, values), colour in zip(scores.items(), (BLUE, VERMILION)):
    ax.plot(counts, np.mean(values, axis=1), color=colour, label=f"{name} cities")
    ax.plot(counts, values, "o", color=colour, alpha=0.6)
ax.axhline(0, color="black", ls="--", label="greedy, the same missions")
ax.set(xscale="log", xticks=counts, xticklabels=counts, xlabel="cities to learn in", ylabel="collected and landed,\npoints ahead of greedy")
ax.legend(fontsize="small")
figure

# %% [markdown]
# One city is learned by heart: level with greedy there, and about twenty points behind it elsewhere. With ten cities the
# gap between the two lines is about ten points, and with a hundred still about five. With 2000 there is none to be seen;
# each point is a mean of 500 missions, so a gap of two points may be luck. In new cities, each step from 1 to 10 to 100
# helps in the mean. From 100 to 2000 the mean gains a point, about as much as seeds differ: three short runs cannot tell. (All
# seeds learned in the same one, ten or hundred cities. So how much they differ says nothing of other cities.)

# %% [markdown]
# ### What is a mission worth?
#
# A hundred missions in one city say little about cities: they all share its walls. The fewer cities the missions are spread
# over, the less they tell. How much less? Fly 400 missions in 12 cities, and take the interval twice: as if the
# missions were independent, and with the cities as what was drawn. (By hand here. The argument `groups` of
# `bootstrap_interval`, above, does the same.)
# (`stream(use, seed)` makes all random generators of this library: each use has a sequence of its own, so what draws
# intervals never shares numbers with what draws missions.)

# %%
few = load_cities("random:12:7")
over_few = agent.over(few)
flown = evaluate(over_few.environment, over_few, missions, 400, seed=2)
values = flown.records()["collected_and_landed"]
members = [values[flown.start.city == city] for city in range(len(few))]

# %%
generator = stream(Use.BOOTSTRAP, 13)

def spread(means):
    return np.quantile(means, [0.025, 0.975])
by_mission = spread([generator.choice(values, len(values)).mean() for _ in range(2000)])
by_city = spread([np.concatenate([members[c] for c in generator.integers(0, len(few), len(few))]).mean() for _ in range(2000)])
print(f"missions drawn again: {by_mission[0]:.3f} to {by_mission[1]:.3f}, width {np.ptp(by_mission):.3f}")
print(f"cities drawn again:   {by_city[0]:.3f} to {by_city[1]:.3f}, width {np.ptp(by_city):.3f}")

# %% [markdown]
# If you want to know about these twelve cities, take the first. If you want to know about *cities*, take the second: next
# time, twelve others will be drawn. With a city of its own for each mission the two would be the same. That
# is why the results page flies over 300 cities.

# %%
Quiz("draw_cities_again")

# %% [markdown]
# ### Where it fails
#
# A mean hides the flights that went wrong. These are the ten of the 300 missions of 13.2 in which the agent is furthest
# behind greedy:

# %%
behind = collected["any_city"] - collected["greedy"]
figure = Figure(figsize=(12, 16.5), layout="constrained")
for ax, mission in zip(figure.subplots(4, 3).flat, behind.argsort()[:10]):
    path = flights["any_city"].trajectory(int(mission))
    draw_trajectory(ax, there.environment, path)
    city = int(flights["any_city"].start.city[mission])
    ax.set_title(f"mission {mission} in city {city}: {100 * behind[mission]:+.0f} points")
    ax.set(xlabel=caption(path), ylabel="", xticks=[], yticks=[])
for ax in figure.axes[10:]:
    ax.axis("off")
figure

# %% [markdown]
# Sort them before you read on. Does a flight use most of its time (below the map) with few arrows to be seen? Then they lie on
# top of one another. Are there devices behind walls, with a long way round? And do several come from one city?
#
# About half are of one kind: between the UAV and the data lie walls or a no-fly zone, and it turns back and forth in front of
# them, as in 12.3, but with data left to collect. A possible reason: it knows the walls near it cell by cell, and those
# further off only as averages over three by three cells. One is of another kind (mission 64): it lands at once, with time
# enough for the only device. And two cities, 51 and 41, are there twice. With ten missions in a hundred cities that happens by
# chance in one of sixteen tries, so it may be that some cities are hard for it.
#
# ## 13.5 One mission in eight views
#
# Turn a map by a right angle, or reflect it in a mirror: it is another city, but the same task. East becomes
# north, and that is all. Nobody told the network. Does it know? To ask, turn the map, and turn the answer back:

# %%
from uavdh_lite.beyond.views import SYMMETRIES, turned, turned_actions

print(inspect.getsource(turned_actions))

# %% [markdown]
# Now all eight views of 500 states in mid-flight, by the network alone:

# %%
state = missions.sample_anywhere(there.environment, 500, stream(Use.EXPLORATION, 13), spare_time=5)
maps, time, allowed = there.observation(state)
one_view = there.network.network.network  # within the mask and the mean over eight views
with torch.no_grad():
    answers = torch.stack([one_view(turned(maps, *symmetry), time)[:, turned_actions(*symmetry)]
                           for symmetry in SYMMETRIES])

# %%
best = answers.where(allowed, torch.tensor(-torch.inf)).argmax(-1)
agree = (best == best[0]).all(0)
print(f"all eight views agree on the action in {agree.float().mean():.0%} of the states")

# %% [markdown]
# It has learned part of the symmetry, but not all. Where the views differ, which one is right? Often two actions are
# equally good. Elsewhere the mean of all eight Q-values is a better guess than any one of them: their errors are partly
# independent, as those of several networks would be. Such a mean is an *equivariant ensemble*. It needs no training, and
# takes eight times the computing time in flight. The shipped agent acts on it; without it, this is what it would collect in the missions of 13.2:

# %%
by_one = evaluate(there.environment, replace(there, network=MaskedNetwork(one_view)), missions, 300, seed=0).records()
for name in (CRAL, "return", "time_used"):
    gain = bootstrap_interval(records["any_city"][name] - by_one[name], groups=ahead["unseen"][1])
    print(f"{name:<28} one view {by_one[name].mean():6.3f}, eight {records['any_city'][name].mean():6.3f}, "
          f"difference {gain.mean:+.3f} ({gain.low:+.3f} to {gain.high:+.3f})")

# %% [markdown]
# Both flew the same missions with the same fading. Where two actions seem nearly equal, a single look may decide now for one
# and now for the other (12.3); the mean decides more steadily. It cannot help where all eight views are wrong in the same way.
#
# ## 13.6 Which frame carries over?
#
# Notebook 7 compared maps in one city. There, a network can learn by heart where things are, in whichever frame it sees
# them. In 2000 cities it cannot. The same ablation over many cities: the map centred on the UAV, the city in place, and
# the two resolutions of notebook 12, three seeds each, 200,000 steps.

# %%
curves = read_table("../data/runs/centring-any_city.csv.gz")
frames = {"centred": BLUE, "non_centred": VERMILION, "global_local": "black"}
figure = Figure(figsize=(6.5, 3.6), layout="constrained")
ax = figure.subplots()
for frame, colour in frames.items():
    for seed in range(3):
        run = (curves["variant"] == frame) & (curves["seed"] == seed)
        ax.plot(curves["steps"][run], curves[CRAL][run], "o-", color=colour, label=frame if seed == 0 else None)
ax.set(xlabel="environment steps", ylabel="collected and landed, validation", title="2000 cities")
ax.legend()
figure

# %% [markdown]
# And over the 300 cities that none of them has seen, by one view of the map and by the mean of all eight:

# %%
for frame in frames:
    runs = {"learned_in": "random:2000:0", "variant": frame, "flown_over": "random:300:9"}
    one, eight = (three_seeds(**runs, views=views) for views in (1, 8))
    print(f"{frame:<13}one view {' '.join(f'{s:.1%}' for s in one)}   eight {' '.join(f'{s:.1%}' for s in eight)}")

# %% [markdown]
# With the city in place, all three seeds collect about half as much. After 200,000 steps the gap is about as wide as in one city
# (notebook 7). There, an agent with the other frame caught up within two million steps. Here it is no better after 200,000 than
# after 100,000, but nobody has run it for longer.
#
# Why? Probably for this reason: in one city, a network that sees it in place can remember for each cell what to do there. In a city that it has
# never seen there is nothing to remember. It would have to find its own place on the map, and relate every wall to it,
# for each place separately. In the centred map, a wall two cells to the east is always in the same place of the input.
# Two resolutions are centred, too. By eight views their three runs are ahead of those of the whole map, by one view they
# overlap: three seeds leave that open. The mean of all eight views adds three to five points to the centred frames.
#
# ## 13.7 Learn one city by heart
#
# The shipped network is a start for any city. If you care about a single one, go on from there:
#
# ```text
# python -m uavdh_lite train --from any_city --city my_city.png
# ```
#
# The recipe `fine_tune` does the rest: the weights of `any_city` to begin with, small steps, hardly any exploring. These
# runs on Manhattan are recorded: three that begin with `any_city`, and the runs of notebook 12, which begin with
# nothing.

# %%
runs = {"fine_tune": (BLUE, "from any_city"), "quantile": (VERMILION, "from nothing")}
recorded = read_table("../data/runs/recipes-manhattan.csv.gz")

def one_run(recipe, seed):
    own = (recorded["variant"] == recipe) & (recorded["seed"] == seed)
    return {name: column[own] for name, column in recorded.items()}

curves = {(recipe, seed): one_run(recipe, seed) for recipe in runs for seed in range(3)}

# %%
figure = Figure(figsize=(8, 4), layout="constrained")
ax = figure.subplots()
for (recipe, seed), curve in curves.items():
    colour, label = runs[recipe]
    ax.plot(curve["steps"], curve[CRAL], color=colour, label=label if seed == 0 else None)
ax.set(xscale="log", xlabel="environment steps", ylabel="collected and landed, validation")
ax.legend()
figure

# %%
for recipe, (_, label) in runs.items():
    own = [curve for (of, _), curve in curves.items() if of == recipe]
    for when in (0, -1):
        print(f"{label:<14}after {own[0]['steps'][when]:>9,.0f} steps: ", *(f"{curve[CRAL][when]:.3f}" for curve in own))

# %% [markdown]
# A run that begins with `any_city` is far ahead at first: after its first validation it is where the others are after more than
# ten times as many steps. In these validations it ends below them, though, by about two points. But they look at
# one view of the map, to save time. In flight the fine-tuned agents act on all eight. Measured so, over 3000 missions
# in pairs with greedy (`docs/results/any_city.md`, on the site under Results, has the commands):
#
# | agent, by all eight views | collected and landed | points ahead of greedy | return, ahead of greedy |
# | --- | --- | --- | --- |
# | fine-tuned, three seeds | 97.8% 97.8% 97.7% | +0.3 +0.3 +0.2, each ± 0.2 | −0.07 +0.07 +0.02, each ± 0.12 |
# | `manhattan`, from nothing (one view) | 97.7% | +0.2 ± 0.2 | +0.31 ± 0.12 |
#
# So after 100,000 steps of their own, on top of the nine million before, and with eight views, they collect as much as the agent
# that was trained for Manhattan alone. They take longer for it: their return is lower. Manhattan leaves little to gain, as `any_city` is good there without any
# fine-tuning (exercise 2).
#
# ## Recap
#
# - A network that flies over another city in each mission must look at the map; one that has a single city need not.
# - *Unseen* is a claim about a source of cities. Test on cities that were not learned in, and say where they come from.
# - Missions in one city share its walls. For an interval about cities, resample whole cities.
# - Turned and mirrored maps are the same task. The mean over the eight views is an ensemble without any training more, at eight
#   times the computing in flight.
# - A general agent, once somebody has trained it, is a quick start for a city of your own: it takes minutes. On
#   Manhattan, an agent that was trained there alone for long is still done a little sooner.
#
# ## Exercises
#
# Two with their answers. More, to write yourself, with checks and hints, are in
# [`exercises/13_any_city`](exercises/13_any_city/13_any_city.ipynb).
#
# **1.** Take the unseen cities kind by kind. Where is the agent furthest behind greedy, or ahead of it?

# %%
kinds = np.array([unseen[c].name.rsplit("_", 2)[0] for c in ahead["unseen"][1]])
for kind in np.unique(kinds):
    lead, cities = (values[kinds == kind] for values in ahead["unseen"])
    print(f"{kind:<11}{len(lead):>4} missions in {len(np.unique(cities))} cities, {points(lead, cities)}")

# %% [markdown]
# Ahead in blocks. Elsewhere the intervals contain 0 or come close to it, which says little with some twenty cities of each
# kind, and four kinds to look at. The results page has a thousand missions.
#
# **2.** Fly over `manhattan` with `any_city`, next to the agent that knows no other city.

# %%
home = load_agent("manhattan")
both = {"any_city": agent.over(home.city), "manhattan": home}
records = {name: evaluate(home.environment, pilot, home.scenario, 200, seed=0).records() for name, pilot in both.items()}
for name in (CRAL, "return"):
    means = "".join(f"{pilot} {record[name].mean():.3f}, " for pilot, record in records.items())
    lead = bootstrap_interval(records["any_city"][name] - records["manhattan"][name])
    print(f"{name:<28} {means}difference {lead.mean:+.3f} ({lead.low:+.3f} to {lead.high:+.3f})")

# %% [markdown]
# Where an interval contains 0, 200 missions cannot tell the two apart. (Missions are drawn again here, as this is about one
# city.) So with eight views against one, no large loss is to be seen. By one view it would have to be measured. In training it
# cost more: `any_city` took several times as many steps.
#
# ## Further reading
#
# - Theile, Bayerlein, Caccamo, Sangiovanni-Vincentelli: *Equivariant Ensembles and Regularization for Reinforcement Learning in Map-based Path Planning*, IROS 2024: the eight views.
# - Cobbe, Klimov, Hesse, Kim, Schulman: *Quantifying Generalization in Reinforcement Learning*, ICML 2019: how many levels one must see.
# - Kirk, Zhang, Grefenstette, Rocktäschel: *A Survey of Zero-shot Generalisation in Deep Reinforcement Learning*, JAIR 2023.
