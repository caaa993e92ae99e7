"""A competition for a class: hidden missions, what a submission scores on them, a leaderboard.

A submission is trusted code. It runs in a process of its own with a limit of time, as the user who
started it, and may do whatever that user may. Run code of strangers in a container.
"""

import hashlib
import json
import os
import runpy
import secrets
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from filelock import FileLock

from uavdh_lite.city import load_city
from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import FunctionPolicy, Policy, evaluate
from uavdh_lite.policies import find_policy, known_policies
from uavdh_lite.scenario import find_scenario
from uavdh_lite.storage import write_json
from uavdh_lite.streams import Use

METRICS = ("collected_and_landed", "landed", "return")
PRACTICE_SEED = 0


@dataclass(frozen=True)
class Challenge:
    """A fixed set of random missions: `episodes` of a scenario, drawn with a seed.

    Their random stream is neither that of training nor of the tests. With the seed 0 it is the
    practice set that everybody has; `hidden` draws a seed that nobody can guess.
    """

    scenario: str = "manhattan"
    episodes: int = 1000
    seed: int = PRACTICE_SEED

    @classmethod
    def hidden(cls, scenario: str, episodes: int) -> "Challenge":
        """A challenge whose seed is drawn by the system; keep its file to yourself."""
        find_scenario(scenario)
        return cls(scenario, episodes, 1 + secrets.randbelow(2**63 - 1))

    @property
    def fingerprint(self) -> str:
        """Says which set of missions it is, without giving the seed away."""
        return hashlib.sha256(json.dumps([*asdict(self).values()]).encode()).hexdigest()[:16]

    def save(self, path: Path) -> None:
        """Write it as JSON; `InputError` if the file exists, for its missions would be lost."""
        if path.exists():
            raise InputError(f"{path} exists: its missions would be lost; take another name")
        write_json(path, asdict(self))

    @classmethod
    def load(cls, path: Path) -> "Challenge":
        """Read what `save` wrote; `InputError` that names the file if it is no challenge."""
        return cls(**_read(path, {"scenario", "episodes", "seed"}))


def score(challenge: Challenge, submission: str, seconds: float = 300) -> dict:
    """What a submission scores: each of `METRICS` as mean, low and high, or why it failed.

    Arguments:
        submission: a known policy's name, a checkpoint, or a Python file with
            `policy(environment, state)`.
        seconds: limit of time of the process that flies it.
    """
    path, known = Path(submission), submission in known_policies()
    if not known and not path.is_file():
        raise InputError(f"submission {submission}: no such file, planner or shipped agent")
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        answer, told = Path(folder, "answer.json"), Path(folder, "told.txt")
        arguments = [submission if known else str(path.resolve()), json.dumps(asdict(challenge))]
        with told.open("wb") as output:
            process = subprocess.Popen(
                [sys.executable, "-m", __name__, *arguments, str(answer)],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                start_new_session=True,  # so that what it starts ends with it
            )
        try:
            process.wait(seconds)
            failed = None if process.returncode == 0 and answer.exists() else _last_line(told)
        except subprocess.TimeoutExpired:
            failed = f"took more than {seconds:g} s"
        finally:
            _end(process)
        metrics = {} if failed else json.loads(answer.read_text())
    return {
        "name": submission if known else path.stem,
        "sha256": None if known else hashlib.sha256(path.read_bytes()).hexdigest(),
        "when": datetime.now(UTC).isoformat(timespec="seconds"),
        "seconds": round(time.perf_counter() - started, 1),
        "failed": failed,
        **metrics,
    }


def _last_line(told: Path) -> str:
    lines = told.read_text(errors="replace").strip().splitlines()
    return lines[-1][:300] if lines else "ended without an answer"


def _end(process: subprocess.Popen) -> None:
    """Kill a process and, where the system has sessions, all that it started."""
    if hasattr(os, "killpg"):
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    process.kill()
    process.wait()


def submitted(path: str, environment: Environment) -> Policy:
    """The policy of a Python file with `policy(environment, state)`."""
    function = runpy.run_path(path).get("policy")
    if not callable(function):
        raise InputError(f"{Path(path).name} has no function policy(environment, state)")
    return FunctionPolicy(partial(function, environment))


def fly_submission(submission: str, challenge: str, answer: str) -> None:
    """What the process of a submission does: fly all missions and write the metrics as JSON."""
    asked = Challenge(**json.loads(challenge))
    scenario = find_scenario(asked.scenario)
    environment = Environment(load_city(scenario.city))
    policy: Policy
    if submission.endswith(".py"):
        policy = submitted(submission, environment)
    elif submission in known_policies():
        policy = find_policy(submission, environment)
    else:
        from uavdh_lite.checkpoint import load_agent  # the others need no PyTorch

        policy = load_agent(submission).over(environment.cities)
    flights = evaluate(environment, policy, scenario, asked.episodes, asked.seed, Use.CHALLENGE)
    metrics = flights.metrics()
    write_json(answer, {name: metrics[name] for name in METRICS})


class Leaderboard:
    """A JSON file with the newest score of each name; a failure does not replace it.

    Processes that write at once wait for each other.
    """

    def __init__(self, path: Path):
        self.path = path

    def add(self, challenge: Challenge, score: dict) -> None:
        """Enter a score; `InputError` if the file is the board of another challenge."""
        about = {"scenario": challenge.scenario, "episodes": challenge.episodes}
        empty: dict = {**about, "fingerprint": challenge.fingerprint, "scores": {}, "failures": []}
        with FileLock(f"{self.path}.lock"):
            board: dict = self._read() if self.path.exists() else empty
            if board["fingerprint"] != challenge.fingerprint:
                raise InputError(f"{self.path} is the board of another challenge: take another")
            if score["failed"]:
                board["failures"].append(score)
            else:
                board["scores"][score["name"]] = score
            write_json(self.path, board)

    def table(self) -> str:
        """The board as a Markdown table, the largest share collected and landed first."""
        board = self._read()
        scores = sorted(board["scores"].values(), key=lambda one: -one[METRICS[0]][0])
        lines = [
            f"{board['scenario']}, {board['episodes']} hidden missions ({board['fingerprint']})",
            "",
            "| | name | collected and landed | landed | return | seconds |",
            "| --- | --- | --- | --- | --- | --- |",
        ]
        for rank, one in enumerate(scores, 1):
            shares = [
                f"{mean:.1%} ({low:.1%} to {high:.1%})"
                for mean, low, high in (one[name] for name in METRICS[:2])
            ]
            mean, low, high = one["return"]
            name = one["name"].replace("|", "/")
            cells = (rank, name, *shares, f"{mean:.1f} ({low:.1f} to {high:.1f})", one["seconds"])
            lines.append("| " + " | ".join(map(str, cells)) + " |")
        failed = [f"- {one['name']}, {one['when']}: {one['failed']}" for one in board["failures"]]
        return "\n".join([*lines, *(["", "Failed:", "", *failed] if failed else [])])

    def _read(self) -> dict:
        return _read(self.path, {"scenario", "episodes", "fingerprint", "scores", "failures"})


def _read(path: Path, expected: set[str]) -> dict:
    """A JSON object with exactly these keys; `InputError` that names the file otherwise."""
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as JSON ({error})") from None
    if not isinstance(values, dict) or set(values) != expected:
        raise InputError(f"{path}: expected a JSON object with {', '.join(sorted(expected))}")
    return values


if __name__ == "__main__":
    fly_submission(*sys.argv[1:])
