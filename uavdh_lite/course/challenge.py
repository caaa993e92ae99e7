"""A competition for a class: hidden missions, what a submission scores on them, a leaderboard.

A submission flies in a process of its own, in an empty folder, which gets states and gives actions.
The missions' seed, the fading, the score and the board stay in this process, out of its reach. Yet
it runs as the user who started it and may do whatever that user may, so run code of strangers in a
container.
"""

import io
import json
import os
import runpy
import secrets
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import load_city
from uavdh_lite.environment import Environment, State, checked_actions
from uavdh_lite.errors import InputError, one_line
from uavdh_lite.evaluation import FunctionPolicy, Policy, evaluate
from uavdh_lite.policies import find_policy, known_policies
from uavdh_lite.scenario import find_scenario
from uavdh_lite.storage import write_json
from uavdh_lite.streams import Use

SCORED = ("collected_and_landed", "landed", "return")
KEPT = 4096  # bytes of what a submission prints: the end, which says why it failed


@dataclass(frozen=True)
class Challenge:
    """A fixed set of random missions: `episodes` of a scenario, drawn with a seed.

    With the seed 0 it is the practice set; `hidden` draws a seed that nobody can guess.
    """

    scenario: str = "manhattan"
    episodes: int = 1000
    seed: int = 0

    def __post_init__(self):
        if not isinstance(self.scenario, str):
            raise InputError(f"scenario {self.scenario!r}: must be the name of a preset")
        if find_scenario(self.scenario).city.startswith("random:"):
            raise InputError(
                f"scenario {self.scenario}: has many cities; a challenge flies over one"
            )
        for name, least, most in (("episodes", 1, 100_000), ("seed", 0, 2**63 - 1)):
            value = getattr(self, name)
            if type(value) is not int or not least <= value <= most:
                raise InputError(f"{name} {value!r}: must be a whole number, {least} to {most}")

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
        with open(descriptor, "w", encoding="utf-8") as file:
            json.dump(asdict(self), file, indent=2)

    @classmethod
    def load(cls, path: Path) -> "Challenge":
        """Read what `save` wrote; `InputError` that names the file if it is no challenge."""
        values = _read(path, ["scenario", "episodes", "seed"])
        try:
            return cls(**values)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None


def entry_name(submission: str, name: str | None = None) -> str:
    """The name of a submission on a board: `name`, or folder and file as in "alice/my_policy".

    A planner or shipped agent keeps its own. Raises `InputError` if there is no such submission,
    or a file is to have a planner's or agent's name or one that cannot be printed.
    """
    known = known_policies()
    if submission not in known and not Path(submission).is_file():
        raise InputError(f"submission {submission}: no such file, planner or shipped agent")
    if submission in known and name is None:
        return submission
    place = Path(submission).resolve()
    name = f"{place.parent.name}/{place.stem}" if name is None else name
    if name in known or not name.strip() or not name.isprintable():
        raise InputError(f"name {name!r}: must be printable, and not that of a planner or an agent")
    return name


class _Pilot(Policy):
    """Asks a submission's process for each action: states go in, a byte an episode comes out."""

    def __init__(self, process: subprocess.Popen):
        self.process = process

    def act(self, state: State) -> np.ndarray:
        buffer = io.BytesIO()
        np.savez(buffer, **vars(state))  # type: ignore[arg-type]
        question = buffer.getvalue()
        self.process.stdin.write(len(question).to_bytes(8, "big") + question)  # type: ignore[union-attr]
        self.process.stdin.flush()  # type: ignore[union-attr]
        answer = np.frombuffer(self.process.stdout.read(len(state)), np.uint8)  # type: ignore[union-attr]
        if len(answer) < len(state):
            raise EOFError
        return answer


def score(
    challenge: Challenge, submission: str, seconds: float = 300, name: str | None = None
) -> dict:
    """What a submission scores: each of `SCORED` as mean, low and high, or why it failed.

    Arguments:
        submission: a known policy's name, a checkpoint, or a Python file with
            `policy(environment, state)`, which may import files beside it. Its working folder is
            an empty one.
        seconds: limit of time for its process, from its start to the last landing.
        name: see `entry_name`.
    """
    outcome: dict[str, Any] = {}
    started, said = time.time(), bytearray()
    result = {"name": entry_name(submission, name), "file": None, "failed": None}
    if submission not in known_policies():
        result["file"] = submission = str(Path(submission).resolve())
    scenario = find_scenario(challenge.scenario)
    environment = Environment(load_city(scenario.city), scenario.channel)
    own = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
    process = subprocess.Popen(
        [sys.executable, "-m", __name__, submission, challenge.scenario, own.name],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )

    def listen() -> None:
        with process.stderr as stream:  # type: ignore[union-attr]
            while part := stream.read1(KEPT):  # type: ignore[union-attr]
                said.extend(part)
                del said[:-KEPT]

    def fly() -> None:
        missions = scenario, challenge.episodes, challenge.seed, Use.CHALLENGE
        try:
            with process.stdout, process.stdin:  # type: ignore[union-attr]
                metrics = evaluate(environment, _Pilot(process), *missions).metrics()
            outcome.update({one: list(metrics[one]) for one in SCORED})
        except (EOFError, OSError):
            outcome["failed"] = ""  # it has ended: what it said last is the reason
        except InputError as error:
            outcome["failed"] = str(error)
        except Exception as error:  # one submission's affair: the others are scored
            outcome["failed"] = f"{type(error).__name__}: {error}"

    # Threads that nobody has to wait for: a pipe may stay open in what a submission has started
    listener, pilot = (threading.Thread(target=work, daemon=True) for work in (listen, fly))
    try:
        listener.start()
        pilot.start()
        ends = time.monotonic() + seconds
        while pilot.is_alive() and process.poll() is None and time.monotonic() < ends:
            pilot.join(min(0.1, seconds))
        if ended := process.poll() is not None:
            pilot.join(5)  # for what is left in the pipe, if no other process keeps that open
        unfinished = pilot.is_alive()
    finally:  # also after Ctrl-C
        with suppress(ProcessLookupError):
            os.killpg(process.pid, 9) if hasattr(os, "killpg") else process.kill()
        process.wait()
        own.cleanup()
    listener.join(1)
    if unfinished:
        outcome = {"failed": "" if ended else f"took more than {seconds:g} s"}
    if outcome.get("failed") == "":
        last = said.decode(errors="replace").strip().split("\n")[-1][:300]
        outcome["failed"] = last or "gave no answer"
    if "failed" in outcome:
        outcome["failed"] = one_line(outcome["failed"])
    taken = round(time.time() - started, 1)
    return {**result, **outcome, "when": time.ctime(started), "seconds": taken}


def _serve(submission: str, scenario: str, folder: str) -> None:
    """What the process of a submission does: answer each state with actions until nobody asks."""
    os.chdir(folder)  # here, because the package itself may be found by the folder before
    questions, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)  # what it reads and prints is its own affair
    os.dup2(2, 1)
    environment = Environment(load_city(find_scenario(scenario).city))
    if submission in known_policies():
        policy = find_policy(submission, environment)
    elif submission.lower().endswith(".py"):
        sys.path.insert(0, str(Path(submission).resolve().parent))  # as `python FILE` has it
        function = runpy.run_path(submission).get("policy")
        if not callable(function):
            raise InputError(f"{submission} has no function policy(environment, state)")
        policy = FunctionPolicy(lambda state: function(environment, state))
    else:
        policy = load_agent(submission).over(environment.cities)
    flying: Policy | None = None
    while size := questions.read(8):
        content = io.BytesIO(questions.read(int.from_bytes(size, "big")))
        with np.load(content, allow_pickle=False) as arrays:
            state = State(**arrays)
        flying = flying or policy.begin(state)
        answers.write(checked_actions(flying.act(state), len(state)).astype(np.uint8).tobytes())
        answers.flush()


@contextmanager
def opened(path: Path, challenge: Challenge) -> Iterator[dict]:
    """The leaderboard in a file, or an empty one; `InputError` if it is another challenge's.

    It is read here and never again, and written once more in the end, because a submission that
    flies meanwhile may write the file. Processes that open one file at once wait for each other.
    """
    empty = {"scenario": challenge.scenario, "episodes": challenge.episodes}
    empty |= {"fingerprint": challenge.fingerprint, "scores": {}, "failures": []}  # no seed
    with FileLock(f"{path}.lock"):
        board = _board(path) if path.exists() else empty
        if board["fingerprint"] != challenge.fingerprint:
            raise InputError(f"{path} is the board of another challenge: take another")
        try:
            yield board
        finally:  # also after Ctrl-C
            if board["scores"] or board["failures"]:
                write_json(path, board)


def enter(path: Path, board: dict, score: dict, replace: bool = False) -> dict | None:
    """Enter a score in an `opened` leaderboard and write it, with the newest score of each name.

    Returns the score that it replaces, if any. A failure replaces none. Raises `InputError` if the
    name is that of another file's score, unless `replace` is given.
    """
    file = score["file"]
    with suppress(ValueError):  # on another drive
        file = file and Path(os.path.relpath(file, path.resolve().parent)).as_posix()
    before = board["scores"].get(score["name"])
    if before and before["file"] != file and not replace:
        said = f"{path} has a score of {score['name']}, from {one_line(before['file'])}"
        raise InputError(f"{said}: give {file} another --name")
    if score["failed"]:
        board["failures"].append({**score, "file": file})
    else:
        board["scores"][score["name"]] = {**score, "file": file}
    write_json(path, board)
    return None if score["failed"] else before


def leaderboard(path: Path) -> str:
    """A leaderboard as a Markdown table, ranked by the columns from left to right."""
    board = _board(path)
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
        lines.append(f"| {rank} | {_cell(one['name'])} | {' | '.join(cells)} |")
    failures = board["failures"]
    lines += [f"- failed: {_cell(one['name'])}: {_cell(one['failed'])}" for one in failures]
    return "\n".join(lines)


def _cell(text: str) -> str:
    return one_line(text).replace("|", "&#124;")


def _board(path: Path) -> dict:
    """The leaderboard in a file; `InputError` that names the file if it is none."""
    board = _read(path, ["scenario", "episodes", "fingerprint", "scores", "failures"])
    try:
        Challenge(board["scenario"], board["episodes"])
        scores, failures = list(board["scores"].values()), board["failures"]
        texts = [board["fingerprint"], *(one["failed"] for one in failures)]
        for one in scores + failures:
            texts += [one["name"], one["when"], one["file"] or ""]
        rows = [one[name] for one in scores for name in SCORED]
        numbers = [number for row in rows for number in row if len(row) == 3]
        whole = all(type(text) is str for text in texts) and len(numbers) == 3 * len(rows)
        whole = whole and all(type(n) in (int, float) and abs(n) < 1e9 for n in numbers)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except (AttributeError, KeyError, TypeError):
        whole = False
    if not whole:
        said = "each score needs name, when, file, failed and three numbers of each measure"
        raise InputError(f"{path}: no leaderboard: {said}")
    return board


def _read(path: Path, expected: list[str]) -> dict:
    """A JSON object with exactly these keys; `InputError` that names the file otherwise."""
    values = None
    with suppress(OSError, ValueError, RecursionError):
        values = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(values, dict) or set(values) != set(expected):
        raise InputError(f"{path}: expected a JSON object with {', '.join(expected)}")
    return values


if __name__ == "__main__":
    _serve(*sys.argv[1:])
