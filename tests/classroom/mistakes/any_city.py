"""Wrong answers to the exercises of notebook 13, and what the message must say of each."""

import numpy as np


def centred(layers, uav, size, fill=(0, 1, 0), shift=0, side=None):
    seen = np.zeros((3, *(2 * (side or size) - 1,) * 2), bool)
    seen[:] = np.array(fill, bool)[:, None, None]
    m = layers.shape[1]
    row, col = ((side or size) - 1 - u + shift for u in uav)
    wide = np.pad(seen, ((0, 0), (size, size), (size, size)), mode="edge")
    wide[:, row + size : row + size + m, col + size : col + size + m] = layers
    return wide[:, size:-size, size:-size].copy()


def of_its_own_size(layers, uav, size):
    return centred(layers, uav, size, side=layers.shape[1])


def middle_of_the_city(layers, uav, size):
    return centred(layers, uav, size, shift=layers.shape[1] - size)


def through_the_large_city(layers, uav, size):
    return centred(layers, uav, size, shift=(size - layers.shape[1]) // 2)


def too_long(layers, uav, size):
    seen = np.zeros((3, 2 * size - 1, 2 * size - 1), bool)
    seen[1] = True
    row, col = size - 1 - uav[0], size - 1 - uav[1]
    seen[:, row : row + size, col : col + size] = layers
    return seen


def as_numbers(*case):
    return centred(*case).astype(float)


TURNS = {0: [0, 1, 2, 3], 1: [3, 0, 1, 2], 2: [2, 3, 0, 1], 3: [1, 2, 3, 0]}


def mean_q(q_of, layers, sign=1, flip=2, swap=(0, 3, 2, 1), last=False, views=(0, 1)):
    rows = []
    for mirrored in views:
        for k in range(4):
            one = np.flip(layers, flip) if mirrored and not last else layers
            one = np.rot90(one, k, axes=(1, 2))
            one = np.flip(one, flip) if mirrored and last else one
            back = np.array(TURNS[sign * k % 4])
            back = back[list(swap)] if mirrored else back
            rows.append(q_of(one[None])[0][[*back, 4, 5]])
    return np.mean(rows, axis=0)


def without_mapping(q_of, layers):
    eight = [np.rot90(x, k, axes=(1, 2)) for x in (layers, layers[..., ::-1]) for k in range(4)]
    return q_of(np.stack(eight)).mean(0)


def without_a_stack(q_of, layers):
    return np.mean([q_of(np.rot90(layers, k, axes=(1, 2))) for k in range(4)], axis=0)


def half_width(values, city, power=0.5, per=None, correct=True):
    off = values - values.mean()
    sums = np.array([off[city == one].sum() for one in set(city.tolist())])
    count = len(sums)
    correction = count / (count - 1) if correct else 1
    return 1.96 * (correction * (sums**2).sum()) ** power / (per or len(values))


def usual(values, city):
    return 1.96 * np.std(values, ddof=1) / len(values) ** 0.5


def of_means(values, city):
    means = np.array([values[city == one].mean() for one in np.unique(city)])
    return 1.96 * means.std(ddof=1) / len(means) ** 0.5


def by_counting(values, city):
    sums = np.bincount(city, values - values.mean())
    return 1.96 * np.sqrt(len(sums) / (len(sums) - 1) * (sums**2).sum()) / len(values)


def by_runs(values, city):
    """As if a city's missions always followed one another."""
    return half_width(values, np.cumsum(np.diff(city, prepend=city[0]) != 0))


MISTAKES = {
    "small_city_map": [
        (lambda *case: centred(*case, fill=(0, 0, 0)), "only no-fly, .*a cell outside the city"),
        (lambda *case: centred(*case, fill=(1, 1, 1)), "only no-fly, .*a cell outside the city"),
        (lambda *case: centred(*case, fill=(0, 0, 1)), "only no-fly, .*a cell outside the city"),
        (lambda *case: centred(*case, fill=(0, 1, 1)), "only no-fly, .*a cell outside the city"),
        (of_its_own_size, "has the shape .* 2M − 1 cells on a side"),
        (middle_of_the_city, "so the place shows"),
        (through_the_large_city, "so the place shows"),
        (lambda *case: centred(*case, shift=1), r"in the middle of the map, at \(M − 1, M − 1\)"),
        (lambda *case: centred(*case, shift=-1), r"in the middle of the map, at \(M − 1, M − 1\)"),
        (lambda layers, uav, size: centred(layers, uav[::-1], size), "Rows and columns"),
        (too_long, "m cells further, not M|a cell outside the city"),
        (as_numbers, "array of Booleans is expected"),
    ],
    "symmetric_q": [
        (without_mapping, "the place of each of the four moves twice"),
        (lambda *case: mean_q(*case, sign=-1), "the wrong way"),
        (lambda *case: mean_q(*case, swap=(0, 1, 2, 3)), "do not swap the moves"),
        (lambda *case: mean_q(*case, flip=1), "half a turn wrong"),
        (lambda *case: mean_q(*case, swap=(2, 1, 0, 3)), "half a turn wrong"),
        (lambda *case: mean_q(*case, last=True), "undo the last step first"),
        (lambda *case: mean_q(*case, views=(0,)), "yours are fewer"),
        (lambda q_of, layers: q_of(layers[None])[0], "yours are fewer"),
        (lambda *case: 8 * mean_q(*case), "all four get their mean"),
        (without_a_stack, r"stack of one by layers\[None\]"),
    ],
    "clustered_half_width": [
        (usual, "usual interval"),
        (of_means, "cities' means"),
        (lambda *case: half_width(*case, power=1), "take the root"),
        (lambda *case: half_width(*case, correct=False), r"total by C/\(C − 1\)"),
        (lambda *case: half_width(*case, per=1), "multiply it by 1.96 / N"),
        (lambda *case: 2 * half_width(*case), "multiply it by 1.96 / N"),
        (lambda *case: half_width(*case) / 1.96, "multiply it by 1.96 / N"),
        (by_counting, "numbers are names"),
        (by_runs, "expected"),
    ],
}
