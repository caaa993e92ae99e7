# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # A better discount
#
# *A worked project, the hasty one. Every line of it runs. What would you ask its authors? Our own
# answer comes at the end.*
#
# We wanted to improve the agent. The discount of 0.95 seemed low to us, so we took 0.99, and
# because learning looked slow, we doubled the learning rate, too.

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
from dataclasses import replace

import numpy as np
import torch
from matplotlib.figure import Figure

from uavdh_lite.evaluation import bootstrap_interval, evaluate
from uavdh_lite.planners import Greedy
from uavdh_lite.recipe import find_recipe
from uavdh_lite.scenario import find_scenario
from uavdh_lite.training import Trainer

torch.set_num_threads(1)  # quickest for small networks

scenario = find_scenario("village")
normal = replace(find_recipe("small"), steps=16_000)
better = replace(normal, discount=0.99, learning_rate=4e-3)

# %%
def train(recipe, seed):
    trainer = Trainer(scenario, recipe, seed)
    while not trainer.finished:
        trainer.step()
    return trainer.agent

# %%
for name, recipe in (("normal", normal), ("better", better)):
    agent = train(recipe, seed=0)
    flown = evaluate(agent.environment, agent, scenario, 100, seed=0).metrics()
    print(name, f"collected {flown['collected'].mean:.0%}")

# %% [markdown]
# This shows what our change is worth.
#
# ---
#
# ## What is wrong with it
#
# - **Two things were changed.** Whatever came out, nobody can say which of the two caused it.
# - **One seed.** A gap between two runs is also a gap between two lucky numbers (8.3).
# - **No prediction.** Any increase would have been taken for a success.
# - **The wrong score.** *Collected* also counts data that went down with the UAV. How many flights
#   landed?
# - **No interval, and only 100 missions.** By luck alone, two shares, each measured over 100 missions, can differ by several percentage
#   points.
# - **No baseline.** Is either of the agents as good as greedy?
# - **The words.** “Better” is the name of the recipe, not its result.
#
# According to the table in the [template](project.ipynb), this project earns none of the ten points.
# Nevertheless, the idea is a good one. How would you test it?
