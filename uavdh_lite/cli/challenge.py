"""`challenge`: a competition for a class."""

from pathlib import Path

from cyclopts import App
from cyclopts.types import PositiveFloat, PositiveInt

from uavdh_lite.course.challenge import METRICS, Challenge, enter
from uavdh_lite.course.challenge import leaderboard as board_of
from uavdh_lite.course.challenge import score as flown_score
from uavdh_lite.evaluation import Interval
from uavdh_lite.experiments.report import interval_text

challenge = App("challenge", help="Score a class's submissions on missions that nobody has seen.")


@challenge.command
def new(file: Path, /, *, scenario: str = "manhattan", episodes: PositiveInt = 1000) -> None:
    """Draw hidden missions and keep them in a file.

    Arguments:
        file: the secret file; do not hand it out.
        scenario: a preset's name.
        episodes: number of missions.
    """
    Challenge.hidden(scenario, episodes).save(file)
    print(f"{file}: {episodes} missions of {scenario}, hidden")


@challenge.command
def score(
    submission: str,
    /,
    *submissions: str,
    secret: Path | None = None,
    leaderboard: Path | None = None,
    scenario: str = "manhattan",
    seconds: PositiveFloat = 300,
) -> None:
    """Fly submissions and print their scores.

    Without --secret they fly the practice set.

    Arguments:
        submission: random, greedy, genie, a shipped agent's name, a checkpoint, or a Python file
            with policy(environment, state).
        submissions: more of them.
        secret: the file that challenge new made.
        leaderboard: a file to enter the scores in.
        scenario: the practice set's preset.
        seconds: time limit of a submission.
    """
    flown = Challenge.load(secret) if secret else Challenge(scenario)
    for path in (submission, *submissions):
        result = flown_score(flown, path, seconds)
        if result["failed"]:
            print(f"{result['name']}: failed: {result['failed']}")
        else:
            means = (f"{m} {interval_text(m, Interval(*result[m]))}" for m in METRICS)
            print(f"{result['name']}: {', '.join(means).replace('_', ' ')}, {result['seconds']} s")
        if leaderboard:
            enter(leaderboard, flown, result)


@challenge.command
def show(leaderboard: Path, /) -> None:
    """Print a leaderboard.

    Arguments:
        leaderboard: the file.
    """
    print(board_of(leaderboard))
