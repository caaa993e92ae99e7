"""The challenge: scores are those of `evaluate`, and a bad submission costs only itself."""

import json
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path
from unittest.mock import Mock

import pytest

from uavdh_lite.city import City
from uavdh_lite.cli.main import main
from uavdh_lite.course.challenge import (
    SCORED,
    Challenge,
    enter,
    entry_name,
    leaderboard,
    opened,
    score,
)
from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import evaluate
from uavdh_lite.planners import Greedy
from uavdh_lite.scenario import find_scenario
from uavdh_lite.storage import data_folder
from uavdh_lite.streams import Use

pytestmark = [  # each submission is a process of its own, some of which hang
    pytest.mark.long,
    pytest.mark.skipif(not shutil.which("bwrap"), reason="bubblewrap is not installed"),
]

ENTRY = {"name": "a", "failed": None, "when": "", **{n: [0, 0, 0] for n in SCORED}}
PRACTICE = Challenge("village", episodes=40)
GREEDY = """
from uavdh_lite.planners import Greedy

def policy(environment, state):
    print("what a policy prints does no harm")
    assert not state.ended.any()
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
    "closed descriptors": ("import os, time\nos.closerange(0, 100)\ntime.sleep(2)", "no answer"),
    "a question to nobody": ("input()", "EOFError"),
    "a flood": (
        "import sys\nsys.stderr.write('x' * 10**8 + chr(10))\nraise RuntimeError('the reason')",
        "RuntimeError: the reason",
    ),
    "what a terminal obeys": ("raise OSError('\\x1b[2J | \\u202e')", r"OSError: \x1b[2J | \u202e"),
    "an answer of its own": (  # what is no action, by every way out of its process
        "import os\nfor n in range(64):\n    try:\n        os.write(n, b'[1]' * 99)\n"
        "    except OSError:\n        pass\ndef policy(environment, state):\n    return state.city",
        "what it gives cannot be read",
    ),
    "a loop": ("while True:\n    pass", "took more than 2 s"),
    "a child": ("import subprocess\nsubprocess.run(['sleep', '60'])", "took more than 2 s"),
    # It keeps the pipes open when the submission itself has been ended
    "a daemon": (
        "import os, time\nif not os.fork():\n    os.setsid()\ntime.sleep(20)",
        "took more than 2 s",
    ),
    "endless printing": ("while True:\n    print('x' * 10_000)", "took more than 2 s"),
}


@pytest.fixture
def submit(tmp_path):
    def write(text, name="submission.py"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
        return str(path)

    return write


def test_a_policy_in_its_own_process_scores_what_it_scores_in_this_one(submit):
    own, known = score(PRACTICE, submit(GREEDY)), score(PRACTICE, "greedy")
    submit(GREEDY, "alice/mine.py")
    folder = Path(submit("from mine import policy", "alice/policy.py")).parent
    by_import = score(PRACTICE, str(folder))
    assert by_import["name"] == "alice"
    environment = Environment(City.load("village"))
    metrics = evaluate(
        environment, Greedy(environment), find_scenario("village"), 40, PRACTICE.seed, Use.CHALLENGE
    ).metrics()
    assert own["failed"] is None and own["name"].endswith("/submission")
    for name in SCORED:
        assert own[name] == known[name] == by_import[name] == list(metrics[name])


def test_a_checkpoint_is_flown(tmp_path):
    path = data_folder() / "checkpoints" / "manhattan_ddqn.safetensors"
    result = score(Challenge("manhattan", 20), str(path))
    assert result["failed"] is None and result["landed"][0] > 0.8


@pytest.mark.parametrize("kind", BAD)
def test_a_bad_submission_fails_in_time_and_says_why(kind, submit):
    (text, reason), started = BAD[kind], time.monotonic()
    late = reason.startswith("took")
    assert reason in score(PRACTICE, submit(text), seconds=2 if late else 300)["failed"]
    assert not late or time.monotonic() - started < 10


@pytest.fixture
def heard():
    """Interrupts are heard by what a test starts, also where the tests run in the background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("heard")
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no process groups")
@pytest.mark.parametrize(
    "number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.longest)]
)
def test_a_submission_ends_with_the_command_that_flies_it(number, submit, tmp_path):
    path = submit("import time\ntime.sleep(600)", f"{tmp_path.name}.py")

    def running():
        every = [p.read_bytes() for p in Path("/proc").glob("[0-9]*/cmdline") if p.exists()]
        return [one for one in every if f"/sheet/{tmp_path.name}.py".encode() in one]

    command = [sys.executable, "-m", "uavdh_lite", "challenge", "score", path]
    with subprocess.Popen([*command, "--scenario", "village"]) as process:
        while not running():
            assert process.poll() is None
            time.sleep(0.1)
        process.send_signal(number)
        assert process.wait(200) in (130, -signal.SIGTERM)
    for _ in range(50):
        if not running():
            return
        time.sleep(0.1)
    raise AssertionError("it flies on")


@pytest.mark.parametrize("scenario", ["manhattan", "open_field"])
def test_the_boards_of_the_practice_sets_load(scenario):
    table = leaderboard(data_folder() / "challenge" / f"practice-{scenario}.json")
    assert f"{scenario}, 1000 practice missions" in table and "| greedy |" in table


def test_the_board_ranks_and_keeps_failures_apart(tmp_path):
    path = tmp_path / "board.json"
    with opened(path, PRACTICE) as board:
        scores = {"fourth": (0.5, 0.1, 9), "second": (0.5, 0.5, 1), "too": (0.5, 0.5, 1)}
        for name, numbers in (scores | {"first": (0.9, 0, 0)}).items():
            numbers = {it: [number] * 3 for it, number in zip(SCORED, numbers, strict=True)}
            enter(path, board, ENTRY | {"name": name, **numbers})
        enter(path, board, {"name": "first", "failed": "a reason", "when": ""})
    table = leaderboard(path)
    expected = ["| 1 | first", "| 2 | second", "| 2 | too", "| 4 | fourth", "failed: first: a"]
    places = [table.index(part) for part in expected]
    assert places == sorted(places)
    for other in (Challenge("village", 41), Challenge("village", 40, seed=1)):
        with pytest.raises(InputError, match="another challenge"), opened(path, other):
            pass


def test_hidden_missions_differ_and_are_not_overwritten(tmp_path):
    first, second = (Challenge.hidden("village", 5) for _ in range(2))
    assert first.seed != second.seed
    first.save(tmp_path / "secret.json")
    assert Challenge.load(tmp_path / "secret.json") == first
    with pytest.raises(InputError, match="exists"):
        second.save(tmp_path / "secret.json")
    if sys.platform != "win32":
        assert (tmp_path / "secret.json").stat().st_mode & 0o777 == 0o600
    for wrong in ({"scenario": "nowhere"}, {"x": 1}):
        (tmp_path / "other.json").write_text(json.dumps(asdict(first) | wrong))
        with pytest.raises(InputError, match=r"other\.json"):
            Challenge.load(tmp_path / "other.json")


def test_the_commands(tmp_path, capsys, submit):
    secret, board = tmp_path / "secret.json", tmp_path / "board.json"
    assert main(f"challenge new {secret} --scenario village --episodes 5".split()) == 0
    command = f"challenge score greedy {submit(GREEDY)} --secret {secret} --leaderboard {board}"
    assert main(command.split()) == 0
    assert main(command.split()) == 0 and "greedy: replaces the score" in capsys.readouterr().out
    assert main(f"challenge show {board}".split()) == 0
    assert "| 1 |" in capsys.readouterr().out
    both = [str(Path(submit("", f"carol/{name}/policy.py")).parent) for name in ("", "carol")]
    assert main(["challenge", "score", *both]) == 2
    assert "carol: is there twice" in capsys.readouterr().err


DAMAGED = {
    "a list": [],
    "nothing": {},
    "scores in a list": {"scores": [1]},
    "a score that is text": {"scores": {"a": "x"}},
    "a score without numbers": {"scores": {"a": ENTRY | {"landed": []}}},
    "a score of words": {"scores": {"a": ENTRY | {"return": ["x", "y", "z"]}}},
    "a score that is not there": {"scores": {"a": {"name": "a"}}},
    "a failure that is a number": {"failures": [3]},
    "a scenario of its own": {"scenario": "nowhere"},
}


@pytest.mark.parametrize("kind", DAMAGED)
def test_a_damaged_board_is_named_in_one_line(kind, tmp_path, capsys):
    path, damage = tmp_path / "board.json", DAMAGED[kind]
    with opened(path, PRACTICE) as board:
        enter(path, board, ENTRY)
    path.write_text(json.dumps(json.loads(path.read_text()) | damage if damage else damage))
    for command in (["show", str(path)], ["score", "greedy", "--leaderboard", str(path)]):
        assert main(["challenge", *command]) == 2
        said = capsys.readouterr().err
        assert f"{path}: " in said and said.count("\n") == 1


def test_what_a_table_would_not_show_is_escaped(tmp_path):
    path = tmp_path / "board.json"
    with opened(path, PRACTICE) as board:
        for odd in ({"failed": "\x1b|\n"}, {}):
            enter(path, board, ENTRY | {"name": "\x1b|\n"} | odd)
    table = leaderboard(path)
    assert "- failed: \\x1b&#124;\\n: \\x1b&#124;\\n" in table
    assert "| 1 | \\x1b&#124;\\n | 0.0%" in table


def test_scenarios_that_would_not_be_flown_are_refused(tmp_path, capsys, monkeypatch):
    secret = tmp_path / "secret.json"
    assert main(["challenge", "new", str(secret), "--scenario", "any_city"]) == 2
    assert "has many cities" in capsys.readouterr().err and not secret.exists()
    with monkeypatch.context() as full, pytest.raises(OSError, match="full"):
        full.setattr(json, "dump", Mock(side_effect=OSError("full")))
        PRACTICE.save(secret)  # and nothing of it stays in the way
    PRACTICE.save(secret)
    both = ["--secret", str(secret), "--scenario", "manhattan"]
    assert main(["challenge", "score", "greedy", *both]) == 2
    assert "--secret has its own" in capsys.readouterr().err


def test_a_submission_has_a_name_of_its_own(submit, tmp_path):
    mine, theirs = (submit("", f"{who}/my_policy.py") for who in ("a", "b"))
    assert [entry_name(one) for one in (mine, theirs, "greedy")] == [
        *("a/my_policy", "b/my_policy", "greedy")
    ]
    submit("", "greedy/policy.py")
    for wrong, said in (("greedy", "not the name of a planner"), ("nobody.py", "no such file")):
        with pytest.raises(InputError, match=said):
            entry_name(str(tmp_path / wrong))


def test_a_submission_is_not_told_the_seed(submit):
    """It may look into its arguments, its environment and all of its memory."""
    text = """
import gc, os, sys
from functools import cache
@cache
def look():
    seen = [sys.argv, dict(os.environ), *(vars(m) for m in sys.modules.values() if m)]
    found = repr(seen) + repr([o for o in gc.get_objects() if type(o) is dict])
    assert "".join(["86420", "97531"]) not in found  # which is not in this text itself
def policy(environment, state):
    look()
    return environment.next_cell[0][state.uav_cell].argmin(1)
"""
    assert score(Challenge("village", 3, seed=8642097531), submit(text))["failed"] is None
