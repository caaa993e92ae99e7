"""Exercises of notebook 5, DDQN."""

import functools
import operator
from collections import Counter

import numpy as np
import torch

from uavdh_lite.course.checks.exercise import CheckFailed, close, exercise, expect, guarded, show
from uavdh_lite.course.checks.table import Table
from uavdh_lite.course.checks.values import Unreadable, numbers
from uavdh_lite.ddqn import ddqn_target, softmax_policy
from uavdh_lite.environment import ACTIONS
from uavdh_lite.streams import Use, stream


def _tensor(value) -> np.ndarray:
    if not isinstance(value, torch.Tensor):
        raise Unreadable("a torch tensor is expected.")
    return numbers(value)


def _softmax(q_values, temperature):
    return softmax_policy(q_values, temperature)


def _draw_policy(ax):
    q_values = np.array([[1000, 999.75, 999.5, 999, 998, 997]], np.float32)
    places = np.arange(len(ACTIONS))
    for k, temperature in enumerate((0.1, 0.5, 2.0)):
        shares = _softmax(torch.tensor(q_values), temperature)[0].numpy()
        ax.bar(places + 0.27 * (k - 1), shares, 0.27, label=f"β = {temperature}")
    names = [f"{name}\n{q:g}" for name, q in zip(ACTIONS, q_values[0], strict=True)]
    ax.set_xticks(places, names, fontsize="small")
    ax.set(xlabel="action and its Q-value", ylabel="probability")


def _powers(top=None, over=1, exponents=torch.div):
    """A softmax with a mistake: what is subtracted from q / β, what the sum is over."""

    def mistake(q_values, temperature):
        tops = {
            None: lambda: 0,
            "row": lambda: q_values.amax(1, True),
            "batch": q_values.max,
            "column": lambda: q_values.amax(0, True),
            "mean": lambda: q_values.mean(1, keepdim=True),
            "least": lambda: q_values.amin(1, True),
            "first": lambda: q_values[:, :1],
        }
        powers = torch.exp(exponents(q_values - tops[top](), temperature))
        sums = {1: lambda: powers.sum(1, True), 0: lambda: powers.sum(0, True), 2: powers.sum}
        return powers / sums[over]() if over is not None else powers

    return mistake


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
        "All Q-values of a state may be far below 0: then every exp(Q/β) is 0, and 0 over 0 is "
        "nan.": [
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


POLICY = Table(
    _softmax,
    _policy_cases,
    mistakes={
        "You normalise over the batch: each column sums to 1, and states get into each other's "
        "way. Sum over the actions, dim=1, so that each row does.": (
            *(_powers(top, 0) for top in (None, "row", "batch", "column")),
            *(_powers(top, 0, torch.mul) for top in (None, "row")),
        ),
        "You divide by the sum of the whole batch. Each state has a policy of its own: sum over "
        "dim=1, with keepdim=True.": tuple(_powers(top, 2) for top in (None, "row", "batch")),
        "These are the exponentials, in the right ratios, but a row does not sum to 1: divide them "
        "by their sum over the actions.": tuple(
            _powers(top, None) for top in (None, "row", "batch")
        ),
        "It overflows: exp of 1000 / 0.1 is infinite, and infinity over infinity is nan. Subtract "
        "the state's largest Q-value before you take exp; that changes no probability.": _powers(),
        "You subtract the largest Q-value of the whole batch, and in a state whose values lie far "
        "below it all exponentials become 0. Subtract the maximum of each row.": _powers("batch"),
        "You subtract each action's maximum over the states, dim=0. That changes the gaps within a "
        "row: subtract from each row its own maximum, dim=1.": _powers("column"),
        **{
            "You subtract something smaller than the maximum of each row"
            f"{what}. Where the best action lies far above it, exp still overflows.": _powers(top)
            for what, top in ((", its mean", "mean"), (", its minimum", "least"), ("", "first"))
        },
        "You multiply by the temperature instead of dividing by it: a cold policy, with a small β, "
        "must be the sharper one.": tuple(
            _powers(top, exponents=torch.mul) for top in (None, "row", "batch")
        ),
        "The temperature has no effect. Inside of exp it matters; a factor in front of it cancels "
        "when you divide by the sum.": tuple(
            _powers(top, exponents=lambda q, b: q) for top in (None, "row", "batch")
        ),
        "The sign is wrong: the action with the largest Q-value must be the likeliest.": (
            lambda q, b: _softmax(-q, b)
        ),
        "These are logarithms of probabilities. The probabilities are asked for.": (
            lambda q, b: torch.log_softmax(q / b, 1)
        ),
        "That is the greedy policy, with 1 for the best action. At a temperature above 0 the "
        "others have a chance too.": lambda q, b: torch.eye(q.shape[1])[q.argmax(1)],
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


class _Tested:
    """A student's ring, asked and spoken of by the numbers of its items, 0 for the first added."""

    def __init__(self, ring: type, capacity: int):
        self.items: list[tuple] = []
        self.numbers: dict[int, int] = {}
        self.capacity = capacity
        self.ring = self._call(f"Ring({capacity})", lambda: ring(capacity))

    def _call(self, what: str, function, none: bool = False):
        when = ""
        if self.items:
            items = "1 item" if len(self.items) == 1 else f"{len(self.items)} items"
            when = f" after {items}, with capacity {self.capacity},"
        try:
            return guarded(function, f"{what}{when}", none)()
        except CheckFailed as failed:
            raise CheckFailed(f"{failed} {self._why(what, failed.__cause__)}".strip()) from None

    def _why(self, what: str, error: BaseException | None) -> str:
        """What is probably wrong if a method stops with this error."""
        if isinstance(error, IndexError) and what.startswith("add"):
            return "A list has only the places that were appended, or made in __init__."
        if isinstance(error, IndexError) and len(self.items) < self.capacity:
            return f"Only {len(self.items)} of {self.capacity} places are filled: draw from those."
        if "larger" in str(error):
            return "A sample may be larger than the number of items stored: items may repeat."
        if "inhomogeneous" in str(error) or "dimensional" in str(error):
            return "generator.choice makes arrays of items: draw places, generator.integers."
        if "ambiguous" in str(error):
            return "Items may hold arrays: do not compare them, keep their places."
        return ""

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
                f"{what} gives back {show(item)}, which is none of the tuples that were added to "
                "this ring. Draw places (generator.integers) and take the items from there: "
                "generator.choice makes arrays of them. And each ring has its own items."
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
    ax.set(
        xlabel="number of the item, 1 for the first added",
        ylabel="times in a sample of 4, mean",
        title="capacity 5",
        xticks=range(1, 13),
    )


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
        "Two samples in a row, with the same generator, are equal: draw from it, and make no "
        "generator of your own.",
    )


def _expect_newest(ring: _Tested, count: int) -> None:
    """The newest item is in every sample."""
    newest = count - 1
    alone = [ring.sample(1, seed)[0] for seed in range(12)]
    if set(alone) == {newest}:
        expect(
            all(newest in ring.sample(4, seed) for seed in range(12)),
            "A sample of 1 is the newest item, but samples of 4 do not always have it.",
        )
        return
    when = f"After {count} items, with capacity {ring.capacity},"
    if len(set(alone)) > 1:
        raise CheckFailed(
            f"{when} the newest item is not in every sample: a sample of 1 must be the newest "
            "alone, and yours differs from draw to draw."
        )
    oldest = max(0, count - ring.capacity)
    if alone[0] == oldest and count >= ring.capacity:
        raise CheckFailed(
            f"{when} every sample has the oldest item where the newest should be: that is the "
            "place to be overwritten next. The newest is one place before it, round the ring."
        )
    wrapped = (
        " That goes wrong once the ring is full and begins again at its first place: the newest "
        "is then no longer at the end."
        if count > ring.capacity
        else " Is the place noted before or after it moves on?"
    )
    raise CheckFailed(
        f"{when} every sample has item number {alone[0] + 1} where the newest, number {count}, "
        f"should be.{wrapped}"
    )


def _expect_stored(ring: _Tested, count: int) -> None:
    """All of the last items are stored, and nothing else is."""
    found = set(ring.sample(60 * ring.capacity, count))
    expected = set(range(max(0, count - ring.capacity), count))
    if found == expected:
        return
    when = f"After {count} items, with capacity {ring.capacity},"
    if count > ring.capacity and found > expected:
        raise CheckFailed(
            f"{when} {len(found)} different items are drawn: the ring grows. From the capacity on "
            "each new item must overwrite the oldest."
        )
    if found == {count - 1}:
        raise CheckFailed(f"{when} only the newest item is ever drawn. Where are the others?")
    if found < expected and len(set(ring.sample(60 * ring.capacity, count)[1:])) == 1:
        raise CheckFailed(
            f"{when} all items of a sample but the newest are the same one. Draw each of them on "
            "its own."
        )
    if found < expected and len(expected - found) == 1:
        raise CheckFailed(
            f"{when} item number {_numbered(expected - found)} is never drawn, though it should "
            "be stored. Is one place too few kept, or drawn from? (The upper end of "
            "generator.integers is left out already: no − 1 there.)"
        )
    if found - expected:
        raise CheckFailed(
            f"{when} the stored items are the numbers {_numbered(found)}, but should be the last "
            f"ones, {_numbered(expected)}: each new item must overwrite the oldest, and no other."
        )
    raise CheckFailed(
        f"{when} only the numbers {_numbered(found)} are ever drawn, of {_numbered(expected)}. "
        "Are too few places kept or drawn from?"
    )


def _expect_uniform(ring: _Tested, count: int) -> None:
    """Besides one newest item, all stored ones are equally likely, and drawn independently.

    A right answer fails with a probability below 1e-7: chi-square is compared with its quantile of
    1 - 1e-8, the share of equal pairs with 6 standard errors. One of 8 items that is drawn half as
    often as the others is found with a probability above 0.999.
    """
    samples, size, generator = 600, 9, stream(Use.EXERCISE, count)
    stored = range(max(0, count - ring.capacity), count)
    others = []
    for _ in range(samples):
        drawn = ring.sample(size, generator)
        drawn.remove(count - 1)
        others.append(drawn)
    total = Counter(number for drawn in others for number in drawn)
    expect(
        total[count - 1] or not others,
        "The newest item comes exactly once in each sample. The others must be drawn from all "
        "stored items, the newest included.",
    )
    mean, items = samples * (size - 1) / len(stored), len(stored)
    off = sum((total[number] - mean) ** 2 / mean for number in stored)
    expect(
        off < {1: 1e-9, 3: 37.0, 8: 52.0}[items],
        f"After {count} items, with capacity {ring.capacity}, the items besides the newest are not "
        f"equally likely: {dict((n + 1, total[n]) for n in stored)} draws by number. Draw each "
        "place from generator.integers(0, number stored).",
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


def _numbered(items: set[int]) -> str:
    return ", ".join(str(n + 1) for n in sorted(items))


def _target(reward, terminal, discount, online_next, target_next):
    return ddqn_target(reward, discount * ~terminal, online_next, target_next)


def _judged(reward, terminal, discount, chooser, judge, masked=True):
    value = judge.gather(1, chooser.argmax(1, True)).squeeze(1)
    return reward + discount * value * (~terminal if masked else 1)


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
    wrong = (reward + 0.9 * target.amax(1)).numpy()
    double = _target(*BY_HAND).numpy()
    for shift, values, label, colour in (
        (-0.2, wrong, "the wrong function's target", "0.7"),
        (0.2, double, "target y", "C0"),
    ):
        ax.bar_label(ax.bar(places + shift, values, 0.4, color=colour, label=label), fmt="%.4g")
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
        "There is one target for each transition, (B,): of each row of target_next take the entry "
        "at the number of the best action by online_next.": [
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
TARGET = Table(
    _target,
    _target_cases,
    mistakes={
        "That is what the wrong function gives: one network both chooses and judges, and a value "
        "is added after the end of an episode.": (
            lambda r, t, d, online, target: _judged(r, t, d, target, target, masked=False)
        ),
        "You take the largest Q-value of the target network: that is the target of plain DQN, "
        "with its bias. The online network must choose the action.": (
            lambda r, t, d, online, target: _judged(r, t, d, target, target)
        ),
        "You take the value from the online network, which also chooses: its errors are then on "
        "both sides, and the maximisation bias stays. The target network must judge.": (
            lambda r, t, d, online, target: _judged(r, t, d, online, online)
        ),
        "The networks are swapped: the online network chooses the action (argmax), the target "
        "network says what it is worth.": (
            lambda r, t, d, online, target: _judged(r, t, d, target, online)
        ),
        "Terminal transitions are not masked: after the end of an episode nothing follows, so "
        "that the target is the reward alone.": (
            lambda r, t, d, online, target: _judged(r, t, d, online, target, masked=False)
        ),
        "The mask is the wrong way round: the next state's value counts where the episode is "
        "not terminal, ~terminal.": (
            lambda r, t, d, online, target: _judged(r, ~t, d, online, target)
        ),
        "At the terminal transitions the reward is lost as well. Only the value of the next state "
        "falls away there: the reward of the last step counts.": (
            lambda r, t, d, online, target: _judged(r, t, d, online, target) * ~t
        ),
        "The discount is missing: the next state's value counts γ times.": (
            lambda r, t, d, online, target: _judged(r, t, 1, online, target)
        ),
        "You take the same discount whatever γ is handed in.": tuple(
            lambda r, t, d, online, target, own=own: _judged(r, t, own, online, target)
            for own in (0.9, 0.95, 0.99)
        ),
        "The discount multiplies the reward too. Only what comes later is discounted.": (
            lambda r, t, d, online, target: _judged(r * d, t, d, online, target)
        ),
        "The reward is missing.": lambda r, t, d, online, target: _judged(
            0 * r, t, d, online, target
        ),
        "You add the number of the best action (that is what argmax gives), not its Q-value: look "
        "it up in target_next.": (lambda r, t, d, online, target: r + d * online.argmax(1) * ~t),
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
    for message, mistake in TARGET.each_mistake():
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
    ax.set(
        xlabel="soft updates",
        ylabel="a weight of the target network",
        title="its weight in the online network is 1",
    )


def _moved(keep=None, take=None):
    """The new target weights; `keep` and `take` make mistakes in the two shares."""

    def update(target, online, rate):
        old = 1 - rate if keep is None else keep(rate)
        new = rate if take is None else take(rate)
        pairs = zip(target, online, strict=True)
        return np.concatenate([np.ravel(old * t + new * o) for t, o in pairs])

    return update


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
    _moved(),
    _update_cases,
    mistakes={
        "The rates are swapped: τ is the share of the online weights, 1 − τ that of the old "
        "target. With τ = 0.005 yours would jump nearly all the way.": (
            _moved(lambda rate: rate, lambda rate: 1 - rate)
        ),
        "You add τ θ, but do not shrink the old target to 1 − τ of itself: the weights would grow "
        "and grow.": _moved(keep=lambda rate: 1),
        "You copy the online weights: the target must go only the share τ of the way.": (
            _moved(lambda rate: 0, lambda rate: 1)
        ),
        "The sign of the difference is wrong: the target moves away from the online weights.": (
            _moved(lambda rate: 1 + rate, lambda rate: -rate)
        ),
        "You add θ, not τ θ, to what is left of the target: the two shares must make 1.": (
            _moved(take=lambda rate: 1)
        ),
        "The target is only shrunk to 1 − τ of itself: τ θ is not added.": (
            _moved(take=lambda rate: 0)
        ),
    },
    tolerance=1e-5,
    smallest=1e-6,
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
    def asked(target, online, rate):
        target, online = ([torch.tensor(a) for a in arrays] for arrays in (target, online))
        tensors, kept, before = list(target), list(online), [_copies(t) for t in (target, online)]
        returned = update(target, online, rate)
        given = " The target weights are as they were" if _equal(tensors, before[0]) else ""
        expect(
            len(online) == len(kept) and _equal(kept, before[1]) and _equal(online, before[1]),
            "The online weights have changed. They only give: the target follows them.",
        )
        if given and 0 < rate < 1:
            right = _moved()(*before, rate)
            expect(
                len(target) != len(tensors) or not _equal([_flat(target)], [right]),
                f"The list has new tensors in it, with the right values, but{given.lower()} in "
                "the network, which holds the old ones. Change the tensors themselves, in place "
                "(lerp_, mul_, copy_).",
            )
            expect(
                not isinstance(returned, list | tuple),
                f"{given.strip()}. Nothing reads what you return: change the tensors themselves, "
                "in place (lerp_, mul_, copy_).",
            )
            raise CheckFailed(
                f"{given.strip()}. Change each tensor itself, whatever its shape, in place (lerp_, "
                "mul_, copy_): `t = …` only gives a new tensor the name t."
            )
        expect(
            len(target) == len(tensors) and all(map(operator.is_, target, tensors)),
            "The list `target` has other tensors in it than before. The network holds the old "
            "ones: change these, in place.",
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


def _copies(tensors) -> list[np.ndarray]:
    return [tensor.detach().numpy().copy() for tensor in tensors]


def _flat(tensors) -> np.ndarray:
    return np.concatenate([tensor.detach().numpy().ravel() for tensor in tensors])


def _equal(tensors, arrays) -> bool:
    pairs = zip(tensors, arrays, strict=True)
    return all(close(numbers(t), numbers(a), 1e-6) for t, a in pairs)
