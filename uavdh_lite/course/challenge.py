"""A competition for a class: hidden missions, what a submission scores on them, a leaderboard.

A submission is trusted code. It runs in a process of its own with a limit of time, as the user who
started it, and may do whatever that user may. Run code of strangers in a container.
"""

import json
import runpy
import secrets
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path

from filelock import FileLock

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import load_city
from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import FunctionPolicy, Policy, evaluate
from uavdh_lite.policies import find_policy, known_policies
from uavdh_lite.scenario import find_scenario
from uavdh_lite.storage import write_json
from uavdh_lite.streams import Use

METRICS = ("collected_and_landed", "landed", "return")


@dataclass(frozen=True)
class Challenge:
    """A fixed set of random missions: `episodes` of a scenario, drawn with a seed.

    With the seed 0 it is the practice set; `hidden` draws a seed that nobody can guess.
    """

    scenario: str = "manhattan"
    episodes: int = 1000
    seed: int = 0

    @classmethod
    def hidden(cls, scenario: str, episodes: int) -> "Challenge":
        """A challenge whose seed is drawn by the system; keep its file to yourself."""
        return cls(find_scenario(scenario).name, episodes, 1 + secrets.randbelow(2**63 - 1))

    def save(self, path: Path) -> None:
        """Write it as JSON; `InputError` if the file exists, for its missions would be lost."""
        if path.exists():
            raise InputError(f"{path} exists: its missions would be lost; take another name")
        write_json(path, asdict(self))

    @classmethod
    def load(cls, path: Path) -> "Challenge":
        """Read what `save` wrote; `InputError` that names the file if it is no challenge."""
        return cls(**_read(path, ["scenario", "episodes", "seed"]))


def score(challenge: Challenge, submission: str, seconds: float = 300) -> dict:
    """What a submission scores: each of `METRICS` as mean, low and high, or why it failed.

    Arguments:
        submission: a known policy's name, a checkpoint, or a Python file with
            `policy(environment, state)`.
        seconds: limit of time of the process that flies it.
    """
    if submission not in known_policies() and not Path(submission).is_file():
        raise InputError(f"submission {submission}: no such file, planner or shipped agent")
    started, result = time.time(), {"name": Path(submission).stem, "failed": None}
    with tempfile.TemporaryDirectory() as folder:
        answer, told = Path(folder, "answer.json"), Path(folder, "told.txt")
        command = [sys.executable, "-m", __name__, submission, json.dumps(asdict(challenge))]
        with told.open("wb") as output, suppress(subprocess.TimeoutExpired):  # no pipe may hang
            subprocess.run([*command, answer], stdout=output, stderr=output, timeout=seconds)
        if answer.exists():
            result |= json.loads(answer.read_text())
        else:
            late = time.time() - started > seconds
            last = told.read_text(errors="replace").strip().split("\n")[-1][:300]
            result["failed"] = f"took more than {seconds:g} s" if late else last or "gave no answer"
    return {**result, "when": time.ctime(started), "seconds": round(time.time() - started, 1)}


def fly_submission(submission: str, challenge: str, answer: str) -> None:
    """What the process of a submission does: fly all missions and write the metrics as JSON."""
    asked = Challenge(**json.loads(challenge))
    scenario = find_scenario(asked.scenario)
    environment = Environment(load_city(scenario.city))
    if submission.endswith(".py"):
        function = runpy.run_path(submission).get("policy")
        if not callable(function):
            raise InputError(f"{submission} has no function policy(environment, state)")
        policy: Policy = FunctionPolicy(lambda state: function(environment, state))
    elif submission in known_policies():
        policy = find_policy(submission, environment)
    else:
        policy = load_agent(submission).over(environment.cities)
    flights = evaluate(environment, policy, scenario, asked.episodes, asked.seed, Use.CHALLENGE)
    write_json(answer, {name: flights.metrics()[name] for name in METRICS})


def enter(path: Path, challenge: Challenge, score: dict) -> None:
    """Enter a score in a leaderboard, a JSON file with the newest score of each name.

    A failure replaces no score. `InputError` if the file is the board of another challenge.
    """
    fingerprint = sha256(json.dumps([*asdict(challenge).values()]).encode()).hexdigest()[:16]
    board = asdict(challenge) | {"fingerprint": fingerprint, "scores": {}, "failures": []}
    del board["seed"]  # it stays hidden: the fingerprint says which missions it is
    with FileLock(f"{path}.lock"):  # processes that write at once wait for each other
        if path.exists():
            board = _read(path, [*board])
        if board["fingerprint"] != fingerprint:
            raise InputError(f"{path} is the board of another challenge: take another")
        if score["failed"]:
            board["failures"].append(score)
        else:
            board["scores"][score["name"]] = score
        write_json(path, board)


def leaderboard(path: Path) -> str:
    """A leaderboard as a Markdown table, the largest share collected and landed first."""
    board = _read(path, ["scenario", "episodes", "fingerprint", "scores", "failures"])
    said = f"{board['scenario']}, {board['episodes']} hidden missions ({board['fingerprint']})"
    lines = [said, "", "| | name | collected and landed | landed | return |", "| --- " * 5 + "|"]
    ranked = sorted(board["scores"].values(), key=lambda one: -one["collected_and_landed"][0])
    for rank, one in enumerate(ranked, 1):
        forms = ("{:.1%} ({:.1%} to {:.1%})",) * 2 + ("{:.1f} ({:.1f} to {:.1f})",)
        cells = [form.format(*one[name]) for form, name in zip(forms, METRICS, strict=True)]
        lines.append(f"| {rank} | {one['name'].replace('|', '/')} | {' | '.join(cells)} |")
    lines += [f"- failed: {one['name']}: {one['failed']}" for one in board["failures"]]
    return "\n".join(lines)


def _read(path: Path, expected: list[str]) -> dict:
    """A JSON object with exactly these keys; `InputError` that names the file otherwise."""
    values = None
    with suppress(OSError, ValueError):
        values = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(values, dict) or set(values) != set(expected):
        raise InputError(f"{path}: expected a JSON object with {', '.join(expected)}")
    return values


if __name__ == "__main__":
    fly_submission(*sys.argv[1:])
