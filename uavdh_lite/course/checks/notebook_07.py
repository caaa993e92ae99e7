"""Exercises of notebook 7, training."""

import itertools
from dataclasses import fields, replace

import numpy as np
import torch

from uavdh_lite.city import load_cities
from uavdh_lite.course.checks.exercise import CheckFailed, exercise
from uavdh_lite.course.checks.learning import Watched
from uavdh_lite.course.checks.values import show
from uavdh_lite.course.given import MAY_CHANGE, REWARDS, ROUNDS, RUNS
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import FunctionPolicy, Policy, evaluate
from uavdh_lite.planners import Random
from uavdh_lite.recipe import SMALL, Recipe
from uavdh_lite.scenario import find_scenario
from uavdh_lite.streams import Use, stream
from uavdh_lite.training import Trainer

LEAST_LEAD = 0.2  # over random, in collected and landed
NOT_CHECKED = (
    "Not checked: whether y is the double target, whether the target network follows with τ = "
    "0.02, and whether each minibatch has the newest step. Compare your loop, line by line, with "
    "the page “The algorithm on one page”."
)
SOON = 2.0  # the best Q-value of a start, if nothing but the next reward counts: it is below 1


class Flown(Environment):
    """An environment that does not fly on when all missions have ended."""

    def step(self, state, action, generator):
        if state.ended.all():
            raise CheckFailed(
                f"All {len(state)} missions have ended, and their UAVs are flown on. Where one has "
                "ended, begin another: `states.with_rows(places, new_states)`."
            )
        return super().step(state, action, generator)


def flown(policy: Policy) -> tuple[dict[str, float], str]:
    """The means of a policy over 500 test missions of the village, and what is said of them."""
    environment, scenario = Environment(load_cities("village")), find_scenario("village")
    records = evaluate(environment, policy, scenario, 500, seed=0).records()
    means = {name: float(values.mean()) for name, values in records.items()}
    names = ("landed", "collected", "time_used", "collected_and_landed")
    return means, ", ".join(f"{name} {means[name]:.1%}" for name in names).replace("_", " ")


def wrong_training(train) -> str:
    """What is wrong with an agent that an answer trains, after 500 test missions of the village."""
    scenario, environment = find_scenario("village"), Flown(load_cities("village"))
    print(f"Training for {ROUNDS:,} rounds, about half a minute …", flush=True)
    torch.manual_seed(0)
    torch.set_num_threads(1)  # quicker, as the network is small
    with Watched() as watched:
        q_values = train(environment, scenario, REWARDS, ROUNDS, stream(Use.EXERCISE, 0))
    if not callable(q_values):
        return f"Return a function q_values(state). You returned {show(q_values)}."
    if not watched.updates:
        return "Nothing was trained: `loss.backward()` was never called."
    q = q_values(scenario.sample(environment, 100, stream(Use.EXERCISE, 1)))
    if np.shape(q) != (100, 6):
        return f"For 100 states q_values gives {show(q)}, not a tensor of shape (100, 6)."
    if not torch.isfinite(q).all():
        return "The Q-values are not finite: they have exploded. Is y made by the target network?"
    best = float(q.detach().amax(1).mean())
    hover, land = q.detach().mean(0)[-2:].tolist()  # of the starts, where landing is allowed
    endless = best > SOON and land > 0.75 * hover

    own, said = flown(FunctionPolicy(lambda s: q_values(s).detach().argmax(1).numpy()))
    chance = flown(Random(0))[0]["collected_and_landed"]
    print(f"{said}; random: {chance:.0%}")
    enough = own["collected_and_landed"] >= chance + LEAST_LEAD
    if enough and not endless and watched.lags is not False:
        print(NOT_CHECKED)
        return ""
    why = "Your agent collects but does not come home: is y the reward alone where it crashed?"
    if own["landed"] > 0.8:
        why = "Your agent lands but hardly collects: is β large at first, is every action tried?"
    if best < SOON:
        why = (
            f"To your agent the best first action is worth {best:.1f}, hardly more than the next "
            "reward. Does the target network follow the online one in each round, and is γ 0.95?"
        )
    if endless:
        why = (
            f"At the start of a mission `land` is worth {land:.1f} to your agent, as if the flight "
            f"went on (`hover`: {hover:.1f}). Where an episode ended, y must be the reward alone."
        )
    if watched.lags is False:
        why = (
            "The weights that learn also make y: no network that lags behind was ever asked. "
            "Begin with `target = copy.deepcopy(online)`, let it follow slowly, and let it judge."
        )
    if watched.ends is False:
        why = (
            "In no minibatch did an episode end. Store the next state as `step` gave it, before a "
            "new mission takes its place."
        )
    if enough:
        return f"{said}. That is enough, but the learning is wrong. {why}"
    asked = f"Random flying has {chance:.0%} collected and landed, and at least 20 points more"
    return f"{said}. {asked}, {chance + LEAST_LEAD:.0%}, are required. {why}"


@exercise("7.1 · Your own DQN flies the village (6 points, 70 minutes)", also=wrong_training)
def village_dqn(environment, scenario, rewards, rounds, generator):
    """`train(environment, scenario, rewards, rounds, generator)`: a function of states, Q-values.

    Here the library's own trainer; the exercise asks for one made of the answers of notebook 6.
    """
    recipe = replace(SMALL, steps=rounds * SMALL.environments)
    trainer = Trainer(scenario, recipe, 0, environment.city)
    while not trainer.finished:
        trainer.step()
    return trainer.agent.q_values


# Of data/runs/deviations-manhattan, by variant, seed and thousand steps: landed, collected, time
# The recorded runs, and all that is at a limit, a little off it, or far from it
NEAR = [(0, 0.5, 0.89, limit - 1e-6, limit, limit + 1e-6, 1.0, 1) for limit in (0.9, 0.8, 0.25)]
AGENTS = [*RUNS.values(), *itertools.product(*NEAR)]
SENTENCES = {
    "wanders": "It uses at least 25 % of its time, and at least 90 % of its missions land, so it "
    "is neither lazy nor crashing: if it collects less than 80 %, 0.8, it wanders.",
    "good": "It uses at least 25 % of its time, and at least 90 % of its missions land: if it "
    "collects at least 80 %, it is good.",
    "crashes": "It uses at least 25 % of its time, so it is not lazy: if fewer than 90 % of its "
    "missions land, it crashes, whatever it collects.",
    "lazy": "If it uses less than 25 % of the flying time, it is lazy, whatever else it does.",
}


def judged(landed, collected, used):
    if used < 0.25:
        return "lazy"
    return "crashes" if landed < 0.9 else "good" if collected >= 0.8 else "wanders"


@exercise(
    "7.2 · What is wrong with this agent? (1 point, 5 minutes)",
    rules={
        sentence: [one for one in AGENTS if judged(*one) == name]
        for name, sentence in SENTENCES.items()
    },
    mistakes={
        "Exactly 90 % landed is enough: only with *fewer* does it crash.": (
            lambda landed, collected, used: judged(landed - 1e-9, collected, used)
        ),
        "Exactly 25 % of the time is not lazy: *less* than 25 % is.": (
            lambda landed, collected, used: judged(landed, collected, used - 1e-9)
        ),
    },
)
def diagnosis(landed, collected, time_used):
    """`diagnose(landed, collected, time_used)`: one of `SENTENCES`."""
    return judged(landed, collected, time_used)


def stored(length, ends, n, discount):
    """Rewards, terminals and values of a stored sequence, and the other two arguments."""
    generator = stream(Use.EXERCISE, 10 * length + len(ends))
    rewards, values = generator.normal(1, 1, length), generator.normal(8, 3, length + 1)
    kind, digits = (int, 0) if length == 3 else (float, 2)
    rewards, values = (array.round(digits).astype(kind) for array in (rewards, values))
    return rewards, np.isin(np.arange(length), ends), values, n, discount


@exercise(
    "7.3 · The n-step return (2 points, 15 minutes)",
    rules={
        "With n = 1 the target is rewards[0] plus γ times values[1], the value of the next "
        "state.": [
            (3, (), 1, 0.5), (2, (), 1, 0.9), (2, (), 1, 1.0), (2, (), 1, 0.0),
        ],
        "Reward k is multiplied by γ^k. After m rewards comes γ^m values[m], with the value of "
        "state m.": [
            (3, (), 2, 0.5), (3, (), 2, 1), (6, (), 2, 0.9), (6, (), 3, 0.8), (6, (), 5, 0.3),
            (40, (), 30, 0.95),
        ],
        "A terminal step among the first m ends the sum with its own reward, and no value is "
        "added.": [
            (6, (2, 4), 3, 0.8), (6, (2, 4), 4, 0.95), (6, (2, 4), 5, 1.0),
            (5, (0,), 1, 0.7), (5, (0,), 3, 0.95), (4, (0, 1, 2, 3), 2, 0.6),
        ],
        "A terminal step after the first m belongs to the future: the value of state m counts.": [
            (6, (2, 4), 1, 0.8), (6, (2, 4), 2, 0.8), (6, (5,), 4, 0.9), (6, (5,), 5, 0.9),
        ],
        "Where fewer than n steps are stored, m = T: sum their rewards, then add γ^T values[T].": [
            (6, (), 7, 0.9), (1, (), 3, 0.4), (3, (), 3, 0.5), (3, (), 1000, 0.5),
        ],
        "Where fewer than n steps are stored, a terminal step still ends the sum.": [
            (6, (2, 4), 9, 0.8), (4, (3,), 5, 0.9), (1, (0,), 2, 0.9),
        ],
    },
    case=stored,
)
def n_step_return(rewards, terminals, values, n, discount):
    """`n_step(rewards, terminals, values, n, discount)`: the target of the first state."""
    m, total = min(n, len(rewards)), 0.0
    for k in range(m):
        total += float(discount**k * rewards[k])
        if terminals[k]:
            return total
    return total + float(discount**m * values[m])


LAZY = replace(
    SMALL,
    name="lazy",
    steps=20_000,
    crash_reward=-150.0,
    crash_reward_end=-150.0,
    huber_delta=None,
    temperature=0.1,
    temperature_end=0.1,
    temperature_decay=0.25,
    exploring_starts=0.0,
)
MOST_STEPS, LEAST_PENALTY, LEAST_SCORE = 24_000, -40.0, 0.35
def wrong_recipe(recipe: Recipe) -> str:
    """What is wrong with a recipe; it trains an agent and flies 500 test missions."""
    changed = {f.name for f in fields(Recipe) if getattr(recipe, f.name) != getattr(LAZY, f.name)}
    if fixed := sorted(changed - {*MAY_CHANGE, "name"}):
        return f"{fixed[0]} must stay {getattr(LAZY, fixed[0])}: start from replace(lazy, …)."
    if recipe.steps > MOST_STEPS:
        return f"{recipe.steps:,} steps: at most {MOST_STEPS:,} are allowed."
    if recipe.crash_reward_end > LEAST_PENALTY or recipe.crash_reward > 0:
        return f"A crash must cost at least {-LEAST_PENALTY:g} at the end, and never be rewarded."
    if not changed - {"name"}:
        return "That is the lazy recipe, unchanged: its agent lands far too early."
    print(f"Training for {recipe.steps:,} steps, about half a minute …", flush=True)
    torch.set_num_threads(1)  # quicker, as the network is small
    trainer = Trainer(find_scenario("village"), recipe, 0)
    while not trainer.finished:
        trainer.step()
    means, said = flown(trainer.agent)
    print(said)
    if means["collected_and_landed"] >= LEAST_SCORE:
        return ""
    why = "Let it explore more at first, use all the steps, and raise the cost of a crash early."
    if recipe.crash_reward < -20:
        why = "A crash costs too much from the start: begin with a small cost and let it grow."
    elif recipe.crash_reward_end < 1.5 * LEAST_PENALTY:
        why = f"At the end the cost of a crash drowns out all else: {LEAST_PENALTY:g} is enough."
    return f"{said}; at least {LEAST_SCORE:.0%} collected and landed are required. {why}"


@exercise("7.4 · Mend a lazy agent (4 points, 20 minutes)", takes=Recipe, also=wrong_recipe)
def mended_recipe():
    """A recipe that differs from `LAZY` in `MAY_CHANGE` and trains a useful agent."""
