"""The challenge: scores are those of `evaluate`, and a bad submission costs only itself."""

import json
import subprocess
import sys
import time

import pytest

from uavdh_lite.city import City
from uavdh_lite.cli.main import main
from uavdh_lite.course.challenge import METRICS, Challenge, enter, leaderboard, score
from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import evaluate
from uavdh_lite.planners import Greedy
from uavdh_lite.scenario import find_scenario
from uavdh_lite.storage import data_folder
from uavdh_lite.streams import Use

pytestmark = pytest.mark.long  # each submission is a process of its own, some of which hang

SMALL = Challenge("village", episodes=40)
GREEDY = """
from uavdh_lite.planners import Greedy

def policy(environment, state):
    print("what a policy prints does no harm")
    return Greedy(environment).act(state)
"""
BAD = {
    "no function": ("x = 1", "has no function policy(environment, state)"),
    "an error": ("def policy(environment, state):\n    return 1 / 0", "division by zero"),
    "a wrong action": (
        "import numpy\ndef policy(environment, state):\n    return numpy.full(len(state), 6)",
        "action 6 of episode 0",
    ),
    "no whole number": (
        "import numpy\ndef policy(environment, state):\n    return numpy.full(len(state), 4.9)",
        "action 4.9 of episode 0",
    ),
    "an exit": ("import os\nos._exit(0)", "gave no answer"),
}
HANGS = {
    "a loop": "while True:\n    pass",
    # Finding: the referee waited for the descriptors, which this one closes, for ever
    "closed descriptors": "import os, time\nos.closerange(0, 100)\ntime.sleep(60)",
    "a child": "import subprocess\nsubprocess.run(['sleep', '60'])",
}


@pytest.fixture
def submit(tmp_path):
    def write(text, name="submission.py"):
        path = tmp_path / name
        path.write_text(text)
        return str(path)

    return write


def test_a_policy_in_its_own_process_scores_what_it_scores_in_this_one(submit):
    own, known = score(SMALL, submit(GREEDY)), score(SMALL, "greedy")
    environment = Environment(City.load("village"))
    metrics = evaluate(
        environment, Greedy(environment), find_scenario("village"), 40, SMALL.seed, Use.CHALLENGE
    ).metrics()
    assert own["failed"] is None and own["name"] == "submission"
    for name in METRICS:
        assert own[name] == known[name] == list(metrics[name])


def test_a_checkpoint_is_flown(tmp_path):
    path = data_folder() / "checkpoints" / "manhattan_ddqn.safetensors"
    result = score(Challenge("manhattan", 20), str(path))
    assert result["failed"] is None and result["landed"][0] > 0.8


@pytest.mark.parametrize("kind", BAD)
def test_a_bad_submission_fails_and_says_why(kind, submit):
    text, reason = BAD[kind]
    assert reason in score(SMALL, submit(text))["failed"]


@pytest.mark.parametrize("kind", HANGS)
def test_a_submission_that_hangs_ends_in_time(kind, submit):
    started = time.monotonic()
    assert score(SMALL, submit(HANGS[kind]), seconds=2)["failed"] == "took more than 2 s"
    assert time.monotonic() - started < 10


def test_an_unknown_submission_is_refused():
    with pytest.raises(InputError, match=r"nobody\.py"):
        score(SMALL, "nobody.py")


def test_no_score_is_lost_when_ten_processes_write_at_once(tmp_path):
    path = tmp_path / "board.json"
    code = (
        "import sys; from pathlib import Path; "
        "from uavdh_lite.course.challenge import METRICS, Challenge, enter; "
        "input(); path, own = Path(sys.argv[1]), sys.argv[2]; "
        "[enter(path, Challenge('village', 40), dict.fromkeys(METRICS, [0, 0, 0]) "
        "| {'name': own + str(k), 'failed': None}) for k in range(4)]"
    )
    writers = [
        subprocess.Popen([sys.executable, "-c", code, path, f"{k}-"], stdin=subprocess.PIPE)
        for k in range(10)
    ]
    for writer in writers:  # all wait for this, then begin together
        writer.stdin.write(b"\n")
        writer.stdin.close()
    assert [writer.wait() for writer in writers] == [0] * 10
    assert len(json.loads(path.read_text())["scores"]) == 40


@pytest.mark.parametrize("scenario", ["manhattan", "open_field"])
def test_the_boards_of_the_practice_sets_load(scenario):
    table = leaderboard(data_folder() / "challenge" / f"practice-{scenario}.json")
    assert f"{scenario}, 1000 hidden missions" in table and "| greedy |" in table


def test_the_board_ranks_and_keeps_failures_apart(tmp_path):
    board = tmp_path / "board.json"
    for name, share in (("second", 0.5), ("first", 0.9)):
        numbers = {name: [share] * 3 for name in METRICS}
        enter(board, SMALL, {"name": name, "failed": None, **numbers})
    enter(board, SMALL, {"name": "first", "failed": "a reason"})
    table = leaderboard(board)
    places = [table.index(part) for part in ("| 1 | first", "| 2 | second", "failed: first: a")]
    assert places == sorted(places)
    for other in (Challenge("village", 41), Challenge("village", 40, seed=1)):
        with pytest.raises(InputError, match="another challenge"):
            enter(board, other, {"name": "x", "failed": "y"})


def test_hidden_missions_differ_and_are_not_overwritten(tmp_path):
    first, second = (Challenge.hidden("village", 5) for _ in range(2))
    assert first.seed != second.seed
    first.save(tmp_path / "secret.json")
    assert Challenge.load(tmp_path / "secret.json") == first
    with pytest.raises(InputError, match="exists"):
        second.save(tmp_path / "secret.json")
    (tmp_path / "other.json").write_text("[]")
    with pytest.raises(InputError, match=r"other\.json"):
        Challenge.load(tmp_path / "other.json")


def test_the_commands(tmp_path, capsys, submit):
    secret, board = tmp_path / "secret.json", tmp_path / "board.json"
    assert main(f"challenge new {secret} --scenario village --episodes 5".split()) == 0
    command = f"challenge score greedy {submit(GREEDY)} --secret {secret} --leaderboard {board}"
    assert main(command.split()) == 0
    assert main(f"challenge show {board}".split()) == 0
    assert "| 1 |" in capsys.readouterr().out
