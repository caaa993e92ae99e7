"""Wrong answers to the exercises of notebook 12, and what the message must say of each."""

import numpy as np

from uavdh_lite.environment import LAND


def moves_home(distance):
    return np.where(distance < 0, np.inf, distance)


def fits(distance, next_cell, cell, time_left):
    in_time = moves_home(distance)[next_cell[cell]] + 1 <= time_left[:, None] - 1
    in_time[:, 5] |= distance[cell] == 0
    return in_time


def no_landing_time(distance, next_cell, cell, time_left):
    in_time = moves_home(distance)[next_cell[cell]] <= time_left[:, None] - 1
    in_time[:, 5] |= distance[cell] == 0
    return in_time


def no_action_time(distance, next_cell, cell, time_left):
    in_time = moves_home(distance)[next_cell[cell]] + 1 <= time_left[:, None]
    in_time[:, 5] |= distance[cell] == 0
    return in_time


def too_careful(distance, next_cell, cell, time_left):
    in_time = moves_home(distance)[next_cell[cell]] + 1 < time_left[:, None] - 1
    in_time[:, 5] |= distance[cell] == 0
    return in_time


def minus_one_is_near(distance, next_cell, cell, time_left):
    in_time = distance[next_cell[cell]] + 1 <= time_left[:, None] - 1
    in_time[:, 5] |= distance[cell] == 0
    return in_time


def landing_like_the_others(distance, next_cell, cell, time_left):
    return moves_home(distance)[next_cell[cell]] + 1 <= time_left[:, None] - 1


def landing_everywhere(distance, next_cell, cell, time_left):
    in_time = landing_like_the_others(distance, next_cell, cell, time_left)
    in_time[:, 5] = True
    return in_time


def as_numbers(*case):
    return fits(*case).astype(int)


def in_place(distance, next_cell, cell, time_left):
    result = fits(distance, next_cell, cell, time_left)
    time_left -= 1
    return result


def loss(theta, y, kappa, level=0.5, power=0.5, sign=1, over="rows"):
    tau = (np.arange(len(theta)) + level) / len(theta)
    u = y[None, :] - theta[:, None]
    huber = np.where(abs(u) <= kappa, power * u**2, kappa * (abs(u) - kappa / 2))
    table = abs(tau[:, None] - (sign * u < 0)) * huber
    return {"rows": table.mean(1).sum(), "all": table.mean(), "none": table.sum()}[over]


def pinball(theta, y, kappa):
    tau = (np.arange(len(theta)) + 0.5) / len(theta)
    u = y[None, :] - theta[:, None]
    return (u * (tau[:, None] - (u < 0))).mean(1).sum()


def target(y, q_values, allowed, action, alpha, low=-np.inf, sign=1):
    best = np.where(allowed, q_values, low).max(1)
    return y - sign * alpha * (best - q_values[np.arange(len(y)), action])


def of_all_actions(y, q_values, allowed, action, alpha):
    return target(y, q_values, np.full_like(allowed, True), action, alpha)


def at_rest(y, q_values, allowed, action, alpha):
    return y - (y - target(y, q_values, allowed, action, 1)) / (1 - alpha)


def longest(data, discount, cost, back=2, late=1, landing=0):
    way = 1
    while discount ** (way - late) * data > cost * sum(
        discount**t for t in range(back * way + landing)
    ):
        way += 1
    return way - 1


def undiscounted_costs(data, discount, cost):
    way = 1
    while discount ** (way - 1) * data > cost * 2 * way:
        way += 1
    return way - 1


def undiscounted_data(data, discount, cost):
    way = 1
    while data > cost * sum(discount**t for t in range(2 * way)):
        way += 1
    return way - 1


def far_is_a_number(distance, next_cell, cell, time_left):
    home = np.where(distance < 0, 99, distance)
    result = home[next_cell[cell]] + 2 <= time_left[:, None]
    result[:, LAND] |= distance[cell] == 0
    return result


def calls_itself(data, discount, cost, way=0):
    price = cost * sum(discount**t for t in range(2 * way + 2))
    if data * discount**way <= price:
        return way
    return calls_itself(data, discount, cost, way + 1)


MISTAKES = {
    "failsafe_mask": [
        (no_landing_time, "Time is missing"),
        (no_action_time, "Time is missing"),
        (too_careful, "at most time_left"),
        (far_is_a_number, "no way home"),
        (minus_one_is_near, "no way home, distance −1"),
        (landing_like_the_others, "To land at once always fits"),
        (landing_everywhere, "in the zone only"),
        (as_numbers, "array of Booleans is expected"),
        (in_place, "changes what it is given"),
    ],
    "quantile_loss": [
        (lambda theta, y, kappa: loss(theta, y, kappa, level=0), "middles of N equal parts"),
        (lambda theta, y, kappa: loss(theta, y, kappa, level=1), "middles of N equal parts"),
        (lambda theta, y, kappa: loss(theta, y, kappa, power=1), "loss is u²/2"),
        (lambda theta, y, kappa: loss(theta, y, kappa, sign=-1), "the other sign"),
        (lambda theta, y, kappa: loss(theta, y, kappa, over="all"), "these means are added up"),
        (lambda theta, y, kappa: loss(theta, y, kappa, over="none"), "the mean over all samples"),
        (lambda theta, y, kappa: loss(theta, y, np.inf), "Beyond kappa Huber's loss is"),
        (pinball, "Up to kappa, whatever kappa is"),
        (lambda theta, y, kappa: loss(theta, y, 1.0), "whatever kappa is"),
        (lambda theta, y, kappa: loss(theta, y, kappa / 2), "Up to kappa"),
        (lambda theta, y, kappa: loss(theta, y, kappa) / kappa, "whatever kappa is"),
    ],
    "advantage_target": [
        (of_all_actions, "Only actions that are allowed count"),
        (lambda *case: target(*case, low=0), "take −inf"),
        (lambda *case: target(*case, low=-100), "Only actions that are allowed count"),
        (lambda *case: target(*case, sign=-1), "The target is y − alpha . gap"),
        (at_rest, "at rest"),
        (lambda y, *others: target(y, *others) * 0 + y, "expected"),
    ],
    "longest_way": [
        (lambda *case: longest(*case) + 1, "The longest way that pays is the answer"),
        (lambda *case: min(longest(*case), 100), "no way is too long"),
        (calls_itself, "RecursionError"),
        (lambda *case: longest(*case, back=1), "there and back"),
        (lambda *case: longest(*case, late=0), "the data comes in step way − 1"),
        (lambda *case: longest(*case, landing=1), "landing is free"),
        (undiscounted_costs, "the sum of cost . γ.t"),
        (undiscounted_data, "data . γ.*is more than the sum"),
    ],
}
