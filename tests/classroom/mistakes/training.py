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


def _whole_memory(rewards, terminals, values, n, discount):
    total = _loses_nothing(rewards, terminals, min(n, len(rewards)), discount)
    m = min(n, len(rewards))
    return total if terminals.any() else total + discount**m * values[m]


def _asks_the_last(own_power):
    def answer(rewards, terminals, values, n, discount):
        m = min(n, len(rewards))
        total, factor = 0, 1
        for k in range(m):
            total += factor * rewards[k]
            factor *= discount
            if terminals[k]:
                break
        if not terminals[m - 1]:
            total += (factor if own_power else discount**m) * values[m]
        return total

    return answer


def _loses_nothing(rewards, terminals, m, discount):
    total = 0
    for k in range(m):
        total += discount**k * rewards[k]
        if terminals[k]:
            break
    return total


def _in_order(*order, landed_least=0.9, ratio=lambda landed, ratio: ratio >= 0.8):
    """Ask in this order; the first that holds counts."""

    def answer(landed, collected, used):
        asked = {
            "crashes": landed < landed_least,
            "good": ratio(landed, collected),
            "lazy": used < 0.25,
        }
        return next((name for name in order if asked[name]), "wanders")

    return answer


RULES = ("lazy", "crashes", "good")


def _percent(landed, ratio, used):
    if used < 25:
        return "lazy"
    return "crashes" if landed < 90 else "good" if ratio >= 80 else "wanders"


def _confused(landed, ratio, used):
    if used < 0.25:
        return "wanders"
    return "crashes" if landed < 0.9 else "good" if ratio >= 0.8 else "lazy"


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
        (_power_too_low, "γ times values"),
        (_value_after_the_end, "no value is added"),
        (_never_stops, "ends the sum"),
        (_value_too_early, "the value of the next state"),
        (_loses_the_last, "with its own reward"),
        (_not_discounted, "counts γ.k times"),
        (_needs_n_steps, "IndexError.*Where fewer than n steps"),
        (_power_n, r"m = T: sum those, then add γ\^T"),
        (_whole_memory, "A terminal step after the first m"),
        (_asks_the_last(own_power=False), "no value is added"),
        (_asks_the_last(own_power=True), "no value is added"),
        (_backwards_in_place, "changes what it is given"),
    ],
    "diagnosis": [
        (_in_order("lazy", "good", "crashes"), "whatever it collects"),
        (_in_order("good", "lazy", "crashes"), "whatever it collects"),
        (_in_order("crashes", "lazy", "good"), "whatever else it does"),
        (_in_order("crashes", "good", "lazy"), "whatever else it does"),
        (_percent, "it wanders"),
        (_in_order(*RULES, landed_least=0.9 + 1e-9), "Exactly 90 %"),
        (
            lambda *shares: "lazy" if shares[2] == 0.25 else _in_order(*RULES)(*shares),
            "Exactly 25 %",
        ),
        (_in_order(*RULES, ratio=lambda landed, ratio: ratio > 0.8), "at least 80 %"),
        (_in_order(*RULES, ratio=lambda landed, ratio: landed * ratio >= 0.8), "at least 80 %"),
        (_confused, "wanders"),
        (lambda landed, ratio, used: landed >= 0.9, "expected is one of lazy, crashes"),
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
            "2,400 of 24,000 steps.*crash is -150 from the very start",
        ),
        (
            replace(LAZY, steps=2_400, crash_reward=-5.0, huber_delta=10.0),
            "crash is -150 at the end .crash_reward_end.*-40 is enough",
        ),
    ],
}
