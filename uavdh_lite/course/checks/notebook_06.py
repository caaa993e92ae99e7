"""Exercises of notebook 6, from Q-learning to DDQN: the parts of a DQN, one after the other."""

from types import SimpleNamespace

import numpy as np
import torch

from uavdh_lite.course.checks.exercise import CheckFailed, exercise
from uavdh_lite.course.checks.learning import Watched
from uavdh_lite.course.checks.values import show
from uavdh_lite.course.small_city import (
    CELLS,
    START,
    flights_of,
    learn_network,
    learn_table,
    small_city,
)
from uavdh_lite.environment import MOVES
from uavdh_lite.streams import Use, stream


def there_and_back():
    """A city with one flight, in which each step pays, whatever it does."""
    places = (3, 1), START, (3, 1), (3, 2)
    left = iter(zip(places, (1.0, 2.0, 4.0, 8.0), (False, False, False, True), strict=True))
    return lambda cell, action: next(left)


def table_values(
    learn, flights, gamma, alpha, device=(0, 3), price=0.2, moves=MOVES[:4], start=START
):
    """The table that an answer learns, (4, 4, 4); of a single flight its largest values, (4, 4)."""
    place, over, steps, drawn = start, True, 0, [0] * 4
    city = there_and_back() if moves is None else small_city(device, price, moves)

    def step(cell, action):
        nonlocal place, over, steps
        if tuple(cell) != (start if over else place):
            raise CheckFailed(_astray(place, over, cell, start))
        place, reward, over = city(cell, action)
        drawn[action] += 1
        steps = 0 if over else steps + 1
        if steps > LONGEST:
            said = f"A flight of {LONGEST:,} steps has not ended. Is each of the four moves drawn?"
            raise CheckFailed(said)
        return place, reward, over

    q = np.asarray(learn(step, start, flights, gamma, alpha, stream(Use.EXERCISE, 0)))
    if q.shape != (4, 4, 4):
        raise CheckFailed(f"Return the table, an array of shape (4, 4, 4), not {show(q)}.")
    if not over:
        raise CheckFailed(_astray(place, over, None, start))
    if ((np.array(drawn) - sum(drawn) / 4) ** 2).sum() > 12 * sum(drawn):  # chance: once in 1e9
        said = f"In {flights} flights the moves 0 to 3 are drawn {drawn} times"
        raise CheckFailed(f"{said}. All must be equally likely in each step.")
    return q if flights > 1 else q.max(axis=2)


def _astray(place, over, cell, start):
    """What is said if a step does not begin where the flight is."""
    if not over:
        begins = "you stop" if cell is None else f"the next step begins at {tuple(cell)}"
        said = f"A flight is at {place} and has not ended, but {begins}. Let the next cell become"
        return f"{said} the current one, and fly on until `ended`."
    if tuple(cell) == place:
        return f"The flight had ended at {place}, but you flew on: check `ended`."
    return f"A flight begins at {tuple(cell)}. Each one must begin in `start`, {start}."


def learned(learn, seed):
    """The table of 30 flights, and the moves that were flown for it."""
    city, moves = small_city(), []

    def step(cell, action):
        moves.append(action)
        return city(cell, action)

    return np.array(learn(step, START, 30, 0.9, 0.05, stream(Use.EXERCISE, seed))), moves


def learns_otherwise(learn) -> str:
    """By the generator's chance alone, and with the same α in every step that was flown."""
    (one, moves), (other, _), (again, _) = (learned(learn, seed) for seed in (1, 2, 1))
    if np.any(one != again) or np.all(one == other):
        return "All random numbers must come from the generator that is passed in."
    left = iter(moves)
    same = SimpleNamespace(integers=lambda _: next(left))
    right, _ = learned(lambda *case: learn_table(*case[:5], same), 1)
    if np.allclose(one, right, 1e-3, 1e-3):
        return ""
    return "Every step moves its entry by the share α of the way to y, in the last flight, too."


def called_table(flights, gamma, alpha, *more):
    said = f"After {flights} flight{'s' * (flights > 1)} with γ = {gamma} and α = {alpha}"
    value = "Q-value [row, column, action]" if flights > 1 else "largest Q-value [row, column]"
    return f"{said}, the table's {value}"


LONGEST = 20_000  # steps of a random flight: it has hardly ever 500
EASTWARD = (3, 3), 0.0, 4 * [(0, 1)]  # device, price and moves: whatever it does, it goes east


@exercise(
    "6.1 · A table that learns (3 points, 25 minutes)",
    rules={
        "In a street where every action leads east, only the last cell learns in one flight: its "
        "entry goes the share α of the way to y = 10, and all others stay 0. Learn in each step.": [
            (1, 0.95, 1.0, *EASTWARD), (1, 0.95, 0.25, *EASTWARD), (1, 0.5, 0.5, *EASTWARD),
        ],
        "y is the reward plus γ times the largest Q-value of the next cell. With γ = 0.95, "
        "the start is worth 6.7 in the end.": [(200, 0.95, 0.5), (200, 0.95, 1.0), (200, 1.0, 0.5)],
        "With another γ, a device elsewhere or another cost per step, the values are different. "
        "A step may also pay: it is `ended` that says that an episode ends, not the reward.": [
            (200, 0.5, 0.5), (200, 0.9, 0.5, (1, 1), 0.5), (200, 0.0, 0.8, (2, 3), 1.0),
            (200, 0.5, 0.5, (0, 3), -0.5),
        ],
        "A flight goes from (3, 0) to (3, 1), back, to (3, 1) again and on to (3, 2), where it "
        "ends; the steps earn 1, 2, 4 and 8. Each step learns from the table as it is by then.": [
            (1, 0.5, 1.0, (3, 2), -1.0, None),
        ],
        "If the episode ended with this step, y is the reward alone. That matters where flights "
        "start in the device's cell, as here, so that Q has values there, too.": [
            (200, 0.95, 0.5, (0, 3), 0.2, MOVES[:4], (0, 3)),
        ],
    },
    ask=table_values,
    call=called_table,
    also=learns_otherwise,
    tolerance=0.01,
    smallest=0.03,
)
def learned_table(step, start, flights, gamma, alpha, generator):
    """`learn_table(step, start, flights, gamma, alpha, generator)`: Q, (4, 4, 4)."""
    return learn_table(step, start, flights, gamma, alpha, generator)


EXPLODED = 60.0  # no cell is worth more than 10


def network_values(learn, seed, *case):
    """The largest Q-value of each cell that a network learns from the steps of 100 flights, (4, 4).

    Infinite if it has exploded; nan at the device, since no step begins there.
    """
    torch.manual_seed(seed)
    np.random.seed(seed)  # noqa: NPY002 (an answer may draw its minibatches with it)
    *constants, device, price = case
    memory, updates = flights_of(small_city(device, price), 100), 1000 + 50 * seed
    if price > 1:  # the step to the device is not told by its reward
        memory[:, 3] = -price
    with Watched(*constants[1:]) as watched:
        network = learn(memory, *constants, updates)
    if not callable(network):
        raise CheckFailed(f"Return the network. You returned {show(network)}.")
    module = isinstance(network, torch.nn.Module)
    q = network(CELLS.to(next(network.parameters(), CELLS).dtype) if module else CELLS)
    if np.shape(q) != (16, 4):
        raise CheckFailed(
            f"For 16 cells your network gives {show(q)}, not a tensor of shape (16, 4)."
        )
    if module and not watched.trained(network):
        raise CheckFailed("The network that you return is not the trained one: return `online`.")
    if watched.losses % updates:
        said = f"For updates = {updates:,} `backward` is called {watched.losses:,} times"
        raise CheckFailed(f"{said}: make as many steps of gradient descent as `updates` says.")
    largest = q.detach().amax(1).reshape(4, 4).float()
    largest[largest > EXPLODED] = np.inf
    largest[device] = np.nan
    return largest


def exact_network(memory, gamma):
    """What a network comes close to: the Q-values of a table, learned until nothing changes."""
    cell, action, reward, after, ended = memory.split([2, 1, 1, 2, 1], dim=1)
    (row, col), (to_row, to_col) = cell.long().T, after.long().T
    q = torch.zeros(4, 4, 4)
    for _ in range(99):
        y = reward[:, 0] + gamma * (1 - ended[:, 0]) * q[to_row, to_col].amax(1)
        q[row, col, action[:, 0].long()] = y
    return lambda cells: q[cells[:, 0].long(), cells[:, 1].long()]


def called_network(seed, gamma, *more):
    tau = f", τ = {more[0]}" if len(more) == 3 else ""
    return f"With γ = {gamma}{tau}, seed {seed}, the largest Q-value of a cell [row, column]"


def draw_explosion(ax, solution):
    memory, updates = flights_of(small_city(), 100), range(0, 601, 150)
    for seed in range(2):
        values = []
        for count in updates:
            torch.manual_seed(seed)
            values.append(learn_network(memory, 0.95, 1.0, count)[0](CELLS)[12].max().item())
        ax.plot(updates, values, "o-", label=f"seed {seed}")
    ax.axhline(6.7, color="gray", label="right: 6.7")
    ax.set(xlabel="updates", ylabel="value of the start", yscale="symlog", title="γ = 0.95")


@exercise(
    "6.2 · A network in the table's place (3 points, 25 minutes)",
    figure=draw_explosion,
    rules={
        "y is the reward plus γ times the largest Q-value of the next cell; after the end nothing "
        "follows, and y is the reward alone. Only the Q-value of the action that was taken moves "
        "towards y.": [
            (0, 0.5, (0, 3), 0.2),
        ],
        "With another γ or a device elsewhere, the values are different. Only `ended` says that "
        "nothing follows: here every step costs 2, and so does the last one.": [
            (1, 0.7, (0, 0), 2.0)
        ],
    },
    ask=network_values,
    call=called_network,
    tolerance=0.1,
    smallest=1.2,
)
def learned_network(memory, gamma, updates):
    """`learn_network(memory, gamma, updates)`: a network from (B, 2) cells to (B, 4) Q-values."""
    return exact_network(memory, gamma)


def draws(ring: type, capacity: int, added: int, size: int, count: int = 1, seed: int = 0):
    """The numbers of the items in so many samples, 1 for the first added; another ring has more."""
    items = [(np.full(2, n % 3), n % 6, n / 10, f"state {n % 4}") for n in range(added)]
    elsewhere = [(item,) for item in items]
    numbers = {id(item): number for number, item in enumerate(items, 1)}
    own, other, generator = ring(capacity), ring(3), stream(Use.EXERCISE, seed)
    for number, item in enumerate(items):
        own.add(item)
        other.add(elsewhere[number])
        if 2 * number == added - added % 2:  # as in a training, which goes on adding
            own.sample(2, stream(Use.EXERCISE, 7))
    samples = [list(own.sample(size, generator)) for _ in range(count)]
    for sample in samples:
        strange = [item for item in sample if id(item) not in numbers]
        if len(sample) != size or strange:
            said = f"{asked(capacity, added, size)} returns"
            if len(sample) != size:
                said = f"{said} a list of length {len(sample)}, expected {size}. An item may come "
                raise CheckFailed(f"{said}more than once: draw size − 1 places and add the newest.")
            if any(others is strange[0] for others in elsewhere):
                said = f"{said} an item that was put into another ring"
                raise CheckFailed(f"{said}: give each ring its own list, in `__init__`.")
            said = f"{said} {show(strange[0])}, which was never added. Return the very tuples"
            raise CheckFailed(f"{said} that were added, not copies or parts of them.")
    return [[numbers[id(item)] for item in sample] for sample in samples]


Unquoted = type("Unquoted", (str,), {"__repr__": str.__str__})  # as it stands in a message


def items_drawn(ring, *case):
    numbers = sorted(set(*draws(ring, *case)))
    return Unquoted(f"item{'s' * (len(numbers) > 1)} {', '.join(map(str, numbers))}")


def asked(capacity, added, size):
    return f"Ring({capacity}), after {added} × add(item), sample({size}, generator)"


def wrong_chance(ring: type) -> str:
    """Besides one newest item all are equally likely; a right answer fails once in 1e7."""
    one, again, other = (draws(ring, 8, 8, 60, seed=seed) for seed in (1, 1, 2))
    if one != again or one == other:
        return "All random numbers must come from the generator that is passed in."
    for capacity, added, limit in ((8, 3, 37.0), (8, 27, 52.0), (8, 8, 52.0)):
        drawn, stored = np.array(draws(ring, capacity, added, 9, 600)), min(capacity, added)
        counts = np.bincount(drawn.ravel())[-stored:] - 600 * (np.arange(stored) == stored - 1)
        if not (drawn == added).any(1).all():
            return "A sample of 1 is the newest item, but larger samples do not always contain it."
        if ((counts - counts.mean()) ** 2).sum() / counts.mean() > limit:
            said = f"After {added} items, the random places hold those stored, oldest first, "
            return f"{said}{counts.tolist()} times: all must be equally likely."
        different = [len(set(sample)) for sample in draws(ring, capacity, added, 3, 1800)]
        right = 1 + (stored - 1) * (1 - (1 - 1 / stored) ** 2)
        if abs(np.mean(different) - right) > 6 * np.std(different) / 1800**0.5 + 1e-9:
            return "Draw every place independently: generator.integers(0, number stored, size − 1)."
    return ""


@exercise(
    "6.3 · A replay memory (3 points, 20 minutes)",
    rules={
        "The newest item is in every sample, so a sample of 1 is the newest item alone.": [
            (5, added, 1) for added in range(1, 5)
        ],
        "When the ring is full, each new item still goes in and takes the place of the oldest, so "
        "the newest is no longer at the end: it is one place before the one to be overwritten "
        "next.": [
            (size, added, 1) for size, most in ((5, 17), (1, 4)) for added in range(size, most)
        ],
        "The other items of a sample are drawn from all stored ones, only from places that are "
        "filled, and may come more than once.": [(5, added, 300) for added in range(1, 6)],
        "When the ring is full, each new item must overwrite the oldest, and no other: the ring "
        "does not grow. generator.integers already leaves out its upper end.": [
            (1, 3, 60), (3, 8, 200), (7, 22, 420)
        ]
        + [(5, added, 300) for added in range(6, 17)],
    },
    takes=type,
    ask=items_drawn,
    call=asked,
    also=wrong_chance,
)
class ring_buffer:
    """The class `Ring(capacity)` with `add(item)` and `sample(size, generator)`."""

    def __init__(self, capacity):
        self.capacity, self.items, self.newest = capacity, [], -1

    def add(self, item):
        self.newest = (self.newest + 1) % self.capacity
        self.items[self.newest : self.newest + 1] = [item]

    def sample(self, size, generator):
        rest = generator.integers(0, len(self.items), size - 1)
        return [self.items[k] for k in (self.newest, *rest)]


@exercise(
    "6.4 · A target network (2 points, 20 minutes)",
    rules={
        "y comes from the target network. With τ = 0 it stays what it was at the start, so y is "
        "the reward, plus a guess near 0: up to 2 more or less is right.": [
            (0, 0.9, 0.0, (0, 3), 1.0),
        ],
        "After each update every weight of the target network becomes (1 − τ) times itself plus τ "
        "times the online one. Then nothing explodes, and the start is worth 6.7.": [
            (0, 0.95, 0.05, (0, 3), 0.2),
        ],
    },
    ask=network_values,
    call=called_network,
    tolerance=0.1,
    smallest=2.0,
)
def learned_calmly(memory, gamma, tau, updates):
    """`learn_calmly(memory, gamma, tau, updates)`: the network of 6.2, with a target network."""
    return exact_network(memory, gamma if tau else 0.0)


def value(chooser, judge):
    return judge.gather(1, chooser.argmax(1, True)).squeeze(1)


def transitions(size, discount, ends=0.4, at=5.0, kind=np.float32, apart=2.0):
    """Arguments of `target` for so many transitions, with Q-values near `at`."""
    generator = stream(Use.EXERCISE, 10 * size + int(10 * discount))
    online = generator.normal(at, apart, (size, 6)).round(2 if apart > 1 else 6)
    target = generator.normal(at, 3, (size, 6)).round(2)
    reward, terminal = generator.normal(1, 2, size).round(2), generator.random(size) < ends
    reward, online, target = (torch.tensor(a.astype(kind)) for a in (reward, online, target))
    return reward, torch.tensor(terminal), discount, online, target


@exercise(
    "6.5 · The double-DQN target (2 points, 10 minutes)",
    rules={
        "There is one target for each transition, (B,): the reward, plus γ times the entry of "
        "target_next, in the same row, for the action that online_next rates highest.": [
            (1, 1.0, 0), (2, 1.0, 0), (8, 1.0, 0), (3, 1, 0, 5.0, np.float64),
            (4, 1.0, 0, -50.0), (2, 1.0, 0, 1.0, np.float32, 1e-4),
        ],
        "The value of the next state is multiplied by the γ that is handed in; the reward "
        "counts in full.": [(2, 0.5, 0), (2, 0.99, 0), (2, 0.0, 0), (2, 1, 0)],
        "At a terminal transition the target is the reward alone. Elsewhere the next state "
        "counts.": [
            (1, 0.9, 2), (1, 1.0, 2), (2, 0.8), (6, 0.8), (32, 0.8), (7, 0.8),
        ],
    },
    mistakes={
        "That is the wrong function: one network both chooses and judges, and a value is added "
        "after the end of an episode.": lambda r, t, d, online, target: r + d * target.amax(1),
        "You take the largest Q-value of the target network: that is the target of plain DQN, "
        "with its bias. The online network must choose the action.": (
            lambda r, t, d, online, target: r + d * target.amax(1) * ~t
        ),
        "The networks are swapped: the online network must choose the action (argmax), and the "
        "target network must say what it is worth.": (
            lambda r, t, d, online, target: r + d * value(target, online) * ~t
        ),
    },
    tolerance=1e-5,
    smallest=1e-5,
    case=transitions,
)
def double_target(reward, terminal, discount, online_next, target_next):
    """`target(reward, terminal, discount, online_next, target_next)`: y, (B,) (eq. 8)."""
    return reward + discount * value(online_next, target_next) * ~terminal


def draw_policy(ax, policy):
    q_values = torch.tensor([[1000, 999.75, 999.5, 999, 998, 997]])
    for k, temperature in enumerate((0.1, 0.5, 2.0)):
        shares = policy(q_values, temperature)[0].numpy()
        ax.bar(np.arange(6) + 0.27 * (k - 1), shares, 0.27, label=f"β = {temperature}")
    ax.set_xticks(range(6), q_values[0].tolist())
    ax.set(xlabel="Q-value of an action", ylabel="probability")


def few(count, temperature, kind=torch.float32):
    """Q-values of so many states, and a temperature."""
    rows = stream(Use.EXERCISE, count).integers(-8, 9, (count, 6)) / 4
    return torch.tensor(rows, dtype=kind), temperature


def rows(temperature, *several):
    return torch.tensor(np.array(several, np.float32)), temperature


NEAR = np.array([1000, 999.875, 999.75, 999.5, 999, 998], np.float32)


@exercise(
    "6.6 · A softmax that does not overflow (2 points, 10 minutes)",
    figure=draw_policy,
    rules={
        "Each row is exp(Q/β), divided by the sum of its own row (dim=1), so that it sums to 1; "
        "keepdim=True makes a column of the sums.": [
            few(1, 1.0), few(2, 1.0), few(5, 1, torch.float64), few(6, 1),
        ],
        "Divide Q by β inside exp: a small β makes the best action likelier, and a large one makes "
        "all about equally likely.": [few(1, 0.25), few(2, 2.0), few(6, 0.7), few(3, 40.0)],
        "No exponent may be above 0, since exp(1000 / 0.1) is infinite: it overflows, and infinity "
        "over infinity is nan. Subtract the state's largest Q-value first; that changes no "
        "probability.": [rows(0.125, NEAR), rows(0.125, NEAR[::-1])],
        "All Q-values of a state may be far below 0. Then every exp(Q/β) is 0, and 0/0 is nan. "
        "Subtract the maximum first.": [rows(0.125, -NEAR), rows(0.1, [-1000.0] * 6)],
        "Within a row the best action may be far above the others, whichever it is: subtract the "
        "maximum of the row, and nothing smaller than the maximum.": [
            rows(0.1, [0.0, 0, 0, 1000, 0, 0]), rows(0.1, [1000.0, 0, 0, 0, 0, 0]),
            rows(0.5, [0.0, -1000, 1000, 0, 1000, 0]),
        ],
        "Rows of a batch may be far apart: subtract from each row its own maximum.": [
            rows(0.125, NEAR, NEAR - 1000), rows(0.125, NEAR - 1500, NEAR, 0 * NEAR),
        ],
    },
    mistakes={
        "These are the logarithms of the probabilities.": (
            lambda q, beta: torch.log_softmax(q / beta, 1)
        ),
    },
    tolerance=1e-3,  # float32 at −10,000
    smallest=1e-7,
)
def stable_policy(q_values, temperature):
    """`policy(q_values, temperature)`: the softmax policy (eq. 10), (B, 6), for any Q-values."""
    return torch.softmax(q_values / temperature, 1)
