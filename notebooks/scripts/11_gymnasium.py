# %% [markdown]
# # 11 · Gymnasium
#
# The same problem for everybody else's agents: a [Gymnasium](https://gymnasium.farama.org) environment, alone or
# many at once, and two agents of [Stable-Baselines3](https://stable-baselines3.readthedocs.io) next to ours.

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
import gymnasium
import numpy as np
from matplotlib.figure import Figure

import torch

import uavdh_lite.bridges.gymnasium
from uavdh_lite.storage import read_table

torch.set_num_threads(1)  # more threads would disturb each other here

# %%
METRIC = "collected_and_landed"
KINDS = {"ddqn": ("our DDQN", "#0072B2", "-"), "dqn": ("SB3 DQN", "#D55E00", "-"),
         "ppo": ("SB3 PPO, greedy", "#009E73", "-"), "ppo_drawn": ("SB3 PPO, drawn", "#009E73", ":")}
recorded = read_table("../data/runs/sb3-village.csv.gz")

def one_run(name, seed):
    own = (recorded["variant"] == name) & (recorded["seed"] == seed)
    return recorded["steps"][own] / 1000, recorded[METRIC][own]

# %%
figure = Figure(figsize=(6.5, 3.6), layout="constrained")
ax = figure.subplots()
for name, (title, colour, style) in KINDS.items():
    for seed in range(3):
        ax.plot(*one_run(name, seed), "o" + style, ms=3, color=colour, label=title if seed == 0 else None)
ax.set(xlabel="thousand environment steps", ylabel="collected and landed", title="village, three seeds each")
ax.legend(loc="upper left", bbox_to_anchor=(1, 1))
figure

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Fly the environment through its Gymnasium interface, step many at once, and train agents of another library on it |
# | **What you'll learn** | What a single and a vectorised environment promise, what happens where an episode ends, and how to compare agents fairly |
# | **What you'll need** | Notebooks 3 and 6; `pip install -e "..[sb3]"`. 20 minutes to read, 45 seconds to run; 10 minutes of exercises |
#
# ## 11.1 One episode
#
# `reset` begins an episode and gives the first observation, `step` takes an action. The observation is a dict: the
# maps of notebook 4, scaled to 0 to 1, and the flying time that is left.

# %%
env = gymnasium.make("uavdh_lite/DataHarvesting-v0", scenario="village", render_mode="rgb_array")
observation, info = env.reset(seed=9)
print({name: array.shape for name, array in observation.items()})
print({name: value.item() for name, value in info.items()})

# %%
total = 0.0
for action in (1, 1, 1, 1, 1, 4, 4):
    observation, reward, terminated, truncated, info = env.step(action)
    total += reward
print(f"return so far {total:.2f}, collected {info['collected']:.0%}, terminated {terminated}")

# %%
from IPython.display import display
from PIL import Image

display(Image.fromarray(env.render()).resize((420, 448)))

# %% [markdown]
# `terminated` is true when the UAV lands or its flying time is over. `truncated` never is: it means that an episode
# was cut off from outside, and an agent should then go on counting with the value of the state. Here the
# flying time is part of the task and of the observation, and running out of it is a real end, with a real penalty.
#
# The help has all of it: `help(uavdh_lite.bridges.gymnasium.DataHarvesting)`.
#
# ## 11.2 Many at once
#
# Simulators written for one episode are run in many processes. This one steps all episodes in the same arrays
# (notebook 3), and its vectorised environment is only a view of that:

# %%
import time

def steps_per_second(envs, seconds=0.3):
    envs.reset(seed=0)
    generator, steps, started = np.random.default_rng(0), 0, time.perf_counter()
    while time.perf_counter() - started < seconds:
        envs.step(generator.integers(0, 5, envs.num_envs))
        steps += envs.num_envs
    return steps / (time.perf_counter() - started)

# %%
many = {mode: gymnasium.make_vec("uavdh_lite/DataHarvesting-v0", 64, vectorization_mode=mode, scenario="village")
        for mode in ("sync", "vector_entry_point")}
turns = [{mode: steps_per_second(envs) for mode, envs in many.items()} for _ in range(5)]
speed = {mode: max(turn[mode] for turn in turns) for mode in many}  # the best of five: other work disturbs both
print(f"64 episodes: {speed['vector_entry_point'] / speed['sync']:.0f} times the steps of a loop over 64 environments")
assert speed["vector_entry_point"] > 3 * speed["sync"]

# %% [markdown]
# Where an episode ends, a vectorised environment has to begin another. Ours does it in the same step: the
# observation that you get is the new episode's first, and the old one's last is in the infos:

# %%
envs = gymnasium.make_vec("uavdh_lite/DataHarvesting-v0", 3, vectorization_mode="vector_entry_point", scenario="village")
envs.reset(seed=0)
observation, reward, terminated, truncated, infos = envs.step(np.array([5, 4, 4]))  # the first one lands
print("terminated     ", terminated)
print("time left now  ", infos["time_left"], "of new and old episodes")
print("final_obs      ", [None if one is None else sorted(one) for one in infos["final_obs"]])

# %% [markdown]
# Gymnasium's other way begins the new episode in the *next* step, which then ignores its action. Whoever puts
# that step into a replay memory teaches the agent a transition that never happened.
#
# ## 11.3 Agents of another library
#
# Stable-Baselines3 takes the environment as it is. Two of its algorithms are in the figure at the top. *DQN* is the
# Q-learning of notebook 5 with a target network, without the double targets. *PPO* has no Q-values: a network gives each
# action's probability, and flights that went better than expected make their actions more probable, a little at a time.
# A short run of PPO, to see it work. A crash costs 20 here and a step 0.1, since in runs this short −150 can make an agent
# lazy (notebook 6). The figures below count the paper's rewards. PPO learns to *draw* its actions, and here it does so in the test,
# too (`predict` has an argument `deterministic`):

# %%
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

from uavdh_lite.environment import Rewards

options = {"scenario": "village", "rewards": Rewards(crash=-20.0, movement=-0.1)}
train_envs = make_vec_env(uavdh_lite.bridges.gymnasium.ID, n_envs=8, seed=0, env_kwargs=options)
model = PPO("MultiInputPolicy", train_envs, gamma=0.95, learning_rate=5e-4, n_steps=128, batch_size=256,
            seed=0, device="cpu")

# %%
from uavdh_lite.city import City
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import evaluate
from uavdh_lite.scenario import find_scenario

environment, scenario = Environment(City.load("village")), find_scenario("village")
policy = uavdh_lite.bridges.gymnasium.as_policy(
    gymnasium.make(uavdh_lite.bridges.gymnasium.ID, **options), lambda batch: model.predict(batch)[0]
)

# %%
def means():
    records = evaluate(environment, policy, scenario, 200, seed=0).records()
    return {name: records[name].mean() for name in ("return", METRIC, "landed", "time_used")}

before = means()
model.learn(4_000)
after = means()
for name in before:
    print(f"{name:<28} before {before[name]:7.2f}, after 4,000 steps {after[name]:7.2f}")

# %% [markdown]
# Does a higher return mean that it collects more? Read all four lines before you answer. A return near 0 with hardly any
# time used is that of an agent that lands at once (notebook 6). So few steps show that it runs, not that it learned the
# task.
#
# `as_policy` makes any function of observations a policy of this library, so that the same evaluation, on the
# same missions, judges all.
#
# ## 11.4 Side by side
#
# The figure at the top is recorded, by `python benchmarks/sb3.py`: 48,000 environment steps each, the same reward and
# discount, the same 200 missions. All fly greedily; PPO also with drawn actions. Here are the last of them, and what they
# cost:

# %%
for name, (title, *_) in KINDS.items():
    own = (recorded["steps"] == recorded["steps"].max()) & (recorded["variant"] == name)
    for metric in (METRIC, "landed"):
        print(f"{title:<16}{metric:<28}", *(f"{share:.3f}" for share in recorded[metric][own]))
    print(f"{title:<16}training took {recorded['seconds'][own].mean():.0f} s")

# %% [markdown]
# With equal steps ours is ahead in all seeds, in less than half of the training time. DQN is on its way: it collects most
# of the data in the missions in which it lands, and crashes in the rest. PPO depends on how it is flown. With drawn actions it
# lands in many missions and brings home something. Flown greedily, it takes the most probable action again and again, even one that is
# hardly more probable than the next, and stays in the air until the time is over. So a table with greedy flights alone
# would have said that PPO learns nothing. (These are the last points of curves that jump. The figure says more.)
#
# What the comparison does *not* show: that one algorithm is better. Ours is tuned for this task, by many runs in
# this very village (notebook 6). Theirs have a few settings that were chosen once, and a network that flattens the map. PPO also
# learns from each step only a few times and then forgets it, so 48,000 steps are few for it. To compare algorithms one would
# have to give all the same care, and the same network.

# %% [markdown]
# ## Recap
#
# - `gymnasium.make` for one episode, `make_vec` with `vector_entry_point` for many; same simulator, same rules.
# - A landing and a crash *terminate*; nothing truncates. No step of the vectorised environment is a dummy.
# - `as_policy` brings agents of other libraries into this one's evaluation.
#
# ## Exercises
#
# **1.** Wrap the environment so that the reward is the data alone. What does an agent then no longer care about?

# %%
class DataOnly(gymnasium.Wrapper):
    def step(self, action):
        before = self.unwrapped.state.data_left.sum()
        observation, _, terminated, truncated, info = self.env.step(action)
        reward = float(before - self.unwrapped.state.data_left.sum())
        return observation, reward, terminated, truncated, info

# %%
wrapped = DataOnly(gymnasium.make(uavdh_lite.bridges.gymnasium.ID, scenario="village"))
wrapped.reset(seed=9)
rewards = [wrapped.step(action)[1] for action in (1, 1, 1, 1, 1, 4, 4)]
assert min(rewards) >= 0 and sum(rewards) > 0
print(np.round(rewards, 2))

# %% [markdown]
# About landing, and nearly always about time. Only the discount still makes it hurry, to get the data sooner. When the last device is empty,
# flying home, hovering and crashing are worth the same to it: nothing.
#
# **2.** How much of the observation can change within an episode? Count the entries of `map` that differ between
# the start of an episode and the time after ten steps of hovering.

# %%
first, _ = env.reset(seed=9)
for _ in range(10):
    last, *_ = env.step(4)
changed = {layer: int((first["map"][layer] != last["map"][layer]).sum()) for layer in range(5)}
assert changed[0] == changed[1] == changed[2] == 0
print(changed)

# %% [markdown]
# Only the two layers of data, at the cells of devices that were served. (And `time`, the other input, which falls in each
# step.) The frame moves when the UAV does, and then nearly everything changes.
#
# ## Further reading
#
# - Towers et al.: *Gymnasium: A Standard Interface for Reinforcement Learning Environments*, 2024.
# - Raffin et al.: *Stable-Baselines3: Reliable Reinforcement Learning Implementations*, JMLR 2021.
# - Schulman et al.: *Proximal Policy Optimization Algorithms*, 2017.
