"""Exercises of notebook 5, DDQN."""

import functools
import operator
import time
from collections import Counter

import numpy as np
import torch

from uavdh_lite.course.checks.exercise import CheckFailed, close, exercise, expect, guarded, show
from uavdh_lite.course.checks.table import Table, edit
from uavdh_lite.course.checks.values import Unreadable, numbers
from uavdh_lite.ddqn import softmax_policy
from uavdh_lite.environment import ACTIONS
from uavdh_lite.streams import Use, stream


def _tensor(value) -> np.ndarray:
    if not isinstance(value, torch.Tensor):
        raise Unreadable("a torch tensor is expected.")
    return numbers(value)


def _softmax(q_values, temperature):
    powers = torch.exp((q_values - q_values.amax(1, True)) / temperature)
    return powers / powers.sum(1, True)


def _draw_policy(ax):
    q_values = torch.tensor([[1000, 999.75, 999.5, 999, 998, 997]])
    places = np.arange(len(ACTIONS))
    for k, temperature in enumerate((0.1, 0.5, 2.0)):
        shares = softmax_policy(q_values, temperature)[0].numpy()
        ax.bar(places + 0.27 * (k - 1), shares, 0.27, label=f"β = {temperature}")
    names = [f"{name}\n{q:g}" for name, q in zip(ACTIONS, q_values[0], strict=True)]
    ax.set_xticks(places, names, fontsize="small")
    ax.set(xlabel="action and its Q-value", ylabel="probability")


def _policy_cases():
    generator = stream(Use.EXERCISE, 0)

    def case(rows, temperature, kind=torch.float32):
        return torch.tensor(rows, dtype=kind), temperature

    def few(count):
        return generator.integers(-8, 9, (count, 6)) / 4

    near = [1000, 999.875, 999.75, 999.5, 999, 998]
    return {
        "Each row is exp(Q/β), divided by the sum of its own row (dim=1), so that it sums to 1; "
        "keepdim=True makes a column of the sums.": [
            case(few(1), 1.0),
            case(few(2), 1.0),
            *(case(few(count), 1, torch.float64) for count in (5, 6)),
        ],
        "Divide Q by β: a small β makes the best action likelier, a large one all alike.": [
            *(case(few(count), beta) for count, beta in ((1, 0.25), (2, 2.0), (6, 0.7), (3, 40.0))),
            case([[0.5] * 6], 0.1),
        ],
        "No exponent may be above 0, since exp(1000 / 0.1) is infinite, and infinity over infinity "
        "is nan. Subtract the state's largest Q-value first; that changes no probability.": [
            case([near], 0.125),
            case([near[::-1]], 0.125),
            case([[900.0, 1000, 0, -1000, 0, 0]], 0.1),
        ],
        "All Q-values of a state may be far below 0: every exp(Q/β) is 0, and 0/0 is nan.": [
            case([[-q for q in near]], 0.125),
            case([[-1000.0] * 6], 0.1),
        ],
        "Within a row the best action may be far above the others, whichever it is: subtract the "
        "maximum of the row, nothing smaller.": [
            case([[0.0, 0, 0, 1000, 0, 0]], 0.1),
            case([[1000.0, 0, 0, 0, 0, 0]], 0.1),
            case([[0.0, -1000, 1000, 0, 1000, 0]], 0.5),
        ],
        "Rows of a batch may be far apart: subtract from each row its own maximum.": [
            case([near, [q - 1000 for q in near]], 0.125),
            case([[q - 1500 for q in near], near[::-1], [0.0] * 6], 0.125),
        ],
    }


def _whatever(old, new, *others):
    """A mistake that is one whichever of the others is made as well."""
    return tuple(edit(old, new, *other) for other in ((), *others))


TOP, TOTAL, OVER = "q_values.amax(1, True)", "powers.sum(1, True)", "/ temperature"
NO_TOP, BATCH_TOP, COLUMN_TOP = ((TOP, top) for top in ("0", "q_values.max()", "q_values.amax(0)"))
POLICY = Table(
    _softmax,
    _policy_cases,
    mistakes={
        "You normalise over the batch. Sum over the actions, dim=1, so that each row sums to 1.": (
            *_whatever(TOTAL, "powers.sum(0)", NO_TOP, BATCH_TOP, COLUMN_TOP),
            *_whatever(OVER, "* temperature", (TOTAL, "powers.sum(0)"))[1:],
            edit(OVER, "* temperature", TOTAL, "powers.sum(0)", *NO_TOP),
        ),
        "You divide by the sum of the whole batch. Each state has a policy of its own: sum over "
        "dim=1, with keepdim=True.": _whatever(TOTAL, "powers.sum()", NO_TOP, BATCH_TOP),
        "These are the exponentials, in the right ratios, but a row does not sum to 1: divide them "
        "by their sum over the actions.": _whatever(TOTAL, "1", NO_TOP, BATCH_TOP),
        "It overflows: exp of 1000 / 0.1 is infinite, and infinity over infinity is nan. Subtract "
        "the state's largest Q-value before you take exp.": edit(*NO_TOP),
        "You subtract the largest Q-value of the whole batch, and in a state whose values lie far "
        "below it all exponentials become 0. Subtract the maximum of each row.": edit(*BATCH_TOP),
        "You subtract each action's maximum over the states, dim=0. That changes the gaps within a "
        "row: subtract from each row its own maximum, dim=1.": edit(*COLUMN_TOP),
        "You subtract something smaller than the maximum of each row. Where the best action lies "
        "far above it, exp still overflows.": tuple(
            edit(TOP, f"q_values{top}") for top in (".mean(1, True)", ".amin(1, True)", "[:, :1]")
        ),
        "You multiply by the temperature: divide by it, since a small β must make the policy "
        "sharper.": _whatever(OVER, "* temperature", NO_TOP, BATCH_TOP),
        "The temperature has no effect. Inside of exp it matters; a factor in front of it cancels "
        "when you divide by the sum.": _whatever(OVER, "", NO_TOP, BATCH_TOP),
        "The sign is wrong: the best action must be the likeliest.": (
            lambda q, beta: _softmax(-q, beta)
        ),
        "These are the probabilities' logarithms.": lambda q, beta: torch.log_softmax(q / beta, 1),
        "That is the greedy policy. Above a temperature of 0 the others have a chance too.": (
            lambda q, beta: torch.eye(q.shape[1])[q.argmax(1)]
        ),
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


@exercise(
    "5.1 · A softmax that does not overflow (2 points, 12 minutes)",
    "exp(10 000) is infinite. But the probabilities depend on the gaps between a state's "
    "Q-values only: what may you subtract from all of them?",
    "A factor that all exponentials of a row share cancels when you divide by their sum; "
    "exp(−c/β) is such a factor, and makes exp((Q − c)/β) of exp(Q/β). Which c, another one in "
    "each row, leaves no exponent above 0, and one that is exactly 0?",
    figure=_draw_policy,
    table=POLICY,
)
def stable_policy(answer) -> None:
    """`policy(q_values, temperature)`: the softmax policy (eq. 12), (B, 6), for any Q-values."""


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


STOPS = {  # by what an error's message has in it, what is probably wrong
    "larger": "A sample may be larger than the number of items stored: items may repeat.",
    "inhomogeneous": "generator.choice makes arrays of items: draw places, generator.integers.",
    "dimensional": "generator.choice makes arrays of items: draw places, generator.integers.",
    "ambiguous": "Items may hold arrays: do not compare them, keep their places.",
}


class _Tested:
    """A student's ring, asked and spoken of by the numbers of its items, 0 for the first added."""

    def __init__(self, ring: type, capacity: int):
        self.items: list[tuple] = []
        self.numbers: dict[int, int] = {}
        self.capacity = capacity
        self.ring = self._call(f"Ring({capacity})", lambda: ring(capacity))

    @property
    def when(self) -> str:
        items = "1 item" if len(self.items) == 1 else f"{len(self.items)} items"
        return f"after {items}, with capacity {self.capacity},"

    def _call(self, what: str, function, none: bool = False):
        try:
            return guarded(function, f"{what} {self.when if self.items else ''}".strip(), none)()
        except CheckFailed as failed:
            error = failed.__cause__
            said = [text for part, text in STOPS.items() if part in str(error)]
            if isinstance(error, IndexError) and what.startswith("add"):
                said = ["A list has only the places that were appended, or made in __init__."]
            elif isinstance(error, IndexError) and len(self.items) < self.capacity:
                filled = f"Only {len(self.items)} of {self.capacity} places are filled"
                said = [f"{filled}: draw from those."]
            raise CheckFailed(" ".join([str(failed), *said])) from None

    def add(self, count: int) -> None:
        for _ in range(count):
            number = len(self.items)
            item = (np.full(2, number % 3), number % 6, number / 10, f"state {number % 4}")
            self._call("add(item)", lambda item=item: self.ring.add(item), none=True)
            self.items.append(item)
            self.numbers[id(item)] = number

    def sample(self, size: int, seed: int | np.random.Generator) -> list[int]:
        """The numbers of the items in one sample."""
        generator = stream(Use.EXERCISE, seed) if isinstance(seed, int) else seed
        what = f"sample({size}, generator)"
        given = self._call(what, lambda: self.ring.sample(size, generator))
        given = self._call(what, lambda: list(given))
        expect(
            len(given) == size,
            f"{what} gives back {len(given)} items, expected {size}: the newest counts as one of "
            "them, and an item may come more than once.",
        )
        for item in (item for item in given if id(item) not in self.numbers):
            empty = item is None or (isinstance(item, int | float) and item == 0)
            expect(
                not empty,
                f"{what} gives back {item!r}: a place that nothing was stored in yet. Draw only "
                "from those that are filled.",
            )
            raise CheckFailed(
                f"{what} gives back {show(item)}, which is none of the tuples added to this ring. "
                "Draw places (generator.integers) and take the items from there: generator.choice "
                "makes arrays of them. And each ring has its own items."
            )
        return [self.numbers[id(item)] for item in given]


def _draw_ring(ax):
    for added, colour, shift in ((3, "C0", -0.2), (12, "C1", 0.2)):
        ring = _Ring(5)
        for number in range(added):
            ring.add(number)
        generator = stream(Use.EXERCISE, 0)
        drawn = Counter(n for _ in range(1000) for n in ring.sample(4, generator))
        heights = [drawn[n] / 1000 for n in range(12)]
        label = f"after {added} items"
        ax.bar(np.arange(1, 13) + shift, heights, 0.4, color=colour, label=label)
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
    function=False,
)
def ring_buffer(answer) -> None:
    """The class `Ring(capacity)` with `add(item)` and `sample(size, generator)`."""
    expect(
        isinstance(answer, type),
        "Hand over the class itself: checks.ring_buffer(Ring), without brackets behind Ring.",
    )
    for method in ("add", "sample"):
        expect(hasattr(answer, method), f"The class has no method {method}.")
    for capacity in (5, 1, 7):
        ring, other = _Tested(answer, capacity), _Tested(answer, 3)
        for count in range(1, 3 * capacity + 2):
            ring.add(1)
            other.add(2)
            _expect_newest(ring, count)
            _expect_stored(ring, count)
    expect(
        ring.sample(12, 1) == ring.sample(12, 1) != ring.sample(12, 2),
        "All chance must come from the generator that is passed in: same seed, same sample.",
    )
    for capacity, count in ((1000, 1), (8, 3), (8, 27), (8, 8)):
        ring = _Tested(answer, capacity)
        ring.add(count)
        _expect_uniform(ring, count)
        _expect_newest(ring, count)
    generator = stream(Use.EXERCISE, 3)
    expect(
        ring.sample(12, generator) != ring.sample(12, generator),
        "Two samples in a row are equal: draw from the generator, and make none of your own.",
    )
    _expect_quick(answer)


def _expect_newest(ring: _Tested, count: int) -> None:
    """The newest item is in every sample."""
    newest, oldest = count - 1, max(0, count - ring.capacity)
    alone = [ring.sample(1, seed)[0] for seed in range(12)]
    expect(
        len(set(alone)) == 1,
        f"{ring.when.capitalize()} the newest item is not in every sample: a sample of 1 must be "
        "the newest alone, and yours differs from draw to draw.",
    )
    if alone[0] != newest:
        why = "Is the place noted before or after it moves on?"
        if alone[0] == oldest and count >= ring.capacity:
            why = "That is the oldest, the place to be overwritten next: take the one before it."
        elif count > ring.capacity:
            why = "Once the ring is full and begins again, the newest is no longer at the end."
        raise CheckFailed(
            f"{ring.when.capitalize()} every sample has item number {alone[0] + 1} where the "
            f"newest, number {count}, should be. {why}"
        )
    expect(
        all(newest in ring.sample(4, seed) for seed in range(12)),
        "A sample of 1 is the newest item, but samples of 4 do not always have it.",
    )


def _expect_stored(ring: _Tested, count: int) -> None:
    """All of the last items are stored, and nothing else is."""
    drawn = ring.sample(60 * ring.capacity, count)
    found, expected = set(drawn), set(range(max(0, count - ring.capacity), count))
    missing = expected - found
    if found == expected:
        return
    if found > expected:
        why = "the ring grows. From the capacity on each new item must overwrite the oldest."
    elif found - expected:
        why = "each new item must overwrite the oldest, and no other."
    elif found == {count - 1}:
        why = "only the newest item is ever drawn."
    elif len(set(drawn[1:])) == 1:
        why = "all items of a sample but the newest are the same one. Draw each of them on its own."
    elif len(missing) == 1:
        why = (
            "is one place too few kept, or drawn from? (generator.integers leaves out its upper "
            "end already: no − 1 there.)"
        )
    else:
        why = "are too few places kept or drawn from?"
    raise CheckFailed(
        f"{ring.when.capitalize()} the items drawn are the numbers {_numbered(found)}, expected "
        f"{_numbered(expected)}: {why}"
    )


def _numbered(items: set[int]) -> str:
    return ", ".join(str(n + 1) for n in sorted(items))


def _expect_uniform(ring: _Tested, count: int) -> None:
    """Besides one newest item, all stored ones are equally likely, and drawn independently.

    A right answer fails with a probability below 1e-7: chi-square is compared with its quantile of
    1 - 1e-8, the share of equal pairs with 6 standard errors. One of 8 items that is drawn half as
    often as the others is found with a probability above 0.999.
    """
    samples, size, generator = 600, 9, stream(Use.EXERCISE, count)
    stored = range(max(0, count - ring.capacity), count)
    total = Counter(n for _ in range(samples) for n in ring.sample(size, generator))
    total[count - 1] -= samples
    expect(
        total[count - 1],
        "The newest item is never drawn twice. Draw the others from all items, it included.",
    )
    mean, items = samples * (size - 1) / len(stored), len(stored)
    off = sum((total[number] - mean) ** 2 / mean for number in stored)
    expect(
        off < {1: 1e-9, 3: 37.0, 8: 52.0}[items],
        f"{ring.when.capitalize()} the items besides the newest are not equally likely: "
        f"{dict((n + 1, total[n]) for n in stored)} draws by number. Draw each place from "
        "generator.integers(0, number stored).",
    )
    pairs = [len(set(ring.sample(3, generator))) for _ in range(3 * samples)]
    # Of two independent draws: none new, one new (equal or with the newest), two different new ones
    right = np.array([1, 3 * (items - 1), (items - 1) * (items - 2)]) / items**2
    found = np.bincount(pairs, minlength=4)[1:4] / len(pairs)
    expect(
        (abs(found - right) <= 6 * np.sqrt(right * (1 - right) / len(pairs)) + 1e-9).all(),
        "Each item is drawn as often as it should be, but not independently of the others in its "
        "sample: draw every place by itself, generator.integers(0, number stored, size − 1).",
    )


def _expect_quick(ring: type) -> None:
    """A full ring of 65,536 items takes a new one as quickly as one of 8.

    The quickest of five batches counts, so that a busy machine fails no right answer: theirs differ
    by a factor of 2 at most, those of a list that shifts its items by 30 or more.
    """

    def seconds(capacity):
        own, batches = ring(capacity), []
        for number in range(capacity):
            own.add((number,))
        for _ in range(5):
            began = time.perf_counter()
            for number in range(100):
                own.add((number,))
            batches.append(time.perf_counter() - began)
        return min(batches)

    ask = guarded(seconds, "Ring(65536) and add(item)")
    expect(
        ask(2**16) < 10 * ask(8),
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
    reward, terminal, _, online, target = BY_HAND
    places, names = np.arange(2), []
    for shift, values, label, colour in (
        (-0.2, reward + 0.9 * target.amax(1), "the wrong function's target", "0.7"),
        (0.2, _target(*BY_HAND), "target y", "C0"),
    ):
        bars = ax.bar(places + shift, values.numpy(), 0.4, color=colour, label=label)
        ax.bar_label(bars, fmt="%.4g")
    for k in places:
        first = f"r = {reward[k]:g}, {'terminal' if terminal[k] else 'not terminal'}"
        names.append(f"{first}\nonline {online[k].tolist()}\ntarget {target[k].tolist()}")
    ax.axhline(0, color="black", linewidth=0.8)
    ax.set_xticks(places, names)
    ax.margins(y=0.1)
    ax.set(ylabel="target, data units", title="the two transitions of the table, γ = 0.9")


def _target_cases():
    def case(size, seed, discount, ends=0.4, at=5.0, kind=np.float32):
        generator = stream(Use.EXERCISE, seed)
        online = generator.normal(at, 2, (size, 6)).round(2)
        target = (online + generator.normal(0, 2, (size, 6))).round(2)
        reward, terminal = generator.normal(1, 2, size).round(2), generator.random(size) < ends
        reward, online, target = (torch.tensor(a.astype(kind)) for a in (reward, online, target))
        return reward, torch.tensor(terminal), discount, online, target

    return {
        "There is one target for each transition, (B,): the reward, plus γ times the entry in its "
        "row of target_next at the number of the best action by online_next.": [
            *(case(size, size, 1.0, ends=0) for size in (1, 8, 6)),
            case(3, 1, 1, ends=0, kind=np.float64),
        ],
        "The best action counts also if all Q-values are far below 0, or close together.": [
            case(4, 3, 1.0, ends=0, at=-50.0),
            (*case(2, 4, 1.0, ends=0)[:3], torch.tensor([[1, 1.0001, 1, 1, 1, 1]] * 2), BY_ROW),
        ],
        "The value of the next state counts γ times, the reward in full.": [
            *(case(2, seed, discount, ends=0) for seed, discount in enumerate((0.5, 0.99, 0.0, 1)))
        ],
        "At a terminal transition the target is the reward alone.": [
            *(case(1, 5, discount, ends=2) for discount in (0.9, 1.0)),
            *(case(size, seed, 0.8) for seed, size in enumerate((2, 6, 32, 7))),
        ],
    }


BY_ROW = torch.tensor([[1.0, -7, 2, 3, 4, 5], [6.0, 8, 7, 9, 1, 0]])
PLAIN, ONLINE = ("online_next.argmax", "target_next.argmax"), ("target_next.g", "online_next.g")
TARGET = Table(
    _target,
    _target_cases,
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
        "You take the same discount whatever γ is handed in.": (
            *(edit("+ discount", f"+ {own}") for own in (0.9, 0.95, 0.99)),
        ),
        "The discount multiplies the reward too.": (
            edit("return reward", "return discount * reward")
        ),
        "The reward is missing.": edit("return reward +", "return"),
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
)


@exercise(
    "5.3 · The double-DQN target (2 points, 12 minutes)",
    "One network is asked which action is best in the next state, the other what that action "
    "is worth. And what is a next state worth after the episode has ended?",
    "The wrong function lets one network do both. argmax says which action is best; with the "
    "number of that action in each row, look up its worth. And a Boolean counts as 0 or 1 in a "
    "product: which of the two terms falls away at the end?",
    figure=_draw_target,
    function=False,
)
def double_target(answer) -> None:
    """`target(reward, terminal, discount, online_next, target_next)`: y, (B,) (eq. 10); by hand."""
    expect(
        isinstance(answer, tuple | list) and len(answer) == 2,
        "Hand over both, the function and your two numbers: ((target, by_hand)).",
    )
    target, by_hand = answer
    expect(
        callable(target) and not isinstance(target, type),
        "Hand over the function itself: its name, without brackets behind it.",
    )
    _expect_by_hand(by_hand)
    TARGET(target)


def _expect_by_hand(by_hand) -> None:
    try:
        given = numbers(by_hand)
    except Unreadable:
        given = np.zeros(0)
    expect(given.shape == (2,), "by_hand is a list of two numbers, the y of each row of the table.")
    right = _target(*BY_HAND)
    wrong = [k for k in range(2) if not close(given[k], right[k])]
    if not wrong:
        return
    for message, mistake in TARGET.each_mistake:
        if close(given, mistake(*BY_HAND)):
            raise CheckFailed(f"by_hand: {message}")
    rows = " and ".join(("first", "second")[k] for k in wrong)
    raise CheckFailed(f"by_hand: not yet right in the {rows} row of the table.")


def _draw_soft_update(ax):
    for rate in (0.5, 0.1, 0.02):
        target, online, path = torch.zeros(1), torch.ones(1), [0.0]
        for _ in range(60):
            torch._foreach_lerp_([target], [online], rate)
            path.append(target.item())
        ax.plot(path, label=f"τ = {rate}")
    ax.axhline(1, color="black", linewidth=0.8)
    ax.set(xlabel="soft updates", ylabel="a weight of the target network")
    ax.set_title("its weight in the online network is 1")


def _moved(target, online, rate):
    """The new target weights in a row."""
    pairs = zip(target, online, strict=True)
    return np.concatenate([np.ravel((1 - rate) * t + rate * o) for t, o in pairs])


def _update_cases():
    def case(rate, *shapes, kind=np.float64, seed=0):
        generator = stream(Use.EXERCISE, seed)
        target, online = (
            [generator.normal(0, 1, shape).round(2).astype(kind) for shape in shapes]
            for _ in range(2)
        )
        return target, online, rate

    layers = (3,), (2, 3), (4, 1, 2)
    return {
        "Each target weight becomes 1 − τ of itself plus τ of the online weight.": [
            *(case(rate, (2,), seed=k) for k, rate in enumerate((0.25, 0.5, 0.9))),
            *(case(rate, (1,), seed=k) for k, rate in enumerate((0.005, 0.01, 0.3))),
        ],
        "With τ = 0 nothing changes, with τ = 1 the target weights become the online ones.": [
            *(case(rate, (2,), seed=5) for rate in (0.0, 1.0, 0, 1))
        ],
        "All tensors of the lists take part, whatever their shapes.": [
            *(case(rate, *layers, seed=6) for rate in (0.25, 0.7)),
            *(case(0.1, *layers, (), kind=np.float32, seed=7), case(0.2, (1, 1), (5, 0), (2,)))[:3],
        ],
    }


UPDATE = Table(
    _moved,
    _update_cases,
    mistakes={
        "The rates are swapped: τ is the share of the online weights, 1 − τ that of the old "
        "target.": edit("(1 - rate) * t + rate * o", "rate * t + (1 - rate) * o"),
        "You add τ θ, but do not shrink the old target to 1 − τ of itself: the weights would grow "
        "and grow.": edit("(1 - rate) *", ""),
        "You copy the online weights: go only the share τ.": edit("(1 - rate) * t + rate * o", "o"),
        "The sign of the difference is wrong: the target moves away from the online weights.": (
            edit("1 - rate", "1 + rate", "+ rate * o", "- rate * o")
        ),
        "You add θ, not τ θ: the two shares must make 1.": edit("+ rate * o", "+ o"),
        "The target is only shrunk to 1 − τ of itself: τ θ is missing.": edit("+ rate * o", ""),
    },
    tolerance=1e-5,
    smallest=1e-6,
)
IN_PLACE = "Change each tensor itself, in place (lerp_, mul_, copy_), whatever its shape"


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
        target, online = ([torch.tensor(a) for a in arrays] for arrays in case[:2])
        tensors, kept, rate = list(target), list(online), case[2]
        returned = update(target, online, rate)
        expect(
            _equal(online, case[1]) and _equal(kept, case[1]),
            "The online weights have changed. They only give: the target follows them.",
        )
        if _equal(tensors, case[0]) and 0 < rate < 1:
            same = "The target weights are as they were"
            expect(
                len(target) != len(tensors) or not _equal([_flat(target)], [_moved(*case)]),
                f"The list has new tensors, right ones, but the network has the old. {IN_PLACE}.",
            )
            expect(
                not isinstance(returned, list | tuple),
                f"{same}. Nothing reads what you return. {IN_PLACE}.",
            )
            raise CheckFailed(f"{same}. {IN_PLACE}: `t = …` only gives a new tensor the name t.")
        expect(
            len(target) == len(tensors) and all(map(operator.is_, target, tensors)),
            f"The list `target` has other tensors in it than the network. {IN_PLACE}.",
        )
        for tensor in online:
            tensor += 1
        expect(
            not (tensors and rate == 1 and _equal(tensors, online)),
            "After an update with τ = 1 target and online share their memory: what changes one of "
            "them later changes the other. Copy the values.",
        )
        return _flat(tensors)

    UPDATE(asked)


def _flat(tensors) -> np.ndarray:
    return np.concatenate([tensor.detach().numpy().ravel() for tensor in tensors])


def _equal(some, others) -> bool:
    return len(some) == len(others) and all(
        map(functools.partial(close, tolerance=1e-6), some, others)
    )
