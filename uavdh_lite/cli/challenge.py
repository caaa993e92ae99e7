"""`challenge`: a competition for a class."""

from pathlib import Path
from typing import TYPE_CHECKING

from cyclopts import App
from cyclopts.types import PositiveFloat, PositiveInt

from uavdh_lite.errors import InputError

if TYPE_CHECKING:
    from uavdh_lite.course.challenge.board import Score

challenge = App("challenge", help="Score a class's submissions on missions that nobody has seen.")


@challenge.command
def new(file: Path, /, *, scenario: str = "manhattan", episodes: PositiveInt = 1000) -> None:
    """Draw hidden missions and keep them in a file.

    Arguments:
        file: the secret file; do not hand it out.
        scenario: a preset's name.
        episodes: number of missions.
    """
    from uavdh_lite.course.challenge.board import Challenge

    hidden = Challenge.hidden(scenario, episodes)
    hidden.save(file)
    print(f"{file}: {hidden.episodes} missions of {hidden.scenario}, hidden")


@challenge.command
def score(
    submission: str,
    /,
    *submissions: str,
    secret: Path | None = None,
    leaderboard: Path | None = None,
    scenario: str = "manhattan",
    seconds: PositiveFloat = 300,
    memory_mb: PositiveFloat = 2000,
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
        memory_mb: memory limit of a submission, MB.
    """
    from uavdh_lite.course.challenge import board

    flown = board.Challenge.load(secret) if secret else board.Challenge(scenario)
    for path in (submission, *submissions):
        result = board.score(flown, path, seconds, memory_mb)
        print(f"{result.name:<24}{_in_words(result)}")
        if leaderboard:
            board.Leaderboard(leaderboard).add(flown, result)


def _in_words(score: "Score") -> str:
    if score.failed:
        return f"failed: {score.failed}"
    assert score.cral and score.has_landed and score.cumulative_reward
    mean, low, high = score.cral
    return (
        f"collected and landed {mean:.1%} ({low:.1%} to {high:.1%}), "
        f"landed {score.has_landed.mean:.1%}, return {score.cumulative_reward.mean:.1f}, "
        f"{score.seconds} s"
    )


@challenge.command
def show(leaderboard: Path, /) -> None:
    """Print a leaderboard.

    Arguments:
        leaderboard: the file.
    """
    from uavdh_lite.course.challenge.board import Leaderboard

    if not leaderboard.exists():
        raise InputError(f"{leaderboard}: no such leaderboard")
    print(Leaderboard(leaderboard).table())
