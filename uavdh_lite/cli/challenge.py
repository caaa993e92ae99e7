"""`python -m uavdh_lite challenge new`, `score` and `show`."""

import argparse
from pathlib import Path

from uavdh_lite.cli.arguments import positive
from uavdh_lite.errors import InputError


def add_commands(commands) -> None:
    """Add `challenge` to the command line's subcommands."""
    challenge = commands.add_parser(
        "challenge",
        help="hidden scenarios, submissions and a leaderboard, for a class",
        description="Score submissions on scenarios that nobody has seen.",
    ).add_subparsers(required=True, metavar="COMMAND")

    new = challenge.add_parser("new", help="draw hidden scenarios, and keep them in a file")
    new.add_argument("file", type=Path, help="the secret: do not hand it out")
    new.add_argument("--scenario", default="manhattan", help="a preset's name (%(default)s)")
    new.add_argument("--episodes", type=positive, default=1000, help="number (%(default)s)")
    new.set_defaults(run=_new)

    score = challenge.add_parser(
        "score",
        help="fly submissions",
        description="Fly submissions: random, greedy, genie, a shipped agent's name, a checkpoint, "
        "or a Python file with policy(environment, state). Without --secret on the practice set.",
    )
    score.add_argument("submissions", nargs="+", metavar="SUBMISSION")
    score.add_argument("--secret", type=Path, metavar="FILE", help="the file that `new` made")
    score.add_argument("--leaderboard", type=Path, metavar="FILE", help="enter the scores here")
    score.add_argument("--scenario", default="manhattan", help="of the practice set (%(default)s)")
    score.add_argument(
        "--seconds", type=float, default=300, help="a submission's time (%(default)s)"
    )
    score.add_argument(
        "--memory-mb", type=float, default=2000, help="a submission's memory (%(default)s)"
    )
    score.set_defaults(run=_score)

    show = challenge.add_parser("show", help="print a leaderboard")
    show.add_argument("leaderboard", type=Path)
    show.set_defaults(run=_show)


def _new(options: argparse.Namespace) -> None:
    from uavdh_lite.course.challenge.board import Challenge

    challenge = Challenge.hidden(options.scenario, options.episodes)
    challenge.save(options.file)
    print(f"{options.file}: {challenge.episodes} scenarios of {challenge.scenario}, hidden")


def _score(options: argparse.Namespace) -> None:
    from uavdh_lite.course.challenge.board import Challenge, Leaderboard, score

    challenge = Challenge.load(options.secret) if options.secret else Challenge(options.scenario)
    for submission in options.submissions:
        result = score(challenge, submission, options.seconds, options.memory_mb)
        if result.failed:
            print(f"{result.name:<24}failed: {result.failed}")
        else:
            assert result.cral and result.has_landed and result.cumulative_reward
            (cral, low, high), landed = result.cral, result.has_landed[0]
            print(
                f"{result.name:<24}collected and landed {cral:.1%} ({low:.1%} to {high:.1%}), "
                f"landed {landed:.1%}, return {result.cumulative_reward[0]:.1f}, "
                f"{result.seconds} s"
            )
        if options.leaderboard:
            Leaderboard(options.leaderboard).add(challenge, result)


def _show(options: argparse.Namespace) -> None:
    from uavdh_lite.course.challenge.board import Leaderboard

    if not options.leaderboard.exists():
        raise InputError(f"{options.leaderboard}: no such leaderboard")
    print(Leaderboard(options.leaderboard).table())
