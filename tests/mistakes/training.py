"""Wrong answers to the exercises of notebook 6, and what the message must say of each."""

from dataclasses import replace

from uavdh_lite.recipe import SMALL


def _power_too_low(rewards, terminals, values, n, discount):
    total = 0
    for k in range(min(n, len(rewards))):
        total += discount**k * rewards[k]
        if terminals[k]:
            return total
    return total + discount**k * values[k + 1]


def _value_after_the_end(rewards, terminals, values, n, discount):
    total = 0
    for k in range(min(n, len(rewards))):
        total += discount**k * rewards[k]
        if terminals[k]:
            break
    return total + discount ** (k + 1) * values[k + 1]


def _never_stops(rewards, terminals, values, n, discount):
    m = min(n, len(rewards))
    return sum(discount**k * rewards[k] for k in range(m)) + discount**m * values[m]


def _value_too_early(rewards, terminals, values, n, discount):
    total = 0
    for k in range(min(n, len(rewards))):
        total += discount**k * rewards[k]
        if terminals[k]:
            return total
    return total + discount ** (k + 1) * values[k]


def _loses_the_last(rewards, terminals, values, n, discount):
    total = 0
    for k in range(min(n, len(rewards))):
        if terminals[k]:
            return total
        total += discount**k * rewards[k]
    return total + discount ** (k + 1) * values[k + 1]


def _not_discounted(rewards, terminals, values, n, discount):
    total = 0
    for k in range(min(n, len(rewards))):
        total += rewards[k]
        if terminals[k]:
            return total
    return total + discount ** (k + 1) * values[k + 1]


def _needs_n_steps(rewards, terminals, values, n, discount):
    total = 0
    for k in range(n):
        total += discount**k * rewards[k]
        if terminals[k]:
            return total
    return total + discount**n * values[n]


def _power_n(rewards, terminals, values, n, discount):
    total = 0
    for k in range(min(n, len(rewards))):
        total += discount**k * rewards[k]
        if terminals[k]:
            return total
    return total + discount**n * values[k + 1]


def _backwards_in_place(rewards, terminals, values, n, discount):
    m = min(n, len(rewards))
    for k in reversed(range(m)):
        values[k] = rewards[k] + discount * values[k + 1] * (not terminals[k])
    return values[0]


def _good_first(landed, ratio, used):
    if ratio >= 0.8:
        return "good"
    if landed < 0.9:
        return "crashes"
    return "lazy" if used < 0.25 else "wanders"


def _lazy_first(landed, ratio, used):
    if used < 0.25:
        return "lazy"
    if landed < 0.9:
        return "crashes"
    return "good" if ratio >= 0.8 else "wanders"


def _lazy_before_good(landed, ratio, used):
    if landed < 0.9:
        return "crashes"
    if used < 0.25:
        return "lazy"
    return "good" if ratio >= 0.8 else "wanders"


def _percent(landed, ratio, used):
    if landed < 90:
        return "crashes"
    return "good" if ratio >= 80 else "lazy" if used < 25 else "wanders"


def _inclusive(landed, ratio, used):
    if landed <= 0.9:
        return "crashes"
    return "good" if ratio >= 0.8 else "lazy" if used < 0.25 else "wanders"


def _product(landed, ratio, used):
    if landed < 0.9:
        return "crashes"
    return "good" if landed * ratio >= 0.8 else "lazy" if used < 0.25 else "wanders"


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

MISTAKES = {
    "n_step_return": [
        (_power_too_low, "one too low"),
        (_value_after_the_end, "added after a terminal step"),
        (_never_stops, "goes on after a terminal step"),
        (_value_too_early, "state before the last step"),
        (_loses_the_last, "terminal step is lost"),
        (_not_discounted, "not discounted"),
        (_needs_n_steps, "IndexError where fewer than n"),
        (_power_n, "that of the steps that there are"),
        (_backwards_in_place, "changes the arrays"),
    ],
    "diagnosis": [
        (_good_first, "collects much but crashes is not good"),
        (_lazy_first, "ask for the time first"),
        (_lazy_before_good, "good, not lazy"),
        (_percent, "not percentages"),
        (_inclusive, "Exactly 90 %"),
        (_product, "not its product"),
        (
            lambda landed, ratio, used: (
                "crashes"
                if landed < 0.9
                else "good"
                if ratio >= 0.8
                else "wanders"
                if used < 0.25
                else "lazy"
            ),
            "confused",
        ),
        (lambda landed, ratio, used: landed >= 0.9, "expected one of crashes, good"),
    ],
    "mended_recipe": [
        (LAZY, "unchanged"),
        (replace(LAZY, steps=48_000, crash_reward=-5.0), "at most 24,000"),
        (replace(LAZY, crash_reward=-5.0, crash_reward_end=-20.0), "crash_reward_end is -20"),
        (replace(LAZY, crash_reward=-2.0, movement_reward=0.0), "movement_reward is 0"),
        (replace(SMALL, steps=24_000), "crash_reward_end is -20"),
        ({"crash_reward": -2.0}, "A Recipe is expected"),
        (
            replace(LAZY, steps=2_400, huber_delta=10.0),
            "costs 150 from the very start.*2,400 steps only",
        ),
    ],
}
