"""A competition for a class: hidden missions, what a submission scores on them, a leaderboard.

A submission flies within walls, where it gets states and gives actions. The missions' seed, the
fading, the score and the board stay in this process, out of its reach.
"""

import json
import os
import secrets
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock

from uavdh_lite.city import load_city
from uavdh_lite.course.walls import Lost, Walled
from uavdh_lite.environment import Environment, State, checked_actions
from uavdh_lite.errors import InputError, one_line
from uavdh_lite.evaluation import Policy, evaluate
from uavdh_lite.policies import known_policies
from uavdh_lite.scenario import find_scenario
from uavdh_lite.storage import read_json, write_json
from uavdh_lite.streams import Use

SCORED = ("collected_and_landed", "landed", "return")


@dataclass(frozen=True)
class Challenge:
    """A fixed set of random missions: `episodes` of a scenario, drawn with a seed.

    With the seed 0 it is the practice set; `hidden` draws a seed that nobody can guess.
    """

    scenario: str = "manhattan"
    episodes: int = 1000
    seed: int = 0

    def __post_init__(self):
        if find_scenario(self.scenario).city.startswith("random:"):
            raise InputError(
                f"scenario {self.scenario}: has many cities; a challenge flies over one"
            )

    @property
    def fingerprint(self) -> str:
        """Which missions these are, without giving away the seed."""
        return sha256(json.dumps([*asdict(self).values()]).encode()).hexdigest()[:16]

    @classmethod
    def hidden(cls, scenario: str, episodes: int) -> "Challenge":
        """A challenge whose seed is drawn by the system; keep its file to yourself."""
        return cls(find_scenario(scenario).name, episodes, 1 + secrets.randbelow(2**63 - 1))

    def save(self, path: Path) -> None:
        """Write it as JSON that only you may read; `InputError` if the file exists."""
        try:
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        except FileExistsError:
            said = f"{path} exists: its missions would be lost; take another name"
            raise InputError(said) from None
        try:
            with open(descriptor, "w", encoding="utf-8") as file:
                json.dump(asdict(self), file, indent=2)
        except BaseException:  # a full disk
            path.unlink()
            raise

    @classmethod
    def load(cls, path: Path) -> "Challenge":
        """Read what `save` wrote; `InputError` that names the file if it is no challenge."""
        try:
            return cls(**json.loads(path.read_text(encoding="utf-8")))
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        except (ValueError, TypeError, AttributeError):
            raise InputError(f"{path}: is not what `challenge new` made") from None


def entry_name(submission: str) -> str:
    """The name of a submission on a board: "alice" for a folder, "alice/my_policy" for a file.

    A planner or shipped agent keeps its own. Raises `InputError` if there is no such submission, if
    it is a link, or if a folder has a planner's or agent's name or one that cannot be printed.
    """
    known, path = known_policies(), Path(submission)
    if submission in known:
        return submission
    if not (path.is_file() or (path / "policy.py").is_file()):
        raise InputError(
            f"submission {submission}: no such file, folder with policy.py, planner or agent"
        )
    if path.is_symlink():
        raise InputError(f"submission {submission}: is a link; score what it leads to")
    place = path.resolve()
    name = place.name if place.is_dir() else f"{place.parent.name}/{place.stem}"
    if name in known or not name.isprintable():
        raise InputError(f"{name!r}: must be printable, and not the name of a planner or an agent")
    return name


class _Pilot(Policy):
    """Asks a submission for each action: a state goes in, numbers come out."""

    def __init__(self, walled: Walled):
        self.walled = walled

    def act(self, state: State) -> np.ndarray:
        return checked_actions(self.walled.call(state), len(state))


def score(
    challenge: Challenge, submission: str, seconds: float = 300, unprotected: bool = False
) -> dict:
    """What a submission scores: each of `SCORED` as mean, low and high, or why it failed.

    Arguments:
        submission: a known policy's name, a checkpoint, a Python file with
            `policy(environment, state)`, or a folder with such a `policy.py`. It can read nothing
            but this file or folder.
        seconds: limit of time, from its start to the last landing.
        unprotected: see `walls.Walled`.
    """
    started = time.time()
    sheet = None if submission in known_policies() else Path(submission).resolve()
    result = {"name": entry_name(submission), "failed": None}
    try:
        with Walled(sheet, unprotected=unprotected) as walled:
            outcome = _flown(walled, challenge, str(walled.sheet or submission), seconds)
    except OSError as error:  # a pipe, a file that nobody may read
        outcome = {"failed": f"cannot be read: {error}"}
    if "failed" in outcome:
        outcome["failed"] = one_line(outcome["failed"])
    taken = round(time.time() - started, 1)
    return {**result, **outcome, "when": time.ctime(started), "seconds": taken}


def _flown(walled: Walled, challenge: Challenge, place: str, seconds: float) -> dict[str, Any]:
    """The scores of what is at a place within the walls, or why it failed."""
    scenario = find_scenario(challenge.scenario)
    environment = Environment(load_city(scenario.city), scenario.channel)
    missions = scenario, challenge.episodes, challenge.seed, Use.CHALLENGE
    late = {"failed": f"took more than {seconds:g} s"}
    walled.begin(seconds)
    try:
        walled.load(place, challenge.scenario)
        metrics = evaluate(environment, _Pilot(walled), *missions).metrics()
        return {one: list(metrics[one]) for one in SCORED}
    except Lost as lost:
        last = walled.said.decode(errors="replace").strip().split("\n")[-1][:300]
        return late if walled.late else {"failed": f"gave no answer: {lost}. {last}"}
    except KeyboardInterrupt as stopped:
        if not hasattr(stopped, "where"):  # Ctrl-C
            raise
        return late
    except InputError as error:
        return {"failed": str(error)}
    except Exception as error:  # one submission's affair: the others are scored
        return {"failed": f"{type(error).__name__}: {error}"}


@contextmanager
def opened(path: Path, challenge: Challenge) -> Iterator[dict]:
    """The leaderboard in a file, or an empty one; `InputError` if it is another challenge's.

    Processes that open one file at once wait for each other.
    """
    board = {"scenario": challenge.scenario, "episodes": challenge.episodes}
    board |= {"fingerprint": challenge.fingerprint, "scores": {}, "failures": []}  # no seed
    with FileLock(f"{path}.lock"):
        if path.exists():
            board = _board(path)
        if board["fingerprint"] != challenge.fingerprint:
            raise InputError(f"{path} is the board of another challenge: take another")
        yield board


def enter(path: Path, board: dict, score: dict) -> dict | None:
    """Enter a score in an `opened` leaderboard and write it, with the newest score of each name.

    Returns the score that it replaces, if any. A failure replaces none.
    """
    before = None
    if score["failed"]:
        board["failures"].append(score)
    else:
        before = board["scores"].get(score["name"])
        board["scores"][score["name"]] = score
    write_json(path, board)
    return before


def leaderboard(path: Path) -> str:
    """A leaderboard as a Markdown table, ranked by the columns from left to right."""
    return _table(_board(path))


def _table(board: dict) -> str:
    practice = Challenge(board["scenario"], board["episodes"]).fingerprint == board["fingerprint"]
    kind = "practice" if practice else "hidden"
    said = f"{board['scenario']}, {board['episodes']} {kind} missions ({board['fingerprint']})"
    lines = [said, "", "| | name | collected and landed | landed | return |", "| --- " * 5 + "|"]
    scores = {name: [-one[it][0] for it in SCORED] for name, one in board["scores"].items()}
    places = sorted(scores.values())
    for name in sorted(scores, key=scores.__getitem__):
        one, rank = board["scores"][name], 1 + places.index(scores[name])
        forms = ("{:.1%} ({:.1%} to {:.1%})",) * 2 + ("{:.1f} ({:.1f} to {:.1f})",)
        cells = [form.format(*one[name]) for form, name in zip(forms, SCORED, strict=True)]
        lines.append(f"| {rank} | {_cell(name)} | {' | '.join(cells)} |")
    failures = board["failures"]
    lines += [f"- failed: {_cell(one['name'])}: {_cell(one['failed'])}" for one in failures]
    return "\n".join(lines)


def _cell(text: str) -> str:
    return one_line(text).replace("|", "&#124;").replace("<", "&lt;")


def _board(path: Path) -> dict:
    """The leaderboard in a file; `InputError` that names the file if it is none, or damaged."""
    board = read_json(path)
    try:
        _table(board)
    except (ValueError, TypeError, LookupError, AttributeError) as error:
        said = f"no leaderboard, or a damaged one ({type(error).__name__}: {error})"
        raise InputError(f"{path}: {said}") from None
    return board
