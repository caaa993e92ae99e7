"""Exercises of notebook 5, DDQN."""

import functools
from collections import Counter

import numpy as np
import torch

from uavdh_lite.course.checks.exercise import (
    CheckFailed,
    close,
    compare,
    exercise,
    expect,
    guarded,
    show,
)
from uavdh_lite.ddqn import ddqn_target, softmax_policy
from uavdh_lite.environment import ACTIONS
from uavdh_lite.streams import Use, stream


def _with_tensors(answer, slips):
    """A function of tensors as one of arrays: gets a copy of each, gives back an array.

    Arguments:
        slips: what to say of an error, by a part of its own message.
    """

    @functools.wraps(answer)
    def call(*arguments):
        given = [torch.tensor(a) if isinstance(a, np.ndarray) else a for a in arguments]
        try:
            result = answer(*given)
        except CheckFailed as error:
            if error.__cause__ is None:
                raise
            cause = error.__cause__  # without all the tensors in the message
            name = getattr(answer, "__name__", "your function")
            known = [slip for part, slip in slips.items() if part in str(cause)]
            text = f"{name} stops with {type(cause).__name__}: {cause}"
            raise CheckFailed(" ".join([text.rstrip(".") + ".", *known])) from cause
        for before, after in zip(arguments, given, strict=True):
            expect(
                not isinstance(before, np.ndarray)
                or np.array_equal(before, after.detach().numpy()),
                "Your function changes a tensor that it is given, in place. It belongs to the "
                "caller: compute a new one.",
            )
        expect(
            isinstance(result, torch.Tensor),
            f"A torch tensor is expected; you give back a {type(result).__name__}.",
        )
        return result.detach().numpy()

    return call


def _softmax(q_values, temperature):
    return softmax_policy(torch.tensor(q_values), temperature).numpy()


def _naive_softmax(q_values, temperature, top=0):
    powers = np.exp((q_values - top) / np.float32(temperature))
    return powers / powers.sum(1, keepdims=True)


def _draw_policy(ax):
    q_values = np.array([[1000, 999.75, 999.5, 999, 998, 997]], np.float32)
    places = np.arange(len(ACTIONS))
    for k, temperature in enumerate((0.1, 0.5, 2.0)):
        shares = _softmax(q_values, temperature)[0]
        ax.bar(places + 0.27 * (k - 1), shares, 0.27, label=f"β = {temperature}")
    names = [f"{name}\n{q:g}" for name, q in zip(ACTIONS, q_values[0], strict=True)]
    ax.set_xticks(places, names, fontsize="small")
    ax.set(xlabel="action and its Q-value", ylabel="probability")
    ax.legend()


@exercise(
    "5.1",
    "A softmax that does not overflow",
    points=2,
    minutes=12,
    hints=(
        "exp(10 000) is infinite. But the probabilities depend on the gaps between a state's "
        "Q-values only: what may you subtract from all of them?",
        "A factor that all exponentials of a row share cancels when you divide by their sum; "
        "exp(−c/β) is such a factor, and makes exp((Q − c)/β) of exp(Q/β). Which c, another one in "
        "each row, leaves no exponent above 0, and one that is exactly 0?",
    ),
    figure=_draw_policy,
)
def stable_policy(answer) -> None:
    """`policy(q_values, temperature)`: the softmax policy (eq. 12), (B, 6), for any Q-values."""
    expect(callable(answer), "Hand over the function itself: its name, without brackets behind it.")
    slips = {
        "return_types": "Along a dimension, max gives two things, the values and where they are: "
        "take `.values`, or use amax.",
        "must match the size": "A sum or maximum of each row goes with the rows only as a column: "
        "keepdim=True makes (B, 1) of (B,).",
    }
    policy = _with_tensors(answer, slips)
    generator = stream(Use.EXERCISE, 0)
    few = generator.integers(-8, 9, (2, 6)).astype(np.float32) / 4
    square = generator.integers(-8, 9, (6, 6)).astype(np.float32) / 4
    with np.errstate(all="ignore"):
        given = policy(few, 0.5)
    if given.shape == few.shape and not close(given.sum(1), np.ones(2)):
        expect(
            not close(given.sum(0), np.ones(6)),
            "You normalise over the batch: each column sums to 1, and states get into each other's "
            "way. Sum over the actions, dim=1, so that each row does.",
        )
        expect(
            not close(given.sum(), 1),
            "You divide by the sum of the whole batch. Each state has a policy of its own: sum "
            "over dim=1, with keepdim=True.",
        )
        off = given / _softmax(few, 0.5)
        expect(
            not close(off, np.repeat(off[:, :1], 6, 1), 1e-3),
            "These are the exponentials, in the right ratios, but a row does not sum to 1: divide "
            "them by their sum over the actions.",
        )
    mistakes = {
        "You subtract each action's maximum over the states, dim=0. That changes the gaps within a "
        "row: subtract from each row its own maximum, dim=1.": (
            lambda q, b: _naive_softmax(q, b, q.max(0))
        ),
        "You multiply by the temperature instead of dividing by it: a cold policy, with a small "
        "β, must be the sharper one.": lambda q, b: _naive_softmax(q, 1 / b),
        "The temperature has no effect. Inside of exp it matters; a factor in front of it "
        "cancels when you divide by the sum.": lambda q, b: _naive_softmax(q, 1.0),
        "The sign is wrong: the action with the largest Q-value must be the likeliest.": (
            lambda q, b: _naive_softmax(-q, b)
        ),
        "These are shares of the Q-values themselves. Take the exponential first.": (
            lambda q, b: q / b / (q / b).sum(1, keepdims=True)
        ),
        "These are logarithms of probabilities. The probabilities are asked for.": (
            lambda q, b: np.log(_naive_softmax(q, b))
        ),
        "That is the greedy policy, with 1 for the best action. At a temperature above 0 the "
        "others have a chance too.": lambda q, b: np.eye(q.shape[1])[q.argmax(1)],
    }
    with np.errstate(all="ignore"):
        compare(policy, _softmax, [(few, 0.5), (few, 2.0), (square, 0.7)], mistakes, 1e-3)
    large = np.array([[1000, 999.875, 999.75, 999.5, 999, 998]], np.float32)
    apart = np.concatenate([large, large - 1000])
    overflows = {
        "You subtract the largest Q-value of the whole batch, and in a state whose values lie far "
        "below it all exponentials become 0. Subtract the maximum of each row.": (
            lambda q, b: _naive_softmax(q, b, q.max())
        ),
        "You subtract something smaller than the maximum of each row. Where the best action lies "
        "far above it, exp still overflows.": (
            lambda q, b: _naive_softmax(q, b, q.mean(1, keepdims=True))
        ),
        "It overflows: exp of 1000 / 0.1 is infinite, and infinity over infinity is nan. Subtract "
        "the state's largest Q-value before you take exp; that changes no probability.": (
            _naive_softmax
        ),
    }
    alone = np.array([[1000, 0, 0, 0, 0, 0]], np.float32)
    with np.errstate(all="ignore"):
        cases = [(large, 0.1), (-large, 0.1), (apart, 0.1), (alone, 0.1)]
        compare(policy, _softmax, cases, overflows, 5e-3)


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
    """A student's ring whose methods are called with items, and talks of them by their numbers."""

    def __init__(self, ring: type, capacity: int):
        self.numbers: dict[tuple, int] = {}
        self.capacity = capacity
        self.ring = self._call(f"Ring({capacity})", lambda: ring(capacity))

    def _call(self, what: str, function):
        try:
            return function()
        except NotImplementedError:
            raise CheckFailed(f"{what.split('(')[0]} is not written yet.") from None
        except Exception as error:
            text = f"{what}{self._when()} stops with {type(error).__name__}: {error}"
            raise CheckFailed(f"{text}. {self._why(what, error)}".strip()) from error

    def _why(self, what: str, error: Exception) -> str:
        """What is probably wrong if a method stops with this error."""
        stored = len(self.numbers)
        if isinstance(error, IndexError) and what.startswith("add"):
            return "A list has only the places that were appended, or made in __init__."
        if isinstance(error, IndexError) and stored < self.capacity:
            return f"So far only {stored} of {self.capacity} places are filled: draw from those."
        if "larger" in str(error):
            return "A sample may be larger than the number of items stored: items may repeat."
        return ""

    def _when(self) -> str:
        if not self.numbers:
            return ""
        items = "1 item" if len(self.numbers) == 1 else f"{len(self.numbers)} items"
        return f" after {items}, with capacity {self.capacity},"

    def add(self, count: int) -> None:
        for _ in range(count):
            number = len(self.numbers)
            item = (f"state {number}", number % 6, number / 10, f"state {number + 1}")
            self.numbers[item] = number
            self._call("add(item)", lambda item=item: self.ring.add(item))

    def sample(self, size: int, seed: int) -> list[int]:
        """The numbers of the items in one sample, 0 for the first ever added."""
        generator = stream(Use.EXERCISE, seed)
        what = f"sample({size}, generator)"
        given = self._call(what, lambda: self.ring.sample(size, generator))
        expect(given is not None, "sample gives back None: is there a `return` at its end?")
        given = self._call(what, lambda: list(given))
        expect(
            len(given) == size,
            f"{what}{self._when()} gives back {len(given)} items, expected {size}: the newest "
            "counts as one of them, and an item may come more than once.",
        )
        numbers = [self._number(item) for item in given]
        for item, number in zip(given, numbers, strict=True):
            expect(
                number >= 0 or (item is not None and not _is_zero(item)),
                f"{what}{self._when()} gives back {item!r}: a place that nothing was stored in "
                "yet. Draw only from those that are filled.",
            )
            expect(
                number >= 0,
                f"{what} gives back {show(item)}, which is none of the items that were added. "
                "Draw places (generator.integers) and take the items from there: "
                "generator.choice makes arrays of them.",
            )
        return numbers

    def _number(self, item) -> int:
        try:
            return self.numbers.get(item, -1)
        except TypeError:  # not even hashable
            return -1


def _is_zero(item) -> bool:
    return np.ndim(item) == 0 and not isinstance(item, str) and item == 0


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
    ax.legend()


@exercise(
    "5.2",
    "A ring buffer with combined replay",
    points=3,
    minutes=20,
    hints=(
        "Keep two things apart: how many places are filled, and where the newest item is. "
        "The places are used in a circle: which operator takes the last one back to the first?",
        "The remainder of a division by the capacity runs in such a circle. While the memory is "
        "not full, only the places filled so far may be drawn; draw places, not items. And of the "
        "size items one is the newest, drawn or not.",
    ),
    figure=_draw_ring,
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
        ring = _Tested(answer, capacity)
        for count in range(1, 3 * capacity + 2):
            ring.add(1)
            _expect_newest(ring, count)
            _expect_stored(ring, count)
    for capacity, count in ((8, 3), (8, 8), (8, 27)):
        ring = _Tested(answer, capacity)
        ring.add(count)
        _expect_uniform(ring, count)
    expect(
        ring.sample(12, 1) == ring.sample(12, 1) != ring.sample(12, 2),
        "All chance must come from the generator that is passed in: same seed, same sample.",
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
    """Besides one newest item, all stored ones are equally likely."""
    samples, size, capacity = 500, 9, ring.capacity
    drawn = Counter(n for seed in range(samples) for n in ring.sample(size, seed))
    drawn[count - 1] -= samples
    stored = range(max(0, count - capacity), count)
    mean = samples * (size - 1) / len(stored)
    if drawn[count - 1] == 0:
        raise CheckFailed(
            "The newest item comes exactly once in each sample. The others must be drawn from all "
            "stored items, the newest included."
        )
    off = max(abs(drawn[n] - mean) for n in stored)
    expect(
        off < 5 * np.sqrt(mean),
        f"After {count} items, with capacity {capacity}, the items besides the newest are not "
        f"equally likely: {dict((n + 1, drawn[n]) for n in stored)} draws by number. Draw each "
        "place from generator.integers(0, number stored).",
    )


def _numbered(items: set[int]) -> str:
    return ", ".join(str(n + 1) for n in sorted(items))


def _target(reward, terminal, discount, online_next, target_next):
    tensors = (torch.tensor(a) for a in (reward, discount * ~terminal, online_next, target_next))
    return ddqn_target(*tensors).numpy()


def _judged(reward, terminal, discount, chooser, judge, masked=True):
    value = judge[np.arange(len(judge)), chooser.argmax(1)]
    return reward + discount * value * (~terminal if masked else 1)


BY_HAND = (  # the table of exercise 5.3, as the arguments of `target`
    np.float32([1, -0.2]),
    np.array([False, True]),
    0.9,
    np.float32([[2, 5, 3], [1, 0, 4]]),
    np.float32([[4, 2, 6], [3, 5, 2]]),
)


def _draw_target(ax):
    reward, terminal, _, online, target = BY_HAND
    places, names = np.arange(2), []
    wrong = reward + 0.9 * target.max(1)
    double = _target(*BY_HAND)
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
    ax.legend()


def _transitions(size: int, seed: int) -> tuple:
    """The arguments of `target` for random transitions, some of them terminal."""
    generator = stream(Use.EXERCISE, seed)
    online = generator.normal(5, 2, (size, 6)).astype(np.float32)
    target = (online + generator.normal(0, 2, (size, 6))).astype(np.float32)
    reward = generator.normal(1, 2, size).astype(np.float32)
    terminal = generator.random(size) < 0.4
    terminal[:2] = True, False
    return reward, terminal, 0.9, online, target


@exercise(
    "5.3",
    "The double-DQN target",
    points=2,
    minutes=12,
    hints=(
        "One network is asked which action is best in the next state, the other what that action "
        "is worth. And what is a next state worth after the episode has ended?",
        "The wrong function lets one network do both. argmax says which action is best; with the "
        "number of that action in each row, look up its worth. And a Boolean counts as 0 or 1 in a "
        "product: which of the two terms falls away at the end?",
    ),
    figure=_draw_target,
)
def double_target(answer) -> None:
    """`target(reward, terminal, discount, online_next, target_next)`: y, (B,) (eq. 10); by hand."""
    expect(
        isinstance(answer, tuple) and len(answer) == 2,
        "Hand over both, the function and your two numbers: ((target, by_hand)).",
    )
    answer, by_hand = answer
    expect(callable(answer), "Hand over the function itself: its name, without brackets behind it.")
    answer = guarded(answer)
    mistakes = {
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
        "The discount multiplies the reward too. Only what comes later is discounted.": (
            lambda r, t, d, online, target: _judged(r * d, t, d, online, target)
        ),
        "The reward is missing.": lambda r, t, d, online, target: _judged(
            0 * r, t, d, online, target
        ),
        "You add the number of the best action (that is what argmax gives), not its Q-value: look "
        "it up in target_next.": (lambda r, t, d, online, target: r + d * online.argmax(1) * ~t),
    }
    slips = {
        "must match the size": "One of them is for each transition, (B,), the other has a number "
        "for each action, (B, 6): pick the best action's first. A single index, target_next[best], "
        "takes rows.",
        "out of bounds": "The first index is the row, the transition; the second the action.",
        "could not be broadcast": "As many rows as columns are needed: torch.arange(B), with B the "
        "number of transitions.",
    }
    _expect_by_hand(by_hand, mistakes)
    target = _with_tensors(answer, slips)
    # More rows than actions come first: `target_next[best]` then has rows to take. As many rows as
    # actions hide a wrong axis.
    cases = [_transitions(size, seed) for seed, size in enumerate((8, 6, 32))]
    shape = target(*cases[0]).shape
    expect(
        shape != (8, 8),
        "You give back a (B, B) matrix. Either target_next[:, best] looks up every action in every "
        "state: torch.arange(B) in place of the colon takes one from each row. Or a column (B, 1) "
        "was added to a row (B,): it needs squeeze(1).",
    )
    expect(
        shape != (8, 6),
        "You give back numbers for all actions, (B, 6). Choose the best action's: one target for "
        "each transition, (B,).",
    )
    compare(target, _target, cases, mistakes)


def _expect_by_hand(by_hand, mistakes) -> None:
    try:
        given = np.array(by_hand, float)
    except (TypeError, ValueError):
        given = np.zeros(0)
    expect(given.shape == (2,), "by_hand is a list of two numbers, the y of each row of the table.")
    right = _target(*BY_HAND)
    wrong = [k for k in range(2) if not close(given[k], right[k])]
    if not wrong:
        return
    for message, mistake in mistakes.items():
        if close(given, mistake(*BY_HAND)):
            raise CheckFailed(f"by_hand: {message}")
    rows = " and ".join(("first", "second")[k] for k in wrong)
    raise CheckFailed(f"by_hand: not yet right in the {rows} row of the table.")


RATE = 0.25


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
    ax.legend()


@exercise(
    "5.4",
    "The soft update, in place",
    points=2,
    minutes=8,
    hints=(
        "In a loop, `t = …` only gives a new tensor the name t. The tensor that the network "
        "holds stays as it was. Which operations of torch change a tensor itself?",
        "Their names end in an underscore: mul_, add_, copy_, lerp_ and others. Go through both "
        "lists together, shrink the target tensor, add the online tensor's share to it, and mind "
        "that the online tensor itself is not changed on the way.",
    ),
    figure=_draw_soft_update,
)
def soft_update_in_place(answer) -> None:
    """`soft_update(target, online, rate)`: lists of tensors; θ̄ ← (1 − τ) θ̄ + τ θ, in place."""
    expect(callable(answer), "Hand over the function itself: its name, without brackets behind it.")
    # What gives back nothing is right here, so the guard around the answer is taken off.
    update = getattr(answer, "__wrapped__", answer)
    target, online = _weights(0), _weights(1)
    tensors, before, kept = list(target), _copies(target), _copies(online)
    returned = _run(update, target, online, RATE)
    expect(
        len(online) == len(kept) and all(map(torch.equal, online, kept)),
        "The online weights have changed. They only give: the target follows them.",
    )
    after = _copies(tensors)
    expected = [(1 - RATE) * old + RATE * new for old, new in zip(before, kept, strict=True)]
    if not _equal(after, expected):
        expect(
            not (_equal(after, before) and isinstance(returned, list | tuple)),
            "The target weights are as they were. Nothing reads what you return: change the "
            "tensors themselves, in place (lerp_, mul_, copy_).",
        )
        _name_what_is_wrong(target, tensors, before, kept, expected)
    for rate in (1.0, 0.0, 0.005):
        expected = [(1 - rate) * t + rate * o for t, o in zip(tensors, online, strict=True)]
        _run(update, target, online, rate)
        expect(
            _equal(tensors, expected),
            f"Right for τ = {RATE}, but not for τ = {rate}: use `rate` in both places.",
        )
    _run(update, target, online, 1.0)
    for tensor in online:
        tensor += 1
    expect(
        not _equal(tensors, online),
        "After an update with τ = 1 target and online share their memory: what changes one of "
        "them later changes the other. Copy the values.",
    )


def _name_what_is_wrong(target, tensors, before, online, expected) -> None:
    """Raise `CheckFailed` for a first update that did not give what was expected."""
    after = _copies(tensors)
    if _equal(after, before):
        in_list = _equal(target, expected)
        raise CheckFailed(
            "The list has new tensors in it, with the right values, but those that the network "
            "holds are as they were. Change the tensors themselves, in place (lerp_, mul_, copy_)."
            if in_list
            else "The target weights are as they were. `t = …` only gives a new tensor the name "
            "t: change the tensor itself, in place (lerp_, mul_, copy_)."
        )
    pairs = list(zip(before, online, strict=True))
    known = {
        "The rates are swapped: τ is the share of the online weights, 1 − τ that of the old "
        "target. With τ = 0.005 yours would jump nearly all the way.": (
            [RATE * old + (1 - RATE) * new for old, new in pairs]
        ),
        "You add τ θ, but do not shrink the old target to 1 − τ of itself: the weights would grow "
        "and grow.": [old + RATE * new for old, new in pairs],
        "You copy the online weights: the target must go only the share τ of the way.": online,
        "The sign of the difference is wrong: the target moves away from the online weights.": (
            [old - RATE * (new - old) for old, new in pairs]
        ),
        "You add θ, not τ θ, to what is left of the target: the two shares must make 1.": (
            [(1 - RATE) * old + new for old, new in pairs]
        ),
        "The target is only shrunk to 1 − τ of itself: τ θ is not added.": (
            [(1 - RATE) * old for old in before]
        ),
    }
    for message, mistake in known.items():
        if _equal(after, mistake):
            raise CheckFailed(message)
    right = [_equal([a], [e]) for a, e in zip(after, expected, strict=True)]
    expect(
        not any(right),
        f"Of {len(right)} tensors {sum(right)} are updated. Is the `return` inside the loop?",
    )
    raise CheckFailed(
        f"With τ = {RATE} a target weight of {before[0][0]:.4g} and an online weight of "
        f"{online[0][0]:.4g} give {after[0][0]:.4g}, expected {expected[0][0]:.4g}."
    )


def _weights(seed: int) -> list[torch.Tensor]:
    generator = stream(Use.EXERCISE, seed)
    return [torch.tensor(generator.normal(0, 1, shape)) for shape in (3, (2, 3), (4, 1, 2))]


def _copies(tensors) -> list[torch.Tensor]:
    return [tensor.detach().clone() for tensor in tensors]


def _equal(some, others) -> bool:
    return all(close(a.detach(), b, 1e-6) for a, b in zip(some, others, strict=True))


def _run(update, target, online, rate):
    try:
        return update(target, online, rate)
    except NotImplementedError:
        raise CheckFailed("soft_update is not written yet.") from None
    except Exception as error:
        raise CheckFailed(
            f"soft_update(target, online, {rate}) stops with {type(error).__name__}: {error}"
        ) from error
