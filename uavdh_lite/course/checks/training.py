"""Exercises of notebook 6, training."""

import itertools
from dataclasses import fields, replace

import numpy as np
import torch

from uavdh_lite.course.checks.exercise import exercise, expect, solution
from uavdh_lite.course.checks.table import edit
from uavdh_lite.course.checks.trial import expect_none, first_true
from uavdh_lite.course.checks.values import one_of
from uavdh_lite.evaluation import evaluate
from uavdh_lite.experiments.runs import keep_freed_memory
from uavdh_lite.recipe import SMALL, Recipe
from uavdh_lite.scenario import find_scenario
from uavdh_lite.streams import Use, stream
from uavdh_lite.training import Trainer


def _draw_n_step(ax, solved):
    steps, rewards, values = range(1, 13), np.full(10, -0.1), np.full(11, 5.0)
    rewards[5] = 3
    for end, label in ((10, "under way throughout"), (7, "the 8th step is terminal")):
        targets = [solved(rewards, np.arange(10) == end, values, n, 0.95) for n in steps]
        ax.plot(steps, targets, "o-", label=label, alpha=0.7)
    ax.set(xlabel="n, steps", ylabel="n-step return, data units")
    ax.set_title("10 steps stored, the 6th earns 3, the others −0.1;\nγ = 0.95, all values 5")


def _stored(length, ends, n, discount):
    """Rewards, terminals and values of a stored sequence, and the other two arguments."""
    generator = stream(Use.EXERCISE, 10 * length + len(ends))
    rewards, values = generator.normal(1, 1, length), generator.normal(8, 3, length + 1)
    kind, digits = (int, 0) if length == 3 else (float, 2)
    rewards, values = (array.round(digits).astype(kind) for array in (rewards, values))
    return rewards, np.isin(np.arange(length), ends), values, n, discount


@solution(
    "6.1 · The n-step return (2 points, 15 minutes)",
    "Write it down for n = 1 and n = 2, then for n = 2 with the first step terminal. After m "
    "rewards, with which power of γ and of which state does the value come?",
    "Keep a factor, at first 1. For each step k: add factor · rewards[k], multiply the factor "
    "by γ, and return if terminals[k]. After m = min(n, T) steps add factor · values[m].",
    figure=_draw_n_step,
    rules={
        "With n = 1 it is rewards[0] plus γ times values[1], the value of the next state.": [
            *((3, (), 1, 0.5), (2, (), 1, 0.9), (2, (), 1, 1.0), (2, (), 1, 0.0)),
        ],
        "Reward k counts γ^k times. After m rewards γ^m values[m] comes, of state m.": [
            *((3, (), 2, 0.5), (3, (), 2, 1), (6, (), 2, 0.9), (6, (), 3, 0.8), (6, (), 5, 0.3)),
        ],
        "A terminal step among the m ends the sum with its own reward, and no value is added.": [
            *((6, (2, 4), 3, 0.8), (6, (2, 4), 4, 0.95), (6, (2, 4), 5, 1.0)),
            *((5, (0,), 1, 0.7), (5, (0,), 3, 0.95), (4, (0, 1, 2, 3), 2, 0.6)),
        ],
        "A terminal step after the first m belongs to the future: the value of state m counts.": [
            *((6, (2, 4), 1, 0.8), (6, (2, 4), 2, 0.8), (6, (5,), 4, 0.9), (6, (5,), 5, 0.9)),
        ],
        "Where fewer than n steps are stored, m = T: sum those, then add γ^T values[T].": [
            *((6, (), 7, 0.9), (1, (), 3, 0.4), (3, (), 3, 0.5), (3, (), 1000, 0.5)),
        ],
        "Where fewer than n steps are stored, a terminal step still ends the sum.": [
            *((6, (2, 4), 9, 0.8), (4, (3,), 5, 0.9), (1, (0,), 2, 0.9)),
        ],
    },
    errors={"IndexError": "There are T rewards and T + 1 values."},
    made=_stored,
)
def n_step_return(rewards, terminals, values, n, discount):
    """`n_step(rewards, terminals, values, n, discount)`: the target of the first state."""
    m, total = min(n, len(rewards)), 0.0
    for k in range(m):
        total += discount**k * rewards[k]
        if terminals[k]:
            return total
    return total + discount**m * values[m]


NAMES = ("lazy", "crashes", "good", "wanders")


# Of data/runs/deviations-manhattan, by variant, seed and thousand steps: landed, collected, time
RUNS = {
    "all-0-300": (0.987, 0.895, 0.738),
    "without_return_steps-0-100": (0.527, 0.409, 0.812),
    "without_crash_reward-1-300": (1.000, 0.100, 0.153),
    "without_crash_reward-0-100": (0.000, 0.237, 1.000),
    "without_exploring_starts-0-100": (0.873, 0.616, 0.645),
    "without_layer_norm-0-300": (1.000, 0.170, 0.318),
    "without_learning_rate-0-300": (0.943, 0.478, 0.727),
    "without_crash_reward-0-300": (0.998, 0.000, 0.022),
    "without_return_steps-0-300": (0.992, 0.858, 0.880),
}


def _draw_diagnosis(ax, solved):
    for landed, collected, used in RUNS.values():
        name = solved(landed, collected, used)
        ax.plot(used, collected, "o", color=f"C{NAMES.index(name)}")
        ax.annotate(f"{name}, {landed:.0%}", (used, collected), fontsize="small")
    ax.set(xlabel="flying time used, share", xlim=(-0.03, 1.2), ylabel="collection ratio")
    ax.set_title("nine validations, with the share that landed")


# The recorded runs, and all that is at a limit, a little off it, or far from it
LIMITS = (0.9, 0.8, 0.25)  # of landed, collected, time_used
NEAR = [(0, 0.5, 0.89, limit - 1e-6, limit, limit + 1e-6, 1.0, 1) for limit in LIMITS]


@solution(
    "6.2 · What is wrong with this agent? (1 point, 5 minutes)",
    "The four terms are defined one after the other, each among those that are left. So which "
    "number must be looked at first?",
    "First `if time_used < 0.25`, then `if landed < 0.9`, then collected: from 0.8 on "
    'it is "good", else it "wanders".',
    figure=_draw_diagnosis,
    rules={
        "It uses 25 % of its time or more, so it is not lazy, and 90 % or more land, so it "
        "does not crash: if it collects less than 80 % (0.8), it wanders.": (lambda *shares: True),
        "It uses 25 % of its time or more, so it is not lazy, and 90 % or more land, so it "
        "does not crash: if it collects at least 80 %, it is good.": (
            lambda landed, collected, used: collected >= 0.8
        ),
        "It uses 25 % of its time or more, so it is not lazy: if fewer than 90 % of its "
        "missions land, it crashes, whatever it collects.": (
            lambda landed, collected, used: landed < 0.9
        ),
        "If it uses less than 25 % of the flying time, it is lazy, whatever else it does.": (
            lambda landed, collected, used: used < 0.25
        ),
    },
    among=[*RUNS.values(), *itertools.product(*NEAR)],
    mistakes={
        "Exactly 90 % landed is enough: *fewer* is a crash.": edit("landed <", "landed <="),
        "Exactly 25 % of the time is not lazy: *less* than 25 % is.": edit("used <", "used <="),
    },
    read=one_of(*NAMES),
)
def diagnosis(landed, collected, time_used):
    """`diagnose(landed, collected, time_used)`: one of `NAMES`."""
    lazy, crashes, good = time_used < 0.25, landed < 0.9, collected >= 0.8
    return "lazy" if lazy else "crashes" if crashes else "good" if good else "wanders"


LAZY = replace(
    SMALL,
    name="lazy",
    steps=20_000,
    crash_reward=-150.0,
    crash_reward_end=-150.0,
    huber_delta=None,
    temperature=0.1,
    exploring_starts=0.0,
)
MOST_STEPS, LEAST_PENALTY, LEAST_SCORE = 24_000, -40.0, 0.35
MAY_CHANGE = (
    *("steps", "crash_reward", "crash_reward_end", "crash_reward_growth", "huber_delta"),
    *("temperature", "temperature_end", "temperature_decay", "exploring_starts"),
)
MENDED = replace(
    LAZY,
    name="mended",
    steps=MOST_STEPS,
    crash_reward=-2.0,
    crash_reward_end=LEAST_PENALTY,
    huber_delta=10.0,
    temperature=1.0,
)


RECIPE = {  # what is said of a recipe, and when
    f"{{steps:,}} steps: at most {MOST_STEPS:,} may be.": lambda of: of.steps > MOST_STEPS,
    f"crash_reward_end is {{crash_reward_end:g}}, but a crash must cost {-LEAST_PENALTY:g} at "
    f"least at the end: {LEAST_PENALTY:g} or lower. (crash_reward, at the start, is free.)": (
        lambda of: of.crash_reward_end > LEAST_PENALTY
    ),
    "crash_reward is {crash_reward:g}: a crash is rewarded at the start. At most 0.": (
        lambda of: of.crash_reward > 0
    ),
    "That is the lazy recipe, unchanged: its agent lands at once and collects nothing.": (
        lambda of: {**vars(of), "name": "lazy"} == vars(LAZY)
    ),
}
CAUSES = {  # what is said of a recipe whose agent collects too little, and when
    "Its reward for a crash is {crash_reward:g} from the very start, far more than there is to "
    "collect: begin with a small price and let it grow.": lambda of: of.crash_reward < -20,
    "Its reward for a crash is {crash_reward_end:g} at the end (crash_reward_end), and that "
    f"drowns all else: {LEAST_PENALTY:g} is enough.": (
        lambda of: of.crash_reward_end < 1.5 * LEAST_PENALTY
    ),
    "Let the price of a crash grow sooner (crash_reward_growth), or the temperature fall lower, so "
    "that it learns to come home.": lambda of: of.landed < 0.9,
    "It sees too little of what there is to collect, or its price of a crash grows too fast: let "
    "it explore more at first, and use all the steps.": lambda of: True,
}


def _draw_schedules(ax):
    for recipe, style in ((LAZY, "--"), (MENDED, "-")):
        steps = np.linspace(0, recipe.steps, 101)
        crash = [recipe.rewards_at(step).crash for step in steps]
        warm = recipe.temperature
        label = f"{recipe.name}: β = {warm:g} at first, Huber loss: {recipe.huber_delta or 'none'}"
        ax.plot(steps / 1000, crash, style, label=label)
    ax.set(xlabel="thousand environment steps", ylabel="reward for a crash")
    ax.set_title(f"how fast it changes: crash_reward_growth = {MENDED.crash_reward_growth:g}")


@exercise(
    "6.3 · Mend a lazy agent (4 points, 30 minutes)",
    "It lands at once since it learned to fear the crash before it saw what there is to "
    "collect. Must a crash cost as much at the beginning of the training as at its end?",
    "Begin with a crash_reward of a few points, comparable with the data that a step brings, "
    "and let it grow to crash_reward_end. Explore more while the Q-values are still wrong "
    "(temperature about 1), limit the pull of large errors (huber_delta), use all the steps.",
    figure=_draw_schedules,
    takes=(
        lambda answer: isinstance(answer, Recipe),
        "A Recipe is expected, from replace(lazy, …); you give {given}.",
    ),
    seconds=3600,
)
def mended_recipe(answer) -> None:
    """A recipe that differs from `LAZY` in `MAY_CHANGE` and trains a useful agent."""
    for field in fields(Recipe):
        kept, given = getattr(LAZY, field.name), getattr(answer, field.name)
        expect(
            kept == given or field.name in (*MAY_CHANGE, "name"),
            f"{field.name} is {given}, but must stay {kept}: start from replace(lazy, …). Only "
            f"these may be changed: {', '.join(MAY_CHANGE)}.",
        )
    expect_none(RECIPE, **vars(answer))
    metrics = _train(answer)
    names = "landed", "collected", "time_used", "collected_and_landed"
    landed, collected, used, score = (metrics[name] for name in names)
    said = (
        f"Landed {landed:.0%}, collected {collected:.0%}, flying time used {used:.0%}; collected "
        f"and landed {score:.1%}"
    )
    print(f"{said}.")
    cause = first_true(CAUSES, landed=landed, **vars(answer))
    expect(
        score >= LEAST_SCORE,
        f"{said}, and {LEAST_SCORE:.0%} are asked for, after {answer.steps:,} of {MOST_STEPS:,} "
        f"steps. {cause}",
    )


def _train(recipe: Recipe, seed: int = 0) -> dict[str, float]:
    """Train an agent for the village; its means over 500 test missions."""
    print(
        f"Training for {recipe.steps:,} steps, about half a minute on a quiet machine …", flush=True
    )
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # the network is small
    keep_freed_memory()
    try:
        trainer = Trainer(find_scenario("village"), recipe, seed)
        while not trainer.finished:
            trainer.step()
        flights = evaluate(trainer.environment, trainer.agent, trainer.scenario, 500, seed=0)
    finally:
        torch.set_num_threads(threads)
    return {name: float(values.mean()) for name, values in flights.records().items()}
