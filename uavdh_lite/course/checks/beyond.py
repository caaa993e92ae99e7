"""Exercises of notebook 12, beyond the paper."""

import numpy as np

from uavdh_lite.city import City
from uavdh_lite.course.checks.exercise import solution
from uavdh_lite.course.checks.table import edit
from uavdh_lite.course.checks.values import truths, whole
from uavdh_lite.environment import ACTIONS, LAND, Environment
from uavdh_lite.plotting import BLUE, VERMILION
from uavdh_lite.streams import Use, stream

SMALL = "L . . B\n. N B .\n. . . N\n. . . ."  # no way home from cell 7


def _situation(name, cell, time_left):
    """Arguments of `fits` for cells of a city; for a number, so many at random, with about that."""
    city = City.load(name) if name == "village" else City.from_text("small", name)
    distance = city.landing_distance.ravel()
    if isinstance(cell, int):
        generator = stream(Use.EXERCISE, cell)
        cell = generator.choice(np.flatnonzero(~city.no_fly.ravel()), cell)
        time_left = np.maximum(distance[cell] + generator.integers(-1, time_left, len(cell)), 1)
    return distance, Environment(city).next_cell[0], np.array(cell), np.array(time_left)


def _leads_to(distance, next_cell, cell, time_left, place):
    k, action = place
    there, left = distance[next_cell[cell[k], action]], time_left[k]
    hovers = " (a landing is one in the zone only; here it stays in the air)"
    what = ACTIONS[action] + (hovers if action == LAND and there else "")
    return f"Here {what} leads to a cell with distance {there}; time_left is {left}."


def _draw_failsafe(ax, solved):
    city = City.load("village")
    cells, distance = np.flatnonzero(~city.no_fly.ravel()), city.landing_distance.ravel()
    counts = np.full(city.size**2, np.nan)
    five = np.full(len(cells), 5)
    counts[cells] = solved(distance, Environment(city).next_cell[0], cells, five).sum(1)
    image = ax.imshow(counts.reshape(city.size, city.size), cmap="viridis")
    ax.figure.colorbar(image, label="actions that fit")
    ax.set(title="village, five units of time left", xlabel="column", ylabel="row")


@solution(
    "12.1 · The failsafe's mask (2 points, 15 minutes)",
    "Look at the cell that each action leads to. How many units of time are left when the UAV "
    "is there, and how many does it take from there to be on the ground?",
    "distance[next_cell[cell]] is (B, 6): moves home after each action. One unit more for "
    "landing must fit into time_left − 1. Then two special cases: −1, and landing at once.",
    figure=_draw_failsafe,
    rules={
        "An action fits if the units for itself, for the way home after it and for the landing are "
        "at most time_left.": [
            *((SMALL, [9], [time_left]) for time_left in (3, 4, 5, 6, 9)),
            *((SMALL, [8], [3]), (SMALL, [4, 14, 2], [4, 6, 3])),
        ],
        "To land at once always fits, but in the zone only: elsewhere it is no landing, and costs "
        "a unit as hovering does.": [
            *((SMALL, [cell], [time_left]) for cell in (0, 1) for time_left in (1, 2, 3)),
            (SMALL, [0, 1, 0], [1, 1, 2]),
        ],
        "Where there is no way home, distance −1, nothing fits: no number stands for that.": [
            *((SMALL, [7], [3]), (SMALL, [7, 0], [10**6, 10**6])),
        ],
        "It must hold for all UAVs of a batch, each with its own time, in any city.": [
            *((SMALL, 30, 4), ("village", 1, 4), ("village", 6, 4), ("village", 40, 4)),
        ],
    },
    made=_situation,
    mistakes={
        "Time is missing: action and landing take one unit each, besides the way home.": (
            *(edit("+ 1 <=", "<="), edit("] - 1", "]"), edit("+ 1 <=", "<=", "] - 1", "]")),
        ),
        "Ask for the distance from the cell that the action leads to, not from the cell where the "
        "UAV is.": edit("home[next_cell[cell]]", "0 * next_cell[cell] + home[cell][:, None]"),
    },
    read=truths,
    why=_leads_to,
    errors=dict.fromkeys(
        ("too many indices", "broadcast"),
        "time_left is (B,), the distances after the actions are (B, 6): time_left[:, None] is a "
        "column, (B, 1).",
    ),
)
def failsafe_mask(distance, next_cell, cell, time_left):
    """`fits(distance, next_cell, cell, time_left)`: the actions that leave time to land, (B, 6)."""
    home = np.where(distance < 0, np.inf, distance)
    fits = home[next_cell[cell]] + 1 <= time_left[:, None] - 1
    fits[:, LAND] |= distance[cell] == 0
    return fits


DRAWN = (1, 5), (2, 3), (4, 4), (32, 1), (8, 50)  # so many quantiles and samples


def _values(given, spread):
    if isinstance(given, list):
        return np.array(given)
    return stream(Use.EXERCISE, 100 * spread + given).normal(0, spread, given).round(2)


def _draw_quantile_loss(ax, solved):
    y = np.linspace(-4, 4, 161)
    for k, colour in ((0, BLUE), (4, VERMILION)):
        theta = [np.where(np.arange(5) == k, 0.0, value) for value in y]
        losses = [solved(*one, 1.0) for one in zip(theta, y[:, None], strict=True)]
        ax.plot(y, losses, color=colour, label=f"θ_{k + 1} = 0 of five, the others exact")
    ax.set(xlabel="the only sample y", ylabel="loss, κ = 1")


@solution(
    "12.2 · The quantile Huber loss (3 points, 15 minutes)",
    "Make a table of all errors first: N rows, one for each quantile, and a column for each "
    "sample. Weight and Huber's loss are tables of the same shape.",
    "u = y[None, :] − theta[:, None]. The weight of row i is its level where u ≥ 0, and one "
    "minus the level where u < 0. Average each row, then add the rows up.",
    figure=_draw_quantile_loss,
    rules={
        "Up to kappa, whatever kappa is, Huber's loss is u²/2, weighted with the level τ where u "
        "is not below 0, and with 1 − τ where it is. The levels are the middles of N equal parts, "
        "(i − 1/2)/N for i from 1 to N, so that of a single quantile is 1/2.": [
            *(([0.0], [0.25], 1.0), ([0.0], [-0.9], 1.0), ([0.0], [1.5], 3.0)),
        ],
        "Beyond kappa Huber's loss is kappa · (|u| − kappa/2), whatever kappa is.": [
            *(([0.0], [2.0], 1.0), ([0.0], [-3.0], 0.5), ([0.0], [9.0], 3.0)),
        ],
        "The weight is τ where u = y − θ is not below 0, and 1 − τ where it is. Each quantile has "
        "the mean over all samples; these means are added up.": [
            *(([0.0, 4.0], [y], 1.0) for y in (0.5, 3.5, 6.0, -2.0)),
            *((*counts, kappa) for counts in DRAWN for kappa in (0.5, 1.0, 3.0)),
        ],
    },
    made=lambda theta, y, kappa: (_values(theta, 2), _values(y, 4), kappa),
    mistakes={
        "The error is u = y − θ: yours has the other sign, so that weights for too high and too "
        "low are swapped.": edit("u < 0", "u > 0"),
    },
)
def quantile_loss(theta, y, kappa):
    """`quantile_loss(theta, y, kappa)`: a number, for N quantiles and any number of samples."""
    levels = (np.arange(len(theta)) + 0.5) / len(theta)
    u = y[None, :] - theta[:, None]
    huber = np.where(abs(u) <= kappa, u**2 / 2, kappa * (abs(u) - kappa / 2))
    return (abs(levels[:, None] - (u < 0)) * huber).mean(1).sum()


ALPHAS = (0.0, 0.3, 0.8)


def _minibatch(count, shift, share, alpha):
    """Arguments of `target` with Q-values near `shift`, this share of the other actions allowed."""
    generator = stream(Use.EXERCISE, int(10 * alpha) + count)
    q_values = generator.normal(shift, 3, (count, 6)).round(2)
    y, action = generator.normal(shift, 3, count).round(2), generator.integers(0, 6, count)
    allowed = generator.random((count, 6)) < share
    allowed[np.arange(count), action] = True
    return y, q_values, allowed, action, alpha


def _draw_advantage_target(ax, solved):
    q_values = np.tile([2.0, 1.6, 1.9, 0.8, 1.7, 0.2], (6, 1))
    places = np.arange(6)
    for offset, alpha, colour in ((-0.2, 0.0, "0.7"), (0.2, 0.5, BLUE)):
        targets = solved(q_values[0], q_values, q_values > 0, places, alpha)
        ax.bar(places + offset, targets, 0.4, color=colour, label=f"α = {alpha}")
    ax.set(xlabel="action taken", ylabel="target, if y is the Q-value")


@solution(
    "12.3 · The target of advantage learning (2 points, 10 minutes)",
    "Two Q-values of each row are needed: of the best action that is allowed, and of the "
    "action that was taken. What is the gap of the best action itself?",
    "np.where(allowed, q_values, −np.inf).max(axis=1) is the best one's. For the other, index "
    "q_values with np.arange(B) and action. Then y − alpha · gap.",
    figure=_draw_advantage_target,
    rules={
        "The target is y − alpha · gap. The gap is the largest Q-value of the row minus that of "
        "the action taken.": [
            *((count, 0.0, 2.0, alpha) for count in (1, 3) for alpha in ALPHAS),
        ],
        "Only actions that are allowed count for the maximum, whatever the Q-values' signs: no "
        "number is small enough for the others, take −inf.": [
            *((count, -20.0, 0.6, alpha) for count in (1, 6) for alpha in ALPHAS),
            *((count, shift, 0.6, 0.3) for count, shift in ((40, 10.0), (6, -1e6), (1, -1e6))),
        ],
    },
    made=_minibatch,
    mistakes={
        "Dividing by 1 − alpha is what comes out in the end, at rest. The target of one update "
        "takes alpha times the gap.": edit(
            "alpha * (best - taken)", "(best - taken) / (1 - alpha)"
        ),
    },
)
def advantage_target(y, q_values, allowed, action, alpha):
    """`target(y, q_values, allowed, action, alpha)`: the targets with wider gaps, (B,)."""
    taken = q_values[np.arange(len(action)), action]
    best = np.where(allowed, q_values, -np.inf).max(1)
    return y - alpha * (best - taken)


def _draw_longest_way(ax, solved):
    discounts = np.linspace(0.9, 0.99, 46)
    for data, colour in ((5.0, BLUE), (20.0, VERMILION)):
        ways = [solved(data, float(discount), 0.1) for discount in discounts]
        ax.step(discounts, ways, color=colour, label=f"{data:g} data units")
    ax.set(xlabel="discount γ", ylabel="longest way that pays, moves")


@solution(
    "12.4 · How far does a discount reach? (2 points, 12 minutes)",
    "Write down the rewards of all steps for a way of 2: four of them. Which are negative, in "
    "which step does the data come, and what does each count, seen from the start?",
    "For a way of w: minus cost · γ^t for t = 0 … 2w − 1, plus data · γ^(w − 1). It falls with "
    "w. Raise w in a loop as long as the next way still pays.",
    figure=_draw_longest_way,
    rules={
        "Without a discount, γ = 1, it pays as long as data > 2 · way · cost: there and back, and "
        "landing is free. The longest way that pays is the answer.": [
            *((5.0, 1.0, 0.11), (20.0, 1.0, 0.23), (6.0, 1.0, 1.0)),
        ],
        "It pays if data · γ^(way − 1) is more than the sum of cost · γ^t, t < 2 · way: the first "
        "move is step 0, so the data comes in step way − 1.": [
            *((1.5, 0.95, 0.11), (4.0, 0.95, 0.23), (7.0, 0.97, 0.23), (0.5, 0.8, 0.11)),
        ],
        "If not even a way of 1, two moves, pays, the answer is 0. Else search on as long as it "
        "pays: no way is too long.": [(0.05, 0.8, 0.11), (5.0, 1.0, 0.002)],
    },
    read=whole,
)
def longest_way(data, discount, cost):
    """`longest_way(data, discount, cost)`: the most moves to a device that pay, an int."""
    way = 1
    while discount ** (way - 1) * data > cost * (discount ** np.arange(2 * way)).sum():
        way += 1
    return way - 1
