"""Exercises of notebook 5, DDQN."""

import functools
import timeit

import numpy as np
import torch

from uavdh_lite.course.checks.exercise import close, exercise, expect, guarded, show, solution
from uavdh_lite.course.checks.table import Table, edit
from uavdh_lite.course.checks.trial import expect_none
from uavdh_lite.course.checks.values import Unreadable, numbers
from uavdh_lite.ddqn import softmax_policy
from uavdh_lite.streams import Use, stream


def _tensor(value) -> np.ndarray:
    if not isinstance(value, torch.Tensor):
        raise Unreadable("a torch tensor is expected.")
    return numbers(value)


def _draw_policy(ax, solved):
    q_values = torch.tensor([[1000, 999.75, 999.5, 999, 998, 997]])
    for k, temperature in enumerate((0.1, 0.5, 2.0)):
        shares = softmax_policy(q_values, temperature)[0].numpy()
        ax.bar(np.arange(6) + 0.27 * (k - 1), shares, 0.27, label=f"β = {temperature}")
    ax.set_xticks(range(6), q_values[0].tolist())
    ax.set(xlabel="Q-value of an action", ylabel="probability")


def _few(count, temperature, kind=torch.float32):
    """Q-values of so many states, and a temperature."""
    rows = stream(Use.EXERCISE, count).integers(-8, 9, (count, 6)) / 4
    return torch.tensor(rows, dtype=kind), temperature


def _rows(temperature, *rows):
    return torch.tensor(np.array(rows, np.float32)), temperature


NEAR = np.array([1000, 999.875, 999.75, 999.5, 999, 998], np.float32)
TOP = "q_values.amax(1, True)"


@solution(
    "5.1 · A softmax that does not overflow (2 points, 12 minutes)",
    "exp(10 000) is infinite. But the probabilities depend on the gaps between a state's "
    "Q-values only: what may you subtract from all of them?",
    "A factor that all exponentials of a row share cancels when you divide by their sum; "
    "exp(−c/β) is such a factor, and makes exp((Q − c)/β) of exp(Q/β). Which c, another one in "
    "each row, leaves no exponent above 0, and one that is exactly 0?",
    figure=_draw_policy,
    rules={
        "Each row is exp(Q/β), divided by the sum of its own row (dim=1), so that it sums to 1; "
        "keepdim=True makes a column of the sums.": [
            *(_few(1, 1.0), _few(2, 1.0), _few(5, 1, torch.float64), _few(6, 1)),
        ],
        "Divide Q by β inside of exp: a small β makes the best action likelier, a large one all "
        "alike.": [_few(1, 0.25), _few(2, 2.0), _few(6, 0.7), _few(3, 40.0)],
        "No exponent may be above 0, since exp(1000 / 0.1) is infinite: it overflows, and infinity "
        "over infinity is nan. Subtract the state's largest Q-value first; that changes no "
        "probability.": [_rows(0.125, NEAR), _rows(0.125, NEAR[::-1])],
        "All Q-values of a state may be far below 0. Then every exp(Q/β) is 0, and 0/0 is nan; and "
        "what is added to a number of ten thousand is rounded. Subtract the maximum first.": [
            *(_rows(0.125, -NEAR), _rows(0.1, [-1000.0] * 6)),
        ],
        "Within a row the best action may be far above the others, whichever it is: subtract the "
        "maximum of the row, nothing smaller than the maximum.": [
            *(_rows(0.1, row) for row in ([0.0, 0, 0, 1000, 0, 0], [1000.0, 0, 0, 0, 0, 0])),
            _rows(0.5, [0.0, -1000, 1000, 0, 1000, 0]),
        ],
        "Rows of a batch may be far apart: subtract from each row its own maximum.": [
            *(_rows(0.125, NEAR, NEAR - 1000), _rows(0.125, NEAR - 1500, NEAR, 0 * NEAR)),
        ],
    },
    mistakes={
        "You subtract each action's maximum over the states, dim=0. That changes the gaps within a "
        "row: subtract from each row its own maximum, dim=1.": edit(TOP, "q_values.amax(0)"),
        "These are the probabilities' logarithms.": lambda q, beta: torch.log_softmax(q / beta, 1),
    },
    read=_tensor,
    tolerance=1e-4,
    smallest=1e-7,
    errors={
        "return_types": "Along a dimension, max gives two things, the values and where they are: "
        "take `.values`, or use amax.",
        "must match the size": "A sum or maximum of each row goes with the rows only as a column: "
        "keepdim=True makes (B, 1) of (B,).",
    },
)
def stable_policy(q_values, temperature):
    """`policy(q_values, temperature)`: the softmax policy (eq. 12), (B, 6), for any Q-values."""
    powers = torch.exp((q_values - q_values.amax(1, True)) / temperature)
    return powers / powers.sum(1, True)


class _Ring:
    """The solution."""

    def __init__(self, capacity):
        self.capacity, self.items, self.newest = capacity, [], -1

    def add(self, item):
        self.newest = (self.newest + 1) % self.capacity
        self.items[self.newest : self.newest + 1] = [item]

    def sample(self, size, generator):
        rest = generator.integers(0, len(self.items), size - 1)
        return [self.items[self.newest], *(self.items[k] for k in rest)]


def _draws(ring: type, capacity: int, added: int, size: int, count: int = 1, seed: int = 0):
    """The numbers of the items in so many samples, 1 for the first added; another ring has more."""
    items = [(np.full(2, n % 3), n % 6, n / 10, f"state {n % 4}") for n in range(added)]
    numbers = {id(item): number for number, item in enumerate(items, 1)}
    own, other, generator = ring(capacity), ring(3), stream(Use.EXERCISE, seed)
    for item in items:
        own.add(item)
        other.add((item,))
    samples = [list(own.sample(size, generator)) for _ in range(count)]
    for sample in samples:
        expect(
            len(sample) == size,
            f"{_call(capacity, added, size)} gives back {len(sample)} items, expected {size}: the "
            "newest counts as one of them, and an item may come more than once.",
        )
        strange = [item for item in sample if id(item) not in numbers]
        expect(
            not strange,
            f"{_call(capacity, added, size)} gives back {next(map(show, strange), None)}, which "
            "is none of the tuples added to this ring. `add` must store each in a place. Draw "
            "places (generator.integers), only from those that are filled, and take the items "
            "themselves from there, no copies: generator.choice makes arrays of them.",
        )
    return [[numbers[id(item)] for item in sample] for sample in samples]


def _call(capacity, added, size):
    return f"Ring({capacity}), after {added} × add(item), sample({size}, generator)"


def _drawn(ring: type):
    """What the table asks of a class: which items are in a sample, by their numbers."""
    return lambda *case: f"items {sorted(set(*_draws(ring, *case)))}"


RING = Table(
    _drawn(_Ring),
    {
        "The newest item is in every sample, so that a sample of 1 is the newest alone.": [
            *((5, added, 1) for added in range(1, 5)),
        ],
        "When the ring is full, each new item still goes in, in the place of the oldest. So the "
        "newest is no longer at the end: it is one place before that to be overwritten next.": [
            *((5, added, 1) for added in range(5, 17)),
            *((1, added, 1) for added in range(1, 4)),
        ],
        "The other items of a sample are drawn from all stored ones, each of them on its own.": [
            *((5, added, 300) for added in range(1, 6)),
        ],
        "When the ring is full, each new item must overwrite the oldest, and no other: the ring "
        "does not grow. All places are drawn from, the last one too: generator.integers leaves out "
        "its upper end already.": [
            *((5, added, 300) for added in range(6, 17)),
            *((1, 3, 60), (3, 8, 200), (7, 22, 420)),
        ],
    },
    read=np.asarray,
    errors={
        "NoneType": "Is a `return` missing, or a list that __init__ should make?",
        "assignment index": "A list has only the places that were appended, or made in __init__.",
        "list index": "There is no such place: `add` must store each item, and only the places "
        "that are filled may be drawn from, or hold the newest.",
        "high": "No place is filled: `add` must store each item, and count it.",
        "larger": "A sample may be larger than the number of items stored: items may repeat.",
        "dimension": "generator.choice makes arrays of items: draw places.",
        "ambiguous": "Items may hold arrays: do not compare them, keep their places.",
    },
    call=_call,
)


def _draw_ring(ax):
    for added in (3, 12):
        counts = np.bincount(np.ravel(_draws(_Ring, 5, added, 4, 1000)), minlength=13)
        ax.plot(range(1, 13), counts[1:] / 1000, "o--", label=f"after {added} items")
    ax.set(xlabel="number of the item, 1 for the first added", xticks=range(1, 13))
    ax.set(ylabel="times in a sample of 4, mean", title="capacity 5")


@exercise(
    "5.2 · A ring buffer with combined replay (3 points, 20 minutes)",
    "Keep two things apart: how many places are filled, and where the newest item is. "
    "The places are used in a circle: which operator takes the last one back to the first?",
    "The remainder of a division by the capacity runs in such a circle. While the memory is "
    "not full, only the places filled so far may be drawn; draw places, not items. And of the "
    "size items one is the newest, drawn or not.",
    figure=_draw_ring,
    takes=(
        lambda answer: isinstance(answer, type),
        "Hand over the class itself: checks.ring_buffer(Ring), without brackets behind Ring.",
    ),
)
def ring_buffer(answer) -> None:
    """The class `Ring(capacity)` with `add(item)` and `sample(size, generator)`."""
    RING(_drawn(answer))
    for capacity, added, limit in ((1000, 1, 1e-9), (8, 3, 37.0), (8, 27, 52.0), (8, 8, 52.0)):
        call = _call(capacity, added, "…")
        guarded(_expect_chance, call, none=True)(answer, capacity, added, limit)
    guarded(_expect_quick, "Ring(65536) and add(item)", none=True)(answer)


CHANCE = {  # what is said of many samples, and when
    "All chance must come from the generator that is passed in: same seed, same sample, and "
    "another one with another seed.": lambda of: of.again[0] != of.again[1] or of.unchanging,
    "A sample of 1 is the newest item, but larger samples do not always have it.": (
        lambda of: not of.newest
    ),
    "After {added} items with the capacity {capacity} the items besides the newest are not equally "
    "likely: from the oldest on {counts} draws. Draw each place from "
    "generator.integers(0, number stored).": lambda of: of.chi_square >= of.limit,
    "Each item is drawn as often as it should be, but not independently of the others in its "
    "sample: draw every place by itself, generator.integers(0, number stored, size − 1).": (
        lambda of: of.dependent
    ),
}


def _expect_chance(ring: type, capacity: int, added: int, limit: float) -> None:
    """Besides one newest item, all stored ones are equally likely, and drawn independently.

    A right answer fails with a probability below 1e-7: chi-square is compared with its quantile of
    1 - 1e-8, the mean number of different items in a sample with 6 standard errors. One of 8 items
    that is drawn half as often as the others is found with a probability above 0.999.
    """
    again = [_draws(ring, capacity, added, 60, seed=seed) for seed in (1, 1, 2)]
    drawn, stored = np.array(_draws(ring, capacity, added, 9, 600)), min(capacity, added)
    counts = np.bincount(drawn.ravel())[-stored:] - 600 * (np.arange(stored) == stored - 1)
    different = [len(set(sample)) for sample in _draws(ring, capacity, added, 3, 1800)]
    right = 1 + (stored - 1) * (1 - (1 - 1 / stored) ** 2)
    expect_none(
        CHANCE,
        capacity=capacity,
        added=added,
        limit=limit,
        again=again,
        unchanging=added > 1 and again[0] == again[2],
        newest=(drawn == added).any(1).all(),
        counts=counts.tolist(),
        chi_square=((counts - counts.mean()) ** 2).sum() / counts.mean(),
        dependent=abs(np.mean(different) - right) > 6 * np.std(different) / 1800**0.5 + 1e-9,
    )


def _expect_quick(ring: type) -> None:
    """A full ring of 65,536 items takes a new one as quickly as one of 8.

    The quickest of five batches counts, so that a busy machine fails no right answer: theirs differ
    by a factor of 2 at most, those of a list that shifts its items by 30 or more.
    """

    def seconds(capacity):
        own = ring(capacity)
        batches = [timeit.timeit(lambda: own.add((0,)), number=capacity)]
        batches += timeit.repeat(lambda: own.add((0,)), number=100, repeat=5)
        return min(batches[1:])

    expect(
        seconds(2**16) < 10 * seconds(8),
        "Adding gets slower the larger the memory is. Do not shift all items by a place, as pop(0) "
        "does: overwrite the oldest where it is.",
    )


def _target(reward, terminal, discount, online_next, target_next):
    best = online_next.argmax(1, True)
    return reward + discount * target_next.gather(1, best).squeeze(1) * ~terminal


BY_HAND = (  # the table of exercise 5.3, as the arguments of `target`
    torch.tensor([1, -0.2]),
    torch.tensor([False, True]),
    0.9,
    torch.tensor([[2.0, 5, 3], [1, 0, 4]]),
    torch.tensor([[4.0, 2, 6], [3, 5, 2]]),
)


def _draw_target(ax):
    wrong, right = BY_HAND[0] + 0.9 * BY_HAND[4].amax(1), _target(*BY_HAND)
    for shift, values, label in ((-0.2, wrong, "the wrong function's"), (0.2, right, "right")):
        bars = ax.bar(np.arange(2) + shift, values.numpy(), 0.4, label=f"target: {label}")
        ax.bar_label(bars, fmt="%.4g")
    ax.set_xticks((0, 1), ("first row", "second row, terminal"))
    ax.set(ylabel="target, data units", title="the two transitions of the table, γ = 0.9")


def _transitions(size, discount, ends=0.4, at=5.0, kind=np.float32, apart=2.0):
    """Arguments of `target` for so many transitions, with Q-values near `at`."""
    generator = stream(Use.EXERCISE, 10 * size + int(10 * discount))
    online = generator.normal(at, apart, (size, 6)).round(2 if apart > 1 else 6)
    target = generator.normal(at, 3, (size, 6)).round(2)
    reward, terminal = generator.normal(1, 2, size).round(2), generator.random(size) < ends
    reward, online, target = (torch.tensor(a.astype(kind)) for a in (reward, online, target))
    return reward, torch.tensor(terminal), discount, online, target


PLAIN, ONLINE = ("online_next.argmax", "target_next.argmax"), ("target_next.g", "online_next.g")
TARGET = Table(
    _target,
    {
        "There is one target for each transition, (B,): the reward, plus γ times the entry in its "
        "row of target_next at the number of the best action by online_next.": [
            *((1, 1.0, 0), (8, 1.0, 0), (6, 1.0, 0), (3, 1, 0, 5.0, np.float64)),
        ],
        "The best action counts also if all Q-values are far below 0, or close together.": [
            *((4, 1.0, 0, -50.0), (2, 1.0, 0, 1.0, np.float32, 1e-4)),
        ],
        "The value of the next state counts γ times, with the γ that is handed in, the reward in "
        "full.": [(2, 0.5, 0), (2, 0.99, 0), (2, 0.0, 0), (2, 1, 0)],
        "At a terminal transition the target is the reward alone.": [
            *((1, 0.9, 2), (1, 1.0, 2), (2, 0.8), (6, 0.8), (32, 0.8), (7, 0.8)),
        ],
    },
    mistakes={
        "That is what the wrong function gives: one network both chooses and judges, and a value "
        "is added after the end of an episode.": edit(*PLAIN, "* ~terminal", ""),
        "You take the largest Q-value of the target network: that is the target of plain DQN, "
        "with its bias. The online network must choose the action.": edit(*PLAIN),
        "You take the value from the online network, which also chooses: the maximisation bias "
        "stays. The target network must judge.": edit(*ONLINE),
        "The networks are swapped: the online network chooses the action (argmax), the target "
        "network says what it is worth.": edit(*PLAIN, *ONLINE),
        "Terminal transitions are not masked: after the end of an episode nothing follows, so "
        "that the target is the reward alone.": edit("* ~terminal", ""),
        "The mask is the wrong way round: the next state's value counts where the episode is "
        "not terminal, ~terminal.": edit("~terminal", "terminal"),
        "At the terminal transitions the reward is lost as well. Only the value of the next state "
        "falls away there.": edit("return reward", "return ~terminal * reward"),
        "The discount is missing: the next state counts γ times.": edit("+ discount *", "+"),
        "You add the number of the best action (that is what argmax gives), not its Q-value: look "
        "it up in target_next.": edit("target_next.gather(1, best)", "best"),
    },
    read=_tensor,
    tolerance=1e-5,
    smallest=1e-5,
    errors={
        "must match the size": "One of them is for each transition, (B,), the other has a number "
        "for each action, (B, 6): pick the best action's first. A single index, target_next[best], "
        "takes rows.",
        "out of bounds": "The first index is the row, the transition; the second the action.",
        "could not be broadcast": "As many rows as columns are needed: torch.arange(B), with B the "
        "number of transitions.",
    },
    made=_transitions,
)


@exercise(
    "5.3 · The double-DQN target (2 points, 12 minutes)",
    "One network is asked which action is best in the next state, the other what that action "
    "is worth. And what is a next state worth after the episode has ended?",
    "The wrong function lets one network do both. argmax says which action is best; with the "
    "number of that action in each row, look up its worth. And a Boolean counts as 0 or 1 in a "
    "product: which of the two terms falls away at the end?",
    figure=_draw_target,
    takes=(
        lambda answer: isinstance(answer, tuple | list) and len(answer) == 2,
        "Hand over both, the function and your two numbers: ((target, by_hand)).",
    ),
)
def double_target(answer) -> None:
    """`target(reward, terminal, discount, online_next, target_next)`: y, (B,) (eq. 10); by hand."""
    target, by_hand = answer
    expect(
        callable(target) and not isinstance(target, type),
        "Hand over the function itself: its name, without brackets behind it.",
    )
    try:
        given = numbers(by_hand)
    except Unreadable:
        given = np.zeros(0)
    expect(given.shape == (2,), "by_hand is a list of two numbers, the y of each row of the table.")
    TARGET.by_hand("by_hand", torch.tensor(given), BY_HAND)
    TARGET(target)


def _draw_soft_update(ax):
    updates = np.arange(61)
    for rate in (0.5, 0.1, 0.02):
        ax.plot(updates, 1 - (1 - rate) ** updates, label=f"τ = {rate}")
    ax.set(xlabel="soft updates", ylabel="a weight of the target network")
    ax.set_title("from 0, with a weight of 1 in the online network")


def _moved(target, online, rate):
    """The new target weights in a row."""
    pairs = zip(target, online, strict=True)
    return np.concatenate([np.ravel((1 - rate) * t + rate * o) for t, o in pairs])


def _weights(rate, *shapes):
    """Target and online weights of these shapes, and a rate."""
    generator = stream(Use.EXERCISE, len(shapes))
    target, online = ([generator.normal(size=shape).round(2) for shape in shapes] for _ in "to")
    return [np.asarray(t) for t in target], [np.asarray(o) for o in online], rate


UPDATE = Table(
    _moved,
    {
        "Each target weight becomes 1 − τ of itself plus τ of the online weight: it goes only the "
        "share τ of the way. All tensors of the lists take part.": [
            *((0.25, (2, 2), (2,)), (0.5, (2,)), (0.9, (2,)), (0.005, (2,))),
        ],
        "With τ = 0 nothing changes, with τ = 1 the target weights become the online ones.": [
            *((0.0, (2,)), (1.0, (2,)), (0, (2,)), (1, (2,))),
        ],
        "All tensors of the lists take part, whatever their shapes.": [
            *((0.25, (3,), (2, 3), (4, 1, 2)), (0.1, (3,), ()), (0.2, (1, 1), (5, 0), (2,))),
        ],
    },
    tolerance=1e-5,
    smallest=1e-6,
    made=_weights,
)


@exercise(
    "5.4 · The soft update, in place (2 points, 8 minutes)",
    "In a loop, `t = …` only gives a new tensor the name t. The tensor that the network "
    "holds stays as it was. Which operations of torch change a tensor itself?",
    "Their names end in an underscore: mul_, add_, copy_, lerp_ and others. Go through both "
    "lists together, shrink the target tensor, add the online tensor's share to it, and mind "
    "that the online tensor itself is not changed on the way.",
    figure=_draw_soft_update,
)
def soft_update_in_place(answer) -> None:
    """`soft_update(target, online, rate)`: the target weights move towards the online ones."""
    update = answer.__wrapped__  # what gives back nothing is right here

    @functools.wraps(update)
    def asked(*case):
        tensors, online = ([torch.tensor(array) for array in arrays] for arrays in case[:2])
        rate = case[2]
        lists, weights = (list(tensors), list(online)), [tensor.detach() for tensor in tensors]
        update(*lists, rate)
        expect(
            [len(one) for one in lists] == [len(tensors), len(online)],
            "Your function takes tensors out of a list, or puts some in. The lists stay as they "
            "are: only the target tensors' values change.",
        )
        expect(
            _equal(online, case[1]),
            "The online weights have changed. They only give: the target follows them.",
        )
        expect(
            not (_equal(tensors, case[0]) and 0 < rate < 1),
            "The tensors of the network are as they were. Change each of them itself, in place "
            "(lerp_, mul_, copy_), whatever its shape: `t = …` only gives a new tensor the name t, "
            "a new tensor in the list is none of the network, and nothing reads what you return.",
        )
        expect(
            not (_equal(weights, case[0]) and 0 < rate < 1),
            "`t.data = …` and set_ give a tensor other memory; in its own the old values stay, for "
            "all that shares it. Write the new values there: lerp_, mul_, copy_.",
        )
        for tensor in online:
            tensor += 0.37
        expect(
            rate != 1 or not _equal(tensors, online),
            "After an update with τ = 1 target and online share their memory: what changes one of "
            "them later changes the other. Copy the values.",
        )
        return _flat(weights)

    UPDATE(asked)


def _flat(arrays) -> np.ndarray:
    return np.concatenate([np.ravel(numbers(array)) for array in arrays])


def _equal(some, others) -> bool:
    return close(_flat(some), _flat(others), 1e-6)
