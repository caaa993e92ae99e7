"""Hidden missions, what a submission scores on them, and the leaderboard."""

import hashlib
import json
import secrets
import time
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from uavdh_lite.city import City
from uavdh_lite.course.challenge.referee import Submission, SubmissionFailed
from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import Flights, Interval, Policy, evaluate
from uavdh_lite.policies import find_policy, known_policies
from uavdh_lite.scenario import find_scenario
from uavdh_lite.storage import write_json
from uavdh_lite.streams import Use

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
        text = json.dumps([self.scenario, self.episodes, self.seed])
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def save(self, path: Path) -> None:
        if path.exists():
            raise InputError(f"{path} exists: its missions would be lost; take another name")
        write_json(path, asdict(self))

    @classmethod
    def load(cls, path: Path) -> "Challenge":
        values = _read(path)
        if set(values) != {"scenario", "episodes", "seed"}:
            raise InputError(f"{path}: not a challenge: expected scenario, episodes and seed")
        return cls(**values)


@dataclass(frozen=True)
class Score:
    """What a submission scored, with 95 % intervals (mean, low, high), or why it failed.

    `cral`: collection ratio and landed. `cumulative_reward`: with the paper's constants. `sha256`:
    of the submitted file, to tell which one it was.
    """

    name: str
    sha256: str | None
    when: str
    seconds: float
    has_landed: Interval | None = None
    cral: Interval | None = None
    cumulative_reward: Interval | None = None
    failed: str | None = None


def score(
    challenge: Challenge, submission: str, seconds: float = 300, memory_mb: float = 2000
) -> Score:
    """Fly a submission on the challenge's missions.

    Arguments:
        submission: `random`, `greedy`, `genie`, a shipped agent's name, a checkpoint, or a Python
            file with `policy(environment, state)`. Files run in a process of their own.
        seconds, memory_mb: limits of that process.

    A submission that fails gets a score that says why; no error is raised.
    """
    scenario = find_scenario(challenge.scenario)
    environment = Environment(City.load(scenario.city))
    started = time.perf_counter()
    path = Path(submission)
    known = submission in known_policies()
    if not known and not path.is_file():
        raise InputError(f"submission {submission}: no such file, planner or shipped agent")
    blank = Score(
        name=submission if known else path.stem,
        sha256=None if known else hashlib.sha256(path.read_bytes()).hexdigest(),
        when=datetime.now(UTC).isoformat(timespec="seconds"),
        seconds=0.0,
    )

    def fly(policy: Policy) -> Flights:
        return evaluate(
            environment, policy, scenario, challenge.episodes, challenge.seed, Use.CHALLENGE
        )

    try:
        if known:
            flights = fly(find_policy(submission, environment))
        else:
            with Submission(path, scenario.city, seconds, memory_mb) as policy:
                flights = fly(policy)
    except SubmissionFailed as error:
        took = round(time.perf_counter() - started, 1)
        return replace(blank, seconds=took, failed=str(error))
    metrics = flights.metrics()
    return replace(
        blank,
        seconds=round(time.perf_counter() - started, 1),
        has_landed=metrics["has_landed"],
        cral=metrics["collection_ratio_and_landed"],
        cumulative_reward=metrics["cumulative_reward"],
    )


class Leaderboard:
    """A JSON file with the newest score of each name; a failure does not replace it."""

    def __init__(self, path: Path):
        self.path = path

    def add(self, challenge: Challenge, score: Score) -> None:
        """Enter a score; `InputError` if the file is the board of another challenge."""
        board = self._read() if self.path.exists() else None
        if board is None:
            about = {"scenario": challenge.scenario, "episodes": challenge.episodes}
            board = {**about, "fingerprint": challenge.fingerprint, "scores": {}, "failures": []}
        if board["fingerprint"] != challenge.fingerprint:
            raise InputError(f"{self.path} is the board of another challenge: take another file")
        if score.failed is None:
            board["scores"][score.name] = asdict(score)
        else:
            board["failures"].append(asdict(score))
        write_json(self.path, board)

    def table(self) -> str:
        """The board as a Markdown table, best collection ratio and landed first."""
        board = self._read()
        lines = [
            f"{board['scenario']}, {board['episodes']} hidden missions ({board['fingerprint']})",
            "",
            "| | name | collected and landed | landed | return | seconds |",
            "| --- | --- | --- | --- | --- | --- |",
        ]
        scores = sorted(board["scores"].values(), key=lambda one: -one["cral"][0])
        for rank, one in enumerate(scores, 1):
            cral, landed = (_percent(one[key]) for key in ("cral", "has_landed"))
            mean, low, high = one["cumulative_reward"]
            reward = f"{mean:.1f} ({low:.1f} to {high:.1f})"
            name = one["name"].replace("|", "/")
            lines.append(f"| {rank} | {name} | {cral} | {landed} | {reward} | {one['seconds']} |")
        if board["failures"]:
            lines += ["", "Failed:", ""]
            lines += [
                f"- {one['name']}, {one['when']}: {one['failed']}" for one in board["failures"]
            ]
        return "\n".join(lines)

    def _read(self) -> dict:
        board = _read(self.path)
        if not {"scenario", "episodes", "fingerprint", "scores", "failures"} <= board.keys():
            raise InputError(f"{self.path}: not a leaderboard")
        return board


def _percent(interval) -> str:
    mean, low, high = (f"{100 * value:.1f}" for value in interval)
    return f"{mean} % ({low} to {high})"


def _read(path: Path) -> dict:
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(f"{path}: not JSON: {error}") from error
    if not isinstance(values, dict):
        raise InputError(f"{path}: expected a JSON object")
    return values
