"""Wrong answers to the exercises of notebook 3, and what the message must say of each."""

import numpy as np

from uavdh_lite.environment import MOVES


def to_rate(snr_db):
    return np.log2(1 + 10 ** (snr_db / 10))


def slot(snr_db, data_left, empty=-np.inf, limit=min, serves_nobody=False):
    if not serves_nobody and not (data_left > 0).any():
        return -1, 0.0
    device = int(np.where(data_left > 0, snr_db, empty).argmax())
    return device, limit(to_rate(snr_db[device]), data_left[device])


def any_device(snr_db, data_left):
    if not data_left.any():
        return -1, 0.0
    device = int(snr_db.argmax())
    return device, min(to_rate(snr_db[device]), data_left[device])


def filtered(snr_db, data_left):
    if not data_left.any():
        return -1, 0.0
    snr_db, data_left = snr_db[data_left > 0], data_left[data_left > 0]
    device = int(snr_db.argmax())
    return device, min(to_rate(snr_db[device]), data_left[device])


def in_place(snr_db, data_left):
    device, amount = slot(snr_db, data_left)
    if device >= 0:
        data_left[device] -= amount
    return device, amount


def nobody(snr_db, data_left):
    device, amount = int(snr_db.argmax()), 0.0
    if data_left[device] == 0:
        return -1, amount
    return device, min(to_rate(snr_db[device]), data_left[device])


def filtered_index(snr_db, data_left):
    if not data_left.any():
        return -1, 0.0
    device = int(snr_db[data_left > 0].argmax())
    return device, min(to_rate(snr_db[device]), data_left[device])


def largest_upload(snr_db, data_left):
    if not data_left.any():
        return -1, 0.0
    uploads = np.minimum(to_rate(snr_db), data_left)
    return int(uploads.argmax()), uploads.max()


def most_data(snr_db, data_left):
    device = int(data_left.argmax())
    return (device, min(to_rate(snr_db[device]), data_left.max())) if data_left.any() else (-1, 0)


FLIGHT_A = [-0.2, -0.7, 2.3, 0.8, 0.3, 0.0]
FLIGHT_B = [1.6, -0.2, -151.2]


def flights(a=None, b=None):
    """The right rewards but for a step (from 1) of flight A or B and what is said instead."""
    first, second = list(FLIGHT_A), list(FLIGHT_B)
    for flight, change in ((first, a), (second, b)):
        if change:
            flight[change[0] - 1] = change[1]
    return lambda: (first, second)


def reward(axis=1, landing_free=True, instead=False, chain=False, sign=1):
    def answer(uploaded, intervened, landed, crashed):
        steps = np.where(landed if landing_free else False, 0, -0.2)
        if instead:
            steps = np.where(intervened, 0, steps)
        events = np.where(intervened, -1, 0) + np.where(crashed, -150, 0)
        if chain:
            events = np.where(crashed, -150, np.where(intervened, -1, 0))
        return uploaded.sum(axis) + sign * (steps + events)

    return answer


def with_if(uploaded, intervened, landed, crashed):
    total = uploaded.sum(1)
    if not landed:
        total -= 0.2
    return total - intervened - 150 * crashed


def controller(wraps=False, buildings=False, clips=False, land=True, flag=True, stay=True):
    def answer(city, cell, action):
        if action == 4:
            return cell, False
        if action == 5:
            return cell, bool(land and not city.landing[cell])
        row, col = cell[0] + MOVES[action][0], cell[1] + MOVES[action][1]
        outside = not (0 <= row < city.size and 0 <= col < city.size)
        if outside and clips:
            return cell, False
        if outside and wraps:
            row, col = row % city.size, col % city.size
        elif outside:
            return cell, flag
        if city.no_fly[row, col] or (buildings and city.buildings[row, col]):
            return (cell if stay else (row, col)), flag
        return (row, col), False

    return answer


def transposed(no_fly=False, landing=False):
    def answer(city, cell, action):
        if action >= 4:
            return cell, action == 5 and not city.landing[cell[::-1] if landing else cell]
        row, col = cell[0] + MOVES[action][0], cell[1] + MOVES[action][1]
        if not (0 <= row < city.size and 0 <= col < city.size):
            return cell, True
        blocked = city.no_fly[(col, row) if no_fly else (row, col)]
        return (cell if blocked else (row, col)), blocked

    return answer


def tilde(city, cell, action):
    if action == 5:
        return cell, ~int(city.landing[cell])
    return controller()(city, cell, action)


def unchecked(city, cell, action):
    row, col = cell[0] + MOVES[action][0], cell[1] + MOVES[action][1]
    if action == 5:
        return cell, not city.landing[cell]
    return (cell, True) if city.no_fly[row, col] else ((row, col), False)


def south_up(city, cell, action):
    return controller()(city, cell, {0: 2, 2: 0}.get(action, action))


def stays_means_intervened(city, cell, action):
    after, _ = controller()(city, cell, action)
    return after, after == cell


MISTAKES = {
    "tdma_slot": [
        (any_device, "without data is not served"),
        (lambda snr, left: slot(snr, left, limit=lambda r, d: r), "no more than is left"),
        (lambda snr, left: slot(snr, left, serves_nobody=True), "nobody may send"),
        (filtered, "that device's index in the full snr_db"),
        (filtered_index, "that device's index in the full snr_db"),
        (nobody, "highest SNR among them wins"),
        (largest_upload, "highest SNR is served"),
        (most_data, "highest SNR is served"),
        (lambda snr, left: slot(snr, left, empty=0.0), "0 dB is not low"),
        (lambda snr, left: slot(snr, left, limit=lambda r, d: d), "what the slot carries"),
        (in_place, "changes what it is given"),
        (lambda snr, left: slot(snr, left)[1], "two numbers are expected"),
    ],
    "rewards_by_hand": [
        (flights(a=(2, 0.3)), "A, step 2.*its penalty is missing"),
        (flights(a=(2, -0.5)), "A, step 2.*The 0.2 for the step is missing"),
        (flights(a=(4, 2.3)), "A, step 4.*no more than the device has left"),
        (flights(a=(5, -0.2)), "A, step 5.*data uploaded is missing"),
        (flights(a=(6, 2.0)), "A, step 6.*nothing is uploaded"),
        (flights(a=(2, 0.5 - 0.2 - 1 - 0.2)), "A, step 2: -0.9 is not right"),
        (lambda: (np.cumsum(FLIGHT_A), FLIGHT_B), "A: these are the sums"),
        (lambda: (FLIGHT_A, list(np.cumsum(FLIGHT_B))), "B: these are the sums"),
        (flights(a=(6, -0.2)), "A, step 6.*lands does not pay"),
        (flights(a=(6, -150)), "A, step 6.*Only the end of the time without a landing is a crash"),
        (flights(b=(3, -149.7)), "B, step 3.*nothing is uploaded"),
        (flights(b=(3, -1.2)), "B, step 3.*penalty for the crash is missing"),
        (flights(b=(3, -150.2)), "B, step 3.*its penalty is missing"),
        (flights(a=(1, None)), "A, step 1 has no number yet"),
        (lambda: (FLIGHT_A, [1.6]), "has 3 steps"),
    ],
    "reward": [
        (reward(axis=0), r"\.sum\(1\)"),
        (reward(axis=None), "its own four slots"),
        (reward(landing_free=False), "Only the step that lands is free"),
        (reward(instead=True), "An intervention costs 1, besides the 0.2"),
        (reward(chain=True), "can both happen"),
        (reward(sign=-1), "less 0.2"),
        (with_if, "cannot decide for a whole batch"),
    ],
    "safe_step": [
        (controller(wraps=True), "leaves the grid"),
        (unchecked, "last one: no error warns you|cell that does not exist|nothing is in the way"),
        (controller(buildings=True), "may be flown over"),
        (controller(clips=True), "leaves the grid.*the controller intervenes"),
        (controller(land=False), "not in the landing zone, so landing is not allowed"),
        (controller(flag=False), "the controller intervenes"),
        (controller(stay=False), "hovers instead"),
        (transposed(no_fly=True), r"look up city.no_fly\[col, row\]"),
        (transposed(landing=True), r"look up city.landing\[col, row\]"),
        (tilde, "write `not`"),
        (south_up, "North is one row up"),
        (stays_means_intervened, "always allowed"),
        (lambda city, cell, action: cell, "give back the cell and whether"),
    ],
}
