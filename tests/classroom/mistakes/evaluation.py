"""Wrong answers to the exercises of notebook 8, and what the message must say of each."""

import math
from dataclasses import replace

import numpy as np

from uavdh_lite.beyond.genie import Genie
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.evaluation import wilson_interval
from uavdh_lite.planners import Greedy


def normal_interval(successes, trials):
    p = successes / trials
    half = 1.96 * math.sqrt(p * (1 - p) / trials)
    return p - half, p + half


def clipped_interval(successes, trials):
    low, high = normal_interval(successes, trials)
    return max(low, 0), min(high, 1)


def one_error(successes, trials):
    p, n = successes / trials, trials
    half = math.sqrt(p * (1 - p) / n + 1 / (4 * n * n))
    return (p + 1 / (2 * n) - half) / (1 + 1 / n), (p + 1 / (2 * n) + half) / (1 + 1 / n)


def no_denominator(successes, trials):
    p, n = successes / trials, trials
    half = 1.96 * math.sqrt(p * (1 - p) / n + 1.96**2 / (4 * n * n))
    return p + 1.96**2 / (2 * n) - half, p + 1.96**2 / (2 * n) + half


def on_a_grid(successes, trials):
    p = successes / trials
    inside = [
        q / 1000
        for q in range(1001)
        if abs(p - q / 1000) <= 1.96 * math.sqrt(q / 1000 * (1 - q / 1000) / trials)
    ]
    return min(inside), max(inside)


def add_variances(a, b):
    half = 1.96 * math.sqrt(np.var(a, ddof=1) / len(a) + np.var(b, ddof=1) / len(b))
    return np.mean(a) - np.mean(b), np.mean(a) - np.mean(b) - half, np.mean(a) - np.mean(b) + half


def no_standard_error(a, b):
    d = a - b
    return d.mean(), d.mean() - 1.96 * np.std(d, ddof=1), d.mean() + 1.96 * np.std(d, ddof=1)


def by_n(a, b):
    d = a - b
    half = 1.96 * d.std() / len(d) ** 0.5
    return d.mean(), d.mean() - half, d.mean() + half


def mean_in_the_middle(a, b):
    mean, low, high = lead_of(a - b)
    return low, mean, high


def lead_of(d, n=None):
    half = 1.96 * d.std(ddof=1) / math.sqrt(n or len(d))
    return d.mean(), d.mean() - half, d.mean() + half


def middle_of_differences(a, b):
    return np.mean(a - b), np.percentile(a - b, 2.5), np.percentile(a - b, 97.5)


def in_place(a, b):
    a -= b
    half = 1.96 * a.std(ddof=1) / len(a) ** 0.5
    return a.mean(), a.mean() - half, a.mean() + half


def half_width(a, b):
    d = a - b
    return d.mean(), 1.96 * d.std(ddof=1) / len(d) ** 0.5


def skipping(least):
    def without_leftovers(environment, state):
        worth = np.where(state.data_left < least, 0, state.data_left)
        return Greedy(environment).act(replace(state, data_left=worth))

    return without_leftovers


def sometimes_idle(environment, state):
    """Greedy, but it waits for a step in some missions."""
    action = Greedy(environment).act(state)
    return np.where((state.time_left == 34) & (state.device_cells[:, 0] == 100), 4, action)


def never_home(environment, state):
    """Greedy's moves, without its way home."""
    action = Greedy(environment).act(state)
    return np.where(action == 5, 4, action)


def straight_ahead(environment, state):
    """To the first device as the crow flies, whatever is in between; home by greedy."""
    row, col = np.divmod(state.device_cells[:, 0].astype(int), 16)
    r, c = np.divmod(state.uav_cell.astype(int), 16)
    action = np.select([r > row, r < row, c > col, c < col], [0, 2, 3, 1], 4)
    home = environment.city.landing_distance.ravel()[state.uav_cell]
    return np.where(state.time_left > home + 3, action, Greedy(environment).act(state))


def in_between(environment, state):
    return Greedy(environment).act(state) + 0.0


def first_only(environment, state):
    return int(Greedy(environment).act(state)[0])


def counted_from_one(environment, state):
    return Greedy(environment).act(state) + 1


def hidden_genie(environment, state):
    return Genie(environment).act(state)


def hidden_agent(environment, state):
    return load_agent("manhattan").act(state)


def broken(environment, state):
    return state.position


def straight_home(environment, state):
    return np.full(len(state), 5)


MISTAKES = {
    "wilson": [
        (lambda k, n: np.round(wilson_interval(np.arange(n) < k)[1:], 4), "Do not round"),
        (normal_interval, "normal approximation"),
        (clipped_interval, "normal approximation"),
        (one_error, r"with z = 1\.96"),
        (on_a_grid, "At both ends of the interval"),
        (no_denominator, r"1 \+ z²/n is missing"),
        (lambda k, n: (0.9, 1.0), "expected"),
    ],
    "episodes_needed": [
        (lambda s, h: math.ceil(1.96 * s / h), "square is missing"),
        (lambda s, h: math.ceil((s / h) ** 2), "1.96 standard errors"),
        (lambda s, h: int((1.96 * s / h) ** 2), "round that up"),
        (lambda s, h: math.ceil((1.96 * s / (h / 2)) ** 2), "neither all of it nor half of a side"),
        (lambda s, h: int((1.96 * s / h) ** 2) + 1, "add nothing"),
        (lambda s, h: math.ceil((1.645 * s / h) ** 2), "1.96 standard errors"),
        (lambda s, h: np.ceil((1.96 * s / h) ** 2), "an int is expected"),
    ],
    "lead": [
        (add_variances, "unpaired"),
        (no_standard_error, "standard error"),
        (by_n, "ddof=1"),
        (lambda a, b: lead_of(b - a), "sign"),
        (lambda a, b: lead_of(abs(a - b)), "size of each difference"),
        (lambda a, b: lead_of(a - b, len(a) - 1), r"d\.std\(ddof=1\) / sqrt\(n\)"),
        (mean_in_the_middle, "in the order"),
        (middle_of_differences, "1.96 standard errors"),
        (in_place, "changes what it is given"),
        (half_width, "not mean and half width"),
    ],
    "policy": [
        (lambda environment, state: Greedy(environment).act(state), "same flights as greedy's"),
        (never_home, "crashed in 300 of 300"),
        (straight_ahead, "safety controller refused"),
        (straight_home, "It is behind greedy: `ways"),
        (skipping(2), "less than the 0.4"),
        (skipping(4), "less than the 0.4"),
        (skipping(0.5), "ahead of greedy, but the interval holds 0"),
        (sometimes_idle, "behind greedy, but the interval holds 0"),
        (in_between, "whole numbers"),
        (first_only, r"one action for each .* the shape \(\)"),
        (counted_from_one, "no action 6"),
        (hidden_genie, "Genie is not allowed"),
        (hidden_agent, "Agent is not allowed"),
        (broken, "^broken stops with AttributeError"),
    ],
}
