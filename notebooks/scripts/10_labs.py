# %% [markdown]
# # 10 · Labs
#
# The library's interactive labs in one place: fly missions of your own, look into the agent's head, fly
# against it, bend the channel, train, and build a city.

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
import torch
from IPython.display import HTML, Image, display

from uavdh_lite.labs import ChannelLab, CityLab, FlyLab, MissionLab, ThinkLab, TrainingLab

torch.set_num_threads(1)  # more threads would disturb each other here

def pictures(stage=None, canvas=None):
    """A lab as it stands, for readers without a kernel: its flights, and its charts."""
    if stage is not None:
        display(HTML(stage.drawing))
    if canvas is not None:
        display(Image(canvas.picture.value))

# %%
lab = MissionLab("manhattan")
lab.other.value = "greedy"
pictures(lab.stage, lab.charts.canvas)

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Use six labs with mouse and keyboard |
# | **What you'll learn** | Little that is new: here you try what the other notebooks explain |
# | **What you'll need** | A running kernel; `pip install -e "..[notebooks]"`, which includes anywidget for what moves in the labs; notebook 0, and for each lab the notebook that is named. 12 minutes to read, 20 seconds to run; 10 minutes of exercises |
#
# ## 10.1 Mission lab (notebook 0)
#
# Drag a device or the start to another cell. Drag the right end of a bar to change how much data a device has, or how
# much time there is. A click adds a device; choose *remove* to take one away. All of it works with keys, too: Tab goes
# from one to the next, arrow keys move it. Up to three policies fly the mission side by side, with the same fading,
# and a sentence says how they differ. *Full screen* is for the lecture hall.
#
# Above: the agent and the greedy planner on one mission; then, for the agent, the data left, which device has
# each slot, and the terms of the reward. (The black line is the step that the map shows.) Both collect all and land, the agent in fewer steps. Now choose
# `manhattan_ddqn` for the first policy, the agent of the paper's method. When the last device is empty, it turns back
# and forth for a while (rings are steps spent hovering): with nothing left to collect its best actions are
# worth nearly the same, and the errors of their Q-values decide. Notebook 12 has an agent that does so less often.

# %%
lab

# %% [markdown]
# ## 10.2 Watch it think (notebooks 4 and 5)
#
# At every step, the Q-values are signs around the UAV: the larger, the better, and the best one is blue. An action that the
# safety controller would refuse has none, such as a landing outside the zone. Nor has one that the failsafe forbids (it brings
# the UAV home in time, notebook 12). The bars next to the map are the same Q-values. This agent has learned quantiles of the return (notebook 12), so
# black lines show where it expects half of the returns (thick) and 80% of them (thin). (They are wider than the luck of
# this mission: notebook 12 gives two possible reasons.) The *action gap*, above the map, is the
# distance from the best Q-value to the next.
#
# Then come the softmax policy at a temperature of your choice, the five layers of
# the map (the network sees them averaged over 3×3 cells, and the middle in full), and two more pictures. *Saliency* is the gradient of the largest Q-value times the input,
# summed over the layers, without its sign: how much that value would change, to first order, if what is in a
# cell vanished. An empty cell is always 0. *Largest Q-value* asks what the mission would be worth if the UAV
# were elsewhere, all else equal; the brighter, the more.

# %%
think = ThinkLab("manhattan")
think.stage.step = 12
think.temperature.value = 1
pictures(canvas=think.charts.canvas)

# %%
think

# %% [markdown]
# ## 10.3 Fly it yourself (notebook 3)
#
# Use the buttons, or click the map and use the arrow keys; space hovers, Enter lands. At the end all other policies fly
# your mission with the same fading, and a second table counts the missions of the session: the first try of each. *a hard one* sets one of five
# missions in which greedy leaves nearly a third of the data. Can you do better than the agent?

# %%
game = FlyLab("manhattan", seed=3)
pictures(game.stage)

# %%
game

# %% [markdown]
# ## 10.4 Channel and shadow (notebooks 1 and 2)
#
# Move the device and the UAV. The squares are the cells that the ray crosses, thick and orange where a
# building blocks it. Colours are the rate that a UAV would get when hovering over each cell, the brighter the
# more. Try: raise the altitude. The rates fall; the shadows stay. The model asks only whether the ray crosses a building
# on the map, and knows no heights (notebook 2): a building blocks it at any altitude, a low one too.

# %%
link = ChannelLab("manhattan")
link.click.value = "UAV"
link.clicked((4, 8))
pictures(canvas=link.canvas)

# %%
link

# %% [markdown]
# ## 10.5 Training live (notebook 6)
#
# Under half a minute for the village. The run is in the background: other cells go on working, and *pause training*
# stops it after the step in progress. After each validation the agent flies one mission, always the same. Click a point
# of the curves to see how it flew then. Try a crash reward of 0 from start to end, and watch *landed*: it
# stays far below 1. That is the agent of notebook 6 that crashes. *failsafe*, *quantiles* and *advantage learning* are
# the ideas of notebook 12, one by one. With *race a second agent*, a rival trains at the same time, step by step: the recipe without your changes, or what you set;
# its curves are dashed, and both agents fly the mission.

# %%
training = TrainingLab("village")
training

# %% [markdown]
# ## 10.6 City editor
#
# Paint with the mouse down: cell by cell, as rectangles, or all that is connected; mirrored, if you like. Every step
# can be undone. The editor says at once what the city still lacks. Move the mouse without its button, and you see the shadow
# that a device under it would lie in. *random city* draws one to begin with.
#
# The agent `any_city` flies in what you have
# painted, next to the greedy planner (notebook 13). With *fly at once* they fly the same mission again after each stroke:
# watch what a wall does. The line below the map says how to train it further for your city.

# %%
city = CityLab("village")
city.fly.click()
pictures(city.stage, city.canvas)

# %%
city

# %% [markdown]
# ## Recap
#
# - The labs hold no logic: all that they show comes from `uavdh_lite`, and the other notebooks say how.
#
# ## Exercises
#
# A few with their answers. More, to write yourself, with checks and hints, are in
# [`exercises/10_labs`](exercises/10_labs/10_labs.ipynb).
#
# **1.** Find a mission in which the greedy planner collects more than the agent, with the mouse or by
# searching. By searching:

# %%
from uavdh_lite.missions import Mission, environment_of
from uavdh_lite.policies import find_policy
from uavdh_lite.scenario import find_scenario

environment, scenario = environment_of("manhattan"), find_scenario("manhattan")

def collected(mission, name):
    end = mission.fly(environment, find_policy(name, environment)).end
    return float(end.collected[0] * end.landed[0])

# %%
missions = [Mission.draw(scenario, environment.city, seed) for seed in range(40)]
lead = [collected(m, "greedy") - collected(m, "manhattan") for m in missions]
worst = int(np.argmax(lead))
assert lead[worst] > 0
print(f"mission {worst}: greedy {100 * lead[worst]:.0f} points ahead; in 40 missions greedy collects more in "
      f"{sum(x > 0 for x in lead)}, the agent in {sum(x < 0 for x in lead)}; mean lead {100 * np.mean(lead):+.1f} points")

# %% [markdown]
# In most of the 40 both collect all there is, so few are left to tell them apart, and a hand-picked one tells nothing. In
# notebook 12 a thousand missions in pairs find neither ahead in data, and the agent ahead in return: it takes less time.

# %% [markdown]
# **2.** In the channel lab, Manhattan: put the device and the UAV in one cell. Up to which altitude does the
# device send at least one data unit a slot? Check your answer with the channel:

# %%
from dataclasses import replace

from uavdh_lite.channel import Channel
from uavdh_lite.labs.link import link as link_of

heights = np.arange(1, 101)
rates = [link_of(environment.city, replace(Channel(), altitude_m=float(h)), (4, 7), (4, 7)).rate for h in heights]
highest = int(heights[np.array(rates) >= 1].max())
assert rates[highest - 1] >= 1 > rates[highest]
print(f"up to {highest} m")

# %% [markdown]
# ## Further reading
#
# - `uavdh_lite/labs`: a module for each lab; `Canvas` shows how a figure is drawn once and then only changed, and
#   `Stage` how flights play in the browser without asking Python.
# - `python -m uavdh_lite app`: the same labs as a web page.
