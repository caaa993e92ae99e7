"""`challenge`: a competition for a class."""

from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter
from cyclopts.validators import Number

from uavdh_lite.cli.options import Count
from uavdh_lite.course.challenge import SCORED, Challenge, enter, entry_name, opened
from uavdh_lite.course.challenge import leaderboard as board_of
from uavdh_lite.course.challenge import score as flown_score
from uavdh_lite.course.walls import program
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import Interval
from uavdh_lite.experiments.report import interval_text

challenge = App("challenge", help="Score a class's submissions on missions that nobody has seen.")


@challenge.command
def new(file: Path, /, *, scenario: str = "manhattan", episodes: Count = 1000) -> None:
    """Draw hidden missions and keep them in a file.

    Arguments:
        file: the secret file; do not hand it out.
        scenario: a preset's name, of a single city.
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
    scenario: str | None = None,
    seconds: Annotated[float, Parameter(validator=Number(gt=0, lte=86_400))] = 300,
    unprotected: bool = False,
) -> None:
    """Fly submissions and print their scores.

    Without --secret they fly the practice set. A file's score is entered under its folder and name,
    as in alice/my_policy.

    Arguments:
        submission: random, greedy, genie, a shipped agent's name, a checkpoint, a Python file with
            policy(environment, state), or a folder with such a policy.py. It can read nothing else.
        submissions: more of them.
        secret: the file that challenge new made.
        leaderboard: a file to enter the scores in.
        scenario: the practice set's preset, by default manhattan; a secret has its own.
        seconds: time limit of a submission.
        unprotected: run it without walls, with all that you may do: for code that you have read.
    """
    if secret and scenario is not None:
        raise InputError("--scenario is that of the practice set: --secret has its own")
    flown = Challenge.load(secret) if secret else Challenge(scenario or "manhattan")
    every = (submission, *submissions)
    names = [entry_name(one) for one in every]  # all are looked at before the first flies
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(f"{twice[0]}: is there twice, and one would replace the other: rename it")
    if not (secret or unprotected):  # for practice, on a student's own machine
        try:
            program()
        except InputError:
            print("Nothing here keeps a submission apart: it runs with all that you may do.")
            unprotected = True
    kept: AbstractContextManager[dict] = nullcontext({})
    with opened(leaderboard, flown) if leaderboard else kept as board:
        for path in every:
            result = flown_score(flown, path, seconds, unprotected)
            called = result["name"]
            if result["failed"]:
                print(f"{called}: failed: {result['failed']}")
            else:
                means = (f"{m} {interval_text(m, Interval(*result[m]))}" for m in SCORED)
                print(f"{called}: {', '.join(means).replace('_', ' ')}, {result['seconds']} s")
            if leaderboard and (before := enter(leaderboard, board, result)):
                print(f"{called}: replaces the score of {before['when']}")


@challenge.command
def show(leaderboard: Path, /) -> None:
    """Print a leaderboard.

    Arguments:
        leaderboard: the file.
    """
    print(board_of(leaderboard))
