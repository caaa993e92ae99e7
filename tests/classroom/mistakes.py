"""Wrong answers to the exercises, and what must be said of each: a part of the rule or mistake.

`test_mutants.py` has more of them, whose rules nobody has written down.
"""

from itertools import combinations

import numpy as np
import torch
from torch import nn

from uavdh_lite.city import City
from uavdh_lite.course.checks import EXERCISES
from uavdh_lite.course.checks.notebook_06 import made
from uavdh_lite.course.checks.notebook_07 import dueling, rounds
from uavdh_lite.environment import MOVES

SOLVED = {name: one.solution for name, one in EXERCISES.items()}


def touching(start, end, cell):
    (rows, cols), (r, c) = np.subtract(end, start), np.subtract(cell, start)
    inside = all(min(a, b) <= x <= max(a, b) for a, b, x in zip(start, end, cell, strict=True))
    return inside and 2 * abs(rows * c - cols * r) <= abs(rows) + abs(cols)


def sampled(start, end, cell):
    points = np.rint(np.linspace(start, end, 200))
    return bool((points == cell).all(1).any())


def to_rate(snr_db):
    return np.log2(1 + 10 ** (snr_db / 10))


def slot(snr_db, data_left):
    """Serves somebody even if nobody has data."""
    device = int(np.where(data_left > 0, snr_db, -np.inf).argmax())
    return device, min(to_rate(snr_db[device]), data_left[device])


def wraps_round(city, cell, action):
    if action > 3:
        return SOLVED["safe_step"](city, cell, action)
    to = tuple(np.add(cell, MOVES[action]) % city.size)
    return (cell, True) if city.no_fly[to] else (to, False)


def all_n(rewards, terminals, values, n, discount):
    total = 0.0
    for k in range(n):
        total += discount**k * rewards[k]
        if terminals[k]:
            return total
    return total + discount**n * values[n]


def one_after_the_other(x, y, rate, steps):
    w = b = 0.0
    for _ in range(steps):
        w -= rate * np.mean(2 * (w * x + b - y) * x)
        b -= rate * np.mean(2 * (w * x + b - y))
    return w, b


def values_for_positions(a, b):
    everything, found = [*a, *b], []
    for chosen in combinations(everything, len(a)):
        rest = [v for v in everything if v not in chosen]
        found.append(abs(sum(chosen) / len(a) - sum(rest) / len(rest)))
    return np.mean([d >= abs(np.mean(a) - np.mean(b)) - 1e-9 for d in found])


def minus_one_is_near(distance, next_cell, cell, time_left):
    in_time = distance[next_cell[cell]] + 1 <= time_left[:, None] - 1
    in_time[:, 5] |= distance[cell] == 0
    return in_time


def only_the_loudest(rate, left):
    """The device that is the loudest at first has all four slots."""
    heard = np.where(left[:, None, None] > 0, rate, -np.inf).argmax(0)[None]
    return np.take_along_axis(np.minimum(4 * rate, left[:, None, None]), heard, 0)[0]


def sizes_of_correlation(left_db, step_m):
    off = left_db - left_db.mean()
    far = (
        k for k in range(1, len(off)) if abs(np.mean(off[k:] * off[:-k])) < np.mean(off**2) / np.e
    )
    return next(far, len(off)) * step_m


FLIGHTS = [-0.2, -0.7, 2.3, 0.8, 0.3, 0.0], [1.6, -0.2, -151.2]


def by_hand(flight, step, reward):
    """The rewards with another one in a step of flight 0 or 1."""
    given = [list(part) for part in FLIGHTS]
    given[flight][step - 1] = reward
    return lambda: given


CHANCE = np.random.default_rng(0)  # of a student's own
OUT_AND_BACK = ["east"] * 6 + ["hover"] * 3 + ["west"] * 6
ROWS = "LL.............. " * 2 + "................ " * 14
HOME = City.load("manhattan").text.split()
CORNER = [*HOME[:4], "B" * 14 + "..", *HOME[5:14], f"B{HOME[14][1:]}", f".B{HOME[15][2:]}"]
MISTAKES = {
    "flight_score": [
        (lambda c, i, landed, past=[]: past.append(c) or len(past) / 99, "earlier calls"),
        (lambda c, i, landed: max(c) / max(i) * landed, "sum of all that was collected"),
        (lambda c, i, landed: sum(c) / sum(i), "has not landed scores 0"),
    ],
    "pilots": [
        ({"A": "greedy", "B": "random", "C": "ddqn"}, "nearest device"),
        ({"A": "ddqn", "B": "greedy", "C": "random"}, "without any aim"),
        ({"A": "ddqn", "B": "random"}, "using each once"),
    ],
    "flown_by_hand": [
        (["south", "up"], "Step 2 is 'up'"),
        (["east"] + ["south"] * 4, "intervened at step 4"),
        (["east"] * 3 + ["land"], "outside the landing zone"),
        (OUT_AND_BACK, "last action must be `land`"),
        ([*OUT_AND_BACK, "land"], r"no more than 3 may be left.*units of time: 5"),
        ([*OUT_AND_BACK, *["south"] * 4, *["hover"] * 2], "flying time ran out"),
        ([*OUT_AND_BACK, "land", "south"], "make `land` the last"),
    ],
    "rate_from_snr": [
        (lambda snr_db: np.log2(1 + 10 ** (float(snr_db) / 10)), "stops with TypeError.*An array"),
        (lambda snr_db: np.log2(2 + 10 ** (snr_db / 10)), "0 dB is a ratio of 1"),
    ],
    "same_path_loss": [
        (lambda d: d ** (2.27 / 3.64), "in sight is the longer"),
        (lambda d: int(d ** (3.64 / 2.27)), "nor the result"),
    ],
    "mean_rate": [
        (lambda snr, var, n, g: to_rate(CHANCE.normal(snr, var**0.5, n)).mean(), "must come from"),
        (lambda *case: SOLVED["mean_rate"](*case), "Simulate: draw"),
        (lambda snr, var, n, g: to_rate(g.normal(snr, var**0.5, 10**5)).mean(), "scatters like"),
        (lambda snr, var, n, g: to_rate(snr + g.normal(0, var**0.5)), "Simulate `draws` slots"),
    ],
    "crosses": [
        (touching, "only touches a cell"),
        (sampled, "cut off a tiny corner"),
        (lambda start, end, cell: start <= cell <= end, "must be near the line|beyond an end"),
    ],
    "shadow_map": [(lambda b, d: b.copy(), "hides everything behind it")],
    "asymmetric_share": [
        (lambda s: (s != s.T).mean(), r"no pair with itself, \[i, j, i, j\]"),
        (lambda s: 0.5, "sight\\), with True everywhere, gives 0.5"),
        (lambda s: 2 * SOLVED["asymmetric_share"](s), "twice the share"),
    ],
    "tdma_slot": [(slot, "nobody may send")],
    "rewards_by_hand": [
        (by_hand(0, 2, 0.3), "A, step 2 gives 0.3, which is not right. The controller"),
        (by_hand(0, 2, -1.2), "A, step 2.*a UAV that hovers uploads all the same"),
        (lambda: [x for flight in FLIGHTS for x in flight], "Return two lists"),
        (by_hand(0, 4, 1.0), "A, step 4.*hovers costs the 0.2"),
        (by_hand(1, 3, -1.2), "B, step 3.*the crash"),
    ],
    "safe_step": [
        (wraps_round, "leaves the grid"),
        (lambda city, cell, action: (cell, False), "the way there, so the controller"),
    ],
    "centre": [
        (lambda *case: np.roll(SOLVED["centre"](*case), 1), "in the middle"),
        (lambda layer, uav, _: SOLVED["centre"](layer, uav, 0), "the map is `outside`"),
        (lambda *case: SOLVED["centre"](*case).astype(int), "Make a map of floats"),
    ],
    "data_layer": [
        (lambda size, uav, devices, data: np.zeros((size, size)), r"expected \(5, 5\)"),
        (lambda size, uav, devices, data: np.zeros((2 * size - 1,) * 2), "its data goes there"),
    ],
    "fitted_line": [
        (lambda x, y, rate, steps: SOLVED["fitted_line"](x, y, -rate, steps), r"\*down\*"),
        (one_after_the_other, "Compute both slopes first"),
        (lambda *c: SOLVED["fitted_line"](*c[:3], min(c[3], 1000)), r"0\.002, 2000\)"),
    ],
    "convolve": [
        (lambda *case: SOLVED["convolve"](*case).astype(int), "whatever the layer holds"),
        (lambda layer, kernel, b: SOLVED["convolve"](layer, kernel[::-1], b), "neither turned"),
    ],
    "network_weights": [(lambda *case: 2_308_854, "gives 2308854, expected")],
    "expected_target": [
        (
            lambda r, ended, g, q, beta: r + g * ~ended * (torch.softmax(q, 1) * q).sum(1),
            "temperature that is handed in",
        ),
        (
            lambda r, ended, g, q, beta: r + g * ~ended * (torch.softmax(q / beta, 0) * q).sum(1),
            "weighted by the probability",
        ),
        (lambda r, *case: SOLVED["expected_target"](case[1] * r, *case), "counts in full"),
    ],
    "epsilon_greedy": [
        (lambda q, epsilon: torch.softmax(q / epsilon, 1), "ε = 0"),
        (lambda q, epsilon: epsilon / 6 + (1 - epsilon) * (q == q.amax(1, True)), "equally|all"),
    ],
    "by_surprise": [
        (lambda errors: np.abs(errors) / np.abs(errors).sum(), "Only the order|has rank 1"),
        (lambda errors: 1 / (1 + np.argsort(np.argsort(-np.abs(errors)))), "add up to 1"),
    ],
    "mended_update": [
        (made("largest"), "action that was taken"),
        (made("end"), "where the episode ended|Where the episode ended"),
        (made("slopes"), "must be forgotten"),
        (made("never"), "in place.*only gives the name"),
        (lambda online, *rest: online(rest[2][0][:, 0]), r"stops with RuntimeError: .*`\.$"),
    ],
    "dueling_head": [
        (dueling(lambda v, a: v - a + a.mean(1, keepdim=True)), "value plus the advantages"),
        (dueling(lambda v, a: v.mean() + a - a.mean(1, keepdim=True)), "Each row has its own"),
        (nn.Identity, r"self.value must be nn.Linear\(3, 1\)"),
    ],
    "mended_round": [
        (rounds("crashed"), "by landing \\*or\\*|as `step` gave it|time is up"),
        (lambda *case: None, "Return the state"),
        (lambda environment, state, *rest: state, "appends one tuple"),
    ],
    "diagnosis": [(lambda landed, collected, used: "good", "wanders")],
    "n_step_return": [
        (lambda r, t, v, n, d: SOLVED["n_step_return"](r, t, v, min(n, 20), d), "30, 0.95"),
        (all_n, r"IndexError.*in line \d+, `.*`\. Where fewer than n steps are stored, m = T"),
    ],
    "steps_to": [
        (lambda s, v, t: SOLVED["steps_to"](s, v - 1e-12, t), "that equals the threshold"),
        (
            lambda s, v, t: next((s[k] for k in range(len(s)) if min(v[k : k + 3]) >= t), None),
            "from your validation to the last",
        ),
    ],
    "lead": [(lambda a, b: (np.mean(a - b), *SOLVED["lead"](a, b)[::2]), "1.96 standard errors")],
    "permutation_p": [(values_for_positions, "deal out positions")],
    "missions_needed": [
        (lambda share, crashes: int(share * 3.8416 / (1 - share)) + 1, "n − crashes of n missions"),
        (lambda share, crashes: 381, "smallest n at which"),
    ],
    "defeat": [
        ("L .\n. .", "it must have 16"),
        (ROWS.strip().replace(" ", "\n"), "at most 16 may"),
        ("\n".join(CORNER), r"no way to the landing zone from \[15, 0\]"),  # 16 are changed
        ("L..", "not a valid city"),
        ("...", "at least one character must be L"),
    ],
    "prioritised": [
        (lambda e, floor: (np.full(len(e), 1 / len(e)), np.ones(len(e))), "in proportion"),
    ],
    "old_share": [(lambda capacity, before, after: 0.5, "all items are there")],
    "failsafe_mask": [(minus_one_is_near, "no way home, distance −1")],
    "data_of_a_step": [
        (lambda rate, left: 4 * rate.max(0), "until it has nothing left"),
        (only_the_loudest, "leaves the next slots to the others"),
    ],
    "view": [
        (lambda m, a, k, f: (np.rot90(m, k, (1, 2)), (a - k) % 4), "Hover and land|swaps left"),
        (lambda m, a, k, f: (m.tolist(), a), "as value 1, but an array of numbers, not a list, is"),
    ],
    "shadow_reach": [
        (lambda left, step: step, "mean product of all pairs"),
        (sizes_of_correlation, "A ρ below 0 is"),
    ],
    "corrected": [
        (lambda line, heard, w: np.average(heard, weights=w), "Add to the line|stops with"),
    ],
    "clustered_half_width": [
        (lambda *case: SOLVED["clustered_half_width"](*case[:2], 1.96), "that by t / N"),
    ],
}
